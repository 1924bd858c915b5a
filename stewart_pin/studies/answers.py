"""What a function answered at the points of a study, wherever it ran, and what tasks bring along to the workers."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, TypeAlias, TypeVar

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.errors import InputError, MissingExtraError, StewartPinError
from stewart_pin.studies.points import Point, Points, words
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


# ----------------------------------------------------------------------------------------------------
# What tasks bring along to workers, where it arrives once
# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Carried:
    """Something that workers keep.

    Each task brings its study along, and the study its chain. A chain that was unpickled again would not be the chain
    whose kernels are compiled, so a worker goes on with the one that came first.

    Attributes
    ----------
    token
        Equal for what is the same, and for nothing else.
    value
        A study or a chain.
    """

    token: str
    value: Any = field(compare=False)

    def __reduce__(self) -> tuple[Any, ...]:
        return _arrived, (self.token, self.value)

    def __call__(self, points: Sequence[Point]) -> list[Answer]:
        """Let a study answer points.

        Parameters
        ----------
        points
            Where.

        Returns
        -------
        list
            Answer of each.
        """
        return self.value(points)


def _arrived(token: str, value: Any) -> Carried:
    return _first(Carried(token, value))


@lru_cache(maxsize=8)
def _first(carried: Carried) -> Carried:
    """Hand out the one that came first of all that are equal."""
    return carried


# ----------------------------------------------------------------------------------------------------
# What a sweep found
# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class FailedPoint:
    """A point of a sweep that has no results.

    Attributes
    ----------
    index
        Where it stands in the arrays.
    point
        Its parameters.
    error
        Name of the class of the error.
    message
        Its text.
    """

    index: tuple[int, ...]
    point: Point
    error: str
    message: str


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(Brief):
    """Results over the points of a sweep; ``sweep["force"]`` is one of them.

    Attributes
    ----------
    name
        What was evaluated.
    axes
        Values along each axis, by the name of its parameter [any unit].
    paired
        Whether the k-th values of all axes belong together: a list of points instead of a grid.
    results
        Arrays ``(*shape, ...)`` by name; nan at points that failed [any unit].
    failures
        Points that have no results, in their order.
    """

    name: str
    axes: Mapping[str, np.ndarray] = field(repr=False)
    paired: bool
    results: Mapping[str, FloatArray] = field(repr=False)
    failures: tuple[FailedPoint, ...] = field(repr=False)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the grid, or (N,) of a list of points."""
        return Points(self.axes, self.paired).shape

    @property
    def success(self) -> bool:
        """Whether every point has results."""
        return not self.failures

    def __getitem__(self, name: str) -> FloatArray:
        """Hand out one result.

        Parameters
        ----------
        name
            Its name.

        Returns
        -------
        numpy.ndarray
            (*shape, ...) its values at all points [any unit].

        Raises
        ------
        InputError
            If there is none of this name.
        """
        if name in self.results:
            return self.results[name]
        if self.results:
            raise InputError(f"the sweep of {self.name} gives {', '.join(self.results)}, not {name!r}")
        if not self.failures:
            raise InputError(f"the sweep of {self.name} has no point, and so no {name!r}")
        first = self.failures[0]
        raise InputError(
            f"the sweep of {self.name} has no {name!r}, for all {len(self.failures)} points failed; the first, "
            f"{words(first.point)}: {first.message}"
        )

    def __str__(self) -> str:
        lines = [f"{self.name} over {' × '.join(map(str, self.shape))} points of {', '.join(self.axes)}"]
        lines += [f"  {name} {values.shape}" for name, values in self.results.items()]
        if self.failures:
            first = self.failures[0]
            lines.append(
                f"  {len(self.failures)} failed, the first at {words(first.point)}: {first.error}: {first.message}"
            )
        return "\n".join(lines)
