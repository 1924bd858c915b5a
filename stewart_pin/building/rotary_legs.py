"""The cranks and rods of a rotary platform, read off its chain for the closed forms."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from stewart_pin.building.body_graph import BodyGraph, Edge
from stewart_pin.errors import UnsupportedError
from stewart_pin.geometry.rotary import RotaryLegs
from stewart_pin.model.description import JointKind
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import FloatArray

_ROUND_OFF = 1e-9
"""How far axes may miss a common point, in robot sizes: files print ten digits."""
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
        self.slack = _ROUND_OFF * chain.length_scale
        self.graph = BodyGraph(chain)

    def leg(self, motor: str, position: float) -> tuple[FloatArray, ...]:
        """Fields of `RotaryLegs` for one motor."""
        joint = self.chain.mechanism.joint(motor)
        edge = self.graph.edge(motor)
        if joint.kind is not JointKind.REVOLUTE:
            raise _no_leg(motor, f"it is {joint.kind}, not revolute")
        if edge is None:
            raise _no_leg(motor, "nothing leads on from its crank")
        if self.graph.body[joint.parent] != self.graph.ground:
            raise _no_leg(motor, f"its axis stands on link '{joint.parent}', not on the ground")
        crank = self.graph.body[joint.child]
        rods = [self._rod(motor, first, crank) for first in self.graph.onward(crank, edge)]
        if not 1 <= len(rods) <= 2:
            raise _no_leg(motor, f"{len(rods)} rods lead on from its crank")
        tip, head = np.mean(rods, axis=0)
        lengths = [np.linalg.norm(end - start) for start, end in rods]
        if max(np.linalg.norm((end - start) - (head - tip)) for start, end in rods) > self.slack:
            raise _no_leg(motor, "the two rods of its crank are not parallel")
        centre = edge.point + edge.axis * (edge.axis @ (tip - edge.point))
        radius = float(np.linalg.norm(tip - centre))
        if radius <= self.slack:
            raise _no_leg(motor, "its crank has no length")
        zero = pin.exp3(-position * edge.axis) @ (tip - centre)
        there = self.graph.frames[self.chain.platform_link].actInv(head)
        return centre, edge.axis, zero, there, np.array(radius), np.array(lengths[0])

    def _rod(self, motor: str, first: Edge, crank: str) -> tuple[FloatArray, FloatArray]:
        """Walk from a crank to the platform: the points about which the joints at either end turn."""
        path, body = [first], self.graph.across(first, crank)
        while body != self.graph.platform:
            onward = self.graph.onward(body, path[-1])
            if body == self.graph.ground or len(onward) != 1 or len(path) > len(self.graph.edges):
                raise _no_leg(motor, f"{len(onward)} ways lead on from link '{body}', none to the platform")
            path.append(onward[0])
            body = self.graph.across(onward[0], body)
        strange = next((edge for edge in path if edge.kind not in _FREEDOMS), None)
        if strange is not None:
            raise _no_leg(motor, f"'{strange.name}' in its rod is {strange.kind}")
        start, count = self._common_point(path)
        end, rest = self._common_point(path[count:])
        freedoms = sum(_FREEDOMS[edge.kind] for edge in path)
        if start is None or end is None or count + rest != len(path) or freedoms < 5:
            raise _no_leg(motor, "its rod has not five or six joint axes, about one point at either end")
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


def _no_leg(motor: str, reason: str) -> UnsupportedError:
    return UnsupportedError(
        f"motor '{motor}' does not drive a crank with a rod between two points: {reason}; closed forms of rotary legs "
        "need such legs, the other verbs do not"
    )
