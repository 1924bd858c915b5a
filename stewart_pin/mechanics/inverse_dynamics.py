"""Inverse dynamics by name of method."""

from __future__ import annotations

from stewart_pin.errors import InputError
from stewart_pin.mechanics.constrained import pinocchio_inverse_dynamics
from stewart_pin.mechanics.constraint_matrix.solution import constraint_matrix_inverse_dynamics
from stewart_pin.mechanics.effort import Effort
from stewart_pin.model.chain import ClosedChain
from stewart_pin.typing import ArrayLike

METHODS = ("pinocchio", "constraint_matrix")


def inverse_dynamics(
    chain: ClosedChain,
    q: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    *,
    method: str = "pinocchio",
    effort_limit: ArrayLike | None = None,
    throw: bool = True,
) -> Effort:
    """Compute the motor efforts that make a chain move as asked.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration with closed loops [m, rad, unit quaternions].
    v
        (nv,) tangent velocity that keeps them closed [m/s, rad/s].
    a
        (nv,) tangent acceleration that keeps them closed [m/s², rad/s²].
    method
        ``"pinocchio"``: RNEA and the loop Jacobian. ``"constraint_matrix"``: all bodies in maximal coordinates, an
        independent check.
    effort_limit
        (nu,) or one number: largest absolute motor effort; redundant motors then share within it, method
        ``"pinocchio"`` only [N or N m].
    throw
        Whether motors that cannot hold the robot are an error. Otherwise ``"pinocchio"`` keeps the demanded motion,
        with efforts by least squares and what they leave over in ``residual``; ``"constraint_matrix"`` keeps the
        motors' part of it, and ``a`` tells how the rest then moves.

    Returns
    -------
    Effort
        Motor efforts, loop reactions, and whether they are unique. Efforts that are not unique are the least-norm
        ones. Idle freedoms, which no motor can drive, follow their own inertia whatever `a` asks of them.

    Raises
    ------
    ActuationError
        If the motors cannot hold the robot; carries the freedom left over and the smallest singular value.
    InputError
        If an argument is wrong, or the state does not keep the loops closed.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> rest = np.zeros(chain.nv)
    >>> stp.inverse_dynamics(chain, chain.q_home, rest, rest).tau_motor.round(2)
    array([49.99, 49.99, 49.99, 49.99, 49.99, 49.99])
    """
    if method == "pinocchio":
        return pinocchio_inverse_dynamics(chain, q, v, a, effort_limit=effort_limit, throw=throw)
    if method != "constraint_matrix":
        raise InputError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    if effort_limit is not None:
        raise InputError(
            "effort_limit is for method 'pinocchio'; 'constraint_matrix' gives the least-norm efforts"
        )
    return constraint_matrix_inverse_dynamics(chain, q, v, a, throw=throw)
