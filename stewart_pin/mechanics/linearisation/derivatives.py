"""Analytical derivatives of inverse and forward dynamics, for variations that keep the loops closed.

Both differentiate the same equations, with N a basis of the motions that keep the loops closed:

    M a + nle = Sᵀ τ + J_cᵀ λ,      J_c a + bias = 0.

The derivative of M a + nle - J_cᵀ λ for fixed a and λ is that of Pinocchio's recursive Newton-Euler algorithm with the
reactions as external forces, plus what `reaction_forces` adds; that of the loops' acceleration is `row_derivatives`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.closure.newton import RANK
from stewart_pin.closure.reaction_derivatives import reaction_forces
from stewart_pin.closure.row_derivatives import row_derivatives
from stewart_pin.mechanics.constrained import forward_dynamics, pinocchio_inverse_dynamics
from stewart_pin.mechanics.freedom import analyse_freedom
from stewart_pin.mechanics.platform import motion_matrix
from stewart_pin.model.chain import ClosedChain
from stewart_pin.typing import ArrayLike, Configuration, FloatArray, Tangent

_NO_INERTIA = 1e-12
"""Inertia of a motion, relative to the largest, below which it has none: a thousand units of round-off."""


@dataclass(frozen=True, eq=False)
class EffortDerivatives:
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


@dataclass(frozen=True, eq=False)
class MotionDerivatives:
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
    chain: ClosedChain, q: ArrayLike, v: ArrayLike, a: ArrayLike
) -> EffortDerivatives:
    """Differentiate the motor efforts of `inverse_dynamics`.

    Where motors are redundant, these are the derivatives of the least-norm efforts; where freedoms are idle, those of
    the efforts when the idle freedoms follow their own inertia.

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

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> rest = np.zeros(chain.nv)
    >>> stp.inverse_dynamics_derivatives(chain, chain.q_home, rest, rest).tau_q.shape
    (6, 24)
    """
    effort = pinocchio_inverse_dynamics(chain, q, v, a)
    q, v, demand = (np.asarray(x, dtype=float) for x in (q, v, a))
    force_q, force_v, inertia = force_derivatives(chain, q, v, effort.a, effort.lambda_c)
    freedom = analyse_freedom(chain, q)
    motions, idle = freedom.motions, freedom.idle
    if idle.shape[1]:
        force_q = force_q + inertia @ _idle_turning(chain, q, effort.a - demand)
        # Idle freedoms take over what they carry: idleᵀ (d force + M idle β) = 0.
        give = np.eye(chain.nv) - inertia @ idle @ _inverse_inertia(chain, inertia, idle) @ idle.T
        force_q, force_v, inertia = give @ force_q, give @ force_v, give @ inertia
    share = motions[chain.motor_index].T
    spread = np.linalg.pinv(share, rcond=RANK)
    # Least-norm efforts are in the range of the motors' share, which turns with the motions: dN = -J⁺ d(J N).
    pull = motions @ np.linalg.lstsq(share.T, effort.tau_motor, rcond=RANK)[0]
    turned = -_least_norm(chain, q, row_derivatives(chain, q, pull, np.zeros(chain.nv)).rate_q)
    beside = np.eye(chain.nu) - spread @ share
    return EffortDerivatives(
        tau_q=spread @ (motions.T @ force_q) + beside @ turned[chain.motor_index],
        tau_v=spread @ (motions.T @ force_v),
        tau_a=spread @ (motions.T @ inertia),
    )


def forward_dynamics_derivatives(
    chain: ClosedChain, q: ArrayLike, v: ArrayLike, tau_motor: ArrayLike
) -> MotionDerivatives:
    """Differentiate the acceleration of `forward_dynamics`.

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
    """
    motion = forward_dynamics(chain, q, v, tau_motor)
    q, v = np.asarray(q, dtype=float), np.asarray(v, dtype=float)
    force_q, force_v, inertia = force_derivatives(chain, q, v, motion.a, motion.lambda_c)
    rows = row_derivatives(chain, q, v, motion.a)
    motions = analyse_freedom(chain, q).motions
    response = motions @ _inverse_inertia(chain, inertia, motions) @ motions.T

    def solve(force: FloatArray, row: FloatArray) -> FloatArray:
        across = -_least_norm(chain, q, row)
        return across + response @ (force - inertia @ across)

    push = np.eye(chain.nv)[:, chain.motor_index]
    return MotionDerivatives(
        a_q=solve(-force_q, rows.acceleration_q),
        a_v=solve(-force_v, rows.acceleration_v),
        a_tau=response @ push,
    )


def force_derivatives(
    chain: ClosedChain, q: Configuration, v: Tangent, a: Tangent, lambda_c: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Differentiate M a + nle - J_cᵀ λ for fixed λ.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].
    a
        (nv,) tangent acceleration [m/s², rad/s²].
    lambda_c
        (nc,) multipliers of the rows [N, N m].

    Returns
    -------
    tuple of numpy.ndarray
        (nv, nv) each, with respect to q, v and a; the last is the joint-space inertia [N, N m per m, rad, per s, s²].
    """
    reactions = reaction_forces(chain, q, lambda_c)
    data = pin.Data(chain.model)
    pin.computeRNEADerivatives(chain.model, data, q, v, a, reactions.forces)
    force_q, force_v, inertia = (
        np.array(x).reshape(chain.nv, chain.nv) for x in (data.dtau_dq, data.dtau_dv, data.M)
    )
    inertia = np.triu(inertia) + np.triu(inertia, 1).T  # Pinocchio fills the upper triangle only
    return force_q - reactions.derivative, force_v, inertia


