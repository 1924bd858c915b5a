"""What a sweep found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.errors import InputError
from stewart_pin.studies.points import Point, Points, words
from stewart_pin.typing import FloatArray


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
