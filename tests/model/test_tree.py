"""The tree of a file is the one that other readers of the same file see."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.model.formats.reading import read_urdf
from stewart_pin.model.tree import build_tree, link_frame
from stewart_pin.model.validation import validate
from tests.small_urdf import ARM, MOTOR, bundled, joint, link, loop, robot, write

ROD = (
    '<inertial><origin xyz="0.1 -0.2 0.3" rpy="0.3 -0.4 0.5"/><mass value="2"/>'
    '<inertia ixx="0.3" ixy="0.01" ixz="-0.02" iyy="0.4" iyz="0.03" izz="0.5"/></inertial>'
)
LIMIT = '<limit lower="-1" upper="2" effort="3" velocity="4"/>'
# Names out of alphabetical order, fixed joints at the root, within a chain and at a leaf, axes of every sign.
SYNTHETIC = robot(
    link("ground", ROD),
    link("plate"),
    link("zeta", ROD),
    link("alpha", ROD),
    link("free", ROD),
    link("tool", ROD),
    link("slider", ROD),
    link("platform", ROD),
    joint("mount", "ground", "plate", "fixed", origin='xyz="1 2 3" rpy="0.1 0.2 0.3"', axis=""),
    joint(
        "turn", "plate", "zeta", origin='xyz="0 1 0" rpy="1 0 0"', axis='<axis xyz="0 -1 0"/>', content=LIMIT
    ),
    joint("bow", "plate", "alpha", origin='rpy="0 1.2 0"', axis='<axis xyz="1 2 -3"/>', content=LIMIT),
    joint("glue", "zeta", "tool", "fixed", origin='xyz="0 0 1" rpy="0 0.7 0"', axis=""),
    joint("Rail", "tool", "slider", "prismatic", axis='<axis xyz="1 1 0"/>', content=LIMIT),
    joint("ahead", "tool", "platform", "prismatic", axis="", content=LIMIT, attributes=MOTOR),
    joint("fly", "ground", "free", "floating", origin='xyz="0 0 2" rpy="0 0 1"', axis=""),
)


def tree(path: Path) -> pin.Model:
    mechanism = read_urdf(path)
    validate(mechanism)
    return build_tree(mechanism, (0.0, 0.0, -9.81))


def random_configuration(model: pin.Model, rng: np.random.Generator) -> np.ndarray:
    return pin.integrate(model, pin.neutral(model), rng.uniform(-2, 2, model.nv))


def with_continuous_joints(ours: pin.Model, theirs: pin.Model, q: np.ndarray) -> np.ndarray:
    """Turn the angle of a continuous joint into Pinocchio's cosine and sine."""
    parts = []
    for mine, other in zip(ours.joints[1:], theirs.joints[1:], strict=True):
        values = q[mine.idx_q : mine.idx_q + mine.nq]
        same = mine.nq == other.nq
        parts.append(values if same else np.array([np.cos(values[0]), np.sin(values[0])]))
    return np.concatenate(parts)


def assert_same_dynamics(
    ours: pin.Model, theirs: pin.Model, q: np.ndarray, q_theirs: np.ndarray, rng
) -> None:
    v = rng.normal(size=ours.nv)
    data, reference = ours.createData(), theirs.createData()
    for mine, other in (
        (pin.crba(ours, data, q), pin.crba(theirs, reference, q_theirs)),
        (pin.nonLinearEffects(ours, data, q, v), pin.nonLinearEffects(theirs, reference, q_theirs, v)),
    ):
        np.testing.assert_allclose(mine, other, rtol=0, atol=1e-12 * max(1.0, np.abs(other).max()))
    pin.framesForwardKinematics(ours, data, q)
    pin.framesForwardKinematics(theirs, reference, q_theirs)
    links = [frame.name for frame in theirs.frames if frame.type == pin.FrameType.BODY]
    assert links
    for name in links:
        mine = data.oMf[link_frame(ours, name)].homogeneous
        other = reference.oMf[theirs.getFrameId(name, pin.FrameType.BODY)].homogeneous
        np.testing.assert_allclose(mine, other, rtol=0, atol=1e-12 * max(1.0, np.abs(other).max()))


@pytest.mark.parametrize("name", stp.robots())
def test_bundled_trees_are_those_of_pinocchio(name: str, rng: np.random.Generator) -> None:
    ours, theirs = stp.load(name).model, pin.buildModelFromUrdf(str(bundled(name)))
    assert list(ours.names) == list(theirs.names)
    assert ours.nv == theirs.nv
    assert sum(with_continuous_joints(ours, theirs, pin.neutral(ours)).shape) == theirs.nq
    for _ in range(3):
        q = random_configuration(ours, rng)
        assert_same_dynamics(ours, theirs, q, with_continuous_joints(ours, theirs, q), rng)


