"""Newton's method for arrays of states: steps from a kernel, damped row by row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stewart_pin.kernels.array_kernel import ArrayKernel
from stewart_pin.kernels.repeating import Repeat
from stewart_pin.typing import BoolArray, FloatArray

_CLOSED = 1e-11
"""Gap at which a row is closed, in robot sizes and radians: a few hundred units of round-off."""
_CLOSED_SINGLE = 1e-5
"""The same in single precision."""
_PLAIN_STEPS = 8
"""Full steps before the rows that have not closed by then are damped."""
_SMALLEST_SHARE = 1e-4
"""Share of Newton's step below which a row is given up."""


@dataclass(frozen=True, eq=False)
class Solved:
    """What Newton's method reached.

    Attributes
    ----------
    states
        (N, n) states, of rows that did not close the best [any unit].
    gap
        (N,) largest entry of each gap, in robot sizes and radians [1].
    closed
        (N,) mask of the rows that closed.
    """

    states: FloatArray
    gap: FloatArray
    closed: BoolArray

    def with_rows(self, rows: np.ndarray, other: Solved) -> Solved:
        """Replace rows.

        Parameters
        ----------
        rows
            Indices of the rows.
        other
            What they become.

        Returns
        -------
        Solved
            With those rows.
        """
        states, gap, closed = self.states.copy(), self.gap.copy(), self.closed.copy()
        states[rows], gap[rows], closed[rows] = other.states, other.gap, other.closed
        return Solved(states, gap, closed)

    def with_rows_of(self, rows: np.ndarray) -> Solved:
        """Pick rows, any of them several times.

        Parameters
        ----------
        rows
            Indices of the rows.

        Returns
        -------
        Solved
            Those rows.
        """
        return Solved(self.states[rows], self.gap[rows], self.closed[rows])


def damped_newton(
    step: ArrayKernel, start: FloatArray, target: FloatArray, *, max_iterations: int = 60, threads: int = 1
) -> Solved:
    """Close every row of an array.

    Parameters
    ----------
    step
        Kernel of ``(state, target, share) -> (next, gap)``.
    start
        (N, n) states to start from [any unit].
    target
        (N, m) targets [any unit].
    max_iterations
        Bound on steps.
    threads
        Number of threads.

    Returns
    -------
    Solved
        States, and which of them are closed.
    """
    tolerance = _CLOSED if step.dtype == np.float64 else _CLOSED_SINGLE
    states, gap = _plain(step, start, target, tolerance, threads)
    left = np.flatnonzero(~(gap <= tolerance))
    if left.size:
        begin, aim = start[left], target[left]
        states[left], gap[left] = _damped(step, begin, aim, tolerance, max_iterations, threads)
    return Solved(states, gap, gap <= tolerance)


def _plain(
    step: ArrayKernel, start: FloatArray, target: FloatArray, tolerance: float, threads: int
) -> tuple[FloatArray, FloatArray]:
    """Take full steps until a row has closed, or has had enough of them."""
    (state, *_), (following, gap, *_) = step.program.inputs, step.program.outputs
    # The step after a closed gap leaves nothing but round-off.
    repeat = Repeat(state.name, following.name, gap.name, tolerance, _PLAIN_STEPS)
    states, gaps = step.repeated(repeat)(start, target, np.ones(1), threads=threads)
    return states, _sizes(gaps)


def _sizes(gaps: FloatArray) -> FloatArray:
    """Largest entry of each gap; column by column, since NumPy is slow along short rows."""
    sizes = np.zeros(len(gaps))
    for column in np.abs(gaps).T:
        np.maximum(sizes, column, out=sizes)
    return sizes


def _damped(
    step: ArrayKernel,
    start: FloatArray,
    target: FloatArray,
    tolerance: float,
    max_iterations: int,
    threads: int,
) -> tuple[FloatArray, FloatArray]:
    """Take shorter steps where a full one does not lower the gap."""

    def take(rows: np.ndarray, states: FloatArray, share: FloatArray) -> tuple[FloatArray, FloatArray]:
        following, gap = step(states, target[rows], share[:, None], threads=threads)
        size = _sizes(gap)
        return following, np.where(np.isfinite(size), size, np.inf)

    states, share = np.array(start, dtype=float), np.ones(len(start))
    following, gap = take(np.arange(len(start)), states, share)
    active = np.flatnonzero(np.isfinite(gap) & (gap > tolerance))
    for _ in range(max_iterations):
        if not active.size:
            break
        after, gap_after = take(active, following[active], np.ones(active.size))
        better = gap_after < gap[active]
        good, worse = active[better], active[~better]
        states[good], gap[good], share[good] = following[good], gap_after[better], 1.0
        following[good] = after[better]
        worse = worse[share[worse] > _SMALLEST_SHARE]
        if worse.size:
            share[worse] /= 4
            following[worse] = take(worse, states[worse], share[worse])[0]
        active = np.sort(np.concatenate([good[gap[good] > tolerance], worse]))
    closed = gap <= tolerance
    states[closed] = following[closed]
    return states, gap
