"""Drake reads rotors, damping and springs of joints from URDF and SDFormat as we do, and as we write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import JointKind
from stewart_pin.model.formats.reading import read_mechanism
from tests.mechanisms import arm
from tests.small_sdf import axis2, sdf
from tests.small_sdf import joint as sdf_joint
from tests.small_sdf import link as sdf_link
from tests.small_urdf import AXIS_Z, joint, link, robot

pytest.importorskip("pydrake", reason="needs Drake: pip install 'stewart_pin[oracles]'")

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant
from pydrake.multibody.tree import MultibodyForces

TOLERANCE = 1e-12
"""Round-off of two algorithms, relative to the largest entry."""

ROTOR = '<drake:rotor_inertia value="0.013"/><drake:gear_ratio value="-7"/>'
ENDS = '<parent link="world"/><child link="{}"/>'
URDF = robot(
    link("world", ""),
    *(link(name) for name in "abcdefg"),
    joint("turn", "world", "a", "continuous", axis=AXIS_Z, content='<dynamics damping="0.7"/>'),
    joint("slide", "a", "b", "prismatic", axis=AXIS_Z,
          content='<dynamics damping="0.4"/><limit lower="-9" upper="9" effort="5" velocity="1"/>'),
    *(
        f'<transmission name="t_{name}"><type>transmission_interface/SimpleTransmission</type><joint name="{name}"/>'
        f'<actuator name="m_{name}">{ROTOR}</actuator></transmission>' for name in ("turn", "slide", "screw")
    ),
    *(
        f'<drake:joint name="{kind}" type="{kind}">{ENDS.format(child)}{content}<dynamics damping="{damping}"/>'
        "</drake:joint>"
        for kind, child, content, damping in (
            ("ball", "c", "", "0.3"), ("universal", "d", "", "0.6"), ("planar", "e", AXIS_Z, "0.1 0.2 0.5"),
            ("screw", "f", f'{AXIS_Z}<drake:screw_thread_pitch value="0.2"/>', "0.9"),
        )
    ),
    joint("last", "world", "g", "continuous", axis=AXIS_Z),
    attributes='xmlns:drake="http://drake.mit.edu"',
)  # fmt: skip


def dynamics(damping: float, spring: str = "") -> str:
    return f"<dynamics><damping>{damping}</damping>{spring}</dynamics>"


SPRING = "<spring_stiffness>9</spring_stiffness><spring_reference>0.3</spring_reference>"
SDF_ROTOR = "<drake:rotor_inertia>0.013</drake:rotor_inertia><drake:gear_ratio>-7</drake:gear_ratio>"
SDF = sdf(
    *(sdf_link(name) for name in "abcdefg"),
    sdf_joint("turn", "world", "a", axis=dynamics(0.7, SPRING), content=SDF_ROTOR),
    sdf_joint("slide", "a", "b", "prismatic", xyz="0 0.6 0.8", axis=dynamics(0.4, SPRING), content=SDF_ROTOR),
    sdf_joint("ball", "world", "c", "ball", axis=dynamics(0.3)),
    sdf_joint("universal", "world", "d", "universal", xyz="1 0 0", axis=dynamics(0.6),
              content=axis2("0 1 0", dynamics(0.6))),
    sdf_joint("screw", "world", "f", "screw", axis=dynamics(0.9),
              content="<screw_thread_pitch>0.2</screw_thread_pitch>" + SDF_ROTOR),
    sdf_joint("still", "world", "g", axis="<limit><effort>0</effort></limit>" + dynamics(0.2), content=SDF_ROTOR),
    '<drake:joint name="planar" type="planar"><drake:parent>a</drake:parent><drake:child>e</drake:child>'
    "<drake:damping>0.1 0.2 0.5</drake:damping></drake:joint>",
).replace("<sdf ", '<sdf xmlns:drake="drake.mit.edu" ')  # fmt: skip


def opened(path: Path, step: float = 0.0) -> MultibodyPlant:
    plant = MultibodyPlant(step)
    if step:  # constraints need its discrete solver
        plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
    Parser(plant).AddModels(str(path))
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    plant.Finalize()
    return plant


class Both:
    """A file as both read it; entries of the same joints in both orders."""

    def __init__(self, path: Path, step: float = 0.0) -> None:
        mechanism = read_mechanism(path)
        (first, *_) = (j.name for j in mechanism.joints if j.has_axis)
        self.chain = build_chain(mechanism, motors=[first])
        self.plant = opened(path, step)

    def parts(self, name: str, kind: str) -> list[str]:
        row = {"universal": ("_1", "_2"), "planar": ("_x", "_y", "_turn")}.get(kind, ("",))
        return [f"{name}{part}" for part in row]

    def compare(self, rng: np.random.Generator) -> set[str]:
        """Set one state in both, and compare masses of single joints and what all joints give."""
        chain, model, plant = self.chain, self.chain.model, self.plant
        q, v = pin.neutral(model), rng.uniform(-1, 1, model.nv)
        context = plant.CreateDefaultContext()
        entries: list[tuple[int, int]] = []
        balls: list[tuple[slice, slice, np.ndarray]] = []
        seen = {plant.get_joint(i).name() for i in plant.GetJointIndices()} - {chain.mechanism.root}
        for name in sorted(seen):
            theirs = plant.GetJointByName(name)
            if not theirs.num_velocities() or not (
                model.existJointName(name)
                or model.existJointName(f"{name}_1")
                or model.existJointName(f"{name}_x")
            ):
                continue
            position, velocity = np.zeros(theirs.num_positions()), np.zeros(theirs.num_velocities())
            if theirs.num_velocities() == 3 and model.existJointName(name):
                ours = model.joints[model.getJointId(name)]
                angles = rng.uniform(-1, 1, 3)
                turned = pin.rpy.rpyToMatrix(*angles)
                q[ours.idx_q : ours.idx_q + 4] = pin.Quaternion(turned).coeffs()
                # Drake's angular velocity is in the parent's frame, ours in the child's.
                position, velocity = angles, turned @ v[ours.idx_v : ours.idx_v + 3]
                start = theirs.velocity_start()
                balls.append((slice(ours.idx_v, ours.idx_v + 3), slice(start, start + 3), turned))
            else:
                for k, part in enumerate(
                    self.parts(name, type(theirs).__name__.removesuffix("Joint").lower())
                ):
                    ours = model.joints[model.getJointId(part)]
                    q[ours.idx_q] = position[k] = rng.uniform(-1, 1)
                    velocity[k] = v[ours.idx_v]
                    entries.append((ours.idx_v, theirs.velocity_start() + k))
            start, at = theirs.position_start(), theirs.velocity_start()
            plant.SetPositions(context, _put(plant.GetPositions(context), start, position))
            plant.SetVelocities(context, _put(plant.GetVelocities(context), at, velocity))
        forces = MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, forces)
        given, drakes = chain.at(q, v).effects, forces.generalized_forces()
        assert given is not None
        ours_all = given.efforts()
        size = np.abs(drakes).max()
        one, two = (list(each) for each in zip(*entries, strict=True))
        assert np.abs(ours_all[one] - drakes[two]).max() <= TOLERANCE * size
        for mine, their, turned in balls:
            assert np.abs(turned @ ours_all[mine] - drakes[their]).max() <= TOLERANCE * size
        self.rotors(one, two)
        return {type(plant.GetJointByName(name)).__name__ for name in seen}

    def rotors(self, one: list[int], two: list[int]) -> None:
        """Compare what the rotors of Drake's motors add to its mass matrix with our armatures."""
        theirs = np.zeros(self.plant.num_velocities())
        context = self.plant.CreateDefaultContext()
        for index in self.plant.GetJointActuatorIndices():
            motor = self.plant.get_joint_actuator(index)
            theirs[motor.joint().velocity_start()] = motor.calc_reflected_inertia(context)
        np.testing.assert_allclose(np.array(self.chain.model.armature)[one], theirs[two], rtol=TOLERANCE)


