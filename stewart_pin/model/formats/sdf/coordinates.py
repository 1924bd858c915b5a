"""What coordinates of SDFormat joints do by themselves, read and written, and the writing of what they may do.

Positions are counted as the file counts them, from where the joint is placed. Drake reads the damping of a ball from an
``<axis>`` that the ball does not have, and a rotor only where the effort may be other than zero.

References
----------
.. [1] Open Robotics, "SDFormat Specification", version 1.11, element dynamics.
.. [2] Drake documentation, "Parsing Models in MultibodyPlant", tags drake:rotor_inertia, drake:gear_ratio,
   drake:damping.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from lxml import etree

from stewart_pin.model.description import Bounds, JointKind, physics_coordinates
from stewart_pin.model.formats.dynamics import DYNAMICS, physics_of
from stewart_pin.model.formats.sdf.elements import OWN, OWN_DYNAMICS, OWN_LIMIT, SPANS, SdfReader, own
from stewart_pin.model.formats.sdf.words import DRAKE_ROTOR, WORDS
from stewart_pin.model.formats.xml import number_text
from stewart_pin.model.joint_physics import NO_PHYSICS, JointPhysics

DRAKE = "drake.mit.edu"
"""Namespace of Drake's words, as we write them."""
_OWN = ("armature", "stiffness", "rest", "force")
"""Attributes of our own namespace that ``<dynamics>`` may have."""


def counted_from(physics: JointPhysics, reading: float) -> JointPhysics:
    """Count the rest of a spring from another zero.

    Parameters
    ----------
    physics
        As one side counts.
    reading
        What the other side reads where this one reads zero [m or rad].

    Returns
    -------
    JointPhysics
        As the other side counts.
    """
    return replace(physics, rest=physics.rest + reading) if physics.pushes else physics


# ----------------------------------------------------------------------------------------------------
# Reading
# ----------------------------------------------------------------------------------------------------


def read_axis_dynamics(reader: SdfReader, axis: etree._Element, owner: str) -> JointPhysics:
    """Read the ``<dynamics>`` of an axis.

    Parameters
    ----------
    reader
        Reader of the file.
    axis
        ``<axis>`` or ``<axis2>``.
    owner
        The joint, for messages.

    Returns
    -------
    JointPhysics
        What is absent is zero; what stands in words of our own comes before what SDFormat has.
    """
    element = reader.optional(axis, "dynamics", owner)
    if element is None:
        return NO_PHYSICS
    reader.note_strangers(element, owner, WORDS["axis/dynamics"])
    told = {
        "damping": "damping",
        "friction": "friction",
        "rest": "spring_reference",
        "stiffness": "spring_stiffness",
    }
    values = {key: reader.vector(element, tag, 1, owner, "0") for key, tag in told.items()}
    if not values["stiffness"].any():
        del values["stiffness"]
    for key in _OWN:
        numbers = reader.own_numbers(element, key, owner)
        if numbers is not None:
            values[key] = _checked(reader, key, numbers, owner)
    return physics_of(reader, element, values, owner)


def read_own_dynamics(
    reader: SdfReader, element: etree._Element, coordinates: Collection[str], owner: str
) -> dict[str, JointPhysics]:
    """Read the elements of our own in which coordinates without an axis tell what they do.

    Parameters
    ----------
    reader
        Reader of the file.
    element
        Joint, or floating link.
    coordinates
        Names that it has; empty: of a link, which names none.
    owner
        Its name, for messages.

    Returns
    -------
    dict
        By the names of the coordinates; of a link by an empty name.
    """
    found: dict[str, JointPhysics] = {}
    for told in reader.children(element, OWN_DYNAMICS):
        reader.only(told, owner, WORDS[OWN_DYNAMICS].attributes)
        coordinate = told.get("coordinate", "")
        if coordinate not in (coordinates or ("",)) or coordinate in found:
            raise reader.error(
                f"{owner}: <{OWN_DYNAMICS} coordinate='{coordinate}'> (line {told.sourceline}): it has "
                f"{', '.join(coordinates) or 'none'}, each once",
                owner,
            )
        values = {
            key: _checked(reader, key, reader.parse(told.attrib[key], None, f"{owner}: {key}", owner), owner)
            for key in DYNAMICS
            if key in told.attrib
        }
        found[coordinate] = physics_of(reader, told, values, owner)
    return found


