"""Velocities and Jacobians of the spatial arm (S3.2, S3.3): closed form and Pinocchio; printed mistakes."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError

LENGTHS = np.array([0.3, 0.5, 0.4])
FRAMES = {3: "link3", 4: "platform"}


@pytest.fixture
def arm() -> stp.ClosedChain:
    return stp.load("arm_3r_spatial")


def frame_jacobian(arm: stp.ClosedChain, q, frame: int, axes: str) -> np.ndarray:
    local = {"base": pin.ReferenceFrame.LOCAL_WORLD_ALIGNED, "frame": pin.ReferenceFrame.LOCAL}[axes]
    return pin.computeFrameJacobian(
        arm.model, pin.Data(arm.model), q, arm.model.getFrameId(FRAMES[frame]), local
    )


@pytest.mark.parametrize("frame", [3, 4])
@pytest.mark.parametrize("axes", ["base", "frame"])
def test_jacobians_are_pinocchios(
    arm: stp.ClosedChain, frame: int, axes: str, rng: np.random.Generator
) -> None:
    q = rng.uniform(-np.pi, np.pi, (50, 3))
    ours = stp.arms.spatial_arm_jacobian(LENGTHS, q, frame=frame, axes=axes)
    theirs = np.array([frame_jacobian(arm, x, frame, axes) for x in q])
    assert np.abs(ours - theirs).max() <= 1e-12


def test_velocities_propagate_outwards(arm: stp.ClosedChain, rng: np.random.Generator) -> None:
    q, rates = rng.uniform(-np.pi, np.pi, (2, 30, 3))
    velocities = stp.arms.spatial_arm_velocities(LENGTHS, q, rates)
    data = pin.Data(arm.model)
    names = ("link1", "link2", "link3", "platform")
    for x, dx, omega, velocity in zip(q, rates, velocities.angular, velocities.linear, strict=True):
        pin.forwardKinematics(arm.model, data, x, dx)
        for i, name in enumerate(names):
            twist = pin.getFrameVelocity(
                arm.model, data, arm.model.getFrameId(name), pin.ReferenceFrame.LOCAL
            )
            assert np.abs(twist.linear - velocity[i]).max() <= 1e-12
            assert np.abs(twist.angular - omega[i]).max() <= 1e-12


def test_the_last_frames_velocity_is_the_jacobian_times_the_rates(rng: np.random.Generator) -> None:
    q, rates = rng.normal(size=(2, 4, 5, 3))
    velocities = stp.arms.spatial_arm_velocities(LENGTHS, q, rates)
    assert velocities.angular.shape == (4, 5, 4, 3)
    for frame in FRAMES:
        twist = np.einsum(
            "...ij,...j->...i", stp.arms.spatial_arm_jacobian(LENGTHS, q, frame=frame, axes="frame"), rates
        )
        np.testing.assert_allclose(twist[..., :3], velocities.linear[..., frame - 1, :], rtol=0, atol=1e-13)
        np.testing.assert_allclose(twist[..., 3:], velocities.angular[..., frame - 1, :], rtol=0, atol=1e-13)


def _printed_jacobian_4(q) -> np.ndarray:
    """S3.2 as printed: (2, 2) without L3; (3, 1) with its bracket misplaced, taken as -L1 + L2 c2 + L3 c23."""
    (l1, l2, l3), (_, q2, q3) = LENGTHS, q
    printed = np.array([[0, l2 * np.sin(q3), 0], [0, l2 * np.cos(q3), l3], [0, 0, 0]])
    printed[2, 0] = -l1 + l2 * np.cos(q2) + l3 * np.cos(q2 + q3)
    return printed


def test_printed_mistakes_are_mistakes(arm: stp.ClosedChain) -> None:
    # Angles at which no printed form is right by chance.
    q, rates = np.array([0.4, 0.3, 0.6]), np.array([0.7, -0.5, 0.9])
    (l1, l2, l3), (q1, q2, q3) = LENGTHS, q
    data = pin.Data(arm.model)
    pin.forwardKinematics(arm.model, data, q, rates)
    twist = pin.getFrameVelocity(arm.model, data, arm.model.getFrameId("link3"), pin.ReferenceFrame.LOCAL)

    # S3.2, ³ω₃: s23, printed as s2 s3 + c2 c3, which is cos(θ2 - θ3).
    s23, c23 = np.sin(q2 + q3), np.cos(q2 + q3)
    right = [s23 * rates[0], c23 * rates[0], rates[1] + rates[2]]
    np.testing.assert_allclose(twist.angular, right, rtol=0, atol=1e-14)
    printed = np.sin(q2) * np.sin(q3) + np.cos(q2) * np.cos(q3)
    assert abs(printed * rates[0] - twist.angular[0]) > 1e-2

    # S3.2, ⁴J: (2, 2) is L2 c3 + L3, (3, 1) is -(L1 + L2 c2 + L3 c23); the other seven elements are as printed.
    truth = frame_jacobian(arm, q, 4, "frame")[:3]
    wrong = np.abs(_printed_jacobian_4(q) - truth) > 1e-12
    assert np.argwhere(wrong).tolist() == [[1, 1], [2, 0]]
    assert truth[1, 1] == pytest.approx(l2 * np.cos(q3) + l3, abs=1e-14)
    assert truth[2, 0] == pytest.approx(-(l1 + l2 * np.cos(q2) + l3 * c23), abs=1e-14)

    # S3.3, J of {3} in the base: (1, 2) is -L2 s2 c1, printed with c2 for s2.
    third = frame_jacobian(arm, q, 3, "base")[:3]
    assert third[0, 1] == pytest.approx(-l2 * np.sin(q2) * np.cos(q1), abs=1e-14)
    assert abs(third[0, 1] + l2 * np.cos(q2) * np.cos(q1)) > 1e-2


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="lengths must be above zero"):
        stp.arms.spatial_arm_jacobian([1, -1, 1], [0, 0, 0])
    with pytest.raises(InputError, match="frame must be one of"):
        stp.arms.spatial_arm_jacobian([1, 1, 1], [0, 0, 0], frame=2)
    with pytest.raises(InputError, match="axes must be"):
        stp.arms.spatial_arm_jacobian([1, 1, 1], [0, 0, 0], axes="world")
    with pytest.raises(InputError, match="q must have shape"):
        stp.arms.spatial_arm_velocities([1, 1, 1], [0, 0], [0, 0, 0])
    with pytest.raises(InputError, match="batch shapes"):
        stp.arms.spatial_arm_velocities([1, 1, 1], np.zeros((2, 3)), np.zeros((3, 3)))
