"""The rows that close the loops, as wrenches on the two bodies: columns of J_cᵀ, their bias J̇_c v, and the gaps.

A row that holds a direction is a unit force along it at the origin of loop frame 2, on body 2 and reversed on body 1;
an angle row is a couple. Carried down the tree they are the rows of the loop Jacobian.

The three rows of a loop that holds a point may be turned together: here they stand along the axes of the body at the
end of a leg, where most of their entries vanish. All work at the origin of frame 2, so that what they span, and the
acceleration that they leave, is that of the chain's own rows while the loop is open, too. Where loops are known to be
closed that origin is at a constant place in either body.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
from numpy.polynomial.polynomial import polyder

from stewart_pin.kernels.graph.bodies import Motions, Placements, Wrench, efforts_of_wrenches, moments_of
from stewart_pin.kernels.planning.spatial import constant, rotation_constant
from stewart_pin.kernels.planning.tree import CouplingRow, LoopEnds, Tree, TreeJoint
from stewart_pin.model.description import JointKind
from stewart_pin.model.loop_rows import AngleRow, LengthRow, NormalRow


@dataclass(frozen=True, eq=False)
class LoopColumns:
    """Loop rows of a whole chain.

    Attributes
    ----------
    transpose
        (nv, nc) J_cᵀ for the rows as they are turned here.
    turn
        (nc, nc) orthogonal: reactions of the chain's own rows are ``turn`` times those of the turned ones.
    """

    transpose: ca.SX
    turn: ca.SX


def loop_columns(tree: Tree, at: Placements, q: ca.SX) -> LoopColumns:
    """Evaluate the rows of a closed chain.

    Parameters
    ----------
    tree
        Constants.
    at
        Placements of the bodies.
    q
        (nq, 1) configuration.

    Returns
    -------
    LoopColumns
        Their Jacobian, transposed.
    """
    columns, turn = ca.SX(tree.nv, tree.nc), ca.SX.eye(tree.nc)
    for loop in tree.loops:
        index = list(loop.index)
        between = frames_between(loop, at)
        wrench1, wrench2 = _row_wrenches(loop, between)
        if loop.holds_point:
            force1, force2, axes = _point_forces(tree, loop, between)
            wrench1[:3, :3], wrench2[:3, :3] = force1, force2
            turn[index[:3], index[:3]] = axes
        wrenches = {
            loop.body1: about_origin(wrench1, between.arm),
            loop.body2: about_origin(wrench2, constant(loop.translation2)),
        }
        columns[:, index] = efforts_of_wrenches(tree.joints, at, wrenches, len(index))
        wound = _wound_by(tree, loop)
        if wound is not None:
            columns[wound[0].v.start, index[0]] += wound[1]
    for row in tree.couplings:
        columns[row.v1, row.index] = 1
        for _, entry, ratio in row.others:
            columns[entry, row.index] = -ratio
        if row.v2 >= 0:
            columns[row.v2, row.index] = -follower(row, q, 1)
    return LoopColumns(columns, turn)


def _wound_by(tree: Tree, loop: LoopEnds) -> tuple[TreeJoint, float] | None:
    """Joint that winds in the cable of a loop, and its ratio."""
    row = loop.rows[0]
    if not isinstance(row, LengthRow) or row.cable.reel is None:
        return None
    return next(joint for joint in tree.joints if joint.name == row.cable.reel), row.cable.ratio


def _way(row: LengthRow, reach: ca.SX, slide: ca.SX | None = None) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Length of a rod or of a cable over its pulley, its gradient e, and slideᵀ (∂e/∂reach) slide, in frame 1."""
    t, s = ca.SX.sym("t", 3), ca.SX.sym("s", 3)
    radius, axis = row.cable.radius, constant(row.axis)
    if radius:
        height = ca.dot(axis, t)
        beyond = ca.norm_2(t - height * axis) - radius
        free = ca.sqrt(beyond**2 + height**2 - radius**2)
        length = radius * (ca.pi - ca.atan2(height, beyond) - ca.atan2(free, radius)) + free
        e = ca.gradient(length, t)
        bend = ca.dot(s, ca.jtimes(e, t, s))
    else:
        length = ca.norm_2(t)
        e = t / length
        across = s - e * ca.dot(e, s)
        bend = ca.dot(across, across) / length
    way = ca.Function("way", [t, s], [length, e, bend])
    found, e, bend = way(reach, ca.SX.zeros(3) if slide is None else slide)
    return ca.SX(found), ca.SX(e), ca.SX(bend)


