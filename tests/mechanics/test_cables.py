"""Cables as loops: their way over pulleys, every formulation, files, locked reels, another unit, refusals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.mechanics.articulated_body.loops import closed_chain_articulated_body
from stewart_pin.model.description import Cable
from stewart_pin.state.cable_paths import cable_paths
from stewart_pin.state.row_derivatives import row_derivatives
from tests.cable_robots import CABLE_ROBOTS, cables_4, cables_8, cables_on_drums
from tests.pulled import spatial
from tests.retelling.changes import CHANGES, changed
from tests.rewritten import configuration_in_other_unit, effort_unit, in_other_unit, rebuild, tangent_unit

each = pytest.mark.parametrize("name", list(CABLE_ROBOTS))
STEP = 1e-6
UNDER = pin.Inertia(2.0, np.zeros(3), 0.01 * np.eye(3))


def _state(chain: stp.ClosedChain, rng: np.random.Generator) -> stp.State:
    """Draw a closed state off home that moves and accelerates."""
    step = 0.1 * rng.standard_normal(chain.nv) * chain.platform_support
    q = stp.close_loops(chain, pin.integrate(chain.model, chain.q_home, step)).q
    J_c = chain.at(q).J_c
    G = np.linalg.svd(J_c)[2][np.linalg.matrix_rank(J_c) :].T
    v = G @ rng.standard_normal(G.shape[1])
    still = chain.at(q, v)
    a = G @ rng.standard_normal(G.shape[1]) - np.linalg.lstsq(still.J_c, still.loop_bias, rcond=None)[0]
    return chain.at(q, v, a)


# --- the way over a pulley --------------------------------------------------------------------------------


def test_a_cable_that_hangs_straight_down_runs_half_around_its_pulley() -> None:
    path = cable_paths(np.array([[0.2, 0.0, -1.0]]), np.array([[0.0, 0.0, 1.0]]), np.array([0.1]))
    assert path.length[0] == pytest.approx(0.1 * np.pi + 1.0, abs=1e-15)
    assert np.abs(path.along[0] - [0, 0, -1]).max() < 1e-15


def test_a_level_cable_runs_a_quarter_around_and_without_radius_it_is_a_line() -> None:
    ends, axes = np.array([[1.1, 0.0, 0.1], [0.3, -0.4, 1.2]]), np.array([[0, 0, 1.0], [0, 0, 1.0]])
    path = cable_paths(ends, axes, np.array([0.1, 0.0]))
    assert path.length == pytest.approx([0.05 * np.pi + 1.0, 1.3], abs=1e-15)
    assert np.abs(path.along - [[1, 0, 0], ends[1] / 1.3]).max() < 1e-15


@pytest.mark.parametrize("least", [0.0, 0.02], ids=["points", "pulleys"])
def test_ways_directions_and_curvatures_are_those_of_differences(
    rng: np.random.Generator, least: float
) -> None:
    count = 200
    axes = rng.standard_normal((count, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    radii, ends = least * rng.uniform(1, 10, count), 2 * rng.standard_normal((count, 3))
    one, two = rng.standard_normal((2, count, 3))
    path = cable_paths(ends, axes, radii)
    away = np.flatnonzero((path.free > 0.5) & (path.distance > 0.3))
    assert len(away) > 100
    there, back = (cable_paths(ends + sign * STEP * one, axes, radii) for sign in (1, -1))
    found = (
        (there.length - back.length, (path.along * one).sum(1)),
        (there.along - back.along, path.turned(one)),
        ((two * (there.turned(two) - back.turned(two))).sum(1), path.bent(two, one)),
    )
    for difference, derivative in found:
        # Central differences of numbers of order one to ten: 1e-16 / 1e-6, and squares of the step.
        assert np.abs(difference / (2 * STEP) - derivative)[away].max() < 3e-8


# --- rows and formulations --------------------------------------------------------------------------------


@each
def test_rows_are_those_of_differences(name: str, rng: np.random.Generator) -> None:
    chain = CABLE_ROBOTS[name]()
    state = _state(chain, rng)

    def moved(dq: np.ndarray, dv: np.ndarray | float = 0.0) -> stp.State:
        return chain.at(pin.integrate(chain.model, state.q, dq), state.v + dv, state.a)

    derivatives = row_derivatives(chain, state.q, state.v, state.a)
    worst = 0.0
    for k in range(chain.nv):
        step = STEP * np.eye(chain.nv)[k]
        there, back = moved(step), moved(-step)
        rows = (there.gap - back.gap, state.J_c[:, k])
        rates = (there.J_c @ state.v - back.J_c @ state.v, derivatives.rate_q[:, k])

        def second(at: stp.State) -> np.ndarray:
            return at.J_c @ state.a + at.loop_bias

        by_q = (second(there) - second(back), derivatives.acceleration_q[:, k])
        faster, slower = moved(np.zeros(chain.nv), step), moved(np.zeros(chain.nv), -step)
        by_v = (faster.loop_bias - slower.loop_bias, derivatives.acceleration_v[:, k])
        for difference, derivative in (rows, rates, by_q, by_v):
            worst = max(worst, float(np.abs(difference / (2 * STEP) - derivative).max()))
    assert worst < 2e-7  # of accelerations up to some 10 m/s² per metre


@each
def test_every_formulation_agrees(name: str, rng: np.random.Generator) -> None:
    chain = CABLE_ROBOTS[name]()
    kernels = stp.compile_kernels(chain, coordinates="tree")
    for _ in range(3):
        state = _state(chain, rng)
        effort = stp.inverse_dynamics(state)
        scale = np.abs(effort.tau_motor).max()
        other = stp.inverse_dynamics(state, method="constraint_matrix")
        assert np.abs(effort.tau_motor - other.tau_motor).max() < 1e-11 * scale
        assert np.abs(effort.lambda_c - other.lambda_c).max() < 1e-10 * np.abs(effort.lambda_c).max()
        by_kernels = kernels.inverse_dynamics(state.q[None], state.v[None], state.a[None])[0]
        assert np.abs(effort.tau_motor - by_kernels).max() < 1e-10 * scale
        size = np.abs(state.a).max()
        assert (
            np.abs(stp.forward_dynamics(chain, state.q, state.v, effort.tau_motor).a - state.a).max()
            < 1e-9 * size
        )
        articulated = closed_chain_articulated_body(chain, state.q, state.v, effort.tau_motor)
        assert np.abs(articulated.a - state.a).max() < 1e-9 * size


def test_massless_legs_that_pull_are_cables_from_points(rng: np.random.Generator) -> None:
    """The same robot told by slides between universal joints and balls needs the same tensions."""
    plain = cables_8().described()
    exits = np.array([loop.placement1.translation for loop in plain.loops])
    ends = np.array([loop.placement2.translation for loop in plain.loops])
    home = pin.XYZQUATToSE3(plain.home["platform_pose"])
    legs = spatial(exits, ends, home)
    cables = stp.cables.cable_robot(exits, ends, platform=legs.mechanism.link("platform").inertia, home=home)
    for _ in range(3):
        motion = home * pin.exp6(0.2 * rng.standard_normal(6)), *rng.standard_normal((2, 6))
        one, two = (stp.platform_motion(chain, *motion, limits=False) for chain in (legs, cables))
        tensions, others = (stp.inverse_dynamics(state).tau_motor for state in (one, two))
        assert np.abs(tensions - others).max() < 1e-10 * np.abs(others).max()
        wound = [
            stp.motor_positions(s) - stp.motor_positions(c.at(c.q_home))
            for s, c in ((one, legs), (two, cables))
        ]
        assert np.abs(wound[0] - wound[1]).max() < 1e-12
        assert np.abs(one.v[legs.motor_index] - two.v[cables.motor_index]).max() < 1e-11
        assert np.abs(one.a[legs.motor_index] - two.a[cables.motor_index]).max() < 1e-10


def test_tension_is_the_effort_of_the_reel_and_two_cables_hold_a_weight() -> None:
    """A point on two cables at 30° below the horizontal: each bears the weight, as 2 T sin 30° = m g."""
    reach = 2.0
    exits = [(-reach * np.cos(np.pi / 6), 0.0), (reach * np.cos(np.pi / 6), 0.0)]
    chain = stp.cables.cable_robot(
        exits, [(0, 0), (0, 0)], platform=UNDER, home=[0, -reach * np.sin(np.pi / 6), 0]
    )
    effort = stp.inverse_dynamics(chain, chain.q_home, chain.rest, chain.rest, throw=False)
    assert effort.tau_motor == pytest.approx([2.0 * 9.81, 2.0 * 9.81], rel=1e-9)
    assert stp.cables.cable_lengths(chain, chain.q_home) == pytest.approx([reach, reach], abs=1e-14)


def test_limits_are_tensions_and_what_is_wound_in_is_the_motors_position() -> None:
    chain = cables_4()
    home = stp.cables.cable_lengths(chain, chain.q_home)
    pose = pin.SE3(np.eye(3), np.array([1.2, 0.0, 0.9]))
    state = stp.inverse_kinematics(chain, pose).state
    wound = stp.motor_positions(state)
    assert np.abs(home - wound - stp.cables.cable_lengths(state)).max() < 1e-12
    held = stp.inverse_dynamics(
        state.chain, state.q, chain.rest, chain.rest, effort_limit=chain.limits
    ).tau_motor
    assert held.min() >= 10.0 - 1e-9
    assert stp.limits_exceeded(chain.at(state.q), tau_motor=-held)


def test_every_turn_of_a_drum_counts() -> None:
    """A pose tells how far drums have turned, in every verb, however far they turn between two instants."""
    chain = cables_on_drums()
    home = chain.at(chain.q_home).pose
    time = np.linspace(0.0, 1.0, 9)
    motion = stp.motions.sinusoidal_motion(time, home=home, amplitude=(0.8, 0.5, 0.4), frequency=(1, 1, 1))
    slow = stp.motor_demand(chain, motion, kernels=False)
    fast = stp.motor_demand(chain, motion, kernels=True)
    assert np.abs(np.diff(slow.positions, axis=0)).max() > 2 * np.pi
    assert np.abs(fast.positions - slow.positions).max() < 1e-9
    assert not fast.turns_unsure and not slow.turns_unsure
    lengths = stp.cables.cable_lengths(chain, chain.q_home)
    for k, position in enumerate(motion.position):
        pose = pin.SE3(home.rotation, position)
        state = stp.inverse_kinematics(chain, pose).state
        wound = 0.008 * stp.motor_positions(state)
        assert np.abs(stp.cables.cable_lengths(state) - (lengths - wound)).max() < 1e-12
        assert np.abs(slow.positions[k] - stp.motor_positions(state)).max() < 1e-9
    # A whole turn more is another length, which eight cables cannot all have.
    turned = stp.motor_positions(state) + 2 * np.pi * np.eye(8)[0]
    with pytest.raises(stp.errors.ClosureError, match="8 motors stand for 6"):
        stp.forward_kinematics(chain, turned, q_guess=state.q)


# --- told otherwise ---------------------------------------------------------------------------------------


@each
@pytest.mark.parametrize("change", [c for c in CHANGES if c != "loop frames turned"])
def test_told_otherwise_it_needs_the_same_efforts(name: str, change: str, rng: np.random.Generator) -> None:
    chain = CABLE_ROBOTS[name]()
    state = _state(chain, rng)
    mechanism, told = changed(chain.described(), CHANGES[change](chain))
    other = rebuild(chain, mechanism, _gravity(chain, change))
    q = np.zeros(chain.nq)
    v, a = np.zeros(chain.nv), np.zeros(chain.nv)
    sign = np.array([told[motor].sign for motor in chain.motors])
    for joint in chain.mechanism.joints:
        if chain.model.existJointName(joint.name):
            here, there = (c.model.joints[c.model.getJointId(joint.name)] for c in (chain, other))
            span, new = slice(here.idx_q, here.idx_q + here.nq), slice(there.idx_q, there.idx_q + there.nq)
            q[new] = told[joint.name].value(state.q[span])
            rates = told[joint.name].rates(here.nv)
            for old, made in ((state.v, v), (state.a, a)):
                made[there.idx_v : there.idx_v + there.nv] = rates @ old[here.idx_v : here.idx_v + here.nv]
    efforts = stp.inverse_dynamics(other, q, v, a).tau_motor
    plain = stp.inverse_dynamics(state).tau_motor
    assert np.abs(sign * efforts - plain).max() < 1e-9 * np.abs(plain).max()


def _gravity(chain: stp.ClosedChain, change: str) -> np.ndarray:
    root = CHANGES[change](chain).links.get(chain.mechanism.root, pin.SE3.Identity())
    return root.rotation.T @ np.array(chain.gravity)


@each
def test_the_unit_of_length_changes_nothing(name: str, rng: np.random.Generator) -> None:
    chain, k = CABLE_ROBOTS[name](), 1e3
    state, other = _state(chain, rng), in_other_unit(chain, k)
    unit = tangent_unit(chain, k)
    q = configuration_in_other_unit(chain, state.q, k)
    efforts = stp.inverse_dynamics(other, q, unit * state.v, unit * state.a).tau_motor
    plain = stp.inverse_dynamics(state).tau_motor * effort_unit(chain, k)
    # Least of those that do it, in robot sizes where drums turn.
    assert np.abs(efforts - plain).max() < 1e-9 * np.abs(plain).max()


@each
def test_a_file_brings_it_back(name: str, tmp_path: Path) -> None:
    chain = CABLE_ROBOTS[name]()
    stp.write_urdf(chain, tmp_path / "robot.urdf")
    again = stp.load(tmp_path / "robot.urdf")
    assert np.abs(again.q_home - chain.q_home).max() < 1e-12
    for old, new in zip(chain.loops, again.loops, strict=True):
        assert new.cable == old.cable and new.length == old.length
        assert np.abs(new.axis - old.axis).max() < 1e-15 or not old.cable.radius
    assert again.limits.effort == pytest.approx(chain.limits.effort, nan_ok=True)


@pytest.mark.parametrize("dialect", ["mjcf", "sdf", "usd", "drake", "isaac", "gepetto"])
def test_formats_without_a_word_for_cables_say_so(dialect: str, tmp_path: Path) -> None:
    suffix = {"mjcf": "xml", "sdf": "sdf", "usd": "usda"}.get(dialect, "urdf")
    with pytest.raises(stp.errors.UnsupportedError, match=r"cable1.*cable"):
        stp.export(cables_8(), tmp_path / f"robot.{suffix}", format=dialect)


def test_a_locked_reel_leaves_a_cable_that_keeps_its_length(rng: np.random.Generator) -> None:
    chain = cables_8()
    state = _state(chain, rng)
    stiff = stp.lock_joints(chain, ["winch3"], q=state.q)
    assert stiff.loops[2].cable == Cable(radius=0.05)
    lengths = stp.cables.cable_lengths(state)
    assert stp.cables.cable_lengths(stiff, stiff.q_home) == pytest.approx(lengths, abs=1e-12)
    assert stp.mobility(stiff).dof == 5


# --- refusals ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cable", "message"),
    [
        (Cable("winch9"), r"cable 'cable1' is wound in by joint 'winch9', which is not there.*winch1"),
        (Cable("platform_pose"), "'platform_pose', which is floating"),
        (Cable("winch1", 0.0), "ratio 0 to its reel"),
        (Cable("winch1", 1.0, -0.1), "radius -0.1 m"),
    ],
)
def test_descriptions_of_no_cable_are_refused(cable: Cable, message: str) -> None:
    plain = cables_8().described()
    first, *others = plain.loops
    with pytest.raises(stp.errors.MechanismError, match=message):
        build_chain(replace(plain, loops=(replace(first, cable=cable), *others)))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"exits": [(0, 0)]}, "as many points"),
        ({"pulleys": -0.1}, "pulleys must be"),
        ({"pulleys": [0.1, 0.2]}, "pulleys must be"),
        ({"swivels": (0, 0, 0)}, "length zero"),
        ({"tension": (-1, 5)}, "tension must be"),
        ({"lengths": (2, 1)}, "lengths must be"),
        ({"drum": -1.0}, "drum must be"),
        ({"home": [0, 0, 0]}, "cable 1 has no direction at home"),
        ({"platform": 3.0}, "platform must be a pinocchio.Inertia"),
    ],
)
def test_wrong_arguments_of_a_cable_robot_are_named(options: dict, message: str) -> None:
    wanted = {
        "exits": [(0, 0), (3, 0), (3, 2), (0, 2)], "attachments": [(0, 0)] * 4, "platform": UNDER,
        "home": [1.5, 1, 0],
    } | options  # fmt: skip
    with pytest.raises(stp.errors.InputError, match=message):
        stp.cables.cable_robot(wanted.pop("exits"), wanted.pop("attachments"), **wanted)


def test_an_end_within_the_pulley_has_no_direction() -> None:
    chain = cables_8()
    q = chain.q_home.copy()
    q[:3] = np.array([-2.0, -1.5, 0.2]) - np.array(chain.loops[0].placement2.translation) + [0.05, 0, 0]
    with pytest.raises(stp.errors.SingularityError, match=r"cable1.*pulley"):
        _ = chain.at(q, np.ones(chain.nv)).loop_bias


# --- motions and simulations ------------------------------------------------------------------------------


@pytest.mark.parametrize("margin", [0.0, 0.1])
def test_a_motion_is_fitted_to_what_tensions_may_be(margin: float) -> None:
    chain = stp.with_limits(cables_4(), {f"winch{k}": {"effort": (10, 90)} for k in range(1, 5)})
    time, home = np.linspace(0, 1, 21), chain.at(chain.q_home).pose

    def motion(scale: float) -> stp.motions.PlatformSamples:
        return stp.motions.sinusoidal_motion(
            time, home=home, amplitude=(0.5 * scale, 0, 0.3 * scale), frequency=(1, 1, 2)
        )

    with pytest.raises(stp.errors.InputError, match="sharing= for redundant motors"):
        stp.fit_to_limits(chain, motion)
    fit = stp.fit_to_limits(chain, motion, sharing="least_norm", margin=margin)
    assert 0.01 < fit.scale < 1 and fit.unscaled[0].limit == "effort"
    least, most = 50 - 40 * (1 - margin), 50 + 40 * (1 - margin)
    assert fit.demand.efforts.min() >= least - 1e-9 and fit.demand.efforts.max() <= most + 1e-9
    bounds = np.tile([least, most], (4, 1))
    with pytest.raises(stp.errors.EffortLimitError, match=r"at .* s, instant"):
        stp.motor_demand(chain, motion(1.001 * fit.scale), effort_limit=bounds)


def test_a_box_that_unwinds_heavy_drums_keeps_its_energy() -> None:
    """Nothing brakes the drums: what the box falls makes it and them move."""
    plain = cables_8()
    free = stp.with_limits(plain, {motor: {"effort": (None, None)} for motor in plain.motors})
    heavy = stp.with_joint_physics(free, {motor: {"armature": 30.0} for motor in plain.motors})
    run = stp.simulate(heavy, heavy.q_home, heavy.rest, lambda t, q, v: np.zeros(8), duration=0.3, dt=1e-3)
    energy = run.audit.kinetic + run.audit.potential
    assert np.ptp(run.audit.kinetic) > 1.0
    assert np.ptp(energy) < 1e-9  # of the step to the fourth power, 1e-12, in joules
    assert np.abs(stp.loop_gap(heavy, run.q[-1])).max() < 1e-12
