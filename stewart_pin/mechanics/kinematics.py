"""Kinematics of a closed chain: pose to configuration and back, motions, and the motor Jacobian."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, overload

import numpy as np
import pinocchio as pin

from stewart_pin.checks import as_array
from stewart_pin.closure.configurations import limit_violations
from stewart_pin.closure.equations import loop_bias
from stewart_pin.closure.newton import RANK, Closure, System, close_loops
from stewart_pin.errors import ClosureError, UnreachableError
from stewart_pin.mechanics.demands import approach, motor_system, pose_system
from stewart_pin.mechanics.forward_solutions import ForwardSolutions, all_forward_kinematics
from stewart_pin.mechanics.platform import motion_matrix, platform_bias
from stewart_pin.model.chain import ClosedChain, as_configuration, as_pose
from stewart_pin.typing import ArrayLike, Configuration, FloatArray, Tangent

_CONSISTENT = 1e-8
"""Part of a demanded motion that may be left over by round-off, relative to its size."""
_AT_LIMIT = 1e-9
"""Excess over a joint limit that is still round-off, in robot sizes or radians."""


@dataclass(frozen=True, eq=False)
class State:
    """A motion of the whole chain at one instant.

    Attributes
    ----------
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].
    a
        (nv,) tangent acceleration [m/s², rad/s²].
    """

    q: Configuration
    v: Tangent
    a: Tangent


def platform_pose(chain: ClosedChain, q: ArrayLike) -> pin.SE3:
    """Locate the platform frame.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration [m, rad, unit quaternions].

    Returns
    -------
    pinocchio.SE3
        oMp, the platform frame in the world.
    """
    q = as_configuration(chain, "q", q)
    data = pin.Data(chain.model)
    pin.forwardKinematics(chain.model, data, q)
    return pin.SE3(pin.updateFramePlacement(chain.model, data, chain.platform_id))


def motor_positions(chain: ClosedChain, q: ArrayLike) -> FloatArray:
    """Pick the motor coordinates out of a configuration.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nu,) in the order of ``chain.motors``; for a leg, its length [m or rad].
    """
    return as_configuration(chain, "q", q)[chain.motor_q_index]


def inverse_kinematics(
    chain: ClosedChain,
    pose: pin.SE3,
    *,
    q_guess: ArrayLike | None = None,
    limits: bool = True,
    throw: bool = True,
) -> Closure:
    """Find the whole configuration of a platform pose.

    Newton's method from the guess, on the loops and the pose together. Where it fails, the demand is approached in
    stages, so that the solution stays on the assembly mode of the guess.

    Parameters
    ----------
    chain
        Closed chain.
    pose
        Platform frame in the world.
    q_guess
        (nq,) configuration to start from [m, rad, unit quaternions]; default: home.
    limits
        Whether joint limits must hold.
    throw
        Whether failure raises; otherwise it is returned with ``success=False``.

    Returns
    -------
    Closure
        Configuration and residual reached.

    Raises
    ------
    ClosureError
        If the chain cannot take the pose; carries the residual reached.
    UnreachableError
        If a joint limit is exceeded; names the joints and their values.
    """
    pose = as_pose("pose", pose)
    start = _start(chain, q_guess)
    here = platform_pose(chain, start)
    twist = pin.log6(here.inverse() * pose).vector

    def demand(share: float) -> System:
        # The end of the path is the pose itself, not its logarithm's exponential.
        target = pose if share == 1.0 else here * pin.exp6(share * twist)
        return pose_system(chain, target)

    closure = approach(chain, start, demand, throw=throw)
    return _within_limits(chain, closure, throw=throw) if limits else closure


@overload
def forward_kinematics(
    chain: ClosedChain,
    q_motor: ArrayLike,
    *,
    q_guess: ArrayLike | None = None,
    throw: bool = True,
    all: Literal[False] = False,
) -> Closure: ...
@overload
def forward_kinematics(chain: ClosedChain, q_motor: ArrayLike, *, all: Literal[True]) -> ForwardSolutions: ...
def forward_kinematics(
    chain: ClosedChain,
    q_motor: ArrayLike,
    *,
    q_guess: ArrayLike | None = None,
    throw: bool = True,
    all: bool = False,
) -> Closure | ForwardSolutions:
    """Find the whole configuration of given motor positions, on the assembly mode of the guess.

    Parameters
    ----------
    chain
        Closed chain.
    q_motor
        (nu,) motor positions in the order of ``chain.motors`` [m or rad].
    q_guess
        (nq,) configuration to start from [m, rad, unit quaternions]; default: home.
    throw
        Whether failure raises; otherwise it is returned with ``success=False``.
    all
        Whether to search other assembly modes as well, from many starts: `all_forward_kinematics`.

    Returns
    -------
    Closure or ForwardSolutions
        Configuration and residual reached, `platform_pose` gives the pose; with ``all`` every configuration found,
        which may not be every one there is.

    Raises
    ------
    ClosureError
        If the loops do not close on these motor positions; carries the residual reached.
    """
    target = as_array("q_motor", q_motor, (chain.nu,))
    if all:
        return all_forward_kinematics(chain, target)
    start = _start(chain, q_guess)
    begin = motor_positions(chain, start)

    def demand(share: float) -> System:
        return motor_system(chain, target if share == 1.0 else begin + share * (target - begin))

    return approach(chain, start, demand, throw=throw)


def platform_motion(
    chain: ClosedChain,
    pose: pin.SE3,
    twist: ArrayLike,
    acceleration: ArrayLike,
    *,
    q_guess: ArrayLike | None = None,
    limits: bool = True,
) -> State:
    """Find the motion of the whole chain from that of the platform.

    Idle freedoms, which neither loops nor platform determine, get the least-norm velocity and acceleration.

    Parameters
    ----------
    chain
        Closed chain.
    pose
        Platform frame in the world.
    twist
        (6,) velocity of the platform origin and angular velocity, in world axes [m/s, rad/s].
    acceleration
        (6,) acceleration of the platform origin and angular acceleration, in world axes [m/s², rad/s²].
    q_guess
        (nq,) configuration to start from [m, rad, unit quaternions]; default: home.
    limits
        Whether joint limits must hold.

    Returns
    -------
    State
        Configuration, velocity and acceleration that keep the loops closed.

    Raises
    ------
    ClosureError
        If the chain cannot take the pose, or cannot follow the twist or acceleration.
    UnreachableError
        If a joint limit is exceeded.
    """
    twist = as_array("twist", twist, (6,))
    acceleration = as_array("acceleration", acceleration, (6,))
    q = inverse_kinematics(chain, pose, q_guess=q_guess, limits=limits).q
    matrix = motion_matrix(chain, q)
    v = _follow(chain, q, matrix, np.concatenate([np.zeros(chain.nc), twist]), "twist")
    bias = np.concatenate([loop_bias(chain, q, v), platform_bias(chain, q, v)])
    demand = np.concatenate([np.zeros(chain.nc), acceleration])
    a = _follow(chain, q, matrix, demand - bias, "acceleration")
    return State(q=q, v=v, a=a)


def motor_jacobian(chain: ClosedChain, q: ArrayLike) -> FloatArray:
    """Map platform twists to motor rates.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration with closed loops [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nu, 6) such that motor rates = J @ twist, twist [v; ω] of the platform origin in world axes
        [m/s or rad/s per m/s or rad/s]. For a platform with fewer than six freedoms, J acts on the twists it can do.
    """
    q = as_configuration(chain, "q", q)
    spread = np.linalg.pinv(motion_matrix(chain, q), rcond=RANK)
    return spread[chain.motor_index][:, chain.nc :]


def _within_limits(chain: ClosedChain, closure: Closure, *, throw: bool) -> Closure:
    if not closure.success:
        return closure
    q = closure.q
    violations = limit_violations(chain, q, _AT_LIMIT)
    if not violations:
        return closure
    if throw:
        listed = "; ".join(
            f"'{n}' at {x:.6g}, allowed {a:.6g} to {b:.6g}" for n, (x, a, b) in violations.items()
        )
        raise UnreachableError(
            f"the pose is out of reach, joints exceed their limits: {listed}; choose another pose, or limits=False",
            violations=violations,
            residual=closure.gap,
            iterations=closure.iterations,
            q=q,
        )
    return replace(closure, success=False)


def _follow(
    chain: ClosedChain, q: Configuration, matrix: FloatArray, demand: FloatArray, name: str
) -> Tangent:
    """Least-norm tangent vector that meets a demand exactly, or an error."""
    motion = np.linalg.lstsq(matrix, demand, rcond=RANK)[0]
    left = float(np.abs(matrix @ motion - demand).max(initial=0.0))
    if left > _CONSISTENT * max(1.0, float(np.abs(demand).max(initial=0.0))):
        raise ClosureError(
            f"the chain cannot follow this {name} here: {left:.3g} of it is left over; "
            "ask for a motion the platform can do",
            residual=left,
            iterations=0,
            q=q,
        )
    return motion


def _start(chain: ClosedChain, q_guess: ArrayLike | None) -> Configuration:
    """Home, or the guess with its loops closed: without that, the way to the demand would begin off the mechanism."""
    if q_guess is None:
        return chain.q_home
    return close_loops(chain, q_guess, throw=False).q
