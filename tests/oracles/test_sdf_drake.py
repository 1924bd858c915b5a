"""Drake's parser of SDFormat and ours: the same links at the same places, the same masses, the same motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from lxml import etree

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import Joint, JointKind, Link, Mechanism
from stewart_pin.model.formats.sdf import read_sdf
from stewart_pin.model.tree import build_tree, link_frame
from stewart_pin.model.validation import validate
from tests.building import cassie
from tests.mechanisms import body, turned
from tests.small_sdf import TREES, write
from tests.zoo.table import zoo_chain

pytest.importorskip("pydrake", reason="needs Drake: pip install 'stewart_pin[oracles]'")

from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    BallRpyJoint,
    JacobianWrtVariable,
    PlanarJoint,
    ScrewJoint,
    UniversalJoint,
)

_EXACT = 1e-10
"""Round-off of two chains of placements, and of two algorithms for the mass matrix."""


class Both:
    """One file, read by both."""

    def __init__(self, path: Path) -> None:
        self.mechanism: Mechanism = read_sdf(path)
        validate(self.mechanism)
        self.model = build_tree(self.mechanism, (0.0, 0.0, -9.81))
        self.data = pin.Data(self.model)
        self.plant = MultibodyPlant(0.0)
        parser = Parser(self.plant)
        parser.AddModels(str(path))
        self.plant.Finalize()
        self.context = self.plant.CreateDefaultContext()
        self.q = pin.neutral(self.model)
        for name, value in self.mechanism.home.items():
            self.set(name, value)

    def set(self, name: str, value: np.ndarray | float) -> None:
        joint = self.model.joints[self.model.getJointId(name)]
        self.q[joint.idx_q : joint.idx_q + joint.nq] = value

    def body(self, link: str):
        """Find Drake's body of a link; a nested model is a model instance there."""
        *scopes, name = link.split("::")
        instance = "::".join([self.mechanism.name, *scopes])
        return self.plant.GetBodyByName(name, self.plant.GetModelInstanceByName(instance))

    def move(self, rng: np.random.Generator) -> None:
        """Set all joints of both to the same random values."""
        plant, context = self.plant, self.context
        for link in self.bodies():
            free = self.body(link)
            if free.is_floating_base_body():
                pose = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
                x = RigidTransform(RotationMatrix(pose.rotation), pose.translation)
                plant.SetFreeBodyPose(context, free, x)
                self.set(f"{link}_floating", pin.SE3ToXYZQUAT(pose))
        for index in plant.GetJointIndices():
            theirs, x = plant.get_joint(index), rng.uniform(-1, 1, 3)
            if theirs.num_positions() in (0, 7):
                continue
            values = plant.GetPositions(context)
            first = theirs.position_start()
            values[first : first + theirs.num_positions()] = x[: theirs.num_positions()]
            plant.SetPositions(context, values)
            self.follow(self.name(theirs), theirs, x)

    def name(self, theirs) -> str:
        """Find our name of a joint: Drake puts it into the model of its child."""
        scopes = self.plant.GetModelInstanceName(theirs.model_instance()).split("::")[1:]
        full = "::".join([*scopes, theirs.name()])
        known = {joint.name.removesuffix("_1").removesuffix("_x") for joint in self.mechanism.joints}
        return full if full in known else theirs.name()

    def follow(self, name: str, theirs, x: np.ndarray) -> None:
        """Set our joint to Drake's values."""
        match theirs:
            case UniversalJoint():
                self.set(f"{name}_1", x[0])
                self.set(f"{name}_2", x[1])
            case BallRpyJoint():
                self.set(name, pin.Quaternion(RollPitchYaw(x).ToRotationMatrix().matrix()).coeffs())
            case ScrewJoint():
                thread = next(c for c in self.mechanism.couplings if c.joint2 == name)
                self.set(name, x[0])
                self.set(str(thread.joint1), thread.polynomial[1] * x[0])
            case PlanarJoint():
                for part, value in zip(("x", "y", "turn"), x, strict=True):
                    self.set(f"{name}_{part}", value)
            case _:
                self.set(name, x[0])

    def bodies(self) -> list[str]:
        return [link.name for link in self.mechanism.links if link.inertia is not None]

    def compare(self) -> None:
        """Links stand at the same places, and the same motion of all links has the same kinetic energy."""
        pin.framesForwardKinematics(self.model, self.data, self.q)
        for link in self.bodies():
            ours = self.data.oMf[link_frame(self.model, link)].homogeneous
            theirs = self.plant.EvalBodyPoseInWorld(self.context, self.body(link)).GetAsMatrix4()
            assert np.abs(ours - theirs).max() < _EXACT, link

    def jacobians(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocities of all links per coordinate velocity, both ways: (6 n, nv) in world axes, [v; ω]."""
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        ours, theirs = [], []
        for link in self.bodies():
            frame = link_frame(self.model, link)
            ours.append(pin.computeFrameJacobian(self.model, self.data, self.q, frame, axes).reshape(6, -1))
            body = self.body(link).body_frame()
            world = self.plant.world_frame()
            jacobian = self.plant.CalcJacobianSpatialVelocity(
                self.context, JacobianWrtVariable.kV, body, np.zeros(3), world, world
            )
            theirs.append(np.vstack([jacobian[3:], jacobian[:3]]))
        return np.vstack(ours), np.vstack(theirs)


@pytest.mark.parametrize("name", TREES)
def test_drake_reads_the_same_tree(name: str, tmp_path: Path, rng: np.random.Generator) -> None:
    _compare(Both(write(tmp_path, TREES[name])), rng)


def _compare(both: Both, rng: np.random.Generator) -> None:
    both.compare()
    for _ in range(3):
        both.move(rng)
        both.compare()
        # v_drake = T v_ours on the motions that threads allow: by the velocities of the links.
        free = np.eye(both.model.nv)
        for coupling in both.mechanism.couplings:
            follower, leader = (
                both.model.joints[both.model.getJointId(str(joint))].idx_v
                for joint in (coupling.joint1, coupling.joint2)
            )
            free[follower, leader] = coupling.polynomial[1]
            free = np.delete(free, follower, axis=1)
        ours, theirs = both.jacobians()
        turn = np.linalg.lstsq(theirs, ours @ free, rcond=None)[0]
        assert np.abs(theirs @ turn - ours @ free).max() < _EXACT
        mass = pin.crba(both.model, both.data, both.q)
        mass = free.T @ (np.triu(mass) + np.triu(mass, 1).T) @ free
        drakes = turn.T @ both.plant.CalcMassMatrix(both.context) @ turn
        assert np.abs(mass - drakes).max() < _EXACT * max(1.0, np.abs(mass).max())


@pytest.mark.parametrize("name", cassie.FILES)
def test_drake_reads_the_same_cassie(name: str, tmp_path: Path, rng: np.random.Generator) -> None:
    """Without the joints that close loops, which Drake does not read, and without gearboxes, which it ignores."""
    if cassie.folder() is None:
        pytest.skip("needs the package example-robot-data")
    path = write(tmp_path, cassie.text(name))
    cut = {part.name for part in (*read_sdf(path).loops, *read_sdf(path).couplings)}
    assert len(cut) in (4, 16)
    root = etree.fromstring(cassie.text(name).encode())
    for joint in root.findall("model/joint"):
        if joint.get("name") in cut:
            joint.getparent().remove(joint)
    for visual in [*root.iter("visual"), *root.iter("collision"), *root.iter("plugin")]:
        visual.getparent().remove(visual)
    _compare(Both(write(tmp_path, etree.tostring(root, encoding="unicode"))), rng)


def test_the_catalogue_has_every_kind(tmp_path: Path) -> None:
    """Every kind of joint that may stand in a tree is compared."""
    kinds = {joint.kind for text in TREES.values() for joint in read_sdf(write(tmp_path, text)).joints}
    assert kinds == {
        JointKind.FIXED,
        JointKind.REVOLUTE,
        JointKind.PRISMATIC,
        JointKind.SPHERICAL,
        JointKind.FLOATING,
    }


# ----------------------------------------------------------------------------------------------------
# Files that we write, where they have no loops: Drake refuses those
# ----------------------------------------------------------------------------------------------------


def _written(name: str) -> stp.ClosedChain:
    if name == "universal and ball":
        rng = np.random.default_rng(3)
        links = (
            Link("ground"),
            Link("first", body(rng)),
            Link("cross"),
            Link("arm", body(rng)),
            Link("tool"),
        )
        joints = (
            Joint("ball", JointKind.SPHERICAL, "ground", "first", turned(rng)),
            Joint("u1", JointKind.REVOLUTE, "first", "cross", turned(rng), np.eye(3)[0]),
            Joint("u2", JointKind.REVOLUTE, "cross", "arm", pin.SE3.Identity(), np.eye(3)[1]),
            Joint("tool_place", JointKind.FIXED, "arm", "tool", turned(rng)),
        )
        home = {"u1": np.array([0.3]), "u2": np.array([-0.4])}
        return build_chain(Mechanism("bent", links, joints, home=home, platform="tool"))
    if name == "coupled":
        return zoo_chain("planetary_gear")
    return stp.load(name)


@pytest.mark.parametrize("name", ["arm_7r", "universal and ball", "coupled"])
def test_drake_opens_what_we_write(name: str, tmp_path: Path, rng: np.random.Generator) -> None:
    chain = _written(name)
    stp.export(chain, tmp_path / "a.sdf", format="sdf")
    both = Both(tmp_path / "a.sdf")
    # Drake's zeros are where the file has its links; ours read what they read in the chain.
    both.compare()
    assert len(both.bodies()) >= 2
    for link in both.bodies():
        ours = both.mechanism.link(link).inertia
        theirs = both.body(link).CalcSpatialInertiaInBodyFrame(both.context)
        assert theirs.get_mass() == ours.mass
        np.testing.assert_allclose(theirs.CopyToFullMatrix6()[:3, :3], ours.matrix()[3:, 3:], atol=1e-14)
    driven = [both.plant.get_joint_actuator(i).joint().name() for i in both.plant.GetJointActuatorIndices()]
    assert driven == list(chain.motors)
