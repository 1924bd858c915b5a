"""Motors with limits, friction and stops: the energy account closes, and every limit shows."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp
from tests.closed_states import random_motion, robot
from tests.mechanisms import four_bar


def audit(run: stp.simulation.Simulation) -> float:
    """Energy that the account cannot explain [J]."""
    return float(np.abs(run.energy + run.dissipated - run.supplied - run.energy[0]).max())


def push(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.full(6, 80.0) + 60 * np.sin(20 * t + np.arange(6))


def test_energy_account_with_friction_and_drive(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    v = random_motion(chain, rng, chain.q_home)[0]
    motors = stp.simulation.Motors(viscous=30.0, coulomb=10.0, inertia=2.0)
    left = []
    for dt in (4e-3, 2e-3):
        run = stp.simulate(chain, chain.q_home, v, push, duration=0.2, dt=dt, motors=motors)
        assert run.success
        assert run.dissipated[-1] > 1.0
        assert abs(run.supplied[-1]) > 1.0
        left.append(audit(run))
    # Account and motion are integrated by the same rule: order four.
    assert left[1] < left[0] / 10
    assert left[1] < 1e-6 * run.dissipated[-1]
    assert (np.diff(run.dissipated) >= 0).all()


def test_motor_inertia_adds_to_the_mass_matrix(rng: np.random.Generator) -> None:
    # The same as an effort -inertia · a on the motor coordinate, which inverse dynamics must then supply.
    chain = robot("stewart")
    rest = np.zeros(chain.nv)
    run = stp.simulate(
        chain, chain.q_home, rest, duration=1e-3, dt=1e-3, motors=stp.simulation.Motors(inertia=3.0)
    )
    pose = run.platform.pose(0)
    state = stp.platform_motion(chain, pose, np.zeros(6), run.platform.acceleration[0])
    efforts = stp.inverse_dynamics(chain, state.q, rest, state.a).tau_motor
    np.testing.assert_allclose(efforts, -3.0 * state.a[chain.motor_index], rtol=0, atol=1e-9)
    assert np.abs(efforts).max() > 1.0


def test_efforts_saturate_at_the_files_limit_and_say_so() -> None:
    chain = robot("stewart")
    rest = np.zeros(chain.nv)
    command = lambda t, q, v: np.array([2e4, 50.0, 50.0, 50.0, 50.0, 50.0])  # noqa: E731
    run = stp.simulate(chain, chain.q_home, rest, command, duration=2e-3, dt=1e-3)
    assert run.tau_motor[0].tolist() == [1e4, 50.0, 50.0, 50.0, 50.0, 50.0]
    first = run.events[0]
    assert (first.kind, first.joint, first.value, first.limit) == ("effort", chain.motors[0], 2e4, 1e4)


def test_a_rate_limit_takes_the_push_but_not_the_brake() -> None:
    chain = four_bar()
    rest = np.zeros(chain.nv)
    motors = stp.simulation.Motors(rate_limit=2.0)
    run = stp.simulate(
        chain, chain.q_home, rest, lambda t, q, v: np.array([40.0]), duration=0.6, dt=2e-3, motors=motors
    )
    rate = run.v[:, chain.motor_index[0]]
    # Gravity is across the plane; other bodies may push the motor a little beyond.
    assert 1.8 < rate.max() < 2.6
    braked = stp.simulate(
        chain,
        chain.q_home,
        run.v[0],
        lambda t, q, v: np.array([-40.0]),
        duration=0.01,
        dt=1e-3,
        motors=motors,
    )
    assert braked.tau_motor[0, 0] == -40.0


def test_end_stops_hold_the_stroke_and_the_account() -> None:
    chain = robot("stewart")
    rest = np.zeros(chain.nv)
    lower = chain.model.lowerPositionLimit[chain.motor_q_index]
    motors = stp.simulation.Motors(stop_stiffness=1e5, stop_damping=300.0)
    run = stp.simulate(chain, chain.q_home, rest, duration=0.6, dt=1e-3, motors=motors)
    assert run.success
    position = run.q[:, chain.motor_q_index]
    # Falling about half a metre onto springs: m v² = k x², 50 kg, 3 m/s, six legs.
    assert position.min() > lower.min() - 0.05
    assert position.min() < lower.min()
    assert any(event.kind == "stroke" for event in run.events)
    assert run.dissipated[-1] > 1.0
    # Stops are met within a step, where the rule has no smooth force to integrate: order two.
    assert audit(run) < 1e-3 * run.dissipated[-1]


def test_a_fall_to_the_limit_is_an_event_with_time_and_joint() -> None:
    chain = robot("stewart")
    rest = np.zeros(chain.nv)
    run = stp.simulate(chain, chain.q_home, rest, duration=1.0, dt=2e-3, stop_on=("stroke",))
    assert not run.success
    event = next(event for event in run.events if event.kind == "stroke")
    assert event.joint in chain.motors
    assert event.value < event.limit == 0.5
    assert event.time == run.time[-1] < 1.0
    assert "stroke" in run.reason


def test_a_singularity_is_announced() -> None:
    # The four-bar's crank motor loses its hold where coupler and rocker are in line; a rocker swings through there.
    chain = four_bar(lengths=(0.6, 0.3, 0.8))
    state = stp.simulate(
        chain,
        chain.q_home,
        np.zeros(chain.nv),
        lambda t, q, v: np.array([8.0]),
        duration=1.5,
        dt=5e-3,
        singular=0.2,
        stop_on=("singularity",),
    )
    assert not state.success
    event = state.events[-1]
    assert event.kind == "singularity"
    assert event.value < 0.2
    # The measure is the one by which configurations are classified.
    measures = stp.singularities.classify_singularity(chain, state.q[-1]).measures
    assert event.value == pytest.approx(measures["motor"], rel=1e-9)
    assert event.joint in chain.tangent_names


def test_a_step_far_too_long_ends_in_words_not_in_nan() -> None:
    chain = robot("stewart")
    rest = np.zeros(chain.nv)
    stiff = lambda t, q, v: -1e6 * (q - chain.q_home)[chain.motor_q_index] - 1e5 * v[chain.motor_index]  # noqa: E731
    motors = stp.simulation.Motors(effort_limit=np.inf)
    run = stp.simulate(chain, chain.q_home, rest, stiff, duration=1.0, dt=0.05, motors=motors)
    assert not run.success
    assert run.events[-1].kind in ("closure_lost", "diverged")
    assert run.events[-1].joint
    assert "dt" in run.reason
    for values in (run.q, run.v, run.energy, run.platform.position, run.final_state.q, run.final_state.v):
        assert np.isfinite(values).all()


def test_friction_stops_what_moves_and_brakes_what_it_says(rng: np.random.Generator) -> None:
    chain = four_bar()
    v = random_motion(chain, rng, chain.q_home)[0]
    run = stp.simulate(
        chain,
        chain.q_home,
        v,
        duration=0.5,
        dt=2e-3,
        motors=stp.simulation.Motors(viscous=2.0),
        record_rate=500.0,
    )
    # Heat is the time integral of viscous · rate²; Simpson's rule on the record.
    rate2 = run.v[:, chain.motor_index[0]] ** 2
    h = run.time[1]
    heat = 2.0 * h / 3 * (rate2[0] + 4 * rate2[1:-1:2].sum() + 2 * rate2[2:-1:2].sum() + rate2[-1])
    assert run.dissipated[-1] == pytest.approx(heat, rel=1e-5)
    assert audit(run) < 1e-8


def test_a_controller_that_fails_in_the_midst_leaves_the_record() -> None:
    chain = robot("stewart")

    def dying(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.full(6, 50.0 if t < 0.02 else np.nan)

    run = stp.simulate(chain, chain.q_home, np.zeros(chain.nv), dying, duration=0.1, dt=2e-3)
    assert not run.success
    assert "finite" in run.reason
    assert run.events[-1].kind == "controller"
    assert len(run) >= 10
    assert np.isfinite(run.tau_motor).all()
