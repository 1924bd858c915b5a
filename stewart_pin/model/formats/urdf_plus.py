"""URDF with loops inside, in the URDF+ dialect, read and written.

Loops are ``<loop name type>`` with ``<predecessor link>`` and ``<successor link>``, each with its ``<origin>``, and
an ``<axis>``; motors are joints with ``independent="true"``; the home configuration is a ``<group_state
name="home">`` as in SRDF. Readers that know none of this see the spanning tree.

References
----------
.. [1] M. Chignoli et al., "URDF+: An Enhanced URDF for Robots with Kinematic Loops", 2024.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.geometry.rotations import rotation_from_rpy, rpy_from_rotation
from stewart_pin.model.description import (
    AXIS_FREE_LOOPS,
    LOOP_KINDS,
    Joint,
    JointKind,
    Link,
    Loop,
    Mechanism,
    Note,
    Outcome,
)
from stewart_pin.model.formats.foreign_tags import reason_to_ignore
from stewart_pin.model.formats.xml import UNLIMITED, ElementReader, number_text, read_xml, shown_tag
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
_INERTIA = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
_NO_DIRECTION = 1e-12
"""Length below which an axis has no direction."""
_Z = np.array([0.0, 0.0, 1.0])


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
            raise self.error(f"the root element is <{shown_tag(self.root)}>, a URDF has <robot>", "<robot>")
        self._note_strangers(
            self.root,
            "the file",
            ("name", "version"),
            ("link", "joint", "loop", "group_state", "end_effector"),
        )
        links = tuple(self._link(element) for element in self.root.findall("link"))
        return Mechanism(
            name=self.root.get("name") or Path(self.path).stem,
            links=links,
            joints=tuple(self._joint(element) for element in self.root.findall("joint")),
            loops=tuple(self._loop(element) for element in self.root.findall("loop")),
            platform=self._platform(links),
            home=self._home(),
            source=self.path,
            notes=tuple(self.notes),
        )

    def _link(self, element: etree._Element) -> Link:
        name = self.text(element, "name", "a <link>")
        owner = f"link '{name}'"
        self._note_strangers(element, owner, ("name", "type"), ("inertial",))
        inertial = self.optional(element, "inertial", owner)
        if inertial is None:
            return Link(name)
        self.only(inertial, owner, (), ("origin", "mass", "inertia"))
        mass_element, entries = self.child(inertial, "mass", owner), self.child(inertial, "inertia", owner)
        self.only(mass_element, owner, ("value",))
        self.only(entries, owner, _INERTIA)
        mass = float(self.numbers(mass_element, "value", 1, owner)[0])
        matrix = np.empty((3, 3))
        for key, (i, j) in _INERTIA.items():
            matrix[i, j] = matrix[j, i] = self.numbers(entries, key, 1, owner)[0]
        placement = self._origin(inertial, owner)
        turned = placement.rotation @ matrix @ placement.rotation.T
        if mass == 0 and not turned.any():
            self._note(owner, "has an <inertial> of zero: a body without mass", Outcome.KEPT)
        # Set afterwards: the constructor refuses negative moments with an error that names nothing.
        inertia = pin.Inertia(mass, placement.translation, np.zeros((3, 3)))
        inertia.inertia = (turned + turned.T) / 2
        return Link(name, inertia)

    def _joint(self, element: etree._Element) -> Joint:
        name = self.text(element, "name", "a <joint>")
        owner = f"joint '{name}'"
        written = self.text(element, "type", owner)
        if written not in _JOINT_TYPES:
            raise self.error(
                f"{owner} has the type '{written}'; supported: {', '.join(sorted(_JOINT_TYPES))}", owner
            )
        self._note_strangers(
            element, owner, ("name", "type", "independent"), ("parent", "child", "origin", "axis", "limit")
        )
        parent, child = self.child(element, "parent", owner), self.child(element, "child", owner)
        for end in (parent, child):
            self.only(end, owner, ("link",))
        kind = _JOINT_TYPES[written]
        # Exporters write <axis xyz="0 0 0"> and limits into fixed joints; only one-freedom joints have them.
        one_freedom = kind in (JointKind.REVOLUTE, JointKind.PRISMATIC)
        return Joint(
            name=name,
            kind=kind,
            parent=self.text(parent, "link", owner),
            child=self.text(child, "link", owner),
            placement=self._origin(element, owner),
            axis=self._axis(element, owner, "axis", "1 0 0") if one_freedom else _Z,
            independent=self._flag(element, "independent", owner),
            **(self._limits(element, owner, written) if one_freedom else {}),
        )

    def _limits(self, joint: etree._Element, owner: str, written: str) -> dict[str, float]:
        """Read the limits of a one-freedom joint; what is absent is unlimited."""
        element = self.optional(joint, "limit", owner)
        if element is None:
            return {}
        self._note_strangers(element, owner, ("lower", "upper", "effort", "velocity"))
        limits = {
            str(key): float(self.numbers(element, str(key), 1, owner)[0])
            for key in ("lower", "upper", "effort", "velocity")
            if key in element.attrib
        }
        range_given = limits.keys() & {"lower", "upper"}
        if written == "continuous" and range_given:
            self._note(owner, "<limit lower, upper>: the joint is continuous")
            limits = {key: value for key, value in limits.items() if key not in range_given}
        elif written != "continuous" and len(range_given) < 2:
            self._note(
                owner,
                "<limit> without lower or upper: no such limit, where other readers assume 0",
                Outcome.KEPT,
            )
        return {
            key: float(np.copysign(np.inf, value)) if abs(value) >= UNLIMITED else value
            for key, value in limits.items()
        }

    def _loop(self, element: etree._Element) -> Loop:
        name = self.text(element, "name", "a <loop>")
        owner = f"loop '{name}'"
        written = self.text(element, "type", owner)
        written = {"continuous": "revolute", "ball": "spherical"}.get(written, written)
        if written not in list(LOOP_KINDS):
            raise self.error(f"{owner} has the type '{written}'; supported: {', '.join(LOOP_KINDS)}", owner)
        kind = JointKind(written)
        parts = {JointKind.UNIVERSAL: ("axis", "axis2"), JointKind.DISTANCE: ("length",)}.get(kind, ("axis",))
        self.only(element, owner, ("name", "type"), ("predecessor", "successor", *parts))
        ends = [self.child(element, tag, owner) for tag in ("predecessor", "successor")]
        for end in ends:
            self.only(end, owner, ("link",), ("origin",))
        length = 0.0
        if kind is JointKind.DISTANCE:
            rod = self.child(element, "length", owner)
            self.only(rod, owner, ("value",))
            length = float(self.numbers(rod, "value", 1, owner)[0])
        # An axis guessed for a loop would be another mechanism.
        default = "0 0 1" if kind in AXIS_FREE_LOOPS else ""
        return Loop(
            name=name,
            kind=kind,
            link1=self.text(ends[0], "link", owner),
            link2=self.text(ends[1], "link", owner),
            placement1=self._origin(ends[0], owner),
            placement2=self._origin(ends[1], owner),
            axis=self._axis(element, owner, "axis", default),
            axis2=self._axis(element, owner, "axis2", "0 1 0" if kind is not JointKind.UNIVERSAL else ""),
            length=length,
        )

    def _platform(self, links: tuple[Link, ...]) -> str | None:
        found: list[str] = []
        for element in self.root.findall("end_effector"):
            if element.get("name") == "platform":
                found.append(self.text(element, "parent_link", "end_effector 'platform'"))
            else:
                self._note_ignored(element, "the file")
        if len(found) > 1:
            raise self.error(f"{len(found)} <end_effector name='platform'>; keep one", "end_effector")
        found += [link.name for link in links if link.name == "platform"]
        return found[0] if found else None

    def _home(self) -> Mapping[str, FloatArray]:
        home: dict[str, FloatArray] = {}
        states = [element for element in self.root.findall("group_state") if element.get("name") == "home"]
        for element in self.root.findall("group_state"):
            if element not in states:
                self._note_ignored(element, "the file")
        if len(states) > 1:
            raise self.error(f"{len(states)} <group_state name='home'>; keep one", "home")
        for state in states:
            self.only(state, "group_state 'home'", ("name", "group"), ("joint",))
            for element in state:
                name = self.text(element, "name", "group_state 'home'")
                owner = f"joint '{name}' of group_state 'home'"
                if name in home:
                    raise self.error(f"{owner} stands there twice; keep one", owner)
                self.only(element, owner, ("name", "value"))
                home[name] = self.parse(self.text(element, "value", owner), None, owner, owner)
        return home

    def _origin(self, element: etree._Element, owner: str) -> pin.SE3:
        origin = self.optional(element, "origin", owner)
        if origin is None:
            return pin.SE3.Identity()
        self.only(origin, owner, ("xyz", "rpy"))
        xyz = self.numbers(origin, "xyz", 3, owner, default="0 0 0")
        return pin.SE3(rotation_from_rpy(*self.numbers(origin, "rpy", 3, owner, default="0 0 0")), xyz)

    def _axis(self, element: etree._Element, owner: str, tag: str, default: str) -> FloatArray:
        axis = self.optional(element, tag, owner) if default else self.child(element, tag, owner)
        if axis is None:
            return self.parse(default, 3, owner, owner)
        self.only(axis, owner, ("xyz",))
        values = self.numbers(axis, "xyz", 3, owner)
        size = np.linalg.norm(values)
        if size < _NO_DIRECTION:
            raise self.error(f"{owner} has an <{tag}> of length zero; give a direction", owner)
        # A vector that is of unit length to the last digit keeps its digits, so that files survive being rewritten.
        return values if abs(size - 1) < 1e-15 else values / size

    def _flag(self, element: etree._Element, attribute: str, owner: str) -> bool:
        value = element.get(attribute, "false")
        if value not in ("true", "false"):
            raise self.error(f"{owner}: {attribute} must be 'true' or 'false', got {value!r}", owner)
        return value == "true"

    def _note(self, owner: str, text: str, outcome: Outcome = Outcome.IGNORED) -> None:
        self.notes.append(Note(owner, text, outcome))

    def _note_ignored(self, element: etree._Element, owner: str) -> None:
        named = f" name='{element.get('name')}'" if element.get("name") and owner == "the file" else ""
        reason = reason_to_ignore(self, element, owner)
        self._note(owner, f"<{shown_tag(element)}{named}>: {reason}")

    def _note_strangers(
        self, element: etree._Element, owner: str, attributes: Collection[str], tags: Collection[str] = ()
    ) -> None:
        """Note attributes and children that are not read, and stop at those that could change the mechanism."""
        for name in element.attrib:
            if name not in attributes:
                self._note(owner, f"attribute '{name}' of <{element.tag}>: unknown")
        for child in element.iterchildren(etree.Element):
            if child.tag not in tags:
                self._note_ignored(child, owner)


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
    if mechanism.platform not in (None, "platform"):
        etree.SubElement(robot, "end_effector", name="platform", parent_link=mechanism.platform, group="all")
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
    etree.SubElement(inertial, "inertia", {key: number_text([matrix[at]]) for key, at in _INERTIA.items()})


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
    # URDF readers require effort and velocity, and take an absent lower or upper limit for 0.
    limits = {"effort": joint.effort, "velocity": joint.velocity}
    if not unlimited:
        limits |= {"lower": joint.lower, "upper": joint.upper}
    if not np.isinf(list(limits.values())).all() or not unlimited:
        finite = {key: number_text([np.clip(value, -UNLIMITED, UNLIMITED)]) for key, value in limits.items()}
        etree.SubElement(element, "limit", finite)


def _write_loop(robot: etree._Element, loop: Loop) -> None:
    element = etree.SubElement(robot, "loop", name=loop.name, type=str(loop.kind))
    for tag, link, placement in (
        ("predecessor", loop.link1, loop.placement1),
        ("successor", loop.link2, loop.placement2),
    ):
        _write_origin(etree.SubElement(element, tag, link=link), placement)
    if loop.kind not in AXIS_FREE_LOOPS:
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
