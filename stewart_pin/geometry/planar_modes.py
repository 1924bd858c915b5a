"""All assembly modes of the planar 3-RPR platform: every pose that fits three given leg lengths.

The angles are the roots of a trigonometric polynomial of degree three, found all at once as eigenvalues and
polished on the leg equations. Ordinary problems run as arrays; those near a merging of poses are done one
by one in `planar_polynomial`, those with coinciding points by circles.

References
----------
.. [1] J.-P. Merlet, "Parallel Robots", 2nd ed., Springer, 2006, ch. 4 (direct kinematics).
.. [2] C. Gosselin, J. Sefrioui, M. Richard, "Solutions polynomiales au problème de la cinématique directe des
   manipulateurs parallèles plans à trois degrés de liberté", Mech. Mach. Theory 27(2), 1992.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array
from stewart_pin.geometry.planar import PlanarRPR, leg_system, planar_leg_lengths
from stewart_pin.geometry.planar_polynomial import (
    Legs,
    as_lengths,
    laurent,
    near_circle,
    one_by_one,
    pose_polynomial,
    pose_terms,
    reduced_legs,
)
from stewart_pin.tolerances import ROUND_OFF
from stewart_pin.typing import ArrayLike, BoolArray, ComplexArray, FloatArray, IntArray

# ----------------------------------------------------------------------------------------------------
# Planar 3-RPR platforms whose points coincide: solved by circles instead of the polynomial
#
# Only here can the platform move with all three legs locked, because the polynomial's leading coefficient is
# the product of the six sides. The one exception moves without turning: two congruent triangles on equal legs.
#
# Everything is in the units of `Legs`; w is the vector along leg 1, so corner i stands at w + z d_i - b_i from
# anchor i.
# ----------------------------------------------------------------------------------------------------


_PAIRS = ((0, 1, 2), (0, 2, 1), (1, 2, 0))


@dataclass(frozen=True)
class SpecialModes:
    """Poses found in closed form.

    Attributes
    ----------
    poses
        ``(w, angle, multiplicity)`` of each isolated pose: complex [1], [rad], int.
    motion
        How the platform moves with its legs locked, in words; empty if it does not.
    """

    poses: tuple[tuple[complex, float, int], ...]
    motion: str = ""


def may_be_special(legs: Legs) -> BoolArray:
    """Tell quickly for which rows `special_modes` is worth asking.

    Parameters
    ----------
    legs
        n problems.

    Returns
    -------
    numpy.ndarray
        (n,) true where points coincide, a leg has no length, or all legs are equally long.
    """
    b, d, p = legs.anchors, legs.corners, legs.lengths
    special = (p.min(axis=-1) <= ROUND_OFF) | (np.ptp(p, axis=-1) <= ROUND_OFF)
    for points in (b, d):
        for i, j, _ in _PAIRS:
            special |= np.abs(points[:, i] - points[:, j]) <= ROUND_OFF
    return special


def special_modes(legs: Legs) -> SpecialModes | None:
    """Solve one problem in closed form if points coincide, a leg has no length, or the legs are parallel.

    Parameters
    ----------
    legs
        A batch of one problem.

    Returns
    -------
    SpecialModes or None
        None if the general method applies.
    """
    b, d, p = legs.anchors[0], legs.corners[0], legs.lengths[0]
    if (p <= ROUND_OFF).any():
        return _pinned(b, d, p, int(np.argmin(p)))
    for i, j, k in _PAIRS:
        if abs(d[i] - d[j]) <= ROUND_OFF:
            return _coincident_corners(b, d, p, (i, j, k))
    for i, j, k in _PAIRS:
        if abs(b[i] - b[j]) <= ROUND_OFF:
            return _base_for_platform(_coincident_corners(d, b, p, (i, j, k)))
    return _congruent(b, d, p)


def _pinned(b: ComplexArray, d: ComplexArray, p: FloatArray, i: int) -> SpecialModes:
    """Turn the platform about a corner that stands on its anchor."""
    j, k = (n for n in range(3) if n != i)
    turns = [_turns(d[n] - d[i], b[n] - b[i], p[n]) for n in (j, k)]
    if turns[0] is None and turns[1] is None:
        return SpecialModes((), f"rotation about anchor {i}, on which corner {i} stands")
    poses = []
    for angle, multiplicity in turns[0] if turns[0] is not None else turns[1] or ():
        z = np.exp(1j * angle)
        w = b[i] - z * d[i]
        if max(abs(abs(w + z * d[n] - b[n]) - p[n]) for n in (j, k)) <= ROUND_OFF:
            # Two poses merge when a leg shrinks to nothing, hence the factor.
            poses.append((complex(w), angle, 2 * multiplicity))
    return SpecialModes(tuple(poses))


def _coincident_corners(
    b: ComplexArray, d: ComplexArray, p: FloatArray, ijk: tuple[int, int, int]
) -> SpecialModes:
    """Hang the platform by the corner that legs i and j share, then turn it about that corner."""
    i, j, k = ijk
    if abs(b[i] - b[j]) <= ROUND_OFF:
        return _double_leg(b, d, p, ijk)
    poses, motion = [], ""
    for corner, twice in _circle_points(b[i], p[i], b[j], p[j]):
        turns = _turns(d[k] - d[i], b[k] - corner, p[k])
        if turns is None:
            motion = f"rotation about the point that legs {i} and {j} share"
            continue
        for angle, multiplicity in turns:
            poses.append((complex(corner - np.exp(1j * angle) * d[i]), angle, twice * multiplicity))
    return SpecialModes(tuple(poses), motion)


def _double_leg(b: ComplexArray, d: ComplexArray, p: FloatArray, ijk: tuple[int, int, int]) -> SpecialModes:
    """Leave a four-bar linkage: legs i and j are one and the same, or contradict each other."""
    i, j, k = ijk
    if abs(p[i] - p[j]) > ROUND_OFF:
        return SpecialModes(())
    arm, base = abs(d[k] - d[i]), abs(b[k] - b[i])
    low, high = max(abs(arm - base), abs(p[i] - p[k])), min(arm + base, p[i] + p[k])
    if low > high + ROUND_OFF:
        return SpecialModes(())
    if low < high - ROUND_OFF or min(arm, base) <= ROUND_OFF:
        return SpecialModes((), f"four-bar motion: legs {i} and {j} are the same leg")
    # The four bars lie stretched or folded in one line: a single pose.
    turn = np.pi if abs(arm + base - low) <= ROUND_OFF else 0.0
    angle = float(np.angle(np.exp(1j * turn) * (b[k] - b[i]) / (d[k] - d[i])))
    z = np.exp(1j * angle)
    poses = [
        (complex(point), angle, multiplicity)
        for point, multiplicity in _circle_points(b[i] - z * d[i], p[i], b[k] - z * d[k], p[k])
    ]
    return SpecialModes(tuple(poses))


def _congruent(b: ComplexArray, d: ComplexArray, p: FloatArray) -> SpecialModes | None:
    """Swing congruent triangles on equal legs; besides, turn them about the circumcentre of the anchors.

    The swing has all legs parallel. A turn by φ about the circumcentre moves each corner by 2 ρ sin(φ/2),
    ρ the circumradius, so two poses more have legs of equal length.
    """
    z = b[1] / d[1] * abs(d[1]) / abs(b[1])
    if max(np.ptp(p), *abs(b - z * d)) > ROUND_OFF:
        return None
    motion = "translation along a circle, all legs parallel"
    # Circumcentre of the anchors; none for anchors in line.
    area = float(np.imag(np.conj(b[1]) * b[2]))
    if abs(area) <= ROUND_OFF * abs(b[1]) * abs(b[2]):
        return SpecialModes((), motion)
    centre = complex(b[1] * abs(b[2]) ** 2 - b[2] * abs(b[1]) ** 2) / (-2j * area)
    poses = []
    for turn, multiplicity in _turns(centre, centre, float(p.mean())) or ():
        w = centre - np.exp(1j * turn) * centre
        poses.append((complex(w), float(np.angle(z * np.exp(1j * turn))), multiplicity))
    return SpecialModes(tuple(poses), motion)


def _base_for_platform(modes: SpecialModes) -> SpecialModes:
    # |w + z d - b| = |w' + z' b - d| with z' the conjugate of z and w' = -z' w: seen from the platform.
    return SpecialModes(
        tuple((-np.exp(-1j * angle) * w, -angle, m) for w, angle, m in modes.poses), modes.motion
    )


def _turns(arm: complex, target: complex, reach: float) -> list[tuple[float, int]] | None:
    """Solve |z arm - target| = reach for the angle of z, with multiplicity; None if every angle does."""
    a, t = abs(arm), abs(target)
    near, far = abs(a - t), a + t
    if min(a, t) <= ROUND_OFF:
        return None if abs(far - reach) <= ROUND_OFF else []
    straight = float(np.angle(target / arm))
    if abs(near - reach) <= ROUND_OFF:
        return [(straight, 2)]
    if abs(far - reach) <= ROUND_OFF:
        return [(float(np.angle(-target / arm)), 2)]
    if not near < reach < far:
        return []
    # reach² = near² + 4 a t sin²(φ/2) and far² - reach² = 4 a t cos²(φ/2): no cancellation at either end.
    half = np.arctan2(np.sqrt((reach - near) * (reach + near)), np.sqrt((far - reach) * (far + reach)))
    return [(float(np.angle(np.exp(1j * (straight + s * 2 * half)))), 1) for s in (-1.0, 1.0)]


def _circle_points(c1: complex, r1: float, c2: complex, r2: float) -> list[tuple[complex, int]]:
    """Intersect two circles with different centres, with multiplicity."""
    gap = abs(c2 - c1)
    along = (c2 - c1) / gap
    foot = ((r1 - r2) * (r1 + r2) + gap**2) / (2 * gap)
    if abs(r1 + r2 - gap) <= ROUND_OFF or abs(abs(r1 - r2) - gap) <= ROUND_OFF:
        return [(c1 + along * np.copysign(r1, foot), 2)]
    # Heron: 16 area² as a product, because the difference r1² - foot² cancels for slender triangles.
    square = (r1 + r2 + gap) * (r1 + r2 - gap) * (gap + r1 - r2) * (gap - r1 + r2)
    if square < 0.0:
        return []
    height = np.sqrt(square) / (2 * gap)
    return [(c1 + along * complex(foot, s * height), 1) for s in (-1.0, 1.0)]


# ----------------------------------------------------------------------------------------------------

_FINITE, _POSITIVE = "finite", "positive-dimensional"


@dataclass(frozen=True, eq=False, repr=False)
class PlanarModes(Brief):
    """Poses of a planar platform that fit its leg lengths, ordered by angle.

    Attributes
    ----------
    position
        (n, 2) platform origin, in the base frame [m].
    angle
        (n,) of the platform x axis in the base frame, in (-π, π] [rad].
    residual
        (n,) largest difference between the leg lengths of the pose and those asked for [m].
    multiplicity
        (n,) how many poses have merged into this one; 1 away from singularities. Where the legs are nearly
        equal and parallel, so that a motion almost fits, complex poses may be counted in.
    kind
        ``"finite"``, or ``"positive-dimensional"`` if the platform can move with its legs locked; then the
        rows hold the isolated poses only.
    motion
        That motion in words; empty for a finite set.
    """

    position: FloatArray
    angle: FloatArray
    residual: FloatArray
    multiplicity: IntArray
    kind: str = _FINITE
    motion: str = ""

    def __len__(self) -> int:
        return len(self.angle)


@dataclass(frozen=True, eq=False, repr=False)
class PlanarModesBatch(Brief):
    """Assembly modes of n sets of leg lengths, six slots each.

    Attributes
    ----------
    position
        (n, 6, 2) platform origin, in the base frame [m]; zero in an empty slot.
    angle
        (n, 6) of the platform x axis in the base frame, ascending in (-π, π]; zero in an empty slot [rad].
    residual
        (n, 6) largest difference to the leg lengths asked for [m].
    multiplicity
        (n, 6) how many poses have merged into this one; 0 marks an empty slot, which come last.
    motion
        n descriptions of how the platform moves with its legs locked; empty where it does not.
    """

    position: FloatArray
    angle: FloatArray
    residual: FloatArray
    multiplicity: IntArray
    motion: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.angle)

    @property
    def count(self) -> IntArray:
        """(n,) number of different isolated poses."""
        return (self.multiplicity > 0).sum(axis=-1)

    def row(self, k: int) -> PlanarModes:
        """Take the modes of one set of leg lengths.

        Parameters
        ----------
        k
            Its index.

        Returns
        -------
        PlanarModes
            Without empty slots.
        """
        full = self.multiplicity[k] > 0
        kind = _POSITIVE if self.motion[k] else _FINITE
        return PlanarModes(
            self.position[k, full],
            self.angle[k, full],
            self.residual[k, full],
            self.multiplicity[k, full],
            kind,
            self.motion[k],
        )


def planar_assembly_modes(planar: PlanarRPR, lengths: ArrayLike) -> PlanarModes:
    """Find every pose that fits three leg lengths.

    Parameters
    ----------
    planar
        Geometry.
    lengths
        (3,) leg lengths [m].

    Returns
    -------
    PlanarModes
        At most six poses, ordered by angle; none if the legs cannot be assembled.

    Raises
    ------
    InputError
        If the shape is wrong or a length is negative.

    Notes
    -----
    ``f(θ) = |N|² - p1² D²`` has degree three in cos θ and sin θ, hence six complex roots z = exp(iθ), which are
    the eigenvalues of its companion matrix [1]_. Real ones have modulus one and give the position N / D;
    where D vanishes, the position comes from two circles, and may be two positions or none. Poses closer than
    the leg equations can tell apart in double precision are one pose with a multiplicity.

    References
    ----------
    .. [1] J.-P. Merlet, "Parallel Robots", 2nd ed., 2006, ch. 4 (direct kinematics).

    Examples
    --------
    >>> planar = PlanarRPR.from_sides(2.0, 2**0.5, 2**0.5, np.pi / 2, 4.0, 0.0, 4.0)
    >>> modes = planar_assembly_modes(planar, [5**0.5] * 3)
    >>> (modes.angle / np.pi).round(12)
    array([-0.25,  0.25])
    """
    lengths = as_array("lengths", lengths, (3,))
    return planar_assembly_modes_batch(planar, lengths[None]).row(0)


def planar_assembly_modes_batch(planar: PlanarRPR, lengths: ArrayLike) -> PlanarModesBatch:
    """Find every pose that fits each of n sets of leg lengths.

    Parameters
    ----------
    planar
        Geometry.
    lengths
        (n, 3) leg lengths [m].

    Returns
    -------
    PlanarModesBatch
        Six slots for each set of lengths.

    Raises
    ------
    InputError
        If the shape is wrong or a length is negative.
    """
    lengths = as_lengths(as_array("lengths", lengths, (None, 3)))
    legs = reduced_legs(planar, lengths)
    w, angle, multiplicity, regular = _regular_modes(legs)
    motion = [""] * len(lengths)
    for k in np.flatnonzero(~regular):
        poses, motion[k] = _hard_modes(legs.rows(np.array([k])))
        w[k], angle[k], multiplicity[k] = 0.0, 0.0, 0
        for slot, pose in enumerate(poses):
            w[k, slot], angle[k, slot], multiplicity[k, slot] = pose
    angle[angle <= -np.pi] += 2 * np.pi
    return _in_base_frame(planar, lengths, legs, w, angle, multiplicity, tuple(motion))


def _regular_modes(legs: Legs) -> tuple[ComplexArray, FloatArray, IntArray, BoolArray]:
    """Solve all rows at once; the last array tells which rows came out beyond doubt."""
    n = len(legs.scale)
    w, angle = np.zeros((n, 6), complex), np.zeros((n, 6))
    multiplicity = np.zeros((n, 6), dtype=int)
    f = pose_polynomial(legs)
    # Rows whose leading coefficient drowns in round-off lose roots to infinity.
    regular = np.abs(f[:, -1]) > 1e-10 * np.abs(f).max(axis=-1)
    for k in np.flatnonzero(regular & may_be_special(legs)):
        regular[k] = special_modes(legs.rows(np.array([k]))) is None
    rows = np.flatnonzero(regular)
    companion = np.zeros((len(rows), 6, 6), complex)
    companion[:, np.arange(1, 6), np.arange(5)] = 1.0
    companion[:, :, -1] = -f[rows, :-1] / f[rows, -1:]
    roots = np.linalg.eigvals(companion).astype(complex)
    real, doubtful = near_circle(roots, f[rows])
    theta = np.angle(roots)
    sub = legs.rows(rows)
    numerator, denominator = pose_terms(sub)
    z = np.exp(1j * theta)
    d = laurent(denominator, z, -1).real
    # Close to D = 0 two positions may share an angle.
    shared = np.abs(d) <= 1e-4 * np.abs(denominator).max(axis=-1, keepdims=True)
    doubtful |= (real & shared).any(axis=-1)
    start = laurent(numerator, z, -1) / np.where(shared, 1.0, d)
    k, slot = np.nonzero(real & ~doubtful[:, None])
    polished, residual, condition = _newton(sub, k, start[k, slot], theta[k, slot])
    failed = (residual > ROUND_OFF) | (condition < 1e-6) | (np.abs(polished[:, 2] - theta[k, slot]) > 1e-4)
    doubtful[k[failed]] = True
    w[rows[k], slot] = polished[:, 0] + 1j * polished[:, 1]
    angle[rows[k], slot] = np.angle(np.exp(1j * polished[:, 2]))
    multiplicity[rows[k], slot] = 1
    regular[rows[doubtful]] = False
    return w, angle, multiplicity, regular


def _newton(
    legs: Legs, k: IntArray, w: ComplexArray, theta: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Polish simple roots; also return the residual and the determinant of unit rows."""
    system = leg_system(legs.anchors[k], legs.corners[k], legs.lengths[k])
    x = np.stack([w.real, w.imag, theta], axis=-1)
    residual, jacobian = system(x)
    det = np.linalg.det(jacobian) if len(x) else np.zeros(0)
    for _ in range(4):
        ok = np.abs(det) > 1e-12
        step = np.zeros_like(x)
        step[ok] = np.linalg.solve(jacobian[ok], residual[ok][..., None])[..., 0]
        trial = x - step
        new_residual, new_jacobian = system(trial)
        better = np.abs(new_residual).max(axis=-1) < np.abs(residual).max(axis=-1)
        if not better.any():
            break
        x[better], residual[better], jacobian[better] = (
            trial[better],
            new_residual[better],
            new_jacobian[better],
        )
        det = np.linalg.det(jacobian)
    return x, np.abs(residual).max(axis=-1), np.abs(det)


