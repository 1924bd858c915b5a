"""Six-legged platforms of the usual designs: semi-regular hexagons, the 6-3 platform, and the cube.

Legs are numbered counter-clockwise in pairs; the points of base and platform lie in the planes z = 0 of their frames.

References
----------
.. [1] J.-P. Merlet, "Parallel Robots", 2nd ed., Springer, 2006, ch. 2 (designs) and ch. 6 (singularities).
.. [2] Z. J. Geng, L. S. Haynes, "Six degree-of-freedom active vibration control using the Stewart platforms", IEEE
   Trans. Control Systems Technology 2(1), 1994 (the cubic configuration).
"""

from __future__ import annotations

import numpy as np

from stewart_pin.checks import as_array, as_positive
from stewart_pin.errors import InputError
from stewart_pin.geometry.hexapod import Hexapod
from stewart_pin.typing import FloatArray

_THIRD = 2 * np.pi / 3
_SIMILAR = 1e-9
"""Angle by which two hexagons may differ and still count as similar [rad]: a rounded input."""


def semi_regular_hexapod(
    base_radius: float, platform_radius: float, base_half_angle: float, platform_half_angle: float
) -> Hexapod:
    """Put the leg ends on two circles, in pairs that repeat every 120°.

    Base pairs stand about 0°, 120° and 240°, platform pairs about 60°, 180° and 300°; neighbouring legs lean towards
    each other in turn at the bottom and at the top.

    Parameters
    ----------
    base_radius, platform_radius
        Radii of the circles [m].
    base_half_angle, platform_half_angle
        Half the angle between the two points of a pair, as seen from the centre; from 0, where they coincide, to below
        60° [rad].

    Returns
    -------
    Hexapod
        Legs 1 and 2 stand on the first base pair, and so on.

    Raises
    ------
    InputError
        If a radius is not above zero, an angle is out of range, or the half-angles add up to 60°: base and platform are
        then similar hexagons, and the platform is singular in every pose [1]_.

    References
    ----------
    .. [1] O. Ma, J. Angeles, "Architecture singularities of parallel manipulators", Int. J. Robotics and Automation
       7(1), 1992.

    Examples
    --------
    >>> hexapod = semi_regular_hexapod(0.5, 0.4, 0.2, 0.3)
    >>> hexapod.base_points[:2].round(4)
    array([[ 0.49  , -0.0993,  0.    ],
           [ 0.49  ,  0.0993,  0.    ]])
    """
    base, platform = as_positive("base_radius", base_radius), as_positive("platform_radius", platform_radius)
    lower = _half_angle("base_half_angle", base_half_angle)
    upper = _half_angle("platform_half_angle", platform_half_angle)
    if abs(lower + upper - np.pi / 3) < _SIMILAR:
        raise InputError(
            f"platform_half_angle {upper:.6g} and base_half_angle {lower:.6g} add up to 60°: base and platform are "
            "similar hexagons, and such a platform is singular in every pose; choose another angle"
        )
    side = np.tile([-1.0, 1.0], 3)
    pair = _THIRD * np.repeat(np.arange(3), 2)
    return Hexapod(
        base * _on_circle(pair + lower * side), platform * _on_circle(pair + (np.pi / 3 - upper) * side)
    )


def hexapod_6_3(base_radius: float, platform_radius: float, base_half_angle: float) -> Hexapod:
    """Put the leg ends on six points of the base and three of the platform, where legs meet in pairs.

    Its direct kinematics has at most 16 solutions instead of 40.

    Parameters
    ----------
    base_radius, platform_radius
        Radii of the circles [m].
    base_half_angle
        Half the angle between the two points of a base pair, from 0 (the octahedron, 3-3) to below 60° [rad].

    Returns
    -------
    Hexapod
        Legs 2 and 3 meet at 60°, 4 and 5 at 180°, 6 and 1 at 300°.

    Raises
    ------
    InputError
        If a radius is not above zero, or the angle is out of range.
    """
    return semi_regular_hexapod(base_radius, platform_radius, base_half_angle, 0.0)


def cubic_hexapod(edge: float, leg: float | None = None) -> Hexapod:
    """Lay the legs along six edges of a cube that stands on a corner.

    The base frame is at the middle of the base points. The platform frame is at the centre of the cube, so home, where
    the legs are along the edges, is at position (0, 0, leg / (2√3)) with axes parallel to the base. There neighbouring
    legs are orthogonal, and the Jacobian is decoupled: JᵀJ = diag(2, 2, 2, edge²/2, edge²/2, 2 edge²) [1]_.

    Parameters
    ----------
    edge
        Edge of the cube [m].
    leg
        Length of the legs at home, in the middles of the edges; default: the whole edge, where legs meet in pairs at
        three corners of base and platform [m].

    Returns
    -------
    Hexapod
        Legs in the order of the edges around the cube's diagonal.

    Raises
    ------
    InputError
        If a length is not above zero, or a leg is longer than the edge.

    References
    ----------
    .. [1] Z. J. Geng, L. S. Haynes, "Six degree-of-freedom active vibration control using the Stewart platforms", 1994.
    """
    edge = as_positive("edge", edge)
    leg = edge if leg is None else as_positive("leg", leg)
    if leg > edge:
        raise InputError(f"leg must be at most the cube's edge of {edge:.6g} m, got {leg:.6g}")
    # Seen from the centre, the corners next to the lowest and to the highest one: radius √(2/3), height ∓1/(2√3).
    corner = np.sqrt(2 / 3) * edge
    lift = np.array([0.0, 0.0, edge / (2 * np.sqrt(3))])
    side = np.tile([-1.0, 1.0], 3)
    pair = _THIRD * np.repeat(np.arange(3), 2)
    low, high = corner * _on_circle(pair) - lift, corner * _on_circle(pair + np.pi / 3 * side) + lift
    # Shortened at both ends alike.
    middle, half = (low + high) / 2, (high - low) / 2 * (leg / edge)
    foot, head = middle - half, middle + half
    return Hexapod(foot - [0.0, 0.0, foot[0, 2]], head)


def _on_circle(angle: FloatArray) -> FloatArray:
    return np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)


def _half_angle(name: str, value: float) -> float:
    angle = float(as_array(name, value, ()))
    if not 0 <= angle < np.pi / 3:
        raise InputError(f"{name} must be from 0 to below π/3 (60°), got {angle:.6g} rad")
    return angle
