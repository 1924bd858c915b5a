"""Closed forms of platforms on rotary legs (RSS), for any batch shape and any number of legs; of the Delta both ways.

Leg *i* is a driven crank that turns about a fixed axis, and a rod with a ball at either end, from the crank's tip to
platform point *i*.

References
----------
.. [1] J.-P. Merlet, "Parallel Robots", 2nd ed., Springer, 2006, ch. 2 and 3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array, as_batch, as_positive, require_broadcast
from stewart_pin.errors import InputError, SingularityError, UnreachableError
from stewart_pin.geometry.rotations import as_rotation
from stewart_pin.tolerances import ROUND_OFF
from stewart_pin.typing import ArrayLike, BoolArray, FloatArray

_SQUARE = 1e-9
"""Cosine between a crank's axis and its zero direction that is still round-off of printed figures."""
_SINGULAR = 1e-12
"""Sine of the angle between rod and crank below which the crank is at a dead centre."""


@dataclass(frozen=True, eq=False, repr=False)
class RotaryLegs(Brief):
    """Geometry of n legs, each a crank and a rod.

    Attributes
    ----------
    base_points
        (n, 3) centres of the circles on which the tips of the cranks run, in the base frame [m].
    axes
        (n, 3) directions about which the cranks turn, in the base frame; made unit vectors, dimensionless.
    zeros
        (n, 3) directions of the cranks at angle zero, square to the axes, in the base frame; made unit vectors,
        dimensionless.
    platform_points
        (n, 3) ends of the rods, in the platform frame [m].
    cranks, rods
        (n,) lengths, or one for all [m].
    """

    base_points: FloatArray
    axes: FloatArray
    zeros: FloatArray
    platform_points: FloatArray
    cranks: FloatArray
    rods: FloatArray

    def __post_init__(self) -> None:
        points = as_array("base_points", self.base_points, (None, 3))
        shape = (len(points), 3)
        fields = {
            name: as_array(name, getattr(self, name), shape) for name in ("axes", "zeros", "platform_points")
        }
        fields["base_points"] = points
        for name in ("axes", "zeros"):
            sizes = np.linalg.norm(fields[name], axis=1, keepdims=True)
            if not sizes.all():
                raise InputError(
                    f"{name}: leg {int(np.argmin(sizes)) + 1} has a vector of length zero; give a direction"
                )
            fields[name] = fields[name] / sizes
        lean = np.abs(np.einsum("ij,ij->i", fields["axes"], fields["zeros"]))
        if (lean > _SQUARE).any():
            raise InputError(
                f"zeros: that of leg {int(np.argmax(lean)) + 1} is not square to its axis, the cosine between them is "
                f"{lean.max():.3g}; a crank turns in the plane across its axis"
            )
        for name in ("cranks", "rods"):
            lengths = as_batch(name, getattr(self, name), ())
            if lengths.shape not in ((), shape[:1]):
                raise InputError(
                    f"{name} must have shape ({shape[0]},) or be one number, got {lengths.shape}"
                )
            lengths = np.broadcast_to(lengths, shape[:1])
            fields[name] = np.array([as_positive(f"{name}[{k}]", value) for k, value in enumerate(lengths)])
        for name, value in fields.items():
            kept = value.copy()
            kept.setflags(write=False)
            object.__setattr__(self, name, kept)


@dataclass(frozen=True, eq=False, repr=False)
class CrankAngles(Brief):
    """Crank angles for a pose, on both branches of every leg.

    Attributes
    ----------
    angle
        (..., n, 2) crank angles: first the branch on which a positive rate pushes the platform point away, then the
        one on which it pulls; in (-π, π], or inside the limits by whole turns [rad]. Beyond a leg's reach both are the
        angle that comes nearest.
    within
        (..., n, 2) whether the branch exists and keeps the limits.
    shortage
        (..., n) by how much a rod is too short (positive) or too long (negative); 0 within reach [m].
    """

    angle: FloatArray
    within: BoolArray
    shortage: FloatArray

    @property
    def success(self) -> BoolArray:
        """(...) whether every leg has a branch within its limits [truth value, dimensionless]."""
        return np.asarray(self.within.any(axis=-1).all(axis=-1))


