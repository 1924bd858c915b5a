"""Legs read off a chain for the closed forms: of a planar 3-RPR platform, and cranks and rods of a rotary one.

And back again: chains from cranks and rods.
"""

from __future__ import annotations

from math import inf

import numpy as np
import pinocchio as pin

from stewart_pin.building.body_graph import BodyGraph, Edge
from stewart_pin.building.loading import build_chain
from stewart_pin.checks import as_array, as_positive
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.geometry.hexapod import STANDARD_GRAVITY
from stewart_pin.geometry.planar import PlanarRPR
from stewart_pin.geometry.rotary import RotaryLegs, crank_angles, crank_vectors, delta_positions
from stewart_pin.model.description import Joint, JointKind, Link, Loop, Mechanism
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.configurations import as_pose
from stewart_pin.tolerances import AT_LIMIT, PRINTED
from stewart_pin.typing import ArrayLike, FloatArray


def planar_rpr(chain: ClosedChain) -> PlanarRPR:
    """Read anchors and corners off a chain that moves in a plane, wherever that stands.

    Parameters
    ----------
    chain
        Closed chain of three legs, each a prismatic motor between a revolute joint on the ground and one on the
        platform, wherever the file cut the loops, and whatever the motors read: lengths are
        ``offset + sign * motor_positions`` with ``sign, offset = chain.leg_readings``.

    Returns
    -------
    PlanarRPR
        Legs in the order of the motors, and the plane. With the plane along xy of the world its frame is the world's,
        but for its height.

    Raises
    ------
    UnsupportedError
        If the chain is no such platform.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> chain = stp.load("rpr_planar")
    >>> sign, offset = chain.leg_readings
    >>> lengths = offset + sign * stp.motor_positions(chain, chain.q_home)
    >>> len(stp.planar_assembly_modes(stp.planar.planar_rpr(chain), lengths))
    4
    """
    graph = BodyGraph(chain)
    platform = graph.frames[chain.platform_link]
    if len(chain.motors) != 3:
        raise UnsupportedError(
            f"a planar 3-RPR platform has three motors, {chain.name} has {len(chain.motors)}"
        )
    hinges = [_leg(graph, motor) for motor in chain.motors]
    z = _across(hinges[0][0].axis, platform.rotation[:, 2])
    axes = _square(z)
    slack = PRINTED * chain.length_scale
    plane = np.eye(4)
    # The plane goes through the platform's origin, and its frame stands under that of the world.
    plane[:3, :3], plane[:3, 3] = axes, z * (z @ platform.translation)
    anchors, corners = [], []
    turned = platform.rotation.T @ axes @ _about_z(axes.T @ platform.rotation)
    for motor, (foot, head) in zip(chain.motors, hinges, strict=True):
        for hinge in (foot, head):
            if np.linalg.norm(np.cross(hinge.axis, z)) > PRINTED:
                raise _no_leg(
                    motor, f"joint '{hinge.name}' does not turn about the axis that the others turn about"
                )
        edge = graph.edge(motor)
        assert edge is not None
        across = np.cross(edge.axis, head.point - foot.point)
        if abs(edge.axis @ z) > PRINTED or abs(across @ z) > slack:
            raise _no_leg(motor, "it does not slide along the line between its hinges")
        anchors.append(axes[:, :2].T @ foot.point)
        corners.append(turned[:, :2].T @ platform.actInv(head.point))
    return PlanarRPR(np.array(anchors), np.array(corners), plane, turned)


def _across(axis: FloatArray, platform_z: FloatArray) -> FloatArray:
    """Direct an axis along the platform's z, or, where that stands otherwise, its first component up."""
    first = axis[np.abs(axis) > PRINTED][0]
    along = axis @ platform_z
    return axis * np.sign(along if abs(along) > 1 - PRINTED else first)


