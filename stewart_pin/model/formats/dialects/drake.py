"""Drake's tags: loops as ``<drake:ball_constraint>``, joints that URDF lacks as ``<drake:joint>``.

A ball constraint holds point P of body A at point Q of body B; it has no name, and gets one from its bodies unless an
attribute ``name`` gives it. Drake's universal joint turns about x of its frame, then about y; its screw advances by
``<drake:screw_thread_pitch>`` per turn, right-handed; its planar joint moves across ``<axis>``. Drake reads ``<mimic>``
too. Of ``<dynamics>`` it reads the damping, of a planar joint three, and no friction; a motor's rotor stands in its
``<transmission>``, and counts by the square of the gear ratio. Springs between points are left out and noted. A
bushing, whose springs hold two frames together, stands for the joint with the freedoms that they leave, and is taken
for it, as if they were rigid.

References
----------
.. [1] Drake documentation, "Parsing Models in MultibodyPlant", tags drake:ball_constraint, drake:joint,
   drake:screw_thread_pitch, drake:linear_bushing_rpy.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.errors import UnsupportedError
from stewart_pin.geometry.rotations import rotation_from_rpy
from stewart_pin.model.description import Joint, JointKind, Loop, Mechanism, Note, Outcome
from stewart_pin.model.formats.dialect import Dialect, Parts, note_lost_limits
from stewart_pin.model.formats.dialects.mimic import write_mimics
from stewart_pin.model.formats.dynamics import note_lost_physics, note_unheard
from stewart_pin.model.formats.urdf_core import read_dynamics
from stewart_pin.model.formats.urdf_elements import UrdfElements
from stewart_pin.model.formats.urdf_writer import save, tree_element
from stewart_pin.model.formats.words import Words
from stewart_pin.model.formats.xml import number_text, shown_tag
from stewart_pin.model.unfolding import unfold_planar, unfold_screw, unfold_universal
from stewart_pin.typing import FloatArray

_NAMESPACE = "http://drake.mit.edu"
_WORLD = "world"
"""Name of the body that does not move."""
_BALL, _BUSHING = "drake:ball_constraint", "drake:linear_bushing_rpy"
_BUSHING_PARTS = (
    "frameA",
    "frameC",
    "force_stiffness",
    "torque_stiffness",
    "force_damping",
    "torque_damping",
)
_JOINTS = ("ball", "planar", "screw", "universal")
_X, _Y = np.eye(3)[:2]


def _read_ball(reader: UrdfElements, element: etree._Element) -> Parts:
    bodies = [reader.child(element, f"{_BALL}_body_{end}", f"<{_BALL}>") for end in "AB"]
    links = [reader.text(body, "name", f"<{_BALL}>") for body in bodies]
    owner = f"ball_constraint of '{links[0]}' and '{links[1]}'"
    tags = [f"{_BALL}_{part}" for part in ("body_A", "body_B", "p_AP", "p_BQ")]
    points = [reader.child(element, tag, owner) for tag in tags[2:]]
    places = [pin.SE3(np.eye(3), reader.numbers(point, "value", 3, owner)) for point in points]
    name = element.get("name") or _free_name(reader, element, f"{links[0]}_{links[1]}_ball")
    return Parts(loops=(Loop(name, JointKind.SPHERICAL, links[0], links[1], *places),))


def _free_name(reader: UrdfElements, element: etree._Element, stem: str) -> str:
    """Give each of several constraints between the same two bodies a number."""
    same = [f"{_BALL}_body_{end}" for end in "AB"]
    wanted = [_inner_name(element, tag) for tag in same]
    others = [e for e in reader.root.iterchildren(etree.Element) if shown_tag(e) == _BALL]
    twins = [e for e in others if e.get("name") is None and [_inner_name(e, tag) for tag in same] == wanted]
    return stem if len(twins) < 2 else f"{stem}_{twins.index(element) + 1}"


def _inner_name(element: etree._Element, tag: str) -> str | None:
    return next(
        (child.get("name") for child in element.iterchildren(etree.Element) if shown_tag(child) == tag), None
    )


def _read_joint(reader: UrdfElements, element: etree._Element) -> Parts:
    name = reader.text(element, "name", "a <drake:joint>")
    owner = f"joint '{name}'"
    written = reader.text(element, "type", owner)
    if written not in _JOINTS:
        raise reader.error(
            f"{owner}: <drake:joint> has the type '{written}'; supported: {', '.join(_JOINTS)}", owner
        )
    pitch = ("drake:screw_thread_pitch",) if written == "screw" else ()
    reader.only(
        element, owner, ("name", "type"), ("parent", "child", "origin", "axis", "dynamics", "limit", *pitch)
    )
    parent, child = reader.ends(element, owner)
    place = reader.origin(element, owner)
    if written == "ball":
        (physics,) = read_dynamics(reader, element, JointKind.SPHERICAL, owner)
        return Parts(joints=(Joint(name, JointKind.SPHERICAL, parent, child, place, physics=physics),))
    if written == "universal":
        both = read_dynamics(reader, element, JointKind.UNIVERSAL, owner)
        return Parts.of(unfold_universal(name, parent, child, place, _X, _Y).doing(both))
    axis = reader.axis(element, owner, "axis", "1 0 0")
    if written == "planar":
        each = read_dynamics(reader, element, JointKind.PLANAR, owner)
        # Drake's slides go other ways in the plane than ours, where its normal is not z.
        if each[0] != each[1] and abs(axis[2]) != 1:
            raise reader.error(
                f"{owner}: <dynamics> tells otherwise of x than of y, which Drake counts by axes of its own; turn the "
                "joint so that its <axis> is z",
                owner,
            )
        return Parts.of(unfold_planar(name, parent, child, place, axis).doing(each))
    thread = reader.child(element, "drake:screw_thread_pitch", owner)
    lead = float(reader.numbers(thread, "value", 1, owner)[0])
    turn = read_dynamics(reader, element, JointKind.REVOLUTE, owner)
    return Parts.of(unfold_screw(name, parent, child, place, axis, lead).doing(turn))


def joint_of_bushing(force: FloatArray, torque: FloatArray) -> tuple[JointKind, FloatArray] | None:
    """Find the joint that a bushing stands for: what its springs leave free is free, and what they hold is held.

    Parameters
    ----------
    force
        (3,) stiffness along x, y, z of the bushing's frames [N/m].
    torque
        (3,) stiffness of the turns about x, y, z [N m/rad].

    Returns
    -------
    tuple of JointKind and numpy.ndarray, or None
        Kind, and axis of a hinge (dimensionless); None: it stands for no joint.
    """
    free = [k for k in range(3) if torque[k] == 0]
    if not ((force > 0).all() and (torque >= 0).all() and len(free) != 2):
        return None
    kind = (JointKind.FIXED, JointKind.REVOLUTE, None, JointKind.SPHERICAL)[len(free)]
    assert kind is not None
    return kind, np.eye(3)[free[0]] if kind is JointKind.REVOLUTE else np.array([0.0, 0.0, 1.0])


def told_of_bushing(numbers: Mapping[str, str | None]) -> str:
    """Tell what becomes of a bushing, with its numbers: they have no part in a rigid joint.

    Parameters
    ----------
    numbers
        ``{tag: as written, or None}`` of what it holds.

    Returns
    -------
    str
        What is told.
    """
    springs = {tag: text for tag, text in numbers.items() if tag.endswith(("_stiffness", "_damping"))}
    told = ", ".join(
        f"{tag.removeprefix('drake:bushing_').replace('_', ' ')} {' '.join((text or 'not stated').split())}"
        for tag, text in springs.items()
    )
    return f"its springs are taken for rigid, and hold the frames together ({told})"


NO_JOINT = (
    "closes a loop by springs that stand for no joint: along all axes, and about none, two or all; write the joint, or "
    f"a <{_BALL}>"
)


def _read_bushing(reader: UrdfElements, element: etree._Element) -> Parts:
    owner = f"<{_BUSHING}> (line {element.sourceline})"
    force, torque = (
        reader.numbers(reader.child(element, f"drake:bushing_{what}_stiffness", owner), "value", 3, owner)
        for what in ("force", "torque")
    )
    found = joint_of_bushing(force, torque)
    if found is None:
        raise reader.error(f"{owner} {NO_JOINT}", f"<{_BUSHING}>")
    ends = [_frame(reader, reader.child(element, f"drake:bushing_frame{end}", owner), owner) for end in "AC"]
    (link1, place1, name), (link2, place2, _) = ends
    loop = Loop(f"{name}_bushing", found[0], link1, link2, place1, place2, axis=found[1])
    told = told_of_bushing(
        {shown_tag(child): child.get("value") for child in element.iterchildren(etree.Element)}
    )
    return Parts(loops=(loop,), notes=(Note(f"loop '{loop.name}'", told, Outcome.CHANGED),))


def _frame(reader: UrdfElements, end: etree._Element, owner: str) -> tuple[str, pin.SE3, str]:
    """Link that carries a ``<frame>`` of Drake, its placement there, and its name."""
    name = reader.text(end, "name", owner)
    frames = [frame for frame in reader.root.iterchildren("frame") if frame.get("name") == name]
    if not frames:
        raise reader.error(f"{owner} names the missing frame '{name}'; correct the name", name)
    whose = f"frame '{name}'"
    if len(frames) > 1:
        raise reader.error(f"{whose} stands {len(frames)} times; leave one of them", name)
    xyz, rpy = (reader.numbers(frames[0], key, 3, whose, "0 0 0") for key in ("xyz", "rpy"))
    return reader.text(frames[0], "link", whose), pin.SE3(rotation_from_rpy(*rpy), xyz), name


def _note_spring(reader: UrdfElements, element: etree._Element) -> Parts:
    """Tell a spring between two points of links, which is no joint's: with its numbers, as it pushes in Drake."""
    told = ", ".join(
        f"{shown_tag(each).rpartition('damper_')[2]} {each.get('value') or each.get('name')}"
        for each in element.iterchildren(etree.Element)
    )
    text = f"left out: a spring between points of two links, which no joint is; a joint may have one ({told})"
    return Parts(notes=(Note(f"<{shown_tag(element)}>", text),))


