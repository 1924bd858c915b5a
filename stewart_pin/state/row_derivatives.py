"""Derivatives of the loop rows' rates and accelerations, and of the forces at the joints that reactions make."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.model.loop_table import LoopTable
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.relative_motion import LoopEnds, cable_path, cross, relative_motion, turn
from stewart_pin.typing import Configuration, FloatArray, Tangent


@dataclass(frozen=True, eq=False)
class RowDerivatives:
    """Derivatives of the rates of the rows at a state.

    Attributes
    ----------
    rate_q
        (nc, nv) derivative of ``loop_jacobian @ v`` for fixed v [m/s and 1/s per m or rad].
    acceleration_q
        (nc, nv) derivative of ``loop_jacobian @ a + loop_bias`` for fixed v and a [m/s² and 1/s² per m or rad].
    acceleration_v
        (nc, nv) derivative of the same with respect to v [1/s and 1/(m s) per m or rad].
    """

    rate_q: FloatArray
    acceleration_q: FloatArray
    acceleration_v: FloatArray

    def set(
        self, row: int, rate_q: FloatArray, acceleration_q: FloatArray, acceleration_v: FloatArray
    ) -> None:
        """Fill one row.

        Parameters
        ----------
        row
            Index among all rows.
        rate_q, acceleration_q, acceleration_v
            (nv,) its derivatives, in the units of the fields [m/s, 1/s, m/s², 1/s² per m or rad].
        """
        self.rate_q[row], self.acceleration_q[row], self.acceleration_v[row] = (
            rate_q,
            acceleration_q,
            acceleration_v,
        )


def row_derivatives(chain: ClosedChain, q: Configuration, v: Tangent, a: Tangent) -> RowDerivatives:
    """Differentiate the rates and accelerations of the loop rows.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].
    a
        (nv,) tangent acceleration [m/s², rad/s²].

    Returns
    -------
    RowDerivatives
        One row per loop row, then one per coupling.
    """
    data = pin.Data(chain.model)
    pin.computeForwardKinematicsDerivatives(chain.model, data, q, v, a)
    table, shape = chain.loop_table, (chain.nc, chain.nv)
    rate_q, acceleration_q, acceleration_v = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    result = RowDerivatives(rate_q, acceleration_q, acceleration_v)
    relative = [relative_motion(chain, data, k) for k in range(len(chain.loops))]
    slides = [motion.translation()[1:] for motion in relative]
    for row, loop, n in zip(table.normal.index, table.normal.loop, table.normal.vector1, strict=True):
        result.set(row, *(n @ derivative for derivative in slides[loop]))
    angle = table.angle
    for row, loop, u1, u2 in zip(angle.index, angle.loop, angle.vector1, angle.vector2, strict=True):
        result.set(row, *(u1 @ derivative for derivative in relative[loop].direction(u2)))
    rod = table.rod
    for row, loop, axis, radius in zip(rod.index, rod.loop, rod.vector1, rod.radius, strict=True):
        result.set(row, *relative[loop].distance(axis, radius))
    _fill_couplings(table, q, v, a, result)
    return result


def _fill_couplings(
    table: LoopTable, q: Configuration, v: Tangent, a: Tangent, result: RowDerivatives
) -> None:
    rows = table.coupling
    curve, third = rows.evaluate(q, 2), rows.evaluate(q, 3)
    for row, v2, p2, p3 in zip(rows.index, rows.v2, curve, third, strict=True):
        if v2 >= 0:
            # q1 - p(q2): rate v1 - p' v2, acceleration a1 - p' a2 - p'' v2².
            result.rate_q[row, v2] = -p2 * v[v2]
            result.acceleration_q[row, v2] = -p2 * a[v2] - p3 * v[v2] ** 2
            result.acceleration_v[row, v2] = -2 * p2 * v[v2]


# ----------------------------------------------------------------------------------------------------
# Reactions of loops and couplings as joint forces, and how they change with the configuration
# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class ReactionForces:
    """Reactions on the joints, the derivative of Jᵀ λ split in what Pinocchio can tell and what it cannot.

    An effort Jᵀ f of forces f held fixed in their joints' frames has a derivative that
    `pinocchio.computeRNEADerivatives` knows, when the forces are passed to it. The rest: reactions turn with frame 1
    and with the directions of their rows, and couplings act on joints alone.

    Attributes
    ----------
    forces
        External force on every joint, in its own frame [N, N m].
    efforts
        (nv,) what couplings add to the joints [N, N m].
    derivative
        (nv, nv) the rest of ∂(Jᵀ λ)/∂q [N/m, N m/rad and so on].
    """

    forces: pin.StdVec_Force
    efforts: FloatArray
    derivative: FloatArray


def reaction_forces(chain: ClosedChain, q: Configuration, lambda_c: FloatArray) -> ReactionForces:
    """Turn the multipliers of the rows into joint forces, and differentiate them.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration [m, rad, unit quaternions].
    lambda_c
        (nc,) multipliers of the rows [N, N m].

    Returns
    -------
    ReactionForces
        Forces, and the part of their derivative that is not Pinocchio's.
    """
    data = pin.Data(chain.model)
    pin.computeJointJacobians(chain.model, data, q)
    efforts, derivative = _coupling_efforts(chain, q, lambda_c)
    forces = [pin.Force.Zero() for _ in range(chain.model.njoints)]
    for k in range(len(chain.loops)):
        at = LoopEnds(chain, data, k)
        delta = at.displacement()
        wrench, change = loop_wrench(chain, k, at, delta, lambda_c)
        force = pin.Force(wrench)
        forces[at.joint2] += at.frame2.act(at.placement.actInv(force))
        forces[at.joint1] -= at.frame1.act(force)
        # In frame 2 the wrench is X⁻¹ F, and d(X⁻¹ F) = X⁻¹ (dF - δ ×* F).
        moved = at.placement.inverse().toDualActionMatrix() @ (change - _force_cross(delta, wrench))
        derivative += at.jacobian2.T @ moved - at.jacobian1.T @ change
    vector = pin.StdVec_Force()
    for force in forces:
        vector.append(force)
    return ReactionForces(vector, efforts, derivative)


def loop_wrench(
    chain: ClosedChain, k: int, at: LoopEnds, delta: FloatArray, lambda_c: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Add up the reactions of one loop.

    Parameters
    ----------
    chain
        Closed chain.
    k
        Number of the loop.
    at
        Its ends.
    delta
        (6, nv) displacement of frame 2 relative to frame 1 per tangent entry [m, rad].
    lambda_c
        (nc,) multipliers of the rows [N, N m].

    Returns
    -------
    wrench : numpy.ndarray
        (6,) force and moment on link 2 at the origin of frame 1, in its axes [N, N m].
    change : numpy.ndarray
        (6, nv) its derivative for fixed multipliers [N, N m per m or rad].
    """
    table, moved = chain.loop_table, at.moved(delta)
    wrench, change = np.zeros(6), np.zeros((6, chain.nv))
    for i in np.flatnonzero(table.normal.loop == k):
        n, force = table.normal.vector1[i], lambda_c[table.normal.index[i]]
        wrench += force * np.concatenate([n, np.cross(at.t, n)])
        change[3:] += force * cross(moved, n)
    for i in np.flatnonzero(table.angle.loop == k):
        u1, moment = table.angle.vector1[i], lambda_c[table.angle.index[i]]
        w = at.rotation @ table.angle.vector2[i]
        wrench[3:] += moment * np.cross(w, u1)
        change[3:] += moment * cross(cross(delta[3:], w), u1)
    for i in np.flatnonzero(table.rod.loop == k):
        force = lambda_c[table.rod.index[i]]
        way = cable_path(at.t, table.rod.vector1[i], table.rod.radius[i])
        e, e_q = way.along[0], way.turned(moved.T).T
        wrench += force * np.concatenate([e, np.cross(at.t, e)])
        change += force * np.vstack([e_q, cross(moved, e) + turn(at.t, e_q)])
    return wrench, change


