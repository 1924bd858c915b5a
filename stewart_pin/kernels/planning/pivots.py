"""Which entries an elimination divides by, chosen once, on samples, and then kept.

A straight-line program cannot choose pivots by value. Samples of the matrix tell which entries vanish always, which
entries are safe to divide by, and how far the columns are independent; among safe entries the one that fills in
least is taken, so that legs are eliminated one by one without being named.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stewart_pin.typing import FloatArray

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
