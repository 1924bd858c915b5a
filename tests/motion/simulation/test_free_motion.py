"""Law 8: a free machine keeps its energy to the integrator's order and its loops closed, however long it runs."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.kernels.choosing import SimulationKernels, simulation_kernels
from stewart_pin.model.description import JointKind
from stewart_pin.motion.simulation.plant import Plant
from stewart_pin.programs.status import StateStatus
from tests.closed_states import random_configuration, random_motion, robot
from tests.mechanisms import arm, five_bar, four_bar, two_bodies


def thrown(chain: stp.ClosedChain, rng: np.random.Generator) -> np.ndarray:
    """Velocity of about one robot size and one radian per second."""
    return random_motion(chain, rng, chain.q_home)[0]


@pytest.mark.parametrize("name", ["stewart", "stewart_sps"])
def test_energy_drift_falls_with_the_fourth_power_of_the_step(name: str, rng: np.random.Generator) -> None:
    chain = robot(name)
    v = thrown(chain, rng)
    drift = []
    for steps in (25, 50):
        run = stp.simulate(chain, chain.q_home, v, duration=0.2, dt=0.2 / steps)
        assert run.success
        assert run.largest_gap < 1e-12  # the loops are closed at every step, whatever its length
        drift.append(np.abs(run.energy - run.energy[0]).max())
    # 2⁴ for order four; higher terms may help.
    assert 12 < drift[0] / drift[1] < 40
    assert drift[1] < 1e-6 * abs(run.energy[0])


def test_redundant_loops_and_other_kinds_keep_their_energy(rng: np.random.Generator) -> None:
    chains = [four_bar(JointKind.SPHERICAL), four_bar(JointKind.REVOLUTE), five_bar(), arm(rng)]
    chains += [two_bodies(kind, rng) for kind in (JointKind.DISTANCE, JointKind.PLANAR, JointKind.UNIVERSAL)]
    for chain in chains:
        v = 0.5 * thrown(chain, rng)
        run = stp.simulate(chain, chain.q_home, v, duration=0.1, dt=2.5e-3)
        assert run.success, (chain.name, run.reason)
        assert run.largest_gap < 1e-12
        # Of the energy's changes between kinds; 1e-6 is far above the 1e-9 seen, far below a wrong sign.
        assert np.abs(run.energy - run.energy[0]).max() < 1e-6 * max(1.0, abs(run.energy[0])), chain.name


@pytest.mark.parametrize(("method", "accuracy"), [("DOP853", 1e-9), ("Radau", 1e-8)])
def test_fixed_steps_converge_to_the_reference(
    method: str, accuracy: float, rng: np.random.Generator
) -> None:
    chain = robot("stewart")
    v = thrown(chain, rng)
    reference = stp.simulate(
        chain, chain.q_home, v, duration=0.1, dt=0.05, method=method, rtol=1e-11, atol=1e-11
    )
    assert reference.success
    assert reference.largest_gap < 1e-12
    errors = []
    for steps in (10, 20):
        run = stp.simulate(chain, chain.q_home, v, duration=0.1, dt=0.1 / steps)
        errors.append(np.abs(run.q[-1] - reference.q[-1]).max())
    # The reference itself is good to `accuracy`.
    assert errors[1] < errors[0] / 12 + accuracy
    assert errors[1] < 1e-7


def test_scipy_methods_treat_redundant_loops() -> None:
    chain = four_bar()
    v = thrown(chain, np.random.default_rng(3))
    reference = stp.simulate(chain, chain.q_home, v, duration=0.4, dt=0.2, method="DOP853")
    run = stp.simulate(chain, chain.q_home, v, duration=0.4, dt=4e-3)
    assert reference.success
    assert reference.largest_gap < 1e-12
    np.testing.assert_allclose(run.q[-1], reference.q[-1], rtol=0, atol=1e-8)


def test_going_on_is_the_same_as_not_having_stopped(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    v = thrown(chain, rng)
    whole = stp.simulate(chain, chain.q_home, v, duration=0.1, dt=2e-3)
    first = stp.simulate(chain, chain.q_home, v, duration=0.04, dt=2e-3)
    rest = stp.simulation.resume(chain, first.final_state, duration=0.06)
    np.testing.assert_array_equal(rest.q[-1], whole.q[-1])
    assert rest.time[-1] == whole.time[-1]
    assert rest.time[0] == first.time[-1]


def test_an_interrupt_loses_nothing(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    v = thrown(chain, rng)
    calls = 0

    def impatient(stage: str, done: int, total: int) -> None:
        nonlocal calls
        calls += 1
        if calls == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        stp.simulate(chain, chain.q_home, v, duration=0.2, dt=2e-3, progress=impatient)
    assert isinstance(caught.value, stp.simulation.SimulationInterrupted)
    run = caught.value.simulation
    assert not run.success
    assert "interrupted" in run.reason
    assert run.time[-1] == pytest.approx(0.04)
    whole = stp.simulate(chain, chain.q_home, v, duration=0.1, dt=2e-3)
    rest = stp.simulation.resume(chain, run.final_state, duration=0.06)
    np.testing.assert_array_equal(rest.q[-1], whole.q[-1])
    with pytest.raises(stp.errors.ConvergenceError, match="interrupted"):
        run.or_raise()


def test_memory_is_set_by_the_record_rate(rng: np.random.Generator) -> None:
    chain = four_bar()
    run = stp.simulate(chain, chain.q_home, np.zeros(chain.nv), duration=0.1, dt=1e-3, record_rate=100.0)
    assert len(run) == 11
    np.testing.assert_allclose(np.diff(run.time), 0.01, atol=1e-12)


def test_the_measured_acceleration_is_the_derivative_of_the_measured_twist(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    run = stp.simulate(chain, chain.q_home, thrown(chain, rng), duration=0.06, dt=1e-3)
    k, h = 30, 1e-3
    twist, position = run.platform.twist, run.platform.position

    def slope(x: np.ndarray) -> np.ndarray:
        return (8 * (x[k + 1] - x[k - 1]) - (x[k + 2] - x[k - 2])) / (12 * h)

    # Fourth-order differences at 1 ms of a motion with rates of about 10/s: 1e-12 · 10⁵, and round-off 1e-13 / h.
    np.testing.assert_allclose(run.platform.acceleration[k], slope(twist), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(run.platform.twist[k, :3], slope(position), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"dt": 0.0}, "dt"),
        ({"dt": 3e-3}, "multiple"),
        ({"method": "Euler"}, "method"),
        ({"stop_on": ("boredom",)}, "stop_on"),
        ({"motors": stp.simulation.Motors(viscous=-1.0)}, "viscous"),
        ({"motors": stp.simulation.Motors(viscous=[1.0, 2.0, 3.0])}, "viscous"),
        ({"controller": lambda t, q, v: np.zeros(2)}, "motor efforts"),
        ({"controller": lambda t, q, v: np.full(6, np.nan)}, "finite"),
    ],
)
def test_bad_input_is_refused(options: dict, message: str) -> None:
    chain = robot("stewart")
    with pytest.raises(stp.errors.InputError, match=message):
        stp.simulate(chain, chain.q_home, np.zeros(chain.nv), **({"duration": 0.01, "dt": 1e-3} | options))


def test_open_loops_are_refused(rng: np.random.Generator) -> None:
    chain = robot("stewart")
    q = chain.q_home.copy()
    q[chain.motor_q_index[0]] += 0.01
    with pytest.raises(stp.errors.InputError, match="close_loops"):
        stp.simulate(chain, q, np.zeros(chain.nv), duration=0.01)
    with pytest.raises(stp.errors.InputError, match="platform_motion"):
        stp.simulate(chain, chain.q_home, rng.normal(size=chain.nv), duration=0.01)


@pytest.mark.parametrize("name", ["stewart", "four_bar"])
def test_kernels_change_nothing(name: str, rng: np.random.Generator) -> None:
    """The same fall by compiled code and by the careful way: round-off of a thousand steps apart."""
    chain = robot(name)
    q = random_configuration(chain, rng, 0.05)
    v, _ = random_motion(chain, rng, q)
    runs = [
        stp.simulate(chain, q, 0.3 * v, duration=0.2, dt=2e-4, kernels=choice) for choice in (True, False)
    ]
    assert all(run.success for run in runs)
    apart = pin.difference(chain.model, runs[0].q[-1], runs[1].q[-1]) / chain.tangent_scale
    assert 0 <= np.abs(apart).max() <= 1e-11
    np.testing.assert_allclose(runs[0].energy, runs[1].energy, rtol=1e-11)


def test_a_kernel_that_loses_digits_is_left(rng: np.random.Generator) -> None:
    """The plant compares, and goes on in the careful way."""
    chain = robot("stewart")
    still = np.zeros(chain.nv)

    class Wrong:
        status = StateStatus.OK
        called = 0

        def __call__(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            self.called += 1
            return np.full(chain.nv, 1.0), np.zeros(chain.nc)

    wrong = Wrong()
    kernels = SimulationKernels(wrong, None)  # type: ignore[arg-type]
    plant = Plant(chain, chain.q_home, still, np.zeros(chain.nu), kernels)
    expected = stp.forward_dynamics(chain, chain.q_home, still, np.zeros(6)).a
    np.testing.assert_allclose(plant.acceleration(chain.q_home, still, np.zeros(6)), expected, atol=1e-9)
    assert wrong.called == 1  # tried once, at the start
    plant._kernel = wrong
    plant.watch(chain.q_home, still)
    np.testing.assert_allclose(plant.acceleration(chain.q_home, still, np.zeros(6)), expected, atol=1e-9)


@pytest.mark.parametrize(
    "name", ["stewart", pytest.param("delta", marks=pytest.mark.slow), "four_bar", "rpr_planar"]
)
def test_compiled_projection_is_the_careful_one(name: str, rng: np.random.Generator) -> None:
    """The shortest displacement onto closed loops and its velocity; what is far from closed is left to the careful."""
    chain = robot(name)
    q = random_configuration(chain, rng, 0.05)
    v, _ = random_motion(chain, rng, q)
    compiled = simulation_kernels(chain, 0, True)
    assert compiled is not None and compiled.projection is not None
    careful = Plant(chain, q, v, np.zeros(chain.nu))
    fast = Plant(chain, q, v, np.zeros(chain.nu), compiled)
    assert fast._projector is not None
    for size, status in ((1e-9, StateStatus.OK), (1e-7, StateStatus.OK), (1e-5, StateStatus.OUT_OF_BOUNDS)):
        off = size * chain.tangent_scale * rng.uniform(-1, 1, chain.nv)
        beside = pin.integrate(chain.model, q, off)
        open_v = v + chain.tangent_scale * rng.uniform(-1, 1, chain.nv)
        (q1, v1, gap1), (q2, v2, gap2) = careful.project(beside, open_v), fast.project(beside, open_v)
        assert fast._projector.status == status
        apart = pin.difference(chain.model, q1, q2) / chain.tangent_scale
        assert np.abs(apart).max() < max(1e-13, size**2)  # the curvature of both ways
        assert np.abs((v1 - v2) / chain.tangent_scale).max() < 20 * size  # one matrix or a newer one
        assert max(gap1, gap2) < 1e-12
        np.testing.assert_allclose(stp.loop_jacobian(chain, q2) @ v2, 0.0, atol=20 * size)


def test_a_projection_that_loses_digits_is_left(rng: np.random.Generator) -> None:
    chain = robot("four_bar")
    compiled = simulation_kernels(chain, 0, True)
    assert compiled is not None

    class Wrong:
        status = StateStatus.OK

        def __call__(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            return q, v, np.zeros(1)

    wrong = SimulationKernels(compiled.acceleration, Wrong())  # type: ignore[arg-type]
    plant = Plant(chain, chain.q_home, np.zeros(chain.nv), np.zeros(chain.nu), wrong)
    assert plant._projector is None
    plant._projector = Wrong()  # type: ignore[assignment]
    plant.watch(chain.q_home, np.zeros(chain.nv))
    assert plant._projector is None


def test_an_arm_needs_no_projection() -> None:
    chain = robot("arm_3r_spatial")
    compiled = simulation_kernels(chain, 0, True)
    assert compiled is not None and compiled.projection is None
    fall = stp.simulate(chain, chain.q_home, np.zeros(chain.nv), duration=0.02, kernels=True)
    same = stp.simulate(chain, chain.q_home, np.zeros(chain.nv), duration=0.02, kernels=False)
    np.testing.assert_allclose(fall.q[-1], same.q[-1], atol=1e-13)


@pytest.mark.parametrize("record_rate", [None, 250.0])
def test_controllers_are_asked_four_times_a_step(record_rate: float | None) -> None:
    """The instants that are recorded and judged are those where steps begin."""
    chain, asked = robot("four_bar"), list[float]()

    def push(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        asked.append(t)
        return np.zeros(1)

    run = stp.simulate(
        chain, chain.q_home, np.zeros(chain.nv), push, duration=0.1, dt=1e-3, record_rate=record_rate
    )
    watched = 0.1 * 50  # states where ways of computing are chosen anew
    assert run.success and 4 * 100 < len(asked) <= 4 * 100 + 1 + watched
