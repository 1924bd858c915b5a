"""Controllers follow, and what the simulated platform did is what was commanded (S0.3, S0.7)."""

from __future__ import annotations

from functools import partial

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from tests.closed_states import random_configuration, random_motion, robot
from tests.mechanisms import four_bar
from tests.retelling.case import case


def composite(chain: stp.ClosedChain, **options) -> partial:
    return partial(stp.motions.sinusoidal_motion, home=stp.platform_pose(chain, chain.q_home), **options)


def start(chain: stp.ClosedChain, reference) -> stp.State:
    want = reference(np.zeros(1))
    return stp.platform_motion(chain, want.pose(0), want.twist[0], want.acceleration[0])


def rms_error(run: stp.simulation.Simulation, reference) -> tuple[float, float, float]:
    want = reference(run.time)
    parts = (
        (run.platform.position, want.position),
        (run.platform.twist, want.twist),
        (run.platform.acceleration, want.acceleration),
    )
    return tuple(float(np.sqrt(np.mean((a - b) ** 2))) for a, b in parts)


@pytest.mark.parametrize("name", ["stewart", "stewart_sps"])
def test_gravity_compensation_holds_the_robot(name: str) -> None:
    chain = robot(name)
    q = random_configuration(chain, np.random.default_rng(2), 0.05)
    run = stp.simulate(
        chain, q, np.zeros(chain.nv), stp.control.GravityCompensation(chain), duration=0.1, dt=2e-3
    )
    # Idle spins of balanced legs stay; everything else has no reason to move.
    assert np.abs(run.platform.twist).max() < 1e-9


@pytest.mark.parametrize("model", ["feedforward", "computed_torque"])
def test_inverse_dynamics_tracks_to_the_integrators_accuracy(model: str) -> None:
    chain = robot("stewart")
    reference = composite(chain)
    controller = (
        stp.control.Feedforward(chain, reference)
        if model == "feedforward"
        else stp.control.ComputedTorque(chain, reference, kp=0.0, kd=0.0)
    )
    state = start(chain, reference)
    errors = []
    for dt in (4e-3, 2e-3):
        run = stp.simulate(chain, state.q, state.v, controller, duration=0.04, dt=dt)
        assert run.success
        errors.append(rms_error(run, reference)[0])
    assert errors[1] < errors[0] / 10
    assert errors[1] < 1e-8


def test_motion_measured_in_the_simulation_is_the_command_and_the_closed_form() -> None:
    chain = robot("stewart")
    reference = composite(chain)
    state = start(chain, reference)
    controller = stp.control.ComputedTorque(chain, reference)
    run = stp.simulate(chain, state.q, state.v, controller, duration=0.2, dt=2e-3)
    position, twist, acceleration = rms_error(run, reference)
    # Steps of 2 ms of a motion with up to 28 rad/s: (0.056)⁴ of its size, and the controller closes the rest.
    assert position < 1e-7
    assert twist < 1e-6
    assert acceleration < 1e-5
    # S0.3: the simulated legs measure what S0.1 computes for the measured pose.
    hexapod = stp.Hexapod.from_chain(chain)
    lengths = stp.leg_lengths(hexapod, run.platform.position, run.platform.rotation)
    np.testing.assert_allclose(run.q[:, chain.motor_q_index], lengths, rtol=0, atol=1e-12)
    rates = stp.hexapods.leg_rates(hexapod, run.platform.position, run.platform.rotation, run.platform.twist)
    np.testing.assert_allclose(run.v[:, chain.motor_index], rates, rtol=0, atol=1e-11)


def test_computed_torque_obeys_its_error_equation() -> None:
    # One axis displaced: e(t) of ë + kd ė + kp e = 0 with e(0) = 10 mm, critically damped.
    chain = robot("stewart")
    home = stp.platform_pose(chain, chain.q_home)
    reference = partial(stp.motions.sinusoidal_motion, home=home, amplitude=np.zeros(3))
    begin = stp.inverse_kinematics(chain, pin.SE3(home.rotation, home.translation + [0.01, 0, 0]))
    controller = stp.control.ComputedTorque(chain, reference, kp=400.0, kd=40.0)
    run = stp.simulate(chain, begin.q, np.zeros(chain.nv), controller, duration=0.1, dt=2e-3)
    error = run.platform.position[:, 0] - home.translation[0]
    expected = 0.01 * (1 + 20 * run.time) * np.exp(-20 * run.time)
    np.testing.assert_allclose(error, expected, rtol=0, atol=1e-7)


