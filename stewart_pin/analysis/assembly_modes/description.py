"""Assembly modes as the search answers them, and what each is like: side of singularities, conditioning, clearance.

References
----------
.. [1] C. Ericson, "Real-Time Collision Detection", Morgan Kaufmann, 2005, section 5.1.9 (segments).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from stewart_pin.analysis.assembly_modes.study import ComplexArray, StudyPlatform, half_gradient, operators
from stewart_pin.brief import Brief
from stewart_pin.checks import as_array, as_positive
from stewart_pin.errors import InputError
from stewart_pin.geometry.hexapod import Hexapod, leg_vectors
from stewart_pin.geometry.hexapod_pose import robot_size, scaled_jacobian
from stewart_pin.typing import ArrayLike, FloatArray

# ----------------------------------------------------------------------------------------------------
# What the search for all poses answers
# ----------------------------------------------------------------------------------------------------


Kind = Literal["finite", "positive-dimensional"]


@dataclass(frozen=True, eq=False, repr=False)
class AssemblyModes(Brief):
    """All real poses of a six-legged platform for six leg lengths, highest platform first.

    Attributes
    ----------
    position
        (n, 3) platform origins in the base frame [m].
    rotation
        (n, 3, 3) platform axes in the base frame.
    residual
        (n,) greatest leg-length error of each pose [m].
    certified
        (n,) mask: a solution next to the pose is proven to exist, and to be the only one there.
    n_complex
        Number of different finite complex solutions found, the real ones included.
    kind
        ``"finite"``, or ``"positive-dimensional"`` when the equations hold along a curve: the platform
        moves with all legs locked. The poses are then the isolated ones only.
    complete
        Whether every path was accounted for: the number of solutions is the generic one, or two searches from
        unrelated start systems agree and none of their paths failed. False means that poses may be missing, or
        that one which is nearly double has been counted twice.
    expected
        Finite complex solutions, with multiplicity, that the paths account for; the generic number of the
        geometry when that is known.
    failed_paths
        Paths of the last search whose end could not be decided.
    searches
        Start systems that were used.
    """

    position: FloatArray
    rotation: FloatArray
    residual: FloatArray
    certified: NDArray[np.bool_]
    n_complex: int
    kind: Kind
    complete: bool
    expected: int
    failed_paths: int
    searches: int

    def __len__(self) -> int:
        return len(self.position)


# ----------------------------------------------------------------------------------------------------

_TOUCHING = 1e-12
"""Two leg ends closer than this, over the size of the robot, are one joint."""


@dataclass(frozen=True, eq=False, repr=False)
class ModeDescription(Brief):
    """Properties of every assembly mode, in the order of the modes.

    Attributes
    ----------
    side
        (n,) sign of det J: modes of different sign are separated by a singularity, dimensionless.
    condition
        (n,) condition number of the leg Jacobian, turns in units of the robot's size, dimensionless.
    clearance
        (n,) least distance between the axes of two legs that share no joint [m].
    closest_legs
        (n, 2) indices of the two legs of that distance.
    in_stroke
        (n,) mask: all legs are within the stroke, or no stroke is given.
    legs_clear
        (n,) mask: no two legs touch, or no radius is given.
    """

    side: NDArray[np.int_]
    condition: FloatArray
    clearance: FloatArray
    closest_legs: NDArray[np.int_]
    in_stroke: NDArray[np.bool_]
    legs_clear: NDArray[np.bool_]


def describe_modes(
    hexapod: Hexapod,
    modes: AssemblyModes,
    *,
    stroke: ArrayLike | None = None,
    leg_radius: float | None = None,
) -> ModeDescription:
    """Describe every assembly mode.

    Parameters
    ----------
    hexapod
        Geometry.
    modes
        From `assembly_modes`.
    stroke
        Least and greatest leg length, (2,) for all legs or (2, 6) for each [m].
    leg_radius
        Radius of the legs [m].

    Returns
    -------
    ModeDescription
        In the order of `modes`.

    Raises
    ------
    InputError
        If a stroke ends before it begins.
    """
    legs, _ = leg_vectors(hexapod, modes.position, modes.rotation)
    lengths = np.linalg.norm(legs, axis=-1)
    in_stroke = np.ones(len(modes), dtype=bool)
    if stroke is not None:
        low, high = as_array("stroke", stroke, (2,) if np.ndim(stroke) == 1 else (2, 6))
        if np.any(low > high):
            raise InputError(f"stroke must give the least length first, got {low} and {high}")
        in_stroke = ((lengths >= low) & (lengths <= high)).all(axis=1)
    size = robot_size(hexapod, lengths) if len(modes) else 1.0
    jacobian = scaled_jacobian(hexapod, modes.position, modes.rotation, size)
    clearance, closest = _clearance(hexapod, legs, size)
    clear = clearance > (0.0 if leg_radius is None else 2.0 * as_positive("leg_radius", leg_radius))
    return ModeDescription(
        np.linalg.slogdet(jacobian)[0].astype(int),
        np.linalg.cond(jacobian),
        clearance,
        closest,
        in_stroke,
        clear if leg_radius is not None else np.ones(len(modes), dtype=bool),
    )


def segment_distance(a: FloatArray, u: FloatArray, b: FloatArray, v: FloatArray) -> FloatArray:
    """Compute the least distance between segments a + s u and b + t v with s, t in [0, 1].

    Parameters
    ----------
    a
        (..., 3) first end of one segment [m].
    u
        (..., 3) vector along it, not zero [m].
    b
        (..., 3) first end of the other [m].
    v
        (..., 3) vector along it, not zero [m].

    Returns
    -------
    numpy.ndarray
        (...,) distances [m].
    """
    w = a - b
    uu, uv, vv, uw, vw = (_dot(x, y) for x, y in ((u, u), (u, v), (v, v), (u, w), (v, w)))
    denominator = uu * vv - uv**2
    parallel = denominator <= 1e-14 * uu * vv
    s = np.clip(np.where(parallel, 0.0, (uv * vw - vv * uw) / np.where(parallel, 1.0, denominator)), 0.0, 1.0)
    # The best t for that s; clamped, it asks for a new s.
    t = np.clip((uv * s + vw) / vv, 0.0, 1.0)
    s = np.clip((uv * t - uw) / uu, 0.0, 1.0)
    return np.linalg.norm(w + s[..., None] * u - t[..., None] * v, axis=-1)


def _dot(x: FloatArray, y: FloatArray) -> NDArray[Any]:
    return (x * y).sum(axis=-1)


def _clearance(hexapod: Hexapod, legs: FloatArray, size: float) -> tuple[FloatArray, NDArray[np.int_]]:
    def apart(points: FloatArray, i: int, j: int) -> bool:
        return float(np.linalg.norm(points[i] - points[j])) > _TOUCHING * size

    pairs = np.array(
        [
            pair
            for pair in combinations(range(6), 2)
            if apart(hexapod.base_points, *pair) and apart(hexapod.platform_points, *pair)
        ],
        dtype=int,
    ).reshape(-1, 2)
    if len(pairs) == 0:
        return np.full(len(legs), np.inf), np.zeros((len(legs), 2), dtype=int)
    i, j = pairs.T
    base = hexapod.base_points
    distance = segment_distance(base[i], legs[:, i], base[j], legs[:, j])
    best = distance.argmin(axis=1)
    return distance.min(axis=1), pairs[best]


# ----------------------------------------------------------------------------------------------------
# Tell an isolated singular solution from a point of a curve of solutions
# ----------------------------------------------------------------------------------------------------

_STEP = 1e-2
"""Distance at which a neighbour is sought; near an isolated point the residual is its square at least."""
_SOLVED = 1e-11
"""Residual of a neighbour that solves the equations, relative to the gradients, dimensionless."""


def lies_on_curve(platform: StudyPlatform, point: ComplexArray) -> bool:
    """Find out whether the equations hold along a curve through a singular solution.

    Parameters
    ----------
    platform
        Parameters.
    point
        (8,) singular solution, Study coordinates of norm one.

    Returns
    -------
    bool
        True when neighbours on either side at a finite distance solve the equations as well.
    """
    matrices = operators(platform.difference, platform.total)
    gradient = half_gradient(matrices, platform.squares, point[None])[0]
    border = np.vstack([gradient, point.conj()])
    # Rows of Vᴴ: the last is the direction in which the equations do not change to first order.
    direction = np.linalg.svd(border)[2][-1].conj()
    return all(_has_neighbour(platform, point, direction, sign * _STEP) for sign in (1.0, -1.0))


def _has_neighbour(
    platform: StudyPlatform, point: ComplexArray, direction: ComplexArray, step: float
) -> bool:
    matrices = operators(platform.difference, platform.total)
    here, scale = point + step * direction, 1.0
    for _ in range(12):
        gradient = half_gradient(matrices, platform.squares, here[None])[0]
        rows = np.vstack([2.0 * gradient, point.conj(), direction.conj()])
        offset = here - point
        values = np.concatenate([gradient @ here, [point.conj() @ offset, direction.conj() @ offset - step]])
        here = here - np.linalg.lstsq(rows, values, rcond=1e-9)[0]
        scale = float(np.abs(gradient).max())
    gradient = half_gradient(matrices, platform.squares, here[None])[0]
    away = abs(direction.conj() @ (here - point)) > 0.5 * abs(step)
    return bool(away and np.abs(gradient @ here).max() < _SOLVED * scale)
