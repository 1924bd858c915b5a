"""Joints and links of Gazebo inside a URDF: ``<gazebo><joint>`` and ``<gazebo><link>``, in SDFormat's words.

Gazebo makes SDFormat of the URDF and puts these elements into it. A joint closes a loop of the URDF's tree. Its pose is
one in the child link; where it sits in the parent follows from how the two links lie while all joints are at zero, the
pose in which Gazebo puts the robot together. A link stands in the frame of the root link; the first joint between it
and a link of the tree hangs it there, from the other side where the link is the parent. Screws count whole turns by
joints of their own; a gearbox couples two joints of the tree.

References
----------
.. [1] Gazebo documentation, "Kinematic loops"; SDFormat documentation, "SDFormat extensions to URDF".
.. [2] Open Robotics, "SDFormat Specification", ``<joint>``: thread_pitch, screw_thread_pitch, gearbox_ratio.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.geometry.rotations import rotation_from_rpy
from stewart_pin.model.description import Coupling, Joint, Link, Mechanism, Note, Outcome
from stewart_pin.model.formats.dialect import AT_ZERO, Dialect, Parts, placement_at_zero, require_links
from stewart_pin.model.formats.dialects.mimic import couple, take_mimic_plugins
from stewart_pin.model.formats.dynamics import GAZEBO_SPRING
from stewart_pin.model.formats.sdf.coordinates import read_axis_dynamics
from stewart_pin.model.formats.sdf.couplings import Gearbox, is_gearbox, mesh
from stewart_pin.model.formats.sdf.elements import SdfReader
from stewart_pin.model.formats.sdf.joints import AXES, GEARBOX, KINDS, Axis, SdfJoint, read_lead
from stewart_pin.model.formats.sdf.mechanism import read_link
from stewart_pin.model.formats.sdf.tree import SAME_PLACE, SdfTree, close, hang
from stewart_pin.model.formats.sdf.words import WORDS as SDF
from stewart_pin.model.formats.urdf_elements import UrdfElements
from stewart_pin.model.formats.words import Strange, Words
from stewart_pin.typing import FloatArray

_FAR = 1e16
"""SDFormat's number for no limit."""
_AXIS = Words(
    (),
    ("xyz", "limit", "dynamics", "use_parent_model_frame"),
    {"initial_position": "all joints are at zero as the file lays the links"},
)
_TEXT = Words(text=True)
_DYNAMICS = SDF["axis/dynamics"]
_SETTINGS = "simulator settings"
_THREADS = ("thread_pitch", "screw_thread_pitch")
_GEARS = ("gearbox_ratio", "gearbox_reference_body")
_WORDS = {
    "robot/gazebo": Words(
        ("reference",),
        ("joint", "link", "plugin", *GAZEBO_SPRING),
        strange=Strange.NOTED,
        told_by_reader=True,
    ),
    **{f"gazebo/{tag}": Words(("value",), text=True) for tag in GAZEBO_SPRING},
    "gazebo/joint": Words(
        ("name", "type"),
        ("parent", "child", "pose", "axis", "axis2", *_THREADS, *_GEARS),
        {"physics": _SETTINGS, "sensor": _SETTINGS},
    ),
    **{f"gazebo/joint/{tag}": _TEXT for tag in ("parent", "child", "pose", *_THREADS, *_GEARS)},
    "gazebo/joint/axis": _AXIS,
    "gazebo/joint/axis2": _AXIS,
    **{
        f"joint/{axis}/{tag}": _TEXT
        for axis in ("axis", "axis2")
        for tag in ("xyz", "use_parent_model_frame")
    },
    **{
        f"joint/{axis}/limit": Words(
            (),
            ("lower", "upper", "velocity"),
            {"effort": "no motor drives it", "stiffness": _SETTINGS, "dissipation": _SETTINGS},
        )
        for axis in ("axis", "axis2")
    },
    **{f"limit/{tag}": _TEXT for tag in ("lower", "upper", "velocity")},
    **{f"joint/{axis}/dynamics": replace(_DYNAMICS, told_by_reader=True) for axis in ("axis", "axis2")},
    **{f"dynamics/{tag}": _TEXT for tag in _DYNAMICS.tags},
}


_NO_WEIGHT = "gravity is off for this link in Gazebo, and stays on here; load(gravity=...) sets it for all"


