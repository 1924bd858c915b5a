"""A run judges itself: energy, singular loops, bits of a run that goes on, arguments, interrupts, whole turns."""

from __future__ import annotations

from dataclasses import fields
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.motion.simulation.record import SimulationInterrupted
from stewart_pin.motion.simulation.steppers import METHODS
from stewart_pin.state.state import State
from tests.closed_states import random_motion, robot, slow_but_for_few
from tests.mechanisms import five_bar, four_bar


def spun(chain: stp.ClosedChain, rate: float) -> np.ndarray:
    """Velocity of a mechanism of one freedom, its motor at a given rate."""
    motion = np.linalg.svd(State(chain, chain.q_home).rows)[2][-1] * chain.tangent_scale
    return motion / motion[chain.motor_index[0]] * rate


def test_a_step_too_large_for_the_motion_ends_the_run() -> None:
    chain = robot("four_bar")
    run = stp.simulate(chain, chain.q_home, spun(chain, 300.0), duration=1.0)
    assert not run.success
    assert run.events[-1].kind == "energy"
    for word in ("energy account", f"{run.time[-1]:g} s", "J", "smaller dt", "DOP853"):
        assert word in run.reason
    assert abs(run.energy[-2] - run.energy[0]) <= 0.01 * run.energy[0] < abs(run.energy[-1] - run.energy[0])


def test_a_step_that_resolves_the_motion_keeps_the_turns() -> None:
    chain = robot("four_bar")
    run = stp.simulate(chain, chain.q_home, spun(chain, 300.0), duration=1.0, dt=1e-4, kernels=True)
    assert run.success
    np.testing.assert_allclose(run.energy, run.energy[0], rtol=1e-4)
    motor = chain.motor_q_index[0]
    assert (run.q[-1, motor] - run.q[0, motor]) / (2 * np.pi) == pytest.approx(41.74, abs=0.005)


CONTINUOUS = """<robot name="wheel"><link name="base"/><link name="rim"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="axle" type="continuous"><parent link="base"/><child link="rim"/><axis xyz="0 0 1"/></joint></robot>"""


@pytest.mark.parametrize(("method", "dt"), [("fixed", 0.05), ("DOP853", 0.05), ("LSODA", 0.05)])
def test_continuous_joints_know_whole_turns(method: str, dt: float, tmp_path: Path) -> None:
    """Steps of 2.4 turns."""
    path = tmp_path / "wheel.urdf"
    path.write_text(CONTINUOUS)
    chain = stp.load(str(path), motors=("axle",), platform="rim")
    run = stp.simulate(chain, chain.q_home, np.array([-300.0]), duration=1.0, dt=dt, method=method)
    assert run.success
    np.testing.assert_allclose(run.q[:, 0], -300.0 * run.time, rtol=0, atol=1e-6)
    on = stp.simulation.resume(chain, run.final_state, duration=dt, method=method)
    assert on.q[-1, 0] == pytest.approx(-300.0 * (1 + dt), abs=1e-6)


def _controllers(chain: stp.ClosedChain) -> dict[str, partial]:
    home = stp.platform_pose(chain, chain.q_home)
    reference = partial(stp.motions.sinusoidal_motion, home=home, amplitude=np.array([0.0, 0.0, 0.02]))
    pid = partial(stp.control.LegPID, chain, reference, kp=1e5, kd=3e3, ki=2e5)
    return {
        "none": lambda: None,
        "function": lambda: lambda t, q, v: 50.0 * np.sin(20 * t) - 10.0 * v[chain.motor_index],
        "dynamic": pid,
        "sampled": lambda: stp.control.SampledController(chain, pid(), rate=250.0),
    }


def assert_continues(chain: stp.ClosedChain, q, v, make, **options) -> None:
    dt = options.pop("dt")
    whole = stp.simulate(chain, q, v, make(), duration=8 * dt, dt=dt, **options)
    for cut in (1, 3, 6) if options.get("method", "fixed") == "fixed" else (3,):
        controller = make()
        first = stp.simulate(chain, q, v, controller, duration=cut * dt, dt=dt, **options)
        rest = stp.simulation.resume(chain, first.final_state, controller, duration=(8 - cut) * dt, **options)
        for field in ("time", "q", "v", "tau_motor", "energy", "supplied", "dissipated", "gap"):
            np.testing.assert_array_equal(getattr(rest, field), getattr(whole, field)[cut:], err_msg=field)
        for field in fields(whole.platform):
            a, b = getattr(rest.platform, field.name), getattr(whole.platform, field.name)
            np.testing.assert_array_equal(a, b[cut:], err_msg=field.name)


@pytest.mark.parametrize("kind", ["none", "function", "dynamic", "sampled"])
@pytest.mark.parametrize("method", slow_but_for_few(["fixed", *METHODS], ["fixed", "RK45", "BDF"]))
def test_going_on_gives_the_same_bits(method: str, kind: str, rng: np.random.Generator) -> None:
    chain = robot("stewart")
    v = 0.1 * random_motion(chain, rng, chain.q_home)[0]
    assert_continues(chain, chain.q_home, v, _controllers(chain)[kind], method=method, dt=2e-3)


@pytest.mark.parametrize("make", [four_bar, five_bar])
@pytest.mark.parametrize("method", ["fixed", "RK45", "Radau"])
def test_redundant_loops_go_on_to_the_same_bits(method: str, make) -> None:
    chain = make()
    v = random_motion(chain, np.random.default_rng(3), chain.q_home)[0]
    # Loop rows are chosen anew 50 times a second: within the run.
    assert_continues(chain, chain.q_home, v, lambda: None, method=method, dt=5e-3)


