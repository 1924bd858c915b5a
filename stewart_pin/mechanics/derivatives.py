"""Analytical derivatives of inverse and forward dynamics, for variations that keep the loops closed.

Both differentiate the same equations, with N a basis of the motions that keep the loops closed:

    M a + nle = Sᵀ τ + J_cᵀ λ + Σ J_fᵀ w,      J_c a + bias = 0.

The derivative of M a + nle - J_cᵀ λ for fixed a and λ is that of Pinocchio's recursive Newton-Euler algorithm with the
reactions as external forces, plus what `reaction_forces` adds; that of the loops' acceleration is `row_derivatives`.
Wrenches w keep their axes, not so the Jacobians of the points at which they act: `outside_effort_derivative`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.brief import Brief
from stewart_pin.errors import UnsupportedError
from stewart_pin.mechanics.forward_dynamics import forward_dynamics
from stewart_pin.mechanics.inverse_dynamics import inverse_dynamics, least_norm, natural_share, take_part
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.outside import OutsideWrenches, Wrenches, as_wrenches, outside_effort_derivative
from stewart_pin.state.row_derivatives import reaction_forces, row_derivatives
from stewart_pin.state.state import State, as_state, named_motion
from stewart_pin.tolerances import NO_INERTIA
from stewart_pin.typing import ArrayLike, FloatArray, Tangent


@dataclass(frozen=True, eq=False, repr=False)
class EffortDerivatives(Brief):
    """Derivatives of the motor efforts; they hold along variations of the state that keep the loops closed.

    Attributes
    ----------
    tau_q
        (nu, nv) with respect to the configuration, along its tangent [N or N m per m or rad].
    tau_v
        (nu, nv) with respect to the velocity [N s/m and so on].
    tau_a
        (nu, nv) with respect to the acceleration [kg and so on].
    """

    tau_q: FloatArray
    tau_v: FloatArray
    tau_a: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class MotionDerivatives(Brief):
    """Derivatives of the acceleration; they hold along variations of the state that keep the loops closed.

    Attributes
    ----------
    a_q
        (nv, nv) with respect to the configuration, along its tangent [1/s² and so on].
    a_v
        (nv, nv) with respect to the velocity [1/s and so on].
    a_tau
        (nv, nu) with respect to the motor efforts [1/kg and so on].
    """

    a_q: FloatArray
    a_v: FloatArray
    a_tau: FloatArray


def inverse_dynamics_derivatives(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    a: ArrayLike | None = None,
    *,
    wrenches: Wrenches | None = None,
) -> EffortDerivatives:
    """Differentiate the motor efforts of `inverse_dynamics`.

    Where motors are redundant, these are the derivatives of the least-norm efforts; where freedoms are idle, those of
    the efforts when the idle freedoms follow their own inertia.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration with closed loops, with a chain [m, rad, unit quaternions].
    v
        (nv,) tangent velocity that keeps them closed, with a chain [m/s, rad/s].
    a
        (nv,) tangent acceleration that keeps them closed [m/s², rad/s²].
    wrenches
        {link: (6,)} what acts from outside, as in `inverse_dynamics`; they keep their axes, and act at the
        frame's origin wherever it goes [N, N m].

    Returns
    -------
    EffortDerivatives
        For variations that keep the loops closed to second order, the change of the efforts is
        ``tau_q @ dq + tau_v @ dv + tau_a @ da``.

    Raises
    ------
    ActuationError
        If the motors cannot hold the robot.
    InputError
        If the state does not keep the loops closed.
    UnsupportedError
        If a joint with dry friction is at rest: its effort jumps there.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> rest = np.zeros(chain.nv)
    >>> stp.dynamics.inverse_dynamics_derivatives(chain, chain.q_home, rest, rest).tau_q.shape
    (6, 24)
    """
    state = as_state(chain, q, v, a)
    chain = state.chain
    _require_slopes(state)
    outside = as_wrenches(chain, wrenches)
    effort, demand = inverse_dynamics(state, wrenches=wrenches), state.require_accelerating()
    force_q, force_v, inertia = force_derivatives(state, effort.a, effort.lambda_c, outside)
    motions, idle = state.freedom.motions, state.freedom.idle
    if idle.shape[1]:
        force_q = force_q + inertia @ _idle_turning(state, effort.a - demand)
        # Idle freedoms take over what they carry: idleᵀ (d force + M idle β) = 0.
        give = np.eye(chain.nv) - inertia @ idle @ _inverse_inertia(chain, inertia, idle) @ idle.T
        force_q, force_v, inertia = give @ force_q, give @ force_v, give @ inertia
    (share, sizes), rank = natural_share(state), state.freedom.count.motor
    u, s, vt = np.linalg.svd(share, full_matrices=False)
    spread = (vt[:rank].T / s[:rank]) @ u[:, :rank].T
    # Least-norm efforts are in the range of the motors' share, which turns with the motions: dN = -J⁺ d(J N).
    pull = motions @ least_norm(share.T, effort.tau_motor * sizes, rank)
    turned = -_least_norm(state, row_derivatives(chain, state.q, pull, chain.rest).rate_q)
    beside, spread = (np.eye(chain.nu) - spread @ share) / sizes[:, None], spread / sizes[:, None]
    return EffortDerivatives(
        tau_q=spread @ (motions.T @ force_q) + beside @ (turned[chain.motor_index] / sizes[:, None]),
        tau_v=spread @ (motions.T @ force_v),
        tau_a=spread @ (motions.T @ inertia),
    )


def forward_dynamics_derivatives(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    tau_motor: ArrayLike | None = None,
    *,
    wrenches: Wrenches | None = None,
) -> MotionDerivatives:
    """Differentiate the acceleration of `forward_dynamics`.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration with closed loops, with a chain [m, rad, unit quaternions].
    v
        (nv,) tangent velocity that keeps them closed, with a chain [m/s, rad/s].
    tau_motor
        (nu,) motor efforts in the order of ``chain.motors`` [N or N m].
    wrenches
        {link: (6,)} what acts from outside, as in `inverse_dynamics`; they keep their axes, and act at the
        frame's origin wherever it goes [N, N m].

    Returns
    -------
    MotionDerivatives
        For variations that keep the loops closed, the change of the acceleration is
        ``a_q @ dq + a_v @ dv + a_tau @ dtau``. Accelerations of idle freedoms without inertia are undetermined, and so
        are their derivatives.

    Raises
    ------
    InputError
        If the state does not keep the loops closed.
    SingularityError
        If a motion that motors or platform take part in has no inertia.
    UnsupportedError
        If a joint with dry friction is at rest: its effort jumps there.
    """
    state = as_state(chain, q, v)
    chain = state.chain
    _require_slopes(state)
    outside = as_wrenches(chain, wrenches)
    motion = forward_dynamics(state, tau_motor=tau_motor, wrenches=wrenches)
    force_q, force_v, inertia = force_derivatives(state, motion.a, motion.lambda_c, outside)
    rows = row_derivatives(chain, state.q, state.v, motion.a)
    motions = state.freedom.motions
    response = motions @ _inverse_inertia(chain, inertia, motions) @ motions.T

    def solve(force: FloatArray, row: FloatArray) -> FloatArray:
        across = -_least_norm(state, row)
        return across + response @ (force - inertia @ across)

    push = np.eye(chain.nv)[:, chain.motor_index]
    return MotionDerivatives(
        a_q=solve(-force_q, rows.acceleration_q),
        a_v=solve(-force_v, rows.acceleration_v),
        a_tau=response @ push,
    )


def _require_slopes(state: State) -> None:
    """Refuse a state in which dry friction has no derivative: a coordinate of it that may move is at rest."""
    if state.effects is None:
        return
    rub, chain = state.effects.rubbing, state.chain
    still = ~rub.moving & take_part(state, chain.tangent_scale[:, None] * state.motions.basis)
    if still.any():
        row = rub.rows[int(np.flatnonzero(still)[0])]
        raise UnsupportedError(
            f"dry friction of a joint at rest has no derivative: the motion {named_motion(chain, row)}; move it, or "
            "take dry friction away by with_joint_physics"
        )


def force_derivatives(
    state: State, a: Tangent, lambda_c: FloatArray, outside: OutsideWrenches | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Differentiate M a + nle - J_cᵀ λ - Σ J_fᵀ w - efforts of joints, for fixed λ, w and dry friction.

    Parameters
    ----------
    state
        The state.
    a
        (nv,) tangent acceleration [m/s², rad/s²].
    lambda_c
        (nc,) multipliers of the rows [N, N m].
    outside
        Wrenches from outside, or None.

    Returns
    -------
    tuple of numpy.ndarray
        (nv, nv) each, with respect to q, v and a; the last is the joint-space inertia [N, N m per m, rad, per s, s²].
    """
    chain, model, unit = state.chain, state.chain.mass_model, state.chain.mass_unit
    reactions = reaction_forces(chain, state.q, lambda_c / unit)
    motion, forces, first = (state.q, state.v, a), reactions.forces, 0
    if state.base_motion is not None:
        ground, first = chain.moving_ground, 6
        model, motion = ground.model, ground.state(state.base_motion, *motion)
        forces = pin.StdVec_Force()
        forces.extend([pin.Force.Zero(), *reactions.forces])
    data = pin.Data(model)
    pin.computeRNEADerivatives(model, data, *motion, forces)
    size = first + chain.nv
    force_q, force_v = (np.array(x).reshape(size, size)[first:, first:] for x in (data.dtau_dq, data.dtau_dv))
    force_q = unit * (force_q - reactions.derivative)
    if outside is not None:
        force_q = force_q - outside_effort_derivative(state, outside)
    force_v = unit * force_v
    if state.effects is not None:
        by_q, by_v = state.effects.slopes()
        force_q, force_v = force_q - by_q, force_v - by_v
    return force_q, force_v, state.M


