"""From an SDFormat file to a mechanism.

A joint whose child link has a parent already closes a loop: Gazebo Classic's way. Drake's ``drake:ball_constraint``
closes one as well, and so does a DetachableJoint of Gazebo that holds two links of the file. Poses are those of the
links at rest, so that every loop is closed while all joints are at zero.
Shapes are read here too.

References
----------
.. [1] Open Robotics, "SDFormat Specification", versions 1.3 to 1.12.
.. [2] R. Tedrake et al., "Drake", multibody parsing: custom elements.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.errors import FileFormatError, UnsupportedError
from stewart_pin.model.description import (
    Coupling,
    Joint,
    JointKind,
    Link,
    Loop,
    Mechanism,
    Outcome,
    physics_coordinates,
)
from stewart_pin.model.formats.dialects.drake import (
    NO_JOINT,
    joint_of_bushing,
    told_of_bushing,
)
from stewart_pin.model.formats.precision import moved_by_digits, within_digits
from stewart_pin.model.formats.sdf.coordinates import read_own_dynamics, read_planar_damping
from stewart_pin.model.formats.sdf.couplings import is_gearbox, read_gearbox, read_mimics
from stewart_pin.model.formats.sdf.elements import OWN_DYNAMICS, SdfReader, held_model, own
from stewart_pin.model.formats.sdf.frames import WORLD, Scope
from stewart_pin.model.formats.sdf.joints import Axis, SdfJoint, ends, link_pose, read_joint
from stewart_pin.model.formats.sdf.models import MERGED, open_document
from stewart_pin.model.formats.sdf.tree import Float, grow_tree
from stewart_pin.model.formats.sdf.words import SHAPE_TAGS, WORDS
from stewart_pin.model.formats.xml import INERTIA_ENTRIES, shown_tag
from stewart_pin.model.joint_physics import NO_PHYSICS
from stewart_pin.model.shapes import Material, Shape, ShapeKind, fault_of_sizes
from stewart_pin.model.validation import keep_odd_inertias

_PLATFORM = "platform"


def read_sdf(path: Path) -> Mechanism:
    """Read a model from SDFormat.

    Links keep their SDFormat frames, and stand under one more link, the ground, called ``world``.

    Parameters
    ----------
    path
        File with ``<sdf>`` as its root: one model, or a world; all models of a world that have joints are read, as one.

    Returns
    -------
    Mechanism
        Description, not yet validated.

    Raises
    ------
    FileFormatError
        If the file is broken, names what does not exist, or holds something that could change the mechanism and is
        not understood.
    UnsupportedError
        If it uses a type of joint, an include or a force that is not supported.
    """
    document = open_document(path)
    model, notes = document.model, document.notes
    scopes = [scope for scope in model.models() if scope.element.tag == "model"]
    if model.static and any(scope.reader.children(scope.element, "joint") for scope in scopes):
        raise model.reader.error(
            f"{model.owner} is static, so that its joints cannot move; remove <static>, and hold its base by a fixed "
            "joint whose parent is world",
            model.owner,
        )
    links: list[Link] = []
    poses: dict[str, pin.SE3] = {}
    floating: set[str] = set()
    floats: dict[str, Float] = {}
    weightless: list[str] = []
    for scope in scopes:
        for element in scope.reader.children(scope.element, "link"):
            link = _link(scope, element, weightless, floating)
            links.append(link)
            poses[link.name] = link_pose(scope, link.name)
            told = _float(scope, element, link.name, poses[link.name])
            floats |= {} if told is None else {link.name: told}
    if not links:
        raise model.reader.error(f"{model.owner} has no <link>", model.owner)
    gravity = document.gravity
    if len(weightless) == len(links):
        gravity = (0.0, 0.0, 0.0)
    else:  # a simulator's force against the weight of some links, as is ``gravcomp`` in MJCF
        for name in weightless:
            model.reader.note(
                f"link '{name}'", "<gravity> off, others have it on: left out, the link has its weight"
            )
    # A world may hold the robot by joints of its own.
    holders = scopes if document.world is None else [*scopes, document.world]
    joints = [joint for scope in holders for joint in _joints(scope)]
    couplings: list[Coupling] = []
    for scope in holders:
        for element in scope.reader.children(scope.element, "joint"):
            if is_gearbox(element) and (coupling := read_gearbox(scope, element, joints)) is not None:
                couplings.append(coupling)
    couplings += read_mimics(model, joints)
    motors = _driven(model, joints)
    tree = grow_tree(
        joints,
        poses,
        fixed={scope.prefix + name for scope in scopes if scope.static for name in _own_links(scope)},
        based=floating,
        needed=_used(couplings, joints),
        motors=motors,
        source=str(path),
        floats=floats,
    )
    afloat = {joint.child for joint in tree.joints if joint.kind is JointKind.FLOATING}
    for name, told in floats.items():
        if told.physics and name not in afloat:
            text = f"<{OWN_DYNAMICS}>: {told.physics} left out, as it does not float"
            model.reader.note(f"link '{name}'", text)
    constraints = [loop for scope in scopes for loop in _ball_constraints(scope)]
    constraints += [loop for scope in scopes for loop in _bushings(scope, poses)]
    held = [loop for scope in scopes for loop in _detachable_joints(scope, poses)]
    frames, mounts = _frames(scopes, poses)
    everywhere = [*links, *tree.links, *frames]
    mechanism = Mechanism(
        name=model.element.get("name", path.stem),
        links=(Link(WORLD), *everywhere),
        joints=(*tree.joints, *mounts),
        loops=(*tree.loops, *constraints, *held),
        couplings=(*couplings, *tree.couplings),
        platform=_platform(model, everywhere),
        home=tree.home,
        source=str(path),
        notes=(*notes, *tree.notes),
        gravity=gravity,
        assembled=not constraints and _agree(joints),
    )
    return keep_odd_inertias(_with_own_names(mechanism, joints))


def _platform(model: Scope, links: list[Link]) -> str | None:
    told = model.reader.own(model.element, "platform")
    names = [link.name for link in links]
    if told is not None and told not in names:
        raise model.reader.error(
            f"{model.owner} names the platform '{told}', which is missing; the links are: {', '.join(names)}",
            told,
        )
    return told or (_PLATFORM if _PLATFORM in names else None)


def _float(scope: Scope, element: etree._Element, link: str, pose: pin.SE3) -> Float | None:
    """Read the name of the joint by which a link floats, and where its frame stands in the world."""
    reader, owner = scope.reader, f"link '{link}'"
    values = reader.own_numbers(element, "position", owner)
    physics = read_own_dynamics(reader, element, (), owner).get("", NO_PHYSICS)
    if values is None and reader.own(element, "joint") is None and not physics:
        return None
    name = reader.own(element, "joint") or f"{link}_floating"
    if values is None:
        return Float(name, physics=physics)
    if len(values) != 7:
        raise reader.error(f"{owner}: stewart_pin:position must hold a point and a quaternion", owner)
    values[3:] = reader.unit_quaternion(values[3:], owner)
    return Float(name, pose * pin.XYZQUATToSE3(values).inverse(), physics)


def _with_own_names(mechanism: Mechanism, joints: list[SdfJoint]) -> Mechanism:
    """Give joints and loops the names that SDFormat did not allow."""
    names = {made: name for joint in joints for made, name in joint.own_names.items()}
    if not names:
        return mechanism
    links = {made: name for made, name in names.items() if made.endswith("_between_1")}
    called = {**{joint.name: joint.name for joint in mechanism.joints}, **names}
    return replace(
        mechanism,
        links=tuple(replace(link, name=links.get(link.name, link.name)) for link in mechanism.links),
        joints=tuple(
            replace(
                joint,
                name=called[joint.name],
                parent=links.get(joint.parent, joint.parent),
                child=links.get(joint.child, joint.child),
            )
            for joint in mechanism.joints
        ),
        loops=tuple(replace(loop, name=names.get(loop.name, loop.name)) for loop in mechanism.loops),
        couplings=tuple(
            replace(
                coupling,
                joint1=called[coupling.joint1],
                joint2=coupling.joint2 and called[coupling.joint2],
            )
            for coupling in mechanism.couplings
        ),
        home={called[name]: value for name, value in mechanism.home.items()},
    )


def _own_links(scope: Scope) -> list[str]:
    return [scope.reader.name(element) for element in scope.reader.children(scope.element, "link")]


def _link(scope: Scope, element: etree._Element, weightless: list[str], floating: set[str]) -> Link:
    name, reader = scope.prefix + scope.reader.name(element), scope.reader
    if not reader.flag(element, "gravity", f"link '{name}'", default=True):
        weightless.append(name)
    if reader.flag(element, "must_be_base_link", f"link '{name}'"):
        floating.add(name)
    return read_link(reader, element, name)


def read_link(reader: SdfReader, element: etree._Element, name: str) -> Link:
    """Read a link: its body and its shapes.

    Parameters
    ----------
    reader
        Reader of the file.
    element
        The ``<link>``.
    name
        Its full name.

    Returns
    -------
    Link
        In its own frame; where that stands, and whether gravity acts on it, is asked elsewhere.

    Raises
    ------
    UnsupportedError
        If something outside the model moves it.
    """
    owner = f"link '{name}'"
    reader.note_strangers(element, owner, WORDS["link"])
    if reader.flag(element, "kinematic", owner):
        raise UnsupportedError(
            f"{reader.path}: {owner} (line {element.sourceline}) is <kinematic>: something outside the model moves it; "
            "remove the element, or the link"
        )
    itself = ("__link__", reader.name(element))
    visuals, collisions = (read_shapes(reader, element, tag, owner, itself) for tag in SHAPE_TAGS)
    is_body = reader.flag(element, own("body")[0], owner, default=True, attribute=True)
    return Link(name, _inertia(reader, element, owner) if is_body else None, visuals, collisions)


def _inertia(reader: SdfReader, element: etree._Element, owner: str) -> pin.Inertia:
    inertial = reader.optional(element, "inertial", owner)
    if inertial is None:
        # What the format's parsers assume.
        reader.note(owner, "has no <inertial>: 1 kg, 1 kg m² about every axis", Outcome.KEPT)
        return pin.Inertia(1.0, np.zeros(3), np.eye(3))
    if reader.flag(inertial, "auto", owner, attribute=True) or reader.children(inertial, "density"):
        raise UnsupportedError(
            f"{reader.path}: {owner} (line {inertial.sourceline}) has its <inertial> computed from its shapes; write "
            "<mass> and <inertia>"
        )
    if reader.children(inertial, "fluid_added_mass"):
        raise UnsupportedError(
            f"{reader.path}: {owner} (line {inertial.sourceline}) has a <fluid_added_mass>, which no rigid body has; "
            "remove it"
        )
    reader.note_strangers(inertial, owner, WORDS["inertial"])
    mass = reader.number(inertial, "mass", owner, "1")
    entries = reader.optional(inertial, "inertia", owner)
    matrix = np.eye(3)
    if entries is not None:
        reader.note_strangers(entries, owner, WORDS["inertia"])
        there = [key for key in WORDS["inertia"].tags if entries.find(key) is not None]
        found = {key: reader.number(entries, key, owner, "1" if key[1] == key[2] else "0") for key in there}
        whole, told = reader.whole_inertia(found, entries.sourceline, owner)
        for text in told:
            reader.note(owner, text, Outcome.CHANGED)
        for key, value in whole.items():
            i, j = INERTIA_ENTRIES[key]
            matrix[i, j] = matrix[j, i] = value
        texts = (child.text or "" for child in entries if isinstance(child.tag, str))
        matrix, moved = within_digits(matrix, texts)
        if moved:
            reader.note(owner, moved_by_digits(moved), Outcome.CHANGED)
    placement, relative_to = reader.pose(inertial, owner)
    if relative_to:
        raise reader.error(
            f"{owner}: the <pose> of its <inertial> (line {inertial.sourceline}) is relative to '{relative_to}', but "
            "it stands in the link frame always; remove the attribute",
            owner,
        )
    turned = placement.rotation @ matrix @ placement.rotation.T
    # Set afterwards: the constructor refuses negative moments with an error that names nothing.
    inertia = pin.Inertia(mass, placement.translation, np.zeros((3, 3)))
    inertia.inertia = (turned + turned.T) / 2
    return inertia


def _joints(scope: Scope) -> list[SdfJoint]:
    reader = scope.reader
    joints = [
        read_joint(scope, element)
        for element in reader.children(scope.element, "joint")
        if not is_gearbox(element)
    ]
    joints += [_drake_joint(scope, element) for element in reader.children(scope.element, "drake:joint")]
    for element in reader.children(scope.element, "drake:tendon_constraint"):
        raise UnsupportedError(
            f"{reader.path}: <drake:tendon_constraint> (line {element.sourceline}) of {scope.owner} is not understood; "
            "write <mimic> where joints are to move together"
        )
    return joints


def _drake_joint(scope: Scope, element: etree._Element) -> SdfJoint:
    """Read Drake's planar joint: at zero, the frames of both links are one, whatever their poses in the file."""
    reader = scope.reader
    name = scope.prefix + reader.name(element)
    owner = f"joint '{name}'"
    written = reader.text(element, "type", owner)
    if written != "planar" or reader.children(element, "pose"):
        raise UnsupportedError(
            f"{reader.path}: <drake:joint> '{name}' (line {element.sourceline}) of type '{written}'; supported: "
            "planar, without a <pose>"
        )
    reader.note_strangers(element, owner, WORDS["drake:joint"])
    plain = etree.Element("joint", name=name)
    for tag in ("parent", "child"):
        etree.SubElement(plain, tag).text = reader.content(element, f"drake:{tag}", owner)
    parent, child = ends(scope, plain, owner)
    reader.note(owner, "<drake:joint>: at zero, both link frames are one", Outcome.KEPT)
    one, normal = pin.SE3.Identity(), np.array([0.0, 0.0, 1.0])
    damping = read_planar_damping(reader, element, owner)
    physics = dict(zip(physics_coordinates(JointKind.PLANAR), damping, strict=True))
    return SdfJoint(
        name, written, JointKind.PLANAR, parent, child, one, one, (Axis(normal),), own_physics=physics
    )


