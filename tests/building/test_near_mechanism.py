"""Moves of places and what they do to loops: linear equations, and what is left where none of them is large enough."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from stewart_pin.building import near_mechanism
from stewart_pin.building.near_mechanism import _Attached, _Equations, _moved, none_near, places_of
from stewart_pin.state.newton import close_at_precision
from tests.zoo.table import zoo_chain


@pytest.mark.parametrize("name", ["crank_rocker", "bennett", "sarrus", "delta_hinges", "par4"])
def test_columns_are_differences_of_gaps(name: str, rng: np.random.Generator) -> None:
    """Of every place, along and about its axes; at open loops as well."""
    chain = zoo_chain(name)
    places = places_of(chain)
    step = 0.3 * rng.uniform(-1, 1, chain.nv) * chain.tangent_scale
    states = [chain.at(q) for q in (chain.q_home, pin.integrate(chain.model, chain.q_home, step))]
    columns = _Attached.of(chain, places).columns(states)
    for move in (rng.normal(size=6 * len(places)), np.eye(6 * len(places))[7]):
        before, after = (_moved(chain, places, h * move) for h in (-1e-5, 1e-5))
        for state, column in zip(states, columns, strict=True):
            difference = (after.at(state.q).relative_gap - before.at(state.q).relative_gap) / 2e-5
            # Rounding over the step, and its square times the cube of a move of size ten.
            np.testing.assert_allclose(column @ move, difference, atol=1e-7)


@pytest.mark.parametrize("reach", [0.0, 0.1, 0.5, 3.0])
def test_what_moves_within_reach_leave_is_the_least(reach: float, rng: np.random.Generator) -> None:
    """Three equations for two moves, against all moves on and within a circle."""
    matrix, right = rng.normal(size=(3, 2)), rng.normal(size=3)
    none = np.zeros(0)
    equations = _Equations(none, none, none, none, none, right, *np.linalg.svd(matrix, full_matrices=False))
    angle, radius = np.meshgrid(np.linspace(0, 2 * np.pi, 721), np.linspace(0, reach, 101))
    moves = np.array([radius * np.cos(angle), radius * np.sin(angle)]).reshape(2, -1)
    least = np.linalg.norm(right[:, None] + matrix @ moves, axis=0).min()
    assert least - 1e-4 <= equations.left_open(reach or 1e-12) <= least + 1e-9


def test_no_mechanism_is_near_a_frame_that_only_seems_to_move() -> None:
    """Three parallel cranks with a coupler, one crank a hundredth short: by 1e-3 no move gives back their motion."""
    chain = zoo_chain("parallel_cranks")
    rank = chain.generic.rank
    places = places_of(chain)
    rng = np.random.default_rng(0)
    for size, expected in ((1e-2, True), (1e-4, False)):
        shift = np.zeros(6 * len(places))
        shift[-3 * 6] = size
        short = _moved(chain, places, shift)
        states = [
            close_at_precision(
                short,
                pin.integrate(chain.model, chain.q_home, 0.3 * rng.uniform(-1, 1, chain.nv)),
                0.1,
                rank=rank,
            ).state
            for _ in range(6)
        ]
        assert none_near(states, rank, places, 1e-3) is expected
    assert not near_mechanism.all_closed(states)
