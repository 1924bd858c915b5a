"""The laws at a generic state of some mechanisms, and the energy of all; `tests/laws` has the rest, slow."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from types import ModuleType

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from tests.closed_states import configuration, random_motion
from tests.laws import (
    test_closing,
    test_derivatives,
    test_effort_maps,
    test_inverse_and_forward,
    test_operational_dynamics,
    test_power,
    test_same_mechanism,
)
from tests.laws.conftest import Case
from tests.zoo.table import QUICK, expected, zoo_chain

MODULES = (
    test_closing,
    test_derivatives,
    test_effort_maps,
    test_inverse_and_forward,
    test_operational_dynamics,
    test_power,
    test_same_mechanism,
)
CHOICES = {"coordinates": ("motor", "platform"), "method": ("pinocchio", "constraint_matrix")}


def _laws(module: ModuleType) -> list[tuple[str, Callable[..., None]]]:
    return [
        (name, law)
        for name, law in inspect.getmembers(module, inspect.isfunction)
        if name.startswith("test_")
    ]


LAWS = [
    pytest.param(law, choice, id="-".join([name.removeprefix("test_"), *choice.values()]))
    for module in MODULES
    for name, law in _laws(module)
    for choice in [
        {kind: value}
        for kind, values in CHOICES.items()
        if kind in inspect.signature(law).parameters
        for value in values
    ]
    or [{}]
]


def case_of(name: str) -> Case:
    chain, q = zoo_chain(name), configuration(name, "generic")
    return Case(chain, q, *random_motion(chain, np.random.default_rng(5), q), "generic")


@pytest.mark.parametrize("name", expected("law", only=QUICK))
@pytest.mark.parametrize(("law", "choice"), LAWS)
def test_law(law: Callable[..., None], choice: dict[str, str], name: str, rng: np.random.Generator) -> None:
    case = case_of(name)
    given = {"case": case, "held": case, "at": case, "chain": case.chain, "rng": rng, **choice}
    law(**{key: given[key] for key in inspect.signature(law).parameters})


@pytest.mark.parametrize("name", expected("free_motion"))
def test_free_motion_keeps_its_energy(name: str) -> None:
    """Classical Runge-Kutta: the energy errs by its order, the loops not at all."""
    case = case_of(name)
    errors = []
    for dt in (4e-3, 2e-3):
        run = stp.simulate(case.chain, case.q, 0.5 * case.v, duration=0.08, dt=dt, kernels=False)
        assert run.success, run.message
        assert run.largest_gap <= 1e-12
        errors.append(np.abs(run.energy - run.energy[0]).max())
    weight = 9.81 * pin.computeTotalMass(case.chain.model) * case.chain.length_scale
    # The error is of order 4: half the step, a sixteenth of it; below, round-off of the energy.
    assert errors[1] <= max(errors[0] / 8, 1e-12 * max(np.abs(run.energy).max(), weight))
    assert errors[1] <= 1e-6 * weight