def crank_angles(
    legs: RotaryLegs,
    position: ArrayLike,
    rotation: ArrayLike,
    *,
    limits: ArrayLike | None = None,
    throw: bool = True,
) -> CrankAngles:
    """Compute the crank angles that put the platform at a pose, on both branches.

    With d from the crank's centre to the platform point, r and l the lengths of crank and rod, e and f the directions
    of the crank at angles 0 and π/2, the rod closes where 2 r (d·e cos θ + d·f sin θ) = d² + r² - l² [1]_.

    Parameters
    ----------
    legs
        Geometry.
    position
        (..., 3) platform origin in the base frame [m].
    rotation
        (..., 3, 3) platform axes in the base frame.
    limits
        (n, 2), or (2,) for all: least and greatest crank angle; default: none [rad].
    throw
        Whether a leg without a branch within its limits is an error; otherwise `CrankAngles.within` tells.

    Returns
    -------
    CrankAngles
        Angles of both branches.

    Raises
    ------
    UnreachableError
        If a leg cannot reach; names the leg, and what its rod or its limits would have to be.
    SingularityError
        If a platform point is on the axis of its crank, and any angle will do.
    InputError
        If an argument has the wrong shape or is not finite.

    References
    ----------
    .. [1] J.-P. Merlet, "Parallel Robots", 2nd ed., 2006, section 3.1 (inverse kinematics).
    """
    reach, _ = _reaches(legs, position, rotation)
    along, square = _components(legs, reach)
    in_plane = np.hypot(along, square)
    distance2 = np.einsum("...i,...i->...", reach, reach)
    # The rod's length must lie between the distances of the platform point from the crank's circle.
    across2 = np.maximum(distance2 - in_plane**2, 0.0)
    nearest = np.sqrt(across2 + (in_plane - legs.cranks) ** 2)
    farthest = np.sqrt(across2 + (in_plane + legs.cranks) ** 2)
    slack = ROUND_OFF * (farthest + legs.rods)
    short, long = nearest - legs.rods, legs.rods - farthest
    shortage = np.where(short > slack, short, 0.0) - np.where(long > slack, long, 0.0)
    # By half the angle: within reach both sides of the fraction are positive, and no cosine has to be clipped.
    opening = 2 * np.arctan2(
        np.sqrt(np.maximum(legs.rods**2 - nearest**2, 0.0)),
        np.sqrt(np.maximum(farthest**2 - legs.rods**2, 0.0)),
    )
    towards = np.arctan2(square, along)
    angle = np.stack([towards - opening, towards + opening], axis=-1)
    low, high = _limits(limits, len(legs.cranks))
    bounded = np.isfinite(low) & np.isfinite(high)
    # Of limits with one end, the middle is where they allow least a turn; beyond the end, the next turn is within.
    ends = np.where(bounded, low, 0.0) + np.where(bounded, high, 0.0)
    middle = np.where(bounded, ends / 2, np.clip(0.0, low, high))
    angle = angle - 2 * np.pi * np.ceil((angle - middle) / (2 * np.pi) - 0.5)
    turns = np.where(~bounded & (angle < low), 1, np.where(~bounded & (angle > high), -1, 0))
    angle = angle + 2 * np.pi * turns
    within = (shortage[..., None] == 0) & (angle >= low) & (angle <= high)
    found = CrankAngles(angle, within, shortage)
    anywhere = (shortage == 0) & (in_plane <= _SINGULAR * legs.cranks)
    if anywhere.any():
        raise SingularityError(
            f"leg {int(np.argwhere(anywhere)[0][-1]) + 1}: the platform point is on the axis of the crank, so any "
            "angle will do; move the platform",
            smallest_singular_value=0.0,
        )
    if throw and not found.success.all():
        raise _unreachable(legs, found, nearest, farthest, low, high)
    return found


def crank_jacobian(
    legs: RotaryLegs, position: ArrayLike, rotation: ArrayLike, angle: ArrayLike
) -> FloatArray:
    """Compute the map from platform twist to crank rates.

    Row *i* is [uᵀ, (R P × u)ᵀ] / (u · dc/dθ), with u along the rod from crank to platform and c(θ) the crank.

    Parameters
    ----------
    legs
        Geometry.
    position
        (..., 3) platform origin in the base frame [m].
    rotation
        (..., 3, 3) platform axes in the base frame.
    angle
        (..., n) crank angles that fit the pose [rad].

    Returns
    -------
    numpy.ndarray
        (..., n, 6) crank rates [rad/s] per twist [v; ω] of the platform origin in base axes [m/s, rad/s].

    Raises
    ------
    SingularityError
        If a crank is at a dead centre, in one plane with rod and axis: it cannot move the platform.
    InputError
        If an argument is wrong, or a rod has not its length at these angles.
    """
    reach, arms = _reaches(legs, position, rotation)
    crank, sweep = crank_vectors(legs, angle)
    require_broadcast(pose=reach.shape[:-2], angle=crank.shape[:-2])
    rods = reach - crank
    lengths = np.linalg.norm(rods, axis=-1)
    off = np.abs(lengths - legs.rods) / legs.rods
    if off.max(initial=0.0) > 1e-6:
        leg = int(np.argwhere(off > 1e-6)[0][-1])
        raise InputError(
            f"angle: the rod of leg {leg + 1} would be {lengths[off > 1e-6][0]:.6g} m long, it is "
            f"{legs.rods[leg]:.6g} m; see crank_angles"
        )
    u = rods / lengths[..., None]
    gain = np.einsum("...i,...i->...", u, sweep)
    dead = np.abs(gain) < _SINGULAR * legs.cranks
    if dead.any():
        leg = int(np.argwhere(dead)[0][-1])
        raise SingularityError(
            f"the crank of leg {leg + 1} is at a dead centre: its rod pushes along crank and axis only; move the "
            "platform",
            smallest_singular_value=float(np.abs(gain).min()),
        )
    return np.concatenate([u, np.cross(np.broadcast_to(arms, u.shape), u)], axis=-1) / gain[..., None]


