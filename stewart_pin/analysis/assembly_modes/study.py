r"""The leg equations of a six-legged platform in Study (dual-quaternion) coordinates.

A pose is a point x = (e, h) of P⁷ on the Study quadric ⟨e, h⟩ = 0: the rotation is R v = e v ē / ⟨e, e⟩ and
the position p = vec(h ē) / ⟨e, e⟩, with real part first. With d_i = h + e P_i - B_i e, leg i has length l_i
when

.. math:: \langle d_i, d_i \rangle - l_i^2 \langle e, e \rangle = 0,

because the leg vector is vec(d_i ē) / ⟨e, e⟩; ⟨·,·⟩ is the bilinear product, not the Hermitian one, so
points with ⟨e, e⟩ = 0 lie at infinity. Both frames have their origin at the ends of the first leg, and its
equation is subtracted from the other five: with r_i = e P_i - B_i e they read

.. math:: \langle 2 h + r_i, r_i \rangle - (l_i^2 - l_1^2) \langle e, e \rangle = 0

and keep their accuracy near infinity, where e is small and ⟨h, h⟩ would drown the rest. Six such quadrics
and the Study quadric have 40 finite complex solutions in general. What tells from a Taylor series that a path
goes to infinity stands below.

References
----------
.. [1] M. L. Husty, "An algorithm for solving the direct kinematics of general Stewart–Gough platforms",
   Mechanism and Machine Theory 31(4), 1996.
.. [2] C. W. Wampler, "Forward displacement analysis of general six-in-parallel SPS (Stewart) platform
   manipulators using soma coordinates", Mechanism and Machine Theory 31(3), 1996.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stewart_pin.geometry.hexapod import Hexapod, require_hexapod
from stewart_pin.typing import FloatArray

ComplexArray = NDArray[np.complexfloating[Any, Any]]


@dataclass(frozen=True, eq=False)
class StudyPlatform:
    """The parameters of the seven quadrics, dimensionless.

    Attributes
    ----------
    difference
        (5, 3) platform minus base points of legs 2 to 6, in frames at the ends of leg 1, dimensionless.
    total
        (5, 3) platform points plus base points, dimensionless.
    squares
        (6,) squared length of leg 1, then what the squares of the others exceed it by, dimensionless.
    """

    difference: NDArray[Any]
    total: NDArray[Any]
    squares: NDArray[Any]

    @classmethod
    def from_points(cls, base: NDArray[Any], platform: NDArray[Any], squares: NDArray[Any]) -> StudyPlatform:
        """Collect the parameters.

        Parameters
        ----------
        base, platform
            (5, 3) ends of legs 2 to 6, in frames at the ends of leg 1, dimensionless.
        squares
            (6,) squared leg lengths, dimensionless.

        Returns
        -------
        StudyPlatform
            The parameters.
        """
        return cls(platform - base, platform + base, np.append(squares[:1], squares[1:] - squares[0]))


@dataclass(frozen=True, eq=False)
class Scaling:
    """A change of origin in both frames and of the unit of length that brings a robot to size one.

    Attributes
    ----------
    base_centre, platform_centre
        (3,) new origins, each in its own frame [m].
    size
        New unit of length [m].
    """

    base_centre: FloatArray
    platform_centre: FloatArray
    size: float

    @classmethod
    def of(cls, hexapod: Hexapod, lengths: FloatArray | None = None) -> Scaling:
        """Choose the scaling of a robot.

        Parameters
        ----------
        hexapod
            Geometry.
        lengths
            (6,) leg lengths that shall be of order one too, if known [m].

        Returns
        -------
        Scaling
            Origins at the ends of leg 1, unit a power of two near the root-mean-square size.
        """
        require_hexapod(hexapod)
        centres = hexapod.base_points[0], hexapod.platform_points[0]
        mean = hexapod.base_points.var(axis=0).sum() + hexapod.platform_points.var(axis=0).sum()
        if lengths is not None:
            mean = (mean + (lengths**2).mean()) / 2
        # A power of two divides without round-off, which the certificates rely on. A robot of coincident
        # points has no size; any unit serves to report it.
        return cls(*centres, float(np.exp2(np.round(np.log2(mean / 2) / 2))) if mean > 0 else 1.0)

    def points(self, hexapod: Hexapod) -> tuple[FloatArray, FloatArray]:
        """Express the leg ends in the new origins and unit.

        Parameters
        ----------
        hexapod
            Geometry.

        Returns
        -------
        base, platform : numpy.ndarray
            (5, 3) ends of legs 2 to 6, each in its own frame, dimensionless.
        """
        return (
            (hexapod.base_points[1:] - self.base_centre) / self.size,
            (hexapod.platform_points[1:] - self.platform_centre) / self.size,
        )

    def pose(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Turn real Study points of the scaled robot into poses of the robot.

        Parameters
        ----------
        points
            (n, 8) real Study coordinates, dimensionless.

        Returns
        -------
        position : numpy.ndarray
            (n, 3) platform origins in the base frame [m].
        rotation : numpy.ndarray
            (n, 3, 3) platform axes in the base frame.
        """
        e, h = points[:, :4], points[:, 4:]
        norm = (e * e).sum(axis=1)
        # vec(h ē) = e0 h_v - h0 e_v - h_v × e_v
        shift = e[:, :1] * h[:, 1:] - h[:, :1] * e[:, 1:] - np.cross(h[:, 1:], e[:, 1:])
        rotation = _rotation(e / np.sqrt(norm)[:, None])
        position = self.size * shift / norm[:, None] + self.base_centre - rotation @ self.platform_centre
        return position, rotation


