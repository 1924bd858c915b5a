"""Closed forms of the hexapod against the printed figures S0.1, S0.2 and against differences."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, SingularityError
from stewart_pin.geometry.rotations import rotation_from_rpy, rpy_from_rotation, skew

# S0.2: rows of the Jacobian at (0, 0, 0.8) m, R = I; force columns, then moment columns in mm.
# fmt: off
REPORT_JACOBIAN = np.array([
    [-0.2359,  0.3083, 0.9216, -304.9414,  333.4953, -189.6232],
    [ 0.2829,  0.3160, 0.9056, -299.0539, -330.0863,  208.5864],
    [-0.1554, -0.3581, 0.9207, -136.2052, -425.4958, -188.5003],
    [-0.4151,  0.0870, 0.9056,  435.3862,  -93.9452,  208.5840],
    [ 0.3850,  0.0501, 0.9216,  441.2806,   97.3387, -189.6246],
    [ 0.1322, -0.4030, 0.9056, -136.3326,  424.0314,  208.5861],
])
# fmt: on


def test_jacobian_equals_the_printed_one(report_cad: stp.Hexapod) -> None:
    jacobian = stp.leg_jacobian(report_cad, [0.0, 0.0, 0.8], np.eye(3))
    jacobian[:, 3:] *= 1e3
    # Half a unit of the last printed digit.
    assert np.abs(jacobian - REPORT_JACOBIAN).max() <= 0.5e-4 * 1.001


def test_jacobian_is_the_derivative_of_the_lengths(report_cad: stp.Hexapod, rng: np.random.Generator) -> None:
    h = 1e-6
    for _ in range(20):
        position = np.array([0.0, 0.0, 1.0]) + rng.uniform(-0.2, 0.2, 3)
        rotation = rotation_from_rpy(*rng.uniform(-0.3, 0.3, 3))
        numeric = np.empty((6, 6))
        for k in range(3):
            e = h * np.eye(3)[k]
            numeric[:, k] = stp.leg_lengths(report_cad, position + e, rotation) - stp.leg_lengths(
                report_cad, position - e, rotation
            )
            # Turn about a world axis: R -> exp(e) R, second-order accurate.
            plus, minus = (rotation_from_rpy(*(s * e)) @ rotation for s in (1.0, -1.0))
            numeric[:, 3 + k] = stp.leg_lengths(report_cad, position, plus) - stp.leg_lengths(
                report_cad, position, minus
            )
        # Central differences: h² truncation and eps/h round-off, both near 1e-10.
        assert np.abs(stp.leg_jacobian(report_cad, position, rotation) - numeric / (2 * h)).max() < 1e-9


def test_any_batch_shape(report_cad: stp.Hexapod, rng: np.random.Generator) -> None:
    position = rng.uniform(-0.1, 0.1, (2, 4, 3)) + [0, 0, 1]
    rotation = rotation_from_rpy(*rng.uniform(-0.2, 0.2, (3, 2, 4)))
    lengths = stp.leg_lengths(report_cad, position, rotation)
    jacobians = stp.leg_jacobian(report_cad, position, rotation)
    forces = stp.point_mass_forces(report_cad, position, rotation, np.ones((2, 4, 3)), mass=20.0)
    assert lengths.shape == (2, 4, 6) and jacobians.shape == (2, 4, 6, 6) and forces.shape == (2, 4, 6)
    one = stp.leg_lengths(report_cad, position[1, 2], rotation[1, 2])
    np.testing.assert_array_equal(lengths[1, 2], one)


def test_point_mass_forces_carry_the_weight(report_ideal: stp.Hexapod) -> None:
    forces = stp.point_mass_forces(report_ideal, [0.1, 0.0, 1.0], np.eye(3), [0.0, 0.0, 0.0], mass=20.0)
    wrench = stp.leg_jacobian(report_ideal, [0.1, 0.0, 1.0], np.eye(3)).T @ forces
    np.testing.assert_allclose(wrench, [0, 0, 20 * 9.81, 0, 0, 0], atol=1e-11)


def test_rotation_order_is_yaw_pitch_roll() -> None:
    # S0.1: the source's listing multiplies Rx Ry Rz instead; the two differ for combined angles.
    roll, pitch, yaw = 0.3, -0.2, 0.5
    rx, ry, rz = (rotation_from_rpy(*a) for a in ((roll, 0, 0), (0, pitch, 0), (0, 0, yaw)))
    rotation = rotation_from_rpy(roll, pitch, yaw)
    np.testing.assert_allclose(rotation, rz @ ry @ rx, atol=1e-15)
    assert np.abs(rotation - rx @ ry @ rz).max() > 0.1
    np.testing.assert_allclose(rpy_from_rotation(rotation), [roll, pitch, yaw], atol=1e-15)


def test_skew_is_the_cross_product(rng: np.random.Generator) -> None:
    a, b = rng.normal(size=(2, 5, 3))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", skew(a), b), np.cross(a, b), atol=1e-15)


@pytest.mark.parametrize(
    ("position", "rotation", "words"),
    [
        ([0, 0], np.eye(3), "position must have shape"),
        ([0, 0, np.nan], np.eye(3), "position must be finite"),
        ([0, 0, 1], np.eye(2), "rotation must have shape"),
        ([0, 0, 1], 2 * np.eye(3), "differs from the identity"),
        ([0, 0, 1], np.diag([1.0, 1.0, -1.0]), "reflection"),
        (np.zeros((2, 3)), np.tile(np.eye(3), (3, 1, 1)), "batch shapes"),
        ("up", np.eye(3), "real numbers"),
    ],
)
def test_bad_poses_are_named(report_cad: stp.Hexapod, position, rotation, words) -> None:
    with pytest.raises(InputError, match=words):
        stp.leg_lengths(report_cad, position, rotation)


def test_singular_pose_gives_the_singular_value(report_ideal: stp.Hexapod) -> None:
    yaw = rotation_from_rpy(0, 0, np.pi / 2)
    with pytest.raises(SingularityError, match="smallest singular value") as caught:
        stp.point_mass_forces(report_ideal, [0, 0, 1.0], yaw, [0, 0, 0], mass=1.0)
    assert caught.value.smallest_singular_value < 1e-12


def test_bad_geometry_is_named() -> None:
    with pytest.raises(InputError, match="platform_points must have shape"):
        stp.Hexapod(np.zeros((6, 3)), np.zeros((5, 3)))
