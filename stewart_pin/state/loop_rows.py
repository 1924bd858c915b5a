r"""Gap, Jacobian and rate of the Jacobian of all loop rows, at any configuration, closed or open, and their factors.

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
         + ratio q          and ratio at the reel of a cable, with its way over the pulley, `cable_paths`, for ǀtǀ
coupling q1 - p(q2)     joint efforts 1 and -p' instead of a wrench
         - r q          and -r at further joints
======== ============== ================== =========================================

This is the only place of the package that knows them for one state; the kernels write them as programs, and the
maximal-coordinate system judges them by its own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg import get_lapack_funcs

from stewart_pin.model.loop_rows import undefined_direction
from stewart_pin.model.loop_table import LoopTable
from stewart_pin.state.cable_paths import CablePaths, cable_paths
from stewart_pin.state.scratch import PlacedJoints
from stewart_pin.tolerances import FAR_FROM_SINGULAR
from stewart_pin.typing import Configuration, FloatArray, Tangent

if TYPE_CHECKING:
    from stewart_pin.state.chain import ClosedChain
    from stewart_pin.state.state import State

_getrf, _gecon, _lange, _getrs = get_lapack_funcs(("getrf", "gecon", "lange", "getrs"), dtype=np.float64)


class PlacedLoops(NamedTuple):
    """Loop frames in the world at one configuration, and the directions of their rows.

    Attributes
    ----------
    origin1, origin2
        (L, 3) origins of frames 1 and 2 [m].
    normal
        (n, 3) unit normals of the normal rows.
    u1, u2
        (a, 3) unit vectors of the angle rows.
    reach
        (r,) distances of the ends of the length rows, of cables the ways over their pulleys [m].
    along
        (r, 3) unit vectors of the length rows; x of frame 1 where the ends coincide, and no direction is defined.
    cables
        All length rows as cables, in world axes, or None where there is no pulley.
    """

    origin1: FloatArray
    origin2: FloatArray
    normal: FloatArray
    u1: FloatArray
    u2: FloatArray
    reach: FloatArray
    along: FloatArray
    cables: CablePaths | None


def place_loops(table: LoopTable, placed: PlacedJoints) -> PlacedLoops:
    """Locate the loop frames where the joints have been placed.

    Parameters
    ----------
    table
        Loops.
    placed
        Placements of the joints.

    Returns
    -------
    PlacedLoops
        Frames and directions, copies.
    """
    turned = (placed.rotation.take(table.carriers, 0) @ table.carried)[:, :, 0]
    one, two, three, four = table.split
    origin1 = turned[:one] + placed.translation.take(table.at1, 0)
    origin2 = turned[one:two] + placed.translation.take(table.at2, 0)
    rods = _NO_RODS if not table.rod.index.size else _rods(table, placed, origin1, origin2)
    return PlacedLoops(origin1, origin2, turned[two:three], turned[three:four], turned[four:], *rods)


_NO_RODS = np.zeros(0), np.zeros((0, 3)), None


def _rods(
    table: LoopTable, placed: PlacedJoints, origin1: FloatArray, origin2: FloatArray
) -> tuple[FloatArray, FloatArray, CablePaths | None]:
    """Distances and directions of the length rows."""
    loop = table.rod.loop
    apart = (origin2 - origin1)[loop]
    if table.rod.radius.any():
        frames = placed.rotation[table.at1[loop]] @ table.rotation1[loop]
        cables = cable_paths(apart, (frames @ table.rod.vector1[:, :, None])[:, :, 0], table.rod.radius)
        return cables.length, cables.along, cables
    reach = np.sqrt((apart * apart).sum(axis=1))
    aside = (placed.rotation[table.at1[loop]] @ table.rotation1[loop])[:, :, 0]
    along = np.where(reach[:, None] > 0, apart, aside) / np.where(reach > 0, reach, 1.0)[:, None]
    return reach, along, None


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
    normal, rod, coupling = table.normal, table.rod, table.coupling
    gap = (at.normal * (at.origin2 - at.origin1).take(normal.loop, 0)).sum(axis=1)
    if table.only_normals:
        return gap
    gap = _scattered(table, gap, (at.u1 * at.u2).sum(axis=1))
    gap[rod.index] = at.reach - rod.length
    gap[table.reel.index] += table.reel.ratio * q[table.reel.q]
    if coupling.index.size:
        gap[coupling.index] = q[coupling.q1] - coupling.evaluate(q, 0) - coupling.ratios_q @ q
    return gap


def _scattered(table: LoopTable, normal: FloatArray, angle: FloatArray) -> FloatArray:
    """Put what belongs to normal and angle rows in their places; zero elsewhere."""
    full = np.zeros((table.size, *normal.shape[1:]))
    full[table.normal.index] = normal
    full[table.angle.index] = angle
    return full


def _moment(moment: FloatArray) -> FloatArray:
    """(n, 6) wrenches of no force; `numpy.pad` takes ten times as long."""
    return np.concatenate([np.zeros_like(moment), moment], axis=1)


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
    normal, rod = table.normal, table.rod
    wrench = np.concatenate([at.normal, cross(at.origin2.take(normal.loop, 0), at.normal)], axis=1)
    if table.only_normals:
        return wrench
    wrench = _scattered(table, wrench, _moment(cross(at.u2, at.u1)))
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
    if table.reel.index.size:
        jacobian[table.reel.index, table.reel.v] += table.reel.ratio
    coupling = table.coupling
    if coupling.index.size:
        jacobian[coupling.index, coupling.v1] += 1.0
        jacobian[coupling.index] -= coupling.ratios_v
        follows = coupling.v2 >= 0
        jacobian[coupling.index[follows], coupling.v2[follows]] -= coupling.evaluate(q, 1)[follows]
    return jacobian


class MovingLoops(NamedTuple):
    """Loop rows along a velocity.

    Attributes
    ----------
    wrench_rate
        (nc, 6) rate of the wrench of every row; zero for couplings [1/s, m/s].
    twist
        (L, 6) spatial velocity of body 2 less that of body 1, at the world origin in world axes [m/s, rad/s].
    drift
        (L, 6) the same of accelerations, without those of joints [m/s², rad/s²].
    """

    wrench_rate: FloatArray
    twist: FloatArray
    drift: FloatArray


def move_loops(
    table: LoopTable, at: PlacedLoops, joints: FloatArray, joint_rates: FloatArray, v: Tangent
) -> MovingLoops:
    """Differentiate the wrenches of the rows along a velocity.

    Parameters
    ----------
    table
        Loops.
    at
        Their frames.
    joints, joint_rates
        (6, nv) joint Jacobians at the world origin, and their rates [m, rad per m or rad; per s].
    v
        (nv,) tangent velocity [m/s, rad/s].

    Returns
    -------
    MovingLoops
        Rates of the wrenches, relative velocities and accelerations.

    Raises
    ------
    SingularityError
        If the ends of a distance loop coincide.
    """
    normal, angle, rod, count = table.normal, table.angle, table.rod, len(at.origin2)
    moving = table.supports * v
    # Spatial velocities at the world origin of the bodies on either side, frames 1 first: (2 L, 6).
    twist, drift = moving @ joints.T, moving @ joint_rates.T
    omega1, omega2 = twist[:count, 3:], twist[count:, 3:]
    velocity2 = twist[count:, :3] + cross(omega2, at.origin2)
    n, loop = at.normal, normal.loop
    n_rate = cross(omega1.take(loop, 0), n)
    moment_rate = cross(velocity2.take(loop, 0), n) + cross(at.origin2.take(loop, 0), n_rate)
    rate = np.concatenate([n_rate, moment_rate], axis=1)
    if not table.only_normals:
        turning = cross(cross(omega2[angle.loop], at.u2), at.u1) + cross(
            at.u2, cross(omega1[angle.loop], at.u1)
        )
        rate = _scattered(table, rate, _moment(turning))
    if rod.index.size:
        free, along = at.reach if at.cables is None else at.cables.free, at.along
        if not free.all():
            culprit = table.names[int(rod.index[np.argmin(free)])].rsplit(" row ", 1)[0]
            raise undefined_direction(culprit, at.cables is not None)
        apart = (velocity2 - twist[:count, :3] - cross(omega1, at.origin1))[rod.loop]
        if at.cables is None:
            e_rate = (apart - along * (along * apart).sum(axis=1)[:, None]) / free[:, None]
        else:
            turning = omega1[rod.loop]
            carried = cross(turning, (at.origin2 - at.origin1)[rod.loop])
            e_rate = at.cables.turned(apart - carried) + cross(turning, along)
        rate[rod.index, :3] = e_rate
        rate[rod.index, 3:] = cross(velocity2[rod.loop], along) + cross(at.origin2[rod.loop], e_rate)
    return MovingLoops(rate, twist[count:] - twist[:count], drift[count:] - drift[:count])


def bias_of(
    table: LoopTable, wrench: FloatArray, moving: MovingLoops, q: Configuration, v: Tangent
) -> FloatArray:
    """Evaluate the second derivative of the gap that is there without acceleration, J̇_c v.

    Parameters
    ----------
    table
        Loops.
    wrench
        (nc, 6) of the rows [1, m].
    moving
        What moves them.
    q
        (nq,) configuration, for the couplings [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].

    Returns
    -------
    numpy.ndarray
        (nc,) bias [m/s² and 1/s²].
    """
    loop = table.row_loop
    if not len(moving.twist):
        bias = np.zeros(table.size)
    else:
        bias = (moving.wrench_rate * moving.twist.take(loop, 0) + wrench * moving.drift.take(loop, 0)).sum(
            axis=1
        )
    coupling = table.coupling
    if coupling.index.size:
        bias[coupling.index] = -coupling.evaluate(q, 2) * np.where(coupling.v2 >= 0, v[coupling.v2], 0.0) ** 2
    return bias


def jacobian_rate_of(
    table: LoopTable,
    wrench: FloatArray,
    moving: MovingLoops,
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
    wrench
        (nc, 6) of the rows [1, m].
    moving
        What moves them.
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
    """
    jacobian_rate = (moving.wrench_rate @ joints + wrench @ joint_rates) * table.row_difference
    coupling = table.coupling
    if coupling.index.size:
        follows = coupling.v2 >= 0
        curve = coupling.evaluate(q, 2) * np.where(follows, v[coupling.v2], 0.0)
        jacobian_rate[coupling.index[follows], coupling.v2[follows]] -= curve[follows]
    return jacobian_rate


