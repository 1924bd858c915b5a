r"""Prove that a solution exists: Newton–Kantorovich bounds with all round-off accounted for.

In the chart where the largest rotation coordinate is one, the seven quadrics are F(z) = 0, z ∈ R⁷. With Y ≈
F'(z̃)⁻¹,

.. math:: \eta \ge |Y F(\tilde z)|, \quad Z_0 \ge |1 - Y F'(\tilde z)|, \quad Z_2 \ge |Y F''|, \qquad
          \eta + Z_0 r + \tfrac12 Z_2 r^2 \le r, \quad Z_0 + Z_2 r < 1

prove that z ↦ z - Y F(z) is a contraction of the ball of radius r about z̃, hence that exactly one solution
lies in it. F has degree two, so the bound on F'' holds everywhere. Round-off of every evaluated sum of
products is at most γₙ = n u / (1 - n u) times the sum of the absolute values, with n the number of
roundings on the way of a term [2]_. What the end of a path is, and from which platforms paths start: below.

References
----------
.. [1] S. M. Rump, "Verification methods: rigorous results using floating-point arithmetic", Acta Numerica
   19, 2010, section 13.
.. [2] N. J. Higham, "Accuracy and Stability of Numerical Algorithms", 2nd ed., SIAM, 2002, section 3.1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stewart_pin.analysis.assembly_modes.homotopy import DEFAULT, Tracked, norm_change, track
from stewart_pin.analysis.assembly_modes.study import (
    SMALL_ROTATION_PART,
    ComplexArray,
    StudyPlatform,
    half_gradient,
    operators,
    relative_norm,
)
from stewart_pin.errors import ConvergenceError
from stewart_pin.typing import FloatArray

_ROUNDINGS = 64
"""No term of a sum below is rounded more often: parameters 4, legs 6, gradients 8, residuals 8, Y 8."""
_GAMMA = _ROUNDINGS * 2.0**-53 / (1.0 - _ROUNDINGS * 2.0**-53)
_UP = 1.0 + 1e-12
"""Covers the roundings of the bounds themselves, all of which are sums of positive numbers."""
_FREE = np.array([[c for c in range(8) if c != k] for k in range(4)])
"""Study coordinates that remain when rotation coordinate k is one."""
_GREATEST_RADIUS = 1e-6
"""A certificate over a larger ball is true but too vague to tell two solutions apart."""


@dataclass(frozen=True, eq=False)
class Certificates:
    """What was proven about approximate real solutions.

    Attributes
    ----------
    points
        (n, 8) polished Study coordinates, dimensionless, the largest rotation coordinate one.
    converged
        (n,) mask: Newton's method settled.
    certified
        (n,) mask: a solution within `radius` is proven.
    radius
        (n,) bound on the error of every Study coordinate; infinite without a proof, dimensionless.
    """

    points: FloatArray
    converged: NDArray[np.bool_]
    certified: NDArray[np.bool_]
    radius: FloatArray


def certify(base: FloatArray, platform: FloatArray, lengths: FloatArray, points: FloatArray) -> Certificates:
    """Polish approximate real solutions and prove that each has a true one next to it.

    Parameters
    ----------
    base, platform
        (5, 3) ends of legs 2 to 6 seen from those of leg 1, dimensionless; off by one rounding at most.
    lengths
        (6,) leg lengths, dimensionless; exact.
    points
        (n, 8) real Study coordinates, dimensionless.

    Returns
    -------
    Certificates
        In the order of `points`.
    """
    x, picked = _in_chart(points)
    study = StudyPlatform.from_points(base, platform, lengths**2)
    matrices = operators(study.difference, study.total)
    rows, free = picked[0][:, :, 0], picked[2][:, 0, :]
    step = np.zeros((len(x), 7))
    with np.errstate(all="ignore"):
        for _ in range(2):
            gradient = half_gradient(matrices, study.squares, x)
            step = -(_inverse(2.0 * gradient[picked]) @ (gradient @ x[:, :, None]))[:, :, 0]
            x[rows, free] += step
        size = np.abs(x).max(axis=1, initial=1.0)
        converged = np.isfinite(x).all(axis=1) & (np.abs(step).max(axis=1, initial=0.0) < 1e-6 * size)
        x[~converged] = points[~converged]
    radius = proven_radius(base, platform, lengths, x)
    certified = converged & (radius < _GREATEST_RADIUS * size)
    return Certificates(x, converged, certified, np.where(certified, radius, np.inf))


def proven_radius(
    base: FloatArray, platform: FloatArray, lengths: FloatArray, points: FloatArray
) -> FloatArray:
    """Find the radius of a ball about each point in which exactly one solution is proven to lie.

    Parameters
    ----------
    base, platform
        (5, 3) ends of legs 2 to 6 seen from those of leg 1, dimensionless; off by one rounding at most.
    lengths
        (6,) leg lengths, dimensionless; exact.
    points
        (n, 8) real Study coordinates, dimensionless, the largest rotation coordinate one.

    Returns
    -------
    numpy.ndarray
        (n,) greatest error of a Study coordinate; infinite where nothing could be proven, dimensionless.
    """
    x, picked = _in_chart(points)
    study = StudyPlatform.from_points(base, platform, lengths**2)
    bounds = operators(np.abs(base) + np.abs(platform), np.abs(base) + np.abs(platform))
    sizes = np.abs(bounds), np.append(lengths[:1] ** 2, lengths[1:] ** 2 + lengths[0] ** 2)
    with np.errstate(all="ignore"):
        gradient = half_gradient(operators(study.difference, study.total), study.squares, x)
        gradient_size = _half_gradient_size(*sizes, np.abs(x))
        jacobian, jacobian_size = 2.0 * gradient[picked], 2.0 * gradient_size[picked]
        inverse = _inverse(jacobian)
        y = np.abs(inverse)
        residual = np.abs(gradient @ x[:, :, None]) + _GAMMA * (gradient_size @ np.abs(x)[:, :, None])
        eta = (y @ residual)[:, :, 0].max(axis=1, initial=0.0) * _UP
        defect = np.abs(np.eye(7) - inverse @ jacobian) + _GAMMA * (np.eye(7) + y @ jacobian_size)
        z0 = defect.sum(axis=2).max(axis=1, initial=0.0) * _UP
        # |F''(v, v)| ≤ 2 Σ|Q| |v|²: the half-gradient of the point of ones, with all signs positive.
        curvature = 2.0 * _half_gradient_size(*sizes, np.ones((1, 8))).sum(axis=2)
        z2 = (y @ curvature[0]).max(axis=1, initial=0.0) * _UP
        radius = 2.0 * eta / (1.0 - z0)
        # With this radius η = (1 - Z₀) r / 2, so the second inequality holds the first: its left-hand side is
        # r/2 (1 + Z₀ + Z₂ r) < r. `_UP` covers the roundings of both. Not-a-number fails every comparison.
        holds = (z0 < 1.0) & ((z0 + z2 * radius) * _UP < 1.0)
    return np.where(holds, radius, np.inf)


def _in_chart(points: FloatArray) -> tuple[FloatArray, tuple[NDArray[np.intp], ...]]:
    """Scale the largest rotation coordinate to one; give the indices that pick the other columns."""
    n = len(points)
    chart = np.argmax(np.abs(points[:, :4]), axis=1)
    rows = np.arange(n)[:, None]
    picked = rows[:, :, None], np.arange(7)[:, None], _FREE[chart][:, None, :]
    return points / points[np.arange(n), chart][:, None], picked


def _half_gradient_size(sizes: FloatArray, squares: FloatArray, x: FloatArray) -> FloatArray:
    """Evaluate the half-gradients with every term positive."""
    e, h = x[:, :4], x[:, 4:]
    moved = (e @ sizes.reshape(20, 4).T).reshape(-1, 5, 4)
    out = np.empty((len(x), 7, 8))
    out[:, 0, :4], out[:, 0, 4:] = squares[0] * e, h
    out[:, 1:6, :4] = (sizes @ (h[:, None, :] + moved)[..., None])[..., 0] + squares[1:, None] * e[:, None, :]
    out[:, 1:6, 4:] = moved
    out[:, 6, :4], out[:, 6, 4:] = h / 2, e / 2
    return out


def _inverse(matrix: FloatArray) -> FloatArray:
    try:
        return np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        return np.linalg.pinv(matrix)


# ----------------------------------------------------------------------------------------------------
# Decide what the end of a path is: a solution, a point at infinity, a singular solution, or a failure
#
# A solution is at infinity when ⟨e, e⟩ = 0. No real pose is near infinity: there ⟨e, e⟩ is the square of the
# norm of e. A small |⟨e, e⟩| alone proves nothing: planar platforms have true complex solutions with a small
# one. A path left on its way was judged by its series, one that arrived is judged by whether Newton's method
# still changes ⟨e, e⟩.
# ----------------------------------------------------------------------------------------------------

_SAME = 1e-13
"""Squared sine of the angle between two points of P⁷ that are one solution, found twice."""
_BESIDE = 1e-4
"""Squared sine of the angle within which a regular solution rules out a singular one."""
_SMALL_NORM = 1e-6
"""Relative |⟨e, e⟩| below which a point may lie at infinity."""
_RANK_LOSS = 1e-14
"""Singular value of gradients of order one that is zero to double precision."""
_SINGULAR = 1e-7
"""Smallest singular value, over the largest, at a singular solution known to half the digits."""
_NEAR = 1e-2
"""A stuck path must have come this near in τ to say where it was going."""
_SETTLED, _UNSETTLED = 1e-2, 0.05
"""Relative change of ⟨e, e⟩ by a Newton step at a finite end (round-off) and at infinity (a half at least)."""


@dataclass(frozen=True, eq=False)
class Endpoints:
    """The ends of a set of paths.

    Attributes
    ----------
    regular
        (n, 8) regular finite solutions, each once.
    singular
        (m, 8) singular finite solutions, one for each path that ended there.
    infinite
        Number of paths that went to infinity.
    failed
        Number of paths whose end could not be decided.
    """

    regular: ComplexArray
    singular: ComplexArray
    infinite: int
    failed: int


def classify(target: StudyPlatform, tracked: Tracked) -> Endpoints:
    """Sort the ends of paths.

    Parameters
    ----------
    target
        The platform at the end of the homotopy.
    tracked
        Where its paths ended.

    Returns
    -------
    Endpoints
        Every path is counted once; two paths on one regular solution count one failure.
    """
    x, arrived = tracked.points, tracked.tau == 0.0
    norm = relative_norm(x)
    regular, infinite = arrived & (norm > _SMALL_NORM), tracked.infinite.copy()
    small = np.flatnonzero(arrived & ~regular)
    if small.size:
        change = norm_change(target, x[small])
        change[_ranks(target, x[small]) < 7] = np.inf
        regular[small], infinite[small] = change < _SETTLED, change > _UNSETTLED
    singular, ends = np.zeros(len(x), dtype=bool), x.copy()
    for i in np.flatnonzero(~arrived & ~infinite & (tracked.tau < _NEAR) & (norm > _SMALL_NORM)):
        ends[i], singular[i] = _settle(target, x[i].astype(complex))
    # Next to a regular solution there is no singular one: that path is lost in round-off.
    singular &= ~beside(ends, x[regular])
    once = distinct(x[regular])
    failed = int((~(regular | infinite | singular)).sum() + regular.sum() - len(once))
    return Endpoints(
        x[regular][once].astype(complex), ends[singular].astype(complex), int(infinite.sum()), failed
    )


def distinct(points: NDArray[Any]) -> NDArray[np.intp]:
    """Find the first of every set of equal points.

    Parameters
    ----------
    points
        (n, 8) Study coordinates, dimensionless.

    Returns
    -------
    numpy.ndarray
        Indices of the points that differ from all before them.
    """
    if len(points) == 0:
        return np.empty(0, dtype=np.intp)
    unit = points / np.linalg.norm(points, axis=1, keepdims=True)
    equal = 1.0 - np.abs(unit.conj() @ unit.T) ** 2 < _SAME
    return np.flatnonzero(~np.tril(equal, -1).any(axis=1))


def beside(points: ComplexArray, solutions: ComplexArray) -> NDArray[np.bool_]:
    """Find the points that lie next to a regular solution, where no singular one can be.

    Parameters
    ----------
    points
        (n, 8) Study coordinates, dimensionless.
    solutions
        (m, 8) regular solutions, dimensionless.

    Returns
    -------
    numpy.ndarray
        (n,) mask.
    """
    unit, others = (p / np.linalg.norm(p, axis=1, keepdims=True) for p in (points, solutions))
    return (1.0 - np.abs(unit.conj() @ others.T) ** 2 < _BESIDE).any(axis=1)


def _ranks(target: StudyPlatform, x: ComplexArray) -> NDArray[np.intp]:
    """Count the independent gradients at ends that have a rotation part; at the others doubles cannot tell."""
    gradient = half_gradient(operators(target.difference, target.total), target.squares, x)
    e, h = (np.linalg.norm(part, axis=1)[:, None] for part in (x[:, :4], x[:, 4:]))
    # In these units all entries but singularity are of order one, however small e is.
    columns = np.repeat(np.hstack([e, h]), 4, axis=1)
    rows = np.hstack([h * h, np.repeat(e * h, 6, axis=1)])
    scaled = (gradient * columns[:, None, :] / rows[:, :, None]).astype(complex)
    ranks = np.linalg.matrix_rank(scaled, tol=_RANK_LOSS)
    return np.where(np.abs(e[:, 0]) ** 2 < SMALL_ROTATION_PART, 7, ranks)


def _settle(target: StudyPlatform, x: ComplexArray) -> tuple[ComplexArray, bool]:
    """Go the last bit to a singular solution by Gauss–Newton, which stands rank loss."""
    matrices, here = operators(target.difference, target.total), x
    for _ in range(30):
        gradient = half_gradient(matrices, target.squares, here[None])[0]
        step = -0.5 * np.linalg.lstsq(gradient, gradient @ here, rcond=_SINGULAR)[0]
        here = here + step
        here = here / np.linalg.norm(here)
    gradient = half_gradient(matrices, target.squares, here[None])[0]
    values = np.linalg.svd(gradient, compute_uv=False)
    solved = np.abs(gradient @ here).max() < 1e-10 * values[0]
    near = 1.0 - abs(here.conj() @ x) ** 2 < 1e-4
    return here, bool(solved and near and values[-1] < 1e-4 * values[0])


# ----------------------------------------------------------------------------------------------------
# Generic complex platforms with their 40 solutions, from which every other platform is reached
#
# They are found by monodromy: one solution is made by choosing the lengths that fit a random pose, and loops
# through random complex platforms permute the solutions until all are known. The group is transitive, so the
# loops reach all; 40 is their proven number [1]_. Run this module to make the data file again::
#
#     python -m stewart_pin.analysis.assembly_modes.certificates
#
# References
# ----------
# .. [1] F. Ronga, T. Vust, "Stewart platforms without computer?", in Real Analytic and Algebraic Geometry, de
#    Gruyter, 1995.
# ----------------------------------------------------------------------------------------------------

GENERIC_COUNT = 40
"""Number of finite complex solutions of a generic platform."""
_FILE = Path(__file__).with_name("start_systems.npz")
_SEEDS = (1, 2, 3, 4)
_MAX_LOOPS = 100


@dataclass(frozen=True, eq=False)
class StartSystem:
    """A platform whose solutions are all known.

    Attributes
    ----------
    platform
        Its parameters.
    points
        (n, 8) its solutions in Study coordinates.
    """

    platform: StudyPlatform
    points: ComplexArray


@cache
def start_systems() -> tuple[StartSystem, ...]:
    """Read the start systems that come with the package.

    Returns
    -------
    tuple of StartSystem
        Independent generic platforms with 40 solutions each.
    """
    with np.load(_FILE) as data:
        return tuple(
            StartSystem(StudyPlatform(d, t, q), x)
            for d, t, q, x in zip(
                data["difference"], data["total"], data["squares"], data["points"], strict=True
            )
        )


def build_start_system(rng: np.random.Generator) -> StartSystem:
    """Find all solutions of a random complex platform by monodromy.

    Parameters
    ----------
    rng
        Source of the platform and of the loops.

    Returns
    -------
    StartSystem
        With 40 solutions.

    Raises
    ------
    ConvergenceError
        If the loops do not end with 40 solutions.
    """
    home, points = _platform_with_one_solution(rng)
    for _ in range(_MAX_LOOPS):
        moved, here = points, home
        for corner in (_random_platform(rng), _random_platform(rng), home):
            ends = track(here, corner, moved, DEFAULT)
            moved, here = ends.points[ends.tau == 0.0], corner
        points = np.vstack([points, moved])
        points = points[distinct(points)]
        if len(points) == GENERIC_COUNT:
            return StartSystem(home, points)
    raise ConvergenceError(
        f"monodromy found {len(points)} of {GENERIC_COUNT} solutions; try another seed",
        residual=float(GENERIC_COUNT - len(points)),
    )


def _gauss(rng: np.random.Generator, *shape: int) -> ComplexArray:
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2.0)


def _random_platform(rng: np.random.Generator) -> StudyPlatform:
    return StudyPlatform.from_points(_gauss(rng, 5, 3), _gauss(rng, 5, 3), 2.0 * _gauss(rng, 6))


def _platform_with_one_solution(rng: np.random.Generator) -> tuple[StudyPlatform, ComplexArray]:
    base, platform, e, h = _gauss(rng, 5, 3), _gauss(rng, 5, 3), _gauss(rng, 4), _gauss(rng, 4)
    h -= e * (e @ h) / (e @ e)
    legs = np.vstack([h, h + operators(platform - base, platform + base) @ e])
    squares = (legs * legs).sum(axis=1) / (e @ e)
    point = np.concatenate([e, h])[None]
    return StudyPlatform.from_points(base, platform, squares), point / np.linalg.norm(point)


def _write(path: Path = _FILE) -> None:
    systems = [build_start_system(np.random.default_rng(seed)) for seed in _SEEDS]
    np.savez(
        path,
        difference=np.array([s.platform.difference for s in systems]),
        total=np.array([s.platform.total for s in systems]),
        squares=np.array([s.platform.squares for s in systems]),
        points=np.array([s.points for s in systems]),
    )


if __name__ == "__main__":
    _write()
