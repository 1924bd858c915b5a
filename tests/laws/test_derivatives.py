"""Law 1: every Jacobian is the derivative that it claims to be, loops closed and open."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from tests.closed_states import along, close, derivative
from tests.laws.conftest import Case

# Central differences of order 4 at h = 1e-3: truncation h⁴/30 · (fifth derivative) and round-off eps/h are both near
# 1e-13 of the robot's size; rates of a few per second raise the first to 1e-10.
DIFFERENCES = 1e-9


@pytest.fixture(params=["closed", "open"])
def at(request: pytest.FixtureRequest, case: Case, rng: np.random.Generator) -> Case:
    """Return the case as it is, and with every joint moved so that the loops are open."""
    if request.param == "closed":
        return case
    chain = case.chain
    apart = pin.integrate(chain.model, case.q, 0.1 * rng.uniform(-1, 1, chain.nv) * chain.tangent_scale)
    v = rng.normal(size=chain.nv) * chain.tangent_scale
    return Case(chain, apart, v, case.a, case.pose)


def test_loop_jacobian(at: Case) -> None:
    chain, jacobian = at.chain, stp.loop_jacobian(at.chain, at.q)
    for k in range(chain.nv):
        direction = np.zeros(chain.nv)
        direction[k] = chain.tangent_scale[k]
        slope = derivative(lambda t, d=direction: stp.loop_gap(chain, along(chain, at.q, d)(t)))
        assert np.abs(jacobian @ direction - slope).max(initial=0.0) <= DIFFERENCES * chain.length_scale


def test_loop_bias(at: Case) -> None:
    chain = at.chain
    curve = along(chain, at.q, at.v)
    # A shorter step than elsewhere: the direction of a short rod turns fast.
    slope = derivative(lambda t: stp.loop_jacobian(chain, curve(t)) @ at.v, 3e-4)
    # The bias is quadratic in the velocity; where it cancels, its parts have the size of the squares.
    size = max(
        np.abs(slope).max(initial=0.0), np.abs(at.v / chain.tangent_scale).max() ** 2 * chain.length_scale
    )
    assert np.abs(stp.loop_bias(chain, at.q, at.v) - slope).max(initial=0.0) <= DIFFERENCES * size


def test_platform_jacobian_and_bias(at: Case) -> None:
    chain = at.chain
    curve = along(chain, at.q, at.v)
    twist = chain.at(at.q).P @ at.v
    here = stp.platform_pose(chain, at.q)
    close(derivative(lambda t: stp.platform_pose(chain, curve(t)).translation), twist[:3], DIFFERENCES)
    turned = derivative(lambda t: pin.log3(stp.platform_pose(chain, curve(t)).rotation @ here.rotation.T))
    # A platform that only translates has no turn and no bias, but the round-off of the joints' own rates.
    rate = float(np.abs(at.v / chain.tangent_scale).max())
    assert np.abs(turned - twist[3:]).max() <= DIFFERENCES * rate
    slope = derivative(lambda t: chain.at(curve(t)).P @ at.v)
    bias = chain.at(at.q, at.v).platform_bias
    assert np.abs(bias - slope).max() <= DIFFERENCES * max(np.abs(slope).max(), chain.length_scale * rate**2)


def test_motor_jacobian(case: Case) -> None:
    """Follow a motion with closed loops: motor rates by differences, twist by differences, no Jacobian at all."""
    chain = case.chain
    matrix = np.vstack([chain.at(case.q).J_c, chain.at(case.q).P]) * chain.tangent_scale
    _, s, vt = np.linalg.svd(matrix)
    rest = vt[np.count_nonzero(s > 1e-10 * s[0]) :]
    if np.abs(rest[:, chain.motor_index]).max(initial=0.0) > 1e-8:
        pytest.skip("motors move with the platform at rest: its twist does not determine their rates")
    curve = along(chain, case.q, case.v, case.a)

    def closed(t: float) -> np.ndarray:
        return stp.close_loops(chain, curve(t)).q

    here = stp.platform_pose(chain, case.q)
    # A wider step: what Newton's method leaves open, 1e-14, must not show; next to a singularity motions bend more.
    h = 4e-3 if case.pose == "near_singular" else 1e-2
    rates = derivative(lambda t: stp.motor_positions(chain, closed(t)), h)
    linear = derivative(lambda t: stp.platform_pose(chain, closed(t)).translation, h)
    angular = derivative(
        lambda t: pin.log3(stp.platform_pose(chain, closed(t)).rotation @ here.rotation.T), h
    )
    # h⁴/30 = 3e-10 times the fifth derivative, which is large where a mechanism turns sharply.
    close(stp.motor_jacobian(chain, case.q) @ np.concatenate([linear, angular]), rates, 1e-6)