def follower(row: CouplingRow, q: ca.SX, order: int) -> ca.SX:
    """Evaluate the polynomial of a coupling or a derivative of it.

    Parameters
    ----------
    row
        The coupling.
    q
        (nq, 1) configuration.
    order
        0 for where joint 1 stands, 1 for the slope, 2 for its rate.

    Returns
    -------
    casadi.SX
        (1, 1), by Horner's rule.
    """
    value = ca.SX(0)
    for coefficient in polyder(row.polynomial, order)[::-1]:
        value = value * (q[row.q2] if row.q2 >= 0 else 0) + float(coefficient)
    return value


@dataclass(frozen=True, eq=False)
class Between:
    """Loop frame 2 as body 1 sees it.

    Attributes
    ----------
    turn
        (3, 3) axes of body 2 in those of body 1.
    rotation, translation
        (3, 3) and (3, 1) 1M2 [m].
    arm
        (3, 1) origin of frame 2 in body 1 [m].
    """

    turn: ca.SX
    rotation: ca.SX
    translation: ca.SX
    arm: ca.SX


def frames_between(loop: LoopEnds, at: Placements) -> Between:
    """Place loop frame 2 in body 1.

    Parameters
    ----------
    loop
        The loop.
    at
        Placements of the bodies.

    Returns
    -------
    Between
        How body 1 sees it.
    """
    to_body1, from1 = at.to_world[loop.body1].T, rotation_constant(loop.rotation1).T
    turn = to_body1 @ at.to_world[loop.body2]
    rotation = from1 @ turn @ rotation_constant(loop.rotation2)
    if loop.holds_point and at.closed:
        return Between(turn, rotation, ca.SX.zeros(3), constant(loop.translation1))
    origin2 = at.in_world[loop.body2] + at.to_world[loop.body2] @ constant(loop.translation2)
    arm = to_body1 @ (origin2 - at.in_world[loop.body1])
    return Between(turn, rotation, from1 @ (arm - constant(loop.translation1)), arm)


def _point_forces(tree: Tree, loop: LoopEnds, between: Between) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Three unit forces at a point, on bodies 1 and 2 in their axes, and their directions in frame 1."""
    from1 = rotation_constant(loop.rotation1).T
    if _along_body2(tree, loop):
        return -between.turn, ca.SX.eye(3), from1 @ between.turn
    return -ca.SX.eye(3), between.turn.T, from1


def _along_body2(tree: Tree, loop: LoopEnds) -> bool:
    """Whether the rows of a point stand along body 2: that at the end of a leg, not the platform or the ground."""
    return loop.body1 in (0, tree.platform) or tree.joints[loop.body1 - 1].kind is JointKind.FLOATING


def _row_wrenches(loop: LoopEnds, between: Between) -> tuple[ca.SX, ca.SX]:
    """Write forces above moments, at the origin of frame 2: on bodies 1 and 2 in their axes, (6, rows) each."""
    columns = []
    for row in loop.rows:
        force, moment = ca.SX.zeros(3), ca.SX.zeros(3)
        match row:
            case NormalRow():
                force = constant(row.normal)
            case AngleRow():
                # u1 · (w × R u2) = w · (R u2 × u1)
                moment = ca.cross(between.rotation @ constant(row.u2), constant(row.u1))
            case LengthRow():
                force = _way(row, between.translation)[1]
        columns.append((force, moment))
    to_body1 = -rotation_constant(loop.rotation1)
    to_body2 = rotation_constant(loop.rotation2) @ between.rotation.T
    both = [
        ca.horzcat(*(ca.vertcat(to_body @ force, to_body @ moment) for force, moment in columns))
        for to_body in (to_body1, to_body2)
    ]
    return both[0], both[1]


def about_origin(wrenches: ca.SX, arm: ca.SX) -> Wrench:
    """Shift wrenches from a point to the body's origin.

    Parameters
    ----------
    wrenches
        (6, k) forces above moments about the point.
    arm
        (3, 1) the point [m].

    Returns
    -------
    tuple
        (3, k) forces and moments about the origin.
    """
    forces = wrenches[:3, :]
    return forces, wrenches[3:, :] + moments_of(arm, forces)


def loop_bias(tree: Tree, at: Placements, drifting: Motions, q: ca.SX, v: ca.SX) -> ca.SX:
    """Evaluate the rows' accelerations.

    Parameters
    ----------
    tree
        Constants.
    at
        Placements of the bodies.
    drifting
        Motions of the bodies without gravity; with zero joint accelerations the result is the bias.
    q, v
        (nq, 1) configuration and (nv, 1) velocity.

    Returns
    -------
    casadi.SX
        (nc, 1) second derivative of the turned rows' gap.
    """
    values = ca.SX(tree.nc, 1)
    for loop in tree.loops:
        values[list(loop.index)] = _row_accelerations(tree, loop, frames_between(loop, at), drifting)
    for row in tree.couplings:
        if row.v2 >= 0:
            values[row.index] = -follower(row, q, 2) * v[row.v2] ** 2
    return values


def _row_accelerations(tree: Tree, loop: LoopEnds, between: Between, moving: Motions) -> ca.SX:
    """Second derivatives of the rows' gap, of those that hold a point as they are turned."""
    one, two, back = loop.body1, loop.body2, rotation_constant(loop.rotation1).T
    arm, offset = between.arm, constant(loop.translation2)
    omega = moving.omega[one]
    acceleration = moving.acceleration[two] + moving.turning[two] @ offset
    velocity = moving.velocity[two] + ca.cross(moving.omega[two], offset)
    # Relative to the point of body 1 that is where the origin of frame 2 is, and in axes that turn with body 1.
    slide = between.turn @ velocity - moving.velocity[one] - ca.cross(omega, arm)
    carried = moving.acceleration[one] + moving.turning[one] @ arm + 2 * ca.cross(omega, slide)
    spin = between.turn @ moving.omega[two] - omega
    spin_rate = between.turn @ moving.omega_rate[two] - moving.omega_rate[one] - ca.cross(omega, spin)
    slide_rate = back @ (between.turn @ acceleration - carried)
    slide, spin, spin_rate = back @ slide, back @ spin, back @ spin_rate
    values = []
    if loop.holds_point:
        along2 = _along_body2(tree, loop)
        values.append(
            acceleration - between.turn.T @ carried if along2 else between.turn @ acceleration - carried
        )
    for row in loop.rows[3:] if loop.holds_point else loop.rows:
        match row:
            case NormalRow():
                values.append(ca.dot(constant(row.normal), slide_rate))
            case AngleRow():
                turned = between.rotation @ constant(row.u2)
                second = ca.cross(spin_rate, turned) + ca.cross(spin, ca.cross(spin, turned))
                values.append(ca.dot(constant(row.u1), second))
            case LengthRow():
                _, along, bend = _way(row, between.translation, slide)
                values.append(ca.dot(along, slide_rate) + bend)
    return ca.vertcat(*values)


