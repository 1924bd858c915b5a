"""Coordinates of joints that have none in a configuration, balls and joints that close loops, and their derivatives.

They are read off the placement of frame 2 in frame 1, 1M2, with translation t and rotation R: of the frames of a loop,
or of what a ball carries. With a the axis in both frames (a universal joint: a in frame 1, b in frame 2) and d
perpendicular to a,

========= ==================================================================
angle     of R about a: from d to R d, seen along a
length    a · t
angle 1   of a universal joint: from b to R b about a, with R = exp(a α) exp(b β)
angle 2   from Rᵀ a to a about b
swing     of a ball: the angle between a and R a
angle     of a ball: that of its whole rotation
========= ==================================================================

Where frame 2 moves against frame 1 by the twist [ṫ; ω], in the axes of frame 1, Ṙ = ω × R. The angle about n from b to
c changes by (n × c) · ċ / ǀn × cǀ² where c turns, and by the opposite of the same of b where b does. Angles of balls,
which have no sign, have a kink at zero: their derivative is zero there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pinocchio as pin

from stewart_pin.errors import UnsupportedError
from stewart_pin.model.description import BALL, Joint, JointKind, loop_coordinates
from stewart_pin.model.loop_rows import orthonormal_triad
from stewart_pin.state.scratch import PlacedJoints
from stewart_pin.tolerances import NO_DIRECTION
from stewart_pin.typing import Configuration, FloatArray

if TYPE_CHECKING:
    from stewart_pin.state.chain import ClosedChain


TURNS = ("turn x", "turn y", "turn z")
"""Rotation vector of a ball, in frame 1. Their rows are the angular velocity, not their derivatives: its spring is
alike about all axes, and log(R)ᵀ times either is the same, since R turns about log(R)."""


class JointCoordinates:
    """Coordinates that only limits know, one per row of these beyond the tangent entries, in their order.

    Parameters
    ----------
    chain
        Closed chain.
    """

    def __init__(self, chain: ClosedChain) -> None:
        self._nv = chain.nv
        joints = {joint.name: joint for joint in chain.mechanism.joints}
        self._coordinates: list[Coordinate] = []
        for name, entry in zip(chain.model.names[1:], list(chain.model.joints)[1:], strict=True):
            if (joint := joints[name]).kind is JointKind.SPHERICAL:
                self._coordinates += coordinates_of_ball(joint, entry.idx_q, entry.idx_v, BALL)
        for k, loop in enumerate(chain.loops):
            self._coordinates += coordinates_of_loop(chain, k, loop_coordinates(loop.kind))

    def values(self, placed: PlacedJoints, q: Configuration, rows: np.ndarray) -> FloatArray:
        """Read coordinates.

        Parameters
        ----------
        placed
            Placements of the joints.
        q
            (nq,) the configuration they belong to [m, rad, unit quaternions].
        rows
            (k,) rows of the limits [index].

        Returns
        -------
        numpy.ndarray
            (k,) lengths and angles, the latter from -π to π [m or rad].
        """
        return np.array([self._coordinates[row - self._nv].at(placed, q) for row in rows], dtype=float)

    def jacobian(self, placed: PlacedJoints, q: Configuration, rows: np.ndarray) -> FloatArray:
        """Differentiate coordinates along the tangent of the tree.

        Parameters
        ----------
        placed
            Placements of the joints, and their Jacobians.
        q
            (nq,) the configuration they belong to [m, rad, unit quaternions].
        rows
            (k,) rows of the limits [index].

        Returns
        -------
        numpy.ndarray
            (k, nv) rates per tangent velocity [m and rad per m or rad].
        """
        found = np.zeros((len(rows), self._nv))
        for into, row in zip(found, rows, strict=True):
            into[:] = self._coordinates[row - self._nv].row(placed, q)
        return found


def coordinates_of_ball(joint: Joint, in_q: int, in_v: int, words: Sequence[str]) -> list[Coordinate]:
    """Make coordinates of a ball of the tree.

    Parameters
    ----------
    joint
        The ball.
    in_q, in_v
        Where its quaternion and its angular velocity begin [index].
    words
        Which: of `BALL`, or `TURNS`.

    Returns
    -------
    list of Coordinate
        One per word.
    """
    ball = _Ball(in_q, in_v)
    return [Coordinate(ball, word, joint.kind, joint.axis, joint.axis) for word in words]


def coordinates_of_loop(chain: ClosedChain, k: int, words: Sequence[str]) -> list[Coordinate]:
    """Make coordinates of a joint that closes a loop.

    Parameters
    ----------
    chain
        Closed chain.
    k
        Number of the loop [index].
    words
        Which: of `loop_coordinates`, or `TURNS`.

    Returns
    -------
    list of Coordinate
        One per word.
    """
    table, loop = chain.loop_table, chain.loops[k]
    frames = (
        pin.SE3(table.rotation1[k], table.translation1[k]),
        pin.SE3(table.rotation2[k], table.translation2[k]),
    )
    pair = _Pair(table.joint1[k], table.joint2[k], *frames, table.difference[k])
    return [Coordinate(pair, word, loop.kind, loop.axis, loop.axis2) for word in words]


class _Ball(NamedTuple):
    """A ball of the tree: where its quaternion is, and its angular velocity."""

    in_q: int
    in_v: int

    def apart(self, _: PlacedJoints, q: Configuration) -> pin.SE3:
        """Placement of what it carries in what carries it, 1M2."""
        return pin.SE3(pin.Quaternion(q[self.in_q : self.in_q + 4]).toRotationMatrix(), np.zeros(3))

    def carried(self, placed: PlacedJoints, apart: pin.SE3, _: FloatArray, about: FloatArray) -> FloatArray:
        """(nv,) derivative by the tangent: the angular velocity of what it carries, in the axes of that."""
        row = np.zeros(placed.jacobian.shape[1])
        row[self.in_v : self.in_v + 3] = apart.rotation.T @ about
        return row


class _Pair(NamedTuple):
    """The frames of a loop in the joints that carry them, and which tangent entries move them apart."""

    joint1: int
    joint2: int
    frame1: pin.SE3
    frame2: pin.SE3
    moves: FloatArray

    def apart(self, placed: PlacedJoints, _: Configuration) -> pin.SE3:
        """Placement of frame 2 in frame 1, 1M2."""
        return self._frame1(placed).actInv(_placement(placed, self.joint2) * self.frame2)

    def carried(
        self, placed: PlacedJoints, apart: pin.SE3, along: FloatArray, about: FloatArray
    ) -> FloatArray:
        """(nv,) derivative by the tangent: a wrench on frame 2, whose power on the joints is the rate."""
        wrench = self._frame1(placed).act(pin.Force(along, about + _cross(apart.translation, along)))
        return (wrench.vector @ placed.jacobian) * self.moves

    def _frame1(self, placed: PlacedJoints) -> pin.SE3:
        return _placement(placed, self.joint1) * self.frame1


def _placement(placed: PlacedJoints, joint: int) -> pin.SE3:
    return pin.SE3(placed.rotation[joint], placed.translation[joint])


class Coordinate:
    """One coordinate of a ball of the tree, or of a loop.

    Parameters
    ----------
    owner
        Where it is read, and what moves it.
    coordinate
        Its word.
    kind
        Of the joint.
    axis, axis2
        (3,) unit vectors of the joint.
    """

    def __init__(
        self, owner: _Ball | _Pair, coordinate: str, kind: JointKind, axis: FloatArray, axis2: FloatArray
    ) -> None:
        self.owner, self.axis, self.axis2 = owner, axis, axis2
        self.coordinate = (
            "whole angle" if kind is JointKind.SPHERICAL and coordinate == "angle" else coordinate
        )
        _, self.x, self.y = orthonormal_triad(axis)

    @property
    def is_angle(self) -> bool:
        """Whether it is an angle."""
        return self.coordinate not in ("length", "x", "y")

    def at(self, placed: PlacedJoints, q: Configuration) -> float:
        """Read it.

        Parameters
        ----------
        placed
            Placements of the joints.
        q
            (nq,) the configuration they belong to [m, rad, unit quaternions].

        Returns
        -------
        float
            A length or an angle, the latter from -π to π [m or rad].
        """
        return self._value(self.owner.apart(placed, q))

    def row(self, placed: PlacedJoints, q: Configuration) -> FloatArray:
        """Differentiate it along the tangent of the tree.

        Parameters
        ----------
        placed
            Placements of the joints, and their Jacobians.
        q
            (nq,) the configuration they belong to [m, rad, unit quaternions].

        Returns
        -------
        numpy.ndarray
            (nv,) rate per tangent velocity [m and rad per m or rad].
        """
        apart = self.owner.apart(placed, q)
        return self.owner.carried(placed, apart, *self._gradient(apart))

    def wrench(self, placed: PlacedJoints, q: Configuration) -> FloatArray:
        """Tell what a unit of effort along it does to frame 2.

        Parameters
        ----------
        placed
            Placements of the joints.
        q
            (nq,) the configuration they belong to [m, rad, unit quaternions].

        Returns
        -------
        numpy.ndarray
            (6,) [force; moment] at the origin of frame 1, in its axes [1, m].
        """
        apart = self.owner.apart(placed, q)
        along, about = self._gradient(apart)
        return np.concatenate([along, about + _cross(apart.translation, along)])

    def _value(self, apart: pin.SE3) -> float:
        rotation, t, a, b = apart.rotation, apart.translation, self.axis, self.axis2
        match self.coordinate:
            case "length":
                return float(a @ t)
            case "x":
                return float(self.x @ t)
            case "y":
                return float(self.y @ t)
            case "swing":
                turned = rotation @ a
                return float(np.arctan2(np.linalg.norm(_cross(a, turned)), a @ turned))
            case "whole angle":
                return float(np.linalg.norm(pin.log3(rotation)))
            case "angle 1":
                return _turn(a, b, rotation @ b)
            case "angle 2":
                return _turn(b, rotation.T @ a, a)
            case "angle":
                return _turn(a, self.x, rotation @ self.x)
            case "turn x" | "turn y" | "turn z":
                return float(pin.log3(rotation)["xyz".index(self.coordinate[-1])])
        raise self._unknown()

    def _gradient(self, apart: pin.SE3) -> tuple[FloatArray, FloatArray]:
        """(3,) and (3,) derivatives by the translation and the rotation of frame 2, in the axes of frame 1."""
        rotation, a, b, none = apart.rotation, self.axis, self.axis2, np.zeros(3)
        match self.coordinate:
            case "length":
                return a, none
            case "x":
                return self.x, none
            case "y":
                return self.y, none
            case "swing":
                return none, _unit(_cross(a, rotation @ a))
            case "whole angle":
                return none, _unit(pin.log3(rotation))
            case "angle 1":
                turned = rotation @ b
                return none, _cross(turned, _turned_by(a, turned))
            case "angle 2":
                # The rate of Rᵀ a is Rᵀ (a × ω), and the angle is counted from it.
                return none, _cross(a, rotation @ _turned_by(b, rotation.T @ a))
            case "angle":
                turned = rotation @ self.x
                return none, _cross(turned, _turned_by(a, turned))
            case "turn x" | "turn y" | "turn z":
                return none, np.eye(3)["xyz".index(self.coordinate[-1])]
        raise self._unknown()

    def _unknown(self) -> UnsupportedError:
        return UnsupportedError(
            f"nothing reads a coordinate '{self.coordinate}' of a joint; tell here what it is"
        )


def _turn(axis: FloatArray, before: FloatArray, after: FloatArray) -> float:
    """Angle about an axis from one direction to another, both seen along the axis."""
    across = axis @ _cross(before, after)
    along = before @ after - (axis @ before) * (axis @ after)
    return float(np.arctan2(across, along))


def _turned_by(axis: FloatArray, direction: FloatArray) -> FloatArray:
    """Differentiate the angle of a direction about an axis by the direction; zero along the axis."""
    across = _cross(axis, direction)
    square = across @ across
    return across / square if square > 0 else across


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Multiply two vectors; `numpy.cross` takes ten times as long."""
    return pin.skew(a) @ b


def _unit(vector: FloatArray) -> FloatArray:
    """Return the direction of a vector, none of what is round-off."""
    length = np.linalg.norm(vector)
    return vector / length if length > NO_DIRECTION else np.zeros(3)
