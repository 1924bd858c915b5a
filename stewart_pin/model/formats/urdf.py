"""URDF, with loops and couplings in any dialect that `dialect` finds.

The core of URDF is read here: links, joints, and, as in SRDF, the home configuration (``<group_state
name="home">``) and the platform (``<end_effector name="platform">``). Motors are joints with
``independent="true"``. Every other tag belongs to a dialect, is known to be harmless, or is refused.

Joints of several freedoms become rows of one-freedom joints, and a joint that gives a link a second parent becomes
a loop; the notes say so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.model.description import Joint, JointKind, Link, Mechanism, Outcome
from stewart_pin.model.formats.dialect import Parts, add_parts, claimed_tags, dialects, found_notes
from stewart_pin.model.formats.named_motors import choose_motors
from stewart_pin.model.formats.side_cars import add_side_car, find_beside
from stewart_pin.model.formats.urdf_elements import INERTIA_ENTRIES, UrdfElements
from stewart_pin.model.formats.xml import UNLIMITED, shown_tag
from stewart_pin.model.spanning_tree import cut_second_parents
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


@dataclass(frozen=True, eq=False)
class _Found:
    """What one tag held, and how the report calls tag and dialect."""

    parts: Parts
    title: str = ""
    tag: str = ""
    subject: str = ""


def read_urdf(path: Path, *, loops: Path | None = None) -> Mechanism:
    """Read a URDF with or without loops.

    Parameters
    ----------
    path
        File to read.
    loops
        Side-car file that declares loops; None: one that lies beside the file under the file's own name, if any.

    Returns
    -------
    Mechanism
        Description, not yet validated.

    Raises
    ------
    FileFormatError
        If the file is broken, or holds a tag that could mean a loop in a dialect that is not understood.
    MechanismError
        If a joint that would have to be cut is a motor.
    """
    mechanism = _UrdfReader(path).read()
    side_car = find_beside(path) if loops is None else loops
    if side_car is not None:
        mechanism = add_side_car(mechanism, side_car)
    for dialect in dialects():
        if dialect.complete is not None:
            mechanism = dialect.complete(mechanism)
    return cut(mechanism)


class _UrdfReader(UrdfElements):
    def read(self) -> Mechanism:
        if self.root.tag != "robot":
            raise self.error(f"the root element is <{shown_tag(self.root)}>, a URDF has <robot>", "<robot>")
        self.ignore_attributes(self.root, "the file", ("name", "version"))
        core = {"link": self._link, "joint": self._joint}
        found: list[_Found] = []
        for element in self.root.iterchildren(etree.Element):
            tag = shown_tag(element)
            if tag in core:
                found.extend(core[tag](element))
            elif tag not in ("group_state", "end_effector"):
                found.extend(self._in_a_dialect(element, "the file"))
        parts = [each.parts for each in found]
        links = tuple(link for part in parts for link in part.links)
        mechanism = Mechanism(
            name=self.root.get("name") or Path(self.path).stem,
            links=links,
            joints=tuple(joint for part in parts for joint in part.joints),
            loops=tuple(loop for part in parts for loop in part.loops),
            couplings=tuple(coupling for part in parts for coupling in part.couplings),
            platform=self._platform(links),
            home=self._home(),
            source=self.path,
            notes=(*self.notes, *(note for part in parts for note in part.notes)),
        )
        for each in found:
            if each.parts.later is not None:
                mechanism = add_parts(mechanism, each.parts.later(mechanism), each.title)
        named = [
            (each.tag, each.subject, each.parts.motors) for each in found if each.parts.motors is not None
        ]
        return choose_motors(mechanism, named)

    def _in_a_dialect(self, element: etree._Element, owner: str) -> list[_Found]:
        """Read a tag by the dialect that claims it; note it, or refuse it, where none does."""
        parent = element.getparent()
        tag = f"{'' if parent is None else shown_tag(parent)}/{shown_tag(element)}"
        dialect = claimed_tags().get(tag)
        if dialect is None:
            self.ignore(element, owner)
            return []
        part = dialect.tags[tag](self, element)
        self.notes += found_notes(part, dialect.title)
        return [_Found(part, dialect.title, shown_tag(element), self.shown(element, owner))]

    def _children_in_dialects(
        self, element: etree._Element, owner: str, known: tuple[str, ...]
    ) -> list[_Found]:
        return [
            found
            for child in element.iterchildren(etree.Element)
            if shown_tag(child) not in known
            for found in self._in_a_dialect(child, owner)
        ]

    def _link(self, element: etree._Element) -> list[_Found]:
        name = self.text(element, "name", "a <link>")
        owner = f"link '{name}'"
        self.ignore_attributes(element, owner, ("name", "type"))
        inertial = self.optional(element, "inertial", owner)
        inertia = None if inertial is None else self._inertia(inertial, owner)
        return [
            _Found(Parts(links=(Link(name, inertia),))),
            *self._children_in_dialects(element, owner, ("inertial",)),
        ]

    def _inertia(self, inertial: etree._Element, owner: str) -> pin.Inertia:
        self.only(inertial, owner, (), ("origin", "mass", "inertia"))
        mass_element, entries = self.child(inertial, "mass", owner), self.child(inertial, "inertia", owner)
        self.only(mass_element, owner, ("value",))
        self.only(entries, owner, INERTIA_ENTRIES)
        mass = float(self.numbers(mass_element, "value", 1, owner)[0])
        matrix = np.empty((3, 3))
        for key, (i, j) in INERTIA_ENTRIES.items():
            matrix[i, j] = matrix[j, i] = self.numbers(entries, key, 1, owner)[0]
        placement = self.origin(inertial, owner)
        turned = placement.rotation @ matrix @ placement.rotation.T
        if mass == 0 and not turned.any():
            self.note(owner, "has an <inertial> of zero: a body without mass", Outcome.KEPT)
        # Set afterwards: the constructor refuses negative moments with an error that names nothing.
        inertia = pin.Inertia(mass, placement.translation, np.zeros((3, 3)))
        inertia.inertia = (turned + turned.T) / 2
        return inertia

    def _joint(self, element: etree._Element) -> list[_Found]:
        name = self.text(element, "name", "a <joint>")
        owner = f"joint '{name}'"
        written = self.text(element, "type", owner)
        if written not in JOINT_TYPES:
            raise self.error(
                f"{owner} has the type '{written}'; supported: {', '.join(sorted(JOINT_TYPES))}", owner
            )
        kind = JOINT_TYPES[written]
        known = ("parent", "child", "origin", "axis", "limit")
        known += ("axis2",) if kind is JointKind.UNIVERSAL else ()
        self.ignore_attributes(element, owner, ("name", "type", "independent"))
        ends = self.ends(element, owner)
        placement, independent = self.origin(element, owner), self.flag(element, "independent", owner)
        if kind in _UNFOLDED:
            if independent:
                raise self.error(f"{owner} is marked independent; a motor drives one freedom", owner)
            own = Parts.of(self._unfold(element, name, kind, ends, placement))
        else:
            own = Parts(joints=(self._plain(element, Joint(name, kind, *ends, placement), independent),))
        return [_Found(own), *self._children_in_dialects(element, owner, known)]

    def _plain(self, element: etree._Element, joint: Joint, independent: bool) -> Joint:
        """Add motor, axis and limits."""
        joint = replace(joint, independent=independent)
        # Exporters write <axis xyz="0 0 0"> and limits into fixed joints; only one-freedom joints have them.
        if not joint.has_axis:
            return joint
        owner = f"joint '{joint.name}'"
        axis = self.axis(element, owner, "axis", "1 0 0")
        return replace(joint, axis=axis, **self._limits(element, owner, element.get("type", "")))

    def _unfold(
        self,
        element: etree._Element,
        name: str,
        kind: JointKind,
        ends: tuple[str, str],
        placement: pin.SE3,
    ) -> Unfolded:
        owner = f"joint '{name}'"
        if self.optional(element, "limit", owner) is not None:
            self.note(owner, f"<limit>: which freedom of a {kind} joint it limits is not said")
        if kind is JointKind.UNIVERSAL:
            axes = [self.axis(element, owner, tag, "") for tag in ("axis", "axis2")]
            return unfold_universal(name, *ends, placement, *axes)
        axis = self.axis(element, owner, "axis", "1 0 0")
        unfold = unfold_planar if kind is JointKind.PLANAR else unfold_cylindrical
        return unfold(name, *ends, placement, axis)

    def _limits(self, joint: etree._Element, owner: str, written: str) -> dict[str, float]:
        """Read the limits of a one-freedom joint; what is absent is unlimited."""
        element = self.optional(joint, "limit", owner)
        if element is None:
            return {}
        keys = ("lower", "upper", "effort", "velocity")
        self.ignore_attributes(element, owner, keys)
        for child in element.iterchildren(etree.Element):
            self.ignore(child, owner)
        limits = {
            key: float(self.numbers(element, key, 1, owner)[0]) for key in keys if key in element.attrib
        }
        range_given = limits.keys() & {"lower", "upper"}
        if written == "continuous" and range_given:
            self.note(owner, "<limit lower, upper>: the joint is continuous")
            limits = {key: value for key, value in limits.items() if key not in range_given}
        elif written != "continuous" and len(range_given) < 2:
            self.note(
                owner,
                "<limit> without lower or upper: no such limit, where other readers assume 0",
                Outcome.KEPT,
            )
        return {
            key: float(np.copysign(np.inf, value)) if abs(value) >= UNLIMITED else value
            for key, value in limits.items()
        }

    def _platform(self, links: tuple[Link, ...]) -> str | None:
        found: list[str] = []
        for element in self.root.findall("end_effector"):
            if element.get("name") == "platform":
                found.append(self.text(element, "parent_link", "end_effector 'platform'"))
            else:
                self.ignore(element, "the file")
        if len(found) > 1:
            raise self.error(f"{len(found)} <end_effector name='platform'>; keep one", "end_effector")
        found += [link.name for link in links if link.name == "platform"]
        return found[0] if found else None

    def _home(self) -> Mapping[str, FloatArray]:
        home: dict[str, FloatArray] = {}
        states = [element for element in self.root.findall("group_state") if element.get("name") == "home"]
        for element in self.root.findall("group_state"):
            if element not in states:
                self.ignore(element, "the file")
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


def cut(mechanism: Mechanism) -> Mechanism:
    """Turn joints that give a link a second parent into loops.

    Parameters
    ----------
    mechanism
        Mechanism whose joints need not form a tree.

    Returns
    -------
    Mechanism
        The same machine; its home keeps the values of the joints that are left.
    """
    joints, loops, notes = cut_second_parents(mechanism.joints, source=mechanism.source)
    lost = {loop.name for loop in loops}
    return replace(
        mechanism,
        joints=joints,
        loops=mechanism.loops + loops,
        notes=mechanism.notes + notes,
        home={name: value for name, value in mechanism.home.items() if name not in lost},
    )
