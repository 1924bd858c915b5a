"""Kinematics in platform coordinates: motor positions of a pose, the motor Jacobian, and the equations back.

Where the motors set lengths of legs, the equations back are those of squared lengths. Of a whole tree the platform
frame is placed and moved here too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.graph.bodies import (
    at_rest,
    efforts_of_wrenches,
    moments_of,
    motions,
    turned_by_small,
)
from stewart_pin.kernels.graph.legs import PlacedLeg
from stewart_pin.kernels.graph.newton_steps import NewtonEquations, any_direction
from stewart_pin.kernels.graph.platform_dynamics import PlacedPlatform, motor_columns
from stewart_pin.kernels.graph.whole_tree import ClosedTree
from stewart_pin.kernels.planning.elimination import eliminate_square
from stewart_pin.kernels.planning.spatial import constant, rotation_constant, shared, turn_from_quaternion
from stewart_pin.model.description import JointKind
from stewart_pin.typing import FloatArray


def motor_position_expressions(placed: PlacedPlatform) -> ca.SX:
    """Express the motor positions by the pose.

    Parameters
    ----------
    placed
        Platform and legs.

    Returns
    -------
    casadi.SX
        (nu, 1) [m or rad], angles within half a turn of home.

    Raises
    ------
    UnsupportedError
        If a motor drives a joint whose position does not follow from the pose.
    """
    q_home, found = placed.plan.chain.q_home[list(placed.plan.tree.motors_q)], []
    for home, value in zip(q_home, _motor_values(placed), strict=True):
        if isinstance(value, tuple):
            value = float(home) + ca.atan2(*_turned_back(value, np.cos(home), np.sin(home)))
        found.append(value)
    return ca.vertcat(*found)


def _motor_values(placed: PlacedPlatform) -> list[ca.SX | tuple[ca.SX, ca.SX]]:
    """Positions of the motors, of those that turn as cosine and sine."""
    found: dict[int, ca.SX | tuple[ca.SX, ca.SX]] = {}
    for leg in placed.legs:
        for motor, entry in leg.leg.motors:
            k = next(k for k, joint in enumerate(leg.leg.joints) if joint.v.start == entry)
            joint = leg.leg.joints[k]
            if k not in leg.positions.values:
                raise UnsupportedError(f"the position of motor '{joint.name}' does not follow from the pose")
            value = leg.positions.values[k]
            found[motor] = (value[0], value[1]) if joint.kind is JointKind.REVOLUTE else value
    return [found[k] for k in range(len(placed.plan.tree.motors))]


def _turned_back(angle: tuple[ca.SX, ca.SX], cosine: Any, sine: Any) -> tuple[ca.SX, ca.SX]:
    """Sine and cosine of an angle less another."""
    return angle[1] * cosine - angle[0] * sine, angle[0] * cosine + angle[1] * sine


def inverse_kinematics_function(placed: PlacedPlatform) -> ca.Function:
    """Write inverse kinematics.

    Parameters
    ----------
    placed
        Platform and legs.

    Returns
    -------
    casadi.Function
        ``pose -> q_motor``, (7, 1) to (nu, 1).
    """
    q_motor = motor_position_expressions(placed)
    return shared("inverse_kinematics", {"pose": placed.pose}, {"q_motor": q_motor, **placed.infeasible()})


def motor_jacobian_function(placed: PlacedPlatform) -> ca.Function:
    """Write the motor Jacobian.

    Parameters
    ----------
    placed
        Platform and legs.

    Returns
    -------
    casadi.Function
        ``pose -> jacobian``, (7, 1) to (nu, 6): motor rates per twist in world axes. For a platform with fewer than
        six freedoms it holds for the twists that it can do.
    """
    return shared(
        "motor_jacobian", {"pose": placed.pose}, {"jacobian": motor_columns(placed).T, **placed.infeasible()}
    )


def pose_equations(placed: PlacedPlatform) -> NewtonEquations:
    """Write the equations of forward kinematics.

    Parameters
    ----------
    placed
        Platform and legs.

    Returns
    -------
    NewtonEquations
        Of the pose, (7, 1), and the motor positions, (nu, 1). Angles count modulo a turn; what the pose asks of the
        platform that it cannot do counts as well. Redundant motors are met by least squares.
    """
    tree, twists = placed.plan.tree, placed.plan.twists
    q_motor = ca.SX.sym("q_motor", len(tree.motors))
    gap, rows, size, beside = squared_lengths(placed, q_motor) or _positions(placed, q_motor)
    jacobian = rows @ constant(twists)
    weighted = None
    matrix, values = jacobian, placed.values(jacobian) / size[:, None] * placed.twist_scale
    if twists.shape[1] != len(tree.motors):
        weighted = jacobian.T @ constant(np.diag(size**-2.0))
        matrix, scale = weighted @ jacobian, placed.twist_scale
        values = placed.values(matrix) * scale[:, None] * scale
    reduced = eliminate_square(matrix, values, "the pose")

    def close(gap: ca.SX) -> ca.SX:
        return constant(twists) @ reduced.solve(gap if weighted is None else weighted @ gap)

    beside = [*beside, *placed.infeasible().values()]
    natural = np.repeat([placed.plan.chain.length_scale, 1.0], 3)
    return NewtonEquations(
        state=placed.pose,
        target=q_motor,
        gap=gap,
        size=ca.sum1(ca.fabs(ca.vertcat(gap / constant(size), *beside))),
        close=close,
        move=_moved,
        sizes=natural,
        determinant=reduced.determinant(placed.usual),
        direction=any_direction(natural, twists / natural[:, None] * placed.twist_scale),
    )


def _positions(placed: PlacedPlatform, q_motor: ca.SX) -> MotorEquations:
    gap = ca.vertcat(*(_short_of(q_motor[k], value) for k, value in enumerate(_motor_values(placed))))
    size = placed.plan.chain.tangent_scale[list(placed.plan.tree.motors)]
    return MotorEquations(gap, motor_columns(placed).T, size, ())


def _moved(pose: ca.SX, step: ca.SX) -> ca.SX:
    return ca.vertcat(pose[:3] + step[:3], turned_by_small(pose[3:], step[3:]))


def _short_of(target: ca.SX, value: ca.SX | tuple[ca.SX, ca.SX]) -> ca.SX:
    """How far a motor is from its target, to the second order."""
    if not isinstance(value, tuple):
        return target - value
    sine, cosine = _turned_back(value, ca.cos(target), ca.sin(target))
    # 2 sin(angle / 2), which sees half a turn, where the sine alone is zero; an arctangent would cost more.
    far = cosine < 0
    size = ca.sqrt(ca.if_else(far, 2 * (1 - cosine), 2 / (1 + cosine)))
    return -ca.if_else(far, ca.copysign(1, sine), sine) * size


# ----------------------------------------------------------------------------------------------------
# Equations between a pose and the lengths of legs, squared: without the root and the division of each length
# ----------------------------------------------------------------------------------------------------


class MotorEquations(NamedTuple):
    """Equations between a pose and motor positions.

    Attributes
    ----------
    gap
        (nu, 1) CasADi expressions, zero at the pose.
    rows
        (nu, 6) how what the gap is short of grows with a twist in world axes.
    size
        (nu,) natural size of each gap [m² or rad].
    beside
        (1, 1) expressions that are zero as well where there is a pose.
    """

    gap: ca.SX
    rows: ca.SX
    size: FloatArray
    beside: Sequence[ca.SX]


def squared_lengths(placed: PlacedPlatform, q_motor: ca.SX) -> MotorEquations | None:
    """Write the equations of legs that are as long as two points are apart, if all motors are of that kind.

    With d from the point on the ground to that of the platform and r from the origin of the platform frame to the
    latter, ``gap = (length² - d·d) / 2`` and the row of a leg is ``[d; r × d]``.

    Parameters
    ----------
    placed
        Platform and legs.
    q_motor
        (nu, 1) symbols of the motor positions.

    Returns
    -------
    MotorEquations or None
        The equations; a length below zero is no length.
    """
    count = len(placed.plan.tree.motors)
    found = {motor: (leg, slide) for leg in placed.legs for motor, slide in _lengths(leg)}
    if len(found) < count:
        return None
    size = placed.plan.chain.tangent_scale[list(placed.plan.tree.motors)]
    turn, position = turn_from_quaternion(placed.pose[3:]), placed.pose[:3]
    gaps, rows, sizes, beside = [], [], [], []
    for motor in range(count):
        leg, slide = found[motor]
        reach = leg.positions.reaches[slide]
        ends = (reach.end, reach.root) if leg.leg.on_platform else (reach.root, reach.end)
        arm = turn @ constant(ends[1])
        apart = position - constant(ends[0]) + arm
        length = reach.sign * q_motor[motor] + reach.offset
        gaps.append((length * length - ca.dot(apart, apart)) / 2)
        rows.append(ca.horzcat(apart.T, ca.cross(arm, apart).T))
        sizes.append(size[motor] * (reach.sign * float(leg.leg.home[slide][0]) + reach.offset))
        beside.append(ca.fabs(length) - length)
    return MotorEquations(ca.vertcat(*gaps), ca.vertcat(*rows), np.array(sizes), beside)


def _lengths(leg: PlacedLeg) -> list[tuple[int, int]]:
    """Motors of a leg that change such a length, and the joint of each."""
    joints = {joint.v.start: k for k, joint in enumerate(leg.leg.joints)}
    entries = [(motor, joints.get(entry)) for motor, entry in leg.leg.motors]
    return [(motor, k) for motor, k in entries if k is not None and k in leg.positions.reaches]


# ----------------------------------------------------------------------------------------------------
# The platform frame of the whole tree: where it is, how joint motions move it, and its bias
# ----------------------------------------------------------------------------------------------------


def platform_columns(closed: ClosedTree) -> ca.SX:
    """Build the transpose of the platform's Jacobian.

    Parameters
    ----------
    closed
        The chain.

    Returns
    -------
    casadi.SX
        (nv, 6): unit forces and unit moments at the platform frame's origin along world axes, as joint efforts.
    """
    tree, at = closed.tree, closed.at
    back = at.to_world[tree.platform].T
    arm = constant(tree.platform_translation)
    force = ca.horzcat(back, ca.SX(3, 3))
    moment = ca.horzcat(moments_of(arm, back), back)
    return efforts_of_wrenches(tree.joints, at, {tree.platform: (force, moment)}, 6)


def platform_bias(closed: ClosedTree, v: ca.SX) -> ca.SX:
    """Write the platform's acceleration that is there without joint acceleration.

    Parameters
    ----------
    closed
        The chain.
    v
        (nv, 1) tangent velocity.

    Returns
    -------
    casadi.SX
        (6, 1) of the platform frame's origin and axes, in world axes.
    """
    tree, at = closed.tree, closed.at
    drifting = motions(tree.joints, at, v, ca.SX.zeros(tree.nv), at_rest(ca.SX.zeros(3)))
    k, to_world = tree.platform, at.to_world[tree.platform]
    linear = drifting.acceleration[k] + drifting.turning[k] @ constant(tree.platform_translation)
    return ca.vertcat(to_world @ linear, to_world @ drifting.omega_rate[k])


def platform_placement(closed: ClosedTree) -> tuple[ca.SX, ca.SX]:
    """Write where the platform frame is.

    Parameters
    ----------
    closed
        The chain.

    Returns
    -------
    position, rotation : casadi.SX
        (3, 1) and (3, 3), in the world.
    """
    tree, at = closed.tree, closed.at
    to_world = at.to_world[tree.platform]
    position = at.in_world[tree.platform] + to_world @ constant(tree.platform_translation)
    return position, to_world @ rotation_constant(tree.platform_rotation)


def platform_pose_function(closed: ClosedTree) -> ca.Function:
    """Write the pose of the platform frame.

    Parameters
    ----------
    closed
        The chain.

    Returns
    -------
    casadi.Function
        ``q -> (position, rotation)``, (nq, 1) to (3, 1) [m] and (3, 3).
    """
    position, rotation = platform_placement(closed)
    return shared("platform_pose", {"q": closed.q}, {"position": position, "rotation": rotation})
