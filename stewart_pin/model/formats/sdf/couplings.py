"""Couplings of SDFormat: gearboxes, which turn two links against a third one, and axes that mimic another one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.model.description import Coupling, JointKind, Outcome
from stewart_pin.model.formats.sdf.elements import SdfReader
from stewart_pin.model.formats.sdf.frames import Scope
from stewart_pin.model.formats.sdf.joints import (
    GEARBOX,
    SdfJoint,
    axis_direction,
    ends,
    joint_frame,
    link_pose,
)
from stewart_pin.model.formats.sdf.words import WORDS
from stewart_pin.typing import FloatArray

_PARALLEL = 1e-6
"""How far the axes of a gearbox and of its joints may deviate [rad²/2]: they are printed with few digits."""
_ACROSS = 1e-3
"""Cosine below which they are at right angles: the same deviation."""


@dataclass(frozen=True, eq=False)
class Gearbox:
    """What a joint of type ``gearbox`` says.

    Attributes
    ----------
    name, owner
        Its name, and how messages call it.
    parent, child, body
        The two links that turn, and the one that they turn against.
    axis1, axis2
        (3,) directions about which the parent and the child turn, in the axes of the world, all joints at rest,
        dimensionless.
    ratio
        Turn of the child about its axis, backwards, per turn of the parent about its own, dimensionless.
    """

    name: str
    owner: str
    parent: str
    child: str
    body: str
    axis1: FloatArray
    axis2: FloatArray
    ratio: float


@dataclass(frozen=True, eq=False)
class _Wheel:
    """A turn of one link against another about an axis: a joint, and the sign with which it counts, 0 if across."""

    joint: SdfJoint
    sign: float


def mesh(
    gearbox: Gearbox, joints: Sequence[SdfJoint], pose_of: Callable[[str], pin.SE3], reader: SdfReader
) -> Coupling | None:
    """Let a gearbox couple the turns of two links against a third one; it holds nothing else.

    With θ1 the angle from the reference body to the parent about ``axis``, and θ2 that to the child about ``axis2``,
    θ2 = -ratio θ1. Links that fixed joints hold together turn as one.

    Parameters
    ----------
    gearbox
        The gearbox.
    joints
        Joints that have coordinates, and fixed ones.
    pose_of
        Placement of a link in the world, all joints at rest.
    reader
        Reader of the file, for notes and the error.

    Returns
    -------
    Coupling or None
        Of the gearbox's name, between two revolute joints; None where both turn at right angles to its axes, so that
        both angles are zero whatever the joints do.

    Raises
    ------
    FileFormatError
        If the two links do not turn against the reference body by one revolute joint each.
    """
    links = {"axis": (gearbox.parent, gearbox.axis1), "axis2": (gearbox.child, gearbox.axis2)}
    rigid = _held_together(joints)
    wheels = {
        tag: _wheel(joints, rigid, gearbox.body, link, axis, pose_of) for tag, (link, axis) in links.items()
    }
    across = {tag: wheel for tag, wheel in wheels.items() if wheel is not None and not wheel.sign}
    if len(across) == 2:
        names = " and ".join(f"'{wheel.joint.name}'" for wheel in across.values())
        reader.note(
            gearbox.owner,
            f"gearbox left out: joints {names} turn at right angles to its <axis> and <axis2>, so that it couples "
            "nothing, in Gazebo either; write the axes along those of the joints to couple them",
        )
        return None
    for tag, wheel in wheels.items():
        if wheel is None or not wheel.sign:
            turns = "" if wheel is None else f"; joint '{wheel.joint.name}' turns at right angles to it"
            raise reader.error(
                f"{gearbox.owner} is a gearbox between '{gearbox.parent}' and '{gearbox.child}' on '{gearbox.body}', "
                f"but no revolute joint about its <{tag}> joins '{gearbox.body}' and '{links[tag][0]}'{turns}; add "
                "that joint, or correct the axis",
                gearbox.owner,
            )
    first, second = (wheel for wheel in wheels.values() if wheel is not None)
    if first.joint is second.joint:
        raise reader.error(f"{gearbox.owner} couples joint '{first.joint.name}' to itself", gearbox.owner)
    reader.note(gearbox.owner, "gearbox: a coupling of two joints, which holds nothing else", Outcome.KEPT)
    factor = -gearbox.ratio * first.sign * second.sign
    constant = _reading(second.joint, 0) - factor * _reading(first.joint, 0)
    return Coupling(gearbox.name, second.joint.name, first.joint.name, (constant, factor))


def _held_together(joints: Sequence[SdfJoint]) -> Callable[[str], str]:
    """Give every link the name of one that stands for all that fixed joints hold together."""
    above: dict[str, str] = {}

    def head(link: str) -> str:
        while link in above:
            link = above[link]
        return link

    for joint in joints:
        ends_of = head(joint.parent), head(joint.child)
        if joint.kind is JointKind.FIXED and ends_of[0] != ends_of[1]:
            above[ends_of[1]] = ends_of[0]
    return head


def _wheel(
    joints: Sequence[SdfJoint],
    rigid: Callable[[str], str],
    body: str,
    link: str,
    axis: FloatArray,
    pose_of: Callable[[str], pin.SE3],
) -> _Wheel | None:
    found: _Wheel | None = None
    for joint in joints:
        if joint.kind is not JointKind.REVOLUTE or rigid(body) == rigid(link):
            continue
        if {rigid(joint.parent), rigid(joint.child)} != {rigid(body), rigid(link)}:
            continue
        own = pose_of(joint.parent).rotation @ joint.in_parent.rotation @ joint.axes[0].direction
        along = float(own @ axis)
        if 1 - abs(along) < _PARALLEL:
            outwards = 1.0 if rigid(joint.parent) == rigid(body) else -1.0
            return _Wheel(joint, outwards * float(np.sign(along)))
        if abs(along) < _ACROSS:
            found = _Wheel(joint, 0.0)
    return found


def read_gearbox(scope: Scope, element: etree._Element, joints: Sequence[SdfJoint]) -> Coupling | None:
    """Read a joint of type ``gearbox``.

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
    Coupling or None
        As `mesh` makes it.
    """
    reader = scope.reader
    name = scope.prefix + reader.name(element)
    owner = f"joint '{name}'"
    reader.note_strangers(element, owner, WORDS["joint of type gearbox"])
    for tag in ("axis", "axis2"):
        for axis in reader.children(element, tag):
            reader.note_strangers(axis, owner, WORDS["axis of a gearbox"])
    parent, child = ends(scope, element, owner)
    body = scope.body(reader.content(element, "gearbox_reference_body", owner), owner)
    placement, _ = joint_frame(scope, element, child, owner)
    axis1, axis2 = (
        placement.rotation @ axis_direction(scope, reader.child(element, tag, owner), placement, owner)
        for tag in ("axis", "axis2")
    )
    ratio = reader.number(element, "gearbox_ratio", owner, "1")
    gearbox = Gearbox(name, owner, parent, child, body, axis1, axis2, ratio)
    return mesh(gearbox, joints, lambda link: link_pose(scope, link), reader)


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
            # Between what both read, of which the file counts from rest.
            zeros = [_reading(joint, number), _reading(leader, at)]
            constant += zeros[0] - rule.multiplier * zeros[1]
            name = rule.name or f"{follower}_mimic"
            couplings.append(Coupling(name, follower, followed, (constant, rule.multiplier)))
    return couplings


def _reading(joint: SdfJoint, number: int) -> float:
    return float(joint.readings[number]) if len(joint.readings) > number else 0.0


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
