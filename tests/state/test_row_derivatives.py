"""Second derivatives of every kind of row, by differences, loops closed and open."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.model.description import LOOP_KINDS
from stewart_pin.state.row_derivatives import reaction_forces, row_derivatives
from tests.closed_states import along, close, derivative
from tests.mechanisms import arm, gear_train, two_bodies

KINDS = [*LOOP_KINDS, "couplings", "stewart", "no loop"]


@pytest.fixture(params=KINDS)
def chain(request: pytest.FixtureRequest, rng: np.random.Generator) -> stp.ClosedChain:
    """Return a chain with each kind of row."""
    match request.param:
        case "couplings":
            return gear_train(rng)
        case "stewart":
            return stp.load("stewart")
        case "no loop":
            return arm(rng)
        case kind:
            return two_bodies(kind, rng)


@pytest.fixture
def q(chain: stp.ClosedChain, rng: np.random.Generator) -> np.ndarray:
    """Return a configuration with open loops: nothing here needs them closed."""
    return pin.integrate(chain.model, chain.q_home, 0.2 * rng.normal(size=chain.nv) * chain.tangent_scale)


# Differences of order 4 at h = 1e-3; the fifth derivative of a short distance is 1e4 of its first.
DIFFERENCES = 1e-7


def test_rates_and_accelerations(chain: stp.ClosedChain, q: np.ndarray, rng: np.random.Generator) -> None:
    v, a, d = rng.normal(size=(3, chain.nv))
    found = row_derivatives(chain, q, v, a)
    curve = along(chain, q, d)

    def acceleration(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return stp.loop_jacobian(chain, q) @ a + stp.loop_bias(chain, q, v)

    assert found.rate_q.shape == (chain.nc, chain.nv)
    if chain.nc:
        rate = derivative(lambda t: stp.loop_jacobian(chain, curve(t)) @ v)
        close(found.rate_q @ d, rate, DIFFERENCES)
        close(found.acceleration_q @ d, derivative(lambda t: acceleration(curve(t), v)), DIFFERENCES)
        close(found.acceleration_v @ d, derivative(lambda t: acceleration(q, v + t * d)), DIFFERENCES)


def test_agrees_with_the_jacobian_s_rate(
    chain: stp.ClosedChain, q: np.ndarray, rng: np.random.Generator
) -> None:
    """The rate of J_c v along d is the derivative of the Jacobian along d, found from the bias alone, times v."""
    v, d = rng.normal(size=(2, chain.nv))
    found = row_derivatives(chain, q, v, np.zeros(chain.nv)).rate_q @ d
    expected = stp.loops.loop_jacobian_rate(chain, q, d, v[:, None])[:, 0]
    np.testing.assert_allclose(found, expected, atol=1e-12 * (1 + np.abs(expected).max(initial=0.0)))


def test_reactions(chain: stp.ClosedChain, q: np.ndarray, rng: np.random.Generator) -> None:
    lambda_c, d = rng.normal(size=chain.nc), rng.normal(size=chain.nv)
    v, a = rng.normal(size=(2, chain.nv))
    found = reaction_forces(chain, q, lambda_c)
    data = pin.Data(chain.model)
    # What Pinocchio takes for efforts: rnea with external forces is less Jᵀ f.
    without = pin.rnea(chain.model, data, q, v, a)
    carried = without - pin.rnea(chain.model, data, q, v, a, found.forces) + found.efforts
    np.testing.assert_allclose(carried, stp.loop_jacobian(chain, q).T @ lambda_c, atol=1e-12)
    without = np.array(pin.computeRNEADerivatives(chain.model, data, q, v, a)[0])
    pushed = np.array(pin.computeRNEADerivatives(chain.model, data, q, v, a, found.forces)[0])
    slope = (without - pushed + found.derivative) @ d
    curve = along(chain, q, d)
    expected = derivative(lambda t: stp.loop_jacobian(chain, curve(t)).T @ lambda_c)
    np.testing.assert_allclose(slope, expected, atol=DIFFERENCES * (1 + np.abs(expected).max(initial=0.0)))
