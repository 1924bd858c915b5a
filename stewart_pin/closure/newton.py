"""Newton's method on the configuration manifold: damped, its step clamped, its solution the nearest one.

Each step is the least-norm solution of the linearised system, with lengths measured in units of the robot's size.
Redundant rows and idle freedoms therefore need no special case: the first add nothing, the second do not move.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.closure.equations import gap_from_data, jacobian_from_data
from stewart_pin.errors import ClosureError, InputError
from stewart_pin.model.chain import ClosedChain, as_configuration
from stewart_pin.typing import ArrayLike, Configuration, FloatArray

TOLERANCE = 2e-14
"""Residual to aim at, per metre of robot size: a hundred units of round-off. Ten times this still counts as closed,
where no step makes it smaller."""
MAX_ITERATIONS = 100
_LARGEST_STEP = 0.3
"""Largest entry of one step, in robot sizes and radians: well below the distance between assembly modes."""
_RANK = 1e-10
"""Singular values below this, relative to the largest, count as zero."""

System = Callable[[pin.Data, Configuration], tuple[FloatArray, FloatArray]]
"""Residual (m,) and Jacobian (m, nv), where placements and joint Jacobians have been computed."""


@dataclass(frozen=True, eq=False)
class Closure:
    """A closed configuration, or how near the solver came.

    Attributes
    ----------
    q
        (nq,) configuration [m, rad, unit quaternions].
    gap
        Largest residual of loops and demands [m, rad].
    iterations
        Newton steps taken.
    success
        Whether the gap is at round-off.
    """

    q: Configuration
    gap: float
    iterations: int
    success: bool


def close_loops(
    chain: ClosedChain,
    q_guess: ArrayLike,
    *,
    tolerance: float = TOLERANCE,
    max_iterations: int = MAX_ITERATIONS,
    throw: bool = True,
) -> Closure:
    """Move a guess to a nearby configuration with closed loops.

    Parameters
    ----------
    chain
        Closed chain.
    q_guess
        (nq,) configuration to start from [m, rad, unit quaternions].
    tolerance
        Largest gap that counts as closed, per metre of robot size [m/m].
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
    """
    q_guess = as_configuration(chain, "q_guess", q_guess)
    return solve(
        chain,
        q_guess,
        loop_system(chain),
        "the loops",
        tolerance=tolerance,
        max_iterations=max_iterations,
        throw=throw,
    )


def loop_system(chain: ClosedChain) -> System:
    """Return gap and Jacobian of the loops as a system for `solve`.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    callable
        Residual (nc,) [m] and Jacobian (nc, nv) from Pinocchio data.
    """
    return lambda data, q: (gap_from_data(chain, data), jacobian_from_data(chain, data))


def solve(
    chain: ClosedChain,
    q_guess: Configuration,
    system: System,
    demand: str,
    *,
    tolerance: float = TOLERANCE,
    max_iterations: int = MAX_ITERATIONS,
    throw: bool = True,
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
    demand
        What is asked for, for the message.
    tolerance
        Largest residual that counts as solved, per metre of robot size [m/m].
    max_iterations
        Number of steps after which to give up.
    throw
        Whether failure raises.

    Returns
    -------
    Closure
        Configuration and residual reached.

    Raises
    ------
    ClosureError
        If the residual does not reach the tolerance.
    """
    if max_iterations < 0:
        raise InputError(f"max_iterations must be 0 or more, got {max_iterations}")
    model, data = chain.model, pin.Data(chain.model)
    enough = tolerance * chain.length_scale

    def evaluate(q: Configuration) -> tuple[FloatArray, FloatArray, float]:
        pin.computeJointJacobians(model, data, q)
        residual, jacobian = system(data, q)
        return residual, jacobian, float(np.abs(residual).max(initial=0.0))

    q = pin.normalize(model, q_guess)
    residual, jacobian, gap = evaluate(q)
    damping, iterations = 0.0, 0
    while gap > enough and iterations < max_iterations:
        iterations += 1
        step = _least_norm_step(residual, jacobian, chain.tangent_scale, damping)
        q_next = pin.integrate(model, q, step)
        trial = evaluate(q_next)
        if np.linalg.norm(trial[0]) < np.linalg.norm(residual):
            q, (residual, jacobian, gap) = q_next, trial
            damping = damping / 10 if damping > 1e-8 else 0.0
        elif damping > 1e3 or gap < 10 * enough:
            break  # no step helps: a local minimum, or round-off
        else:
            damping = max(10 * damping, 1e-6)
    success = gap <= 10 * enough
    if throw and not success:
        raise ClosureError(
            f"{demand} cannot be met from this guess: the residual is {gap:.3g} m after {iterations} steps; "
            "start nearer, or ask for a pose within reach",
            residual=gap,
            iterations=iterations,
            q=q,
        )
    return Closure(q=q, gap=gap, iterations=iterations, success=success)


def _least_norm_step(
    residual: FloatArray, jacobian: FloatArray, scale: FloatArray, damping: float
) -> FloatArray:
    """Solve J dq = -r for the shortest dq in scaled coordinates, damped and clamped."""
    u, s, vt = np.linalg.svd(jacobian * scale, full_matrices=False)
    largest = s[0] if s.size else 0.0
    keep = s > _RANK * largest
    s = s[keep]
    gain = s / (s**2 + (damping * largest) ** 2)
    scaled = -vt[keep].T @ (gain * (u[:, keep].T @ residual))
    longest = np.abs(scaled).max(initial=0.0)
    if longest > _LARGEST_STEP:
        scaled *= _LARGEST_STEP / longest
    return scaled * scale
