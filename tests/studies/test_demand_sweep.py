"""Demands over grids of motions: against closed forms, without kernels, in any company and on any executor."""

from __future__ import annotations

import functools
import pickle
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.model.tree import KINDS
from stewart_pin.motion import motor_demand as motor_demand_module
from stewart_pin.studies import demand_sweep
from stewart_pin.studies.answers import Carried
from stewart_pin.studies.demand_sweep import _digest
from tests.cable_robots import cables_8
from tests.closed_states import slow_but_for_few
from tests.mechanisms import gear_train
from tests.studies import functions
from tests.studies.motions import PHASE, design, robot, shake, shake_stewart
from tests.studies.test_sweep import same

AXES = {"amplitude": [0.002, 0.05, 0.1], "frequency": [0.5, 3.0, 8.0, 12.0]}
NAMES = {"peak_effort", "rms_effort", "lowest_position", "highest_position", "travel", "peak_rate"} | {
    "peak_power",
    "mean_power",
}

ZOO = Path(__file__).parents[1] / "zoo" / "urdf"


def close(found: stp.sweeps.Sweep, expected: stp.sweeps.Sweep, tolerance: float = 1e-10) -> None:
    """Equal, but for a part of the largest value of each figure."""
    assert set(found.results) == set(expected.results) == NAMES
    for name, values in expected.results.items():
        largest = np.nanmax(np.abs(values))
        np.testing.assert_allclose(found[name], values, rtol=0, atol=tolerance * largest, err_msg=name)


def test_figures_are_those_of_the_closed_form_at_every_point() -> None:
    chain = robot("stewart")
    found = stp.sweep_demand(chain, shake_stewart, AXES, kernels=True)
    assert found["peak_effort"].shape == (3, 4, 6) and found.success
    hexapod, bodies = stp.Hexapod.from_chain(chain), stp.hexapods.hexapod_bodies(chain)
    home = stp.platform_pose(chain, chain.q_home)
    for i, part in enumerate(AXES["amplitude"]):
        for j, frequency in enumerate(AXES["frequency"]):
            size, w = part * chain.length_scale, 2 * np.pi * frequency
            wave = np.sin(2 * np.pi * PHASE)
            position = home.translation + np.outer(size * wave, [1, 0, 0])
            twist, acceleration = np.zeros((2, 40, 6))
            twist[:, 0] = size * w * np.cos(2 * np.pi * PHASE)
            acceleration[:, 0] = -size * w**2 * wave
            force = stp.hexapods.hexapod_inverse_dynamics(
                hexapod, bodies, position, home.rotation, twist, acceleration, gravity=chain.gravity
            ).actuator
            length = stp.leg_lengths(hexapod, position, home.rotation)
            rate = np.einsum("nij,nj->ni", stp.leg_jacobian(hexapod, position, home.rotation), twist)
            expected = {
                "peak_effort": np.abs(force).max(axis=0),
                "rms_effort": np.sqrt(np.square(force).mean(axis=0)),
                "lowest_position": length.min(axis=0),
                "highest_position": length.max(axis=0),
                "travel": np.ptp(length, axis=0),
                "peak_rate": np.abs(rate).max(axis=0),
                "peak_power": np.abs(force * rate).max(axis=0),
                "mean_power": np.abs(force * rate).mean(axis=0),
            }
            for name, values in expected.items():
                # Round-off of 1e-15, times some hundred operations.
                np.testing.assert_allclose(found[name][i, j], values, rtol=0, atol=1e-12 * values.max())


