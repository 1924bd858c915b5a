"""Simulations on a ground that moves: closed forms, other gravity, and the energy that the ground gives."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import InputError
from stewart_pin.model.description import Joint, JointKind, Link, Mechanism
from tests.closed_states import random_configuration, robot
from tests.mechanisms import X, at


def bead() -> stp.ClosedChain:
    """Build 2 kg on a level slide."""
    links = (Link("ground"), Link("bead", pin.Inertia(2.0, np.zeros(3), 0.01 * np.eye(3))))
    joint = Joint("slide", JointKind.PRISMATIC, "ground", "bead", at(), X, independent=True)
    return build_chain(Mechanism("bead", links, (joint,), platform="bead"))


def test_a_bead_on_a_turning_slide_flies_out() -> None:
    rate = 2.0
    spin = stp.dynamics.BaseMotion(twist=np.array([0, 0, 0, 0, 0, rate]))
    run = stp.simulate(bead(), [0.1], [0.0], duration=1.0, dt=2e-3, base_motion=spin)
    np.testing.assert_allclose(run.q[:, 0], 0.1 * np.cosh(rate * run.time), rtol=1e-9)
    kinetic = 0.5 * 2.0 * run.v[:, 0] ** 2
    np.testing.assert_allclose(run.audit.outside, kinetic, atol=1e-9)  # the centrifugal force alone does work
    assert np.abs(run.audit.unexplained).max() < 1e-9


def test_a_floor_that_shakes_shakes_what_stands_on_springs() -> None:
    """Transmissibility of a damped oscillator, once its own swing has died away."""
    m, k, c, f, lift = 2.0, 800.0, 40.0, 2.5, 0.01
    w = 2 * np.pi * f
    chain = stp.with_joint_physics(bead(), {"slide": {"stiffness": k, "damping": c}})

    def floor(t: float) -> stp.dynamics.BaseMotion:
        return stp.dynamics.BaseMotion(
            twist=np.array([lift * w * np.cos(w * t), 0, 0, 0, 0, 0]),
            acceleration=np.array([-lift * w * w * np.sin(w * t), 0, 0, 0, 0, 0]),
        )

    run = stp.simulate(chain, [0.0], [0.0], duration=3.0, dt=2e-3, base_motion=floor)
    late = run.time > 2.0
    absolute = run.q[late, 0] + lift * np.sin(w * run.time[late])
    s = 1j * w
    answer = lift * (k + c * s) / (m * s * s + c * s + k)
    expected = np.abs(answer) * np.sin(w * run.time[late] + np.angle(answer))
    np.testing.assert_allclose(absolute, expected, atol=1e-7)


def test_a_ground_that_speeds_up_is_other_gravity(rng: np.random.Generator) -> None:
    chain = robot("five_bar")
    q, push = random_configuration(chain, rng, 0.1), np.array([1.0, -2.0, 3.0])
    model = chain.model.copy()
    model.gravity = pin.Motion(chain.gravity - push, np.zeros(3))
    other = stp.ClosedChain(chain.mechanism, model, chain.motors, chain.platform, chain.q_home)
    ground = stp.dynamics.BaseMotion(acceleration=np.concatenate([push, np.zeros(3)]))
    here = stp.simulate(chain, q, chain.rest, duration=0.2, dt=1e-3, base_motion=lambda t: ground)
    there = stp.simulate(other, q, chain.rest, duration=0.2, dt=1e-3)
    np.testing.assert_allclose(here.q, there.q, atol=1e-9)
    part = stp.simulate(chain, q, chain.rest, duration=0.1, dt=1e-3, base_motion=ground)
    rest = stp.simulation.resume(chain, part.final_state, duration=0.1, base_motion=ground)
    np.testing.assert_array_equal(rest.q[-1], here.q[-1])


def test_what_is_no_motion_is_refused() -> None:
    with pytest.raises(InputError, match="base_motion must be a BaseMotion or a function"):
        stp.simulate(bead(), [0.0], [0.0], duration=0.1, base_motion=3.0)  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="base_motion must return a BaseMotion, got float at 0 s"):
        stp.simulate(bead(), [0.0], [0.0], duration=0.1, base_motion=lambda t: t)  # pyright: ignore[reportArgumentType]
