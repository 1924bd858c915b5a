"""Motions: the derivatives are those of the pose."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError


def test_twist_and_acceleration_are_the_derivatives_of_the_position() -> None:
    # S0.6: x 1 Hz, y 3 Hz, z 4.5 Hz, 20 mm.
    time, h = stp.motions.sample_times(2.0, 50.0), 1e-5
    home = pin.SE3(np.eye(3), np.array([0.1, 0.2, 1.0]))
    before, here, after = (stp.motions.sinusoidal_motion(time + s, home=home) for s in (-h, 0.0, h))
    # Central differences: h² ω³ a / 6 is 8e-9 of truncation, eps / h 1e-11 and eps / h² 1e-6 of round-off.
    np.testing.assert_allclose((after.position - before.position) / (2 * h), here.twist[:, :3], atol=1e-8)
    second = (after.position - 2 * here.position + before.position) / h**2
    np.testing.assert_allclose(second, here.acceleration[:, :3], atol=2e-5)
    assert np.abs(here.position - home.translation).max(axis=0) == pytest.approx([0.02, 0.02, 0.02], rel=1e-2)
    assert not here.twist[:, 3:].any() and not here.acceleration[:, 3:].any()
    np.testing.assert_array_equal(here.pose(7).translation, here.position[7])


def test_single_frequency_is_a_special_case() -> None:
    time = stp.motions.sample_times(1.0, 1000.0)
    motion = stp.motions.sinusoidal_motion(
        time, home=pin.SE3.Identity(), amplitude=(0, 0, 0.01), frequency=(0, 0, 5.0)
    )
    np.testing.assert_allclose(motion.position[:, 2], 0.01 * np.sin(10 * np.pi * time), atol=1e-16)
    assert not motion.position[:, :2].any()


def test_sample_times_leave_the_end_out() -> None:
    time = stp.motions.sample_times(2.0, 500.0)
    assert len(time) == 1000 and time[0] == 0.0 and time[-1] == pytest.approx(1.998)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"amplitude": (1, 2)}, "amplitude must have shape"),
        ({"frequency": (1, -2, 3)}, "frequency must be 0 or more"),
        ({"frequency": (1, np.nan, 3)}, "frequency must be finite"),
        ({"home": np.eye(4)}, "home must be a pinocchio.SE3"),
    ],
)
def test_bad_motions_are_named(arguments, words) -> None:
    with pytest.raises(InputError, match=words):
        stp.motions.sinusoidal_motion([0.0, 1.0], **({"home": pin.SE3.Identity()} | arguments))


@pytest.mark.parametrize(
    ("duration", "rate"), [(-1.0, 10.0), (1.0, 0.0), (1e9, 1e9), (np.inf, 1.0), (1e-3, 1.0)]
)
def test_bad_durations_are_named(duration, rate) -> None:
    with pytest.raises(InputError, match=r"duration|rate"):
        stp.motions.sample_times(duration, rate)
