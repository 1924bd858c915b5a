"""Transition lengths of the planar platform: the figures S1.7, counts on random and special geometries."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, UnsupportedError


@pytest.fixture
def exercise() -> stp.PlanarRPR:
    """Return the platform of S1.4 to S1.7."""
    return stp.PlanarRPR.from_sides(3.0, 3 * 2**0.5, 3.0, np.pi / 4, 5.0, 0.0, 6.0)


def test_intervals_of_the_exercise(exercise: stp.PlanarRPR) -> None:
    # S1.7: the source prints two digits, the recomputed ends have seven.
    found = stp.planar.planar_transition_lengths(exercise, [5.0, 0.0, 3.0], 1)
    ends = [3.710531, 4.863724, 6.967344, 7.022340, 7.849087, 9.262383]
    np.testing.assert_allclose(found.lengths, ends, rtol=0, atol=0.51e-6)
    assert found.counts.tolist() == [0, 2, 4, 6, 4, 2, 0]
    assert [len(found.intervals(n)) for n in (0, 2, 4, 6)] == [2, 2, 2, 1]
    assert found.intervals(6) == [(found.lengths[2], found.lengths[3])]
    assert found.intervals(0)[-1][1] == np.inf


def test_counts_on_either_side_of_each_transition(exercise: stp.PlanarRPR) -> None:
    found = stp.planar.planar_transition_lengths(exercise, [5.0, 0.0, 3.0], 1)
    for k, length in enumerate(found.lengths):
        below, at, above = (
            stp.planar_assembly_modes(exercise, [5.0, length + step, 3.0]) for step in (-1e-9, 0.0, 1e-9)
        )
        assert (len(below), len(above)) == (found.counts[k], found.counts[k + 1])
        # At the transition two poses are one, at the place reported; it moves by the root of round-off.
        assert sorted(at.multiplicity)[-1] == 2 and len(at) == max(len(below), len(above)) - 1
        merged = int(np.argmax(at.multiplicity))
        assert abs(at.angle[merged] - found.angle[k]) < 1e-6
        np.testing.assert_allclose(at.position[merged], found.position[k], atol=1e-6)
    assert found.residual.max() < 2e-15


def test_merged_poses_are_singular(exercise: stp.PlanarRPR) -> None:
    for leg in range(3):
        found = stp.planar.planar_transition_lengths(exercise, [5.0, 5.0, 3.0], leg)
        jacobian = stp.planar.planar_leg_jacobian(exercise, found.position, found.angle)
        singular = np.linalg.svd(jacobian, compute_uv=False)
        assert (singular[:, -1] < 1e-12 * singular[:, 0]).all()


def test_random_geometries_change_where_told(rng: np.random.Generator) -> None:
    seen = set()
    for _ in range(40):
        planar = stp.PlanarRPR(rng.normal(size=(3, 2)), rng.normal(size=(3, 2)) * rng.uniform(0.3, 2))
        lengths = stp.planar.planar_leg_lengths(planar, rng.normal(size=2), rng.uniform(-np.pi, np.pi))
        leg = int(rng.integers(3))
        found = stp.planar.planar_transition_lengths(planar, lengths, leg)
        assert (np.abs(np.diff(found.counts)) == 2).all() and found.residual.max() < 1e-14
        assert found.counts[-1] == 0
        seen.add(int(found.counts.max()))
        probe = np.concatenate(
            [np.linspace(0.01, 1.2 * found.lengths[-1], 60), found.lengths - 1e-9, found.lengths + 1e-9]
        )
        probe = probe[probe > 0.0]
        sweep = np.tile(lengths, (len(probe), 1))
        sweep[:, leg] = probe
        counts = stp.planar.planar_assembly_modes_batch(planar, sweep).count
        np.testing.assert_array_equal(counts, found.counts[np.searchsorted(found.lengths, probe)])
    assert seen == {2, 4, 6}


def test_special_linkages_change_by_even_numbers(rng: np.random.Generator) -> None:
    """Integer linkages fold flat, translate as parallelograms, or meet two transitions at once."""
    for _ in range(50):
        planar = stp.PlanarRPR(*rng.integers(-2, 3, (2, 3, 2)))
        lengths = rng.integers(1, 5, 3).astype(float)
        if (planar.anchors[0] == planar.anchors[1]).all() and (planar.corners[0] == planar.corners[1]).all():
            continue
        found = stp.planar.planar_transition_lengths(planar, lengths, 2)
        assert (found.counts % 2 == 0).all() and (np.diff(found.counts) != 0).all()
        probe = np.linspace(0.0, 8.0, 41)[1:] + 1e-3 * np.pi
        sweep = np.tile(lengths, (len(probe), 1))
        sweep[:, 2] = probe
        counts = stp.planar.planar_assembly_modes_batch(planar, sweep).count
        np.testing.assert_array_equal(counts, found.counts[np.searchsorted(found.lengths, probe)])


def test_a_parallelogram_linkage() -> None:
    # Legs 0 and 1 carry corner 2, the platform origin, along a circle of radius 2 around (0, 1).
    planar = stp.PlanarRPR([[-1, 1], [1, 1], [0, 6]], [[-1, 0], [1, 0], [0, 0]])
    found = stp.planar.planar_transition_lengths(planar, [2.0, 2.0, 0.0], 2)
    # Highest and lowest point of the circle: (0, 3) and (0, -1).
    assert {3.0, 7.0} <= set(found.lengths.round(12))


@pytest.mark.parametrize(
    ("anchors", "corners", "lengths", "leg", "ends", "counts"),
    [
        # A kite: legs 0 and 1 may fold onto bars of their lengths; then leg 2 turns idly about its anchor.
        # On the other branch it reaches one side more or less than leg 0, from the same anchor.
        (
            [[-1, 0], [2, 0], [-1, 0]],
            [[1, 0], [0, 2], [0, 0]],
            [5**0.5, 3.0, 0.0],
            2,
            [5**0.5 - 1, 5**0.5 + 1],
            [0, 4, 0],
        ),
        # Congruent rows of points: translation along the unit circle, or turned by up to a right angle, where
        # legs 1 and 2 stand in one line and the last corner is three units off.
        ([[1, 0], [0, 1], [-1, 2]], [[0, -1], [-1, 0], [-2, 1]], [0.0, 1.0, 1.0], 0, [1.0, 3.0], [0, 4, 0]),
        # Legs 0 and 1 stretched in one line hold their common corner at (2, 0); the platform turns about it.
        # Both ways of holding it have become one, which the count of different poses shows.
        ([[0, 0], [5, 0], [2, 7]], [[0, 0], [0, 0], [3, 0]], [2.0, 3.0, 0.0], 2, [4.0, 10.0], [0, 2, 0]),
    ],
)
def test_linkages_with_a_hidden_branch(anchors, corners, lengths, leg, ends, counts) -> None:
    found = stp.planar.planar_transition_lengths(stp.PlanarRPR(anchors, corners), lengths, leg)
    np.testing.assert_allclose(found.lengths, ends, rtol=1e-14)
    assert found.counts.tolist() == counts


def test_a_linkage_that_cannot_be_closed(exercise: stp.PlanarRPR) -> None:
    found = stp.planar.planar_transition_lengths(exercise, [0.1, 0.1, 0.0], 2)
    assert found.lengths.shape == (0,) and found.counts.tolist() == [0]
    assert found.intervals(0) == [(0.0, np.inf)]


def test_bad_input_is_named(exercise: stp.PlanarRPR) -> None:
    with pytest.raises(InputError, match="leg must be 0, 1 or 2, got 3"):
        stp.planar.planar_transition_lengths(exercise, [5.0, 5.0, 3.0], 3)
    with pytest.raises(InputError, match="lengths must have shape"):
        stp.planar.planar_transition_lengths(exercise, [5.0, 5.0], 0)
    double = stp.PlanarRPR([[0, 0], [0, 0], [4, 0]], [[0, 0], [0, 0], [1, 0]])
    with pytest.raises(UnsupportedError, match="legs 1 and 2 share both ends"):
        stp.planar.planar_transition_lengths(double, [1.0, 1.0, 1.0], 2)
