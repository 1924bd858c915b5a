"""The tree of a mechanism as URDF elements, placements and shapes included, for the writers of all dialects."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TypeGuard

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.geometry.hexapod import STANDARD_GRAVITY
from stewart_pin.geometry.rotations import rpy_from_rotation
from stewart_pin.model.description import (
    Bounds,
    Joint,
    JointKind,
    Link,
    Mechanism,
    Note,
    Outcome,
    unknown_kind,
)
from stewart_pin.model.formats.dialect import COMPLETE, find_beside, write_files
from stewart_pin.model.formats.dynamics import write_dynamics
from stewart_pin.model.formats.urdf_elements import SIZE_ATTRIBUTES
from stewart_pin.model.formats.xml import INERTIA_ENTRIES, UNLIMITED, number_text
from stewart_pin.model.shapes import Material, MaterialNames, Shape, ShapeKind, path_from, rounded_as_three

# ----------------------------------------------------------------------------------------------------
# Placements as URDF has them, for the writers of all dialects
# ----------------------------------------------------------------------------------------------------


def write_origin(element: etree._Element, placement: pin.SE3) -> None:
    """Write a placement as ``<origin>``, unless it is the identity.

    Parameters
    ----------
    element
        Where to put it.
    placement
        The placement.
    """
    attributes = pose_attributes(placement)
    if attributes:
        etree.SubElement(element, "origin", attributes)


def pose_attributes(placement: pin.SE3) -> dict[str, str]:
    """Print a placement as the attributes ``xyz`` and ``rpy``.

    Parameters
    ----------
    placement
        The placement.

    Returns
    -------
    dict
        Without ``rpy`` where nothing is turned; empty for the identity.
    """
    rpy = rpy_from_rotation(placement.rotation)
    turned = {"rpy": number_text(rpy)} if rpy.any() else {}
    moved = {"xyz": number_text(placement.translation)} if turned or placement.translation.any() else {}
    return moved | turned


# ----------------------------------------------------------------------------------------------------
# Shapes of links as ``<visual>``, ``<collision>`` and ``<material>`` of a URDF
# ----------------------------------------------------------------------------------------------------


class UrdfShapes:
    """Writes the shapes of one file.

    Parameters
    ----------
    folder
        Folder of the file: meshes and textures are named as seen from there.

    Attributes
    ----------
    notes
        What URDF has no word for.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.notes: list[Note] = []
        self.materials = MaterialNames()

    def write(self, element: etree._Element, link: Link) -> None:
        """Write the shapes of a link.

        Parameters
        ----------
        element
            The ``<link>``.
        link
            What it describes.
        """
        for tag, shapes in (("visual", link.visuals), ("collision", link.collisions)):
            for shape in shapes:
                self._write(element, tag, shape, f"link '{link.name}'")

    def write_materials(self, robot: etree._Element) -> None:
        """Write what the shapes are made of, before all links.

        Parameters
        ----------
        robot
            The ``<robot>``, with its links.
        """
        for number, (name, material) in enumerate(self.materials.named.items()):
            element = etree.Element("material", name=name)
            if material.rgba is not None:
                etree.SubElement(element, "color", rgba=number_text(material.rgba))
            if material.texture:
                picture = path_from(self.folder, material.texture, material.folder)
                etree.SubElement(element, "texture", filename=picture)
            robot.insert(number, element)

    def _write(self, link: etree._Element, tag: str, shape: Shape, owner: str) -> None:
        match shape.kind:
            case ShapeKind.CAPSULE:
                text = f"{tag}: URDF has no capsules; written as a cylinder and two balls"
                self.notes.append(Note(owner, text, Outcome.CHANGED))
                for part in rounded_as_three(shape):
                    if all(part.sizes):
                        self._write(link, tag, part, owner)
            case ShapeKind.ELLIPSOID:
                self.notes.append(Note(owner, f"{tag}: URDF has no ellipsoids; left out"))
            case _:
                self._element(link, tag, shape)

    def _element(self, link: etree._Element, tag: str, shape: Shape) -> None:
        element = etree.SubElement(link, tag, {"name": shape.name} if shape.name else {})
        write_origin(element, shape.placement)
        geometry = etree.SubElement(element, "geometry")
        if shape.kind is ShapeKind.MESH:
            mesh = etree.SubElement(
                geometry, "mesh", filename=path_from(self.folder, shape.mesh, shape.folder)
            )
            if any(size != 1 for size in shape.sizes):
                mesh.set("scale", number_text(shape.sizes))
        else:
            attributes = SIZE_ATTRIBUTES[shape.kind]
            values = [shape.sizes] if len(attributes) == 1 else [[size] for size in shape.sizes]
            texts = (number_text(value) for value in values)
            etree.SubElement(geometry, str(shape.kind), dict(zip(attributes, texts, strict=True)))
        if tag == "visual" and _says_something(shape.material):
            etree.SubElement(element, "material", name=self.materials.name(shape.material))


