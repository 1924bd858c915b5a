"""All configurations of the planar arm (S3.1): counted, checked, bounded."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, SingularityError

LENGTHS = np.array([0.5, 0.4, 0.2])


def _wrapped(difference: np.ndarray) -> np.ndarray:
    return np.abs((difference + np.pi) % (2 * np.pi) - np.pi)


def test_every_branch_reaches_and_no_other_exists(rng: np.random.Generator) -> None:
    # 10 000 random poses: every configuration puts the hand there, and the one that made the pose is among them.
    worst_pose = worst_angles = 0.0
    for drawn in rng.uniform(-np.pi, np.pi, (10_000, 3)):
        position, angle = stp.arms.planar_arm_pose(LENGTHS, drawn)
        found = stp.planar_arm_configurations(LENGTHS, position, angle)
        assert found.shape == (2, 3)
        assert (np.abs(found) <= np.pi).all()
        assert found[0, 1] > 0 > found[1, 1]
        there, direction = stp.arms.planar_arm_pose(LENGTHS, found)
        worst_pose = max(worst_pose, np.abs(there - position).max(), _wrapped(direction - angle).max())
        worst_angles = max(worst_angles, _wrapped(found - drawn).max(axis=1).min())
    assert worst_pose < 1e-14
    # Near the edges of the reach the angles are as uncertain as the root of the wrist's round-off.
    assert worst_angles < 1e-9


def test_forward_kinematics_is_the_robots(rng: np.random.Generator) -> None:
    arm = stp.load("arm_3r_planar")
    for q in rng.uniform(-np.pi, np.pi, (50, 3)):
        pose = stp.platform_pose(arm, q)
        position, angle = stp.arms.planar_arm_pose(LENGTHS, q)
        np.testing.assert_allclose(pose.translation, [*position, 0.0], rtol=0, atol=1e-15)
        np.testing.assert_allclose(pose.rotation, pin.exp3(np.array([0, 0, angle])), rtol=0, atol=1e-14)
        # Newton's method on the same robot finds one of the branches.
        closure = stp.inverse_kinematics(arm, pose, q_guess=q + 0.01)
        branches = stp.planar_arm_configurations(LENGTHS, position, angle)
        assert _wrapped(branches - closure.q).max(axis=1).min() < 1e-9


@pytest.mark.parametrize(
    ("lengths", "position", "angle", "reach", "n"),
    [
        ((0.5, 0.4, 0.2), (0.6, 0.3), 0.4, "regular", 2),
        ((0.5, 0.4, 0.2), (1.1, 0.0), 0.0, "stretched", 1),
        ((0.5, 0.4, 0.2), (0.0, -0.9), np.pi, "too far", 0),
        ((0.5, 0.4, 0.2), (0.3, 0.0), 0.0, "folded", 1),
        ((0.4, 0.5, 0.2), (0.3, 0.0), 0.0, "folded", 1),
        ((0.5, 0.4, 0.2), (0.2, 0.05), 0.0, "too near", 0),
        ((0.5, 0.5, 0.2), (0.0, 0.2), np.pi / 2, "positive-dimensional", 1),
    ],
)
def test_edges_of_the_reach(lengths, position, angle: float, reach: str, n: int) -> None:
    branches = stp.arms.planar_arm_branches(lengths, position, angle)
    assert (str(branches.reach), len(branches.configurations)) == (reach, n)
    assert (branches.excess > 0) == (n == 0)
    assert branches.elbow.tolist() == {2: [1, -1], 1: [0], 0: []}[n]
    there, direction = stp.arms.planar_arm_pose(lengths, branches.configurations)
    if n:
        np.testing.assert_allclose(there, [position] * n, rtol=0, atol=5e-15)
        assert _wrapped(direction - angle).max() < 5e-15


def test_the_excess_is_the_distance_to_the_reach() -> None:
    assert stp.arms.planar_arm_branches(LENGTHS, [1.35, 0.0], 0.0).excess == pytest.approx(0.25)
    assert stp.arms.planar_arm_branches(LENGTHS, [0.23, 0.0], 0.0).excess == pytest.approx(0.07)


def test_branches_are_counted_right_next_to_the_edge() -> None:
    # Elbows that nearly coincide are still two: θ2 from 1e-2 down to 1e-6.
    for bend in 10.0 ** np.arange(-2, -7, -1):
        for second in (bend, np.pi - bend):
            q = np.array([0.3, second, -0.4])
            position, angle = stp.arms.planar_arm_pose(LENGTHS, q)
            found = stp.planar_arm_configurations(LENGTHS, position, angle)
            assert found.shape == (2, 3)
            # Round-off of the wrist, 1e-16, over the bend.
            assert _wrapped(found[0] - q).max() < 1e-15 / bend


def test_links_of_very_different_length(rng: np.random.Generator) -> None:
    lengths = np.array([1.0, 1e-4, 0.2])
    for q in rng.uniform(0.05, np.pi - 0.05, (100, 3)):
        position, angle = stp.arms.planar_arm_pose(lengths, q)
        found = stp.planar_arm_configurations(lengths, position, angle)
        there, _ = stp.arms.planar_arm_pose(lengths, found)
        np.testing.assert_allclose(there, [position] * 2, rtol=0, atol=1e-15)


def test_any_first_angle_is_an_error_that_says_so() -> None:
    with pytest.raises(SingularityError, match="any first angle will do") as caught:
        stp.planar_arm_configurations([0.5, 0.5, 0.2], [0.2, 0.0], 0.0)
    # Along the direction the hand does not move.
    q = stp.arms.planar_arm_branches([0.5, 0.5, 0.2], [0.2, 0.0], 0.0).configurations[0]
    for step in (0.1, 2.0):
        position, angle = stp.arms.planar_arm_pose([0.5, 0.5, 0.2], q + step * caught.value.direction)
        np.testing.assert_allclose(position, [0.2, 0.0], rtol=0, atol=1e-15)
        assert _wrapped(angle) < 1e-15


def test_limits_leave_out_and_let_full_turns_in() -> None:
    pose = ([0.5, 0.6], np.pi / 2)
    both = stp.planar_arm_configurations(LENGTHS, *pose)
    right = stp.planar_arm_configurations(LENGTHS, *pose, limits=[[-3, 3], [0, 3], [-3, 3]])
    np.testing.assert_array_equal(right, both[:1])
    assert stp.planar_arm_configurations(LENGTHS, *pose, limits=[[-3, 3], [0, 1], [-3, 3]]).shape == (0, 3)
    wide = stp.planar_arm_configurations(LENGTHS, *pose, limits=[[-3, 3], [0, 3], [-7, 7]])
    assert wide.shape == (3, 3)
    np.testing.assert_allclose(np.sort(wide[:, 2] - both[0, 2]), [-2 * np.pi, 0, 2 * np.pi], atol=1e-15)
    # A limit that is exactly met counts as met.
    exact = stp.planar_arm_configurations(LENGTHS, *pose, limits=np.stack([both[1], both[1]], axis=1))
    np.testing.assert_allclose(exact, both[1:], rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("arguments", "limits", "words"),
    [
        (([1, 1], [0, 0], 0.0), None, "lengths must have shape"),
        (([1, 0, 1], [0, 0], 0.0), None, "lengths must be above zero"),
        (([1, 1, 1], [0, 0, 0], 0.0), None, "position must have shape"),
        (([1, 1, 1], [0, np.nan], 0.0), None, "position must be finite"),
        (([1, 1, 1], [0, 0], "up"), None, "angle must be"),
        (([1, 1, 1], [0, 0], 0.0), [[0, 1]], "limits must have shape"),
        (([1, 1, 1], [0, 0], 0.0), [[0, 1], [1, 0], [0, 1]], "limits must be \\(least, greatest\\)"),
    ],
)
def test_bad_input_is_named(arguments, limits, words: str) -> None:
    with pytest.raises(InputError, match=words):
        stp.planar_arm_configurations(*arguments, limits=limits)
