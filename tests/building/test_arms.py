"""Serial arms are chains without loops: loaded, judged and computed by the same verbs."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp

ARMS = ("arm_7r", "arm_3r_planar", "arm_3r_spatial")


@pytest.fixture(params=ARMS)
def arm(request: pytest.FixtureRequest) -> stp.ClosedChain:
    return stp.load(request.param)


def test_an_arm_is_a_chain_without_loops(arm: stp.ClosedChain) -> None:
    report = stp.mobility(arm)
    assert arm.loops == ()
    assert (arm.nc, arm.nu, arm.platform) == (0, arm.nv, "platform")
    assert (report.dof, report.idle, report.redundant_rows, report.motors_sufficient) == (arm.nv, (), 0, True)
    assert not arm.q_home.any()


def test_no_loops_give_empty_gaps(arm: stp.ClosedChain, rng: np.random.Generator) -> None:
    q, v = rng.normal(size=(2, arm.nv))
    assert stp.loop_gap(arm, q).shape == stp.loop_bias(arm, q, v).shape == (0,)
    assert stp.loop_jacobian(arm, q).shape == (0, arm.nv)
    closure = stp.close_loops(arm, q)
    assert closure.success
    np.testing.assert_array_equal(closure.q, q)
    assert len(stp.loops.constraint_models(arm)) == 0


def test_dynamics_of_an_arm(arm: stp.ClosedChain, rng: np.random.Generator) -> None:
    data = pin.Data(arm.model)
    for _ in range(5):
        q, v, tau = rng.normal(size=(3, arm.nv))
        reference = pin.aba(arm.model, data, q, v, tau)
        size = np.abs(reference).max()
        for method in ("projection", "constraint_dynamics"):
            motion = stp.forward_dynamics(arm, q, v, tau, method=method)
            assert np.abs(motion.a - reference).max() <= 1e-11 * size
            assert motion.lambda_c.shape == (0,)
        for method in ("pinocchio", "constraint_matrix"):
            effort = stp.inverse_dynamics(arm, q, v, reference, method=method)
            # Round-off of the weight, some hundred N m, through a handful of operations.
            np.testing.assert_allclose(effort.tau_motor, tau, rtol=0, atol=1e-11)
            assert effort.unique
            assert effort.reactions_unique


def test_kinematics_of_an_arm(arm: stp.ClosedChain, rng: np.random.Generator) -> None:
    data = pin.Data(arm.model)
    q, v, a = rng.uniform(0.2, 1.0, (3, arm.nv))
    pose = stp.platform_pose(arm, q)
    back = stp.inverse_kinematics(arm, pose, q_guess=q + 0.02)
    assert pose.isApprox(stp.platform_pose(arm, back.q), 1e-12)
    np.testing.assert_allclose(stp.forward_kinematics(arm, q).q, q, rtol=0, atol=1e-13)
    jacobian = pin.computeFrameJacobian(
        arm.model, data, q, arm.platform_id, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    )
    rates = stp.motor_jacobian(arm, q) @ jacobian
    # More than six joints: the least-norm rates, a projection; up to six: the rates themselves.
    np.testing.assert_allclose(rates @ rates, rates, rtol=0, atol=1e-12)
    if arm.nv <= 6:
        np.testing.assert_allclose(rates, np.eye(arm.nv), rtol=0, atol=1e-12)
        pin.forwardKinematics(arm.model, data, q, v, a)
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        spin = pin.getFrameClassicalAcceleration(arm.model, data, arm.platform_id, axes).vector
        state = stp.platform_motion(arm, pose, jacobian @ v, spin, q_guess=q)
        np.testing.assert_allclose(state.v, v, rtol=0, atol=1e-11)
        np.testing.assert_allclose(state.a, a, rtol=0, atol=1e-10)


def test_the_maximal_coordinates_of_the_seven_joint_arm() -> None:
    # Ground and seven bodies; 6 ground columns, 5 per joint, 1 per motor.
    arm = stp.load("arm_7r")
    system = stp.constraint_matrix_system(arm, arm.q_home, np.zeros(7), np.zeros(7))
    assert len(system.bodies) == 8
    assert system.C.shape == (48, 6 + 7 * 5 + 7)


def test_the_seven_joint_arm_is_the_sources() -> None:
    # S2: the joint matrices as printed, child axes in the parent.
    arm = stp.load("arm_7r")
    data, q = pin.Data(arm.model), np.linspace(-1.2, 1.5, 7)
    pin.forwardKinematics(arm.model, data, q)
    for i, angle in enumerate(q, start=1):
        c, s = np.cos(angle), np.sin(angle)
        if i == 1:
            printed = [[c, -s, 0], [s, c, 0], [0, 0, 1]]
        elif i in (2, 3, 5, 7):
            printed = [[c, -s, 0], [0, 0, 1], [-s, -c, 0]]
        else:
            printed = [[c, -s, 0], [0, 0, -1], [s, c, 0]]
        np.testing.assert_allclose(data.liMi[i].rotation, printed, rtol=0, atol=1e-15)
    masses = [inertia.mass for inertia in arm.model.inertias[1:]]
    assert masses == [5, 18, 10, 12, 8.6, 16, 10]


def test_arms_survive_writing(arm: stp.ClosedChain, tmp_path) -> None:
    stp.write_urdf(arm, tmp_path / "again.urdf")
    again = stp.load(tmp_path / "again.urdf")
    assert again.model == arm.model
    assert again.motors == arm.motors
