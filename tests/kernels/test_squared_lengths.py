"""Forward kinematics of platforms on legs by squared lengths: which these are, and that the poses fit."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.kernels.graph.platform_dynamics import motor_columns, place_platform
from stewart_pin.kernels.graph.platform_kinematics import motor_position_expressions, squared_lengths
from stewart_pin.kernels.planning.plan import plan_platform
from stewart_pin.programs.status import StateStatus
from tests.closed_states import robot
from tests.kernels.platforms import PLATFORMS

BY_LENGTH = (
    "stewart",
    "stewart_sps",
    "stewart_cad",
    "stewart_s1",
    "legs on the platform",  # whose slides count backwards, from an offset
    "ball in the tree",
    "ball in the tree, idle spins",
)


def poses(chain: stp.ClosedChain, rng: np.random.Generator, count: int) -> np.ndarray:
    home = stp.platform_pose(chain, chain.q_home)
    moves = [
        pin.exp6(0.1 * np.repeat([chain.length_scale, 1], 3) * rng.uniform(-1, 1, 6)) for _ in range(count)
    ]
    return np.array([pin.SE3ToXYZQUAT(home * move) for move in moves])


@pytest.mark.parametrize("name", PLATFORMS)
def test_equations_are_those_of_the_positions(name: str, rng: np.random.Generator) -> None:
    """Gap = length · (position asked for - position of the pose), to the first order, and its rows likewise."""
    chain = PLATFORMS[name]()
    placed = place_platform(plan_platform(chain))
    q_motor = ca.SX.sym("q_motor", chain.nu)
    squared = squared_lengths(placed, q_motor)
    assert (squared is not None) == (name in BY_LENGTH)
    if squared is None:
        return
    outputs = [squared.gap, squared.rows, motor_position_expressions(placed), motor_columns(placed).T]
    function = ca.Function("both", [placed.pose, q_motor], [*outputs, ca.vertcat(*squared.beside)])
    for pose in poses(chain, rng, 3):
        there = np.array(function(pose, np.zeros(chain.nu))[2]).ravel()
        off = 1e-6 * rng.uniform(-1, 1, chain.nu)
        gap, rows, _, jacobian, beside = (np.array(x) for x in function(pose, there + off))
        scale = np.array(rows)[:, 0] / np.array(jacobian)[:, 0]  # plus or minus the length
        np.testing.assert_allclose(rows, scale[:, None] * jacobian, atol=1e-12)
        np.testing.assert_allclose(gap.ravel(), scale * off, atol=1e-11)  # off² / 2
        np.testing.assert_array_equal(beside, 0.0)


@pytest.mark.parametrize("name", BY_LENGTH)
def test_poses_are_found(name: str, rng: np.random.Generator) -> None:
    chain = PLATFORMS[name]()
    many = stp.compile_kernels(chain)
    expected = poses(chain, rng, 50)
    q_motor = many.inverse_kinematics(expected)
    home = pin.SE3ToXYZQUAT(stp.platform_pose(chain, chain.q_home))
    found = many.forward_kinematics(q_motor, home)
    sign = np.sign(np.sum(found[:, 3:] * expected[:, 3:], axis=1))
    found[:, 3:] *= sign[:, None]
    np.testing.assert_allclose(found, expected, atol=1e-13 * max(1.0, chain.length_scale))


def test_a_length_below_zero_is_no_length(rng: np.random.Generator) -> None:
    """Its square would fit: the pose belongs to another position of the motor."""
    chain = PLATFORMS["stewart"]()
    many, home = stp.compile_kernels(chain), pin.SE3ToXYZQUAT(stp.platform_pose(chain, chain.q_home))
    q_motor = many.inverse_kinematics(poses(chain, rng, 3))
    q_motor[1, 4] *= -1
    status = np.empty(3, dtype=np.int8)
    found = many.forward_kinematics(q_motor, home, status=status)
    assert status.tolist() == [StateStatus.OK, StateStatus.OUT_OF_BOUNDS, StateStatus.OK]
    assert np.isnan(found[1]).all()


@pytest.mark.parametrize(
    "name", ["stewart", pytest.param("six cranks", marks=pytest.mark.slow), "four_bar"]
)  # by lengths, by positions, by the whole tree
def test_guesses_need_no_unit_quaternions(name: str, rng: np.random.Generator) -> None:
    chain = PLATFORMS[name]() if name in PLATFORMS else robot(name)
    many, home = stp.compile_kernels(chain), pin.SE3ToXYZQUAT(stp.platform_pose(chain, chain.q_home))
    q_motor = stp.motor_positions(chain, chain.q_home) + 0.01 * chain.tangent_scale[chain.motor_index]
    guess = np.array([home, home, home])
    guess[1, 3:] *= 1.3
    guess[2, 3:] = 0.0
    status = np.empty(3, dtype=np.int8)
    found = many.forward_kinematics(np.tile(q_motor, (3, 1)), guess, status=status)
    assert status.tolist() == [StateStatus.OK, StateStatus.OK, StateStatus.OUT_OF_BOUNDS]
    np.testing.assert_allclose(found[1], found[0], atol=1e-12)
    assert np.isnan(found[2]).all()
