"""Motor efforts within limits, by a quadratic programme."""

from __future__ import annotations

import numpy as np
import proxsuite

from stewart_pin.checks import as_array
from stewart_pin.errors import ConvergenceError, InputError
from stewart_pin.typing import ArrayLike, FloatArray

_ACCURACY = 1e-10
"""Residual at which the solver stops, relative to the load."""


def bounded_efforts(share: FloatArray, load: FloatArray, limit: ArrayLike) -> FloatArray:
    """Find the least-norm efforts within limits that carry a load.

    Parameters
    ----------
    share
        (dof, nu) what one unit of each motor's effort contributes to each motion [N or N m per N or N m].
    load
        (dof,) what the motions need [N, N m].
    limit
        (nu,) or one number: largest absolute effort [N or N m].

    Returns
    -------
    numpy.ndarray
        (nu,) efforts [N or N m].

    Raises
    ------
    InputError
        If a limit is negative.
    ConvergenceError
        If no efforts within the limits carry the load.
    """
    nu = share.shape[1]
    bound = np.broadcast_to(
        as_array("effort_limit", np.atleast_1d(np.asarray(limit, dtype=float)), (None,)), (nu,)
    )
    if (bound < 0).any():
        raise InputError(f"effort_limit must be 0 or more, got {bound.min():g}")
    # Dependent rows (idle freedoms carry no load) are taken out, and the load is scaled to about one.
    u, s, vt = np.linalg.svd(share, full_matrices=False)
    keep = s > 1e-10 * s[0]
    size = max(1.0, float(np.abs(load).max(initial=0.0)))
    rows, goal = vt[keep], (u[:, keep].T @ load) / (s[keep] * size)
    qp = proxsuite.proxqp.dense.QP(nu, rows.shape[0], nu)
    qp.settings.eps_abs = _ACCURACY
    qp.settings.max_iter = 10_000
    qp.init(np.eye(nu), np.zeros(nu), rows, goal, np.eye(nu), -bound / size, bound / size)
    qp.solve()
    left = float(np.abs(rows @ qp.results.x - goal).max(initial=0.0))
    over = float((np.abs(qp.results.x) - bound / size).max(initial=0.0))
    if qp.results.info.status != proxsuite.proxqp.QPSolverOutput.PROXQP_SOLVED or max(left, over) > 1e-8:
        raise ConvergenceError(
            f"no efforts within effort_limit carry the load ({left * size:.3g} N or N m is left over); "
            "raise the limit or slow down",
            residual=left * size,
        )
    return qp.results.x * size
