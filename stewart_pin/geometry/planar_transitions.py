"""Lengths of one leg of the planar 3-RPR platform at which its number of assembly modes changes.

Without that leg the platform is the coupler of a four-bar linkage. Its modes are the coupler poses that keep
the free corner at the leg's length from the anchor, so they merge where this distance is extreme.

References
----------
.. [1] P. Wenger, D. Chablat, "Workspace and assembly modes in fully-parallel manipulators", Advances in Robot
   Kinematics, 1998.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.geometry.planar import PlanarRPR, merging_system, planar_leg_lengths, valley_newton
from stewart_pin.geometry.planar_modes import planar_assembly_modes_batch
from stewart_pin.geometry.planar_polynomial import as_lengths, reduced_legs, unit_circle_roots
from stewart_pin.tolerances import ROOT_BAND, ROUND_OFF
from stewart_pin.typing import ArrayLike, ComplexArray, FloatArray, IntArray

_SAMPLES = 16
"""Points on the unit circle that fix a Laurent polynomial of powers -6 … 6, rounded up for the transform."""


_EQUAL = 1e-12
"""Two transitions closer than this, per largest length, are one."""

_VANISHED = 1e-13
"""Share of its terms below which a polynomial is zero: round-off of some ten products."""

_FOLD = 1e-4
"""Newton's method ends this close to a pose where two coupler curves cross, and no closer."""

_INSIDE = 0.5413
"""Where an interval is probed: not halfway, because symmetric mechanisms have special lengths there."""


@dataclass(frozen=True, eq=False, repr=False)
class PlanarTransitions(Brief):
    """Where the number of assembly modes changes along the length of one leg.

    Attributes
    ----------
    leg
        Index of the leg that changes.
    lengths
        (m,) its lengths at which poses merge and the number changes, ascending [m].
    counts
        (m + 1,) number of modes below the first, between neighbours, and above the last.
    position
        (m, 2) platform origin where poses merge, in the base frame [m].
    angle
        (m,) of the platform x axis there, in the base frame [rad].
    residual
        (m,) largest misfit of a leg length there [m].
    """

    leg: int
    lengths: FloatArray
    counts: IntArray
    position: FloatArray
    angle: FloatArray
    residual: FloatArray

    def intervals(self, count: int) -> list[tuple[float, float]]:
        """List the open intervals of lengths with a given number of modes.

        Parameters
        ----------
        count
            Number of modes.

        Returns
        -------
        list of tuple
            ``(from, to)`` [m]; the last may end at infinity.
        """
        ends = [0.0, *map(float, self.lengths), np.inf]
        return [(ends[i], ends[i + 1]) for i in np.flatnonzero(self.counts == count)]


