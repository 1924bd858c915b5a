"""Chirps, minimum-jerk moves and splines: derivatives on the manifold, ends at rest."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from stewart_pin.errors import InputError
from stewart_pin.motion.trajectories import PlatformSamples, chirp_motion, minimum_jerk_motion, spline_motion


def poses(rng: np.random.Generator, count: int) -> list[pin.SE3]:
    return [
        pin.SE3(pin.exp3(rng.uniform(-0.4, 0.4, 3)), np.array([0, 0, 1]) + rng.uniform(-0.1, 0.1, 3))
        for _ in range(count)
    ]


def check_derivatives(motion, time: np.ndarray) -> None:
    h = 1e-5
    before, here, after = motion(time - h), motion(time), motion(time + h)
    for k in range(time.size):
        turn = pin.log3(after.rotation[k] @ before.rotation[k].T) / (2 * h)
        # Central differences: h² truncation and eps/h round-off, both about 1e-10 times the rates here.
        np.testing.assert_allclose(turn, here.twist[k, 3:], atol=1e-7)
        np.testing.assert_allclose(
            (after.position[k] - before.position[k]) / (2 * h), here.twist[k, :3], atol=1e-7
        )
        np.testing.assert_allclose(
            (after.twist[k] - before.twist[k]) / (2 * h), here.acceleration[k], atol=1e-5
        )


def test_chirp() -> None:
    home = pin.SE3(np.eye(3), np.array([0.0, 0.0, 1.0]))

    def motion(time) -> PlatformSamples:
        return chirp_motion(
            time,
            home=home,
            direction=(1, 0, 1),
            amplitude=0.01,
            start_frequency=1,
            end_frequency=4,
            duration=3.0,
        )

    check_derivatives(motion, np.linspace(0.1, 2.9, 13))
    crossings = np.diff(np.sign(motion(np.linspace(0, 3, 3001)).position[1:, 0])) != 0
    # Mean frequency 2.5 Hz over 3 s: 15 half periods.
    assert np.count_nonzero(crossings) in (14, 15)


def test_minimum_jerk(rng: np.random.Generator) -> None:
    start, end = poses(rng, 2)

    def motion(time) -> PlatformSamples:
        return minimum_jerk_motion(time, start=start, end=end, duration=2.0)

    check_derivatives(motion, np.linspace(0.1, 1.9, 7))
    ends = motion(np.array([0.0, 2.0]))
    assert not ends.twist.any() and not ends.acceleration[0].any()
    np.testing.assert_allclose(ends.acceleration[1], 0, atol=1e-12)
    np.testing.assert_allclose(ends.position[1], end.translation, atol=1e-15)
    np.testing.assert_allclose(ends.rotation[1], end.rotation, atol=1e-14)


def test_spline_goes_through_its_poses(rng: np.random.Generator) -> None:
    knots = np.array([0.0, 0.7, 1.5, 2.0])
    through = poses(rng, 4)

    def motion(time) -> PlatformSamples:
        return spline_motion(time, knots=knots, poses=through)

    check_derivatives(motion, np.array([0.2, 0.5, 0.9, 1.2, 1.7, 1.9]))
    at = motion(knots)
    for k, pose in enumerate(through):
        np.testing.assert_allclose(at.position[k], pose.translation, atol=1e-14)
        np.testing.assert_allclose(at.rotation[k], pose.rotation, atol=1e-13)
    np.testing.assert_allclose(at.twist[[0, -1]], 0, atol=1e-12)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda p: spline_motion([0.0], knots=[0.0, 0.0], poses=p), "rising instants"),
        (lambda p: spline_motion([0.0], knots=[0.0, 1.0, 2.0], poses=p), "3 knots and 2 poses"),
        (lambda p: spline_motion([5.0], knots=[0.0, 1.0], poses=p), "within the knots"),
        (
            lambda p: minimum_jerk_motion([3.0], start=p[0], end=p[1], duration=2.0),
            "within 0 and the duration",
        ),
        (
            lambda p: chirp_motion([0.0], home=p[0], direction=(0, 0, 0), duration=1.0),
            "direction must not be zero",
        ),
        (lambda p: chirp_motion([0.0], home=p[0], duration=-1.0), "duration"),
    ],
)
def test_bad_profiles_are_named(rng: np.random.Generator, call, words) -> None:
    with pytest.raises(InputError, match=words):
        call(poses(rng, 2))
