"""The rows that close the loops, as wrenches on the two bodies: columns of J_cᵀ, and their bias J̇_c v.

A row that holds a direction is a unit force along it at the origin of loop frame 2, on body 2 and reversed on body 1;
an angle row is a couple. Carried down the tree they are the rows of the loop Jacobian.

The three rows of a loop that holds a point may be turned together, as long as the loop is closed: here they stand
along the axes of the body at the end of a leg, where most of their entries vanish.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.polynomial.polynomial import polyder

from stewart_pin.kernels.graph.joint_efforts import Wrench, efforts_of_wrenches, moments_of
from stewart_pin.kernels.graph.joint_motion import Motions, Placements
from stewart_pin.kernels.planning.spatial import constant, rotation_constant
from stewart_pin.kernels.planning.tree import CouplingRow, LoopEnds, Tree
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
        Placements of the bodies, with closed loops.
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
        between = _between(loop, at)
        wrench1, wrench2 = _row_wrenches(loop, between)
        if loop.holds_point:
            force1, force2, axes = _point_forces(tree, loop, between)
            wrench1[:3, :3], wrench2[:3, :3] = force1, force2
            turn[index[:3], index[:3]] = axes
        wrenches = {
            loop.body1: _about_origin(wrench1, constant(loop.translation1) + _reach(loop, between)),
            loop.body2: _about_origin(wrench2, constant(loop.translation2)),
        }
        columns[:, index] = efforts_of_wrenches(tree.joints, at, wrenches, len(index))
    for row in tree.couplings:
        columns[row.v1, row.index] = 1
        if row.v2 >= 0:
            columns[row.v2, row.index] = -follower(row, q, 1)
    return LoopColumns(columns, turn)


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
class _Between:
    """1M2 of a loop: (3, 3) rotation, and (3, 1) translation, exactly zero where the loop holds a point."""

    rotation: ca.SX
    translation: ca.SX


def _between(loop: LoopEnds, at: Placements) -> _Between:
    frame1 = at.to_world[loop.body1] @ rotation_constant(loop.rotation1)
    frame2 = at.to_world[loop.body2] @ rotation_constant(loop.rotation2)
    if loop.holds_point:
        return _Between(frame1.T @ frame2, ca.SX.zeros(3))
    reach = _origin2(loop, at) - _origin1(loop, at)
    return _Between(frame1.T @ frame2, frame1.T @ reach)


def _origin1(loop: LoopEnds, at: Placements) -> ca.SX:
    return at.in_world[loop.body1] + at.to_world[loop.body1] @ constant(loop.translation1)


def _origin2(loop: LoopEnds, at: Placements) -> ca.SX:
    return at.in_world[loop.body2] + at.to_world[loop.body2] @ constant(loop.translation2)


def _reach(loop: LoopEnds, between: _Between) -> ca.SX:
    """Origin of frame 2 from that of frame 1, in axes of body 1."""
    return rotation_constant(loop.rotation1) @ between.translation


def _point_forces(tree: Tree, loop: LoopEnds, between: _Between) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Three unit forces at a point, on bodies 1 and 2 in their axes, and their directions in frame 1.

    They stand along the axes of the body at the end of a leg, not of the platform or the ground.
    """
    from1, from2 = rotation_constant(loop.rotation1).T, rotation_constant(loop.rotation2).T
    body2 = between.rotation @ from2
    free1 = loop.body1 in (0, tree.platform) or tree.joints[loop.body1 - 1].kind is JointKind.FLOATING
    if free1:
        return -(from1.T @ body2), ca.SX.eye(3), body2
    return -ca.SX.eye(3), body2.T @ from1, from1


def _row_wrenches(loop: LoopEnds, between: _Between) -> tuple[ca.SX, ca.SX]:
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
                force = between.translation / ca.norm_2(between.translation)
        columns.append((force, moment))
    to_body1 = -rotation_constant(loop.rotation1)
    to_body2 = rotation_constant(loop.rotation2) @ between.rotation.T
    both = [
        ca.horzcat(*(ca.vertcat(to_body @ force, to_body @ moment) for force, moment in columns))
        for to_body in (to_body1, to_body2)
    ]
    return both[0], both[1]


def _about_origin(wrenches: ca.SX, arm: ca.SX) -> Wrench:
    """Shift wrenches from a point to the body's origin."""
    forces = wrenches[:3, :]
    return forces, wrenches[3:, :] + moments_of(arm, forces)


def loop_bias(
    tree: Tree, at: Placements, drifting: Motions, columns: LoopColumns, q: ca.SX, v: ca.SX
) -> ca.SX:
    """Evaluate the rows' accelerations.

    Parameters
    ----------
    tree
        Constants.
    at
        Placements of the bodies, with closed loops.
    drifting
        Motions of the bodies without gravity; with zero joint accelerations the result is the bias.
    columns
        The rows, as they are turned.
    q, v
        (nq, 1) configuration and (nv, 1) velocity.

    Returns
    -------
    casadi.SX
        (nc, 1) second derivative of the turned rows' gap.
    """
    values = ca.SX(tree.nc, 1)
    for loop in tree.loops:
        values[list(loop.index)] = _row_accelerations(loop, _between(loop, at), at, drifting)
    for row in tree.couplings:
        if row.v2 >= 0:
            values[row.index] = -follower(row, q, 2) * v[row.v2] ** 2
    return columns.turn.T @ values


def _row_accelerations(loop: LoopEnds, between: _Between, at: Placements, moving: Motions) -> ca.SX:
    velocity1, omega1, acceleration1, alpha1 = _end_motion(loop.body1, loop.translation1, at, moving)
    velocity2, omega2, acceleration2, alpha2 = _end_motion(loop.body2, loop.translation2, at, moving)
    frame1 = (at.to_world[loop.body1] @ rotation_constant(loop.rotation1)).T
    reach = frame1.T @ between.translation
    drift, spin = velocity2 - velocity1, omega2 - omega1
    slide = drift - ca.cross(omega1, reach)
    # Time derivatives of the two relative velocities, with the turning of frame 1 taken out.
    slide_rate = (
        acceleration2
        - acceleration1
        - ca.cross(alpha1, reach)
        - ca.cross(omega1, drift)
        - ca.cross(omega1, slide)
    )
    spin_rate = alpha2 - alpha1 - ca.cross(omega1, spin)
    slide, slide_rate, spin, spin_rate = (frame1 @ x for x in (slide, slide_rate, spin, spin_rate))
    values = []
    for row in loop.rows:
        match row:
            case NormalRow():
                values.append(ca.dot(constant(row.normal), slide_rate))
            case AngleRow():
                turned = between.rotation @ constant(row.u2)
                second = ca.cross(spin_rate, turned) + ca.cross(spin, ca.cross(spin, turned))
                values.append(ca.dot(constant(row.u1), second))
            case LengthRow():
                distance = ca.norm_2(between.translation)
                along = between.translation / distance
                across = slide - along * ca.dot(along, slide)
                values.append(ca.dot(along, slide_rate) + ca.dot(across, across) / distance)
    return ca.vertcat(*values)


def _end_motion(
    body: int, offset: np.ndarray, at: Placements, moving: Motions
) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Velocity, angular velocity, acceleration and angular acceleration of a loop frame, in world axes."""
    arm = constant(offset)
    velocity = moving.velocity[body] + ca.cross(moving.omega[body], arm)
    acceleration = moving.acceleration[body] + moving.turning[body] @ arm
    to_world = at.to_world[body]
    return (
        to_world @ velocity,
        to_world @ moving.omega[body],
        to_world @ acceleration,
        to_world @ moving.omega_rate[body],
    )