def test_compiled_code_goes_on_to_the_same_bits(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    v = 0.1 * random_motion(chain, rng, chain.q_home)[0]
    assert_continues(chain, chain.q_home, v, lambda: None, kernels=True, dt=2e-3)


def parallelogram() -> stp.ClosedChain:
    """Links of equal lengths in pairs: in line, its loops are singular."""
    return four_bar(lengths=(0.3, 0.9, 0.3), ground=0.9)


@pytest.mark.parametrize("method", ["fixed", "RK45", "DOP853", "Radau", "BDF", "LSODA"])
def test_a_singularity_of_the_loops_is_an_event(method: str) -> None:
    chain = parallelogram()
    options = {} if method == "fixed" else {"rtol": 1e-7, "atol": 1e-7}
    run = stp.simulate(
        chain,
        chain.q_home,
        spun(chain, 4.0),
        duration=2.0,
        dt=5e-3,
        method=method,
        stop_on="singularity",
        **options,
    )
    kinds = [event.kind for event in run.events]
    assert "singularity" in kinds, run.reason
    assert not run.success
    assert run.reason
    first = run.events[kinds.index("singularity")]
    assert first.value < first.limit


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({name: bad}, name)
        for name in ("duration", "dt", "rtol", "atol", "record_rate", "singular", "start_time")
        for bad in (np.nan, np.inf, -np.inf, "1e-3", [1e-3], True, 1e-3j)
    ]
    + [
        ({name: bad}, name)
        for name in ("duration", "dt", "rtol", "atol", "record_rate")
        for bad in (0.0, -1e-3)
    ]
    + [
        ({"singular": -1e-3}, "singular"),
        ({"singular": 1.0}, "singular"),
        ({"rtol": 1e-17}, "rtol"),
        ({"rtol": 2.0}, "rtol"),
        ({"method": None}, "method"),
        ({"method": ["fixed"]}, "method"),
        ({"stop_on": 3}, "stop_on"),
        ({"progress": 3}, "progress"),
    ],
)
def test_arguments_are_checked_at_the_door(options: dict, message: str) -> None:
    chain = robot("four_bar")
    ask = {"duration": 0.01, "dt": 1e-3} | options
    with pytest.raises(stp.errors.InputError, match=message):
        stp.simulate(chain, chain.q_home, np.zeros(chain.nv), **ask)
    if message != "start_time":
        state = stp.simulate(chain, chain.q_home, np.zeros(chain.nv), duration=1e-3).final_state
        with pytest.raises(stp.errors.InputError, match=message):
            stp.simulation.resume(chain, state, **ask)


def test_states_to_go_on_from_are_checked() -> None:
    chain = robot("four_bar")
    with pytest.raises(stp.errors.InputError, match="final_state"):
        stp.simulation.resume(chain, chain.q_home, duration=1e-3)
    other = robot("stewart")
    state = stp.simulate(other, other.q_home, np.zeros(other.nv), duration=1e-3).final_state
    with pytest.raises(stp.errors.InputError, match="state"):
        stp.simulation.resume(chain, state, duration=1e-3)


DOOR = """<robot name="door"><link name="wall"/><link name="leaf"><inertial><origin xyz="0.4 0.1 1"/>
<mass value="5"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="low" type="revolute" independent="true"><parent link="wall"/><child link="leaf"/><axis xyz="1 0 0"/>
<limit lower="-3" upper="3" effort="10" velocity="10"/></joint>
<loop name="high" type="revolute"><predecessor link="wall"><origin xyz="2 0 0"/></predecessor>
<successor link="leaf"><origin xyz="2 0 0"/></successor><axis xyz="1 0 0"/></loop></robot>"""


@pytest.mark.parametrize("method", ["fixed", *METHODS])
def test_purely_redundant_loops_are_simulated(method: str, tmp_path: Path) -> None:
    """A door on two hinges in line falls as on one; parallel cranks turn."""
    path = tmp_path / "door.urdf"
    path.write_text(DOOR)
    door = stp.load(str(path), platform="leaf")
    assert door.generic.rank == 0
    run = stp.simulate(door, door.q_home, np.zeros(door.nv), duration=0.2, dt=1e-2, method=method)
    assert run.success
    np.testing.assert_allclose(run.energy, run.energy[0], rtol=1e-7)
    assert run.q[-1, 0] == pytest.approx(-0.5 * 5 * 9.81 * 0.1 / 6.05 * 0.2**2, rel=0.05)


def test_an_interrupt_carries_the_part_that_ran() -> None:
    chain = robot("four_bar")

    def stop(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        if t > 0.0255:
            raise KeyboardInterrupt
        return np.zeros(chain.nu)

    with pytest.raises(KeyboardInterrupt) as caught:
        stp.simulate(chain, chain.q_home, np.zeros(chain.nv), stop, duration=1.0, kernels=False)
    assert isinstance(caught.value, SimulationInterrupted)
    assert caught.value.simulation.time[-1] == pytest.approx(0.025)
    assert str(caught.value).startswith("interrupted at 0.025 s")


def test_no_journal_keeps_a_run_that_was_cut(tmp_path: Path) -> None:
    chain, journal, cut = robot("four_bar"), tmp_path / "runs.jsonl", [True]

    def stop(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        if cut[0] and t > 4e-3:
            raise KeyboardInterrupt
        return np.zeros(chain.nu)

    def end(start: float) -> float:
        run = stp.simulate(
            chain, chain.q_home, start * np.zeros(chain.nv), stop, duration=0.01, kernels=False
        )
        return float(run.time[-1])

    with pytest.raises(KeyboardInterrupt):
        stp.sweep(end, {"start": [1.0, 2.0]}, journal=journal)
    cut[0] = False
    again = stp.sweep(end, {"start": [1.0, 2.0]}, journal=journal)
    np.testing.assert_allclose(np.ravel(again["value"]), 0.01)
