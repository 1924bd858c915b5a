"""Kinematics of a closed chain: pose to configuration and back, motions, and the motor Jacobian."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from stewart_pin.checks import as_array
from stewart_pin.closure.equations import gap_from_data, jacobian_from_data, loop_bias, row_sizes
from stewart_pin.closure.newton import RANK, Closure, System, close_loops, solve
from stewart_pin.errors import ClosureError, UnreachableError
from stewart_pin.model.chain import ClosedChain, as_configuration, as_pose
from stewart_pin.typing import ArrayLike, Configuration, FloatArray, Tangent

_CONSISTENT = 1e-8
"""Part of a demanded motion that may be left over by round-off, relative to its size."""
_AT_LIMIT = 1e-9
"""Excess over a joint limit that is still round-off, in robot sizes or radians."""
_STAGES = (4, 16)
"""Numbers of steps towards a demand, tried in order where the demand at once fails."""


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
        return _with_pose(chain, target)

    closure = _approach(chain, start, demand, throw=throw)
    return _within_limits(chain, closure, throw=throw) if limits else closure


def forward_kinematics(
    chain: ClosedChain, q_motor: ArrayLike, *, q_guess: ArrayLike | None = None, throw: bool = True
) -> Closure:
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

    Returns
    -------
    Closure
        Configuration and residual reached; `platform_pose` gives the pose.

    Raises
    ------
    ClosureError
        If the loops do not close on these motor positions; carries the residual reached.
    """
    target = as_array("q_motor", q_motor, (chain.nu,))
    start = _start(chain, q_guess)
    begin = motor_positions(chain, start)

    def demand(share: float) -> System:
        return _with_motors(chain, target if share == 1.0 else begin + share * (target - begin))

    return _approach(chain, start, demand, throw=throw)


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


def motion_matrix(chain: ClosedChain, q: Configuration) -> FloatArray:
    """Stack the loop Jacobian on the platform Jacobian.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nc + 6, nv) rates of the gap in loop frames 1, then twist in world axes [per m/s or rad/s].
    """
    data = pin.Data(chain.model)
    pin.computeJointJacobians(chain.model, data, q)
    pin.updateFramePlacement(chain.model, data, chain.platform_id)
    return np.vstack([jacobian_from_data(chain, data), _platform_jacobian(chain, data)])


def platform_bias(chain: ClosedChain, q: Configuration, v: Tangent) -> FloatArray:
    """Compute the platform's acceleration that is there without tangent acceleration.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].

    Returns
    -------
    numpy.ndarray
        (6,) classical acceleration of the platform origin and angular acceleration, world axes [m/s², rad/s²].
    """
    data = pin.Data(chain.model)
    pin.forwardKinematics(chain.model, data, q, v, np.zeros(chain.nv))
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    return pin.getFrameClassicalAcceleration(chain.model, data, chain.platform_id, axes).vector


def _platform_jacobian(chain: ClosedChain, data: pin.Data) -> FloatArray:
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    # Pinocchio hands a matrix of one column over as a vector.
    return pin.getFrameJacobian(chain.model, data, chain.platform_id, axes).reshape(6, -1)


def _with_pose(chain: ClosedChain, target: pin.SE3) -> System:
    """Loops, and the platform frame at its target: position error [m], rotation vector of R R_targetᵀ [rad]."""

    def evaluate(data: pin.Data, q: Configuration) -> tuple[FloatArray, FloatArray]:
        here = pin.updateFramePlacement(chain.model, data, chain.platform_id)
        turn = here.rotation @ target.rotation.T
        angle = pin.log3(turn)
        jacobian = _platform_jacobian(chain, data).copy()
        # d log3(R) = Jlog3(R) ω_body, with ω_body = Rᵀ ω_world of the error rotation.
        jacobian[3:] = pin.Jlog3(turn) @ turn.T @ jacobian[3:]
        residual = np.concatenate([gap_from_data(chain, data), here.translation - target.translation, angle])
        return residual, np.vstack([jacobian_from_data(chain, data), jacobian])

    sizes = np.concatenate([row_sizes(chain), np.full(3, chain.length_scale), np.ones(3)])
    return System(evaluate, sizes, "the pose")


def _with_motors(chain: ClosedChain, target: FloatArray) -> System:
    rows = np.eye(chain.nv)[chain.motor_index]

    def evaluate(data: pin.Data, q: Configuration) -> tuple[FloatArray, FloatArray]:
        residual = np.concatenate([gap_from_data(chain, data), q[chain.motor_q_index] - target])
        return residual, np.vstack([jacobian_from_data(chain, data), rows])

    sizes = np.concatenate([row_sizes(chain), chain.tangent_scale[chain.motor_index]])
    return System(evaluate, sizes, "the motor positions")


def _approach(
    chain: ClosedChain, start: Configuration, demand: Callable[[float], System], *, throw: bool
) -> Closure:
    """Solve for the demand at once, or failing that through intermediate ones."""
    direct = closure = solve(chain, start, demand(1.0))
    iterations = closure.iterations
    for stages in _STAGES:
        if closure.success:
            break
        closure = replace(closure, q=start)
        for k in range(1, stages + 1):
            closure = solve(chain, closure.q, demand(k / stages))
            iterations += closure.iterations
            if not closure.success:
                break
    # Of failures the direct one tells most: how near to the demand itself the chain can come.
    closure = replace(closure if closure.success else direct, iterations=iterations)
    return closure.or_raise(demand(1.0).demand) if throw else closure


def _within_limits(chain: ClosedChain, closure: Closure, *, throw: bool) -> Closure:
    if not closure.success:
        return closure
    model, q = chain.model, closure.q
    violations: dict[str, tuple[float, float, float]] = {}
    for name, joint in zip(model.names[1:], model.joints[1:], strict=True):
        if joint.nq != 1:
            continue
        k = joint.idx_q
        low, high = float(model.lowerPositionLimit[k]), float(model.upperPositionLimit[k])
        slack = _AT_LIMIT * chain.tangent_scale[joint.idx_v]
        if not low - slack <= q[k] <= high + slack:
            violations[name] = (float(q[k]), low, high)
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
