"""Efforts of many states within limits, compiled by numba: a dual active-set method in the efforts that move nothing.

Imported only when the extra ``compiled`` is installed. With x₀ the efforts that are wanted, Z an orthonormal basis of
what motors may do against each other, and y their coordinates, the programme is the least-distance one: min y² with
limits on x₀ + Z y. Goldfarb and Idnani [1]_: from y = 0 the limit that is passed most is taken in, and one that has
come to pull the wrong way is let go, until none is passed; each exchange makes y² larger, so that no choice comes
twice.

References
----------
.. [1] D. Goldfarb, A. Idnani, "A numerically stable dual method for solving strictly convex quadratic programs",
       Mathematical Programming 27, 1983.
"""

from __future__ import annotations

import numpy as np
from numba import njit  # pyright: ignore[reportMissingModuleSource]

OK, NONE, LOST = 0, 1, 2
"""What becomes of a state: efforts are found; there are none; exchanges came to no end."""

_EXACT = 1e-12
"""Excess over a limit that is round-off, relative to efforts and limits."""
_EXCEEDED = 1e-9
"""Excess up to which a limit that cannot be kept counts as kept: round-off of a state, as for the verb of one state."""
_SAME = 1e-11
"""Sine of an angle below which the direction of a limit lies in those of others."""

_jit = njit(cache=True, nogil=True, error_model="numpy")


@_jit
def _reflected(work, k, norm, beta):
    """Reflect column k to its head, and those after it alike: a step of Householder."""
    nu, d = work.shape
    head = work[k, k]
    alpha = -norm if head > 0 else norm
    work[k, k] = head - alpha
    beta[k] = -1.0 / (alpha * work[k, k])
    for j in range(k + 1, d):
        s = 0.0
        for i in range(k, nu):
            s += work[i, k] * work[i, j]
        s *= beta[k]
        for i in range(k, nu):
            work[i, j] -= s * work[i, k]


@_jit
def _next_column(work, k):
    """Bring the column with most left of it to place k; its length below."""
    nu, d = work.shape
    best, size = k, -1.0
    for j in range(k, d):
        s = 0.0
        for i in range(k, nu):
            s += work[i, j] * work[i, j]
        if s > size:
            best, size = j, s
    if best != k:
        for i in range(nu):
            work[i, k], work[i, best] = work[i, best], work[i, k]
    return np.sqrt(size)


@_jit
def _null_basis(share, rank, work, beta, Z):
    """Fill Z (nu, r) with an orthonormal basis of the null space of share (d, nu), of known rank."""
    d, nu = share.shape
    for i in range(nu):
        for j in range(d):
            work[i, j] = share[j, i]
    for k in range(rank):
        norm = _next_column(work, k)
        beta[k] = 0.0
        if norm > 0.0:
            _reflected(work, k, norm, beta)
    for c in range(nu - rank):
        for i in range(nu):
            Z[i, c] = 0.0
        Z[rank + c, c] = 1.0
        for k in range(rank - 1, -1, -1):
            s = 0.0
            for i in range(k, nu):
                s += work[i, k] * Z[i, c]
            s *= beta[k]
            for i in range(k, nu):
                Z[i, c] -= s * work[i, k]


@_jit
def _factor(Z, held, sense, count, Q, R):
    """Factor the directions of the limits that hold: column j of them is Q R[:, j]; Gram and Schmidt, twice."""
    r = Z.shape[1]
    for j in range(count):
        for i in range(r):
            Q[i, j] = sense[j] * Z[held[j], i]
        for k in range(j):
            R[k, j] = 0.0
        for _ in range(2):
            for k in range(j):
                s = 0.0
                for i in range(r):
                    s += Q[i, k] * Q[i, j]
                R[k, j] += s
                for i in range(r):
                    Q[i, j] -= s * Q[i, k]
        s = 0.0
        for i in range(r):
            s += Q[i, j] * Q[i, j]
        R[j, j] = np.sqrt(s)
        for i in range(r):
            Q[i, j] /= R[j, j]


@_jit
def _place(start, Z, y, x):
    """Fill x = start + Z y."""
    for i in range(len(start)):
        x[i] = start[i]
        for c in range(len(y)):
            x[i] += Z[i, c] * y[c]


@_jit
def _most_passed(x, lower, upper, least, held, count):
    """Find the limit that is passed most, by more than some, with one for a lower and minus one for an upper."""
    worst, sign = -1, 1.0
    for i in range(len(x)):
        taken = False
        for j in range(count):
            taken = taken or held[j] == i
        if taken:
            continue
        if lower[i] - x[i] > least:
            worst, least, sign = i, lower[i] - x[i], 1.0
        if x[i] - upper[i] > least:
            worst, least, sign = i, x[i] - upper[i], -1.0
    return worst, sign


@_jit
def _split(normal, Q, R, count, direction, step):
    """Split a normal into what lies in those that hold, with which weights, and what is left; its square, relative."""
    r, own, left = len(normal), 0.0, 0.0
    for i in range(r):
        direction[i] = normal[i]
        own += normal[i] * normal[i]
    for j in range(count):
        step[j] = 0.0
        for i in range(r):
            step[j] += Q[i, j] * normal[i]
    for _ in range(2):
        for j in range(count):
            s = 0.0
            for i in range(r):
                s += Q[i, j] * direction[i]
            for i in range(r):
                direction[i] -= s * Q[i, j]
    for i in range(r):
        left += direction[i] * direction[i]
    for j in range(count - 1, -1, -1):
        for k in range(j + 1, count):
            step[j] -= R[j, k] * step[k]
        step[j] /= R[j, j]
    return left if own > _EXACT * _EXACT and left > _SAME * _SAME * own else 0.0


