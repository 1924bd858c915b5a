"""Newton's method for arrays of states: steps from a kernel, damped row by row."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stewart_pin.kernels.programs.repeating import Repeat
from stewart_pin.kernels.running.array_kernel import ArrayKernel
from stewart_pin.typing import BoolArray, FloatArray

_CLOSED = 1e-11
"""Gap at which a row is closed, in robot sizes and radians: a few hundred units of round-off."""
_CLOSED_SINGLE = 1e-5
"""The same in single precision."""
_ANY_GAP = 1e30
"""Larger than any, and a number in single precision too."""
_DOUBLE_STEPS = 6
"""Double steps before the rows that have not closed by then are damped."""


@dataclass(frozen=True, eq=False)
class NewtonSteps:
    """Kernels that step towards a target.

    Attributes
    ----------
    double
        Of ``(state, target) -> (next, gap)``: a full step, and another with the matrix of the first.
    damped
        Gives that of ``(search, target) -> (next, gap)``, when rows need it: a trial of a shorter step.
    """

    double: ArrayKernel
    damped: Callable[[], ArrayKernel]


@dataclass(frozen=True, eq=False)
class Solved:
    """What Newton's method reached.

    Attributes
    ----------
    states
        (N, n) states, of rows that did not close the best [any unit].
    closed
        (N,) mask of the rows that closed.
    """

    states: FloatArray
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
        states, closed = self.states.copy(), self.closed.copy()
        states[rows], closed[rows] = other.states, other.closed
        return Solved(states, closed)

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
        return Solved(self.states[rows], self.closed[rows])


def damped_newton(
    steps: NewtonSteps,
    start: FloatArray,
    target: FloatArray,
    *,
    out: FloatArray | None = None,
    max_iterations: int = 60,
    threads: int = 1,
) -> Solved:
    """Close every row of an array.

    Parameters
    ----------
    steps
        What to take.
    start
        (N, n) states to start from [any unit].
    target
        (N, m) targets [any unit].
    out
        (N, n) array for the states; None makes one [any unit].
    max_iterations
        Bound on damped trials of a row.
    threads
        Number of threads.

    Returns
    -------
    Solved
        States, and which of them are closed.
    """
    tolerance = _tolerance(steps.double)
    states, closed = _plain(steps.double, start, target, out, tolerance, threads)
    if not closed.all():
        left = np.flatnonzero(~closed)
        begin, aim = np.broadcast_to(start, states.shape)[left], target[left]
        states[left], closed[left] = _damped(steps.damped(), begin, aim, tolerance, max_iterations, threads)
    return Solved(states, closed)


class OneSearch:
    """Newton's method for one state at a time, with the results of `damped_newton`, bit for bit.

    Parameters
    ----------
    steps
        What to take.
    begin
        (n, size) states to try in turn where a call names none [any unit].
    """

    def __init__(self, steps: NewtonSteps, begin: FloatArray) -> None:
        self._steps, self._begin = steps, begin
        self._tolerance = _tolerance(steps.double)
        self._plain = steps.double.repeated(_double_steps(steps.double)).single_state()

    def __call__(self, target: FloatArray, start: FloatArray | None = None) -> tuple[FloatArray, bool]:
        """Close one state.

        Parameters
        ----------
        target
            (m,) target [any unit].
        start
            (n,) state to start from; None takes the usual ones in turn [any unit].

        Returns
        -------
        state : numpy.ndarray
            (n,) the best that was reached [any unit].
        closed : bool
            Whether it is closed.
        """
        state, closed = np.zeros(0), False
        for begin in self._begin if start is None else (start,):
            state, gap = self._plain(begin, target)
            closed = bool(gap[0] <= self._tolerance)
            if not closed:
                solved = damped_newton(self._steps, begin[None], target[None])
                state, closed = solved.states[0], bool(solved.closed[0])
            if closed:
                break
        return state, closed


def _tolerance(kernel: ArrayKernel) -> float:
    return _CLOSED if kernel.dtype == np.float64 else _CLOSED_SINGLE


def _double_steps(kernel: ArrayKernel) -> Repeat:
    """Double steps until a row has closed, or has had enough of them."""
    (state, *_), (following, gap, *_) = kernel.program.inputs, kernel.program.outputs
    # The step after a closed gap leaves nothing but round-off.
    return Repeat(state.name, following.name, gap.name, _tolerance(kernel), _DOUBLE_STEPS)


def _plain(
    kernel: ArrayKernel,
    start: FloatArray,
    target: FloatArray,
    out: FloatArray | None,
    tolerance: float,
    threads: int,
) -> tuple[FloatArray, BoolArray]:
    """Take double steps until a row has closed, or has had enough of them."""
    room = None if out is None else [out, None]
    states, gaps = kernel.repeated(_double_steps(kernel))(start, target, out=room, threads=threads)
    return states, gaps[:, 0] <= tolerance


def _damped(
    kernel: ArrayKernel,
    start: FloatArray,
    target: FloatArray,
    tolerance: float,
    trials: int,
    threads: int,
) -> tuple[FloatArray, BoolArray]:
    """Take shorter steps where a full one does not lower the gap."""
    (search, *_), (following, gap) = kernel.program.inputs, kernel.program.outputs
    n = start.shape[1]
    begin = np.zeros((len(start), search.size), dtype=kernel.dtype)
    begin[:, :n] = begin[:, n : 2 * n] = start
    begin[:, -2:] = _ANY_GAP, 1.0
    # The first trial is the start itself.
    repeat = Repeat(search.name, following.name, gap.name, tolerance, 1 + trials)
    end, _ = kernel.repeated(repeat)(begin, target, threads=threads)
    closed = end[:, -2] <= tolerance
    return np.where(closed[:, None], end[:, n : 2 * n], end[:, :n]), closed
