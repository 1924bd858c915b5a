"""Couplings as rows of joint rates: q1 = p(q2) holds v1 - p' v2 = 0 and a1 - p' a2 = p'' v2²."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stewart_pin.mechanics.articulated_body.bodies import Body
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import Configuration, FloatArray, Tangent


@dataclass(frozen=True, eq=False)
class GearRows:
    """Rows of all couplings.

    Attributes
    ----------
    jacobian
        (r, nv) rates of the residuals per joint rate [unit of joint 1 per unit of joint].
    gap
        (r,) q1 - p(q2) [m or rad].
    bias
        (r,) second derivative of the residuals without joint acceleration [m/s² or rad/s²].
    """

    jacobian: FloatArray
    gap: FloatArray
    bias: FloatArray


def coupling_rows(chain: ClosedChain, bodies: Sequence[Body], q: Configuration, v: Tangent) -> GearRows:
    """Evaluate the couplings of a chain.

    Parameters
    ----------
    chain
        Closed chain.
    bodies
        Bodies of its tree.
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].

    Returns
    -------
    GearRows
        One row per coupling.
    """
    at = {body.joint.name: body for body in bodies if body.joint is not None}
    rows = len(chain.couplings)
    jacobian, gap, bias = np.zeros((rows, chain.nv)), np.zeros(rows), np.zeros(rows)
    for k, coupling in enumerate(chain.couplings):
        # Horner's scheme for p, p' and p''.
        value = slope = half_curve = 0.0
        x = float(q[at[coupling.joint2].q_index][0]) if coupling.joint2 else 0.0
        for coefficient in reversed(coupling.polynomial):
            half_curve = half_curve * x + slope
            slope = slope * x + value
            value = value * x + coefficient
        first = at[coupling.joint1]
        jacobian[k, first.v_index] = 1.0
        gap[k] = float(q[first.q_index][0]) - value
        if coupling.joint2:
            second = at[coupling.joint2].v_index
            jacobian[k, second] = -slope
            bias[k] = -2.0 * half_curve * float(v[second][0]) ** 2
    return GearRows(jacobian, gap, bias)
