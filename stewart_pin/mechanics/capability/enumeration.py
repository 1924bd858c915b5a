"""From linear limits to the corners and faces of the set that they leave, exact to round-off; linear programmes."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import proxsuite
import scipy.linalg
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection, KDTree, QhullError

from stewart_pin.errors import ConvergenceError, UnsupportedError
from stewart_pin.typing import FloatArray

_FLAT = 1e-9
"""Radius of an inscribed ball, relative to the limits, below which a set counts as flat."""
_SAME = 1e-8
"""Distance below which two corners, or two faces, are the same, relative to the limits."""
_MEETING = 1e-7
"""Distance of a bound from a corner found by duality below which it meets there, relative to the limits."""
_MOST_CORNERS = 4096
"""Corners of a box that are worth enumerating: 12 independent motors."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A convex set as corners and as faces, coordinates all in one unit.

    Attributes
    ----------
    vertices
        (n, d) corners [any unit].
    normals
        (m, d) outward unit normals, dimensionless.
    offsets
        (m,) such that ``normals @ x <= offsets`` inside [any unit].
    limits
        (m,) what each face stands for.
    """

    vertices: FloatArray
    normals: FloatArray
    offsets: FloatArray
    limits: tuple[str, ...]


def image_of_limits(
    rows: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    limits: tuple[tuple[str, str], ...],
    linear: FloatArray,
    offset: FloatArray,
) -> Shape | None:
    """Map the set ``lower <= rows @ y <= upper`` by ``x = linear @ y + offset``.

    Parameters
    ----------
    rows
        (m, k) constraint rows, of rank k [any unit].
    lower, upper
        (m,) bounds [any unit].
    limits
        (m,) what each lower and upper bound stands for.
    linear
        (d, k) of rank d [any unit].
    offset
        (d,) image of zero [any unit].

    Returns
    -------
    Shape or None
        The image; None when no y satisfies the limits.
    """
    corners = corners_within(rows, lower, upper)
    if corners is None:
        return None
    vertices = corners @ linear.T + offset
    if linear.shape[0] != linear.shape[1]:
        return hull(vertices)
    # Each bound is a half-plane in x as well: rows y = (rows linear⁻¹)(x - offset).
    normals = np.linalg.solve(linear.T, rows.T).T
    shift = normals @ offset
    return _shape(
        vertices,
        np.vstack([-normals, normals]),
        np.concatenate([-(lower + shift), upper + shift]),
        tuple(low for low, _ in limits) + tuple(high for _, high in limits),
    )


def cut(normals: FloatArray, offsets: FloatArray, limits: tuple[str, ...]) -> Shape | None:
    """Build the set ``normals @ x <= offsets``.

    Parameters
    ----------
    normals
        (m, d) outward normals, of rank d [any unit].
    offsets
        (m,) [any unit].
    limits
        (m,) what each face stands for.

    Returns
    -------
    Shape or None
        The set; None when it is empty.
    """
    lengths = np.linalg.norm(normals, axis=1)
    level = lengths < 1e-12 * lengths.max(initial=0.0)
    if (offsets[level] < 0).any():
        return None
    normals, offsets = normals[~level], offsets[~level]
    vertices = corners_within(normals, np.full(offsets.size, -np.inf), offsets)
    if vertices is None:
        return None
    return _shape(
        vertices, normals, offsets, tuple(x for x, out in zip(limits, level, strict=True) if not out)
    )


def hull(points: FloatArray) -> Shape:
    """Build the convex hull of points, flat ones included.

    Parameters
    ----------
    points
        (n, d) [any unit].

    Returns
    -------
    Shape
        The hull; a flat one has two faces for each direction in which it has no extent.
    """
    d = points.shape[1]
    centre = points.mean(axis=0)
    size = float(np.abs(points - centre).max(initial=0.0)) or 1.0
    _, s, vt = np.linalg.svd((points - centre) / size, full_matrices=True)
    rank = int(np.count_nonzero(s > _FLAT * max(1.0, s[0] if s.size else 0.0)))
    within, across = vt[:rank], vt[rank:]
    flat = (points - centre) @ within.T / size
    if rank == 0:
        index, normals, offsets = np.array([0]), np.zeros((0, 0)), np.zeros(0)
    elif rank == 1:
        index = np.array([int(flat[:, 0].argmin()), int(flat[:, 0].argmax())])
        normals, offsets = np.array([[-1.0], [1.0]]), np.array([-flat[:, 0].min(), flat[:, 0].max()])
    else:
        solid = ConvexHull(flat)
        index = solid.vertices
        normals, offsets = _faces(solid.equations, flat)
    normals = np.vstack([normals @ within, across, -across])
    offsets = np.concatenate([offsets * size, np.zeros(2 * (d - rank))]) + normals @ centre
    return Shape(points[index], normals, offsets, ("",) * offsets.size)


def corners_within(rows: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray | None:
    """Enumerate the corners of ``lower <= rows @ y <= upper``.

    Parameters
    ----------
    rows
        (m, k) constraint rows, of rank k [any unit].
    lower, upper
        (m,) bounds, infinite where there is none [any unit].

    Returns
    -------
    numpy.ndarray or None
        (n, k) corners; one row when the set is a point, None when it is empty [any unit].

    Raises
    ------
    UnsupportedError
        If there are too many to be enumerated.
    """
    lengths = np.linalg.norm(rows, axis=1)
    lengths[lengths == 0.0] = 1.0
    rows, lower, upper = rows / lengths[:, None], lower / lengths, upper / lengths
    m, k = rows.shape
    if k == 0:
        return np.zeros((1, 0)) if (lower <= 0).all() and (upper >= 0).all() else None
    if m == k and np.isfinite(lower).all() and np.isfinite(upper).all():
        if 2**k > _MOST_CORNERS:
            raise UnsupportedError(f"{k} independent motors make 2**{k} corners; ask for fewer motors")
        # A skewed box: every choice of bounds is a corner.
        choices = np.unique(np.array(list(product(*zip(lower, upper, strict=True)))), axis=0)
        return np.linalg.solve(rows, choices.T).T
    centre, radius = _middle(rows, lower, upper)
    bounds = np.concatenate([lower, upper])
    size = float(np.abs(bounds[np.isfinite(bounds)]).max())
    if radius < -_FLAT * size:
        return None
    if radius <= _FLAT * size:
        return _flat_corners(rows, lower, upper, centre, size)
    if k == 1:
        sign = rows[:, 0]  # rows are of unit length
        low, high = np.where(sign > 0, lower, -upper), np.where(sign > 0, upper, -lower)
        return np.array([[low[sign != 0].max()], [high[sign != 0].min()]])
    return _solid_corners(rows, lower, upper, centre, size)


def _middle(rows: FloatArray, lower: FloatArray, upper: FloatArray) -> tuple[FloatArray, float]:
    """Zero when it is well inside, else the centre of the largest ball."""
    clearance = float(np.minimum(upper, -lower).min())
    if clearance > 1e-3 * float(np.abs(upper[np.isfinite(upper)]).max(initial=0.0)):
        return np.zeros(rows.shape[1]), clearance
    return interior_point(rows, lower, upper)


def _solid_corners(
    rows: FloatArray, lower: FloatArray, upper: FloatArray, centre: FloatArray, size: float
) -> FloatArray:
    """Corners of a set with an interior, by duality, then refined on the bounds that meet there."""
    sides, bounds = np.vstack([rows, -rows]), np.concatenate([upper, -lower])
    there = np.isfinite(bounds)
    sides, bounds = sides[there], bounds[there] / size
    try:
        found = HalfspaceIntersection(np.c_[sides, -bounds], centre / size).intersections
    except QhullError:
        found = np.full((1, sides.shape[1]), np.nan)
    if not np.isfinite(found).all():
        raise ConvergenceError(
            "the corners of the set could not be found: it is too long and thin; move away from the singularity",
            residual=np.inf,
        )
    corners = np.empty_like(found)
    for k, corner in enumerate(found):
        meeting = np.abs(sides @ corner - bounds) < _MEETING
        gap = bounds[meeting] - sides[meeting] @ corner
        corners[k] = corner + np.linalg.lstsq(sides[meeting], gap, rcond=1e-12)[0]
    return corners[_distinct(corners)] * size


def _flat_corners(
    rows: FloatArray, lower: FloatArray, upper: FloatArray, centre: FloatArray, size: float
) -> FloatArray | None:
    """Corners of a set without interior: find the bounds that always hold, and look within their plane."""
    sides, bounds = np.vstack([rows, -rows]), np.concatenate([upper, -lower])
    tight = []
    for k in np.flatnonzero(np.abs(sides @ centre - bounds) <= 10 * _FLAT * size):
        lowest = greatest(-sides[k], sides, bounds)
        if sides[k] @ lowest > bounds[k] - 100 * _FLAT * size:
            tight.append(k)
    if not tight:
        return centre[None]
    centre = centre + np.linalg.lstsq(sides[tight], bounds[tight] - sides[tight] @ centre, rcond=1e-10)[0]
    plane = scipy.linalg.null_space(sides[tight], rcond=1e-10)
    left = [k for k in range(rows.shape[0]) if np.linalg.norm(rows[k] @ plane) > 1e-9]
    shift = rows[left] @ centre
    within = corners_within(rows[left] @ plane, lower[left] - shift, upper[left] - shift)
    return None if within is None else within @ plane.T + centre


def _shape(vertices: FloatArray, normals: FloatArray, offsets: FloatArray, limits: tuple[str, ...]) -> Shape:
    """Normalise the faces and drop those that only touch the set, and repeated ones."""
    lengths = np.linalg.norm(normals, axis=1)
    kept = np.flatnonzero((lengths > 0) & np.isfinite(offsets))
    normals, offsets = normals[kept] / lengths[kept, None], offsets[kept] / lengths[kept]
    size = float(np.abs(vertices).max(initial=0.0)) or 1.0
    on = np.abs(vertices @ normals.T - offsets) < _SAME * size
    dimension = _dimension(vertices, size)
    # A face holds at least as many independent corners as the set has dimensions, the planes of a flat set more.
    real = [
        k
        for k in range(kept.size)
        if on[:, k].any() and _dimension(vertices[on[:, k]], size) >= dimension - 1
    ]
    chosen = [real[k] for k in _distinct(np.c_[normals[real], offsets[real] / size])]
    return Shape(vertices, normals[chosen], offsets[chosen], tuple(limits[kept[k]] for k in chosen))


def _dimension(points: FloatArray, size: float) -> int:
    return int(np.linalg.matrix_rank(points - points[0], tol=_SAME * size))


def _faces(equations: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Merge the simplices of a hull that lie in one plane, and fit that plane to all its points."""
    planes = []
    # Thousands of simplices share a plane in six dimensions: rounding leaves few, which are then compared.
    _, first = np.unique(np.round(equations, 6), axis=0, return_index=True)
    for equation in equations[first]:
        on = points[np.abs(points @ equation[:-1] + equation[-1]) < _SAME]
        normal = np.linalg.svd(on - on.mean(axis=0), full_matrices=on.shape[0] < on.shape[1])[2][-1]
        normal = normal * np.sign(normal @ equation[:-1])
        planes.append([*normal, (points @ normal).max()])
    fitted = np.array(planes)
    fitted = fitted[_distinct(fitted)]
    return fitted[:, :-1], fitted[:, -1]


