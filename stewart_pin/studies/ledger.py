"""Results of a sweep as they come in, in any order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from stewart_pin.errors import InputError
from stewart_pin.studies.answers import Answer, NoAnswer, Results
from stewart_pin.studies.points import Point, Points, words
from stewart_pin.studies.record import FailedPoint, Sweep
from stewart_pin.typing import BoolArray, FloatArray


class Ledger:
    """Arrays that fill up while a sweep goes on.

    Parameters
    ----------
    points
        Points of the sweep.
    """

    def __init__(self, points: Points) -> None:
        self.points = points
        self.done: BoolArray = np.zeros(points.size, dtype=bool)
        self.begun: BoolArray = np.zeros(points.size, dtype=bool)
        self.count = 0
        self._results: dict[str, FloatArray] = {}
        self._failed: dict[int, NoAnswer] = {}
        self._model = -1

    def tasks(self, groups: np.ndarray | None, chunk: int) -> Iterator[tuple[list[int], list[Point]]]:
        """Cut what is left to do into tasks.

        Parameters
        ----------
        groups
            (N,) index of the group of each point; a task holds points of one group. None: all are of one.
        chunk
            Most points in a task.

        Yields
        ------
        numbers : list of int
            Numbers of the points.
        points : list of dict
            Their parameters.
        """
        left = np.flatnonzero(~self.done)
        ends = [left.size]
        if groups is not None:
            left = left[np.argsort(groups[left], kind="stable")]
            ends = [*(np.flatnonzero(np.diff(groups[left])) + 1), left.size]
        begin = 0
        for end in ends:
            for start in range(begin, end, chunk):
                numbers = left[start : min(start + chunk, end)].tolist()
                self.begun[numbers] = True
                yield numbers, [self.points.at(number) for number in numbers]
            begin = end

    def in_hand(self, most: int) -> list[Point]:
        """List points that were begun and are not done.

        Parameters
        ----------
        most
            How many to list.

        Returns
        -------
        list of dict
            The first of them.
        """
        return [self.points.at(int(number)) for number in np.flatnonzero(self.begun & ~self.done)[:most]]

    def require_alike(self, numbers: Sequence[int], answers: Sequence[Answer]) -> None:
        """Check that answers have the names and shapes of those before.

        Parameters
        ----------
        numbers
            Numbers of the points.
        answers
            Answer of each.

        Raises
        ------
        InputError
            If one has not; names both points.
        """
        for number, answer in zip(numbers, answers, strict=True):
            if isinstance(answer, NoAnswer):
                continue
            if self._model < 0:
                self._begin(number, answer)
            known = {name: values.shape[1:] for name, values in self._results.items()}
            given = {name: values.shape for name, values in answer.items()}
            if given != known:
                raise InputError(
                    f"every point needs results of the same names and shapes: at {self._words(self._model)} they are "
                    f"{known}, at {self._words(number)} {given}"
                )

    def enter(self, numbers: Sequence[int], answers: Sequence[Answer]) -> None:
        """Enter answers.

        Parameters
        ----------
        numbers
            Numbers of the points.
        answers
            Answer of each.

        Raises
        ------
        InputError
            If one has other names or shapes than those before.
        """
        self.require_alike(numbers, answers)
        for number, answer in zip(numbers, answers, strict=True):
            if isinstance(answer, NoAnswer):
                self._failed[number] = answer
            else:
                for name, values in answer.items():
                    self._results[name][number] = values
            self.count += not self.done[number]
            self.done[number] = True

    def closed(self, name: str) -> Sweep:
        """Give the record.

        Parameters
        ----------
        name
            What was evaluated.

        Returns
        -------
        Sweep
            Results in the shape of the grid.
        """
        points = self.points
        failures = tuple(
            FailedPoint(points.index(number), points.at(number), answer.error, answer.message)
            for number, answer in sorted(self._failed.items())
        )
        results = {
            key: values.reshape(*points.shape, *values.shape[1:]) for key, values in self._results.items()
        }
        return Sweep(name, points.axes, points.paired, results, failures)

    def _begin(self, number: int, answer: Results) -> None:
        self._model = number
        self._results = {
            name: np.full((self.points.size, *values.shape), np.nan) for name, values in answer.items()
        }

    def _words(self, number: int) -> str:
        return words(self.points.at(number))