def _square(z: FloatArray) -> FloatArray:
    """Axes with a given z, and x as near to the world's as can be; to its y where that stands across."""
    near = np.eye(3)[0 if abs(z[0]) < 1 - PRINTED else 1]
    x = near - (near @ z) * z
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _about_z(rotation: FloatArray) -> FloatArray:
    """Turn about z that takes x as near as can be to a rotation's x, or to its y where that stands across."""
    flat = rotation[:2, 0] if np.linalg.norm(rotation[:2, 0]) > PRINTED else rotation[:2, 1]
    c, s = flat / np.linalg.norm(flat)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def _leg(graph: BodyGraph, motor: str) -> tuple[Edge, Edge]:
    """Hinges of a leg on the ground and on the platform."""
    edge = graph.edge(motor)
    if edge is None or edge.kind is not JointKind.PRISMATIC:
        raise _no_leg(
            motor, "nothing leads on from it" if edge is None else f"it is {edge.kind}, not prismatic"
        )
    ends: dict[str, Edge] = {}
    for link in edge.links:
        onward = graph.onward(graph.body[link], edge)
        if len(onward) != 1 or onward[0].kind is not JointKind.REVOLUTE:
            raise _no_leg(motor, f"link '{link}' is not held by one revolute joint")
        ends[graph.across(onward[0], graph.body[link])] = onward[0]
    if set(ends) != {graph.ground, graph.platform}:
        raise _no_leg(motor, "it does not lead from the ground to the platform")
    return ends[graph.ground], ends[graph.platform]


def _no_leg(motor: str, reason: str) -> UnsupportedError:
    return UnsupportedError(
        f"motor '{motor}' does not drive a leg of a planar 3-RPR platform: {reason}; its closed forms need such legs, "
        "the other verbs do not"
    )


# ----------------------------------------------------------------------------------------------------
# The cranks and rods of a rotary platform, read off its chain for the closed forms
# ----------------------------------------------------------------------------------------------------

_ROUND_OFF = 1e-9
"""Share of the largest singular value below which lines leave a direction open: those of hinges in a row."""
_FREEDOMS = {JointKind.REVOLUTE: 1, JointKind.UNIVERSAL: 2, JointKind.SPHERICAL: 3}


def rotary_legs(chain: ClosedChain) -> RotaryLegs:
    """Read crank centres, axes, lengths and platform points off a chain.

    Every motor turns a crank about an axis of the ground, and rods lead from the crank to the platform, each between
    joints that turn about one point at either end, however the file builds and cuts them. Two parallel rods on one
    crank count as one between their middles, which is exact as long as the platform does not turn: a Delta.

    Parameters
    ----------
    chain
        Closed chain, its home closed.

    Returns
    -------
    RotaryLegs
        Legs in the order of the motors; crank angles are motor positions.

    Raises
    ------
    UnsupportedError
        If a motor does not drive such a leg.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> chain = stp.load("hexapod_rss")
    >>> pose = stp.platform_pose(chain, chain.q_home)
    >>> angles = stp.rotary.crank_angles(stp.rotary.rotary_legs(chain), pose.translation, pose.rotation).angle[:, 0]
    >>> np.allclose(angles, stp.motor_positions(chain, chain.q_home))
    True
    """
    reader = _Reader(chain)
    legs = [
        reader.leg(motor, float(q))
        for motor, q in zip(chain.motors, chain.q_home[chain.motor_q_index], strict=True)
    ]
    if not legs:
        raise UnsupportedError("a chain without motors has no driven cranks")
    return RotaryLegs(*(np.array(column) for column in zip(*legs, strict=True)))


