"""Planar 3-RPR platforms whose points coincide: solved by circles instead of the polynomial.

Only here can the platform move with all three legs locked, because the polynomial's leading coefficient is
the product of the six sides. The one exception moves without turning: two congruent triangles on equal legs.

Everything is in the units of `Legs`; w is the vector along leg 1, so corner i stands at w + z d_i - b_i from
anchor i.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stewart_pin.geometry.planar_polynomial import ROUND_OFF, Legs
from stewart_pin.typing import BoolArray, ComplexArray, FloatArray

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
