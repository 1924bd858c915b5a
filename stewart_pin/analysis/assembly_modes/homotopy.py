"""Follow the solutions of seven quadrics in P⁷ while their parameters move: NumPy, all paths side by side.

The homotopy parameter τ runs from 1 (start) to 0 (target). Each step expands every path in a Taylor series,
sums the tail of the series as a geometric one, and corrects with two Newton steps. The step length comes
from the radius of convergence that the series shows, so it shrinks before a singular point and not after
it; a step whose first correction is large, or whose second does not shrink quadratically, is refused: that
is what keeps two paths apart. A path whose series foresees infinity is left there; one that is lost next to
it is followed to its end with more digits.

References
----------
.. [1] A. J. Sommese, C. W. Wampler, "The Numerical Solution of Systems of Polynomials", World Scientific,
   2005, ch. 2, 7.
.. [2] S. Timme, "Mixed precision path tracking for polynomial homotopy continuation", Adv. Comput. Math.
   47, 2021 (step control from the local error of the predictor and the contraction of the corrector).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stewart_pin.analysis.assembly_modes.study import (
    CLOSE,
    CONVERGED,
    NEAR,
    SMALL_ROTATION_PART,
    ComplexArray,
    StudyPlatform,
    foresees_infinity,
    operators,
    relative_norm,
    round_off,
)
from stewart_pin.typing import FloatArray


@dataclass(frozen=True)
class TrackerSettings:
    """How carefully to follow a path.

    Attributes
    ----------
    order
        Order of the Taylor series.
    contraction
        Newton corrections must shrink at least by twice this factor, dimensionless.
    largest_error
        Relative prediction error aimed at; five times as much is refused, dimensionless.
    reach
        Greatest step over the radius of convergence, dimensionless.
    least_tau
        Value of τ at which a path that has not arrived is left, dimensionless.
    max_steps
        Steps after which a path is left.
    """

    order: int = 6
    contraction: float = 0.06
    largest_error: float = 1e-2
    reach: float = 0.6
    least_tau: float = 1e-13
    max_steps: int = 600


DEFAULT = TrackerSettings()
MAX_REFUSALS = 8
"""A path whose step was refused this often in a row is stuck at a singular point."""
SHARE = 0.75
"""Part of the way left that a path goes at once after its arrival was refused: its end may be singular."""
LOST = 1e-2, 0.05
"""Below this τ, a path near infinity is lost in round-off when a step of this part of τ is refused."""


@dataclass(frozen=True, eq=False)
class Tracked:
    """Where the paths ended.

    Attributes
    ----------
    points
        (n, 8) last Study coordinates, of Hermitian norm one.
    tau
        (n,) homotopy parameter reached, dimensionless; 0 means that the path arrived.
    steps
        (n,) steps taken, refused ones included, dimensionless.
    infinite
        (n,) mask: the path was left because it goes to infinity.
    """

    points: ComplexArray
    tau: FloatArray
    steps: FloatArray
    infinite: NDArray[np.bool_]


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
    quadrics = _quadrics(start, target)
    n = len(points)
    x, tau = _normalised(points), np.ones(n)
    state = {"curvature": np.full(n, 2.0), "scale": np.ones(n), "cap": np.ones(n)}
    state |= {"wait": np.zeros(n), "backoff": np.ones(n)}
    steps, refusals, infinite = np.zeros(n, dtype=int), np.zeros(n, dtype=int), np.zeros(n, dtype=bool)
    active = np.arange(n)
    with np.errstate(all="ignore"):  # a refused step may overflow
        while active.size:
            local = {name: values[active] for name, values in state.items()}
            trial, trial_tau, good, lost = _step(quadrics, x[active], tau[active], local, settings)
            infinite[active] = local.pop("infinite")
            for name, values in local.items():
                state[name][active] = values
            good &= ~infinite[active]
            steps[active] += 1
            x[active[good]], tau[active[good]] = trial[good], trial_tau[good]
            refusals[active] = np.where(good, 0, np.where(lost, MAX_REFUSALS, refusals[active] + 1))
            left = (tau < settings.least_tau) | (refusals >= MAX_REFUSALS) | (steps > settings.max_steps)
            active = active[~(left | infinite)[active]]
        arrived = np.flatnonzero(tau == 0.0)
        for _ in range(2):
            x[arrived] = _normalised(
                x[arrived] + _correction(quadrics, np.zeros(arrived.size), x[arrived])[0]
            )
    return Tracked(x, tau, steps, infinite)


def norm_change(target: StudyPlatform, points: ComplexArray) -> FloatArray:
    """Compute how much one Newton step changes ⟨e, e⟩, in the precision of the points.

    Parameters
    ----------
    target
        The platform.
    points
        (n, 8) solutions, Study coordinates.

    Returns
    -------
    numpy.ndarray
        (n,) relative to its value; infinite where the gradients are singular, dimensionless.
    """
    with np.errstate(all="ignore"):
        quadrics, x = _quadrics(target, target), _normalised(points)
        e, moved = x[:, :4], (x + _correction(quadrics, np.zeros(len(x)), x)[0])[:, :4]
        now = (e * e).sum(axis=1)
        return np.nan_to_num(np.abs((moved * moved).sum(axis=1) - now) / np.abs(now), nan=np.inf)


def _quadrics(start: StudyPlatform, target: StudyPlatform) -> list[ComplexArray]:
    """Expand the symmetric matrices of the quadrics in powers of τ; each (8, 56) for points @ matrix."""
    m0 = operators(target.difference, target.total)
    m1 = operators(start.difference, start.total) - m0
    kind = np.result_type(m1, start.squares, target.squares, 1j)
    powers = [np.zeros((7, 8, 8), dtype=kind) for _ in range(3 if m1.any() else 2)]
    # The transpose of the antisymmetric M_i is -M_i.
    powers[0][1:6] = np.block([[-m0 @ m0, -m0], [m0, np.zeros_like(m0)]])
    powers[0][0, 4:, 4:] = np.eye(4)
    powers[0][6] = np.kron([[0, 1], [1, 0]], np.eye(4)) / 2
    if m1.any():
        powers[1][1:6] = np.block([[-m0 @ m1 - m1 @ m0, -m1], [m1, np.zeros_like(m1)]])
        powers[2][1:6, :4, :4] = -m1 @ m1
    powers[0][:6, :4, :4] -= target.squares[:, None, None] * np.eye(4)
    powers[1][:6, :4, :4] -= (start.squares - target.squares)[:, None, None] * np.eye(4)
    return [np.ascontiguousarray(q.reshape(56, 8).T) for q in powers]


def _normalised(x: ComplexArray) -> ComplexArray:
    return x / np.linalg.norm(x, axis=1, keepdims=True)


def _size(v: ComplexArray, x: ComplexArray) -> FloatArray:
    """Measure rotation and translation parts each by its own part of the point: near infinity e is small."""
    e, h = np.linalg.norm(x[:, :4], axis=1), np.linalg.norm(x[:, 4:], axis=1)
    return np.hypot(np.linalg.norm(v[:, :4], axis=1) / e, np.linalg.norm(v[:, 4:], axis=1) / h)


def _ratio(last: ComplexArray, before: ComplexArray, x: ComplexArray, size: FloatArray) -> ComplexArray:
    """Fit one complex ratio to two successive coefficients, in the measure of `_size`."""
    products = before.conj() * last
    e, h = np.linalg.norm(x[:, :4], axis=1) ** 2, np.linalg.norm(x[:, 4:], axis=1) ** 2
    return (products[:, :4].sum(axis=1) / e + products[:, 4:].sum(axis=1) / h) / size**2


def _bordered(gradient: ComplexArray, x: ComplexArray) -> ComplexArray:
    """Add the moving patch: a correction is orthogonal to the point."""
    matrix = np.empty((len(x), 8, 8), dtype=x.dtype)
    matrix[:, :7] = gradient.reshape(-1, 7, 8)
    matrix[:, 7] = x.conj()
    return matrix


def _at(quadrics: list[ComplexArray], tau: FloatArray, x: ComplexArray) -> ComplexArray:
    """Evaluate half the gradients, (n, 56), by Horner's rule in τ."""
    value = x @ quadrics[-1]
    for q in quadrics[-2::-1]:
        value = value * tau[:, None] + x @ q
    return value


