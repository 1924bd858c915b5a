"""Recognise the legs of a platform: where each motor's leg meets the ground and the platform."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from stewart_pin.errors import UnsupportedError
from stewart_pin.model.description import Joint, JointKind, Mechanism
from stewart_pin.model.unfolding import fixed_to
from stewart_pin.tolerances import PRINTED
from stewart_pin.typing import FloatArray

_PARALLEL = 1e-4
"""Sine of the angle between two axes below which printed digits leave open where they meet."""

_Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class _Edge:
    """A connection as seen from one of its two links: the joint's frame in this link and in the other one."""

    kind: JointKind
    name: str
    other: str
    here: pin.SE3
    there: pin.SE3
    axis: FloatArray


@dataclass(frozen=True, eq=False)
class _Locus:
    """Where the common point of the joints passed so far can be: a point, or anywhere on the axis of the only one.

    `origin` and `axis` stand in the current link, `start` and `start_axis` in the link where the walk began.
    """

    origin: FloatArray
    axis: FloatArray | None
    start: FloatArray
    start_axis: FloatArray | None


def leg_points(mechanism: Mechanism, motors: Sequence[str], platform: str) -> tuple[FloatArray, FloatArray]:
    """Find both ends of the leg that each motor drives.

    A leg is a prismatic motor between joints that turn about one point of the ground and joints that turn about one
    point of the platform, and slides along the line between the points; wherever the file cut the loop. Axes may miss
    the point as few printed digits make them.

    Parameters
    ----------
    mechanism
        Description.
    motors
        Names of the motor joints.
    platform
        Name of the platform link.

    Returns
    -------
    base_points : numpy.ndarray
        (nu, 3) in the ground link's frame [m].
    platform_points : numpy.ndarray
        (nu, 3) in the platform link's frame [m].

    Raises
    ------
    UnsupportedError
        If a motor does not drive such a leg.
    """
    walker = _Walker(mechanism, platform)
    legs = [walker.leg(mechanism.joint(motor)) for motor in motors]
    base, top = ([leg[link] for leg in legs] for link in (mechanism.root, platform))
    return np.array(base).reshape(-1, 3), np.array(top).reshape(-1, 3)