def planar_transition_lengths(planar: PlanarRPR, lengths: ArrayLike, leg: int) -> PlanarTransitions:
    r"""Find every length of one leg at which the number of assembly modes changes.

    Parameters
    ----------
    planar
        Geometry.
    lengths
        (3,) leg lengths [m]; that of `leg` is not used.
    leg
        Index of the leg that changes: 0, 1 or 2.

    Returns
    -------
    PlanarTransitions
        At most twelve lengths, with the numbers of modes between them.

    Raises
    ------
    InputError
        If a shape or the index is wrong, or a length is negative.
    UnsupportedError
        If the two other legs are the same leg, so that the number is infinite between transitions.

    Notes
    -----
    With circles of radius r around :math:`q_i` and :math:`q_j`, :math:`e = q_j - q_i`, :math:`k = q_k - q_i`,
    :math:`E = |e|^2`, :math:`F = |k|^2`, :math:`\bar k e = G + i X`, :math:`h = (r_i^2 - r_j^2 + E)/2` and
    :math:`T = r_i^2 E - h^2`, the squared length of leg k is
    :math:`r_i^2 + F - 2 (G h \mp X \sqrt T) / E`. Its derivative by θ vanishes where
    :math:`(T P^2 - Q^2) / E^2 = 0`, :math:`P = F' E^2/2 - (G h)' E + G h E'` and
    :math:`Q = (X' T + X T'/2) E - X T E'`: a trigonometric polynomial of degree six, solved by eigenvalues.
    Newton's method on the pose then finishes; the length is stationary there, so its error is quadratic.
    """
    if leg not in (0, 1, 2):
        raise InputError(f"leg must be 0, 1 or 2, got {leg!r}")
    lengths = as_lengths(as_array("lengths", lengths, (3,))).copy()
    lengths[leg] = 0.0
    reduced = reduced_legs(planar, lengths[None])
    b, d, p, scale = reduced.anchors[0], reduced.corners[0], reduced.lengths[0], float(reduced.scale[0])
    i, j = (n for n in range(3) if n != leg)
    if abs(b[i] - b[j]) + abs(d[i] - d[j]) <= ROUND_OFF:
        raise UnsupportedError(
            f"legs {i + 1} and {j + 1} share both ends: no number of modes; choose another leg"
        )
    reach, poses = _extreme_lengths(b, d, p, leg)
    ends = np.concatenate([[0.0], reach, [reach[-1] + 1.0 if len(reach) else 1.0]])
    probes = np.tile(lengths, (len(ends) - 1, 1))
    probes[:, leg] = scale * (ends[:-1] + _INSIDE * np.diff(ends))
    counts = planar_assembly_modes_batch(planar, probes).count
    changes = np.flatnonzero(np.diff(counts))
    at = poses[changes]
    angle = np.angle(np.exp(1j * at[:, 2]))
    first_anchor, first_corner = (complex(*points[0]) for points in (planar.anchors, planar.corners))
    origin = scale * (at[:, 0] + 1j * at[:, 1]) + first_anchor - np.exp(1j * angle) * first_corner
    position = np.stack([origin.real, origin.imag], axis=-1)
    full = np.tile(lengths, (len(changes), 1))
    full[:, leg] = scale * reach[changes]
    residual = np.abs(planar_leg_lengths(planar, position, angle) - full).max(axis=-1)
    return PlanarTransitions(
        leg, full[:, leg], counts[np.concatenate([[0], changes + 1])], position, angle, residual
    )


def _extreme_lengths(
    b: ComplexArray, d: ComplexArray, p: FloatArray, leg: int
) -> tuple[FloatArray, FloatArray]:
    """Collect all critical distances of the free corner from its anchor, ascending, with their poses."""
    i, j = (n for n in range(3) if n != leg)
    starts = []
    for angle in _critical_angles(b, d, p, leg):
        q = b - np.exp(1j * angle) * d
        gap = abs(q[j] - q[i])
        if gap > ROUND_OFF:
            foot = ((p[i] - p[j]) * (p[i] + p[j]) + gap**2) / (2 * gap)
            height = np.sqrt(max(p[i] ** 2 - foot**2, 0.0))
            along = (q[j] - q[i]) / gap
            starts += [(q[i] + along * complex(foot, s * height), angle) for s in (-1.0, 1.0)]
    x = np.array([[w.real, w.imag, angle] for w, angle in starts]).reshape(-1, 3)
    if len(x):
        system = merging_system(b, d, p, leg)
        # One of the two branches fits the angle; where both nearly do, keep both.
        misfit = np.abs(system(x)[0]).max(axis=-1).reshape(-1, 2)
        x = x[(misfit <= np.maximum(2 * misfit.min(axis=-1, keepdims=True), 1e-3)).ravel()]
        x = valley_newton(system, x, max_iterations=40, largest_step=3e-2)
        residual = np.abs(system(x)[0])
        # A degenerate extremum leaves the determinant poorly solved, but its length accurate.
        x = x[(residual[:, :2].max(axis=-1) <= ROUND_OFF) & (residual[:, 2] <= 1e-8)]
    folded = _folded_poses(b, d, p, leg)
    for pose in folded:
        turn = np.angle(np.exp(1j * (x[:, 2] - pose[2])))
        x = x[np.hypot(np.hypot(*(x[:, :2] - pose[:2]).T), turn) > _FOLD]
    x = np.concatenate([x, folded, _parallelogram_extremes(b, d, p, leg)])
    z = np.exp(1j * x[:, 2])
    reach = np.abs(x[:, 0] + 1j * x[:, 1] + z * d[leg] - b[leg])
    order = np.argsort(reach)
    reach, x = reach[order], x[order]
    new = np.diff(reach, prepend=0.0) > _EQUAL
    return reach[new], x[new]


