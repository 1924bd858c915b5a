"""Planar platforms at their worst: merged poses, shared angles, coinciding points, locked legs that move."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp

# Poses of these mechanisms are known by construction; merged ones keep a third of the digits.
MERGED = 1e-4


def collinear_circles(square: float) -> tuple[stp.PlanarRPR, np.ndarray]:
    """Build circles around (0, 0), (3, 0), (5, 0) at angle zero that share the points (1, ±sqrt(square))."""
    corners = np.array([[0.0, 0.0], [1.0, 2.0], [-1.0, 1.0]])
    centres = np.array([[0.0, 0.0], [3.0, 0.0], [5.0, 0.0]])
    return stp.PlanarRPR(centres + corners, corners), np.sqrt((centres[:, 0] - 1.0) ** 2 + square)


def test_two_positions_share_an_angle() -> None:
    # D = 0 at angle zero: N / D says nothing, the circles do.
    planar, lengths = collinear_circles(0.25)
    modes = stp.planar_assembly_modes(planar, lengths)
    level = np.abs(modes.angle) < 1e-7
    # Equal up to round-off, the two angles may come in either order.
    shared = modes.position[level][np.argsort(modes.position[level][:, 1])]
    np.testing.assert_allclose(shared, [[1.0, -0.5], [1.0, 0.5]], atol=1e-7)
    assert modes.multiplicity[level].tolist() == [1, 1] and modes.multiplicity.sum() % 2 == 0


def test_a_root_without_a_position_is_dropped() -> None:
    # D = N = 0 at angle zero again, but the circles meet in complex points only.
    planar, lengths = collinear_circles(-0.25)
    assert abs(stp.planar.planar_pose_polynomial(planar, lengths, 0.0)) < 1e-12
    modes = stp.planar_assembly_modes(planar, lengths)
    assert (np.abs(modes.angle) > 1e-3).all() and modes.residual.max(initial=0.0) < 1e-14


def test_two_positions_merge_at_a_shared_angle() -> None:
    planar, lengths = collinear_circles(0.0)
    modes = stp.planar_assembly_modes(planar, lengths)
    level = np.abs(modes.angle) < MERGED
    assert modes.multiplicity[level].tolist() == [2]
    np.testing.assert_allclose(modes.position[level], [[1.0, 0.0]], atol=MERGED)


@pytest.mark.parametrize("reach", [pytest.param(2, marks=pytest.mark.slow), 3])
def test_lattice_geometries(rng: np.random.Generator, reach: int) -> None:
    """Small integers make every kind of coincidence: right angles, equal sides, folded and double legs."""
    kinds = set()
    for _ in range(700):
        planar = stp.PlanarRPR(*rng.integers(-reach, reach + 1, (2, 3, 2)))
        position, angle = rng.integers(-reach, reach + 1, 2), rng.integers(4) * np.pi / 2
        lengths = stp.planar.planar_leg_lengths(planar, position, angle)
        if not lengths.any() and not planar.anchors.any():
            continue
        modes = stp.planar_assembly_modes(planar, lengths)
        assert (modes.angle > -np.pi).all() and (modes.angle <= np.pi).all()
        kinds.add((modes.kind, int(modes.multiplicity.max(initial=0))))
        assert modes.multiplicity.sum() % 2 == 0 and modes.residual.max(initial=0.0) < 1e-13
        if modes.kind == "finite":
            turn = np.abs(np.angle(np.exp(1j * (modes.angle - angle))))
            assert (np.hypot(*(modes.position - position).T) + turn).min() < MERGED
    assert {("finite", 1), ("finite", 2), ("positive-dimensional", 0)} <= kinds


@pytest.mark.parametrize(
    ("anchors", "corners", "lengths", "pose", "multiplicity"),
    [
        # A triple pose where the circles of legs 0 and 2 almost coincide.
        ([[1, -1], [-1, 2], [-2, -1]], [[-2, -1], [1, 2], [-2, 2]], [1, 4, 1], [-1, 1, np.pi / 2], 3),
        # A triple pose at the angle of a simple one: a four-fold root of f, scattered over 1e-4.
        ([[2, 2], [2, 1], [-1, -2]], [[1, 3], [-2, -1], [1, 2]], [74, 8, 8], [-2, -2, np.pi], 3),
        ([[0, 1], [2, 1], [2, 0]], [[0, 0], [-1, 1], [-1, -2]], [5, 25, 5], [-2, 2, np.pi / 2], 3),
        # A triple pose whose neighbours, 1e-5 away along a curve, fit to round-off as well.
        ([[1, 0], [-1, -2], [2, -2]], [[0, 1], [1, 0], [0, -1]], [8, 2, 25], [-2, -2, -np.pi / 2], 3),
    ],
)
def test_triple_poses(anchors, corners, lengths, pose, multiplicity) -> None:
    modes = stp.planar_assembly_modes(stp.PlanarRPR(anchors, corners), np.sqrt(lengths))
    turn = np.abs(np.angle(np.exp(1j * (modes.angle - pose[2]))))
    there = np.hypot(*(modes.position - pose[:2]).T) + turn < 1e-3
    assert modes.multiplicity[there].tolist() == [multiplicity]
    assert modes.multiplicity.sum() % 2 == 0


def test_congruent_triangles_swing_and_turn() -> None:
    anchors = np.array([[1.0, 2.0], [4.0, 2.0], [1.0, 6.0]])  # right-angled, circumradius 2.5
    turn = 0.7
    back = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    planar = stp.PlanarRPR(anchors, anchors @ back.T + [0.3, -0.8])
    modes = stp.planar_assembly_modes(planar, [2.0, 2.0, 2.0])
    assert modes.kind == "positive-dimensional" and "circle" in modes.motion
    # A turn by φ about the circumcentre moves each corner by 5 sin(φ/2).
    half = np.arcsin(2.0 / 5.0)
    np.testing.assert_allclose(modes.angle, [turn - 2 * half, turn + 2 * half], atol=1e-14)
    assert modes.residual.max() < 1e-14
    # The motion is real: all the poses of the circle fit.
    around = np.linspace(0.0, 2 * np.pi, 7)
    home = anchors[0] - planar.corners[0] @ np.array(
        [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
    )
    position = home + 2.0 * np.stack([np.cos(around), np.sin(around)], axis=-1)
    np.testing.assert_allclose(stp.planar.planar_leg_lengths(planar, position, turn), 2.0, atol=1e-14)


@pytest.mark.parametrize(("length", "count"), [(2.5, 2), (5.0, 1), (5.1, 0)])
def test_congruent_triangles_turn_at_most_by_half(length: float, count: int) -> None:
    triangle = np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 4.0]])
    modes = stp.planar_assembly_modes(stp.PlanarRPR(triangle, triangle), [length] * 3)
    assert len(modes) == count and modes.multiplicity.sum() in (0, 2)
    assert modes.kind == "positive-dimensional"


def test_congruent_rows_of_points_only_swing() -> None:
    row = np.array([[0.0, 0.0], [1.0, 0.0], [3.0, 0.0]])
    modes = stp.planar_assembly_modes(stp.PlanarRPR(row, row), [1.0, 1.0, 1.0])
    assert len(modes) == 0 and modes.kind == "positive-dimensional"


@pytest.mark.parametrize("swap", [False, True])
def test_two_points_coincide(swap: bool) -> None:
    # Corners 0 and 1 are one point, 4 from anchor 0 and 3 from anchor 1: at (0, ±3) or so, then leg 2.
    anchors, corners = [[0.0, 0.0], [5.0, 0.0], [1.0, 7.0]], [[1.0, 1.0], [1.0, 1.0], [2.0, 1.0]]
    planar = stp.PlanarRPR(corners, anchors) if swap else stp.PlanarRPR(anchors, corners)
    modes = stp.planar_assembly_modes(planar, [4.0, 3.0, 5.0])
    # From (3.2, 2.4) to (1, 7) it is sqrt(26): leg and side, 5 and 1, reach; from (3.2, -2.4) they do not.
    assert len(modes) == 2 and modes.residual.max() < 2e-15
    if not swap:
        c, s = np.cos(modes.angle), np.sin(modes.angle)
        shared = modes.position + np.stack([c - s, s + c], axis=-1)
        np.testing.assert_allclose(shared, [[3.2, 2.4]] * 2, atol=1e-14)


def test_a_corner_on_the_third_anchor_spins() -> None:
    # The shared corner meets anchor 2, and leg 2 is as long as the side: there any angle fits.
    planar = stp.PlanarRPR([[0, 0], [5, 0], [3.2, 2.4]], [[0, 0], [0, 0], [2, 0]])
    modes = stp.planar_assembly_modes(planar, [4.0, 3.0, 2.0])
    assert modes.kind == "positive-dimensional" and "rotation" in modes.motion
    for angle in np.linspace(-3.0, 3.0, 5):
        np.testing.assert_allclose(
            stp.planar.planar_leg_lengths(planar, [3.2, 2.4], angle), [4, 3, 2], atol=1e-14
        )


@pytest.mark.parametrize(
    ("lengths", "kind", "count"),
    [
        ([2.0, 2.0, 2.0], "positive-dimensional", 0),
        ([2.0, 2.5, 2.0], "finite", 0),  # the two equal legs contradict each other
        ([1.0, 1.0, 1.5], "finite", 0),  # the four bars do not reach
        ([1.0, 1.0, 2.0], "finite", 1),  # they just reach, stretched
    ],
)
def test_two_legs_are_the_same(lengths: list[float], kind: str, count: int) -> None:
    planar = stp.PlanarRPR([[0, 0], [0, 0], [4, 0]], [[0, 0], [0, 0], [1, 0]])
    modes = stp.planar_assembly_modes(planar, lengths)
    assert (modes.kind, len(modes)) == (kind, count)
    if count:
        np.testing.assert_allclose(modes.position, [[1.0, 0.0]], atol=1e-15)
        assert modes.multiplicity.tolist() == [2]


def test_all_corners_in_one_point() -> None:
    planar = stp.PlanarRPR([[0, 0], [0, 0], [4, 0]], np.zeros((3, 2)))
    assert stp.planar_assembly_modes(planar, [2.0, 2.0, 3.0]).kind == "positive-dimensional"
    assert stp.planar_assembly_modes(planar, [2.0, 2.0, 1.0]).kind == "finite"


def test_a_leg_without_length_pins_its_corner() -> None:
    planar = stp.PlanarRPR([[0, 0], [5, 0], [0, 5]], [[0, 0], [1, 0.5], [0, 2]])
    angle = 0.4
    lengths = stp.planar.planar_leg_lengths(planar, [0.0, 0.0], angle)
    assert lengths[0] == 0.0
    modes = stp.planar_assembly_modes(planar, lengths)
    np.testing.assert_allclose(modes.angle, [angle], atol=1e-14)
    np.testing.assert_array_equal(modes.position, [[0.0, 0.0]])
    assert len(stp.planar_assembly_modes(planar, lengths + [0.0, 0.0, 0.1])) == 0
    # All anchors in one point, which carries a corner: the platform turns freely.
    spin = stp.PlanarRPR(np.zeros((3, 2)), planar.corners)
    assert stp.planar_assembly_modes(spin, [0.0, 1.25**0.5, 2.0]).kind == "positive-dimensional"


@pytest.mark.parametrize("excess", [1e-4, 1e-7, 1e-10])
def test_nearly_congruent_triangles_keep_their_poses(excess: float) -> None:
    # A breath away from the swing, two of its poses remain besides the two turns; the legs barely say where.
    triangle = np.array([[1.0, 2.0], [4.0, 2.0], [1.0, 6.0]])
    modes = stp.planar_assembly_modes(stp.PlanarRPR(triangle, triangle), [2.0, 2.0, 2.0 + excess])
    assert modes.kind == "finite" and len(modes) == 4 and modes.residual.max() < 1e-14
    assert abs(modes.angle[1] + modes.angle[2]) < excess


@pytest.mark.parametrize("excess", [pytest.param(1e-5, marks=pytest.mark.slow), 1e-7])
def test_nearly_congruent_triangles_keep_the_generating_pose(rng: np.random.Generator, excess: float) -> None:
    # All three circles nearly coincide; where two of them meet tells nothing about the pose.
    for _ in range(40):
        anchors = rng.normal(size=(3, 2))
        planar = stp.PlanarRPR(anchors, anchors + excess * rng.normal(size=(3, 2)))
        around, angle = rng.uniform(-np.pi, np.pi), excess * rng.normal()
        position = rng.uniform(0.3, 2.0) * np.array([np.cos(around), np.sin(around)])
        modes = stp.planar_assembly_modes(planar, stp.planar.planar_leg_lengths(planar, position, angle))
        assert len(modes) % 2 == 0 and modes.residual.max() < 1e-13
        # The legs fix the pose along the circle by no more than round-off over the excess.
        assert np.hypot(*(modes.position - position).T).min() < 1e-3
