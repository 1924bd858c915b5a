"""Wrenches from outside in motions: what they ask of the motors, and what a simulated chain does under them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError
from stewart_pin.state.outside import as_wrenches, outside_power
from tests.closed_states import close, random_configuration, random_motion, robot
from tests.retelling.case import case


def swaying() -> stp.motions.PlatformSamples:
    return case("stewart").motion(0.5, tuple(np.linspace(0, 1, 7)))


# --- what a motion asks of the motors ---


def test_the_closed_form_carries_what_acts_on_the_platform(rng: np.random.Generator) -> None:
    tool = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
    plain = robot("stewart")
    chain = stp.with_platform(plain, "platform", placement=tool, name="tool")
    samples = chain_motion(chain, swaying(), tool)
    wrenches = {"tool": 50 * rng.normal(size=6), "platform": 50 * rng.normal(size=(7, 6)), "base": np.ones(6)}
    demand = stp.motor_demand(chain, samples, wrenches=wrenches)
    assert demand.method == "closed_form"
    assert [place.link for place in demand.wrenches.places] == list(wrenches)
    for k in range(len(samples)):
        state = stp.platform_motion(chain, samples.pose(k), samples.twist[k], samples.acceleration[k])
        now = {**wrenches, "platform": wrenches["platform"][k]}
        close(demand.efforts[k], stp.inverse_dynamics(state, wrenches=now).tau_motor, 1e-10)


def chain_motion(
    chain: stp.ClosedChain, samples: stp.motions.PlatformSamples, tool: pin.SE3
) -> stp.motions.PlatformSamples:
    """Follow with a frame that is fixed to the platform what the platform does."""
    poses = [samples.pose(k) * tool for k in range(len(samples))]
    arms = [samples.rotation[k] @ tool.translation for k in range(len(samples))]
    twist, acceleration = samples.twist.copy(), samples.acceleration.copy()
    for k, arm in enumerate(arms):
        omega, alpha = samples.twist[k, 3:], samples.acceleration[k, 3:]
        twist[k, :3] += np.cross(omega, arm)
        acceleration[k, :3] += np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm))
    return stp.motions.PlatformSamples(
        samples.time,
        np.array([pose.translation for pose in poses]),
        np.array([pose.rotation for pose in poses]),
        twist,
        acceleration,
    )


@pytest.mark.parametrize("name", ["stewart", "delta", "five_bar"])
def test_what_acts_elsewhere_is_computed_state_by_state(name: str, rng: np.random.Generator) -> None:
    chain = robot(name)
    samples = swaying() if name == "stewart" else case(name).motion(0.5, tuple(np.linspace(0, 1, 5)))
    others = {chain.platform, chain.mechanism.root}
    body = next(link.name for link in chain.mechanism.links if link.inertia and link.name not in others)
    gust, held = rng.normal(size=6), rng.normal(size=6)
    demand = stp.motor_demand(
        chain, samples, wrenches=lambda t: {chain.platform: np.cos(t) * gust, body: held} if t else None
    )
    assert demand.method == "one_state"
    assert not demand.wrenches.values[0].any()
    same = stp.motor_demand(chain, samples, wrenches={
        chain.platform: np.where(samples.time > 0, np.cos(samples.time), 0.0)[:, None] * gust,
        body: np.where(samples.time > 0, 1.0, 0.0)[:, None] * held,
    })  # fmt: skip
    close(same.efforts, demand.efforts, 1e-12)
    q = chain.q_home
    for k, t in enumerate(samples.time):
        motion = samples.pose(k), samples.twist[k], samples.acceleration[k]
        state = stp.platform_motion(chain, *motion, q_guess=q, limits=False)
        now = {chain.platform: np.cos(t) * gust, body: held} if t else {}
        close(demand.efforts[k], stp.inverse_dynamics(state, wrenches=now).tau_motor, 1e-10)
        q = state.q


@pytest.mark.parametrize("name", ["five_bar", "four_bar"])
def test_kernels_carry_them_in_a_demand(name: str, rng: np.random.Generator) -> None:
    pytest.importorskip("casadi")
    chain, samples = robot(name), case(name).motion(0.5, tuple(np.linspace(0, 1, 5)))
    body = [link.name for link in chain.mechanism.links if link.inertia is not None][-1]
    wrenches = {
        chain.platform: rng.normal(size=(5, 6)),
        body: rng.normal(size=6),
        chain.mechanism.root: np.ones(6),
    }
    demand = stp.motor_demand(chain, samples, wrenches=wrenches, kernels=True)
    assert demand.method == "kernels"
    assert demand.wrenches.links == tuple(wrenches)
    close(demand.efforts, stp.motor_demand(chain, samples, wrenches=wrenches, kernels=False).efforts, 1e-10)
    found = stp.compare_methods(chain, samples, wrenches=wrenches, kernels=True)
    assert "kernels" in found.forces
    assert found.agreement["agreement"] <= 1e-9


def test_a_demand_refuses_what_it_cannot_carry() -> None:
    chain, samples = robot("stewart"), swaying()
    with pytest.raises(InputError, match=r"must have shape \(6,\) or \(7, 6\), got \(3, 6\)"):
        stp.motor_demand(chain, samples, wrenches={"platform": np.zeros((3, 6))})
    with pytest.raises(InputError, match="did you mean 'platform'"):
        stp.motor_demand(chain, samples, wrenches=lambda t: {"platfrom": np.zeros(6)})
    with pytest.raises(InputError, match="must return"):
        stp.motor_demand(chain, samples, wrenches=lambda t: np.zeros(6))
    assert stp.motor_demand(chain, samples, wrenches={}).wrenches is None


def test_a_fit_leaves_room_for_the_wrenches() -> None:
    """Pressed upon, motors that have less effort left allow less of a motion; the limit that binds is an effort."""
    chain = stp.with_limits(robot("five_bar"), {name: {"effort": 1.0} for name in robot("five_bar").motors})
    strong = case("five_bar").motion(1.0, tuple(np.linspace(0, 1, 5)))
    peak = np.abs(stp.motor_demand(chain, strong).efforts).max()
    chain = stp.with_limits(chain, {name: {"effort": 1.01 * peak} for name in chain.motors})
    motion = lambda scale: case("five_bar").motion(scale, tuple(np.linspace(0, 1, 5)))  # noqa: E731
    assert stp.fit_to_limits(chain, motion).scale == 1.0
    push = {chain.platform: 0.05 * peak / chain.length_scale * np.ones(6)}
    fit = stp.fit_to_limits(chain, motion, wrenches=push)
    assert 0.1 < fit.scale < 0.99
    assert fit.binding.limit == "effort"
    assert np.abs(fit.demand.efforts).max() <= 1.01 * peak * (1 + 1e-6)
    assert fit.demand.wrenches is not None


def test_every_method_of_a_comparison_takes_them(rng: np.random.Generator) -> None:
    chain, samples = robot("stewart"), case("stewart").motion(0.5, (0.0, 0.1, 0.2))
    found = stp.compare_methods(chain, samples, wrenches={"platform": 50 * rng.normal(size=6)})
    assert set(found.forces) == {"pinocchio", "constraint_matrix", "closed_form"}
    assert max(found.agreement.values()) <= 1e-10
    close(sum(found.contributions.values()), found.forces["pinocchio"], 1e-10)
    assert np.abs(found.contributions["wrenches"]).max() > 1.0
    legs = stp.compare_methods(chain, samples, wrenches={"leg1_lower": 50 * rng.normal(size=6)})
    assert set(legs.forces) == {"pinocchio", "constraint_matrix"}
    assert max(legs.agreement.values()) <= 1e-10
    assert "no closed form: wrenches act on other links than the platform" in legs.notes


@pytest.mark.parametrize("where", ["platform", "leg1_lower"])
def test_controllers_reckon_with_a_known_wrench(where: str, rng: np.random.Generator) -> None:
    chain, times = robot("stewart"), (0.1,)
    reference = lambda t: case("stewart").motion(0.5, tuple(t))  # noqa: E731
    want = reference(times)
    state = stp.platform_motion(chain, want.pose(0), want.twist[0], want.acceleration[0])
    known = {where: 50 * rng.normal(size=6)}
    light = stp.massless_legs(chain, point_platform=True)
    for model, moved in (("full", chain), ("point_mass", light)):
        needed = stp.inverse_dynamics(moved, state.q, state.v, state.a, wrenches=known).tau_motor
        for make in (stp.control.Feedforward, stp.control.ComputedTorque):
            for given in (known, lambda t, s: known):
                control = make(chain, reference, model=model, wrenches=given)
                close(control(0.1, state.q, state.v), needed, 1e-8)
    with pytest.raises(InputError, match="did you mean"):
        stp.control.ComputedTorque(chain, reference, wrenches={where + "x": np.zeros(6)})


# --- what a chain does under them ---


@pytest.mark.parametrize(
    ("name", "method"),
    [("stewart", "fixed"), ("five_bar", "fixed"), ("arm_3r_spatial", "fixed"), ("arm_3r_spatial", "DOP853")],
)
def test_work_from_outside_becomes_energy(name: str, method: str, rng: np.random.Generator) -> None:
    chain = robot(name)
    q = random_configuration(chain, rng, 0.05)
    body = next(link.name for link in chain.mechanism.links if link.inertia is not None)
    weight = 9.81 * sum(inertia.mass for inertia in chain.model.inertias)
    force = weight * np.repeat([1, chain.length_scale], 3) * rng.normal(size=(2, 6))

    def push(t: float, state: stp.State) -> dict[str, np.ndarray]:
        drag = -0.2 * force[0] * np.tanh(state.twist)  # what depends on the motion
        return {chain.platform: np.cos(9 * t) * force[0] + drag, body: 0.1 * force[1]}

    run = stp.simulate(
        chain, q, np.zeros(chain.nv), duration=0.05, dt=1e-3, wrenches=push, method=method, kernels=False,
        record_rate=200,
    )  # fmt: skip
    assert run.success, run.reason
    account = run.energy - run.outside + run.dissipated - run.supplied
    assert np.abs(run.outside).max() > 1e-3 * weight * chain.length_scale
    # The fixed step is of order four; DOP853 keeps 1e-9.
    assert np.abs(account - account[0]).max() <= 1e-6 * np.abs(run.outside).max()
    for k, t in enumerate(run.time):
        state = chain.at(run.q[k], run.v[k])
        outside = as_wrenches(chain, push(t, state))
        close(run.wrenches.values[k], outside.values, 1e-9)
        # And the recorded acceleration is that of the verb of one state.
        motion = stp.forward_dynamics(state, tau_motor=run.tau_motor[k], wrenches=outside)
        found = run.platform.acceleration[k] - state.platform_bias
        close(found, state.P @ motion.a, 1e-6)
        assert np.isfinite(outside_power(state, outside))


def test_weight_from_outside_is_more_gravity() -> None:
    """Half of each body's weight again, at its centre of mass wherever that goes, is a gravity half as strong again."""
    chain = robot("arm_3r_spatial")
    heavier = stp.load("arm_3r_spatial", gravity=1.5 * chain.gravity)

    def weigh(t: float, state: stp.State) -> dict[str, np.ndarray]:
        data, found = pin.Data(chain.model), {}
        pin.framesForwardKinematics(chain.model, data, state.q)
        for link in chain.mechanism.links:
            if link.inertia is not None:
                turn = data.oMf[chain.model.getFrameId(link.name, pin.FrameType.BODY)].rotation
                force = 0.5 * link.inertia.mass * chain.gravity
                found[link.name] = np.concatenate([force, np.cross(turn @ link.inertia.lever, force)])
        return found

    given = np.array([0.2, 0.5, -0.4]), np.array([0.3, -0.2, 0.1])
    how = {"duration": 0.2, "dt": 5e-3, "kernels": False}
    pushed = stp.simulate(chain, *given, wrenches=weigh, **how)
    falling = stp.simulate(heavier, *given, **how)
    close(pushed.q, falling.q, 1e-11)
    # What came from outside is the further potential energy.
    close(pushed.outside, (falling.energy[0] - falling.energy) + (pushed.energy - pushed.energy[0]), 1e-5)


