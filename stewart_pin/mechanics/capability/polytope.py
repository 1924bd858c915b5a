"""Sets of velocities or wrenches with flat faces, and what is asked of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array
from stewart_pin.errors import InputError
from stewart_pin.mechanics.capability.enumeration import Shape, cut, hull
from stewart_pin.typing import ArrayLike, FloatArray

_INSIDE = 1e-9
"""How far outside a point may be by round-off, relative to the size of the polytope."""


@dataclass(frozen=True, eq=False, repr=False)
class Polytope(Brief):
    """All velocities, or all wrenches, that a robot can produce at one configuration.

    Attributes
    ----------
    vertices
        (n, d) corners [m/s, rad/s or N, N m, see `units`].
    normals
        (m, d) outward normals of the faces; ``normals / scale`` has unit length [m/s or N per unit of x].
    offsets
        (m,) such that ``normals @ x <= offsets`` inside: distances from zero in normalised coordinates
        ``scale * x`` [m/s or N].
    limits
        (m,) the limit behind each face, e.g. ``"leg3 at +0.5"``; empty where several share a face.
    names
        (d,) coordinates: ``vx vy vz wx wy wz`` or ``fx fy fz mx my mz`` about the platform origin, in world axes, for
        a platform with six freedoms or with freedoms along axes; else ``mode 1`` ... along the columns of `basis`.
    units
        (d,) unit of each coordinate.
    scale
        (d,) that turns coordinates into one unit, m/s or N: angular velocities times `length`, moments over it
        [1, m or 1/m].
    basis
        (6, d) such that twist or wrench = basis @ x, in world axes [1, and per m for modes].
    length
        Length that makes turning and shifting comparable [m].
    """

    vertices: FloatArray
    normals: FloatArray
    offsets: FloatArray
    limits: tuple[str, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    scale: FloatArray
    basis: FloatArray
    length: float


@dataclass(frozen=True, eq=False, repr=False)
class Ball(Brief):
    """The largest ball about rest that fits into a polytope: what is possible in every direction.

    Attributes
    ----------
    radius
        In normalised coordinates; negative when even zero lies outside, by at least that much [m/s or N].
    direction
        (d,) worst direction, as a point on the ball, in the polytope's coordinates [m/s, rad/s or N, N m].
    limit
        The limit that is met there.
    """

    radius: float
    direction: FloatArray
    limit: str


def polytope_support(polytope: Polytope, direction: ArrayLike) -> float:
    """Find the greatest component along a direction, all other components being free.

    Parameters
    ----------
    polytope
        Velocities or wrenches.
    direction
        (d,) weights of the coordinates [dimensionless].

    Returns
    -------
    float
        Maximum of ``direction @ x`` over the polytope [unit of the coordinates].
    """
    return float((polytope.vertices @ _direction(polytope, direction)).max())


def polytope_reach(polytope: Polytope, direction: ArrayLike) -> float:
    """Find how far one can go straight along a direction, all other components being zero.

    Parameters
    ----------
    polytope
        Velocities or wrenches that contain zero.
    direction
        (d,) direction in the polytope's coordinates [dimensionless].

    Returns
    -------
    float
        Largest s such that ``s * direction`` is inside [unit of the coordinates].

    Raises
    ------
    InputError
        If zero lies outside.
    """
    return _first(polytope, direction)[0]


def polytope_limit(polytope: Polytope, direction: ArrayLike) -> str:
    """Name the limit that is met first along a direction, all other components being zero.

    Parameters
    ----------
    polytope
        Velocities or wrenches that contain zero.
    direction
        (d,) direction in the polytope's coordinates [dimensionless].

    Returns
    -------
    str
        The limit; empty where several motors share it.

    Raises
    ------
    InputError
        If zero lies outside.
    """
    return _first(polytope, direction)[1]


def polytope_contains(polytope: Polytope, points: ArrayLike) -> np.ndarray:
    """Tell which points lie inside.

    Parameters
    ----------
    polytope
        Velocities or wrenches.
    points
        (..., d) in the polytope's coordinates [m/s, rad/s or N, N m].

    Returns
    -------
    numpy.ndarray
        (...) of bool; points on the boundary count as inside, to round-off [dimensionless].
    """
    points = np.asarray(points, dtype=float)
    points = as_array("points", points, (*points.shape[:-1], len(polytope.names)))
    slack = _INSIDE * np.abs(polytope.vertices * polytope.scale).max()
    return (points @ polytope.normals.T <= polytope.offsets + slack).all(axis=-1)


def inscribed_ball(polytope: Polytope) -> Ball:
    """Find the largest ball about zero, and so the direction in which the robot can do least.

    Parameters
    ----------
    polytope
        Velocities or wrenches.

    Returns
    -------
    Ball
        Radius [m/s or N], worst direction and the limit that stands in the way.
    """
    worst = int(polytope.offsets.argmin())
    radius = float(polytope.offsets[worst])
    # The normal, of unit length in normalised coordinates, points from zero to where the ball touches.
    touching = radius * polytope.normals[worst] / polytope.scale**2
    return Ball(radius=radius, direction=touching, limit=polytope.limits[worst])


def polytope_section(polytope: Polytope, coordinates: Sequence[int | str] = (0, 1, 2)) -> Polytope:
    """Cut with the subspace in which all other coordinates are zero.

    With the first three coordinates this is the velocities without turning, or the forces without moment.

    Parameters
    ----------
    polytope
        Velocities or wrenches.
    coordinates
        Which coordinates stay, by index or by name, as ``"vx"``.

    Returns
    -------
    Polytope
        In these coordinates alone.

    Raises
    ------
    InputError
        If a coordinate does not exist, or nothing of the polytope lies in the subspace.
    """
    chosen = _coordinates(polytope, coordinates)
    scale = polytope.scale[chosen]
    shape = cut(polytope.normals[:, chosen] / scale, polytope.offsets, polytope.limits)
    if shape is None:
        others = ", ".join(name for k, name in enumerate(polytope.names) if k not in chosen)
        raise InputError(f"no point of the polytope has zero {others}; choose other coordinates")
    return _among(polytope, chosen, shape)


def polytope_projection(polytope: Polytope, coordinates: Sequence[int | str] = (0, 1, 2)) -> Polytope:
    """Cast the shadow on a subspace: all other coordinates may take any value.

    Parameters
    ----------
    polytope
        Velocities or wrenches.
    coordinates
        Which coordinates stay, by index or by name, as ``"vx"``.

    Returns
    -------
    Polytope
        In these coordinates alone.
    """
    chosen = _coordinates(polytope, coordinates)
    return _among(polytope, chosen, hull(polytope.vertices[:, chosen] * polytope.scale[chosen]))


def _first(polytope: Polytope, direction: ArrayLike) -> tuple[float, str]:
    """How far a ray from zero stays inside, and the limit that ends it."""
    direction = _direction(polytope, direction)
    if polytope.offsets.min() < -_INSIDE * np.abs(polytope.offsets).max():
        raise InputError(
            "zero lies outside this polytope, so nothing can be reached from it: the motors cannot hold the robot "
            f"({polytope.limits[int(polytope.offsets.argmin())] or 'several limits'})"
        )
    rate = polytope.normals @ direction
    towards = np.flatnonzero(rate > 1e-12 * float(np.linalg.norm(polytope.scale * direction)))
    ends = polytope.offsets[towards] / rate[towards]
    first = int(ends.argmin())
    return max(0.0, float(ends[first])), polytope.limits[towards[first]]


def _among(polytope: Polytope, chosen: list[int], shape: Shape) -> Polytope:
    """Give a shape in normalised coordinates the names and units of some coordinates of a polytope."""
    scale = polytope.scale[chosen]
    return Polytope(
        vertices=shape.vertices / scale,
        normals=shape.normals * scale,
        offsets=shape.offsets,
        limits=shape.limits,
        names=tuple(polytope.names[k] for k in chosen),
        units=tuple(polytope.units[k] for k in chosen),
        scale=scale,
        basis=polytope.basis[:, chosen],
        length=polytope.length,
    )


def _direction(polytope: Polytope, direction: ArrayLike) -> FloatArray:
    direction = as_array("direction", direction, (len(polytope.names),))
    if not direction.any():
        raise InputError("direction must not be zero")
    return direction


def _coordinates(polytope: Polytope, coordinates: Sequence[int | str]) -> list[int]:
    """Find coordinates told by index or by name."""
    names = polytope.names
    told = [names.index(k) if isinstance(k, str) and k in names else k for k in coordinates]
    known = all(isinstance(k, int | np.integer) and 0 <= k < len(names) for k in told)
    if not told or not known or len(set(told)) != len(told):
        raise InputError(
            f"coordinates must be different names of {', '.join(names)}, or their indices from 0 to {len(names) - 1}, "
            f"got {tuple(coordinates)}"
        )
    return [int(k) for k in told]
