"""Which equations close a loop: the rows that each kind selects from the relative placement 1M2.

Three primitives make all kinds. With t the translation and R the rotation of 1M2,

* a *normal* row holds ``n · t`` at zero: frame 2 stays in a plane of frame 1;
* an *angle* row holds ``u1 · R u2`` at zero: two directions stay at right angles;
* a *length* row holds ``|t| - length`` at zero: a rod. That of a cable takes the way over a pulley in place of |t|, and
  has what a reel has wound in added.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stewart_pin.errors import SingularityError
from stewart_pin.model.description import NO_CABLE, Cable, JointKind, Loop, unknown_kind
from stewart_pin.typing import FloatArray


@dataclass(frozen=True, eq=False)
class NormalRow:
    """``normal · t = 0``.

    Attributes
    ----------
    normal
        (3,) unit vector in loop frame 1.
    """

    normal: FloatArray


@dataclass(frozen=True, eq=False)
class AngleRow:
    """``u1 · R u2 = 0``.

    Attributes
    ----------
    u1
        (3,) unit vector in loop frame 1.
    u2
        (3,) unit vector in loop frame 2.
    """

    u1: FloatArray
    u2: FloatArray


@dataclass(frozen=True, eq=False)
class LengthRow:
    """``|t| = length``, or ``way(t) + ratio * reel = length``.

    Attributes
    ----------
    length
        Distance between the origins of the loop frames, or length of the cable where nothing is wound in [m].
    axis
        (3,) axis about which a pulley swivels, a unit vector in loop frame 1.
    cable
        Reel and pulley; those of a rod are no reel and no pulley.
    """

    length: float
    axis: FloatArray
    cable: Cable = NO_CABLE


Row = NormalRow | AngleRow | LengthRow


def closure_rows(loop: Loop) -> tuple[Row, ...]:
    """List the equations of one loop.

    Parameters
    ----------
    loop
        The loop.

    Returns
    -------
    tuple
        Rows: 3 for a spherical closure, 5 revolute, 4 universal, 4 cylindrical, 5 prismatic, 3 planar,
        2 point on line, 1 distance or cable, 6 fixed. Angle rows are the small-angle rotation about `a`, `b`, `c` in
        order.
    """
    a, b, c = orthonormal_triad(loop.axis)
    # u1 · R u2 with R ≈ 1 + [φ]×:  (c, b) gives φ·a,  (-c, a) gives φ·b,  (b, a) gives φ·c. The last two share u2 = a,
    # so that R a = ±a follows however large R is; (a, c) in place of (-c, a) would let the axes part.
    turn_a, turn_b, turn_c = AngleRow(c, b), AngleRow(-c, a), AngleRow(b, a)
    point = tuple(NormalRow(n) for n in np.eye(3))
    across = (NormalRow(b), NormalRow(c))
    match loop.kind:
        case JointKind.SPHERICAL:
            return point
        case JointKind.REVOLUTE:
            return (*point, turn_b, turn_c)
        case JointKind.UNIVERSAL:
            return (*point, AngleRow(a, loop.axis2))
        case JointKind.CYLINDRICAL:
            return (*across, turn_b, turn_c)
        case JointKind.PRISMATIC:
            return (*across, turn_a, turn_b, turn_c)
        case JointKind.PLANAR:
            return (NormalRow(a), turn_b, turn_c)
        case JointKind.POINT_ON_LINE:
            return across
        case JointKind.DISTANCE:
            return (LengthRow(loop.length, a),)
        case JointKind.CABLE:
            return (LengthRow(loop.length, a, loop.cable),)
        case JointKind.FIXED:
            return (*point, turn_a, turn_b, turn_c)
        case JointKind.FLOATING:
            return ()
    raise unknown_kind(f"loop '{loop.name}'", loop.kind, "the table of loop rows")


def undefined_direction(loop: str, pulleys: bool) -> SingularityError:
    """Say that the ends of a rod or a cable leave it no direction.

    Parameters
    ----------
    loop
        Name of the loop.
    pulleys
        Whether it may run over a pulley.

    Returns
    -------
    SingularityError
        To be raised.
    """
    where = " or that of a cable lies on the axis or within the circle of its pulley" if pulleys else ""
    return SingularityError(
        f"the ends of the distance loop '{loop}' coincide{where}, so its direction is undefined; close it first",
        smallest_singular_value=0.0,
    )


def orthonormal_triad(axis: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Complete a unit vector to a right-handed orthonormal triad.

    Parameters
    ----------
    axis
        (3,) unit vector.

    Returns
    -------
    tuple of numpy.ndarray
        a (the axis), b, c = a × b, each (3,), dimensionless; for a coordinate axis the cyclically next ones.
    """
    k = int(np.argmax(np.abs(axis)))
    helper = np.eye(3)[(k + 1) % 3]
    b = helper - axis * (axis @ helper)
    b /= np.linalg.norm(b)
    return axis, b, np.cross(axis, b)
