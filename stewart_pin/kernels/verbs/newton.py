"""Newton's method for arrays of states: steps from a kernel, damped, or along paths that keep the branch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from stewart_pin.programs.array_kernel import ArrayKernel
from stewart_pin.programs.repeating import Repeat
from stewart_pin.tolerances import CONTRACTION, SHORTEST_STRETCH
from stewart_pin.typing import BoolArray, FloatArray

_CLOSED = 1e-11
"""Gap at which a row is closed, in robot sizes and radians: a few hundred units of round-off."""
_CLOSED_SINGLE = 1e-5
"""The same in single precision."""
_ON_THE_WAY, _STEPS_ON_THE_WAY = 1e-6, 12
"""Move at which a stretch is through, and double steps that it may take: what is out of reach is approached by linear
convergence, and the end of the way is solved for again."""
_ANY_GAP = 1e30
"""Larger than any, and a number in single precision too."""
_DOUBLE_STEPS = 6
"""Double steps before the rows that have not closed by then are damped."""
_NONE = np.zeros(1)
"""Contraction before the first step."""
_STRETCHES = 10_000
"""Stretches after which a path is given up: five for a radian, so that three hundred turns are followed."""
_PATIENCE = 50
"""Stretches after which another choice of pivots is asked for though some rows are still on their way."""


@dataclass(frozen=True, eq=False)
class NewtonSteps:
    """Kernels that step towards a target.

    Attributes
    ----------
    double
        Of ``(state, target, contraction) -> (next, gap, largest)``: a full step, and another with the matrix of the
        first.
    damped
        Gives that of ``(search, target) -> (next, gap)``, when rows need it: a trial of a shorter step.
    stretch
        Gives that of double steps towards targets on the way, when rows need it.
    """

    double: ArrayKernel
    damped: Callable[[], ArrayKernel]
    stretch: Callable[[], ArrayKernel]


@dataclass(frozen=True, eq=False)
class Plans:
    """Steps by several choices of pivots towards the same targets: where one divides by nothing, another may serve.

    Attributes
    ----------
    known
        Gives the steps of all choices so far, the usual one first.
    further
        Makes another choice, for one of the (k, n) states where no choice serves; says whether there is one. None
        where there is no choice.
    met
        Gives the (k, m) targets that (k, n) states meet, where what lies between two targets need not be within
        reach; None where it is.
    """

    known: Callable[[], Sequence[NewtonSteps]]
    further: Callable[[FloatArray], bool] | None = None
    met: Callable[[FloatArray], FloatArray] | None = None


@dataclass(frozen=True, eq=False)
class Solved:
    """What Newton's method reached.

    Attributes
    ----------
    states
        (N, n) states, of rows that did not close the best [any unit].
    closed
        (N,) mask of the rows that closed.
    kept
        (N,) mask of the rows that are on the branch of their start.
    """

    states: FloatArray
    closed: BoolArray
    kept: BoolArray

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
        states, closed, kept = self.states.copy(), self.closed.copy(), self.kept.copy()
        states[rows], closed[rows], kept[rows] = other.states, other.closed, other.kept
        return Solved(states, closed, kept)

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
        return Solved(self.states[rows], self.closed[rows], self.kept[rows])


Between = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
"""Targets (k, m) at shares (k,) of the way from (k, m) to (k, m)."""


def straight(begin: FloatArray, end: FloatArray, share: FloatArray) -> FloatArray:
    """Go from one target to another in a straight line, as from motor positions to others.

    Parameters
    ----------
    begin, end
        (k, m) targets [any unit].
    share
        (k,) of the way, dimensionless.

    Returns
    -------
    numpy.ndarray
        (k, m) targets [any unit].
    """
    return begin + share[:, None] * (end - begin)


def solve_on_branch(
    plans: Plans,
    start: FloatArray,
    begin: Callable[[np.ndarray], tuple[FloatArray, FloatArray]],
    target: FloatArray,
    between: Between,
    *,
    out: FloatArray | None = None,
    threads: int = 1,
) -> Solved:
    """Close every row of an array on the branch of its start.

    Parameters
    ----------
    plans
        What to take.
    start
        (n,) or (N, n) states to start from [any unit].
    begin
        Gives the (k, n) states where the ways of some rows begin, and the (k, m) targets that these meet [any unit].
    target
        (N, m) targets [any unit].
    between
        Leads from the one to the other.
    out
        (N, n) array for the states; None makes one [any unit].
    threads
        Number of threads.

    Returns
    -------
    Solved
        States, which of them are closed, and which of them have kept their branch.

    Notes
    -----
    Rows of whose branch the first steps leave no doubt are through; the others are followed along the way in stretches
    short enough for that. What is then not met, but by damped steps, is on another branch, or beyond a singularity.
    """
    steps = plans.known()[0]
    tolerance = _tolerance_of(steps.double)
    states, closed, kept = _double_steps(steps.double, start, target, threads, out)
    if kept.all():
        return Solved(states, closed, kept)
    left = np.flatnonzero(~kept & np.isfinite(target).all(axis=1))
    if len(left):
        ways = begin(left)
        ends, arrived = _follow(plans, *ways, target[left], between, threads)
        came, went = left[arrived], ~arrived & ~closed[left]
        states[came], closed[came], kept[came] = ends[arrived], True, True
        again = left[went]
        if len(again):
            states[again], closed[again] = _damped(
                steps.damped(), ways[0][went], target[again], tolerance, threads
            )
    return Solved(states, closed, kept)


class OneSearch:
    """Newton's method for one state at a time, with the results of `solve_on_branch`, bit for bit.

    Parameters
    ----------
    steps
        What to take.
    begin
        (size,) state to start from where a call names none; None where there is no such state [any unit].
    """

    def __init__(self, steps: NewtonSteps, begin: FloatArray | None) -> None:
        kernel = steps.double
        self._begin = begin
        self._tolerance = _tolerance_of(kernel)
        self._plain = kernel.repeated(_repeat(kernel)).single_state()

    def __call__(self, target: FloatArray, start: FloatArray | None = None) -> FloatArray | None:
        """Close one state.

        Parameters
        ----------
        target
            (m,) target [any unit].
        start
            (n,) state to start from; None takes the usual one [any unit].

        Returns
        -------
        numpy.ndarray or None
            (n,) state on the branch of its start; None where that takes more than a few steps [any unit].
        """
        begin = self._begin if start is None else start
        if begin is None:
            return None
        state, gap, largest = self._plain(begin, target, _NONE)
        return state if gap[0] <= self._tolerance and abs(largest[0]) <= CONTRACTION else None


def _tolerance_of(kernel: ArrayKernel) -> float:
    return _CLOSED if kernel.dtype == np.float64 else _CLOSED_SINGLE


def _double_steps(
    kernel: ArrayKernel,
    start: FloatArray,
    target: FloatArray,
    threads: int,
    out: FloatArray | None = None,
    tolerance: float = 0.0,
) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Take double steps until a row has closed, or has had enough of them; say who closed, and who surely stayed."""
    room = None if out is None else [out, None, None]
    repeat = _repeat(kernel, tolerance)
    states, gap, largest = kernel.repeated(repeat)(start, target, _NONE, out=room, threads=threads)
    closed = gap[:, 0] <= repeat.tolerance
    return states, closed, closed & (np.abs(largest[:, 0]) <= CONTRACTION)


