r"""The linear system that a chain is for small motions about an equilibrium.

With :math:`\xi` coordinates along the motions T that keep the loops closed,

.. math:: \ddot\xi = A_{21}\,\xi + A_{22}\,\dot\xi + B_2\,δτ .

At rest, curvature of the motions meets no force that is not in balance already, so that the derivatives of the
acceleration along T are all there is; velocities enter by damping, and else by their squares only. Dry friction, which
holds what is at rest, has no place in a linear system: it is left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.building.joints import without_dry_friction
from stewart_pin.checks import as_array
from stewart_pin.errors import InputError
from stewart_pin.mechanics.derivatives import forward_dynamics_derivatives
from stewart_pin.mechanics.effort import hangs
from stewart_pin.mechanics.forward_dynamics import forward_dynamics
from stewart_pin.mechanics.inverse_dynamics import inverse_dynamics
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.outside import Wrenches
from stewart_pin.state.state import State, as_state
from stewart_pin.tolerances import NO_INERTIA
from stewart_pin.typing import ArrayLike, FloatArray

_AT_REST = 1e-6
"""Acceleration, in robot sizes and radians per s², below which a state counts as an equilibrium: printed digits."""


@dataclass(frozen=True, eq=False, repr=False)
class LinearSystem(Brief):
    """Small motions about an equilibrium, d[ξ; ξ̇]/dt = A [ξ; ξ̇] + B δτ.

    Attributes
    ----------
    A
        (2n, 2n) system matrix [1, 1/s, 1/s²].
    B
        (2n, nu) input matrix: acceleration per motor effort [m or rad per N s² or N m s²].
    motions
        (nv, n) T, tangent displacement per coordinate: dq = T ξ [m, rad].
    names
        Names of the coordinates: the motors, then ``idle 1`` and so on.
    q
        (nq,) configuration [m, rad, unit quaternions].
    tau_motor
        (nu,) motor efforts that hold it [N or N m].
    """

    A: FloatArray
    B: FloatArray
    motions: FloatArray
    names: tuple[str, ...]
    q: FloatArray
    tau_motor: FloatArray


def linearise(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    *,
    tau_motor: ArrayLike | None = None,
    wrenches: Wrenches | None = None,
) -> LinearSystem:
    """Linearise the motion of a chain about an equilibrium.

    The coordinates are the displacements of the motors (or of as many of them as the chain has freedoms), and of the
    idle freedoms.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration with closed loops, with a chain [m, rad, unit quaternions].
    tau_motor
        (nu,) motor efforts that hold it there [N or N m]; default: those that gravity and the wrenches need.
    wrenches
        {link: (6,)} what acts from outside, as in `inverse_dynamics`; they keep their axes, and act at the
        frame's origin wherever it goes [N, N m].

    Returns
    -------
    LinearSystem
        A, B and the coordinates.

    Raises
    ------
    ActuationError
        If the motors cannot hold the robot.
    InputError
        If the loops are open, or the efforts do not hold the configuration.
    SingularityError
        If a motion that motors or platform take part in has no inertia.

    Notes
    -----
    Springs and damping of joints count (`with_joint_physics`), dry friction does not. Idle freedoms with inertia but
    nothing that holds them stay in the system, with zero eigenvalues; those without inertia do not move.
    """
    state = as_state(chain, q).require_still_ground("linearise")
    state = State(without_dry_friction(state.chain), state.q)  # at rest
    chain = state.chain
    needed = inverse_dynamics(state, wrenches=wrenches)
    tau = needed.tau_motor if tau_motor is None else as_array("tau_motor", tau_motor, (chain.nu,))
    require_balance(
        state,
        forward_dynamics(state, tau_motor=tau, wrenches=wrenches).a,
        "leave tau_motor out, or choose a configuration at rest (idle freedoms hang down)",
    )
    motions, names = coordinate_motions(state)
    slopes = forward_dynamics_derivatives(state, tau_motor=tau, wrenches=wrenches)
    scale = chain.tangent_scale[:, None]
    coordinates = np.linalg.pinv(motions / scale) / scale.T  # ξ of a motion
    n = motions.shape[1]
    A = np.zeros((2 * n, 2 * n))
    A[:n, n:] = np.eye(n)
    A[n:, :n] = coordinates @ slopes.a_q @ motions
    A[n:, n:] = coordinates @ slopes.a_v @ motions
    B = np.vstack([np.zeros((n, chain.nu)), coordinates @ slopes.a_tau])
    return LinearSystem(A, B, motions, names, state.q, tau)


def require_balance(state: State, a: FloatArray, remedy: str) -> None:
    """Refuse a configuration that does not stay.

    Parameters
    ----------
    state
        State at rest.
    a
        (nv,) its acceleration [m/s², rad/s²].
    remedy
        What to do.

    Raises
    ------
    InputError
        If it accelerates by more than printed digits make it; names the joint.
    """
    chain = state.chain
    left = _without_hanging(state, a) / chain.tangent_scale
    if np.abs(left).max(initial=0.0) > _AT_REST * max(1.0, float(np.linalg.norm(chain.gravity))):
        worst = int(np.argmax(np.abs(left)))
        raise InputError(
            f"q is no equilibrium under these efforts: '{chain.tangent_names[worst]}' accelerates with "
            f"{left[worst]:.3g} robot sizes or radians per s²; {remedy}"
        )


def _without_hanging(state: State, a: FloatArray) -> FloatArray:
    """Leave out the acceleration of idle freedoms that is due to printed digits."""
    idle = state.freedom.idle
    if not idle.shape[1]:
        return a
    moments = idle.T @ state.M @ idle
    loads = idle.T @ (state.M @ a)
    if not hangs(state, idle, loads):
        return a
    return a - idle @ np.linalg.lstsq(moments, loads, rcond=NO_INERTIA)[0]


def coordinate_motions(state: State) -> tuple[FloatArray, tuple[str, ...]]:
    """Choose readable coordinates of the motions: motors first, idle freedoms after.

    Parameters
    ----------
    state
        State of a chain whose motors hold it.

    Returns
    -------
    motions : numpy.ndarray
        (nv, n) motion per unit of each coordinate: a motor with the other ones at rest, or an idle freedom [m, rad].
    names : tuple of str
        One per coordinate.
    """
    chain, freedom = state.chain, state.freedom
    scale = chain.tangent_scale[:, None]
    idle, held = freedom.idle / scale, freedom.active
    share = (held * scale)[chain.motor_index]
    motors = list(range(chain.nu))
    if chain.nu > held.shape[1]:
        motors = _independent(share / chain.tangent_scale[chain.motor_index, None], held.shape[1])
    moving = scale * held @ np.linalg.inv(share[motors])
    names = [*(chain.motors[k] for k in motors), *(f"idle {k + 1}" for k in range(idle.shape[1]))]
    return np.hstack([moving, freedom.idle]), tuple(names)


def _independent(share: FloatArray, count: int) -> list[int]:
    """Pick rows one after the other, each the first that is not nearly dependent on those before."""
    chosen: list[int] = []
    for k in range(share.shape[0]):
        rows = share[[*chosen, k]]
        if len(chosen) < count and np.linalg.svd(rows, compute_uv=False)[-1] > 1e-3 * np.linalg.norm(
            share, 2
        ):
            chosen.append(k)
    return chosen
