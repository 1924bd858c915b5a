"""Legs read off a chain for the closed forms: of a planar 3-RPR platform, and cranks and rods of a rotary one."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from stewart_pin.building.body_graph import BodyGraph, Edge
from stewart_pin.errors import UnsupportedError
from stewart_pin.geometry.planar import PlanarRPR
from stewart_pin.geometry.rotary import RotaryLegs
from stewart_pin.model.description import JointKind
from stewart_pin.state.chain import ClosedChain
from stewart_pin.tolerances import PRINTED
from stewart_pin.typing import FloatArray


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
