"""How the loop Jacobian changes along a motion, for whatever rows there are, from the derivative of the bias.

The bias is a quadratic form, ``loop_bias(v) = J̇_c(v) v``; half its derivative is the symmetric half of ``J̇_c(v) u``.
The other half is there because tangents of ball joints and free bodies do not commute: with X_v φ = J_c v,

    J̇_c(v) u - J̇_c(u) v = X_v X_u φ - X_u X_v φ = J_c [v, u],

the bracket of the joint's group.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from stewart_pin.checks import as_array
from stewart_pin.closure.equations import loop_bias, loop_jacobian
from stewart_pin.closure.row_derivatives import row_derivatives
from stewart_pin.model.chain import ClosedChain, as_configuration
from stewart_pin.typing import ArrayLike, FloatArray, Tangent


def loop_jacobian_rate(chain: ClosedChain, q: ArrayLike, v: ArrayLike, motions: ArrayLike) -> FloatArray:
    r"""Differentiate the loop Jacobian along a velocity, times some motions: :math:`\dot J_c(q, v)\, U`.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration of the spanning tree [m, rad, unit quaternions].
    v
        (nv,) tangent velocity along which the chain moves [m/s, rad/s].
    motions
        (nv, k) tangent vectors, U; the identity gives the whole matrix [m/s, rad/s].

    Returns
    -------
    numpy.ndarray
        (nc, k) in loop frame 1 [m/s² and 1/s²].

    Raises
    ------
    SingularityError
        If the ends of a distance loop coincide.
    """
    q, v = as_configuration(chain, "q", q), as_array("v", v, (chain.nv,))
    motions = as_array("motions", motions, (chain.nv, None))
    if not chain.nc or not motions.size:
        return np.zeros((chain.nc, motions.shape[1]))
    loop_bias(chain, q, v)  # refuses a distance loop without direction, whose derivatives would be no numbers
    symmetric = row_derivatives(chain, q, v, np.zeros(chain.nv)).acceleration_v @ motions
    brackets = np.stack([tangent_bracket(chain, v, u) for u in motions.T], axis=1)
    return (symmetric + loop_jacobian(chain, q) @ brackets) / 2


def tangent_bracket(chain: ClosedChain, v: Tangent, u: Tangent) -> Tangent:
    """Bracket two tangents, joint by joint: zero but for ball joints and free bodies, whose motions do not commute.

    Parameters
    ----------
    chain
        Closed chain.
    v, u
        (nv,) tangents [m/s, rad/s].

    Returns
    -------
    numpy.ndarray
        (nv,) bracket of the left-invariant fields, [v, u] [m/s², rad/s²].
    """
    bracket = np.zeros(chain.nv)
    for joint in chain.model.joints[1:]:
        own = slice(joint.idx_v, joint.idx_v + joint.nv)
        if joint.nv == 3:
            bracket[own] = np.cross(v[own], u[own])
        elif joint.nv == 6:
            bracket[own] = pin.Motion(v[own]).cross(pin.Motion(u[own])).vector
    return bracket
