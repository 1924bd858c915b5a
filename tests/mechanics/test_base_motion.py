"""A ground that moves: three formulations agree, and what it does is that of other gravity where it is no more."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, UnsupportedError
from tests.closed_states import close, random_configuration, random_motion, robot, slow_but_for_few

ROBOTS = ("stewart", "stewart_sps", "delta", "five_bar", "four_bar", "gear_train", "universal", "planar")
AGREE = 1e-9


@cache
def effective(name: str) -> stp.ClosedChain:
    """Give some joints rotors, damping and springs."""
    chain = robot(name)
    own = {"armature": 0.3, "damping": 0.2, "stiffness": 2.0, "friction": 0.1}
    hinges = [joint.name for joint in chain.mechanism.joints if joint.has_axis]
    return stp.with_joint_physics(chain, dict.fromkeys(hinges, own))


def ship(rng: np.random.Generator) -> stp.dynamics.BaseMotion:
    return stp.dynamics.BaseMotion(pin.exp3(rng.normal(size=3)), *rng.normal(size=(2, 6)))


def sailing(name: str, rng: np.random.Generator) -> tuple[Any, dict[str, np.ndarray]]:
    chain = effective(name)
    q = random_configuration(chain, rng)
    v, a = random_motion(chain, rng, q)
    bodies = [link.name for link in chain.mechanism.links if link.inertia is not None]
    return chain.at(q, v, a, base_motion=ship(rng)), {bodies[-1]: rng.normal(size=6)}


@pytest.mark.parametrize("name", slow_but_for_few(ROBOTS, ("stewart", "five_bar", "gear_train")))
def test_formulations_agree(name: str, rng: np.random.Generator) -> None:
    state, wrenches = sailing(name, rng)
    found = stp.inverse_dynamics(state, wrenches=wrenches, throw=False)
    if not stp.mobility(state.chain).motors_sufficient:
        pytest.skip("its motors do not hold it")
    by_bodies = stp.inverse_dynamics(state, method="constraint_matrix", wrenches=wrenches)
    close(by_bodies.tau_motor, found.tau_motor, AGREE)
    resting = stp.inverse_dynamics(state.chain, state.q, state.v, state.a, wrenches=wrenches)
    assert np.abs(resting.tau_motor - found.tau_motor).max() > 1e-3 * np.abs(found.tau_motor).max()
    forth = stp.forward_dynamics(state, tau_motor=found.tau_motor, wrenches=wrenches)
    active = state.chain.motor_index
    close(forth.a[active], state.a[active], 1e-7)
    plain = robot(name).at(state.q, state.v, base_motion=state.base_motion)
    tau = rng.normal(size=plain.chain.nu) * np.abs(found.tau_motor).max()
    by_recursion = stp.dynamics.closed_chain_articulated_body(plain, tau_motor=tau, wrenches=wrenches)
    close(by_recursion.a, stp.forward_dynamics(plain, tau_motor=tau, wrenches=wrenches).a, 1e-8)


@pytest.mark.parametrize("name", ["stewart", "five_bar"])
def test_a_ground_that_speeds_up_is_other_gravity(name: str, rng: np.random.Generator) -> None:
    state, _ = sailing(name, rng)
    chain, push, turn = robot(name), rng.normal(size=3), state.base_motion.rotation
    moved = stp.dynamics.BaseMotion(
        turn, np.array([3.0, -2.0, 1.0, 0, 0, 0]), np.concatenate([push, np.zeros(3)])
    )
    model = chain.model.copy()
    model.gravity = pin.Motion(turn.T @ (chain.gravity - push), np.zeros(3))
    other = stp.ClosedChain(chain.mechanism, model, chain.motors, chain.platform, chain.q_home)
    here, there = chain.at(state.q, state.v, state.a, base_motion=moved), other.at(state.q, state.v, state.a)
    verbs: dict[str, Callable[[stp.State], np.ndarray]] = {
        "inverse": lambda s: stp.inverse_dynamics(s).tau_motor,
        "bodies": lambda s: stp.inverse_dynamics(s, method="constraint_matrix").tau_motor,
        "forward": lambda s: stp.forward_dynamics(s, tau_motor=np.zeros(chain.nu)).a,
        "reactions": lambda s: np.concatenate([np.r_[p.force, p.moment] for p in stp.joint_reactions(s)]),
        "slopes": lambda s: stp.dynamics.inverse_dynamics_derivatives(s).tau_q,
        "law": lambda s: (lambda law: law.c + law.g - law.w)(stp.operational_dynamics(s)),
    }
    for verb in verbs.values():
        close(verb(here), verb(there), AGREE)


@pytest.mark.parametrize("name", ["stewart", "five_bar"])
def test_verbs_of_one_state_fit_together(name: str, rng: np.random.Generator) -> None:
    state, wrenches = sailing(name, rng)
    effort = stp.inverse_dynamics(state, wrenches=wrenches)
    law = stp.operational_dynamics(state, wrenches=wrenches)
    rates = law.motion.gamma
    x_acceleration = np.linalg.lstsq(law.motion.G, state.a - rates)[0]
    close(law.M @ x_acceleration + law.c + law.g - law.w, effort.tau_motor, AGREE)
    # Derivatives along the motions that keep the loops closed, v and a changed as the loops need it.
    found = stp.dynamics.inverse_dynamics_derivatives(state, wrenches=wrenches)
    chain, step = state.chain, 1e-5
    along = state.motions.basis[:, 0] * chain.tangent_scale

    def moved(h: float) -> Any:
        q = stp.close_loops(chain, pin.integrate(chain.model, state.q, h * along)).q
        near = chain.at(q)
        v = state.v - near.motions.across(near.J_c @ state.v / chain.row_sizes) * chain.tangent_scale
        left = near.J_c @ state.a + chain.at(q, v).loop_bias
        a = state.a - near.motions.across(left / chain.row_sizes) * chain.tangent_scale
        return chain.at(q, v, a, base_motion=state.base_motion)

    ahead, back = moved(step), moved(-step)
    change = [
        (pin.difference(chain.model, back.q, ahead.q)) / (2 * step),
        (ahead.v - back.v) / (2 * step),
        (ahead.a - back.a) / (2 * step),
    ]
    predicted = found.tau_q @ change[0] + found.tau_v @ change[1] + found.tau_a @ change[2]
    taus = [stp.inverse_dynamics(s, wrenches=wrenches).tau_motor for s in (ahead, back)]
    measured = (taus[0] - taus[1]) / (2 * step)
    assert np.abs(predicted - measured).max() < 1e-5 * np.abs(measured).max()


def test_the_ground_is_held_by_what_the_whole_robot_loses(rng: np.random.Generator) -> None:
    """Reactions at the feet are what moves all bodies on: momentum in the inertial frame, by differences in time."""
    chain, base = robot("stewart"), ship(rng)
    q = random_configuration(chain, rng)
    v, a = random_motion(chain, rng, q)
    parts = stp.joint_reactions(chain.at(q, v, a, base_motion=base))
    force = sum(
        part.force * (1 if part.source == "base" else -1)
        for part in parts
        if "base" in (part.source, part.target)
    )
    mass = sum(body.mass for body in list(chain.model.inertias)[1:])  # the first is the ground's

    def centre(t: float) -> np.ndarray:
        """Mass times the centre of mass in the inertial frame."""
        spin = pin.exp3(t * base.twist[3:] + t * t / 2 * base.acceleration[3:])
        at = stp.close_loops(chain, pin.integrate(chain.model, q, t * v + t * t / 2 * a)).q
        local = pin.centerOfMass(chain.model, chain.model.createData(), at)
        return mass * (spin @ base.rotation @ local + t * base.twist[:3] + t * t / 2 * base.acceleration[:3])

    h = 1e-3
    rate = (centre(h) - 2 * centre(0.0) + centre(-h)) / h**2 - mass * chain.gravity
    np.testing.assert_allclose(base.rotation @ force, rate, atol=1e-4 * np.abs(rate).max())


def test_what_knows_no_moving_ground_says_so() -> None:
    chain = robot("stewart")
    state = chain.at(chain.q_home, base_motion=stp.dynamics.BaseMotion())
    asks: tuple[Callable[[], object], ...] = (
        lambda: stp.linearise(state),
        lambda: stp.natural_frequencies(state, motor_stiffness=1e6),
        lambda: stp.polytopes.wrench_polytope(state),
        lambda: stp.forward_dynamics(state, tau_motor=np.zeros(6), method="constraint_dynamics"),
    )
    for ask in asks:
        with pytest.raises(UnsupportedError, match="knows of no ground that moves"):
            ask()
    with pytest.raises(InputError, match="base_motion must be a BaseMotion, got dict"):
        chain.at(chain.q_home, base_motion={"twist": np.zeros(6)})  # pyright: ignore[reportArgumentType]
