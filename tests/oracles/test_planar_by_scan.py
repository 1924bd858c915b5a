"""The planar platform against other ways to solve it: the source's own f(θ), sign scans, blind Newton."""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy.optimize import brentq, minimize_scalar

import stewart_pin as stp


def source_terms(planar: stp.PlanarRPR, lengths, theta):
    """Return A2, B2, A3, B3, N1, N2, D as the source prints them; first anchor and corner at the origins."""
    (x1, _), (x2, y2) = planar.anchors[1:]
    l3, l2 = np.hypot(*planar.corners[1:].T)
    gamma = np.arctan2(*planar.corners[2, ::-1])
    p1, p2, p3 = lengths
    a2, b2 = l3 * np.cos(theta) - x1, l3 * np.sin(theta)
    a3, b3 = l2 * np.cos(theta + gamma) - x2, l2 * np.sin(theta + gamma) - y2
    n1 = b3 * (p2**2 - p1**2 - a2**2 - b2**2) - b2 * (p3**2 - p1**2 - a3**2 - b3**2)
    n2 = -a3 * (p2**2 - p1**2 - a2**2 - b2**2) + a2 * (p3**2 - p1**2 - a3**2 - b3**2)
    return a2, b2, a3, b3, n1, n2, 2 * (a2 * b3 - b2 * a3)


def source_f(planar: stp.PlanarRPR, lengths, theta):
    *_, n1, n2, d = source_terms(planar, lengths, theta)
    return n1**2 + n2**2 - lengths[0] ** 2 * d**2


def random_exercise(rng: np.random.Generator) -> tuple[stp.PlanarRPR, np.ndarray]:
    l2, l3 = rng.uniform(0.5, 4.0, 2)
    gamma = rng.uniform(0.1, 3.0)
    l1 = np.sqrt(l2**2 + l3**2 - 2 * l2 * l3 * np.cos(gamma))
    planar = stp.PlanarRPR.from_sides(l1, l2, l3, gamma, rng.uniform(1, 6), *rng.uniform(-6, 6, 2))
    lengths = stp.planar.planar_leg_lengths(planar, rng.uniform(-4, 4, 2), rng.uniform(-np.pi, np.pi))
    return planar, lengths


def test_f_is_the_one_of_the_source(rng: np.random.Generator) -> None:
    # S1.1: f(±π/4) = 0, then f itself at random angles of random exercises.
    planar = stp.PlanarRPR.from_sides(2.0, 2**0.5, 2**0.5, np.pi / 2, 4.0, 0.0, 4.0)
    quarter = np.array([-np.pi / 4, np.pi / 4])
    # Round-off of terms up to 1600 m⁶.
    assert np.abs(source_f(planar, [5**0.5] * 3, quarter)).max() < 1e-11
    assert np.abs(stp.planar.planar_pose_polynomial(planar, [5**0.5] * 3, quarter)).max() < 1e-11
    for _ in range(50):
        planar, lengths = random_exercise(rng)
        theta = rng.uniform(-np.pi, np.pi, 20)
        *_, n1, n2, _ = source_terms(planar, lengths, theta)
        ours = stp.planar.planar_pose_polynomial(planar, lengths, theta)
        # Relative to the terms that cancel in f.
        terms = (n1**2 + n2**2).max()
        assert np.abs(ours - source_f(planar, lengths, theta)).max() < 1e-12 * terms


def test_third_equation_needs_a3() -> None:
    # The source prints p3² = (x + A2)² + (y + B3)²; only A3 gives back the length.
    planar = stp.PlanarRPR.from_sides(3.0, 3 * 2**0.5, 3.0, np.pi / 4, 5.0, 0.0, 6.0)
    lengths = np.array([5.0, 5.0, 3.0])
    modes = stp.planar_assembly_modes(planar, lengths)
    a2, b2, a3, b3, n1, n2, d = source_terms(planar, lengths, modes.angle)
    x, y = n1 / d, n2 / d
    np.testing.assert_allclose(np.stack([x, y], axis=-1), modes.position, atol=1e-13)
    np.testing.assert_allclose((x + a2) ** 2 + (y + b2) ** 2, 25.0, atol=1e-12)
    np.testing.assert_allclose((x + a3) ** 2 + (y + b3) ** 2, 9.0, atol=1e-12)
    assert np.abs((x + a2) ** 2 + (y + b3) ** 2 - 9.0).min() > 0.5


