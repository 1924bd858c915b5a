"""Demands of motors that make whole turns: neither kernels nor the number of instants change an answer."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import Coupling, Joint, Link, Mechanism
from tests.closed_states import close
from tests.mechanisms import R, Z, arm, body, turned
from tests.motion.turning import LEAD, screw, turning
from tests.zoo.table import zoo_chain


@pytest.mark.parametrize("count", [31, 301])
@pytest.mark.parametrize("kernels", [None, True])
def test_a_gear_stands_elsewhere_after_a_turn(count: int, kernels: bool | None) -> None:
    """The carrier turns 0.9 times, the sun 2.6 times as far: efforts depend on where the planet stands."""
    chain = zoo_chain("planetary_gear")
    samples, right = turning(chain, 2.6 * 0.9, count)
    found, plain = (stp.motor_demand(chain, samples, kernels=choice) for choice in (kernels, False))
    close(found.positions, right, 1e-12)
    close(found.efforts, plain.efforts, 1e-12)


@pytest.mark.parametrize("count", [41, pytest.param(301, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kernels", [None, True])
def test_the_turns_of_a_screw_follow_from_its_lead(count: int, kernels: bool | None) -> None:
    chain = stp.with_limits(screw(), {"screw": {"position": (-10 * np.pi, 10 * np.pi)}})
    home, time = stp.platform_pose(chain, chain.q_home), np.arange(count) / 40

    def shake(share: float) -> stp.motions.PlatformSamples:
        amplitude = (0.0, 0.0, 0.1 * share)
        return stp.motions.sinusoidal_motion(time, home=home, amplitude=amplitude, frequency=(0, 0, 1))

    found = stp.motor_demand(chain, shake(1.0), kernels=kernels)
    close(found.positions[:, 0], 0.1 * np.sin(2 * np.pi * time) / LEAD, 1e-12)
    assert not found.holds() and {excess.joint for excess in found.check()} == {"screw"}
    swept = stp.sweep_demand(chain, shake, {"share": [1.0]}, kernels=kernels)
    assert swept["travel"][0, 0] == pytest.approx(0.2 / LEAD)


@pytest.mark.slow
def test_a_motion_on_a_screw_is_fitted_by_its_turns() -> None:
    chain = stp.with_limits(screw(), {"screw": {"position": (-10 * np.pi, 10 * np.pi)}})
    home, time = stp.platform_pose(chain, chain.q_home), np.arange(301) / 40

    def shake(share: float) -> stp.motions.PlatformSamples:
        amplitude = (0.0, 0.0, 0.1 * share)
        return stp.motions.sinusoidal_motion(time, home=home, amplitude=amplitude, frequency=(0, 0, 1))

    assert stp.fit_to_limits(chain, shake).scale == pytest.approx(0.5, rel=1e-5)


@pytest.mark.parametrize("count", [60, pytest.param(301, marks=pytest.mark.slow)])
def test_a_crank_turns_once_whatever_the_number_of_instants(count: int) -> None:
    """Kernels start at home, from where the other half of the turn lies behind a dead centre of the platform."""
    chain = stp.load("four_bar")
    samples, right = turning(chain, 1.0, count)
    for kernels in (None, True):
        close(stp.motor_demand(chain, samples, kernels=kernels).positions, right, 1e-12)


def test_turns_of_more_than_a_quarter_between_two_instants_are_followed(rng: np.random.Generator) -> None:
    """Of an arm that turns about its first axis: no loop, no coupling sees whole turns."""
    chain = arm(rng)
    time, rate = np.linspace(0.0, 1.0, 9), np.array([3.2 * np.pi, 0.0, 0.0])
    states = [chain.at(chain.q_home + t * rate, rate) for t in time]
    columns = [(s.pose.translation, s.pose.rotation, s.twist, s.platform_bias) for s in states]
    samples = stp.motions.PlatformSamples(time, *map(np.array, zip(*columns, strict=True)))
    found = stp.motor_demand(chain, samples, kernels=True)
    assert found.method == "kernels"
    close(found.positions, np.array([state.q for state in states]), 1e-10)
    few = stp.motions.PlatformSamples(*(values[::2] for values in vars(samples).values()))
    found, plain = (stp.motor_demand(chain, few, kernels=kernels) for kernels in (True, False))
    assert found.method == "one_state"
    np.testing.assert_array_equal(found.positions, plain.positions)


def test_turns_that_poses_do_not_tell_are_said(rng: np.random.Generator) -> None:
    """Nearly a turn from one instant to the next looks like a little back; the rates know better."""
    chain = arm(rng)
    rate = np.array([1.9 * np.pi, 0.0, 0.0])
    for spacing, unsure in ((0.1, {}), (1.0, {chain.motors[0]: 0.0})):
        time = spacing * np.arange(5)
        states = [chain.at(chain.q_home + t * rate, rate) for t in time]
        columns = [(s.pose.translation, s.pose.rotation, s.twist, s.platform_bias) for s in states]
        samples = stp.motions.PlatformSamples(time, *map(np.array, zip(*columns, strict=True)))
        assert stp.motor_demand(chain, samples).turns_unsure == unsure


@pytest.mark.parametrize("kernels", [None, pytest.param(True, marks=pytest.mark.slow)])
def test_a_turn_of_a_sum_is_a_part_of_a_turn_of_each_joint(
    kernels: bool | None, rng: np.random.Generator
) -> None:
    """The platform follows five joints that turn alike, all ratios being one: it turns five times as far."""
    names = [f"part{k}" for k in range(5)]
    links = (Link("base"), *(Link(f"{name}_link", body(rng)) for name in ("sum", *names)))
    joints = tuple(
        Joint(name, R, "base", f"{name}_link", turned(rng), Z, independent=name == "part0")
        for name in ("sum", *names)
    )
    first, *rest = names
    couplings = (
        Coupling("sum", "sum", first, (0.0, 1.0), tuple((name, 1.0) for name in rest)),
        *(Coupling(name, name, first, (0.0, 1.0)) for name in rest),
    )
    chain = build_chain(Mechanism("adder", links, joints, couplings=couplings, platform="sum_link"))
    samples, right = turning(chain, 0.3, 400)  # the platform turns 1.5 times
    found, plain = (stp.motor_demand(chain, samples, kernels=choice) for choice in (kernels, False))
    close(found.positions, right, 1e-12)
    close(found.efforts, plain.efforts, 1e-12)
