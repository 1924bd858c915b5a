"""Elimination of matrices of expressions by planned pivots, and the systems that it solves."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from stewart_pin.errors import UnsupportedError
from stewart_pin.typing import FloatArray

# ----------------------------------------------------------------------------------------------------
# Which entries an elimination divides by, chosen once, on samples, and then kept
#
# A straight-line program cannot choose pivots by value. Samples of the matrix tell which entries vanish always, which
# entries are safe to divide by, and how far the columns are independent; among safe entries the one that fills in
# least is taken, so that legs are eliminated one by one without being named.
# ----------------------------------------------------------------------------------------------------


ZERO = 1e-11
"""Entries below this, relative to their column before elimination, are round-off at every sample."""
_NOTHING = 1e-9
"""So are those below this, relative to the largest of all: what ill-conditioned loops make of gaps of 1e-12, at which
samples count as closed."""
REGULAR = 1e-2
"""Share of the usual regularity that states have around which pivots are chosen: elsewhere pivots are not larger by
more than its inverse, unless by round-off."""
_SAFE = 0.1
"""Share of the largest entry of its column that a pivot must have at every sample, where some entry has."""


@dataclass(frozen=True, eq=False)
class Pivots:
    """An order of elimination.

    Attributes
    ----------
    places
        (row, column) of each pivot, in order.
    vanishing
        Entries that are zero before elimination though their expressions are not.
    dropped
        For each pivot, the entries that vanish by it in the other rows.
    sizes
        Each pivot's median over the samples, relative to the largest entry of the matrix.
    score
        Smallest pivot relative to the largest entry of its column, over all pivots and samples.
    rows
        Rows that are left over.
    columns
        Columns that depend on the others.
    """

    places: tuple[tuple[int, int], ...]
    vanishing: frozenset[tuple[int, int]]
    dropped: tuple[frozenset[tuple[int, int]], ...]
    sizes: tuple[float, ...]
    score: float
    rows: tuple[int, ...]
    columns: tuple[int, ...]


def plan_pivots(
    values: FloatArray,
    columns: list[int],
    *,
    last_rows: tuple[int, ...] = (),
    nothing: float = _NOTHING,
    rank: int | None = None,
) -> Pivots:
    """Choose pivots.

    Parameters
    ----------
    values
        (samples, m, n) the matrix at samples, rows and columns scaled to equal units, dimensionless.
    columns
        Columns to eliminate.
    last_rows
        Rows to be used only where no other will do.
    nothing
        Size relative to the largest entry below which an entry is round-off; 0 where the system is known to be regular.
    rank
        Number of independent columns, where it is known: what lies beyond is round-off, though it be all there is.

    Returns
    -------
    Pivots
        Order of elimination; entries that vanish at all samples are taken for zero.
    """
    work = values.copy()
    largest = np.abs(values).max(initial=0.0)
    floor = np.maximum(ZERO * np.abs(values).max(axis=(0, 1), initial=0.0), nothing * largest)
    vanishing = _dropped(work, floor)
    rows, left = list(range(values.shape[1])), list(columns)
    choice = _rank(values[:, :, columns]) < len(columns)
    places, dropped, sizes, score = [], [], [], np.inf
    while left and rows and (rank is None or len(places) < rank):
        occupied = np.abs(work).max(axis=0) > 0
        best, quality = _next_pivot(work, occupied, rows, left, set(last_rows), choice=choice)
        if best is None:
            break
        i, j = best
        score = min(score, quality)
        rows.remove(i)
        left.remove(j)
        places.append(best)
        sizes.append(float(np.median(np.abs(work[:, i, j])) / largest))
        for r in rows:
            if occupied[r, j]:
                work[:, r] -= (work[:, r, j] / work[:, i, j])[:, None] * work[:, i]
                work[:, r, j] = 0.0
        dropped.append(_dropped(work, floor))
    return Pivots(
        tuple(places), vanishing, tuple(dropped), tuple(sizes), float(score), tuple(rows), tuple(left)
    )


def _dropped(work: FloatArray, floor: FloatArray) -> frozenset[tuple[int, int]]:
    """Set entries that are nothing at every sample to zero, and say which."""
    gone = np.abs(work).max(axis=0) <= floor
    work[:, gone] = 0.0
    return frozenset((int(r), int(c)) for r, c in zip(*np.nonzero(gone), strict=True))


def _rank(values: FloatArray) -> int:
    if not values.size:
        return 0
    s = np.linalg.svd(values, compute_uv=False)
    return int(np.count_nonzero(s > _NOTHING * s.max(initial=0.0), axis=1).max())


def _next_pivot(
    work: FloatArray,
    occupied: np.ndarray,
    rows: list[int],
    columns: list[int],
    last: set[int],
    *,
    choice: bool,
) -> tuple[tuple[int, int] | None, float]:
    """Among the safe entries the one that fills in least; where none is safe, the safest.

    Where columns are to be left over, a safe entry is not small beside those of other columns either.
    """
    count = occupied[np.ix_(rows, columns)]
    in_row, in_column = count.sum(axis=1), count.sum(axis=0)
    best, chosen, quality = None, (np.inf,) * 4, 0.0
    of_columns = np.abs(work[:, rows][:, :, columns]).max(axis=1)
    of_all = of_columns.max(axis=1)
    for b, j in enumerate(columns):
        largest = of_columns[:, b]
        if not (largest > 0).all():
            continue
        beside = float((largest / of_all).min()) if choice else 1.0
        for a, i in enumerate(rows):
            if not count[a, b]:
                continue
            entry = float((np.abs(work[:, i, j]) / largest).min())
            fill = (in_row[a] - 1) * (in_column[b] - 1)
            safe = min(entry, beside)
            key = (float(i in last), 0.0, fill, -entry) if safe >= _SAFE else (2.0, -safe, fill, 0.0)
            if key < chosen:
                best, chosen, quality = (i, j), key, entry
    return best, quality


# ----------------------------------------------------------------------------------------------------

Rows = list[dict[int, ca.SX]]


class Elimination:
    """A matrix of expressions, reduced by planned pivots; right-hand sides may follow.

    Parameters
    ----------
    matrix
        (m, n) expressions.
    pivots
        Order of elimination.
    scale
        (m, n) by which entries become dimensionless; None where it is not asked what becomes of `nothing`.
    """

    def __init__(self, matrix: ca.SX, pivots: Pivots, scale: FloatArray | None = None) -> None:
        self.pivots = pivots
        self._scale = scale
        self.nothing: list[ca.SX] = []
        """What was taken for zero because it vanishes at all samples, dimensionless."""
        self.rows = rows_of(matrix)
        self.factors: list[list[tuple[int, ca.SX]]] = []
        left = set(range(matrix.shape[0]))
        self._drop(pivots.vanishing)
        for (i, j), dropped in zip(pivots.places, pivots.dropped, strict=True):
            left.discard(i)
            pivot, factors = self.rows[i], []
            for r in sorted(left):
                if j in self.rows[r]:
                    factor = self.rows[r].pop(j) / pivot[j]
                    factors.append((r, factor))
                    for c, entry in pivot.items():
                        if c != j:
                            self.rows[r][c] = self.rows[r].get(c, ca.SX(0)) - factor * entry
            self._drop(dropped)
            self.factors.append(factors)

    def _drop(self, places: frozenset[tuple[int, int]]) -> None:
        for r, c in sorted(places):
            entry = self.rows[r].pop(c, None)
            if entry is not None and self._scale is not None:
                self.nothing.append(entry * float(self._scale[r, c]))

    def pivot_expressions(self) -> list[ca.SX]:
        """List what is divided by.

        Returns
        -------
        list of casadi.SX
            Pivots in their order.
        """
        return [self.rows[i][j] for i, j in self.pivots.places]

    def determinant(self, usual: Callable[[ca.SX], FloatArray]) -> ca.SX:
        """Multiply the pivots, each relative to its usual size: zero at singularities, where the sign changes.

        Parameters
        ----------
        usual
            Gives the (n,) usual sizes of (n, 1) expressions.

        Returns
        -------
        casadi.SX
            (1, 1).
        """
        pivots = self.pivot_expressions()
        if not pivots:
            return ca.SX(1)
        sizes = usual(ca.vertcat(*pivots))
        return functools.reduce(
            lambda x, y: x * y, [p / float(s) for p, s in zip(pivots, sizes, strict=True)]
        )

    def forward(self, right: ca.SX) -> ca.SX:
        """Carry right-hand sides through the elimination.

        Parameters
        ----------
        right
            (m, k) right-hand sides.

        Returns
        -------
        casadi.SX
            (m, k); the rows left over no longer contain the eliminated unknowns.
        """
        right = ca.SX(right)
        for (i, _), factors in zip(self.pivots.places, self.factors, strict=True):
            for r, factor in factors:
                right[r, :] = right[r, :] - factor * right[i, :]
        return right

    def back(self, right: ca.SX, known: dict[int, ca.SX]) -> dict[int, ca.SX]:
        """Find the eliminated unknowns.

        Parameters
        ----------
        right
            (m, k) right-hand sides after `forward`.
        known
            ``{column: (1, k)}`` values of the other unknowns; those that are missing are zero.

        Returns
        -------
        dict
            ``{column: (1, k)}`` values of all unknowns.
        """
        values = dict(known)
        for i, j in reversed(self.pivots.places):
            rest = right[i, :]
            for c, entry in self.rows[i].items():
                if c != j and c in values:
                    rest = rest - entry * values[c]
            values[j] = rest / self.rows[i][j]
        return values

    def solve(self, right: ca.SX) -> ca.SX:
        """Solve the system, where it is square and has all its pivots.

        Parameters
        ----------
        right
            (n, k) right-hand sides.

        Returns
        -------
        casadi.SX
            (n, k).
        """
        found = self.back(self.forward(right), {})
        return ca.vertcat(*(found[k] for k in range(len(found))))

    def transposed(self, right: ca.SX) -> ca.SX:
        """Solve the transposed system with the rows that are left over at zero.

        Parameters
        ----------
        right
            (n, 1) right-hand sides, one for each column; those of dependent columns are not used.

        Returns
        -------
        casadi.SX
            (m, 1) x with ``matrixᵀ x = right``.
        """
        x = ca.SX.zeros(len(self.rows))
        before: list[int] = []
        for i, j in self.pivots.places:
            rest = right[j]
            for r in before:
                if j in self.rows[r]:
                    rest = rest - self.rows[r][j] * x[r]
            x[i] = rest / self.rows[i][j]
            before.append(i)
        # The elimination steps, transposed, in reverse order.
        for (i, _), factors in zip(reversed(self.pivots.places), reversed(self.factors), strict=True):
            for r, factor in factors:
                x[i] = x[i] - factor * x[r]
        return x


def solve_symmetric(
    matrix: ca.SX, right: ca.SX, values: FloatArray
) -> tuple[list[ca.SX], tuple[int, ...], float]:
    """Solve a symmetric system that is positive semidefinite, by L D Lᵀ.

    Parameters
    ----------
    matrix
        (n, n) expressions.
    right
        (n, k) right-hand sides.
    values
        (samples, n, n) the matrix at samples, in equal units, dimensionless.

    Returns
    -------
    solution : list of casadi.SX
        n unknowns, (1, k) each; those without a pivot are zero.
    dropped : tuple of int
        The unknowns without a pivot.
    score : float
        Smallest pivot relative to its diagonal entry before elimination.
    """
    n = matrix.shape[0]
    work, rows = values.copy(), rows_of(matrix)
    scale = np.abs(values).max(axis=(0, 1, 2), initial=0.0)
    start = np.abs(np.einsum("kii->ki", values)).max(axis=0, initial=0.0)
    right, left = ca.SX(right), [k for k in range(n) if start[k] > ZERO * scale]
    dropped = [k for k in range(n) if k not in left]
    places: list[int] = []
    score = np.inf
    while left:
        # Positive definite matrices need no order for their round-off; this one keeps it for rank.
        quality = [float((work[:, k, k] / np.maximum(values[:, k, k], 1e-300)).min()) for k in left]
        best = int(np.argmax(quality)) if min(quality) < ZERO else 0
        if quality[best] < ZERO:
            dropped += left
            break
        k = left.pop(best)
        score = min(score, quality[best])
        places.append(k)
        touched = [r for r in left if k in rows[r]]
        _eliminate_symmetric(rows, right, k, touched)
        for r in touched:
            work[:, r] -= (work[:, r, k] / work[:, k, k])[:, None] * work[:, k]
    solution = [ca.SX.zeros(1, right.shape[1])] * n
    done: list[int] = []
    for k in reversed(places):
        rest = right[k, :]
        for c in done:
            if c in rows[k]:
                rest = rest - rows[k][c] * solution[c]
        solution[k] = rest / rows[k][k]
        done.append(k)
    return solution, tuple(sorted(dropped)), float(score)


def _eliminate_symmetric(rows: Rows, right: ca.SX, k: int, touched: Sequence[int]) -> None:
    """Take row k off the rows that have an entry in its column."""
    for r in touched:
        factor = rows[r][k] / rows[k][k]
        right[r, :] = right[r, :] - factor * right[k, :]
        for c in touched:
            if c >= r:
                rows[r][c] = rows[c][r] = rows[r].get(c, ca.SX(0)) - factor * rows[c][k]


def rows_of(matrix: ca.SX) -> Rows:
    """Split a matrix into rows of the entries that are not zero.

    Parameters
    ----------
    matrix
        (m, n) expressions.

    Returns
    -------
    list of dict
        ``{column: entry}`` for each row.
    """
    rows: Rows = [{} for _ in range(matrix.shape[0])]
    for r in range(matrix.shape[0]):
        for c in range(matrix.shape[1]):
            if not matrix[r, c].is_zero():
                rows[r][c] = matrix[r, c]
    return rows


def eliminate_square(matrix: ca.SX, values: FloatArray, what: str) -> Elimination:
    """Prepare the solution of a square system.

    Parameters
    ----------
    matrix
        (n, n) expressions.
    values
        (samples, n, n) the matrix at samples, in equal units, dimensionless.
    what
        What the system determines, for the message.

    Returns
    -------
    Elimination
        For any right-hand sides.

    Raises
    ------
    UnsupportedError
        If the system is singular at the samples.
    """
    n = matrix.shape[0]
    pivots = plan_pivots(values, list(range(n)), nothing=0.0)
    if len(pivots.places) < n:
        raise UnsupportedError(f"{what} is not determined: {n - len(pivots.places)} freedom(s) are left over")
    return Elimination(matrix, pivots)


def solve_square(matrix: ca.SX, right: ca.SX, values: FloatArray, what: str) -> tuple[ca.SX, float]:
    """Solve a square system.

    Parameters
    ----------
    matrix
        (n, n) expressions.
    right
        (n, k) right-hand sides.
    values
        (samples, n, n) the matrix at samples, in equal units, dimensionless.
    what
        What the system determines, for the message.

    Returns
    -------
    solution : casadi.SX
        (n, k).
    score : float
        Of the pivots.

    Raises
    ------
    UnsupportedError
        If the system is singular at the samples.
    """
    reduced = eliminate_square(matrix, values, what)
    return reduced.solve(right), reduced.pivots.score