def _says_something(material: Material | None) -> TypeGuard[Material]:
    return material is not None and bool(material.name or material.texture or material.rgba)


# ----------------------------------------------------------------------------------------------------


def tree_element(
    mechanism: Mechanism, path: Path, nsmap: dict[str, str] | None = None
) -> tuple[etree._Element, tuple[Note, ...]]:
    """Write links with their shapes, and joints.

    Parameters
    ----------
    mechanism
        What to write.
    path
        File that is to be written: meshes are named as seen from its folder.
    nsmap
        Namespaces that the dialect's tags need.

    Returns
    -------
    robot : lxml.etree._Element
        The ``<robot>``, without loops.
    notes : tuple of Note
        What URDF has no word for, and what was put in its place.
    """
    robot = etree.Element("robot", {"name": mechanism.name}, nsmap)
    shapes = UrdfShapes(path.resolve().parent)
    for link in mechanism.links:
        _write_link(robot, link)
        shapes.write(robot[-1], link)
    for joint in mechanism.joints:
        _write_joint(robot, joint)
    shapes.write_materials(robot)
    return robot, tuple(shapes.notes)


def save(
    robot: etree._Element, mechanism: Mechanism, path: Path, *, side_car: Mapping[Path, str] | None = None
) -> tuple[Note, ...]:
    """Add platform, home, unusual gravity and names of odd inertias to a robot, and write the file.

    Parameters
    ----------
    robot
        The ``<robot>``, with its loops.
    mechanism
        What it describes.
    path
        File to create or overwrite.
    side_car
        Text of the file beside it that declares its loops; None: there is none, and one that lies there already is
        passed by.

    Returns
    -------
    tuple of Note
        Which files lie there that declare loops as well.
    """
    stale = [each for each in find_beside(path) if each not in (side_car or {})]
    passed_by = "load passes it by, other software may not" if side_car is None else "load refuses two"
    text = f"declares loops of another file; {passed_by}: remove it"
    notes = tuple(Note(f"file '{each.name}' beside it", text) for each in stale)
    if stale and side_car is None:
        robot.set(*COMPLETE)
    if mechanism.platform not in (None, "platform"):
        etree.SubElement(robot, "end_effector", name="platform", parent_link=mechanism.platform, group="all")
    if mechanism.home:
        state = etree.SubElement(robot, "group_state", name="home", group="all")
        if mechanism.assembled:
            state.set("assembled", "true")
        for name, values in mechanism.home.items():
            etree.SubElement(state, "joint", name=name, value=number_text(values))
    if mechanism.gravity not in (None, STANDARD_GRAVITY):
        etree.SubElement(robot, "gravity", xyz=number_text(mechanism.gravity))
    for link in mechanism.links:
        if link.name in mechanism.odd_inertias and link.inertia is not None:
            etree.SubElement(robot, "odd_inertia", link=link.name)
    # The side-car first: where only one gets there, it names frames that the old URDF lacks, which is an error.
    write_files({**(side_car or {}), path: robot})
    return notes