def _read(reader: UrdfElements, element: etree._Element) -> Parts:
    """Read a ``<gazebo>``; the first one reads the links and joints of all, which belong together."""
    _ = reader.gazebo_springs  # of joints of the URDF: taken out
    bodies = _take_bodies(reader)
    couplings = take_mimic_plugins(reader, element)
    if _floats(element):
        reader.note(f"<gazebo reference='{element.get('reference')}'>", _NO_WEIGHT)
    if len(element):
        reader.ignore(element, "the file")

    def placed(mechanism: Mechanism) -> Parts:
        found = _placed(reader, mechanism, bodies)
        coupled = [couple(mechanism, coupling) for coupling in couplings]
        return replace(
            found,
            couplings=found.couplings + tuple(coupling for each in coupled for coupling in each.couplings),
            notes=found.notes + tuple(note for each in coupled for note in each.notes),
        )

    return Parts(links=bodies.links, later=placed if bodies.joints or bodies.gears or couplings else None)


def _on_left_out(reader: UrdfElements, joint: etree._Element) -> bool:
    """Tell whether a joint hangs a ``<gazebo><model>`` on the robot: the model is left out, and so is the joint."""
    models = {model.get("name") for model in reader.root.iterfind("gazebo/model")}
    for end in ("parent", "child"):
        name, inner, _ = (joint.findtext(end) or "").strip().partition("::")
        if inner and name in models:
            owner, told = (
                f"joint '{joint.get('name')}' of <gazebo>",
                f"hangs the <gazebo> model '{name}' on the robot: both left out",
            )
            if any(note.text == told for note in reader.notes):
                raise reader.error(
                    f"{owner} is the second that joins the <gazebo> model '{name}', which may close a loop; write the "
                    "links and joints of the model as those of the URDF",
                    owner,
                )
            reader.note(owner, told)
            return True
    return False


def _floats(element: etree._Element) -> bool:
    """Whether gravity is turned off for a link."""
    words = {tag: (element.findtext(tag) or "").strip().lower() for tag in ("turnGravityOff", "gravity")}
    return words["turnGravityOff"] in ("true", "1") or words["gravity"] in ("false", "0")


# ----------------------------------------------------------------------------------------------------
# What stands in the file
# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Bodies:
    """Links and joints of all ``<gazebo>`` of a file; joints lie at the origin of their parent so far."""

    links: tuple[Link, ...]
    poses: dict[str, pin.SE3]
    joints: tuple[SdfJoint, ...]
    gears: tuple[etree._Element, ...]
    in_model: frozenset[tuple[str, int]]
    """Axes that are written in the frame of the model: name of the joint, and which."""


def _take_bodies(reader: UrdfElements) -> _Bodies:
    """Take links and joints out of all ``<gazebo>`` of a file; a second call finds none left."""
    plain = [each for each in reader.root.iterfind("gazebo") if not each.get("reference")]
    found = {tag: [child for each in plain for child in each.iterfind(tag)] for tag in ("link", "joint")}
    for child in (*found["link"], *found["joint"]):
        parent = child.getparent()
        if parent is not None:
            parent.remove(child)
    elements = [joint for joint in found["joint"] if not _on_left_out(reader, joint)]
    elements, alone = _on_the_robot(reader, elements, [link.get("name", "") for link in found["link"]])
    sdf = SdfReader(Path(reader.path), reader.notes)
    links: list[Link] = []
    poses: dict[str, pin.SE3] = {}
    for element in found["link"]:
        if (name := sdf.name(element)) in alone:
            continue
        owner = f"link '{name}' of <gazebo>"
        links.append(read_link(sdf, element, name))
        poses[name], frame = sdf.pose(element, owner)
        if frame not in ("", "__model__"):
            raise reader.error(
                f"{owner}: <pose relative_to='{frame}'> (line {element.sourceline}); write the pose in the frame of "
                "the model, which is that of the root link",
                owner,
            )
        if not sdf.flag(element, "gravity", owner, default=True):
            reader.note(owner, _NO_WEIGHT)
    gears = tuple(joint for joint in elements if is_gearbox(joint))
    plain_joints = [joint for joint in elements if not is_gearbox(joint)]
    in_model = {
        (joint.get("name", ""), number)
        for joint in plain_joints
        for number, tag in enumerate(("axis", "axis2"))
        if _in_model_frame(reader, joint, tag)
    }
    joints = tuple(_read_joint(reader, sdf, joint) for joint in plain_joints)
    return _Bodies(tuple(links), poses, joints, gears, frozenset(in_model))


def _on_the_robot(
    reader: UrdfElements, joints: list[etree._Element], links: list[str]
) -> tuple[list[etree._Element], set[str]]:
    """Leave out links that no joint leads to from the robot, bodies of their own in Gazebo, and their joints."""
    ends = [{(joint.findtext(end) or "").strip() for end in ("parent", "child")} for joint in joints]
    alone = set(links)
    while True:
        reached = {link for pair in ends if pair - alone for link in pair & alone}
        if not reached:
            break
        alone -= reached
    for name in links:
        if name in alone:
            told = "no joint of <gazebo> holds it on the robot: a body of its own in Gazebo, left out"
            reader.note(f"link '{name}' of <gazebo>", told)
    kept = [joint for joint, pair in zip(joints, ends, strict=True) if not pair & alone]
    return kept, alone


