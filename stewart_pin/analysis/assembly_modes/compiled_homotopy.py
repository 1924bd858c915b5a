"""The tracker of `homotopy` compiled by numba, path after path: the same steps, ten times as fast.

Imported only when the extra ``compiled`` is installed. A path lives in the affine chart in which its largest
coordinate is one, so a correction costs one 7×7 elimination. `x` is a Study point; `m`, `s` and `q` are the
difference, total and squares of a `StudyPlatform`; `r` are the five quaternions e P_i - B_i e, `g` the
half-gradients.
"""

from __future__ import annotations

import numpy as np
from numba import njit  # pyright: ignore[reportMissingModuleSource]

from stewart_pin.analysis.assembly_modes.homotopy import LOST, MAX_REFUSALS, SHARE, Tracked, TrackerSettings
from stewart_pin.analysis.assembly_modes.study import (
    BEYOND_DOUBLES,
    CLOSE,
    CONVERGED,
    NEAR,
    NO_NORM,
    NO_ROTATION_PART,
    ROUND_OFF,
    ComplexArray,
    StudyPlatform,
)

# Fused multiply-add, no signed zeros; NaN and infinity keep their meaning: the refusal of a step needs them.
_jit = njit(cache=True, fastmath={"contract", "nsz"}, error_model="numpy")


def track(
    start: StudyPlatform, target: StudyPlatform, points: ComplexArray, settings: TrackerSettings
) -> Tracked:
    """Follow solutions of one platform to another along the straight line between their parameters.

    Parameters
    ----------
    start, target
        The two ends.
    points
        (n, 8) solutions of `start`.
    settings
        How carefully.

    Returns
    -------
    Tracked
        In the order of `points`.
    """
    ends = [
        np.ascontiguousarray(a, dtype=complex)
        for end in (start, target)
        for a in (end.difference, end.total, end.squares)
    ]
    moving = not (np.array_equal(ends[0], ends[3]) and np.array_equal(ends[1], ends[4]))
    numbers = (settings.contraction, settings.largest_error, settings.reach, settings.least_tau)
    x = np.array(points, dtype=complex, order="C")
    tau, steps, infinite = _track_all(*ends, moving, x, settings.order, numbers, settings.max_steps)
    return Tracked(x, tau, steps, infinite)


@_jit
def _operator(m, s, i, a, b, c, d):
    """Apply M_i: e P_i - B_i e for a quaternion (a; b, c, d)."""
    return (
        -(m[i, 0] * b + m[i, 1] * c + m[i, 2] * d),
        a * m[i, 0] + c * s[i, 2] - d * s[i, 1],
        a * m[i, 1] + d * s[i, 0] - b * s[i, 2],
        a * m[i, 2] + b * s[i, 1] - c * s[i, 0],
    )


@_jit
def _half_gradient(m, s, q, x, g, r):
    for c in range(4):
        g[0, c], g[0, 4 + c] = -q[0] * x[c], x[4 + c]
        g[6, c], g[6, 4 + c] = 0.5 * x[4 + c], 0.5 * x[c]
    for i in range(5):
        a0, a1, a2, a3 = _operator(m, s, i, x[0], x[1], x[2], x[3])
        r[i, 0], r[i, 1], r[i, 2], r[i, 3] = a0, a1, a2, a3
        b0, b1, b2, b3 = _operator(m, s, i, a0 + x[4], a1 + x[5], a2 + x[6], a3 + x[7])
        k = i + 1
        g[k, 0], g[k, 1] = -b0 - q[k] * x[0], -b1 - q[k] * x[1]
        g[k, 2], g[k, 3] = -b2 - q[k] * x[2], -b3 - q[k] * x[3]
        g[k, 4], g[k, 5], g[k, 6], g[k, 7] = a0, a1, a2, a3


