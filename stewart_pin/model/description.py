"""A mechanism as data: links, joints, loops and how they hang together, before any library sees it.

Every reader of a file format produces a `Mechanism`; every writer and the builder of the Pinocchio model consume
one. Frames follow URDF: a joint's frame sits at `placement` in its parent link, and the child link's frame
is the joint's frame after the joint has moved.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from math import inf

import numpy as np
import pinocchio as pin

from stewart_pin.brief import Brief
from stewart_pin.errors import UnsupportedError
from stewart_pin.model.joint_physics import NO_PHYSICS, JointPhysics
from stewart_pin.model.shapes import Shape
from stewart_pin.typing import FloatArray


class JointKind(StrEnum):
    """What a joint, or the closure of a loop, leaves free."""

    FIXED = "fixed"
    REVOLUTE = "revolute"
    PRISMATIC = "prismatic"
    FLOATING = "floating"
    SPHERICAL = "spherical"
    UNIVERSAL = "universal"
    CYLINDRICAL = "cylindrical"
    PLANAR = "planar"
    POINT_ON_LINE = "point_on_line"
    DISTANCE = "distance"
    CABLE = "cable"


TREE_KINDS = (
    JointKind.FIXED,
    JointKind.REVOLUTE,
    JointKind.PRISMATIC,
    JointKind.FLOATING,
    JointKind.SPHERICAL,
)
"""Kinds that a joint of the spanning tree may have."""

LOOP_KINDS = (
    JointKind.FIXED,
    JointKind.REVOLUTE,
    JointKind.PRISMATIC,
    JointKind.SPHERICAL,
    JointKind.UNIVERSAL,
    JointKind.CYLINDRICAL,
    JointKind.PLANAR,
    JointKind.POINT_ON_LINE,
    JointKind.DISTANCE,
    JointKind.CABLE,
)
"""Kinds that the closure of a loop may have."""


def unknown_kind(owner: str, kind: str, where: str) -> UnsupportedError:
    """Say that a table of kinds lacks the one of a joint or a loop.

    Parameters
    ----------
    owner
        The joint or loop, as ``joint 'wrist'``.
    kind
        Its kind.
    where
        What the table is of.

    Returns
    -------
    UnsupportedError
        To be raised.
    """
    return UnsupportedError(
        f"{owner} is of kind '{kind}', which {where} does not know; make it of joints of other kinds, or enter it there"
    )


BALL = ("swing", "angle")
"""Coordinates of a ball that can be limited: the angle between its axis in both frames, and that of its whole turn."""

_LOOP_COORDINATES = {
    JointKind.REVOLUTE: ("angle",),
    JointKind.PRISMATIC: ("length",),
    JointKind.POINT_ON_LINE: ("length",),
    JointKind.CYLINDRICAL: ("length", "angle"),
    JointKind.UNIVERSAL: ("angle 1", "angle 2"),
    JointKind.SPHERICAL: BALL,
    JointKind.PLANAR: ("x", "y", "angle"),
}


def loop_coordinates(kind: JointKind) -> tuple[str, ...]:
    """Name the coordinates that the closure of a loop has, in the order of its bounds.

    Parameters
    ----------
    kind
        One of `LOOP_KINDS`.

    Returns
    -------
    tuple of str
        Lengths are called ``length``, ``x`` or ``y``; the others are angles. None for rigid closures, distances and
        cables.
    """
    return _LOOP_COORDINATES.get(kind, ())


def physics_coordinates(kind: JointKind) -> tuple[str, ...]:
    """Name the coordinates along which a joint that closes a loop may have a spring, damping or friction.

    Parameters
    ----------
    kind
        One of `LOOP_KINDS`.

    Returns
    -------
    tuple of str
        Those of `loop_coordinates`; of a ball ``turn``, the rotation as a whole.
    """
    return ("turn",) if kind is JointKind.SPHERICAL else loop_coordinates(kind)


AXIS_FREE_LOOPS = (JointKind.FIXED, JointKind.SPHERICAL, JointKind.DISTANCE, JointKind.CABLE)
"""Kinds of loops whose meaning does not depend on an axis; that of a cable does where it runs over a pulley."""


Span = tuple[float, float]
"""Least and greatest value, infinite where nothing is stated."""
_NONE: Span = (-inf, inf)


@dataclass(frozen=True)
class Bounds:
    """What one coordinate may do, (least, greatest) each; infinite where nothing is stated.

    Attributes
    ----------
    position
        Position [m or rad].
    velocity
        Velocity [m/s or rad/s].
    acceleration
        Acceleration [m/s² or rad/s²].
    effort
        Effort of a motor [N or N m].
    jerk
        Rate of the acceleration [m/s³ or rad/s³].
    """

    position: Span = _NONE
    velocity: Span = _NONE
    acceleration: Span = _NONE
    effort: Span = _NONE
    jerk: Span = _NONE


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid link.

    Attributes
    ----------
    name
        Unique name.
    inertia
        Mass [kg], centre of mass [m] and inertia about it [kg m²] in the link frame; None: the link is no body.
    visuals, collisions
        Shapes for viewers and for collision checkers; no equation of motion depends on them.
    """

    name: str
    inertia: pin.Inertia | None = None
    visuals: tuple[Shape, ...] = ()
    collisions: tuple[Shape, ...] = ()


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of the spanning tree.

    Attributes
    ----------
    name
        Unique name.
    kind
        One of `TREE_KINDS`.
    parent, child
        Link names.
    placement
        Joint frame in the parent link at zero joint value.
    axis
        (3,) unit vector in the joint frame, for one-freedom joints.
    lower, upper
        Position limits of a one-freedom joint [m or rad].
    effort, velocity
        Largest effort [N or N m] and speed [m/s or rad/s] to both sides, or (least, greatest).
    independent
        Whether a motor drives the joint.
    acceleration, jerk
        Largest acceleration [m/s² or rad/s²] and its rate [m/s³ or rad/s³] to both sides, or (least, greatest).
    swing, turn
        Of a ball: largest angle between its axis in both frames, and largest angle of its whole rotation [rad].
    physics
        What it does by itself: rotor, damping, friction, spring.
    """

    name: str
    kind: JointKind
    parent: str
    child: str
    placement: pin.SE3
    axis: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    lower: float = -inf
    upper: float = inf
    effort: float | Span = inf
    velocity: float | Span = inf
    independent: bool = False
    acceleration: float | Span = inf
    jerk: float | Span = inf
    swing: float = inf
    turn: float = inf
    physics: JointPhysics = NO_PHYSICS

    @property
    def has_axis(self) -> bool:
        """Whether the joint has one freedom, along or about its axis."""
        return self.kind in (JointKind.REVOLUTE, JointKind.PRISMATIC)

    @property
    def bounds(self) -> Bounds:
        """What the coordinate of a one-freedom joint may do, both ends of each."""
        return Bounds(
            position=(self.lower, self.upper),
            velocity=_span(self.velocity),
            acceleration=_span(self.acceleration),
            effort=_span(self.effort),
            jerk=_span(self.jerk),
        )


def _span(value: float | Span) -> Span:
    return value if isinstance(value, tuple) else (-value, value)


@dataclass(frozen=True)
class Cable:
    """How a cable is wound in, and the pulley that it runs over.

    Attributes
    ----------
    reel
        Joint of the tree whose coordinate winds the cable in; None: its length stays as it is.
    ratio
        Cable that is wound in per unit of that coordinate [m per m or rad].
    radius
        Radius of the pulley [m]; 0: the cable leaves from a point. The cable comes along the axis of frame 1 to its
        origin, where it touches the pulley, and the pulley swivels about that axis towards the other end.
    """

    reel: str | None = None
    ratio: float = 1.0
    radius: float = 0.0


NO_CABLE = Cable()
"""Of loops that are none."""


@dataclass(frozen=True, eq=False)
class Loop:
    """A joint that closes a loop: a frame on link 1 and a frame on link 2 that move as the kind allows.

    Attributes
    ----------
    name
        Unique name.
    kind
        One of `LOOP_KINDS`.
    link1, link2
        Link names (predecessor, successor).
    placement1, placement2
        Loop frames 1 and 2 in their links.
    axis
        (3,) unit vector of the free axis, or of the plane's normal, in frame 1; for kinds that share it, in frame 2
        as well. A universal joint turns about `axis` of frame 1 and `axis2` of frame 2.
    axis2
        (3,) second axis of a universal joint, in frame 2, a unit vector.
    length
        Distance kept between the frame origins by a `DISTANCE` loop, or all of a `CABLE` from the origin of frame 1 to
        that of frame 2 where its reel reads zero [m].
    bounds
        What each coordinate of the joint may do, in the order of `loop_coordinates`; empty: nothing is stated.
    physics
        What it does by itself along each of `physics_coordinates`, in their order; empty: nothing.
    cable
        Reel and pulley of a `CABLE`, which always pulls: its effort on the reel is its tension × ratio.
    """

    name: str
    kind: JointKind
    link1: str
    link2: str
    placement1: pin.SE3
    placement2: pin.SE3
    axis: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    axis2: FloatArray = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))
    length: float = 0.0
    bounds: tuple[Bounds, ...] = ()
    physics: tuple[JointPhysics, ...] = ()
    cable: Cable = NO_CABLE


@dataclass(frozen=True, eq=False)
class Coupling:
    """One-freedom joints that move together: a gear, a belt, a mimic joint, the thread of a screw, a differential.

    The first joint stands at ``c0 + c1 x + c2 x² + ... + r3 x3 + r4 x4 + ...``, with x the position of the second, and
    x3, x4, ... those of the others.

    Attributes
    ----------
    name
        Unique name.
    joint1
        Joint whose position follows.
    joint2
        Joint that it follows, or None: joint 1 stands at c0.
    polynomial
        (n,) coefficients c0, c1, ... [unit of joint 1 per power of the unit of joint 2].
    others
        Further joints that it follows, each with its ratio [unit of joint 1 per unit of that joint].
    """

    name: str
    joint1: str
    joint2: str | None
    polynomial: tuple[float, ...]
    others: tuple[tuple[str, float], ...] = ()

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of all its joints, the one that follows first."""
        followed = () if self.joint2 is None else (self.joint2,)
        return (self.joint1, *followed, *(name for name, _ in self.others))


