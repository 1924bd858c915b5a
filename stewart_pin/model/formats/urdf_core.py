"""The core of URDF: links, joints with their limits, platform and home.

Joints of several freedoms become rows of one-freedom joints. Platform and home are written as in SRDF: ``<end_effector
name="platform">`` and ``<group_state name="home">``.

References
----------
.. [1] ROS wiki, "urdf/XML/link", "urdf/XML/joint" and "srdf".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.model.description import (
    Bounds,
    Joint,
    JointKind,
    Link,
    Outcome,
    loop_coordinates,
    physics_coordinates,
)
from stewart_pin.model.formats.dialect import Parts
from stewart_pin.model.formats.dynamics import DYNAMICS, SPREAD, physics_of, with_gazebo_spring
from stewart_pin.model.formats.precision import moved_by_digits, within_digits
from stewart_pin.model.formats.urdf_elements import (
    BOTH_SIDES,
    CONES,
    LIMITS,
    SHAPE_TAGS,
    UrdfElements,
    read_shapes,
)
from stewart_pin.model.formats.xml import INERTIA_ENTRIES, MIRRORED, UNLIMITED, shown_tag
from stewart_pin.model.joint_physics import NO_PHYSICS, JointPhysics
from stewart_pin.model.unfolding import Unfolded, unfold_cylindrical, unfold_planar, unfold_universal
from stewart_pin.typing import FloatArray

JOINT_TYPES = {
    "fixed": JointKind.FIXED,
    "revolute": JointKind.REVOLUTE,
    "continuous": JointKind.REVOLUTE,
    "prismatic": JointKind.PRISMATIC,
    "floating": JointKind.FLOATING,
    "spherical": JointKind.SPHERICAL,
    "ball": JointKind.SPHERICAL,
    "planar": JointKind.PLANAR,
    "cylindrical": JointKind.CYLINDRICAL,
    "universal": JointKind.UNIVERSAL,
}
"""What the types of ``<joint>`` mean; URDF itself has neither spherical nor cylindrical nor universal joints."""

_UNFOLDED = (JointKind.PLANAR, JointKind.CYLINDRICAL, JointKind.UNIVERSAL)


def read_link(reader: UrdfElements, element: etree._Element) -> Parts:
    """Read a ``<link>`` with its ``<inertial>`` and its shapes.

    Parameters
    ----------
    reader
        Reader of the file.
    element
        The link.

    Returns
    -------
    Parts
        One link.
    """
    name = reader.text(element, "name", "a <link>")
    owner = f"link '{name}'"
    inertial = reader.optional(element, "inertial", owner)
    inertia = None if inertial is None else _inertia(reader, inertial, owner)
    visuals, collisions = (read_shapes(reader, element, tag, owner) for tag in SHAPE_TAGS)
    return Parts(links=(Link(name, inertia, visuals, collisions),))


def _inertia(reader: UrdfElements, inertial: etree._Element, owner: str) -> pin.Inertia:
    mass_element, entries = reader.child(inertial, "mass", owner), reader.child(inertial, "inertia", owner)
    mass = float(reader.numbers(mass_element, "value", 1, owner)[0])
    names = [key for key in (*INERTIA_ENTRIES, *MIRRORED) if key in entries.attrib]
    found = {key: float(reader.numbers(entries, key, 1, owner)[0]) for key in names}
    found, told = reader.whole_inertia(found, entries.sourceline, owner)
    for text in told:
        reader.note(owner, text, Outcome.CHANGED)
    matrix = np.empty((3, 3))
    for key, (i, j) in INERTIA_ENTRIES.items():
        if key not in found:
            reader.text(entries, key, owner)  # says that it is missing
        matrix[i, j] = matrix[j, i] = found[key]
    matrix, moved = within_digits(matrix, (entries.get(key, "") for key in names))
    if moved:
        reader.note(owner, moved_by_digits(moved), Outcome.CHANGED)
    placement = reader.origin(inertial, owner)
    turned = placement.rotation @ matrix @ placement.rotation.T
    if mass == 0 and not turned.any():
        reader.note(owner, "has an <inertial> of zero: a body without mass", Outcome.KEPT)
    # Set afterwards: the constructor refuses negative moments with an error that names nothing.
    inertia = pin.Inertia(mass, placement.translation, np.zeros((3, 3)))
    inertia.inertia = (turned + turned.T) / 2
    return inertia


def read_joint(reader: UrdfElements, element: etree._Element) -> Parts:
    """Read a ``<joint>``.

    Parameters
    ----------
    reader
        Reader of the file.
    element
        The joint.

    Returns
    -------
    Parts
        One joint, or the row that stands for it.
    """
    name = reader.text(element, "name", "a <joint>")
    owner = f"joint '{name}'"
    written = reader.text(element, "type", owner)
    if written not in JOINT_TYPES:
        raise reader.error(
            f"{owner} has the type '{written}'; supported: {', '.join(sorted(JOINT_TYPES))}", owner
        )
    kind = JOINT_TYPES[written]
    ends = reader.ends(element, owner)
    placement, independent = reader.origin(element, owner), reader.flag(element, "independent", owner)
    if kind not in _UNFOLDED:
        (physics,) = read_dynamics(reader, element, kind, owner)
        joint = Joint(name, kind, *ends, placement, independent=independent, physics=physics)
        return Parts(joints=(_with_axis(reader, element, joint),))
    if independent:
        raise reader.error(f"{owner} is marked independent; a motor drives one freedom", owner)
    return Parts.of(_unfold(reader, element, name, kind, ends, placement))


def joint_tags(element: etree._Element) -> tuple[str, ...]:
    """List the children of a ``<joint>`` that `read_joint` reads.

    Parameters
    ----------
    element
        The joint.

    Returns
    -------
    tuple of str
        Tags.
    """
    universal = JOINT_TYPES.get(element.get("type", "")) is JointKind.UNIVERSAL
    return ("parent", "child", "origin", "axis", "limit", "dynamics", *(("axis2",) if universal else ()))


def _with_axis(reader: UrdfElements, element: etree._Element, joint: Joint) -> Joint:
    """Add axis and limits."""
    # Exporters write <axis xyz="0 0 0"> and limits into fixed joints; only one-freedom joints have them.
    owner = f"joint '{joint.name}'"
    if joint.kind is JointKind.FLOATING and element.find("limit") is not None:
        reader.note(owner, "<limit>: which freedom of a floating joint it limits is not said")
    if joint.kind is JointKind.SPHERICAL:
        cones = _cones(reader, element, owner)
        if "swing" in cones:  # of this axis
            return replace(joint, axis=reader.axis(element, owner, "axis", "0 0 1"), **cones)
        joint = replace(joint, **cones)
    if not joint.has_axis:
        if joint.kind is not JointKind.FIXED and element.find("axis") is not None:
            reader.note(owner, f"<axis>: a {joint.kind} joint has none, but for that of a swing")
        return joint
    axis = reader.axis(element, owner, "axis", "1 0 0")
    physics, spring = joint.physics, reader.gazebo_springs.get(joint.name)
    if spring:
        physics = with_gazebo_spring(reader, physics, spring, owner)
    limits = _limits(reader, element, owner, element.get("type", ""))
    return replace(joint, axis=axis, physics=physics, **limits)


def _unfold(
    reader: UrdfElements,
    element: etree._Element,
    name: str,
    kind: JointKind,
    ends: tuple[str, str],
    placement: pin.SE3,
) -> Unfolded:
    owner = f"joint '{name}'"
    if reader.optional(element, "limit", owner) is not None:
        reader.note(owner, f"<limit>: which freedom of a {kind} joint it limits is not said")
    physics = read_dynamics(reader, element, kind, owner)
    if kind is JointKind.UNIVERSAL:
        axes = [reader.axis(element, owner, tag, "") for tag in ("axis", "axis2")]
        return unfold_universal(name, *ends, placement, *axes).doing(physics)
    axis = reader.axis(element, owner, "axis", "1 0 0")
    unfold = unfold_planar if kind is JointKind.PLANAR else unfold_cylindrical
    return unfold(name, *ends, placement, axis).doing(physics)


def _cones(reader: UrdfElements, joint: etree._Element, owner: str) -> dict[str, float]:
    """Read how far a ball may swing and turn."""
    element = reader.optional(joint, "limit", owner)
    return {} if element is None else _numbers(reader, element, owner, CONES)


def read_limit(
    reader: UrdfElements, element: etree._Element, owner: str
) -> dict[str, float | tuple[float, float]]:
    """Read the numbers of a ``<limit>``.

    Effort, velocity, acceleration and jerk hold to both sides; ``least_effort`` and the like give another least value.

    Parameters
    ----------
    reader
        Reader of the file.
    element
        The limit.
    owner
        Joint or loop that holds it.

    Returns
    -------
    dict
        By the fields of `Joint`; what is absent, or so large that it means none, is infinite or missing [m, rad, N, N m
        and their rates].
    """
    limits = _numbers(reader, element, owner, LIMITS)
    if "deceleration" in limits:
        # Which end of an acceleration brakes changes with the direction of the motion.
        braking = limits.pop("deceleration")
        if braking != limits.get("acceleration"):
            least = min(braking, limits.get("acceleration", np.inf))
            text = f"<limit deceleration>: accelerations are limited alike to both sides, to {least:g}"
            reader.note(owner, text, Outcome.CHANGED)
            limits["acceleration"] = least
    empty = [key for key in BOTH_SIDES if limits.get(key) == 0.0 and f"least_{key}" not in limits]
    if empty:
        # What exporters write for what they were not told; a joint that may do nothing would be fixed.
        reader.note(owner, f"<limit {', '.join(empty)}> of 0: taken for not stated", Outcome.CHANGED)
        limits = {key: value for key, value in limits.items() if key not in empty}
    found: dict[str, float | tuple[float, float]] = dict(limits)
    for key in BOTH_SIDES:
        if f"least_{key}" in limits:
            least, most = limits[f"least_{key}"], limits.get(key, np.inf)
            found[key] = most if least == -most else (least, most)
            del found[f"least_{key}"]
    return found


def read_bounds(
    reader: UrdfElements, element: etree._Element, owner: str, kind: JointKind
) -> tuple[Bounds, ...]:
    """Read the limits of a joint that closes a loop: one ``<limit>`` for each coordinate, which names it.

    Parameters
    ----------
    reader
        Reader of the file.
    element
        The loop.
    owner
        Its name, for messages.
    kind
        Kind of the loop; a joint of one coordinate need not name it.

    Returns
    -------
    tuple of Bounds
        In the order of `loop_coordinates`; empty where nothing is stated.
    """
    own = loop_coordinates(kind)
    found: dict[str, Bounds] = {}
    for limit in element.findall("limit"):
        coordinate = limit.attrib.pop("coordinate", own[0] if len(own) == 1 else "")
        if coordinate not in own or coordinate in found:
            reader.note(owner, f"<limit>: which freedom of a {kind} joint it limits is not said")
            continue
        numbers = read_limit(reader, limit, owner)
        numbers.pop("effort", None)  # no motor drives it
        ends = {"lower": -np.inf, "upper": np.inf}
        lower, upper = (_one(numbers.pop(key, default)) for key, default in ends.items())
        spans = {
            key: value if isinstance(value, tuple) else (-value, value) for key, value in numbers.items()
        }
        found[coordinate] = Bounds(position=(lower, upper), **spans)
    return tuple(found.get(coordinate, Bounds()) for coordinate in own) if found else ()


def _one(value: float | tuple[float, float]) -> float:
    return value[1] if isinstance(value, tuple) else value


def _numbers(
    reader: UrdfElements, element: etree._Element, owner: str, keys: tuple[str, ...]
) -> dict[str, float]:
    for name in element.attrib:
        if name not in keys and name in (*LIMITS, *CONES):
            reader.note(owner, f"attribute '{name}' of <limit>: a joint of its type has none")
    for child in element.iterchildren(etree.Element):
        reader.ignore(child, owner)
    limits = {key: float(reader.numbers(element, key, 1, owner)[0]) for key in keys if key in element.attrib}
    return {
        key: float(np.copysign(np.inf, value)) if abs(value) >= UNLIMITED else value
        for key, value in limits.items()
    }


def _limits(
    reader: UrdfElements, joint: etree._Element, owner: str, written: str
) -> dict[str, float | tuple[float, float]]:
    """Read the limits of a one-freedom joint; what is absent is unlimited."""
    element = reader.optional(joint, "limit", owner)
    if element is None:
        return {}
    limits = read_limit(reader, element, owner)
    range_given = limits.keys() & {"lower", "upper"}
    if written == "continuous" and range_given:
        reader.note(owner, "<limit lower, upper>: the joint is continuous")
        limits = {key: value for key, value in limits.items() if key not in range_given}
    elif written != "continuous" and len(range_given) < 2:
        reader.note(
            owner,
            "<limit> without lower or upper: no such limit, where other readers assume 0",
            Outcome.KEPT,
        )
    return limits


def read_dynamics(
    reader: UrdfElements, joint: etree._Element, kind: JointKind, owner: str
) -> tuple[JointPhysics, ...]:
    """Read the ``<dynamics>`` of a joint of the tree.

    Parameters
    ----------
    reader
        Reader of the file.
    joint
        The joint.
    kind
        Its kind; one of several freedoms may tell of all alike by one number, or of each.
    owner
        Its name, for messages.

    Returns
    -------
    tuple of JointPhysics
        One per freedom of a joint that is unfolded, in the order of its rows; of any other joint one.
    """
    element = reader.optional(joint, "dynamics", owner)
    names = () if kind is JointKind.SPHERICAL else physics_coordinates(kind)
    count = max(1, len(names))
    if element is None:
        return (NO_PHYSICS,) * count
    if kind is JointKind.FIXED:
        reader.note(owner, "<dynamics>: a joint that does not move has none")
        return (NO_PHYSICS,)
    if kind is JointKind.FLOATING:
        _note_alike(reader, owner, "six coordinates")
    return _of_each(reader, element, owner, kind, count)


def _of_each(
    reader: UrdfElements, element: etree._Element, owner: str, kind: JointKind, count: int
) -> tuple[JointPhysics, ...]:
    told: dict[str, FloatArray] = {}
    for key in DYNAMICS:
        if key in element.attrib:
            where = f"{owner}: <dynamics {key}> (line {element.sourceline})"
            told[key] = reader.parse(reader.text(element, key, owner), None, where, owner)
            if key not in SPREAD and count > 1:
                raise reader.error(
                    f"{where}: along which coordinate of a {kind} joint is not said; write a joint for each",
                    owner,
                )
            if key != "stiffness" and len(told[key]) not in (1, count):
                wanted = f"one number, or {count}" if count > 1 else "one number"
                raise reader.error(f"{where} must hold {wanted}, got {len(told[key])}", owner)
    if any(len(values) == 1 for values in told.values()) and count > 1:
        _note_alike(reader, owner, f"{count} coordinates")
    return tuple(
        physics_of(
            reader,
            element,
            {
                key: values if count == 1 else np.resize(values, count)[k : k + 1]
                for key, values in told.items()
            },
            owner,
        )
        for k in range(count)
    )


def _note_alike(reader: UrdfElements, owner: str, coordinates: str) -> None:
    reader.note(owner, f"<dynamics>: one number tells of its {coordinates} alike", Outcome.KEPT)


def read_loop_dynamics(
    reader: UrdfElements, element: etree._Element, owner: str, kind: JointKind
) -> tuple[JointPhysics, ...]:
    """Read what a joint that closes a loop does by itself: one ``<dynamics>`` for each coordinate, which names it.

    Parameters
    ----------
    reader
        Reader of the file.
    element
        The loop.
    owner
        Its name, for messages.
    kind
        Kind of the loop; a joint of one coordinate need not name it, and one of several tells without a name of all.

    Returns
    -------
    tuple of JointPhysics
        In the order of `physics_coordinates`; empty where nothing is told.
    """
    own = physics_coordinates(kind)
    elements = [each for each in element.iterchildren(etree.Element) if shown_tag(each) == "dynamics"]
    found: dict[str, JointPhysics] = {}
    for each in elements:
        if not own:
            reader.note(owner, f"<dynamics>: a {kind} joint that closes a loop has no coordinate")
            continue
        coordinate = each.get("coordinate", own[0] if len(own) == 1 else "")
        names = (coordinate,) if coordinate else own
        if not set(names) <= set(own) or set(names) & found.keys():
            raise reader.error(
                f"{owner}: <dynamics coordinate='{coordinate}'> (line {each.sourceline}): a {kind} joint has "
                f"{', '.join(own)}, each once",
                owner,
            )
        found |= zip(names, _of_each(reader, each, owner, kind, len(names)), strict=True)
    return tuple(found.get(coordinate, NO_PHYSICS) for coordinate in own) if any(found.values()) else ()


def read_platform(reader: UrdfElements, links: tuple[Link, ...]) -> str | None:
    """Find the platform that a file names.

    Parameters
    ----------
    reader
        Reader of the file.
    links
        Links of the file.

    Returns
    -------
    str or None
        Parent link of the end effector 'platform', else the link of that name, if any.
    """
    found: list[str] = []
    for element in reader.root.findall("end_effector"):
        if element.get("name") == "platform":
            found.append(reader.text(element, "parent_link", "end_effector 'platform'"))
        else:
            reader.ignore(element, "the file")
    if len(found) > 1:
        raise reader.error(f"{len(found)} <end_effector name='platform'>; keep one", "end_effector")
    found += [link.name for link in links if link.name == "platform"]
    return found[0] if found else None


def read_home(reader: UrdfElements) -> Mapping[str, FloatArray]:
    """Read the home configuration.

    Parameters
    ----------
    reader
        Reader of the file.

    Returns
    -------
    dict
        Joint values [m, rad, quaternion].
    """
    home: dict[str, FloatArray] = {}
    states = [element for element in reader.root.findall("group_state") if element.get("name") == "home"]
    for element in reader.root.findall("group_state"):
        if element not in states:
            reader.ignore(element, "the file")
    if len(states) > 1:
        raise reader.error(f"{len(states)} <group_state name='home'>; keep one", "home")
    for state in states:
        for element in state:
            name = reader.text(element, "name", "group_state 'home'")
            owner = f"joint '{name}' of group_state 'home'"
            if name in home:
                raise reader.error(f"{owner} stands there twice; keep one", owner)
            home[name] = reader.parse(reader.text(element, "value", owner), None, owner, owner)
    return home


def read_assembled(reader: UrdfElements) -> bool:
    """Read whether home stays where the file has it, whatever the limits say, as `save` notes it.

    Parameters
    ----------
    reader
        Reader of the file.

    Returns
    -------
    bool
        Attribute ``assembled`` of the home configuration.
    """
    homes = [element for element in reader.root.findall("group_state") if element.get("name") == "home"]
    return any(reader.flag(element, "assembled", "group_state 'home'") for element in homes)


def read_gravity(reader: UrdfElements) -> tuple[float, float, float] | None:
    """Read the acceleration of free fall, which `save` adds where it is not the usual one.

    Parameters
    ----------
    reader
        Reader of the file.

    Returns
    -------
    tuple of float or None
        In the world frame [m/s²]; None: the file does not say.
    """
    element = reader.optional(reader.root, "gravity", "the file")
    if element is None:
        return None
    x, y, z = map(float, reader.numbers(element, "xyz", 3, "<gravity>"))
    return x, y, z


def read_odd_inertias(reader: UrdfElements, links: tuple[Link, ...]) -> frozenset[str]:
    """Read which links keep an inertia that no real body has, as `save` notes them.

    Parameters
    ----------
    reader
        Reader of the file.
    links
        Links of the file.

    Returns
    -------
    frozenset of str
        Their names.
    """
    odd: set[str] = set()
    for element in reader.root.findall("odd_inertia"):
        name = reader.text(element, "link", "<odd_inertia>")
        if name not in [link.name for link in links]:
            raise reader.error(
                f"<odd_inertia> (line {element.sourceline}) names the missing link '{name}'; correct the name",
                name,
            )
        reader.note(
            f"link '{name}'", "<odd_inertia>: its inertia is kept, which no real body has", Outcome.KEPT
        )
        odd.add(name)
    return frozenset(odd)
