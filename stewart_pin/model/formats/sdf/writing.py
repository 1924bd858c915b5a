"""SDFormat, written so that other readers find the mechanism, and `load` all that a chain holds.

Links stand where they are at home: there every loop is closed, and a joint that closes one is a second joint with the
same child, as Gazebo Classic has it, marked as the one to cut. The joints of the file read zero there; what they read
in the chain stands in words of our own (see `elements`), as do motors, platform and limits that SDFormat does not know.
Two hinges about a cross without mass become one universal joint, and a thread a screw, where they are called as `load`
calls them and motors drive both hinges, one after the other, or none. A link that is no body is a frame where it only
marks a place, and else a link without mass.

References
----------
.. [1] Open Robotics, "SDFormat Specification", version 1.11.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.errors import UnsupportedError
from stewart_pin.geometry.hexapod import STANDARD_GRAVITY
from stewart_pin.geometry.rotations import rpy_from_rotation
from stewart_pin.model.description import (
    Bounds,
    Coupling,
    Joint,
    JointKind,
    Link,
    Loop,
    Mechanism,
    Note,
    Outcome,
    loop_coordinates,
    unknown_kind,
)
from stewart_pin.model.formats.dialect import write_files
from stewart_pin.model.formats.sdf.coordinates import (
    DRAKE,
    counted_from,
    set_own,
    write_axis_dynamics,
    write_limit,
    write_own_dynamics,
    write_own_limit,
    write_rotor,
)
from stewart_pin.model.formats.sdf.elements import OWN, OWN_PREFIX
from stewart_pin.model.formats.sdf.frames import WORLD, coordinates_between, motion
from stewart_pin.model.formats.xml import INERTIA_ENTRIES, number_text
from stewart_pin.model.joint_physics import NO_PHYSICS, JointPhysics
from stewart_pin.model.shapes import Material, Shape, ShapeKind, path_from
from stewart_pin.model.unfolding import fixed_to, unfold_screw
from stewart_pin.typing import FloatArray

_VERSION = "1.11"
_TYPES = {
    JointKind.FIXED: "fixed",
    JointKind.REVOLUTE: "revolute",
    JointKind.PRISMATIC: "prismatic",
    JointKind.SPHERICAL: "ball",
    JointKind.UNIVERSAL: "universal",
}
_AXES = ("axis", "axis2")
_SAME_COUPLING = 1e-12
"""Constant of a coupling between displacements from home, in its own terms, that is round-off."""


def write_sdf(mechanism: Mechanism, path: Path) -> tuple[Note, ...]:
    """Write a mechanism as SDFormat.

    Parameters
    ----------
    mechanism
        What to write, its home complete.
    path
        File to create or overwrite.

    Returns
    -------
    tuple of Note
        What was put in the place of something that SDFormat does not allow.

    Raises
    ------
    UnsupportedError
        If SDFormat cannot express a joint, a loop or a coupling; names it and the remedy.
    """
    writer = _SdfWriter(mechanism, path.resolve().parent)
    write_files({path: writer.write()})
    return tuple(writer.notes)


# ----------------------------------------------------------------------------------------------------
# What becomes one joint of the file: joints of the tree, rows of two with a cross between them, and loops
# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Placed:
    """A joint of the file; its frame is that of the child at rest, but for `in_child`."""

    name: str
    written: str
    parent: str
    child: str
    in_child: pin.SE3
    position: FloatArray
    axes: tuple[FloatArray, ...] = ()
    bounds: tuple[Bounds, ...] = ()
    readings: tuple[float, ...] = ()
    parts: tuple[Joint, ...] = ()
    lead: float = 0.0
    physics: tuple[JointPhysics, ...] = ()
    ball: tuple[Bounds, ...] = ()
    ball_physics: JointPhysics = NO_PHYSICS
    ball_axis: FloatArray | None = None
    closes: bool = False
    cross: str = ""


def _rows(mechanism: Mechanism) -> dict[str, tuple[Joint, Joint, float]]:
    """Find the rows that `load` makes of universal joints (lead 0) and of screws, by the name of their first joint."""
    by_parent: dict[str, list[Joint]] = {}
    for joint in mechanism.joints:
        by_parent.setdefault(joint.parent, []).append(joint)
    busy = {link for loop in mechanism.loops for link in (loop.link1, loop.link2)} | {mechanism.platform}
    used = [name for coupling in mechanism.couplings for name in coupling.joints]
    names = {joint.name for joint in mechanism.joints}
    motors = [joint.name for joint in mechanism.joints if joint.independent]
    found: dict[str, tuple[Joint, Joint, float]] = {}
    for first in mechanism.joints:
        link, below = mechanism.link(first.child), by_parent.get(first.child, [])
        is_cross = link.inertia is None and not (link.visuals or link.collisions) and link.name not in busy
        taken = {joint.name for row in found.values() for joint in row[:2]}
        if not is_cross or len(below) != 1 or first.kind is not JointKind.REVOLUTE or first.name in taken:
            continue
        second = below[0]
        if second.name in taken:
            continue
        at_once = np.array_equal(second.placement.homogeneous, np.eye(4))
        # Of a joint as a whole the file says that it is driven, and where it stands among the motors.
        driven = [motors.index(part.name) for part in (first, second) if part.independent]
        alike = not driven or (len(driven) == 2 and driven[1] == driven[0] + 1)
        called = not names & set(_parts(first, second))
        if second.kind is JointKind.REVOLUTE and at_once and alike and called:
            found[first.name] = first, second, 0.0
            continue
        thread = next((c for c in mechanism.couplings if c.name == f"{first.name}_thread"), None)
        if thread is None or used.count(second.name) > 1 or thread.polynomial[0]:
            continue
        lead = 2 * np.pi * thread.polynomial[1] if len(thread.polynomial) == 2 else 0.0
        plain = (thread.joint1, thread.joint2) == (second.name, first.name) and not second.independent
        free = second.bounds == Bounds() and not second.physics
        made = unfold_screw(first.name, first.parent, second.child, first.placement, first.axis, lead)
        if lead and plain and free and _is_same(made.joints, (first, second)):
            found[first.name] = first, second, lead
    return found


def _parts(first: Joint, second: Joint) -> tuple[str, ...]:
    """Name the joints that `load` makes of a universal one, but for those that are called so already."""
    stem = _stem(first, second)
    return tuple(f"{stem}_{k}" for k, joint in enumerate((first, second), 1) if joint.name != f"{stem}_{k}")


def _stem(first: Joint, second: Joint) -> str:
    stem = first.name.removesuffix("_1")
    return stem if (first.name, second.name) == (f"{stem}_1", f"{stem}_2") else first.name


def _is_same(made: tuple[Joint, ...], joints: tuple[Joint, ...]) -> bool:
    return all(
        (one.name, one.kind, one.parent, one.child) == (two.name, two.kind, two.parent, two.child)
        and np.array_equal(one.placement.homogeneous, two.placement.homogeneous)
        and np.array_equal(one.axis, two.axis)
        for one, two in zip(made, joints, strict=True)
    )


def _of_tree(joint: Joint, values: FloatArray) -> _Placed:
    if joint.kind not in _TYPES:
        raise unknown_kind(f"joint '{joint.name}'", joint.kind, "the writer of SDFormat")
    one = pin.SE3.Identity()
    ball = (Bounds(position=(-np.inf, joint.swing)), Bounds(position=(-np.inf, joint.turn)))
    is_ball, has_axis = joint.kind is JointKind.SPHERICAL, joint.has_axis
    return _Placed(
        joint.name,
        _TYPES[joint.kind],
        joint.parent,
        joint.child,
        one,
        values,
        (joint.axis,) if has_axis else (),
        (joint.bounds,) if has_axis else (),
        (float(values[0]),) if has_axis else (),
        (joint,),
        physics=(joint.physics,) if has_axis else (),
        ball=ball if is_ball else (),
        ball_physics=joint.physics if is_ball else NO_PHYSICS,
        ball_axis=joint.axis if is_ball else None,
    )


def _of_row(first: Joint, second: Joint, lead: float, home: Mapping[str, FloatArray]) -> _Placed:
    name = first.name if lead else _stem(first, second)
    values = np.concatenate([home[first.name], home[second.name]])
    parts = (first,) if lead else (first, second)
    back = motion(second.kind, second.axis, values[1:]).rotation.T
    return _Placed(
        name,
        "screw" if lead else "universal",
        first.parent,
        second.child,
        pin.SE3.Identity(),
        values[: len(parts)],
        (back @ first.axis, second.axis)[: len(parts)],
        tuple(part.bounds for part in parts),
        tuple(float(value) for value in values[: len(parts)]),
        parts,
        lead,
        physics=tuple(part.physics for part in parts),
        cross="" if lead or first.child == f"{name}_between_1" else first.child,
    )


def _of_loop(loop: Loop, at: Mapping[str, pin.SE3]) -> _Placed:
    there = (at[loop.link1] * loop.placement1).actInv(at[loop.link2] * loop.placement2)
    readings = coordinates_between(loop.kind, loop.axis, loop.axis2, there)
    is_ball = loop.kind is JointKind.SPHERICAL
    axes = (loop.axis,) if len(readings) == 1 else (there.rotation.T @ loop.axis, loop.axis2)[: len(readings)]
    return _Placed(
        loop.name,
        _TYPES[loop.kind],
        loop.link1,
        loop.link2,
        loop.placement2,
        np.array(pin.SE3ToXYZQUAT(there)),
        axes,
        () if is_ball else loop.bounds or (Bounds(),) * len(readings),
        readings,
        physics=() if is_ball else loop.physics or (NO_PHYSICS,) * len(readings),
        ball=loop.bounds if is_ball else (),
        ball_physics=loop.physics[0] if is_ball and loop.physics else NO_PHYSICS,
        ball_axis=loop.axis if is_ball else None,
        closes=True,
    )


# ----------------------------------------------------------------------------------------------------


class _SdfWriter:
    def __init__(self, mechanism: Mechanism, folder: Path) -> None:
        self.mechanism = mechanism
        self.folder = folder
        self.notes: list[Note] = []
        self.at = _placements(mechanism)
        self.names = _Names(self.notes)
        self.frames = _frames(mechanism)
        self.still = fixed_to(mechanism, mechanism.root)
        self.loops = [self._turned(loop) for loop in mechanism.loops]
        for loop in mechanism.loops:
            if loop.kind not in _TYPES:
                raise UnsupportedError(
                    f"loop '{loop.name}' is {loop.kind}; SDFormat closes spherical, fixed, revolute, prismatic and "
                    "universal loops: cut the loop at another joint"
                )

    def write(self) -> etree._Element:
        root = etree.Element("sdf", {"version": _VERSION}, {OWN_PREFIX: OWN, "drake": DRAKE})
        holder = root
        gravity = self.mechanism.gravity
        if gravity not in (None, STANDARD_GRAVITY):
            holder = etree.SubElement(root, "world", name="default")
            etree.SubElement(holder, "gravity").text = number_text(gravity)
        model = etree.SubElement(
            holder, "model", name=self.names.free(self.mechanism.name or "robot", "model")
        )
        self.names = _Names(self.notes)  # those of the parts are a space of their own
        links = {link.name: self.names.of_link(link.name) for link in self._written_links()}
        self.links = {**links, **({WORLD: WORLD} if self.mechanism.root == WORLD else {})}
        if self.mechanism.platform is not None:
            set_own(model, platform=self.links[self.mechanism.platform])
        self._links(model)
        self._joints(model)
        etree.cleanup_namespaces(root)
        return root

    def _written_links(self) -> Iterator[Link]:
        crosses = {first.child for first, _, _ in _rows(self.mechanism).values()}
        for link in self.mechanism.links:
            if link.name not in crosses and not (link.name == WORLD == self.mechanism.root):
                yield link

    def _links(self, model: etree._Element) -> None:
        floats = {j.child: j for j in self.mechanism.joints if j.kind is JointKind.FLOATING}
        for link in self._written_links():
            if link.name in self.frames:
                continue
            element = etree.SubElement(model, "link", name=self.links[link.name])
            _write_pose(element, self.at[link.name])
            self._inertial(element, link)
            if link.name in floats:
                self._float(element, floats[link.name])
            names = _Names([])
            for tag, shapes in (("visual", link.visuals), ("collision", link.collisions)):
                for shape in shapes:
                    self._shape(element, tag, shape, names, link)
        if self.mechanism.root == WORLD:
            self._note_world(self.mechanism.link(WORLD))
        for name, mount in self.frames.items():
            element = etree.SubElement(
                model, "frame", name=self.links[name], attached_to=self.links[mount.parent]
            )
            _write_pose(element, mount.placement)
            if mount.name != f"{self.links[name]}_frame":
                set_own(element, joint=mount.name)

    def _note_world(self, world: Link) -> None:
        if world.inertia is not None or world.visuals or world.collisions:
            self.notes.append(
                Note("link 'world'", "its mass and shapes are left out: SDFormat's world is no link")
            )

    def _inertial(self, element: etree._Element, link: Link) -> None:
        inertia = link.inertia
        if inertia is None:
            set_own(element, body="false")
            if link.name in self.still:
                return  # what holds still needs no mass, and readers give it some
            text = "no body: written as one without mass, which some simulators refuse"
            self.notes.append(Note(f"link '{link.name}'", text, Outcome.CHANGED))
            inertia = pin.Inertia.Zero()
        inertial = etree.SubElement(element, "inertial")
        _write_pose(inertial, pin.SE3(np.eye(3), inertia.lever))
        etree.SubElement(inertial, "mass").text = number_text([inertia.mass])
        entries = etree.SubElement(inertial, "inertia")
        for key, at in INERTIA_ENTRIES.items():
            etree.SubElement(entries, key).text = number_text([inertia.inertia[at]])

    def _float(self, element: etree._Element, joint: Joint) -> None:
        if joint.parent != self.mechanism.root:
            raise UnsupportedError(
                f"joint '{joint.name}' lets link '{joint.child}' float on '{joint.parent}', which moves; links of "
                "SDFormat float in the world"
            )
        if joint.name != f"{joint.child}_floating":
            set_own(element, joint=joint.name)
        if not np.array_equal(joint.placement.homogeneous, np.eye(4)):
            set_own(element, position=number_text(self.mechanism.home[joint.name]))
        write_own_dynamics(element, joint.physics)
        self._note_physics(joint.name, joint.physics, is_loop=False)
        etree.SubElement(element, "must_be_base_link").text = "true"

    def _joints(self, model: etree._Element) -> None:
        root = self.mechanism.root
        rows = _rows(self.mechanism)
        home = self.mechanism.home
        seconds = {second.name for _, second, _ in rows.values()}
        mounts = {mount.name for mount in self.frames.values()}
        placed: list[_Placed] = []
        for joint in self.mechanism.joints:
            if joint.name in rows:
                placed.append(_of_row(*rows[joint.name], home))
            elif joint.kind is not JointKind.FLOATING and joint.name not in mounts | seconds:
                placed.append(_of_tree(joint, home.get(joint.name, np.zeros(0))))
        placed += [_of_loop(loop, self.at) for loop in self.loops]
        if root != WORLD:
            name = next(
                _numbered(f"{WORLD}_fixed", {joint.name for joint in placed} | set(self.links.values()))
            )
            element = etree.SubElement(model, "joint", name=self.names.free(name, "joint"), type="fixed")
            etree.SubElement(element, "parent").text = WORLD
            etree.SubElement(element, "child").text = self.links[root]
        written: dict[str, tuple[etree._Element, str]] = {}
        for joint in placed:
            written |= self._joint(model, joint)
        skipped = {f"{first.name}_thread" for first, _, lead in rows.values() if lead}
        for coupling in self.mechanism.couplings:
            if coupling.name not in skipped:
                self._coupling(coupling, written)

    def _joint(self, model: etree._Element, joint: _Placed) -> dict[str, tuple[etree._Element, str]]:
        """Write a joint; return the axis that stands for each joint of the tree."""
        name = self.names.of_joint(joint.name)
        element = etree.SubElement(model, "joint", name=name, type=joint.written)
        if name != joint.name:
            set_own(element, name=joint.name)
        if joint.written == "universal":
            for k, part in enumerate(joint.parts, 1):
                if part.name != f"{name}_{k}":
                    set_own(element, **{f"part{k}": part.name})
            if joint.cross or (joint.parts and name != joint.name):
                set_own(element, between=joint.cross or f"{joint.name}_between_1")
        _write_pose(element, joint.in_child)
        etree.SubElement(element, "parent").text = self.links[joint.parent]
        etree.SubElement(element, "child").text = self.links[joint.child]
        if _moves(joint.position):
            set_own(element, position=number_text(joint.position))
        if any(part.has_axis for part in joint.parts):
            set_own(element, independent="true" if any(part.independent for part in joint.parts) else "false")
        if joint.lead:
            etree.SubElement(element, "screw_thread_pitch").text = number_text([joint.lead])
        written = self._axes(element, joint)
        for key, bounds in zip(loop_coordinates(JointKind.SPHERICAL), joint.ball, strict=bool(joint.ball)):
            write_own_limit(element, key, bounds)
        if joint.ball_axis is not None and not np.array_equal(joint.ball_axis, [0, 0, 1]):
            set_own(element, axis=number_text(joint.ball_axis))
        if joint.ball_physics:
            self._ball_physics(element, joint)
        if joint.closes:
            engine = etree.SubElement(etree.SubElement(element, "physics"), "simbody")
            etree.SubElement(engine, "must_be_loop_joint").text = "true"
        return written

    def _axes(self, element: etree._Element, joint: _Placed) -> dict[str, tuple[etree._Element, str]]:
        """Write what the axes of a joint may do, and what they do by themselves."""
        written: dict[str, tuple[etree._Element, str]] = {}
        for k, (axis, bounds, reading, physics) in enumerate(
            zip(joint.axes, joint.bounds, joint.readings, joint.physics, strict=True)
        ):
            inner = etree.SubElement(element, _AXES[k])
            etree.SubElement(inner, "xyz").text = number_text(axis)
            is_driven = bool(joint.parts) and joint.parts[k].independent
            write_limit(inner, bounds, reading, is_driven=is_driven)
            # Drake has a motor where an effort may be, and on joints of one axis.
            if physics.armature and is_driven and bounds.effort[1] != 0.0 and len(joint.axes) == 1:
                write_rotor(element, physics.armature)
                physics = replace(physics, armature=0.0)
            if not write_axis_dynamics(inner, counted_from(physics, -reading)):
                name = joint.parts[k].name if joint.parts else joint.name
                self._note_physics(name, physics, is_loop=joint.closes)
            if joint.parts:
                written[joint.parts[k].name] = inner, _AXES[k]
        return written

    def _ball_physics(self, element: etree._Element, joint: _Placed) -> None:
        """Write the damping of a ball where Drake looks for it, and the rest in words of our own."""
        if joint.ball_physics.damping:
            write_axis_dynamics(
                etree.SubElement(element, "axis"), JointPhysics(damping=joint.ball_physics.damping)
            )
        rest = replace(joint.ball_physics, damping=0.0)
        write_own_dynamics(element, rest, "turn")
        self._note_physics(joint.name, rest, is_loop=joint.closes)

    def _note_physics(self, name: str, physics: JointPhysics, *, is_loop: bool) -> None:
        if physics:
            text = f"{physics}: partly in words of our own; others know damping, friction and linear springs of axes"
            self.notes.append(Note(f"{'loop' if is_loop else 'joint'} '{name}'", text, Outcome.KEPT))

    def _coupling(self, coupling: Coupling, written: Mapping[str, tuple[etree._Element, str]]) -> None:
        offset, multiplier, *higher = (*coupling.polynomial, 0.0, 0.0)
        fault = ""
        if coupling.others:
            fault = "follows a sum of joints"
        elif coupling.joint2 is None:
            fault = "holds a joint still: make the joint fixed"
        elif any(higher):
            fault = "is not linear"
        elif written[coupling.joint1][0].find("mimic") is not None:
            fault = f"is the second that joint '{coupling.joint1}' follows: write the other joint of one of them first"
        if fault or coupling.joint2 is None:
            raise UnsupportedError(f"coupling '{coupling.name}' {fault}; format 'sdf' knows only <mimic>")
        axis, _ = written[coupling.joint1]
        leader, which = written[coupling.joint2]
        parent = leader.getparent()
        assert parent is not None
        element = etree.SubElement(axis, "mimic", joint=str(parent.get("name")), axis=which)
        if coupling.name != f"{coupling.joint1}_mimic":
            set_own(element, name=coupling.name)
        at1, at2 = (float(self.mechanism.home[name][0]) for name in (coupling.joint1, coupling.joint2))
        rest = offset + multiplier * at2 - at1
        # At home the coupling holds, to the digits of its terms.
        exact = abs(rest) <= _SAME_COUPLING * max(1.0, abs(offset), abs(at1), abs(multiplier * at2))
        for tag, value in (
            ("multiplier", multiplier),
            ("offset", 0.0 if exact else rest),
            ("reference", 0.0),
        ):
            etree.SubElement(element, tag).text = number_text([value])

    def _turned(self, loop: Loop) -> Loop:
        """Take a loop from the other side where its second link is the world, which is no child in SDFormat."""
        if not loop.link2 == WORLD == self.mechanism.root:
            return loop
        text = "told from its other side: SDFormat's world is no child"
        self.notes.append(Note(f"loop '{loop.name}'", text, Outcome.CHANGED))
        is_universal = loop.kind is JointKind.UNIVERSAL
        return replace(
            loop,
            link1=loop.link2,
            link2=loop.link1,
            placement1=loop.placement2,
            placement2=loop.placement1,
            axis=-loop.axis2
            if is_universal
            else loop.axis
            if loop.kind is JointKind.SPHERICAL
            else -loop.axis,
            axis2=-loop.axis if is_universal else loop.axis2,
            bounds=loop.bounds[::-1] if is_universal else loop.bounds,
            physics=loop.physics[::-1] if is_universal else loop.physics,
        )

    def _shape(self, link: etree._Element, tag: str, shape: Shape, names: _Names, owner: Link) -> None:
        name = names.free(shape.name or tag, "shape")
        element = etree.SubElement(link, tag, name=name)
        if name != shape.name:
            set_own(element, name=shape.name)
        _write_pose(element, shape.placement)
        geometry = etree.SubElement(etree.SubElement(element, "geometry"), str(shape.kind))
        values: dict[str, tuple[float, ...]]
        match shape.kind:
            case ShapeKind.BOX:
                values = {"size": shape.sizes}
            case ShapeKind.ELLIPSOID:
                values = {"radii": shape.sizes}
            case ShapeKind.MESH:
                etree.SubElement(geometry, "uri").text = path_from(self.folder, shape.mesh, shape.folder)
                values = {"scale": shape.sizes} if any(size != 1 for size in shape.sizes) else {}
            case _:
                values = dict(zip(("radius", "length"), ((size,) for size in shape.sizes), strict=False))
        for key, value in values.items():
            etree.SubElement(geometry, key).text = number_text(value)
        if shape.material is not None:
            self._material(element, tag, shape.material, owner)

    def _material(self, shape: etree._Element, tag: str, material: Material, owner: Link) -> None:
        subject = f"link '{owner.name}'"
        if material.texture:
            self.notes.append(Note(subject, f"{tag}: texture '{material.texture}' is left out"))
        if tag != "visual" or material.rgba is None:
            if material.name:
                self.notes.append(Note(subject, f"{tag}: the material '{material.name}' is left out"))
            return
        element = etree.SubElement(shape, "material")
        if material.name:
            set_own(element, name=material.name)
        for word in ("ambient", "diffuse"):
            etree.SubElement(element, word).text = number_text(material.rgba)


class _Names:
    """Names that SDFormat allows: each once among links, joints and frames of a model."""

    def __init__(self, notes: list[Note]) -> None:
        self.taken: set[str] = {WORLD}
        self.notes = notes

    def free(self, name: str, suffix: str) -> str:
        """Find a name that is still free, and take it."""
        # Readers take no notice of blanks around the text of an element.
        plain = name.replace("::", "_").strip() or suffix
        if plain == WORLD or (plain.startswith("__") and plain.endswith("__")):
            plain = f"{plain}_{suffix}"
        found = next(_numbered(plain, self.taken, suffix))
        self.taken.add(found)
        return found

    def of_link(self, name: str) -> str:
        """Name a link; note where it has to be another name."""
        found = self.free(name, "link")
        if found != name:
            text = f"called '{found}', as SDFormat keeps such names for itself"
            self.notes.append(Note(f"link '{name}'", text, Outcome.CHANGED))
        return found

    def of_joint(self, name: str) -> str:
        """Name a joint, which keeps its own name in a word of ours."""
        return self.free(name, "joint")


def _numbered(stem: str, taken: set[str], suffix: str = "") -> Iterator[str]:
    """List names that are free: itself, with a suffix, then with numbers."""
    named = f"{stem}_{suffix}" if suffix else stem
    candidates = [stem, named, *(f"{named}_{k}" for k in range(2, len(taken) + 4))]
    yield from (name for name in candidates if name not in taken)


def _placements(mechanism: Mechanism) -> dict[str, pin.SE3]:
    """Place every link in the world, at home."""
    placed = {mechanism.root: pin.SE3.Identity()}
    waiting = list(mechanism.joints)
    while waiting:
        later: list[Joint] = []
        for joint in waiting:
            if joint.parent not in placed:
                later.append(joint)
                continue
            values = mechanism.home.get(joint.name, np.zeros(0))
            placed[joint.child] = (
                placed[joint.parent] * joint.placement * motion(joint.kind, joint.axis, values)
            )
        waiting = later
    return placed


def _frames(mechanism: Mechanism) -> dict[str, Joint]:
    """Find the links that only mark a place on another one, with the joints that hold them there."""
    busy = {joint.parent for joint in mechanism.joints}
    busy |= {link for loop in mechanism.loops for link in (loop.link1, loop.link2)}
    bare = {
        link.name
        for link in mechanism.links
        if link.inertia is None and not (link.visuals or link.collisions)
    }
    return {
        joint.child: joint
        for joint in mechanism.joints
        if joint.kind is JointKind.FIXED and joint.child in bare - busy and joint.parent != WORLD
    }


def _moves(position: FloatArray) -> bool:
    """Tell whether a position, perhaps with a quaternion, is not zero."""
    plain = position[:-1] if len(position) >= 4 else position
    return bool(plain.any())


def _write_pose(element: etree._Element, placement: pin.SE3) -> None:
    rpy = rpy_from_rotation(placement.rotation)
    if placement.translation.any() or rpy.any():
        etree.SubElement(element, "pose").text = number_text([*placement.translation, *rpy])