def test_a_point_mass_on_light_legs_asks_for_mass_times_g_plus_amplitude_omega_squared() -> None:
    chain = stp.massless_legs(robot("stewart"), point_platform=True)
    home = stp.platform_pose(chain, chain.q_home)

    def heave(amplitude: float, frequency: float) -> stp.motions.PlatformSamples:
        along = np.array([0.0, 0.0, 1.0])
        return stp.motions.sinusoidal_motion(
            PHASE / frequency, home=home, amplitude=amplitude * along, frequency=frequency * along
        )

    amplitude, frequency = np.array([1e-3, 0.05, 0.2]), np.array([2.0, 10.0])
    found = stp.sweep_demand(chain, heave, {"amplitude": amplitude, "frequency": frequency}, kernels=True)
    # Lowest and pushed upwards most at the same instant. Each leg gives a sixth, along its own slope; all are equal.
    height = home.translation[2]
    radius = np.sqrt(found["lowest_position"][..., 0] ** 2 - (height - amplitude[:, None]) ** 2)
    low = height - amplitude[:, None]
    slope = low / np.hypot(radius, low)
    force = 20.0 * (9.81 + amplitude[:, None] * (2 * np.pi * frequency) ** 2) / (6 * slope)
    np.testing.assert_allclose(found["peak_effort"], np.repeat(force[..., None], 6, axis=-1), rtol=1e-9)
    ends = [np.hypot(radius, height + sign * amplitude[:, None]) for sign in (1, -1)]
    np.testing.assert_allclose(found["travel"][..., 0], ends[0] - ends[1], rtol=1e-9)


def test_lowering_a_weight_gives_its_energy_to_the_motors() -> None:
    """Slowly, so that every motor brakes all the way; turned, so that orientations count."""
    chain = stp.massless_legs(robot("stewart"), point_platform=True)
    home = stp.platform_pose(chain, chain.q_home)
    time = np.linspace(0.0, 20.0, 2001)

    def lower(height: float, yaw: float) -> stp.motions.PlatformSamples:
        end = pin.SE3(home.rotation @ pin.rpy.rpyToMatrix(0.0, 0.0, yaw), home.translation - [0, 0, height])
        return stp.motions.minimum_jerk_motion(time, start=home, end=end, duration=20.0)

    axes = {"height": [0.1, 0.3], "yaw": [0.0, 0.1]}
    found = stp.sweep_demand(chain, lower, axes, kernels=True)
    # The trapezoidal rule is exact to 1e-9 here: all derivatives vanish at the ends but the third and later ones.
    energy = found["mean_power"].sum(axis=-1) * 20.0 * 2001 / 2000
    np.testing.assert_allclose(energy, np.array([[0.1], [0.3]]) * 20.0 * 9.81 * [[1.0, 1.0]], rtol=1e-6)
    # The speed is greatest halfway, 15/8 of its mean.
    total = found["peak_power"].sum(axis=-1)[:, 0]
    np.testing.assert_allclose(total, np.array([0.1, 0.3]) / 20.0 * 15 / 8 * 20.0 * 9.81, rtol=0.01)
    close(found, stp.sweep_demand(chain, lower, axes, kernels=False))


@pytest.mark.parametrize(
    "name",
    slow_but_for_few(
        ["stewart", "hexapod_rss", "delta", "rpr_planar", "arm_3r_planar"], ["stewart", "rpr_planar"]
    ),
)
def test_kernels_change_nothing(name: str) -> None:
    """Legs in closed form and, of the arm, iteration; the careful verbs take milliseconds a state, so few points."""
    chain = robot(name)
    axes = {"amplitude": [0.05], "frequency": [4.0], "axis": ["x", "y"]}
    motion = functools.partial(shake, chain)
    found = stp.sweep_demand(chain, motion, axes, kernels=True)
    assert found.success
    close(found, stp.sweep_demand(chain, motion, axes, kernels=False))


def test_a_robot_that_cannot_be_compiled_does_without() -> None:
    chain = replace(robot("arm_7r"), q_home=np.full(7, 0.4))  # bent, so that it can go any way
    motion = functools.partial(shake, chain)
    axes = {"amplitude": [0.01], "frequency": [1.0, 2.0]}
    with pytest.raises(UnsupportedError, match="leave 1 freedom"):
        stp.compile_kernels(chain)
    plain = stp.sweep_demand(chain, motion, axes, kernels=False)
    for kernels in (None, True):
        close(stp.sweep_demand(chain, motion, axes, kernels=kernels), plain)


@pytest.mark.parametrize("kernels", [True, False])
def test_what_is_out_of_reach_is_named(kernels: bool) -> None:
    chain = robot("delta")
    found = stp.sweep_demand(
        chain,
        functools.partial(shake, chain),
        {"amplitude": [0.05, 3.0], "frequency": [1.0]},
        kernels=kernels,
    )
    assert [(failed.index, failed.error) for failed in found.failures] == [((1, 0), "ClosureError")]
    assert np.isfinite(found["peak_effort"][0]).all() and np.isnan(found["peak_effort"][1]).all()


