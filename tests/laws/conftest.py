"""Every bundled robot in every kind of pose: a new folder of ``urdf/`` comes under the laws by being there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import stewart_pin as stp
from tests.closed_states import POSES, conditioning, configuration, random_motion, robot


@dataclass(frozen=True)
class Case:
    """A robot at a closed configuration, with a motion that keeps it closed."""

    chain: stp.ClosedChain
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    pose: str


@pytest.fixture(params=stp.robots())
def chain(request: pytest.FixtureRequest) -> stp.ClosedChain:
    """Return each bundled robot."""
    return robot(request.param)


@pytest.fixture(params=POSES)
def case(request: pytest.FixtureRequest, chain: stp.ClosedChain, rng: np.random.Generator) -> Case:
    """Return each robot in each kind of pose, moving."""
    q = configuration(chain.name, request.param)
    return Case(chain, q, *random_motion(chain, rng, q), request.param)


@pytest.fixture
def held(case: Case) -> Case:
    """Return the case, if the robot's motors can hold it: the others have no inverse dynamics."""
    if not stp.mobility(case.chain).motors_sufficient:
        pytest.skip(f"the motors of {case.chain.name} do not hold it")
    return case


def round_off(case: Case, generic: float) -> float:
    """Scale a tolerance: next to a singularity efforts grow, and so do the accelerations of their round-off."""
    return generic * max(1.0, 0.01 / conditioning(case.chain, case.q))