def write_drake(mechanism: Mechanism, path: Path) -> tuple[Note, ...]:
    """Write a mechanism as URDF with Drake's tags, so that Drake's own parser finds the loops.

    Spherical joints become ``<drake:joint type="ball">``. Drake lets a root link float, unless it is called
    ``world``: where no link is, one is added, and the ground is fixed to it. Couplings become ``<mimic>``, motors get a
    ``<transmission>``.

    Parameters
    ----------
    mechanism
        What to write.
    path
        File to create or overwrite.

    Returns
    -------
    tuple of Note
        What the dialect has no word for.

    Raises
    ------
    UnsupportedError
        If a loop is not spherical, a coupling is no ``<mimic>``, or a moving link is called ``world``.
    """
    robot, notes = tree_element(mechanism, path, {"drake": _NAMESPACE})
    write_mimics(robot, mechanism, "drake")
    for joint in mechanism.joints:
        if joint.kind is JointKind.SPHERICAL:
            element = next(e for e in robot.iter("joint") if e.get("name") == joint.name)
            element.tag = f"{{{_NAMESPACE}}}joint"
            element.set("type", "ball")
    if mechanism.root != _WORLD and any(link.name == _WORLD for link in mechanism.links):
        raise UnsupportedError(f"link '{_WORLD}' moves, but Drake calls its world so; rename it")
    if mechanism.root != _WORLD:
        _fix_to_world(robot, mechanism)
    for loop in mechanism.loops:
        if loop.kind is not JointKind.SPHERICAL:
            raise UnsupportedError(
                f"loop '{loop.name}' is of type '{loop.kind}'; Drake's URDF knows only ball constraints: "
                "loops_by_balls(chain) holds hinges and rigid closures by balls"
            )
        _write_ball(robot, loop)
    rotors: list[str] = []
    for joint in mechanism.joints:
        if joint.independent:
            rotors += _write_transmission(robot, joint)
    lost = (*note_lost_limits(mechanism, "drake"), *note_lost_physics(mechanism, "drake"))
    unheard = note_unheard(mechanism, "Drake", ("damping",), rotors)
    return (*notes, *lost, *unheard, *save(robot, mechanism, path))


