"""Whether a chain that was written and read is the same mechanism: what both answer in terms of the same joints."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from tests.closed_states import random_configuration, random_motion

TOLERANCE = 1e-12
"""Of what no matrix is inverted for, relative to its largest entry."""
_SOLVED = 1e-10
"""Of motor efforts: loops multiply round-off by their conditioning."""


def shared(chain: stp.ClosedChain, other: stp.ClosedChain, q: np.ndarray) -> np.ndarray:
    """Carry a configuration over by the names of the joints."""
    result = np.zeros(other.nq)
    for name, joint in zip(other.model.names[1:], other.model.joints[1:], strict=True):
        same = chain.model.joints[chain.model.getJointId(name)]
        result[joint.idx_q : joint.idx_q + joint.nq] = q[same.idx_q : same.idx_q + same.nq]
    return result


def tangent_order(chain: stp.ClosedChain, other: stp.ClosedChain) -> np.ndarray:
    """Index of every tangent entry of `other` in `chain`."""
    joints = [(chain.model.joints[chain.model.getJointId(name)], name) for name in other.model.names[1:]]
    return np.concatenate([np.arange(joint.idx_v, joint.idx_v + joint.nv) for joint, _ in joints]).astype(int)


def require_same(chain: stp.ClosedChain, other: stp.ClosedChain, rng: np.random.Generator) -> None:
    """Compare freedoms, poses, masses, bias and motor efforts at home and at a random closed state."""
    assert (other.nq, other.nv, other.motors) == (chain.nq, chain.nv, chain.motors)
    assert other.generic.rank == chain.generic.rank
    np.testing.assert_array_equal(other.gravity, chain.gravity)
    order = tangent_order(chain, other)
    scale = TOLERANCE * max(1.0, chain.length_scale)
    np.testing.assert_allclose(other.q_home, shared(chain, other, chain.q_home), rtol=0, atol=scale)
    for q in (chain.q_home, random_configuration(chain, rng)):
        theirs = shared(chain, other, q)
        v, a = random_motion(chain, rng, q)
        if chain.platform is not None:
            one, two = stp.platform_pose(chain, q), stp.platform_pose(other, theirs)
            np.testing.assert_allclose(two.homogeneous, one.homogeneous, rtol=0, atol=scale)
        for ask in (_masses, _bias):
            mine = ask(chain, q, v)
            again = ask(other, theirs, v[order])
            picked = mine[np.ix_(*[order] * mine.ndim)]
            np.testing.assert_allclose(again, picked, rtol=0, atol=TOLERANCE * np.abs(mine).max())
        if chain.nc:
            assert np.abs(stp.loop_gap(other, theirs)).max() < 1e-11 * max(1.0, chain.length_scale)
        if chain.motors and np.abs(_bias(chain, q, v)).max() > 0:
            mine, again = (
                stp.inverse_dynamics(each, x, dx, ddx).tau_motor
                for each, x, dx, ddx in ((chain, q, v, a), (other, theirs, v[order], a[order]))
            )
            size = max(np.abs(mine).max(), np.abs(_bias(chain, q, v)).max())
            np.testing.assert_allclose(again, mine, rtol=0, atol=_SOLVED * size)


def _masses(chain: stp.ClosedChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    upper = np.triu(pin.crba(chain.model, pin.Data(chain.model), q))
    return upper + np.triu(upper, 1).T


def _bias(chain: stp.ClosedChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.array(pin.nonLinearEffects(chain.model, pin.Data(chain.model), q, v))
