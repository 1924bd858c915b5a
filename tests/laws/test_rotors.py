"""Law 5 with rotors: inertia of the joints' own, Pinocchio's armature, is felt alike by every formulation."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import UnsupportedError
from tests.closed_states import (
    KINDS,
    close,
    derivative,
    random_configuration,
    random_motion,
    robot,
    slow_but_for_few,
)
from tests.zoo.table import ROBOTS

AGREE = 1e-10
"""Relative; as law 5 without rotors, of which these are a part."""


@cache
def turning(name: str) -> stp.ClosedChain:
    """Give every joint a rotor of its own, as heavy as the bodies."""
    chain = robot(name)
    model = chain.model.copy()
    inertia = pin.crba(chain.model, pin.Data(chain.model), chain.q_home).diagonal()
    usual = np.median(inertia[inertia > 0] / chain.tangent_scale[inertia > 0] ** 2)
    own = np.random.default_rng(3).uniform(0.2, 1.0, chain.nv) * usual * chain.tangent_scale**2
    model.armature = own
    return replace(chain, model=model)


@pytest.fixture(params=[*ROBOTS, *KINDS])
def chain(request: pytest.FixtureRequest) -> stp.ClosedChain:
    """Return each bundled robot and each kind of closure, with a rotor on every joint."""
    return turning(request.param)


def moving(chain: stp.ClosedChain, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    q = random_configuration(chain, rng)
    return q, *random_motion(chain, rng, q)


def held(chain: stp.ClosedChain) -> None:
    if not stp.mobility(chain).motors_sufficient:
        pytest.skip(f"the motors of {chain.name} do not hold it")


def by_hand(chain: stp.ClosedChain, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Joint efforts of the open tree, rotors added to those of a model without."""
    bare = chain.model.copy()
    bare.armature = np.zeros(chain.nv)
    return pin.rnea(bare, bare.createData(), q, v, a) + np.array(chain.model.armature) * a


def test_efforts_are_those_by_hand(chain: stp.ClosedChain, rng: np.random.Generator) -> None:
    held(chain)
    q, v, a = moving(chain, rng)
    for method in ("pinocchio", "constraint_matrix"):
        effort = stp.inverse_dynamics(chain, q, v, a, method=method)
        needed = by_hand(chain, q, v, effort.a)
        given = chain.motor_rows.T @ effort.tau_motor + stp.loop_jacobian(chain, q).T @ effort.lambda_c
        close(given / needed_size(needed), needed / needed_size(needed), AGREE)


def needed_size(needed: np.ndarray) -> float:
    return float(np.abs(needed).max())


def test_methods_agree(chain: stp.ClosedChain, rng: np.random.Generator) -> None:
    held(chain)
    q, v, a = moving(chain, rng)
    one = stp.inverse_dynamics(chain, q, v, a)
    two = stp.inverse_dynamics(chain, q, v, a, method="constraint_matrix")
    close(two.tau_motor, one.tau_motor, AGREE)
    close(two.a / chain.tangent_scale, one.a / chain.tangent_scale, AGREE)
    back = stp.forward_dynamics(chain, q, v, one.tau_motor)
    close(
        back.a / chain.tangent_scale, one.a / chain.tangent_scale, 1e-8
    )  # round-off times the inertias' spread
    heavy = stp.inverse_dynamics(robot(chain.name), q, v, a).tau_motor if chain.name in stp.robots() else 0.0
    assert np.abs(one.tau_motor - heavy).max() > 1e-3 * np.abs(one.tau_motor).max()  # they are felt


def test_articulated_bodies_agree(chain: stp.ClosedChain, rng: np.random.Generator) -> None:
    q, v, _ = moving(chain, rng)
    tau = rng.normal(size=chain.nu)
    one = stp.forward_dynamics(chain, q, v, tau)
    two = stp.dynamics.closed_chain_articulated_body(chain, q, v, tau)
    close(two.a / chain.tangent_scale, one.a / chain.tangent_scale, 1e-9)
    if not chain.nc:
        three = stp.articulated_body_acceleration(chain, q, v, chain.motor_rows.T @ tau)
        close(three, one.a, 1e-9)