def _ball_constraints(scope: Scope) -> list[Loop]:
    """Read Drake's constraints that hold a point of one link at a point of another."""
    reader, tag = scope.reader, "drake:ball_constraint"
    loops: list[Loop] = []
    for number, element in enumerate(reader.children(scope.element, tag), start=1):
        owner = f"<{tag}> {number} (line {element.sourceline})"
        ends_of = ("body_A", "body_B")
        points = ("p_AP", "p_BQ")
        reader.note_strangers(element, owner, WORDS[tag])
        names = [scope.body(reader.content(element, f"{tag}_{part}", owner), owner) for part in ends_of]
        at = [pin.SE3(np.eye(3), reader.vector(element, f"{tag}_{part}", 3, owner)) for part in points]
        name = f"{scope.prefix}ball_constraint_{number}"
        loops.append(Loop(name, JointKind.SPHERICAL, names[0], names[1], at[0], at[1]))
    return loops


def _bushings(scope: Scope, poses: dict[str, pin.SE3]) -> list[Loop]:
    """Read Drake's bushings as the joints that they stand for."""
    reader, tag = scope.reader, "drake:linear_bushing_rpy"
    loops: list[Loop] = []
    for number, element in enumerate(reader.children(scope.element, tag), start=1):
        owner = f"<{tag}> {number} (line {element.sourceline})"
        reader.note_strangers(element, owner, WORDS[tag])
        force, torque = (
            reader.vector(element, f"drake:bushing_{what}_stiffness", 3, owner)
            for what in ("force", "torque")
        )
        found = joint_of_bushing(force, torque)
        if found is None:
            raise UnsupportedError(f"{reader.path}: {owner} {NO_JOINT}")
        frames = [reader.content(element, f"drake:bushing_frame{end}", owner) for end in "AC"]
        bodies = [scope.body(frame, owner) for frame in frames]
        at = [
            poses.get(body, pin.SE3.Identity()).inverse() * scope.pose(frame, owner)
            for body, frame in zip(bodies, frames, strict=True)
        ]
        name = f"{scope.prefix}bushing_{number}"
        loops.append(Loop(name, found[0], *bodies, *at, axis=found[1]))
        told = told_of_bushing(
            {shown_tag(child): child.text for child in element.iterchildren(etree.Element)}
        )
        reader.note(f"loop '{name}'", told, Outcome.CHANGED)
    return loops


