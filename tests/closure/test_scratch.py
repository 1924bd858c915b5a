"""The fast loop equations are the plain ones, for every kind of loop, closed and open."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.closure.scratch import LoopScratch
from stewart_pin.model.description import LOOP_KINDS, JointKind
from tests.closed_states import random_configuration
from tests.mechanisms import arm, two_bodies


def require_same(chain: stp.ClosedChain, q: np.ndarray, v: np.ndarray) -> None:
    scratch = LoopScratch(chain)
    gap, jacobian, bias = scratch.place(q), scratch.jacobian(), scratch.bias(q, v)
    # Round-off of sums of a few terms near one.
    np.testing.assert_allclose(gap, stp.loop_gap(chain, q), rtol=0, atol=1e-14)
    np.testing.assert_allclose(jacobian, stp.loop_jacobian(chain, q), rtol=0, atol=1e-13)
    np.testing.assert_allclose(bias, stp.loop_bias(chain, q, v), rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", [kind for kind in LOOP_KINDS if kind is not JointKind.SPHERICAL])
def test_same_as_the_plain_equations_open_or_closed(kind: JointKind, rng: np.random.Generator) -> None:
    chain = two_bodies(kind, rng)
    for _ in range(3):
        q = pin.integrate(chain.model, chain.q_home, rng.uniform(-0.4, 0.4, chain.nv))
        require_same(chain, q, rng.normal(size=chain.nv))


@pytest.mark.parametrize("kind", LOOP_KINDS)
def test_same_where_the_loops_are_closed(kind: JointKind, rng: np.random.Generator) -> None:
    chain = two_bodies(kind, rng)
    require_same(chain, random_configuration(chain, rng), rng.normal(size=chain.nv))


def test_same_for_a_platform_on_balls(rng: np.random.Generator) -> None:
    chain = stp.load("stewart")
    require_same(chain, random_configuration(chain, rng), rng.normal(size=chain.nv))


def test_ball_loops_are_off_by_no_more_than_their_gap(rng: np.random.Generator) -> None:
    chain = stp.load("stewart")
    q = pin.integrate(chain.model, chain.q_home, rng.uniform(-0.1, 0.1, chain.nv))
    scratch = LoopScratch(chain)
    gap = scratch.place(q)
    np.testing.assert_allclose(gap, stp.loop_gap(chain, q), rtol=0, atol=1e-14)
    difference = np.abs(scratch.jacobian() - stp.loop_jacobian(chain, q)).max()
    # The missing term is ω1 × gap, with one rad/s at most per rad/s.
    assert 0 < difference <= np.sqrt(3) * np.abs(gap).max()


def test_a_chain_without_loops_has_no_rows(rng: np.random.Generator) -> None:
    chain = arm(rng)
    scratch = LoopScratch(chain)
    assert scratch.place(chain.q_home).shape == (0,)
    assert scratch.jacobian().shape == (0, chain.nv)
    assert scratch.bias(chain.q_home, np.ones(chain.nv)).shape == (0,)
