"""Generated six-legged platforms have the properties that their designs are known for."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import stewart_pin as stp
from stewart_pin.errors import InputError

THIRD = Rotation.from_rotvec([0, 0, 2 * np.pi / 3])


@pytest.mark.parametrize("leg", [0.3, 0.2, 0.05])
def test_the_cube_is_orthogonal_and_decoupled_at_home(leg: float) -> None:
    hexapod, home = stp.hexapods.cubic_hexapod(0.3, leg), [0, 0, leg / (2 * np.sqrt(3))]
    np.testing.assert_allclose(stp.leg_lengths(hexapod, home, np.eye(3)), leg, rtol=1e-14)
    jacobian = stp.leg_jacobian(hexapod, home, np.eye(3))
    # Three pairs of parallel legs, along three orthogonal directions; neighbours are orthogonal.
    cosines = np.round(jacobian[:, :3] @ jacobian[:, :3].T, 14)
    np.testing.assert_array_equal(cosines, np.tile(np.eye(3), (2, 2)))
    expected = np.diag([2, 2, 2, 0.3**2 / 2, 0.3**2 / 2, 2 * 0.3**2])
    np.testing.assert_allclose(jacobian.T @ jacobian, expected, atol=1e-14)
    # Equally fast in every direction, and a force is carried by at most the same leg force in every direction.
    np.testing.assert_allclose(np.linalg.svd(jacobian[:, :3], compute_uv=False), np.sqrt(2), rtol=1e-14)


def test_legs_of_the_cube_lie_on_edges_of_one_cube() -> None:
    short, whole = stp.hexapods.cubic_hexapod(0.3, 0.1), stp.hexapods.cubic_hexapod(0.3)
    lift = np.array([0, 0, 0.1]) / (2 * np.sqrt(3)), np.array([0, 0, 0.3]) / (2 * np.sqrt(3))
    # From the centre of the cube: lower ends, upper ends and middles of both are on the same lines.
    for near, far in ((short.base_points - lift[0], whole.base_points - lift[1]),):
        middle = (whole.platform_points + far) / 2
        np.testing.assert_allclose((short.platform_points + near) / 2, middle, atol=1e-15)
        np.testing.assert_allclose((near - middle) * 3, far - middle, atol=1e-15)
        np.testing.assert_allclose(np.linalg.norm(middle, axis=1), 0.3 / np.sqrt(2), atol=1e-15)
    assert len(np.unique(whole.base_points.round(12), axis=0)) == 3
    assert len(np.unique(whole.platform_points.round(12), axis=0)) == 3


def test_semi_regular_hexagons() -> None:
    hexapod = stp.hexapods.semi_regular_hexapod(0.5, 0.4, 0.2, 0.3)
    for points, radius, half, middle in (
        (hexapod.base_points, 0.5, 0.2, 0.0),
        (hexapod.platform_points, 0.4, 0.3, np.pi / 3),
    ):
        np.testing.assert_allclose(np.linalg.norm(points, axis=1), radius, rtol=1e-15)
        # Three pairs, 2 r sin(half angle) apart, that a turn by 120° maps on each other.
        np.testing.assert_allclose(np.roll(points, -2, axis=0), THIRD.apply(np.array(points)), atol=1e-15)
        pairs = points.reshape(3, 2, 3) if middle == 0 else np.roll(points, -1, axis=0).reshape(3, 2, 3)
        np.testing.assert_allclose(
            np.linalg.norm(pairs[:, 1] - pairs[:, 0], axis=1), 2 * radius * np.sin(half), rtol=1e-14
        )
        first = pairs[0].mean(axis=0)
        assert np.arctan2(first[1], first[0]) == pytest.approx(middle, abs=1e-14)
    lengths = stp.leg_lengths(hexapod, [0, 0, 0.6], np.eye(3))
    expected = np.sqrt(0.5**2 + 0.4**2 - 2 * 0.5 * 0.4 * np.cos(np.pi / 3 - 0.5) + 0.6**2)
    np.testing.assert_allclose(lengths, expected, rtol=1e-14)


def test_similar_hexagons_are_singular_in_every_pose(rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match=r"add up to 60°: .* singular in every pose"):
        stp.hexapods.semi_regular_hexapod(0.5, 0.4, 0.3, np.pi / 3 - 0.3)
    near = stp.hexapods.semi_regular_hexapod(0.5, 0.4, 0.3, 0.3)
    twin = stp.Hexapod(near.base_points, 0.8 * near.base_points)
    for hexapod, singular in ((twin, True), (near, False)):
        for _ in range(5):
            turn = Rotation.from_rotvec(rng.uniform(-0.3, 0.3, 3)).as_matrix()
            jacobian = stp.leg_jacobian(hexapod, [*rng.uniform(-0.1, 0.1, 2), 0.6], turn)
            s = np.linalg.svd(jacobian, compute_uv=False)
            assert (s[-1] < 1e-14) == singular


def test_6_3_has_three_points_above_and_16_poses() -> None:
    hexapod = stp.hexapods.hexapod_6_3(0.5, 0.4, 0.2)
    meeting = hexapod.platform_points[[1, 3, 5]], hexapod.platform_points[[2, 4, 0]]
    np.testing.assert_allclose(*meeting, atol=1e-15)
    np.testing.assert_allclose(np.degrees(np.arctan2(meeting[0][0, 1], meeting[0][0, 0])), 60, atol=1e-12)
    assert len(np.unique(hexapod.base_points.round(12), axis=0)) == 6
    turn = Rotation.from_euler("xyz", [0.1, 0.05, 0.2]).as_matrix()
    modes = stp.assembly_modes(hexapod, stp.leg_lengths(hexapod, [0.02, 0.03, 0.6], turn))
    assert modes.complete and modes.n_complex == 16


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (
            lambda: stp.hexapods.semi_regular_hexapod(0, 1, 0.1, 0.1),
            "base_radius must be a finite number above zero, got 0",
        ),
        (
            lambda: stp.hexapods.semi_regular_hexapod(1, 1, -0.1, 0.1),
            "base_half_angle must be from 0 to below π/3",
        ),
        (
            lambda: stp.hexapods.hexapod_6_3(1, 1, 1.1),
            "base_half_angle must be from 0 to below π/3 .*, got 1.1 rad",
        ),
        (
            lambda: stp.hexapods.cubic_hexapod(0.3, 0.31),
            "leg must be at most the cube's edge of 0.3 m, got 0.31",
        ),
        (lambda: stp.hexapods.cubic_hexapod(np.nan), "edge must be a finite number above zero"),
    ],
)
def test_bad_designs_are_named(build, words: str) -> None:
    with pytest.raises(InputError, match=words):
        build()
