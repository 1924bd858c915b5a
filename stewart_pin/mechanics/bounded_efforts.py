"""Motor efforts within limits, by a quadratic programme."""

from __future__ import annotations

import numpy as np
import proxsuite

from stewart_pin.errors import ConvergenceError, InputError
from stewart_pin.typing import ArrayLike, FloatArray

_ACCURACY = 1e-10
"""Residual at which the solver stops, relative to the load."""
_CARRIED = 1e-8
"""Part of the load that may be left over, relative to it, before it counts as not carried."""
_AT_LIMIT = 1e-8
"""Distance from a limit, relative to the load, at which the solver means the limit itself."""
_UNLIMITED = 1e10
""""No limit" in the quadratic programme, relative to the load."""


def bounded_efforts(share: FloatArray, load: FloatArray, limit: ArrayLike, rank: int) -> FloatArray:
    """Find the least-norm efforts within limits that carry a load.

    Parameters
    ----------
    share
        (dof, nu) what one unit of each motor's effort contributes to each motion [N or N m per N or N m].
    load
        (dof,) what the motions need [N, N m].
    limit
        (nu, 2) least and greatest effort; or (nu,) or one number: largest absolute effort; inf for none [N or N m].
    rank
        Number of independent rows of the share.

    Returns
    -------
    numpy.ndarray
        (nu,) efforts [N or N m].

    Raises
    ------
    InputError
        If a limit is negative, no number, empty, or of another shape.
    ConvergenceError
        If no efforts within the limits carry the load.
    """
    nu = share.shape[1]
    bound = _bounds(limit, nu)
    # Dependent rows (idle freedoms carry no load) are taken out, and the load is scaled to about one.
    u, s, vt = np.linalg.svd(share, full_matrices=False)
    size = max(1.0, float(np.abs(load).max(initial=0.0)))
    rows, goal = vt[:rank], (u[:, :rank].T @ load) / (s[:rank] * size)
    qp = proxsuite.proxqp.dense.QP(nu, rows.shape[0], nu)
    qp.settings.eps_abs = _ACCURACY
    qp.settings.max_iter = 10_000
    # No limit is one far beyond what any least-norm solution would use.
    least, most = np.clip(bound / size, -_UNLIMITED, _UNLIMITED).T
    qp.init(np.eye(nu), np.zeros(nu), rows, goal, np.eye(nu), least, most)
    qp.solve()
    efforts = _polished(qp.results.x, rows, goal, least, most)
    left = float(np.abs(rows @ efforts - goal).max(initial=0.0))
    if qp.results.info.status != proxsuite.proxqp.QPSolverOutput.PROXQP_SOLVED or left > _CARRIED:
        raise ConvergenceError(
            f"no efforts within effort_limit carry the load ({left * size:.3g} N or N m is left over); "
            "raise the limit or slow down",
            residual=left * size,
        )
    return efforts * size


def _bounds(limit: ArrayLike, nu: int) -> FloatArray:
    """Least and greatest efforts (nu, 2)."""
    try:
        bound = np.asarray(limit, dtype=float)
        if bound.shape != (nu, 2):
            bound = np.broadcast_to(bound, (nu,))
    except (TypeError, ValueError):
        raise InputError(
            f"effort_limit must be a number or have shape ({nu},), got {np.shape(limit)} of {type(limit).__name__}; "
            f"with the least efforts first, ({nu}, 2)"
        ) from None
    if bound.ndim == 2:
        if not (bound[:, 0] <= bound[:, 1]).all():
            raise InputError(f"effort_limit must have the least effort first, got {bound.tolist()}")
        return bound
    if not (bound >= 0).all():
        raise InputError(f"effort_limit must be 0 or more (inf: no limit), got {np.min(bound):g}")
    return bound[:, None] * [-1.0, 1.0]


def _polished(
    efforts: FloatArray, rows: FloatArray, goal: FloatArray, least: FloatArray, most: FloatArray
) -> FloatArray:
    """Put efforts at a limit exactly there and solve for the others: round-off instead of the solver's accuracy."""
    low, high = efforts < least + _AT_LIMIT, efforts > most - _AT_LIMIT
    held = low | high
    exact = np.where(low, least, np.where(high, most, 0.0))
    exact[~held] = np.linalg.lstsq(rows[:, ~held], goal - rows @ exact, rcond=None)[0]
    slack = 1e-12 * np.maximum(np.abs(least), np.abs(most))
    fits = ((exact >= least - slack) & (exact <= most + slack)).all()
    fits = fits and np.abs(exact - efforts).max(initial=0.0) < 10 * _AT_LIMIT
    return np.clip(exact if fits else efforts, least, most)