def operators(difference: NDArray[Any], total: NDArray[Any]) -> NDArray[Any]:
    """Build the antisymmetric matrices M_i with r_i = M_i e = e P_i - B_i e.

    Parameters
    ----------
    difference, total
        (..., 5, 3) platform points minus and plus base points, dimensionless.

    Returns
    -------
    numpy.ndarray
        (..., 5, 4, 4) matrices, dimensionless.
    """
    m = np.zeros((*difference.shape[:-1], 4, 4), dtype=difference.dtype)
    m[..., 0, 1:], m[..., 1:, 0] = -difference, difference
    x, y, z = np.moveaxis(total, -1, 0)
    m[..., 1, 2], m[..., 1, 3], m[..., 2, 3] = z, -y, x
    m[..., 2, 1], m[..., 3, 1], m[..., 3, 2] = -z, y, -x
    return m


def half_gradient(matrices: NDArray[Any], squares: NDArray[Any], points: NDArray[Any]) -> NDArray[Any]:
    """Compute half the gradients of the seven quadrics; their product with the point is the residual.

    Parameters
    ----------
    matrices
        (5, 4, 4) from `operators`, dimensionless.
    squares
        (6,) of a `StudyPlatform`, dimensionless.
    points
        (n, 8) Study coordinates, dimensionless.

    Returns
    -------
    numpy.ndarray
        (n, 7, 8) one row for leg 1, one for each other leg minus leg 1, then the Study quadric;
        dimensionless.
    """
    e, h = points[:, :4], points[:, 4:]
    moved = (e @ matrices.reshape(20, 4).T).reshape(-1, 5, 4)
    gradient = np.empty((len(points), 7, 8), dtype=np.result_type(matrices, squares, points))
    gradient[:, 0, :4], gradient[:, 0, 4:] = -squares[0] * e, h
    # The transpose of the antisymmetric M_i is -M_i.
    gradient[:, 1:6, :4] = (
        -(matrices @ (h[:, None, :] + moved)[..., None])[..., 0] - squares[1:, None] * e[:, None, :]
    )
    gradient[:, 1:6, 4:] = moved
    gradient[:, 6, :4], gradient[:, 6, 4:] = h / 2, e / 2
    return gradient


def _rotation(e: FloatArray) -> FloatArray:
    w, x, y, z = e.T
    # fmt: off
    rows = [
        [w*w + x*x - y*y - z*z, 2*(x*y - w*z),         2*(x*z + w*y)],
        [2*(x*y + w*z),         w*w - x*x + y*y - z*z, 2*(y*z - w*x)],
        [2*(x*z - w*y),         2*(y*z + w*x),         w*w - x*x - y*y + z*z],
    ]
    # fmt: on
    return np.moveaxis(np.array(rows), -1, 0)


