"""Wrenches from outside: where a frame stands, what its wrench does to the joints, and what is refused."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError
from stewart_pin.state.outside import (
    as_wrenches,
    outside_effort_derivative,
    outside_efforts,
    outside_places,
    outside_power,
    with_outside,
    wrench_samples,
)
from tests.closed_states import along, close, derivative, random_configuration, random_motion, robot

ROBOTS = ("stewart", "stewart_sps", "delta", "four_bar", "arm_7r", "gear_train", "par4")


def moving(name: str, rng: np.random.Generator) -> stp.State:
    chain = robot(name)
    q = random_configuration(chain, rng, 0.1)
    return chain.at(q, *random_motion(chain, rng, q))


def random_wrenches(chain: stp.ClosedChain, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Draw one for every link, the ground and links without mass among them."""
    return {link.name: rng.normal(size=6) for link in chain.mechanism.links}


@pytest.mark.parametrize("name", ROBOTS)
def test_their_power_is_that_of_the_frames(name: str, rng: np.random.Generator) -> None:
    state = moving(name, rng)
    chain, wrenches = state.chain, random_wrenches(state.chain, rng)
    outside = as_wrenches(chain, wrenches)
    curve = along(chain, state.q, state.v)
    power = 0.0
    for place, value in zip(outside.places, outside.values, strict=True):

        def at(t: float, place=place) -> np.ndarray:
            data = pin.Data(chain.model)
            pin.forwardKinematics(chain.model, data, curve(t))
            return (data.oMi[place.joint] * place.placement).homogeneous

        now, rate = at(0.0), derivative(at)
        spin = rate[:3, :3] @ now[:3, :3].T
        omega = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
        power += value[:3] @ rate[:3, 3] + value[3:] @ omega
    close(outside_efforts(state, outside) @ state.v, power, 1e-9)
    assert outside_power(state, outside) == outside_efforts(state, outside) @ state.v


@pytest.mark.parametrize("name", ROBOTS)
def test_pinocchio_takes_the_same_forces(name: str, rng: np.random.Generator) -> None:
    state = moving(name, rng)
    chain, outside = state.chain, as_wrenches(state.chain, random_wrenches(state.chain, rng))
    given = chain.model, pin.Data(chain.model), state.q, state.v, state.a
    forces = with_outside(state, outside, [pin.Force.Zero()] * chain.model.njoints)
    close(pin.rnea(*given) - pin.rnea(*given, forces), outside_efforts(state, outside), 1e-11)


@pytest.mark.parametrize("name", [*ROBOTS, "arm_3r_spatial"])
def test_the_derivative_equals_differences(name: str, rng: np.random.Generator) -> None:
    state = moving(name, rng)
    chain, outside = state.chain, as_wrenches(state.chain, random_wrenches(state.chain, rng))

    def efforts(step: np.ndarray) -> np.ndarray:
        return outside_efforts(chain.at(pin.integrate(chain.model, state.q, step)), outside)

    differences = [derivative(lambda t, unit=unit: efforts(t * unit)) for unit in np.eye(chain.nv)]
    close(outside_effort_derivative(state, outside), np.transpose(differences), 1e-9)


def test_a_place_is_that_of_the_frame(rng: np.random.Generator) -> None:
    tool = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
    chain = stp.with_platform(stp.load("stewart"), "platform", placement=tool, name="tool")
    base, place = outside_places(chain, ["base", chain.platform_link])
    assert base.joint == 0
    at = chain.model.joints[place.joint]
    assert at.idx_v == chain.platform_support.nonzero()[0][-1] - at.nv + 1
    state = chain.at(chain.q_home)
    rotation, translation = state._placed.rotation[place.joint], state._placed.translation[place.joint]
    assert (pin.SE3(rotation, translation) * place.placement).isApprox(state.pose, 1e-12)


def test_a_wrench_on_the_ground_changes_nothing() -> None:
    chain = robot("stewart")
    outside = as_wrenches(chain, {"base": np.ones(6)})
    assert not outside_efforts(chain.at(chain.q_home), outside).any()
    assert as_wrenches(chain, None) is None
    assert as_wrenches(chain, {}) is None


