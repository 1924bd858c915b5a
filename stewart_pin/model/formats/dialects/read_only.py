"""Dialects that are only read: frames of onshape-to-robot, urdfdom's ``<constraint>``, motors that ROS names."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.errors import FileFormatError
from stewart_pin.model.description import (
    AXIS_FREE_LOOPS,
    LOOP_KINDS,
    Coupling,
    JointKind,
    Loop,
    Mechanism,
    Note,
    Outcome,
)
from stewart_pin.model.formats.dialect import Dialect, Parts, add_parts, carrier
from stewart_pin.model.formats.dialects.mimic import couple, has_mimic
from stewart_pin.model.formats.dynamics import DYNAMICS
from stewart_pin.model.formats.urdf_core import read_loop_dynamics
from stewart_pin.model.formats.urdf_elements import UrdfElements
from stewart_pin.model.formats.words import Strange, Words, meant_word
from stewart_pin.model.formats.xml import reason_to_ignore, shown_tag
from stewart_pin.typing import FloatArray

# ----------------------------------------------------------------------------------------------------
# Frames called ``closing_NAME_1`` and ``closing_NAME_2``, as onshape-to-robot exports a mate ``closing_NAME``.
#
# The type of the mate is not in the URDF. For hinges the exporter adds a second pair of frames, ``closing_NAME_1_z``
# and ``closing_NAME_2_z``, farther up the axis, which are read as a revolute loop about z. A pair alone is taken
# for a ball, the weakest that all mates share; to say otherwise, name the pair in a YAML beside the URDF (see
# `gepetto`), with the type that it is.
#
# References
# ----------
# .. [1] onshape-to-robot documentation, "Kinematic loops".
# ----------------------------------------------------------------------------------------------------

_NAME = re.compile(r"(closing_.+)_([12])(_z)?")
_TITLE = "frames closing_*_1, closing_*_2"
_ASSUMED = "taken for a ball: the file does not say what the mate was; if it is more, name the pair in a YAML beside it"


def _complete(mechanism: Mechanism) -> Mechanism:
    ends: dict[tuple[str, str], dict[str, str]] = {}
    for link in mechanism.links:
        found = _NAME.fullmatch(link.name)
        if found:
            ends.setdefault((found[1], found[3] or ""), {})[found[2]] = link.name
    for (stem, suffix), pair in ends.items():
        if len(pair) < 2 or (suffix and (stem, "") not in ends):
            raise FileFormatError(
                f"frame '{next(iter(pair.values()))}' is called like half of a pair that closes a loop, and the other "
                "half is missing; add it, or rename the frame",
                path=mechanism.source,
                culprit=next(iter(pair.values())),
            )
        if not suffix:
            mechanism = _closed(mechanism, stem, pair, hinge=(stem, "_z") in ends)
    return mechanism


def _closed(mechanism: Mechanism, stem: str, pair: dict[str, str], *, hinge: bool) -> Mechanism:
    (link1, place1), (link2, place2) = (carrier(mechanism, pair[end]) for end in "12")
    for loop in mechanism.loops:
        ends = [(loop.link1, loop.placement1), (loop.link2, loop.placement2)]
        wanted = [(link1, place1), (link2, place2)]
        if _same(ends, wanted) or _same(ends[::-1], wanted):
            return _closed_already(mechanism, stem, loop, hinge=hinge)
        if loop.name == stem:
            raise FileFormatError(
                f"loop '{stem}' and the frames '{pair['1']}' and '{pair['2']}' have one name, and close at different "
                "places; rename one",
                path=mechanism.source,
                culprit=stem,
            )
    kind = JointKind.REVOLUTE if hinge else JointKind.SPHERICAL
    parts = Parts(loops=(Loop(stem, kind, link1, link2, place1, place2),))
    if not hinge:
        parts = Parts(loops=parts.loops, notes=(Note(f"loop '{stem}'", _ASSUMED, Outcome.CHANGED),))
    return add_parts(mechanism, parts, _TITLE)


def _closed_already(mechanism: Mechanism, stem: str, loop: Loop, *, hinge: bool) -> Mechanism:
    """Keep the loop that closes where a pair of frames does, unless the frames say that it is more."""
    if hinge and loop.kind not in (JointKind.REVOLUTE, JointKind.FIXED):
        raise FileFormatError(
            f"the frames of '{stem}' are those of a hinge, and loop '{loop.name}' is {loop.kind} at the same place; "
            "remove one of the two",
            path=mechanism.source,
            culprit=stem,
        )
    note = Note(f"frames '{stem}'", f"closed already by the {loop.kind} loop '{loop.name}'")
    return replace(mechanism, notes=(*mechanism.notes, note))


def _same(ends: list[tuple[str, pin.SE3]], wanted: list[tuple[str, pin.SE3]]) -> bool:
    """Tell whether two pairs of frames have the same links and origins."""
    return all(
        link == other and np.allclose(place.translation, there.translation, rtol=0, atol=1e-9)
        for (link, place), (other, there) in zip(ends, wanted, strict=True)
    )


_CLOSING_FRAMES = Dialect("closing_frames", _TITLE, complete=_complete)


# ----------------------------------------------------------------------------------------------------
# The ``<constraint>`` that is proposed for urdfdom: parent and child, each with its origin and its axis.
#
# The axes stand in the frames that the origins make, as the axis of a URDF joint does. A universal joint turns about
# the parent's axis and the child's. For the other types the child's frame is turned, by the least rotation, so that its
# axis becomes the parent's.
#
# References
# ----------
# .. [1] urdfdom, pull request 264, "Add constraints to describe closed loops", 2026.
# ----------------------------------------------------------------------------------------------------

_SYNONYMS = {"continuous": "revolute", "ball": "spherical"}


def _read_constraint(reader: UrdfElements, element: etree._Element) -> Parts:
    name = reader.text(element, "name", "a <constraint>")
    owner = f"constraint '{name}'"
    written = reader.text(element, "type", owner)
    types = [kind for kind in LOOP_KINDS if kind is not JointKind.DISTANCE]
    word = written.removesuffix("_joint")  # the fork writes spherical_joint
    if _SYNONYMS.get(word, word) not in types:
        raise reader.error(f"{owner} has the type '{written}'; supported: {', '.join(types)}", owner)
    kind = JointKind(_SYNONYMS.get(word, word))
    link1, link2 = reader.ends(element, owner)
    place1, place2 = (reader.origin(element, owner, f"{end}_origin") for end in ("parent", "child"))
    default = "0 0 1" if kind in AXIS_FREE_LOOPS else ""
    axis = reader.axis(element, owner, "parent_axis", default)
    given = reader.optional(element, "child_axis", owner) is not None or kind is JointKind.UNIVERSAL
    axis2 = reader.axis(element, owner, "child_axis", default) if given else axis
    physics = read_loop_dynamics(reader, element, owner, kind)
    if kind is JointKind.UNIVERSAL:
        loop = Loop(name, kind, link1, link2, place1, place2, axis, axis2, physics=physics)
        return Parts(loops=(loop,))
    notes: tuple[Note, ...] = ()
    if kind not in AXIS_FREE_LOOPS and not np.array_equal(axis, axis2):
        place2 = place2 * pin.SE3(_least_rotation(axis, axis2), np.zeros(3))
        if kind is JointKind.PRISMATIC:
            text = "two axes do not say how the child is turned about them; the least rotation is taken"
            notes = (Note(f"loop '{name}'", text, Outcome.CHANGED),)
    loop = Loop(name, kind, link1, link2, place1, place2, axis, physics=physics)
    return Parts(loops=(loop,), notes=notes)


def _least_rotation(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the rotation of least angle that takes unit vector a to b."""
    if a @ b < -1 + 1e-12:  # half a turn about any axis across
        across = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
        across /= np.linalg.norm(across)
        return 2 * np.outer(across, across) - np.eye(3)
    return pin.Quaternion.FromTwoVectors(a, b).toRotationMatrix()


