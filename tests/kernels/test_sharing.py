"""Efforts within limits for arrays of states: as by the verb of one state, which has another solver."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.compiled import StateStatus
from stewart_pin.errors import EffortLimitError, InputError, UnsupportedError
from stewart_pin.kernels.verbs import sharing as of_kernels
from tests.cable_robots import cables_4, cables_8
from tests.closed_states import random_configuration, random_motion, robot
from tests.mechanics.test_sharing import crossed
from tests.mechanisms import five_bar
from tests.pulled import boxed

WAYS: dict[str, tuple[Any, Any]] = {
    "eight cables": (boxed, "platform"),
    "seven cables": (lambda: boxed(7), "platform"),
    "four in a plane": (crossed, "platform"),
    "four in a plane, by the motors": (crossed, "motor"),
    "five-bar with three motors": (five_bar, "tree"),
    "as many motors as freedoms": (lambda: robot("stewart"), "platform"),
    "cables_4": (cables_4, "platform"),
    "cables_8": (cables_8, "platform"),
}


def states(chain: stp.ClosedChain, rng: np.random.Generator, count: int) -> list[stp.State]:
    found = []
    for _ in range(count):
        q = random_configuration(chain, rng, 0.1)
        v, a = random_motion(chain, rng, q)
        found.append(chain.at(q, v, a))
    return found


def told(state: stp.State, coordinates: str) -> tuple[np.ndarray, ...]:
    """Tell a state in the coordinates of kernels."""
    chain, a = state.chain, state.require_accelerating()
    if coordinates == "tree":
        return state.q, state.v, a
    if coordinates == "motor":
        return tuple(
            x for x in (state.q[chain.motor_q_index], state.v[chain.motor_index], a[chain.motor_index])
        )
    motion = stp.platform_pose(chain, state.q)
    twist = state.P @ state.v
    return pin.SE3ToXYZQUAT(motion), twist, state.P @ a + state.platform_bias


SLOW = (
    "seven cables",
    "four in a plane",
    "four in a plane, by the motors",
    "as many motors as freedoms",
    "cables_8",
)
"""Ways that tell no more than others do, to be asked with `-m slow`."""


@pytest.mark.parametrize(
    "way", [pytest.param(way, marks=pytest.mark.slow if way in SLOW else ()) for way in WAYS]
)
def test_they_are_those_of_one_state(way: str, rng: np.random.Generator) -> None:
    build, coordinates = WAYS[way]
    chain = build()
    kernels = stp.compile_kernels(chain, coordinates=coordinates)
    some = states(chain, rng, 12)
    inputs = [np.array(x) for x in zip(*(told(state, coordinates) for state in some), strict=True)]
    free = kernels.inverse_dynamics(*inputs)
    high = 1.2 * np.abs(free).max()
    limits = np.c_[np.full(chain.nu, -0.7 * high), np.full(chain.nu, high)]
    limits[1] = -np.inf, np.inf
    outcomes = set()
    for sharing in ("least_norm", "mid_range"):
        for share in (1.0, 0.35):
            status = np.empty(len(some), dtype=np.int8)
            found = kernels.inverse_dynamics(
                *inputs, effort_limit=share * limits, sharing=sharing, status=status
            )
            single = kernels.single_state("inverse_dynamics", effort_limit=share * limits, sharing=sharing)
            for k, state in enumerate(some):
                outcomes.add(StateStatus(int(status[k])))
                np.testing.assert_array_equal(single(*(x[k] for x in inputs)), found[k])
                assert single.status == status[k]
                try:
                    one = stp.inverse_dynamics(state, effort_limit=share * limits, sharing=sharing).tau_motor
                except EffortLimitError:
                    assert status[k] == StateStatus.OUT_OF_LIMITS and np.isnan(found[k]).all()
                    continue
                assert status[k] == StateStatus.OK
                np.testing.assert_allclose(found[k], one, rtol=0, atol=1e-9 * np.abs(one).max())
    assert StateStatus.OK in outcomes


@pytest.fixture(scope="module")
def many() -> tuple[Any, tuple[np.ndarray, ...]]:
    """Make a thousand states of the eight cables, of which some are out of limits."""
    rng, chain = np.random.default_rng(7), boxed()
    pose = np.tile(pin.SE3ToXYZQUAT(stp.platform_pose(chain, chain.q_home)), (1000, 1))
    pose[:, :3] += rng.uniform(-0.5, 0.5, (1000, 3))
    return stp.compile_kernels(chain), (
        pose,
        0.3 * rng.normal(size=(1000, 6)),
        3 * rng.normal(size=(1000, 6)),
    )


def test_threads_places_and_neighbours_change_nothing(many) -> None:
    kernels, inputs = many
    limits = kernels.chain.limits
    status, out = np.empty(1000, dtype=np.int8), np.empty((1000, 8))
    found = kernels.inverse_dynamics(*inputs, effort_limit=limits, out=out, status=status)
    assert found is out
    assert set(status.tolist()) == {StateStatus.OK, StateStatus.OUT_OF_LIMITS}
    low, high = limits.bounds("effort", kernels.chain.motor_index).T
    good = status == StateStatus.OK
    assert 300 < np.count_nonzero(good) < 900
    assert ((out[good] >= low) & (out[good] <= high)).all() and np.isnan(out[~good]).all()
    np.testing.assert_array_equal(kernels.inverse_dynamics(*inputs, effort_limit=limits, threads=3), out)
    part = [x[500:510] for x in inputs]
    np.testing.assert_array_equal(kernels.inverse_dynamics(*part, effort_limit=limits), out[500:510])
    lost = inputs[0].copy()
    lost[3, 0] = np.nan
    again = kernels.inverse_dynamics(lost, *inputs[1:], effort_limit=limits, status=status)
    assert status[3] == StateStatus.INPUT_NOT_FINITE and np.isnan(again[3]).all()
    np.testing.assert_array_equal(np.delete(again, 3, axis=0), np.delete(out, 3, axis=0))
    np.testing.assert_array_equal(
        kernels.inverse_dynamics(*(x[7] for x in inputs), effort_limit=limits), out[7]
    )


def test_without_numba_the_same_efforts_come_from_the_other_solver(
    many, monkeypatch: pytest.MonkeyPatch
) -> None:
    kernels, inputs = many
    some, limits = inputs, kernels.chain.limits
    for sharing in ("least_norm", "mid_range"):
        status, other = np.empty((2, 1000), dtype=np.int8)
        fast = kernels.inverse_dynamics(*some, effort_limit=limits, sharing=sharing, status=status)
        with monkeypatch.context() as patch:
            patch.setattr(of_kernels, "_compiled", lambda: None)
            slow = kernels.inverse_dynamics(*some, effort_limit=limits, sharing=sharing, status=other)
        np.testing.assert_array_equal(status, other)
        good = status == StateStatus.OK
        size = np.abs(slow[good]).max(axis=1, keepdims=True)
        assert (np.abs(fast - slow)[good] / size).max() < 1e-9


def test_wrong_options(many) -> None:
    kernels, inputs = many
    with pytest.raises(UnsupportedError, match="kernels share by 'least_norm' or 'mid_range'"):
        kernels.inverse_dynamics(*inputs, sharing="least_peak")
    with pytest.raises(InputError, match="effort_limit must be a number or have shape"):
        kernels.inverse_dynamics(*inputs, effort_limit=[1.0, 2.0])
    with pytest.raises(
        InputError, match="effort_limit and sharing are for 'inverse_dynamics', got 'reactions'"
    ):
        kernels.single_state("reactions", effort_limit=1.0)
    with pytest.raises(InputError, match="status must be an array int8"):
        kernels.inverse_dynamics(*inputs, effort_limit=1.0, status=np.zeros(3, dtype=np.int8))


def test_what_exchanges_bring_to_no_end_the_other_solver_answers(
    many, monkeypatch: pytest.MonkeyPatch
) -> None:
    kernels, inputs = many
    some, limits = [x[:40] for x in inputs], kernels.chain.limits

    def lost(share, tau, sizes, lower, upper, middle, rank, begin, end, codes) -> None:
        codes[begin:end] = 2

    status, other = np.empty((2, 40), dtype=np.int8)
    expected = kernels.inverse_dynamics(*some, effort_limit=limits, status=status)
    monkeypatch.setattr(of_kernels, "_compiled", lambda: lost)
    found = kernels.inverse_dynamics(*some, effort_limit=limits, status=other)
    np.testing.assert_array_equal(status, other)
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    one = kernels.single_state("inverse_dynamics", effort_limit=limits)
    for k in range(5):
        np.testing.assert_array_equal(one(*(x[k] for x in some)), found[k])
        assert one.status == status[k]