def test_computed_torque_turns_the_platform_back_the_exact_way() -> None:
    chain = robot("stewart")
    # A command that is itself turned: world and platform axes differ.
    home = pin.SE3(pin.exp3(np.array([0.2, 0.1, -0.15])), np.array([0.02, 0.0, 1.0]))
    reference = partial(stp.motions.sinusoidal_motion, home=home, amplitude=np.zeros(3))
    turn = pin.exp3(np.array([0.1, -0.05, 0.15]))
    begin = stp.inverse_kinematics(chain, pin.SE3(turn @ home.rotation, home.translation))
    controller = stp.control.ComputedTorque(chain, reference, kp=400.0, kd=40.0)
    run = stp.simulate(chain, begin.q, np.zeros(chain.nv), controller, duration=0.1, dt=2e-3)
    angle = np.array([np.linalg.norm(pin.log3(R @ home.rotation.T)) for R in run.platform.rotation])
    # About one fixed axis, the rotation vector obeys the error equation exactly.
    expected = angle[0] * (1 + 20 * run.time) * np.exp(-20 * run.time)
    np.testing.assert_allclose(angle, expected, rtol=0, atol=1e-6)


def test_leg_pid_tracks_and_its_integral_removes_the_sag() -> None:
    chain = robot("stewart")
    home = stp.platform_pose(chain, chain.q_home)
    reference = partial(stp.motions.sinusoidal_motion, home=home, amplitude=np.zeros(3))
    rest = np.zeros(chain.nv)
    sag = {}
    for ki in (0.0, 2e6):
        controller = stp.control.LegPID(chain, reference, kp=1e5, kd=3e3, ki=ki)
        run = stp.simulate(chain, chain.q_home, rest, controller, duration=0.5, dt=2.5e-3)
        assert run.success
        sag[ki] = abs(run.platform.position[-1, 2] - home.translation[2])
    # 50 N per leg on 1e5 N/m, legs inclined.
    assert 2e-4 < sag[0.0] < 1e-3
    assert sag[2e6] < sag[0.0] / 50


@pytest.mark.parametrize("name", ["four_bar", "five_bar", "rpr_planar"])
def test_leg_pid_follows_platforms_with_few_freedoms(name: str) -> None:
    """A platform on a curve cannot move without centripetal acceleration, and is not asked to."""
    asked = case(name)
    chain, t = asked.chain, 0.1
    controller = stp.control.LegPID(chain, lambda times: asked.motion(1.0, tuple(times)), kp=100.0, kd=7.0)
    w = 2 * np.pi * asked.frequency
    away, rate = asked.amplitude(1.0) * np.sin(w * t), asked.amplitude(1.0) * w * np.cos(w * t)
    effort = controller(t, chain.q_home, np.zeros(chain.nv))
    np.testing.assert_allclose(
        effort, 100.0 * away + 7.0 * rate, rtol=1e-9
    )  # round-off of inverse kinematics


def test_the_integral_stops_at_its_limit() -> None:
    chain = robot("stewart")
    controller = stp.control.LegPID(chain, composite(chain), ki=10.0, integral_limit=5.0)
    q = chain.q_home.copy()
    q[chain.motor_q_index] -= 0.01  # too short: the error is positive
    assert (controller.state_rate(0.0, q, np.zeros(chain.nv), np.full(6, 0.4)) > 0).all()
    assert (controller.state_rate(0.0, q, np.zeros(chain.nv), np.full(6, 0.5)) == 0).all()
    assert (controller.state_rate(0.0, q, np.zeros(chain.nv), np.full(6, -0.5)) > 0).all()


