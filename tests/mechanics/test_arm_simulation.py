"""The seven-joint arm in motion: the source's rule and the exact motion (S2.2), momentum on a free base (S2.4)."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import stewart_pin as stp
from tests.mechanics.arm_motion import START, simulate, source_torque

# Final q - q0 in degrees, all printed digits.
RULE = [2.772803, -0.209674, 79.631933, -1.781752, -62.685614, 3.457400, -13.352252]
EXACT = [2.733551, -0.211802, 79.420332, -1.687289, -62.520165, 3.469957, -13.312813]
HALF_A_DIGIT = 0.5e-6 * 1.001


@pytest.fixture
def arm() -> stp.ClosedChain:
    return stp.load("arm_7r", gravity=(0, 0, 0))


def stepped(arm: stp.ClosedChain, h: float, steps: int) -> np.ndarray:
    """Step as the source does: dq += h ddq, then q += h dq + h²/2 ddq; q - q0 in degrees."""
    q, dq = START.copy(), np.zeros(7)
    for k in range(steps):
        ddq = stp.articulated_body_acceleration(arm, q, dq, source_torque(k * h))
        dq = dq + h * ddq
        q = q + h * dq + h**2 / 2 * ddq
    return np.rad2deg(q - START)


def test_the_sources_rule_gives_the_sources_digits(arm: stp.ClosedChain) -> None:
    # 1001 updates: at t = 0, 0.01, ... 10 s.
    assert np.abs(stepped(arm, 0.01, 1001) - RULE).max() <= HALF_A_DIGIT


def test_the_exact_motion_has_the_corrected_digits(arm: stp.ClosedChain) -> None:
    exact = simulate(arm, START, np.zeros(7), source_torque, 10.0, rtol=1e-11).q[-1]
    assert np.abs(np.rad2deg(exact - START) - EXACT).max() <= HALF_A_DIGIT


def test_the_sources_rule_counts_three_halves_and_is_of_first_order(arm: stp.ClosedChain) -> None:
    # From rest a constant acceleration moves h² a / 2; h times the updated rate adds h² a to that.
    ddq = np.rad2deg(stp.articulated_body_acceleration(arm, START, np.zeros(7), source_torque(0.0)))
    np.testing.assert_allclose(stepped(arm, 0.01, 1), 1.5 * 0.01**2 * ddq, rtol=1e-9, atol=1e-12)
    coarse, fine = (np.abs(stepped(arm, h, round(10 / h)) - EXACT).max() for h in (0.08, 0.04))
    assert 1.8 < coarse / fine < 2.2


@pytest.mark.parametrize("case", ["from rest", "thrown"])
def test_momentum_of_a_free_arm_stays(arm: stp.ClosedChain, case: str) -> None:
    bus = pin.Inertia(150.0, np.array([0.02, 0.0, -0.3]), np.diag([20.0, 18.0, 15.0]))
    satellite = stp.on_floating_base(arm, bus)
    q, v = np.array(satellite.q_home), np.zeros(13)
    q[7:] = START
    if case == "thrown":
        v[:6] = [0.05, -0.02, 0.01, 0.03, -0.05, 0.02]
    motion = simulate(satellite, q, v, source_torque, 10.0, samples=21)
    data = pin.Data(satellite.model)
    # Linear, and angular about the centre of mass, world axes.
    momentum = np.array(
        [
            pin.computeCentroidalMomentum(satellite.model, data, *x).vector
            for x in zip(motion.q, motion.v, strict=True)
        ]
    )
    assert np.abs(momentum - momentum[0]).max() <= 1e-10
    assert (np.abs(momentum[0]).min() > 0.1) == (case == "thrown")
    # The base answers: it turns, although nothing outside pushes it.
    assert np.abs(pin.log3(pin.XYZQUATToSE3(motion.q[-1, :7]).rotation)).max() > 0.01


@pytest.mark.parametrize("duration", [0.5, pytest.param(4.0, marks=pytest.mark.slow)])
def test_momentum_of_a_free_stewart_platform_stays(duration: float) -> None:
    # A platform on a satellite: springs, dampers and shaking in the legs are internal forces. 4 s take about 12 s.
    chain = stp.on_floating_base(
        stp.load("stewart"), pin.Inertia(400.0, np.zeros(3), np.diag([80.0, 90.0, 70.0])), gravity=(0, 0, 0)
    )
    n, phase = chain.nq, np.arange(6.0)
    rest = chain.q_home[chain.motor_q_index]

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        q, v = pin.normalize(chain.model, y[:n]), y[n:]
        stretch = q[chain.motor_q_index] - rest
        tau = -400 * stretch - 60 * v[chain.motor_index] + 20 * np.sin(3 * t + phase)
        a = stp.dynamics.closed_chain_articulated_body(chain, q, v, tau).a
        return np.concatenate([pin.tangentMap(chain.model, q) @ v, a])

    v = np.zeros(chain.nv)
    v[:6] = [0.1, 0.0, -0.05, 0.02, 0.05, -0.1]
    # Longer steps have stages that open the loops by more than the dynamics accepts.
    start, options = np.concatenate([chain.q_home, v]), {"rtol": 1e-10, "atol": 1e-11, "max_step": 0.01}
    done = solve_ivp(rate, (0, duration), start, method="DOP853", **options)
    assert done.success
    data = pin.Data(chain.model)
    momentum = np.array(
        [
            pin.computeCentroidalMomentum(chain.model, data, pin.normalize(chain.model, y[:n]), y[n:]).vector
            for y in done.y.T
        ]
    )
    assert np.abs(momentum - momentum[0]).max() <= 1e-10 * np.abs(momentum[0]).max()
    # The loops stay closed without any correction, and the platform has moved against its base.
    assert np.abs(stp.loop_gap(chain, done.y[:n, -1])).max() < 1e-9
    assert np.abs(done.y[chain.motor_q_index] - rest[:, None]).max() > 0.01
