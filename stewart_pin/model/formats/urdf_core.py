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

from stewart_pin.model.description import Joint, JointKind, Link, Outcome
from stewart_pin.model.formats.dialect import Parts
from stewart_pin.model.formats.urdf_elements import INERTIA_ENTRIES, UrdfElements
from stewart_pin.model.formats.urdf_shapes import SHAPE_TAGS, read_shapes
from stewart_pin.model.formats.xml import UNLIMITED
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
    reader.ignore_attributes(element, owner, ("name", "type"))
    inertial = reader.optional(element, "inertial", owner)
    inertia = None if inertial is None else _inertia(reader, inertial, owner)
    visuals, collisions = (read_shapes(reader, element, tag, owner) for tag in SHAPE_TAGS)
    return Parts(links=(Link(name, inertia, visuals, collisions),))


def _inertia(reader: UrdfElements, inertial: etree._Element, owner: str) -> pin.Inertia:
    reader.only(inertial, owner, (), ("origin", "mass", "inertia"))
    mass_element, entries = reader.child(inertial, "mass", owner), reader.child(inertial, "inertia", owner)
    reader.only(mass_element, owner, ("value",))
    reader.only(entries, owner, (*INERTIA_ENTRIES, *(_swapped(key) for key in ("ixy", "ixz", "iyz"))))
    mass = float(reader.numbers(mass_element, "value", 1, owner)[0])
    matrix = np.empty((3, 3))
    for key, (i, j) in INERTIA_ENTRIES.items():
        matrix[i, j] = matrix[j, i] = reader.numbers(entries, key, 1, owner)[0]
        mirrored = _swapped(key)
        if mirrored in entries.attrib and reader.numbers(entries, mirrored, 1, owner)[0] != matrix[i, j]:
            raise reader.error(
                f"{owner}: {key} and {mirrored} of <inertia> (line {entries.sourceline}) differ; "
                f"an inertia is symmetric, remove {mirrored}",
                owner,
            )
    placement = reader.origin(inertial, owner)
    turned = placement.rotation @ matrix @ placement.rotation.T
    if mass == 0 and not turned.any():
        reader.note(owner, "has an <inertial> of zero: a body without mass", Outcome.KEPT)
    # Set afterwards: the constructor refuses negative moments with an error that names nothing.
    inertia = pin.Inertia(mass, placement.translation, np.zeros((3, 3)))
    inertia.inertia = (turned + turned.T) / 2
    return inertia


def _swapped(key: str) -> str:
    """Name the entry on the other side of the diagonal: iyx for ixy."""
    return f"i{key[2]}{key[1]}"


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
    reader.ignore_attributes(element, owner, ("name", "type", "independent"))
    ends = reader.ends(element, owner)
    placement, independent = reader.origin(element, owner), reader.flag(element, "independent", owner)
    if kind not in _UNFOLDED:
        joint = Joint(name, kind, *ends, placement, independent=independent)
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
    return ("parent", "child", "origin", "axis", "limit", *(("axis2",) if universal else ()))


def _with_axis(reader: UrdfElements, element: etree._Element, joint: Joint) -> Joint:
    """Add axis and limits."""
    # Exporters write <axis xyz="0 0 0"> and limits into fixed joints; only one-freedom joints have them.
    if not joint.has_axis:
        return joint
    owner = f"joint '{joint.name}'"
    axis = reader.axis(element, owner, "axis", "1 0 0")
    return replace(joint, axis=axis, **_limits(reader, element, owner, element.get("type", "")))


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
    if kind is JointKind.UNIVERSAL:
        axes = [reader.axis(element, owner, tag, "") for tag in ("axis", "axis2")]
        return unfold_universal(name, *ends, placement, *axes)
    axis = reader.axis(element, owner, "axis", "1 0 0")
    unfold = unfold_planar if kind is JointKind.PLANAR else unfold_cylindrical
    return unfold(name, *ends, placement, axis)


def _limits(reader: UrdfElements, joint: etree._Element, owner: str, written: str) -> dict[str, float]:
    """Read the limits of a one-freedom joint; what is absent is unlimited."""
    element = reader.optional(joint, "limit", owner)
    if element is None:
        return {}
    keys = ("lower", "upper", "effort", "velocity")
    reader.ignore_attributes(element, owner, keys)
    for child in element.iterchildren(etree.Element):
        reader.ignore(child, owner)
    limits = {key: float(reader.numbers(element, key, 1, owner)[0]) for key in keys if key in element.attrib}
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
    empty = [key for key in ("effort", "velocity") if limits.get(key) == 0.0]
    if empty:
        # What exporters write for what they were not told; a joint that may do nothing would be fixed.
        reader.note(owner, f"<limit {', '.join(empty)}> of 0: taken for not stated", Outcome.CHANGED)
        limits = {key: value for key, value in limits.items() if key not in empty}
    return {
        key: float(np.copysign(np.inf, value)) if abs(value) >= UNLIMITED else value
        for key, value in limits.items()
    }


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
        reader.only(state, "group_state 'home'", ("name", "group", "assembled"), ("joint",))
        for element in state:
            name = reader.text(element, "name", "group_state 'home'")
            owner = f"joint '{name}' of group_state 'home'"
            if name in home:
                raise reader.error(f"{owner} stands there twice; keep one", owner)
            reader.only(element, owner, ("name", "value"))
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
    reader.only(element, "<gravity>", ("xyz",))
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
        reader.only(element, "<odd_inertia>", ("link",))
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
