"""The angles of a planar 3-RPR platform as roots of one trigonometric polynomial of degree three.

In complex numbers, with z = exp(iθ), w the vector along the first leg, and anchors b and corners d counted
from those of the first leg, leg *i* asks for |w + z d_i - b_i| = p_i. The differences to the first leg are
linear in w, so w = N(z) / D(z), and |w| = p_1 leaves f = |N|² - p_1² D² = 0 [1]_. Problems near a merging of poses
are solved below, one by one.

References
----------
.. [1] J.-P. Merlet, "Parallel Robots", 2nd ed., Springer, 2006, ch. 4 (direct kinematics).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stewart_pin.checks import as_array, as_batch
from stewart_pin.errors import InputError
from stewart_pin.geometry.planar import (
    Equations,
    PlanarRPR,
    leg_system,
    require_planar,
    strong_newton,
    valley_newton,
)
from stewart_pin.tolerances import ROOT_BAND, ROUND_OFF
from stewart_pin.typing import ArrayLike, BoolArray, ComplexArray, FloatArray, IntArray


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
    require_planar(planar)
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


# ----------------------------------------------------------------------------------------------------
# Assembly modes of one planar 3-RPR problem near a merging of poses, where each root needs a second look
#
# Close to a merging the eigenvalues of a double root scatter by the square root of round-off, on or off the
# unit circle. The leg equations decide: a pose is real if they hold to round-off, and two poses are one if they
# hold halfway between as well.
# ----------------------------------------------------------------------------------------------------


_SCATTER = 1e4 * np.finfo(float).eps
"""An m-fold root scatters its eigenvalues over a disc of about this radius to the power 1/m."""

_SINGULAR = 1e-5
"""Least over largest singular value at a merged pose that Newton's method has reached as far as it can."""

_SHARED = 1e-4
"""Poses with angles this close have one root between them as far as eigenvalues can tell."""

_SAME = 1e-2
"""Poses farther apart than this are different, whatever the equations say halfway."""

_RING = 24
"""Starting points on the circle where all three circles nearly coincide."""


def near_circle(roots: ComplexArray, coefficients: ComplexArray) -> tuple[BoolArray, BoolArray]:
    """Tell the real roots of several polynomials, and the polynomials where that is not clear-cut.

    Parameters
    ----------
    roots
        (n, k) complex.
    coefficients
        (n, k + 1) of the polynomials, the leading one last.

    Returns
    -------
    real : numpy.ndarray
        (n, k) whether a root has modulus one to round-off.
    doubtful : numpy.ndarray
        (n,) whether some root may belong to a merged pair, or is close to one that does.
    """
    offset = np.abs(np.abs(roots) - 1.0)
    real = offset < 1e-9
    distance = np.abs(roots[:, :, None] - roots[:, None, :])
    distance[:, np.arange(roots.shape[1]), np.arange(roots.shape[1])] = np.inf
    nearest = distance.min(axis=-1)
    # An error e of the coefficients moves a root and its neighbour by the root of e / |c| Π |z - others|.
    distance[distance == nearest[..., None]] = 1.0
    distance[distance == np.inf] = 1.0
    error = _SCATTER * np.abs(coefficients).sum(axis=-1) / np.abs(coefficients[:, -1])
    complex_for_certain = offset**2 * distance.prod(axis=-1) > error[:, None]
    doubtful = np.where(real, nearest < 1e-4, (offset < ROOT_BAND) & ~complex_for_certain)
    return real, doubtful.any(axis=-1)