def test_kernels_do_not_drop_the_wrenches() -> None:
    pytest.importorskip("casadi")
    chain = robot("four_bar")
    push = {chain.platform: [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]}
    given = chain, chain.q_home, np.zeros(chain.nv)
    runs = [
        stp.simulate(*given, duration=0.02, dt=1e-3, wrenches=push, kernels=kernels)
        for kernels in (False, True)
    ]
    close(runs[1].q, runs[0].q, 1e-9)
    free = stp.simulate(*given, duration=0.02, dt=1e-3, kernels=True)
    assert np.abs(free.q[-1] - runs[1].q[-1]).max() > 1e-4


def test_a_run_goes_on_under_the_same_wrenches() -> None:
    chain = robot("four_bar")
    push = lambda t, state: {chain.platform: np.cos(50 * t) * np.ones(6)}  # noqa: E731
    given = {"wrenches": push, "kernels": False}
    whole = stp.simulate(chain, chain.q_home, np.zeros(chain.nv), duration=0.04, dt=2e-3, **given)
    first = stp.simulate(chain, chain.q_home, np.zeros(chain.nv), duration=0.02, dt=2e-3, **given)
    second = stp.simulation.resume(chain, first.final_state, duration=0.02, **given)
    assert np.array_equal(second.q[-1], whole.q[-1])
    assert second.outside[-1] == whole.outside[-1]
    assert second.outside[0] == first.outside[-1] != 0.0


