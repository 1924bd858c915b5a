"""Dry friction sticks exactly and slips as closed forms say, whatever has it and however steps are taken."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import brentq

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import Joint, JointKind, Link, Loop, Mechanism
from stewart_pin.motion.simulation import steppers
from tests.closed_states import random_motion, robot, slow_but_for_few
from tests.mechanisms import ONE, Y, at, four_bar, rod
from tests.motion.simulation.test_joint_physics import sled, unexplained

WAYS = [("fixed", 2e-3), ("DOP853", 0.05), ("Radau", 0.05)]
RUBBING_FOUR_BAR = {
    "crank_motor": {"friction": 0.3},
    "elbow": {"friction": 0.1},
    "rocker_hinge": {"friction": 0.15},
    "pin": {"friction": 0.2},
}


def slope(angle: float, **own: float) -> stp.ClosedChain:
    """Two kilograms on a slide that falls towards x."""
    chain = sled(**own)
    model = chain.model.copy()
    model.gravity.linear = 9.81 * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    return replace(chain, model=model)


@pytest.mark.parametrize(("method", "dt"), WAYS)
def test_a_block_on_a_slope_below_its_limit_stays_to_the_last_bit(method: str, dt: float) -> None:
    pull = 2.0 * 9.81 * np.sin(0.3)
    held = slope(0.3, friction=pull * (1 + 1e-6))
    run = stp.simulate(held, [0.1], [0.0], duration=0.3, dt=dt, method=method)
    assert run.success, run.reason
    assert (run.q == 0.1).all()
    assert (run.v == 0.0).all()
    assert run.dissipated[-1] == 0.0
    loose = slope(0.3, friction=pull * 0.9)
    run = stp.simulate(loose, [0.1], [0.0], duration=0.3, dt=dt, method=method)
    np.testing.assert_allclose(run.q[:, 0], 0.1 + 0.1 * pull / 2 * run.time**2 / 2, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("method", "dt"), [("fixed", 1e-3), ("DOP853", 0.05)])
def test_a_mass_on_a_spring_turns_and_stops_where_its_closed_form_does(method: str, dt: float) -> None:
    m, k, F, x0 = 2.0, 5000.0, 400.0, 0.5
    run = stp.simulate(sled(stiffness=k, friction=F), [x0], [0.0], duration=0.25, dt=dt, method=method)
    assert run.success, run.reason
    omega, d = np.sqrt(k / m), F / k
    # Half swings about ±d in turn, each 2 d shorter than the last, until the spring is weaker than friction.
    half = np.floor(omega * run.time / np.pi)
    turns = int(np.ceil((x0 - d) / (2 * d)))
    x = (-1.0) ** half * ((x0 - (2 * half + 1) * d) * np.cos(omega * run.time - half * np.pi) + d)
    x = np.where(half < turns, x, (-1.0) ** turns * (x0 - 2 * turns * d))
    # ω dt = 0.05: (ω dt)⁴ of a half metre in a thousand radians, and less by SciPy's tolerances.
    np.testing.assert_allclose(run.q[:, 0], x, rtol=0, atol=1e-6)
    assert (run.v[half >= turns] == 0.0).all()
    assert np.unique(run.q[half > turns - 0.5]).size == 1
    assert run.audit.by_friction[-1] == pytest.approx(k / 2 * (x0**2 - run.q[-1, 0] ** 2), rel=1e-6)


def force(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.array([10.0 * np.sin(2 * np.pi * t)])


def stick_and_slip(times: np.ndarray, F: float = 8.0, m: float = 2.0) -> np.ndarray:
    """Positions of a block that this force pulls: loose from F on, at rest where the impulse is used up."""
    w = 2 * np.pi
    loose = np.arcsin(F / 10) / w

    def rate(t: float) -> float:
        return (10 / w * (np.cos(w * loose) - np.cos(w * t)) - F * (t - loose)) / m

    def way(t: float) -> float:
        swing = np.cos(w * loose) * (t - loose) - (np.sin(w * t) - np.sin(w * loose)) / w
        return (10 / w * swing - F * (t - loose) ** 2 / 2) / m

    stopped = brentq(rate, 0.3, 0.6, xtol=1e-15)
    x = np.zeros(len(times))
    for k in range(int(2 * times[-1]) + 1):
        since = np.clip(times - k / 2, loose, stopped)
        x += (-1.0) ** k * np.array([way(t) for t in since])
    return x


@pytest.mark.parametrize(("method", "dt"), [("fixed", 4e-3), ("DOP853", 0.05), ("LSODA", 0.05)])
def test_a_driven_block_sticks_and_slips_as_its_closed_form(method: str, dt: float) -> None:
    run = stp.simulate(sled(friction=8.0), [0.0], [0.0], force, duration=1.0, dt=dt, method=method)
    assert run.success, run.reason
    np.testing.assert_allclose(run.q[:, 0], stick_and_slip(run.time), rtol=0, atol=1e-8)
    still = run.time < 0.147
    assert (run.q[still] == 0.0).all()
    assert unexplained(run) < 1e-7


def test_changes_within_a_step_are_found_and_keep_the_order_of_the_method() -> None:
    off = []
    for dt in (0.02, 0.01):
        run = stp.simulate(sled(friction=8.0), [0.0], [0.0], force, duration=1.0, dt=dt)
        off.append(np.abs(run.q[:, 0] - stick_and_slip(run.time)).max())
    # 2⁴; a change that is found a part of a step late would leave 2 or 4.
    assert off[1] < off[0] / 12


def test_a_pendulum_with_friction_stops_where_its_energy_says_and_stays() -> None:
    weight, F, start = 2.0 * 9.81 * 0.5, 1.0, 2.0
    body = pin.Inertia(2.0, np.array([0.0, 0.0, -0.5]), 1e-3 * np.eye(3))
    joint = Joint("hinge", JointKind.REVOLUTE, "ground", "bob", ONE, axis=Y, independent=True)
    links = (Link("ground"), Link("bob", body))
    chain = build_chain(Mechanism("pendulum", links, (joint,), (), platform="bob"))
    chain = stp.with_joint_physics(chain, {"hinge": {"friction": F}})
    run = stp.simulate(chain, [start], [0.0], duration=8.0, dt=2e-2)
    assert run.success, run.reason
    # From one rest to the next the weight loses what friction takes: weight (cos b - cos a) = F |a - b|.
    angle = start
    while weight * abs(np.sin(angle)) > F:
        loss = lambda b, a=angle: weight * (np.cos(b) - np.cos(a)) - F * abs(a - b)  # noqa: E731
        low = np.sign(angle) * np.arcsin(F / weight)  # the fastest point
        angle = brentq(loss, low, -angle)
    assert run.q[-1, 0] == pytest.approx(angle, abs=1e-5)
    end = run.q[-1]
    assert (run.q[run.time > 7.0] == end).all()
    on = stp.simulation.resume(chain, run.final_state, duration=1.0)
    assert (on.q == end).all()


@pytest.mark.parametrize("joint", RUBBING_FOUR_BAR)
def test_a_four_bar_stops_by_friction_anywhere_in_its_loop(joint: str) -> None:
    chain = stp.with_joint_physics(four_bar(JointKind.REVOLUTE), {joint: RUBBING_FOUR_BAR[joint]})
    v = 0.1 * random_motion(chain, np.random.default_rng(1), chain.q_home)[0]
    run = stp.simulate(chain, chain.q_home, v, duration=0.2, dt=5e-3)
    assert run.success, run.reason
    assert run.audit.by_friction[-1] == pytest.approx(run.energy[0], rel=1e-9)
    assert (run.v[-1] == 0.0).all()
    assert (run.q[-1] == run.q[-10]).all()


@pytest.mark.parametrize("method", slow_but_for_few(["fixed", "DOP853"], ["fixed"]))
def test_redundant_friction_in_a_loop_holds_what_it_can_hold_together(method: str) -> None:
    chain = stp.with_joint_physics(four_bar(JointKind.REVOLUTE), RUBBING_FOUR_BAR)
    least, most = stp.inverse_dynamics(chain, chain.q_home, chain.rest, chain.rest).band[0]
    for share, moves in ((0.9999, False), (1.0001, True)):
        for effort in (share * least, share * most):
            pull = lambda t, q, v, f=effort: np.array([f])  # noqa: E731
            run = stp.simulate(chain, chain.q_home, chain.rest, pull, duration=0.05, dt=0.01, method=method)
            assert run.success, run.reason
            assert (run.q != run.q[0]).any() == moves
            assert np.sign(run.v[-1, 0]) == moves * np.sign(effort)
    # All at once: four joints stop together, and start together.
    wave = lambda t, q, v: np.array([1.6 * most * np.sin(20 * t)])  # noqa: E731
    run = stp.simulate(chain, chain.q_home, chain.rest, wave, duration=0.5, dt=5e-3, method=method)
    assert run.success, run.reason
    still = (run.v == 0.0).all(axis=1)
    assert still.sum() > 10
    assert (~still).sum() > 10
    assert unexplained(run) < 1e-6 * run.dissipated[-1]


@pytest.mark.parametrize("method", slow_but_for_few(["fixed", "DOP853"], ["fixed"]))
def test_what_is_stuck_in_a_moving_mechanism_does_not_creep(method: str) -> None:
    chain = stp.with_joint_physics(robot("five_bar"), {"left_hip": {"friction": 2.0}})
    swing = lambda t, q, v: np.array([0.0, 0.02 * np.cos(9 * t)])  # noqa: E731
    options = {"duration": 0.2, "dt": 0.01, "method": method}
    run = stp.simulate(chain, chain.q_home, chain.rest, swing, **options)
    assert run.success, run.reason
    assert np.abs(run.q[-1] - run.q[0]).max() > 0.05
    assert (run.q[:, 0] == run.q[0, 0]).all()
    # And a coordinate that no configuration holds: of the hinge that closes the loop.
    chain = stp.with_joint_physics(robot("five_bar"), {"tip_pin": {"friction": 0.2}})
    run = stp.simulate(chain, chain.q_home, chain.rest, swing, **options)
    effects = stp.with_joint_physics(chain, {"tip_pin": {"damping": 1.0}}).joint_effects
    angles = [effects.positions(chain.at(q))[0] for q in run.q]
    assert np.abs(run.q[-1] - run.q[0]).max() > 0.05
    assert np.ptp(angles) < 1e-11


def test_the_account_closes_to_the_order_of_the_steps(rng: np.random.Generator) -> None:
    physics = {f"leg{k}": {"friction": 20.0, "damping": 5.0} for k in range(1, 7)}
    chain = stp.with_joint_physics(robot("stewart"), physics | {"leg2_x": {"friction": 0.5}})
    v = 0.3 * random_motion(chain, rng, chain.q_home)[0]
    hold = stp.control.GravityCompensation(chain)
    left = []
    for dt in (0.02, 0.005):
        run = stp.simulate(chain, chain.q_home, v, hold, duration=0.1, dt=dt)
        assert run.success, run.reason
        left.append(unexplained(run))
    # 4⁴; what sticks divides steps unevenly.
    assert left[1] < left[0] / 30
    assert left[1] < 1e-8 * run.audit.by_friction[-1]


@pytest.mark.parametrize("method", slow_but_for_few(["fixed", "RK45"], ["fixed"]))
def test_a_run_with_friction_goes_on_to_the_same_bits(method: str) -> None:
    dt = {"fixed": 5e-3, "RK45": 0.02}[method]
    chain = stp.with_joint_physics(four_bar(JointKind.REVOLUTE), RUBBING_FOUR_BAR)
    wave = lambda t, q, v: np.array([0.8 * np.sin(60 * t)])  # noqa: E731
    start = chain, chain.q_home, chain.rest, wave
    whole = stp.simulate(*start, duration=8 * dt, dt=dt, method=method)
    assert 0 < (whole.v[:, 0] == 0).sum() < 9
    for cut in (1, 4):
        first = stp.simulate(*start, duration=cut * dt, dt=dt, method=method)
        rest = stp.simulation.resume(chain, first.final_state, wave, duration=(8 - cut) * dt, method=method)
        for field in ("q", "v", "energy", "supplied", "dissipated"):
            np.testing.assert_array_equal(getattr(rest, field), getattr(whole, field)[cut:], err_msg=field)


def test_dry_friction_of_motors_is_that_of_their_joints() -> None:
    motors = stp.simulation.Motors(coulomb=5.0, viscous=2.0)
    a = stp.simulate(sled(friction=3.0), [0.0], [0.0], force, duration=0.6, dt=5e-3, motors=motors)
    b = stp.simulate(sled(friction=8.0, damping=2.0), [0.0], [0.0], force, duration=0.6, dt=5e-3)
    np.testing.assert_allclose(a.q, b.q, rtol=0, atol=1e-14)
    assert (a.v == 0.0).any()
    np.testing.assert_allclose(a.audit.by_friction, 3 / 8 * b.audit.by_friction, rtol=1e-12)
    others = b.audit.by_damping + 5 / 8 * b.audit.by_friction
    np.testing.assert_allclose(a.audit.by_motors, others, rtol=1e-12)
    assert a.audit.by_damping[-1] == 0.0


def test_friction_that_changes_without_end_is_an_error_with_its_joint(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(steppers, "_MOST_CHANGES", 1)
    for method in ("fixed", "RK45"):
        shake = lambda t, q, v: np.array([10.0 * np.sin(200 * t)])  # noqa: E731
        run = stp.simulate(sled(friction=8.0), [0.0], [0.0], shake, duration=0.2, dt=0.1, method=method)
        assert not run.success
        assert "slide sticks and slips" in run.reason
        assert "smaller dt" in run.reason


def test_a_ball_stuck_about_one_axis_needs_fixed_steps(rng: np.random.Generator) -> None:
    body = pin.Inertia(1.0, np.zeros(3), 0.1 * np.eye(3))
    slide = Joint("slide", JointKind.PRISMATIC, "ground", "sled", ONE, independent=True)
    ball = Joint("ball", JointKind.SPHERICAL, "sled", "top", ONE)
    links = (Link("ground"), Link("sled", body), Link("top", body))
    chain = build_chain(Mechanism("top", links, (slide, ball), (), platform="sled"))
    model = chain.model.copy()
    model.gravity.linear = np.zeros(3)
    chain = stp.with_joint_physics(replace(chain, model=model), {"ball": {"friction": 0.2}})
    v = np.array([0.0, 0.0, 0.0, 3.0])
    run = stp.simulate(chain, chain.q_home, v, duration=2.0, dt=5e-3)
    assert run.success, run.reason
    # A spin about one axis: ω = 3 - 0.2 t / 0.1 until it is used up.
    np.testing.assert_allclose(run.v[:, 3], np.maximum(3.0 - 2.0 * run.time, 0.0), rtol=0, atol=1e-12)
    with pytest.raises(stp.errors.UnsupportedError, match=r"some axes alone.*method='fixed'"):
        stp.simulate(chain, chain.q_home, v, duration=0.1, dt=0.05, method="RK45")


TRACKED = {
    "sled": ("slide",),
    "stewart": ("leg1", "leg2", "leg3", "leg4", "leg5", "leg6", "leg2_x"),
}


@pytest.mark.parametrize("name", ["sled", pytest.param("stewart", marks=pytest.mark.slow)])
@pytest.mark.parametrize("controller", ["ComputedTorque", "Feedforward"])
def test_a_controller_that_knows_springs_and_friction_follows_without_error(
    controller: str, name: str
) -> None:
    # Its efforts jump where the motion turns, which neither side of the jump may see of the other.
    own = {"friction": 5.0, "damping": 20.0, "stiffness": 300.0, "rest": 0.8, "armature": 2.0}
    bare = sled() if name == "sled" else robot(name)
    chain = stp.with_joint_physics(bare, dict.fromkeys(TRACKED[name], own))
    home = stp.platform_pose(chain, chain.q_home)
    amplitude = (0.03, 0.0, 0.0) if name == "sled" else (0.03, 0.02, 0.02)
    reference = partial(
        stp.motions.sinusoidal_motion, home=home, amplitude=amplitude, frequency=(1.0, 0.7, 1.3)
    )
    start = reference(np.zeros(1))
    state = stp.platform_motion(chain, start.pose(0), start.twist[0], start.acceleration[0])
    follow = getattr(stp.control, controller)(chain, reference)
    off = []
    for dt in (0.02, 0.01):
        run = stp.simulate(chain, state.q, state.v, follow, duration=0.4, dt=dt)
        assert run.success, run.reason
        off.append(np.abs(run.platform.position - reference(run.time).position).max())
        assert run.audit.by_friction[-1] > 0.1
    assert off[1] < off[0] / 10
    assert off[1] < 1e-6


def test_friction_of_a_rocker_turns_with_it_at_dead_centres() -> None:
    # There its rate is zero whatever the crank does, so that friction has no hold, and the crank goes on.
    chain = stp.with_joint_physics(four_bar(JointKind.REVOLUTE), {"rocker_hinge": {"friction": 0.3}})
    motion = np.linalg.svd(chain.at(chain.q_home).rows)[2][-1] * chain.tangent_scale
    push = lambda t, q, v: np.array([3.0 * (12.0 - v[0])])  # noqa: E731
    run = stp.simulate(chain, chain.q_home, 12.0 * motion / motion[0], push, duration=0.6, dt=5e-3)
    assert run.success, run.reason
    assert run.q[-1, 0] - run.q[0, 0] > 6.0
    # Friction times the way of the rocker, to and fro: from the ends of its swing and of the run.
    rocker = run.q[:, 2]
    assert run.audit.by_friction[-1] == pytest.approx(0.3 * np.abs(np.diff(rocker)).sum(), rel=1e-3)
    assert unexplained(run) < 1e-3 * run.audit.by_friction[-1]


def test_friction_where_loops_leave_no_rate_disturbs_nothing(rng: np.random.Generator) -> None:
    bare = robot("rpr_planar")
    lift = {"platform_pose": {"friction": 1e-3}}  # three of its six entries never move
    chain = stp.with_joint_physics(bare, lift)
    v = 0.3 * random_motion(bare, rng, bare.q_home)[0]
    run = stp.simulate(chain, chain.q_home, v, duration=0.02, dt=2e-3)
    assert run.success, run.reason
    assert unexplained(run) < 1e-8
    assert run.audit.by_friction[-1] > 0.0


def test_a_four_bar_cut_at_another_joint_sticks_and_slips_the_same() -> None:
    links = (
        Link("ground"),
        Link("crank", rod(0.3)),
        Link("coupler", rod(0.8)),
        Link("rocker", rod(0.6)),
    )
    joints = (
        Joint("crank_motor", JointKind.REVOLUTE, "ground", "crank", ONE, independent=True),
        Joint("elbow", JointKind.REVOLUTE, "crank", "coupler", at(0.3)),
        Joint("pin", JointKind.REVOLUTE, "coupler", "rocker", at(0.8)),
    )
    hinge = Loop("rocker_hinge", JointKind.REVOLUTE, "rocker", "ground", at(0.6), at(0.9))
    one = four_bar(JointKind.REVOLUTE)
    other = build_chain(Mechanism("cut", links, joints, (hinge,), platform="coupler"))
    wave = lambda t, q, v: np.array([1.2 * np.sin(20 * t)])  # noqa: E731
    found = []
    for bare in (one, other):
        chain = stp.with_joint_physics(bare, RUBBING_FOUR_BAR)
        # The rocker, told from its other end, points the other way.
        crank, elbow, rocker = one.q_home
        q = one.q_home if bare is one else np.array([crank, elbow, rocker + np.pi - crank - elbow])
        run = stp.simulate(chain, q, chain.rest, wave, duration=0.4, dt=5e-3)
        assert run.success, run.reason
        assert 5 < (run.v[:, 0] == 0).sum() < 75
        found.append(run)
    np.testing.assert_allclose(found[1].q[:, :2], found[0].q[:, :2], rtol=0, atol=1e-8)
    np.testing.assert_allclose(found[1].audit.by_friction, found[0].audit.by_friction, rtol=0, atol=1e-8)