def _reaches(legs: RotaryLegs, position: ArrayLike, rotation: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Vectors from the cranks' centres to the platform points, and the arms R P, each (..., n, 3) [m]."""
    position = as_batch("position", position, (3,))
    rotation = as_rotation("rotation", rotation)
    require_broadcast(position=position.shape[:-1], rotation=rotation.shape[:-2])
    arms = np.einsum("...ij,kj->...ki", rotation, legs.platform_points)
    return position[..., None, :] + arms - legs.base_points, arms


def _components(legs: RotaryLegs, vector: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Components of vectors in the planes of the cranks: along angle 0 and along angle π/2."""
    ahead = np.cross(legs.axes, legs.zeros)
    return tuple(np.einsum("...ki,ki->...k", vector, direction) for direction in (legs.zeros, ahead))


def crank_vectors(legs: RotaryLegs, angle: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Compute the cranks and their derivatives by the angle.

    Parameters
    ----------
    legs
        Geometry.
    angle
        (..., n) crank angles [rad].

    Returns
    -------
    crank : numpy.ndarray
        (..., n, 3) from centre to tip, in the base frame [m].
    sweep : numpy.ndarray
        (..., n, 3) derivative by the angle, in the base frame [m].
    """
    angle = as_batch("angle", angle, legs.cranks.shape)
    cos, sin = np.cos(angle)[..., None], np.sin(angle)[..., None]
    ahead, lengths = np.cross(legs.axes, legs.zeros), legs.cranks[:, None]
    return lengths * (cos * legs.zeros + sin * ahead), lengths * (cos * ahead - sin * legs.zeros)


def _limits(limits: ArrayLike | None, count: int) -> tuple[FloatArray, FloatArray]:
    """Limits as (n, 1) arrays."""
    if limits is None:
        return np.full((count, 1), -np.inf), np.full((count, 1), np.inf)
    try:
        pair = np.broadcast_to(np.asarray(limits, dtype=float), (count, 2))
    except ValueError:
        raise InputError(f"limits must have shape ({count}, 2) or (2,), got {np.shape(limits)}") from None
    if not (pair[:, 0] <= pair[:, 1]).all():
        leg = int(np.argmin(pair[:, 0] <= pair[:, 1]))
        raise InputError(f"limits: those of leg {leg + 1} are {pair[leg]}; give the least angle first")
    return pair[:, :1], pair[:, 1:]


def _unreachable(
    legs: RotaryLegs,
    found: CrankAngles,
    nearest: FloatArray,
    farthest: FloatArray,
    low: FloatArray,
    high: FloatArray,
) -> UnreachableError:
    """Name the first leg that has no branch."""
    where = tuple(int(k) for k in np.argwhere(~found.within.any(axis=-1))[0])
    leg, index = where[-1], f" at index {where[:-1]}" if where[:-1] else ""
    if found.shortage[where]:
        bounds = (float(legs.rods[leg]), float(nearest[where]), float(farthest[where]))
        reason = (
            f"its rod is {bounds[0]:.6g} m long, its platform point is {bounds[1]:.6g} to {bounds[2]:.6g} m from the "
            "circle of its crank"
        )
    else:
        # The branch that misses its limits by less.
        beyond = np.maximum(low[leg] - found.angle[where], found.angle[where] - high[leg])
        bounds = (float(found.angle[where][np.argmin(beyond)]), float(low[leg, 0]), float(high[leg, 0]))
        reason = f"its crank would stand at {bounds[0]:.6g} rad, beyond its limits {bounds[1]:.6g} to {bounds[2]:.6g}"
    return UnreachableError(
        f"leg {leg + 1} cannot reach the pose{index}: {reason}; move the platform",
        violations={f"leg {leg + 1}": bounds},
        residual=float(np.abs(found.shortage).max()),
        iterations=0,
        q=found.angle,
    )


# ----------------------------------------------------------------------------------------------------
# The Delta robot: three rotary legs and a platform that does not turn
#
# The two rods of a parallelogram act like one rod between their middles, so a Delta is a `RotaryLegs` of three legs,
# and `crank_angles` is its inverse kinematics.
# ----------------------------------------------------------------------------------------------------

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