@pytest.mark.parametrize("name", stp.robots())
def test_yourdfpy_reads_the_same_links_and_joints(name: str) -> None:
    yourdfpy = pytest.importorskip("yourdfpy")
    robot = yourdfpy.URDF.load(str(bundled(name)), build_scene_graph=False, load_meshes=False)
    mechanism = stp.load(name).mechanism
    assert set(robot.link_map) == {link.name for link in mechanism.links}
    kinds = {"continuous": "revolute"}
    assert {(j.name, kinds.get(j.type, j.type), j.parent, j.child) for j in robot.robot.joints} == {
        (j.name, str(j.kind), j.parent, j.child) for j in mechanism.joints
    }


def test_fixed_joints_and_odd_axes(tmp_path: Path, rng: np.random.Generator) -> None:
    path = write(tmp_path, SYNTHETIC)
    ours, theirs = tree(path), pin.buildModelFromUrdf(str(path))
    assert list(ours.names) == list(theirs.names)
    assert (ours.nq, ours.nv) == (theirs.nq, theirs.nv)
    for _ in range(5):
        q = random_configuration(ours, rng)
        assert_same_dynamics(ours, theirs, q, q, rng)
    limited = [ours.getJointId(name) for name in ("turn", "bow", "Rail", "ahead")]
    at = [ours.joints[j].idx_q for j in limited]
    for limit in ("lowerPositionLimit", "upperPositionLimit"):
        np.testing.assert_array_equal(getattr(ours, limit)[at], getattr(theirs, limit)[at])
    at = [ours.joints[j].idx_v for j in limited]
    np.testing.assert_array_equal(ours.upperEffortLimit[at], 3.0)
    np.testing.assert_array_equal(ours.upperVelocityLimit[at], 4.0)


def test_a_continuous_joint_is_a_revolute_one_without_limits(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    text = robot(
        link("base"),
        link("platform", ROD),
        joint("spin", "base", "platform", "continuous", origin='rpy="0.3 0 0"', attributes=MOTOR),
    )
    path = write(tmp_path, text)
    ours, theirs = tree(path), pin.buildModelFromUrdf(str(path))
    assert (ours.nq, theirs.nq) == (1, 2)  # an angle here, cosine and sine there
    assert np.isinf(ours.upperPositionLimit).all()
    for angle in (0.0, 2.0, 7.0):
        q = np.array([angle])
        assert_same_dynamics(ours, theirs, q, with_continuous_joints(ours, theirs, q), rng)


def test_a_ball_is_a_spherical_joint(tmp_path: Path, rng: np.random.Generator) -> None:
    # URDF has no such type, so the reference is built by hand.
    text = robot(
        link("base"),
        link("platform", ROD),
        joint("ball", "base", "platform", "ball", origin='xyz="1 2 3" rpy="0.3 0 0"', axis=""),
    )
    ours = tree(write(tmp_path, text))
    theirs = pin.Model()
    placement = pin.SE3(pin.exp3(np.array([0.3, 0, 0])), np.array([1.0, 2, 3]))
    ball = theirs.addJoint(0, pin.JointModelSpherical(), placement, "ball")
    turned = pin.rpy.rpyToMatrix(0.3, -0.4, 0.5)
    inertia = np.array([[0.3, 0.01, -0.02], [0.01, 0.4, 0.03], [-0.02, 0.03, 0.5]])
    body = pin.Inertia(2.0, np.array([0.1, -0.2, 0.3]), turned @ inertia @ turned.T)
    theirs.appendBodyToJoint(ball, body, pin.SE3.Identity())
    theirs.addBodyFrame("platform", ball, pin.SE3.Identity(), 0)
    for _ in range(3):
        q = random_configuration(ours, rng)
        assert_same_dynamics(ours, theirs, q, q, rng)


def test_a_link_may_share_its_name_with_a_joint(tmp_path: Path) -> None:
    text = robot(
        link("base"),
        link("arm"),
        link("platform"),
        joint("arm", "base", "arm", attributes=MOTOR),
        joint("platform", "arm", "platform", attributes=MOTOR),
        loop("rod", "distance", "arm", "platform", origin1='xyz="1 0 0"', content='<length value="1"/>'),
    )
    chain = stp.load(write(tmp_path, text))
    assert chain.model.frames[chain.platform_id].type == pin.FrameType.BODY


def test_gravity_reaches_the_model(tmp_path: Path) -> None:
    chain = stp.load(write(tmp_path, robot(*ARM)), gravity=(1.0, 2.0, 3.0))
    np.testing.assert_array_equal(chain.gravity, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(chain.model.gravity.vector, [1.0, 2.0, 3.0, 0, 0, 0])