def _fix_to_world(robot: etree._Element, mechanism: Mechanism) -> None:
    robot.insert(0, etree.Element("link", name=_WORLD))
    taken = {joint.name for joint in mechanism.joints}
    name = next(n for n in (f"{_WORLD}_fixed{'_' * k}" for k in range(len(taken) + 1)) if n not in taken)
    element = etree.SubElement(robot, "joint", name=name, type="fixed")
    etree.SubElement(element, "parent", link=_WORLD)
    etree.SubElement(element, "child", link=mechanism.root)


def _write_ball(robot: etree._Element, loop: Loop) -> None:
    element = etree.SubElement(robot, f"{{{_NAMESPACE}}}ball_constraint", name=loop.name)
    for end, link in zip("AB", (loop.link1, loop.link2), strict=True):
        etree.SubElement(element, f"{{{_NAMESPACE}}}ball_constraint_body_{end}", name=link)
    for points, place in zip(("p_AP", "p_BQ"), (loop.placement1, loop.placement2), strict=True):
        value = number_text(place.translation)
        etree.SubElement(element, f"{{{_NAMESPACE}}}ball_constraint_{points}", value=value)


def _write_transmission(robot: etree._Element, joint: Joint) -> list[str]:
    """Write a motor, with its rotor where Drake finds it there; return whose."""
    element = etree.SubElement(robot, "transmission", name=f"{joint.name}_transmission")
    etree.SubElement(element, "type").text = "transmission_interface/SimpleTransmission"
    etree.SubElement(element, "joint", name=joint.name)
    actuator = etree.SubElement(element, "actuator", name=f"{joint.name}_motor")
    # Drake has no motor where the effort may be none.
    if not joint.physics.armature or joint.bounds.effort[1] == 0:
        return []
    (told,) = (e for e in robot.iterfind("joint") if e.get("name") == joint.name)
    dynamics = told.find("dynamics")
    assert dynamics is not None
    for tag, value in (("rotor_inertia", dynamics.attrib.pop("armature")), ("gear_ratio", "1")):
        etree.SubElement(actuator, f"{{{_NAMESPACE}}}{tag}", value=str(value))
    if not dynamics.attrib:
        told.remove(dynamics)
    return [joint.name]


