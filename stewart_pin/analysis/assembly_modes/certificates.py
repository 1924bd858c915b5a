r"""Prove that a solution exists: Newton–Kantorovich bounds with all round-off accounted for.

In the chart where the largest rotation coordinate is one, the seven quadrics are F(z) = 0, z ∈ R⁷. With Y ≈
F'(z̃)⁻¹,

.. math:: \eta \ge |Y F(\tilde z)|, \quad Z_0 \ge |1 - Y F'(\tilde z)|, \quad Z_2 \ge |Y F''|, \qquad
          \eta + Z_0 r + \tfrac12 Z_2 r^2 \le r, \quad Z_0 + Z_2 r < 1

prove that z ↦ z - Y F(z) is a contraction of the ball of radius r about z̃, hence that exactly one solution
lies in it. F has degree two, so the bound on F'' holds everywhere. Round-off of every evaluated sum of
products is at most γₙ = n u / (1 - n u) times the sum of the absolute values, with n the number of
roundings on the way of a term [2]_.

References
----------
.. [1] S. M. Rump, "Verification methods: rigorous results using floating-point arithmetic", Acta Numerica
   19, 2010, section 13.
.. [2] N. J. Higham, "Accuracy and Stability of Numerical Algorithms", 2nd ed., SIAM, 2002, section 3.1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stewart_pin.analysis.assembly_modes.study import StudyPlatform, half_gradient, operators
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