def _read_joint(reader: UrdfElements, sdf: SdfReader, element: etree._Element) -> SdfJoint:
    name = reader.text(element, "name", "a <gazebo><joint>")
    owner = f"joint '{name}' of <gazebo>"
    written = reader.text(element, "type", owner)
    if written not in KINDS:
        raise reader.error(
            f"{owner} has the type '{written}'; supported: {', '.join([*KINDS, GEARBOX])}", owner
        )
    kind = KINDS[written]
    needless = {"screw": _GEARS}.get(written, (*_THREADS, *_GEARS))
    for tag in needless:
        if element.find(tag) is not None:
            reader.note(owner, f"<{tag}>: a joint of type '{written}' has none")
    axes = AXES.get(kind, ())
    for tag in ("axis", "axis2"):
        if tag not in axes and element.find(tag) is not None:
            reader.note(owner, f"<{tag}>: a joint of type '{written}' has none")
    parent, child = (reader.content(reader.child(element, tag, owner), owner) for tag in ("parent", "child"))
    return SdfJoint(
        name,
        written,
        kind,
        parent,
        child,
        pin.SE3.Identity(),
        _pose(reader, element, owner),
        axes=tuple(_axis_and_limits(reader, sdf, element, tag, owner) for tag in axes),
        lead=read_lead(sdf, element, owner) if written == "screw" else 0.0,
    )


def _pose(reader: UrdfElements, element: etree._Element, owner: str) -> pin.SE3:
    pose = reader.optional(element, "pose", owner)
    if pose is None:
        return pin.SE3.Identity()
    numbers = reader.parse(reader.content(pose, owner), 6, f"{owner}: <pose>", owner)
    return pin.SE3(rotation_from_rpy(*numbers[3:]), numbers[:3])


def _axis_and_limits(
    reader: UrdfElements, sdf: SdfReader, joint: etree._Element, tag: str, owner: str
) -> Axis:
    """Read an axis and what its coordinate may do and does by itself, which is zero where all joints are."""
    element = reader.child(joint, tag, owner)
    axis = Axis(_axis(reader, joint, tag, owner), physics=read_axis_dynamics(sdf, element, owner))
    limit = reader.optional(element, "limit", owner)
    if limit is None:
        return axis
    lower, upper, velocity = (
        default
        if (child := reader.optional(limit, key, owner)) is None
        else float(reader.parse(reader.content(child, owner), 1, f"{owner}: <{key}>", owner)[0])
        for key, default in (("lower", -inf), ("upper", inf), ("velocity", -1.0))
    )
    return replace(
        axis,
        lower=-inf if lower <= -_FAR else lower,
        upper=inf if upper >= _FAR else upper,
        velocity=velocity if 0 < velocity < _FAR else inf,
    )


def _in_model_frame(reader: UrdfElements, joint: etree._Element, tag: str) -> bool:
    """Tell whether an axis is written in the model's frame, as in SDFormat 1.4, and not in the joint's."""
    owner = f"joint '{joint.get('name')}' of <gazebo>"
    axis = reader.optional(joint, tag, owner)
    flag = None if axis is None else reader.optional(axis, "use_parent_model_frame", owner)
    if flag is None:
        return False
    word = reader.content(flag, owner)
    if word not in ("0", "1", "false", "true"):
        raise reader.error(f"{owner}: <use_parent_model_frame> must be 0 or 1, got {word!r}", owner)
    return word in ("1", "true")


def _axis(reader: UrdfElements, joint: etree._Element, tag: str, owner: str) -> FloatArray:
    axis = reader.child(joint, tag, owner)
    xyz = reader.child(axis, "xyz", owner)
    return reader.direction(reader.content(xyz, owner), f"{owner}: <{tag}>", owner)


# ----------------------------------------------------------------------------------------------------
# Where it belongs in the mechanism
# ----------------------------------------------------------------------------------------------------


