"""Linear programmes, as quadratic ones without a quadratic part, by ProxQP, and polished to a vertex."""

from __future__ import annotations

import numpy as np
import proxsuite
from scipy.optimize import linprog

from stewart_pin.errors import ConvergenceError
from stewart_pin.typing import FloatArray

_ACCURACY = 1e-10
"""Residuals and duality gap at which the solver stops; bounds are scaled to about one."""
_NEVER = 1e-14
"""Threshold of ProxQP's infeasibility test that takes nothing for infeasible."""
_PATIENCE = 1_000
"""Most iterations; 15 are usual."""
_ACTIVE = 1e-6
"""Slack below which a bound counts as reached, when the solution is polished."""
_FEASIBLE = 1e-8
_FAR = 1e20
"""What ProxQP reads as no bound."""


def maximise(cost: FloatArray, rows: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Maximise ``cost @ x`` subject to ``lower <= rows @ x <= upper``.

    Parameters
    ----------
    cost
        (n,) objective [any unit].
    rows
        (m, n) constraint rows, of rank n, so that the maximum exists when both sides are bounded [any unit].
    lower, upper
        (m,) bounds, infinite where there is none [any unit].

    Returns
    -------
    numpy.ndarray
        (n,) the maximum, a vertex to round-off where it is unique [any unit].

    Raises
    ------
    ConvergenceError
        If there is none: the bounds contradict each other, or leave the objective free.
    """
    lengths = np.linalg.norm(rows, axis=1)
    lengths[lengths == 0.0] = 1.0
    rows, lower, upper = rows / lengths[:, None], lower / lengths, upper / lengths
    bounds = np.concatenate([lower, upper])
    size = max(float(np.abs(bounds[np.isfinite(bounds)]).max(initial=0.0)), np.finfo(float).tiny)
    lower, upper = lower / size, upper / size
    steep = float(np.linalg.norm(cost)) or 1.0
    x, dual = _proxqp(cost / steep, rows, lower, upper)
    if dual is None or _violation(rows, lower, upper, x) > _FEASIBLE:
        sides, bounds = np.vstack([rows, -rows]), np.concatenate([upper, -lower])
        return greatest(cost, sides, bounds) * size
    return _polish(rows, lower, upper, x, dual, cost / steep) * size


def interior_point(rows: FloatArray, lower: FloatArray, upper: FloatArray) -> tuple[FloatArray, float]:
    """Find the centre of the largest ball in ``lower <= rows @ x <= upper``, be the set solid, flat or empty.

    Parameters
    ----------
    rows
        (m, n) constraint rows, of rank n [any unit].
    lower, upper
        (m,) bounds, infinite where there is none [any unit].

    Returns
    -------
    centre : numpy.ndarray
        (n,) centre of the ball [any unit].
    radius : float
        Its radius; 0 to round-off when the set is flat, negative when it is empty [any unit].
    """
    lengths = np.linalg.norm(rows, axis=1)
    bounds = np.concatenate([lower, upper])
    # Half the distance of two bounds is the most a ball can have; one-sided bounds may leave it free.
    most = float(np.abs(bounds[np.isfinite(bounds)]).max(initial=0.0)) or 1.0
    # rows x + |row| r <= upper, -rows x + |row| r <= -lower, r <= most
    ball = np.vstack([np.c_[rows, lengths], np.c_[-rows, lengths], np.eye(rows.shape[1] + 1)[-1]])
    answer = greatest(np.eye(rows.shape[1] + 1)[-1], ball, np.concatenate([upper, -lower, [most]]))
    return answer[:-1], float(answer[-1])


def greatest(cost: FloatArray, rows: FloatArray, upper: FloatArray) -> FloatArray:
    """Maximise ``cost @ x`` subject to ``rows @ x <= upper``, where the set may have no interior.

    Parameters
    ----------
    cost
        (n,) objective [any unit].
    rows
        (m, n) constraint rows [any unit].
    upper
        (m,) bounds, infinite where there is none [any unit].

    Returns
    -------
    numpy.ndarray
        (n,) a maximum [any unit].

    Raises
    ------
    ConvergenceError
        If there is none.
    """
    there = np.isfinite(upper)
    size = float(np.abs(upper[there]).max(initial=0.0)) or 1.0
    # HiGHS, a simplex method: on sets that round-off leaves 1e-11 thin, ProxQP fails in one case out of 25.
    answer = linprog(
        -cost, A_ub=rows[there], b_ub=upper[there] / size, bounds=(None, None), method="highs-ds"
    )
    if answer.status != 0:
        raise ConvergenceError(
            f"the linear programme was not solved, its limits contradict each other or leave a direction free: "
            f"{answer.message}",
            residual=np.inf,
        )
    return answer.x * size


def _proxqp(
    cost: FloatArray, rows: FloatArray, lower: FloatArray, upper: FloatArray
) -> tuple[FloatArray, FloatArray | None]:
    """Solve a linear programme of unit scale; gives the multipliers as well, or None when it was not solved."""
    n = cost.size
    qp = proxsuite.proxqp.dense.QP(n, 0, rows.shape[0], False, proxsuite.proxqp.dense.HessianType.Zero)
    qp.settings.eps_abs = _ACCURACY
    # Small residuals alone leave 5e-8 of the optimum; with the duality gap it is 3e-10, before polishing.
    qp.settings.check_duality_gap = True
    qp.settings.eps_duality_gap_abs = _ACCURACY
    # With the default settings one feasible linear programme in five is declared infeasible, and with a stricter
    # test still one in 150; without the updates of the penalty by residuals none of thousands is.
    qp.settings.eps_primal_inf = _NEVER
    qp.settings.eps_dual_inf = _NEVER
    qp.settings.bcl_update = False
    qp.settings.max_iter = _PATIENCE
    qp.init(
        np.zeros((n, n)), -cost, np.zeros((0, n)), np.zeros(0),
        rows, np.maximum(lower, -_FAR), np.minimum(upper, _FAR),
    )  # fmt: skip
    qp.solve()
    solved = qp.results.info.status == proxsuite.proxqp.QPSolverOutput.PROXQP_SOLVED
    return qp.results.x, qp.results.z if solved else None


def _violation(rows: FloatArray, lower: FloatArray, upper: FloatArray, x: FloatArray) -> float:
    value = rows @ x
    return float(np.maximum(value - upper, lower - value).max(initial=0.0))


def _polish(
    rows: FloatArray, lower: FloatArray, upper: FloatArray, x: FloatArray, dual: FloatArray, cost: FloatArray
) -> FloatArray:
    """Move onto the bounds that are reached and pushed against, unless that leaves the feasible set."""
    value = rows @ x
    for pushed in (np.abs(dual) > _ACTIVE, np.ones(rows.shape[0], dtype=bool)):
        high = pushed & (upper - value < _ACTIVE)
        low = pushed & (value - lower < _ACTIVE) & ~high
        reached = high | low
        if not reached.any():
            continue
        goal = np.where(high, upper, lower)[reached]
        better = x + np.linalg.lstsq(rows[reached], goal - value[reached], rcond=1e-10)[0]
        # Round-off of the bounds, which are about one; the objective may only fall by what was infeasible before.
        if _violation(rows, lower, upper, better) < 1e-13 and cost @ better > cost @ x - 10 * _ACTIVE:
            return better
    return x