_ENDS = ("parent", "child")
_CONSTRAINT = {
    "robot/constraint": Words(
        ("name", "type"),
        (*(f"{end}{part}" for end in _ENDS for part in ("", "_origin", "_axis")), "dynamics"),
    ),
    "constraint/dynamics": Words(("coordinate", *DYNAMICS)),
    **{f"constraint/{end}": Words(("link",)) for end in _ENDS},
    **{f"constraint/{end}_origin": Words(("xyz", "rpy")) for end in _ENDS},
    **{f"constraint/{end}_axis": Words(("xyz",)) for end in _ENDS},
}

_URDFDOM = Dialect("urdfdom", "urdfdom <constraint>", {"robot/constraint": _read_constraint}, _CONSTRAINT)


# ----------------------------------------------------------------------------------------------------
# Motors that ROS names: ``<transmission>`` and ``<ros2_control>``.
#
# They count where no joint is marked independent and they can only mean one thing; see `choose_motors`. A joint of
# ``<ros2_control>`` with ``<param name="mimic">`` follows another one, as by a ``<mimic>``.
#
# References
# ----------
# .. [1] ROS wiki, "urdf/XML/Transmission"; ros2_control documentation, "URDF hardware components".
# ----------------------------------------------------------------------------------------------------

_NOT_DRIVEN = ("PassiveJointInterface", "JointStateInterface")
_ROTOR = ("drake:rotor_inertia", "drake:gear_ratio")
_GEARS = "efforts and speeds of motors are those of their joints here, behind the gears"
_HARDWARE = "settings of the hardware"
_INSIDE = {
    **dict.fromkeys(("mechanicalReduction", "motorTorqueConstant", "offset"), _GEARS), "role": "told by its joints",
    "hardwareInterface": "that of the joint counts",
}  # fmt: skip
_FOLLOWING = ("mimic", "multiplier", "offset")
"""Params of a joint that follows another one."""


