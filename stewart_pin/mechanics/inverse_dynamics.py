r"""Inverse dynamics: which motor efforts make a chain move as asked.

Everything follows from one equation of motion on the spanning tree,

.. math:: M a + h = S^\top \tau + J_c^\top \lambda + \sum J_f^\top w_f .

Where loop rows and motors are as many as the tangent has entries and far from singular, the square system
:math:`[J_c; S]^\top` gives both unknowns at once. Elsewhere N, a basis of the motions that keep the loops closed
(J_c N = 0), splits the equation: Nᵀ times it gives the motor efforts without the reactions, the rest the reactions.
How redundant motors share a load within limits tells `sharing`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, get_args

import numpy as np

from stewart_pin.errors import InputError, SingularityError
from stewart_pin.mechanics.constraint_matrix.solution import constraint_matrix_inverse_dynamics
from stewart_pin.mechanics.effort import Effort
from stewart_pin.mechanics.sharing import Sharer, Sharing, sharer
from stewart_pin.model.tree import Limits
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.freedom import require_held
from stewart_pin.state.joint_effects import held_by
from stewart_pin.state.loop_rows import Drive
from stewart_pin.state.outside import OutsideWrenches, Wrenches, as_wrenches, given_efforts, needed_efforts
from stewart_pin.state.state import State, as_state, named_motion
from stewart_pin.tolerances import CONSISTENT, NO_INERTIA, TAKES_PART
from stewart_pin.typing import ArrayLike, BoolArray, FloatArray, Tangent

Method = Literal["pinocchio", "constraint_matrix"]


def inverse_dynamics(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    a: ArrayLike | None = None,
    *,
    wrenches: Wrenches | OutsideWrenches | None = None,
    method: Method = "pinocchio",
    effort_limit: ArrayLike | Limits | None = None,
    sharing: Sharing = "least_norm",
    throw: bool = True,
) -> Effort:
    """Compute the motor efforts that make a chain move as asked.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration with closed loops, with a chain [m, rad, unit quaternions].
    v
        (nv,) tangent velocity that keeps them closed, with a chain [m/s, rad/s].
    a
        (nv,) tangent acceleration that keeps them closed, with a chain [m/s², rad/s²].
    wrenches
        {link: (6,)} what acts from outside: [force; moment] on the link, at the origin of its frame, world axes; the
        platform is ``chain.platform`` [N, N m].
    method
        ``"pinocchio"``: RNEA and the loop Jacobian. ``"constraint_matrix"``: all bodies in maximal coordinates, an
        independent check.
    effort_limit
        (nu,) or one number: largest absolute motor effort; (nu, 2): least and greatest one; or ``chain.limits``, what
        the chain states. Redundant motors then share within it, method ``"pinocchio"`` only; what dry friction of
        joints at rest might hold is not counted upon [N or N m].
    sharing
        Which of the efforts that redundant motors may give, within `effort_limit`, method ``"pinocchio"`` only:
        ``"least_norm"``; ``"least_peak"``: those whose largest absolute value is least, and of these the ones of least
        norm; ``"mid_range"``: the nearest to the middles of the limits, where a motor that lacks one counts from zero.
        All are counted in natural units, see Returns. Along a motion the first and the last are continuous as long as
        the limits leave room; of the second the peak is, while the efforts below it may jump.
    throw
        Whether motors that cannot hold the robot are an error. Otherwise ``"pinocchio"`` keeps the demanded motion,
        with efforts by least squares and what they leave over in ``residual``; ``"constraint_matrix"`` keeps the
        motors' part of it, and ``a`` tells how the rest then moves.

    Returns
    -------
    Effort
        Motor efforts, loop reactions, and whether they are unique. Efforts and reactions that are not unique are the
        least-norm ones in natural units, forces times ``chain.length_scale`` beside moments: N m, so that the split
        does not depend on the unit of length. Springs, damping and dry friction of joints (`with_joint_physics`) count:
        dry friction opposes the motion, of a joint at rest the one that `a` starts; where that stays, it may be
        anything within its limits, and ``band`` tells what motors may then give. Idle freedoms, which no motor can
        drive, follow their own inertia, the wrenches and their joints, whatever `a` asks of them; dry friction holds
        them at rest while it can.

    Raises
    ------
    ActuationError
        If the motors cannot hold the robot; carries the freedom left over and the smallest singular value.
    EffortLimitError
        If no efforts within `effort_limit` make it move so; carries the motors in the way and by how much.
    SingularityError
        If the loops have lost a row here, or wrenches push an idle freedom that has no inertia.
    InputError
        If an argument is wrong, or the state does not keep the loops closed.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> rest = np.zeros(chain.nv)
    >>> stp.inverse_dynamics(chain, chain.q_home, rest, rest).tau_motor.round(2)
    array([49.99, 49.99, 49.99, 49.99, 49.99, 49.99])
    >>> heavier = {"platform": [0, 0, -100, 0, 0, 0]}  # pressed upon with 100 N
    >>> stp.inverse_dynamics(chain, chain.q_home, rest, rest, wrenches=heavier).tau_motor.round(2)
    array([67.53, 67.53, 67.53, 67.53, 67.53, 67.53])
    """
    state = as_state(chain, q, v, a)
    a = state.require_accelerating()
    outside = None if wrenches is None else as_wrenches(state.chain, wrenches)
    if method not in get_args(Method):
        raise InputError(f"method must be one of {', '.join(get_args(Method))}, got {method!r}")
    usual = effort_limit is None and sharing == "least_norm"
    sharing_by = None if usual else sharer(state.chain, effort_limit, sharing)
    if method == "constraint_matrix" and sharing_by is not None:
        raise InputError(
            "effort_limit is for method 'pinocchio', and so is sharing; 'constraint_matrix' gives those of least norm"
        )
    if method == "pinocchio":
        return inverse_dynamics_by(state, a, outside, sharing_by, throw=throw)
    # What is singular is a property of the state, so that all methods refuse the same ones.
    if throw:
        require_held(state)
    require_idle_inertia(state, given_efforts(state, outside, a))
    return _with_band(constraint_matrix_inverse_dynamics(state, a, outside, throw=throw), state, outside)


def inverse_dynamics_by(
    state: State, a: Tangent, outside: OutsideWrenches | None, sharing: Sharer | None, *, throw: bool = True
) -> Effort:
    """Compute inverse dynamics with a `Sharer`, which remembers the limits that held in the state before.

    Parameters
    ----------
    state
        State that `State.require_accelerating` has passed.
    a
        (nv,) its acceleration [m/s², rad/s²].
    outside
        Wrenches from outside, or None.
    sharing
        How redundant motors share within limits; None: by least norm, whatever the limits.
    throw
        As in `inverse_dynamics`.

    Returns
    -------
    Effort
        As of `inverse_dynamics`.
    """
    if sharing is None and state.drive is not None:
        return _with_band(_by_drive(state, state.drive, a, outside), state, outside)
    if throw:
        require_held(state)
    require_idle_inertia(state, given_efforts(state, outside, a))
    return _with_band(_by_motions(state, a, sharing, outside), state, outside)


def _with_band(effort: Effort, state: State, outside: OutsideWrenches | None) -> Effort:
    """Add by how much motor efforts may differ while dry friction holds what is at rest."""
    if state.effects is None or not state.effects.rubbing.limits.size:
        return effort
    rub = state.effects.rubbing
    held = state.effects.directions(effort.a) == 0
    if not held.any():
        return effort
    pushes = (rub.limits[:, None] * rub.rows)[held]
    gains = np.array([_motors_alone(state, push) for push in pushes]).T
    if state.drive is None and take_part(state, state.freedom.idle)[held].any():
        return replace(effort, band=_band_beside_idle(effort, state, outside, pushes, gains))
    half = np.abs(gains).sum(axis=1)
    return replace(effort, band=effort.tau_motor[:, None] + np.outer(half, [-1.0, 1.0]))


def _band_beside_idle(
    effort: Effort, state: State, outside: OutsideWrenches | None, pushes: FloatArray, gains: FloatArray
) -> FloatArray:
    """Efforts (nu, 2) that friction (k, nv) allows, of all its shares that balance idle freedoms as they are balanced.

    The gains (nu, k) are what motors have to give against each at its limit.
    """
    from scipy.optimize import linprog  # noqa: PLC0415 - slow to import, for what few chains ask

    given = state.chain.motor_rows.T @ effort.tau_motor + state.J_c.T @ effort.lambda_c
    share = np.linalg.lstsq(pushes.T, needed_efforts(state, effort.a, outside) - given)[0]
    balance, ends = state.freedom.idle.T @ pushes.T, []
    unit = float(np.abs(balance).max()) or 1.0
    equal = balance / unit, balance @ share / unit
    for gain in gains:
        size = float(np.abs(gain).max()) or 1.0
        both = [sign * linprog(sign * gain / size, None, None, *equal, (-1, 1)).fun for sign in (1, -1)]
        ends.append([size * end for end in both])
    return (effort.tau_motor + gains @ share)[:, None] - np.array(ends)[:, ::-1]


def _motors_alone(state: State, push: Tangent) -> FloatArray:
    """Motor efforts (nu,) that balance joint efforts at rest."""
    if state.drive is None:
        return least_efforts(state, state.freedom.motions.T @ push)
    scale = state.chain.tangent_scale
    return state.drive.carry(push * scale)[1] / scale[state.chain.motor_index]


def motor_efforts(state: State, a: Tangent, outside: OutsideWrenches | None = None) -> FloatArray:
    """Compute the motor efforts of a motion without checks: for controllers, whose states are those of an integrator.

    Parameters
    ----------
    state
        State whose loops are closed or nearly so.
    a
        (nv,) tangent acceleration [m/s², rad/s²].
    outside
        Wrenches from outside, or None.

    Returns
    -------
    numpy.ndarray
        (nu,) motor efforts, of least norm in natural units where they are not unique [N or N m].
    """
    drive = state.drive
    if drive is None:
        return _by_motions(state, a, None, outside).tau_motor
    return _by_drive(state, drive, a, outside).tau_motor


def _by_drive(state: State, drive: Drive, a: Tangent, outside: OutsideWrenches | None) -> Effort:
    """Solve [J_c; S]ᵀ [λ; τ] = M a + nle - Σ J_fᵀ w_f - efforts of joints, regular and square."""
    chain, scale = state.chain, state.chain.tangent_scale
    plain = outside is None and state.effects is None
    needed = (state.tree_efforts(a) if plain else needed_efforts(state, a, outside)) * scale
    reactions, motors = drive.carry(needed)
    left = needed - reactions @ state.rows
    left[chain.motor_index] -= motors
    return Effort(
        tau_motor=motors / scale[chain.motor_index],
        lambda_c=reactions / chain.row_sizes,
        unique=True,
        reactions_unique=True,
        a=a,
        residual=float(np.abs(left / scale).max()),
    )


def _by_motions(state: State, a: Tangent, sharing: Sharer | None, outside: OutsideWrenches | None) -> Effort:
    """Split the equation of motion by the motions that keep the loops closed."""
    chain, freedom, usual = state.chain, state.freedom, state.chain.generic
    needed, a = let_idle_go(state, a, freedom.idle, outside)
    load = freedom.motions.T @ needed
    if sharing is None:
        tau_motor = least_efforts(state, load)
    else:
        tau_motor = sharing.efforts(natural_share(state)[0], load, freedom.count.motor)
    needed[chain.motor_index] -= tau_motor
    lambda_c = least_reactions(state, needed)
    return Effort(
        tau_motor=tau_motor,
        lambda_c=lambda_c,
        unique=freedom.count.motor == chain.nu,
        reactions_unique=usual.rank == chain.nc,
        a=a,
        residual=float(np.abs(needed - state.J_c.T @ lambda_c).max(initial=0.0)),
    )


def least_efforts(state: State, load: FloatArray) -> FloatArray:
    """Find the motor efforts that carry a load, of least norm where they are not unique.

    Parameters
    ----------
    state
        The state.
    load
        (dof,) what the motions of `Freedom.motions` need [N m].

    Returns
    -------
    numpy.ndarray
        (nu,) efforts; forces count by ``chain.length_scale`` in their norm, moments by one [N or N m].
    """
    share, sizes = natural_share(state)
    return least_norm(share, load, state.freedom.count.motor) / sizes


def natural_share(state: State) -> tuple[FloatArray, FloatArray]:
    """Tell what efforts in natural units, all N m, contribute to the motions.

    Parameters
    ----------
    state
        The state.

    Returns
    -------
    share : numpy.ndarray
        (dof, nu) contribution of each motor to each motion of `Freedom.motions`, dimensionless.
    sizes : numpy.ndarray
        (nu,) by which efforts are multiplied to stand in natural units [m or 1].
    """
    chain = state.chain
    sizes = chain.tangent_scale[chain.motor_index]
    return state.freedom.motions[chain.motor_index].T / sizes, sizes


def least_norm(matrix: FloatArray, right: FloatArray, rank: int) -> FloatArray:
    """Solve a system by the least solution, with as many directions as it is known to have.

    Parameters
    ----------
    matrix
        (m, n) matrix [any unit].
    right
        (m,) right-hand side [any unit].
    rank
        Number of singular values to use.

    Returns
    -------
    numpy.ndarray
        (n,) solution in the sense of least squares, in any unit.
    """
    u, s, vt = np.linalg.svd(matrix, full_matrices=False)
    return vt[:rank].T @ ((u[:, :rank].T @ right) / s[:rank])


def least_reactions(state: State, efforts: FloatArray) -> FloatArray:
    """Find the reactions that carry joint efforts, of least norm in natural units where rows are redundant.

    Parameters
    ----------
    state
        The state.
    efforts
        (nv,) joint efforts to be carried [N, N m].

    Returns
    -------
    numpy.ndarray
        (nc,) multipliers of the rows [N, N m].
    """
    chain, motions = state.chain, state.motions
    return motions.reactions(efforts * chain.tangent_scale) / chain.row_sizes


def let_idle_go(
    state: State, a: Tangent, idle: FloatArray, outside: OutsideWrenches | None
) -> tuple[FloatArray, Tangent]:
    """Compute tree efforts for an acceleration, with that of idle freedoms as their own inertia makes it.

    Parameters
    ----------
    state
        The state.
    a
        (nv,) demanded tangent acceleration [m/s², rad/s²].
    idle
        (nv, n) idle motions [m, rad].
    outside
        Wrenches from outside, or None.

    Returns
    -------
    efforts, a : numpy.ndarray
        (nv,) what motors and loops have to give [N, N m], and the acceleration that follows [m/s², rad/s²].
    """
    needed = needed_efforts(state, a, outside)
    if not idle.shape[1]:
        return needed, a
    moments, axes, heavy = idle_inertia(state)
    axes = idle @ (axes[:, heavy] / np.sqrt(moments[heavy]))
    if state.effects is not None:
        needed = _with_idle_friction(state, a, axes, needed)
    change = -axes @ (axes.T @ needed)
    return needed + state.M @ change, a + change


def _with_idle_friction(state: State, a: Tangent, axes: FloatArray, needed: FloatArray) -> FloatArray:
    """Let dry friction oppose what idle freedoms at rest do, instead of what was demanded of them.

    The axes (nv, k) of the idle freedoms are of one unit of inertia each.
    """
    assert state.effects is not None
    rub = state.effects.rubbing
    free = ~rub.moving & take_part(state, axes)
    if not free.any():
        return needed
    rows, limits = rub.rows[free], rub.limits[free]
    needed = needed - (limits * state.effects.directions(a)[free]) @ rows
    pull = rows @ (a - axes @ (axes.T @ needed)) + rub.bias[free]
    friction = held_by(rows @ axes, pull, limits) @ rows
    require_idle_inertia(state, friction)
    return needed - friction


def take_part(state: State, motions: FloatArray) -> BoolArray:
    """Tell which coordinates with dry friction take part in one of some motions.

    Parameters
    ----------
    state
        State with `Effects`.
    motions
        (nv, k) tangent vectors [m, rad].

    Returns
    -------
    numpy.ndarray
        (k,) mask of `Effects.rubbing`.
    """
    assert state.effects is not None
    rub, chain = state.effects.rubbing, state.chain
    if not motions.shape[1]:
        return np.zeros(len(rub.rows), dtype=bool)
    lengths = np.linalg.norm(motions / chain.tangent_scale[:, None], axis=0)
    shares = rub.rows @ (motions / lengths) / rub.sizes[:, None]
    return (np.abs(shares) > TAKES_PART).any(axis=1)


def idle_inertia(state: State) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Tell the inertia of idle freedoms.

    Parameters
    ----------
    state
        The state.

    Returns
    -------
    moments : numpy.ndarray
        (n,) in natural units [kg m²].
    axes : numpy.ndarray
        (n, n) principal axes, a column each, dimensionless.
    heavy : numpy.ndarray
        (n,) of bool, dimensionless: which have any.
    """
    idle = state.freedom.idle
    moments, axes = np.linalg.eigh(idle.T @ state.M @ idle)
    return moments, axes, moments > NO_INERTIA * np.abs(state.inertia).max()


def require_idle_inertia(state: State, efforts: Tangent | None) -> None:
    """Refuse wrenches, springs and friction that push an idle freedom without inertia: nothing says how it would move.

    Parameters
    ----------
    state
        The state.
    efforts
        (nv,) joint efforts that neither motors nor loops give, or None [N, N m].

    Raises
    ------
    SingularityError
        Naming the motion.
    """
    if efforts is None or not state.chain.generic.count.idle:
        return
    idle, scale = state.freedom.idle, state.chain.tangent_scale
    moments, axes, heavy = idle_inertia(state)
    light = idle @ axes[:, ~heavy]
    pushed = efforts @ light
    if np.abs(pushed).max(initial=0.0) > CONSISTENT * float(np.abs(efforts * scale).max(initial=0.0)):
        direction = light @ pushed
        direction = direction / np.abs(direction / scale).max()
        raise SingularityError(
            f"nothing with inertia takes part in the motion {named_motion(state.chain, direction)}, and wrenches, "
            "springs or friction push it, so its acceleration is undetermined; give the bodies mass, or let nothing "
            "push it",
            smallest_singular_value=float(moments[0]),
            direction=direction,
            names=state.chain.tangent_names,
        )
