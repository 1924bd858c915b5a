"""Rates and accelerations of the legs against differences along a path, and their errors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import stewart_pin as stp
from stewart_pin.errors import InputError, SingularityError
from stewart_pin.geometry.rotations import rotation_from_rpy


def test_rates_and_accelerations_are_derivatives_of_the_lengths(report_cad: stp.Hexapod, rng) -> None:
    h = 1e-3
    t = h * np.arange(-2, 3)
    for _ in range(50):
        position = np.array([0, 0, 1.0]) + rng.uniform(-0.2, 0.2, 3)
        rotation = rotation_from_rpy(*rng.uniform(-0.3, 0.3, 3))
        twist, acceleration = rng.normal(size=(2, 6))
        # exp(θ) with θ = ω t + dω/dt t²/2 has the angular velocity ω and acceleration dω/dt at t = 0; the
        # next term of ω is of order t², so it reaches the lengths at t³ and cancels in the second difference.
        travel = np.multiply.outer(t, twist) + np.multiply.outer(t**2 / 2, acceleration)
        turned = Rotation.from_rotvec(travel[:, 3:]).as_matrix() @ rotation
        lengths = stp.leg_lengths(report_cad, position + travel[:, :3], turned)
        rates = np.array([1, -8, 0, 8, -1]) @ lengths / (12 * h)
        accelerations = np.array([-1, 16, -30, 16, -1]) @ lengths / (12 * h**2)
        state = report_cad, position, rotation, twist
        # Truncation: h⁴ / 30 times the fifth derivative of a length, up to 1e4 m/s⁵; round-off eps / h².
        assert np.abs(stp.hexapods.leg_rates(*state) - rates).max() < 1e-9
        assert np.abs(stp.hexapods.leg_accelerations(*state, acceleration) - accelerations).max() < 1e-8


def test_a_platform_at_rest_has_legs_at_rest(report_cad: stp.Hexapod) -> None:
    state = report_cad, [0.1, 0, 1.0], np.eye(3), np.zeros(6)
    np.testing.assert_array_equal(stp.hexapods.leg_rates(*state), np.zeros(6))
    np.testing.assert_array_equal(stp.hexapods.leg_accelerations(*state, np.zeros(6)), np.zeros(6))


def test_batches_of_poses_and_of_twists(report_cad: stp.Hexapod, rng) -> None:
    position, twist, acceleration = [0, 0, 1.0], rng.normal(size=(4, 1, 6)), rng.normal(size=(5, 6))
    assert stp.hexapods.leg_rates(report_cad, position, np.eye(3), twist).shape == (4, 1, 6)
    accelerations = stp.hexapods.leg_accelerations(report_cad, position, np.eye(3), twist, acceleration)
    assert accelerations.shape == (4, 5, 6)
    one = stp.hexapods.leg_accelerations(report_cad, position, np.eye(3), twist[2, 0], acceleration[3])
    np.testing.assert_allclose(accelerations[2, 3], one, rtol=1e-13)


def test_bad_motions_are_named(report_cad: stp.Hexapod) -> None:
    pose = report_cad, np.zeros((2, 3)) + [0, 0, 1], np.eye(3)
    with pytest.raises(InputError, match="twist must have shape"):
        stp.hexapods.leg_rates(*pose, np.zeros(5))
    with pytest.raises(InputError, match=r"batch shapes do not fit.*twist"):
        stp.hexapods.leg_rates(*pose, np.zeros((3, 6)))
    with pytest.raises(InputError, match="acceleration must be finite"):
        stp.hexapods.leg_accelerations(*pose, np.zeros(6), [0, 0, 0, np.nan, 0, 0])


def test_a_leg_without_length_has_no_rate(report_cad: stp.Hexapod) -> None:
    flat = stp.Hexapod(report_cad.base_points, report_cad.base_points)
    for call in (
        lambda: stp.hexapods.leg_rates(flat, np.zeros(3), np.eye(3), np.zeros(6)),
        lambda: stp.hexapods.leg_accelerations(flat, np.zeros(3), np.eye(3), np.zeros(6), np.zeros(6)),
    ):
        with pytest.raises(SingularityError, match="length zero"):
            call()