class _Reader:
    def __init__(self, chain: ClosedChain) -> None:
        self.chain = chain
        self.slack = PRINTED * chain.length_scale
        self.graph = BodyGraph(chain)

    def leg(self, motor: str, position: float) -> tuple[FloatArray, ...]:
        """Fields of `RotaryLegs` for one motor."""
        joint = self.chain.mechanism.joint(motor)
        edge = self.graph.edge(motor)
        if joint.kind is not JointKind.REVOLUTE:
            raise _no_crank(motor, f"it is {joint.kind}, not revolute")
        if edge is None:
            raise _no_crank(motor, "nothing leads on from its crank")
        if self.graph.body[joint.parent] != self.graph.ground:
            raise _no_crank(motor, f"its axis stands on link '{joint.parent}', not on the ground")
        crank = self.graph.body[joint.child]
        rods = [self._rod(motor, first, crank) for first in self.graph.onward(crank, edge)]
        if not 1 <= len(rods) <= 2:
            raise _no_crank(motor, f"{len(rods)} rods lead on from its crank")
        tip, head = np.mean(rods, axis=0)
        lengths = [np.linalg.norm(end - start) for start, end in rods]
        if max(np.linalg.norm((end - start) - (head - tip)) for start, end in rods) > self.slack:
            raise _no_crank(motor, "the two rods of its crank are not parallel")
        centre = edge.point + edge.axis * (edge.axis @ (tip - edge.point))
        radius = float(np.linalg.norm(tip - centre))
        if radius <= self.slack:
            raise _no_crank(motor, "its crank has no length")
        zero = pin.exp3(-position * edge.axis) @ (tip - centre)
        there = self.graph.frames[self.chain.platform_link].actInv(head)
        return centre, edge.axis, zero, there, np.array(radius), np.array(lengths[0])

    def _rod(self, motor: str, first: Edge, crank: str) -> tuple[FloatArray, FloatArray]:
        """Walk from a crank to the platform: the points about which the joints at either end turn."""
        path, body = [first], self.graph.across(first, crank)
        while body != self.graph.platform:
            onward = self.graph.onward(body, path[-1])
            if body == self.graph.ground or len(onward) != 1 or len(path) > len(self.graph.edges):
                raise _no_crank(motor, f"{len(onward)} ways lead on from link '{body}', none to the platform")
            path.append(onward[0])
            body = self.graph.across(onward[0], body)
        strange = next((edge for edge in path if edge.kind not in _FREEDOMS), None)
        if strange is not None:
            raise _no_crank(motor, f"'{strange.name}' in its rod is {strange.kind}")
        start, count = self._common_point(path)
        end, rest = self._common_point(path[count:])
        freedoms = sum(_FREEDOMS[edge.kind] for edge in path)
        if start is None or end is None or count + rest != len(path) or freedoms < 5:
            raise _no_crank(motor, "its rod has not five or six joint axes, about one point at either end")
        return start, end

    def _common_point(self, path: list[Edge]) -> tuple[FloatArray | None, int]:
        """Find the point through which the first axes of a path all pass, and how many do."""
        for count in range(len(path), 0, -1):
            # Nearest point to points and lines: each asks for P (x - point) = 0, with P across the line.
            across = [
                np.eye(3) - np.outer(e.axis, e.axis) if e.kind is JointKind.REVOLUTE else np.eye(3)
                for e in path[:count]
            ]
            system, right = (
                np.vstack(across),
                np.concatenate([p @ e.point for p, e in zip(across, path, strict=False)]),
            )
            point, _, rank, _ = np.linalg.lstsq(system, right, rcond=_ROUND_OFF)
            if rank == 3 and np.abs(system @ point - right).max() <= self.slack:
                return point, count
        return None, 0


def _no_crank(motor: str, reason: str) -> UnsupportedError:
    return UnsupportedError(
        f"motor '{motor}' does not drive a crank with a rod between two points: {reason}; closed forms of rotary legs "
        "need such legs, the other verbs do not"
    )


# ----------------------------------------------------------------------------------------------------
# Chains from cranks and rods
# ----------------------------------------------------------------------------------------------------

_X, _Y, _Z = np.eye(3)
_Rods = list[list[tuple[str, FloatArray]]]
"""Of every crank the names of its rods, and how far each stands from the middle of the leg, in base axes [m]."""


