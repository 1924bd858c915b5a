"""Couplings of SDFormat: gearboxes, and axes that mimic another one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from lxml import etree

from stewart_pin.model.description import Coupling, JointKind, Outcome
from stewart_pin.model.formats.sdf.frames import Scope
from stewart_pin.model.formats.sdf.joints import (
    GEARBOX,
    SdfJoint,
    axis_direction,
    ends,
    joint_frame,
    link_pose,
)
from stewart_pin.typing import FloatArray

_PARALLEL = 1e-6
"""How far the axes of a gearbox and of its joints may deviate [rad²/2]: they are printed with few digits."""


@dataclass(frozen=True, eq=False)
class _Wheel:
    """A turn of one link against another about an axis: a joint, and the sign with which it counts."""

    joint: SdfJoint
    sign: float


def read_gearbox(scope: Scope, element: etree._Element, joints: Sequence[SdfJoint]) -> Coupling:
    """Read a joint of type ``gearbox``: it couples the turns of two links against a third one, and holds nothing else.

    With θ1 the angle from the reference body to the parent about ``axis``, and θ2 that to the child about ``axis2``,
    θ2 = -ratio θ1.

    Parameters
    ----------
    scope
        Model that holds it.
    element
        The joint.
    joints
        All other joints of the file.

    Returns
    -------
    Coupling
        Of the gearbox's name, between two revolute joints.

    Raises
    ------
    FileFormatError
        If the two links do not turn against the reference body by one revolute joint each.
    """
    reader = scope.reader
    name = scope.prefix + reader.name(element)
    owner = f"joint '{name}'"
    parent, child = ends(scope, element, owner)
    body = scope.body(reader.content(element, "gearbox_reference_body", owner), owner)
    ratio = reader.number(element, "gearbox_ratio", owner, "1")
    placement, _ = joint_frame(scope, element, child, owner)
    wheels: list[_Wheel] = []
    for tag, link in (("axis", parent), ("axis2", child)):
        axis = axis_direction(scope, reader.child(element, tag, owner), placement, owner)
        wheel = _wheel(scope, joints, body, link, placement.rotation @ axis)
        if wheel is None:
            raise reader.error(
                f"{owner} (line {element.sourceline}) is a gearbox between '{parent}' and '{child}' on '{body}', but "
                f"no revolute joint about its <{tag}> joins '{body}' and '{link}'; add that joint",
                owner,
            )
        wheels.append(wheel)
    first, second = wheels
    if first.joint is second.joint:
        raise reader.error(f"{owner} couples joint '{first.joint.name}' to itself", owner)
    reader.note(
        owner,
        "gearbox: a coupling of two joints, which holds nothing else",
        Outcome.KEPT,
    )
    factor = -ratio * first.sign * second.sign
    return Coupling(name, second.joint.name, first.joint.name, (0.0, factor))


def is_gearbox(element: etree._Element) -> bool:
    """Tell whether a joint is a gearbox.

    Parameters
    ----------
    element
        The joint.

    Returns
    -------
    bool
        Whether it couples two other joints.
    """
    return element.get("type", "").lower() == GEARBOX


def read_mimics(scope: Scope, joints: Sequence[SdfJoint]) -> list[Coupling]:
    """Make couplings of the axes that follow others.

    Parameters
    ----------
    scope
        The outermost model, for errors.
    joints
        All joints of the file.

    Returns
    -------
    list of Coupling
        One per axis that follows.

    Raises
    ------
    FileFormatError
        If an axis follows one that is missing, or itself.
    """
    named = {joint.name: joint for joint in joints}
    couplings: list[Coupling] = []
    for joint in joints:
        for number, axis in enumerate(joint.axes):
            if axis.follow is None:
                continue
            rule, owner = axis.follow, f"joint '{joint.name}'"
            leader = named.get(rule.leader)
            at = 1 if rule.leader_axis == "axis2" else 0
            if leader is None or at >= len(leader.axes):
                raise scope.reader.error(
                    f"{owner} mimics the {rule.leader_axis} of joint '{rule.leader}', which does not exist; it may "
                    f"follow: {', '.join(other.name for other in joints if other.axes and other is not joint)}",
                    owner,
                )
            follower, followed = coordinate(joint, number), coordinate(leader, at)
            if follower == followed:
                raise scope.reader.error(f"{owner} mimics itself; name another joint", owner)
            scope.reader.note(owner, "<mimic>: a coupling", Outcome.KEPT)
            constant = rule.offset - rule.multiplier * rule.reference
            couplings.append(Coupling(f"{follower}_mimic", follower, followed, (constant, rule.multiplier)))
    return couplings


def coordinate(joint: SdfJoint, number: int) -> str:
    """Name the one-freedom joint that stands for an axis.

    Parameters
    ----------
    joint
        Joint of the file.
    number
        0 for its ``axis``, 1 for its ``axis2``.

    Returns
    -------
    str
        The joint's own name, or one of the parts of a joint with two axes.
    """
    return joint.name if len(joint.axes) == 1 else f"{joint.name}_{number + 1}"


def _wheel(scope: Scope, joints: Sequence[SdfJoint], body: str, link: str, axis: FloatArray) -> _Wheel | None:
    for joint in joints:
        if joint.kind is not JointKind.REVOLUTE or {joint.parent, joint.child} != {body, link}:
            continue
        own = link_pose(scope, joint.parent).rotation @ joint.in_parent.rotation @ joint.axes[0].direction
        along = float(own @ axis)
        if 1 - abs(along) < _PARALLEL:
            outwards = 1.0 if joint.parent == body else -1.0
            return _Wheel(joint, outwards * float(np.sign(along)))
    return None