def _detachable_joints(scope: Scope, poses: dict[str, pin.SE3]) -> list[Loop]:
    """Read what holds a link of a model at another one as they lie at rest, until it is detached."""
    reader = scope.reader
    loops: list[Loop] = []
    plugins = [(each, held_model(each)) for each in reader.children(scope.element, "plugin")]
    for number, (element, held) in enumerate(((e, held) for e, held in plugins if held is not None), start=1):
        owner = f"DetachableJoint {number} (line {element.sourceline})"
        other = scope.parent.nested[held] if held and scope.parent is not None else scope
        one, two = (
            end.body(reader.content(element, tag, owner), owner)
            for end, tag in ((scope, "parent_link"), (other, "child_link"))
        )
        placed = poses[one].actInv(poses[two])
        name = f"{scope.prefix}detachable_joint_{number}"
        loops.append(Loop(name, JointKind.FIXED, one, two, placed, pin.SE3.Identity()))
    return loops


def _driven(model: Scope, joints: list[SdfJoint]) -> list[str]:
    """Find the motors where the file tells: every axis states its effort, and that of some joints is zero."""
    if any(joint.is_driven is not None for joint in joints):
        return [joint.name for joint in joints if joint.is_driven]
    movable = [joint for joint in joints if joint.kind in (JointKind.REVOLUTE, JointKind.PRISMATIC)]
    efforts = [joint.axes[0].effort for joint in movable]
    if None in efforts or 0.0 not in efforts or not any(efforts):
        return []
    driven = [joint.name for joint, effort in zip(movable, efforts, strict=True) if effort]
    for name in driven:
        model.reader.note(f"joint '{name}'", "a motor: every other axis has <effort>0</effort>", Outcome.KEPT)
    return driven