def _write_link(robot: etree._Element, link: Link) -> None:
    element = etree.SubElement(robot, "link", name=link.name)
    if link.inertia is None:
        return
    inertial = etree.SubElement(element, "inertial")
    write_origin(inertial, pin.SE3(np.eye(3), link.inertia.lever))
    etree.SubElement(inertial, "mass", value=number_text([link.inertia.mass]))
    matrix = link.inertia.inertia
    entries = {key: number_text([matrix[at]]) for key, at in INERTIA_ENTRIES.items()}
    etree.SubElement(inertial, "inertia", entries)


_TREE = (
    JointKind.FIXED,
    JointKind.REVOLUTE,
    JointKind.PRISMATIC,
    JointKind.FLOATING,
    JointKind.SPHERICAL,
)
"""Kinds of joints whose type, axis and limits are written."""


def _write_joint(robot: etree._Element, joint: Joint) -> None:
    if joint.kind not in _TREE:
        raise unknown_kind(f"joint '{joint.name}'", joint.kind, "the writer of URDF")
    unlimited = joint.kind is JointKind.REVOLUTE and np.isinf([joint.lower, joint.upper]).all()
    element = etree.SubElement(
        robot, "joint", name=joint.name, type="continuous" if unlimited else str(joint.kind)
    )
    if joint.independent:
        element.set("independent", "true")
    etree.SubElement(element, "parent", link=joint.parent)
    etree.SubElement(element, "child", link=joint.child)
    write_origin(element, joint.placement)
    if joint.kind is JointKind.SPHERICAL:
        if np.isfinite(joint.swing):
            etree.SubElement(element, "axis", xyz=number_text(joint.axis))
        _write_stated(element, {"swing": joint.swing, "turn": joint.turn})
    if not joint.has_axis:
        write_dynamics(element, joint.physics)
        return
    etree.SubElement(element, "axis", xyz=number_text(joint.axis))
    # URDF readers require effort and velocity, and take an absent lower or upper limit for 0.
    bounds = joint.bounds
    limits = {"effort": bounds.effort[1], "velocity": bounds.velocity[1]}
    if not unlimited:
        limits |= {"lower": joint.lower, "upper": joint.upper}
    limits |= _further(bounds)
    if not unlimited or not np.isinf(list(limits.values())).all():
        finite = {key: number_text([np.clip(value, -UNLIMITED, UNLIMITED)]) for key, value in limits.items()}
        etree.SubElement(element, "limit", finite)
    write_dynamics(element, joint.physics)


def write_bounds(owner: etree._Element, bounds: Bounds, **attributes: str) -> None:
    """Write what a coordinate of a loop may do as a ``<limit>``; nothing where nothing is stated.

    Parameters
    ----------
    owner
        Element that gets the limit.
    bounds
        Limits.
    **attributes
        Further attributes of the limit.
    """
    lower, upper = bounds.position
    limits = {"lower": lower, "upper": upper, "velocity": bounds.velocity[1]} | _further(bounds)
    _write_stated(owner, limits, **attributes)


def _further(bounds: Bounds) -> dict[str, float]:
    """Limits that URDF's four numbers do not say, in the words of `read_limit`."""
    found = {"acceleration": bounds.acceleration[1], "jerk": bounds.jerk[1]}
    found = {key: value for key, value in found.items() if np.isfinite(value)}
    for key in ("effort", "velocity", "acceleration", "jerk"):
        least, most = getattr(bounds, key)
        # A zero alone is taken for not stated.
        if least != -most or most == 0.0:
            found |= {key: most, f"least_{key}": least}
    return found


def _write_stated(owner: etree._Element, limits: dict[str, float], **attributes: str) -> None:
    def is_told(key: str) -> bool:
        # Without a least value the other would hold to both sides.
        both = limits.get(key.removeprefix("least_"), np.inf)
        return bool(np.isfinite(limits[key]) or (key.startswith("least_") and np.isfinite(both)))

    told = {
        key: number_text([np.clip(value, -UNLIMITED, UNLIMITED)])
        for key, value in limits.items()
        if is_told(key)
    }
    if told:
        etree.SubElement(owner, "limit", {**attributes, **told})