def test_samples_are_one_for_each_state(rng: np.random.Generator) -> None:
    chain, moved = robot("stewart"), rng.normal(size=(4, 6))
    samples = wrench_samples(chain, {"platform": moved, "leg1_lower": [0, 0, 1, 0, 0, 0]}, np.arange(4.0))
    for k, row in enumerate(moved):
        found = samples.at(k).by_link()
        assert np.array_equal(found["platform"], row)
        assert np.array_equal(found["leg1_lower"], [0, 0, 1, 0, 0, 0])
    assert wrench_samples(chain, None, np.arange(4.0)) is None
    assert wrench_samples(chain, {}, np.arange(4.0)) is None


def test_a_function_names_the_links_that_bear_something() -> None:
    """A link that it leaves out at an instant bears nothing then."""
    chain = robot("stewart")

    def gust(t: float) -> dict[str, list[float]] | None:
        if t == 0:
            return None
        return {"platform": [t, 0, 0, 0, 0, 0]} if t < 2 else {"leg1_lower": [0, t, 0, 0, 0, 0]}

    samples = wrench_samples(chain, gust, np.array([0.0, 1.0, 2.0]))
    assert [place.link for place in samples.places] == ["platform", "leg1_lower"]
    assert np.array_equal(samples.values[:, 0, 0], [0, 1, 0])
    assert np.array_equal(samples.values[:, 1, 1], [0, 0, 2])
    assert wrench_samples(chain, lambda t: None, np.arange(3.0)) is None
    with pytest.raises(InputError, match=r"must return \{link: \(6,\)\}.*got ndarray at 0 s"):
        wrench_samples(chain, lambda t: np.zeros(6), np.arange(3.0))


def test_what_acts_on_the_platform_is_gathered_there(rng: np.random.Generator) -> None:
    tool = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
    chain = stp.with_platform(stp.load("stewart"), "platform", placement=tool, name="tool")
    state = chain.at(random_configuration(chain, rng, 0.1))
    wrenches = {"tool": rng.normal(size=6), "platform": rng.normal(size=6), "base": rng.normal(size=6)}
    gathered = wrench_samples(chain, wrenches, np.zeros(1)).on_platform(chain, state.pose.rotation[None])
    same = as_wrenches(chain, {"tool": gathered[0]})
    close(outside_efforts(state, same), outside_efforts(state, as_wrenches(chain, wrenches)), 1e-12)
    elsewhere = wrench_samples(chain, {"leg1_lower": np.ones(6)}, np.zeros(1))
    assert elsewhere.on_platform(chain, state.pose.rotation[None]) is None


@pytest.mark.parametrize(
    ("wrenches", "said"),
    [
        ({"platfrom": np.zeros(6)}, "did you mean 'platform'"),
        ({"leg1": np.zeros(6)}, "but a joint; name the link that it moves, 'leg1_upper'"),
        ({"zzz": np.zeros(6)}, "the links are: base, platform"),
        ({3: np.zeros(6)}, "3 is no link"),
        ({"platform": np.zeros(3)}, r"wrenches\['platform'\] must have shape \(6,\), got \(3,\)"),
        ({"platform": [0, 0, np.nan, 0, 0, 0]}, r"wrenches\['platform'\] must be finite"),
        ({"platform": "push"}, r"wrenches\['platform'\] must be an array of real numbers"),
        (np.zeros(6), "must be a mapping"),
        ([("platform", np.zeros(6))], "must be a mapping"),
    ],
)
def test_what_is_refused(wrenches: object, said: str) -> None:
    chain = robot("stewart")
    with pytest.raises(InputError, match=said):
        as_wrenches(chain, wrenches)


def test_samples_of_another_number_are_refused() -> None:
    chain = robot("stewart")
    with pytest.raises(
        InputError, match=r"wrenches\['platform'\] must have shape \(6,\) or \(4, 6\), got \(3, 6\)"
    ):
        wrench_samples(chain, {"platform": np.zeros((3, 6))}, np.arange(4.0))
    with pytest.raises(InputError, match=r"wrenches\['platform'\] must be finite"):
        wrench_samples(chain, {"platform": np.full((4, 6), np.inf)}, np.arange(4.0))
