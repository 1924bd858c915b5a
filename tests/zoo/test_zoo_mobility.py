"""Freedoms as the literature states them, by the package and by a judge that adds screws."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp
from tests.zoo import kinematics
from tests.zoo.table import ZOO, Row, zoo_chain

each = pytest.mark.parametrize("row", ZOO, ids=[row.name for row in ZOO])


@each
def test_mobility_is_that_of_the_literature(row: Row) -> None:
    chain, found = zoo_chain(row.name), stp.mobility(zoo_chain(row.name))
    assert (found.dof, found.dof_home, len(found.idle)) == (row.mobility, row.mobility, row.idle)
    assert set(found.dof_samples) == {row.mobility}
    assert found.redundant_rows == len(found.redundant) == row.excess
    assert (found.motors_sufficient, found.lost, found.home_singular) == (True, 0, False)
    assert found.verdict == "sufficient" and found.suggestion == chain.motors
    assert chain.nu == row.mobility - row.idle


def _ranks(rows: np.ndarray) -> tuple[int, float]:
    """Rank by the widest gap between singular values, and how wide it is, in powers of ten."""
    s = np.append(np.linalg.svd(rows, compute_uv=False), 1e-16)
    s = np.maximum(s, 1e-16 * s[0])
    gaps = np.log10(s[:-1] / s[1:])
    return int(np.argmax(gaps)) + 1, float(gaps.max())


@each
def test_mobility_by_screws(row: Row) -> None:
    """At home, and at the end of a motion: what is free at once is free for good."""
    told = kinematics.read(row.file)
    loops, gears = len(told.loops), len(told.gears)
    assert told.size - 6 * loops - gears + row.excess == row.mobility  # Kutzbach, and what he misses
    rank, digits = _ranks(kinematics.equations(told, np.zeros(told.size))[1])
    assert told.size - rank == row.mobility and digits > 10
    # Locked motors leave the spins that are idle.
    locked = np.vstack(
        [kinematics.equations(told, np.zeros(told.size))[1], np.eye(told.size)[list(told.motors)]]
    )
    assert told.size - _ranks(locked)[0] == row.idle
    moved = kinematics.move(told, rank, np.random.default_rng(3).normal(size=told.size))
    gap, rows = kinematics.equations(told, moved)
    assert np.linalg.norm(moved) > 0.1
    assert np.abs(gap).max() < 1e-13
    assert _ranks(rows)[0] == rank and _ranks(rows)[1] > 8