@_jit
def _factor(g, k, lu, pivots):
    """Eliminate all columns of `g` but `k`; the diagonal keeps reciprocals."""
    for r in range(7):
        for c in range(7):
            lu[r, c] = g[r, c if c < k else c + 1]
    for c in range(7):
        best, p = -1.0, c
        for r in range(c, 7):
            size = abs(lu[r, c].real) + abs(lu[r, c].imag)
            if size > best:
                best, p = size, r
        pivots[c] = p
        if not best > 0.0:
            return False
        if p != c:
            for j in range(7):
                lu[c, j], lu[p, j] = lu[p, j], lu[c, j]
        z = lu[c, c]
        weight = 1.0 / (z.real * z.real + z.imag * z.imag)
        reciprocal = complex(z.real * weight, -z.imag * weight)
        lu[c, c] = reciprocal
        for r in range(c + 1, 7):
            f = lu[r, c] * reciprocal
            lu[r, c] = f
            for j in range(c + 1, 7):
                lu[r, j] -= f * lu[c, j]
    return True


@_jit
def _solve(lu, pivots, b):
    for c in range(7):
        p = pivots[c]
        b[c], b[p] = b[p], b[c]
    for r in range(1, 7):
        value = b[r]
        for j in range(r):
            value -= lu[r, j] * b[j]
        b[r] = value
    for r in range(6, -1, -1):
        value = b[r]
        for j in range(r + 1, 7):
            value -= lu[r, j] * b[j]
        b[r] = value * lu[r, r]


@_jit
def _parts(x):
    """Compute the squared norms of the rotation and of the translation part."""
    e, h = 0.0, 0.0
    for c in range(4):
        e += x[c].real ** 2 + x[c].imag ** 2
        h += x[4 + c].real ** 2 + x[4 + c].imag ** 2
    return e, h


@_jit
def _newton(m, s, q, x, k, g, r, lu, pivots, b):
    """Correct `x` in place; return the size of the correction, each part measured by its own."""
    _half_gradient(m, s, q, x, g, r)
    for i in range(7):
        value = 0j
        for c in range(8):
            value += g[i, c] * x[c]
        b[i] = -0.5 * value
    if not _factor(g, k, lu, pivots):
        return np.inf
    _solve(lu, pivots, b)
    e, h = _parts(x)
    turn, shift = 0.0, 0.0
    for i in range(7):
        c = i if i < k else i + 1
        x[c] += b[i]
        if c < 4:
            turn += b[i].real ** 2 + b[i].imag ** 2
        else:
            shift += b[i].real ** 2 + b[i].imag ** 2
    return np.sqrt(turn / e + shift / h)


@_jit
def _to_chart(x):
    """Scale so that the largest coordinate is one; return its index."""
    k, best = 0, -1.0
    for c in range(8):
        size = x[c].real ** 2 + x[c].imag ** 2
        if size > best:
            k, best = c, size
    factor = x[k].conjugate() / best
    for c in range(8):
        x[c] *= factor
    x[k] = 1.0
    return k


@_jit
def _fits_chart(x):
    """Tell whether no coordinate has outgrown the one that is kept at one."""
    for c in range(8):  # noqa: SIM110 - numba compiles no generator expressions
        if x[c].real ** 2 + x[c].imag ** 2 > 4.0:
            return False
    return True


