"""What a function answered at the points of a study, wherever it ran."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar

import numpy as np

from stewart_pin.errors import InputError, MissingExtraError, StewartPinError
from stewart_pin.studies.points import Point, words
from stewart_pin.typing import FloatArray

T = TypeVar("T")
Results: TypeAlias = dict[str, FloatArray]
"""Named results of one point."""


@dataclass(frozen=True)
class NoAnswer:
    """Why a point has no results.

    Attributes
    ----------
    error
        Name of the class of the error.
    message
        Its text.
    """

    error: str
    message: str


Answer: TypeAlias = Results | NoAnswer
Study: TypeAlias = Callable[[Sequence[Point]], list[Answer]]
"""Answers a handful of points at once."""


@dataclass(frozen=True, eq=False)
class EachPoint:
    """A study that asks a function at one point after the other.

    Attributes
    ----------
    function
        Function of named parameters to a number, an array, or several by their names.
    """

    function: Callable[..., Any]

    def __call__(self, points: Sequence[Point]) -> list[Answer]:
        """Ask the function.

        Parameters
        ----------
        points
            Where.

        Returns
        -------
        list
            What it answered at each.
        """
        return [self._answer(point) for point in points]

    def _answer(self, point: Point) -> Answer:
        value = ask(lambda: self.function(**point), point)
        return value if isinstance(value, NoAnswer) else as_results(value, point)


def ask(call: Callable[[], T], point: Point) -> T | NoAnswer:
    """Take what a function gives at a point, and errors of the package for its answer.

    Parameters
    ----------
    call
        What gives.
    point
        Where; other errors than those of the package are sent on with a note that says so.

    Returns
    -------
    object or NoAnswer
        What it gave, or why it did not.
    """
    try:
        return call()
    except StewartPinError as error:
        if not isinstance(error, MissingExtraError):  # which says nothing about the point
            return NoAnswer(type(error).__name__, str(error))
        raise
    except Exception as error:
        note = f"at the point {words(point)} of the sweep"
        if not _travels(error):
            error = RuntimeError(f"{type(error).__name__}: {error}")
        error.add_note(note)
        raise error from error.__cause__


def _travels(error: Exception) -> bool:
    """Tell whether an error gets home from another process; one that does not breaks the pool, and is never read."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return False
    return True


def as_results(value: Any, point: Point) -> Results:
    """Check what a function gave.

    Parameters
    ----------
    value
        Number, array, or mapping of names to them.
    point
        Where, for messages.

    Returns
    -------
    dict
        Arrays by name; the name of one that has none is ``value`` [any unit].

    Raises
    ------
    InputError
        If it is none of these.
    """
    named = value if isinstance(value, Mapping) else {"value": value}
    results: Results = {}
    for name, given in named.items():
        try:
            array = np.asarray(given)
        except ValueError:  # rows of different lengths
            array = np.asarray(None)
        if not isinstance(name, str) or array.dtype.kind not in "biuf":
            raise InputError(
                f"the function must give real numbers, arrays of them, or a dict of these; at {words(point)} "
                f"{name!r} is {given!r:.60}"
            )
        results[name] = np.array(array, dtype=np.float64)
    return results
