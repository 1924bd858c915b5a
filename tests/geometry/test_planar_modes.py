"""Assembly modes of the planar platform: the figures S1.1 to S1.6, and laws on random geometries."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError

# Leg lengths are polished until Newton's step no longer lowers the misfit: a few units in the last place.
ROUND_OFF = 1e-14


@pytest.fixture
def exercise() -> stp.PlanarRPR:
    """Return the platform of S1.4 to S1.7."""
    return stp.PlanarRPR.from_sides(3.0, 3 * 2**0.5, 3.0, np.pi / 4, 5.0, 0.0, 6.0)


def corners(planar: stp.PlanarRPR, modes: stp.planar.PlanarModes) -> np.ndarray:
    c, s = np.cos(modes.angle), np.sin(modes.angle)
    rotation = np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)
    return modes.position[:, None] + np.einsum("nij,kj->nki", rotation, planar.corners)


def distance(modes: stp.planar.PlanarModes, position: np.ndarray, angle: float) -> np.ndarray:
    turn = np.angle(np.exp(1j * (modes.angle - angle)))
    return np.hypot(*(modes.position - position).T) + np.abs(turn)


def test_first_example_has_two_poses() -> None:
    # S1.1 and S1.3: angles -π/4 and π/4, corners as printed.
    planar = stp.PlanarRPR.from_sides(2.0, 2**0.5, 2**0.5, np.pi / 2, 4.0, 0.0, 4.0)
    modes = stp.planar_assembly_modes(planar, [5**0.5] * 3)
    np.testing.assert_allclose(modes.angle, [-np.pi / 4, np.pi / 4], atol=1e-15)
    printed = [[[1, 2], [2, 1], [2, 3]], [[2, 1], [3, 2], [1, 2]]]
    np.testing.assert_allclose(corners(planar, modes), printed, atol=1e-15)
    assert modes.kind == "finite" and modes.multiplicity.tolist() == [1, 1]


def test_second_example_to_fifteen_digits(exercise: stp.PlanarRPR) -> None:
    # S1.4, printed to fifteen decimals.
    printed = [-0.720849204460390, -0.331005184283869, 1.143685517821374, 2.115909014086458]
    modes = stp.planar_assembly_modes(exercise, [5.0, 5.0, 3.0])
    # Half a unit of the last printed digit, plus one unit in the last place of our 2.1.
    np.testing.assert_allclose(modes.angle, printed, rtol=0, atol=1.0e-15)
    lengths = stp.planar.planar_leg_lengths(exercise, modes.position, modes.angle)
    assert np.abs(lengths - [5.0, 5.0, 3.0]).max() <= ROUND_OFF
    np.testing.assert_array_equal(modes.residual, np.abs(lengths - [5.0, 5.0, 3.0]).max(axis=-1))


@pytest.mark.parametrize(
    ("p2", "angles"),
    [
        (7.0, [-0.673157, -0.354740, 0.037767, 0.458878, 0.977673, 2.513853]),  # S1.5
        (4.0, [1.331642, 1.777514]),  # S1.6
    ],
)
def test_six_and_two_poses(exercise: stp.PlanarRPR, p2: float, angles: list[float]) -> None:
    modes = stp.planar_assembly_modes(exercise, [5.0, p2, 3.0])
    np.testing.assert_allclose(modes.angle, angles, rtol=0, atol=0.5e-6)
    assert modes.residual.max() <= ROUND_OFF and (modes.multiplicity == 1).all()


def test_the_generating_pose_is_always_found(rng: np.random.Generator) -> None:
    for _ in range(2000):
        planar = stp.PlanarRPR(
            rng.normal(size=(3, 2)) * rng.uniform(0.1, 3), rng.normal(size=(3, 2)) * rng.uniform(0.1, 3)
        )
        position, angle = rng.normal(size=2), rng.uniform(-np.pi, np.pi)
        lengths = stp.planar.planar_leg_lengths(planar, position, angle)
        modes = stp.planar_assembly_modes(planar, lengths)
        # A pose that is 1e-7 from merging keeps half the digits; the residual keeps all.
        assert distance(modes, position, angle).min() < 1e-7
        assert modes.residual.max() <= ROUND_OFF * max(1.0, lengths.max())
        # Real roots of a real trigonometric polynomial come in pairs.
        assert modes.multiplicity.sum() % 2 == 0 and modes.multiplicity.sum() <= 6
        assert (np.diff(modes.angle) >= 0).all() and (np.abs(modes.angle) <= np.pi).all()


def test_origins_of_both_frames_do_not_matter(exercise: stp.PlanarRPR, rng: np.random.Generator) -> None:
    modes = stp.planar_assembly_modes(exercise, [5.0, 7.0, 3.0])
    for _ in range(10):
        anchor_shift, corner_shift = rng.normal(size=(2, 2))
        moved = stp.PlanarRPR(exercise.anchors + anchor_shift, exercise.corners + corner_shift)
        again = stp.planar_assembly_modes(moved, [5.0, 7.0, 3.0])
        # Condition of six poses within 0.06 of merging, times round-off of the shift.
        np.testing.assert_allclose(again.angle, modes.angle, atol=1e-12)
        np.testing.assert_allclose(corners(moved, again), corners(exercise, modes) + anchor_shift, atol=1e-12)


@pytest.mark.parametrize("unit", [1e-120, 1e-3, 1e3, 1e120])
def test_units_do_not_matter(exercise: stp.PlanarRPR, unit: float) -> None:
    scaled = stp.PlanarRPR(exercise.anchors * unit, exercise.corners * unit)
    modes = stp.planar_assembly_modes(exercise, [5.0, 7.0, 3.0])
    again = stp.planar_assembly_modes(scaled, unit * np.array([5.0, 7.0, 3.0]))
    np.testing.assert_allclose(again.angle, modes.angle, atol=1e-12)
    np.testing.assert_allclose(again.position / unit, modes.position, atol=1e-12)


def test_order_of_the_legs_does_not_matter(exercise: stp.PlanarRPR) -> None:
    modes = stp.planar_assembly_modes(exercise, [5.0, 7.0, 3.0])
    for order in ([1, 2, 0], [2, 0, 1], [0, 2, 1]):
        turned = stp.PlanarRPR(exercise.anchors[order], exercise.corners[order])
        again = stp.planar_assembly_modes(turned, np.array([5.0, 7.0, 3.0])[order])
        np.testing.assert_allclose(again.angle, modes.angle, atol=1e-12)
        np.testing.assert_allclose(again.position, modes.position, atol=1e-12)


def test_many_lengths_at_once(exercise: stp.PlanarRPR, rng: np.random.Generator) -> None:
    lengths = rng.uniform(2.0, 9.0, (200, 3))
    batch = stp.planar.planar_assembly_modes_batch(exercise, lengths)
    assert len(batch) == 200 and set(batch.count) >= {0, 2, 4}
    for k in range(200):
        one, row = stp.planar_assembly_modes(exercise, lengths[k]), batch.row(k)
        assert len(row) == len(one) == batch.count[k]
        np.testing.assert_allclose(row.angle, one.angle, atol=1e-9)
    # Empty slots come last and hold zeros, never NaN.
    empty = batch.multiplicity == 0
    assert not batch.position[empty].any() and not batch.angle[empty].any()
    assert (np.diff(empty.astype(int), axis=1) >= 0).all()


def test_no_lengths_at_all(exercise: stp.PlanarRPR) -> None:
    batch = stp.planar.planar_assembly_modes_batch(exercise, np.zeros((0, 3)))
    assert len(batch) == 0 and batch.position.shape == (0, 6, 2)


def test_legs_that_cannot_meet(exercise: stp.PlanarRPR) -> None:
    modes = stp.planar_assembly_modes(exercise, [1.0, 1.0, 30.0])
    assert len(modes) == 0 and modes.kind == "finite" and modes.position.shape == (0, 2)


@pytest.mark.parametrize("length", [1e-9, 1e9, 1e15, 1e300])
def test_absurd_lengths_give_numbers(exercise: stp.PlanarRPR, length: float) -> None:
    for lengths in ([length, 5.0, 3.0], [length] * 3, [length, length, 0.0]):
        modes = stp.planar_assembly_modes(exercise, lengths)
        assert np.isfinite(modes.position).all() and np.isfinite(modes.angle).all()
        assert (modes.residual <= 1e-13 * max(length, 10.0)).all()


def test_bad_lengths_are_named(exercise: stp.PlanarRPR) -> None:
    with pytest.raises(InputError, match="lengths must have shape"):
        stp.planar_assembly_modes(exercise, [5.0, 5.0])
    with pytest.raises(InputError, match="lengths must not be negative, got -5"):
        stp.planar_assembly_modes(exercise, [-5.0, 5.0, 3.0])
    with pytest.raises(InputError, match="lengths must be finite"):
        stp.planar_assembly_modes(exercise, [np.nan, 5.0, 3.0])
    with pytest.raises(InputError, match="no mechanism"):
        stp.planar_assembly_modes(stp.PlanarRPR(np.zeros((3, 2)), np.zeros((3, 2))), [0.0, 0.0, 0.0])
