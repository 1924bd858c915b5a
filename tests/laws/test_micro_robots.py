"""Micro-robots, of 1e-18 kg or of 1e-7 m, obey as others do, in every formulation: efforts are in proportion."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import UnsupportedError
from tests.closed_states import close, random_configuration, random_motion, robot, slow_but_for_few
from tests.zoo.table import ROBOTS, zoo_chain

AGREE = {2.0**-60: 1e-15, 1e-18: 1e-10}
"""Powers of two cost no digits at all: every bit is the same; others cost round-off, as law 5."""


@cache
def light(name: str, share: float) -> stp.ClosedChain:
    """Scale all masses and inertias of a bundled robot."""
    chain = robot(name)
    bodies = {link.name: link.inertia for link in chain.mechanism.links if link.inertia is not None}
    scaled = {n: pin.Inertia(share * y.mass, y.lever, share * y.inertia) for n, y in bodies.items()}
    return stp.build.replace_inertias(chain, scaled)


def answers(chain: stp.ClosedChain, share: float, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Efforts over the share of mass, and accelerations under efforts in proportion, by all formulations."""
    q = random_configuration(robot(chain.name), rng)
    v, a = random_motion(robot(chain.name), rng, q)
    tau, found = rng.normal(size=chain.nu), {}
    for method in ("pinocchio", "constraint_matrix"):
        effort = stp.inverse_dynamics(chain, q, v, a, method=method)
        found[method] = effort.tau_motor / share
        if chain.nc:
            found[f"reactions, {method}"] = effort.lambda_c / share
    found["forward"] = stp.forward_dynamics(chain, q, v, share * tau).a
    found["articulated bodies"] = stp.dynamics.closed_chain_articulated_body(chain, q, v, share * tau).a
    found["inertia of the platform's coordinates"] = stp.operational_dynamics(chain, q, v).M / share
    push = {chain.platform: share * np.arange(1.0, 7.0)}
    for method in ("pinocchio", "constraint_matrix"):
        effort = stp.inverse_dynamics(chain, q, v, a, wrenches=push, method=method)
        found[f"pushed, {method}"] = effort.tau_motor / share
    found["pushed forward"] = stp.forward_dynamics(chain, q, v, share * tau, wrenches=push).a
    parts = stp.joint_reactions(chain.at(q, v, a), wrenches=push)
    found["pushed joints"] = np.array([part.force for part in parts if part.unique]) / share
    state, pose = chain.at(q, v), stp.platform_pose(chain, q)
    twist, acceleration = state.P @ v, state.P @ a + state.platform_bias
    given = {
        "tree": (q, v, a),
        "motor": (q[chain.motor_q_index], v[chain.motor_index], a[chain.motor_index]),
        "platform": (pin.SE3ToXYZQUAT(pose), twist, acceleration),
    }
    for coordinates, motion in given.items():
        try:
            kernels = stp.compile_kernels(chain, coordinates=coordinates, engine="numpy")
        except UnsupportedError:
            continue
        found[f"kernels, {coordinates}"] = kernels.inverse_dynamics(*motion) / share
        found[f"forward kernels, {coordinates}"] = kernels.forward_dynamics(*motion[:2], share * tau)
    try:
        hexapod, bodies = stp.Hexapod.from_chain(chain), stp.hexapods.hexapod_bodies(chain)
    except UnsupportedError:
        return found
    forces = stp.hexapods.hexapod_inverse_dynamics(
        hexapod, bodies, pose.translation, pose.rotation, twist, acceleration, gravity=chain.gravity
    )
    found["closed form"] = forces.actuator / share
    return found


@cache
def usual_answers(name: str) -> dict[str, np.ndarray]:
    return answers(robot(name), 1.0, np.random.default_rng(5))


@pytest.mark.parametrize("share", [2.0**-60, pytest.param(1e-18, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "name",
    [
        *slow_but_for_few(ROBOTS, ["four_bar", "rpr_planar"]),
    ],
)
def test_efforts_are_in_proportion_to_masses(name: str, share: float) -> None:
    usual = usual_answers(name)
    micro = answers(light(name, share), share, np.random.default_rng(5))
    assert micro.keys() == usual.keys()
    for way, expected in usual.items():
        assert np.isfinite(micro[way]).all(), way
        close(micro[way], expected, AGREE[share])


def test_rotors_set_by_hand_count_as_they_stand(rng: np.random.Generator) -> None:
    chain, fresh = light("five_bar", 2.0**-60), stp.build.replace_inertias(light("five_bar", 2.0**-60), {})
    q = random_configuration(chain, rng)
    v, a = random_motion(chain, rng, q)
    before = stp.inverse_dynamics(chain, q, v, a).tau_motor
    found = []
    for each in (stp.build.replace_inertias(chain, {}), fresh):
        if each is not fresh:
            stp.inverse_dynamics(each, q, v, a)
        each.model.armature = np.full(chain.nv, 2.0**-58)
        found.append(stp.inverse_dynamics(each, q, v, a).tau_motor)
        assert len(stp.joint_reactions(each, q, v, stp.inverse_dynamics(each, q, v, a))) > 0
    np.testing.assert_array_equal(*found)
    assert np.abs(found[0] - before).max() > 0.1 * np.abs(before).max()


def small(chain: stp.ClosedChain, share: float) -> stp.ClosedChain:
    """Scale all lengths of a mechanism whose home is zero, that of gravity's acceleration as well."""
    old = chain.described()

    def placed(placement: pin.SE3) -> pin.SE3:
        return pin.SE3(placement.rotation, share * placement.translation)

    def body(inertia: pin.Inertia | None) -> pin.Inertia | None:
        return inertia and pin.Inertia(inertia.mass, share * inertia.lever, share**2 * inertia.inertia)

    mechanism = replace(
        old,
        links=tuple(replace(link, inertia=body(link.inertia)) for link in old.links),
        joints=tuple(replace(joint, placement=placed(joint.placement)) for joint in old.joints),
        loops=tuple(
            replace(loop, placement1=placed(loop.placement1), placement2=placed(loop.placement2))
            for loop in old.loops
        ),
    )
    gravity = share * chain.gravity
    return build_chain(mechanism, motors=chain.motors, platform=chain.platform, gravity=gravity)


@pytest.mark.parametrize("share", [1e-3, 1e-7])
@pytest.mark.parametrize("name", ["rccc", "cardan_shaft", "tripod_3prs"])
def test_efforts_are_in_proportion_to_lengths(name: str, share: float, rng: np.random.Generator) -> None:
    usual, micro = zoo_chain(name), small(zoo_chain(name), share)
    close([micro.length_scale], [share * usual.length_scale], 1e-9)
    assert stp.mobility(micro).dof == stp.mobility(usual).dof
    lengths = np.where(usual.angle_mask, 1.0, share)
    v, a = random_motion(usual, rng, usual.q_home)
    for method in ("pinocchio", "constraint_matrix"):
        expected = stp.inverse_dynamics(usual, usual.q_home, v, a, method=method).tau_motor
        tau = stp.inverse_dynamics(micro, micro.q_home, lengths * v, lengths * a, method=method).tau_motor
        close(tau * lengths[micro.motor_index] / share**2, expected, 1e-9)