def _hard_modes(legs: Legs) -> tuple[list[tuple[complex, float, int]], str]:
    special = special_modes(legs)
    if special is not None:
        return list(special.poses), special.motion
    poses = one_by_one(legs)
    if len(poses) > 6:
        # The polynomial has six roots: more poses are points of an arc that fits to round-off.
        return [], "a motion that changes the leg lengths by no more than round-off"
    return poses, ""


def _in_base_frame(
    planar: PlanarRPR,
    lengths: FloatArray,
    legs: Legs,
    w: ComplexArray,
    angle: FloatArray,
    multiplicity: IntArray,
    motion: tuple[str, ...],
) -> PlanarModesBatch:
    first_anchor, first_corner = (complex(*points[0]) for points in (planar.anchors, planar.corners))
    origin = w * legs.scale[:, None] + first_anchor - np.exp(1j * angle) * first_corner
    empty = multiplicity == 0
    position = np.stack([origin.real, origin.imag], axis=-1)
    order = np.lexsort((position[..., 1], position[..., 0], angle, empty), axis=-1)
    position = np.take_along_axis(np.where(empty[..., None], 0.0, position), order[..., None], axis=1)
    angle = np.take_along_axis(np.where(empty, 0.0, angle), order, axis=1)
    multiplicity = np.take_along_axis(multiplicity, order, axis=1)
    misfit = np.abs(planar_leg_lengths(planar, position, angle) - lengths[:, None]).max(axis=-1)
    return PlanarModesBatch(position, angle, np.where(multiplicity > 0, misfit, 0.0), multiplicity, motion)