def _agree(joints: list[SdfJoint]) -> bool:
    """Tell whether the links of the file stand as its couplings and planar joints want them."""
    rules = [axis.follow for joint in joints for axis in joint.axes if axis.follow is not None]
    shifted = any(rule.offset - rule.multiplier * rule.reference for rule in rules)
    return not shifted and all(joint.kind is not JointKind.PLANAR for joint in joints)


def _used(couplings: list[Coupling], joints: list[SdfJoint]) -> set[str]:
    """Name the joints of the file whose positions couplings use."""
    used = {name for coupling in couplings for name in coupling.joints}
    return {joint.name for joint in joints if used & {joint.name, f"{joint.name}_1", f"{joint.name}_2"}}


def _frames(scopes: list[Scope], poses: dict[str, pin.SE3]) -> tuple[list[Link], list[Joint]]:
    """Make a link without inertia of every ``<frame>``, so that it may be the platform."""
    links: list[Link] = []
    mounts: list[Joint] = []
    for scope in scopes:
        for element in scope.reader.children(scope.element, "frame"):
            written = scope.reader.name(element)
            if written.startswith(MERGED):
                continue
            name = scope.prefix + written
            owner = f"frame '{name}'"
            carrier = scope.body(written, owner)
            placement = poses.get(carrier, pin.SE3.Identity()).inverse() * scope.pose(written, owner)
            links.append(Link(name))
            mount = scope.reader.own(element, "joint") or f"{name}_frame"
            mounts.append(Joint(mount, JointKind.FIXED, carrier, name, placement))
    return links, mounts