def _least_norm(state: State, rows: FloatArray) -> FloatArray:
    """Smallest tangent vectors (nv, n) with the given rates of the loop rows (nc, n), in natural units."""
    chain = state.chain
    return chain.tangent_scale[:, None] * state.motions.across(rows / chain.row_sizes[:, None])


def _idle_turning(state: State, idle: Tangent) -> FloatArray:
    """How a fixed idle motion has to turn with the configuration to stay idle: (nv, nv), least norm.

    It moves neither loops nor motors nor platform: [J_c; S; P] z = 0, so that [J_c; S; P] dz = -d[J_c; S; P] z.
    """
    chain = state.chain
    loops = row_derivatives(chain, state.q, idle, chain.rest).rate_q
    across = -state.motions.across(loops / chain.row_sizes[:, None])
    # What the least motion across the loops gives motors and platform is taken back along the active motions.
    sizes, scale, active = chain.twist_sizes[:, None], chain.tangent_scale, state.freedom.active
    twist = state.P * scale / sizes
    demand = np.vstack([np.zeros((chain.nu, chain.nv)), -_platform_rate(state, idle) / sizes])
    both = np.vstack([chain.motor_rows, twist])
    change = across + active @ np.linalg.pinv(both @ active) @ (demand - both @ across)
    return scale[:, None] * change


def _platform_rate(state: State, v: Tangent) -> FloatArray:
    """Differentiate the platform's twist, where a motion leaves it at rest, with respect to q: (6, nv), world axes."""
    chain, data = state.chain, pin.Data(state.chain.model)
    pin.computeForwardKinematicsDerivatives(chain.model, data, state.q, v, chain.rest)
    oMp = pin.updateFramePlacement(chain.model, data, chain.platform_id)
    # The turning of the axes acts on the twist, which is zero.
    by_q = pin.getFrameVelocityDerivatives(chain.model, data, chain.platform_id, pin.ReferenceFrame.LOCAL)[0]
    return np.kron(np.eye(2), oMp.rotation) @ np.reshape(by_q, (6, chain.nv))


def _inverse_inertia(chain: ClosedChain, inertia: FloatArray, motions: FloatArray) -> FloatArray:
    """Inverse of the inertia of the motions that have any."""
    moments, axes = np.linalg.eigh(motions.T @ inertia @ motions)
    scale = chain.tangent_scale
    heavy = moments > NO_INERTIA * np.abs(scale[:, None] * inertia * scale).max()
    return (axes[:, heavy] / moments[heavy]) @ axes[:, heavy].T
