"""How large a mechanism is: from distances between its joints, not from where it stands.

A joint has a place on each of the two bodies that it connects: a ball or a universal joint a point, a hinge a line. A
slide has none, for its frame may stand anywhere along it. On every body the places lie around the point that is
nearest to all of them, and on every axis the places on either side of it stand at some distance along it. The largest
distance from the former, or half the largest one between the latter, is the size: the link lengths and the offsets of
Denavit and Hartenberg, told without their frames. It does not change when the robot is moved, a zero is shifted, a
frame is turned about its axis or slid along it, or loops are cut elsewhere.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.model.description import Joint, JointKind, Mechanism, unknown_kind
from stewart_pin.typing import FloatArray

_POINTS = (
    JointKind.SPHERICAL,
    JointKind.UNIVERSAL,
    JointKind.FIXED,
    JointKind.DISTANCE,
    JointKind.CABLE,
)
_LINES = (JointKind.REVOLUTE, JointKind.CYLINDRICAL)
_NOWHERE = (JointKind.PRISMATIC, JointKind.PLANAR, JointKind.FLOATING)
_OFFSET_OF_ROUND_OFF = 1e-6
"""Share of the other lengths in a file below which a distance between joints is an accident of printed digits."""
_ROUND_OFF = 1e-14
"""What a few placements, one after the other, leave of the distance between two points that are one, relative to it."""
_LONG_STROKE = 500.0
"""Stroke, in sizes of the bodies, beyond which it is a number for "none": a gantry of 20 m on carriages of 0.1 m has
200, and programs write 1000 m and more."""
_PARALLEL = 0.05
"""Sine between axes below which no point of either is nearest to the other in a sense that printed digits keep."""
_MEET = 1e-6
"""Distance of two axes, relative to the lengths in the file, at which they meet in a point."""


@dataclass(frozen=True, eq=False)
class _Place:
    """Where a joint sits on a body: a point, with the direction of its axis if it is a line."""

    point: FloatArray
    axis: FloatArray | None = None


def length_scale(mechanism: Mechanism, platform: str | None = None, *, digits: float = 0.0) -> float:
    """Measure a mechanism.

    Parameters
    ----------
    mechanism
        Description.
    platform
        Link whose origin counts as a place, too.
    digits
        Share of the other lengths in the file that its last digits leave open: a distance between joints below it is
        no length, but axes that were meant to meet or to lie in line, dimensionless.

    Returns
    -------
    float
        The largest distance of a joint's place from the middle of the places on one body, or half the largest offset
        along an axis; where all joints meet in a point or slide, half the longest stated stroke that bodies of their
        size may have, else how far a centre of mass is from where the axes on its body meet, else the same for the
        frames of the file, else for centres of mass; 1 where there is no length at all [m].
    """
    bodies = _bodies(mechanism)
    drawn = _largest_drawn(mechanism, bodies)
    places = _places(mechanism, bodies, platform, drawn)
    told = [
        max(_largest_radius(places), _largest_offset(mechanism, bodies, places)),
        _longest_stroke(mechanism, drawn),
        _farthest_mass_from_middle(mechanism, bodies, places),
        drawn,
        _farthest_mass(mechanism),
    ]
    # Of a balanced gimbal no length is left but those of its bodies, and round-off of where it stands.
    others = max(told[0], *told[2:], _widest_body(mechanism))
    reach = max(
        (float(np.linalg.norm(each.point)) for group in places.values() for each in group), default=0.0
    )
    floor = max(max(_OFFSET_OF_ROUND_OFF, digits) * others, _ROUND_OFF * reach)
    return next((length for length in told if length > floor), 1.0)


_Bodies = dict[str, tuple[str, pin.SE3]]


def _bodies(mechanism: Mechanism) -> _Bodies:
    """Body of every link, named after its first link, and the link's placement in it: fixed joints are no joints."""
    above = {joint.child: joint for joint in mechanism.joints}
    found: dict[str, tuple[str, pin.SE3]] = {}

    def find(link: str) -> tuple[str, pin.SE3]:
        chain: list[Joint] = []
        while link not in found and link in above and above[link].kind is JointKind.FIXED:
            chain.append(above[link])
            link = above[link].parent
        body, placement = found.setdefault(link, (link, pin.SE3.Identity()))
        for joint in reversed(chain):
            placement = placement * joint.placement
            found[joint.child] = (body, placement)
        return body, placement

    for link in mechanism.links:
        find(link.name)
    return found


