"""Newton's method on the configuration manifold: damped, its step clamped, its solution the nearest one.

Each step is the least-norm solution of the linearised system, with lengths measured in units of the robot's size.
Redundant rows and idle freedoms therefore need no special case: the first add nothing, the second do not move.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.checks import as_positive
from stewart_pin.closure.equations import flipped_loop, gap_from_data, jacobian_from_data, row_sizes
from stewart_pin.errors import ClosureError, InputError
from stewart_pin.model.chain import ClosedChain, as_configuration
from stewart_pin.typing import ArrayLike, Configuration, FloatArray

TOLERANCE = 2e-13
"""Largest gap that counts as closed, relative to the robot's size: a thousand units of round-off. Newton's method
goes on to a tenth of it as long as that makes the gap smaller."""
MAX_ITERATIONS = 100
RANK = 1e-10
"""Singular values below this, relative to the largest, count as zero: far above round-off, and far below those of a
robot that still moves sensibly."""
_LARGEST_STEP = 0.3
"""Largest entry of one step, in robot sizes and radians: well below the distance between assembly modes."""


@dataclass(frozen=True, eq=False)
class System:
    """Equations to be solved for a configuration.

    Attributes
    ----------
    evaluate
        Residual (m,) and Jacobian (m, nv), where placements and joint Jacobians have been computed.
    sizes
        (m,) natural size of each residual: the robot's size [m], or 1 [rad].
    demand
        What the equations ask for, in words.
    """

    evaluate: Callable[[pin.Data, Configuration], tuple[FloatArray, FloatArray]]
    sizes: FloatArray
    demand: str


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
        Whether the gap is at round-off, every loop is assembled, and joint limits hold where they were asked for.
    flipped
        A loop whose rows vanish, but with its axes against each other, if there is one.
    """

    q: Configuration
    gap: float
    iterations: int
    success: bool
    flipped: str | None = None

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
        reached = (
            f"loop '{self.flipped}' closes only with its axes against each other"
            if self.flipped
            else f"the residual is {self.gap:.3g} [m or rad]"
        )
        raise ClosureError(
            f"{demand} cannot be met from this guess: {reached} after {self.iterations} steps; "
            "start nearer, or ask for a pose within reach",
            residual=self.gap,
            iterations=self.iterations,
            q=self.q,
        )


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

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> closure = stp.close_loops(chain, chain.q_home)
    >>> closure.success, closure.gap < 1e-12
    (True, True)
    """
    q_guess = as_configuration(chain, "q_guess", q_guess)
    system = loop_system(chain)
    closure = solve(chain, q_guess, system, tolerance=tolerance, max_iterations=max_iterations)
    return closure.or_raise(system.demand) if throw else closure


def loop_system(chain: ClosedChain) -> System:
    """Return gap and Jacobian of the loops as a system for `solve`.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    System
        Residual (nc,) [m] and Jacobian (nc, nv) from Pinocchio data.
    """
    return System(
        lambda data, q: (gap_from_data(chain, data, q), jacobian_from_data(chain, data, q)),
        row_sizes(chain),
        "closed loops",
    )


def solve(
    chain: ClosedChain,
    q_guess: Configuration,
    system: System,
    *,
    tolerance: float = TOLERANCE,
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
        Largest residual that counts as solved, relative to the natural sizes of the residuals.
    max_iterations
        Number of steps after which to give up.

    Returns
    -------
    Closure
        Configuration and residual reached, whether they succeed or not.

    Raises
    ------
    InputError
        If tolerance or number of iterations make no sense.
    """
    tolerance = as_positive("tolerance", tolerance)
    if max_iterations < 0:
        raise InputError(f"max_iterations must be 0 or more, got {max_iterations}")
    model, data = chain.model, pin.Data(chain.model)

    def evaluate(q: Configuration) -> tuple[FloatArray, FloatArray, float]:
        pin.computeJointJacobians(model, data, q)
        residual, jacobian = system.evaluate(data, q)
        residual = residual / system.sizes
        # A residual without size and steps in natural sizes: every unit of length gives the same iterates.
        jacobian = jacobian * chain.tangent_scale / system.sizes[:, None]
        return residual, jacobian, float(np.abs(residual).max(initial=0.0))

    q = pin.normalize(model, q_guess)
    residual, jacobian, worst = evaluate(q)
    damping, iterations = 0.0, 0
    while worst > tolerance / 10 and iterations < max_iterations:
        iterations += 1
        step = _least_norm_step(residual, jacobian, damping)
        q_next = pin.integrate(model, q, step * chain.tangent_scale)
        trial = evaluate(q_next)
        if np.linalg.norm(trial[0]) < np.linalg.norm(residual):
            q, (residual, jacobian, worst) = q_next, trial
            damping = damping / 10 if damping > 1e-8 else 0.0
        elif damping > 1e3 or worst < tolerance:
            break  # no step helps: a local minimum, or round-off
        else:
            damping = max(10 * damping, 1e-6)
    gap = float(np.abs(residual * system.sizes).max(initial=0.0))
    pin.forwardKinematics(model, data, q)
    closed = worst <= tolerance
    flipped = flipped_loop(chain, data) if closed else None
    return Closure(q, gap, iterations, success=closed and flipped is None, flipped=flipped)


def _least_norm_step(residual: FloatArray, jacobian: FloatArray, damping: float) -> FloatArray:
    """Solve J dq = -r for the shortest dq, damped and clamped."""
    u, s, vt = np.linalg.svd(jacobian, full_matrices=False)
    largest = s[0] if s.size else 0.0
    keep = s > RANK * largest
    s = s[keep]
    gain = s / (s**2 + (damping * largest) ** 2)
    step = -vt[keep].T @ (gain * (u[:, keep].T @ residual))
    longest = np.abs(step).max(initial=0.0)
    return step * min(1.0, _LARGEST_STEP / longest) if longest > 0 else step