def _coupling_efforts(
    chain: ClosedChain, q: Configuration, lambda_c: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Joint efforts of couplings, 1, -p' and -r times each reaction, and of reels; and what of them changes with q2."""
    rows, slope, curve = (
        chain.loop_table.coupling,
        *(chain.loop_table.coupling.evaluate(q, n) for n in (1, 2)),
    )
    efforts, derivative = np.zeros(chain.nv), np.zeros((chain.nv, chain.nv))
    for k, row in enumerate(rows.index):
        efforts[rows.v1[k]] += lambda_c[row]
        if rows.v2[k] >= 0:
            efforts[rows.v2[k]] -= slope[k] * lambda_c[row]
            derivative[rows.v2[k], rows.v2[k]] -= curve[k] * lambda_c[row]
    efforts -= lambda_c[rows.index] @ rows.ratios_v
    reel = chain.loop_table.reel
    np.add.at(efforts, reel.v, reel.ratio * lambda_c[reel.index])
    return efforts, derivative


def _force_cross(columns: FloatArray, wrench: FloatArray) -> FloatArray:
    """Spatial cross product of each motion [linear; angular] with a wrench: (6, n)."""
    moment = cross(columns[:3], wrench[:3]) + cross(columns[3:], wrench[3:])
    return np.vstack([cross(columns[3:], wrench[:3]), moment])
