"""Law 2: motions of the closed chain keep the loops closed, and closing closes to round-off."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from tests.laws.conftest import Case


def test_motions_keep_the_loops_closed(case: Case) -> None:
    chain, freedom = case.chain, case.chain.at(case.q).freedom
    assert freedom.motions.shape == (chain.nv, chain.nv - freedom.rank)
    # Round-off of the decomposition: a few units of the Jacobian's largest entry.
    size = chain.length_scale * max(1.0, np.abs(stp.loop_jacobian(chain, case.q)).max(initial=0.0))
    assert np.abs(stp.loop_jacobian(chain, case.q) @ freedom.motions).max(initial=0.0) <= 1e-13 * size


def test_gap_after_closing(case: Case, rng: np.random.Generator) -> None:
    chain = case.chain
    for _ in range(5):
        step = 0.1 * rng.uniform(-1, 1, chain.nv) * chain.tangent_scale
        closure = stp.close_loops(chain, pin.integrate(chain.model, case.q, step), throw=False)
        if not closure.success:
            # Only next to a singularity may a guess have no closed configuration near it.
            assert case.pose == "near_singular"
            continue
        gap = np.abs(stp.loop_gap(chain, closure.q)).max(initial=0.0)
        # Coordinates of a robot larger than a metre have round-off in proportion.
        assert gap <= 1e-12 * max(1.0, chain.length_scale)
        assert closure.gap == pytest.approx(gap, rel=1e-6, abs=1e-17)


def test_forward_and_inverse_kinematics_undo_each_other(case: Case) -> None:
    chain = case.chain
    pose = stp.platform_pose(chain, case.q)
    there = stp.inverse_kinematics(chain, pose, q_guess=case.q, limits=False)
    back = stp.forward_kinematics(chain, stp.motor_positions(chain, there.q), q_guess=there.q, limits=False)
    assert np.abs(pin.log6(pose.actInv(stp.platform_pose(chain, back.q))).vector).max() <= 1e-9 * max(
        1.0, chain.length_scale
    )