DIALECT = Dialect(
    "drake",
    "Drake's tags",
    {
        f"robot/{_BALL}": _read_ball,
        "robot/drake:joint": _read_joint,
        f"robot/{_BUSHING}": _read_bushing,
        "robot/frame": lambda reader, element: Parts(),
        "robot/drake:linear_spring_damper": _note_spring,
    },
    {
        _BALL: Words(("name",), tuple(f"{_BALL}_{part}" for part in ("body_A", "body_B", "p_AP", "p_BQ"))),
        **{f"{_BALL}_body_{end}": Words(("name",)) for end in "AB"},
        **{f"{_BALL}_{point}": Words(("value",)) for point in ("p_AP", "p_BQ")},
        "robot/frame": Words(("name", "link", "xyz", "rpy")),
        f"robot/{_BUSHING}": Words((), tuple(f"drake:bushing_{part}" for part in _BUSHING_PARTS)),
        **{f"drake:bushing_frame{end}": Words(("name",)) for end in "AC"},
        **{f"drake:bushing_{part}": Words(("value",)) for part in _BUSHING_PARTS[2:]},
        "robot/drake:joint": Words(
            ("name", "type"),
            ("parent", "child", "origin", "axis", "dynamics", "drake:screw_thread_pitch"),
            {"limit": "Drake reads none for joints of these types"},
        ),
        "drake:joint/parent": Words(("link",)),
        "drake:joint/child": Words(("link",)),
        "drake:screw_thread_pitch": Words(("value",)),
    },
    write=write_drake,
)
