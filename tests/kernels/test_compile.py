"""Verbs for arrays of states against those for one state, on every bundled robot."""

from __future__ import annotations

import pickle
import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.kernels.kernels import Kernels, compile_kernels
from stewart_pin.programs.status import StateStatus
from tests import mechanisms
from tests.closed_states import (
    close,
    derivative,
    random_configuration,
    random_motion,
    robot,
    slow_but_for_few,
)
from tests.kernels.platforms import motor_to_spare
from tests.zoo.table import ROBOTS

AGREE = 1e-10
HELD = [name for name in ROBOTS if stp.mobility(robot(name)).motors_sufficient]
"""Robots whose motors hold them: inverse dynamics and motor coordinates are for these."""
ON_PLATFORM = [name for name in HELD if name != "arm_7r"]
"""Robots that the motion of their platform determines."""
LIKE_ANOTHER = {"stewart_cad", "stewart_s1"}
"""Robots whose legs are those of another one."""
SMALL = [name for name in HELD if robot(name).nv < 24]


@cache
def kernels(name: str, coordinates: str = "platform") -> Kernels:
    return compile_kernels(robot(name), coordinates=coordinates)  # pyright: ignore[reportArgumentType]


def array_of(states: list[tuple[np.ndarray, ...]]) -> list[np.ndarray]:
    return [np.array(x) for x in zip(*states, strict=True)]


def platform_states(many: Kernels, rng: np.random.Generator, count: int = 4):
    """States of the whole chain, driven by poses and motions that the platform can do, and those as arrays."""
    chain, whole, states = many.chain, [], []
    for _ in range(count):
        q = random_configuration(chain, rng, 0.1)
        v, a = random_motion(chain, rng, q)
        jacobian = chain.at(q).P
        pose, twist = stp.platform_pose(chain, q), jacobian @ v
        acceleration = jacobian @ a + chain.at(q, v).platform_bias
        # On the branch that the kernel takes: an arm reaches most poses in several ways.
        q_motor = many.inverse_kinematics(pin.SE3ToXYZQUAT(pose))
        there = stp.forward_kinematics(chain, q_motor, limits=False).q
        whole.append(stp.platform_motion(chain, pose, twist, acceleration, q_guess=there, limits=False))
        states.append((pin.SE3ToXYZQUAT(pose), twist, acceleration, q_motor))
    return whole, array_of(states)


@pytest.mark.parametrize(
    "name", slow_but_for_few(ON_PLATFORM, ["stewart", "four_bar", "rpr_planar", "arm_3r_spatial"])
)
def test_platform_coordinates_agree(name: str, rng: np.random.Generator) -> None:
    many = kernels(name)
    chain = many.chain
    whole, (pose, twist, acceleration, q_motor) = platform_states(many, rng)
    tau_motor = many.inverse_dynamics(pose, twist, acceleration)
    moved = many.forward_dynamics(pose, twist, tau_motor)
    rates = np.einsum("nij,nj->ni", many.motor_jacobian(pose), twist)
    for k, s in enumerate(whole):
        close(q_motor[k], stp.motor_positions(chain, s.q), AGREE)
        close(tau_motor[k], stp.inverse_dynamics(chain, s.q, s.v, s.a).tau_motor, AGREE)
        close(rates[k], s.v[chain.motor_index], AGREE)
        a = stp.forward_dynamics(chain, s.q, s.v, tau_motor[k]).a
        close(moved[k], chain.at(s.q).P @ a + chain.at(s.q, s.v).platform_bias, AGREE)


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n in LIKE_ANOTHER else n for n in ON_PLATFORM]
)
def test_forward_kinematics_returns(name: str, rng: np.random.Generator) -> None:
    many = kernels(name)
    _, (pose, _, _, q_motor) = platform_states(many, rng, 3)
    status = np.full(3, -1, dtype=np.int8)
    guess = pin.SE3ToXYZQUAT(stp.platform_pose(many.chain, many.chain.q_home))
    if name.startswith("arm"):
        guess = pose[0]  # home is stretched out, where no Newton step exists
    found = many.forward_kinematics(q_motor, guess, status=status)
    assert (status == StateStatus.OK).all()
    for one, other in zip(found, pose, strict=True):
        close(pin.XYZQUATToSE3(one).homogeneous, pin.XYZQUATToSE3(other).homogeneous, 1e-9)