def _placed(reader: UrdfElements, mechanism: Mechanism, bodies: _Bodies) -> Parts:
    """Hang the links, close loops by all other joints, and couple by gearboxes."""

    def pose_of(link: str) -> pin.SE3:
        return bodies.poses[link] if link in bodies.poses else placement_at_zero(mechanism, link)

    tree = SdfTree()
    joints = [_between(mechanism, joint, bodies, pose_of) for joint in bodies.joints]
    size = max((float(np.linalg.norm(pose.translation)) for pose in bodies.poses.values()), default=1.0)
    waiting = set(bodies.poses)
    hung: list[SdfJoint] = []
    while waiting:
        joint = next(each for each in joints if len({each.parent, each.child} & waiting) == 1)
        joints.remove(joint)
        hung.append(_reversed(joint) if joint.parent in waiting else joint)
        waiting.discard(hung[-1].child)
        hang(tree, hung[-1], size * SAME_PLACE, False)
        told = f"hangs link '{hung[-1].child}' of <gazebo> on '{hung[-1].parent}'"
        tree.notes.append(Note(f"joint '{joint.name}' of <gazebo>", told, Outcome.CHANGED))
    taken = {joint.name for joint in (*mechanism.joints, *tree.joints)}
    for joint in joints:
        close(tree, _renamed(tree, joint, taken), mechanism.source)
    turning = [_as_sdf(joint) for joint in mechanism.joints] + hung
    sdf = SdfReader(Path(reader.path), tree.notes)
    meshed = [_mesh(reader, sdf, gear, mechanism, turning, pose_of) for gear in bodies.gears]
    at_zero = tuple(Note(f"loop '{loop.name}'", AT_ZERO, Outcome.CHANGED) for loop in tree.loops)
    return Parts(
        tuple(tree.links),
        tuple(tree.joints),
        tuple(tree.loops),
        (*tree.couplings, *(coupling for coupling in meshed if coupling is not None)),
        (*at_zero, *tree.notes),
    )


def _between(
    mechanism: Mechanism, joint: SdfJoint, bodies: _Bodies, pose_of: Callable[[str], pin.SE3]
) -> SdfJoint:
    """Place a joint in both links as they lie at zero; the model's frame is that of the root link."""
    require_links(mechanism, (joint.parent, joint.child), f"joint '{joint.name}' of <gazebo>")
    in_world = pose_of(joint.child) * joint.in_child
    axes = [
        replace(axis, direction=in_world.rotation.T @ axis.direction)
        if (joint.name, number) in bodies.in_model
        else axis
        for number, axis in enumerate(joint.axes)
    ]
    return replace(joint, in_parent=pose_of(joint.parent).actInv(in_world), axes=tuple(axes))


def _reversed(joint: SdfJoint) -> SdfJoint:
    """Let parent and child change places: R = exp(a α) exp(b β), so that Rᵀ = exp(-b β) exp(-a α)."""
    axes = tuple(replace(axis, direction=-axis.direction) for axis in reversed(joint.axes))
    return replace(
        joint,
        parent=joint.child,
        child=joint.parent,
        in_parent=joint.in_child,
        in_child=joint.in_parent,
        axes=axes,
    )


def _renamed(tree: SdfTree, joint: SdfJoint, taken: Collection[str]) -> SdfJoint:
    """Call a joint otherwise whose name a joint of the tree has."""
    if joint.name not in taken:
        return joint
    name = f"{joint.name}_of_gazebo"
    told = f"a joint of the URDF is called so, too: called '{name}' here"
    tree.notes.append(Note(f"joint '{joint.name}' of <gazebo>", told, Outcome.CHANGED))
    return replace(joint, name=name)


def _as_sdf(joint: Joint) -> SdfJoint:
    axes = (Axis(joint.axis),) if joint.has_axis else ()
    return SdfJoint(
        joint.name,
        joint.kind,
        joint.kind,
        joint.parent,
        joint.child,
        joint.placement,
        pin.SE3.Identity(),
        axes,
    )


def _mesh(
    reader: UrdfElements,
    sdf: SdfReader,
    element: etree._Element,
    mechanism: Mechanism,
    joints: list[SdfJoint],
    pose_of: Callable[[str], pin.SE3],
) -> Coupling | None:
    name = reader.text(element, "name", "a <gazebo><joint>")
    owner = f"joint '{name}' of <gazebo>"
    for tag in _THREADS:
        if element.find(tag) is not None:
            sdf.note(owner, f"<{tag}>: a joint of type '{GEARBOX}' has none")
    parent, child, body = (
        reader.content(reader.child(element, tag, owner), owner)
        for tag in ("parent", "child", "gearbox_reference_body")
    )
    require_links(mechanism, (parent, child, body), owner)
    in_world = pose_of(child) * _pose(reader, element, owner)
    axis1, axis2 = (
        axis if _in_model_frame(reader, element, tag) else in_world.rotation @ axis
        for tag in ("axis", "axis2")
        for axis in (_axis(reader, element, tag, owner),)
    )
    told = reader.optional(element, "gearbox_ratio", owner)
    text = "1" if told is None else reader.content(told, owner)
    ratio = float(reader.parse(text, 1, f"{owner}: <gearbox_ratio>", owner)[0])
    gearbox = Gearbox(name, owner, parent, child, body, axis1, axis2, ratio)
    return mesh(gearbox, joints, pose_of, sdf)


DIALECT = Dialect("gazebo", "Gazebo <gazebo>", {"robot/gazebo": _read}, _WORDS)
