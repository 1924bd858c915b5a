"""``<dynamics>`` of URDF, read and written: damping, friction, and in words of our own rotors and springs.

URDF has ``damping`` and ``friction``. What else a joint does stands in further attributes, called as the fields of
`JointPhysics`, which other readers pass over: ``armature``, ``stiffness`` (coefficients by powers, the linear one
first), ``rest``, ``force``. A joint that closes a loop has an element for each coordinate that does something, which
``coordinate`` names where there are several.

References
----------
.. [1] ROS wiki, "urdf/XML/joint", dynamics.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import fields, replace
from typing import TYPE_CHECKING

import numpy as np
from lxml import etree

from stewart_pin.model.description import Joint, JointKind, Mechanism, Note, Outcome, physics_coordinates
from stewart_pin.model.formats.xml import ElementReader, number_text, shown_tag
from stewart_pin.model.joint_physics import NO_PHYSICS, JointPhysics
from stewart_pin.typing import FloatArray

if TYPE_CHECKING:
    from stewart_pin.model.formats.urdf_elements import UrdfElements

DYNAMICS = (
    "damping",
    "friction",
    *(f.name for f in fields(JointPhysics) if f.name not in ("damping", "friction")),
)
"""Attributes of ``<dynamics>``: the fields of `JointPhysics`."""
SPREAD = ("armature", "damping", "friction")
"""Those that one number may tell of all coordinates alike."""


def physics_of(
    reader: ElementReader, element: etree._Element, values: dict[str, FloatArray], owner: str
) -> JointPhysics:
    """Make the physics of one coordinate of numbers that a file gives, or say which of them cannot be.

    Parameters
    ----------
    reader
        Reader of the file, for the error.
    element
        Where they stand.
    values
        (1,) by the fields of `JointPhysics`, of the stiffness (k,) [kg, N s/m, N, N/m, m, or as of turns].
    owner
        Joint or loop, for the message.

    Returns
    -------
    JointPhysics
        What is absent is zero.
    """
    numbers = {key: tuple(map(float, each)) for key, each in values.items()}
    physics = JointPhysics(
        stiffness=numbers.pop("stiffness", ()), **{key: each[0] for key, each in numbers.items()}
    )
    if fault := physics.fault():
        raise reader.error(f"{owner}: the {fault} (<{shown_tag(element)}>, line {element.sourceline})", owner)
    return physics


# ----------------------------------------------------------------------------------------------------
# Springs of Gazebo, which stand beside the joint: ``<gazebo reference="joint"><springStiffness>``
# ----------------------------------------------------------------------------------------------------

GAZEBO_SPRING = {"springStiffness": "stiffness", "springReference": "rest"}
"""What the tags mean."""
_OF_ONE_FREEDOM = ("revolute", "continuous", "prismatic")


def take_gazebo_springs(reader: UrdfElements) -> dict[str, dict[str, FloatArray]]:
    """Read the springs of joints that stand inside ``<gazebo>``, and take them out of it.

    Parameters
    ----------
    reader
        Reader of the file.

    Returns
    -------
    dict
        By joint, stiffness [N/m, N m/rad] and rest [m, rad], (1,) each, where they are told.
    """
    joints = {
        element.get("name")
        for element in reader.root.findall("joint")
        if element.get("type") in _OF_ONE_FREEDOM
    }
    found: dict[str, dict[str, FloatArray]] = {}
    for gazebo in reader.root.findall("gazebo"):
        joint = gazebo.get("reference", "")
        owner = f"<gazebo reference='{joint}'>"
        for element in [each for each in gazebo.iterchildren(etree.Element) if each.tag in GAZEBO_SPRING]:
            key = GAZEBO_SPRING[str(element.tag)]
            if joint not in joints:
                reader.note(owner, f"<{element.tag}>: no joint of one freedom is called so")
                continue
            if key in found.setdefault(joint, {}):
                raise reader.error(
                    f"{owner} has <{element.tag}> twice (line {element.sourceline}); keep one", owner
                )
            text = element.get("value") or reader.content(element, owner)
            found[joint][key] = reader.parse(text, 1, f"{owner}: <{element.tag}>", owner)
            gazebo.remove(element)
    return found


def with_gazebo_spring(
    reader: UrdfElements, physics: JointPhysics, spring: dict[str, FloatArray], owner: str
) -> JointPhysics:
    """Add the spring that ``<gazebo>`` gives to a joint.

    Parameters
    ----------
    reader
        Reader of the file.
    physics
        What the joint says of itself.
    spring
        Stiffness [N/m, N m/rad] and rest [m, rad], (1,) each, where they are told.
    owner
        The joint, for messages.

    Returns
    -------
    JointPhysics
        Both together.
    """
    if physics.pushes or physics.rest:
        raise reader.error(f"{owner} has a spring in <dynamics> and one in <gazebo>; keep one", owner)
    if "stiffness" not in spring:
        reader.note(owner, "<springReference> of <gazebo>: there is no <springStiffness>")
        return physics
    rest = float(spring["rest"][0]) if "rest" in spring else 0.0
    return replace(physics, stiffness=(float(spring["stiffness"][0]),), rest=rest)


# ----------------------------------------------------------------------------------------------------
# Rotors of motors, which stand in other tags than the joint
# ----------------------------------------------------------------------------------------------------


def with_rotors(
    reader: UrdfElements, mechanism: Mechanism, rotors: Collection[tuple[str, float]]
) -> Mechanism:
    """Give joints the rotors that other tags tell.

    Parameters
    ----------
    reader
        Reader of the file.
    mechanism
        Description whose joints they name.
    rotors
        Joint, and inertia times the square of the gear ratio [kg or kg m²].

    Returns
    -------
    Mechanism
        With the armature of these joints.
    """
    added: dict[str, Joint] = {}
    for name, armature in rotors:
        owner = f"joint '{name}'"
        joint = next((each for each in mechanism.joints if each.name == name and each.has_axis), None)
        if joint is None:
            reader.note(
                owner, f"its rotor of {armature:g} is left out: the joint is missing or has not one freedom"
            )
            continue
        known = added[name].physics.armature if name in added else joint.physics.armature
        if known and known != armature:
            raise reader.error(f"{owner} has two rotors, of {known:g} and {armature:g}; keep one", owner)
        added[name] = replace(joint, physics=replace(joint.physics, armature=armature))
    if not added:
        return mechanism
    return replace(
        mechanism,
        joints=tuple(added.get(each.name, each) if each.has_axis else each for each in mechanism.joints),
    )


# ----------------------------------------------------------------------------------------------------
# Writing
# ----------------------------------------------------------------------------------------------------


def write_dynamics(owner: etree._Element, physics: JointPhysics, **attributes: str) -> None:
    """Write what a coordinate does by itself as ``<dynamics>``; nothing where it does nothing.

    Parameters
    ----------
    owner
        Element that gets it.
    physics
        Numbers, of which those that are not zero are written.
    **attributes
        Further attributes of the element.
    """
    values = {key: np.atleast_1d(getattr(physics, key)) for key in DYNAMICS}
    told = {
        key: number_text(each)
        for key, each in values.items()
        if getattr(physics, key) != getattr(NO_PHYSICS, key)
    }
    if told:
        etree.SubElement(owner, "dynamics", {**attributes, **told})


def write_loop_dynamics(owner: etree._Element, kind: JointKind, physics: tuple[JointPhysics, ...]) -> None:
    """Write what a joint that closes a loop does by itself, one ``<dynamics>`` for each coordinate that does.

    Parameters
    ----------
    owner
        The loop.
    kind
        Its kind.
    physics
        In the order of `physics_coordinates`, or empty.
    """
    own = physics_coordinates(kind)
    for coordinate, each in zip(own, physics, strict=False):
        write_dynamics(owner, each, **({"coordinate": coordinate} if len(own) > 1 else {}))


def note_unheard(
    mechanism: Mechanism,
    software: str,
    heard: Collection[str] = ("damping", "friction"),
    but: Collection[str] = (),
) -> tuple[Note, ...]:
    """Note what joints of the tree do by themselves that only `load` reads from their ``<dynamics>``.

    Parameters
    ----------
    mechanism
        What is written.
    software
        Whose readers pass over it.
    heard
        Fields of `JointPhysics` that they read.
    but
        Joints whose rotor they read elsewhere.

    Returns
    -------
    tuple of Note
        One per joint, with the numbers.
    """
    notes: list[Note] = []
    for joint in mechanism.joints:
        # A joint of six freedoms is one for itself everywhere else, whatever stands in it.
        known = {
            *(heard if joint.kind is not JointKind.FLOATING else ()),
            *(("armature",) if joint.name in but else ()),
        }
        rest = replace(joint.physics, **{key: getattr(NO_PHYSICS, key) for key in known})
        if rest:
            text = f"{rest}: in attributes of <dynamics> that {software} passes over"
            notes.append(Note(f"joint '{joint.name}'", text, Outcome.KEPT))
    return tuple(notes)


def note_lost_physics(mechanism: Mechanism, format: str) -> tuple[Note, ...]:
    """Note what loops do by themselves, which a format leaves out.

    Parameters
    ----------
    mechanism
        What is written.
    format
        Named in the notes.

    Returns
    -------
    tuple of Note
        One per coordinate that does something, with the numbers.
    """
    return tuple(
        Note(f"loop '{loop.name}'", f"{physics} of its {name} left out: '{format}' has no word for it")
        for loop in mechanism.loops
        for name, physics in zip(physics_coordinates(loop.kind), loop.physics, strict=False)
        if physics
    )
