r"""Forward dynamics: how a chain accelerates under given motor efforts.

The acceleration that keeps the loops closed is a particular one plus motions N of the loops, and Nᵀ times the equation
of motion determines how much of each:

.. math:: J_c a + \dot J_c v = 0, \qquad N^\top (M a + h - S^\top \tau - \sum J_f^\top w_f - f) = 0 ,

with f what joints do by themselves: springs, damping, dry friction.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.linalg import get_lapack_funcs

from stewart_pin.checks import as_array
from stewart_pin.errors import ConvergenceError, InputError, SingularityError, UnsupportedError
from stewart_pin.mechanics.effort import Motion
from stewart_pin.mechanics.inverse_dynamics import least_reactions, require_idle_inertia, take_part
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.joint_effects import held_by
from stewart_pin.state.loop_rows import Drive
from stewart_pin.state.loop_verbs import reactions_from_pinocchio, unknown_to_pinocchio
from stewart_pin.state.outside import OutsideWrenches, Wrenches, as_wrenches, given_efforts
from stewart_pin.state.state import State, as_state, named_motion
from stewart_pin.tolerances import CONSISTENT, NO_INERTIA
from stewart_pin.typing import ArrayLike, BoolArray, FloatArray, Tangent

(_potrs,) = get_lapack_funcs(("potrs",), dtype=np.float64)

Method = Literal["projection", "constraint_dynamics"]


def forward_dynamics(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    tau_motor: ArrayLike | None = None,
    *,
    wrenches: Wrenches | OutsideWrenches | None = None,
    method: Method | None = None,
) -> Motion:
    """Compute the acceleration under given motor efforts.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration with closed loops, with a chain [m, rad, unit quaternions].
    v
        (nv,) tangent velocity that keeps them closed, with a chain [m/s, rad/s].
    tau_motor
        (nu,) motor efforts in the order of ``chain.motors``; with a state, by name [N or N m].
    wrenches
        {link: (6,)} what acts from outside: [force; moment] on the link, at the origin of its frame, world axes; the
        platform is ``chain.platform`` [N, N m].
    method
        ``"projection"``: the equation of motion projected on the motions that keep the loops closed; for every chain,
        also with redundant loops or massless legs. ``"constraint_dynamics"``: `pinocchio.constraintDynamics`, for
        spherical and fixed loops that are not redundant, on bodies with mass. Default: the latter where its rows and
        inertias are far from singular, at half the cost, otherwise the former.

    Returns
    -------
    Motion
        Acceleration and loop reactions (of least norm in natural units where loops are redundant).

    Raises
    ------
    InputError
        If the state does not keep the loops closed, or the method is unknown.
    UnsupportedError
        If ``constraint_dynamics`` cannot treat the chain.
    SingularityError
        If the loops have lost a row here, or a motion that motors, platform or wrenches take part in has no inertia,
        so that no acceleration is determined.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> state = chain.at(chain.q_home)
    >>> effort = stp.inverse_dynamics(state)
    >>> bool(abs(stp.forward_dynamics(state, tau_motor=effort.tau_motor).a).max() < 1e-9)
    True
    """
    state = as_state(chain, q, v).require_moving()
    chain = state.chain
    if tau_motor is None and not chain.nu:
        tau_motor = np.zeros(0)
    if tau_motor is None:
        raise InputError("tau_motor is missing; pass the motor efforts, in the order of chain.motors")
    tau = np.zeros(chain.nv)
    tau[chain.motor_index] = as_array("tau_motor", tau_motor, (chain.nu,))
    given = given_efforts(state, None if wrenches is None else as_wrenches(chain, wrenches))
    if given is not None:
        require_idle_inertia(state, given)
        tau += given
    if method not in (None, "projection", "constraint_dynamics"):
        raise InputError(f"method must be 'projection' or 'constraint_dynamics', got {method!r}")
    motion = _accelerated(state, tau, method)
    held = None if state.effects is None else resting_friction(state, motion.a)
    if held is None:
        return motion
    require_idle_inertia(state, held)
    return _accelerated(state, tau + held, method)


def _accelerated(state: State, tau: FloatArray, method: Method | None) -> Motion:
    """Accelerate the tree under joint efforts (nv,), its loops closed."""
    chain = state.chain
    if method == "constraint_dynamics":
        return _constraint_dynamics(state.require_still_ground("pinocchio.constraintDynamics"), tau)
    if method is None and state.drive is not None and state.base_motion is None and chain.known_to_pinocchio:
        motion = _by_pinocchio(state, tau)
        if motion is not None:
            return motion
    push = chain.tangent_scale * (tau - state.nle)
    if state.drive is not None and state.motor_inertia is not None:
        return _by_drive(state, state.drive, state.motor_inertia, push)
    return _by_motions(state, push)


def _by_drive(state: State, drive: Drive, factor: FloatArray, push: FloatArray) -> Motion:
    """Move along the motors: M_x ẍ = Gᵀ(push - M a_0); natural units."""
    chain, inertia, G, start = state.chain, state.inertia, state.motor_motions, state.drift
    rates = _potrs(factor, (push - inertia @ start) @ G, lower=1)[0]
    a = start + G @ rates
    lambda_c = drive.carry(inertia @ a - push)[0] / chain.row_sizes
    return Motion(a=a * chain.tangent_scale, lambda_c=lambda_c)


def _by_motions(state: State, push: FloatArray) -> Motion:
    """Move along an orthonormal basis of the motions; natural units."""
    chain, motions, inertia = state.chain, state.motions, state.inertia
    start = -motions.across(state.loop_bias / chain.row_sizes)
    a = start + _free_acceleration(state, inertia, push - inertia @ start)
    lambda_c = least_reactions(state, (inertia @ a - push) / chain.tangent_scale)
    return Motion(a=a * chain.tangent_scale, lambda_c=lambda_c)


def _free_acceleration(state: State, inertia: FloatArray, push: FloatArray) -> Tangent:
    """Acceleration along the motions that keep the loops closed; idle freedoms without inertia do not accelerate."""
    chain, free = state.chain, state.motions.basis
    moments, axes = np.linalg.eigh(free.T @ inertia @ free)
    heavy = moments > NO_INERTIA * moments.max(initial=0.0)
    if not heavy.all():
        _require_idle(state, free @ axes[:, ~heavy], moments)
    kept = axes[:, heavy]
    return free @ (kept @ ((kept.T @ (free.T @ push)) / moments[heavy])) if chain.nv else push


_AT_ONCE = 1e-9
"""Acceleration of a coordinate at rest, relative to what friction and the rest make of it, below which it stays."""


def resting_friction(state: State, a: Tangent) -> Tangent | None:
    """Find what dry friction of joints at rest does.

    Parameters
    ----------
    state
        State with `Effects`.
    a
        (nv,) acceleration without it [m/s², rad/s²].

    Returns
    -------
    numpy.ndarray or None
        (nv,) joint efforts; None where no joint with dry friction is at rest [N, N m].

    Raises
    ------
    ConvergenceError
        If no friction is found, which does not happen but for numbers beyond any machine.
    """
    assert state.effects is not None
    rub = state.effects.rubbing
    still = ~rub.moving
    if not still.any():
        return None
    return friction_at_rest(state, a, still)[0] @ rub.rows[still]


def friction_at_rest(
    state: State, a: Tangent, still: BoolArray, share: float = 1.0
) -> tuple[FloatArray, FloatArray]:
    """Find what dry friction of some coordinates does, which are taken to be at rest.

    Parameters
    ----------
    state
        State with `Effects`.
    a
        (nv,) acceleration without it [m/s², rad/s²].
    still
        (k,) mask of the coordinates of `Rubbing`.
    share
        Part of the limits that it may reach, dimensionless.

    Returns
    -------
    efforts : numpy.ndarray
        (n,) of these coordinates [N or N m].
    left : numpy.ndarray
        (n,) accelerations that are left, zero where friction holds [m/s² or rad/s²].

    Raises
    ------
    ConvergenceError
        As `held_by`.
    """
    assert state.effects is not None
    rub, free = state.effects.rubbing, state.chain.tangent_scale[:, None] * state.motions.basis
    able = take_part(state, free)[still]  # what closed loops let nothing move does nothing
    efforts, left = np.zeros((2, len(able)))
    if not able.any():
        return efforts, left
    rows, limits = rub.rows[still][able], share * rub.limits[still][able]
    moments, axes = np.linalg.eigh(free.T @ state.M @ free)
    heavy = moments > NO_INERTIA * moments.max(initial=0.0)
    response = rows @ free @ (axes[:, heavy] / np.sqrt(moments[heavy]))
    pull = rows @ a + rub.bias[still][able]
    efforts[able] = held_by(response, pull, limits)
    across = response @ response.T
    rates = pull + across @ efforts[able]
    # Round-off of what holds, and of what nothing pulls.
    starts = np.abs(rates) > _AT_ONCE * (np.abs(pull) + np.abs(across) @ limits)
    left[able] = np.where(starts, rates, 0.0)
    return efforts, left


def _require_idle(state: State, weightless: FloatArray, moments: FloatArray) -> None:
    """Of the weightless motions, all must be idle: each of them then is one of the idle freedoms."""
    chain = state.chain
    idle = state.freedom.idle / chain.tangent_scale[:, None]
    active = weightless - idle @ (idle.T @ weightless)
    # A weightless motion is determined by round-off to about the root of NO_INERTIA.
    if np.abs(active).max(initial=0.0) > 1e-3:
        direction = weightless[:, np.argmax(np.linalg.norm(active, axis=0))] * chain.tangent_scale
        raise SingularityError(
            f"nothing with inertia takes part in the motion {named_motion(chain, direction)}, so its acceleration is "
            "undetermined; give the bodies mass",
            smallest_singular_value=float(moments[0]),
            direction=direction,
            names=chain.tangent_names,
        )


def _constraint_dynamics(state: State, tau: FloatArray) -> Motion:
    chain = state.chain
    if not chain.known_to_pinocchio:
        unknown = (
            unknown_to_pinocchio(chain)
            or "pinocchio.constraintDynamics cannot treat redundant loops (see mobility)"
        )
        raise UnsupportedError(f"{unknown}; use method='projection'")
    motion = _by_pinocchio(state, tau)
    if motion is None:
        raise UnsupportedError(
            "pinocchio.constraintDynamics needs bodies with mass, and a state away from singularities; "
            "use method='projection'"
        )
    left = float(np.abs(state.J_c @ motion.a + state.loop_bias).max(initial=0.0))
    if left > CONSISTENT * max(1.0, float(np.abs(motion.a).max(initial=0.0))):
        raise ConvergenceError(
            f"pinocchio.constraintDynamics leaves {left:.3g} of the loop acceleration; use method='projection'",
            residual=left,
        )
    return motion


def _by_pinocchio(state: State, tau: FloatArray) -> Motion | None:
    """Pinocchio's own algorithm; None where bodies lack mass for it."""
    memory = state.chain.constrained_dynamics
    solver = memory.take()
    found = solver.accelerate(state.q, state.v, tau)
    memory.give(solver)
    return found and Motion(a=found[0], lambda_c=reactions_from_pinocchio(state.chain, found[1]))
