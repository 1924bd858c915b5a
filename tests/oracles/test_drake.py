"""Law 9: Drake reads the bundled URDF as its tree, with the same masses, and needs the same motor efforts."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import find_robot
from stewart_pin.model.description import JointKind

pytest.importorskip("pydrake", reason="needs Drake: pip install 'stewart_pin[oracles]'")

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from tests.oracles.drake_engine import Engine


@pytest.fixture
def engine(chain: stp.ClosedChain) -> Engine:
    """Return a robot as Drake reads its file; what Drake cannot read is skipped, by name."""
    balls = [joint.name for joint in chain.mechanism.joints if joint.kind is JointKind.SPHERICAL]
    if balls:
        pytest.skip(f"Drake reads no spherical joint from plain URDF: {', '.join(balls)}")
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(find_robot(chain.name)))
    plant.mutable_gravity_field().set_gravity_vector(chain.gravity)
    if chain.mechanism.root != "world":
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(chain.mechanism.root))
    plant.Finalize()
    return Engine(chain, plant)


def test_links_have_the_same_masses(engine: Engine) -> None:
    context = engine.plant.CreateDefaultContext()
    for link in engine.chain.mechanism.links:
        if link.inertia is not None and link.name != "world":
            body = engine.plant.GetBodyByName(link.name)
            assert body.get_mass(context) == link.inertia.mass


def test_mass_matrix_and_bias(engine: Engine, rng: np.random.Generator) -> None:
    chain, data = engine.chain, pin.Data(engine.chain.model)
    assert (engine.plant.num_positions(), engine.plant.num_velocities()) == (chain.nq, chain.nv)
    for _ in range(5):
        q = pin.integrate(chain.model, chain.q_home, rng.uniform(-1, 1, chain.nv))
        v = rng.uniform(-1, 1, chain.nv)
        inertia, bias = engine.inertia_and_bias(q, v)
        ours = pin.crba(chain.model, data, q)
        ours = np.triu(ours) + np.triu(ours, 1).T
        # 1e-10: round-off of two algorithms, entries up to a few hundred.
        assert np.abs(inertia - ours).max() < 1e-10 * np.abs(ours).max()
        ours = pin.nonLinearEffects(chain.model, data, q, v)
        assert np.abs(bias - ours).max() < 1e-10 * np.abs(ours).max()


def test_motor_efforts(engine: Engine, closed_states, project) -> None:
    """Drake's tree, projected on the motors: it knows no loops here, so their Jacobian is ours."""
    chain = engine.chain
    for state in closed_states(chain, 5):
        ours = stp.inverse_dynamics(chain, state.q, state.v, state.a)
        needed = engine.tree_efforts(state.q, state.v, ours.a)
        theirs = project(needed, stp.loop_jacobian(chain, state.q), chain.motor_index)
        # Law 9.
        assert np.abs(theirs - ours.tau_motor).max() <= 1e-9 * np.abs(ours.tau_motor).max()


def test_motor_efforts_under_wrenches(
    engine: Engine, closed_states, project, rng: np.random.Generator
) -> None:
    """Forces on every body of Drake's, links without mass among them, at its origin."""
    chain = engine.chain
    unit = 9.81 * sum(body.mass for body in chain.model.inertias) * np.repeat([1.0, chain.length_scale], 3)
    for state in closed_states(chain, 3):
        wrenches = {link.name: unit * rng.normal(size=6) for link in chain.mechanism.links}
        ours = stp.inverse_dynamics(chain, state.q, state.v, state.a, wrenches=wrenches)
        needed = engine.tree_efforts(state.q, state.v, ours.a) - engine.outside(state.q, wrenches)
        theirs = project(needed, stp.loop_jacobian(chain, state.q), chain.motor_index)
        # Law 9.
        assert np.abs(theirs - ours.tau_motor).max() <= 1e-9 * np.abs(ours.tau_motor).max()
