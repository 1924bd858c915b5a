"""Laws 6 and 7: neither where the loops are cut nor the unit of length changes the motion."""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from tests.closed_states import close, robot
from tests.laws.conftest import Case, round_off_of_accelerations
from tests.rewritten import (
    carry_over,
    configuration_in_other_unit,
    effort_unit,
    in_other_unit,
    recut,
    tangent_unit,
)

SAME = 1e-9  # round-off of two different eliminations, at condition numbers up to 1e3


@cache
def otherwise_cut(name: str) -> stp.ClosedChain | None:
    return recut(robot(name))


@cache
def in_millimetres(name: str) -> stp.ClosedChain:
    return in_other_unit(robot(name), 1e3)


def platform_acceleration(chain: stp.ClosedChain, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    return chain.at(q).P @ a + chain.at(q, v).platform_bias


def test_another_cut_moves_the_same(held: Case, rng: np.random.Generator) -> None:
    chain, other = held.chain, otherwise_cut(held.chain.name)
    if other is None:
        pytest.skip("no loop that could be cut elsewhere")
    q, v, a = carry_over(chain, other, held.q, held.v, held.a)
    assert np.abs(
        stp.platform_pose(other, q).homogeneous - stp.platform_pose(chain, held.q).homogeneous
    ).max() < (1e-9 * max(1.0, chain.length_scale))
    one = stp.inverse_dynamics(chain, held.q, held.v, held.a)
    for method in ("pinocchio", "constraint_matrix"):
        two = stp.inverse_dynamics(other, q, v, a, method=method)
        close(two.tau_motor, one.tau_motor, SAME)
    tau_motor = one.tau_motor * rng.uniform(0.5, 1.5, chain.nu)
    here = stp.forward_dynamics(chain, held.q, held.v, tau_motor).a
    there = stp.forward_dynamics(other, q, v, tau_motor).a
    close(platform_acceleration(other, q, v, there), platform_acceleration(chain, held.q, held.v, here), SAME)


def test_the_unit_of_length_changes_nothing(held: Case, rng: np.random.Generator) -> None:
    chain, other, k = held.chain, in_millimetres(held.chain.name), 1e3
    tangent, effort = tangent_unit(chain, k), effort_unit(chain, k)
    assert stp.mobility(other) == stp.mobility(chain)
    # Newton's method takes the same steps.
    guess = pin.integrate(chain.model, held.q, 0.1 * rng.uniform(-1, 1, chain.nv) * chain.tangent_scale)
    here = stp.close_loops(chain, guess, throw=False)
    there = stp.close_loops(other, configuration_in_other_unit(chain, guess, k), throw=False)
    if here.success and held.pose != "near_singular":
        apart = pin.difference(other.model, configuration_in_other_unit(chain, here.q, k), there.q)
        assert np.abs(apart / other.tangent_scale).max() <= 1e-9
    # And so do the bodies.
    q = stp.close_loops(other, configuration_in_other_unit(chain, held.q, k)).q
    one = stp.inverse_dynamics(chain, held.q, held.v, held.a)
    for method in ("pinocchio", "constraint_matrix"):
        two = stp.inverse_dynamics(other, q, held.v * tangent, held.a * tangent, method=method)
        if one.unique:
            close(two.tau_motor / effort, one.tau_motor, SAME)
    tau_motor = one.tau_motor * rng.uniform(0.5, 1.5, chain.nu)
    moved = stp.forward_dynamics(chain, held.q, held.v, tau_motor)
    moved_too = stp.forward_dynamics(other, q, held.v * tangent, tau_motor * effort)
    close(
        moved_too.a / other.tangent_scale,
        moved.a / chain.tangent_scale,
        round_off_of_accelerations(held, SAME, one),
    )
