"""Chains from cranks and rods: those of the bundled robots' numbers answer as the bundled robots do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, UnreachableError
from tests.closed_states import close, random_configuration, random_motion, robot


def bodies(chain: stp.ClosedChain, crank: str, rod: str) -> dict[str, Any]:
    link = chain.mechanism.link
    return {
        "platform": link("platform").inertia,
        "crank": link(crank).inertia,
        "rod": link(rod).inertia,
    }


def hexapod(**options: Any) -> stp.ClosedChain:
    bundled = robot("hexapod_rss")
    told = {"limits": (-1.5, 1.5), "effort": 20.0, "velocity": 10.0}
    return stp.build.rotary_hexapod_chain(
        stp.rotary.rotary_legs(bundled), **bodies(bundled, "crank1", "rod1"), **(told | options)
    )


def delta(**options: Any) -> stp.ClosedChain:
    legs = stp.rotary.delta_legs(
        base_radius=0.4573 / np.sqrt(12), platform_radius=0.115 / np.sqrt(12), crank=0.112, rod=0.232
    )
    told = {"width": 0.05, "limits": (-0.7, 1.4), "effort": 10.0, "velocity": 20.0}
    return stp.build.delta_chain(legs, **bodies(robot("delta"), "crank1", "rod1a"), **(told | options))


@pytest.mark.parametrize(("name", "make"), [("hexapod_rss", hexapod), ("delta", delta)])
def test_the_numbers_of_a_bundled_robot(
    name: str, make: Callable[..., stp.ClosedChain], rng: np.random.Generator
) -> None:
    bundled = robot(name)
    where = stp.platform_pose(bundled, bundled.q_home)
    mine = make(home=where if name == "hexapod_rss" else where.translation)
    assert mine.motors == bundled.motors and mine.platform == bundled.platform
    np.testing.assert_allclose(
        stp.motor_positions(mine, mine.q_home), stp.motor_positions(bundled, bundled.q_home), atol=1e-12
    )
    index, same = mine.motor_index, bundled.motor_index
    for field in ("lower", "upper"):
        ours, theirs = (np.asarray(getattr(c.model, f"{field}PositionLimit")) for c in (mine, bundled))
        np.testing.assert_array_equal(ours[mine.motor_q_index], theirs[bundled.motor_q_index])
    np.testing.assert_array_equal(mine.model.effortLimit[index], bundled.model.effortLimit[same])
    assert stp.mobility(mine).dof == stp.mobility(bundled).dof
    for _ in range(3):
        q = random_configuration(bundled, rng, 0.1)
        pose = stp.platform_pose(bundled, q)
        found, other = (stp.inverse_kinematics(c, pose, limits=False).q for c in (mine, bundled))
        np.testing.assert_allclose(
            stp.motor_positions(mine, found), stp.motor_positions(bundled, other), atol=1e-10
        )
        np.testing.assert_allclose(
            stp.motor_jacobian(mine, found), stp.motor_jacobian(bundled, other), atol=1e-7
        )
        v, a = random_motion(bundled, rng, other)
        state = bundled.at(other, v, a)
        twist, demand = state.P @ v, state.P @ a + state.platform_bias
        efforts = []
        for chain in (mine, bundled):
            moving = stp.platform_motion(chain, pose, twist, demand, limits=False)
            efforts.append(stp.inverse_dynamics(chain, moving.q, moving.v, moving.a).tau_motor)
        close(efforts[0], efforts[1], 1e-8)


@pytest.mark.parametrize("make", [hexapod, delta])
def test_a_default_home_has_cranks_about_the_middle(make: Callable[..., stp.ClosedChain]) -> None:
    chain = make()
    middle = 0.0 if make is hexapod else 0.35
    np.testing.assert_allclose(stp.motor_positions(chain, chain.q_home), middle, atol=0.05)
    np.testing.assert_allclose(stp.loop_gap(chain, chain.q_home), 0, atol=1e-12)
    assert stp.mobility(chain).verdict == "sufficient"
    again = stp.rotary.rotary_legs(chain)
    np.testing.assert_allclose(again.cranks, 0.12 if make is hexapod else 0.112, rtol=1e-9)


@pytest.mark.parametrize(
    ("make", "options", "words"),
    [
        (delta, {"width": 0.0}, "width"),
        (delta, {"limits": (1.0, -1.0)}, "limits"),
        (delta, {"home": [0.0, 0.0]}, "home"),
        (hexapod, {"limits": 3.0}, "limits"),
        (hexapod, {"rod": 0.2}, "rod must be a pinocchio.Inertia"),
    ],
)
def test_bad_input_is_named(
    make: Callable[..., stp.ClosedChain], options: dict[str, Any], words: str
) -> None:
    legs = stp.rotary.rotary_legs(robot("hexapod_rss"))
    with pytest.raises(InputError, match=words):
        if "rod" in options:
            stp.build.rotary_hexapod_chain(legs, **(bodies(robot("hexapod_rss"), "crank1", "rod1") | options))
        else:
            make(**options)


def test_legs_of_another_number_and_homes_out_of_reach_are_refused() -> None:
    legs = stp.rotary.rotary_legs(robot("hexapod_rss"))
    with pytest.raises(InputError, match="3 legs, got 6"):
        stp.build.delta_chain(legs, width=0.05, **bodies(robot("delta"), "crank1", "rod1a"))
    with pytest.raises(UnreachableError, match="leg"):
        delta(home=[0.0, 0.0, -1.0])


@pytest.mark.parametrize(
    ("limits", "angle"),
    [((-np.inf, -0.2), -0.2), ((0.2, np.inf), 0.2), ((1.0, np.inf), 1.0), ((7.0, np.inf), 7.0)],
)
def test_a_home_at_the_end_of_the_limits(limits: tuple[float, float], angle: float) -> None:
    """Where zero is beyond an only limit, home stands at that, all cranks alike, whatever the round-off."""
    for chain in (delta(limits=limits), hexapod(limits=limits)):
        motors = stp.motor_positions(chain, chain.q_home)
        np.testing.assert_allclose(motors, angle, atol=1e-9)
