"""Joints of Gazebo inside a URDF: ``<gazebo><joint>``, in SDFormat's words, closes a loop of the URDF's tree.

Gazebo puts the pose of such a joint into the child link. Where the joint sits in the parent follows from how the two
links lie while all joints are at zero, which is the pose in which Gazebo puts the robot together.

References
----------
.. [1] Gazebo documentation, "Kinematic loops"; SDFormat documentation, "SDFormat extensions to URDF".
"""

from __future__ import annotations

from dataclasses import replace
from math import inf

import pinocchio as pin
from lxml import etree

from stewart_pin.geometry.rotations import rotation_from_rpy
from stewart_pin.model.description import Bounds, JointKind, Loop, Mechanism, Note, Outcome
from stewart_pin.model.formats.dialect import AT_ZERO, Dialect, Parts, relative_at_zero
from stewart_pin.model.formats.dialects.mimic import couple, take_mimic_plugins
from stewart_pin.model.formats.urdf_elements import UrdfElements
from stewart_pin.model.formats.words import Strange, Words
from stewart_pin.typing import FloatArray

_TYPES = {
    "revolute": JointKind.REVOLUTE,
    "continuous": JointKind.REVOLUTE,
    "prismatic": JointKind.PRISMATIC,
    "ball": JointKind.SPHERICAL,
    "fixed": JointKind.FIXED,
    "universal": JointKind.UNIVERSAL,
}
_FAR = 1e16
"""SDFormat's number for no limit."""
_NO_COORDINATE = "a joint that closes a loop has no coordinate"
_AXIS = Words(
    (),
    ("xyz", "limit", "use_parent_model_frame"),
    {"dynamics": _NO_COORDINATE, "initial_position": _NO_COORDINATE},
)
_TEXT = Words(text=True)
_SETTINGS = "simulator settings"
_WORDS = {
    "robot/gazebo": Words(("reference",), ("joint", "plugin"), strange=Strange.NOTED, told_by_reader=True),
    "gazebo/joint": Words(
        ("name", "type"),
        ("parent", "child", "pose", "axis", "axis2"),
        {"physics": _SETTINGS, "sensor": _SETTINGS},
    ),
    **{f"gazebo/joint/{tag}": _TEXT for tag in ("parent", "child", "pose")},
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
}


def _read(reader: UrdfElements, element: etree._Element) -> Parts:
    joints = [] if element.get("reference") else element.findall("joint")
    for joint in joints:
        element.remove(joint)
    couplings = take_mimic_plugins(reader, element)
    if _floats(element):
        reader.note(
            f"<gazebo reference='{element.get('reference')}'>",
            "gravity is off for this link in Gazebo, and stays on here; load(gravity=...) sets it for all",
        )
    if len(element) or not (joints or couplings):
        reader.ignore(element, "the file")
    joints = [joint for joint in joints if not _on_left_out(reader, joint)]
    loops = [_read_joint(reader, joint) for joint in joints]
    in_model = {
        (joint.get("name"), tag)
        for joint in joints
        for tag in ("axis", "axis2")
        if _in_model_frame(reader, joint, tag)
    }

    def placed(mechanism: Mechanism) -> Parts:
        found: list[Loop] = []
        for loop in loops:
            relative = relative_at_zero(mechanism, loop.link1, loop.link2, f"joint '{loop.name}' of <gazebo>")
            turned = {
                tag: _from_model(mechanism, loop, tag)
                for tag in ("axis", "axis2")
                if (loop.name, tag) in in_model
            }
            found.append(replace(loop, placement1=relative * loop.placement2, **turned))
        notes = tuple(Note(f"loop '{loop.name}'", AT_ZERO, Outcome.CHANGED) for loop in found)
        coupled = [couple(mechanism, coupling) for coupling in couplings]
        return Parts(
            loops=tuple(found),
            couplings=tuple(coupling for each in coupled for coupling in each.couplings),
            notes=notes + tuple(note for each in coupled for note in each.notes),
        )

    return Parts(later=placed if loops or couplings else None)


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


def _read_joint(reader: UrdfElements, element: etree._Element) -> Loop:
    name = reader.text(element, "name", "a <gazebo><joint>")
    owner = f"joint '{name}' of <gazebo>"
    written = reader.text(element, "type", owner)
    if written not in _TYPES:
        raise reader.error(f"{owner} has the type '{written}'; supported: {', '.join(_TYPES)}", owner)
    kind = _TYPES[written]
    parent, child = (reader.content(reader.child(element, tag, owner), owner) for tag in ("parent", "child"))
    pose = reader.optional(element, "pose", owner)
    placement = pin.SE3.Identity()
    if pose is not None:
        numbers = reader.parse(reader.content(pose, owner), 6, f"{owner}: <pose>", owner)
        placement = pin.SE3(rotation_from_rpy(*numbers[3:]), numbers[:3])
    loop = Loop(name, kind, parent, child, pin.SE3.Identity(), placement)
    if kind is JointKind.UNIVERSAL:
        return replace(
            loop,
            axis=_axis(reader, element, "axis", owner),
            axis2=_axis(reader, element, "axis2", owner),
            bounds=_bounds(reader, element, ("axis", "axis2"), owner),
        )
    if kind in (JointKind.REVOLUTE, JointKind.PRISMATIC):
        return replace(
            loop,
            axis=_axis(reader, element, "axis", owner),
            bounds=_bounds(reader, element, ("axis",), owner),
        )
    return loop


def _bounds(
    reader: UrdfElements, joint: etree._Element, tags: tuple[str, ...], owner: str
) -> tuple[Bounds, ...]:
    """Read what the coordinates may do; they are zero where all joints are, as the frames are placed."""
    found: list[Bounds] = []
    for tag in tags:
        limit = reader.optional(reader.child(joint, tag, owner), "limit", owner)
        if limit is None:
            found.append(Bounds())
            continue
        lower, upper, velocity = (
            default
            if (child := reader.optional(limit, tag, owner)) is None
            else float(reader.parse(reader.content(child, owner), 1, f"{owner}: <{tag}>", owner)[0])
            for tag, default in (("lower", -inf), ("upper", inf), ("velocity", -1.0))
        )
        found.append(
            Bounds(
                position=(-inf if lower <= -_FAR else lower, inf if upper >= _FAR else upper),
                velocity=(-velocity, velocity) if 0 < velocity < _FAR else (-inf, inf),
            )
        )
    return tuple(found) if any(each != Bounds() for each in found) else ()


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


def _from_model(mechanism: Mechanism, loop: Loop, tag: str) -> FloatArray:
    """Turn an axis from the model's frame, that of the root link, into the joint's, all joints at zero."""
    children = {joint.child for joint in mechanism.joints}
    root = next(link.name for link in mechanism.links if link.name not in children)
    owner = f"joint '{loop.name}' of <gazebo>"
    frame = (
        loop.placement2
        if loop.link2 == root
        else relative_at_zero(mechanism, root, loop.link2, owner) * loop.placement2
    )
    return frame.rotation.T @ getattr(loop, tag)


def _axis(reader: UrdfElements, joint: etree._Element, tag: str, owner: str) -> FloatArray:
    axis = reader.child(joint, tag, owner)
    xyz = reader.child(axis, "xyz", owner)
    return reader.direction(reader.content(xyz, owner), f"{owner}: <{tag}>", owner)


DIALECT = Dialect("gazebo", "Gazebo <gazebo>", {"robot/gazebo": _read}, _WORDS)