@_jit
def _expand(m, s, q, m1, s1, q1, moving, k, order, x, r, lu, pivots, b):
    """Fill x[1:] and r[1:] with the Taylor coefficients in τ - τ_new."""
    for j in range(1, order + 1):
        study, square, square1, shift = 0j, 0j, 0j, 0j
        for a in range(1, j):
            for c in range(4):
                study += x[a, c] * x[j - a, 4 + c]
                square += x[a, c] * x[j - a, c]
                shift += x[a, 4 + c] * x[j - a, 4 + c]
        for a in range(j):
            for c in range(4):
                square1 += x[a, c] * x[j - 1 - a, c]
        b[6] = -0.5 * study
        b[0] = -0.5 * (shift - q[0] * square - q1[0] * square1)
        for i in range(5):
            total = -q[i + 1] * square - q1[i + 1] * square1
            for a in range(1, j):
                for c in range(4):
                    total += (2.0 * x[a, 4 + c] + r[a, i, c]) * r[j - a, i, c]
            if moving:
                v0, v1, v2, v3 = _operator(m1, s1, i, x[j - 1, 0], x[j - 1, 1], x[j - 1, 2], x[j - 1, 3])
                r[j, i, 0], r[j, i, 1], r[j, i, 2], r[j, i, 3] = v0, v1, v2, v3
                total += 2.0 * ((r[0, i, 0] + x[0, 4]) * v0 + (r[0, i, 1] + x[0, 5]) * v1)
                total += 2.0 * ((r[0, i, 2] + x[0, 6]) * v2 + (r[0, i, 3] + x[0, 7]) * v3)
            b[i + 1] = -0.5 * total
        _solve(lu, pivots, b)
        x[j, k] = 0j
        for c in range(7):
            x[j, c if c < k else c + 1] = b[c]
        if j == order:
            return
        for i in range(5):
            v0, v1, v2, v3 = _operator(m, s, i, x[j, 0], x[j, 1], x[j, 2], x[j, 3])
            if moving:
                v0, v1, v2, v3 = v0 + r[j, i, 0], v1 + r[j, i, 1], v2 + r[j, i, 2], v3 + r[j, i, 3]
            r[j, i, 0], r[j, i, 1], r[j, i, 2], r[j, i, 3] = v0, v1, v2, v3


@_jit
def _tail(x, order):
    """Measure the last two coefficients, and fit one complex ratio to them."""
    e, h = _parts(x[0])
    e1, h1 = _parts(x[order])
    e2, h2 = _parts(x[order - 1])
    last, before = np.sqrt(e1 / e + h1 / h) + 1e-300, np.sqrt(e2 / e + h2 / h) + 1e-300
    ratio = 0j
    for c in range(4):
        ratio += x[order - 1, c].conjugate() * x[order, c] / e
        ratio += x[order - 1, 4 + c].conjugate() * x[order, 4 + c] / h
    return last, before, ratio / before**2


@_jit
def _predict(x, order, ratio, length, y):
    """Sum the series at `length`, its tail as a geometric one."""
    tail = 1.0 / (1.0 - ratio * length)
    for c in range(8):
        value = x[order, c] * tail
        for j in range(order - 1, -1, -1):
            value = value * length + x[j, c]
        y[c] = value


@_jit
def _relative_norm(x):
    """Compute |⟨e, e⟩| over the squared norm of the point."""
    e, h = _parts(x)
    return abs(x[0] * x[0] + x[1] * x[1] + x[2] * x[2] + x[3] * x[3]) / (e + h)


@_jit
def _round_off(x):
    norm = _relative_norm(x)
    if norm < CLOSE[1]:
        return ROUND_OFF[2]
    return ROUND_OFF[1] if norm < CLOSE[0] else ROUND_OFF[0]


@_jit
def _foresees_infinity(x, y):
    """Tell whether a path through `x` whose series ends at `y` goes to infinity."""
    e, h = _parts(x)
    e0, h0 = _parts(y)
    if not 0.25 * h < h0 < 4.0 * h:
        return False
    shrinks, norm, norm0 = e0 * h / (e * h0), _relative_norm(x), _relative_norm(y)
    return (
        (e0 < NO_ROTATION_PART[0] * h0 and shrinks < NO_ROTATION_PART[1])
        or (norm0 < NO_NORM[0] and norm0 < NO_NORM[1] * shrinks**2 * norm)
        or (norm0 < BEYOND_DOUBLES[0] and norm0 < BEYOND_DOUBLES[1] * norm)
    )


@_jit
def _place(mt, st, qt, m1, s1, q1, moving, tau, m, s, q):
    """Set the parameters at `tau`."""
    if moving:
        for i in range(5):
            for c in range(3):
                m[i, c] = mt[i, c] - tau * m1[i, c]
                s[i, c] = st[i, c] - tau * s1[i, c]
    for i in range(6):
        q[i] = qt[i] - tau * q1[i]


