"""Gap of the loops, its Jacobian, its bias: what a user may ask of any configuration, closed or open."""

from __future__ import annotations

import numpy as np

from stewart_pin.checks import as_array
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import State, as_state
from stewart_pin.typing import ArrayLike, FloatArray


def loop_gap(chain: ClosedChain | State, q: ArrayLike | None = None) -> FloatArray:
    """Measure how far the loops are from closed.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration of the spanning tree, with a chain [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nc,) residual of 1M2, loop after loop, in loop frame 1 [m; angle rows are sines, dimensionless], then of the
        couplings [m or rad].
    """
    return as_state(chain, q).gap.copy()


def loop_jacobian(chain: ClosedChain | State, q: ArrayLike | None = None) -> FloatArray:
    r"""Differentiate the loop gap along the tangent of the spanning tree.

    The sign is that of a derivative, :math:`\dot\phi = J_c(q)\, v`, for every q, closed or open. Pinocchio's
    ``RigidConstraintModel`` has the opposite sign, its ``PointAnchorConstraintModel`` this one. Where the ends of a
    distance loop coincide, the distance has a kink and no derivative; its row is then that along x of frame 1.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration of the spanning tree, with a chain [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nc, nv) rate of the gap, in loop frame 1, per tangent velocity [m/s and 1/s per m/s or rad/s].
    """
    return as_state(chain, q).J_c.copy()


def loop_bias(
    chain: ClosedChain | State, q: ArrayLike | None = None, v: ArrayLike | None = None
) -> FloatArray:
    r"""Compute the part of the gap's second derivative that is there without acceleration, :math:`\dot J_c v`.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration of the spanning tree, with a chain [m, rad, unit quaternions].
    v
        (nv,) tangent velocity, with a chain [m/s, rad/s].

    Returns
    -------
    numpy.ndarray
        (nc,) such that the gap's second derivative is ``loop_jacobian @ a + loop_bias`` [m/s² and 1/s²].

    Raises
    ------
    SingularityError
        If the ends of a distance loop coincide.
    """
    state = as_state(chain, q, v)
    return state.J_c_rate @ state.v  # a distance loop without direction is refused at rest, too


def loop_jacobian_rate(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    motions: ArrayLike | None = None,
) -> FloatArray:
    r"""Differentiate the loop Jacobian along a velocity, times some motions: :math:`\dot J_c(q, v)\, U`.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration of the spanning tree, with a chain [m, rad, unit quaternions].
    v
        (nv,) tangent velocity along which the chain moves, with a chain [m/s, rad/s].
    motions
        (nv, k) tangent vectors, U; default: the identity, for the whole matrix [m/s, rad/s].

    Returns
    -------
    numpy.ndarray
        (nc, k) in loop frame 1 [m/s² and 1/s²].

    Raises
    ------
    SingularityError
        If the ends of a distance loop coincide.
    """
    state = as_state(chain, q, v)
    rate = np.array(state.J_c_rate)
    return rate if motions is None else rate @ as_array("motions", motions, (state.chain.nv, None))