def _least_norm(chain: ClosedChain, q: Configuration, rows: FloatArray) -> FloatArray:
    """Smallest tangent vectors (nv, n) with the given rates of the loop rows (nc, n), lengths in robot sizes."""
    scale = chain.tangent_scale
    jacobian = motion_matrix(chain, q)[: chain.nc] * scale
    return scale[:, None] * np.linalg.lstsq(jacobian, rows, rcond=RANK)[0]


def _idle_turning(chain: ClosedChain, q: Configuration, idle: Tangent) -> FloatArray:
    """How a fixed idle motion has to turn with the configuration to stay idle: (nv, nv), least norm.

    It moves neither loops nor motors nor platform: [J_c; S; P] z = 0, so that [J_c; S; P] dz = -d[J_c; S; P] z.
    """
    matrix = motion_matrix(chain, q)
    stacked = np.vstack([matrix, np.eye(chain.nv)[chain.motor_index]])
    loops = row_derivatives(chain, q, idle, np.zeros(chain.nv)).rate_q
    change = np.vstack([loops, _platform_rate(chain, q, idle), np.zeros((chain.nu, chain.nv))])
    scale = chain.tangent_scale
    return -scale[:, None] * np.linalg.lstsq(stacked * scale, change, rcond=RANK)[0]


def _platform_rate(chain: ClosedChain, q: Configuration, v: Tangent) -> FloatArray:
    """Differentiate the platform's twist, where a motion leaves it at rest, with respect to q: (6, nv), world axes."""
    data = pin.Data(chain.model)
    pin.computeForwardKinematicsDerivatives(chain.model, data, q, v, np.zeros(chain.nv))
    oMp = pin.updateFramePlacement(chain.model, data, chain.platform_id)
    # The turning of the axes acts on the twist, which is zero.
    by_q = pin.getFrameVelocityDerivatives(chain.model, data, chain.platform_id, pin.ReferenceFrame.LOCAL)[0]
    return np.kron(np.eye(2), oMp.rotation) @ np.reshape(by_q, (6, chain.nv))


def _inverse_inertia(chain: ClosedChain, inertia: FloatArray, motions: FloatArray) -> FloatArray:
    """Inverse of the inertia of the motions that have any."""
    moments, axes = np.linalg.eigh(motions.T @ inertia @ motions)
    scale = chain.tangent_scale
    heavy = moments > _NO_INERTIA * np.abs(scale[:, None] * inertia * scale).max()
    return (axes[:, heavy] / moments[heavy]) @ axes[:, heavy].T
