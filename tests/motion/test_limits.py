"""One judge of limits, asked by every verb: what it says of one of them holds in the others."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, MechanismError, UnreachableError
from stewart_pin.model.tree import KINDS
from tests.closed_states import robot
from tests.small_urdf import MOTOR, joint, link
from tests.small_urdf import robot as small_robot

TIME = np.linspace(0.0, 1.0, 101)
SWING = 0.3


@pytest.fixture(scope="module")
def hinged() -> stp.ClosedChain:
    """Limit the lower hinges of the Stewart platform to 0.3 rad to either side of home."""
    chain = robot("stewart")
    hinges = [f"leg{k}_{axis}" for k in range(1, 7) for axis in "xy"]
    at_home = {name: chain.q_home[chain.tangent_names.index(name)] for name in hinges}
    return stp.with_limits(chain, {name: {"position": (x - SWING, x + SWING)} for name, x in at_home.items()})


def sway(chain: stp.ClosedChain, amplitude: float = 0.5, frequency: float = 0.25):
    home = stp.platform_pose(chain, chain.q_home)
    return lambda k: stp.motions.sinusoidal_motion(
        TIME, home=home, amplitude=[amplitude * k, 0, 0], frequency=np.full(3, frequency)
    )


def test_a_fit_looks_at_hinges_and_holds_in_inverse_kinematics(hinged: stp.ClosedChain) -> None:
    free = stp.fit_to_limits(robot("stewart"), sway(hinged))
    fit = stp.fit_to_limits(hinged, sway(hinged))
    assert 0 < fit.scale < free.scale
    assert fit.binding is not None
    assert fit.binding.limit == "stroke" and fit.binding.motor.endswith(("_x", "_y"))
    assert 1 - 1e-4 < fit.binding.use <= 1 + 1e-9
    assert set(fit.looked_at["stroke"]) == {*hinged.motors, *hinged.limits.names[: hinged.nv]} - {
        f"platform_pose {axis}" for axis in ("vx", "vy", "vz", "wx", "wy", "wz")
    }
    assert fit.binding.motor in str(fit) and "looked at" in str(fit)
    assert not fit.demand.check() and not stp.limits_exceeded(fit.demand)
    for k in range(0, TIME.size, 5):
        stp.inverse_kinematics(hinged, fit.samples.pose(k))
    # A little more is too much, by the hinge that was named.
    more = stp.motor_demand(hinged, sway(hinged)(fit.scale * 1.001)).check()
    assert fit.binding.motor in {excess.joint for excess in more}
    worst = next(excess for excess in more if excess.joint == fit.binding.motor)
    with pytest.raises(UnreachableError, match=f"'{worst.joint}'"):
        at = int(np.argmin(np.abs(TIME - worst.time)))
        stp.inverse_kinematics(hinged, sway(hinged)(fit.scale * 1.001).pose(at))


def test_a_fit_holds_in_a_simulation(hinged: stp.ClosedChain) -> None:
    fit = stp.fit_to_limits(hinged, sway(hinged), margin=0.02)
    state = stp.platform_motion(
        hinged, fit.samples.pose(0), fit.samples.twist[0], fit.samples.acceleration[0]
    )
    reference = sway(hinged)(fit.scale)
    want = lambda t: stp.motions.sinusoidal_motion(  # noqa: E731
        t,
        home=stp.platform_pose(hinged, hinged.q_home),
        amplitude=[0.5 * fit.scale, 0, 0],
        frequency=[0.25] * 3,
    )
    control = stp.control.ComputedTorque(hinged, want, kp=400.0, kd=40.0)
    run = stp.simulate(hinged, state.q, state.v, control, duration=1.0, dt=1e-2).or_raise()
    np.testing.assert_allclose(run.platform.position[-1], reference.position[-1], atol=1e-3)
    assert not stp.limits_exceeded(run)
    assert not run.events
    # Without the fit the hinge is passed, and both the run and its judge name it.
    far = lambda t: stp.motions.sinusoidal_motion(  # noqa: E731
        t, home=stp.platform_pose(hinged, hinged.q_home), amplitude=[0.5, 0, 0], frequency=[0.25] * 3
    )
    start = stp.platform_motion(hinged, far([0.0]).pose(0), far([0.0]).twist[0], far([0.0]).acceleration[0])
    control = stp.control.ComputedTorque(hinged, far, kp=400.0, kd=40.0)
    run = stp.simulate(hinged, start.q, start.v, control, duration=1.0, dt=1e-2)
    named = {excess.joint for excess in stp.limits_exceeded(run)}
    assert fit.binding is not None and fit.binding.motor in named
    assert {event.joint for event in run.events if event.kind == "stroke"} == named


def test_kinematics_judge_alike(hinged: stp.ClosedChain) -> None:
    far = sway(hinged)(1.0).pose(TIME.size - 1)
    free = stp.inverse_kinematics(hinged, far, limits=False)
    excesses = stp.limits_exceeded(free)
    assert excesses == stp.limits_exceeded(free.state) == stp.limits_exceeded(hinged.at(free.q))
    for ask, demand in (
        (stp.inverse_kinematics, far),
        (stp.forward_kinematics, stp.motor_positions(hinged, free.q)),
    ):
        assert ask(hinged, demand, limits=False).success
        refused = ask(hinged, demand, throw=False)
        assert not refused.success and excesses[0].joint in refused.reason
        with pytest.raises(UnreachableError) as raised:
            ask(hinged, demand)
        assert set(raised.value.violations) == {excess.joint for excess in excesses}
    for excess in excesses:
        end = excess.most if excess.value > excess.most else excess.least
        assert excess.limit == end
        assert excess.by == pytest.approx(abs(excess.value - end), abs=1e-15)
        assert excess.time is None and excess.unit == "rad"


def test_a_stroke_is_kept_by_forward_kinematics() -> None:
    chain = robot("stewart")
    long = stp.motor_positions(chain, chain.q_home) + 0.9
    with pytest.raises(UnreachableError, match=r"'leg1' at .* allowed 0\.5 to 1\.8"):
        stp.forward_kinematics(chain, long)
    assert stp.forward_kinematics(chain, long, limits=False).success
    assert not len(stp.forward_kinematics(chain, long, all=True).closures)


@pytest.mark.parametrize(
    "kind",
    [
        "velocity",
        pytest.param("effort", marks=pytest.mark.slow),
        pytest.param("acceleration", marks=pytest.mark.slow),
        pytest.param("jerk", marks=pytest.mark.slow),
    ],
)
def test_every_kind_of_a_motion_is_judged(kind: str) -> None:
    chain = robot("stewart")
    motion = sway(chain, 0.05, 2.0)(1.0)
    free = stp.motor_demand(chain, motion)
    # What platform_motion gives the first leg, independently of the judge.
    leg = chain.motor_index[0]
    acceleration = np.array(
        [
            stp.platform_motion(chain, motion.pose(k), motion.twist[k], motion.acceleration[k]).a[leg]
            for k in range(TIME.size)
        ]
    )
    peak = {
        "velocity": np.abs(free.rates[:, 0]).max(),
        "effort": np.abs(free.efforts[:, 0]).max(),
        "acceleration": np.abs(acceleration).max(),
        "jerk": np.abs(np.gradient(acceleration, TIME)).max(),
    }[kind]
    close = stp.with_limits(chain, {"leg1": {kind: 0.999 * peak}})
    found = stp.motor_demand(close, motion).check()
    assert {(excess.joint, excess.kind) for excess in found} == {("leg1", kind)}
    excess = max(found, key=lambda one: one.by)
    assert abs(excess.value) == pytest.approx(peak, rel=1e-6)
    assert excess.by == pytest.approx(0.001 * peak, rel=1e-4)
    assert not stp.motor_demand(stp.with_limits(chain, {"leg1": {kind: 1.001 * peak}}), motion).check()
    fit = stp.fit_to_limits(close, sway(chain, 0.05, 2.0))
    assert fit.binding is not None and fit.binding.motor == "leg1" and fit.scale < 1
    assert not fit.demand.check()


def test_the_rate_of_a_hinge_is_judged() -> None:
    chain = robot("stewart")
    motion = sway(chain, 0.05, 2.0)(1.0)
    hinge = chain.tangent_names.index("leg1_y")
    swing = max(
        abs(stp.platform_motion(chain, motion.pose(k), motion.twist[k], motion.acceleration[k]).v[hinge])
        for k in range(TIME.size)
    )
    close = stp.with_limits(chain, {"leg1_y": {"velocity": 0.999 * swing}})
    found = stp.motor_demand(close, motion).check()
    assert {(one.joint, one.kind, one.unit) for one in found} == {("leg1_y", "velocity", "rad/s")}
    assert {name.rsplit(" ")[0] for name in stp.fit_to_limits(close, sway(chain, 0.05, 2.0)).looked_at["rate"]} == {
        *chain.motors, "leg1_y",
    }  # fmt: skip


def test_a_cable_pushes_nowhere() -> None:
    """Efforts from 0 on: in simulations, polytopes, shared efforts and the judge."""
    chain = robot("stewart")
    cables = stp.with_limits(chain, {motor: {"effort": (0, 400)} for motor in chain.motors})
    q, rest = chain.q_home, np.zeros(chain.nv)
    weight = stp.inverse_dynamics(chain, q, rest, rest).tau_motor
    assert (weight > 0).all()
    assert not stp.limits_exceeded(cables.at(q), tau_motor=weight)
    pulled = -weight
    assert len(stp.limits_exceeded(cables.at(q), tau_motor=pulled)) == 6
    run = stp.simulate(cables, q, rest, lambda t, q, v: pulled, duration=0.02, dt=1e-2)
    np.testing.assert_array_equal(run.tau_motor, 0.0)
    # Efforts (0, f) are f/2 ± f/2: the box of ± f/2, shifted by the wrench of f/2 on all legs.
    pushes = stp.polytopes.wrench_polytope(cables, q)
    box = stp.polytopes.wrench_polytope(chain, q, effort_limit=200.0)
    np.testing.assert_allclose(np.ptp(pushes.vertices, axis=0), np.ptp(box.vertices, axis=0), rtol=1e-9)
    least = pushes.vertices[:, 2].min()
    # Legs that only push lift the platform and do not pull it down; 1e-9 of their 400 N is round-off.
    assert least == pytest.approx(0.0, abs=4e-7)
    bounded = stp.inverse_dynamics(cables, q, rest, rest, effort_limit=cables.limits).tau_motor
    np.testing.assert_allclose(bounded, weight, rtol=1e-9)
    with pytest.raises(stp.errors.ConvergenceError):
        heavy = stp.with_limits(chain, {motor: {"effort": (0, 0.9 * weight[0])} for motor in chain.motors})
        stp.inverse_dynamics(heavy, q, rest, rest, effort_limit=heavy.limits)


def test_one_motor_without_a_limit_can_be_given_one() -> None:
    chain = robot("stewart")
    lacks = stp.with_limits(chain, {"leg4": {"velocity": None, "effort": None}})
    q = chain.q_home
    for polytope, argument, full in (
        (stp.polytopes.velocity_polytope, "rate_limit", 2.0),
        (stp.polytopes.wrench_polytope, "effort_limit", 1e4),
    ):
        with pytest.raises(InputError, match=f"for the motors leg4; pass {argument}"):
            polytope(lacks, q)
        given = np.full(6, np.nan)
        given[3] = full
        np.testing.assert_allclose(
            np.sort(polytope(lacks, q, **{argument: given}).vertices, axis=0),
            np.sort(polytope(chain, q).vertices, axis=0),
        )


def test_a_loop_may_limit_velocities_and_stand_at_its_end() -> None:
    """The pin that closes the five-bar, as fast or as far as it is: the same as a hinge of the tree would be."""
    chain = robot("five_bar")
    name = next(name for name in chain.limits.names if name.startswith("tip_pin"))
    slow = stp.with_limits(chain, {name: {"velocity": 1.0}})
    wide, narrow = (stp.polytopes.velocity_polytope(each, chain.q_home) for each in (chain, slow))
    fastest = [np.linalg.norm(each.vertices, axis=1).max() for each in (narrow, wide)]
    assert fastest[0] < 0.9 * fastest[1]
    assert any(name in face for face in narrow.limits)
    # At the fastest corners the pin turns at 1 rad/s: with the motions of the tree that give their twists.
    state = chain.at(chain.q_home)
    motions = state.freedom.motions
    turning = np.linalg.pinv(state.P @ motions) @ narrow.basis @ narrow.vertices.T
    rates = slow.judge.rates(chain.q_home, motions @ turning, np.array([chain.limits.names.index(name)]))
    assert np.abs(rates).max() == pytest.approx(1.0, rel=1e-6)


def test_limits_of_loops_are_judged_and_bind_a_fit() -> None:
    chain = robot("stewart")
    cone = stp.with_limits(chain, {"leg1_ball angle": {"position": 2.9}})
    turn = cone.judge.asked(chain.q_home[None])[0].values[0, -1]
    motion = sway(chain, 0.3)
    peak = max(
        cone.judge.asked(stp.inverse_kinematics(chain, motion(1.0).pose(k)).q[None])[0].values[0, -1]
        for k in range(TIME.size)
    )
    assert peak > turn
    tight = stp.with_limits(chain, {"leg1_ball angle": {"position": (turn + peak) / 2}})
    fit = stp.fit_to_limits(tight, motion)
    assert fit.binding is not None and fit.binding.motor == "leg1_ball angle" and 0 < fit.scale < 1
    (excess,) = stp.motor_demand(tight, motion(1.0)).check()
    assert excess.joint == "leg1_ball angle"
    with pytest.raises(UnreachableError, match="leg1_ball angle"):
        stp.inverse_kinematics(tight, motion(1.0).pose(TIME.size - 1))


def test_with_limits_refuses_what_is_none() -> None:
    chain = robot("stewart")
    for limits, message in (
        ({"leg7": {"effort": 1.0}}, "no coordinate to limit; those that have: leg1_x"),
        ({"platform_pose vx": {"velocity": 1.0}}, "no coordinate to limit"),
        ({"leg1": {"speed": 1.0}}, "the kinds are: position, velocity"),
        ({"leg1": {"effort": (2.0, 1.0)}}, "the least, 2, is above the greatest, 1"),
        ({"leg1": {"effort": "strong"}}, "must be"),
        ({"leg1": 3.0}, "must be a mapping of kinds"),
        ({"leg1_ball swing": {"velocity": 1.0}}, "limits of position only"),
        ({"leg1_ball swing": {"position": -1.0}}, "above zero|is above"),
        ({"leg1_ball swing": {"effort": 1.0}}, "no motor drives it"),
        (["leg1"], "must be a mapping of joints"),
    ):
        with pytest.raises(InputError, match=message):
            stp.with_limits(chain, limits)  # type: ignore[arg-type]
    with pytest.raises(MechanismError, match=r"home of .*'leg1'"):
        stp.with_limits(chain, {"leg1": {"position": (1.7, 1.8)}})
    with pytest.raises(InputError, match="limits_exceeded takes a State"):
        stp.limits_exceeded(chain)  # type: ignore[arg-type]


def test_limits_survive_files_and_pickling(tmp_path) -> None:
    chain = stp.with_limits(
        robot("stewart"),
        {
            "leg1": {"effort": (0, 500), "velocity": (-1, 2), "acceleration": 30, "jerk": (-400, 500)},
            "leg2": {"velocity": None, "effort": (None, 70)},
            "leg1_ball swing": {"position": 1.1},
            "leg2_ball angle": {"position": 2.5},
        },
    )
    stp.write_urdf(chain, tmp_path / "limits.urdf")
    again = stp.load(tmp_path / "limits.urdf")
    assert again.limits.names == chain.limits.names
    for kind in KINDS:
        np.testing.assert_array_equal(again.limits.of(kind), chain.limits.of(kind))
    assert again.model.lowerEffortLimit[again.motor_index[0]] == 0.0


def test_a_swing_of_the_joints_of_a_hexapod() -> None:
    hexapod = stp.Hexapod.from_chain(robot("stewart"))
    steel = pin.Inertia(5.0, np.zeros(3), 0.1 * np.eye(3))
    chain = stp.hexapod_chain(
        hexapod, platform=steel, lower=steel, upper=steel, stroke=(0.5, 1.8), swing=1.2, ball_swing=0.2
    )
    rows = [chain.limits.names.index(f"leg3_{axis}") for axis in "xy"]
    np.testing.assert_array_equal(chain.limits.position[rows], [[-1.2, 1.2]] * 2)
    home = stp.platform_pose(chain, chain.q_home)
    assert not stp.limits_exceeded(chain.at(chain.q_home))
    # The swing of a ball: between the leg and where it stood at home, seen from the platform.
    pose = pin.SE3(pin.exp3(np.array([0.05, 0.1, 0.0])), home.translation + [0.1, 0.0, 0.05])
    q = stp.inverse_kinematics(chain, pose, limits=False).q

    def legs(at: pin.SE3) -> np.ndarray:
        along = np.array([at.act(point) for point in hexapod.platform_points]) - hexapod.base_points
        return along @ at.rotation / np.linalg.norm(along, axis=1)[:, None]

    swings = np.arccos((legs(pose) * legs(home)).sum(axis=1))
    judged = chain.judge.asked(q[None])[0].values[0, -6:]
    np.testing.assert_allclose(judged, swings, atol=1e-9)
    over = {excess.joint for excess in stp.limits_exceeded(chain.at(q))}
    assert over == {f"leg{k + 1}_ball swing" for k in np.flatnonzero(swings > 0.2)}


def four_bar(lower: float, upper: float) -> str:
    """Write a four-bar whose last hinge, d, gives the pin a second parent, and has limits."""
    limit = f'<limit lower="{lower}" upper="{upper}" effort="7" velocity="3" acceleration="11"/>'
    return small_robot(
        *(link(name) for name in ("base", "crank", "coupler", "rocker")),
        link("pin", ""),
        joint("a", "base", "crank", "continuous", attributes=MOTOR),
        joint("b", "crank", "coupler", "continuous", origin='xyz="0.4 0 0"'),
        joint("f", "coupler", "pin", "fixed", origin='xyz="0.9 0 0"', axis=""),
        joint("c", "base", "rocker", "continuous", origin='xyz="1 0 0"'),
        joint("d", "rocker", "pin", origin='xyz="0.6 0 0"', content=limit),
    )


def test_a_joint_that_is_cut_keeps_its_limits(tmp_path) -> None:
    def written(lower: float, upper: float) -> stp.ClosedChain:
        path = tmp_path / "cut.urdf"
        path.write_text(four_bar(lower, upper))
        return stp.load(path, platform="coupler")

    wide = written(-10.0, 10.0)
    (row,) = (wide.limits.names.index("d"),)
    assert row >= wide.nv
    assert wide.limits.velocity[row].tolist() == [-3, 3] and wide.limits.acceleration[row].tolist() == [
        -11,
        11,
    ]

    def pin_angle(q: np.ndarray) -> float:
        a, b, c = (q[wide.tangent_names.index(name)] for name in "abc")
        return float((a + b - c + np.pi) % (2 * np.pi) - np.pi)

    turned = wide.q_home[wide.motor_q_index] + 0.3
    free = stp.forward_kinematics(wide, turned)
    at_home, there = pin_angle(wide.q_home), pin_angle(free.q)
    middle = (at_home + there) / 2
    ends = (middle, 3.0) if at_home > there else (-3.0, middle)
    chain = written(*ends)
    np.testing.assert_allclose(chain.q_home, wide.q_home, atol=1e-12)
    for ask, demand in (
        (stp.forward_kinematics, turned),
        (stp.inverse_kinematics, stp.platform_pose(wide, free.q)),
    ):
        with pytest.raises(UnreachableError, match="'d' at"):
            ask(chain, demand)
    (excess,) = stp.limits_exceeded(chain.at(free.q))
    assert (excess.joint, excess.kind) == ("d", "position")
    assert excess.value == pytest.approx(there, abs=1e-12)
    # A home that they exclude is another one.
    away = written(at_home + 0.1, at_home + 0.2)
    assert at_home + 0.1 <= pin_angle(away.q_home) <= at_home + 0.2
    stp.write_urdf(chain, tmp_path / "again.urdf")
    again = stp.load(tmp_path / "again.urdf")
    np.testing.assert_array_equal(again.limits.position[row], chain.limits.position[row])


@pytest.mark.slow
def test_a_workspace_of_a_chain_keeps_its_hinges(hinged: stp.ClosedChain) -> None:
    level = stp.platform_pose(hinged, hinged.q_home).rotation
    legs = stp.workspaces.sample_workspace(
        stp.Hexapod.from_chain(hinged), level, stroke=(0.5, 1.8), spacing=0.25
    )
    all_joints = stp.workspaces.sample_workspace(hinged, level, spacing=0.25)
    np.testing.assert_array_equal(all_joints.position, legs.position)
    assert 0 < all_joints.inside.sum() < legs.inside.sum() and all_joints.volume < legs.volume
    for k in np.flatnonzero(legs.inside)[::7]:
        pose = pin.SE3(level, legs.position[k])
        found = stp.inverse_kinematics(hinged, pose, throw=False)
        assert found.success is bool(all_joints.inside[k])


def test_a_sweep_judges_all_joints(hinged: stp.ClosedChain) -> None:
    def motion(amplitude: float) -> stp.motions.PlatformSamples:
        return sway(hinged)(amplitude)

    amplitudes = [0.05, 0.5, 1.0]
    found = stp.sweep_demand(hinged, motion, {"amplitude": amplitudes}, limits=True)
    expected = [not stp.motor_demand(hinged, motion(amplitude)).check() for amplitude in amplitudes]
    assert found["within_limits"].astype(bool).tolist() == expected
    assert expected[0] and not expected[-1]