# ----------------------------------------------------------------------------------------------------
# Shapes of SDFormat: ``<visual>`` and ``<collision>`` of links, and their colours
#
# A shape that cannot be read is left out with a note: no equation of motion depends on it.
# ----------------------------------------------------------------------------------------------------

_SIZES = {
    ShapeKind.CYLINDER: ("radius", "length"),
    ShapeKind.CAPSULE: ("radius", "length"),
    ShapeKind.SPHERE: ("radius",),
}
_VECTORS = {ShapeKind.BOX: "size", ShapeKind.ELLIPSOID: "radii"}


def read_shapes(
    reader: SdfReader, link: etree._Element, tag: str, owner: str, frames: tuple[str, ...]
) -> tuple[Shape, ...]:
    """Read the shapes of a link.

    Parameters
    ----------
    reader
        Reader of the file.
    link
        The ``<link>``.
    tag
        ``visual`` or ``collision``.
    owner
        Named in messages and notes.
    frames
        Names under which a pose may call the frame of the link itself.

    Returns
    -------
    tuple of Shape
        Those that can be read; the others are noted.
    """
    shapes: list[Shape] = []
    for element in reader.children(link, tag):
        try:
            shapes.append(_shape(reader, element, owner, frames))
        except FileFormatError as error:
            why = str(error).removeprefix(f"{reader.path}: ").removeprefix(owner).lstrip(": ")
            reader.note(owner, f"<{tag}>: left out, {why}")
    return tuple(shapes)