def _read_transmission(reader: UrdfElements, element: etree._Element) -> Parts:
    reason_to_ignore(reader, element, "the file")
    joints = element.findall("joint")
    rotors, notes = _rotors(reader, element, [joint.get("name") or "" for joint in joints])
    if joints and all(_is_passive(joint) for joint in joints):
        passive = Note(reader.shown(element, "the file"), "passive joints, no motors")
        return Parts(notes=(*notes, passive), rotors=rotors)
    return Parts(motors=tuple(joint.get("name") or "" for joint in joints), notes=notes, rotors=rotors)


def _rotors(
    reader: UrdfElements, element: etree._Element, joints: list[str]
) -> tuple[tuple[tuple[str, float], ...], tuple[Note, ...]]:
    """Read Drake's inertia of a rotor [kg or kg m²], which counts by the square of the gear ratio before it."""
    shown = reader.shown(element, "the file")
    found: list[float] = []
    for actuator in element.findall("actuator"):
        told = [reader.optional(actuator, tag, shown) for tag in _ROTOR]
        if any(each is not None for each in told):
            inertia, ratio = (
                default if each is None else float(reader.numbers(each, "value", 1, shown)[0])
                for each, default in zip(told, (0.0, 1.0), strict=True)
            )
            if inertia < 0:
                raise reader.error(
                    f"{shown}: <{_ROTOR[0]}> (line {actuator.sourceline}) is {inertia:g}; it must be zero or more",
                    shown,
                )
            found.append(inertia * ratio**2)
    if not any(found):
        return (), ()
    if len(found) > 1 or len(joints) != 1:
        text = f"its rotors of {found} are left out: they belong to {len(joints)} joints"
        return (), (Note(shown, text),)
    if _has_no_effort(reader, joints[0]):
        text = f"its rotor of {found[0]:g} is left out: Drake drives no joint whose <limit effort> is 0"
        return (), (Note(shown, text),)
    return ((joints[0], found[0]),), ()


def _has_no_effort(reader: UrdfElements, joint: str) -> bool:
    """Tell whether the effort of a joint is limited to zero."""
    tags = ("joint", "drake:joint")
    limits = [
        limit
        for each in reader.root.iterchildren(etree.Element)
        if shown_tag(each) in tags and each.get("name") == joint
        for limit in each.findall("limit")
    ]
    return any(reader.numbers(limit, "effort", 1, f"joint '{joint}'", "1")[0] == 0.0 for limit in limits)


