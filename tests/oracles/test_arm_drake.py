"""The arms against Drake: accelerations of the same bodies and joints (S2.3)."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp

pytest.importorskip("pydrake")


def drake_plant(chain: stp.ClosedChain):
    """Build the arm from the chain's numbers, link by link."""
    from pydrake.math import RigidTransform, RotationMatrix
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, RotationalInertia, SpatialInertia

    plant = MultibodyPlant(0.0)
    frames = {chain.mechanism.root: plant.world_frame()}
    for joint in chain.mechanism.joints:
        place = RigidTransform(RotationMatrix(joint.placement.rotation), joint.placement.translation)
        foot = plant.AddFrame(FixedOffsetFrame(f"{joint.name}_foot", frames[joint.parent], place))
        inertia = chain.mechanism.link(joint.child).inertia
        if inertia is None:  # the tool: a frame of its parent
            frames[joint.child] = foot
            continue
        m = inertia.inertia
        about_com = RotationalInertia(m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2])
        body = SpatialInertia.MakeFromCentralInertia(inertia.mass, inertia.lever, about_com)
        frames[joint.child] = plant.AddRigidBody(joint.child, body).body_frame()
        plant.AddJoint(RevoluteJoint(joint.name, foot, frames[joint.child], joint.axis))
    plant.mutable_gravity_field().set_gravity_vector(chain.gravity)
    plant.Finalize()
    return plant


@pytest.mark.parametrize("name", ["arm_7r", "arm_3r_planar", "arm_3r_spatial"])
def test_accelerations_equal_drakes(name: str, rng: np.random.Generator) -> None:
    chain = stp.load(name, gravity=(1.0, -9.81, 3.0))
    plant = drake_plant(chain)
    context = plant.CreateDefaultContext()
    rates = plant.AllocateTimeDerivatives()
    for _ in range(10):
        q, v, tau = rng.normal(0, [[2], [2], [20]], (3, chain.nv))
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        plant.get_applied_generalized_force_input_port().FixValue(context, tau)
        plant.CalcTimeDerivatives(context, rates)
        theirs = rates.CopyToVector()[chain.nv :]
        ours = stp.articulated_body_acceleration(chain, q, v, tau)
        # Two factorisations in doubles; the condition number of M is below 1e3.
        assert np.abs(ours - theirs).max() <= 1e-11 * np.abs(theirs).max()
