"""The cranks and rods of a rotary platform, read off its chain for the closed forms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.errors import UnsupportedError
from stewart_pin.geometry.rotary import RotaryLegs
from stewart_pin.model.chain import ClosedChain
from stewart_pin.model.description import Joint, JointKind, Loop
from stewart_pin.model.tree import link_frame
from stewart_pin.typing import FloatArray

_ROUND_OFF = 1e-9
"""How far axes may miss a common point, in robot sizes: files print ten digits."""
_FREEDOMS = {JointKind.REVOLUTE: 1, JointKind.UNIVERSAL: 2, JointKind.SPHERICAL: 3}


@dataclass(frozen=True, eq=False)
class _Edge:
    """A connection of two links at home, in the world: its point, and its axis where it has only one."""

    name: str
    kind: JointKind
    links: tuple[str, str]
    point: FloatArray
    axis: FloatArray


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
    >>> angles = stp.crank_angles(stp.rotary_legs(chain), pose.translation, pose.rotation).angle[:, 0]
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
        data = pin.Data(chain.model)
        pin.framesForwardKinematics(chain.model, data, chain.q_home)
        self.frames = {
            link.name: data.oMf[link_frame(chain.model, link.name)] for link in chain.mechanism.links
        }
        # Links that fixed joints hold together are one body, called by one of them.
        self.body = {link.name: link.name for link in chain.mechanism.links}
        edges = [self._edge(part, part.parent, part.child, part.placement) for part in chain.mechanism.joints]
        edges += [self._edge(part, part.link1, part.link2, part.placement1) for part in chain.loops]
        for edge in edges:
            if edge.kind is JointKind.FIXED:
                one, other = (self.body[link] for link in edge.links)
                self.body = {link: one if body == other else body for link, body in self.body.items()}
        self.edges = [edge for edge in edges if edge.kind not in (JointKind.FIXED, JointKind.FLOATING)]
        self.ground, self.platform = self.body[chain.mechanism.root], self.body[chain.platform]
        self._drop_dead_ends()

    def leg(self, motor: str, position: float) -> tuple[FloatArray, ...]:
        """Fields of `RotaryLegs` for one motor."""
        joint = self.chain.mechanism.joint(motor)
        edge = next((edge for edge in self.edges if edge.name == motor), None)
        if joint.kind is not JointKind.REVOLUTE:
            raise _no_leg(motor, f"it is {joint.kind}, not revolute")
        if edge is None:
            raise _no_leg(motor, "nothing leads on from its crank")
        if self.body[joint.parent] != self.ground:
            raise _no_leg(motor, f"its axis stands on link '{joint.parent}', not on the ground")
        crank = self.body[joint.child]
        rods = [self._rod(motor, first, crank) for first in self._onward(crank, edge)]
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
        there = self.frames[self.chain.platform].actInv(head)
        return centre, edge.axis, zero, there, np.array(radius), np.array(lengths[0])

    def _rod(self, motor: str, first: _Edge, crank: str) -> tuple[FloatArray, FloatArray]:
        """Walk from a crank to the platform: the points about which the joints at either end turn."""
        path, body = [first], self._across(first, crank)
        while body != self.platform:
            onward = self._onward(body, path[-1])
            if body == self.ground or len(onward) != 1 or len(path) > len(self.edges):
                raise _no_leg(motor, f"{len(onward)} ways lead on from link '{body}', none to the platform")
            path.append(onward[0])
            body = self._across(onward[0], body)
        strange = next((edge for edge in path if edge.kind not in _FREEDOMS), None)
        if strange is not None:
            raise _no_leg(motor, f"'{strange.name}' in its rod is {strange.kind}")
        start, count = self._common_point(path)
        end, rest = self._common_point(path[count:])
        freedoms = sum(_FREEDOMS[edge.kind] for edge in path)
        if start is None or end is None or count + rest != len(path) or freedoms < 5:
            raise _no_leg(motor, "its rod has not five or six joint axes, about one point at either end")
        return start, end

    def _common_point(self, path: list[_Edge]) -> tuple[FloatArray | None, int]:
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

    def _drop_dead_ends(self) -> None:
        """Forget bodies that hang on one joint, such as counterweights."""
        while True:
            ends = [self.body[link] for edge in self.edges for link in edge.links]
            loose = {body for body in ends if ends.count(body) == 1} - {self.ground, self.platform}
            if not loose:
                return
            self.edges = [edge for edge in self.edges if not loose & {self.body[link] for link in edge.links}]

    def _onward(self, body: str, behind: _Edge) -> list[_Edge]:
        return [e for e in self.edges if e is not behind and body in {self.body[link] for link in e.links}]

    def _across(self, edge: _Edge, body: str) -> str:
        one, other = (self.body[link] for link in edge.links)
        return other if one == body else one

    def _edge(self, part: Joint | Loop, link1: str, link2: str, placement: pin.SE3) -> _Edge:
        frame = self.frames[link1] * placement
        return _Edge(
            part.name, part.kind, (link1, link2), np.array(frame.translation), frame.rotation @ part.axis
        )


def _no_leg(motor: str, reason: str) -> UnsupportedError:
    return UnsupportedError(
        f"motor '{motor}' does not drive a crank with a rod between two points: {reason}; closed forms of rotary legs "
        "need such legs, the other verbs do not"
    )