def _checked(reader: SdfReader, key: str, numbers: np.ndarray, owner: str) -> np.ndarray:
    if key != "stiffness" and len(numbers) != 1:
        raise reader.error(f"{owner}: {key} of its dynamics must hold one number, got {len(numbers)}", owner)
    return numbers


def read_free_physics(
    reader: SdfReader, element: etree._Element, kind: JointKind, owner: str, *, has_axes: bool
) -> dict[str, JointPhysics]:
    """Read what coordinates do that have no axis: those of a ball, whose damping stands where Drake looks for it.

    Parameters
    ----------
    reader
        Reader of the file.
    element
        The joint.
    kind
        What it leaves free.
    owner
        Its name, for messages.
    has_axes
        Whether its coordinates have axes.

    Returns
    -------
    dict
        By the names of `physics_coordinates`.
    """
    names = () if has_axes else physics_coordinates(kind)
    if not names and reader.children(element, OWN_DYNAMICS):
        raise reader.error(
            f"{owner} has a <{OWN_DYNAMICS}>; write into the <dynamics> of its axes, which a fixed joint lacks",
            owner,
        )
    found = read_own_dynamics(reader, element, names, owner)
    if kind is JointKind.SPHERICAL:
        damping, whole = _ball_damping(reader, element, owner), found.get("turn", NO_PHYSICS)
        if damping and whole.damping:
            raise reader.error(f"{owner} tells its damping twice; keep one", owner)
        found["turn"] = replace(whole, damping=whole.damping + damping)
    return found


def _ball_damping(reader: SdfReader, joint: etree._Element, owner: str) -> float:
    axis = reader.optional(joint, "axis", owner)
    if axis is None:
        return 0.0
    reader.note_strangers(axis, owner, WORDS["axis of a ball"])
    dynamics = reader.optional(axis, "dynamics", owner)
    if dynamics is None:
        return 0.0
    reader.note_strangers(dynamics, owner, WORDS["dynamics of a ball"])
    damping = reader.vector(dynamics, "damping", 1, owner, "0")
    return physics_of(reader, dynamics, {"damping": damping}, owner).damping


def read_planar_damping(reader: SdfReader, joint: etree._Element, owner: str) -> tuple[JointPhysics, ...]:
    """Read the damping of Drake's planar joint.

    Parameters
    ----------
    reader
        Reader of the file.
    joint
        The ``<drake:joint>``.
    owner
        Its name, for messages.

    Returns
    -------
    tuple of JointPhysics
        Along x, along y, and of the turn.
    """
    values = reader.vector(joint, "drake:damping", 3, owner, "0 0 0")
    return tuple(physics_of(reader, joint, {"damping": values[k : k + 1]}, owner) for k in range(3))


def read_rotor(reader: SdfReader, joint: etree._Element, owner: str) -> float:
    """Read the rotor that Drake's words give to a motor.

    Parameters
    ----------
    reader
        Reader of the file.
    joint
        The joint.
    owner
        Its name, for messages.

    Returns
    -------
    float
        Inertia times the square of the gear ratio [kg or kg m²].
    """
    inertia, ratio = (
        reader.number(joint, tag, owner, default) for tag, default in zip(DRAKE_ROTOR, "01", strict=True)
    )
    if inertia < 0:
        raise reader.error(f"{owner}: <{DRAKE_ROTOR[0]}> is {inertia:g}; it must be zero or more", owner)
    return inertia * ratio**2


# ----------------------------------------------------------------------------------------------------
# Writing
# ----------------------------------------------------------------------------------------------------


def write_axis_dynamics(axis: etree._Element, physics: JointPhysics) -> bool:
    """Write what a coordinate does as the ``<dynamics>`` of its axis.

    A linear spring with a preload is one that rests elsewhere. Of a polynomial others see the linear part at rest.

    Parameters
    ----------
    axis
        ``<axis>`` or ``<axis2>``.
    physics
        As the file counts.

    Returns
    -------
    bool
        Whether all of it stands in words that other readers may know.
    """
    if physics == NO_PHYSICS:
        return True
    element = etree.SubElement(axis, "dynamics")
    stiffness = physics.stiffness[0] if physics.stiffness else 0.0
    # Drake ends where a stiffness is negative.
    is_spring = stiffness > 0
    words = {"damping": physics.damping, "friction": physics.friction}
    if is_spring:
        words |= {"spring_reference": physics.rest + physics.force / stiffness, "spring_stiffness": stiffness}
    for tag, value in words.items():
        if value or tag == "spring_reference":
            etree.SubElement(element, tag).text = number_text([value])
    linear = len(physics.stiffness) == 1 and is_spring
    kept = [key for key in ("armature", "force") if getattr(physics, key)]
    kept += ["stiffness"] if physics.stiffness and not linear else []
    # Otherwise the reference of the spring is its rest.
    kept += ["rest"] if physics.force or not linear else []
    told = {
        key: np.atleast_1d(getattr(physics, key)) for key in kept if getattr(physics, key) or physics.pushes
    }
    set_own(element, **{key: number_text(numbers) for key, numbers in told.items()})
    return not physics.armature and (linear or not physics.pushes)


