"""Foresee from a Taylor series that a path goes to infinity, and tell how exact a point near infinity can be.

A solution is at infinity when ⟨e, e⟩ = 0. The gradients are singular there, so a path cannot be followed to
the end; but it is analytic in τ, and its series, summed at τ = 0, shows the end long before round-off spoils
the corrections. Two kinds occur: the rotation part e vanishes altogether (translations without bound), or
⟨e, e⟩ vanishes and e does not (rotation entries without bound). Finite solutions that lie next to infinity
look alike from afar, with ⟨e, e⟩ in proportion to |e|⁴ as e decreases; so an end that is not zero to all
digits must vanish faster than that to count.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stewart_pin.analysis.assembly_modes.study import ComplexArray
from stewart_pin.typing import FloatArray

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