def _places(
    mechanism: Mechanism, bodies: _Bodies, platform: str | None, drawn: float
) -> dict[str, list[_Place]]:
    places: dict[str, list[_Place]] = defaultdict(list)

    def add(owner: str, link: str, kind: JointKind, placement: pin.SE3, axis: FloatArray) -> None:
        body, at = bodies[link]
        frame = at * placement
        if kind in _POINTS:
            places[body].append(_Place(np.array(frame.translation)))
        elif kind in _LINES:
            places[body].append(_Place(np.array(frame.translation), frame.rotation @ axis))
        elif kind not in _NOWHERE:
            raise unknown_kind(owner, kind, "the measure of size")

    for joint in mechanism.joints:
        if joint.kind is not JointKind.FIXED:
            owner = f"joint '{joint.name}'"
            add(owner, joint.parent, joint.kind, joint.placement, joint.axis)
            add(owner, joint.child, joint.kind, pin.SE3.Identity(), joint.axis)
    for loop in mechanism.loops:
        on_line = loop.kind is JointKind.POINT_ON_LINE  # the line is on body 1, the point on body 2
        one, two = (JointKind.REVOLUTE, JointKind.SPHERICAL) if on_line else (loop.kind, loop.kind)
        owner = f"loop '{loop.name}'"
        add(owner, loop.link1, one, loop.placement1, loop.axis)
        add(owner, loop.link2, two, loop.placement2, loop.axis)
    for body, place in _universal_centres(mechanism, bodies, drawn):
        places[body].append(place)
    if platform is not None:
        body, at = bodies[platform]
        places[body].append(_Place(np.array(at.translation)))
    return places


def _universal_centres(mechanism: Mechanism, bodies: _Bodies, drawn: float) -> list[tuple[str, _Place]]:
    """Points where the axes of hinges on both sides of a massless link meet: centres of universal joints.

    The point is fixed in the bodies on either side as well, where the single hinge is only a line.
    """
    inertial = {bodies[link.name][0] for link in mechanism.links if link.inertia is not None}
    above = {bodies[j.child][0]: j for j in mechanism.joints if j.kind is not JointKind.FIXED}
    centres: list[tuple[str, _Place]] = []
    for joint in mechanism.joints:
        cross, at = bodies[joint.parent]
        upper = above.get(cross)
        if upper is None or cross in inertial or {joint.kind, upper.kind} != {JointKind.REVOLUTE}:
            continue
        # Both axes in the cross: the upper one through its origin, for it is the upper joint's child.
        first_axis = bodies[upper.child][1].rotation @ upper.axis
        first = _Place(bodies[upper.child][1].translation, first_axis)
        frame = at * joint.placement
        second_axis = frame.rotation @ joint.axis
        second = _Place(np.array(frame.translation), second_axis)
        middle, reach = _middle(*_arrays([first, second]))
        if reach > _MEET * drawn or np.linalg.norm(np.cross(first_axis, second_axis)) < _MEET:
            continue
        # From the cross to its neighbours: along the axes the joints do not move the point.
        parent, in_parent = bodies[upper.parent]
        along = float(first_axis @ (middle - first.point))
        hinge = in_parent * upper.placement
        centres.append((parent, _Place(hinge.act(along * upper.axis))))
        child, in_child = bodies[joint.child]
        along = float(second_axis @ (middle - second.point))
        centres.append((child, _Place(in_child.act(along * joint.axis))))
    return centres


def _largest_drawn(mechanism: Mechanism, bodies: _Bodies) -> float:
    """Largest distance, on one body, of the origin of a joint's or loop's frame in the file from their middle."""
    points: dict[str, list[FloatArray]] = defaultdict(list)

    def add(link: str, placement: pin.SE3 | None) -> None:
        body, at = bodies[link]
        points[body].append(np.array(at.translation if placement is None else at.act(placement.translation)))

    for joint in mechanism.joints:
        if joint.kind is not JointKind.FIXED:
            add(joint.parent, joint.placement)
            add(joint.child, None)
    for loop in mechanism.loops:
        add(loop.link1, loop.placement1)
        add(loop.link2, loop.placement2)
    groups = (np.array(group) for group in points.values() if len(group) > 1)
    return max((float(np.linalg.norm(g - g.mean(axis=0), axis=1).max()) for g in groups), default=0.0)


