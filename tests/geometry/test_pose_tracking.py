"""Tracking: back to the same pose around a loop, a named stop at a fold, never a change of assembly mode."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import stewart_pin as stp
from stewart_pin.errors import InputError
from stewart_pin.geometry.rotations import rotation_from_rpy


def _determinants(hexapod: stp.Hexapod, tracked: stp.hexapods.TrackedPose) -> np.ndarray:
    return np.linalg.det(stp.leg_jacobian(hexapod, tracked.position, tracked.rotation))


def test_a_regular_path_is_followed_to_its_end(report_cad: stp.Hexapod) -> None:
    t = np.linspace(0.0, 2.0 * np.pi, 15)
    position = np.column_stack([0.2 * np.sin(t), 0.15 * np.cos(t), 2.2 + 0.2 * np.sin(2 * t)])
    rotation = rotation_from_rpy(0.2 * np.sin(t), 0.2 * np.sin(2 * t), 0.3 * np.sin(t))
    lengths = stp.leg_lengths(report_cad, position, rotation)
    tracked = stp.hexapods.track_pose(report_cad, lengths, start=(position[0], rotation[0]))
    assert tracked.event == "finished" and tracked.success
    # Round-off times a condition number near 1e2.
    np.testing.assert_allclose(tracked.position, position, atol=1e-12)
    np.testing.assert_allclose(tracked.rotation, rotation, atol=1e-12)
    np.testing.assert_allclose(tracked.last_lengths, lengths[-1], atol=1e-13)


def test_a_fold_stops_the_path_with_its_name(report_ideal: stp.Hexapod) -> None:
    # The yaw of this robot is singular at a quarter turn; the lengths go on as if it were not.
    yaw = np.linspace(0.0, np.radians(120.0), 25)
    rotation = rotation_from_rpy(0.0, 0.0, yaw)
    lengths = stp.leg_lengths(report_ideal, [0.0, 0.0, 1.0], rotation)
    tracked = stp.hexapods.track_pose(report_ideal, lengths, start=([0.0, 0.0, 1.0], np.eye(3)))
    assert tracked.event == "fold" and not tracked.success
    assert len(tracked.position) == 18  # samples of 5°: 0 to 85°
    reached = np.arctan2(tracked.last_rotation[1, 0], tracked.last_rotation[0, 0])
    assert np.radians(85.0) <= reached < np.radians(90.0)
    assert tracked.smallest_singular_value < 0.05
    assert len(set(np.sign(_determinants(report_ideal, tracked)))) == 1


def test_no_random_path_changes_its_assembly_mode(
    report_ideal: stp.Hexapod, rng: np.random.Generator
) -> None:
    events = []
    home = (np.array([0.0, 0.0, 1.0]), np.eye(3))
    for _ in range(20):
        lengths = stp.leg_lengths(report_ideal, *home)
        ends = lengths, lengths * rng.uniform(0.75, 1.25, 6)
        tracked = stp.hexapods.track_pose(report_ideal, np.linspace(*ends, 6), start=home)
        events.append(tracked.event)
        assert len(set(np.sign(_determinants(report_ideal, tracked)))) == 1
        # And back again: only the same assembly mode returns to the home pose.
        way_back = np.linspace(tracked.last_lengths, ends[0], 6)
        back = stp.hexapods.track_pose(
            report_ideal, way_back, start=(tracked.last_position, tracked.last_rotation)
        )
        assert back.success
        np.testing.assert_allclose(back.position[-1], home[0], atol=1e-9)
        np.testing.assert_allclose(back.rotation[-1], home[1], atol=1e-9)
    assert {"finished", "fold"} == set(events)


def test_coarse_paths_across_singularities_never_flip(report_ideal: stp.Hexapod) -> None:
    # Eight samples on the way between far poses, many of them of another assembly mode. This seed holds a
    # path on which the same tracker without its guards comes out on the other side.
    rng, events = np.random.default_rng(1), []
    for _ in range(60):
        begin = np.array([0.0, 0.0, 1.0]) + rng.uniform(-0.3, 0.3, 3), rng.uniform(-0.6, 0.6, 3)
        end = np.array([0.0, 0.0, 1.0]) + rng.uniform(-0.6, 0.6, 3), rng.uniform(-2, 2, 3)
        turns = [rotation_from_rpy(*angles) for angles in (begin[1], end[1])]
        t = np.linspace(0.0, 1.0, 8)
        rotation = Slerp([0, 1], Rotation.from_matrix(turns))(t).as_matrix()
        lengths = stp.leg_lengths(report_ideal, begin[0] + t[:, None] * (end[0] - begin[0]), rotation)
        tracked = stp.hexapods.track_pose(report_ideal, lengths, start=(begin[0], turns[0]))
        events.append(tracked.event)
        assert len(set(np.sign(_determinants(report_ideal, tracked)))) == 1
    assert set(events) == {"finished", "fold"}


def test_bad_paths_are_named(report_cad: stp.Hexapod) -> None:
    start = ([0.0, 0.0, 2.0], np.eye(3))
    with pytest.raises(InputError, match="at least one sample"):
        stp.hexapods.track_pose(report_cad, np.empty((0, 6)), start=start)
    with pytest.raises(InputError, match="lengths must have shape"):
        stp.hexapods.track_pose(report_cad, np.ones(6), start=start)
