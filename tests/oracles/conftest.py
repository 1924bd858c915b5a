"""What the comparisons with other engines share: random states with closed loops, and the projection on the motors."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import null_space

import stewart_pin as stp
from tests.zoo.table import ROBOTS

_RANK = 1e-9
"""Singular values below this, relative to the largest, count as zero: loops are closed to 1e-13."""


@pytest.fixture
def closed_states(rng: np.random.Generator) -> Callable[[stp.ClosedChain, int], Iterator[stp.State]]:
    """Return a generator of random states near home whose loops stay closed, idle freedoms moving too."""

    def states(chain: stp.ClosedChain, count: int) -> Iterator[stp.State]:
        for _ in range(count):
            free = null_space(stp.loop_jacobian(chain, chain.q_home), rcond=_RANK)
            step = free @ rng.uniform(-0.1, 0.1, free.shape[1]) * chain.length_scale
            q = stp.close_loops(chain, pin.integrate(chain.model, chain.q_home, step)).q
            jacobian = stp.loop_jacobian(chain, q)
            free = null_space(jacobian, rcond=_RANK)
            v = free @ rng.uniform(-1, 1, free.shape[1])
            drift = np.linalg.lstsq(jacobian, stp.loop_bias(chain, q, v), rcond=_RANK)[0]
            yield chain.at(q, v, free @ rng.uniform(-3, 3, free.shape[1]) - drift)

    return states


@pytest.fixture
def project() -> Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]:
    """Return the projection of tree efforts (nv,) on motors (nu,), past loops of Jacobian (nc, nv)."""

    def projection(needed: np.ndarray, jacobian: np.ndarray, motors: np.ndarray) -> np.ndarray:
        free = null_space(jacobian, rcond=_RANK) if jacobian.size else np.eye(needed.size)
        return np.linalg.lstsq(free[motors].T, free.T @ needed, rcond=_RANK)[0]

    return projection


@pytest.fixture(params=ROBOTS)
def chain(request: pytest.FixtureRequest) -> stp.ClosedChain:
    """Return every bundled robot in turn, falling in a direction that no axis has."""
    return stp.load(request.param, gravity=(1.3, -2.1, -9.81))