@pytest.mark.parametrize("name", [n if n in SMALL else pytest.param(n, marks=pytest.mark.slow) for n in HELD])
def test_motor_coordinates_agree(name: str, rng: np.random.Generator) -> None:
    many = kernels(name, "motor")
    chain, whole, states = many.chain, [], []
    for _ in range(3):
        v = rng.normal(size=chain.nu) * chain.tangent_scale[chain.motor_index]
        step = 0.05 * rng.uniform(-1, 1, chain.nu) * chain.tangent_scale[chain.motor_index]
        q_motor = stp.motor_positions(chain, chain.q_home) + step
        q = stp.forward_kinematics(chain, q_motor, limits=False).q
        motion, a = random_motion(chain, rng, q)
        whole.append((q, motion, a))
        states.append((q_motor, motion[chain.motor_index], a[chain.motor_index]))
    if chain.nv - chain.nc > chain.nu and stp.mobility(chain).idle:
        pytest.skip("idle freedoms move as they like; the platform's coordinates fix them")
    position, velocity, acceleration = array_of(states)
    tau_motor = many.inverse_dynamics(position, velocity, acceleration)
    moved = many.forward_dynamics(position, velocity, tau_motor)
    for k, (q, v, a) in enumerate(whole):
        close(tau_motor[k], stp.inverse_dynamics(chain, q, v, a).tau_motor, AGREE)
    close(moved, acceleration, 1e-9)


def test_gears_and_threads_in_motor_coordinates(rng: np.random.Generator) -> None:
    chain = mechanisms.gear_train(rng)
    many, states = compile_kernels(chain, coordinates="motor"), []
    for _ in range(3):
        q = random_configuration(chain, rng, 0.3)
        v, a = random_motion(chain, rng, q)
        states.append((q, v, a))
    position = np.array([q[chain.motor_q_index] for q, _, _ in states])
    velocity, acceleration = (np.array([s[k][chain.motor_index] for s in states]) for k in (1, 2))
    tau_motor = many.inverse_dynamics(position, velocity, acceleration)
    for k, (q, v, a) in enumerate(states):
        close(tau_motor[k], stp.inverse_dynamics(chain, q, v, a).tau_motor, AGREE)
    close(many.forward_dynamics(position, velocity, tau_motor), acceleration, AGREE)


def test_a_motor_to_spare(rng: np.random.Generator) -> None:
    chain = motor_to_spare()
    many = compile_kernels(chain)
    assert (many.report.route, many.report.freedoms, chain.nu) == ("legs", 3, 4)
    _, (pose, twist, acceleration, q_motor) = platform_states(many, rng, 3)
    home = pin.SE3ToXYZQUAT(stp.platform_pose(chain, chain.q_home))
    found = many.forward_kinematics(q_motor, home)
    for one, other in zip(found, pose, strict=True):
        close(pin.XYZQUATToSE3(one).homogeneous, pin.XYZQUATToSE3(other).homogeneous, 1e-9)
    # Derivatives along the plane's own freedoms.
    twists = np.linalg.svd(twist.T)[0][:, :3]
    by_twist = many.inverse_dynamics_derivatives(pose[0], twist[0], acceleration[0])[1]
    slope = derivative(lambda t: many.inverse_dynamics(pose[0], twist[0] + t * twists.T, acceleration[0]))
    close((by_twist @ twists).T, slope, 1e-8)


def test_lopsided_rods_that_may_spin_are_refused() -> None:
    old = mechanisms.rotary_hexapod().described()
    lopsided = pin.Inertia(0.2, np.array([0.2, 0.02, 0.0]), np.diag([1e-4, 3e-3, 3e-3]))
    links = tuple(replace(link, inertia=lopsided) if link.name == "rod0" else link for link in old.links)
    chain = build_chain(replace(old, links=links), motors=tuple(f"motor{k}" for k in range(6)))
    with pytest.raises(stp.errors.UnsupportedError, match=r"idle freedoms .*elbow.* coordinates='tree'"):
        compile_kernels(chain)
    assert compile_kernels(chain, coordinates="tree").report.freedoms == 12


