"""Newton's method on the configuration manifold: damped, its step clamped, its solution the nearest one.

Each step is the least-norm solution of the linearised system in natural units, with as many directions as the
mechanism has (`Generic`). Redundant rows and idle freedoms therefore need no special case: the first add nothing, the
second do not move. Off the closed configurations the rows of an overconstrained linkage are independent, but what lies
beyond its rank is of the size of the gap: dividing by it would carry the guess far away.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.brief import Brief
from stewart_pin.checks import as_count, as_positive
from stewart_pin.errors import ClosureError
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import State, as_chain, as_configuration
from stewart_pin.tolerances import CLOSED
from stewart_pin.typing import ArrayLike, Configuration, FloatArray, Tangent

MAX_ITERATIONS = 100
LARGEST_STEP = 0.3
"""Largest entry of one step, in robot sizes and radians: well below the distance between assembly modes."""
_ABOVE_ROUND_OFF = 1e3
"""Damping in units of round-off where no rank is known: rows that depend on others are round-off themselves, and one
round-off divided by another would lead far along the motion."""
_NEARER = 20
"""Rounds in which a closed configuration is moved along its motions towards the guess."""
_NEAR_ENOUGH = 1e-3
"""Step along the closed configurations, relative to the distance from the guess, at which that is the least."""

_WIDE = 5.0
"""Ratio of neighbouring singular values from which on the smaller may come of printed digits."""


@dataclass(frozen=True, eq=False)
class System:
    """Equations to be solved for a configuration.

    Attributes
    ----------
    evaluate
        Residual (m,) and Jacobian (m, nv) at a state, in natural units.
    sizes
        (m,) natural size of each residual: the robot's size [m], or 1 [rad].
    rank
        Number of directions that the Jacobian has at a solution, or None where that is not known yet.
    demand
        What the equations ask for, in words.
    """

    evaluate: Callable[[State], tuple[FloatArray, FloatArray]]
    sizes: FloatArray
    rank: int | None
    demand: str


@dataclass(frozen=True, eq=False, repr=False)
class Closure(Brief):
    """A closed configuration, or how near the solver came.

    Attributes
    ----------
    state
        The state reached, at rest.
    gap
        Largest residual of loops and demands [m, rad].
    iterations
        Newton steps taken.
    success
        Whether the gap is at round-off, every loop is assembled, and joint limits hold where they were asked for.
    reason
        What kept it from success, in words; empty for a success.
    """

    state: State
    gap: float
    iterations: int
    success: bool
    reason: str = ""

    @property
    def q(self) -> Configuration:
        """(nq,) configuration reached [m, rad, unit quaternions]."""
        return self.state.q

    def or_raise(self, demand: str) -> Closure:
        """Return the closure, or raise what kept it from success.

        Parameters
        ----------
        demand
            What was asked for, in words.

        Returns
        -------
        Closure
            This record.

        Raises
        ------
        ClosureError
            If it is no success; carries residual, iterations and configuration.
        """
        if self.success:
            return self
        raise ClosureError(
            f"{demand} cannot be met from this guess: {self.reason} after {self.iterations} steps; "
            "start nearer, or ask for a pose within reach",
            residual=self.gap,
            iterations=self.iterations,
            q=self.q,
        )


def close_loops(
    chain: ClosedChain,
    q_guess: ArrayLike,
    *,
    tolerance: float = CLOSED,
    max_iterations: int = MAX_ITERATIONS,
    throw: bool = True,
) -> Closure:
    """Move a guess to the nearest configuration with closed loops.

    Parameters
    ----------
    chain
        Closed chain.
    q_guess
        (nq,) configuration to start from [m, rad, unit quaternions].
    tolerance
        Largest gap that counts as closed, in robot sizes (``chain.length_scale``) and radians.
    max_iterations
        Number of steps after which to give up.
    throw
        Whether failure raises; otherwise it is returned with ``success=False``.

    Returns
    -------
    Closure
        Configuration and residual reached.

    Raises
    ------
    ClosureError
        If the loops do not close from here; carries the residual reached.
    InputError
        If an argument is wrong.

    Notes
    -----
    The distance is that of the tangent in natural units, `ClosedChain.tangent_scale`. Where several configurations are
    equally near, or the guess is far away, it is a local minimum of the distance that is found.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> closure = stp.close_loops(chain, chain.q_home)
    >>> closure.success, closure.gap < 1e-12
    (True, True)
    """
    as_chain(chain)
    guess = State(chain, as_configuration(chain, "q_guess", q_guess))
    tolerance = as_positive("tolerance", tolerance)
    max_iterations = as_count("max_iterations", max_iterations)
    system = loop_system(chain)
    closure = solve(chain, guess.q, system, tolerance=tolerance, max_iterations=max_iterations)
    if closure.success and closure.iterations:
        closure = _nearest(guess, closure, system, tolerance, max_iterations)
    return closure.or_raise(system.demand) if throw else closure


def loop_system(chain: ClosedChain, *, ranked: bool = True) -> System:
    """Return gap and Jacobian of the loops as a system for `solve`.

    Parameters
    ----------
    chain
        Closed chain.
    ranked
        Whether the rank of the mechanism is to be used; it cannot while it is being found.

    Returns
    -------
    System
        Residual (nc,) and Jacobian (nc, nv), dimensionless.
    """
    return System(
        lambda state: (state.gap / chain.row_sizes, state.rows),
        chain.row_sizes,
        chain.generic.rank if ranked else None,
        "closed loops",
    )


def polish(chain: ClosedChain, q_guess: Configuration, *, max_iterations: int = MAX_ITERATIONS) -> Closure:
    """Close the loops to the last bit without knowing their rank.

    Parameters
    ----------
    chain
        Closed chain.
    q_guess
        (nq,) configuration to start from [m, rad, unit quaternions].
    max_iterations
        Number of steps after which to give up.

    Returns
    -------
    Closure
        Configuration and residual reached.
    """
    return solve(chain, q_guess, loop_system(chain, ranked=False), max_iterations=max_iterations)


def solve(
    chain: ClosedChain,
    q_guess: Configuration,
    system: System,
    *,
    tolerance: float = CLOSED,
    max_iterations: int = MAX_ITERATIONS,
) -> Closure:
    """Solve a system of equations on the configuration manifold (Levenberg-Marquardt, least-norm steps).

    Parameters
    ----------
    chain
        Closed chain.
    q_guess
        (nq,) configuration to start from [m, rad, unit quaternions].
    system
        Residual and Jacobian.
    tolerance
        Largest residual that counts as solved, in natural units.
    max_iterations
        Number of steps after which to give up.

    Returns
    -------
    Closure
        Configuration and residual reached, whether they succeed or not.

    Notes
    -----
    Without a rank every step is damped by the size of the residual, which keeps the convergence quadratic where
    solutions are not isolated and rows depend on each other at them [1]_.

    References
    ----------
    .. [1] J. Fan, Y. Yuan, "On the quadratic convergence of the Levenberg-Marquardt method without nonsingularity
       assumption", Computing 74, 2005, theorem 2.1.
    """
    state = chain.at(pin.normalize(chain.model, np.array(q_guess, dtype=float)))
    residual, jacobian = system.evaluate(state)
    worst = _largest(residual)
    damping, iterations = 0.0, 0
    while worst > max(tolerance, state.round_off) / 10 and iterations < max_iterations:
        iterations += 1
        own = float(np.linalg.norm(residual)) if system.rank is None else 0.0
        least = _ABOVE_ROUND_OFF * state.round_off if system.rank is None else 0.0
        step = _least_norm_step(residual, jacobian, max(damping, own), system.rank, least)
        following = displaced(state, step)
        trial = system.evaluate(following)
        if np.linalg.norm(trial[0]) < np.linalg.norm(residual):
            state, (residual, jacobian) = following, trial
            worst = _largest(residual)
            damping = damping / 10 if damping > 1e-8 else 0.0
        elif damping > 1e3 or worst < max(tolerance, state.round_off):
            break  # no step helps: a local minimum, or round-off
        else:
            damping = max(10 * damping, 10 * own, 1e-6)
    return judged(state, residual, system, iterations, tolerance)


def judged(
    state: State, residual: FloatArray, system: System, iterations: int, tolerance: float = CLOSED
) -> Closure:
    """Say whether a residual is closed, and every loop assembled.

    Parameters
    ----------
    state
        State reached.
    residual
        (m,) of the system there, dimensionless.
    system
        What was solved.
    iterations
        Steps taken.
    tolerance
        Largest residual that counts as solved, dimensionless.

    Returns
    -------
    Closure
        The verdict.
    """
    gap = float(np.abs(residual * system.sizes).max(initial=0.0))
    reason = ""
    if not _largest(residual) <= max(tolerance, state.round_off):
        reason = f"the residual is {gap:.3g} [m or rad]"
    else:
        opposed = state.opposed()
        if opposed:
            reason = (
                f"loop '{state.chain.loops[opposed[0]].name}' closes only with its axes against each other"
            )
    return Closure(state, gap, iterations, success=not reason, reason=reason)


def displaced(state: State, step: Tangent) -> State:
    """Move a configuration along its tangent.

    Parameters
    ----------
    state
        Where to start.
    step
        (nv,) displacement in natural units, dimensionless.

    Returns
    -------
    State
        At rest.
    """
    chain = state.chain
    return State(chain, pin.integrate(chain.model, state.q, step * chain.tangent_scale))


@dataclass(frozen=True, eq=False)
class NearClosure:
    """A configuration whose loops are as nearly closed as a rank allows.

    Attributes
    ----------
    state
        The state reached, at rest.
    rank
        Number of directions in which the loops were closed.
    """

    state: State
    rank: int


def close_at_precision(
    chain: ClosedChain, q_guess: Configuration, precision: float, *, rank: int | None = None
) -> NearClosure:
    """Close loops that need not close exactly, without following what may be digits.

    Parameters
    ----------
    chain
        Closed chain.
    q_guess
        (nq,) configuration to start from [m, rad, unit quaternions].
    precision
        Largest singular value that may come of printed digits, dimensionless.
    rank
        Number of directions to close; default: found by `rank_at_precision` once the gap is as small.

    Returns
    -------
    NearClosure
        The least gap found.
    """
    state = chain.at(pin.normalize(chain.model, np.array(q_guess, dtype=float)))
    residual = state.relative_gap
    own = rank
    for _ in range(MAX_ITERATIONS):
        size = float(np.linalg.norm(residual))
        factors = state.row_factors
        values = factors[1]
        if rank is None:
            own = rank_at_precision(values, precision) if size <= precision else None
        # What may be digits is followed nowhere: it would lead far along the motion.
        kept = int(np.count_nonzero(values > precision)) if own is None else own
        step = _step_of(factors, residual, size if own is None else 0.0, kept)
        trial = displaced(state, step)
        better = float(np.linalg.norm(trial.relative_gap)) < size
        if not better and (own is not None or size <= precision):
            break
        if not better:
            step = _step_of(factors, residual, 10 * size, kept)
            trial = displaced(state, step)
            if not float(np.linalg.norm(trial.relative_gap)) < size:
                break
        state, residual = trial, trial.relative_gap
    if own is None:
        own = rank_at_precision(state.row_factors[1], precision)
    return NearClosure(state, own)


def rank_at_precision(values: FloatArray, precision: float) -> int:
    """Count singular values that belong to a mechanism whose numbers were rounded.

    Parameters
    ----------
    values
        (n,) singular values of loop rows, the largest first, dimensionless.
    precision
        Largest one that may come of the rounding, dimensionless.

    Returns
    -------
    int
        How many stand above the widest gap whose lower edge rounding explains; all where there is none.
    """
    edges = np.concatenate([[1.0], np.maximum(values, precision / 10)])
    ratios = edges[:-1] / edges[1:]
    ratios[values > precision] = 0.0
    widest = int(np.argmax(ratios)) if ratios.size else 0
    return widest if ratios.size and ratios[widest] >= _WIDE else values.size


def _nearest(
    guess: State, closure: Closure, system: System, tolerance: float, max_iterations: int
) -> Closure:
    """Move along the closed configurations to the one that is nearest to the guess."""
    chain, best = guess.chain, closure

    def away(state: State) -> Tangent:
        return pin.difference(chain.model, state.q, guess.q) / chain.tangent_scale

    apart = away(best.state)
    distance = float(np.linalg.norm(apart))
    for _ in range(_NEARER):
        basis = best.state.motions.basis
        step = basis @ (basis.T @ apart)
        if np.linalg.norm(step) <= _NEAR_ENOUGH * distance:
            break
        left = max_iterations - best.iterations
        trial = solve(chain, displaced(best.state, step).q, system, tolerance=tolerance, max_iterations=left)
        moved = away(trial.state)
        if not trial.success or np.linalg.norm(moved) >= distance:
            break
        best = Closure(trial.state, trial.gap, best.iterations + trial.iterations, success=True)
        apart, distance = moved, float(np.linalg.norm(moved))
    return best


def _least_norm_step(
    residual: FloatArray, jacobian: FloatArray, damping: float, rank: int | None, least: float = 0.0
) -> FloatArray:
    """Solve J dq = -r for the shortest dq, damped by a share of J's size, and by no less than `least`, and clamped."""
    return _step_of(np.linalg.svd(jacobian, full_matrices=False), residual, damping, rank, least)


def _step_of(
    factors: tuple[FloatArray, FloatArray, FloatArray],
    residual: FloatArray,
    damping: float,
    rank: int | None,
    least: float = 0.0,
) -> FloatArray:
    """Do so with the singular value decomposition of J."""
    u, s, vt = factors
    s = s[:rank]
    u, vt = u[:, : s.size], vt[: s.size]
    largest = s[0] if s.size else 0.0
    square = s**2 + max(damping * largest, least) ** 2
    gain = np.divide(s, square, out=np.zeros_like(s), where=square > 0)
    step = -vt.T @ (gain * (u.T @ residual))
    longest = np.abs(step).max(initial=0.0)
    return step * min(1.0, LARGEST_STEP / longest) if longest > 0 else step


def _largest(residual: FloatArray) -> float:
    return float(np.abs(residual).max(initial=0.0))
