"""URDF with loops inside, in the URDF+ dialect, read and written.

Loops are ``<loop name type>`` with ``<predecessor link>`` and ``<successor link>``, each with its ``<origin>``, and
an ``<axis>``; motors are joints with ``independent="true"``; the home configuration is a ``<group_state
name="home">`` as in SRDF. Readers that know none of this see the spanning tree.

References
----------
.. [1] M. Chignoli et al., "URDF+: An Enhanced URDF for Robots with Kinematic Loops", 2024.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.geometry.rotations import rotation_from_rpy, rpy_from_rotation
from stewart_pin.model.description import LOOP_KINDS, Joint, JointKind, Link, Loop, Mechanism, Note
from stewart_pin.model.formats.xml import ElementReader, number_text, read_xml
from stewart_pin.typing import FloatArray

_JOINT_TYPES = {
    "fixed": JointKind.FIXED,
    "revolute": JointKind.REVOLUTE,
    "continuous": JointKind.REVOLUTE,
    "prismatic": JointKind.PRISMATIC,
    "floating": JointKind.FLOATING,
    "spherical": JointKind.SPHERICAL,
    "ball": JointKind.SPHERICAL,
}
_KNOWN = {"link", "joint", "loop", "group_state"}
_IGNORED = {
    "material": "colours are for viewers",
    "transmission": "motors are the joints marked independent",
    "gazebo": "simulator settings",
    "sensor": "sensors",
    "mujoco": "simulator settings",
    "group": "semantic groups",
    "disable_collisions": "collision settings",
}
_IGNORED_IN_LINK = {"visual": "for viewers", "collision": "collision shapes", "material": "for viewers"}
_LOOP_WORDS = ("loop", "constraint", "closure", "closing", "coupling", "connect", "weld", "joint")
DIALECTS = "URDF+ (<loop>)"
"""Loop syntaxes that `load` understands."""


def read_urdf(path: Path) -> Mechanism:
    """Read a URDF with or without loops.

    Parameters
    ----------
    path
        File to read.

    Returns
    -------
    Mechanism
        Description, not yet validated.

    Raises
    ------
    FileFormatError
        If the file is broken, or holds a tag that could mean a loop in a dialect that is not understood.
    """
    return _UrdfReader(path).read()


class _UrdfReader(ElementReader):
    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.root = read_xml(path)
        self.notes: list[Note] = []

    def read(self) -> Mechanism:
        if self.root.tag != "robot":
            raise self.error(f"the root element is <{self.root.tag}>, a URDF has <robot>", str(self.root.tag))
        self._refuse_foreign_loops()
        joints = tuple(self._joint(element) for element in self.root.findall("joint"))
        links = tuple(self._link(element) for element in self.root.findall("link"))
        return Mechanism(
            name=self.root.get("name", Path(self.path).stem),
            links=links,
            joints=joints,
            loops=tuple(self._loop(element) for element in self.root.findall("loop")),
            platform=next((link.name for link in links if link.name == "platform"), None),
            home=self._home(),
            source=self.path,
            notes=tuple(self.notes),
        )

    def _refuse_foreign_loops(self) -> None:
        """Stop at every tag that could close a loop and would otherwise be dropped; note the other strangers."""
        strangers: dict[str, int] = {}
        for element in self.root.iterchildren(etree.Element):
            tag = str(element.tag).replace("{", "").replace("}", ":")
            if tag in _KNOWN:
                continue
            local = tag.rsplit(":", 1)[-1].lower()
            nested = element.find(".//joint") if tag == "gazebo" else None
            if nested is not None or any(word in local for word in _LOOP_WORDS):
                shown = "<gazebo><joint>" if nested is not None else f"<{tag}>"
                raise self.error(
                    f"{shown} (line {element.sourceline}) could close a loop, and is not understood; "
                    f"supported: {DIALECTS}",
                    shown,
                )
            strangers[tag] = strangers.get(tag, 0) + 1
        for tag, count in strangers.items():
            reason = _IGNORED.get(tag, "unknown tag")
            self.notes.append(Note(f"<{tag}>", f"{count} ignored: {reason}"))

    def _link(self, element: etree._Element) -> Link:
        name = self.text(element, "name", "a <link>")
        owner = f"link '{name}'"
        for child in element.iterchildren(etree.Element):
            if child.tag != "inertial":
                self._ignore(child, owner, _IGNORED_IN_LINK)
        if element.find("inertial") is None:
            return Link(name)
        inertial = self.child(element, "inertial", owner)
        mass = self.numbers(self.child(inertial, "mass", owner), "value", 1, owner)[0]
        entries = self.child(inertial, "inertia", owner)
        xx, xy, xz, yy, yz, zz = (
            self.numbers(entries, key, 1, owner)[0] for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        )
        placement = self._origin(inertial, owner)
        turned = (
            placement.rotation @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ placement.rotation.T
        )
        if mass == 0 and not turned.any():
            self.notes.append(Note(owner, "has zero mass and inertia: no body"))
            return Link(name)
        return Link(name, pin.Inertia(float(mass), placement.translation, (turned + turned.T) / 2))

    def _joint(self, element: etree._Element) -> Joint:
        name = self.text(element, "name", "a <joint>")
        owner = f"joint '{name}'"
        written = self.text(element, "type", owner)
        if written not in _JOINT_TYPES:
            raise self.error(
                f"{owner} has the type '{written}'; supported: {', '.join(sorted(_JOINT_TYPES))}", owner
            )
        for tag in ("mimic", "coupling"):
            if element.find(tag) is not None:
                raise self.error(f"{owner}: <{tag}> couples joints, and is not supported; remove it", owner)
        kind = _JOINT_TYPES[written]
        limit = element.find("limit")
        bounded = limit is not None and kind in (JointKind.REVOLUTE, JointKind.PRISMATIC)
        for child in element.iterchildren(etree.Element):
            if child.tag not in ("parent", "child", "origin", "axis", "limit"):
                self._ignore(
                    child, owner, {"dynamics": "friction and damping are arguments of the simulation"}
                )

        def read(attribute: str, absent: float) -> float:
            if not bounded or limit is None or attribute not in limit.attrib:
                return absent
            return float(self.numbers(limit, attribute, 1, owner)[0])

        free = written == "continuous"
        return Joint(
            name=name,
            kind=kind,
            parent=self.text(self.child(element, "parent", owner), "link", owner),
            child=self.text(self.child(element, "child", owner), "link", owner),
            placement=self._origin(element, owner),
            axis=self._axis(element, owner, "axis", "1 0 0"),
            lower=-np.inf if free else read("lower", -np.inf),
            upper=np.inf if free else read("upper", np.inf),
            effort=read("effort", np.inf),
            velocity=read("velocity", np.inf),
            independent=self._flag(element, "independent", owner),
        )

    def _loop(self, element: etree._Element) -> Loop:
        name = self.text(element, "name", "a <loop>")
        owner = f"loop '{name}'"
        written = self.text(element, "type", owner)
        written = {"continuous": "revolute", "ball": "spherical"}.get(written, written)
        if written not in list(LOOP_KINDS):
            raise self.error(f"{owner} has the type '{written}'; supported: {', '.join(LOOP_KINDS)}", owner)
        ends = [self.child(element, tag, owner) for tag in ("predecessor", "successor")]
        length = element.find("length")
        for child in element.iterchildren(etree.Element):
            if child.tag not in ("predecessor", "successor", "axis", "axis2", "length"):
                raise self.error(f"{owner}: <{child.tag}> is not understood", owner)
        return Loop(
            name=name,
            kind=JointKind(written),
            link1=self.text(ends[0], "link", owner),
            link2=self.text(ends[1], "link", owner),
            placement1=self._origin(ends[0], owner),
            placement2=self._origin(ends[1], owner),
            axis=self._axis(element, owner, "axis", "0 0 1"),
            axis2=self._axis(element, owner, "axis2", "0 1 0"),
            length=0.0 if length is None else float(self.numbers(length, "value", 1, owner)[0]),
        )

    def _home(self) -> Mapping[str, FloatArray]:
        states = [element for element in self.root.findall("group_state") if element.get("name") == "home"]
        if len(states) > 1:
            raise self.error(f"{len(states)} <group_state name='home'>; keep one", "home")
        if not states:
            return {}
        home: dict[str, FloatArray] = {}
        for element in states[0].findall("joint"):
            name = self.text(element, "name", "group_state 'home'")
            owner = f"joint '{name}' of group_state 'home'"
            home[name] = self.parse(self.text(element, "value", owner), None, owner, owner)
        return home

    def _origin(self, element: etree._Element, owner: str) -> pin.SE3:
        origin = element.find("origin")
        if origin is None:
            return pin.SE3.Identity()
        xyz = self.numbers(origin, "xyz", 3, owner, default="0 0 0")
        return pin.SE3(rotation_from_rpy(*self.numbers(origin, "rpy", 3, owner, default="0 0 0")), xyz)

    def _axis(self, element: etree._Element, owner: str, tag: str, default: str) -> FloatArray:
        axis = element.find(tag)
        values = self.parse(default, 3, owner, owner) if axis is None else self.numbers(axis, "xyz", 3, owner)
        size = np.linalg.norm(values)
        if size < 1e-12:
            raise self.error(f"{owner} has an <{tag}> of length zero; give a direction", owner)
        return values / size

    def _flag(self, element: etree._Element, attribute: str, owner: str) -> bool:
        value = element.get(attribute, "false")
        if value not in ("true", "false"):
            raise self.error(f"{owner}: {attribute} must be 'true' or 'false', got {value!r}", owner)
        return value == "true"

    def _ignore(self, child: etree._Element, owner: str, reasons: Mapping[str, str]) -> None:
        self.notes.append(Note(owner, f"<{child.tag}> ignored: {reasons.get(str(child.tag), 'unknown tag')}"))


def write_urdf_file(mechanism: Mechanism, path: Path) -> None:
    """Write a mechanism as URDF with loops in the URDF+ dialect.

    Parameters
    ----------
    mechanism
        What to write.
    path
        File to create or overwrite.
    """
    robot = etree.Element("robot", name=mechanism.name)
    for link in mechanism.links:
        _write_link(robot, link)
    for joint in mechanism.joints:
        _write_joint(robot, joint)
    for loop in mechanism.loops:
        _write_loop(robot, loop)
    if mechanism.home:
        state = etree.SubElement(robot, "group_state", name="home", group="all")
        for name, values in mechanism.home.items():
            etree.SubElement(state, "joint", name=name, value=number_text(values))
    path.write_bytes(etree.tostring(robot, pretty_print=True, xml_declaration=True, encoding="utf-8"))


def _write_link(robot: etree._Element, link: Link) -> None:
    element = etree.SubElement(robot, "link", name=link.name)
    if link.inertia is None:
        return
    inertial = etree.SubElement(element, "inertial")
    _write_origin(inertial, pin.SE3(np.eye(3), link.inertia.lever))
    etree.SubElement(inertial, "mass", value=number_text([link.inertia.mass]))
    matrix = link.inertia.inertia
    names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    etree.SubElement(inertial, "inertia", {key: number_text([matrix[at]]) for key, at in names.items()})


def _write_joint(robot: etree._Element, joint: Joint) -> None:
    unlimited = joint.kind is JointKind.REVOLUTE and np.isinf([joint.lower, joint.upper]).all()
    element = etree.SubElement(
        robot, "joint", name=joint.name, type="continuous" if unlimited else str(joint.kind)
    )
    if joint.independent:
        element.set("independent", "true")
    etree.SubElement(element, "parent", link=joint.parent)
    etree.SubElement(element, "child", link=joint.child)
    _write_origin(element, joint.placement)
    if not joint.has_axis:
        return
    etree.SubElement(element, "axis", xyz=number_text(joint.axis))
    limits = {"lower": joint.lower, "upper": joint.upper, "effort": joint.effort, "velocity": joint.velocity}
    finite = {key: number_text([value]) for key, value in limits.items() if np.isfinite(value)}
    if finite:
        # URDF readers require both of these.
        etree.SubElement(element, "limit", {"effort": "1e30", "velocity": "1e30", **finite})


def _write_loop(robot: etree._Element, loop: Loop) -> None:
    element = etree.SubElement(robot, "loop", name=loop.name, type=str(loop.kind))
    for tag, link, placement in (
        ("predecessor", loop.link1, loop.placement1),
        ("successor", loop.link2, loop.placement2),
    ):
        _write_origin(etree.SubElement(element, tag, link=link), placement)
    if loop.kind not in (JointKind.SPHERICAL, JointKind.FIXED, JointKind.DISTANCE):
        etree.SubElement(element, "axis", xyz=number_text(loop.axis))
    if loop.kind is JointKind.UNIVERSAL:
        etree.SubElement(element, "axis2", xyz=number_text(loop.axis2))
    if loop.kind is JointKind.DISTANCE:
        etree.SubElement(element, "length", value=number_text([loop.length]))


def _write_origin(element: etree._Element, placement: pin.SE3) -> None:
    rpy = rpy_from_rotation(placement.rotation)
    if placement.translation.any() or rpy.any():
        attributes = {"xyz": number_text(placement.translation)}
        if rpy.any():
            attributes["rpy"] = number_text(rpy)
        etree.SubElement(element, "origin", attributes)