def leg_readings(
    mechanism: Mechanism, motors: Sequence[str], platform: str, home: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Find what each motor of a leg reads: length = offset + sign × reading.

    The leg may turn about a point at either end, or about parallel axes as in a planar mechanism, and then has the
    length between these.

    Parameters
    ----------
    mechanism
        Description.
    motors
        Names of the motor joints.
    platform
        Name of the platform link.
    home
        (nu,) readings at home, which tell to which side the leg points [m].

    Returns
    -------
    sign : numpy.ndarray
        (nu,) 1 where a longer leg reads more, -1 where it reads less, dimensionless.
    offset : numpy.ndarray
        (nu,) length where the motor reads zero [m].

    Raises
    ------
    UnsupportedError
        If a motor drives neither.
    """
    walker = _Walker(mechanism, platform)
    zero = np.array([walker.zero(mechanism.joint(motor)) for motor in motors])
    sign = np.where(zero + home < 0, -1.0, 1.0)
    return sign, sign * zero


class _Walker:
    def __init__(self, mechanism: Mechanism, platform: str) -> None:
        self.ends = (mechanism.root, platform)
        self.edges = _edges(mechanism)
        self.fixed = {
            link: (end, placement)
            for end in self.ends
            for link, placement in fixed_to(mechanism, end).items()
            if link not in self.ends
        }
        self._absorb_fixed_links()
        self.edges = {link: _joined(edges) for link, edges in self.edges.items()}
        reach = [np.linalg.norm(edge.here.translation) for edges in self.edges.values() for edge in edges]
        self.tolerance = PRINTED * max(reach, default=1.0)
        self._drop_dead_ends()

    def leg(self, motor: Joint) -> dict[str, FloatArray]:
        """Find the ends of one leg: the point in the ground and the point in the platform, by link."""
        below, above, _ = self._ends(motor)
        for link, locus in (below, above):
            if locus.axis is not None:
                raise _no_leg(motor.name, f"it turns about an axis of link '{link}', not about a point")
        return {link: locus.origin for link, locus in (below, above)}

    def zero(self, motor: Joint) -> float:
        """Find how far along its axis the leg reaches where the motor reads zero."""
        return float(motor.axis @ self._ends(motor)[2])

    def _ends(self, motor: Joint) -> tuple[tuple[str, _Locus], tuple[str, _Locus], FloatArray]:
        """Find both ends of a leg, and the way between them in the motor's frame, where the motor reads zero."""
        if motor.kind is not JointKind.PRISMATIC:
            raise _no_leg(motor.name, f"it is {motor.kind}, not prismatic")
        below, above = (
            self._walk(motor, motor.parent, motor.child),
            self._walk(motor, motor.child, motor.parent),
        )
        if {below[0], above[0]} != set(self.ends):
            raise _no_leg(motor.name, f"it does not lead from link '{self.ends[0]}' to link '{self.ends[1]}'")
        # Both points in the motor's frame; the slide changes their distance along its axis only.
        apart = above[1].start - motor.placement.actInv(below[1].start)
        hinges = [above[1].start_axis, below[1].start_axis]
        if hinges[0] is not None and hinges[1] is not None:
            apart = apart - self._along_hinges(motor, hinges[0], hinges[1], apart)
        elif hinges[0] is not None or hinges[1] is not None:
            link = (above if hinges[0] is not None else below)[0]
            raise _no_leg(
                motor.name, f"it turns about an axis of link '{link}', about a point at the other end"
            )
        miss = float(np.linalg.norm(np.cross(motor.axis, apart)))
        if miss > self.tolerance:
            raise _no_leg(motor.name, f"its axis misses the line between the leg's ends by {miss:.3g} m")
        return below, above, apart

    def _along_hinges(
        self, motor: Joint, above: FloatArray, below: FloatArray, apart: FloatArray
    ) -> FloatArray:
        """Find what lies along the two hinges of a leg in a plane, in the motor's frame."""
        lower = motor.placement.rotation.T @ below
        if max(np.linalg.norm(np.cross(above, lower)), abs(above @ motor.axis)) > _PARALLEL:
            raise _no_leg(motor.name, "it turns about an axis at either end, but moves in no plane")
        return (above @ apart) * above

    def _walk(self, motor: Joint, link: str, behind: str) -> tuple[str, _Locus]:
        """Walk from one side of the motor over joints about one point to the ground or the platform."""
        visited = {behind}
        link, _ = self.fixed.get(link, (link, pin.SE3.Identity()))
        locus: _Locus | None = None
        rigid = pin.SE3.Identity()  # current link in the first one, while only fixed joints have been passed
        while link not in self.ends:
            visited.add(link)
            onward = [edge for edge in self.edges.get(link, []) if edge.other not in visited]
            if len(onward) != 1:
                raise _no_leg(motor.name, f"{len(onward)} ways lead on from link '{link}'")
            edge = onward[0]
            if edge.kind is JointKind.FIXED:
                rigid, locus = rigid * edge.here * edge.there.inverse(), _carried(locus, edge)
            elif edge.kind in (JointKind.REVOLUTE, JointKind.SPHERICAL, JointKind.UNIVERSAL):
                locus = self._narrowed(motor, locus, edge, rigid)
            else:
                raise _no_leg(motor.name, f"joint '{edge.name}' is {edge.kind}")
            link = edge.other
        if locus is None:
            raise _no_leg(motor.name, f"it is fixed to link '{link}'")
        return link, locus

    def _narrowed(self, motor: Joint, locus: _Locus | None, edge: _Edge, rigid: pin.SE3) -> _Locus:
        """Pass a joint: the common point lies on its axis, or at its centre."""
        center = np.array(edge.here.translation)
        axis = edge.here.rotation @ edge.axis if edge.kind is JointKind.REVOLUTE else None
        if locus is None:
            start_axis = None if axis is None else rigid.rotation @ axis
            there = None if axis is None else edge.there.rotation @ edge.axis
            return _Locus(np.array(edge.there.translation), there, rigid.act(center), start_axis)
        # Nearest points of the two loci: locus.origin + s locus.axis = center + t axis.
        columns = ([] if locus.axis is None else [locus.axis]) + ([] if axis is None else [-axis])
        steps, miss = np.zeros(len(columns)), center - locus.origin
        if columns:
            system = np.column_stack(columns)
            if np.linalg.svd(system, compute_uv=False)[-1] < _PARALLEL:
                raise _no_leg(motor.name, f"two of its joints turn about parallel axes (joint '{edge.name}')")
            steps = np.linalg.lstsq(system, miss, rcond=None)[0]
            miss = miss - system @ steps
        gap = float(np.linalg.norm(miss))
        if gap > self.tolerance:
            raise _no_leg(
                motor.name, f"its joints do not turn about one point: '{edge.name}' misses it by {gap:.3g} m"
            )
        along = steps[-1] if axis is not None else 0.0
        start = locus.start if locus.start_axis is None else locus.start + steps[0] * locus.start_axis
        return _Locus(edge.there.act(along * edge.axis), None, start, None)

    def _absorb_fixed_links(self) -> None:
        """Count links fixed to the ground or the platform as part of it, so that legs may start anywhere on them."""
        edges: dict[str, list[_Edge]] = {link: [] for link in self.edges if link not in self.fixed}
        rest = pin.SE3.Identity()
        for link, leaving in self.edges.items():
            owner, placement = self.fixed.get(link, (link, rest))
            for edge in leaving:
                other, beyond = self.fixed.get(edge.other, (edge.other, rest))
                if other != owner:
                    moved = replace(edge, other=other, here=placement * edge.here, there=beyond * edge.there)
                    edges[owner].append(moved)
        self.edges = edges

    def _drop_dead_ends(self) -> None:
        """Forget links that hang on one joint, such as covers and sensors."""
        while True:
            loose = [link for link, edges in self.edges.items() if len(edges) < 2 and link not in self.ends]
            if not loose:
                return
            for link in loose:
                del self.edges[link]
            for link, edges in self.edges.items():
                self.edges[link] = [edge for edge in edges if edge.other in self.edges]


def _edges(mechanism: Mechanism) -> dict[str, list[_Edge]]:
    edges: dict[str, list[_Edge]] = {link.name: [] for link in mechanism.links}
    connections = [
        (joint, joint.parent, joint.child, joint.placement, pin.SE3.Identity())
        for joint in mechanism.joints
        if joint.kind is not JointKind.FLOATING  # which holds nothing together
    ] + [(loop, loop.link1, loop.link2, loop.placement1, loop.placement2) for loop in mechanism.loops]
    for part, link1, link2, placement1, placement2 in connections:
        edges[link1].append(_Edge(part.kind, part.name, link2, placement1, placement2, part.axis))
        edges[link2].append(_Edge(part.kind, part.name, link1, placement2, placement1, part.axis))
    return edges


def _joined(edges: list[_Edge]) -> list[_Edge]:
    """Count two balls between the same two links as what they are: a hinge about the line through both."""
    balls: dict[str, list[_Edge]] = {}
    for edge in edges:
        if edge.kind is JointKind.SPHERICAL:
            balls.setdefault(edge.other, []).append(edge)
    for pair in balls.values():
        if len(pair) == 2:
            one, two = pair
            here, there = _through(one.here, two.here), _through(one.there, two.there)
            hinge = _Edge(JointKind.REVOLUTE, one.name, one.other, here, there, _Z)
            edges = [hinge if edge is one else edge for edge in edges if edge is not two]
    return edges


def _through(one: pin.SE3, two: pin.SE3) -> pin.SE3:
    """Frame at one point whose z leads to another."""
    way = two.translation - one.translation
    if not way.any():
        return one
    return pin.SE3(pin.Quaternion.FromTwoVectors(_Z, way).toRotationMatrix(), one.translation)


def _carried(locus: _Locus | None, edge: _Edge) -> _Locus | None:
    """Express the locus in the link beyond a fixed joint."""
    if locus is None:
        return None
    step = edge.there * edge.here.inverse()
    axis = None if locus.axis is None else step.rotation @ locus.axis
    return _Locus(step.act(locus.origin), axis, locus.start, locus.start_axis)


def _no_leg(motor: str, reason: str) -> UnsupportedError:
    return UnsupportedError(
        f"motor '{motor}' does not drive a leg with a point-like joint at either end: {reason}; "
        "closed forms of hexapods need such legs, the other verbs do not"
    )