def test_models_cost_what_they_ignore() -> None:
    chain = robot("stewart")
    reference = composite(chain)
    state = start(chain, reference)
    errors = {}
    for model in ("full", "point_mass"):
        controller = stp.control.LegPID(
            chain, reference, feedforward=stp.control.Feedforward(chain, reference, model)
        )
        run = stp.simulate(chain, state.q, state.v, controller, duration=0.06, dt=2e-3)
        errors[model] = rms_error(run, reference)[0]
    assert errors["full"] < 1e-7
    assert errors["point_mass"] > 100 * errors["full"]


def test_point_mass_is_exact_for_the_machine_it_believes_in() -> None:
    # S0.9a: legs without mass, platform a point.
    chain = stp.massless_legs(robot("stewart"), point_platform=True)
    reference = composite(chain)
    state = start(chain, reference)
    force = stp.control.Feedforward(chain, reference, "point_mass")(0.0, state.q, state.v)
    exact = stp.inverse_dynamics(chain, state.q, state.v, state.a).tau_motor
    np.testing.assert_allclose(force, exact, rtol=1e-11)


def test_full_feedforward_is_inverse_dynamics_for_any_chain(rng: np.random.Generator) -> None:
    chain = four_bar()
    state_v, _ = random_motion(chain, rng, chain.q_home)
    controller = stp.control.GravityCompensation(chain)
    rest = np.zeros(chain.nv)
    expected = stp.inverse_dynamics(chain, chain.q_home, rest, rest).tau_motor
    np.testing.assert_allclose(controller(0.0, chain.q_home, state_v), expected, rtol=0, atol=1e-12)


def test_sampling_and_encoders(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    reference = composite(chain)
    state = start(chain, reference)
    inner = stp.control.ComputedTorque(chain, reference)
    sampled = stp.control.SampledController(chain, inner, rate=250.0)
    run = stp.simulate(chain, state.q, state.v, sampled, duration=0.1, dt=2e-3)
    # Held for two steps.
    assert (run.tau_motor[0:-1:2] == run.tau_motor[1::2]).all()
    assert np.abs(np.diff(run.tau_motor[::2], axis=0)).min() > 0
    coarse = stp.control.SampledController(chain, inner, rate=250.0, resolution=1e-4)
    q, _ = coarse.measure(state.q, state.v)
    ticks = q[chain.motor_q_index] / 1e-4
    np.testing.assert_allclose(ticks, np.round(ticks), rtol=0, atol=1e-8)
    assert np.abs(stp.loop_gap(chain, q)).max() < 1e-12
    with pytest.raises(stp.errors.InputError, match="multiple"):
        stp.simulate(chain, state.q, state.v, sampled, duration=0.1, dt=2.5e-3)


def test_a_sampled_integral_survives_a_stop() -> None:
    chain = robot("stewart")
    reference = composite(chain)
    state = start(chain, reference)
    pid = stp.control.SampledController(chain, stp.control.LegPID(chain, reference, ki=1e5), rate=250.0)
    whole = stp.simulate(chain, state.q, state.v, pid, duration=0.06, dt=2e-3)
    # Between two samples, and on one: it must not act twice.
    for cut in (0.026, 0.028):
        first = stp.simulate(chain, state.q, state.v, pid, duration=cut, dt=2e-3)
        rest = stp.simulation.resume(chain, first.final_state, pid, duration=0.06 - cut)
        np.testing.assert_allclose(rest.q[-1], whole.q[-1], rtol=0, atol=1e-12)
        np.testing.assert_array_equal(rest.tau_motor[-1] != 0, True)
    assert rest.final_state.controller.any()
    with pytest.raises(stp.errors.InputError, match="another"):
        stp.simulation.resume(chain, first.final_state, duration=0.1)


def test_wrong_models_are_refused() -> None:
    chain = robot("stewart")
    with pytest.raises(stp.errors.InputError, match="model"):
        stp.control.ComputedTorque(chain, composite(chain), model="rigid")
    with pytest.raises(stp.errors.InputError, match="kp"):
        stp.control.LegPID(chain, composite(chain), kp=-1.0)
    with pytest.raises(stp.errors.UnsupportedError):
        stp.control.Feedforward(four_bar(), composite(four_bar()), "point_mass")
