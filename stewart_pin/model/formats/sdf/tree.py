"""From the joints of an SDFormat model to a spanning tree with loops.

Links keep their SDFormat frames. The description wants a joint's frame to be that of its child link; where the two
differ in a way that matters, a link without inertia, ``<child>_at_<joint>``, stands in the joint's frame, and the
child is fixed to it. Links without a parent float, unless their model is static.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin

from stewart_pin.errors import FileFormatError, MechanismError
from stewart_pin.model.description import Bounds, Coupling, Joint, JointKind, Link, Loop, Note, Outcome
from stewart_pin.model.formats.sdf.frames import WORLD
from stewart_pin.model.formats.sdf.joints import Axis, SdfJoint
from stewart_pin.model.spanning_tree import cut_second_parents
from stewart_pin.model.unfolding import Unfolded, unfold_planar, unfold_screw, unfold_universal
from stewart_pin.typing import FloatArray

_SAME_PLACE = 1e-14
"""Distance, in sizes of the robot, and entry of a rotation below which two frames are one."""
_PERPENDICULAR = 1e-9
"""Cosine of the angle between the axes of a universal joint that closes a loop."""


@dataclass(eq=False)
class SdfTree:
    """Parts of the mechanism.

    Attributes
    ----------
    links
        New links without inertia, beside those of the file.
    joints, loops, couplings
        The spanning tree, what closes it, and threads of screws.
    home
        Poses of the floating links [m, unit quaternions].
    notes
        What was changed.
    """

    links: list[Link] = field(default_factory=list)
    joints: list[Joint] = field(default_factory=list)
    loops: list[Loop] = field(default_factory=list)
    couplings: list[Coupling] = field(default_factory=list)
    home: dict[str, FloatArray] = field(default_factory=dict)
    notes: list[Note] = field(default_factory=list)


def grow_tree(
    joints: Sequence[SdfJoint],
    poses: Mapping[str, pin.SE3],
    *,
    fixed: Collection[str],
    based: Collection[str],
    needed: Collection[str],
    motors: Collection[str],
    source: str,
) -> SdfTree:
    """Hang every link on one joint, and close loops by the others.

    Parameters
    ----------
    joints
        Joints of the file.
    poses
        Placement of every link in the world while all joints are at zero, in the order of the file.
    fixed
        Links of static models.
    based
        Links that the file wants to float, whatever joins them.
    needed
        Joints whose positions couplings use.
    motors
        Joints that a motor drives.
    source
        The file, for messages.

    Returns
    -------
    SdfTree
        Parts of the mechanism.

    Raises
    ------
    FileFormatError
        If a joint has to close a loop and cannot.
    """
    tree = SdfTree()
    size = max((float(np.linalg.norm(pose.translation)) for pose in poses.values()), default=1.0)
    marked = [joint for joint in joints if joint.must_close]
    hanging = [joint for joint in joints if not joint.must_close]
    grounded = _ground(hanging, poses, fixed, based)
    tree.joints += grounded
    tree.home = {
        joint.name: np.array(pin.SE3ToXYZQUAT(poses[joint.child]))
        for joint in grounded
        if joint.kind is JointKind.FLOATING
    }
    names = {joint.name for joint in joints}
    for joint in grounded:
        if joint.name in names:
            raise FileFormatError(
                f"joint '{joint.name}' has the name of the joint that holds a link in the world; rename it",
                path=source,
                culprit=joint.name,
            )
    kept = _cut(tree, grounded, hanging, {*needed, *motors}, source)
    for joint in joints:
        if joint.name in kept:
            _hang(tree, joint, size * _SAME_PLACE, joint.name in motors)
        else:
            tree.loops.append(_close(joint, source))
    for joint in marked:
        text = "<must_be_loop_joint>: closes a loop"
        tree.notes.append(Note(f"joint '{joint.name}'", text, Outcome.CHANGED))
    return tree


def _ground(
    joints: Sequence[SdfJoint],
    poses: Mapping[str, pin.SE3],
    fixed: Collection[str],
    based: Collection[str],
) -> list[Joint]:
    """Join links to the world: fixed, or floating where nothing else leads to them."""
    one = pin.SE3.Identity()
    below: dict[str, list[str]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint.child)
    children = {joint.child for joint in joints}
    reached: set[str] = set()

    def reach(link: str) -> None:
        waiting = [link]
        while waiting:
            at = waiting.pop()
            if at not in reached:
                reached.add(at)
                waiting += below.get(at, ())

    reach(WORLD)
    held: list[Joint] = []
    for link in poses:
        if link in fixed:
            held.append(Joint(f"{link}_static", JointKind.FIXED, WORLD, link, poses[link]))
            reach(link)
    # First the links that are nobody's child, then, of links that only hang on each other, the first of the file.
    for floats in (
        [link for link in poses if link in based or link not in children],
        list(poses),
    ):
        for link in floats:
            if link not in reached or (link in based and link not in fixed):
                held.append(Joint(f"{link}_floating", JointKind.FLOATING, WORLD, link, one))
                reach(link)
        based = ()
    return held


def _cut(
    tree: SdfTree,
    grounded: Sequence[Joint],
    hanging: Sequence[SdfJoint],
    needed: Collection[str],
    source: str,
) -> set[str]:
    """Choose the joints of the tree; those that must keep their coordinate pass for motors."""
    cut_last = [
        Joint(
            joint.name,
            joint.kind,
            joint.parent,
            joint.child,
            joint.in_parent,
            independent=joint.name in needed or joint.lead != 0.0 or _leans(joint),
        )
        for joint in hanging
    ]
    try:
        kept, _, notes = cut_second_parents([*grounded, *cut_last], source=source)
    except MechanismError as error:
        raise FileFormatError(
            f"link '{next(joint.child for joint in hanging if joint.name == error.culprit)}' has several parents, and "
            f"joint '{error.culprit}' cannot close a loop: it is a screw, has axes that are not at right angles, is a "
            "motor, or a gearbox or <mimic> needs its position; mark another joint of the loop with "
            "<physics><simbody><must_be_loop_joint>true</must_be_loop_joint></simbody></physics>",
            path=source,
            culprit=error.culprit,
        ) from None
    tree.notes += notes
    return {joint.name for joint in kept}


def _leans(joint: SdfJoint) -> bool:
    """Tell whether a joint of two axes does not have them at right angles: no loop of ours."""
    if joint.kind is not JointKind.UNIVERSAL:
        return False
    first, second = joint.axes
    return abs(float(first.direction @ second.direction)) > _PERPENDICULAR


def _close(joint: SdfJoint, source: str) -> Loop:
    if joint.lead != 0.0 or _leans(joint):
        raise FileFormatError(
            f"joint '{joint.name}' of type '{joint.written}' cannot close a loop; take its <must_be_loop_joint> off, "
            "and mark another joint of the loop",
            path=source,
            culprit=joint.name,
        )
    loop = Loop(joint.name, joint.kind, joint.parent, joint.child, joint.in_parent, joint.in_child)
    match joint.axes:
        case [only]:
            return replace(loop, axis=only.direction, bounds=_bounds(only))
        case [first, second]:
            return replace(
                loop, axis=first.direction, axis2=second.direction, bounds=_bounds(first) + _bounds(second)
            )
    return loop


def _hang(tree: SdfTree, joint: SdfJoint, near: float, is_motor: bool) -> None:
    """Hang the child link on a joint of the tree."""
    in_child, child = joint.in_child, joint.child
    same_turn = bool(np.abs(in_child.rotation - np.eye(3)).max() <= _SAME_PLACE)
    axes = [axis.direction for axis in joint.axes]
    lever = in_child.translation
    if joint.kind in (JointKind.REVOLUTE, JointKind.PRISMATIC):
        # Along its own axis a hinge may be moved, and a slide anywhere; turned, it has another axis only.
        axis = axes[0] if same_turn else in_child.rotation @ axes[0]
        same = (
            joint.kind is JointKind.PRISMATIC or float(np.linalg.norm(lever - axis * (axis @ lever))) <= near
        )
        axes = [axis] if same else axes
    else:
        same = joint.kind is JointKind.FIXED or (same_turn and float(np.linalg.norm(lever)) <= near)
    placement = joint.in_parent
    if same:
        placement = placement * in_child.inverse()
    else:
        child = f"{joint.child}_at_{joint.name}"
        tree.links.append(Link(child))
        fixed = Joint(f"{child}_fixed", JointKind.FIXED, child, joint.child, in_child.inverse())
        tree.joints.append(fixed)
    if len(axes) <= 1 and not joint.lead and joint.kind is not JointKind.PLANAR:
        made = Joint(joint.name, joint.kind, joint.parent, child, placement, independent=is_motor)
        if axes:
            made = _limited(replace(made, axis=axes[0]), joint.axes[0])
        tree.joints.append(made)
        return
    row = _row(joint, child, placement, axes)
    parts = list(row.joints)
    for number, axis in enumerate(joint.axes):
        if joint.kind is not JointKind.PLANAR:
            parts[number] = replace(_limited(parts[number], axis), independent=is_motor)
    tree.links += row.links
    tree.joints += parts
    tree.couplings += row.couplings
    tree.notes.append(replace(row.note, text=row.note.text.replace("universal", joint.written)))


def _row(joint: SdfJoint, child: str, placement: pin.SE3, axes: list[FloatArray]) -> Unfolded:
    if joint.lead:
        return unfold_screw(joint.name, joint.parent, child, placement, axes[0], joint.lead)
    if joint.kind is JointKind.PLANAR:
        return unfold_planar(joint.name, joint.parent, child, placement, axes[0])
    return unfold_universal(joint.name, joint.parent, child, placement, axes[0], axes[1])


def _bounds(axis: Axis) -> tuple[Bounds]:
    """Gather the limits of a joint that closes a loop: its coordinate is zero where the model is placed."""
    return (
        Bounds(
            position=(axis.lower, axis.upper),
            velocity=(-axis.velocity, axis.velocity),
            acceleration=(-axis.acceleration, axis.acceleration),
        ),
    )


def _limited(joint: Joint, axis: Axis) -> Joint:
    effort = np.inf if axis.effort is None else axis.effort
    return replace(
        joint,
        lower=axis.lower,
        upper=axis.upper,
        effort=effort,
        velocity=axis.velocity,
        acceleration=axis.acceleration,
    )