def _repeat(kernel: ArrayKernel, tolerance: float = 0.0) -> Repeat:
    """Repeat double steps down to round-off, or to a tolerance above it."""
    (state, _, before), (following, gap, largest) = kernel.program.inputs, kernel.program.outputs
    also = ((before.name, largest.name),)
    # The step after a closed gap leaves nothing but round-off.
    closed, limit = max(tolerance, _tolerance_of(kernel)), _STEPS_ON_THE_WAY if tolerance else _DOUBLE_STEPS
    return Repeat(state.name, following.name, gap.name, closed, limit, also)


def _follow(
    plans: Plans,
    start: FloatArray,
    start_target: FloatArray,
    target: FloatArray,
    between: Between,
    threads: int,
) -> tuple[FloatArray, BoolArray]:
    """Follow paths of targets, in stretches that are shortened where a branch might be lost."""
    state, arrived = _up_to_targets(plans, start, start_target, target, between, threads)
    # The target itself, which has to be met in all its entries.
    met = np.zeros(len(state), dtype=bool)
    while len(there := np.flatnonzero(arrived & ~met)):
        state[there], met[there] = _by_any(
            [steps.double for steps in plans.known()], state[there], target[there], threads
        )
        if plans.further is None or met[there].all() or not plans.further(state[there[~met[there]]]):
            break
    return state, met


def _up_to_targets(
    plans: Plans,
    start: FloatArray,
    start_target: FloatArray,
    target: FloatArray,
    between: Between,
    threads: int,
) -> tuple[FloatArray, BoolArray]:
    """Follow paths nearly to their ends, and say which of them came that far."""
    state, share, length = start.copy(), np.zeros(len(start)), np.full(len(start), 0.5)
    begin, done = start_target.copy(), np.zeros(len(start))
    for count in range(1, _STRETCHES + 1):
        under_way = share < 1.0
        on_the_way = np.flatnonzero(under_way & (length >= SHORTEST_STRETCH))
        stuck = np.flatnonzero(under_way & (length < SHORTEST_STRETCH))
        # A few slow ones must not keep the others waiting.
        asked = plans.further is not None and len(stuck) and (not len(on_the_way) or count % _PATIENCE == 0)
        if asked and plans.further is not None and plans.further(state[stuck]):
            length[stuck] = 0.1
            continue
        if not len(on_the_way):
            break
        reach = np.minimum(share[on_the_way] + length[on_the_way], 1.0)
        past = done[on_the_way]
        aim = between(begin[on_the_way], target[on_the_way], (reach - past) / (1.0 - past))
        stretches = [steps.stretch() for steps in plans.known()]
        found, good = _by_any(stretches, state[on_the_way], aim, threads, _ON_THE_WAY)
        forward = on_the_way[good]
        state[forward], share[forward] = found[good], reach[good]
        length[forward] *= 2.0
        length[on_the_way[~good]] /= 4.0
        again = forward[share[forward] < 1.0]
        if plans.met is not None and len(again):
            begin[again], done[again] = plans.met(state[again]), share[again]
    return state, share >= 1.0


def _by_any(
    kernels: Sequence[ArrayKernel],
    start: FloatArray,
    target: FloatArray,
    threads: int,
    tolerance: float = 0.0,
) -> tuple[FloatArray, BoolArray]:
    """Step with the first choice of pivots that serves."""
    state, good = start.copy(), np.zeros(len(start), dtype=bool)
    for kernel in kernels:
        left = np.flatnonzero(~good)
        if not len(left):
            break
        state[left], _, good[left] = _double_steps(
            kernel, start[left], target[left], threads, tolerance=tolerance
        )
    return state, good


def _damped(
    kernel: ArrayKernel,
    start: FloatArray,
    target: FloatArray,
    tolerance: float,
    threads: int,
    trials: int = 60,
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
