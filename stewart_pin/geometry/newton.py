"""Newton steps for many small systems at once, from starts that may lie near a singular root."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stewart_pin.typing import FloatArray

Equations = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""(n, k) unknowns to (n, m) residuals and (n, m, k) Jacobians."""

_RANK = 4 * np.finfo(float).eps
"""Singular values below this share of the largest are round-off and take no step."""

_PATIENCE = 5
"""Steps without a smaller residual after which a start is given up."""

_ACROSS = 2
"""Steps across the valley after one along it: their errors are those of the step to the power 4."""


def valley_newton(
    equations: Equations, start: FloatArray, *, max_iterations: int, largest_step: float
) -> FloatArray:
    """Take Newton steps, each followed by a return to the valley floor, and keep the best point.

    An m-fold root lies in a curved valley of small residuals. A step along the valley leaves its floor and so
    enlarges the residual, unless steps across the valley follow. The distance shrinks by 1 - 1/m each time.

    Parameters
    ----------
    equations
        Maps (n, k) unknowns to (n, m) residuals and (n, m, k) Jacobians, row by row.
    start
        (n, k) first guesses, dimensionless: in units that make all unknowns of order one.
    max_iterations
        Steps taken per row, at most.
    largest_step
        Longer steps are shortened to this.

    Returns
    -------
    numpy.ndarray
        (n, k) the unknowns of least residual, dimensionless, the start included.
    """
    x, best = np.array(start), np.array(start)
    residual, jacobian = equations(x)
    least = np.linalg.norm(residual, axis=-1)
    idle = np.zeros(len(x), dtype=int)
    for _ in range(max_iterations):
        if ((idle >= _PATIENCE) | (least <= np.finfo(float).eps)).all():
            break
        step = _step(jacobian, residual)
        length = np.linalg.norm(step, axis=-1, keepdims=True)
        x = x - step * np.minimum(1.0, largest_step / np.where(length > 0.0, length, 1.0))
        x = strong_newton(equations, x, max_iterations=_ACROSS)
        residual, jacobian = equations(x)
        cost = np.linalg.norm(residual, axis=-1)
        best = np.where((cost < least)[:, None], x, best)
        idle = np.where(cost < least, 0, idle + 1)
        least = np.fmin(cost, least)
    return best


def strong_newton(equations: Equations, start: FloatArray, *, max_iterations: int) -> FloatArray:
    """Take Newton steps in all but the weakest direction: to the floor of the valley, not along it.

    Parameters
    ----------
    equations
        Maps (n, k) unknowns to (n, m) residuals and (n, m, k) Jacobians, row by row.
    start
        (n, k) first guesses, dimensionless: in units that make all unknowns of order one.
    max_iterations
        Steps taken per row.

    Returns
    -------
    numpy.ndarray
        (n, k) unknowns, dimensionless.
    """
    x = np.array(start)
    for _ in range(max_iterations):
        residual, jacobian = equations(x)
        x = x - _step(jacobian, residual, drop=1)
    return x


def _step(jacobian: FloatArray, residual: FloatArray, *, drop: int = 0) -> FloatArray:
    """Return the step to subtract, with nothing along directions without rank."""
    u, s, vt = np.linalg.svd(jacobian, full_matrices=False)
    used = s > _RANK * s[:, :1]
    used[:, s.shape[1] - drop :] = False
    weight = np.divide(1.0, s, out=np.zeros_like(s), where=used)
    return np.einsum("nji,nj->ni", vt, weight * np.einsum("nij,ni->nj", u, residual))
