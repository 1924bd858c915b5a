"""Closed forms of six-legged platforms (UPS and SPS legs), for any batch shape, and the usual designs.

Leg *i* runs from base point *i* (base frame) to platform point *i* (platform frame). Nothing here touches
Pinocchio: these formulas are the oracle for the rest of the package. The semi-regular, the 6-3 and the cubic design
stand below.

References
----------
.. [1] J.-P. Merlet, "Parallel Robots", 2nd ed., Springer, 2006, ch. 2 and 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array, as_batch, as_positive, require_broadcast
from stewart_pin.errors import InputError, SingularityError
from stewart_pin.geometry.rotations import as_rotation
from stewart_pin.tolerances import JACOBIAN_SINGULAR
from stewart_pin.typing import ArrayLike, FloatArray

if TYPE_CHECKING:

    class _HasLegPoints(Protocol):
        def leg_points(self) -> tuple[FloatArray, FloatArray]: ...


STANDARD_GRAVITY = (0.0, 0.0, -9.81)
"""Gravity of the package's robots, in the world frame [m/s²]."""


@dataclass(frozen=True, eq=False, repr=False)
class Hexapod(Brief):
    """Geometry of a six-legged platform.

    Attributes
    ----------
    base_points
        (6, 3) lower leg ends, in the base frame [m].
    platform_points
        (6, 3) upper leg ends, in the platform frame [m].
    """

    base_points: FloatArray
    platform_points: FloatArray

    def __post_init__(self) -> None:
        for name in ("base_points", "platform_points"):
            points = as_array(name, getattr(self, name), (6, 3)).copy()
            points.setflags(write=False)
            object.__setattr__(self, name, points)

    @classmethod
    def from_points(cls, table: ArrayLike) -> Hexapod:
        """Take the twelve leg ends from one table.

        Parameters
        ----------
        table
            (6, 6) one leg per row, base x y z, platform x y z; or (12, 3) six base points, then the platform's [m].

        Returns
        -------
        Hexapod
            Legs in the order of the rows.

        Raises
        ------
        InputError
            If the table has another shape, or a row holds something else than finite numbers; names the row.

        Examples
        --------
        >>> rows = [[k // 2 - 1, k % 2, 0, k % 3 - 1, k // 3, 0] for k in range(6)]
        >>> Hexapod.from_points(rows).platform_points[1]
        array([0., 0., 0.])
        """
        if not isinstance(table, Sequence | np.ndarray) or isinstance(table, str):
            raise InputError(f"table must be rows of numbers, got {type(table).__name__}")
        rows = [as_array(f"table row {k}", row, (None,)) for k, row in enumerate(table, start=1)]
        width = {6: 6, 12: 3}.get(len(rows))
        if width is None:
            raise InputError(
                f"table must have 6 rows of base x y z, platform x y z, or 12 rows of x y z, got {len(rows)} rows"
            )
        for k, row in enumerate(rows, start=1):
            if len(row) != width:
                raise InputError(f"table row {k} has {len(row)} numbers, one of {len(rows)} rows has {width}")
        points = np.array(rows)
        return cls(points[:, :3], points[:, 3:]) if width == 6 else cls(points[:6], points[6:])

    @classmethod
    def from_chain(cls, chain: _HasLegPoints) -> Hexapod:
        """Read the twelve leg ends off a closed chain.

        Parameters
        ----------
        chain
            A chain whose six motors are the prismatic joints of legs with a point-like joint at either end.

        Returns
        -------
        Hexapod
            Legs in the order of ``chain.motors``.
        """
        return cls(*chain.leg_points())


def require_hexapod(value: object) -> None:
    """Refuse what is no geometry of a platform on legs.

    Parameters
    ----------
    value
        What the caller passed.

    Raises
    ------
    InputError
        If it is something else, as a chain; says what takes one.
    """
    if not isinstance(value, Hexapod):
        raise InputError(
            f"a closed form of platforms on legs takes a Hexapod, got {type(value).__name__}; for a chain use "
            "Hexapod.from_chain(chain), or inverse_kinematics, forward_kinematics and motor_jacobian, which take it"
        )


