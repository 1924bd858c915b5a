"""Bundled robots and kinds of closures in every kind of pose: a folder of ``urdf/`` comes under the laws by itself."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from tests.closed_states import (
    KINDS,
    POSES,
    conditioning,
    configuration,
    random_motion,
    robot,
    smallest_inertia,
)
from tests.zoo.table import ROBOTS, ZOO


@dataclass(frozen=True)
class Case:
    """A robot at a closed configuration, with a motion that keeps it closed."""

    chain: stp.ClosedChain
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    pose: str


@pytest.fixture(params=[*ROBOTS, *KINDS, *(pytest.param(row.name, marks=pytest.mark.slow) for row in ZOO)])
def chain(request: pytest.FixtureRequest) -> stp.ClosedChain:
    """Return each bundled robot, each kind of closure, and each mechanism of the zoo."""
    return robot(request.param)


@pytest.fixture(params=POSES)
def case(request: pytest.FixtureRequest, chain: stp.ClosedChain, rng: np.random.Generator) -> Case:
    """Return each robot in each kind of pose, moving."""
    q = configuration(chain.name, request.param)
    return Case(chain, q, *random_motion(chain, rng, q), request.param)


LONG_PROGRAMS = ("arm_7r", "delta", "hexapod_rss", "stewart_cad", "stewart_s1", "stewart_sps")
"""Robots whose kernels take seconds to be written."""


@pytest.hookimpl(tryfirst=True)  # before slow tests are left out
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Ask mechanisms of the zoo at a generic pose and next to a singularity only; leave much to the slow tests."""
    told = [(item, getattr(getattr(item, "callspec", None), "params", {})) for item in items]
    for item, p in told:
        long = item.path.stem == "test_kernels" and p.get("chain") in LONG_PROGRAMS
        again = item.path.stem == "test_wrenches" and p.get("case") == "home"
        if item.path.parent == Path(__file__).parent and (long or again or p.get("case") == "symmetric"):
            item.add_marker(pytest.mark.slow)
    zoo = {row.name for row in ZOO}
    left = [item for item, p in told if p.get("chain") in zoo and p.get("case") in ("home", "symmetric")]
    if left:
        config.hook.pytest_deselected(items=left)
        gone = {id(item) for item in left}
        items[:] = [item for item in items if id(item) not in gone]


@cache
def _motors_sufficient(chain: stp.ClosedChain) -> bool:
    return stp.mobility(chain).motors_sufficient


@pytest.fixture
def held(case: Case) -> Case:
    """Return the case, if the robot's motors can hold it: the others have no inverse dynamics."""
    if not _motors_sufficient(case.chain):
        pytest.skip(f"the motors of {case.chain.name} do not hold it")
    return case


def round_off(case: Case, generic: float) -> float:
    """Scale a tolerance on efforts: next to a singularity they are large, and so is their round-off."""
    return generic * max(1.0, 0.01 / conditioning(case.chain, case.q))


def round_off_of_efforts(case: Case, generic: float, effort: stp.dynamics.Effort) -> float:
    """Scale a tolerance on efforts and reactions: where they happen to be small, round-off is as usual."""
    chain = case.chain
    needed = pin.rnea(chain.model, pin.Data(chain.model), case.q, case.v, effort.a) * chain.tangent_scale
    usual = np.abs(needed).max() / conditioning(chain, case.q)
    actual = np.abs(effort.tau_motor * chain.tangent_scale[chain.motor_index]).max()
    return round_off(case, generic) * max(1.0, usual / actual)


def round_off_of_accelerations(case: Case, generic: float, effort: stp.dynamics.Effort) -> float:
    """Scale a tolerance on accelerations: the round-off of large reactions moves a thin rod that may spin the most."""
    chain = case.chain
    push = max(np.abs(effort.tau_motor).max(), chain.length_scale * np.abs(effort.lambda_c).max(initial=0.0))
    least = 10 * np.finfo(float).eps * push / smallest_inertia(chain, case.q)
    return max(round_off(case, generic), least / np.abs(effort.a / chain.tangent_scale).max())
