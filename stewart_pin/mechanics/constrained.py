"""Inverse and forward dynamics of a closed chain from Pinocchio's tree algorithms and the loop Jacobian.

Everything follows from one equation of motion on the spanning tree,

    M a + nle = Sᵀ tau_motor + J_cᵀ lambda_c,

split by N, a basis of the motions that keep the loops closed (J_c N = 0): Nᵀ times the equation gives the motor
efforts without the reactions, the rest gives the reactions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.checks import as_array
from stewart_pin.closure.equations import (
    bias_from_data,
    flipped_loop,
    gap_from_data,
    jacobian_from_data,
    row_sizes,
)
from stewart_pin.closure.newton import RANK
from stewart_pin.closure.pinocchio_constraints import constraint_models, reactions_from_pinocchio
from stewart_pin.errors import (
    ActuationError,
    ConvergenceError,
    InputError,
    SingularityError,
    UnsupportedError,
)
from stewart_pin.mechanics.bounded_efforts import bounded_efforts
from stewart_pin.mechanics.effort import Effort, Motion
from stewart_pin.mechanics.freedom import Freedom, analyse_freedom
from stewart_pin.model.chain import ClosedChain, as_configuration
from stewart_pin.typing import ArrayLike, Configuration, FloatArray, Tangent

_CONSISTENT = 1e-6
"""How far a state may be from closed loops, in robot sizes and radians (per s, s²), relative where the state itself is
larger: round-off and printed digits of user data, not a wrong state."""
NO_INERTIA = 1e-12
"""Inertia of a motion, relative to the largest, below which it has none: a thousand units of round-off."""


@dataclass(frozen=True, eq=False)
class ClosedState:
    """A state whose loops have been checked, with what was computed on the way.

    Attributes
    ----------
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].
    jacobian
        (nc, nv) loop Jacobian [m/s and 1/s per m/s or rad/s].
    bias
        (nc,) loop bias [m/s² and 1/s²].
    """

    q: Configuration
    v: Tangent
    jacobian: FloatArray
    bias: FloatArray


def pinocchio_inverse_dynamics(
    chain: ClosedChain,
    q: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    *,
    effort_limit: ArrayLike | None = None,
    throw: bool = True,
) -> Effort:
    """Compute motor efforts and loop reactions from RNEA and the loop Jacobian.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration with closed loops [m, rad, unit quaternions].
    v
        (nv,) tangent velocity that keeps them closed [m/s, rad/s].
    a
        (nv,) tangent acceleration that keeps them closed [m/s², rad/s²].
    effort_limit
        (nu,) or one number: largest absolute motor effort [N or N m]; redundant motors then share within it.
    throw
        Whether motors that cannot hold the robot are an error; otherwise the least-squares efforts are returned with
        their residual.

    Returns
    -------
    Effort
        Motor efforts, reactions, and whether they are unique.

    Raises
    ------
    ActuationError
        If the motors cannot hold the robot; carries the freedom left over.
    InputError
        If the state does not keep the loops closed.
    """
    state = closed_state(chain, q, v)
    a = as_array("a", a, (chain.nv,))
    _require_small(chain, state.jacobian @ a + state.bias, a, "a", "platform_motion")
    data = pin.Data(chain.model)
    freedom = analyse_freedom(chain, state.q)
    if throw:
        require_held(chain, freedom)
    needed, a = _let_idle_go(chain, data, state, a, freedom.idle)

    share = freedom.motions[chain.motor_index].T  # Nᵀ Sᵀ, (dof, nu)
    load = freedom.motions.T @ needed
    if effort_limit is None:
        tau_motor, _, rank, _ = np.linalg.lstsq(share, load, rcond=RANK)
    else:
        tau_motor, rank = bounded_efforts(share, load, effort_limit), np.linalg.matrix_rank(share, rtol=RANK)
    needed[chain.motor_index] -= tau_motor
    lambda_c = np.linalg.lstsq(state.jacobian.T, needed, rcond=RANK)[0]
    return Effort(
        tau_motor=tau_motor,
        lambda_c=lambda_c,
        unique=bool(rank == chain.nu),
        reactions_unique=freedom.rank == chain.nc,
        a=a,
        residual=float(np.abs(needed - state.jacobian.T @ lambda_c).max(initial=0.0)),
    )


def forward_dynamics(
    chain: ClosedChain, q: ArrayLike, v: ArrayLike, tau_motor: ArrayLike, *, method: str = "projection"
) -> Motion:
    """Compute the acceleration under given motor efforts.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration with closed loops [m, rad, unit quaternions].
    v
        (nv,) tangent velocity that keeps them closed [m/s, rad/s].
    tau_motor
        (nu,) motor efforts in the order of ``chain.motors`` [N or N m].
    method
        ``"projection"``: the equation of motion projected on the motions that keep the loops closed; for every chain,
        also with redundant loops or massless legs. ``"constraint_dynamics"``: `pinocchio.constraintDynamics`, for
        spherical and fixed loops that are not redundant, on bodies with mass.

    Returns
    -------
    Motion
        Acceleration and loop reactions (of least norm where loops are redundant).

    Raises
    ------
    InputError
        If the state does not keep the loops closed, or the method is unknown.
    UnsupportedError
        If ``constraint_dynamics`` cannot treat the chain.
    SingularityError
        If a motion that motors or platform take part in has no inertia, so that no acceleration is determined.
    """
    state = closed_state(chain, q, v)
    tau = np.zeros(chain.nv)
    tau[chain.motor_index] = as_array("tau_motor", tau_motor, (chain.nu,))
    if method == "constraint_dynamics":
        return _constraint_dynamics(chain, state, tau)
    if method != "projection":
        raise InputError(f"method must be 'projection' or 'constraint_dynamics', got {method!r}")
    data = pin.Data(chain.model)
    inertia = joint_space_inertia(chain, data, state.q)
    push = tau - pin.nonLinearEffects(chain.model, data, state.q, state.v)
    freedom = analyse_freedom(chain, state.q)
    a = -np.linalg.lstsq(state.jacobian, state.bias, rcond=RANK)[0]
    a = a + _free_acceleration(chain, freedom, inertia, push - inertia @ a)
    lambda_c = np.linalg.lstsq(state.jacobian.T, inertia @ a - push, rcond=RANK)[0]
    return Motion(a=a, lambda_c=lambda_c)


def _free_acceleration(
    chain: ClosedChain, freedom: Freedom, inertia: FloatArray, push: FloatArray
) -> Tangent:
    """Acceleration along the motions that keep the loops closed; idle freedoms without inertia do not accelerate."""
    moments, axes = np.linalg.eigh(freedom.motions.T @ inertia @ freedom.motions)
    heavy = moments > NO_INERTIA * moments.max(initial=0.0)
    weightless = freedom.motions @ axes[:, ~heavy]
    # Of the weightless motions, all must be idle: each of them then is one of the idle freedoms.
    idle = freedom.idle / chain.tangent_scale[:, None]
    active = weightless / chain.tangent_scale[:, None]
    active = active - idle @ (idle.T @ active)
    # A weightless motion is determined by round-off to about the root of NO_INERTIA.
    if np.abs(active).max(initial=0.0) > 1e-3:
        direction = weightless[:, np.argmax(np.linalg.norm(active, axis=0))]
        raise SingularityError(
            f"nothing with inertia takes part in the motion {named_motion(chain, direction)}, so its acceleration is "
            "undetermined; give the bodies mass",
            smallest_singular_value=float(moments[0]),
            direction=direction,
            names=chain.tangent_names,
        )
    kept = axes[:, heavy]
    return freedom.motions @ (kept @ ((kept.T @ (freedom.motions.T @ push)) / moments[heavy]))


def require_held(chain: ClosedChain, freedom: Freedom) -> None:
    """Refuse a configuration at which the motors cannot hold the robot.

    Parameters
    ----------
    chain
        Closed chain.
    freedom
        Its motions there.

    Raises
    ------
    ActuationError
        With the freedom that is left over.
    """
    if not freedom.lost.shape[1]:
        return
    direction = freedom.weakest / np.abs(freedom.weakest).max()
    raise ActuationError(
        f"the motors cannot hold the robot here: {freedom.lost.shape[1]} freedom(s) left over with all motors "
        f"locked (smallest singular value {freedom.smallest_singular_value:.3g}), the motion "
        f"{named_motion(chain, direction)}; "
        "move away from this configuration, add a motor, or pass throw=False for least squares",
        smallest_singular_value=freedom.smallest_singular_value,
        direction=direction,
        names=chain.tangent_names,
    )


def named_motion(chain: ClosedChain, direction: FloatArray) -> str:
    """Spell out the largest entries of a motion.

    Parameters
    ----------
    chain
        Closed chain.
    direction
        (nv,) the motion [m, rad].

    Returns
    -------
    str
        Tangent names with their values.
    """
    order = np.argsort(-np.abs(direction))[:6]
    largest = np.abs(direction).max()
    return ", ".join(
        f"{chain.tangent_names[k]} {direction[k]:+.3g}" for k in order if abs(direction[k]) > 1e-6 * largest
    )


def closed_state(chain: ClosedChain, q: ArrayLike, v: ArrayLike) -> ClosedState:
    """Check that a state keeps the loops closed: dynamics of an open loop would be a silent wrong answer.

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
    ClosedState
        The state, with loop Jacobian and bias.

    Raises
    ------
    InputError
        If q leaves the loops open, or v opens them.
    """
    q, v = as_configuration(chain, "q", q), as_array("v", v, (chain.nv,))
    data = pin.Data(chain.model)
    pin.computeJointJacobians(chain.model, data, q)
    pin.forwardKinematics(chain.model, data, q, v, np.zeros(chain.nv))
    gap, jacobian = gap_from_data(chain, data, q), jacobian_from_data(chain, data, q)
    _require_small(chain, gap, np.zeros(chain.nv), "q", "close_loops")
    flipped = flipped_loop(chain, data)
    if flipped is not None:
        raise InputError(f"q holds loop '{flipped}' with its axes against each other; see close_loops")
    _require_small(chain, jacobian @ v, v, "v", "platform_motion")
    return ClosedState(q=q, v=v, jacobian=jacobian, bias=bias_from_data(chain, data, q, v))


def _require_small(chain: ClosedChain, left: FloatArray, value: Tangent, name: str, remedy: str) -> None:
    relative = np.abs(left) / row_sizes(chain)
    if relative.max(initial=0.0) > _CONSISTENT * max(
        1.0, float(np.abs(value / chain.tangent_scale).max(initial=0.0))
    ):
        row = int(np.argmax(relative))
        raise InputError(
            f"{name} does not keep the loops closed: {abs(left[row]):.3g} is left over in "
            f"{chain.loop_table.names[row]}; see {remedy}"
        )


def _let_idle_go(
    chain: ClosedChain, data: pin.Data, state: ClosedState, a: Tangent, idle: FloatArray
) -> tuple[FloatArray, Tangent]:
    """Tree efforts for the demanded acceleration, idle freedoms replaced by what their own inertia makes them do."""
    needed = np.array(pin.rnea(chain.model, data, state.q, state.v, a))
    if not idle.shape[1]:
        return needed, a
    inertia = joint_space_inertia(chain, data, state.q)
    moments, axes = np.linalg.eigh(idle.T @ inertia @ idle)
    scale = chain.tangent_scale
    heavy = moments > NO_INERTIA * np.abs(scale[:, None] * inertia * scale).max()
    axes = idle @ axes[:, heavy]
    change = -axes @ ((axes.T @ needed) / moments[heavy])
    return needed + inertia @ change, a + change


def joint_space_inertia(chain: ClosedChain, data: pin.Data, q: Configuration) -> FloatArray:
    """Compute the inertia matrix of the spanning tree, both halves.

    Parameters
    ----------
    chain
        Closed chain.
    data
        Scratch.
    q
        (nq,) configuration [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nv, nv) symmetric [kg, kg m, kg m²].
    """
    upper = np.triu(np.reshape(pin.crba(chain.model, data, q), (chain.nv, chain.nv)))
    return upper + np.triu(upper, 1).T


def _constraint_dynamics(chain: ClosedChain, state: ClosedState, tau: FloatArray) -> Motion:
    models = constraint_models(chain)
    if chain.nc and np.linalg.matrix_rank(state.jacobian * chain.tangent_scale, rtol=RANK) < chain.nc:
        raise UnsupportedError(
            "pinocchio.constraintDynamics cannot treat redundant loops (see mobility); use method='projection'"
        )
    # Fresh datas for every call: other algorithms leave desired accelerations behind in theirs.
    datas = pin.StdVec_RigidConstraintData()
    for model in models:
        datas.append(model.createData())
    data = pin.Data(chain.model)
    pin.initConstraintDynamics(chain.model, data, models, datas)
    settings = pin.ProximalSettings(1e-14, 0.0, 1)
    a = np.array(pin.constraintDynamics(chain.model, data, state.q, state.v, tau, models, datas, settings))
    if not np.isfinite(a).all():
        raise UnsupportedError(
            "pinocchio.constraintDynamics gives no finite answer: bodies lack mass; use method='projection'"
        )
    left = float(np.abs(state.jacobian @ a + state.bias).max(initial=0.0))
    if left > _CONSISTENT * max(1.0, float(np.abs(a).max(initial=0.0))):
        raise ConvergenceError(
            f"pinocchio.constraintDynamics leaves {left:.3g} of the loop acceleration; use method='projection'",
            residual=left,
        )
    return Motion(a=a, lambda_c=reactions_from_pinocchio(chain, np.array(data.lambda_c)))
