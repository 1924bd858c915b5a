"""Micro-robots: bodies of 1e-18 kg obey as heavy ones do, in every formulation: efforts are in proportion to masses."""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import UnsupportedError
from tests.closed_states import close, random_configuration, random_motion, robot, slow_but_for_few

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


@pytest.mark.parametrize("share", AGREE)
@pytest.mark.parametrize(
    "name",
    [
        *slow_but_for_few(n for n in stp.robots() if n != "delta"),
        pytest.param("delta", marks=pytest.mark.slow),
    ],
)
def test_efforts_are_in_proportion_to_masses(name: str, share: float) -> None:
    usual = answers(robot(name), 1.0, np.random.default_rng(5))
    micro = answers(light(name, share), share, np.random.default_rng(5))
    assert micro.keys() == usual.keys()
    for way, expected in usual.items():
        assert np.isfinite(micro[way]).all(), way
        close(micro[way], expected, AGREE[share])