class Outcome(StrEnum):
    """What a reader made of something it found."""

    KEPT = "kept"
    CHANGED = "changed"
    IGNORED = "ignored"


@dataclass(frozen=True)
class Note:
    """Something a reader found, and what it made of it.

    Attributes
    ----------
    subject
        Tag or name.
    text
        What became of it, and why.
    outcome
        Kept as it stands, changed (a cut joint, an unfolded one, a joint of another type), or ignored.
    """

    subject: str
    text: str
    outcome: Outcome = Outcome.IGNORED


_ALIKE = 20
"""Findings of one reason that a report tells one by one."""


def _reason(text: str) -> str:
    return text.rpartition(": ")[2]


@dataclass(frozen=True)
class Report:
    """What a reader found in a file besides links, joints and loops of its own dialect; print it.

    Attributes
    ----------
    notes
        One note per finding, in the order of the file.
    """

    notes: tuple[Note, ...] = ()

    def __str__(self) -> str:
        """Group equal findings, one line each: what was kept, then what was changed, then what was ignored.

        Of many that were ignored for one reason, the first are told, and how many more there are.
        """
        lines: list[str] = []
        for outcome in Outcome:
            subjects: dict[str, list[str]] = {}
            for note in self.notes:
                if note.outcome is outcome:
                    subjects.setdefault(note.text, []).append(note.subject)
            reasons = Counter(_reason(text) for text in subjects)
            told: Counter[str] = Counter()
            for text, owners in subjects.items():
                reason = _reason(text)
                told[reason] += 1
                if outcome is not Outcome.IGNORED or told[reason] <= _ALIKE:
                    more = f" and {len(owners) - 3} more" if len(owners) > 3 else ""
                    lines.append(f"{outcome}: {text} ({', '.join(owners[:3])}{more})")
                elif told[reason] == _ALIKE + 1:
                    lines.append(f"{outcome}: {reasons[reason] - _ALIKE} more: {reason}")
        return "\n".join(lines) or "nothing was ignored"


