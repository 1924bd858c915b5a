"""Law 9: Drake reads the bundled URDF as its tree, with the same masses, and needs the same motor efforts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.resources import find_robot
from stewart_pin.model.description import JointKind

pytest.importorskip("pydrake", reason="needs Drake: pip install 'stewart_pin[oracles]'")

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import MultibodyForces


@dataclass(frozen=True, eq=False)
class Engine:
    """A chain's tree as Drake read it, with the change of coordinates, found by the names of the joints."""

    chain: stp.ClosedChain
    plant: MultibodyPlant

    def coordinates(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return q, v, a in Drake's coordinates, and T (nv, nv) with v_drake = T v_pinocchio."""
        chain = self.chain
        turn, drift, theirs_q = np.zeros((chain.nv, chain.nv)), np.zeros(chain.nv), np.zeros(chain.nq)
        at_zero = pin.Data(chain.model)
        pin.forwardKinematics(chain.model, at_zero, pin.neutral(chain.model))
        for number in range(1, chain.model.njoints):
            joint, name = chain.model.joints[number], chain.model.names[number]
            i, value = joint.idx_v, q[joint.idx_q : joint.idx_q + joint.nq]
            if joint.nv == 1:
                theirs = self.plant.GetJointByName(name)
                turn[theirs.velocity_start(), i] = 1.0
                theirs_q[theirs.position_start()] = value[0]
                continue
            # Drake leaves the child of a floating joint as a free body: quaternion w x y z, then position;
            # angular velocity, then velocity, both in the world. Ours are in the body, the velocity first.
            child = chain.mechanism.joint(name).child
            free = self.plant.GetBodyByName(child)
            pose = at_zero.oMi[number] * pin.XYZQUATToSE3(value)
            x, y, z, w = pin.Quaternion(pose.rotation).coeffs()
            start = free.floating_positions_start()
            theirs_q[start : start + 7] = [w, x, y, z, *pose.translation]
            k = free.floating_velocities_start_in_v()
            turn[k : k + 3, i + 3 : i + 6] = pose.rotation
            turn[k + 3 : k + 6, i : i + 3] = pose.rotation
            drift[k + 3 : k + 6] = pose.rotation @ np.cross(v[i + 3 : i + 6], v[i : i + 3])
        return theirs_q, turn @ v, turn @ a + drift, turn

    def tree_efforts(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return what the tree demands of every coordinate, by Drake's inverse dynamics, in our coordinates."""
        context = self.plant.CreateDefaultContext()
        theirs_q, theirs_v, theirs_a, turn = self.coordinates(q, v, a)
        self.plant.SetPositions(context, theirs_q)
        self.plant.SetVelocities(context, theirs_v)
        forces = MultibodyForces(self.plant)
        self.plant.CalcForceElementsContribution(context, forces)
        return turn.T @ self.plant.CalcInverseDynamics(context, theirs_a, forces)

    def inertia_and_bias(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return mass matrix and bias, gravity included, in our coordinates."""
        context = self.plant.CreateDefaultContext()
        theirs_q, theirs_v, drift, turn = self.coordinates(q, v, np.zeros(self.chain.nv))
        self.plant.SetPositions(context, theirs_q)
        self.plant.SetVelocities(context, theirs_v)
        inertia = self.plant.CalcMassMatrix(context)
        bias = self.plant.CalcBiasTerm(context) - self.plant.CalcGravityGeneralizedForces(context)
        # Zero acceleration in our coordinates is not zero in theirs: a free body's v is in the world there.
        return turn.T @ inertia @ turn, turn.T @ (bias + inertia @ drift)


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