def _shape(reader: SdfReader, element: etree._Element, owner: str, frames: tuple[str, ...]) -> Shape:
    placement, relative_to = reader.pose(element, owner)
    if relative_to not in ("", *frames):
        raise reader.error(f"its <pose> is relative to '{relative_to}', not to its link", owner)
    geometry = reader.child(element, "geometry", owner)
    inside = list(geometry.iterchildren(etree.Element))
    if len(inside) != 1:
        raise reader.error(f"its <geometry> holds {len(inside)} shapes, and is to hold one", owner)
    told, written = inside[0], shown_tag(inside[0])
    if written not in list(ShapeKind):
        raise reader.error(f"shapes of type <{written}> are not understood", owner)
    kind = ShapeKind(written)
    sizes = _sizes(reader, told, kind, owner)
    fault = fault_of_sizes(kind, sizes)
    if fault:
        raise reader.error(fault, owner)
    told_name = reader.own(element, "name")
    name, mesh = element.get("name", "") if told_name is None else told_name, ""
    if kind is ShapeKind.MESH:
        if reader.children(told, "submesh"):
            raise reader.error("it shows a part of a mesh only, a <submesh>", owner)
        mesh = reader.content(told, "uri", owner)
    return Shape(
        kind, sizes, placement, name, mesh.removeprefix("file://"),
        str(Path(reader.path).resolve().parent) if mesh else "", _material(reader, element, owner),
    )  # fmt: skip


def _sizes(reader: SdfReader, told: etree._Element, kind: ShapeKind, owner: str) -> tuple[float, ...]:
    if kind in _SIZES:
        return tuple(reader.number(told, tag, owner) for tag in _SIZES[kind])
    if kind in _VECTORS:
        return tuple(map(float, reader.vector(told, _VECTORS[kind], 3, owner)))
    return tuple(map(float, reader.vector(told, "scale", 3, owner, "1 1 1")))


def _material(reader: SdfReader, element: etree._Element, owner: str) -> Material | None:
    material = reader.optional(element, "material", owner)
    if material is None:
        return None
    for tag in ("diffuse", "ambient"):
        told = reader.optional(material, tag, owner)
        if told is not None:
            values = [
                float(value) for value in reader.parse((told.text or ""), None, f"{owner}: <{tag}>", owner)
            ]
            if len(values) not in (3, 4):
                raise reader.error(f"<{tag}> must hold 3 or 4 numbers, got {len(values)}", owner)
            red, green, blue, opacity = (*values, 1.0)[:4]
            return Material(reader.own(material, "name") or "", (red, green, blue, opacity))
    reader.note(owner, "<material>: only <diffuse> and <ambient> are read")
    return None