@dataclass(frozen=True, eq=False, repr=False)
class Mechanism(Brief):
    """Links, joints and loops of one machine.

    Attributes
    ----------
    name
        Name of the robot.
    links, joints, loops, couplings
        Parts, in the order of the file.
    platform
        Link that carries the platform frame, or None when nothing says so.
    home
        Joint values of the home configuration: ``{joint: values}``, Pinocchio's convention [m, rad, quaternion].
    home_is_guess
        Whether the loops may be open there, and joints beyond their limits: home is then found from it.
    source
        File the mechanism came from, for messages.
    notes
        What the reader kept, changed or ignored.
    gravity
        (3,) acceleration of free fall that the file states [m/s²], or None where it states none.
    odd_inertias
        Links whose inertia no real body has, one principal moment being above the sum of the others, and which are kept
        as the file has them; elsewhere such an inertia is an error.
    assembled
        Whether the file places the links themselves, so that its home closes every loop, whatever the limits say.
    motor_hints
        Joints that the file names as driven, but not so that they could be taken for the motors.
    digits
        How finely the file tells where joints and loops are attached, lengths [m] and angles [rad]; None: as its text
        prints them.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    loops: tuple[Loop, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    platform: str | None = None
    home: Mapping[str, FloatArray] = field(default_factory=dict)
    home_is_guess: bool = False
    source: str = ""
    notes: tuple[Note, ...] = ()
    gravity: tuple[float, float, float] | None = None
    odd_inertias: frozenset[str] = frozenset()
    assembled: bool = False
    motor_hints: tuple[str, ...] = ()
    digits: tuple[float, float] | None = None

    @property
    def root(self) -> str:
        """Name of the one link without a parent: the ground."""
        children = {joint.child for joint in self.joints}
        return next(link.name for link in self.links if link.name not in children)

    @property
    def reels(self) -> frozenset[str]:
        """Names of the joints that wind in cables: a whole turn of one is a length of cable."""
        return frozenset(loop.cable.reel for loop in self.loops if loop.cable.reel is not None)

    def link(self, name: str) -> Link:
        """Return a link.

        Parameters
        ----------
        name
            Its name.

        Returns
        -------
        Link
            The link.
        """
        return next(link for link in self.links if link.name == name)

    def joint(self, name: str) -> Joint:
        """Return a joint.

        Parameters
        ----------
        name
            Its name.

        Returns
        -------
        Joint
            The joint.
        """
        return next(joint for joint in self.joints if joint.name == name)