@pytest.mark.parametrize("coordinates", ["tree", "motor", "platform"])
@pytest.mark.parametrize("name", slow_but_for_few([*ROBOTS, *KINDS], ["four_bar", "gear_train"]))
def test_kernels_agree(name: str, rng: np.random.Generator, coordinates: str) -> None:
    chain = turning(name)
    held(chain)
    if (chain.name, coordinates) == ("arm_3r_planar", "platform"):
        pytest.skip("its home is stretched: a pose beside it does not tell on which side the elbow is")
    try:
        kernels = stp.compile_kernels(chain, coordinates=coordinates, engine="numpy")
    except UnsupportedError as error:
        pytest.skip(str(error))
    q, v, a = moving(chain, rng)
    if coordinates != "tree":  # where idle freedoms stand and move is then up to the verb
        state = chain.at(q, v)
        twist, acceleration = state.P @ v, state.P @ a + state.platform_bias
        found = stp.platform_motion(chain, stp.platform_pose(chain, q), twist, acceleration, limits=False)
        q, v, a = found.q, found.v, found.a
    effort = stp.inverse_dynamics(chain, q, v, a)
    given, wanted, size = (q, v, a), effort.a, chain.tangent_scale
    if coordinates == "motor":
        given = q[chain.motor_q_index], v[chain.motor_index], a[chain.motor_index]
        wanted, size = given[2], size[chain.motor_index]
    elif coordinates == "platform":
        given = pin.SE3ToXYZQUAT(stp.platform_pose(chain, q)), twist, acceleration
        wanted, size = acceleration, np.repeat([chain.length_scale, 1.0], 3)
    efforts = kernels.inverse_dynamics(*given)
    close(efforts, effort.tau_motor, 1e-9)
    close(kernels.forward_dynamics(*given[:2], efforts) / size, wanted / size, 1e-8)
    if not stp.mobility(chain).idle:
        close(kernels.regressor(*given) @ kernels.inertial_parameters, efforts, 1e-9)


def test_derivatives_agree_with_differences(rng: np.random.Generator) -> None:
    chain = turning("five_bar")
    kernels = stp.compile_kernels(chain, coordinates="motor", engine="numpy")
    q, v, a = moving(chain, rng)
    given = q[chain.motor_q_index], v[chain.motor_index], a[chain.motor_index]
    for place, found in enumerate(kernels.inverse_dynamics_derivatives(*given)):
        for k, unit in enumerate(np.eye(chain.nu)):
            moved = lambda t: kernels.inverse_dynamics(  # noqa: E731
                *(x + t * unit if n == place else x for n, x in enumerate(given))  # noqa: B023
            )
            close(found[:, k], derivative(moved), 1e-7)


def test_simulation_by_kernels_keeps_the_energy(rng: np.random.Generator) -> None:
    chain = turning("four_bar")
    q = random_configuration(chain, rng, 0.05)
    v, _ = random_motion(chain, rng, q)
    runs = [
        stp.simulate(chain, q, 0.3 * v, duration=0.02, dt=2e-4, kernels=choice) for choice in (True, False)
    ]
    close(runs[0].q[-1], runs[1].q[-1], 1e-11)
    np.testing.assert_allclose(runs[0].energy, runs[0].energy[0], rtol=1e-9)


def test_rebuilt_chains_keep_their_rotors() -> None:
    chain = turning("stewart")
    own = dict(zip(chain.tangent_names, chain.model.armature, strict=True))
    parameter = stp.build.geometry_parameters(chain)[0]
    body = pin.Inertia(1.0, np.zeros(3), np.eye(3))
    for rebuilt in (
        stp.massless_legs(chain),
        stp.attach_payload(chain, body),
        stp.with_motors(chain, chain.motors[::-1]),
        stp.with_platform(chain, "leg1_upper"),
        stp.lock_joints(chain, ["leg1"]),
        stp.on_floating_base(chain, base_inertia=body),
        stp.build.displace_geometry(chain, {parameter: 1e-3}),
    ):
        for name, amount in zip(rebuilt.tangent_names, rebuilt.model.armature, strict=True):
            assert amount == own.get(name, 0.0), name


def test_what_has_no_place_for_rotors_says_so() -> None:
    chain = turning("stewart")
    with pytest.raises(
        UnsupportedError, match=r"joint .* of stewart has armature .* take it away by with_joint"
    ):
        stp.hexapods.hexapod_bodies(chain)
    kernels = stp.compile_kernels(chain, engine="numpy")
    assert kernels.report.route == "tree" and "has a rotor" in kernels.report.why_tree
