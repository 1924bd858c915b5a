r"""The way of a cable over a pulley that swivels about the cable's own line, and how it changes with the far end.

In the plane of the pulley, with the swivel axis a up, ρ the distance of the far end from it and z its height, the
pulley of radius r has its centre at (r, 0) and the cable comes up the axis to the origin. It leaves the pulley at the
angle φ, where the outward normal u = (cos φ, sin φ) is at right angles to the free cable e = (sin φ, -cos φ):

.. math:: (ρ - r, z) = r u + f e, \qquad f^2 = (ρ - r)^2 + z^2 - r^2, \qquad l = r (π - φ) + f .

Moving the far end by δ changes l by e·δ, φ by u·δ/f, and the heading of the pulley by b·δ/ρ with b = a × radius. Hence

.. math:: ∂e/∂t = u u^T / f + b b^T \sin φ / ρ .

A pulley without radius is a point: any plane through the cable will do. See A. Pott, "Cable-Driven Parallel Robots",
Springer, 2018, section 3.5, for the model.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stewart_pin.typing import FloatArray


class CablePaths(NamedTuple):
    """Ways of n cables, in the axes in which their ends were given.

    Attributes
    ----------
    length
        (n,) from the origin of frame 1 over the pulley to the far end [m].
    free
        (n,) from the pulley to the far end [m]; 0 where the end lies on the swivel axis or within the pulley, and no
        way is defined.
    along
        (n, 3) unit vectors of the free cables, to the far end.
    outward
        (n, 3) normals where they leave the pulley, unit vectors.
    across
        (n, 3) normals of the planes of the pulleys, unit vectors.
    radial
        (n, 3) unit vectors from the swivel axes to the far ends.
    distance
        (n,) distances of the far ends from the swivel axes [m]; those of points are lines aside of the cables.
    radius
        (n,) radii of the pulleys [m].
    """

    length: FloatArray
    free: FloatArray
    along: FloatArray
    outward: FloatArray
    across: FloatArray
    radial: FloatArray
    distance: FloatArray
    radius: FloatArray

    @property
    def _sine(self) -> FloatArray:
        """(n,) sin φ."""
        return _dot(self.along, self.radial)

    def turned(self, motion: FloatArray) -> FloatArray:
        """Turn the free cables as motions of the far ends do, seen from body 1.

        Parameters
        ----------
        motion
            (n, 3) velocities or displacements of the far ends [m, or per s].

        Returns
        -------
        numpy.ndarray
            (n, 3) rates of `along` [1, or per s].
        """
        inside = _dot(self.outward, motion) / _safe(self.free)
        aside = _dot(self.across, motion) * self._sine / _safe(self.distance)
        return inside[:, None] * self.outward + aside[:, None] * self.across

    def bent(self, velocity: FloatArray, motion: FloatArray) -> FloatArray:
        """Change the curvature of the ways along a velocity, as displacements of the far ends do.

        Parameters
        ----------
        velocity
            (n, 3) velocities of the far ends [m/s].
        motion
            (n, 3) displacements of the far ends [m].

        Returns
        -------
        numpy.ndarray
            (n,) change of velocityᵀ (∂e/∂t) velocity for a velocity that stays [m/s²].
        """
        free, distance, radial = _safe(self.free), _safe(self.distance), self.radial
        cosine, curve = _dot(self.outward, radial), self._sine / distance
        # How the frame of the free cable moves: along by `lead`, about the pulley by `roll`, about the swivel by `yaw`.
        lead, roll = _dot(self.along, motion), _dot(self.outward, motion) / free
        yaw = _dot(self.across, motion) / distance
        longer = lead + self.radius * roll
        outward = -roll[:, None] * self.along + (cosine * yaw)[:, None] * self.across
        across = -yaw[:, None] * radial
        inside, aside = _dot(self.outward, velocity), _dot(self.across, velocity)
        curve_rate = cosine * roll / distance - curve * _dot(radial, motion) / distance
        return (
            -longer / free**2 * inside**2
            + 2 / free * inside * _dot(outward, velocity)
            + curve_rate * aside**2
            + 2 * curve * aside * _dot(across, velocity)
        )


def cable_paths(apart: FloatArray, axis: FloatArray, radius: FloatArray) -> CablePaths:
    """Lay cables over their pulleys.

    Parameters
    ----------
    apart
        (n, 3) far ends from the origins of frames 1 [m].
    axis
        (n, 3) swivel axes in the same axes, unit vectors.
    radius
        (n,) radii of the pulleys [m].

    Returns
    -------
    CablePaths
        Their ways.
    """
    # The world axis that is least along a cable from a point spans a plane with it that is never in doubt.
    sidewise = np.eye(3)[np.abs(apart).argmin(axis=1)]
    axis = np.where((radius > 0)[:, None], axis, sidewise)
    height = _dot(axis, apart)
    aside = apart - height[:, None] * axis
    distance = np.sqrt(_dot(aside, aside))
    beyond = distance - radius
    square = beyond**2 + height**2 - radius**2
    defined = (distance > 0) & (square > 0)
    free = np.sqrt(np.where(defined, square, 0.0))
    whole = _safe(free**2 + radius**2)
    cosine, sine = (radius * beyond - free * height) / whole, (radius * height + free * beyond) / whole
    radial = aside / _safe(distance)[:, None]
    angle = np.arctan2(height, beyond) + np.arctan2(free, radius)
    return CablePaths(
        length=radius * (np.pi - angle) + free,
        free=free,
        along=sine[:, None] * radial - cosine[:, None] * axis,
        outward=cosine[:, None] * radial + sine[:, None] * axis,
        across=np.cross(axis, radial),
        radial=radial,
        distance=distance,
        radius=radius,
    )


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return (a * b).sum(axis=1)


def _safe(sizes: FloatArray) -> FloatArray:
    """Divisors: one in place of zero, for what is refused later."""
    return np.where(sizes == 0, 1.0, sizes)
