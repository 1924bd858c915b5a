"""The tree of a mechanism as URDF elements, for the writers of all dialects."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.geometry.hexapod import STANDARD_GRAVITY
from stewart_pin.model.description import Bounds, Joint, JointKind, Link, Mechanism, Note
from stewart_pin.model.formats.side_cars import COMPLETE, find_beside
from stewart_pin.model.formats.urdf_elements import INERTIA_ENTRIES
from stewart_pin.model.formats.urdf_placements import write_origin
from stewart_pin.model.formats.urdf_shape_writer import UrdfShapes
from stewart_pin.model.formats.xml import UNLIMITED, number_text


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


def save(robot: etree._Element, mechanism: Mechanism, path: Path, *, has_side_car: bool = False) -> None:
    """Add platform, home, unusual gravity and names of odd inertias to a robot, and write the file.

    Parameters
    ----------
    robot
        The ``<robot>``, with its loops.
    mechanism
        What it describes.
    path
        File to create or overwrite.
    has_side_car
        Whether a file beside it is to declare its loops; one that lies there already is passed by otherwise.
    """
    if not has_side_car and find_beside(path) is not None:
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
    path.write_bytes(etree.tostring(robot, pretty_print=True, xml_declaration=True, encoding="utf-8"))


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


def _write_joint(robot: etree._Element, joint: Joint) -> None:
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
        _write_stated(element, {"swing": joint.swing, "turn": joint.turn})
    if not joint.has_axis:
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
    finite = {key: number_text([value]) for key, value in limits.items() if np.isfinite(value)}
    if finite:
        etree.SubElement(owner, "limit", {**attributes, **finite})
