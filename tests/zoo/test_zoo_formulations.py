"""Every formulation gives the same efforts and accelerations for every mechanism, at home and beside it."""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import UnsupportedError
from stewart_pin.programs.status import StateStatus
from tests.closed_states import close, configuration, random_motion
from tests.laws.conftest import Case, round_off, round_off_of_accelerations, round_off_of_efforts
from tests.zoo.table import REFUSED, expected, zoo_chain

AGREEMENT = 1e-10
"""Relative, at generic poses: round-off of two eliminations at condition numbers up to 1e3."""


@pytest.fixture(params=[pytest.param("home", marks=pytest.mark.slow), "generic"])
def pose(request: pytest.FixtureRequest) -> str:
    return request.param


def _case(name: str, pose: str, rng: np.random.Generator) -> Case:
    chain, q = zoo_chain(name), configuration(name, pose)
    return Case(chain, q, *random_motion(chain, rng, q), pose)


@pytest.mark.parametrize("name", expected("inverse"))
def test_inverse_dynamics(name: str, pose: str, rng: np.random.Generator) -> None:
    case = _case(name, pose, rng)
    one = stp.inverse_dynamics(case.chain, case.q, case.v, case.a)
    two = stp.inverse_dynamics(case.chain, case.q, case.v, case.a, method="constraint_matrix")
    close(two.tau_motor, one.tau_motor, round_off_of_efforts(case, AGREEMENT, one))
    assert (two.unique, two.reactions_unique) == (one.unique, one.reactions_unique)


@pytest.mark.parametrize("name", expected("forward"))
def test_forward_dynamics(name: str, pose: str, rng: np.random.Generator) -> None:
    case = _case(name, pose, rng)
    chain, scale = case.chain, case.chain.tangent_scale
    effort = stp.inverse_dynamics(chain, case.q, case.v, case.a)
    tolerance = round_off_of_accelerations(case, AGREEMENT, effort)
    methods = {
        "projection": stp.forward_dynamics(chain, case.q, case.v, effort.tau_motor, method="projection"),
        "articulated": stp.dynamics.closed_chain_articulated_body(chain, case.q, case.v, effort.tau_motor),
    }
    if chain.known_to_pinocchio:
        methods["pinocchio"] = stp.forward_dynamics(
            chain, case.q, case.v, effort.tau_motor, method="constraint_dynamics"
        )
    for motion in methods.values():
        close(motion.a / scale, effort.a / scale, tolerance)


@cache
def kernels(name: str, coordinates: str) -> stp.compiled.Kernels:
    return stp.compile_kernels(zoo_chain(name), coordinates=coordinates, engine="numpy")


def answering(name: str, coordinates: str) -> stp.compiled.Kernels | None:
    """Compile kernels, or see them refused where there can be none."""
    if (coordinates, name) not in REFUSED:
        return kernels(name, coordinates)
    with pytest.raises(UnsupportedError):
        kernels(name, coordinates)
    return None


@pytest.mark.parametrize("name", expected("tree_kernels", quick=True))
def test_kernels_in_tree_coordinates(name: str, pose: str, rng: np.random.Generator) -> None:
    case = _case(name, pose, rng)
    chain, many, status = case.chain, kernels(name, "tree"), np.empty(1, dtype=np.int8)
    effort = stp.inverse_dynamics(chain, case.q, case.v, case.a)
    tau_motor = many.inverse_dynamics(case.q[None], case.v[None], case.a[None], status=status)
    assert status[0] == StateStatus.OK
    close(tau_motor[0], effort.tau_motor, round_off_of_efforts(case, AGREEMENT, effort))
    a = many.forward_dynamics(case.q[None], case.v[None], effort.tau_motor[None])[0]
    tolerance = round_off_of_accelerations(case, AGREEMENT, effort)
    close(a / chain.tangent_scale, effort.a / chain.tangent_scale, tolerance)


@pytest.mark.parametrize("name", expected("motor_kernels", quick=True))
def test_kernels_in_motor_coordinates(name: str, pose: str, rng: np.random.Generator) -> None:
    case = _case(name, pose, rng)
    many, chain, status = answering(name, "motor"), case.chain, np.empty(1, dtype=np.int8)
    if many is None:
        return
    rate, demand = rng.normal(size=(2, chain.nu)) * chain.tangent_scale[chain.motor_index]
    if chain.generic.count.idle:  # whose rates are nobody's demand: at rest nothing depends on them
        rate, demand = np.zeros(chain.nu), np.zeros(chain.nu)
    x = stp.motor_positions(chain, case.q)
    q = stp.forward_kinematics(chain, x, limits=False).q
    here = stp.dynamics.motion_map(chain, q, np.zeros(chain.nv))
    v = here.G @ rate
    effort = stp.inverse_dynamics(chain, q, v, here.G @ demand + stp.dynamics.motion_map(chain, q, v).gamma)
    found = many.inverse_dynamics(x, rate, demand, status=status)
    assert status[0] == StateStatus.OK
    weight = 9.81 * pin.computeTotalMass(chain.model) * chain.length_scale
    assert np.abs(found - effort.tau_motor).max() <= round_off(case, AGREEMENT) * max(
        weight, np.abs(effort.tau_motor).max()
    )


@pytest.mark.parametrize("name", expected("platform_kernels", quick=True))
def test_kernels_in_platform_coordinates(name: str, pose: str, rng: np.random.Generator) -> None:
    case = _case(name, pose, rng)
    many, chain, status = answering(name, "platform"), case.chain, np.empty(1, dtype=np.int8)
    if many is None:
        return
    placed, rest, still = stp.platform_pose(chain, case.q), np.zeros(6), np.zeros(chain.nv)
    q = stp.inverse_kinematics(chain, placed, limits=False).q
    effort = stp.inverse_dynamics(chain, q, still, still)
    found = many.inverse_dynamics(pin.SE3ToXYZQUAT(placed), rest, rest, status=status)
    assert status[0] == StateStatus.OK
    weight = 9.81 * pin.computeTotalMass(chain.model) * chain.length_scale
    assert np.abs(found - effort.tau_motor).max() <= round_off(case, AGREEMENT) * max(
        weight, np.abs(effort.tau_motor).max()
    )
