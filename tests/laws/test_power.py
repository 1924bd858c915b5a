"""Law 3: what the motors put in is what kinetic and potential energy gain."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from tests.closed_states import along, derivative
from tests.laws.conftest import Case


@pytest.mark.parametrize("method", ["pinocchio", "constraint_matrix"])
def test_motor_power_is_the_rate_of_energy(held: Case, method: str) -> None:
    chain, model, v = held.chain, held.chain.model, held.v
    effort = stp.inverse_dynamics(chain, held.q, v, held.a, method=method)
    data, curve = pin.Data(model), along(chain, held.q, v, effort.a)

    def energy(t: float) -> float:
        q = curve(t)
        return pin.computeKineticEnergy(model, data, q, v + effort.a * t) + pin.computePotentialEnergy(
            model, data, q
        )

    power = effort.tau_motor @ v[chain.motor_index]
    # Powers that cancel have digits relative to the parts, not to their sum.
    parts = np.abs(effort.tau_motor * v[chain.motor_index]).sum()
    # Differences at h = 1e-3 see the energy's round-off divided by h; measured 1e-9.
    size = max(parts, energy(0.0) if chain.gravity.any() else 0.0)
    assert abs(power - derivative(energy)) <= 1e-8 * max(size, abs(power))