def _put(values: np.ndarray, start: int, part: np.ndarray) -> np.ndarray:
    values = values.copy()
    values[start : start + len(part)] = part
    return values


@pytest.mark.parametrize(("suffix", "text"), [("urdf", URDF), ("sdf", SDF)])
def test_hand_written_files(suffix: str, text: str, tmp_path: Path, rng: np.random.Generator) -> None:
    path = tmp_path / f"a.{suffix}"
    path.write_text(text, encoding="utf-8")
    both = Both(path)
    for _ in range(3):
        kinds = both.compare(rng)
    assert {
        f"{each}Joint" for each in ("Revolute", "Prismatic", "BallRpy", "Universal", "Planar", "Screw")
    } <= kinds
    assert np.count_nonzero(both.chain.model.armature) == 3 and both.chain.model.damping.any()


@pytest.mark.parametrize("format", ["drake", "sdf"])
def test_an_arm_that_we_write(format: str, tmp_path: Path, rng: np.random.Generator) -> None:
    """SDFormat has springs, of which a preload shifts the rest; Drake's URDF has none."""
    chain, spring = arm(rng, 4), ("stiffness", "rest", "force") if format == "sdf" else ()
    keys = ("armature", "damping", *spring)
    physics = {name: dict(zip(keys, rng.uniform(0.1, 2, 5), strict=False)) for name in chain.motors}
    chain = stp.with_joint_physics(chain, physics)
    path = tmp_path / ("a.sdf" if format == "sdf" else "a.urdf")
    stp.export(chain, path, format=format)
    both = Both(path)
    np.testing.assert_allclose(both.chain.model.armature, chain.model.armature, rtol=1e-15)
    assert np.count_nonzero(both.chain.model.armature) == len(chain.motors) > 1
    both.compare(rng)


@pytest.mark.parametrize("name", ["stewart", "delta"])
def test_closed_robots_that_we_write_for_drake(name: str, tmp_path: Path, rng: np.random.Generator) -> None:
    bare = stp.load(name)
    told = {
        each.name: {
            "damping": rng.uniform(0.1, 2),
            **({"armature": rng.uniform(0.1, 1)} if each.name in bare.motors else {}),
        }
        for each in bare.mechanism.joints
        if each.kind not in (JointKind.FIXED, JointKind.FLOATING)
    }
    stp.export(stp.with_joint_physics(bare, told), tmp_path / "a.urdf", format="drake")
    both = Both(tmp_path / "a.urdf", step=1e-3)
    # The platform floats, alone without damping.
    assert np.count_nonzero(both.chain.model.damping) == bare.nv - 6
    both.compare(rng)