def opposed_loops(table: LoopTable, placed: PlacedJoints) -> list[int]:
    """Find loops whose rows may vanish although they are not assembled: directions that should agree are opposed.

    Parameters
    ----------
    table
        Loops.
    placed
        Placements of the joints.

    Returns
    -------
    list of int
        Numbers of these loops.
    """
    loop, direction = table.aligned, table.directions[:, :, None]
    if not loop.size:
        return []
    one = placed.rotation[table.at1[loop]] @ (table.rotation1[loop] @ direction)
    two = placed.rotation[table.at2[loop]] @ (table.rotation2[loop] @ direction)
    return [int(number) for number in loop[(one * two).sum(axis=1)[:, 0] < 0]]


def alignment_of(table: LoopTable, placed: PlacedJoints, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Measure how far directions that should agree differ, which rows do not tell from directions that are opposed.

    Parameters
    ----------
    table
        Loops.
    placed
        Placements of the joints.
    joints
        (6, nv) joint Jacobians at the world origin [m, rad per m or rad].

    Returns
    -------
    difference : numpy.ndarray
        (3 n,) direction of frame 2 less that of frame 1, world axes, three for each pair, dimensionless.
    jacobian : numpy.ndarray
        (3 n, nv) its rate per tangent velocity [1 per m or rad].
    """
    loop, direction = table.aligned, table.directions[:, :, None]
    one = (placed.rotation[table.at1[loop]] @ (table.rotation1[loop] @ direction))[:, :, 0]
    two = (placed.rotation[table.at2[loop]] @ (table.rotation2[loop] @ direction))[:, :, 0]
    turning1 = table.supports[loop][:, :, None] * joints[3:].T
    turning2 = table.supports[loop + len(table.joint1)][:, :, None] * joints[3:].T
    rates = np.cross(turning2, two[:, None]) - np.cross(turning1, one[:, None])
    return (two - one).ravel(), rates.transpose(0, 2, 1).reshape(-1, joints.shape[1])


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Multiply vectors row by row; `numpy.cross` takes eight times as long for a few rows.

    Parameters
    ----------
    a, b
        (n, 3) vectors [any unit].

    Returns
    -------
    numpy.ndarray
        (n, 3) a × b, in any unit.
    """
    # What stands at k is the entry k + 2 of the product: one shift more, and two fewer.
    return (a * b.take(_NEXT, 1) - a.take(_NEXT, 1) * b).take(_NEXT, 1)


_NEXT = np.array([1, 2, 0])


class Drive:
    """The square system of loop rows and motor rows in natural units, [J_c; S], by its passive block P.

    With J_c = [P | Q] for passive joints and motors, the motion of motor rates u and row rates r is
    P⁻¹ (r - Q u) for the former. It exists where there are as many motors as freedoms, no idle ones and no redundant
    rows, and where its condition is so good that no singularity can be near; elsewhere singular values decide, in
    `Freedom`.

    Parameters
    ----------
    chain
        The chain.
    across
        (nc, nu) Q, dimensionless.
    factors
        (nc, nc) LU factors of P, dimensionless.
    pivots
        (nc,) index of the row exchanged at each step.
    regularity
        Estimated reciprocal of the condition number of P.
    """

    def __init__(
        self,
        chain: ClosedChain,
        across: FloatArray,
        factors: FloatArray,
        pivots: np.ndarray,
        regularity: float,
    ) -> None:
        self.regularity = regularity
        self._passive, self._motors, self._across = chain.passive_index, chain.motor_index, across
        self._factors, self._pivots = factors, pivots

    @staticmethod
    def of(state: State) -> Drive | None:
        """Factorise, or say that the state needs a closer look.

        Parameters
        ----------
        state
            State of a chain whose motors determine its motion.

        Returns
        -------
        Drive or None
            The factors.
        """
        chain, rows = state.chain, state.rows
        passive, across = rows.take(chain.passive_index, 1), rows.take(chain.motor_index, 1)
        if not chain.nc:
            return Drive(chain, across, passive, np.zeros(0, dtype=np.int32), 1.0)
        factors, pivots, info = _getrf(passive)
        if info:
            return None
        regularity = float(_gecon(factors, _lange("1", passive))[0])
        return Drive(chain, across, factors, pivots, regularity) if regularity > FAR_FROM_SINGULAR else None

    def motions(self) -> FloatArray:
        """Move with one motor at a time.

        Returns
        -------
        numpy.ndarray
            (nv, nu), dimensionless.
        """
        count = self._motors.size
        G = np.zeros((self._passive.size + count, count))
        G[self._motors] = np.eye(count)
        if self._passive.size:
            G[self._passive] = -_getrs(self._factors, self._pivots, self._across)[0]
        return G

    def across(self, rates: FloatArray) -> FloatArray:
        """Find the motion with given rates of loop rows and the motors at rest.

        Parameters
        ----------
        rates
            (nc,) or (nc, k), dimensionless.

        Returns
        -------
        numpy.ndarray
            (nv,) or (nv, k), dimensionless.
        """
        motion = np.zeros((self._passive.size + self._motors.size, *rates.shape[1:]))
        if self._passive.size:
            motion[self._passive] = _getrs(self._factors, self._pivots, rates)[0]
        return motion

    def carry(self, efforts: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Find the reactions of loop rows and the motor efforts that make given efforts of the tree.

        Parameters
        ----------
        efforts
            (nv,), dimensionless.

        Returns
        -------
        reactions : numpy.ndarray
            (nc,), dimensionless.
        motors : numpy.ndarray
            (nu,), dimensionless.
        """
        motors = efforts.take(self._motors)
        if not self._passive.size:
            return np.zeros(0), motors
        reactions = _getrs(self._factors, self._pivots, efforts.take(self._passive), trans=1)[0]
        return reactions, motors - reactions @ self._across
