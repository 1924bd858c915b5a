"""Equations between a pose and the lengths of legs, squared: without the root and the division of each length."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from stewart_pin.kernels.graph.legs import PlacedLeg
from stewart_pin.kernels.graph.platform_dynamics import PlacedPlatform
from stewart_pin.kernels.planning.spatial import constant, turn_from_quaternion
from stewart_pin.typing import FloatArray


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
