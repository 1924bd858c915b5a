"""Forward dynamics of trees, and of chains with loops: the three passes, then the forces that keep the loops closed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from stewart_pin.checks import as_array
from stewart_pin.errors import InputError, SingularityError
from stewart_pin.mechanics.articulated_body.bodies import Body, cross_motion, skew, tree_bodies
from stewart_pin.mechanics.articulated_body.joint_efforts import (
    JointCoordinate,
    LoopFrames,
    loop_coordinates_of,
    tree_coordinates,
    with_moving_friction,
)
from stewart_pin.mechanics.articulated_body.passes import (
    BodyMotion,
    Response,
    first_pass,
    respond,
    spatial_base,
    without_inertia,
)
from stewart_pin.mechanics.constraint_matrix.joint_efforts import friction_at_rest
from stewart_pin.mechanics.effort import Motion
from stewart_pin.model.description import Loop
from stewart_pin.model.loop_rows import AngleRow, LengthRow, NormalRow, closure_rows, undefined_direction
from stewart_pin.state.base_motion import BaseMotion
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.outside import Wrenches, as_wrenches
from stewart_pin.state.state import State, as_chain, as_configuration, as_state
from stewart_pin.tolerances import NOTHING
from stewart_pin.typing import ArrayLike, Configuration, FloatArray, Tangent

# ----------------------------------------------------------------------------------------------------
# Couplings as rows of joint rates: q1 = p(q2) + Σ r q holds v1 - p' v2 - Σ r v = 0, a1 - p' a2 - Σ r a = p'' v2²
# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class GearRows:
    """Rows of all couplings.

    Attributes
    ----------
    jacobian
        (r, nv) rates of the residuals per joint rate [unit of joint 1 per unit of joint].
    gap
        (r,) q1 - p(q2) [m or rad].
    bias
        (r,) second derivative of the residuals without joint acceleration [m/s² or rad/s²].
    """

    jacobian: FloatArray
    gap: FloatArray
    bias: FloatArray


def coupling_rows(chain: ClosedChain, bodies: Sequence[Body], q: Configuration, v: Tangent) -> GearRows:
    """Evaluate the couplings of a chain.

    Parameters
    ----------
    chain
        Closed chain.
    bodies
        Bodies of its tree.
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].

    Returns
    -------
    GearRows
        One row per coupling.
    """
    at = {body.joint.name: body for body in bodies if body.joint is not None}
    rows = len(chain.couplings)
    jacobian, gap, bias = np.zeros((rows, chain.nv)), np.zeros(rows), np.zeros(rows)
    for k, coupling in enumerate(chain.couplings):
        # Horner's scheme for p, p' and p''.
        value = slope = half_curve = 0.0
        x = float(q[at[coupling.joint2].q_index][0]) if coupling.joint2 else 0.0
        for coefficient in reversed(coupling.polynomial):
            half_curve = half_curve * x + slope
            slope = slope * x + value
            value = value * x + coefficient
        first = at[coupling.joint1]
        jacobian[k, first.v_index] = 1.0
        gap[k] = float(q[first.q_index][0]) - value
        if coupling.joint2:
            second = at[coupling.joint2].v_index
            jacobian[k, second] = -slope
            bias[k] = -2.0 * half_curve * float(v[second][0]) ** 2
        for name, ratio in coupling.others:
            jacobian[k, at[name].v_index] = -ratio
            gap[k] -= ratio * float(q[at[name].q_index][0])
    return GearRows(jacobian, gap, bias)


# ----------------------------------------------------------------------------------------------------
# Loops as wrenches: each loop row is a wrench that the closure transmits from link 1 to link 2
#
# With v_rel the spatial velocity of link 2 relative to link 1 and T the wrench of a row, the rate of the gap is
# Tᵀ v_rel. T belongs to link 1 but for what the joint itself moves, so that its rate is T° + v₁ ×* T, with T° as seen
# from link 1. Everything stands in base coordinates, [angular; linear]. No formula is shared with
# `stewart_pin.state`.
#
# References
# ----------
# .. [1] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer, 2008, ch. 8.
# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class LoopWrenches:
    """Rows of one loop.

    Attributes
    ----------
    body1, body2
        Numbers of the bodies.
    wrench1, wrench2
        (6, r) wrenches in the coordinates of either body [1 and m].
    gap
        (r,) residual of the rows [m and 1].
    rate
        (r,) its derivative [m/s and 1/s].
    bias
        (r,) its second derivative without acceleration of the bodies [m/s² and 1/s²].
    """

    body1: int
    body2: int
    wrench1: FloatArray
    wrench2: FloatArray
    gap: FloatArray
    rate: FloatArray
    bias: FloatArray


def loop_wrenches(loop: Loop, bodies: Sequence[Body], motion: BodyMotion) -> LoopWrenches:
    """Evaluate the rows of a loop.

    Parameters
    ----------
    loop
        The loop.
    bodies
        Bodies of the tree.
    motion
        Their motion, from the first pass.

    Returns
    -------
    LoopWrenches
        Wrenches, gap, rate and bias.

    Raises
    ------
    SingularityError
        If the ends of a distance loop coincide.
    """
    number = {body.link: i for i, body in enumerate(bodies)}
    one, two = number[loop.link1], number[loop.link2]
    axes1, origin1 = _loop_frame(motion.to_base[one], loop.placement1)
    axes2, origin2 = _loop_frame(motion.to_base[two], loop.placement2)
    velocity1, velocity2 = (np.linalg.solve(motion.to_base[k], motion.velocity[k]) for k in (one, two))
    relative = velocity2 - velocity1
    arm, spin = skew(origin2), skew(relative[:3])
    slide = relative[3:] - arm @ relative[:3]  # of frame 2's origin, as seen from link 1: v + ω × p
    sliding, reach, none = skew(slide), origin2 - origin1, np.zeros(3)
    wrenches, rates, gaps = [], [], []
    for row in closure_rows(loop):
        match row:
            case NormalRow():
                n = axes1 @ row.normal
                gaps.append(n @ reach)
                wrenches.append(np.concatenate([arm @ n, n]))
                rates.append(np.concatenate([sliding @ n, none]))
            case AngleRow():
                u1, u2 = axes1 @ row.u1, axes2 @ row.u2
                gaps.append(u1 @ u2)
                wrenches.append(np.concatenate([-skew(u1) @ u2, none]))  # u2 × u1
                rates.append(np.concatenate([-skew(u1) @ (spin @ u2), none]))
            case LengthRow():
                way, e, turn = _way(loop, row, axes1 @ row.axis, reach, slide)
                gaps.append(way - row.length)
                wrenches.append(np.concatenate([arm @ e, e]))
                rates.append(np.concatenate([sliding @ e + arm @ turn, turn]))
    wrench = np.array(wrenches).reshape(-1, 6).T
    apparent_rate = np.array(rates).reshape(-1, 6)
    return LoopWrenches(
        body1=one,
        body2=two,
        wrench1=np.linalg.solve(motion.to_base[one].T, wrench),  # f₀ = ⁱX₀ᵀ fᵢ
        wrench2=np.linalg.solve(motion.to_base[two].T, wrench),
        gap=np.array(gaps),
        rate=wrench.T @ relative,
        # (T° + v₁ ×* T)ᵀ v_rel, and (v ×*)ᵀ = -(v ×)
        bias=apparent_rate @ relative - wrench.T @ (cross_motion(velocity1) @ relative),
    )


def _way(
    loop: Loop, row: LengthRow, axis: FloatArray, reach: FloatArray, slide: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """Length of a rod or of a cable over its pulley, its direction at frame 2, and the rate of that.

    With D from the middle of the pulley to the far end, D⊥ at right angles to it and f² = D² - r² the free cable, the
    tangent is e = (f D - r D⊥) / D²; its rate is that of the quotient.
    """
    radius = row.cable.radius
    level = reach - axis * (axis @ reach)
    away = float(np.linalg.norm(level if radius else reach))
    ahead = level / away if radius and away else np.zeros(3)
    side = skew(ahead) @ axis
    middle = reach - radius * ahead
    square = float(middle @ middle)
    if away == 0.0 or square <= radius**2:
        raise undefined_direction(loop.name, bool(radius))
    free = np.sqrt(square - radius**2)
    yaw = float((skew(axis) @ ahead) @ slide) / away  # of the pulley about its swivel axis
    moving = slide - radius * yaw * (skew(axis) @ ahead)
    beside, beside_rate = skew(side) @ middle, skew(side) @ moving + yaw * skew(skew(axis) @ side) @ middle
    e = (free * middle - radius * beside) / square
    along = float(middle @ moving)
    rate = (along / free * middle + free * moving - radius * beside_rate - 2 * along * e) / square
    if not radius:
        return free, e, rate
    wrapped = np.arccos(-radius / np.sqrt(square)) - np.arctan2(axis @ middle, ahead @ middle)
    return float(radius * wrapped + free), e, rate


def _loop_frame(to_base: FloatArray, placement: pin.SE3) -> tuple[FloatArray, FloatArray]:
    """Axes (3, 3) and origin (3,) of a loop frame in base coordinates, read off ⁱX₀ = [[E, 0], [-E r×, E]]."""
    rotation = to_base[:3, :3].T
    cross = -rotation @ to_base[3:, :3]
    origin = np.array([cross[2, 1], cross[0, 2], cross[1, 0]])
    return rotation @ placement.rotation, origin + rotation @ placement.translation


# ----------------------------------------------------------------------------------------------------


def _reels(chain: ClosedChain, bodies: Sequence[Body]) -> FloatArray:
    """(nc, nv) what the reels of cables add to the rates of the rows; the rows of loops stand in their order."""
    at = {body.joint.name: body for body in bodies if body.joint is not None}
    wound, row = np.zeros((chain.nc, chain.nv)), 0
    for loop in chain.loops:
        if loop.cable.reel is not None:
            wound[row, at[loop.cable.reel].v_index] = loop.cable.ratio
        row += len(closure_rows(loop))
    return wound


_LENT = 0.1
"""Arm, in robot sizes, at which a lent rotor has all the mass of the robot."""


def closed_chain_articulated_body(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    tau_motor: ArrayLike | None = None,
    *,
    wrenches: Wrenches | None = None,
) -> Motion:
    """Compute the acceleration under given motor efforts, loops closed, by the articulated-body algorithm.

    An independent second opinion on `forward_dynamics`: neither joint-space inertia nor loop Jacobian is formed.

    Parameters
    ----------
    chain
        Closed chain, or a state of it. Bodies may be without mass as long as every motion that keeps the loops closed
        moves some.
    q
        (nq,) configuration with closed loops, with a chain [m, rad, unit quaternions].
    v
        (nv,) tangent velocity that keeps them closed, with a chain [m/s, rad/s].
    tau_motor
        (nu,) motor efforts in the order of ``chain.motors`` [N or N m].
    wrenches
        {link: (6,)} what acts from outside: [force; moment] on the link, at the origin of its frame, world axes; with a
        `base_motion` of the state those of the inertial frame [N, N m].

    Returns
    -------
    Motion
        Acceleration and loop reactions (of least norm in natural units where loops are redundant).

    Raises
    ------
    InputError
        If an argument is wrong, or the state does not keep the loops closed.
    SingularityError
        If a motion moves nothing that has inertia, or the loops have lost a row here.

    Notes
    -----
    The tree with open loops answers several load cases in the same passes: the state itself, and a unit wrench pair on
    each row of a loop (a pair of joint efforts for a coupling). With A the relative accelerations that these cause and
    b those of the state, the loop forces follow from A λ + b = 0 ([1]_, ch. 8, with responses instead of matrices).

    A joint beyond which the tree has no inertia is lent a rotor, and an effort f that is to cancel what it costs: with
    rotor r, f = r q̈, one more row q̈ - f / r = 0 for each. The solution has the rotor in it no more.

    References
    ----------
    .. [1] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer, 2008.
    """
    state = as_state(chain, q, v).require_moving()
    chain, q, v = state.chain, state.q, state.v
    if tau_motor is None and not chain.nu:
        tau_motor = np.zeros(0)
    if tau_motor is None:
        raise InputError("tau_motor is missing; pass the motor efforts, in the order of chain.motors")
    tau_motor = as_array("tau_motor", tau_motor, (chain.nu,))
    base_motion = state.base_motion
    base_velocity, base_acceleration = spatial_base(base_motion, chain.gravity)
    bodies = tree_bodies(chain)
    motion = _under(chain, wrenches, first_pass(bodies, q, v, base_velocity), base_motion)
    loops = [loop_wrenches(loop, bodies, motion) for loop in chain.loops]
    gears = coupling_rows(chain, bodies, q, v)
    own = [*tree_coordinates(chain, bodies, q, v), *_loop_coordinates(chain, bodies, motion)]
    efforts, resting = with_moving_friction(chain, own, v)

    rotors = np.array(chain.model.armature)
    lent = without_inertia(bodies, rotors, motion.to_parent) if chain.nc else []
    rotors[lent] += _rotors(chain)[lent]
    # Case 0 is the state with open loops, case k a unit force of row k alone, at rest and without gravity; then a unit
    # effort on each joint that has been lent a rotor, and at each coordinate that dry friction may hold.
    rows = chain.nc + len(lent)
    cases = 1 + rows + len(resting)
    tau = np.zeros((chain.nv, cases))
    tau[chain.motor_index, 0] = tau_motor
    bias, product = np.zeros((2, len(bodies), 6, cases))
    bias[:, :, 0], product[:, :, 0] = motion.bias, motion.velocity_product
    for effort, coordinate in zip(efforts, own, strict=True):
        coordinate.give(effort, tau[:, 0], bias[:, :, 0])
    for k, coordinate in enumerate(resting, 1 + rows):
        coordinate.give(1.0, tau[:, k], bias[:, :, k])
    # A gear's unit force is a pair of joint efforts.
    tau[:, 1 + chain.nc - gears.jacobian.shape[0] : 1 + chain.nc] = gears.jacobian.T
    wound = _reels(chain, bodies)
    tau[:, 1 : 1 + chain.nc] += wound.T
    tau[lent, np.arange(1 + chain.nc, 1 + rows)] = 1.0
    base = np.zeros((6, cases))
    base[:, 0] = base_acceleration
    start = 1
    for loop in loops:
        columns = slice(start, start + loop.gap.size)
        # External forces enter the bias with a minus sign; link 1 feels the opposite of link 2.
        bias[loop.body2][:, columns] -= loop.wrench2
        bias[loop.body1][:, columns] += loop.wrench1
        start = columns.stop
    response = respond(bodies, rotors, motion.to_parent, tau, bias, product, base)
    relative = np.vstack(
        [
            *(x.wrench2.T @ response.body[x.body2] - x.wrench1.T @ response.body[x.body1] for x in loops),
            gears.jacobian @ response.joint,
            response.joint[lent],
        ]
    )
    relative[: chain.nc] += wound @ response.joint
    relative[: chain.nc, 0] += np.concatenate([*(loop.bias for loop in loops), gears.bias])
    given, asked = [0, *range(1 + rows, cases)], slice(1, 1 + rows)
    kept = relative[:, asked]
    at = np.arange(chain.nc, rows)
    kept[at, at] -= 1 / rotors[lent]
    forces = _loop_forces(chain, kept, relative[:, given], lent)
    held = _held(resting, response, given, asked, forces)
    total = forces[:, 0] + forces[:, 1:] @ held
    a = response.joint[:, 0] + response.joint[:, asked] @ total + response.joint[:, 1 + rows :] @ held
    return Motion(a=a, lambda_c=total[: chain.nc])


_STARTS = 1e-11
"""Part that closed loops leave of what a coordinate answers to its own effort with open ones, from which on it may
move: below is round-off of numbers that cancel."""


def _held(
    resting: Sequence[JointCoordinate],
    response: Response,
    given: Sequence[int],
    asked: slice,
    forces: FloatArray,
) -> FloatArray:
    """Dry friction of coordinates at rest, from what a unit of each does with closed loops (k,) [N or N m].

    Given are the load cases of the state and of these units, asked those of the rows; forces keep the loops closed.
    """
    held = np.zeros(len(resting))
    if not resting:
        return held
    rates = np.array([own.accelerations(response) for own in resting])
    closed = rates[:, given] + rates[:, asked] @ forces
    pull, units = closed[:, 0] + [own.known for own in resting], closed[:, 1:]
    alone = rates[:, list(given)[1:]].diagonal()
    able = units.diagonal() > _STARTS * alone
    if able.any():
        limits = np.array([own.friction for own in resting])[able]
        held[able] = friction_at_rest(units[np.ix_(able, able)], pull[able], limits)
    return held


def _loop_coordinates(
    chain: ClosedChain, bodies: Sequence[Body], motion: BodyMotion
) -> list[JointCoordinate]:
    """List what joints that close loops do."""
    number, found = {body.link: i for i, body in enumerate(bodies)}, []
    for loop in chain.loops:
        one, two = number[loop.link1], number[loop.link2]
        axes1, origin1 = _loop_frame(motion.to_base[one], loop.placement1)
        axes2, origin2 = _loop_frame(motion.to_base[two], loop.placement2)
        frames = LoopFrames(one, two, axes1, axes2, origin1, origin2)
        found += loop_coordinates_of(loop, frames, motion, chain.length_scale)
    return found


def _rotors(chain: ClosedChain) -> FloatArray:
    """Inertia of a rotor that is neither much more nor much less than what joints move (nv,) [kg m², kg]."""
    mass = sum(body.mass for body in chain.model.inertias) or 1.0
    return mass * (_LENT * chain.length_scale / chain.tangent_scale) ** 2


def _loop_forces(
    chain: ClosedChain, response: FloatArray, open_loops: FloatArray, lent: list[int]
) -> FloatArray:
    """Solve A λ + b = 0 with as many directions as the loops have; least in natural units where rows are redundant.

    Each column of b is a load case of its own.
    """
    if not response.size:
        return np.zeros_like(open_loops)
    sizes = np.concatenate([chain.row_sizes, chain.tangent_scale[lent]])
    rank = chain.generic.rank + len(lent)
    # Per natural effort and in natural units: A is symmetric, its rank that of the loop rows.
    u, s, vt = np.linalg.svd(response / sizes / sizes[:, None])
    if lent and s[rank - 1] <= NOTHING * s[0]:
        name = chain.tangent_names[lent[int(np.argmax(np.abs(vt[rank - 1, chain.nc :])))]]
        raise SingularityError(
            f"a motion in which '{name}' takes part moves nothing that has inertia, so no effort determines its "
            "acceleration; give the links beyond it mass, or use forward_dynamics",
            smallest_singular_value=float(s[rank - 1]),
            names=(name,),
        )
    scaled = u[:, :rank].T @ (open_loops / sizes[:, None])
    return -(vt[:rank].T @ (scaled / s[:rank, None])) / sizes[:, None]


def _under(
    chain: ClosedChain, wrenches: Wrenches | None, motion: BodyMotion, base_motion: BaseMotion | None
) -> BodyMotion:
    """Take what acts on the bodies from outside off their bias forces."""
    outside = as_wrenches(chain, wrenches)
    if outside is None:
        return motion
    borne, bias = outside.by_link(), motion.bias.copy()
    turn = (base_motion or BaseMotion()).rotation
    for number, body in enumerate(tree_bodies(chain)):
        if body.link in borne:
            # [moment; force] at the body's own origin: the rotation E of ⁱX₀ takes it into its axes.
            force, moment = borne[body.link].reshape(2, 3) @ turn @ motion.to_base[number][:3, :3].T
            bias[number] -= np.concatenate([moment, force])
    return replace(motion, bias=bias)


# ----------------------------------------------------------------------------------------------------
# Forward dynamics of trees: serial arms, spanning trees, fixed, prescribed or free-floating base
# ----------------------------------------------------------------------------------------------------


def articulated_body_acceleration(
    chain: ClosedChain,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    *,
    wrenches: Wrenches | None = None,
    base_motion: BaseMotion | None = None,
) -> Tangent:
    """Compute the acceleration of the spanning tree by the articulated-body algorithm.

    Loops are left open; `closed_chain_articulated_body` closes them.

    Parameters
    ----------
    chain
        Chain; a serial arm is one without loops.
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].
    tau
        (nv,) efforts of all tree joints, not of the motors only, beside what they do by themselves; what joints that
        close loops do is left away with the loops [N, N m].
    wrenches
        {link: (6,)} what acts from outside: [force; moment] on the link, at the origin of its frame, world axes; with a
        `base_motion` those of the inertial frame [N, N m].
    base_motion
        How the ground link moves; default: at rest. For a base that is free to move see `on_floating_base`.

    Returns
    -------
    numpy.ndarray
        (nv,) tangent acceleration [m/s², rad/s²].

    Raises
    ------
    InputError
        If an argument has the wrong shape or is not finite.
    SingularityError
        If a joint moves nothing that has inertia.

    Notes
    -----
    Three passes: outwards for velocities and bias forces, inwards for the inertia that each subtree shows at its joint,
    outwards again for the accelerations. The cost is proportional to the number of bodies.

    References
    ----------
    .. [1] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer, 2008, table 7.1.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> arm = stp.load("arm_3r_planar", gravity=(0, -9.81, 0))
    >>> rest = np.zeros(3)
    >>> stp.articulated_body_acceleration(arm, rest, rest, rest).round(3)
    array([-25.628,  35.802, -18.032])
    """
    as_chain(chain)
    q, v = as_configuration(chain, "q", q), as_array("v", v, (chain.nv,))
    tau = as_array("tau", tau, (chain.nv,))
    base_velocity, base_acceleration = spatial_base(base_motion, chain.gravity)
    bodies = tree_bodies(chain)
    motion = _under(chain, wrenches, first_pass(bodies, q, v, base_velocity), base_motion)
    efforts, resting = with_moving_friction(chain, own := tree_coordinates(chain, bodies, q, v), v)
    given = np.zeros((chain.nv, 1 + len(resting)))
    given[:, 0] = tau
    given[[each.entry for each in own], 0] += efforts
    given[[each.entry for each in resting], np.arange(1, given.shape[1])] = 1.0
    first = np.arange(given.shape[1]) == 0
    response = respond(
        bodies,
        np.array(chain.model.armature),
        motion.to_parent,
        given,
        motion.bias[:, :, None] * first,
        motion.velocity_product[:, :, None] * first,
        base_acceleration[:, None] * first,
    )
    held = _held(resting, response, range(given.shape[1]), slice(0), np.zeros((0, given.shape[1])))
    return response.joint[:, 0] + response.joint[:, 1:] @ held