def _correction(
    quadrics: list[ComplexArray], tau: FloatArray, x: ComplexArray
) -> tuple[ComplexArray, FloatArray]:
    matrix = _bordered(_at(quadrics, tau, x), x)
    residual = matrix @ x[:, :, None]
    residual[:, 7] = 0.0
    step: ComplexArray = solve(matrix, -0.5 * residual)[:, :, 0]
    return step, _size(step, x)


def _series(quadrics: list[ComplexArray], tau: FloatArray, x: ComplexArray, order: int) -> list[ComplexArray]:
    """Expand the paths in s = τ - τ_new, coefficient by coefficient; one matrix serves them all."""
    n, t = len(x), tau[:, None]
    stacked = np.hstack(quadrics)
    terms = [_shifted(x, t, stacked)]
    matrix = _bordered(terms[0][0], x)
    inverse = solve(matrix, np.eye(8, 7, dtype=x.dtype))
    # Cauchy products as one product of long rows: block j of `rows` is the gradient at x_j, and the
    # columns hold the series backwards, so that row blocks 1..j meet x_(j-1)..x_0.
    rows = np.zeros((n, 7, 8 * (order + 1)), dtype=x.dtype)
    columns = np.zeros((n, 8 * (order + 1), 1), dtype=x.dtype)
    columns[:, -8:, 0] = x
    series = [x]
    for j in range(1, order + 1):
        known = terms[j - 1][1]
        if len(quadrics) == 3 and j > 1:
            known = known + terms[j - 2][2]
        block = slice(8 * j, 8 * j + 8)
        rows[:, :, block] = known.reshape(n, 7, 8)
        total = rows[:, :, 8 : 8 * j + 8] @ columns[:, -8 * j :]
        x_j = (inverse @ total)[:, :, 0] * -0.5
        series.append(x_j)
        if j < order:
            columns[:, -8 * j - 8 : -8 * j, 0] = x_j
            terms.append(_shifted(x_j, t, stacked))
            rows[:, :, block] += terms[j][0].reshape(n, 7, 8)
    return series