def test_the_state_that_fails_is_looked_at_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """A motion of many states is not followed up to the one without answer; and poses are looked at once."""
    tried: list[object] = []

    def noting(verb):
        def noted(chain, pose, *arguments, **options):
            tried.append(pose.translation)
            return verb(chain, pose, *arguments, **options)

        return noted

    for verb in ("platform_motion", "inverse_kinematics"):
        monkeypatch.setattr(motor_demand_module, verb, noting(getattr(motor_demand_module, verb)))
    chain = stp.load("delta")
    axes = {"amplitude": [1.0], "frequency": [1.0, 2.0, 3.0]}
    found = stp.sweep_demand(chain, functools.partial(shake, chain), axes, kernels=True)
    assert {failed.error for failed in found.failures} == {"ClosureError"} and len(found.failures) == 3
    assert len(tried) == 1 and tried[0][0] > 0.1 * chain.length_scale
    # Where the pose can be reached, the error is of the rest of the state.
    planar = robot("rpr_planar")
    home = stp.platform_pose(planar, planar.q_home)

    def leave_the_plane(speed: float) -> stp.motions.PlatformSamples:
        twist, still = np.tile([0, 0, speed, 0, 0, 0], (3, 1)), np.zeros((3, 6))
        place = np.tile(home.translation, (3, 1)), np.tile(home.rotation, (3, 1, 1))
        return stp.motions.PlatformSamples(np.arange(3.0), *place, twist, still)

    found = stp.sweep_demand(planar, leave_the_plane, {"speed": [0.0, 1.0]}, kernels=True)
    (failed,) = found.failures
    assert failed.index == (1,) and failed.error == "ClosureError" and "cannot follow this" in failed.message


def test_designs_may_stand_side_by_side() -> None:
    """The study itself takes points of several designs in any order."""
    study = demand_sweep.DemandStudy(
        design, functools.partial(shake, frequency=5.0), ("radius",), ("amplitude", "chain"), True, 1.0
    )
    points = [{"radius": radius, "amplitude": 0.05} for radius in (0.5, 0.7, 0.5)]
    first, second, third = study(points)
    for name in NAMES:
        np.testing.assert_array_equal(first[name], third[name])
        np.testing.assert_array_equal(second[name], study(points[1:2])[0][name])
    assert np.abs(first["peak_effort"] - second["peak_effort"]).max() > 1.0


@pytest.mark.slow
def test_neither_company_nor_executor_changes_a_bit(tmp_path: Path) -> None:
    """The last point fails in the middle of a call of the kernels."""
    chain = robot("delta")
    motion = functools.partial(shake, chain)
    axes = {"amplitude": [0.01, 0.03, 0.05, 3.0], "frequency": [1.0, 2.0]}
    sweep = functools.partial(stp.sweep_demand, chain, motion, axes, kernels=True)
    whole = sweep()
    assert len(whole.failures) == 2
    same(sweep(chunk=1), whole)
    with ThreadPoolExecutor(4) as pool:
        for chunk in (1, 5):
            same(sweep(executor=pool, chunk=chunk), whole)
    with functions.processes(2) as pool:
        same(sweep(executor=pool, chunk=2), whole)

    def interrupt(stage: str, done: int, total: int) -> None:
        if done >= 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweep(journal=tmp_path / "journal", chunk=5, progress=interrupt)
    same(sweep(journal=tmp_path / "journal"), whole)


def test_a_worker_keeps_a_chain_and_its_kernels() -> None:
    """As pickle carries them: the same robot from another sweep is the one that is there, another robot is not."""

    def carried(chain: stp.ClosedChain) -> stp.ClosedChain:
        return pickle.loads(pickle.dumps(Carried(_digest(chain), chain))).value

    first = carried(stp.load("stewart"))
    assert carried(stp.load("stewart")) is first
    assert carried(stp.load("stewart", gravity=(0, 0, -1.6))) is not first