def test_motors_that_know_the_wrench_hold_against_it(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    wrenches = {"platform": 50 * rng.normal(size=6), "leg2_upper": 20 * rng.normal(size=6)}
    hold = stp.control.GravityCompensation(chain, wrenches=wrenches)
    run = stp.simulate(
        chain,
        chain.q_home,
        np.zeros(chain.nv),
        hold,
        duration=0.02,
        dt=2e-3,
        wrenches=wrenches,
        kernels=False,
    )
    assert np.abs(run.v).max() <= 1e-9
    ignorant = stp.control.GravityCompensation(chain)
    moved = stp.simulate(
        chain,
        chain.q_home,
        np.zeros(chain.nv),
        ignorant,
        duration=0.02,
        dt=2e-3,
        wrenches=wrenches,
        kernels=False,
    )
    assert np.abs(moved.v).max() > 1e-3


def test_a_run_says_what_its_wrenches_lack() -> None:
    chain = robot("four_bar")
    given = chain, chain.q_home, np.zeros(chain.nv)
    with pytest.raises(InputError, match="did you mean"):
        stp.simulate(*given, duration=0.01, wrenches={chain.platform + "x": np.zeros(6)})
    with pytest.raises(InputError, match="the wrenches failed at 0 s: wrenches must return"):
        stp.simulate(*given, duration=0.01, wrenches=lambda t, state: np.zeros(6))

    def breaks(t: float, state: stp.State) -> dict[str, np.ndarray]:
        return {chain.platform: np.full(6, 0.0 if t < 0.005 else np.nan)}

    run = stp.simulate(*given, duration=0.01, dt=1e-3, wrenches=breaks, kernels=False)
    assert not run.success
    assert "wrenches failed at 0.005 s" in run.reason
    assert [event.kind for event in run.events] == ["wrenches"]


def test_a_spin_without_inertia_is_not_pushed() -> None:
    chain = stp.massless_legs(robot("stewart_sps"))
    rest = np.zeros(chain.nv)
    base, platform = chain.leg_points()
    along = chain.at(chain.q_home).pose.act(platform[0]) - base[0]
    push = {"leg1_upper": [0, 0, 0, *along]}
    given = {"duration": 0.01, "dt": 1e-3, "kernels": False}
    with pytest.raises(InputError, match=r"motion leg1_z .1, and wrenches, springs or friction push it"):
        stp.simulate(chain, chain.q_home, rest, wrenches=push, **given)
    run = stp.simulate(chain, chain.q_home, rest, wrenches=lambda t, s: push if t > 0.004 else None, **given)
    assert not run.success
    assert "and wrenches, springs or friction push it" in run.reason
    assert run.time[-1] >= 0.003


def test_motion_given_moves_on_under_pushes_of_its_own(rng: np.random.Generator) -> None:
    """Efforts of inverse dynamics under a wrench, held over a short step: the motion asked for begins."""
    chain = robot("five_bar")
    q = random_configuration(chain, rng, 0.05)
    v, a = random_motion(chain, rng, q)
    push = {chain.platform: rng.normal(size=6)}
    tau = stp.inverse_dynamics(chain, q, v, a, wrenches=push).tau_motor
    run = stp.simulate(chain, q, v, lambda t, q, v: tau, duration=1e-6, dt=1e-6, wrenches=push, kernels=False)
    close((run.v[1] - run.v[0]) / 1e-6, a, 1e-3)
