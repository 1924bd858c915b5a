"""Pivots chosen on samples: rank as the one-state verbs see it, and what ill-conditioned loops leave of it."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.kernels.kernels import compile_kernels
from stewart_pin.kernels.planning.elimination import Elimination, plan_pivots
from stewart_pin.programs.status import StateStatus
from tests.building import cassie


def samples(rng: np.random.Generator, *, tiny: float, noise: float) -> np.ndarray:
    """Matrices of which column 2 is tiny, and column 3 the sum of two others but for noise."""
    values = rng.uniform(0.5, 1.0, (8, 5, 4)) * rng.choice([-1.0, 1.0], (8, 5, 4))
    values[:, :, 2] *= tiny
    values[:, :, 3] = values[:, :, 0] + values[:, :, 1] + noise * rng.uniform(-1, 1, (8, 5))
    return values


def test_what_depends_but_for_the_gaps_of_loops_is_dropped(rng: np.random.Generator) -> None:
    assert len(plan_pivots(samples(rng, tiny=1.0, noise=1e-10), [0, 1, 2, 3]).columns) == 1
    assert plan_pivots(samples(rng, tiny=1.0, noise=1e-6), [0, 1, 2, 3]).columns == ()


def test_a_column_of_round_off_is_dropped_and_a_small_one_kept(rng: np.random.Generator) -> None:
    pivots = plan_pivots(samples(rng, tiny=1e-15, noise=1.0), [0, 1, 2, 3])
    assert pivots.columns == (2,)
    pivots = plan_pivots(samples(rng, tiny=1e-6, noise=1.0), [0, 1, 2, 3])
    assert pivots.columns == ()
    assert 1e-7 < min(pivots.sizes) < 3e-6


def test_a_system_known_to_be_regular_keeps_its_smallest_column(rng: np.random.Generator) -> None:
    values = samples(rng, tiny=1e-12, noise=1.0)[:, :4]
    assert plan_pivots(values, [0, 1, 2, 3]).columns == (2,)
    assert plan_pivots(values, [0, 1, 2, 3], nothing=0.0).columns == ()


def test_where_all_is_round_off_a_known_rank_finds_no_pivot(rng: np.random.Generator) -> None:
    """Rows that repeat others leave nothing but round-off: in no unit of their own is it small."""
    values = 1e-17 * rng.uniform(-1.0, 1.0, (8, 5, 4))
    assert plan_pivots(values, [0, 1, 2, 3], rank=0).places == ()
    assert len(plan_pivots(samples(rng, tiny=1.0, noise=1.0), [0, 1, 2, 3], rank=3).places) == 3


def test_elimination_solves(rng: np.random.Generator) -> None:
    values = rng.uniform(-1, 1, (6, 4, 4))
    matrix, right = ca.SX.sym("m", 4, 4), ca.SX.sym("r", 4, 2)
    solve = ca.Function(
        "solve", [matrix, right], [Elimination(matrix, plan_pivots(values, [0, 1, 2, 3])).solve(right)]
    )
    b = rng.uniform(-1, 1, (4, 2))
    for value in values:
        np.testing.assert_allclose(np.array(solve(value, b)), np.linalg.solve(value, b), rtol=1e-9)


@pytest.mark.slow
@pytest.mark.skipif(cassie.folder() is None, reason="needs the package example-robot-data")
@pytest.mark.parametrize("name", ["cassie", "cassie_v2"])
def test_accelerations_of_nearly_locked_loops(name: str, tmp_path: Path, rng: np.random.Generator) -> None:
    """Both bipeds have rows that depend on each other, one also rows that nearly do, by printed digits of π/2."""
    chain = cassie.load(name, tmp_path)
    many, q = compile_kernels(chain, coordinates="tree"), chain.q_home
    motions = chain.at(q).freedom.motions
    v, tau = motions @ rng.normal(size=motions.shape[1]), 10.0 * rng.normal(size=chain.nu)
    status, conditioning = np.empty(1, dtype=np.int8), np.empty(1)
    found = many.forward_dynamics(q[None], v[None], tau, status=status, conditioning=conditioning)[0]
    expected = stp.forward_dynamics(chain, q, v, tau).a
    assert status[0] == StateStatus.OK
    # Singular values of 3e-7 in `cassie` cost six digits.
    np.testing.assert_allclose(
        found, expected, atol=(1e-8 if name == "cassie" else 1e-11) * np.abs(expected).max()
    )
    assert (conditioning[0] < 1e-2) == (name == "cassie")
