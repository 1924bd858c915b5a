"""Derivatives of the loop rows' rates and accelerations: what a change of configuration or velocity does to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.model.loop_table import LoopTable
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.relative_motion import relative_motion
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
    for row, loop in zip(table.rod.index, table.rod.loop, strict=True):
        result.set(row, *relative[loop].distance())
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
