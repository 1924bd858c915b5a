"""Gap of the loops, its Jacobian and its bias, at any configuration, closed or open.

The relative placement 1M2 of the loop frames has translation t and rotation R. With c the velocity of frame 2's
origin relative to body 1 and w the relative angular velocity, both in frame 1: dt = c and dR = [w]× R. All
derivatives below follow from these two. The Jacobians are assembled from the joint Jacobians of the tree; nothing
depends on the scratch of Pinocchio's constraint classes, whose Jacobians are wrong unless ``calc`` ran before.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.checks import as_array
from stewart_pin.errors import SingularityError
from stewart_pin.model.chain import ClosedChain, as_configuration
from stewart_pin.model.description import JointKind
from stewart_pin.model.loop_rows import orthonormal_triad
from stewart_pin.model.loop_table import LoopTable
from stewart_pin.typing import ArrayLike, Configuration, FloatArray, Tangent

_HELD = (JointKind.FIXED, JointKind.PRISMATIC)
"""Loops that hold all directions of frames 1 and 2 together."""
_ALIGNED = (*_HELD, JointKind.REVOLUTE, JointKind.CYLINDRICAL, JointKind.PLANAR)
"""Loops that hold at least their axes together."""


@dataclass(frozen=True, eq=False)
class _Placements:
    """Loop frames at one configuration: world rotation 1 (L, 3, 3), world origins (L, 3), 1M2 as R and t."""

    world1: FloatArray
    origin1: FloatArray
    origin2: FloatArray
    rotation: FloatArray
    translation: FloatArray


def loop_gap(chain: ClosedChain, q: ArrayLike) -> FloatArray:
    """Measure how far the loops are from closed.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration of the spanning tree [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nc,) residual of 1M2, loop after loop, in loop frame 1 [m; angle rows are sines, dimensionless], then of the
        couplings [m or rad].
    """
    q = as_configuration(chain, "q", q)
    data = pin.Data(chain.model)
    pin.forwardKinematics(chain.model, data, q)
    return gap_from_data(chain, data, q)


def row_sizes(chain: ClosedChain) -> FloatArray:
    """Return the natural size of each loop row, by which a gap is judged large or small.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    numpy.ndarray
        (nc,) the robot's size for rows that are lengths [m], 1 for angles and their sines.
    """
    sizes = np.full(chain.nc, chain.length_scale)
    sizes[chain.loop_table.angle.index] = 1.0
    coupling = chain.loop_table.coupling
    sizes[coupling.index] = chain.tangent_scale[coupling.v1]
    return sizes


def loop_jacobian(chain: ClosedChain, q: ArrayLike) -> FloatArray:
    r"""Differentiate the loop gap along the tangent of the spanning tree.

    The sign is that of a derivative, :math:`\dot\phi = J_c(q)\, v`, for every q, closed or open. Pinocchio's
    ``RigidConstraintModel`` has the opposite sign, its ``PointAnchorConstraintModel`` this one. Where the ends of a
    distance loop coincide, the distance has a kink and no derivative; its row is then that along x of frame 1.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration of the spanning tree [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nc, nv) rate of the gap, in loop frame 1, per tangent velocity [m/s and 1/s per m/s or rad/s].
    """
    q = as_configuration(chain, "q", q)
    data = pin.Data(chain.model)
    pin.computeJointJacobians(chain.model, data, q)
    return jacobian_from_data(chain, data, q)


def loop_bias(chain: ClosedChain, q: ArrayLike, v: ArrayLike) -> FloatArray:
    r"""Compute the part of the gap's second derivative that is there without acceleration, :math:`\dot J_c v`.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration of the spanning tree [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].

    Returns
    -------
    numpy.ndarray
        (nc,) such that the gap's second derivative is ``loop_jacobian @ a + loop_bias`` [m/s² and 1/s²].

    Raises
    ------
    SingularityError
        If the ends of a distance loop coincide.
    """
    q, v = as_configuration(chain, "q", q), as_array("v", v, (chain.nv,))
    data = pin.Data(chain.model)
    pin.forwardKinematics(chain.model, data, q, v, np.zeros(chain.nv))
    return bias_from_data(chain, data, q, v)


def gap_from_data(chain: ClosedChain, data: pin.Data, q: Configuration) -> FloatArray:
    """Evaluate the gap where forward kinematics has run.

    Parameters
    ----------
    chain
        Closed chain.
    data
        Scratch that holds the joint placements.
    q
        (nq,) configuration that it holds [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nc,) gap in loop frame 1 [m and dimensionless].
    """
    table = chain.loop_table
    at = _placements(table, data)
    gap = np.empty(table.size)
    gap[table.normal.index] = np.einsum("ri,ri->r", table.normal.vector1, at.translation[table.normal.loop])
    gap[table.angle.index] = np.einsum("ri,ri->r", table.angle.vector1, _turned(table, at))
    gap[table.rod.index] = np.linalg.norm(at.translation[table.rod.loop], axis=1) - table.rod.length
    gap[table.coupling.index] = q[table.coupling.q1] - table.coupling.evaluate(q, 0)
    return gap


def flipped_loop(chain: ClosedChain, data: pin.Data) -> str | None:
    """Find a loop whose rows vanish although it is not assembled: directions that should agree are opposed.

    Parameters
    ----------
    chain
        Closed chain.
    data
        Scratch that holds the joint placements.

    Returns
    -------
    str or None
        Name of the first such loop.
    """
    table = chain.loop_table
    rotation = None
    for k, loop in enumerate(chain.loops):
        if loop.kind in _ALIGNED:
            rotation = _placements(table, data).rotation if rotation is None else rotation
            axes = np.stack(orthonormal_triad(loop.axis))
            agreement = np.einsum("ai,ij,aj->a", axes, rotation[k], axes)
            if (agreement if loop.kind in _HELD else agreement[:1]).min() < 0:
                return loop.name
    return None


def jacobian_from_data(chain: ClosedChain, data: pin.Data, q: Configuration) -> FloatArray:
    """Evaluate the loop Jacobian where the joint Jacobians have been computed.

    Parameters
    ----------
    chain
        Closed chain.
    data
        Scratch that holds the joint placements and Jacobians.
    q
        (nq,) configuration that it holds [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nc, nv) derivative of the gap, in loop frame 1 [m and 1 per m or rad].
    """
    table = chain.loop_table
    at = _placements(table, data)
    # Pinocchio hands a matrix of one column over as a vector.
    linear, angular = data.J.reshape(6, -1)[:3], data.J.reshape(6, -1)[3:]
    # Columns that move both frames or neither cancel: `difference` is the support of 2 less that of 1.
    at_origin2 = linear[None] - np.cross(at.origin2[:, :, None], angular[None], axis=1)
    to_frame1 = np.swapaxes(at.world1, 1, 2)
    slide = to_frame1 @ (at_origin2 * table.difference[:, None, :])
    turn = to_frame1 @ (angular[None] * table.difference[:, None, :])
    jacobian = np.zeros((table.size, chain.nv))
    jacobian[table.normal.index] = np.einsum("ri,rin->rn", table.normal.vector1, slide[table.normal.loop])
    # u1 · (w × R u2) = w · (R u2 × u1)
    lever = np.cross(_turned(table, at), table.angle.vector1)
    jacobian[table.angle.index] = np.einsum("ri,rin->rn", lever, turn[table.angle.loop])
    along = _directions(table, at)
    jacobian[table.rod.index] = np.einsum("ri,rin->rn", along, slide[table.rod.loop])
    fill_couplings(table, q, jacobian)
    return jacobian


def fill_couplings(table: LoopTable, q: Configuration, jacobian: FloatArray) -> None:
    """Write the rows of the couplings into a loop Jacobian: 1 for the joint that follows, -p' for the other.

    Parameters
    ----------
    table
        Loops and couplings.
    q
        (nq,) configuration [m, rad, unit quaternions].
    jacobian
        (nc, nv) loop Jacobian with zeros in these rows, changed in place [unit of joint 1 per unit of joint].
    """
    rows = table.coupling
    jacobian[rows.index, rows.v1] = 1.0
    follows = rows.v2 >= 0
    jacobian[rows.index[follows], rows.v2[follows]] = -rows.evaluate(q, 1)[follows]


def coupling_bias(table: LoopTable, q: Configuration, v: Tangent) -> FloatArray:
    """Compute the bias of the couplings, -p'' v2².

    Parameters
    ----------
    table
        Loops and couplings.
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].

    Returns
    -------
    numpy.ndarray
        (r,) one per coupling [m/s² or rad/s²].
    """
    rows = table.coupling
    return -rows.evaluate(q, 2) * v[rows.v2] ** 2 if rows.index.size else np.zeros(0)


def bias_from_data(chain: ClosedChain, data: pin.Data, q: Configuration, v: Tangent) -> FloatArray:
    """Evaluate the bias where forward kinematics has run to second order with zero joint acceleration.

    Parameters
    ----------
    chain
        Closed chain.
    data
        Scratch that holds joint placements, velocities and accelerations.
    q
        (nq,) configuration that it holds [m, rad, unit quaternions].
    v
        (nv,) tangent velocity that it holds [m/s, rad/s].

    Returns
    -------
    numpy.ndarray
        (nc,) bias [m/s² and 1/s²].

    Raises
    ------
    SingularityError
        If the ends of a distance loop coincide.
    """
    table = chain.loop_table
    at = _placements(table, data)
    distance = np.linalg.norm(at.translation[table.rod.loop], axis=1)
    if not distance.all():
        culprit = chain.loops[int(table.rod.loop[np.argmin(distance)])].name
        raise SingularityError(
            f"the ends of the distance loop '{culprit}' coincide, so its direction is undefined; close it first",
            smallest_singular_value=0.0,
        )
    velocity1, omega1, acceleration1, alpha1 = _motions(table.joint1, table.translation1, data)
    velocity2, omega2, acceleration2, alpha2 = _motions(table.joint2, table.translation2, data)
    reach = at.origin2 - at.origin1
    drift = velocity2 - velocity1
    spin = omega2 - omega1
    slide = drift - np.cross(omega1, reach)
    # Time derivatives of the two relative velocities, with the frame's own turning taken out.
    slide_rate = (
        acceleration2
        - acceleration1
        - np.cross(alpha1, reach)
        - np.cross(omega1, drift)
        - np.cross(omega1, slide)
    )
    spin_rate = alpha2 - alpha1 - np.cross(omega1, spin)

    def in_frame1(x: FloatArray) -> FloatArray:
        return np.einsum("lji,lj->li", at.world1, x)

    slide, slide_rate, spin, spin_rate = map(in_frame1, (slide, slide_rate, spin, spin_rate))
    bias = np.empty(table.size)
    bias[table.normal.index] = np.einsum("ri,ri->r", table.normal.vector1, slide_rate[table.normal.loop])
    turned, w = _turned(table, at), spin[table.angle.loop]
    second = np.cross(spin_rate[table.angle.loop], turned) + np.cross(w, np.cross(w, turned))
    bias[table.angle.index] = np.einsum("ri,ri->r", table.angle.vector1, second)
    along, c = _directions(table, at), slide[table.rod.loop]
    across = c - along * np.einsum("ri,ri->r", along, c)[:, None]
    bias[table.rod.index] = (
        np.einsum("ri,ri->r", along, slide_rate[table.rod.loop])
        + np.einsum("ri,ri->r", across, across) / distance
    )
    bias[table.coupling.index] = coupling_bias(table, q, v)
    return bias


def _placements(table: LoopTable, data: pin.Data) -> _Placements:
    world1, origin1 = _frame_in_world(table.joint1, table.rotation1, table.translation1, data)
    world2, origin2 = _frame_in_world(table.joint2, table.rotation2, table.translation2, data)
    to_frame1 = np.swapaxes(world1, 1, 2)
    return _Placements(
        world1=world1,
        origin1=origin1,
        origin2=origin2,
        rotation=to_frame1 @ world2,
        translation=np.einsum("lij,lj->li", to_frame1, origin2 - origin1),
    )


def _frame_in_world(
    joints: tuple[int, ...], rotation: FloatArray, translation: FloatArray, data: pin.Data
) -> tuple[FloatArray, FloatArray]:
    turn = np.array([data.oMi[j].rotation for j in joints]).reshape(-1, 3, 3)
    move = np.array([data.oMi[j].translation for j in joints]).reshape(-1, 3)
    return turn @ rotation, move + np.einsum("lij,lj->li", turn, translation)


def _motions(joints: tuple[int, ...], offset: FloatArray, data: pin.Data) -> tuple[FloatArray, ...]:
    """Velocity, angular velocity, classical acceleration and angular acceleration of points, in world axes."""
    turn = np.array([data.oMi[j].rotation for j in joints]).reshape(-1, 3, 3)
    twist = np.array([data.v[j].vector for j in joints]).reshape(-1, 6)
    spatial = np.array([data.a[j].vector for j in joints]).reshape(-1, 6)
    omega, alpha = twist[:, 3:], spatial[:, 3:]
    velocity = twist[:, :3] + np.cross(omega, offset)
    # Spatial acceleration misses the ω × v of the point: a_point = a + α × p + ω × (v + ω × p).
    acceleration = spatial[:, :3] + np.cross(alpha, offset) + np.cross(omega, velocity)
    return tuple(np.einsum("lij,lj->li", turn, x) for x in (velocity, omega, acceleration, alpha))


def _turned(table: LoopTable, at: _Placements) -> FloatArray:
    """Direction u2 of every angle row, in frame 1: (r, 3)."""
    return np.einsum("rij,rj->ri", at.rotation[table.angle.loop], table.angle.vector2)


def _directions(table: LoopTable, at: _Placements) -> FloatArray:
    """Point from frame 1 to frame 2 of every length row, in frame 1: (r, 3); along x where the two coincide."""
    reach = at.translation[table.rod.loop]
    reach = np.where(reach.any(axis=1, keepdims=True), reach, [1.0, 0.0, 0.0])
    return reach / np.linalg.norm(reach, axis=1, keepdims=True)
