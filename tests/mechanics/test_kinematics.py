"""Pose to configuration and back, motions of the whole chain, and what is out of reach."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import stewart_pin as stp
from stewart_pin.errors import ClosureError, InputError, UnreachableError
from stewart_pin.state import paths
from tests.closed_states import NAMES, along, close, derivative, random_configuration, random_motion, robot
from tests.mechanisms import arm, four_bar

HEXAPODS = ("stewart", "stewart_sps", "stewart_cad", "stewart_s1")


def random_pose(chain: stp.ClosedChain, rng: np.random.Generator) -> pin.SE3:
    """Draw a pose within 0.2 m (larger robots: in proportion) and 20° of home."""
    home, size = stp.platform_pose(chain, chain.q_home), max(1.0, chain.length_scale)
    turn = Rotation.from_euler("xyz", rng.uniform(-20, 20, 3), degrees=True).as_matrix()
    return pin.SE3(turn @ home.rotation, home.translation + 0.2 * size * rng.uniform(-1, 1, 3))


@pytest.mark.parametrize("name", HEXAPODS)
def test_motors_of_a_pose_are_the_leg_lengths(name: str, rng: np.random.Generator) -> None:
    chain = robot(name)
    hexapod = stp.Hexapod.from_chain(chain)
    for _ in range(20):
        pose = random_pose(chain, rng)
        q = stp.inverse_kinematics(chain, pose, limits=False).q
        lengths = stp.leg_lengths(hexapod, pose.translation, pose.rotation)
        close(stp.motor_positions(chain, q), lengths, 1e-13)
        jacobian = stp.leg_jacobian(hexapod, pose.translation, pose.rotation)
        close(stp.motor_jacobian(chain, q), jacobian, 1e-12)


@pytest.mark.parametrize("name", HEXAPODS)
def test_pose_of_the_motors_of_a_pose(name: str, rng: np.random.Generator) -> None:
    """Undo 50 poses on each of four robots: 200."""
    chain = robot(name)
    for _ in range(50):
        pose = random_pose(chain, rng)
        there = stp.inverse_kinematics(chain, pose, limits=False)
        assert there.success and there.gap <= 1e-12 * max(1.0, chain.length_scale)
        back = stp.forward_kinematics(chain, stp.motor_positions(chain, there.q), limits=False)
        apart = pin.log6(pose.actInv(stp.platform_pose(chain, back.q))).vector
        # Round-off times the condition number of the legs, below 100 here.
        assert np.abs(apart).max() <= 1e-11 * max(1.0, chain.length_scale)


@pytest.mark.parametrize("name", HEXAPODS)
def test_rates_and_accelerations_of_the_legs(name: str, rng: np.random.Generator) -> None:
    chain = robot(name)
    hexapod = stp.Hexapod.from_chain(chain)
    pose, twist, acceleration = random_pose(chain, rng), rng.normal(size=6), rng.normal(size=6)
    state = stp.platform_motion(chain, pose, twist, acceleration, limits=False)
    at = hexapod, pose.translation, pose.rotation, twist
    close(state.v[chain.motor_index], stp.hexapods.leg_rates(*at), 1e-12)
    close(state.a[chain.motor_index], stp.hexapods.leg_accelerations(*at, acceleration), 1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_motion_follows_a_path(name: str, rng: np.random.Generator) -> None:
    """Differentiate the configurations along a path of the platform: they are v and a, whatever formulas say."""
    chain = robot(name)
    q0 = random_configuration(chain, rng, 0.1)
    v0, a0 = random_motion(chain, rng, q0)
    data = pin.Data(chain.model)
    pin.forwardKinematics(chain.model, data, q0, v0, a0)
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    pose = stp.platform_pose(chain, q0)
    twist = pin.getFrameVelocity(chain.model, data, chain.platform_id, axes).vector
    acceleration = pin.getFrameClassicalAcceleration(chain.model, data, chain.platform_id, axes).vector
    state = stp.platform_motion(chain, pose, twist, acceleration, q_guess=q0, limits=False)

    curve, h = along(chain, state.q, state.v, state.a), 1e-3
    # The platform's own motion along the curve: to second order, it is the one that was asked for.
    data = pin.Data(chain.model)
    pin.forwardKinematics(chain.model, data, state.q, state.v, state.a)
    done = pin.getFrameVelocity(chain.model, data, chain.platform_id, axes).vector
    close(done, twist, 1e-9)
    done = pin.getFrameClassicalAcceleration(chain.model, data, chain.platform_id, axes).vector
    close(done, acceleration, 1e-9)
    # And the loops stay closed to second order: what is left is of third order, h³ times the jerk.
    for t in (-h, h):
        assert np.abs(stp.loop_gap(chain, curve(t))).max(initial=0.0) <= 100 * h**3 * chain.length_scale


def pose_on_path(t: float, home: pin.SE3) -> pin.SE3:
    """Locate a platform that sways and turns."""
    turn = pin.exp3(np.array([0.2 * np.sin(t), 0.15 * np.cos(2 * t), 0.25 * np.sin(1.5 * t)]))
    move = np.array([0.1 * np.sin(2 * t), 0.12 * np.cos(t), 0.08 * np.sin(3 * t)])
    return pin.SE3(turn @ home.rotation, home.translation + move)


@pytest.mark.parametrize("name", ["stewart", "stewart_sps"])
def test_velocity_is_the_derivative_of_the_configuration(name: str) -> None:
    """Differences of poses give the twist, differences of configurations the velocity that must belong to it."""
    chain = robot(name)
    home, t, h = stp.platform_pose(chain, chain.q_home), 0.7, 1e-3
    poses = {k: pose_on_path(t + k * h, home) for k in (-2, -1, 0, 1, 2)}
    q = {k: stp.inverse_kinematics(chain, pose, limits=False).q for k, pose in poses.items()}

    def weighed(values: dict[int, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """First and second derivative by central differences of order 4."""
        first = (8 * (values[1] - values[-1]) - (values[2] - values[-2])) / (12 * h)
        second = (16 * (values[1] + values[-1]) - (values[2] + values[-2]) - 30 * values[0]) / (12 * h**2)
        return first, second

    linear, linear_rate = weighed({k: pose.translation for k, pose in poses.items()})
    # Of the rotation vector from the middle pose, rate and second rate at zero are ω and dω/dt.
    angular, angular_rate = weighed(
        {k: pin.log3(pose.rotation @ poses[0].rotation.T) for k, pose in poses.items()}
    )
    twist, acceleration = np.concatenate([linear, angular]), np.concatenate([linear_rate, angular_rate])
    state = stp.platform_motion(chain, poses[0], twist, acceleration, limits=False)
    v, a = weighed({k: pin.difference(chain.model, q[0], other) for k, other in q.items()})
    # Legs may spin as they like, which changes neither the angles before their spin nor their lengths.
    told = np.abs(state.freedom.idle).max(axis=1, initial=0.0) < 1e-9
    close(state.v[told], v[told], 1e-9)
    close(state.a[told], a[told], 1e-6)  # round-off 1e-14 / h²


def test_joint_limits_name_the_joints() -> None:
    chain = robot("stewart_cad")
    home = stp.platform_pose(chain, chain.q_home)
    pose = pin.SE3(home.rotation, home.translation + [0, 0, 1.0])
    with pytest.raises(UnreachableError, match=r"'leg1' at .*, allowed 2.20147 to 2.70147") as caught:
        stp.inverse_kinematics(chain, pose)
    assert set(caught.value.violations) == {f"leg{i}" for i in range(1, 7)}
    value, lower, upper = caught.value.violations["leg1"]
    assert (lower, upper) == (2.20147, 2.70147) and value > upper
    assert caught.value.residual <= 1e-12
    # The residual is at round-off all the same: it is the limits that refuse.
    closure = stp.inverse_kinematics(chain, pose, throw=False)
    assert not closure.success and closure.gap <= 1e-12
    free = stp.inverse_kinematics(chain, pose, limits=False)
    assert free.success
    np.testing.assert_array_equal(free.q, closure.q)
    with pytest.raises(UnreachableError):
        stp.platform_motion(chain, pose, np.zeros(6), np.zeros(6))
    assert stp.platform_motion(chain, pose, np.zeros(6), np.zeros(6), limits=False).q.shape == (chain.nq,)


def test_a_pose_the_chain_cannot_take() -> None:
    """A planar linkage asked to leave its plane by 0.3 m: the residual is what no joint can give."""
    chain = four_bar()
    pose = stp.platform_pose(chain, chain.q_home)
    lifted = pin.SE3(pose.rotation, pose.translation + [0, 0, 0.3])
    with pytest.raises(ClosureError, match=r"the pose .* cannot be met") as caught:
        stp.inverse_kinematics(chain, lifted)
    assert caught.value.residual == pytest.approx(0.3, abs=1e-6)
    closure = stp.inverse_kinematics(chain, lifted, throw=False)
    assert not closure.success and closure.gap == caught.value.residual
    for twist, acceleration, name in (
        ([0, 0, 1, 0, 0, 0], np.zeros(6), "twist"),
        (np.zeros(6), [0, 0, 1, 0, 0, 0], "acceleration"),
    ):
        with pytest.raises(ClosureError, match=f"cannot follow this {name}"):
            stp.platform_motion(chain, pose, twist, acceleration)


def test_motor_positions_out_of_reach() -> None:
    chain = robot("stewart")
    short = np.array([0.1, 3.0, 0.1, 3.0, 0.1, 3.0])
    with pytest.raises(ClosureError, match="the motor positions cannot be met") as caught:
        stp.forward_kinematics(chain, short)
    assert caught.value.residual > 1e-3
    assert not stp.forward_kinematics(chain, short, throw=False).success


def test_a_guess_that_cannot_be_closed_is_no_crash() -> None:
    """With throw=False nothing raises, also when the guess itself has no closed configuration near it."""
    chain = four_bar(lengths=(0.3, 0.8, 0.6), ground=0.9)
    guess = np.array([0.0, np.pi, 0.0])
    pose = stp.platform_pose(chain, chain.q_home)
    closure = stp.inverse_kinematics(chain, pose, q_guess=guess, throw=False, limits=False)
    assert isinstance(closure, stp.loops.Closure) and np.isfinite(closure.q).all()
    assert isinstance(stp.forward_kinematics(chain, [1.0], q_guess=guess, throw=False), stp.loops.Closure)


def test_far_poses_are_approached_in_stretches(monkeypatch: pytest.MonkeyPatch) -> None:
    """With so little contraction allowed that the direct way is refused, short stretches arrive at the same place."""
    chain = robot("stewart")
    home = stp.platform_pose(chain, chain.q_home)
    pose = pin.SE3(pin.exp3(np.array([0.2, -0.3, 0.4])) @ home.rotation, home.translation + [0.2, 0.1, 0.2])
    direct = stp.inverse_kinematics(chain, pose, limits=False)
    monkeypatch.setattr(paths, "CONTRACTION", 0.01)
    staged = stp.inverse_kinematics(chain, pose, limits=False)
    assert staged.success and staged.iterations > direct.iterations
    assert np.abs(pin.difference(chain.model, direct.q, staged.q)).max() <= 1e-11


def test_jacobian_of_the_pose_equations(rng: np.random.Generator) -> None:
    """The rows leave the derivative of the logarithm out, which is one where the error vanishes."""
    chain = robot("stewart")
    start = chain.at(chain.q_home)
    path = paths.pose_path(start, start.pose)
    v = rng.normal(size=chain.nv)
    curve = along(chain, chain.q_home, v)
    moved = derivative(lambda t: path.residual(chain.at(curve(t)), 1.0))
    # Differences of order 4 at h = 1e-3: 1e-11 of rates near one.
    close(path.rows(start) @ (v / chain.tangent_scale), moved, 1e-9)


def test_half_a_turn_is_no_special_case(rng: np.random.Generator) -> None:
    """The logarithm of half a turn is not unique, and its derivative large: no NaN comes of it."""
    chain = arm(rng, 6)
    here = stp.platform_pose(chain, chain.q_home)
    for axis in np.eye(3):
        pose = pin.SE3(pin.exp3(np.pi * axis) @ here.rotation, here.translation)
        closure = stp.inverse_kinematics(chain, pose, throw=False)
        assert np.isfinite(closure.q).all() and np.isfinite(closure.gap)


def test_a_pose_is_told_in_three_ways() -> None:
    chain = robot("stewart")
    pose = pin.SE3(pin.exp3(np.array([0.1, -0.05, 0.2])), np.array([0.03, -0.02, 1.0]))
    q = stp.inverse_kinematics(chain, pose).q
    for told in (pin.SE3ToXYZQUAT(pose), list(pin.SE3ToXYZQUAT(pose)), pose.homogeneous):
        np.testing.assert_allclose(stp.inverse_kinematics(chain, told).q, q, atol=1e-13)
        np.testing.assert_allclose(
            stp.platform_motion(chain, told, np.zeros(6), np.zeros(6)).q, q, atol=1e-13
        )


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda c: stp.inverse_kinematics(c, np.eye(3)), "pose must be .*, or a matrix .*shape .3, 3."),
        (
            lambda c: stp.inverse_kinematics(c, "up"),
            "pose must be a pinocchio.SE3, seven numbers .*, got str",
        ),
        (lambda c: stp.inverse_kinematics(c, np.diag([1.0, 1.0, -1.0, 1.0])), "a reflection"),
        (lambda c: stp.inverse_kinematics(c, [0, 0, 1, 0, 0, 0, 2]), "quaternion that is not of unit length"),
        (
            lambda c: stp.inverse_kinematics(c, pin.SE3(np.eye(3), np.full(3, np.nan))),
            "pose.translation must be finite",
        ),
        (lambda c: stp.inverse_kinematics(c, pin.SE3(2 * np.eye(3), np.zeros(3))), "pose.rotation"),
        (lambda c: stp.forward_kinematics(c, np.ones(5)), r"q_motor must have shape \(6,\), got \(5,\)"),
        (lambda c: stp.forward_kinematics(c, np.ones(6), q_guess=np.ones(3)), "q_guess must have shape"),
        (
            lambda c: stp.platform_motion(c, pin.SE3.Identity(), np.ones(3), np.ones(6)),
            "twist must have shape",
        ),
        (
            lambda c: stp.platform_motion(c, pin.SE3.Identity(), np.ones(6), [np.inf] * 6),
            "acceleration must be finite",
        ),
        (lambda c: stp.motor_positions(c, np.ones(2)), "q must have shape"),
        (lambda c: stp.platform_pose(c, np.ones(2)), "q must have shape"),
        (lambda c: stp.motor_jacobian(c, np.full(25, np.nan)), "q must be finite"),
    ],
)
def test_bad_arguments_are_named(call, message: str) -> None:
    with pytest.raises(InputError, match=message):
        call(robot("stewart"))