def _shifted(v: ComplexArray, t: FloatArray, stacked: ComplexArray) -> list[ComplexArray]:
    """Compute the coefficients of Q(τ - s) v in powers of s."""
    products = v @ stacked
    a, b = products[:, :56], products[:, 56:112]
    if stacked.shape[1] == 112:
        return [a + t * b, -b]
    c = products[:, 112:]
    tc = t * c
    return [a + t * (b + tc), -(b + 2.0 * tc), c]


def _step(
    quadrics: list[ComplexArray],
    x: ComplexArray,
    tau: FloatArray,
    state: dict[str, Any],
    settings: TrackerSettings,
) -> tuple[ComplexArray, FloatArray, NDArray[np.bool_], NDArray[np.bool_]]:
    """Try one step of every path; tell which succeeded and which are lost; `state` learns from it."""
    order, tiny = settings.order, 1e-300
    series = _series(quadrics, tau, x, order)
    last, before = (_size(series[j], x) + tiny for j in (order, order - 1))
    growth = last / before
    ratio = _ratio(series[order], series[order - 1], x, before)
    infinite = (relative_norm(x) < NEAR) & (last * tau**order < CONVERGED)
    if infinite.any():
        infinite &= foresees_infinity(x, _summed(series, ratio, tau))
    state["infinite"] = infinite
    aim = np.minimum(settings.largest_error, settings.contraction / state["curvature"])
    length = (aim / (state["scale"] * last * growth)) ** (1.0 / (order + 1))
    length = np.minimum(np.minimum(length, settings.reach / growth), state["cap"])
    length = np.where(state["wait"] > 0, np.minimum(length, SHARE * tau), length)
    arrives = length >= tau
    length = np.where(arrives, tau, length)
    tau_new = np.where(arrives, 0.0, tau - length)
    y = _normalised(_summed(series, ratio, length))
    step, first = _correction(quadrics, tau_new, y)
    y = y + step
    step, second = _correction(quadrics, tau_new, y)
    y = _normalised(y + step)
    floor = round_off(y)
    curvature = second / np.maximum(first, tiny) ** 2
    curvature = np.where((first > 1e-7) & np.isfinite(second), curvature, state["curvature"])
    good = first < 5.0 * settings.largest_error
    good &= second <= np.maximum(2.0 * settings.contraction * first, floor)
    good &= curvature * second**2 < floor
    # A refused arrival may be due to a singular end, which tells nothing about the way there.
    learns, predicted = good | ~arrives, state["scale"] * last * growth * length ** (order + 1)
    learnt = np.clip(np.maximum(curvature, 0.5 * state["curvature"]), 0.5, 1e6)
    state["curvature"] = np.where(learns, learnt, state["curvature"])
    learnt = np.clip(np.nan_to_num(first, nan=np.inf) / np.maximum(predicted, tiny), 0.2, 5.0)
    learnt = np.clip(state["scale"] * learnt, 1e-3, 1e3)
    state["scale"] = np.where(learns, learnt, state["scale"])
    state["cap"] = np.where(good, 1.0, np.where(learns, 0.4 * length, SHARE * tau))
    state["wait"] = np.where(learns, state["wait"] - good, state["backoff"])
    state["backoff"] = np.where(learns, state["backoff"], 2.0 * state["backoff"])
    lost = learns & ~good & (tau < LOST[0]) & (length < LOST[1] * tau)
    if lost.any():
        lost &= relative_norm(x) < CLOSE[0]
    return y, tau_new, good, lost


