"""Kernels answer wherever the verbs of one state do, on the same branch, far from home, through dead centres too."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.state.generic import regularity
from tests.closed_states import robot
from tests.zoo.table import ROBOTS

REGULAR = 1e-2
"""Share of the usual regularity from which on a state must be answered; nearer to a singularity it may be refused."""


@cache
def kernels(name: str, coordinates: Any) -> stp.compiled.Kernels:
    return stp.compile_kernels(robot(name), coordinates=coordinates)


def commands(chain: stp.ClosedChain, rng: np.random.Generator, count: int) -> np.ndarray:
    """Motor positions as far from home as the motors go: a turn and a half, or half the size of the robot."""
    home = stp.motor_positions(chain, chain.q_home)
    turning = np.array([chain.tangent_scale[k] == 1.0 for k in chain.motor_index])
    reach = np.where(turning, 4.0, 0.5 * chain.length_scale)
    return home + reach * rng.uniform(-1, 1, (count, chain.nu)) * rng.uniform(0, 1, (count, 1)) ** 2


def close(chain: stp.ClosedChain, found: np.ndarray, right: np.ndarray, regular: float) -> bool:
    """Whether efforts agree up to the digits that are lost, see `lost_on_the_way`; relative to the weight at least."""
    weight = 9.81 * pin.computeTotalMass(chain.model) * max(1.0, chain.length_scale)
    return bool(np.abs(found - right).max() <= 1e-11 / regular**2 * max(weight, np.abs(right).max()))


def compared(name: str, count: int, seed: int) -> dict[str, int]:
    """Compare in motor and platform coordinates; counts of what became of the states."""
    rng = np.random.default_rng(seed)
    chain = robot(name)
    by_motors = kernels(name, "motor")
    q_motor = commands(chain, rng, count)
    rate, acceleration = rng.uniform(-1, 1, (2, chain.nu)) * chain.tangent_scale[chain.motor_index]
    if chain.generic.count.idle:  # whose rates are nobody's demand: at rest nothing depends on them
        rate, acceleration = np.zeros(chain.nu), np.zeros(chain.nu)
    status = np.empty(count, dtype=np.int8)
    found = by_motors.inverse_dynamics(q_motor, rate, acceleration, status=status)
    number = dict.fromkeys(("answered", "refused by both", "refused", "unknown to one state"), 0)
    for k in range(count):
        closure = stp.forward_kinematics(chain, q_motor[k], limits=False, throw=False)
        if not closure.success:
            number["refused by both" if status[k] else "unknown to one state"] += 1
            continue
        here = regularity(closure.state)
        if status[k]:
            number["refused"] += here >= REGULAR
            continue
        q = closure.q
        G = stp.dynamics.motion_map(chain, q, np.zeros(chain.nv), coordinates="motor").G
        v = G @ rate
        gamma = stp.dynamics.motion_map(chain, q, v, coordinates="motor").gamma
        right = stp.inverse_dynamics(chain, q, v, G @ acceleration + gamma).tau_motor
        assert close(chain, found[k], right, here), (name, q_motor[k], found[k], right, here)
        number["answered"] += 1
    return number


def compared_poses(name: str, count: int, seed: int) -> dict[str, int]:
    """Compare at rest at poses that motors lead to; counts of what became of the states."""
    rng = np.random.default_rng(seed)
    chain = robot(name)
    reached = [
        stp.forward_kinematics(chain, x, limits=False, throw=False) for x in commands(chain, rng, count)
    ]
    poses = [stp.platform_pose(chain, closure.q) for closure in reached if closure.success]
    status, rest = np.empty(len(poses), dtype=np.int8), np.zeros(6)
    found = kernels(name, "platform").inverse_dynamics(
        np.array([pin.SE3ToXYZQUAT(pose) for pose in poses]), rest, rest, status=status
    )
    number = dict.fromkeys(("answered", "refused by both", "refused", "unknown to one state"), 0)
    for k, pose in enumerate(poses):
        closure = stp.inverse_kinematics(chain, pose, limits=False, throw=False)
        if not closure.success:
            number["refused by both" if status[k] else "unknown to one state"] += 1
            continue
        here = regularity(closure.state)
        if status[k]:
            number["refused"] += here >= REGULAR
            continue
        still = np.zeros(chain.nv)
        right = stp.inverse_dynamics(chain, closure.q, still, still).tau_motor
        assert close(chain, found[k], right, here), (name, pose, found[k], right, here)
        number["answered"] += 1
    return number


QUICK = ("four_bar", "stewart")
ROBOTS = [
    pytest.param(name, marks=() if name in QUICK else pytest.mark.slow)
    for name in ROBOTS
    if name != "arm_7r"  # seven motors for six freedoms: a motion within itself
]


@pytest.mark.parametrize("name", ROBOTS)
def test_motors_anywhere(name: str) -> None:
    number = compared(name, 100, 5)
    # A path may come so near to a singularity that only one of the two finds its way past.
    assert number["answered"] > 50 and number["refused"] + number["unknown to one state"] <= 3, number


@pytest.mark.parametrize("name", ROBOTS)
def test_poses_anywhere(name: str) -> None:
    number = compared_poses(name, 100, 5)
    # Motors lead round dead centres of legs too: a pose that is met on another branch may be refused.
    assert number["answered"] > 50 and number["refused"] <= 5, number
