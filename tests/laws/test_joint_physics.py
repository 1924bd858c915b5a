"""Laws 3 to 6 with springs, damping, dry friction and constant forces on every joint of the tree and of the loops."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp
from tests.closed_states import KINDS, close, random_configuration, random_motion
from tests.joint_physics import physical
from tests.zoo.table import ROBOTS

AGREE = 1e-10
"""Relative; as law 5 without physics of joints."""


@pytest.fixture(params=[*ROBOTS, *KINDS])
def chain(request: pytest.FixtureRequest) -> stp.ClosedChain:
    """Return each bundled robot and each kind of closure, with physics on every joint."""
    return physical(request.param)


def state_of(
    chain: stp.ClosedChain, rng: np.random.Generator, *, rest: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw a closed configuration with a motion, or with one that is about to start."""
    q = random_configuration(chain, rng)
    v, a = random_motion(chain, rng, q)
    if rest:
        motions = chain.at(q).freedom.motions
        v, a = chain.rest, motions @ rng.normal(size=motions.shape[1])
    return q, v, a


def held(chain: stp.ClosedChain) -> None:
    if not stp.mobility(chain).motors_sufficient:
        pytest.skip(f"the motors of {chain.name} do not hold it")


def test_methods_agree(chain: stp.ClosedChain, rng: np.random.Generator) -> None:
    held(chain)
    q, v, a = state_of(chain, rng)
    one = stp.inverse_dynamics(chain, q, v, a)
    two = stp.inverse_dynamics(chain, q, v, a, method="constraint_matrix")
    close(two.tau_motor, one.tau_motor, AGREE)
    close(two.a / chain.tangent_scale, one.a / chain.tangent_scale, AGREE)
    if one.reactions_unique:
        close(two.lambda_c / chain.row_sizes, one.lambda_c / chain.row_sizes, 1e-9)