def _is_passive(joint: etree._Element) -> bool:
    """Tell whether a joint's interfaces are all those of a joint that nothing drives."""
    words = [(each.text or "").strip().rpartition("/")[2] for each in joint.findall("hardwareInterface")]
    return bool(words) and all(word in _NOT_DRIVEN for word in words)


def _read_ros2_control(reader: UrdfElements, element: etree._Element) -> Parts:
    reason_to_ignore(reader, element, "the file")
    joints = element.findall("joint")
    driven = [joint for joint in joints if joint.find("command_interface") is not None]
    followers = [coupling for joint in joints for coupling in _followed(reader, joint)]

    def coupled(mechanism: Mechanism) -> Parts:
        parts = [couple(mechanism, coupling) for coupling in followers]
        return Parts(
            couplings=tuple(coupling for part in parts for coupling in part.couplings),
            notes=tuple(note for part in parts for note in part.notes),
        )

    motors = tuple(joint.get("name") or "" for joint in driven)
    return Parts(motors=motors, later=coupled if followers else None)


def _followed(reader: UrdfElements, joint: etree._Element) -> list[Coupling]:
    """Read the params of a joint that follows another one; where it has a ``<mimic>``, that one counts."""
    name = reader.text(joint, "name", "a <joint> of <ros2_control>")
    owner = f"joint '{name}' of <ros2_control>"
    told: dict[str, str] = {}
    for param in joint.findall("param"):
        key = reader.text(param, "name", owner)
        meant = meant_word(key, _FOLLOWING)
        if key in told or (meant and meant != key):
            fault = (
                "stands there twice; keep one" if key in told else f"is not understood; is '{meant}' meant?"
            )
            raise reader.error(f"{owner}: <param name='{key}'> (line {param.sourceline}) {fault}", owner)
        if key in _FOLLOWING:
            told[key] = reader.content(param, owner)
        else:
            reader.note(
                f"{owner}, line {param.sourceline}", f"<param name='{key}'>: settings of the hardware"
            )
    if "mimic" not in told:
        if told:
            raise reader.error(f"{owner} has a <param name='{min(told)}'>, but none called 'mimic'", owner)
        return []
    offset, multiplier = (
        float(reader.parse(told.get(key, default), 1, f"{owner}: <param name='{key}'>", owner)[0])
        for key, default in (("offset", "0"), ("multiplier", "1"))
    )
    coupling = Coupling(f"{name}_mimic", name, told["mimic"], (offset, multiplier))
    return [] if has_mimic(reader, coupling, "<ros2_control>") else [coupling]


_ROS = Dialect(
    "ros",
    "ROS <transmission>, <ros2_control>",
    {"robot/transmission": _read_transmission, "robot/ros2_control": _read_ros2_control},
    {
        "transmission": Words(
            (),
            ("type", "joint", "actuator"),
            {
                "@name": "",
                "@type": "told by its joints",
                **dict.fromkeys(
                    ("leftActuator", "rightActuator", "mechanicalReduction", "motorTorqueConstant"), _GEARS
                ),
            },
            strange=Strange.NOTED,
        ),
        "transmission/joint": Words(("name",), ("hardwareInterface",), _INSIDE, strange=Strange.NOTED),
        "transmission/actuator": Words((), (*_ROTOR,), {"@name": "", **_INSIDE}, strange=Strange.NOTED),
        **{f"actuator/{tag}": Words(("value",)) for tag in _ROTOR},
        "joint/hardwareInterface": Words(text=True, strange=Strange.NOTED),
        "ros2_control": Words(
            (),
            ("joint",),
            {
                "@name": "",
                "@type": "",
                "@rw_rate": "",
                "@is_async": "",
                **dict.fromkeys(("hardware", "sensor", "gpio"), _HARDWARE),
                "transmission": _GEARS,
            },
            strange=Strange.NOTED,
        ),
        "ros2_control/joint": Words(
            ("name",),
            ("command_interface", "param"),
            {"state_interface": "what is measured"},
            strange=Strange.NOTED,
        ),
        "ros2_control/joint/param": Words(("name",), text=True),
        "joint/command_interface": Words(
            (), (), {"@name": "", "param": "limits of commands are the controller's"}, strange=Strange.NOTED
        ),
    },
)


DIALECTS = (_CLOSING_FRAMES, _URDFDOM, _ROS)