def test_memory_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = stp.sweep_demand(robot("stewart"), shake_stewart, AXES, kernels=True)
    states: list[int] = []
    plain = demand_sweep.demands_by_kernels

    def noting(kernels: object, motions: Sequence[stp.motions.PlatformSamples], **rule) -> object:
        states.append(sum(map(len, motions)))
        return plain(kernels, motions, **rule)

    monkeypatch.setattr(demand_sweep, "demands_by_kernels", noting)
    monkeypatch.setattr(demand_sweep, "_STATES", 100)
    monkeypatch.setattr(motor_demand_module, "_CHUNK", 32)
    same(stp.sweep_demand(robot("stewart"), shake_stewart, AXES, kernels=True, chunk=12), whole)
    assert sum(states) == 12 * 40 and max(states) <= 100 + 40


def test_motions_may_differ_in_length() -> None:
    chain = robot("stewart")
    home = stp.platform_pose(chain, chain.q_home)

    def instants(count: int) -> stp.motions.PlatformSamples:
        return stp.motions.sinusoidal_motion(np.arange(count) / count, home=home)

    found = stp.sweep_demand(chain, instants, {"count": [1, 500, 7]}, kernels=True)
    for k, count in enumerate([1, 500, 7]):
        demand = stp.motor_demand(chain, instants(count), kernels=False)
        np.testing.assert_allclose(
            found["rms_effort"][k], np.sqrt(np.square(demand.efforts).mean(axis=0)), rtol=1e-12
        )
        np.testing.assert_allclose(found["peak_rate"][k], np.abs(demand.rates).max(axis=0), atol=1e-12)


@pytest.mark.slow
def test_designs_are_points_as_well() -> None:
    axes = {"amplitude": [0.02, 0.1], "radius": [0.4, 0.6, 0.8], "half_angle": [0.2, np.pi / 3 - 0.3]}
    found = stp.sweep_demand(design, functools.partial(shake, frequency=5.0), axes, kernels=True)
    # Base and platform are then similar hexagons, which no chain is built of.
    assert {(failed.index[2], failed.error) for failed in found.failures} == {(1, "InputError")}
    assert len(found.failures) == 6
    for i, amplitude in enumerate(axes["amplitude"]):
        for j, radius in enumerate(axes["radius"]):
            chain = design(radius)
            demand = stp.motor_demand(chain, shake(chain, amplitude, 5.0), kernels=False)
            expected = np.abs(demand.efforts).max(axis=0)
            np.testing.assert_allclose(found["peak_effort"][i, j, 0], expected, rtol=1e-10)
    paired = {"radius": [0.8, 0.4, 0.8], "amplitude": [0.1, 0.02, 0.02]}
    listed = stp.sweep_demand(
        design, functools.partial(shake, frequency=5.0), paired, paired=True, kernels=True
    )
    for k, index in enumerate([(1, 2, 0), (0, 0, 0), (0, 2, 0)]):
        np.testing.assert_array_equal(listed["peak_effort"][k], found["peak_effort"][index])


def test_a_design_is_built_once_and_compiled_where_it_is_worth_it(monkeypatch: pytest.MonkeyPatch) -> None:
    built: list[float] = []
    compiled: list[object] = []

    def counted(radius: float) -> stp.ClosedChain:
        built.append(radius)
        # Without a closed form, so that a handful of states is worth it.
        monkeypatch.setattr(motor_demand_module, "leg_form", lambda chain, form: None)
        return design(radius)

    plain = demand_sweep.demands_by_kernels

    def noting(kernels, motions, **rule) -> object:
        compiled.append(kernels)
        return plain(kernels, motions, **rule)

    monkeypatch.setattr(demand_sweep, "demands_by_kernels", noting)
    axes = {"amplitude": np.linspace(0.01, 0.1, 8), "radius": [0.5, 0.7]}
    motion = functools.partial(shake, frequency=2.0)
    stp.sweep_demand(counted, motion, axes, chunk=3)  # 8 motions of 40 states for each design
    assert sorted(built) == [0.5, 0.7] and len(set(compiled)) == 2 and len(compiled) == 6
    compiled.clear()
    stp.sweep_demand(counted, motion, {"amplitude": [0.01], "radius": [0.5]})
    assert compiled == []


