"""A chain's tree as Drake read it, in the package's coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.model.description import JointKind

pytest.importorskip("pydrake", reason="needs Drake: pip install 'stewart_pin[oracles]'")

from pydrake.multibody.math import SpatialForce
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
        turn, drift, theirs_q = (
            np.zeros((chain.nv, chain.nv)),
            np.zeros(chain.nv),
            np.zeros(self.plant.num_positions()),
        )
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
            if chain.mechanism.joint(name).kind is JointKind.SPHERICAL:
                # Drake's angles are roll, pitch, yaw; its angular velocity is in the parent's joint frame.
                theirs, turned = (
                    self.plant.GetJointByName(name),
                    pin.Quaternion(*value[[3, 0, 1, 2]]).matrix(),
                )
                theirs_q[theirs.position_start() : theirs.position_start() + 3] = pin.rpy.matrixToRpy(turned)
                k = theirs.velocity_start()
                turn[k : k + 3, i : i + 3] = turned
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

    def outside(self, q: np.ndarray, wrenches: dict[str, np.ndarray]) -> np.ndarray:
        """Return what wrenches at the origins of bodies do to every coordinate, by Drake, in our coordinates."""
        context, rest = self.plant.CreateDefaultContext(), np.zeros(self.chain.nv)
        theirs_q, _, _, turn = self.coordinates(q, rest, rest)
        self.plant.SetPositions(context, theirs_q)
        forces = MultibodyForces(self.plant)
        for name, wrench in wrenches.items():
            force = SpatialForce(tau=wrench[3:], f=wrench[:3])
            frame = self.plant.GetBodyByName(name)
            frame.AddInForceInWorld(context, force, forces)
        needed = self.plant.CalcInverseDynamics(context, np.zeros(self.plant.num_velocities()), forces)
        weight = self.plant.CalcInverseDynamics(
            context, np.zeros(self.plant.num_velocities()), MultibodyForces(self.plant)
        )
        return turn.T @ (weight - needed)

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
