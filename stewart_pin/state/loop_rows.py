r"""Gap, Jacobian and rate of the Jacobian of all loop rows, at any configuration, closed or open.

The relative placement 1M2 of the loop frames has translation t and rotation R. Every row is a wrench w that the loop
transmits, in world axes at the world origin, and its rate is the power of that wrench on the motion of body 2
relative to body 1,

.. math:: \dot\phi = w \cdot (V_2 - V_1) = w \cdot \Delta J\, v, \qquad
          \dot J_c = \dot w \cdot \Delta J + w \cdot \Delta\dot J ,

with V the spatial velocities [v; ω] at the world origin. With n, u1 fixed in frame 1, u2 in frame 2, p2 the origin of
frame 2 and e the unit vector from origin 1 to origin 2:

======== ============== ================== =========================================
row      φ              force of w         moment of w
======== ============== ================== =========================================
normal   n · t          n                  p2 × n
angle    u1 · R u2      0                  u2 × u1
length   ǀtǀ - length   e                  p2 × e
coupling q1 - p(q2)     joint efforts 1 and -p' instead of a wrench
======== ============== ================== =========================================

This is the only place of the package that knows them for one state; the kernels write them as programs, and the
maximal-coordinate system judges them by its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stewart_pin.errors import SingularityError
from stewart_pin.model.loop_table import LoopTable
from stewart_pin.state.scratch import Scratch
from stewart_pin.typing import Configuration, FloatArray, Tangent


@dataclass(frozen=True, eq=False)
class PlacedLoops:
    """Loop frames in the world at one configuration, and the directions of their rows.

    Attributes
    ----------
    turn1, turn2
        (L, 3, 3) rotations of frames 1 and 2.
    origin1, origin2
        (L, 3) their origins [m].
    normal
        (n, 3) unit normals of the normal rows.
    u1, u2
        (a, 3) unit vectors of the angle rows.
    reach
        (r,) distances of the ends of the length rows [m].
    along
        (r, 3) unit vectors of the length rows; x of frame 1 where the ends coincide, and no direction is defined.
    """

    turn1: FloatArray
    turn2: FloatArray
    origin1: FloatArray
    origin2: FloatArray
    normal: FloatArray
    u1: FloatArray
    u2: FloatArray
    reach: FloatArray
    along: FloatArray


def place_loops(table: LoopTable, scratch: Scratch) -> PlacedLoops:
    """Locate the loop frames where the joints have been placed.

    Parameters
    ----------
    table
        Loops.
    scratch
        Scratch that holds the joint placements.

    Returns
    -------
    PlacedLoops
        Frames and directions, copies.
    """
    joint1, joint2 = scratch.rotation[table.at1], scratch.rotation[table.at2]
    turn1, turn2 = joint1 @ table.rotation1, joint2 @ table.rotation2
    origin1 = scratch.translation[table.at1] + (joint1 @ table.translation1[:, :, None])[:, :, 0]
    origin2 = scratch.translation[table.at2] + (joint2 @ table.translation2[:, :, None])[:, :, 0]
    normal, angle, rod = table.normal, table.angle, table.rod
    apart = (origin2 - origin1)[rod.loop]
    reach = np.sqrt((apart * apart).sum(axis=1))
    if rod.index.size:
        apart = np.where(reach[:, None] > 0, apart, turn1[rod.loop, :, 0])
        apart = apart / np.where(reach > 0, reach, 1.0)[:, None]
    return PlacedLoops(
        turn1=turn1,
        turn2=turn2,
        origin1=origin1,
        origin2=origin2,
        normal=(turn1[normal.loop] @ normal.vector1[:, :, None])[:, :, 0],
        u1=(turn1[angle.loop] @ angle.vector1[:, :, None])[:, :, 0],
        u2=(turn2[angle.loop] @ angle.vector2[:, :, None])[:, :, 0],
        reach=reach,
        along=apart,
    )


def gap_of(table: LoopTable, at: PlacedLoops, q: Configuration) -> FloatArray:
    """Measure how far the loops are from closed.

    Parameters
    ----------
    table
        Loops.
    at
        Their frames.
    q
        (nq,) configuration, for the couplings [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nc,) gap [m; sines of angles, dimensionless; m or rad for couplings].
    """
    normal, angle, rod, coupling = table.normal, table.angle, table.rod, table.coupling
    gap = np.empty(table.size)
    gap[normal.index] = (at.normal * (at.origin2 - at.origin1)[normal.loop]).sum(axis=1)
    if angle.index.size:
        gap[angle.index] = (at.u1 * at.u2).sum(axis=1)
    if rod.index.size:
        gap[rod.index] = at.reach - rod.length
    if coupling.index.size:
        gap[coupling.index] = q[coupling.q1] - coupling.evaluate(q, 0)
    return gap


def wrenches_of(table: LoopTable, at: PlacedLoops) -> FloatArray:
    """Write the wrench of every row.

    Parameters
    ----------
    table
        Loops.
    at
        Their frames.

    Returns
    -------
    numpy.ndarray
        (nc, 6) force and moment about the world origin, in world axes; zero for couplings [1, m; 1 for angle rows].
    """
    normal, angle, rod = table.normal, table.angle, table.rod
    wrench = np.zeros((table.size, 6))
    wrench[normal.index, :3] = at.normal
    wrench[normal.index, 3:] = cross(at.origin2[normal.loop], at.normal)
    if angle.index.size:
        wrench[angle.index, 3:] = cross(at.u2, at.u1)
    if rod.index.size:
        wrench[rod.index, :3] = at.along
        wrench[rod.index, 3:] = cross(at.origin2[rod.loop], at.along)
    return wrench


def jacobian_of(table: LoopTable, wrench: FloatArray, joints: FloatArray, q: Configuration) -> FloatArray:
    """Evaluate the loop Jacobian.

    Parameters
    ----------
    table
        Loops.
    wrench
        (nc, 6) of the rows [1, m].
    joints
        (6, nv) joint Jacobians at the world origin [m, rad per m or rad].
    q
        (nq,) configuration, for the couplings [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nc, nv) rate of the gap per tangent velocity [m and 1 per m or rad].
    """
    # Each joint moves the rows of the loops that it opens, with the sign of the side on which it is.
    jacobian = (wrench @ joints) * table.row_difference
    coupling = table.coupling
    if coupling.index.size:
        jacobian[coupling.index, coupling.v1] += 1.0
        follows = coupling.v2 >= 0
        jacobian[coupling.index[follows], coupling.v2[follows]] -= coupling.evaluate(q, 1)[follows]
    return jacobian


def jacobian_rate_of(
    table: LoopTable,
    at: PlacedLoops,
    wrench: FloatArray,
    joints: FloatArray,
    joint_rates: FloatArray,
    q: Configuration,
    v: Tangent,
) -> FloatArray:
    """Differentiate the loop Jacobian along a velocity.

    Parameters
    ----------
    table
        Loops.
    at
        Their frames.
    wrench
        (nc, 6) of the rows [1, m].
    joints, joint_rates
        (6, nv) joint Jacobians at the world origin, and their rates [m, rad per m or rad; per s].
    q
        (nq,) configuration, for the couplings [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].

    Returns
    -------
    numpy.ndarray
        (nc, nv) such that the second derivative of the gap is ``jacobian @ a + rate @ v`` [per s].

    Raises
    ------
    SingularityError
        If the ends of a distance loop coincide.
    """
    normal, angle, rod, coupling = table.normal, table.angle, table.rod, table.coupling
    # Spatial velocities at the world origin of the bodies on either side, (L, 6).
    twist1, twist2 = ((joints @ (side * v).T).T for side in (table.support1, table.support2))
    omega1, omega2 = twist1[:, 3:], twist2[:, 3:]
    velocity2 = twist2[:, :3] + cross(omega2, at.origin2)
    rate = np.zeros((table.size, 6))
    n_rate = cross(omega1[normal.loop], at.normal)
    rate[normal.index, :3] = n_rate
    rate[normal.index, 3:] = cross(velocity2[normal.loop], at.normal) + cross(at.origin2[normal.loop], n_rate)
    if angle.index.size:
        rate[angle.index, 3:] = cross(cross(omega2[angle.loop], at.u2), at.u1) + cross(
            at.u2, cross(omega1[angle.loop], at.u1)
        )
    if rod.index.size:
        if not at.reach.all():
            culprit = table.names[int(rod.index[np.argmin(at.reach)])].rsplit(" row ", 1)[0]
            raise SingularityError(
                f"the ends of the distance loop '{culprit}' coincide, so its direction is undefined; close it first",
                smallest_singular_value=0.0,
            )
        apart = (velocity2 - twist1[:, :3] - cross(omega1, at.origin1))[rod.loop]
        along = at.along
        e_rate = (apart - along * (along * apart).sum(axis=1)[:, None]) / at.reach[:, None]
        rate[rod.index, :3] = e_rate
        rate[rod.index, 3:] = cross(velocity2[rod.loop], along) + cross(at.origin2[rod.loop], e_rate)
    jacobian_rate = (rate @ joints + wrench @ joint_rates) * table.row_difference
    if coupling.index.size:
        follows = coupling.v2 >= 0
        curve = coupling.evaluate(q, 2) * np.where(follows, v[coupling.v2], 0.0)
        jacobian_rate[coupling.index[follows], coupling.v2[follows]] -= curve[follows]
    return jacobian_rate


def opposed_loops(table: LoopTable, at: PlacedLoops) -> list[int]:
    """Find loops whose rows may vanish although they are not assembled: directions that should agree are opposed.

    Parameters
    ----------
    table
        Loops.
    at
        Their frames.

    Returns
    -------
    list of int
        Numbers of these loops.
    """
    if not table.aligned.size:
        return []
    direction = table.directions[:, :, None]
    agreement = ((at.turn1[table.aligned] @ direction) * (at.turn2[table.aligned] @ direction)).sum(axis=1)
    return [int(loop) for loop in table.aligned[agreement[:, 0] < 0]]


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Multiply vectors row by row; `numpy.cross` takes ten times as long for a few rows.

    Parameters
    ----------
    a, b
        (n, 3) vectors [any unit].

    Returns
    -------
    numpy.ndarray
        (n, 3) a × b, in any unit.
    """
    product = np.empty((len(a), 3))
    a0, a1, a2 = a[:, 0], a[:, 1], a[:, 2]
    b0, b1, b2 = b[:, 0], b[:, 1], b[:, 2]
    np.subtract(a1 * b2, a2 * b1, out=product[:, 0])
    np.subtract(a2 * b0, a0 * b2, out=product[:, 1])
    np.subtract(a0 * b1, a1 * b0, out=product[:, 2])
    return product