def test_a_redundant_arm_needs_motor_coordinates() -> None:
    with pytest.raises(stp.errors.UnsupportedError, match=r"1 freedom.* coordinates='motor'"):
        compile_kernels(robot("arm_7r"))


def test_motors_that_hold_nothing_are_refused() -> None:
    chain = mechanisms.five_bar(("left_hip",))
    with pytest.raises((stp.errors.ActuationError, stp.errors.UnsupportedError)):
        compile_kernels(chain).inverse_dynamics(np.zeros(7), np.zeros(6), np.zeros(6))


def test_bad_states_come_out_as_nan_with_a_code(rng: np.random.Generator) -> None:
    many = kernels("stewart")
    _, (pose, twist, acceleration, q_motor) = platform_states(many, rng, 4)
    expected = many.inverse_dynamics(pose, twist, acceleration)
    pose[1, 3:] *= 1.01  # no unit quaternion
    pose[2, 0] = np.nan
    status = np.empty(4, dtype=np.int8)
    found = many.inverse_dynamics(pose, twist, acceleration, status=status)
    assert status.tolist() == [
        StateStatus.OK,
        StateStatus.OUT_OF_BOUNDS,
        StateStatus.INPUT_NOT_FINITE,
        StateStatus.OK,
    ]
    assert np.isnan(found[1:3]).all()
    assert np.array_equal(found[[0, 3]], expected[[0, 3]])
    q_motor[1] = [0.1, 2.0, 0.1, 2.0, 0.1, 2.0]  # legs that no platform fits
    poses = many.forward_kinematics(q_motor, pose[0], status=status)
    assert status.tolist() == [StateStatus.OK, StateStatus.OUT_OF_BOUNDS, StateStatus.OK, StateStatus.OK]
    assert np.isnan(poses[1]).all()


@pytest.mark.parametrize("name", ["four_bar", "delta", "rpr_planar"])
def test_a_demand_that_the_platform_cannot_follow_has_a_code(name: str, rng: np.random.Generator) -> None:
    many = kernels(name)
    _, (pose, twist, acceleration, _) = platform_states(many, rng, 2)
    twist[1] += [0.0, 0.0, 0.0, 0.3, 0.2, 0.1]
    status = np.empty(2, dtype=np.int8)
    assert np.isnan(many.inverse_dynamics(pose, twist, acceleration, status=status)[1]).all()
    assert status.tolist() == [StateStatus.OK, StateStatus.OUT_OF_BOUNDS]
    # So has a pose that it cannot take.
    pose[1, 3:] = pin.Quaternion(pin.exp3(np.array([0.3, 0.2, 0.1]))).coeffs()
    twist[1] = acceleration[1] = 0.0
    assert np.isnan(many.inverse_dynamics(pose, twist, acceleration, status=status)[1]).all()
    assert status[1] != StateStatus.OK


@pytest.mark.parametrize("name", ["four_bar", "five_bar"])
@pytest.mark.parametrize("axis", np.eye(3))
def test_a_platform_half_a_turn_off_is_not_taken_for_the_pose(name: str, axis: np.ndarray) -> None:
    # At home, and turned by exactly half a turn: the sine of the error vanishes, and all loops are closed.
    many = kernels(name)
    home = stp.platform_pose(many.chain, many.chain.q_home)
    turned = pin.SE3ToXYZQUAT(pin.SE3(pin.exp3(np.pi * axis) @ home.rotation, home.translation))
    status = np.empty(2, dtype=np.int8)
    found = many.inverse_kinematics(np.array([turned, pin.SE3ToXYZQUAT(home)]), status=status)
    assert status.tolist() == [StateStatus.OUT_OF_BOUNDS, StateStatus.OK]
    assert np.isnan(found[0]).all()


def test_one_state_and_many(rng: np.random.Generator) -> None:
    for name in ("stewart", "four_bar"):
        many = kernels(name)
        _, (pose, twist, acceleration, q_motor) = platform_states(many, rng, 2)
        both = many.inverse_dynamics(pose, twist, acceleration)
        assert np.array_equal(many.inverse_dynamics(pose[0], twist[0], acceleration[0]), both[0])
        assert many.forward_kinematics(q_motor[0], pose[0]).shape == (7,)
        assert many.inverse_dynamics(pose[:0], twist[:0], acceleration[:0]).shape == (0, many.chain.nu)
        with pytest.raises(stp.errors.InputError):
            many.inverse_dynamics(pose[:, :6], twist, acceleration)