# ----------------------------------------------------------------------------------------------------
# Foresee from a Taylor series that a path goes to infinity, and tell how exact a point near infinity can be
#
# A solution is at infinity when ⟨e, e⟩ = 0. The gradients are singular there, so a path cannot be followed to
# the end; but it is analytic in τ, and its series, summed at τ = 0, shows the end long before round-off spoils
# the corrections. Two kinds occur: the rotation part e vanishes altogether (translations without bound), or
# ⟨e, e⟩ vanishes and e does not (rotation entries without bound). Finite solutions that lie next to infinity
# look alike from afar, with ⟨e, e⟩ in proportion to |e|⁴ as e decreases; so an end that is not zero to all
# digits must vanish faster than that to count.
# ----------------------------------------------------------------------------------------------------

NEAR = 1e-3
"""Relative |⟨e, e⟩| below which the series is asked."""
CONVERGED = 1e-3
"""Size of the last term of a series that may be summed at τ = 0, relative to the point."""
NO_ROTATION_PART = 1e-12, 1e-4
"""|e|² over |h|² at an end without rotation part, and over the same ratio now."""
NO_NORM = 1e-12, 1e-2
"""|⟨e, e⟩| at an end with a rotation part, and over what it would be if it went as |e|⁴."""
BEYOND_DOUBLES = 1e-19, 1e-5
"""|⟨e, e⟩| at an end that doubles cannot tell from infinity, and over its value now."""
ROUND_OFF = (1e-9, 1e-6, 1e-3)
"""Relative Newton corrections that may be round-off: anywhere, and below each of `CLOSE`."""
CLOSE = (1e-8, 1e-12)
"""Relative |⟨e, e⟩| below which the gradients lose digits."""

SMALL_ROTATION_PART = 1e-4
"""|e|² of a point of norm one at which doubles are short of digits."""


def relative_norm(points: ComplexArray) -> FloatArray:
    """Compute |⟨e, e⟩| over the squared Hermitian norm of the point.

    Parameters
    ----------
    points
        (n, 8) Study coordinates, dimensionless.

    Returns
    -------
    numpy.ndarray
        (n,) zero at infinity, dimensionless.
    """
    e = points[:, :4]
    return np.abs((e * e).sum(axis=1)) / (np.abs(points) ** 2).sum(axis=1)


def round_off(points: ComplexArray) -> FloatArray:
    """Bound the Newton correction that round-off can cause.

    Parameters
    ----------
    points
        (n, 8) Study coordinates, dimensionless.

    Returns
    -------
    numpy.ndarray
        (n,) relative to the point, dimensionless.
    """
    norm = relative_norm(points)
    return np.choose((norm < CLOSE[0]).astype(int) + (norm < CLOSE[1]), ROUND_OFF)


def foresees_infinity(points: ComplexArray, ends: ComplexArray) -> NDArray[np.bool_]:
    """Find the paths that go to infinity.

    Parameters
    ----------
    points
        (n, 8) points of the paths, Study coordinates, dimensionless.
    ends
        (n, 8) their Taylor series summed at τ = 0, dimensionless.

    Returns
    -------
    numpy.ndarray
        (n,) mask.
    """
    (e, h), (e0, h0) = _parts(points), _parts(ends)
    shrinks, norm, norm0 = e0 * h / (e * h0), relative_norm(points), relative_norm(ends)
    no_rotation_part = (e0 < NO_ROTATION_PART[0] * h0) & (shrinks < NO_ROTATION_PART[1])
    no_norm = (norm0 < NO_NORM[0]) & (norm0 < NO_NORM[1] * shrinks**2 * norm)
    beyond_doubles = (norm0 < BEYOND_DOUBLES[0]) & (norm0 < BEYOND_DOUBLES[1] * norm)
    # A series that has not converged lets h explode.
    return (0.25 * h < h0) & (h0 < 4.0 * h) & (no_rotation_part | no_norm | beyond_doubles)


def _parts(x: ComplexArray) -> tuple[FloatArray, FloatArray]:
    return (np.abs(x[:, :4]) ** 2).sum(axis=1), (np.abs(x[:, 4:]) ** 2).sum(axis=1)
