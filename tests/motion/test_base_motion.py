"""Demands on a ship: every instant is the state of one, by another formulation as well."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError
from tests.closed_states import close, robot


def rolling(t: float) -> stp.dynamics.BaseMotion:
    w = 1.3
    angle, rate, acceleration = 0.3 * np.sin(w * t), 0.3 * w * np.cos(w * t), -0.3 * w * w * np.sin(w * t)
    x = np.eye(6)[3]
    return stp.dynamics.BaseMotion(pin.exp3(np.array([angle, 0.0, 0.0])), rate * x, acceleration * x)


def test_demand_and_fit_follow_the_ground(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    home, time = stp.platform_pose(chain, chain.q_home), np.linspace(0.0, 1.0, 9)

    def motion(scale: float) -> stp.motions.PlatformSamples:
        return stp.motions.sinusoidal_motion(time, home=home, amplitude=scale * np.array([0.05, 0.03, 0.04]))

    samples = motion(1.0)

    found = stp.motor_demand(chain, samples, base_motion=rolling)
    still = stp.motor_demand(chain, samples, kernels=False)
    close(found.positions, still.positions, 1e-9)
    for k, t in enumerate(samples.time):
        state = stp.platform_motion(chain, samples.pose(k), samples.twist[k], samples.acceleration[k])
        there = chain.at(state.q, state.v, state.a, base_motion=rolling(t))
        by_bodies = stp.inverse_dynamics(there, method="constraint_matrix").tau_motor
        close(found.efforts[k], by_bodies, 1e-8)
    again = stp.motor_demand(chain, samples, base_motion=[rolling(t) for t in samples.time])
    np.testing.assert_array_equal(again.efforts, found.efforts)
    most = np.abs(found.efforts).max()
    weak = stp.with_limits(chain, {motor: {"effort": 0.97 * most} for motor in chain.motors})
    fit = stp.fit_to_limits(weak, motion, base_motion=rolling)
    assert fit.scale < 1.0 and np.abs(fit.demand.efforts).max() <= 0.97 * most * (1 + 1e-9)
    with pytest.raises(
        InputError, match="base_motion has 2 motions of the ground, the motion is of 9 instants"
    ):
        stp.motor_demand(chain, samples, base_motion=[rolling(0.0)] * 2)
    with pytest.raises(InputError, match="base_motion must return a BaseMotion, got float at 0 s"):
        stp.motor_demand(chain, samples, base_motion=lambda t: t)  # pyright: ignore[reportArgumentType]


@pytest.mark.slow
def test_kernels_know_a_ground_that_moves() -> None:
    chain = robot("stewart")
    home = stp.platform_pose(chain, chain.q_home)
    samples = stp.motions.sinusoidal_motion(np.linspace(0.0, 1.0, 301), home=home)
    push = {"platform": [0.0, 3.0, -20.0, 1.0, 0.0, 0.0]}
    found = stp.motor_demand(chain, samples, wrenches=push, base_motion=rolling)
    assert found.method == "kernels"
    one_by_one = stp.motor_demand(chain, samples, wrenches=push, base_motion=rolling, kernels=False)
    assert one_by_one.method == "one_state"
    close(found.efforts, one_by_one.efforts, 1e-10)
    close(found.positions, one_by_one.positions, 1e-10)
