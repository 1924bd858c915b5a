"""Joints of an OpenUSD stage, before anything decides which of them hang a body and which close a loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf
from typing import Any

import numpy as np
import pinocchio as pin

from stewart_pin.errors import UnsupportedError
from stewart_pin.model.description import Bounds, JointKind, Note, Outcome, loop_coordinates
from stewart_pin.model.formats.precision import Precision, half_unit
from stewart_pin.model.formats.usd.bodies import Body, body_above, quaternion_of, rotation_of
from stewart_pin.model.formats.usd.physics import own_physics, read_physics
from stewart_pin.model.formats.usd.stage import (
    BOUNDS,
    DOFS,
    FREE_DOFS,
    OWN,
    WITH_AXIS,
    Stage,
    meant,
    placement_of,
    same_single,
    schema_frames,
)
from stewart_pin.model.formats.xml import UNLIMITED
from stewart_pin.model.joint_physics import JointPhysics
from stewart_pin.typing import FloatArray

GROUND = ""
"""Stands for the path of the body that a joint to the world has."""
_UNIT = 1e-13
"""How far the square of a unit vector of all digits may be from one: its last digits are kept."""
CHANCE = 1e-14
"""Half a unit of a last digit that a number of double precision may lack by chance."""
_OPEN = Bounds()
_TYPED = {
    "PhysicsFixedJoint": JointKind.FIXED,
    "PhysicsRevoluteJoint": JointKind.REVOLUTE,
    "PhysicsPrismaticJoint": JointKind.PRISMATIC,
    "PhysicsSphericalJoint": JointKind.SPHERICAL,
    "PhysicsDistanceJoint": JointKind.DISTANCE,
}
_GAINS = ("stiffness", "damping")
_UNREAD = ("Tendon", "Equality", "PhysxRackAndPinion", "PhysxGear")
"""What names of schemas contain that tie bodies or joints together in ways that are not read."""


@dataclass(frozen=True, eq=False)
class Edge:
    """A joint of the stage.

    Attributes
    ----------
    name, path
        Its name, and the path of its prim.
    kind
        What it leaves free.
    bodies
        Paths of the bodies that it joins; `GROUND`: the world.
    frames
        Its frames in them.
    axis, axis2
        (3,) unit vectors as of `Loop`.
    length
        Distance that a rod keeps [m].
    bounds
        What each coordinate may do, as of `Loop`; empty: nothing is stated.
    physics
        What it does by itself along each of `coordinates_with_physics`; empty: nothing.
    drawn
        Whether springs are told about where the stage places the bodies.
    motors
        Which coordinates a drive moves.
    excluded
        Whether the file keeps it out of articulations: a joint that closes a loop.
    home
        Joint values that our own words state, or None [m, rad, unit quaternion].
    told
        Whether words of our own describe it.
    """

    name: str
    path: str
    kind: JointKind
    bodies: tuple[str, str]
    frames: tuple[pin.SE3, pin.SE3]
    axis: FloatArray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    axis2: FloatArray = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))
    length: float = 0.0
    bounds: tuple[Bounds, ...] = ()
    physics: tuple[JointPhysics, ...] = ()
    drawn: bool = False
    motors: frozenset[int] = frozenset()
    excluded: bool = False
    home: FloatArray | None = None
    told: bool = False

    def reversed(self) -> Edge:
        """Tell the same joint from its other end.

        Returns
        -------
        Edge
            With the same coordinates, but for planar joints, whose slides are those of the other body.
        """
        axis, axis2 = -self.axis, self.axis2
        bounds, motors, physics = self.bounds, self.motors, self.physics
        if self.kind is JointKind.UNIVERSAL:
            axis, axis2, bounds = -self.axis2, -self.axis, bounds[::-1]
            motors, physics = frozenset(1 - number for number in motors), physics[::-1]
        elif self.kind is JointKind.PLANAR:
            bounds, physics = (), ()
        elif self.kind is JointKind.SPHERICAL:
            axis = self.axis
        return replace(
            self,
            bodies=self.bodies[::-1],
            frames=self.frames[::-1],
            axis=axis,
            axis2=axis2,
            bounds=bounds,
            motors=motors,
            physics=physics,
            home=None,
        )


class JointReader:
    """Reads all joints of a stage.

    Parameters
    ----------
    stage
        The stage.
    bodies
        Its bodies, by path.

    Attributes
    ----------
    digits
        How finely the frames are told that no words of our own tell.
    """

    def __init__(self, stage: Stage, bodies: Mapping[str, Body]) -> None:
        self.stage = stage
        self.bodies = bodies
        self.digits = Precision()
        self.idle: list[str] = []

    def read(self) -> list[Edge]:
        """Read the joints.

        Returns
        -------
        list of Edge
            Those that hold something, or are moved by a motor, in the order of the stage; named after their prims where
            that is unique, else after their paths.

        Raises
        ------
        UnsupportedError
            If something ties bodies together in a way that is not read.
        FileFormatError
            If a joint names what does not exist, or has limits that are none.
        """
        edges: list[Edge] = []
        drives: dict[str, bool] = {}
        for prim in self.stage.prims():
            self._refuse_unread(prim)
            if not prim.IsA(self.stage.usd.UsdPhysics.Joint):
                continue
            path = str(prim.GetPath())
            if not self.stage.value(prim, "physics:jointEnabled", True):
                self.stage.note(path, "physics:jointEnabled is off: left out")
                continue
            edge = self._edge(prim, path)
            if edge is not None:
                edges.append(edge)
                drives[path] = self._has_gains(prim)
        # Converters put a drive without gains on every joint, and gains on those with a motor.
        if len(set(drives[edge.path] for edge in edges if edge.motors)) > 1:
            for edge in edges:
                if edge.motors and not drives[edge.path] and not edge.told:
                    self.stage.note(
                        edge.path, "its drive has no gains, as others have: not a motor", Outcome.KEPT
                    )
            edges = [
                edge if drives[edge.path] or edge.told else replace(edge, motors=frozenset())
                for edge in edges
            ]
        names = [edge.name for edge in edges]
        return [
            edge
            if edge.told or names.count(edge.name) == 1
            else replace(edge, name=edge.path.strip("/").replace("/", "_"))
            for edge in edges
        ]

    def _refuse_unread(self, prim: Any) -> None:
        kind, applied = str(prim.GetTypeName()), [str(name) for name in prim.GetAppliedSchemas()]
        applied += [str(name) for name in prim.GetPrimTypeInfo().GetAppliedAPISchemas()]
        named = prim.GetMetadata("apiSchemas")
        applied += [] if named is None else [str(name) for name in named.GetAddedOrExplicitItems()]
        known = prim.IsA(self.stage.usd.UsdPhysics.Joint)
        strange = [name for name in applied if any(word in name for word in _UNREAD)]
        if strange or ("Joint" in kind and not known):
            raise UnsupportedError(
                f"{self.stage.path}: <{prim.GetPath()}> has the schema {strange[0] if strange else kind}, which ties "
                "bodies together in a way that is not read; write it as a UsdPhysics joint, or a NewtonMimicAPI"
            )

    def _has_gains(self, prim: Any) -> bool:
        return any(
            self.stage.value(prim, f"drive:{instance}:physics:{gain}", 0.0) != 0
            for instance in _instances(prim, "PhysicsDriveAPI")
            for gain in _GAINS
        )

    def _edge(self, prim: Any, path: str) -> Edge | None:
        stage = self.stage
        ends = [self._end(prim, path, number) for number in (0, 1)]
        bodies = (ends[0][0], ends[1][0])
        if bodies[0] == bodies[1]:
            stage.note(path, "joins the world, or a body, to itself: holds nothing")
            return None
        kind, dofs = self._kind(prim, path)
        told = stage.own(prim, "joint") is not None
        excluded = bool(stage.value(prim, "physics:excludeFromArticulation", False))
        if kind is JointKind.FLOATING and not told:
            if not excluded:
                raise stage.error(
                    path,
                    "locks nothing, and holds nothing; lock what it is to hold (PhysicsLimitAPI, low above high), or "
                    "remove it",
                )
            stage.note(path, "a joint without limits, which holds nothing: left out")
            return None
        edge = Edge(
            name=stage.own(prim, "joint", prim.GetName()),
            path=path,
            kind=kind,
            bodies=bodies,
            frames=(ends[0][1], ends[1][1]),
            bounds=tuple(self._bound(prim, path, kind, dof) for dof in dofs),
            motors=self._motors(prim, path, kind, dofs),
            excluded=excluded,
        )
        if all(bound == _OPEN for bound in edge.bounds):
            edge = replace(edge, bounds=())
        physics, drawn = read_physics(stage, prim, path, kind)
        edge = replace(edge, physics=physics, drawn=drawn)
        edge = self._with_axes(prim, edge, dofs)
        if kind is JointKind.SPHERICAL:
            edge = replace(edge, bounds=self._cone(prim, path))
        if kind is JointKind.DISTANCE:
            edge = replace(edge, length=self._length(prim, path))
        mine = self._told(prim, edge) if told else None
        if told and mine is None:
            text = f"was changed since its words {OWN}... were written: these are passed over"
            stage.note(path, text, Outcome.CHANGED)
        self._count_digits(prim, own=mine is not None)
        return edge if mine is None else mine

    # ------------------------------------------------------------------------------------------------
    # Frames
    # ------------------------------------------------------------------------------------------------

    def _end(self, prim: Any, path: str, number: int) -> tuple[str, pin.SE3]:
        """Find the body at one end, and the frame of the joint in it."""
        stage = self.stage
        targets = stage.targets(prim, f"physics:body{number}")
        if len(targets) > 1:
            raise stage.error(path, f"names {len(targets)} bodies as physics:body{number}; name one")
        position = np.array(stage.value(prim, f"physics:localPos{number}", (0.0, 0.0, 0.0)), dtype=float)
        quaternion = stage.value(prim, f"physics:localRot{number}")
        turn = quaternion_of(quaternion) if quaternion is not None else np.array([1.0, 0.0, 0.0, 0.0])
        if not (np.isfinite(position).all() and np.isfinite(turn).all() and np.linalg.norm(turn) > 0.5):
            raise stage.error(path, f"has a physics:localPos{number} or localRot{number} that places nothing")
        body, within, scale = self._target(path, targets)
        # Positions are in the space of the prim, which may be scaled; rotations are not.
        shift = meant(position) * scale * stage.metre
        return body, within * pin.SE3(rotation_of(turn), shift)

    def _target(self, path: str, targets: list[Any]) -> tuple[str, pin.SE3, FloatArray]:
        one = pin.SE3.Identity()
        if not targets:
            return GROUND, one, np.ones(3)
        prim = self.stage.stage.GetPrimAtPath(targets[0])
        if not prim:
            raise self.stage.error(path, f"joins <{targets[0]}>, and no such prim is there; correct the path")
        placed, scale = self.stage.pose(prim)
        owner = body_above(self.stage, prim)
        if owner is None:
            return GROUND, placed, scale
        body = self.bodies.get(str(owner.GetPath()))
        if body is None:
            raise self.stage.error(
                path,
                f"joins <{targets[0]}>, which is no part of the stage: not active, or never defined (`def`)",
            )
        return body.path, one if owner == prim else body.pose.inverse() * placed, scale

    def _count_digits(self, prim: Any, *, own: bool) -> None:
        """Find what the numbers of a joint leave open: those of our own words, which are double, or of the schema."""
        lengths: list[float] = []
        angles: list[float] = []
        if own:
            frames = [np.array(self.stage.own(prim, f"frame{number}")) for number in (0, 1)]
            lengths = [half_unit(repr(float(value))) for frame in frames for value in frame[3, :3]]
            turned = [*(value for frame in frames for value in frame[:3, :3].flat)]
            turned += [*self.stage.own(prim, "axis", ())]
            angles = [half_unit(repr(float(value))) for value in turned]
            # A number whose last digit is 0 by chance is none of fourteen decimals.
            found = Precision(*(most if most > CHANCE else 0.0 for most in (max(lengths), max(angles))))
            self.digits = Precision(
                max(self.digits.length, found.length), max(self.digits.angle, found.angle)
            )
            return
        for number in (0, 1):
            # A position in a scaled body is as fine as the scale makes it.
            path, targets = str(prim.GetPath()), self.stage.targets(prim, f"physics:body{number}")
            scale = map(float, self._target(path, targets)[2])
            position = self.stage.value(prim, f"physics:localPos{number}", (0.0, 0.0, 0.0))
            lengths += [_open_by(value) * along for value, along in zip(position, scale, strict=True)]
            quaternion = self.stage.value(prim, f"physics:localRot{number}")
            angles += [] if quaternion is None else [_open_by(value) for value in quaternion_of(quaternion)]
        length, angle = (max(values, default=0.0) for values in (lengths, angles))
        # An entry of a quaternion is half an angle.
        self.digits = Precision(
            max(self.digits.length, length * self.stage.metre), max(self.digits.angle, 2 * angle)
        )

    # ------------------------------------------------------------------------------------------------
    # Kinds, axes and limits
    # ------------------------------------------------------------------------------------------------

    def _kind(self, prim: Any, path: str) -> tuple[JointKind, tuple[str, ...]]:
        """Tell what a joint leaves free, and which freedom of the schema each coordinate is."""
        kind = _TYPED.get(str(prim.GetTypeName()))
        limits = _instances(prim, "PhysicsLimitAPI")
        self._look_for_unapplied(prim, path, limits)
        if kind is not None:
            for name in limits:
                self.stage.note(path, f"PhysicsLimitAPI:{name}: a joint of its type has limits of its own")
            coordinates = {JointKind.REVOLUTE: ("angular",), JointKind.PRISMATIC: ("linear",)}
            return kind, coordinates.get(kind, ())
        if "distance" in limits:
            raise self.stage.error(
                path, "limits the distance; a PhysicsDistanceJoint with equal limits is a rod"
            )
        locked: set[str] = set()
        for name in limits:
            low, high = self._range(prim, name)
            if low > high or low == high == 0:
                locked.add(name)
            elif low == high:
                raise self.stage.error(
                    path,
                    f"holds {name} at {low:g}; lock it (low above high), and shift physics:localPos0 or localRot0",
                )
        kind, dofs = self._generic(path, [dof for dof in DOFS if dof not in locked])
        for name in sorted({*limits} - locked - {*dofs}):
            if np.isfinite(self._range(prim, name)).any():
                self.stage.note(
                    path, f"PhysicsLimitAPI:{name}: a {kind} joint has no such coordinate, no limit"
                )
        return kind, dofs

    def _look_for_unapplied(self, prim: Any, path: str, limits: list[str]) -> None:
        """Refuse limits, and note drives, without the schema that makes engines look at them."""
        drives = _instances(prim, "PhysicsDriveAPI")
        for prop in prim.GetAuthoredProperties():
            what, _, rest = str(prop.GetName()).partition(":")
            instance = rest.partition(":")[0]
            if what == "limit" and instance not in limits:
                raise self.stage.error(
                    path,
                    f"has {prop.GetName()}, but not the schema PhysicsLimitAPI:{instance}, without which engines pass "
                    "it over; apply it, or remove the attribute",
                )
            if what == "drive" and instance not in drives:
                self.stage.note(
                    path, f"drive:{instance} without the schema PhysicsDriveAPI:{instance}: not a motor"
                )

    def _generic(self, path: str, free: list[str]) -> tuple[JointKind, tuple[str, ...]]:
        shifts = [dof[-1] for dof in free if dof.startswith("trans")]
        turns = [dof[-1] for dof in free if dof.startswith("rot")]
        match len(shifts), len(turns):
            case 0, 0:
                return JointKind.FIXED, ()
            case 0, 1:
                return JointKind.REVOLUTE, tuple(free)
            case 1, 0:
                return JointKind.PRISMATIC, tuple(free)
            case 0, 3:
                return JointKind.SPHERICAL, ()
            case 1, 1 if shifts == turns:
                return JointKind.CYLINDRICAL, tuple(free)
            case 2, 1 if turns[0] not in shifts:
                # The slides in the order of `orthonormal_triad`.
                x = "XYZ"[("XYZ".index(turns[0]) + 1) % 3]
                y = next(axis for axis in shifts if axis != x)
                return JointKind.PLANAR, (f"trans{x}", f"trans{y}", f"rot{turns[0]}")
            case 0, 2 if "X" in turns:
                # Swing about one axis of frame 0, then twist about x of frame 1.
                other = next(axis for axis in turns if axis != "X")
                text = f"turns about {other} of body 0 and X of body 1: a universal joint"
                self.stage.note(path, text, Outcome.KEPT)
                return JointKind.UNIVERSAL, (f"rot{other}", "rotX")
            case 1, 3:
                return JointKind.POINT_ON_LINE, (f"trans{shifts[0]}",)
            case 3, 3:
                return JointKind.FLOATING, ()
        raise UnsupportedError(
            f"{self.stage.path}: <{path}> leaves free {', '.join(free)}; of joints without a type, hinges, slides, "
            "balls, cylinders, planes (two slides and the turn across), universal joints (rotX and one more) and "
            "points on lines (a slide and all turns) are read"
        )

    def _with_axes(self, prim: Any, edge: Edge, dofs: tuple[str, ...]) -> Edge:
        units = dict(zip("XYZ", np.eye(3), strict=True))
        if str(prim.GetTypeName()) in _TYPED:
            if edge.kind in WITH_AXIS:
                token = self.stage.value(prim, "physics:axis", "X")
                if token not in units:
                    raise self.stage.error(edge.path, f"has the physics:axis {token}; it is X, Y or Z")
                return replace(edge, axis=units[token])
            return edge
        match edge.kind:
            case JointKind.UNIVERSAL:
                return replace(edge, axis=units[dofs[0][-1]], axis2=units["X"])
            case JointKind.FIXED | JointKind.SPHERICAL | JointKind.FLOATING:
                return edge
            case _:
                return replace(edge, axis=units[dofs[-1][-1]])

    def _range(self, prim: Any, dof: str) -> tuple[float, float]:
        if dof in ("angular", "linear"):
            names = ("physics:lowerLimit", "physics:upperLimit")
        else:
            names = (f"limit:{dof}:physics:low", f"limit:{dof}:physics:high")
        low, high = (
            float(self.stage.value(prim, name, far)) for name, far in zip(names, (-inf, inf), strict=True)
        )
        # Writers also say by the largest number that there is no limit.
        return -inf if low <= -UNLIMITED else low, inf if high >= UNLIMITED else high

    def _bound(self, prim: Any, path: str, kind: JointKind, dof: str) -> Bounds:
        """Read limits of a coordinate, which are degrees where it is an angle."""
        stage, angular = self.stage, dof == "angular" or dof.startswith("rot")
        unit = np.radians(1.0) if angular else stage.metre
        low, high = (unit * float(end) for end in meant(self._range(prim, dof)))
        if low > high:
            raise stage.error(
                path,
                f"has a lower limit {low:g} above the upper, {high:g} [m or rad]; a fixed joint is locked",
            )
        speed = inf
        if kind in WITH_AXIS:
            speed = unit * float(meant([stage.value(prim, "physxJoint:maxJointVelocity", inf)])[0])
        force = float(meant([stage.value(prim, f"drive:{dof}:physics:maxForce", inf)])[0])
        force *= stage.kilogram * stage.metre * (stage.metre if angular else 1.0)
        speed, force = (value if value > 0 else inf for value in (speed, force))
        # Isaac's word for no limit of speed is a million.
        speed = inf if speed >= unit * 1e6 else speed
        return Bounds(position=(low, high), velocity=(-speed, speed), effort=(-force, force))

    def _motors(self, prim: Any, path: str, kind: JointKind, dofs: tuple[str, ...]) -> frozenset[int]:
        instances = _instances(prim, "PhysicsDriveAPI")
        for name in instances:
            if name not in dofs:
                self.stage.note(path, f"PhysicsDriveAPI:{name}: a {kind} joint has no such coordinate")
            gains = [self.stage.value(prim, f"drive:{name}:physics:{gain}", 0.0) for gain in _GAINS]
            if any(gains):
                text = (
                    f"gains {gains[0]:g}, {gains[1]:g} of its drive: a servo's; a motor gives what it is told"
                )
                self.stage.note(path, text)
        if kind is JointKind.PLANAR or kind is JointKind.CYLINDRICAL or kind is JointKind.UNIVERSAL:
            return frozenset(number for number, dof in enumerate(dofs) if dof in instances)
        return frozenset({0} if set(instances) & set(dofs) else ())

    def _length(self, prim: Any, path: str) -> float:
        ends = [float(self.stage.value(prim, f"physics:{end}Distance", -1.0)) for end in ("min", "max")]
        if ends[0] != ends[1] or ends[0] < 0:
            raise self.stage.error(
                path,
                f"keeps the distance between {ends[0]:g} and {ends[1]:g}: a rope or a stop; physics:minDistance and "
                "maxDistance have to be equal, which makes a rod",
            )
        return float(meant([ends[0]])[0]) * self.stage.metre

    # ------------------------------------------------------------------------------------------------
    # Words of our own, where they still say the same
    # ------------------------------------------------------------------------------------------------

    def _told(self, prim: Any, edge: Edge) -> Edge | None:
        """Read exact numbers, or find that they do not round to those of the schema."""
        stage = self.stage
        told = [stage.own(prim, f"frame{number}") for number in (0, 1)]
        if stage.own(prim, "kind") != str(edge.kind) or None in told or stage.metre != 1.0:
            return None
        frames = (placement_of(told[0]), placement_of(told[1]))
        axis, axis2 = (
            np.array(stage.own(prim, name, (0.0, 0.0, 1.0)), dtype=float) for name in ("axis", "axis2")
        )
        if stage.own(prim, "axis2") is None:
            axis2 = np.array([0.0, 1.0, 0.0])
        if any(np.abs(one).max() > 2 or abs(np.linalg.norm(one) - 1) > 1e-9 for one in (axis, axis2)):
            return None
        axis, axis2 = (
            one / np.linalg.norm(one) if abs(one @ one - 1) > _UNIT else one for one in (axis, axis2)
        )
        turned = schema_frames(edge.kind, *frames, axis, axis2)
        if not (
            _same_frame(turned.frame0, edge.frames[0]) and _same_frame(turned.frame1, edge.frames[1])
        ) or (edge.kind in WITH_AXIS and turned.token != stage.value(prim, "physics:axis", "X")):
            return None
        mine = replace(edge, frames=frames, axis=axis, axis2=axis2, told=True)
        length = stage.own(prim, "length")
        if length is not None and same_single(np.array(length), np.array([edge.length])):
            mine = replace(mine, length=float(length[0]))
        bounds = _own_bounds(stage.own(prim, "bounds"), edge.kind)
        if bounds is not None and _round_alike(bounds, edge):
            mine = replace(mine, bounds=bounds)
        physics, ours = own_physics(stage, prim, edge.path, edge.kind, edge.physics)
        mine = replace(mine, physics=physics, drawn=edge.drawn and not ours)
        home = stage.own(prim, "home")
        motors = edge.motors if stage.own(prim, "motor") or not edge.motors else frozenset[int]()
        return replace(mine, home=None if home is None else np.array(home, dtype=float), motors=motors)

    def _cone(self, prim: Any, path: str) -> tuple[Bounds, ...]:
        """Read how far a ball swings: the largest of its two angles; a cone that is not round is none of ours."""
        limits = [float(self.stage.value(prim, f"physics:coneAngle{k}Limit", -1.0)) for k in (0, 1)]
        if min(limits) < 0:
            if max(limits) >= 0:
                self.stage.note(path, f"a cone of {max(limits):g} degrees to one side alone: not limited")
            return ()
        if limits[0] != limits[1]:
            text = f"a cone of {limits[0]:g} by {limits[1]:g} degrees: the larger is taken for both"
            self.stage.notes.append(Note(path, text, Outcome.CHANGED))
        swing = float(np.radians(meant([max(limits)])[0]))
        return Bounds(position=(-inf, swing)), _OPEN


def _instances(prim: Any, schema: str) -> list[str]:
    """List the instances of a schema that is applied several times."""
    return [
        str(name).split(":", 1)[1] for name in prim.GetAppliedSchemas() if str(name).startswith(f"{schema}:")
    ]


def _open_by(value: float) -> float:
    """Find what a number of single precision leaves open: what its shortest decimals do, or its last bit."""
    single = np.float32(value)
    by_digits = half_unit(str(single))
    return max(by_digits, float(np.spacing(np.abs(single))) / 2) if by_digits else 0.0


def _same_frame(one: pin.SE3, other: pin.SE3) -> bool:
    return same_single(one.translation, other.translation) and bool(
        np.abs(one.rotation - other.rotation).max() <= 2e-6
    )


def _own_bounds(numbers: Any, kind: JointKind) -> tuple[Bounds, ...] | None:
    count = len(loop_coordinates(kind))
    if numbers is None or len(numbers) != count * 2 * len(BOUNDS):
        return None
    spans = np.array(numbers, dtype=float).reshape(count, len(BOUNDS), 2).tolist()
    return tuple(Bounds(**{key: tuple(span) for key, span in zip(BOUNDS, row, strict=True)}) for row in spans)


def _round_alike(bounds: tuple[Bounds, ...], edge: Edge) -> bool:
    """Tell whether limits of position still are those of the schema, which has no other for some kinds."""
    told = edge.bounds or (_OPEN,) * len(bounds)
    if edge.kind in FREE_DOFS and not edge.bounds:
        return True
    pairs = list(zip(bounds, told, strict=True))
    # The schema has no word for the whole turn of a ball.
    pairs = pairs[:1] if edge.kind is JointKind.SPHERICAL else pairs
    return all(same_single(np.array(own.position), np.array(there.position)) for own, there in pairs)
