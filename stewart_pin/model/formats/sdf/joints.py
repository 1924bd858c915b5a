"""Joints of SDFormat as the file gives them: two links, a frame in each, axes with their limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.errors import UnsupportedError
from stewart_pin.model.description import Bounds, JointKind, Outcome, Span, loop_coordinates
from stewart_pin.model.formats.sdf.coordinates import read_axis_dynamics, read_free_physics, read_rotor
from stewart_pin.model.formats.sdf.elements import OWN_LIMIT, SPANS, SdfReader, direction, own
from stewart_pin.model.formats.sdf.frames import MODEL, WORLD, Scope, coordinates_between, motion
from stewart_pin.model.formats.sdf.words import DRAKE_ROTOR, WORDS
from stewart_pin.model.formats.xml import shown_tag
from stewart_pin.model.joint_physics import NO_PHYSICS, JointPhysics
from stewart_pin.typing import FloatArray

# ----------------------------------------------------------------------------------------------------
# Axes of SDFormat joints: directions, limits, and other axes that they follow
# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Follow:
    """An axis that follows another one: ``follower = multiplier (leader - reference) + offset``.

    Attributes
    ----------
    leader, leader_axis
        Full name of the joint, and which axis of it.
    multiplier, offset, reference
        The law, in the units of both axes [m or rad].
    name
        Name of the coupling, perhaps empty.
    """

    leader: str
    leader_axis: str
    multiplier: float
    offset: float
    reference: float
    name: str = ""


@dataclass(frozen=True, eq=False)
class Axis:
    """One axis of a joint.

    Attributes
    ----------
    direction
        (3,) unit vector in the joint frame, dimensionless.
    lower, upper
        Position limits [m or rad].
    effort
        Largest effort [N or N m], or None where the file states none.
    velocity
        Largest speed [m/s or rad/s].
    acceleration
        Largest acceleration, Drake's extension [m/s² or rad/s²].
    follow
        The axis that it follows, or None.
    spans
        Limits that are not opposite, and of the jerk, as (least, greatest); they come before the numbers above.
    physics
        What it does by itself, as the file counts.
    """

    direction: FloatArray
    lower: float = -inf
    upper: float = inf
    effort: float | None = None
    velocity: float = inf
    acceleration: float = inf
    follow: Follow | None = None
    spans: Mapping[str, Span] = field(default_factory=dict)
    physics: JointPhysics = NO_PHYSICS


def read_axis(
    scope: Scope, joint: etree._Element, tag: str, placement: pin.SE3, owner: str, *, endless: bool
) -> Axis:
    """Read an axis of a joint.

    Parameters
    ----------
    scope
        Model that holds the joint.
    joint
        Its element.
    tag
        ``axis`` or ``axis2``.
    placement
        Joint in the world.
    owner
        The joint, for messages.
    endless
        Whether the joint is continuous.

    Returns
    -------
    Axis
        Direction, limits, and what it follows.
    """
    reader = scope.reader
    element = reader.child(joint, tag, owner)
    reader.note_strangers(element, owner, WORDS["axis"])
    axis = axis_direction(scope, element, placement, owner)
    limit = reader.optional(element, "limit", owner)
    follow = _follow(scope, joint, element, tag, owner)
    physics = read_axis_dynamics(reader, element, owner)
    if limit is None:
        return Axis(axis, follow=follow, physics=physics)
    reader.note_strangers(limit, owner, WORDS["axis/limit"])
    lower, upper, effort, velocity, acceleration = (
        reader.bound(limit, key, owner)
        for key in ("lower", "upper", "effort", "velocity", "drake:acceleration")
    )
    if endless:
        if lower is not None or upper is not None:
            reader.note(owner, "<limit> lower, upper: the joint is continuous")
        lower = upper = None
    return Axis(
        axis,
        lower=-inf if lower is None else lower,
        upper=inf if upper is None else upper,
        # A negative limit is none.
        effort=inf if effort is not None and effort < 0 else effort,
        velocity=inf if velocity is None or velocity < 0 else velocity,
        acceleration=inf if acceleration is None or acceleration < 0 else acceleration,
        follow=follow,
        spans=reader.own_spans(limit, owner),
        physics=physics,
    )


def axis_direction(scope: Scope, element: etree._Element, placement: pin.SE3, owner: str) -> FloatArray:
    """Read an axis in the frame of its joint.

    Parameters
    ----------
    scope
        Model that holds the joint.
    element
        ``<axis>`` or ``<axis2>``.
    placement
        Joint in the world.
    owner
        The joint, for messages.

    Returns
    -------
    numpy.ndarray
        (3,) unit vector in the joint frame, dimensionless.
    """
    reader = scope.reader
    xyz = reader.optional(element, "xyz", owner)
    if xyz is None:
        reader.note(owner, f"<{shown_tag(element)}> has no <xyz>: z, the format's default", Outcome.KEPT)
    else:
        reader.only(xyz, owner, WORDS["axis/xyz"].attributes)
    vector = reader.vector(element, "xyz", 3, owner, "0 0 1")
    frame = "" if xyz is None else xyz.get("expressed_in") or ""
    old = reader.flag(element, "use_parent_model_frame", owner)
    if old and scope.version >= (1, 7):
        raise reader.error(
            f"{owner}: <use_parent_model_frame> (line {element.sourceline}) ended with version 1.6; write "
            f"<xyz expressed_in='{MODEL}'>",
            owner,
        )
    if old or scope.version < (1, 5):
        frame = MODEL
    if frame:
        vector = placement.rotation.T @ (scope.pose(frame, owner).rotation @ vector)
    return direction(reader, vector, owner)


def _follow(scope: Scope, joint: etree._Element, axis: etree._Element, tag: str, owner: str) -> Follow | None:
    reader = scope.reader
    mimic = reader.optional(axis, "mimic", owner)
    drakes = reader.optional(joint, "drake:mimic", owner) if tag == "axis" else None
    if mimic is not None and drakes is not None:
        raise reader.error(f"{owner} has a <mimic> and a <drake:mimic>; keep one", owner)
    if drakes is not None:
        reader.only(drakes, owner, WORDS["drake:mimic"].attributes)
        multiplier, offset = (
            float(reader.numbers(drakes, key, 1, owner)[0]) for key in ("multiplier", "offset")
        )
        leader = scope.prefix + reader.text(drakes, "joint", owner)
        return Follow(leader, "axis", multiplier, offset, 0.0)
    if mimic is None:
        return None
    reader.only(mimic, owner, WORDS["axis/mimic"].attributes, WORDS["axis/mimic"].tags)
    which = mimic.get("axis", "axis")
    if which not in ("axis", "axis2"):
        raise reader.error(
            f"{owner}: <mimic axis='{which}'> (line {mimic.sourceline}) must be axis or axis2", owner
        )
    return Follow(
        leader=scope.prefix + reader.text(mimic, "joint", owner),
        leader_axis=which,
        multiplier=reader.number(mimic, "multiplier", owner, "1"),
        offset=reader.number(mimic, "offset", owner, "0"),
        reference=reader.number(mimic, "reference", owner, "0"),
        name=reader.own(mimic, "name") or "",
    )


# ----------------------------------------------------------------------------------------------------

KINDS = {
    "fixed": JointKind.FIXED,
    "revolute": JointKind.REVOLUTE,
    "continuous": JointKind.REVOLUTE,
    "prismatic": JointKind.PRISMATIC,
    "ball": JointKind.SPHERICAL,
    "universal": JointKind.UNIVERSAL,
    "revolute2": JointKind.UNIVERSAL,
    # Turn and slide along one axis, which the thread couples.
    "screw": JointKind.CYLINDRICAL,
}
"""What a type leaves free."""
AXES = {
    JointKind.REVOLUTE: ("axis",),
    JointKind.PRISMATIC: ("axis",),
    JointKind.CYLINDRICAL: ("axis",),
    JointKind.UNIVERSAL: ("axis", "axis2"),
}
"""Axes that a kind has."""
GEARBOX = "gearbox"
_POSE = 7
"""Numbers of a placement: a point and a quaternion."""
_READINGS = {
    JointKind.REVOLUTE: 1,
    JointKind.PRISMATIC: 1,
    JointKind.CYLINDRICAL: 1,
    JointKind.UNIVERSAL: 2,
    JointKind.SPHERICAL: 4,
}
"""How many numbers a joint of the tree reads; a screw only its turn."""


@dataclass(frozen=True, eq=False)
class SdfJoint:
    """A joint of the file, before anything decides whether it hangs its child or closes a loop.

    Attributes
    ----------
    name, written
        Full name, and type as written.
    kind
        What it leaves free; a screw is cylindrical here.
    parent, child
        Full link names; the parent may be the world.
    in_parent, in_child
        Frame of the joint in both links, at zero.
    axes
        As many as the type has.
    lead
        Travel of a screw per turn [m], positive for a right-hand thread.
    must_close
        Whether the file asks that it closes a loop.
    own_names
        Names that it and what stands for it had before SDFormat wanted others, by those of the file.
    is_driven
        Whether a motor drives it, where the file says so in our own word.
    position
        What it reads at rest, where that is not zero [m, rad, quaternion].
    own_bounds
        Limits that SDFormat has no word for, by coordinate.
    own_physics
        What coordinates do that have no axis in SDFormat.
    ball_axis
        (3,) axis from which the swing of a ball is counted, in the joint frame, dimensionless; None: z.
    """

    name: str
    written: str
    kind: JointKind
    parent: str
    child: str
    in_parent: pin.SE3
    in_child: pin.SE3
    axes: tuple[Axis, ...] = ()
    lead: float = 0.0
    must_close: bool = False
    own_names: Mapping[str, str] = field(default_factory=dict)
    is_driven: bool | None = None
    position: FloatArray | None = None
    own_bounds: Mapping[str, Bounds] = field(default_factory=dict)
    own_physics: Mapping[str, JointPhysics] = field(default_factory=dict)
    ball_axis: FloatArray | None = None

    @property
    def rest(self) -> pin.SE3:
        """Frame of the child in that of the parent, at rest, both turned to where the joint reads zero."""
        axes = [axis.direction for axis in self.axes]
        if self.position is None:
            return pin.SE3.Identity()
        if len(self.position) == _POSE:
            return pin.XYZQUATToSE3(self.position)
        if self.kind is JointKind.UNIVERSAL:
            second = motion(JointKind.REVOLUTE, axes[1], self.position[1:])
            return motion(JointKind.REVOLUTE, second.rotation @ axes[0], self.position[:1]) * second
        if self.lead:
            along = self.position * self.lead / (2 * np.pi)
            return motion(JointKind.REVOLUTE, axes[0], self.position) * motion(
                JointKind.PRISMATIC, axes[0], along
            )
        return motion(self.kind, axes[0] if axes else np.zeros(3), self.position)

    @property
    def readings(self) -> FloatArray:
        """(n,) what the joint reads at rest: one per axis, or the quaternion of a ball [m, rad]."""
        if self.kind is JointKind.SPHERICAL:
            return np.array([0.0, 0.0, 0.0, 1.0]) if self.position is None else self.position[-4:]
        if self.position is None or len(self.position) != _POSE:
            return np.zeros(len(self.axes)) if self.position is None else self.position
        first = self.rest.rotation @ self.axes[0].direction if self.axes else np.zeros(3)
        last = self.axes[-1].direction if self.axes else first
        return np.array(coordinates_between(self.kind, first, last, self.rest))


def read_joint(scope: Scope, element: etree._Element) -> SdfJoint:
    """Read a joint.

    Parameters
    ----------
    scope
        Model that holds it.
    element
        A ``<joint>`` of any type but ``gearbox``.

    Returns
    -------
    SdfJoint
        The joint.

    Raises
    ------
    UnsupportedError
        If its type exists, and is not understood.
    """
    reader = scope.reader
    name = scope.prefix + reader.name(element)
    owner = f"joint '{name}'"
    written = reader.text(element, "type", owner).lower()
    if written not in KINDS:
        raise UnsupportedError(
            f"{reader.path}: {owner} (line {element.sourceline}) has the type '{written}'; supported: "
            f"{', '.join([*sorted(KINDS), GEARBOX])}"
        )
    kind = KINDS[written]
    tags = AXES.get(kind, ())
    reader.note_strangers(element, owner, WORDS["joint"])
    for tag in ("axis", "axis2"):
        if tag not in tags and reader.children(element, tag) and (tag, kind) != ("axis", JointKind.SPHERICAL):
            reader.note(owner, f"<{tag}>: a joint of type '{written}' has none")
    parent, child = ends(scope, element, owner)
    placement, in_child = joint_frame(scope, element, child, owner)
    return SdfJoint(
        name=name,
        written=written,
        kind=kind,
        parent=parent,
        child=child,
        in_parent=link_pose(scope, parent).inverse() * placement,
        in_child=in_child,
        axes=_with_rotor(
            reader,
            element,
            [
                read_axis(scope, element, tag, placement, owner, endless=written == "continuous")
                for tag in tags
            ],
            owner,
        ),
        lead=read_lead(scope.reader, element, owner) if written == "screw" else 0.0,
        must_close=_must_close(scope, element, owner),
        own_names=_own_names(scope, element, name),
        is_driven=None
        if reader.own(element, "independent") is None
        else reader.flag(element, own("independent")[0], owner, attribute=True),
        position=_position(scope, element, kind, owner),
        own_bounds=_own_bounds(scope, element, kind, owner),
        own_physics=read_free_physics(reader, element, kind, owner, has_axes=bool(tags)),
        ball_axis=_ball_axis(scope, element, owner),
    )


def _with_rotor(reader: SdfReader, element: etree._Element, axes: list[Axis], owner: str) -> tuple[Axis, ...]:
    """Give an axis the rotor that Drake gives to it: that of the motor, which it has where an effort may be."""
    armature = read_rotor(reader, element, owner)
    if not armature:
        return tuple(axes)
    fault = ""
    if len(axes) != 1:
        fault = "Drake drives joints of one axis"
    elif axes[0].effort == 0.0:
        fault = "Drake drives no joint whose <effort> is 0"
    if fault:
        reader.note(owner, f"<{DRAKE_ROTOR[0]}>: its rotor of {armature:g} is left out, {fault}")
        return tuple(axes)
    if axes[0].physics.armature:
        raise reader.error(f"{owner} has a stewart_pin:armature and a <{DRAKE_ROTOR[0]}>; keep one", owner)
    return (replace(axes[0], physics=replace(axes[0].physics, armature=armature)),)


def _ball_axis(scope: Scope, element: etree._Element, owner: str) -> FloatArray | None:
    values = scope.reader.own_numbers(element, "axis", owner)
    if values is None:
        return None
    if len(values) != 3:
        raise scope.reader.error(f"{owner}: stewart_pin:axis must hold three numbers", owner)
    return direction(scope.reader, values, owner)


def _own_names(scope: Scope, element: etree._Element, name: str) -> dict[str, str]:
    keys = {"name": name, "part1": f"{name}_1", "part2": f"{name}_2", "between": f"{name}_between_1"}
    told = {made: scope.reader.own(element, key) for key, made in keys.items()}
    return {made: own_name for made, own_name in told.items() if own_name}


def _position(scope: Scope, element: etree._Element, kind: JointKind, owner: str) -> FloatArray | None:
    """Read what the joint reads at rest; a placement where it closes a loop."""
    values = scope.reader.own_numbers(element, "position", owner)
    if values is None:
        return None
    if len(values) not in (_READINGS.get(kind, _POSE), _POSE):
        raise scope.reader.error(
            f"{owner}: stewart_pin:position (line {element.sourceline}) of a joint of type '{kind}' may not hold "
            f"{len(values)} numbers",
            owner,
        )
    if len(values) >= 4:
        values[-4:] = scope.reader.unit_quaternion(values[-4:], owner)
    return values


def _own_bounds(scope: Scope, element: etree._Element, kind: JointKind, owner: str) -> dict[str, Bounds]:
    reader = scope.reader
    found: dict[str, Bounds] = {}
    for limit in reader.children(element, OWN_LIMIT):
        keys = ("position", *SPANS)
        reader.only(limit, owner, ("coordinate", *own(*keys)))
        coordinate = limit.get("coordinate", "")
        if coordinate not in loop_coordinates(kind) or coordinate in found:
            raise reader.error(
                f"{owner}: <{OWN_LIMIT} coordinate='{coordinate}'> (line {limit.sourceline}): a joint of kind '{kind}' "
                f"has {', '.join(loop_coordinates(kind)) or 'none'}, each once",
                owner,
            )
        found[coordinate] = Bounds(**reader.own_spans(limit, owner, keys))
    return found


def ends(scope: Scope, element: etree._Element, owner: str) -> tuple[str, str]:
    """Find the two links that a joint joins; the file may name frames on them.

    Parameters
    ----------
    scope
        Model that holds the joint.
    element
        The joint.
    owner
        The joint, for messages.

    Returns
    -------
    parent, child : str
        Full link names; the parent may be the world.
    """
    reader = scope.reader
    written = [reader.content(element, tag, owner) for tag in ("parent", "child")]
    parent, child = (scope.body(name, owner) for name in written)
    if child == WORLD:
        raise reader.error(
            f"{owner} (line {element.sourceline}) has the world as its child; make it the parent", owner
        )
    if parent == child:
        raise reader.error(
            f"{owner} (line {element.sourceline}) joins link '{child}' to itself; correct <parent> or <child>",
            owner,
        )
    return parent, child


def link_pose(scope: Scope, link: str) -> pin.SE3:
    """Find where a link stands in the world while all joints are at zero.

    Parameters
    ----------
    scope
        Any model of the file, or the world.
    link
        Full link name, or ``world``.

    Returns
    -------
    pinocchio.SE3
        Placement of the link in the world.
    """
    if link == WORLD:
        return pin.SE3.Identity()
    if scope.element.tag == "world":
        scope = next(iter(scope.nested.values()))
    while scope.prefix and scope.parent is not None:
        scope = scope.parent
    return scope.pose(link, f"link '{link}'")


def joint_frame(scope: Scope, element: etree._Element, child: str, owner: str) -> tuple[pin.SE3, pin.SE3]:
    """Find where a joint stands at zero.

    Parameters
    ----------
    scope
        Model that holds the joint.
    element
        The joint.
    child
        Full name of its child link.
    owner
        The joint, for messages.

    Returns
    -------
    in_world, in_child : pinocchio.SE3
        Placements of the joint.
    """
    placement, relative_to = scope.reader.pose(element, owner)
    written = scope.reader.content(element, "child", owner)
    in_world = scope.pose(relative_to or written, owner) * placement
    if not relative_to and scope.prefix + written == child:
        return in_world, placement  # with the digits of the file
    return in_world, link_pose(scope, child).inverse() * in_world


def read_lead(reader: SdfReader, element: etree._Element, owner: str) -> float:
    """Read the travel of a screw per turn: the old ``thread_pitch`` is in rad/m, positive for a left-hand thread.

    Parameters
    ----------
    reader
        Reader of the file.
    element
        The joint.
    owner
        The joint, for messages.

    Returns
    -------
    float
        Travel of the child along the axis, positive for a right-hand thread [m].

    Raises
    ------
    FileFormatError
        If it has no thread, or one of no lead.
    """
    if reader.children(element, "screw_thread_pitch"):
        lead = reader.number(element, "screw_thread_pitch", owner)
        if not lead:
            where = f"{owner} (line {element.sourceline})"
            raise reader.error(f"{where} is a screw that does not travel; write a revolute joint", owner)
        return lead
    if not reader.children(element, "thread_pitch"):
        raise reader.error(
            f"{owner} (line {element.sourceline}) is a screw without a thread; give <screw_thread_pitch> in m per "
            "turn",
            owner,
        )
    pitch = reader.number(element, "thread_pitch", owner)
    lead = -2 * np.pi / pitch if pitch else inf
    if not np.isfinite(lead):
        raise reader.error(
            f"{owner}: <thread_pitch> (line {element.sourceline}) must not be zero: it is in rad per m", owner
        )
    reader.note(
        owner,
        "<thread_pitch>: read as rad per m of a left-hand thread, as Gazebo does; <screw_thread_pitch> says m per turn",
        Outcome.KEPT,
    )
    return float(lead)


def _must_close(scope: Scope, element: etree._Element, owner: str) -> bool:
    """Find Simbody's mark of a joint at which the tree is to be cut."""
    reader, found = scope.reader, False
    for physics in reader.children(element, "physics"):
        for engine in reader.children(physics, "simbody"):
            found = found or reader.flag(engine, "must_be_loop_joint", owner)
        reader.note(owner, "<physics>: simulator settings")
    return found