def rotary_hexapod_chain(
    legs: RotaryLegs,
    *,
    platform: pin.Inertia,
    crank: pin.Inertia,
    rod: pin.Inertia,
    limits: tuple[float, float] = (-inf, inf),
    base: pin.Inertia | None = None,
    effort: float = inf,
    velocity: float = inf,
    home: pin.SE3 | None = None,
    name: str = "rotary_hexapod",
    gravity: ArrayLike = STANDARD_GRAVITY,
) -> ClosedChain:
    """Build a platform on six cranks and rods, a ball at either end of each rod.

    A ball at a crank is three revolute joints about one point, the last along the rod, which may spin; a ball at the
    platform closes a loop. The platform is a free body of the tree.

    Parameters
    ----------
    legs
        Six legs.
    platform
        Inertia in the platform frame [kg, m, kg m²].
    crank
        Inertia of each crank, in a frame at its centre, x along it and y along its axis [kg, m, kg m²].
    rod
        Inertia of each rod, in a frame at the crank's tip, z along the rod [kg, m, kg m²].
    limits
        Least and greatest crank angle [rad].
    base
        Inertia of the ground link, which makes it a body of the maximal-coordinate system [kg, m, kg m²].
    effort
        Largest motor torque [N m].
    velocity
        Largest crank rate [rad/s].
    home
        Platform frame in the world at home; default: level, its points centred above the tips of cranks in the middle
        of their limits, at the height that the rods have there on average. Each crank stands on the branch nearer to
        that middle.
    name
        Name of the robot.
    gravity
        (3,) acceleration of free fall in the world frame [m/s²].

    Returns
    -------
    ClosedChain
        Legs in the order of the points; motors ``motor1`` to ``motor6`` with the angles of `crank_angles`.

    Raises
    ------
    InputError
        If there are not six legs, an inertia is none, or the limits are empty.
    UnreachableError
        If a leg does not reach home within the limits.
    MechanismError
        If an inertia is unphysical.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> bundled = stp.load("hexapod_rss")
    >>> body = bundled.mechanism.link
    >>> bodies = {name: body(link).inertia for name, link in (("crank", "crank1"), ("rod", "rod1"))}
    >>> legs = stp.rotary.rotary_legs(bundled)
    >>> chain = stp.build.rotary_hexapod_chain(legs, platform=body("platform").inertia, **bodies)
    >>> stp.mobility(chain).dof
    12
    """
    _require_legs(legs, 6, platform=platform, crank=crank, rod=rod, base=base)
    middle = _middle_angles(legs, limits)
    if home is None:
        tips = legs.base_points + crank_vectors(legs, middle)[0]
        across = (tips - tips.mean(axis=0)) - (legs.platform_points - legs.platform_points.mean(axis=0))
        rise = np.sqrt(np.maximum(legs.rods**2 - (across[:, :2] ** 2).sum(axis=1), 0.0)).mean()
        home = pin.SE3(np.eye(3), tips.mean(axis=0) - legs.platform_points.mean(axis=0) + rise * _Z)
    pose = as_pose("home", home)
    rods: _Rods = [[(f"rod{k + 1}", np.zeros(3))] for k in range(6)]
    links = [Link("base", base), Link("platform", platform)]
    parts = _rotary_parts(legs, rods, pose, middle, limits, (effort, velocity), (crank, rod))
    return _rotary_chain(name, links, parts, pose, gravity)