def leg_vectors(hexapod: Hexapod, position: ArrayLike, rotation: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Compute the vectors along the legs and the arms to the platform points.

    Parameters
    ----------
    hexapod
        Geometry.
    position
        (..., 3) platform origin in the base frame [m].
    rotation
        (..., 3, 3) platform axes in the base frame.

    Returns
    -------
    legs : numpy.ndarray
        (..., 6, 3) from base to platform point, in the base frame [m].
    arms : numpy.ndarray
        (..., 6, 3) from platform origin to platform point, in the base frame [m].
    """
    require_hexapod(hexapod)
    position = as_batch("position", position, (3,))
    rotation = as_rotation("rotation", rotation)
    require_broadcast(position=position.shape[:-1], rotation=rotation.shape[:-2])
    arms = np.einsum("...ij,kj->...ki", rotation, hexapod.platform_points)
    return position[..., None, :] + arms - hexapod.base_points, arms


def leg_lengths(hexapod: Hexapod, position: ArrayLike, rotation: ArrayLike) -> FloatArray:
    """Compute the six leg lengths of a pose: ``l = |p + R P - B|``.

    Parameters
    ----------
    hexapod
        Geometry.
    position
        (..., 3) platform origin in the base frame [m].
    rotation
        (..., 3, 3) platform axes in the base frame.

    Returns
    -------
    numpy.ndarray
        (..., 6) lengths [m].
    """
    return np.linalg.norm(leg_vectors(hexapod, position, rotation)[0], axis=-1)


def leg_jacobian(hexapod: Hexapod, position: ArrayLike, rotation: ArrayLike) -> FloatArray:
    """Compute the map from platform twist to leg rates.

    Row *i* is [uᵀ, (R P × u)ᵀ] with u the unit vector along leg *i* from base to platform [1]_.

    Parameters
    ----------
    hexapod
        Geometry.
    position
        (..., 3) platform origin in the base frame [m].
    rotation
        (..., 3, 3) platform axes in the base frame.

    Returns
    -------
    numpy.ndarray
        (..., 6, 6) leg rates [m/s] per twist [v; ω] of the platform origin in base axes.

    Raises
    ------
    SingularityError
        If a leg has no length, and therefore no direction.

    References
    ----------
    .. [1] J.-P. Merlet, "Parallel Robots", 2nd ed., 2006, section 5.3 (inverse Jacobian).
    """
    legs, arms = leg_vectors(hexapod, position, rotation)
    lengths = np.linalg.norm(legs, axis=-1, keepdims=True)
    if (lengths == 0.0).any():
        leg = int(np.argwhere(lengths[..., 0] == 0.0)[0][-1])
        raise SingularityError(
            f"leg {leg + 1} has length zero and no direction; move the platform", smallest_singular_value=0.0
        )
    u = legs / lengths
    return np.concatenate([u, np.cross(arms, u)], axis=-1)


def leg_forces_for_wrench(jacobian: FloatArray, wrench: ArrayLike) -> FloatArray:
    """Solve Jᵀ f = w for the leg forces that put a wrench on the platform.

    Parameters
    ----------
    jacobian
        (..., 6, 6) from `leg_jacobian` [1, m].
    wrench
        (..., 6) force and moment about the platform origin, in base axes [N, N m].

    Returns
    -------
    numpy.ndarray
        (..., 6) leg forces, positive pushing the platform away from the base [N].

    Raises
    ------
    SingularityError
        If a Jacobian is singular.
    """
    wrench = as_batch("wrench", wrench, (6,))
    singular = np.linalg.svd(jacobian, compute_uv=False)
    worst = singular[..., -1] / singular[..., 0]
    if (worst < JACOBIAN_SINGULAR).any():
        smallest = float(singular[..., -1].ravel()[np.argmin(worst)])
        raise SingularityError(
            f"the legs cannot carry every wrench here: the leg Jacobian is singular "
            f"(smallest singular value {smallest:.3g}); move away from this pose",
            smallest_singular_value=smallest,
        )
    return np.linalg.solve(np.swapaxes(jacobian, -1, -2), wrench[..., None])[..., 0]


def point_mass_forces(
    hexapod: Hexapod,
    position: ArrayLike,
    rotation: ArrayLike,
    acceleration: ArrayLike,
    *,
    mass: float,
    gravity: ArrayLike = STANDARD_GRAVITY,
    wrench: ArrayLike | None = None,
) -> FloatArray:
    """Compute the leg forces for a point mass on massless legs: f = J⁻ᵀ ([m (a - g); 0] - wrench).

    Parameters
    ----------
    hexapod
        Geometry.
    position
        (..., 3) platform origin, which carries the mass, in the base frame [m].
    rotation
        (..., 3, 3) platform axes in the base frame.
    acceleration
        (..., 3) of the platform origin, in base axes [m/s²].
    mass
        Platform mass [kg].
    gravity
        (3,) acceleration of free fall in base axes [m/s²].
    wrench
        (..., 6) [force; moment] from outside on the platform at its origin, in base axes; default: none [N, N m].

    Returns
    -------
    numpy.ndarray
        (..., 6) leg forces, positive pushing the platform away from the base [N].
    """
    mass = as_positive("mass", mass)
    jacobian = leg_jacobian(hexapod, position, rotation)
    push = mass * (as_batch("acceleration", acceleration, (3,)) - as_array("gravity", gravity, (3,)))
    require_broadcast(position=jacobian.shape[:-2], acceleration=push.shape[:-1])
    load = np.concatenate([push, np.zeros_like(push)], axis=-1)
    if wrench is not None:
        outside = as_batch("wrench", wrench, (6,))
        require_broadcast(
            position=jacobian.shape[:-2], acceleration=push.shape[:-1], wrench=outside.shape[:-1]
        )
        load = load - outside
    return leg_forces_for_wrench(jacobian, load)


# ----------------------------------------------------------------------------------------------------
# Six-legged platforms of the usual designs: semi-regular hexagons, the 6-3 platform, and the cube
#
# Legs are numbered counter-clockwise in pairs; the points of base and platform lie in the planes z = 0 of their frames.
#
# References
# ----------
# .. [1] J.-P. Merlet, "Parallel Robots", 2nd ed., Springer, 2006, ch. 2 (designs) and ch. 6 (singularities).
# .. [2] Z. J. Geng, L. S. Haynes, "Six degree-of-freedom active vibration control using the Stewart platforms", IEEE
#    Trans. Control Systems Technology 2(1), 1994 (the cubic configuration).
# ----------------------------------------------------------------------------------------------------

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
