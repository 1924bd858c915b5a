"""Closed forms of the Delta robot, for any batch shape: three rotary legs and a platform that does not turn.

The two rods of a parallelogram act like one rod between their middles, so a Delta is a `RotaryLegs` of three legs, and
`crank_angles` is its inverse kinematics.

References
----------
.. [1] R. Clavel, "DELTA, a fast robot with parallel geometry", 18th Int. Symp. on Industrial Robots, 1988.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array, as_positive
from stewart_pin.errors import InputError, SingularityError, UnreachableError
from stewart_pin.geometry.rotary import RotaryLegs, crank_vectors
from stewart_pin.tolerances import ROUND_OFF
from stewart_pin.typing import ArrayLike, BoolArray, FloatArray

_IN_LINE = 1e-12
"""Area over the squares of rod and longest side below which three knees stand in line, or at one point."""


def delta_legs(
    *,
    base_radius: float,
    platform_radius: float,
    crank: float,
    rod: float,
    directions: ArrayLike = (0.0, 2 * np.pi / 3, 4 * np.pi / 3),
) -> RotaryLegs:
    """Build the geometry of a Delta: cranks level and outward at angle zero, positive angles turn them down.

    Parameters
    ----------
    base_radius
        Distance of the cranks' axes from the centre of the base [m].
    platform_radius
        Distance of the middles of the parallelograms' lower ends from the centre of the platform [m].
    crank
        Length of the driven arms [m].
    rod
        Length of the parallelograms [m].
    directions
        (3,) directions of the arms, from base x towards base y [rad].

    Returns
    -------
    RotaryLegs
        Three legs in the order of the directions.

    Raises
    ------
    InputError
        If a length is not above zero.

    Examples
    --------
    >>> legs = delta_legs(base_radius=0.132, platform_radius=0.033, crank=0.112, rod=0.232)
    >>> delta_positions(legs, [0.5, 0.5, 0.5]).position[0].round(4) + 0.0
    array([ 0.    ,  0.    , -0.1758])
    """
    angle = as_array("directions", directions, (3,))
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros(3)], axis=1)
    across = np.stack([-np.sin(angle), np.cos(angle), np.zeros(3)], axis=1)
    lengths = np.array([as_positive("crank", crank), as_positive("rod", rod)])
    return RotaryLegs(
        base_points=as_positive("base_radius", base_radius) * out,
        axes=across,
        zeros=out,
        platform_points=as_positive("platform_radius", platform_radius) * out,
        cranks=np.full(3, lengths[0]),
        rods=np.full(3, lengths[1]),
    )


@dataclass(frozen=True, eq=False, repr=False)
class DeltaPositions(Brief):
    """Where the platform of a Delta can be for given crank angles.

    Attributes
    ----------
    position
        (..., 2, 3) platform origin in the base frame: first behind the plane of the three knees, as one sees it with
        the legs counter-clockwise, which is below the base of a hanging robot, then in front of it [m]. Beyond reach
        both are the foot of the perpendicular in that plane.
    success
        (...) whether the rods meet [truth value, dimensionless].
    """

    position: FloatArray
    success: BoolArray


def delta_positions(legs: RotaryLegs, angle: ArrayLike, *, throw: bool = True) -> DeltaPositions:
    """Compute both positions of a Delta's platform: where three spheres about its knees meet [1]_.

    The platform keeps the orientation of the base.

    Parameters
    ----------
    legs
        Geometry with three legs.
    angle
        (..., 3) crank angles [rad].
    throw
        Whether rods that do not meet are an error; otherwise `DeltaPositions.success` tells.

    Returns
    -------
    DeltaPositions
        Both positions.

    Raises
    ------
    InputError
        If there are not three legs, or an argument is wrong.
    SingularityError
        If the knees stand in line, so that the platform can turn about them.
    UnreachableError
        If the rods do not meet.

    References
    ----------
    .. [1] R. Clavel, "DELTA, a fast robot with parallel geometry", 1988.
    """
    if len(legs.cranks) != 3:
        raise InputError(f"legs must be the three of a Delta, got {len(legs.cranks)}")
    # Each knee, seen from the platform's origin instead of its own platform point.
    knees = legs.base_points + crank_vectors(legs, angle)[0] - legs.platform_points
    first, sides = knees[..., 0, :], knees[..., 1:, :] - knees[..., :1, :]
    normal = np.cross(sides[..., 0, :], sides[..., 1, :])
    area, size = np.linalg.norm(normal, axis=-1), np.linalg.norm(sides, axis=-1).max(axis=-1)
    if (area <= _IN_LINE * (size**2 + legs.rods[0] ** 2)).any():
        raise SingularityError(
            "the knees, seen from the platform, stand in line: it can turn about them; move the cranks",
            smallest_singular_value=float(area.min()),
        )
    normal = normal / area[..., None]
    # 2 s_k · x = l_1² - l_k² + s_k² with x from the first knee, and x in the plane of the knees.
    system = np.concatenate([2 * sides, normal[..., None, :]], axis=-2)
    sums = legs.rods[0] ** 2 - legs.rods[1:] ** 2 + np.sum(sides**2, axis=-1)
    right = np.concatenate([sums, np.zeros((*area.shape, 1))], axis=-1)
    foot = np.linalg.solve(system, right[..., None])[..., 0]
    rise2 = legs.rods[0] ** 2 - np.sum(foot**2, axis=-1)
    success = np.asarray(rise2 >= -ROUND_OFF * (legs.rods[0] ** 2 + size**2))
    if throw and not success.all():
        worst = np.unravel_index(int(np.argmin(rise2)), success.shape)
        apart = float(np.linalg.norm(foot[worst]))
        raise UnreachableError(
            f"the rods do not meet{f' at index {tuple(map(int, worst))}' if worst else ''}: the point nearest to the "
            f"knees is {apart:.6g} m from the first, whose rod is {legs.rods[0]:.6g} m long; choose other crank angles",
            violations={"leg 1": (apart, 0.0, float(legs.rods[0]))},
            residual=apart - float(legs.rods[0]),
            iterations=0,
            q=np.asarray(angle, dtype=float),
        )
    rise = np.sqrt(np.maximum(rise2, 0.0))[..., None] * normal
    middle = first + foot
    return DeltaPositions(np.stack([middle - rise, middle + rise], axis=-2), success)
