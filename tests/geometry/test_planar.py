"""Closed forms of the planar platform: lengths, Jacobian, construction from sides, bad input."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, SingularityError


def random_planar(rng: np.random.Generator) -> stp.PlanarRPR:
    return stp.PlanarRPR(rng.normal(size=(3, 2)), rng.normal(size=(3, 2)))


def test_lengths_of_a_right_angled_platform() -> None:
    planar = stp.PlanarRPR([[0, 0], [4, 0], [0, 4]], [[1, 0], [3, 0], [0, 2]])
    # A quarter turn puts the corners at (5, 6), (5, 8), (3, 5).
    lengths = stp.planar.planar_leg_lengths(planar, [5.0, 5.0], np.pi / 2)
    np.testing.assert_allclose(lengths, np.sqrt([61.0, 65.0, 10.0]), rtol=4e-16)


def test_jacobian_is_the_derivative_of_the_lengths(rng: np.random.Generator) -> None:
    h = 1e-6
    for _ in range(20):
        planar, x = random_planar(rng), rng.normal(size=3)
        numeric = np.empty((3, 3))
        for k in range(3):
            plus, minus = x + h * np.eye(3)[k], x - h * np.eye(3)[k]
            numeric[:, k] = stp.planar.planar_leg_lengths(planar, plus[:2], plus[2])
            numeric[:, k] -= stp.planar.planar_leg_lengths(planar, minus[:2], minus[2])
        # Central differences: h² truncation (larger on short legs) and eps/h round-off, both near 1e-10.
        jacobian = stp.planar.planar_leg_jacobian(planar, x[:2], x[2])
        assert np.abs(jacobian - numeric / (2 * h)).max() < 1e-8


def test_any_batch_shape(rng: np.random.Generator) -> None:
    planar = random_planar(rng)
    position, angle = rng.normal(size=(2, 1, 2)), rng.normal(size=(2, 5))
    lengths = stp.planar.planar_leg_lengths(planar, position, angle)
    jacobian = stp.planar.planar_leg_jacobian(planar, position, angle)
    assert lengths.shape == (2, 5, 3) and jacobian.shape == (2, 5, 3, 3)
    np.testing.assert_array_equal(
        lengths[1, 3], stp.planar.planar_leg_lengths(planar, position[1, 0], angle[1, 3])
    )


def test_sides_make_the_triangle() -> None:
    # S1.4: a triangle with sides 3 (opposite the first corner), 3√2 and 3.
    planar = stp.PlanarRPR.from_sides(3.0, 3 * 2**0.5, 3.0, np.pi / 4, 5.0, 0.0, 6.0)
    np.testing.assert_allclose(planar.corners, [[0, 0], [3, 0], [3, 3]], atol=1e-15)
    np.testing.assert_array_equal(planar.anchors, [[0, 0], [5, 0], [0, 6]])


def test_arrays_are_frozen_copies() -> None:
    anchors = np.zeros((3, 2))
    planar = stp.PlanarRPR(anchors, np.eye(3)[:, :2])
    anchors[0] = 7.0
    assert not planar.anchors.any()
    with pytest.raises(ValueError, match="read-only"):
        planar.corners[0, 0] = 1.0


def test_bad_input_is_named() -> None:
    planar = stp.PlanarRPR(np.eye(3)[:, :2], np.eye(3)[:, :2])
    with pytest.raises(InputError, match="anchors must have shape"):
        stp.PlanarRPR(np.zeros((3, 3)), np.zeros((3, 2)))
    with pytest.raises(InputError, match="corners must be finite"):
        stp.PlanarRPR(np.zeros((3, 2)), [[0, 0], [1, np.inf], [0, 1]])
    with pytest.raises(InputError, match=r"l1 must close the triangle: .* give 3"):
        stp.PlanarRPR.from_sides(2.9, 3 * 2**0.5, 3.0, np.pi / 4, 5.0, 0.0, 6.0)
    with pytest.raises(InputError, match="l2 must be a finite number above zero"):
        stp.PlanarRPR.from_sides(3.0, -1.0, 3.0, np.pi / 4, 5.0, 0.0, 6.0)
    with pytest.raises(InputError, match="batch shapes do not fit"):
        stp.planar.planar_leg_lengths(planar, np.zeros((2, 2)), np.zeros(3))
    with pytest.raises(InputError, match="position must have shape"):
        stp.planar.planar_leg_lengths(planar, [0.0, 0.0, 0.0], 0.0)
    with pytest.raises(SingularityError, match="leg 1 has length zero"):
        stp.planar.planar_leg_jacobian(planar, [0.0, 0.0], 0.0)
