"""Balls in place of hinges and rigid closures: the same motions, the same motor efforts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.model.description import LOOP_KINDS, JointKind
from tests.mechanisms import four_bar, two_bodies

CHAINS = {
    "five_bar": lambda rng: stp.load("five_bar"),
    "rpr_planar": lambda rng: stp.load("rpr_planar"),
    "hinge in a plane": lambda rng: four_bar(JointKind.REVOLUTE),
    "hinge in space": lambda rng: two_bodies(JointKind.REVOLUTE, rng),
    "rigid in space": lambda rng: two_bodies(JointKind.FIXED, rng),
    "balls already": lambda rng: stp.load("delta"),
}


@pytest.mark.parametrize("make", CHAINS.values(), ids=CHAINS)
def test_the_motions_and_efforts_are_the_same(make, rng: np.random.Generator) -> None:
    chain = make(rng)
    by_balls = stp.build.loops_by_balls(chain)
    assert {loop.kind for loop in by_balls.loops} == {JointKind.SPHERICAL}
    assert stp.mobility(by_balls).dof == stp.mobility(chain).dof
    step = pin.integrate(chain.model, chain.q_home, 0.1 * rng.normal(size=chain.nv))
    q = stp.close_loops(chain, step).q
    # 1e-9: loops are closed to 1e-12 m, over lever arms of a tenth of a metre.
    assert np.abs(stp.loop_gap(by_balls, q)).max() < 1e-9
    free, held = (stp.loop_jacobian(each, q) for each in (chain, by_balls))
    motions = np.linalg.svd(free).Vh[np.linalg.matrix_rank(free, tol=1e-9) :]
    np.testing.assert_allclose(held @ motions.T, 0, atol=1e-9)
    v = rng.normal(size=len(motions)) @ motions
    a = np.linalg.lstsq(free, -stp.loop_bias(chain, q, v), rcond=1e-9)[0]
    np.testing.assert_allclose(held @ a + stp.loop_bias(by_balls, q, v), 0, atol=1e-8)
    ours, theirs = (stp.inverse_dynamics(each, q, v, a).tau_motor for each in (chain, by_balls))
    np.testing.assert_allclose(theirs, ours, rtol=1e-8, atol=1e-9 * np.abs(ours).max())


def test_balls_stand_apart_as_told() -> None:
    first, second = stp.build.loops_by_balls(stp.load("five_bar"), distance=0.08).loops
    gap = first.placement1.translation - second.placement1.translation
    assert np.linalg.norm(gap) == pytest.approx(0.08, rel=1e-12)
    with pytest.raises(InputError, match="distance"):
        stp.build.loops_by_balls(stp.load("five_bar"), distance=0.0)


@pytest.mark.parametrize(
    "kind", sorted(set(LOOP_KINDS) - {JointKind.SPHERICAL, JointKind.REVOLUTE, JointKind.FIXED})
)
def test_loops_that_no_balls_replace_are_named(kind: JointKind, rng: np.random.Generator) -> None:
    with pytest.raises(UnsupportedError, match=f"loop 'loop' is of type '{kind}'"):
        stp.build.loops_by_balls(two_bodies(kind, rng))


@pytest.mark.parametrize("format", ["drake", "isaac", "gepetto"])
def test_hinges_get_into_formats_that_know_balls_only(format: str, tmp_path: Path) -> None:
    chain = stp.build.loops_by_balls(stp.load("five_bar"))
    stp.export(chain, tmp_path / "a.urdf", format=format)
    again = stp.load(tmp_path / "a.urdf")
    assert [loop.name for loop in again.loops] == [loop.name for loop in chain.loops]
    assert stp.mobility(again).dof == 2