@pytest.mark.slow
def test_threads_compile_without_harm() -> None:
    """Many first calls at the same time, of a chain that nobody has compiled before."""
    for _ in range(2):
        chain = stp.load("rpr_planar")
        motion = functools.partial(shake, chain)
        axes = {"amplitude": np.linspace(0.001, 0.05, 12), "frequency": [1.0]}
        with ThreadPoolExecutor(6) as pool:
            found = stp.sweep_demand(chain, motion, axes, kernels=True, executor=pool, chunk=1)
        same(found, stp.sweep_demand(chain, motion, axes, kernels=True))


def test_a_chain_that_is_bound_to_the_motion_stays() -> None:
    """So that one robot can be asked for the motion that another makes about its own home."""
    chain, other = robot("stewart"), stp.massless_legs(stp.load("stewart_cad"))
    home = stp.platform_pose(other, other.q_home).translation
    asked: list[np.ndarray] = []

    def motion(amplitude: float, chain: stp.ClosedChain) -> stp.motions.PlatformSamples:
        asked.append(stp.platform_pose(chain, chain.q_home).translation)
        return shake(robot("stewart"), amplitude, 1.0)

    stp.sweep_demand(chain, functools.partial(motion, chain=other), {"amplitude": [0.01]})
    np.testing.assert_array_equal(asked[-1], home)
    stp.sweep_demand(chain, motion, {"amplitude": [0.01]})
    np.testing.assert_array_equal(asked[-1], stp.platform_pose(chain, chain.q_home).translation)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"axes": {"amplitude": [0.1], "speed": [1.0]}},
            r"axis 'speed' is no parameter of the motion .*shake",
        ),
        ({"axes": {"amplitude": [0.1]}}, "missing a required argument: 'frequency'"),
        ({"axes": {"amplitude": [0.1], "frequency": [1.0], "chain": [1]}}, "axis 'chain' is no parameter"),
        ({"motion": lambda amplitude, frequency: 3}, r"must give a PlatformSamples, at amplitude=0\.1"),
        ({"motion": 3}, "motion must be a function"),
        ({"chain": "stewart"}, "chain must be a ClosedChain or a function"),
        ({"chain": lambda: 3}, "chain .* must give a ClosedChain"),
        ({"chain": lambda radius: 3}, "missing a required argument: 'radius'"),
        ({"kernels": 3}, "kernels must be True, False or None"),
        ({"chunk": 0}, "chunk must be"),
    ],
)
def test_bad_input_is_refused(changes, words: str) -> None:
    given = {
        "chain": robot("stewart"),
        "motion": shake_stewart,
        "axes": {"amplitude": [0.1], "frequency": [1.0]},
    }
    given |= changes
    if given["motion"] is shake_stewart and "chain" in given["axes"]:
        given["motion"] = shake
    with pytest.raises(InputError, match=words):
        stp.sweep_demand(given.pop("chain"), given.pop("motion"), given.pop("axes"), **given)


def test_a_motion_without_instants_is_refused() -> None:
    chain = robot("stewart")
    home = stp.platform_pose(chain, chain.q_home)
    with pytest.raises(InputError, match="gives no instant at count=0"):
        stp.sweep_demand(
            chain, lambda count: stp.motions.sinusoidal_motion(np.zeros(count), home=home), {"count": [0]}
        )


def test_what_cannot_be_sent_is_refused() -> None:
    lock = threading.Lock()
    with functions.processes(1) as pool, pytest.raises(InputError, match="cannot be sent to other processes"):
        stp.sweep_demand(
            robot("stewart"),
            functools.partial(shake_stewart, frequency=lock),
            {"amplitude": [0.1]},
            executor=pool,
        )


def test_a_journal_knows_the_robot(tmp_path: Path) -> None:
    chain = robot("stewart")
    stp.sweep_demand(chain, shake_stewart, AXES, journal=tmp_path / "journal", kernels=True)
    again = stp.load("stewart")  # the same file, loaded again
    stp.sweep_demand(again, shake_stewart, AXES, journal=tmp_path / "journal", kernels=True)
    for other in (
        stp.massless_legs(chain),
        stp.load("stewart_sps"),
        stp.load("stewart", gravity=(0, 0, -1.6)),
    ):
        with pytest.raises(InputError, match="belongs to another study"):
            stp.sweep_demand(other, shake_stewart, AXES, journal=tmp_path / "journal")


