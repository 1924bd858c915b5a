"""The tracker of `homotopy` compiled by numba, path after path: the same steps, ten times as fast.

Imported only when the extra ``fast`` is installed. A path lives in the affine chart in which its largest
coordinate is one, so a correction costs one 7×7 elimination. `x` is a Study point, `m` and `s` are platform minus
and plus base points, `q` squared lengths; `d` are the six leg quaternions, `g` the half-gradients.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from stewart_pin.analysis.assembly_modes.homotopy import MAX_REFUSALS, ROUND_OFF, Tracked, TrackerSettings
from stewart_pin.analysis.assembly_modes.study import ComplexArray, StudyPlatform

# Fused multiply-add and no signed zeros; NaN and infinity keep their meaning, the refusal of a step needs them.
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
    tau, steps = _track_all(*ends, moving, x, settings.order, numbers, settings.max_steps)
    return Tracked(x, tau, steps)


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
def _half_gradient(m, s, q, x, g, d):
    for i in range(6):
        a0, a1, a2, a3 = _operator(m, s, i, x[0], x[1], x[2], x[3])
        a0, a1, a2, a3 = a0 + x[4], a1 + x[5], a2 + x[6], a3 + x[7]
        d[i, 0], d[i, 1], d[i, 2], d[i, 3] = a0, a1, a2, a3
        b0, b1, b2, b3 = _operator(m, s, i, a0, a1, a2, a3)
        g[i, 0], g[i, 1] = -b0 - q[i] * x[0], -b1 - q[i] * x[1]
        g[i, 2], g[i, 3] = -b2 - q[i] * x[2], -b3 - q[i] * x[3]
        g[i, 4], g[i, 5], g[i, 6], g[i, 7] = a0, a1, a2, a3
    for c in range(4):
        g[6, c], g[6, 4 + c] = 0.5 * x[4 + c], 0.5 * x[c]


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
def _newton(m, s, q, x, k, g, d, lu, pivots, b):
    """Correct `x` in place; return the size of the correction."""
    _half_gradient(m, s, q, x, g, d)
    for r in range(7):
        value = 0j
        for c in range(8):
            value += g[r, c] * x[c]
        b[r] = -0.5 * value
    if not _factor(g, k, lu, pivots):
        return np.inf
    _solve(lu, pivots, b)
    size = 0.0
    for c in range(7):
        x[c if c < k else c + 1] += b[c]
        size += b[c].real ** 2 + b[c].imag ** 2
    return np.sqrt(size)


@_jit
def _norm(x):
    size = 0.0
    for c in range(8):
        size += x[c].real ** 2 + x[c].imag ** 2
    return np.sqrt(size)


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
def _expand(m, s, q, m1, s1, q1, moving, k, order, x, d, lu, pivots, b):
    """Fill x[1:] and d[1:] with the Taylor coefficients in τ - τ_new of the path and of its leg quaternions."""
    for j in range(1, order + 1):
        study, square, square1 = 0j, 0j, 0j
        for a in range(1, j):
            for c in range(4):
                study += x[a, c] * x[j - a, 4 + c]
                square += x[a, c] * x[j - a, c]
        for a in range(j):
            for c in range(4):
                square1 += x[a, c] * x[j - 1 - a, c]
        b[6] = -0.5 * study
        for i in range(6):
            total = -q[i] * square - q1[i] * square1
            for a in range(1, j):
                for c in range(4):
                    total += d[a, i, c] * d[j - a, i, c]
            if moving:
                v0, v1, v2, v3 = _operator(m1, s1, i, x[j - 1, 0], x[j - 1, 1], x[j - 1, 2], x[j - 1, 3])
                d[j, i, 0], d[j, i, 1], d[j, i, 2], d[j, i, 3] = v0, v1, v2, v3
                total += 2.0 * (d[0, i, 0] * v0 + d[0, i, 1] * v1 + d[0, i, 2] * v2 + d[0, i, 3] * v3)
            b[i] = -0.5 * total
        _solve(lu, pivots, b)
        x[j, k] = 0j
        for c in range(7):
            x[j, c if c < k else c + 1] = b[c]
        if j == order:
            return
        for i in range(6):
            v0, v1, v2, v3 = _operator(m, s, i, x[j, 0], x[j, 1], x[j, 2], x[j, 3])
            v0, v1, v2, v3 = v0 + x[j, 4], v1 + x[j, 5], v2 + x[j, 6], v3 + x[j, 7]
            if moving:
                v0, v1, v2, v3 = v0 + d[j, i, 0], v1 + d[j, i, 1], v2 + d[j, i, 2], v3 + d[j, i, 3]
            d[j, i, 0], d[j, i, 1], d[j, i, 2], d[j, i, 3] = v0, v1, v2, v3


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
def _place(mt, st, qt, m1, s1, q1, moving, tau, m, s, q):
    """Set the parameters at `tau`."""
    for i in range(6):
        if moving:
            for c in range(3):
                m[i, c] = mt[i, c] - tau * m1[i, c]
                s[i, c] = st[i, c] - tau * s1[i, c]
        q[i] = qt[i] - tau * q1[i]


@_jit
def _track_all(ms, ss, qs, mt, st, qt, moving, points, order, numbers, max_steps):
    """Follow every path; overwrite `points` by where they ended."""
    contraction, largest_error, reach, least_tau = numbers
    n = points.shape[0]
    taus, counts = np.ones(n), np.zeros(n, np.int64)
    m1, s1, q1 = mt - ms, st - ss, qt - qs
    m, s, q = ms.copy(), ss.copy(), qs.copy()
    g, lu = np.empty((7, 8), np.complex128), np.empty((7, 7), np.complex128)
    pivots, b = np.empty(7, np.int64), np.empty(7, np.complex128)
    x, d = np.zeros((order + 1, 8), np.complex128), np.zeros((order + 1, 6, 4), np.complex128)
    y = np.empty(8, np.complex128)
    for path in range(n):
        x[0] = points[path]
        k = _to_chart(x[0])
        tau, curvature, scale, cap, steps, refusals = 1.0, 2.0, 1.0, 1.0, 0, 0
        while tau >= least_tau and refusals < MAX_REFUSALS and steps <= max_steps:
            if refusals == 0:
                _place(mt, st, qt, m1, s1, q1, moving, tau, m, s, q)
                _half_gradient(m, s, q, x[0], g, d[0])
                if not _factor(g, k, lu, pivots):
                    break
                _expand(m, s, q, m1, s1, q1, moving, k, order, x, d, lu, pivots, b)
                size = _norm(x[0])
                last, before = _norm(x[order]) / size + 1e-300, _norm(x[order - 1]) / size + 1e-300
                growth, ratio = last / before, 0j
                for c in range(8):
                    ratio += x[order - 1, c].conjugate() * x[order, c]
                ratio /= (before * size) ** 2
            aim = min(largest_error, contraction / curvature)
            length = (aim / (scale * last * growth)) ** (1.0 / (order + 1))
            length = min(length, reach / growth, cap)
            arrives = not length < tau
            length, tau_new = (tau, 0.0) if arrives else (length, tau - length)
            _predict(x, order, ratio, length, y)
            _place(mt, st, qt, m1, s1, q1, moving, tau_new, m, s, q)
            size = _norm(y)
            first = _newton(m, s, q, y, k, g, d[0], lu, pivots, b) / size
            second = _newton(m, s, q, y, k, g, d[0], lu, pivots, b) / size if first < np.inf else np.inf
            steps += 1
            predicted = max(scale * last * growth * length ** (order + 1), 1e-300)
            observed = second / max(first, 1e-300) ** 2
            if first > 1e-7 and second < np.inf:
                curvature = min(max(observed, 0.5 * curvature, 0.5), 1e6)
            else:
                observed = curvature
            growth_of_error = min(max(first / predicted, 0.2), 5.0) if first < np.inf else 5.0
            scale = min(max(scale * growth_of_error, 1e-3), 1e3)
            good = first < 5.0 * largest_error and second <= max(2.0 * contraction * first, ROUND_OFF)
            if good and observed * second * second < ROUND_OFF:
                x[0], tau, cap, refusals = y, tau_new, 1.0, 0
                k = _to_chart(x[0])
            else:
                cap, refusals = 0.4 * length, refusals + 1
        if tau == 0.0:
            _place(mt, st, qt, m1, s1, q1, moving, 0.0, m, s, q)
            for _ in range(2):
                _newton(m, s, q, x[0], k, g, d[0], lu, pivots, b)
        points[path] = x[0] / _norm(x[0])
        taus[path], counts[path] = tau, steps
    return taus, counts
