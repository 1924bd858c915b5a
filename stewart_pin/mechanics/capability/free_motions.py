"""Which limits still bind a motion where others are free to compensate for it: idle spins, a redundant arm's inside.

With y = K f a motion that does not count, limits ``rows @ y <= bounds`` are to be projected along f. A limit that some
f relaxes without tightening another one binds nothing, for that f may be as large as it likes; by the theorem of Tucker
these are the limits that take part in no λ ≥ 0 with λᵀ rows K = 0. Those that stay are constant along every f that they
let go on for ever, so that what they leave is bounded across these f.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from stewart_pin.errors import ConvergenceError
from stewart_pin.tolerances import SINGULAR, TAKES_PART
from stewart_pin.typing import FloatArray

_FARTHEST = 1 / SINGULAR
"""How far a compensating motion may go for a limit to be let off by one: what needs more leans on round-off."""
_LET_OFF = 0.5
"""Amount, of one, by which a limit has to be let off to count as such."""


def binding_limits(
    rows: FloatArray, lower: FloatArray, upper: FloatArray, free: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Drop the limits that motions which do not count can always keep.

    Parameters
    ----------
    rows
        (m, k) rows of the limits, of natural size [any unit].
    lower, upper
        (m,) bounds, infinite where there is none; the lower one is nowhere above the upper one [any unit].
    free
        (k, n) orthonormal basis of the motions that do not count [dimensionless].

    Returns
    -------
    lower : numpy.ndarray
        (m,) bounds, infinite where none binds [any unit].
    upper : numpy.ndarray
        (m,) the same [any unit].

    Raises
    ------
    ConvergenceError
        If the linear programme that tells them apart was not solved.
    """
    lower, upper = lower.copy(), upper.copy()
    along = rows @ free
    sizes = np.linalg.norm(along, axis=1)
    moved = np.flatnonzero(sizes > TAKES_PART * np.linalg.norm(rows, axis=1).max(initial=0.0))
    along = along[moved] / sizes[moved, None]
    while True:
        stated = np.isfinite(lower[moved]) | np.isfinite(upper[moved])
        moved, along = moved[stated], along[stated]
        high, low = np.isfinite(upper[moved]), np.isfinite(lower[moved])
        off = _off(np.vstack([along[high], -along[low]]))
        off_high, off_low = off[: np.count_nonzero(high)], off[np.count_nonzero(high) :]
        alone = _alone(along)
        if not (off.any() or alone.any()):
            return lower, upper
        upper[moved[high][off_high]], lower[moved[low][off_low]] = np.inf, -np.inf
        upper[moved[alone]], lower[moved[alone]] = np.inf, -np.inf


def _alone(along: FloatArray) -> np.ndarray:
    """Rows that no others make up: some motion meets any value of such a row and leaves the others as they are."""
    u, s, _ = np.linalg.svd(along)
    dependent = u[:, np.count_nonzero(s > SINGULAR) :]
    return np.linalg.norm(dependent, axis=1) < SINGULAR


def _off(sides: FloatArray) -> np.ndarray:
    """Sides ``sides @ f <= bound`` that some f lets off without tightening another."""
    m, n = sides.shape
    if m == 0:
        return np.zeros(0, dtype=bool)
    # sides f + t <= 0 with 0 <= t <= 1: such motions add up, so that the largest sum of t shows all at once.
    answer = linprog(
        np.r_[np.zeros(n), -np.ones(m)],
        A_ub=np.c_[sides, np.eye(m)],
        b_ub=np.zeros(m),
        bounds=[(-_FARTHEST, _FARTHEST)] * n + [(0.0, 1.0)] * m,
        method="highs-ds",
    )
    if answer.status != 0:
        raise ConvergenceError(
            f"the limits that bind the platform could not be told from those that do not: {answer.message}",
            residual=np.inf,
        )
    return answer.x[n:] > _LET_OFF