def write_own_dynamics(owner: etree._Element, physics: JointPhysics, coordinate: str = "") -> None:
    """Write what a coordinate without an axis does, in an element of our own.

    Parameters
    ----------
    owner
        Joint, or floating link.
    physics
        Numbers, of which those that are not zero are written.
    coordinate
        Its name; empty: of a link.
    """
    told = {
        key: number_text(np.atleast_1d(getattr(physics, key)))
        for key in DYNAMICS
        if getattr(physics, key) != getattr(NO_PHYSICS, key)
    }
    if told:
        named = {"coordinate": coordinate} if coordinate else {}
        etree.SubElement(owner, f"{{{OWN}}}{OWN_DYNAMICS.partition(':')[2]}", {**named, **told})


def write_rotor(joint: etree._Element, armature: float) -> None:
    """Write the rotor of a motor in Drake's words.

    Parameters
    ----------
    joint
        The joint.
    armature
        Inertia that counts at the joint [kg or kg m²].
    """
    for tag, value in zip(DRAKE_ROTOR, (armature, 1.0), strict=True):
        etree.SubElement(joint, f"{{{DRAKE}}}{tag.partition(':')[2]}").text = number_text([value])


def set_own(element: etree._Element, **values: str) -> None:
    """Set attributes of our own namespace.

    Parameters
    ----------
    element
        What gets them.
    **values
        By their names.
    """
    for key, value in values.items():
        element.set(own(key)[0], value)


def write_limit(axis: etree._Element, bounds: Bounds, reading: float, *, is_driven: bool) -> None:
    """Write the limits of an axis; positions count from where it is at rest.

    Simulators drive every axis that may have an effort, so that one without a motor is given none.

    Parameters
    ----------
    axis
        ``<axis>`` or ``<axis2>``.
    bounds
        Limits, as the chain counts.
    reading
        What the chain reads where the file reads zero [m or rad].
    is_driven
        Whether a motor drives the axis.
    """
    limit = etree.SubElement(axis, "limit")
    for tag, end in zip(("lower", "upper"), bounds.position, strict=True):
        etree.SubElement(limit, tag).text = _end_text(end - reading)
    words = {"effort": "effort", "velocity": "velocity", "acceleration": f"{{{DRAKE}}}acceleration"}
    for key in SPANS:
        least, most = getattr(bounds, key)
        passive = key == "effort" and not is_driven
        if passive:
            etree.SubElement(limit, key).text = "0"
        if key in words and least == -most and most >= 0.0 and not (passive and most):
            if np.isfinite(most) and not passive:
                etree.SubElement(limit, words[key]).text = number_text([most])
        elif np.isfinite([least, most]).any() or passive:
            set_own(limit, **{key: f"{_end_text(least)} {_end_text(most)}"})


def write_own_limit(element: etree._Element, coordinate: str, bounds: Bounds) -> None:
    """Write the limits of a coordinate without an axis, in an element of our own; nothing where nothing is stated.

    Parameters
    ----------
    element
        The joint.
    coordinate
        Its name.
    bounds
        Limits.
    """
    spans = {key: getattr(bounds, key) for key in ("position", *SPANS)}
    stated = {key: span for key, span in spans.items() if np.isfinite(span).any()}
    if stated:
        limit = etree.SubElement(element, f"{{{OWN}}}{OWN_LIMIT.partition(':')[2]}", coordinate=coordinate)
        set_own(limit, **{key: " ".join(map(_end_text, span)) for key, span in stated.items()})


def _end_text(value: float) -> str:
    return number_text([value]) if np.isfinite(value) else "inf" if value > 0 else "-inf"
