"""A spanning tree of the bodies and joints of an OpenUSD stage, with loops, and its home where the bodies stand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from stewart_pin.model.description import Coupling, Joint, JointKind, Link, Loop, Mechanism, Outcome
from stewart_pin.model.formats.sdf.frames import WORLD
from stewart_pin.model.formats.sdf.joints import Axis, SdfJoint
from stewart_pin.model.formats.sdf.tree import grow_tree
from stewart_pin.model.formats.usd.bodies import Body
from stewart_pin.model.formats.usd.joints import GROUND, Edge
from stewart_pin.model.formats.usd.stage import Stage
from stewart_pin.model.loop_rows import orthonormal_triad
from stewart_pin.typing import FloatArray

_POSED = 1e-3
"""Largest gap, in sizes of the robot and radians, with which the stage still places the bodies of a joint."""
_ALIAS = "\0world"
"""Stands for the name of a moving body that is called as the ground is."""
_STRAIGHT = 1e-6
"""Angle [rad] below which frames of single precision coincide."""
_NO_TREE = (JointKind.DISTANCE, JointKind.POINT_ON_LINE)
"""Kinds that hang no body."""


class TreeMaker:
    """Makes a tree with loops of bodies and joints.

    Parameters
    ----------
    stage
        The stage.
    bodies
        Its bodies, by path.
    edges
        Joints between them, and to the world.
    ground
        Path of the body that stands for the world, or None.

    Attributes
    ----------
    names
        Names of the links, by the path of their bodies.
    """

    def __init__(
        self, stage: Stage, bodies: Mapping[str, Body], edges: Sequence[Edge], ground: str | None
    ) -> None:
        self.stage = stage
        self.bodies = bodies
        self.edges = [self._with_rest(edge) for edge in edges]
        self.ground = WORLD if ground is None else bodies[ground].link.name
        self.names = {path: body.link.name for path, body in bodies.items()}
        self.names[GROUND] = WORLD
        # A moving body may be called as the ground is while the tree grows.
        self.inner = {path: _ALIAS if name == WORLD and path else name for path, name in self.names.items()}
        self.root = ground

    def make(self, couplings: Sequence[Coupling]) -> Mechanism:
        """Make the mechanism.

        Parameters
        ----------
        couplings
            Couplings of joints, which have to keep their coordinates.

        Returns
        -------
        Mechanism
            Links, joints, loops, couplings and home.

        Raises
        ------
        FileFormatError
            If a loop consists of joints that have to keep their coordinates.
        """
        needed = {name for coupling in couplings for name in coupling.joints}
        hanging, closing = self._split(needed)
        moving = [path for path in self.bodies if path != self.root]
        # A body may be called as the world is here; it is the ground then, or has another name by now.
        tree = grow_tree(
            [self._as_joint(edge) for edge in hanging],
            {self.inner[path]: self.bodies[path].pose for path in moving},
            fixed=(),
            based=(),
            needed=(),
            motors=(),
            source=str(self.stage.path),
        )
        self.stage.notes += tree.notes
        home, gap = {_real(name): pose for name, pose in tree.home.items()}, 0.0
        joints = {_real(joint.name): replace(joint, name=_real(joint.name)) for joint in tree.joints}
        for edge in hanging:
            names = _coordinates(edge)
            for number, name in enumerate(names):
                joints[name] = _limited(joints[name], edge, number)
            values, off = self._values(edge, [joints[name] for name in names])
            home |= dict(zip(names, values, strict=True)) if values else {}
            gap = max(gap, off)
        # A body that floats hangs on the world; where a body is the ground, on that.
        parts = tuple(
            replace(
                joint,
                parent=self.ground if joint.parent == WORLD else _real(joint.parent),
                child=_real(joint.child),
            )
            for joint in joints.values()
        )
        loops = tuple(self._loop(edge) for edge in closing)
        gap = max((gap, *(self._gap(edge) for edge in closing)))
        gap = max((gap, *(_uncoupled(coupling, home) for coupling in couplings)))
        posed = gap <= _POSED
        if not posed:
            text = f"the bodies of joints stand {gap:.2g} robot sizes or radians apart: home is searched for from there"
            self.stage.note("stage", text, Outcome.CHANGED)
        ground = Link(WORLD) if self.root is None else self.bodies[self.root].link
        added = (replace(link, name=_real(link.name)) for link in tree.links)
        links = (ground, *(self.bodies[path].link for path in moving), *added)
        return Mechanism(
            name="",
            links=links,
            joints=parts,
            loops=loops,
            couplings=tuple(couplings),
            home=home,
            home_is_guess=not posed,
            assembled=posed,
        )

    def _split(self, needed: set[str]) -> tuple[list[Edge], list[Edge]]:
        """Choose a spanning tree: motors and followers first, then rotors, then what the file keeps in articulations.

        A rotor is one of a coordinate of the tree; a joint that closes a loop has none.
        """
        group = {path: path for path in (GROUND, *self.bodies)}

        def top(path: str) -> str:
            while group[path] != path:
                path = group[path]
            return path

        def rank(edge: Edge) -> int:
            if edge.motors or edge.name in needed or edge.kind is JointKind.FLOATING:
                return 0
            if any(own.armature for own in edge.physics):
                return 1
            return 3 if edge.excluded else 2

        chosen: set[str] = set()
        for edge in sorted((edge for edge in self.edges if edge.kind not in _NO_TREE), key=rank):
            one, other = (top(end) for end in edge.bodies)
            if one != other:
                group[one] = other
                chosen.add(edge.path)
            elif rank(edge) == 0:
                raise self.stage.error(
                    edge.path,
                    "is driven, or coupled to another joint, and so are all others of its loop: one of them has to "
                    "close it, and has no coordinate then; take its drive off",
                )
        for edge in self.edges:
            if edge.path in chosen and edge.excluded and edge.kind is not JointKind.FLOATING:
                text = "physics:excludeFromArticulation: in the tree: nothing else holds its body, or it is a motor"
                self.stage.note(edge.path, text, Outcome.KEPT)
            elif edge.path not in chosen and not edge.excluded:
                self.stage.note(edge.path, "closes a loop", Outcome.CHANGED)
        return self._directed([edge for edge in self.edges if edge.path in chosen]), [
            edge for edge in self.edges if edge.path not in chosen
        ]

    def _directed(self, edges: Sequence[Edge]) -> list[Edge]:
        """Turn joints so that they lead away from the world, or from a body that floats."""
        reached, turned = {GROUND}, dict[str, Edge]()
        while len(turned) < len(edges):
            grown = False
            for edge in edges:
                one, other = edge.bodies
                if edge.path in turned or (one in reached) == (other in reached):
                    continue
                turned[edge.path] = edge if one in reached else edge.reversed()
                reached |= {one, other}
                grown = True
                turned_over = one not in reached and edge.kind is JointKind.PLANAR
                for what, told in (("limits", edge.bounds), ("springs, damping and friction", edge.physics)):
                    if turned_over and told:
                        self.stage.note(edge.path, f"its {what}: they are those of slides of the other body")
            if not grown:
                ends = {edge.bodies[1] for edge in edges if edge.path not in turned}
                free = [edge.bodies[0] for edge in edges if edge.path not in turned]
                reached.add(next((path for path in free if path not in ends), free[0]))
        return [turned[edge.path] for edge in edges]

    def _as_joint(self, edge: Edge) -> SdfJoint:
        axes = {
            JointKind.FIXED: (),
            JointKind.SPHERICAL: (),
            JointKind.FLOATING: (),
            JointKind.UNIVERSAL: (edge.axis, edge.axis2),
        }.get(edge.kind, (edge.axis,))
        parent, child = (self.inner[end] for end in edge.bodies)
        return SdfJoint(
            edge.name,
            str(edge.kind),
            edge.kind,
            parent,
            child,
            *edge.frames,
            axes=tuple(Axis(axis) for axis in axes),
        )

    def _loop(self, edge: Edge) -> Loop:
        first, second = (self.ground if end == GROUND else self.names[end] for end in edge.bodies)
        return Loop(
            edge.name, edge.kind, first, second, *edge.frames,
            axis=edge.axis, axis2=edge.axis2, length=edge.length, bounds=edge.bounds, physics=edge.physics,
        )  # fmt: skip

    # ------------------------------------------------------------------------------------------------
    # Home, from where the bodies stand
    # ------------------------------------------------------------------------------------------------

    def _apart(self, edge: Edge) -> pin.SE3:
        """Place frame 1 in frame 0, as the stage has it."""
        placed = [
            frame if end == GROUND else self.bodies[end].pose * frame
            for end, frame in zip(edge.bodies, edge.frames, strict=True)
        ]
        return placed[0].inverse() * placed[1]

    def _with_rest(self, edge: Edge) -> Edge:
        """Count the rest of a spring from the zero of its coordinate."""
        if not edge.drawn:
            return edge
        (own,), apart = edge.physics, self._apart(edge)
        if edge.kind is JointKind.SPHERICAL:
            if np.linalg.norm(pin.log3(apart.rotation)) > _STRAIGHT:
                text = "its spring is at rest where its frames coincide, in MuJoCo where the stage places its bodies"
                self.stage.note(edge.path, text, Outcome.CHANGED)
            return edge
        ((at,),) = coordinates(edge, apart)
        return replace(edge, physics=(replace(own, rest=own.rest + float(at)),))

    def _values(self, edge: Edge, joints: Sequence[Joint]) -> tuple[list[FloatArray], float]:
        """Read the coordinates of a joint of the tree, and what it misses its bodies by."""
        apart = self._apart(edge)
        values = coordinates(edge, apart)
        turn, shift = _parts(apart, _moved(edge, values))
        gap = max(turn, shift / self._size())
        for number, joint in enumerate(joints):
            if joint.kind is JointKind.REVOLUTE:
                values[number] = _within(values[number], joint)
        told = edge.home
        if told is not None and len(values) == 1 and len(told) == len(values[0]):
            same = _distance(_moved(edge, values), _moved(edge, [told])) <= 1e-6
            values = [told] if same else values
        return values, gap

    def _gap(self, edge: Edge) -> float:
        """Measure by how much a loop is open, where its coordinates do not explain it."""
        apart = self._apart(edge)
        if edge.kind is JointKind.DISTANCE:
            return abs(float(np.linalg.norm(apart.translation)) - edge.length) / self._size()
        if edge.kind is JointKind.POINT_ON_LINE:
            shift = apart.translation
            return float(np.linalg.norm(shift - edge.axis * (edge.axis @ shift))) / self._size()
        if edge.kind is JointKind.UNIVERSAL and abs(edge.axis @ edge.axis2) > 1e-9:
            lean = abs(float(edge.axis @ apart.rotation @ edge.axis2))
            return max(lean, float(np.linalg.norm(apart.translation)) / self._size())
        closed = _moved(edge, coordinates(edge, apart))
        turn, shift = _parts(apart, closed)
        return max(turn, shift / self._size())

    def _size(self) -> float:
        reach = max(
            (float(np.linalg.norm(frame.translation)) for edge in self.edges for frame in edge.frames),
            default=0.0,
        )
        return reach or 1.0


def _real(name: str) -> str:
    return name.replace(_ALIAS, WORLD)


def _parts(one: pin.SE3, other: pin.SE3) -> tuple[float, float]:
    apart = one.inverse() * other
    return float(np.linalg.norm(pin.log3(apart.rotation))), float(np.linalg.norm(apart.translation))


def _distance(one: pin.SE3, other: pin.SE3) -> float:
    return max(_parts(one, other))


def _angle(rotation: FloatArray, axis: FloatArray) -> float:
    return float(np.arctan2(axis @ pin.unSkew(rotation - rotation.T) / 2, (np.trace(rotation) - 1) / 2))


def coordinates(edge: Edge, apart: pin.SE3) -> list[FloatArray]:
    """Read the coordinates of a joint off the placement of its second frame in the first.

    Parameters
    ----------
    edge
        The joint.
    apart
        Placement of frame 1 in frame 0, which the joint may not allow.

    Returns
    -------
    list of numpy.ndarray
        Values of each of the joints that stand for it [m, rad, unit quaternion].
    """
    shift, turn, axis = apart.translation, apart.rotation, edge.axis
    match edge.kind:
        case JointKind.REVOLUTE:
            return [np.array([_angle(turn, axis)])]
        case JointKind.PRISMATIC:
            return [np.array([axis @ shift])]
        case JointKind.SPHERICAL:
            return [np.array(pin.Quaternion(turn).coeffs())]
        case JointKind.FLOATING:
            return [np.array(pin.SE3ToXYZQUAT(apart))]
        case JointKind.CYLINDRICAL:
            return [np.array([axis @ shift]), np.array([_angle(turn, axis)])]
        case JointKind.PLANAR:
            normal, x, y = orthonormal_triad(axis)
            return [np.array([x @ shift]), np.array([y @ shift]), np.array([_angle(turn, normal)])]
        case JointKind.UNIVERSAL:
            # The first turn alone moves the second axis.
            second = turn @ edge.axis2
            first = float(np.arctan2(axis @ np.cross(edge.axis2, second), edge.axis2 @ second))
            rest = pin.exp3(-first * axis) @ turn
            return [np.array([first]), np.array([_angle(rest, edge.axis2)])]
    return []


def _moved(edge: Edge, values: Sequence[FloatArray]) -> pin.SE3:
    """Place frame 1 in frame 0 at joint values."""
    one, axis = np.eye(3), edge.axis
    match edge.kind:
        case JointKind.REVOLUTE:
            return pin.SE3(pin.exp3(values[0][0] * axis), np.zeros(3))
        case JointKind.PRISMATIC:
            return pin.SE3(one, values[0][0] * axis)
        case JointKind.SPHERICAL:
            return pin.SE3(pin.Quaternion(np.array(values[0])).normalized().toRotationMatrix(), np.zeros(3))
        case JointKind.FLOATING:
            return pin.XYZQUATToSE3(values[0])
        case JointKind.CYLINDRICAL:
            return pin.SE3(pin.exp3(values[1][0] * axis), values[0][0] * axis)
        case JointKind.PLANAR:
            normal, x, y = orthonormal_triad(axis)
            return pin.SE3(pin.exp3(values[2][0] * normal), values[0][0] * x + values[1][0] * y)
        case JointKind.UNIVERSAL:
            return pin.SE3(pin.exp3(values[0][0] * axis) @ pin.exp3(values[1][0] * edge.axis2), np.zeros(3))
    return pin.SE3.Identity()


def _within(value: FloatArray, joint: Joint) -> FloatArray:
    """Turn an angle by whole turns into its range, where that helps."""
    if joint.lower <= value[0] <= joint.upper:
        return value
    turned = [value + 2 * np.pi * turns for turns in (-1, 1)]
    return next((other for other in turned if joint.lower <= other[0] <= joint.upper), value)


def _coordinates(edge: Edge) -> tuple[str, ...]:
    """Name the joints of the tree that stand for one of the file, as `grow_tree` names them."""
    suffixes = {
        JointKind.UNIVERSAL: ("_1", "_2"),
        JointKind.CYLINDRICAL: ("_slide", "_turn"),
        JointKind.PLANAR: ("_x", "_y", "_turn"),
        JointKind.FIXED: (),
    }.get(edge.kind, ("",))
    return tuple(f"{edge.name}{suffix}" for suffix in suffixes)


def _limited(joint: Joint, edge: Edge, number: int) -> Joint:
    physics = edge.physics[number] if edge.physics else joint.physics
    joint = replace(joint, independent=number in edge.motors, physics=physics)
    if not edge.bounds:
        return joint
    if edge.kind is JointKind.SPHERICAL:
        swing, turn = (bound.position[1] for bound in edge.bounds)
        return replace(joint, axis=edge.axis, swing=swing, turn=turn)
    bound = edge.bounds[number]
    lower, upper = bound.position
    further = {
        key: _one_number(getattr(bound, key)) for key in ("velocity", "acceleration", "effort", "jerk")
    }
    return replace(joint, lower=lower, upper=upper, **further)


def _one_number(span: tuple[float, float]) -> Any:
    return span[1] if span[0] == -span[1] else span


def _uncoupled(coupling: Coupling, home: Mapping[str, FloatArray]) -> float:
    """Measure by how much a joint does not follow [m or rad]."""
    follower, leader = home.get(coupling.joint1), home.get(coupling.joint2 or "")
    if follower is None or (leader is None and coupling.joint2 is not None):
        return 0.0
    at = 0.0 if leader is None else float(leader[0])
    return abs(float(follower[0] - np.polynomial.polynomial.polyval(at, coupling.polynomial)))