def _largest_offset(mechanism: Mechanism, bodies: _Bodies, places: dict[str, list[_Place]]) -> float:
    """Half the largest distance, along an axis, between what is nearest to it on the bodies on either side."""
    arrays = {body: _arrays(group) for body, group in places.items()}
    largest = 0.0
    for joint in mechanism.joints:
        if joint.kind is not JointKind.REVOLUTE:
            continue
        along: list[FloatArray] = []
        for link, placement in ((joint.parent, joint.placement), (joint.child, pin.SE3.Identity())):
            body, at = bodies[link]
            frame = at * placement
            along.append(_feet(np.array(frame.translation), frame.rotation @ joint.axis, *arrays[body]))
        feet = np.concatenate(along)
        largest = max(largest, float(np.ptp(feet)) / 2) if feet.size else largest
    return largest


def _feet(point: FloatArray, axis: FloatArray, points: FloatArray, axes: FloatArray) -> FloatArray:
    """Coordinates along an axis of its points nearest to places; without lines that are parallel or nearly so."""
    apart = points - point
    # A point has no axis: across is zero.
    across = np.cross(axis, axes)
    square = (across * across).sum(axis=1)
    lines = axes.any(axis=1)
    skew = square >= _PARALLEL**2
    feet = apart @ axis
    feet[skew] = (np.cross(apart, axes)[skew] * across[skew]).sum(axis=1) / square[skew]
    return feet[skew | ~lines]


def _arrays(places: list[_Place]) -> tuple[FloatArray, FloatArray]:
    """Points (n, 3) and axes (n, 3) of places, zero for those that are no lines."""
    zero = np.zeros(3)
    return (
        np.array([place.point for place in places]),
        np.array([zero if place.axis is None else place.axis for place in places]),
    )


def _largest_radius(places: dict[str, list[_Place]]) -> float:
    return max((_middle(*_arrays(group))[1] for group in places.values()), default=0.0)


def _middle(points: FloatArray, axes: FloatArray) -> tuple[FloatArray, float]:
    """Point nearest to points and lines in the sense of least squares, and the largest distance from it."""
    start = points.mean(axis=0)
    if len(points) == 1:
        return start, 0.0
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]  # onto the directions in which a distance counts
    apart = points - start
    # Least norm: along the direction of parallel lines it stays, for there it makes no difference.
    normal = across.sum(axis=0)
    values, vectors = np.linalg.eigh(normal)
    kept = values > _PARALLEL**2 * values[-1]
    goal = (across @ apart[:, :, None]).sum(axis=0)[:, 0]
    step = vectors[:, kept] @ ((vectors[:, kept].T @ goal) / values[kept])
    reach = (across @ (apart - step)[:, :, None])[:, :, 0]
    return start + step, float(np.sqrt((reach * reach).sum(axis=1).max()))


def _longest_stroke(mechanism: Mechanism, drawn: float) -> float:
    """Half the longest stroke; one that no body is nearly large enough for stands for none, whatever the unit."""
    strokes = [j.upper - j.lower for j in mechanism.joints if j.kind is JointKind.PRISMATIC]
    bodies = max(_farthest_mass(mechanism), _widest_body(mechanism))
    # Points without extent say nothing of what is long.
    most = _LONG_STROKE * max(bodies, drawn) if bodies > 0 else np.inf
    return max((s / 2 for s in strokes if np.isfinite(s) and s <= most), default=0.0)


def _widest_body(mechanism: Mechanism) -> float:
    """Largest radius of gyration."""
    inertias = [link.inertia for link in mechanism.links if link.inertia is not None]
    radii = [np.abs(np.diag(body.inertia)).max() / body.mass for body in inertias if body.mass > 0]
    return float(np.sqrt(max(radii, default=0.0)))


def _farthest_mass_from_middle(
    mechanism: Mechanism, bodies: _Bodies, places: dict[str, list[_Place]]
) -> float:
    """Largest distance of a centre of mass from where the axes on its body meet, of bodies on which they do."""
    largest = 0.0
    for link in mechanism.links:
        body, at = bodies[link.name]
        if link.inertia is None or not places.get(body):
            continue
        points, axes = _arrays(places[body])
        directions = np.linalg.svd(axes, compute_uv=False)
        if axes.any(axis=1).all() and directions[1:2].sum() <= _PARALLEL:
            continue  # a line has no middle
        middle, _ = _middle(points, axes)
        largest = max(largest, float(np.linalg.norm(at.act(link.inertia.lever) - middle)))
    return largest


def _farthest_mass(mechanism: Mechanism) -> float:
    return max(
        (float(np.linalg.norm(link.inertia.lever)) for link in mechanism.links if link.inertia is not None),
        default=0.0,
    )