@pytest.mark.parametrize("kernels", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_what_acts_from_outside_counts_at_every_point(kernels: bool, tmp_path: Path) -> None:
    chain, axes = robot("stewart"), {"amplitude": [0.01, 0.02], "frequency": [1.0]}
    push = {chain.platform_link: np.array([0.0, 5.0, -40.0, 1.0, 0.0, 0.0])}
    ship = stp.dynamics.BaseMotion(twist=[0, 0, 0, 0.3, 0, 0], acceleration=[0, 0, 1.0, 0, 0.4, 0])  # pyright: ignore[reportArgumentType]
    journal = tmp_path / "journal"
    acting = {"wrenches": push, "base_motion": ship}
    found = stp.sweep_demand(chain, shake_stewart, axes, kernels=kernels, journal=journal, **acting)
    for k, amplitude in enumerate(axes["amplitude"]):
        samples = shake_stewart(amplitude, 1.0)
        expected = stp.motor_demand(chain, samples, kernels=False, **acting)
        np.testing.assert_allclose(
            found["peak_effort"][k, 0], np.abs(expected.efforts).max(axis=0), rtol=1e-10
        )
    still = stp.sweep_demand(chain, shake_stewart, axes, kernels=kernels)
    assert not np.allclose(still["peak_effort"], found["peak_effort"], rtol=1e-2)
    acting["wrenches"] = {chain.platform_link: push[chain.platform_link] * (1 + 1e-12)}
    with pytest.raises(InputError, match="journal"):
        stp.sweep_demand(chain, shake_stewart, axes, journal=journal, **acting)
    with pytest.raises(InputError, match="wrenches"):
        stp.sweep_demand(chain, shake_stewart, axes, wrenches={"nothing": np.zeros(6)})


def test_the_digest_sees_the_loops_too() -> None:
    chain = robot("stewart")
    first, *others = chain.loops
    moved = replace(first, placement1=first.placement1 * pin.SE3(np.eye(3), np.array([1e-9, 0.0, 0.0])))
    other = replace(chain, mechanism=replace(chain.mechanism, loops=(moved, *others)))
    assert _digest(other) != _digest(chain) == _digest(stp.load("stewart"))


def test_the_digest_sees_every_ratio_of_a_sum(rng: np.random.Generator) -> None:
    chain = gear_train(rng, differential=True)
    last = chain.couplings[-1]
    (name, ratio), *rest = last.others
    moved = replace(last, others=((name, ratio + 1e-9), *rest))
    parts = replace(chain.mechanism, couplings=(*chain.couplings[:-1], moved))
    assert _digest(replace(chain, mechanism=parts)) != _digest(chain)


@pytest.mark.parametrize("own", [{"stiffness": 2.0}, {"force": 1.0}, {"friction": 0.1}, {"damping": 0.1}])
def test_the_digest_sees_what_joints_do(own: dict[str, float]) -> None:
    chain = robot("five_bar")
    for name in (chain.motors[0], chain.loops[0].name):
        one = stp.with_joint_physics(chain, {name: own})
        two = stp.with_joint_physics(chain, {name: {**own, "stiffness": 2.0, "rest": 0.3}})
        assert len({_digest(chain), _digest(one), _digest(two)}) == 3, name


@pytest.mark.slow
def test_the_digest_sees_reels_and_pulleys() -> None:
    chain = cables_8()
    first, *others = chain.loops
    told = [_digest(chain)]
    for cable in ({"ratio": 0.5}, {"radius": 0.06}, {"reel": "winch2"}):
        loops = (replace(first, cable=replace(first.cable, **cable)), *others)
        told.append(_digest(replace(chain, mechanism=replace(chain.mechanism, loops=loops))))
    assert len(set(told)) == 4


def test_the_digest_sees_every_limit() -> None:
    # Balls of the tree (swing and angle), joints that close loops, motors and passive joints, at both ends.
    chains = [
        stp.load("stewart_sps"),
        stp.load(ZOO / "gough_6sps.urdf"),
        stp.load(ZOO / "planetary_gear.urdf"),
    ]
    for chain in chains:
        tried = [_digest(chain)]
        for row, name in enumerate(chain.limits.names):
            for kind in KINDS:
                ball = row >= chain.nv and name.endswith(("swing", "angle"))
                ends = (3.0, 3.1) if ball else ((-9.0, 9.0), (-9.0, 9.1), (-9.1, 9.0), (-9.0, None))
                if not ball or kind == "position":
                    tried += _digests(chain, name, kind, ends)
        assert len(tried) > 20 and len(set(tried)) == len(tried)


def _digests(chain: stp.ClosedChain, name: str, kind: str, ends: Sequence[object]) -> list[str]:
    try:
        return [_digest(stp.with_limits(chain, {name: {kind: end}})) for end in ends]
    except InputError:  # a coordinate that has no such limit
        return []


def test_the_digest_sees_all_that_moves_an_answer() -> None:
    chain = stp.load(ZOO / "planetary_gear.urdf", motors=None)
    assert chain.couplings
    model, mechanism = chain.model.copy(), chain.mechanism
    model.armature = model.armature + 1e-9
    link = mechanism.links[-1].name
    gear = mechanism.couplings[0]
    geared = replace(gear, polynomial=tuple(c + 1e-9 for c in gear.polynomial))
    stewart = robot("stewart")
    first, *rest = stewart.loops
    loops = [
        replace(first, placement2=first.placement2 * pin.SE3(np.eye(3), np.array([0.0, 1e-9, 0.0]))),
        replace(first, axis=first.axis[[1, 2, 0]]),
        replace(first, axis2=first.axis2[[1, 2, 0]]),
        replace(first, length=first.length + 1e-9),
    ]
    moved = stewart.q_home.copy()
    moved[0] += 1e-9
    changed = [
        replace(chain, model=model),
        replace(chain, mechanism=replace(mechanism, couplings=(geared, *mechanism.couplings[1:]))),
        stp.attach_payload(chain, pin.Inertia(1e-6, np.zeros(3), np.eye(3) * 1e-9), link=link),
        stp.load("stewart", gravity=(0, 0, -9.8)),
        replace(stewart, q_home=moved),
        stp.with_platform(stewart, stewart.mechanism.links[-1].name),
        stp.with_motors(stewart, stewart.motors[::-1]),
        *(replace(stewart, mechanism=replace(stewart.mechanism, loops=(loop, *rest))) for loop in loops),
    ]
    digests = [_digest(other) for other in (chain, stewart, *changed)]
    assert len(set(digests)) == len(digests)


def test_a_journal_of_looser_balls_is_refused(tmp_path: Path) -> None:
    chain = stp.load(ZOO / "gough_6sps.urdf")
    ball = next(name for name in chain.limits.names if name.endswith("swing"))
    home = stp.platform_pose(chain, chain.q_home)
    loose, tight = (stp.with_limits(chain, {ball: {"position": most}}) for most in (3.0, 2.0))
    motion = functools.partial(
        stp.motions.sinusoidal_motion, np.arange(5) / 5, home=home, frequency=(1, 0, 0)
    )

    def shake(amplitude: float) -> stp.motions.PlatformSamples:
        return motion(amplitude=(amplitude, 0, 0))

    for limits in (True, False):
        journal = tmp_path / f"journal {limits}"
        stp.sweep_demand(loose, shake, {"amplitude": [0.01]}, limits=limits, journal=journal)
        with pytest.raises(InputError, match="belongs to another study"):
            stp.sweep_demand(tight, shake, {"amplitude": [0.01]}, limits=limits, journal=journal)
    named = tmp_path / "named"
    stp.sweep_demand(loose, shake, {"amplitude": [0.01]}, journal=named, name="mine")
    with pytest.raises(InputError, match="belongs to another study"):
        stp.sweep_demand(loose, shake, {"amplitude": [0.01]}, journal=named, name="mine", limits=True)


def test_no_point_is_no_demand() -> None:
    found = stp.sweep_demand(robot("stewart"), shake_stewart, {"amplitude": [], "frequency": [1.0]})
    assert found.shape == (0, 1) and not found.results