def one_by_one(legs: Legs) -> list[tuple[complex, float, int]]:
    """Find the poses of one problem that no closed form covers.

    Parameters
    ----------
    legs
        A batch of one problem.

    Returns
    -------
    list of tuple
        ``(w, angle, multiplicity)`` of each pose: vector along leg 1 [1], [rad], int.
    """
    b, d, p = legs.anchors[0], legs.corners[0], legs.lengths[0]
    roots = unit_circle_roots(pose_polynomial(legs)[0])
    close = roots[np.abs(np.abs(roots) - 1.0) < ROOT_BAND]
    if not len(close):
        return []
    start = np.array([[w.real, w.imag, t] for t in np.angle(close) for w in _circle_starts(b, d, p, t)])
    if not len(start):
        return []
    system = leg_system(b, d, p)
    x = valley_newton(system, start, max_iterations=60, largest_step=3e-2)
    x[:, 2] = np.angle(np.exp(1j * x[:, 2]))
    misfit = np.abs(system(x)[0]).max(axis=-1)
    order = np.argsort(misfit)
    poses = _distinct(system, x[order][misfit[order] <= ROUND_OFF])
    multiplicity = _multiplicities(roots, poses, system(poses)[1] if len(poses) else np.zeros((0, 3, 3)))
    return [(complex(x, y), float(t), int(m)) for (x, y, t), m in zip(poses, multiplicity, strict=True)]


def _circle_starts(b: ComplexArray, d: ComplexArray, p: FloatArray, angle: float) -> list[complex]:
    """Guess positions at an angle: each leg puts corner 1 on a circle; intersect the two farthest apart."""
    centres = b - np.exp(1j * angle) * d
    i, j = max(((0, 1), (0, 2), (1, 2)), key=lambda ij: abs(centres[ij[1]] - centres[ij[0]]))
    gap = abs(centres[j] - centres[i])
    if gap < 1e-2:
        # Nearly one circle: its legs barely tell where along it the pose lies.
        return list(centres.mean() + p.mean() * np.exp(2j * np.pi * np.arange(_RING) / _RING))
    along = (centres[j] - centres[i]) / gap
    foot = ((p[i] - p[j]) * (p[i] + p[j]) + gap**2) / (2 * gap)
    # Circles that just miss each other may touch at the polished angle.
    height = np.sqrt(max(p[i] ** 2 - foot**2, 0.0))
    return [complex(centres[i] + along * complex(foot, s * height)) for s in (-1.0, 1.0)]


def _distinct(equations: Equations, x: FloatArray) -> FloatArray:
    """Keep one of the poses that the leg equations cannot tell apart; the best come first."""
    kept = np.zeros((0, 3))
    for pose in x:
        half = 0.5 * (pose - kept)
        half[:, 2] = 0.5 * np.angle(np.exp(1j * (pose[2] - kept[:, 2])))
        near = np.abs(half).max(axis=-1) < _SAME
        # The poses that satisfy the equations to round-off lie on a curve: look halfway along it.
        halfway = strong_newton(equations, (kept + half)[near], max_iterations=3)
        if (np.abs(equations(halfway)[0]).max(axis=-1) > ROUND_OFF).all():
            kept = np.concatenate([kept, pose[None]])
    return kept


def _multiplicities(roots: ComplexArray, poses: FloatArray, jacobian: FloatArray) -> IntArray:
    """Give each pose its root, then hand the roots left over to singular poses within their scatter."""
    multiplicity = np.ones(len(poses), dtype=int)
    if not len(poses):
        return multiplicity
    distance = np.abs(np.exp(1j * poses[:, 2])[:, None] - roots[None, :])
    free = np.ones(len(roots), dtype=bool)
    for _ in range(min(len(poses), len(roots))):
        pose, root = np.unravel_index(np.argmin(distance), distance.shape)
        free[root] = False
        distance[pose], distance[:, root] = np.inf, np.inf
    singular = np.linalg.svd(jacobian, compute_uv=False)
    for k in np.argsort(singular[:, -1] / singular[:, 0]):
        if singular[k, -1] > _SINGULAR * singular[k, 0]:
            break
        left = np.flatnonzero(free)
        gaps = np.abs(roots[left] - np.exp(1j * poses[k, 2]))
        left, gaps = left[np.argsort(gaps)], np.sort(gaps)
        # Poses that share the angle (D = 0) share the root of f and scatter it further.
        sharing = int((np.abs(np.exp(1j * poses[:, 2]) - np.exp(1j * poses[k, 2])) < _SHARED).sum())
        more = [m for m in range(1, len(gaps) + 1) if gaps[m - 1] <= _SCATTER ** (1 / (m + sharing))]
        if more:
            multiplicity[k] += more[-1]
            free[left[: more[-1]]] = False
    return multiplicity
