"""When kernels are worth compiling, and for whom."""

from __future__ import annotations

import builtins
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.kernels import choosing
from stewart_pin.kernels.choosing import kernels_for, simulation_kernels
from tests.closed_states import random_configuration, random_motion, robot


def test_few_states_are_left_to_the_verbs_of_one() -> None:
    chain = robot("stewart")
    assert kernels_for(chain, choosing.HANDFUL - 1) is None
    assert kernels_for(chain, choosing.HANDFUL) is kernels_for(chain, 10**6)
    assert kernels_for(chain, 10**6, wanted=False) is None
    assert simulation_kernels(chain, choosing.MANY_CALLS - 1) is None
    assert simulation_kernels(chain, choosing.MANY_CALLS, wanted=False) is None
    with pytest.raises(stp.errors.InputError, match="kernels must be True, False or None"):
        kernels_for(chain, 10, wanted="yes")  # pyright: ignore[reportArgumentType]


def test_each_thread_has_its_own_places(rng: np.random.Generator) -> None:
    chain = robot("four_bar")
    here = simulation_kernels(chain, choosing.MANY_CALLS)
    assert here is not None and here is simulation_kernels(chain, choosing.MANY_CALLS)
    with ThreadPoolExecutor(1) as other:
        there = other.submit(simulation_kernels, chain, choosing.MANY_CALLS).result()
    assert there is not None and there is not here
    q = random_configuration(chain, rng)
    v, _ = random_motion(chain, rng, q)
    tau = rng.normal(size=chain.nu)
    expected = stp.forward_dynamics(chain, q, v, tau).a
    a = here.acceleration(q, v, tau)[0].copy()
    there.acceleration(q, 0 * v, tau)
    np.testing.assert_array_equal(here.acceleration.outputs[0], a)
    np.testing.assert_allclose(a, expected, atol=1e-10 * max(1.0, np.abs(expected).max()))


def test_an_interpreter_is_no_gain_for_one_state(monkeypatch: pytest.MonkeyPatch) -> None:
    chain = robot("rpr_planar")
    choosing._compiled_tree.cache_clear()
    real = builtins.__import__

    def without(name: str, *args: Any, **options: Any) -> Any:
        if name.startswith("llvmlite"):
            raise ImportError(name)
        return real(name, *args, **options)

    monkeypatch.setattr(builtins, "__import__", without)
    assert simulation_kernels(chain, choosing.MANY_CALLS) is None
    with pytest.raises(stp.errors.MissingExtraError, match="llvmlite"):
        simulation_kernels(chain, choosing.MANY_CALLS, wanted=True)