def _distinct(rows: FloatArray) -> list[int]:
    """Find the rows that repeat no earlier one."""
    repeated = {int(later) for _, later in KDTree(rows).query_pairs(_SAME)}
    return [k for k in range(len(rows)) if k not in repeated]


# ----------------------------------------------------------------------------------------------------
# Linear programmes, as quadratic ones without a quadratic part, by ProxQP, and polished to a vertex
# ----------------------------------------------------------------------------------------------------

_ACCURACY = 1e-10
"""Residuals and duality gap at which the solver stops; bounds are scaled to about one."""
_NEVER = 1e-14
"""Threshold of ProxQP's infeasibility test that takes nothing for infeasible."""
_PATIENCE = 1_000
"""Most iterations; 15 are usual."""
_ACTIVE = 1e-6
"""Slack below which a bound counts as reached, when the solution is polished."""
_FEASIBLE = 1e-8
"""Violation of a bound from which on the solver is not believed, and corners are enumerated: a hundred times its
accuracy."""
_FAR = 1e20
"""What ProxQP reads as no bound."""


def maximise(cost: FloatArray, rows: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Maximise ``cost @ x`` subject to ``lower <= rows @ x <= upper``.

    Parameters
    ----------
    cost
        (n,) objective [any unit].
    rows
        (m, n) constraint rows, of rank n, so that the maximum exists when both sides are bounded [any unit].
    lower, upper
        (m,) bounds, infinite where there is none [any unit].

    Returns
    -------
    numpy.ndarray
        (n,) the maximum, a vertex to round-off where it is unique [any unit].

    Raises
    ------
    ConvergenceError
        If there is none: the bounds contradict each other, or leave the objective free.
    """
    lengths = np.linalg.norm(rows, axis=1)
    lengths[lengths == 0.0] = 1.0
    rows, lower, upper = rows / lengths[:, None], lower / lengths, upper / lengths
    bounds = np.concatenate([lower, upper])
    size = max(float(np.abs(bounds[np.isfinite(bounds)]).max(initial=0.0)), np.finfo(float).tiny)
    lower, upper = lower / size, upper / size
    steep = float(np.linalg.norm(cost)) or 1.0
    x, dual = _proxqp(cost / steep, rows, lower, upper)
    if dual is None or _violation(rows, lower, upper, x) > _FEASIBLE:
        sides, bounds = np.vstack([rows, -rows]), np.concatenate([upper, -lower])
        return greatest(cost, sides, bounds) * size
    return _polish(rows, lower, upper, x, dual, cost / steep) * size


def interior_point(rows: FloatArray, lower: FloatArray, upper: FloatArray) -> tuple[FloatArray, float]:
    """Find the centre of the largest ball in ``lower <= rows @ x <= upper``, be the set solid, flat or empty.

    Parameters
    ----------
    rows
        (m, n) constraint rows, of rank n [any unit].
    lower, upper
        (m,) bounds, infinite where there is none [any unit].

    Returns
    -------
    centre : numpy.ndarray
        (n,) centre of the ball [any unit].
    radius : float
        Its radius; 0 to round-off when the set is flat, negative when it is empty [any unit].
    """
    lengths = np.linalg.norm(rows, axis=1)
    bounds = np.concatenate([lower, upper])
    # Half the distance of two bounds is the most a ball can have; one-sided bounds may leave it free.
    most = float(np.abs(bounds[np.isfinite(bounds)]).max(initial=0.0)) or 1.0
    # rows x + |row| r <= upper, -rows x + |row| r <= -lower, r <= most
    ball = np.vstack([np.c_[rows, lengths], np.c_[-rows, lengths], np.eye(rows.shape[1] + 1)[-1]])
    answer = greatest(np.eye(rows.shape[1] + 1)[-1], ball, np.concatenate([upper, -lower, [most]]))
    return answer[:-1], float(answer[-1])


def greatest(cost: FloatArray, rows: FloatArray, upper: FloatArray) -> FloatArray:
    """Maximise ``cost @ x`` subject to ``rows @ x <= upper``, where the set may have no interior.

    Parameters
    ----------
    cost
        (n,) objective [any unit].
    rows
        (m, n) constraint rows [any unit].
    upper
        (m,) bounds, infinite where there is none [any unit].

    Returns
    -------
    numpy.ndarray
        (n,) a maximum [any unit].

    Raises
    ------
    ConvergenceError
        If there is none.
    """
    there = np.isfinite(upper)
    size = float(np.abs(upper[there]).max(initial=0.0)) or 1.0
    # HiGHS, a simplex method: on sets that round-off leaves 1e-11 thin, ProxQP fails in one case out of 25.
    answer = linprog(
        -cost, A_ub=rows[there], b_ub=upper[there] / size, bounds=(None, None), method="highs-ds"
    )
    if answer.status != 0:
        raise ConvergenceError(
            f"the linear programme was not solved, its limits contradict each other or leave a direction free: "
            f"{answer.message}",
            residual=np.inf,
        )
    return answer.x * size


def _proxqp(
    cost: FloatArray, rows: FloatArray, lower: FloatArray, upper: FloatArray
) -> tuple[FloatArray, FloatArray | None]:
    """Solve a linear programme of unit scale; gives the multipliers as well, or None when it was not solved."""
    n = cost.size
    qp = proxsuite.proxqp.dense.QP(n, 0, rows.shape[0], False, proxsuite.proxqp.dense.HessianType.Zero)
    qp.settings.eps_abs = _ACCURACY
    # Small residuals alone leave 5e-8 of the optimum; with the duality gap it is 3e-10, before polishing.
    qp.settings.check_duality_gap = True
    qp.settings.eps_duality_gap_abs = _ACCURACY
    # With the default settings one feasible linear programme in five is declared infeasible, and with a stricter
    # test still one in 150; without the updates of the penalty by residuals none of thousands is.
    qp.settings.eps_primal_inf = _NEVER
    qp.settings.eps_dual_inf = _NEVER
    qp.settings.bcl_update = False
    qp.settings.max_iter = _PATIENCE
    qp.init(
        np.zeros((n, n)), -cost, np.zeros((0, n)), np.zeros(0),
        rows, np.maximum(lower, -_FAR), np.minimum(upper, _FAR),
    )  # fmt: skip
    qp.solve()
    solved = qp.results.info.status == proxsuite.proxqp.QPSolverOutput.PROXQP_SOLVED
    return qp.results.x, qp.results.z if solved else None


def _violation(rows: FloatArray, lower: FloatArray, upper: FloatArray, x: FloatArray) -> float:
    value = rows @ x
    return float(np.maximum(value - upper, lower - value).max(initial=0.0))


def _polish(
    rows: FloatArray, lower: FloatArray, upper: FloatArray, x: FloatArray, dual: FloatArray, cost: FloatArray
) -> FloatArray:
    """Move onto the bounds that are reached and pushed against, unless that leaves the feasible set."""
    value = rows @ x
    for pushed in (np.abs(dual) > _ACTIVE, np.ones(rows.shape[0], dtype=bool)):
        high = pushed & (upper - value < _ACTIVE)
        low = pushed & (value - lower < _ACTIVE) & ~high
        reached = high | low
        if not reached.any():
            continue
        goal = np.where(high, upper, lower)[reached]
        better = x + np.linalg.lstsq(rows[reached], goal - value[reached], rcond=1e-10)[0]
        # Round-off of the bounds, which are about one; the objective may only fall by what was infeasible before.
        if _violation(rows, lower, upper, better) < 1e-13 and cost @ better > cost @ x - 10 * _ACTIVE:
            return better
    return x
