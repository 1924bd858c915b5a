"""What each kind of loop closure transmits, told a second time for the maximal-coordinate system.

This table is this system's own: it judges the rows of `stewart_pin.model.loop_rows`, so nothing of it comes from there.
Entries stand in the order of the reactions, `ClosedChain.loop_table`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stewart_pin.model.description import JointKind, Loop
from stewart_pin.typing import FloatArray


@dataclass(frozen=True, eq=False)
class ForceAlong:
    """A force at the origin of frame 2, along a direction that is fixed in body 1.

    Attributes
    ----------
    direction
        (3,) unit vector in frame 1.
    """

    direction: FloatArray


@dataclass(frozen=True, eq=False)
class MomentAcross:
    """A moment along ``second × first``: it keeps a direction of each body at right angles to the other.

    Attributes
    ----------
    first
        (3,) unit vector in frame 1.
    second
        (3,) unit vector in frame 2.
    """

    first: FloatArray
    second: FloatArray


@dataclass(frozen=True)
class ForceBetween:
    """A force along the line between the origins of the frames, which keeps their distance.

    Attributes
    ----------
    distance
        What is kept [m].
    """

    distance: float


Transmitted = ForceAlong | MomentAcross | ForceBetween


def transmitted(loop: Loop) -> tuple[Transmitted, ...]:
    """List what a loop transmits.

    Parameters
    ----------
    loop
        The loop.

    Returns
    -------
    tuple
        One entry per reaction.
    """
    x, y, z = np.eye(3)
    axis = np.array(loop.axis, dtype=float)
    left, up = _beside(axis)
    # Moments about left and up hold the axis of body 2 in the direction of that of body 1.
    held = MomentAcross(-up, axis), MomentAcross(left, axis)
    twist = MomentAcross(up, left)  # about the axis
    by_kind: dict[JointKind, tuple[Transmitted, ...]] = {
        JointKind.SPHERICAL: (ForceAlong(x), ForceAlong(y), ForceAlong(z)),
        JointKind.REVOLUTE: (ForceAlong(x), ForceAlong(y), ForceAlong(z), *held),
        JointKind.UNIVERSAL: (
            ForceAlong(x),
            ForceAlong(y),
            ForceAlong(z),
            MomentAcross(axis, np.array(loop.axis2, dtype=float)),
        ),
        JointKind.CYLINDRICAL: (ForceAlong(left), ForceAlong(up), *held),
        JointKind.PRISMATIC: (ForceAlong(left), ForceAlong(up), twist, *held),
        JointKind.PLANAR: (ForceAlong(axis), *held),
        JointKind.POINT_ON_LINE: (ForceAlong(left), ForceAlong(up)),
        JointKind.DISTANCE: (ForceBetween(loop.length),),
        JointKind.FIXED: (ForceAlong(x), ForceAlong(y), ForceAlong(z), twist, *held),
    }
    return by_kind[loop.kind]


def _beside(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors that make a right-handed frame with an axis: of a coordinate axis the next two."""
    longest = int(np.abs(axis).argmax())
    next_one = np.zeros(3)
    next_one[longest - 2] = 1.0
    up = np.cross(axis, next_one)
    up = up / np.sqrt(up @ up)
    return np.cross(up, axis), up
