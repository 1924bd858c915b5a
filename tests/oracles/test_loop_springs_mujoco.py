"""Law 9: what a joint that closes a loop does by itself, MuJoCo does where the same mechanism is cut elsewhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.model.description import JointKind
from tests.closed_states import random_configuration, random_motion, robot
from tests.oracles.test_mujoco import compiled
from tests.rewritten import carry_over, recut


def sprung(name: str) -> stp.ClosedChain:
    """Give damping and springs to all joints but the one at which `recut` cuts instead: MuJoCo's loops have none."""
    chain, rng = robot(name), np.random.default_rng(5)
    other = recut(chain)
    assert other is not None
    cut, kept = {loop.name for loop in other.loops}, {loop.name for loop in chain.loops}
    weight = 9.81 * sum(body.mass for body in chain.model.inertias) * chain.length_scale
    told = {}
    for joint in other.mechanism.joints:
        if joint.kind in (JointKind.FIXED, JointKind.FLOATING) or joint.name in cut:
            continue
        length = chain.length_scale if joint.kind is JointKind.PRISMATIC else 1.0
        told[joint.name] = {"damping": 0.2 * weight * rng.uniform() / length**2}
        told[joint.name]["stiffness"] = 0.5 * weight * rng.uniform() / length**2
        if joint.kind is not JointKind.SPHERICAL:
            told[joint.name]["rest"] = 0.2 * rng.normal() * length
        if joint.name not in kept:
            told[joint.name]["armature"] = 0.01 * weight * rng.uniform() / length**2
    assert kept & set(told)
    return stp.with_joint_physics(chain, told)


@pytest.mark.parametrize("name", ["four_bar", "five_bar", "stewart"])
def test_loops_with_springs_need_the_same_efforts(
    name: str, rng: np.random.Generator, project, tmp_path: Path
) -> None:
    chain = sprung(name)
    other = recut(chain)
    assert other is not None
    engine = compiled(other, tmp_path)
    for _ in range(3):
        q = random_configuration(chain, rng)
        v, a = random_motion(chain, rng, q)
        told = carry_over(chain, other, q, v, a)
        turn = engine.set(*told)
        needed = turn.T @ engine.tree_efforts()
        theirs = project(needed, stp.loop_jacobian(other, told[0]), other.motor_index)
        for method in ("pinocchio", "constraint_matrix"):
            ours = stp.inverse_dynamics(chain, q, v, a, method=method).tau_motor
            assert ours == pytest.approx(theirs, rel=1e-9, abs=1e-9 * np.abs(theirs).max())
        bare = stp.inverse_dynamics(robot(name), q, v, a).tau_motor
        assert np.abs(bare - theirs).max() > 1e-3 * np.abs(theirs).max()  # springs are felt
