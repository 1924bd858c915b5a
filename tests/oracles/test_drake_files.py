"""Drake opens the files written for it as the same mechanism, loops and gears included; its joints are read alike."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import JointKind
from stewart_pin.model.formats.reading import read_urdf
from tests.mechanisms import four_bar, two_bodies
from tests.small_urdf import ARM, AXIS_Z, joint, link, robot, write
from tests.zoo.table import ROBOTS

pytest.importorskip("pydrake", reason="needs Drake: pip install 'stewart_pin[oracles]'")

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant
from pydrake.systems.analysis import Simulator

from tests.oracles.drake_engine import Engine

# Round-off of two algorithms, relative to the largest entry.
TOLERANCE = 1e-10
DOWN = (1.3, -2.1, -9.81)


def opened(path: Path, gravity: np.ndarray, step: float = 1e-3) -> MultibodyPlant:
    """Let Drake read a file; constraints need its discrete solver."""
    plant = MultibodyPlant(step)
    plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
    Parser(plant).AddModels(str(path))
    plant.mutable_gravity_field().set_gravity_vector(gravity)
    plant.Finalize()
    return plant


CHAINS = {
    **{
        name: lambda _, name=name: stp.load(name, gravity=DOWN)
        for name in ROBOTS
        if all(loop.kind is JointKind.SPHERICAL for loop in stp.load(name).loops)
    },
    "two bodies": lambda rng: build_chain(two_bodies(JointKind.SPHERICAL, rng).described(), gravity=DOWN),
    **{
        name: lambda _, name=name: stp.build.loops_by_balls(stp.load(name, gravity=DOWN))
        for name in ("five_bar", "rpr_planar")
    },
    "redundant": lambda _: build_chain(four_bar().described(), gravity=DOWN),
}


@pytest.mark.parametrize("make", CHAINS.values(), ids=CHAINS)
def test_the_file_is_the_same_mechanism(make, tmp_path: Path, rng: np.random.Generator) -> None:
    chain = make(rng)
    stp.export(chain, tmp_path / "a.urdf", format="drake")
    plant = opened(tmp_path / "a.urdf", chain.gravity)
    assert plant.num_velocities() == chain.nv
    assert plant.num_actuators() == chain.nu
    assert plant.num_constraints() == len(chain.loops)
    engine, data = Engine(chain, plant), chain.model.createData()
    for _ in range(3):
        q = pin.integrate(chain.model, chain.q_home, rng.uniform(-0.5, 0.5, chain.nv))
        v = rng.uniform(-1, 1, chain.nv)
        inertia, bias = engine.inertia_and_bias(q, v)
        ours = pin.crba(chain.model, data, q)
        ours = np.triu(ours) + np.triu(ours, 1).T
        assert np.abs(inertia - ours).max() < TOLERANCE * np.abs(ours).max()
        ours = pin.nonLinearEffects(chain.model, data, q, v)
        assert np.abs(bias - ours).max() < TOLERANCE * np.abs(ours).max()
        _, gravity = engine.inertia_and_bias(q, 0 * v)
        ours = pin.computeGeneralizedGravity(chain.model, data, q)
        assert np.abs(gravity - ours).max() < TOLERANCE * np.abs(ours).max()


@pytest.mark.parametrize("name", ["stewart", "four_bar", "delta", "five_bar", "rpr_planar"])
def test_the_loops_hold_the_same_points(name: str, tmp_path: Path, closed_states) -> None:
    """Let go, Drake's robot falls as ours does: its loops are closed at the right points, by stiff constraints."""
    chain = stp.build.loops_by_balls(stp.load(name, gravity=DOWN))
    stp.export(chain, tmp_path / "a.urdf", format="drake")
    step = 1e-4
    plant = opened(tmp_path / "a.urdf", chain.gravity, step)
    engine = Engine(chain, plant)
    (state,) = closed_states(chain, 1)
    context = plant.CreateDefaultContext()
    theirs_q, theirs_v, _, _ = engine.coordinates(state.q, state.v, state.v)
    plant.SetPositions(context, theirs_q)
    plant.SetVelocities(context, theirs_v)
    port = plant.get_actuation_input_port(plant.GetModelInstanceByName(chain.name))
    port.FixValue(context, np.zeros(chain.nu))
    simulator = Simulator(plant, context)
    simulator.AdvanceTo(step)
    ours = stp.forward_dynamics(chain, state.q, state.v, np.zeros(chain.nu)).a
    drift = engine.coordinates(state.q, state.v, ours)[2]
    v_next = plant.GetVelocities(context)
    # Drake's constraints are slightly soft, whatever the step: up to 0.3 m/s² of what falls at 10 m/s².
    scale = max(np.abs(drift).max(), np.linalg.norm(DOWN))
    assert np.abs((v_next - theirs_v) / step - drift).max() < 0.05 * scale


GEARED = robot(
    *ARM,
    link("wheel"),
    joint("turn", "arm", "wheel", content='<mimic joint="elbow" multiplier="-2.5" offset="0.3"/>'),
)


def test_gears_are_constraints_of_drake(tmp_path: Path) -> None:
    chain = stp.load(write(tmp_path, GEARED))
    stp.export(chain, tmp_path / "a.urdf", format="drake")
    plant = opened(tmp_path / "a.urdf", chain.gravity)
    assert plant.num_constraints() == 1 == len(chain.couplings)


NAMESPACE = 'xmlns:drake="http://drake.mit.edu"'
JOINTS = {
    "universal": ("", ["j_1", "j_2"]),
    "planar": (AXIS_Z, ["j_x", "j_y", "j_turn"]),
    "ball": ("", ["j"]),
    "screw": ('<axis xyz="0 0.6 0.8"/><drake:screw_thread_pitch value="0.7"/>', ["j"]),
}


@pytest.mark.parametrize(("kind", "content", "names"), [(k, *v) for k, v in JOINTS.items()], ids=JOINTS)
def test_joints_of_drake_move_as_drake_moves_them(
    kind: str, content: str, names: list[str], tmp_path: Path, rng: np.random.Generator
) -> None:
    text = robot(
        link("world", ""),
        link("platform"),
        f'<drake:joint name="j" type="{kind}"><parent link="world"/><child link="platform"/>'
        f'<origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/>{content}</drake:joint>',
        attributes=NAMESPACE,
    )
    path = write(tmp_path, text)
    plant = opened(path, np.zeros(3))
    context = plant.CreateDefaultContext()
    chain = build_chain(read_urdf(path), motors=[n for n in names if kind != "ball"])
    for _ in range(3):
        theirs = rng.uniform(-1, 1, plant.num_positions())
        plant.SetPositions(context, theirs)
        q = pin.neutral(chain.model)
        if kind == "ball":
            q[:] = pin.Quaternion(pin.rpy.rpyToMatrix(*theirs)).coeffs()
        elif kind == "screw":
            thread = chain.couplings[0]
            q[chain.model.joints[chain.model.getJointId("j")].idx_q] = theirs[0]
            slide = thread.polynomial[0] + thread.polynomial[1] * theirs[0]
            q[chain.model.joints[chain.model.getJointId("j_slide")].idx_q] = slide
        else:
            for name, value in zip(names, theirs, strict=True):
                q[chain.model.joints[chain.model.getJointId(name)].idx_q] = value
        pose = plant.GetBodyByName("platform").EvalPoseInWorld(context).GetAsMatrix4()
        np.testing.assert_allclose(stp.platform_pose(chain, q).homogeneous, pose, atol=1e-14)