def delta_chain(
    legs: RotaryLegs,
    *,
    width: float,
    platform: pin.Inertia,
    crank: pin.Inertia,
    rod: pin.Inertia,
    limits: tuple[float, float] = (-inf, inf),
    base: pin.Inertia | None = None,
    effort: float = inf,
    velocity: float = inf,
    home: ArrayLike | None = None,
    name: str = "delta",
    gravity: ArrayLike = STANDARD_GRAVITY,
) -> ClosedChain:
    """Build a Delta: three cranks, each with two parallel rods that have a ball at either end.

    Balls and tree are as of `rotary_hexapod_chain`; the pairs of rods keep the platform from turning.

    Parameters
    ----------
    legs
        Three legs, as of `delta_legs`: each rod stands for the middle of a pair.
    width
        Distance of the two rods of a pair, along the axis of their crank [m].
    platform
        Inertia in the platform frame [kg, m, kg m²].
    crank
        Inertia of each crank, in a frame at its centre, x along it and y along its axis [kg, m, kg m²].
    rod
        Inertia of each of the six rods, in a frame at the crank's tip, z along the rod [kg, m, kg m²].
    limits
        Least and greatest crank angle [rad].
    base
        Inertia of the ground link, which makes it a body of the maximal-coordinate system [kg, m, kg m²].
    effort
        Largest motor torque [N m].
    velocity
        Largest crank rate [rad/s].
    home
        (3,) platform origin in the world at home; default: the first of `delta_positions` with the cranks in the middle
        of their limits, or at zero. Each crank stands on the branch nearer to that middle [m].
    name
        Name of the robot.
    gravity
        (3,) acceleration of free fall in the world frame [m/s²].

    Returns
    -------
    ClosedChain
        Legs in their order; motors ``motor1`` to ``motor3`` with the angles of `crank_angles`.

    Raises
    ------
    InputError
        If there are not three legs, the width is not above zero, an inertia is none, or the limits are empty.
    UnreachableError
        If a leg does not reach home within the limits.
    MechanismError
        If an inertia is unphysical.

    Examples
    --------
    >>> import numpy as np, pinocchio as pin, stewart_pin as stp
    >>> legs = stp.rotary.delta_legs(base_radius=0.132, platform_radius=0.033, crank=0.112, rod=0.232)
    >>> bodies = {name: pin.Inertia(0.1, np.zeros(3), 1e-4 * np.eye(3)) for name in ("platform", "crank", "rod")}
    >>> stp.mobility(stp.build.delta_chain(legs, width=0.05, **bodies)).dof
    9
    """
    _require_legs(legs, 3, platform=platform, crank=crank, rod=rod, base=base)
    half = as_positive("width", width) / 2
    middle = _middle_angles(legs, limits)
    position = delta_positions(legs, middle).position[0] if home is None else as_array("home", home, (3,))
    pose = pin.SE3(np.eye(3), position)
    rods: _Rods = [
        [(f"rod{k}{side}", sign * half * axis) for side, sign in (("a", 1), ("b", -1))]
        for k, axis in enumerate(legs.axes, start=1)
    ]
    links = [Link("base", base), Link("platform", platform)]
    parts = _rotary_parts(legs, rods, pose, middle, limits, (effort, velocity), (crank, rod))
    return _rotary_chain(name, links, parts, pose, gravity)


def _require_legs(legs: RotaryLegs, count: int, **inertias: pin.Inertia | None) -> None:
    if not isinstance(legs, RotaryLegs) or len(legs.cranks) != count:
        found = f"{len(legs.cranks)} legs" if isinstance(legs, RotaryLegs) else type(legs).__name__
        raise InputError(f"legs must be RotaryLegs with {count} legs, got {found}")
    for argument, inertia in inertias.items():
        if not isinstance(inertia, pin.Inertia) and not (argument == "base" and inertia is None):
            raise InputError(f"{argument} must be a pinocchio.Inertia, got {type(inertia).__name__}")


def _middle_angles(legs: RotaryLegs, limits: tuple[float, float]) -> FloatArray:
    """Middle of the limits for every crank; zero where they have an end at most [rad]."""
    try:
        low, high = map(float, limits)
    except (TypeError, ValueError):
        low = high = inf
    if not low < high:
        raise InputError(f"limits must be (least, greatest) crank angle, got {limits!r}")
    bounded = np.isfinite(low) and np.isfinite(high)
    return np.full(len(legs.cranks), (low + high) / 2 if bounded else np.clip(0.0, low, high))


_Parts = tuple[list[Link], list[Joint], list[Loop], dict[str, FloatArray]]


