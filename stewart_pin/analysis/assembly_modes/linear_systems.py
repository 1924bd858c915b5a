"""Many small linear systems at once, in double or in extended precision."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

EXTENDED = np.clongdouble
"""Complex numbers with more digits than doubles: 64 bits on x86, 113 on other Linux, none more elsewhere."""


def solve(matrices: NDArray[Any], right: NDArray[Any]) -> NDArray[Any]:
    """Solve linear systems; singular ones give least-squares solutions or entries that are not finite.

    Parameters
    ----------
    matrices
        (n, k, k) coefficients, dimensionless.
    right
        (n, k, m) or (k, m) right-hand sides, dimensionless.

    Returns
    -------
    numpy.ndarray
        (n, k, m) solutions, dimensionless.
    """
    if matrices.dtype == EXTENDED:
        return _eliminate(matrices, right)
    try:
        return np.linalg.solve(matrices, right)
    except np.linalg.LinAlgError:
        return np.linalg.pinv(matrices) @ right


def _eliminate(matrices: NDArray[Any], right: NDArray[Any]) -> NDArray[Any]:
    # LAPACK has no extended precision.
    n, k, _ = matrices.shape
    rows = np.concatenate([matrices, np.broadcast_to(right, (n, *right.shape[-2:]))], axis=2)
    each = np.arange(n)
    for c in range(k):
        pivot = c + np.abs(rows[:, c:, c]).argmax(axis=1)
        rows[each, c], rows[each, pivot] = rows[each, pivot], rows[each, c].copy()
        rows[:, c] /= rows[:, c, c : c + 1]
        others = np.delete(np.arange(k), c)
        rows[:, others] -= rows[:, others, c, None] * rows[:, None, c]
    return rows[:, :, k:]
