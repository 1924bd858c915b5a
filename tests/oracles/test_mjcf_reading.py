"""MuJoCo, given the same file, has the same bodies, inertia, bias and constraints as the chain read from it."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.model.description import JointKind
from stewart_pin.model.formats.mjcf.compiling import compile_mjcf
from stewart_pin.model.tree import link_frame
from tests.model.small_mjcf import QPOS, WORKSHOP, write
from tests.oracles.test_mujoco import same_row_space

mujoco = pytest.importorskip("mujoco", reason="needs MuJoCo: pip install 'stewart_pin[mjcf]'")


@dataclass(frozen=True, eq=False)
class Twin:
    """A file, read by us and by MuJoCo."""

    chain: stp.ClosedChain
    model: mujoco.MjModel
    data: mujoco.MjData

    @classmethod
    def of(cls, path: Path, **options) -> Twin:
        chain = stp.load(path, **options)
        model = mujoco.MjModel.from_xml_string(_for_mujoco(path))
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        return cls(chain, model, mujoco.MjData(model))

    def joint(self, number: int) -> tuple[str, pin.JointModel]:
        """Find our joint for MuJoCo's: by name, or as the only unnamed joint of its body."""
        owner = int(self.model.jnt_bodyid[number])
        body = self.model.body(owner).name or f"body_{owner}"
        name = self.model.joint(number).name or f"{body}_joint"
        return name, self.chain.model.joints[self.chain.model.getJointId(name)]

    def set(self, q: np.ndarray, v: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Set MuJoCo's state from ours; return T and T's rate: v_mujoco = T v, a_mujoco = T a + drift."""
        chain, model, data = self.chain, self.model, self.data
        v = np.zeros(chain.nv) if v is None else v
        turn, drift = np.zeros((chain.nv, chain.nv)), np.zeros(chain.nv)
        for number in range(model.njnt):
            name, joint = self.joint(number)
            at, k, i = int(model.jnt_qposadr[number]), int(model.jnt_dofadr[number]), joint.idx_v
            value = q[joint.idx_q : joint.idx_q + joint.nq]
            block = turn[k : k + joint.nv, i : i + joint.nv]
            block[:] = np.eye(joint.nv)
            if joint.nq == 4:
                value = value[[3, 0, 1, 2]]
            if joint.nq == 7:
                pose = chain.mechanism.joint(name).placement * pin.XYZQUATToSE3(value)
                x, y, z, w = pin.Quaternion(pose.rotation).coeffs()
                value = np.array([*pose.translation, w, x, y, z])
                block[:3, :3] = pose.rotation
                drift[k : k + 3] = pose.rotation @ np.cross(v[i + 3 : i + 6], v[i : i + 3])
            data.qpos[at : at + joint.nq] = value
        data.qvel[:] = turn @ v
        mujoco.mj_forward(model, data)
        return turn, drift

    def equalities(self) -> tuple[np.ndarray, np.ndarray]:
        """Return residual and Jacobian of the equality constraints at the state set."""
        rows = self.data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        # What no joint moves is held without rows, for which there is room nevertheless.
        filled = self.data.efc_J[: len(rows) * self.model.nv]
        return self.data.efc_pos[rows], filled.reshape(-1, self.model.nv)[rows]


def _for_mujoco(path: Path) -> str:
    """Cut out what refers to files that are not there, which the reader does by itself."""
    text = path.read_text(encoding="utf-8")
    for absent in (
        '<mesh name="absent" file="nowhere.stl"/>',
        '<geom type="mesh" mesh="absent"/>',
        '<texture name="paint" type="2d" file="nowhere.png"/>',
        ' texture="paint"',
    ):
        text = text.replace(absent, "")
    return text


def random_states(chain: stp.ClosedChain, rng: np.random.Generator, count: int):
    for _ in range(count):
        yield (
            pin.integrate(chain.model, chain.q_home, rng.uniform(-1, 1, chain.nv)),
            rng.uniform(-1, 1, chain.nv),
        )


def require_same_tree(twin: Twin, rng: np.random.Generator) -> None:
    """Compare poses of all named bodies and of sites, mass matrix and bias; 1e-10 relative is round-off."""
    chain, model = twin.chain, twin.chain.model
    data = pin.Data(model)
    for q, v in random_states(chain, rng, 4):
        turn, drift = twin.set(q, v)
        pin.framesForwardKinematics(model, data, q)
        for k in range(1, twin.model.nbody):
            name = twin.model.body(k).name or f"body_{k}"
            frame = data.oMf[link_frame(model, name)]
            np.testing.assert_allclose(frame.translation, twin.data.xpos[k], rtol=0, atol=1e-12)
            np.testing.assert_allclose(frame.rotation.ravel(), twin.data.xmat[k], rtol=0, atol=1e-12)
        full = np.zeros((chain.nv, chain.nv))
        mujoco.mj_fullM(twin.model, twin.data, full)
        inertia = pin.crba(model, data, q)
        inertia = np.triu(inertia) + np.triu(inertia, 1).T
        assert np.abs(turn.T @ full @ turn - inertia).max() < 1e-10 * np.abs(inertia).max()
        ours = pin.nonLinearEffects(model, data, q, v)
        theirs = turn.T @ (full @ drift + twin.data.qfrc_bias)
        assert np.abs(theirs - ours).max() < 1e-10 * np.abs(ours).max()


def workshop(folder: Path, equality: str = "") -> Path:
    return write(folder, WORKSHOP % (equality, QPOS))


def test_tree_of_every_joint(rng: np.random.Generator, tmp_path: Path) -> None:
    twin = Twin.of(workshop(tmp_path))
    assert twin.chain.nv == twin.model.nv == 16
    require_same_tree(twin, rng)


def test_sites_are_frames(rng: np.random.Generator, tmp_path: Path) -> None:
    twin = Twin.of(workshop(tmp_path), platform="tool")
    for q, _ in random_states(twin.chain, rng, 3):
        twin.set(q)
        pose = stp.platform_pose(twin.chain, q)
        np.testing.assert_allclose(pose.translation, twin.data.site("tool").xpos, rtol=0, atol=1e-12)
        np.testing.assert_allclose(pose.rotation.ravel(), twin.data.site("tool").xmat, rtol=0, atol=1e-12)


def test_home_is_the_keyframe(tmp_path: Path) -> None:
    twin = Twin.of(workshop(tmp_path))
    twin.set(twin.chain.q_home)
    ours = twin.data.qpos.copy()
    mujoco.mj_resetDataKeyframe(twin.model, twin.data, 0)
    mujoco.mj_normalizeQuat(twin.model, twin.data.qpos)
    np.testing.assert_allclose(ours, twin.data.qpos, rtol=0, atol=1e-14)


EQUALITIES = {
    "connect of bodies": '<connect name="c" body1="shin" body2="platform" anchor="0.1 0.2 0.3"/>',
    "connect to the world": '<connect name="c" body1="coupler" anchor="0.1 0.2 0.3"/>',
    "connect of sites": '<connect name="c" site1="sole" site2="tool"/>',
    "weld of bodies": '<weld name="c" body1="shin" body2="platform"/>',
    "weld at a pose": (
        '<weld name="c" body1="shin" body2="block" relpose="0.1 0.2 0.3 0.8 0.1 0.2 0.3" anchor="0.05 -0.1 0.2"'
        ' torquescale="0.3"/>'
    ),
    "weld of sites": '<weld name="c" site1="sole" site2="tool"/>',
    "weld without moment": '<weld name="c" site1="sole" site2="tool" torquescale="0"/>',
    "weld to a mocap body": '<weld name="c" body1="hand" body2="block"/>',
    "gear": '<joint name="c" joint1="knee" joint2="hip" polycoef="0.1 0.7 -0.2 0.3 0.15"/>',
    "gear without offset": '<joint name="c" joint1="slider" joint2="crank"/>',
    "held joint": '<joint name="c" joint1="hip" polycoef="0.2 0 0 0 0"/>',
    "rod": '<tendon name="c" tendon1="rod" polycoef="0.05 0 0 0 0"/>',
    "sum of joints": '<tendon name="c" tendon1="sum" polycoef="0.3 0 0 0 0"/>',
}


@pytest.mark.parametrize("text", EQUALITIES.values(), ids=EQUALITIES)
def test_equality_constraints_hold_the_same_motions(
    text: str, rng: np.random.Generator, tmp_path: Path
) -> None:
    """Where our gap is closed so is MuJoCo's, and both Jacobians span the same rows."""
    twin = Twin.of(workshop(tmp_path, text), motors=["second"])
    chain = twin.chain
    for q, _ in random_states(chain, rng, 6):
        closure = stp.close_loops(chain, q, throw=False)
        if not closure.success:
            continue
        turn, _ = twin.set(closure.q)
        residual, jacobian = twin.equalities()
        if 'torquescale="0"' in text:
            residual, jacobian = residual[:3], jacobian[:3]
        assert np.abs(residual).max() < 1e-11
        assert same_row_space(jacobian @ turn, stp.loop_jacobian(chain, closure.q)) < 1e-10
        break
    else:
        pytest.fail("no state closes the loop")


@pytest.mark.parametrize("name", ["connect of bodies", "connect to the world", "connect of sites"])
def test_open_connects_have_our_rows_in_world_axes(
    name: str, rng: np.random.Generator, tmp_path: Path
) -> None:
    twin = Twin.of(workshop(tmp_path, EQUALITIES[name]), motors=["second"])
    chain, data = twin.chain, pin.Data(twin.chain.model)
    (loop,) = chain.loops
    assert loop.kind is JointKind.SPHERICAL
    for q, _ in random_states(chain, rng, 3):
        twin.set(q)
        residual, _ = twin.equalities()
        pin.framesForwardKinematics(chain.model, data, q)
        frame1 = data.oMf[link_frame(chain.model, loop.link1)] * loop.placement1
        # Their residual is point 1 less point 2, in the world; ours is 2 less 1, in frame 1.
        np.testing.assert_allclose(-frame1.rotation.T @ residual, stp.loop_gap(chain, q), rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["gear", "gear without offset", "held joint"])
def test_open_gears_have_our_row(name: str, rng: np.random.Generator, tmp_path: Path) -> None:
    twin = Twin.of(workshop(tmp_path, EQUALITIES[name]), motors=["second"])
    for q, _ in random_states(twin.chain, rng, 3):
        turn, _ = twin.set(q)
        residual, jacobian = twin.equalities()
        sign = np.sign(residual @ stp.loop_gap(twin.chain, q))
        # Degree four in a joint of a few radians: 1e-12 is round-off.
        np.testing.assert_allclose(sign * residual, stp.loop_gap(twin.chain, q), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(
            sign * jacobian @ turn, stp.loop_jacobian(twin.chain, q), rtol=1e-12, atol=1e-12
        )


def test_two_connects_are_one_hinge(rng: np.random.Generator, tmp_path: Path) -> None:
    two = (
        '<connect body1="shin" body2="platform" anchor="0.1 0.2 0.3"/>'
        '<connect body1="platform" body2="shin" anchor="0.3 0.1 -0.2"/>'
    )
    twin = Twin.of(workshop(tmp_path, two), motors=["second"])
    chain = twin.chain
    (loop,) = chain.loops
    assert loop.kind is JointKind.REVOLUTE and loop.name == "connect_1"
    assert "together with 'connect_2'" in str(chain.report)
    for q, _ in random_states(chain, rng, 3):
        closed = stp.close_loops(chain, q).q
        turn, _ = twin.set(closed)
        residual, jacobian = twin.equalities()
        assert np.abs(residual).max() < 1e-11
        assert len(residual) == 6 and chain.nc == 5
        assert same_row_space(jacobian @ turn, stp.loop_jacobian(chain, closed)) < 1e-10


def test_a_connect_and_a_rod_are_one_universal_joint(rng: np.random.Generator, tmp_path: Path) -> None:
    """The rod spans the hypotenuse over two arms that stay square: 0.3, 0.4 and 0.5."""
    sites = '<site name="centre" pos="0.1 0.2 0"/><site name="arm" pos="0.1 0.2 0.4"/>'
    text = WORKSHOP.replace('<site name="tool"', f'{sites}<site name="tool"')
    text = text.replace('<site name="anchor"', '<site name="middle" pos="0.1 0.5 0.6"/><site name="anchor"')
    text = text.replace('<site site="tip"/>', '<site site="arm"/>')
    ties = '<tendon name="r" tendon1="rod"{}/><connect name="c" site1="middle" site2="centre"/>'
    path = write(tmp_path, text % (ties.format(""), QPOS))
    zero = float(mujoco.MjModel.from_xml_string(_for_mujoco(path)).tendon_length0[0])
    write(tmp_path, text % (ties.format(f' polycoef="{0.5 - zero!r} 0 0 0 0"'), QPOS))
    twin = Twin.of(path, motors=["second"])
    chain = twin.chain
    (loop,) = chain.loops
    assert loop.kind is JointKind.UNIVERSAL and loop.name == "c"
    for q, _ in random_states(chain, rng, 3):
        closed = stp.close_loops(chain, q).q
        turn, _ = twin.set(closed)
        residual, jacobian = twin.equalities()
        assert np.abs(residual).max() < 1e-11
        assert same_row_space(jacobian @ turn, stp.loop_jacobian(chain, closed)) < 1e-10


LINKAGE = """
<mujoco model="linkage">
  <compiler angle="degree"/>
  <option gravity="1 -9 -2"/>
  <default><geom type="capsule" size="0.03"/><joint axis="0 0 1"/></default>
  <worldbody>
    <body name="left" pos="0 0 0.1">
      <joint name="left" ref="30" pos="0.02 0 0"/><geom fromto="0 0 0 0.2 0.4 0"/>
      <body name="platform" pos="0.2 0.4 0">
        <joint name="elbow"/><geom fromto="0 0 0 0.3 0.2 0.1"/><site name="tip" pos="0.31 0.2 0.1"/>
        <body name="spinner" pos="0 0.1 0"><joint name="spin" type="slide" axis="0 0 1"/><geom size="0.05 0.1"/></body>
      </body>
    </body>
    <body name="right" pos="0.8 0 0.1">
      <joint name="right" axis="0 0 -1" pos="0 -0.03 0"/><geom fromto="0 0 0 0.1 0.4 0"/>
      <body name="forearm" pos="0.1 0.4 0">
        <joint name="wrist"/><geom fromto="0 0 0 -0.4 0.1 0"/><site name="end" pos="-0.4 0.2 0.1"/>
      </body>
    </body>
  </worldbody>
  <equality>
    <connect site1="end" site2="tip"/>
    <joint joint1="spin" joint2="left" polycoef="0.05 0.2 0.1 0 0"/>
  </equality>
  <actuator><motor joint="right" gear="3"/><position joint="left" kp="5"/></actuator>
</mujoco>
"""


def test_motor_efforts(rng: np.random.Generator, closed_states, project, tmp_path: Path) -> None:
    """MuJoCo's file, tree and rows: a linkage drawn open, anchors off centre, a reference and a cam."""
    twin = Twin.of(write(tmp_path, LINKAGE))
    chain, model, data = twin.chain, twin.model, twin.data
    assert chain.motors == ("right", "left")
    assert "closing them moves joint" in str(chain.report)
    motors = model.jnt_dofadr[model.actuator_trnid[:, 0]]
    for state in closed_states(chain, 5):
        ours = stp.inverse_dynamics(chain, state.q, state.v, state.a)
        turn, drift = twin.set(state.q, state.v)
        _, jacobian = twin.equalities()
        data.qacc[:] = turn @ ours.a + drift
        model.opt.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        mujoco.mj_inverse(model, data)
        model.opt.disableflags = 0
        theirs = project(data.qfrc_inverse, jacobian, motors)
        # Law 9.
        assert np.abs(theirs - ours.tau_motor).max() <= 1e-9 * np.abs(ours.tau_motor).max()
        proof = stp.inverse_dynamics(chain, state.q, state.v, state.a, method="constraint_matrix")
        assert np.abs(proof.tau_motor - ours.tau_motor).max() <= 1e-10 * np.abs(ours.tau_motor).max()


WEIGHTS = """
<mujoco>
  <compiler {}/>
  <asset><mesh name="m" vertex="0 0 0  1 0 0  0 1 0  0 0 1"/></asset>
  <worldbody>
    <geom type="mesh" mesh="m"/>
    <body name="still" pos="0 1 0"><geom size="0.3"/></body>
    <body name="heavy"><joint/><geom type="mesh" mesh="m" group="1"/><geom type="mesh" mesh="m" mass="0"/></body>
    <body name="told"><joint/><inertial pos="0 0 0" mass="3" diaginertia="1 1 1"/><geom type="mesh" mesh="m"/></body>
    <body name="free"><freejoint/><geom type="mesh" mesh="m" density="3" group="2"/><geom type="mesh" mesh="m"/></body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize(
    "option",
    [
        "",
        'inertiafromgeom="true"',
        'inertiagrouprange="1 2"',
        'settotalmass="10"',
        'boundmass="4"',
        'fusestatic="true"',
        'discardvisual="true"',
        'alignfree="true"',
    ],
)
def test_shapes_that_are_taken_away_have_no_weight(option: str, tmp_path: Path) -> None:
    """Meshes that no inertia depends on are not opened; whatever the compiler's options, the bodies stay the same."""
    path = write(tmp_path, WEIGHTS.format(option))
    ours, _, told = compile_mjcf(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        theirs = mujoco.MjSpec.from_file(str(path)).compile()
    for array in ("body_mass", "body_inertia", "body_ipos", "body_iquat", "body_pos", "body_quat"):
        np.testing.assert_array_equal(getattr(ours, array), getattr(theirs, array))
    assert any("settotalmass" in text for text in told) == ("settotalmass" in option)


def test_the_model_that_comes_with_mujoco(rng: np.random.Generator) -> None:
    """Free bodies, balls, unnamed parts, a weld, meshes, tendons with wraps, ten actuators of all kinds."""
    path = Path(mujoco.__file__).parent / "testdata" / "model.xml"
    twin = Twin.of(path, platform="head")
    assert twin.chain.nv == twin.model.nv and len(twin.chain.loops) == 1
    require_same_tree(twin, rng)
    # Actuators of joints, in their order; wheel_0 is a ball.
    assert twin.chain.motors == ("hipy_2", "hipz_1", "hipz_2", "wheel_2", "hipz_0", "wheel_1", "hipy_1")