def _rotary_parts(
    legs: RotaryLegs,
    rods: _Rods,
    pose: pin.SE3,
    middle: FloatArray,
    limits: tuple[float, float],
    drive: tuple[float, float],
    bodies: tuple[pin.Inertia, pin.Inertia],
) -> _Parts:
    """Cranks, rods and the balls between them, closed at a pose of the platform."""
    # A crank may stand at a limit, where round-off decides whether it is within.
    bounded = None if np.isinf(limits).all() else np.asarray(limits, dtype=float) + (-AT_LIMIT, AT_LIMIT)
    found = crank_angles(legs, pose.translation, pose.rotation, limits=bounded)
    off = np.where(found.within, np.abs(found.angle - middle[:, None]), inf)
    angles = np.take_along_axis(found.angle, np.argmin(off, axis=1)[:, None], axis=1)[:, 0]
    angles = np.clip(angles, *limits)
    tips = legs.base_points + crank_vectors(legs, angles)[0]
    links: list[Link] = []
    joints: list[Joint] = []
    loops: list[Loop] = []
    values: dict[str, FloatArray] = {}
    for k, pair in enumerate(rods):
        crank, motor = f"crank{k + 1}", f"motor{k + 1}"
        # x along the crank at angle zero, y along its axis.
        facing = np.stack([legs.zeros[k], legs.axes[k], np.cross(legs.zeros[k], legs.axes[k])], axis=1)
        links.append(Link(crank, bodies[0]))
        joints.append(
            Joint(
                motor, JointKind.REVOLUTE, "base", crank, pin.SE3(facing, legs.base_points[k]), _Y,
                *limits, *drive, independent=True,
            )
        )  # fmt: skip
        values[motor] = np.array([angles[k]])
        head = legs.platform_points[k]
        there = facing @ pin.exp3(angles[k] * _Y)
        u = there.T @ (pose.act(head) - tips[k]) / legs.rods[k]
        for rod, aside in pair:
            at = pin.SE3(np.eye(3), legs.cranks[k] * _X + facing.T @ aside)
            chain = [crank, f"{rod}_cross1", f"{rod}_cross2", rod]
            ends = zip("yx", (_Y, _X), strict=True)
            hinges = [*((f"{rod}_{end}", axis) for end, axis in ends), (f"{rod}_spin", _Z)]
            for step, (hinge, axis) in enumerate(hinges):
                placement = at if step == 0 else pin.SE3.Identity()
                joints.append(Joint(hinge, JointKind.REVOLUTE, chain[step], chain[step + 1], placement, axis))
            # u = Ry(β) Rx(α) z = (sin β cos α, -sin α, cos β cos α).
            turns = (np.arctan2(u[0], u[2]), -np.arcsin(np.clip(u[1], -1.0, 1.0)), 0.0)
            values |= {hinge: np.array([turn]) for (hinge, _), turn in zip(hinges, turns, strict=True)}
            links += [Link(chain[1]), Link(chain[2]), Link(rod, bodies[1])]
            on_platform = pin.SE3(np.eye(3), head + pose.rotation.T @ aside)
            on_rod = pin.SE3(np.eye(3), legs.rods[k] * _Z)
            loops.append(Loop(f"{rod}_ball", JointKind.SPHERICAL, "platform", rod, on_platform, on_rod))
    return links, joints, loops, values


def _rotary_chain(
    name: str, links: list[Link], parts: _Parts, pose: pin.SE3, gravity: ArrayLike
) -> ClosedChain:
    floating = Joint("platform_pose", JointKind.FLOATING, "base", "platform", pin.SE3.Identity())
    legs, joints, loops, values = parts
    mechanism = Mechanism(
        name, (*links, *legs), (floating, *joints), tuple(loops), platform="platform",
        home={"platform_pose": pin.SE3ToXYZQUAT(pose), **values}, source="",
    )  # fmt: skip
    return build_chain(mechanism, gravity=gravity)