@_jit
def _take_in(worst, sign, bound, Z, limits, y, normal, direction, Q, R):
    """Take in a limit, and let go of those that come to pull the wrong way; how many hold then, or -1: it cannot be."""
    held, sense, push, step, count = limits
    r, new = len(y), 0.0
    for i in range(r):
        normal[i] = sign * Z[worst, i]
    while True:
        _factor(Z, held, sense, count, Q, R)
        left = _split(normal, Q, R, count, direction, step)
        gap = bound
        for i in range(r):
            gap -= normal[i] * y[i]
        # How far until a limit that holds pulls the wrong way, and until the new one is kept.
        go, drop = np.inf, -1
        for j in range(count):
            if step[j] > _SAME and push[j] < go * step[j]:
                go, drop = push[j] / step[j], j
        whole = gap / left if left > 0.0 else np.inf
        if whole == np.inf and drop < 0:
            return -1, gap
        far = min(whole, go)
        if whole < np.inf:
            for i in range(r):
                y[i] += far * direction[i]
        for j in range(count):
            push[j] -= far * step[j]
        new += far
        if whole <= go:
            held[count], sense[count], push[count] = worst, sign, new
            return count + 1, gap
        for j in range(drop, count - 1):
            held[j], sense[j], push[j] = held[j + 1], sense[j + 1], push[j + 1]
        count -= 1


@_jit
def _settle(start, Z, lower, upper, limits, y, x, Q, R):
    """Solve once more from the limits that hold, so that no exchange has left its round-off."""
    held, sense, _, step, count = limits
    _factor(Z, held, sense, count, Q, R)
    y[:] = 0.0
    for j in range(count):
        k = held[j]
        step[j] = sense[j] * ((lower[k] if sense[j] > 0 else upper[k]) - start[k])
        for i in range(j):
            step[j] -= R[i, j] * step[i]
        step[j] /= R[j, j]
        for i in range(len(y)):
            y[i] += step[j] * Q[i, j]
    _place(start, Z, y, x)
    for j in range(count):
        x[held[j]] = lower[held[j]] if sense[j] > 0 else upper[held[j]]
    for i in range(len(x)):
        x[i] = min(max(x[i], lower[i]), upper[i])


@_jit
def _share_one(start, Z, lower, upper, scale, x, limits, vectors, Q, R):
    """Fill x with the efforts nearest to start within limits."""
    held, sense, push, step = limits
    y, normal, direction = vectors
    count = 0
    y[:] = 0.0
    for _ in range(20 * (Z.size + 1)):
        _place(start, Z, y, x)
        worst, sign = _most_passed(x, lower, upper, _EXACT * scale, held, count)
        if worst < 0:
            _settle(start, Z, lower, upper, (held, sense, push, step, count), y, x, Q, R)
            return OK
        bound = sign * ((lower[worst] if sign > 0 else upper[worst]) - start[worst])
        count, gap = _take_in(
            worst, sign, bound, Z, (held, sense, push, step, count), y, normal, direction, Q, R
        )
        if count < 0:
            return NONE if gap > _EXCEEDED * scale else LOST
    return LOST


@_jit
def share_all(share, tau, sizes, lower, upper, middle, rank, begin, end, codes) -> None:
    """Replace least efforts by those within limits, state by state.

    Parameters
    ----------
    share
        (N, d, nu) contribution of efforts in natural units, dimensionless.
    tau
        (N, nu) least efforts, to be replaced; states that are nan, or lost, are left [N or N m].
    sizes
        (nu,) by which efforts come to natural units [m or 1].
    lower, upper
        (nu,) limits in natural units [N m].
    middle
        (nu,) the efforts that are wanted, in natural units [N m].
    rank
        Independent ways in which the motors move.
    begin, end
        Range of states [index].
    codes
        (N,) int8 to write to what became of each, dimensionless.
    """
    d, nu = share.shape[1:]
    r = nu - rank
    work, beta, Z = np.empty((nu, d)), np.empty(rank), np.empty((nu, r))
    start, x = np.empty(nu), np.empty(nu)
    vectors = np.empty(r), np.empty(r), np.empty(r)
    limits = np.empty(nu, np.int64), np.empty(nu), np.empty(nu), np.empty(nu)
    Q, R = np.empty((r, r + 1)), np.empty((r + 1, r + 1))
    largest = 0.0
    for i in range(nu):
        for bound in (lower[i], upper[i]):
            if np.isfinite(bound):
                largest = max(largest, abs(bound))
    for n in range(begin, end):
        codes[n] = OK
        if not np.isfinite(tau[n].sum()):
            continue
        _null_basis(share[n], rank, work, beta, Z)
        scale = largest
        for i in range(nu):
            start[i] = tau[n, i] * sizes[i]
        for c in range(r):
            s = 0.0
            for i in range(nu):
                s += Z[i, c] * middle[i]
            for i in range(nu):
                start[i] += Z[i, c] * s
        for i in range(nu):
            scale = max(scale, abs(start[i]))
        codes[n] = _share_one(start, Z, lower, upper, scale, x, limits, vectors, Q, R)
        if codes[n] == LOST:
            continue
        for i in range(nu):
            tau[n, i] = x[i] / sizes[i] if codes[n] == OK else np.nan