def _summed(series: list[ComplexArray], ratio: ComplexArray, length: FloatArray) -> ComplexArray:
    """Sum series in the step length, their tails as geometric ones."""
    s = length[:, None]
    y = series[-1] / (1.0 - ratio[:, None] * s)
    for x_j in series[-2::-1]:
        y = y * s + x_j
    return y


# ----------------------------------------------------------------------------------------------------
# Many small linear systems at once, in double or in extended precision
# ----------------------------------------------------------------------------------------------------

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


# ----------------------------------------------------------------------------------------------------
# Follow paths that are lost next to infinity to their ends with more digits
#
# There the gradients are so nearly singular that the last digits of doubles decide. It takes few geometries in a
# thousand, but the classes whose paths go to infinity have finite solutions beside it. Where the platform's
# compiler has no longer floats than doubles nothing is gained, and such paths stay undecided.
# ----------------------------------------------------------------------------------------------------

_AT_MOST = 10
"""More lost paths than chance explains: the geometry is architecturally singular, and digits do not help."""
_BEYOND = 1e-22
"""Relative |⟨e, e⟩| of a lost path that went to infinity: its end would depend on the last digits of the input."""


def with_more_digits(start: StudyPlatform, target: StudyPlatform, tracked: Tracked) -> Tracked:
    """Go on with the paths that were lost next to infinity, and correct the ends that are there.

    Parameters
    ----------
    start, target
        The ends of the homotopy.
    tracked
        What double precision made of it.

    Returns
    -------
    Tracked
        The same with those paths replaced; in extended precision where there were any.
    """
    # An end at infinity that has a rotation part was reached by a jump from afar, and is told in doubles.
    small = (np.abs(tracked.points[:, :4]) ** 2).sum(axis=1) < SMALL_ROTATION_PART
    close = (relative_norm(tracked.points) < CLOSE[1]) & ~tracked.infinite & (small | (tracked.tau > 0.0))
    if not 0 < close.sum() <= _AT_MOST:
        return tracked
    points, tau = tracked.points.astype(EXTENDED), tracked.tau.copy()
    infinite, steps = tracked.infinite.copy(), tracked.steps.copy()
    for i in np.flatnonzero(close):
        here = _between(start, target, tracked.tau[i])
        # A path that had arrived stays where it is, and is corrected.
        on = track(here, _between(start, target, 0.0), points[i : i + 1], DEFAULT)
        points[i], tau[i], infinite[i] = on.points[0], on.tau[0] * tracked.tau[i], on.infinite[0]
        steps[i] += on.steps[0]
    infinite |= close & (tau > 0.0) & (relative_norm(points) < _BEYOND)
    return replace(tracked, points=points, tau=tau, infinite=infinite, steps=steps)


def _between(start: StudyPlatform, target: StudyPlatform, tau: float) -> StudyPlatform:
    ends = [
        [np.asarray(a, dtype=EXTENDED) for a in (p.difference, p.total, p.squares)] for p in (start, target)
    ]
    return StudyPlatform(*(b + np.longdouble(tau) * (a - b) for a, b in zip(*ends, strict=True)))