def test_the_interpreter_agrees_with_the_machine_code(rng: np.random.Generator) -> None:
    many = kernels("stewart")
    slow = compile_kernels(robot("stewart"), engine="numpy")
    _, (pose, twist, acceleration, _) = platform_states(many, rng, 3)
    close(
        slow.inverse_dynamics(pose, twist, acceleration),
        many.inverse_dynamics(pose, twist, acceleration),
        1e-13,
    )


@pytest.mark.parametrize("name", ["stewart", "four_bar"])
def test_single_precision(name: str, rng: np.random.Generator) -> None:
    many, single = kernels(name), compile_kernels(robot(name), dtype=np.float32)
    _, (pose, twist, acceleration, q_motor) = platform_states(many, rng, 3)
    # 1e-7 of round-off, times a few hundred operations that cancel.
    close(single.inverse_kinematics(pose), q_motor, 1e-5)
    close(single.forward_kinematics(q_motor, pose[0]), many.forward_kinematics(q_motor, pose[0]), 1e-4)
    expected = many.inverse_dynamics(pose, twist, acceleration)
    close(single.inverse_dynamics(pose, twist, acceleration), expected, 1e-4)


def test_pickled_kernels_answer_the_same(rng: np.random.Generator) -> None:
    many = kernels("four_bar")
    _, (pose, twist, acceleration, _) = platform_states(many, rng, 2)
    again = pickle.loads(pickle.dumps(many))
    close(
        again.inverse_dynamics(pose, twist, acceleration),
        many.inverse_dynamics(pose, twist, acceleration),
        1e-13,
    )


def test_wrong_options() -> None:
    for wrong in ({"dtype": np.int32}, {"coordinates": "joint"}, {"engine": "gpu"}):
        with pytest.raises(stp.errors.InputError, match=next(iter(wrong))):
            compile_kernels(robot("four_bar"), **wrong).inverse_dynamics(
                np.zeros(7), np.zeros(6), np.zeros(6)
            )


def test_report_and_functions() -> None:
    many = kernels("stewart")
    many.casadi("inverse_dynamics")
    report = many.report
    assert (report.route, report.freedoms, report.coordinates) == ("legs", 6, "platform")
    assert report.pivot_score > 0.5
    assert "inverse_dynamics: " in str(report)
    assert set(many.names) >= {"inverse_dynamics", "tree_inverse_dynamics", "motor_jacobian"}
    assert many.casadi("inverse_dynamics").name_in() == ["pose", "twist", "acceleration"]
    with pytest.raises(stp.errors.InputError, match="inverse_dynamics"):
        many.casadi("inverse")
    assert kernels("four_bar").report.route == "tree"
    assert "twists that change with the pose" in str(kernels("four_bar").report)


def test_the_plan_is_reported() -> None:
    legs = kernels("stewart").report.blocks
    assert [block.name for block in legs] == [f"leg of leg{k}_x" for k in range(1, 7)]
    for k, block in enumerate(legs, 1):
        assert block.joints == "RRP-S"
        assert {row for row, _ in block.pivots} == {f"leg{k}_x", f"leg{k}_y", f"leg{k}"}
        assert {equation for _, equation in block.pivots} == {f"leg{k}_ball {axis}" for axis in "xyz"}
    assert "leg of leg1_x RRP-S: 3 pivots" in str(kernels("stewart").report)
    whole = kernels("four_bar", "motor")
    loops, drive = whole.report.blocks
    assert (loops.name, drive.name) == ("loops", "loops and drive")
    # Of five rows of the one loop two do something in the plane, and the motor's is beside them.
    assert len(loops.pivots) == 2
    assert {equation for _, equation in drive.pivots} - {e for _, e in loops.pivots} == {
        whole.chain.motors[0]
    }
    assert compile_kernels(robot("arm_7r"), coordinates="tree").report.blocks == ()


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [n for n in sys.modules if n.startswith("stewart_pin.kernels.") and "compile" not in n]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(stp.errors.MissingExtraError, match="kernels"):
        compile_kernels(robot("stewart"))
