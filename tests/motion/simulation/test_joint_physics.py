"""Springs, dampers and dry friction of joints in a simulation: closed forms, and what the account says of them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import Joint, JointKind, Link, Mechanism
from tests.closed_states import random_motion, robot
from tests.mechanisms import ONE, X

FIVE_BAR = {
    "left_hip": {"damping": 0.02, "stiffness": (0.4, 0.05, 0.2), "rest": 0.2, "force": 0.1, "armature": 0.01},
    "left_knee": {"damping": 0.01, "stiffness": 0.3},
    "tip_pin": {"damping": 0.015, "stiffness": (0.2, 0.0, 0.1), "rest": 0.4, "force": -0.07},
}
STEWART = {
    "leg1": {"damping": 30.0, "stiffness": 900.0, "rest": 0.9, "armature": 3.0},
    "leg2_x": {"damping": 2.0, "stiffness": 5.0},
    "leg3_ball": {"damping": 1.5, "stiffness": 4.0},
}
PHYSICS = {"five_bar": FIVE_BAR, "stewart": STEWART}


def sled(**own: object) -> stp.ClosedChain:
    """Two kilograms on a slide along x, horizontal."""
    body = pin.Inertia(2.0, np.zeros(3), 0.01 * np.eye(3))
    joint = Joint("slide", JointKind.PRISMATIC, "ground", "sled", ONE, axis=X, independent=True)
    mechanism = Mechanism("sled", (Link("ground"), Link("sled", body)), (joint,), (), platform="sled")
    chain = build_chain(mechanism)
    return stp.with_joint_physics(chain, {"slide": own}) if own else chain


def unexplained(run: stp.simulation.Simulation) -> float:
    """Energy that the account cannot explain [J]."""
    return float(np.abs(run.energy + run.dissipated - run.supplied - run.outside - run.energy[0]).max())


@pytest.mark.parametrize(("method", "dt"), [("fixed", 2e-3), ("DOP853", 0.04)])
def test_a_mass_on_a_spring_and_a_damper_follows_its_closed_form(method: str, dt: float) -> None:
    m, c, k, rest = 2.0, 3.0, 50.0, 0.1
    chain = sled(damping=c, stiffness=k, rest=rest)
    run = stp.simulate(chain, [0.5], [0.0], duration=0.4, dt=dt, method=method, rtol=1e-10, atol=1e-10)
    decay = c / (2 * m)
    omega = np.sqrt(k / m - decay**2)
    t, x0 = run.time, 0.5 - rest
    x = x0 * np.exp(-decay * t) * (np.cos(omega * t) + decay / omega * np.sin(omega * t))
    # Order four: (ω dt)⁵ per step, 1e-10 over the thousand of them.
    np.testing.assert_allclose(run.q[:, 0] - rest, x, rtol=0, atol=1e-9)
    heat = k * x0**2 / 2 - run.energy
    np.testing.assert_allclose(run.dissipated, heat, rtol=0, atol=1e-8)
    assert run.energy[0] == pytest.approx(k * x0**2 / 2)


def test_a_stiffening_spring_and_a_damper_agree_with_an_equation_by_hand() -> None:
    own = {"stiffness": (40.0, 10.0, 300.0), "rest": 0.1, "force": 1.5, "damping": 0.7, "armature": 0.5}
    run = stp.simulate(sled(**own), [0.6], [-1.0], duration=0.5, dt=2e-3)

    def rates(t: float, y: np.ndarray) -> list[float]:
        x = y[0] - 0.1
        return [y[1], (1.5 - 40 * x - 10 * x**2 - 300 * x**3 - 0.7 * y[1]) / 2.5]

    judge = solve_ivp(
        rates, (0.0, 0.5), [0.6, -1.0], method="DOP853", rtol=1e-12, atol=1e-12, t_eval=run.time
    )
    np.testing.assert_allclose(run.q[:, 0], judge.y[0], rtol=0, atol=1e-7)


@pytest.mark.parametrize("name", ["five_bar", "stewart"])
def test_the_account_closes_with_springs_and_dampers_to_the_order_of_the_integrator(
    name: str, rng: np.random.Generator
) -> None:
    chain = stp.with_joint_physics(robot(name), PHYSICS[name])
    v = random_motion(chain, rng, chain.q_home)[0]
    left = []
    for dt in (4e-3, 2e-3):
        run = stp.simulate(chain, chain.q_home, v, duration=0.12, dt=dt)
        assert run.success, run.reason
        left.append(unexplained(run))
    assert left[1] < left[0] / 12
    assert left[1] < 1e-6 * run.dissipated[-1]


def test_springs_alone_keep_the_energy(rng: np.random.Generator) -> None:
    springs = {
        joint: {name: value for name, value in own.items() if name != "damping"}
        for joint, own in FIVE_BAR.items()
    }
    chain = stp.with_joint_physics(robot("five_bar"), springs)
    v = random_motion(chain, rng, chain.q_home)[0]
    drift = []
    for dt in (4e-3, 2e-3):
        run = stp.simulate(chain, chain.q_home, v, duration=0.12, dt=dt)
        assert run.dissipated[-1] == 0.0
        drift.append(np.abs(run.energy - run.energy[0]).max())
    assert drift[1] < drift[0] / 12


@pytest.mark.parametrize("method", ["DOP853", "Radau"])
def test_all_ways_of_stepping_agree_on_springs_and_dampers(method: str, rng: np.random.Generator) -> None:
    chain = stp.with_joint_physics(robot("five_bar"), FIVE_BAR)
    v = random_motion(chain, rng, chain.q_home)[0]
    a = stp.simulate(chain, chain.q_home, v, duration=0.04, dt=0.02, method=method)
    b = stp.simulate(chain, chain.q_home, v, duration=0.04, dt=5e-4)
    np.testing.assert_allclose(a.q[-1], b.q[-1], rtol=0, atol=1e-8)


def test_a_damper_too_stiff_for_the_step_is_refused_with_the_step_that_does() -> None:
    chain = sled(damping=2000.0)
    with pytest.raises(stp.errors.InputError, match=r"dampers.*slide.*1e\+03/s.*0\.0028 s.*Radau"):
        stp.simulate(chain, [0.0], [1.0], duration=0.1, dt=5e-3)
    run = stp.simulate(chain, [0.0], [1.0], duration=0.1, dt=5e-3, method="Radau")
    assert run.success
    assert run.q[-1, 0] == pytest.approx(1e-3, rel=1e-6)
    with pytest.raises(stp.errors.InputError, match=r"springs.*slide.*rad/s"):
        stp.simulate(sled(stiffness=2e6), [0.1], [0.0], duration=0.1, dt=5e-3)
    with pytest.raises(stp.errors.InputError, match="dampers"):
        motors = stp.simulation.Motors(viscous=2000.0)
        stp.simulate(sled(), [0.0], [1.0], duration=0.1, dt=5e-3, motors=motors)
    # A spring that stiffens on the way ends the run there.
    run = stp.simulate(sled(stiffness=(1.0, 0.0, 1e6)), [0.0], [80.0], duration=0.1, dt=2.5e-3)
    assert not run.success
    assert "smaller dt" in run.reason
