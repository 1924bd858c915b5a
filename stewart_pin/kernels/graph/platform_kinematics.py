"""Kinematics in platform coordinates: motor positions of a pose, the motor Jacobian, and a Newton step back."""

from __future__ import annotations

import casadi as ca
import numpy as np

from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.elimination import solve_square
from stewart_pin.kernels.graph.functions import shared
from stewart_pin.kernels.graph.platform_dynamics import PlacedPlatform, motor_columns
from stewart_pin.kernels.graph.quaternions import turned_by_small
from stewart_pin.kernels.spatial import constant
from stewart_pin.model.description import JointKind


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
    found: dict[int, ca.SX] = {}
    for leg in placed.legs:
        for motor, entry in leg.leg.motors:
            k = next(k for k, joint in enumerate(leg.leg.joints) if joint.v.start == entry)
            joint = leg.leg.joints[k]
            if k not in leg.positions.values:
                raise UnsupportedError(f"the position of motor '{joint.name}' does not follow from the pose")
            value = leg.positions.values[k]
            if joint.kind is JointKind.REVOLUTE:
                home = float(leg.leg.home[k][0])
                cosine, sine = np.cos(home), np.sin(home)
                off = value[1] * cosine - value[0] * sine, value[0] * cosine + value[1] * sine
                value = home + ca.atan2(*off)
            found[motor] = value
    return ca.vertcat(*(found[k] for k in range(len(placed.plan.tree.motors))))


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


def newton_step_function(placed: PlacedPlatform) -> ca.Function:
    """Write one step of forward kinematics.

    Parameters
    ----------
    placed
        Platform and legs.

    Returns
    -------
    casadi.Function
        ``(pose, q_motor, share) -> (pose_next, gap)``, (7, 1), (nu, 1), (1, 1) to (7, 1), (nu, 1); the gap is that of
        the pose before the step, in sizes of the motors, angles modulo a turn, and below it what the pose asks of the
        platform that it cannot do. Redundant motors are met by least
        squares.
    """
    tree, twists = placed.plan.tree, placed.plan.twists
    share = ca.SX.sym("share")
    q_motor = ca.SX.sym("q_motor", len(tree.motors))
    gap = q_motor - motor_position_expressions(placed)
    turns = _turns(placed)
    gap = ca.vertcat(*(_wrapped(gap[k]) if turn else gap[k] for k, turn in enumerate(turns)))
    size = placed.plan.chain.tangent_scale[list(tree.motors)]
    jacobian = motor_columns(placed).T @ constant(twists)
    matrix, right = jacobian, gap
    values = placed.values(jacobian) / size[:, None] * placed.twist_scale
    if twists.shape[1] != len(tree.motors):
        weighted = jacobian.T @ constant(np.diag(size**-2.0))
        matrix, right = weighted @ jacobian, weighted @ gap
        scale = placed.twist_scale
        values = placed.values(matrix) * scale[:, None] * scale
    step = share * constant(twists) @ solve_square(matrix, right, values, "the pose")[0]
    pose_next = ca.vertcat(placed.pose[:3] + step[:3], turned_by_small(placed.pose[3:], step[3:]))
    beside = placed.infeasible().values()
    return shared(
        "forward_kinematics_step",
        {"pose": placed.pose, "q_motor": q_motor, "share": share},
        {"pose_next": pose_next, "gap": ca.sum1(ca.fabs(ca.vertcat(gap / constant(size), *beside)))},
    )


def _turns(placed: PlacedPlatform) -> list[bool]:
    """Whether each motor turns."""
    joints = {joint.v.start: joint for joint in placed.plan.tree.joints}
    return [joints[index].kind is JointKind.REVOLUTE for index in placed.plan.tree.motors]


def _wrapped(angle: ca.SX) -> ca.SX:
    return ca.atan2(ca.sin(angle), ca.cos(angle))