@_jit
def _track_all(ms, ss, qs, mt, st, qt, moving, points, order, numbers, max_steps):
    """Follow every path; overwrite `points` by where they ended."""
    contraction, largest_error, reach, least_tau = numbers
    n = points.shape[0]
    taus, counts, infinite = np.ones(n), np.zeros(n, np.int64), np.zeros(n, np.bool_)
    m1, s1, q1 = mt - ms, st - ss, qt - qs
    m, s, q = ms.copy(), ss.copy(), qs.copy()
    g, lu = np.empty((7, 8), np.complex128), np.empty((7, 7), np.complex128)
    pivots, b = np.empty(7, np.int64), np.empty(7, np.complex128)
    x, r = np.zeros((order + 1, 8), np.complex128), np.zeros((order + 1, 5, 4), np.complex128)
    y = np.empty(8, np.complex128)
    for path in range(n):
        x[0] = points[path]
        k = _to_chart(x[0])
        tau, curvature, scale, cap, steps, refusals = 1.0, 2.0, 1.0, 1.0, 0, 0
        wait, backoff = 0, 1
        last, growth, ratio, factored = 0.0, 0.0, 0j, False
        while tau >= least_tau and refusals < MAX_REFUSALS and steps <= max_steps:
            if refusals == 0:
                _place(mt, st, qt, m1, s1, q1, moving, tau, m, s, q)
                _half_gradient(m, s, q, x[0], g, r[0])
                near = _relative_norm(x[0]) < NEAR
                # The factors of the last correction belong to a point next to this one: good to predict a step.
                if (near or not factored) and not _factor(g, k, lu, pivots):
                    break
                _expand(m, s, q, m1, s1, q1, moving, k, order, x, r, lu, pivots, b)
                last, before, ratio = _tail(x, order)
                growth = last / before
                if near and last * tau**order < CONVERGED:
                    _predict(x, order, ratio, tau, y)
                    if _foresees_infinity(x[0], y):
                        infinite[path] = True
                        break
            aim = min(largest_error, contraction / curvature)
            length = (aim / (scale * last * growth)) ** (1.0 / (order + 1))
            length = min(length, reach / growth, cap)
            if wait > 0:
                length = min(length, SHARE * tau)
            arrives = not length < tau
            length, tau_new = (tau, 0.0) if arrives else (length, tau - length)
            _predict(x, order, ratio, length, y)
            _place(mt, st, qt, m1, s1, q1, moving, tau_new, m, s, q)
            first = _newton(m, s, q, y, k, g, r[0], lu, pivots, b)
            second = _newton(m, s, q, y, k, g, r[0], lu, pivots, b) if first < np.inf else np.inf
            steps += 1
            floor = _round_off(y)
            predicted = max(scale * last * growth * length ** (order + 1), 1e-300)
            observed = second / max(first, 1e-300) ** 2
            if not (first > 1e-7 and second < np.inf):
                observed = curvature
            good = first < 5.0 * largest_error and second <= max(2.0 * contraction * first, floor)
            good = good and observed * second * second < floor
            if arrives and not good:
                # The end may be singular, which tells nothing about the way there.
                wait, backoff, cap, refusals = backoff, 2 * backoff, SHARE * tau, refusals + 1
                continue
            curvature = min(max(observed, 0.5 * curvature, 0.5), 1e6)
            growth_of_error = min(max(first / predicted, 0.2), 5.0) if first < np.inf else 5.0
            scale = min(max(scale * growth_of_error, 1e-3), 1e3)
            if good:
                x[0], tau, cap, refusals, wait = y, tau_new, 1.0, 0, wait - 1
                factored = _fits_chart(x[0])
                if not factored:
                    k = _to_chart(x[0])
            else:
                cap, refusals = 0.4 * length, refusals + 1
                if tau < LOST[0] and length < LOST[1] * tau and _relative_norm(x[0]) < CLOSE[0]:
                    break
        if tau == 0.0:
            _place(mt, st, qt, m1, s1, q1, moving, 0.0, m, s, q)
            for _ in range(2):
                _newton(m, s, q, x[0], k, g, r[0], lu, pivots, b)
        e, h = _parts(x[0])
        points[path] = x[0] / np.sqrt(e + h)
        taus[path], counts[path] = tau, steps
    return taus, counts, infinite
