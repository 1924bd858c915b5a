"""The angles of a planar 3-RPR platform as roots of one trigonometric polynomial of degree three.

In complex numbers, with z = exp(iθ), w the vector along the first leg, and anchors b and corners d counted
from those of the first leg, leg *i* asks for |w + z d_i - b_i| = p_i. The differences to the first leg are
linear in w, so w = N(z) / D(z), and |w| = p_1 leaves f = |N|² - p_1² D² = 0 [1]_.

References
----------
.. [1] J.-P. Merlet, "Parallel Robots", 2nd ed., Springer, 2006, ch. 4 (direct kinematics).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stewart_pin.checks import as_array, as_batch
from stewart_pin.errors import InputError
from stewart_pin.geometry.planar import PlanarRPR
from stewart_pin.typing import ArrayLike, ComplexArray, FloatArray, IntArray

ROUND_OFF = 64 * np.finfo(float).eps
"""Misfit of a leg length that counts as zero, per largest length in the problem."""


@dataclass(frozen=True, eq=False)
class Legs:
    """Legs of n problems, counted from leg 1 and divided by the largest length of each problem.

    Attributes
    ----------
    anchors, corners
        (n, 3) complex, the first of each is zero [1].
    lengths
        (n, 3) [1].
    scale
        (n,) the unit of length of each problem [m].
    """

    anchors: ComplexArray
    corners: ComplexArray
    lengths: FloatArray
    scale: FloatArray

    def rows(self, k: IntArray) -> Legs:
        """Take some problems out.

        Parameters
        ----------
        k
            (m,) their indices.

        Returns
        -------
        Legs
            A batch of m.
        """
        return Legs(self.anchors[k], self.corners[k], self.lengths[k], self.scale[k])


def as_lengths(value: ArrayLike) -> FloatArray:
    """Check leg lengths.

    Parameters
    ----------
    value
        (..., 3) what the caller passed [m].

    Returns
    -------
    numpy.ndarray
        (..., 3) as float64 [m].

    Raises
    ------
    InputError
        If the shape is wrong or a length is negative.
    """
    lengths = as_batch("lengths", value, (3,))
    if (lengths < 0.0).any():
        raise InputError(f"lengths must not be negative, got {float(lengths.min())}")
    return lengths


def reduced_legs(planar: PlanarRPR, lengths: FloatArray) -> Legs:
    """Count anchors and corners from those of leg 1, in units of the largest length around.

    Parameters
    ----------
    planar
        Geometry.
    lengths
        (n, 3) [m].

    Returns
    -------
    Legs
        The same n problems without units.

    Raises
    ------
    InputError
        If every point coincides and every length is zero.
    """
    b = planar.anchors[:, 0] + 1j * planar.anchors[:, 1]
    d = planar.corners[:, 0] + 1j * planar.corners[:, 1]
    b, d = b - b[0], d - d[0]
    geometry = max(abs(x[i] - x[j]) for x in (b, d) for i, j in ((0, 1), (0, 2), (1, 2)))
    scale = np.maximum(lengths.max(axis=-1, initial=0.0), geometry)
    if (scale == 0.0).any():
        raise InputError("anchors, corners and lengths are all zero: there is no mechanism to solve")
    return Legs(b / scale[:, None], d / scale[:, None], lengths / scale[:, None], scale)


def pose_terms(legs: Legs) -> tuple[ComplexArray, ComplexArray]:
    """Expand N and D, whose quotient is the vector along leg 1, in powers of z.

    Parameters
    ----------
    legs
        n problems.

    Returns
    -------
    N : numpy.ndarray
        (n, 4) complex coefficients of z⁻¹ … z² [1].
    D : numpy.ndarray
        (n, 3) complex coefficients of z⁻¹ … z; real on the unit circle [1].
    """
    p = legs.lengths
    u, right = [], []
    for i in (1, 2):
        b, d = legs.anchors[:, i], legs.corners[:, i]
        u.append(np.stack([-b, d], axis=-1))  # from corner 1 to corner i, minus from anchor 1 to anchor i
        both = (p[:, i] - p[:, 0]) * (p[:, i] + p[:, 0]) - abs(d) ** 2 - abs(b) ** 2
        right.append(np.stack([np.conj(d) * b, both, d * np.conj(b)], axis=-1))
    n = -1j * (_product(u[1], right[0]) - _product(u[0], right[1]))
    cross = _product(np.conj(u[0][:, ::-1]), u[1])
    return n, -1j * (cross - np.conj(cross[:, ::-1]))


def pose_polynomial(legs: Legs) -> ComplexArray:
    """Expand f = |N|² - p_1² D² in powers of z.

    Parameters
    ----------
    legs
        n problems.

    Returns
    -------
    numpy.ndarray
        (n, 7) complex coefficients of z⁻³ … z³; those of opposite powers are conjugate [1].
    """
    n, d = pose_terms(legs)
    f = _product(n, np.conj(n[:, ::-1]))
    f[:, 1:-1] -= legs.lengths[:, :1] ** 2 * _product(d, d)
    return 0.5 * (f + np.conj(f[:, ::-1]))


def laurent(coefficients: ComplexArray, z: ComplexArray, lowest: int) -> ComplexArray:
    """Evaluate a Laurent polynomial.

    Parameters
    ----------
    coefficients
        (n, k) of z to the powers ``lowest`` and up.
    z
        (n, m) complex arguments.
    lowest
        The lowest power.

    Returns
    -------
    numpy.ndarray
        (n, m) complex values.
    """
    value = np.zeros_like(z)
    for c in coefficients.T[::-1]:
        value = value * z + c[:, None]
    return value * z ** float(lowest)


def unit_circle_roots(coefficients: ComplexArray) -> ComplexArray:
    """Find all roots of one self-reciprocal Laurent polynomial by the eigenvalues of its companion matrix.

    Parameters
    ----------
    coefficients
        (2k + 1,) complex; opposite ones conjugate. Outermost ones that are round-off are dropped in pairs.

    Returns
    -------
    numpy.ndarray
        Complex roots, at most 2k; those of modulus one are angles. None if the polynomial is constant.
    """
    size = np.abs(coefficients)
    # Leading coefficients below round-off of the largest stand for roots at zero and at infinity.
    keep = size > 1e-14 * size.max(initial=0.0)
    k = len(coefficients) // 2
    degree = int(np.abs(np.flatnonzero(keep) - k).max(initial=0))
    if degree == 0:
        return np.zeros(0, complex)
    return np.roots(coefficients[k - degree : k + degree + 1][::-1]).astype(complex)


def planar_pose_polynomial(planar: PlanarRPR, lengths: ArrayLike, angle: ArrayLike) -> FloatArray:
    """Evaluate f(θ) = N1² + N2² - p1² D², whose zeros are the angles of the assembly modes.

    Parameters
    ----------
    planar
        Geometry.
    lengths
        (3,) leg lengths [m].
    angle
        (...) of the platform x axis in the base frame [rad].

    Returns
    -------
    numpy.ndarray
        (...) values [m⁶].
    """
    lengths = as_lengths(as_array("lengths", lengths, (3,)))
    angle = as_batch("angle", angle, ())
    legs = reduced_legs(planar, lengths[None])
    values = laurent(pose_polynomial(legs), np.exp(1j * angle.reshape(1, -1)), -3)
    return values.real.reshape(angle.shape) * legs.scale[0] ** 6


def _product(a: ComplexArray, b: ComplexArray) -> ComplexArray:
    out = np.zeros((a.shape[0], a.shape[1] + b.shape[1] - 1), dtype=complex)
    for i in range(a.shape[1]):
        out[:, i : i + b.shape[1]] += a[:, i : i + 1] * b
    return out