def _critical_angles(b: ComplexArray, d: ComplexArray, p: FloatArray, leg: int) -> FloatArray:
    """Find the angles at which a coupler pose may have the free corner at an extreme distance."""
    i, j = (n for n in range(3) if n != leg)
    # Sample as far as possible from the least E, which may be zero: the division there is exact but 0 / 0.
    least = np.pi - np.angle(-(d[j] - d[i]) * np.conj(b[j] - b[i]))
    first = least + np.pi / _SAMPLES
    z = np.exp(1j * (first + 2 * np.pi * np.arange(_SAMPLES) / _SAMPLES))[:, None]
    q, dq = b - z * d, -1j * z * d
    e, de, k, dk = (x[:, m] - x[:, i] for m in (j, leg) for x in (q, dq))
    big_e, d_big_e = np.abs(e) ** 2, 2 * (np.conj(e) * de).real
    d_big_f = 2 * (np.conj(k) * dk).real
    gx, d_gx = np.conj(k) * e, np.conj(dk) * e + np.conj(k) * de
    h, d_h = 0.5 * ((p[i] - p[j]) * (p[i] + p[j]) + big_e), 0.5 * d_big_e
    t, d_t = p[i] ** 2 * big_e - h**2, p[i] ** 2 * d_big_e - 2 * h * d_h
    big_p = 0.5 * d_big_f * big_e**2 - (d_gx.real * h + gx.real * d_h) * big_e + gx.real * h * d_big_e
    big_q = (d_gx.imag * t + 0.5 * gx.imag * d_t) * big_e - gx.imag * t * d_big_e
    terms = np.array([t * big_p**2, big_q**2]) / big_e**2
    norm = terms[0] - terms[1]
    if np.abs(t).max() <= _VANISHED:
        # The linkage stays stretched: both branches are one, Q = 0.
        norm = big_p
    elif np.abs(norm).max() <= _VANISHED * np.abs(terms).max():
        # The distance is constant on one branch; then T P² = Q² and the other branch is critical with Q.
        norm = big_q
    coefficients = np.fft.fftshift(np.fft.fft(norm)) / _SAMPLES
    roots = unit_circle_roots(coefficients[_SAMPLES // 2 - 6 : _SAMPLES // 2 + 7])
    return first + np.angle(roots[np.abs(np.abs(roots) - 1.0) < ROOT_BAND])


def _parallelogram_extremes(b: ComplexArray, d: ComplexArray, p: FloatArray, leg: int) -> FloatArray:
    """Add the extremes of the translation along a circle that a parallelogram linkage allows."""
    i, j = (n for n in range(3) if n != leg)
    base, arm = b[j] - b[i], d[j] - d[i]
    if max(abs(abs(base) - abs(arm)), abs(p[i] - p[j])) > ROUND_OFF or abs(arm) <= ROUND_OFF:
        return np.zeros((0, 3))
    z = base / arm * abs(arm) / abs(base)
    q = b - z * d
    towards = q[leg] - q[i]
    if abs(towards) <= ROUND_OFF:
        return np.zeros((0, 3))
    w = [q[i] + s * p[i] * towards / abs(towards) for s in (-1.0, 1.0)]
    return np.array([[x.real, x.imag, np.angle(z)] for x in w])


def _folded_poses(b: ComplexArray, d: ComplexArray, p: FloatArray, leg: int) -> FloatArray:
    """Find the poses where a linkage of special lengths lies flat in one line.

    Two coupler curves cross there, or one shrinks to a point: every distance is critical without being
    extreme, and Newton's method ends only near it.
    """
    i, j = (n for n in range(3) if n != leg)
    base, arm = b[j] - b[i], d[j] - d[i]
    if min(abs(base), abs(arm)) <= ROUND_OFF:
        return np.zeros((0, 3))
    poses = []
    for side in (1.0, -1.0):
        z = side * base / arm * abs(arm) / abs(base)
        q = b - z * d
        # Along the line from anchor i: where the two legs reach, measured from their centres.
        gap = ((q[j] - q[i]) * np.conj(base)).real / abs(base)
        poses += [
            (q[i] + reach * base / abs(base), np.angle(z))
            for reach in (-p[i], p[i])
            if abs(abs(reach - gap) - p[j]) <= ROUND_OFF
        ]
    return np.array([[w.real, w.imag, angle] for w, angle in poses]).reshape(-1, 3)
