"""Law 3 between joints and motors: efforts on one side do the work of those on the other."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp
from tests.closed_states import close
from tests.laws.conftest import Case, round_off


def test_joint_efforts_do_the_work_of_motor_efforts(held: Case) -> None:
    """Every passive joint that no idle freedom moves, one by one and all together."""
    chain, rng = held.chain, np.random.default_rng(11)
    idle = np.abs(chain.at(held.q).freedom.idle / chain.tangent_scale[:, None]).max(axis=1, initial=0.0)
    names = [
        name for k, name in enumerate(chain.tangent_names) if k not in chain.motor_index and idle[k] < 1e-9
    ]
    if not names:
        pytest.skip("every joint is a motor, or idle")
    for joints in (names, names[:1], names[-1:]):
        found = stp.dynamics.joint_motor_map(chain, held.q, joints, held.v)
        index = [chain.tangent_names.index(name) for name in joints]
        scale = chain.tangent_scale[index]
        tolerance = round_off(held, 1e-10)
        error = (found.J @ held.v[chain.motor_index] - held.v[index]) / scale
        assert np.abs(error).max() <= tolerance * np.abs(held.v / chain.tangent_scale).max()
        error = (found.J @ held.a[chain.motor_index] + found.bias - held.a[index]) / scale
        assert np.abs(error).max() <= tolerance * np.abs(held.a / chain.tangent_scale).max()
        effort = rng.normal(size=len(index)) / scale
        power = (found.J.T @ effort) @ held.v[chain.motor_index]
        # Against the powers that the joint could have: one that hardly moves has no digits of its own.
        size = np.abs(effort * scale).sum() * np.abs(held.v / chain.tangent_scale).max()
        assert abs(power - effort @ held.v[index]) <= tolerance * size
        if found.inverse is not None:
            rates = chain.tangent_scale[chain.motor_index]
            close(found.inverse @ held.v[index] / rates, held.v[chain.motor_index] / rates, 10 * tolerance)
