"""From the joints of an SDFormat model to a spanning tree with loops and couplings.

Links keep their SDFormat frames. The description wants a joint's frame to be that of its child link; where the two
differ in a way that matters, a link without inertia, ``<child>_at_<joint>``, stands in the joint's frame, and the
child is fixed to it. Links without a parent float, unless their model is static.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from stewart_pin.errors import FileFormatError, MechanismError
from stewart_pin.model.description import (
    Bounds,
    Coupling,
    Joint,
    JointKind,
    Link,
    Loop,
    Note,
    Outcome,
    Span,
    loop_coordinates,
    physics_coordinates,
)
from stewart_pin.model.formats.precision import printed_precision
from stewart_pin.model.formats.sdf.coordinates import counted_from
from stewart_pin.model.formats.sdf.frames import WORLD, motion
from stewart_pin.model.formats.sdf.joints import Axis, SdfJoint
from stewart_pin.model.joint_physics import NO_PHYSICS, JointPhysics
from stewart_pin.model.unfolding import (
    Unfolded,
    close_by_screw,
    cut_second_parents,
    unfold_cylindrical,
    unfold_planar,
    unfold_screw,
    unfold_universal,
)
from stewart_pin.tolerances import PRINTED
from stewart_pin.typing import FloatArray

SAME_PLACE = 1e-14
"""Distance, in sizes of the robot, and entry of a rotation below which two frames are one."""


@dataclass(frozen=True, eq=False)
class Float:
    """The joint by which a link floats.

    Attributes
    ----------
    joint
        Its name.
    placement
        Its frame in the world.
    physics
        What its six coordinates do by themselves.
    """

    joint: str
    placement: pin.SE3 = field(default_factory=pin.SE3.Identity)
    physics: JointPhysics = NO_PHYSICS


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
    floats: Mapping[str, Float] | None = None,
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
    floats
        What the file says of the joints by which links float.

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
    grounded = _ground(hanging, poses, fixed, based, floats or {})
    tree.joints += grounded
    tree.home = {
        joint.name: np.array(pin.SE3ToXYZQUAT(joint.placement.actInv(poses[joint.child])))
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
            hang(tree, joint, size * SAME_PLACE, joint.name in motors)
        else:
            close(tree, joint, source, is_motor=joint.name in motors)
    for joint in marked:
        text = "<must_be_loop_joint>: closes a loop"
        tree.notes.append(Note(f"joint '{joint.name}'", text, Outcome.CHANGED))
    return tree


def _ground(
    joints: Sequence[SdfJoint],
    poses: Mapping[str, pin.SE3],
    fixed: Collection[str],
    based: Collection[str],
    told: Mapping[str, Float],
) -> list[Joint]:
    """Join links to the world: fixed, or floating where nothing else leads to them."""
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
                float_ = told.get(link, Float(f"{link}_floating"))
                made = Joint(float_.joint, JointKind.FLOATING, WORLD, link, float_.placement)
                held.append(replace(made, physics=float_.physics))
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
    """Choose the joints of the tree; those that must keep their coordinate pass for motors, screws where they can."""
    screws = {joint.name for joint in hanging if joint.lead}
    cut_last = {
        joint.name: Joint(
            joint.name,
            joint.kind,
            joint.parent,
            joint.child,
            joint.in_parent,
            independent=joint.name in needed or joint.name in screws or _leans(joint, source),
            physics=JointPhysics(armature=_armature(joint)),
        )
        for joint in hanging
    }
    while True:
        try:
            kept, _, notes = cut_second_parents([*grounded, *cut_last.values()], source=source)
            break
        except MechanismError as error:
            # A screw keeps its turn where it closes a loop, but two joints more stand for it than in the tree.
            if error.culprit in screws and cut_last[error.culprit].independent:
                cut_last[error.culprit] = replace(cut_last[error.culprit], independent=False)
                continue
            raise FileFormatError(
                f"link '{cut_last[error.culprit].child}' has several parents, and joint '{error.culprit}' cannot close "
                "a loop: it has axes that are not at right angles, is a motor, or a gearbox or <mimic> needs its "
                "position; mark another joint of the loop with "
                "<physics><simbody><must_be_loop_joint>true</must_be_loop_joint></simbody></physics>",
                path=source,
                culprit=error.culprit,
            ) from None
    tree.notes += notes
    return {joint.name for joint in kept}


def _armature(joint: SdfJoint) -> float:
    """Largest rotor of its coordinates: none of a joint that closes a loop."""
    every = [*(axis.physics for axis in joint.axes), *joint.own_physics.values()]
    return max((physics.armature for physics in every), default=0.0)


_LEANING = 4.0
"""Roundings of a file that add up between two axes: three entries of either, and their frames."""


def _leans(joint: SdfJoint, source: str) -> bool:
    """Tell whether a joint of two axes does not have them at right angles, but for digits: no loop of ours."""
    if joint.kind is not JointKind.UNIVERSAL:
        return False
    first, second = joint.axes
    lean = abs(float(first.direction @ second.direction))
    return lean > PRINTED and lean > _LEANING * printed_precision(Path(source)).angle


def close(tree: SdfTree, joint: SdfJoint, source: str, *, is_motor: bool = False) -> None:
    """Close a loop by a joint; a screw stays a joint, at whose end the loop is closed.

    Parameters
    ----------
    tree
        Takes the loop.
    joint
        Joint of the file.
    source
        The file, for messages.
    is_motor
        Whether a motor drives it; only a screw can be one.

    Raises
    ------
    FileFormatError
        If its axes are not at right angles.
    """
    if _leans(joint, source):
        raise FileFormatError(
            f"joint '{joint.name}' of type '{joint.written}' cannot close a loop: its axes are not at right angles; "
            "let another joint of the loop close it",
            path=source,
            culprit=joint.name,
        )
    in_parent = joint.in_parent if joint.position is None else joint.in_parent * joint.rest.inverse()
    loop = Loop(joint.name, joint.kind, joint.parent, joint.child, in_parent, joint.in_child)
    if joint.lead:
        screw = replace(loop, axis=joint.axes[0].direction)
        row, loop = close_by_screw(screw, joint.lead)
        _add_row(tree, row, joint, is_motor)
    tree.loops.append(loop if joint.lead else _with_axes(loop, joint))


def _with_axes(loop: Loop, joint: SdfJoint) -> Loop:
    readings = joint.readings
    match joint.axes:
        case [only]:
            if joint.kind is JointKind.PLANAR:
                return replace(loop, axis=only.direction, physics=_without_axes(joint))
            bounds, physics = _bounds(only, readings[0]), _physics(joint)
            return replace(loop, axis=only.direction, bounds=bounds, physics=physics)
        case [first, second]:
            bounds = _bounds(first, readings[0]) + _bounds(second, readings[1])
            axis = joint.rest.rotation @ first.direction
            return replace(loop, axis=axis, axis2=second.direction, bounds=bounds, physics=_physics(joint))
    if joint.own_bounds:
        coordinates = loop_coordinates(joint.kind)
        loop = replace(loop, bounds=tuple(joint.own_bounds.get(key, Bounds()) for key in coordinates))
    loop = replace(loop, physics=_without_axes(joint))
    return loop if joint.ball_axis is None else replace(loop, axis=joint.ball_axis)


def _physics(joint: SdfJoint) -> tuple[JointPhysics, ...]:
    """Gather what the axes of a joint that closes a loop do; their springs count from where the model is placed."""
    each = zip(joint.axes, joint.readings, strict=True)
    found = tuple(counted_from(axis.physics, float(reading)) for axis, reading in each)
    return found if any(found) else ()


def _without_axes(joint: SdfJoint) -> tuple[JointPhysics, ...]:
    """Gather what the coordinates of a joint do that has no axes in SDFormat, or one that is none of them."""
    found = tuple(joint.own_physics.get(key, NO_PHYSICS) for key in physics_coordinates(joint.kind))
    return found if any(found) else ()


def hang(tree: SdfTree, joint: SdfJoint, near: float, is_motor: bool) -> None:
    """Hang the child link on a joint of the tree.

    Parameters
    ----------
    tree
        Takes the joint, and what stands for it.
    joint
        Joint of the file.
    near
        Distance below which two points are one [m].
    is_motor
        Whether a motor drives it.
    """
    in_child, child = joint.in_child, joint.child
    same_turn = bool(np.abs(in_child.rotation - np.eye(3)).max() <= SAME_PLACE)
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
    if joint.position is not None:
        alone = len(axes) == 1 and not joint.lead
        rest = motion(joint.kind, axes[0], joint.readings) if alone else joint.rest
        placement = placement * rest.inverse()
    readings = joint.readings
    # A screw is cylindrical as well, and one without lead none of ours.
    in_a_row = joint.lead or joint.kind is JointKind.PLANAR or joint.written == JointKind.CYLINDRICAL
    if len(axes) <= 1 and not in_a_row:
        made = Joint(joint.name, joint.kind, joint.parent, child, placement, independent=is_motor)
        if joint.position is not None and len(readings):
            tree.home[joint.name] = readings
        if axes:
            made = _limited(replace(made, axis=axes[0]), joint.axes[0], readings[0])
        tree.joints.append(_ball(made, joint) if joint.kind is JointKind.SPHERICAL else made)
        return
    if joint.kind is JointKind.UNIVERSAL:
        axes = [joint.rest.rotation @ axes[0], axes[1]]
    row = _row(joint, child, placement, axes)
    if joint.kind is JointKind.PLANAR:
        row = row.doing(_without_axes(joint))
    _add_row(tree, row, joint, is_motor)


def _add_row(tree: SdfTree, row: Unfolded, joint: SdfJoint, is_motor: bool) -> None:
    """Add the joints in a row that stand for one of the file, with its limits and readings."""
    readings = joint.readings
    parts = list(row.joints)
    for number, axis in enumerate(joint.axes):
        if joint.kind is not JointKind.PLANAR:
            parts[number] = replace(_limited(parts[number], axis, readings[number]), independent=is_motor)
            if joint.position is not None:
                tree.home[parts[number].name] = readings[number : number + 1]
    if joint.lead and joint.position is not None:
        tree.home[parts[1].name] = readings * joint.lead / (2 * np.pi)
    tree.links += row.links
    tree.joints += parts
    tree.couplings += row.couplings
    tree.notes.append(replace(row.note, text=row.note.text.replace("universal", joint.written)))


def _row(joint: SdfJoint, child: str, placement: pin.SE3, axes: list[FloatArray]) -> Unfolded:
    if joint.lead:
        return unfold_screw(joint.name, joint.parent, child, placement, axes[0], joint.lead)
    if joint.kind is JointKind.CYLINDRICAL:
        return unfold_cylindrical(joint.name, joint.parent, child, placement, axes[0])
    if joint.kind is JointKind.PLANAR:
        return unfold_planar(joint.name, joint.parent, child, placement, axes[0])
    return unfold_universal(joint.name, joint.parent, child, placement, axes[0], axes[1])


def _bounds(axis: Axis, reading: float) -> tuple[Bounds]:
    """Gather the limits of a joint that closes a loop; those of the file are counted from where the model is placed."""
    spans: dict[str, Span] = {
        "velocity": (-axis.velocity, axis.velocity),
        "acceleration": (-axis.acceleration, axis.acceleration),
        **axis.spans,
    }
    spans.pop("effort", None)  # no motor drives it
    return (Bounds(position=(axis.lower + reading, axis.upper + reading), **spans),)


def _limited(joint: Joint, axis: Axis, reading: float) -> Joint:
    effort = np.inf if axis.effort is None else axis.effort
    values: dict[str, float | Span] = {
        "effort": effort,
        "velocity": axis.velocity,
        "acceleration": axis.acceleration,
        **axis.spans,
    }
    even = {key: _even(value) for key, value in values.items()}
    physics = counted_from(axis.physics, float(reading))
    return replace(joint, lower=axis.lower + reading, upper=axis.upper + reading, physics=physics, **even)


def _even(value: float | Span) -> float | Span:
    """One number for a span to both sides."""
    return value[1] if isinstance(value, tuple) and value[0] == -value[1] else value


def _ball(made: Joint, joint: SdfJoint) -> Joint:
    swing, turn = (joint.own_bounds.get(key, Bounds()).position[1] for key in loop_coordinates(joint.kind))
    axis = made.axis if joint.ball_axis is None else joint.ball_axis
    physics = joint.own_physics.get("turn", NO_PHYSICS)
    return replace(made, swing=swing, turn=turn, axis=axis, physics=physics)