# ----------------------------------------------------------------------------------------------------
# How far the loops are from closed
# ----------------------------------------------------------------------------------------------------


def loop_gaps(tree: Tree, at: Placements, q: ca.SX) -> ca.SX:
    """Evaluate the gap of the loops.

    Parameters
    ----------
    tree
        Constants.
    at
        Placements of the bodies.
    q
        (nq, 1) configuration.

    Returns
    -------
    casadi.SX
        (nc, 1) as `stewart_pin.loop_gap` [m, rad and dimensionless].
    """
    gap = ca.SX(tree.nc, 1)
    for loop in tree.loops:
        frame1 = at.to_world[loop.body1] @ rotation_constant(loop.rotation1)
        frame2 = at.to_world[loop.body2] @ rotation_constant(loop.rotation2)
        origin1 = at.in_world[loop.body1] + at.to_world[loop.body1] @ constant(loop.translation1)
        origin2 = at.in_world[loop.body2] + at.to_world[loop.body2] @ constant(loop.translation2)
        rotation, reach = frame1.T @ frame2, frame1.T @ (origin2 - origin1)
        for index, row in zip(loop.index, loop.rows, strict=True):
            match row:
                case NormalRow():
                    gap[index] = ca.dot(constant(row.normal), reach)
                case AngleRow():
                    gap[index] = ca.dot(constant(row.u1), rotation @ constant(row.u2))
                case LengthRow():
                    gap[index] = _way(row, reach)[0] - row.length
        wound = _wound_by(tree, loop)
        if wound is not None:
            gap[loop.index[0]] += wound[1] * q[wound[0].q.start]
    for row in tree.couplings:
        gap[row.index] = q[row.q1] - follower(row, q, 0) - sum(ratio * q[at] for at, _, ratio in row.others)
    return gap


def opposed_axes(tree: Tree, at: Placements) -> ca.SX:
    """Find loops whose rows vanish although they are not assembled: directions that should agree are opposed.

    Parameters
    ----------
    tree
        Constants.
    at
        Placements of the bodies.

    Returns
    -------
    casadi.SX
        (1, 1) 0 for an assembled chain, 1 where the axes of a loop point against each other.
    """
    worst = ca.SX(0)
    for loop in tree.loops:
        if loop.kind is JointKind.UNIVERSAL:
            continue
        # Angle rows hold u2 of frame 2 at right angles to two axes of frame 1: along the third, which has its name.
        axes = {tuple(row.u2) for row in loop.rows if isinstance(row, AngleRow)}
        frame1 = at.to_world[loop.body1] @ rotation_constant(loop.rotation1)
        frame2 = at.to_world[loop.body2] @ rotation_constant(loop.rotation2)
        for axis in sorted(axes):
            agreement = ca.dot(frame1 @ constant(axis), frame2 @ constant(axis))
            worst = ca.fmax(worst, -agreement)
    return worst
