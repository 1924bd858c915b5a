"""Reactions of loops and couplings as joint forces, and how they change with the configuration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.relative_motion import LoopEnds, cross, turn
from stewart_pin.typing import Configuration, FloatArray


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
        force, length = lambda_c[table.rod.index[i]], np.linalg.norm(at.t)
        e = at.t / length
        e_q = (moved - np.outer(e, e @ moved)) / length
        wrench += force * np.concatenate([e, np.cross(at.t, e)])
        change += force * np.vstack([e_q, cross(moved, e) + turn(at.t, e_q)])
    return wrench, change


def _coupling_efforts(
    chain: ClosedChain, q: Configuration, lambda_c: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Joint efforts of the couplings, 1 and -p' times each reaction, and what of them changes with q2."""
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
    return efforts, derivative


def _force_cross(columns: FloatArray, wrench: FloatArray) -> FloatArray:
    """Spatial cross product of each motion [linear; angular] with a wrench: (6, n)."""
    moment = cross(columns[:3], wrench[:3]) + cross(columns[3:], wrench[3:])
    return np.vstack([cross(columns[3:], wrench[:3]), moment])
