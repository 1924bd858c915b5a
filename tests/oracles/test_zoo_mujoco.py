"""MuJoCo has the mass matrix, the bias forces and the constraints of every mechanism that the tests have as MJCF."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import UnsupportedError
from tests.model.small_mjcf import BOTH, DRIVEN, QPOS, TIES, WORKSHOP, mjcf, write
from tests.oracles.test_mjcf_reading import Twin, require_same_tree
from tests.oracles.test_mujoco import same_row_space
from tests.zoo.table import ROWS, zoo_chain

WITHOUT_WORDS = {"oldham", "wedge", "rscr", "rccc"}
"""Mechanisms whose loops are closed by slides or cylinders."""
SMALL = {"arm": mjcf(BOTH, DRIVEN), "workshop": WORKSHOP % (TIES, QPOS)}


def twin_of(name: str, folder: Path) -> Twin:
    if name in SMALL:
        return Twin.of(write(folder, SMALL[name]))
    chain, path = zoo_chain(name), folder / f"{name}.xml"
    stp.export(chain, path, format="mjcf")
    return Twin.of(path)


@pytest.mark.parametrize("name", sorted({*SMALL, *ROWS} - WITHOUT_WORDS))
def test_same_tree_and_same_constraints(name: str, rng: np.random.Generator, tmp_path: Path) -> None:
    twin = twin_of(name, tmp_path)
    chain = twin.chain
    require_same_tree(twin, rng)
    for share in (0.0, 0.05):
        step = share * rng.uniform(-1, 1, chain.nv) * chain.tangent_scale
        closed = stp.close_loops(chain, pin.integrate(chain.model, chain.q_home, step)).q
        turn, _ = twin.set(closed)
        residual, jacobian = twin.equalities()
        ours = stp.loop_jacobian(chain, closed)
        assert np.abs(residual).max(initial=0.0) < 1e-11 * max(1.0, chain.length_scale)
        if np.abs(ours).max(initial=0.0) < 1e-12:  # a tree, or a door whose second hinge holds nothing more
            assert np.abs(jacobian).max(initial=0.0) < 1e-12
            continue
        # Of equal rank, which the angle is infinite without.
        assert same_row_space(jacobian @ turn, ours) < 1e-10


@pytest.mark.parametrize("name", sorted(WITHOUT_WORDS))
def test_other_loops_are_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(UnsupportedError, match="cut the loop at another joint"):
        twin_of(name, tmp_path)