def test_a_fine_sign_scan_finds_no_other_roots(rng: np.random.Generator) -> None:
    theta = np.linspace(-np.pi, np.pi, 20001)
    compared = 0
    for _ in range(200):
        planar, lengths = random_exercise(rng)
        modes = stp.planar_assembly_modes(planar, lengths)
        values = source_f(planar, lengths, theta)
        crossings = np.flatnonzero(values[:-1] * values[1:] < 0)
        for k in crossings:
            root = brentq(partial(source_f, planar, lengths), theta[k], theta[k + 1], xtol=1e-14)
            # f loses digits where its terms cancel; the modes do not.
            assert np.abs(modes.angle - root).min() < 1e-6
        # The scan misses pairs between two grid points, so only roots well apart must be equally many.
        if (np.diff(modes.angle) > 2e-3).all():
            assert len(crossings) == len(modes)
            compared += 1
    assert compared > 150


def blind_newton(planar: stp.PlanarRPR, lengths: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Run Gauss–Newton on |leg|² = p² from 300 random poses and keep the different ends."""
    span = np.abs(planar.anchors).max() + np.abs(planar.corners).max() + lengths.max()
    x = np.column_stack([rng.uniform(-span, span, (300, 2)), rng.uniform(-np.pi, np.pi, 300)])
    for _ in range(40):
        c, s = np.cos(x[:, 2]), np.sin(x[:, 2])
        rotation = np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)
        arm = np.einsum("nij,kj->nki", rotation, planar.corners)
        leg = x[:, None, :2] + arm - planar.anchors
        misfit = 0.5 * ((leg**2).sum(axis=-1) - lengths**2)
        slope = np.stack(
            [*np.moveaxis(leg, -1, 0), arm[..., 0] * leg[..., 1] - arm[..., 1] * leg[..., 0]], -1
        )
        step = np.einsum("nij,nj->ni", np.linalg.pinv(slope), misfit)
        x -= step * np.minimum(1.0, span / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-300))
    ends = x[np.abs(misfit).max(axis=-1) < 1e-11 * span**2]
    keys = np.column_stack([ends[:, :2], np.cos(ends[:, 2]), np.sin(ends[:, 2])]).round(5)
    return ends[np.unique(keys, axis=0, return_index=True)[1]]


def test_blind_newton_finds_no_other_poses(rng: np.random.Generator) -> None:
    found, all_found = 0, 0
    for _ in range(40):
        planar = stp.PlanarRPR(rng.normal(size=(3, 2)), rng.normal(size=(3, 2)) * rng.uniform(0.3, 2))
        lengths = stp.planar.planar_leg_lengths(planar, rng.normal(size=2), rng.uniform(-np.pi, np.pi))
        modes = stp.planar_assembly_modes(planar, lengths)
        hit = set()
        for end in blind_newton(planar, lengths, rng):
            turn = np.abs(np.angle(np.exp(1j * (modes.angle - end[2]))))
            gap = np.hypot(*(modes.position - end[:2]).T) + turn
            assert gap.min() < 1e-5
            hit.add(int(np.argmin(gap)))
        found, all_found = found + len(hit), all_found + len(modes)
    # Random starts miss poses with a small basin; they must find nearly all for this test to mean something.
    assert found > 0.9 * all_found


def test_transitions_are_where_the_extremes_of_f_vanish() -> None:
    # S1.7 once more: the extreme of the source's f between merging roots, as a function of p2, changes sign.
    planar = stp.PlanarRPR.from_sides(3.0, 3 * 2**0.5, 3.0, np.pi / 4, 5.0, 0.0, 6.0)
    found = stp.planar.planar_transition_lengths(planar, [5.0, 0.0, 3.0], 1)
    assert len(found.lengths) == 6
    for length, angle in zip(found.lengths, found.angle, strict=True):
        side = np.sign(np.diff(source_f(planar, [5.0, length, 3.0], angle + 1e-3 * np.array([0, 1]))))[0]

        def extreme(p2: float, angle: float = angle, side: float = side) -> float:
            best = minimize_scalar(
                lambda t: side * source_f(planar, [5.0, p2, 3.0], t),
                bounds=(angle - 1e-3, angle + 1e-3),
                method="bounded",
                options={"xatol": 1e-12},
            )
            return side * best.fun

        # f near 1e-11 of round-off, and its slope by p2 some hundreds: twelve digits of p2.
        root = brentq(extreme, length - 1e-6, length + 1e-6, xtol=1e-14)
        assert abs(root - length) < 1e-12
