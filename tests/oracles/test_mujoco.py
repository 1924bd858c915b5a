"""Law 9: MuJoCo, given the exported file, has the same tree, the same loops, and needs the same motor efforts."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import Joint, JointKind, Link, Loop, Mechanism
from tests.mechanisms import gear_train

mujoco = pytest.importorskip("mujoco", reason="needs MuJoCo: pip install 'stewart_pin[oracles]'")


@dataclass(frozen=True, eq=False)
class Engine:
    """A chain as MuJoCo compiled it, with the change of coordinates, found by the names of the joints."""

    chain: stp.ClosedChain
    model: mujoco.MjModel
    data: mujoco.MjData

    def set(self, q: np.ndarray, v: np.ndarray | None = None, a: np.ndarray | None = None) -> np.ndarray:
        """Set the state from Pinocchio's; return T (nv, nv) with v_mujoco = T v_pinocchio."""
        chain, model = self.chain, self.chain.model
        turn, drift = np.zeros((chain.nv, chain.nv)), np.zeros(chain.nv)
        at_zero = pin.Data(model)
        pin.framesForwardKinematics(model, at_zero, pin.neutral(model))
        for number, (name, joint) in enumerate(zip(model.names, model.joints, strict=True)):
            if number == 0:
                continue
            theirs = self.model.joint(name)
            value = q[joint.idx_q : joint.idx_q + joint.nq]
            i, k = joint.idx_v, int(theirs.dofadr[0])
            block = turn[k : k + joint.nv, i : i + joint.nv]
            if joint.nv == 6:
                # v is in the body, theirs is in the world; ω is in the body for both.
                pose = at_zero.oMi[number] * pin.XYZQUATToSE3(value)
                x, y, z, w = pin.Quaternion(pose.rotation).coeffs()
                value = np.array([*pose.translation, w, x, y, z])
                block[:3, :3], block[3:, 3:] = pose.rotation, np.eye(3)
                if v is not None:
                    drift[k : k + 3] = pose.rotation @ np.cross(v[i + 3 : i + 6], v[i : i + 3])
            elif joint.nv == 3:
                body = self.model.body(int(theirs.bodyid[0])).name
                placement = at_zero.oMf[model.getFrameId(body)].inverse() * at_zero.oMi[number]
                value = np.array([value[3], *(placement.rotation @ value[:3])])
                block[:] = placement.rotation
            else:
                block[:] = 1.0
            start = int(theirs.qposadr[0])
            self.data.qpos[start : start + joint.nq] = value
        self.data.qvel[:] = 0.0 if v is None else turn @ v
        self.data.qacc[:] = 0.0 if a is None else turn @ a + drift
        return turn

    def inertia(self) -> np.ndarray:
        """Return the mass matrix at the state set."""
        mujoco.mj_forward(self.model, self.data)
        full = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, full)
        return full

    def tree_efforts(self) -> np.ndarray:
        """Return what the state set demands of every coordinate, loops, limits and contacts switched off."""
        self.model.opt.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        mujoco.mj_inverse(self.model, self.data)
        self.model.opt.disableflags = 0
        return self.data.qfrc_inverse.copy()

    def loops(self) -> tuple[np.ndarray, np.ndarray]:
        """Return residual and Jacobian of the equality constraints at the state set."""
        mujoco.mj_fwdPosition(self.model, self.data)
        rows = self.data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        jacobian = self.data.efc_J.reshape(-1, self.model.nv)
        return self.data.efc_pos[rows], jacobian[rows]


def compiled(chain: stp.ClosedChain, folder: Path) -> Engine:
    path = folder / "robot.xml"
    stp.export(chain, path, format="mjcf")
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    return Engine(chain, model, mujoco.MjData(model))


def random_configuration(chain: stp.ClosedChain, rng: np.random.Generator) -> np.ndarray:
    return pin.integrate(chain.model, chain.q_home, rng.uniform(-1, 1, chain.nv))


def same_row_space(first: np.ndarray, second: np.ndarray) -> float:
    """Return the sine of the largest angle between two row spaces of equal rank, or infinity."""
    bases = []
    for matrix in (first, second):
        _, s, vt = np.linalg.svd(matrix)
        bases.append(vt[: np.count_nonzero(s > 1e-9 * s[0])])
    if len(bases[0]) != len(bases[1]):
        return np.inf
    return float(np.abs(bases[0] - bases[0] @ bases[1].T @ bases[1]).max())


def require_same_tree(engine: Engine, rng: np.random.Generator) -> None:
    chain = engine.chain
    data = pin.Data(chain.model)
    for _ in range(5):
        q, v = random_configuration(chain, rng), rng.uniform(-1, 1, chain.nv)
        turn = engine.set(q)
        inertia = pin.crba(chain.model, data, q)
        inertia = np.triu(inertia) + np.triu(inertia, 1).T
        # 1e-10: round-off of two algorithms, entries up to a few hundred.
        assert np.abs(turn.T @ engine.inertia() @ turn - inertia).max() < 1e-10 * np.abs(inertia).max()
        engine.set(q, v, np.zeros(chain.nv))
        drift = engine.data.qacc.copy()
        ours = pin.nonLinearEffects(chain.model, data, q, v)
        assert np.abs(turn.T @ engine.tree_efforts() - ours).max() < 1e-10 * np.abs(ours).max()
        # Zero acceleration in our coordinates is not zero in theirs: a free body's v is in the world there.
        theirs = engine.inertia() @ drift + engine.data.qfrc_bias
        assert np.abs(turn.T @ theirs - ours).max() < 1e-10 * np.abs(ours).max()


def test_mass_matrix_and_bias(chain: stp.ClosedChain, rng: np.random.Generator, tmp_path: Path) -> None:
    require_same_tree(compiled(chain, tmp_path), rng)


def require_home(engine: Engine) -> None:
    """Check the keyframe against the chain's home, and leave the data there."""
    engine.set(engine.chain.q_home)
    ours = engine.data.qpos.copy()
    mujoco.mj_resetDataKeyframe(engine.model, engine.data, engine.model.key("home").id)
    # Quaternions pass through rotation matrices on the way.
    np.testing.assert_allclose(engine.data.qpos, ours, rtol=0, atol=1e-14)


def test_home_keyframe_is_home_and_closes_the_loops(chain: stp.ClosedChain, tmp_path: Path) -> None:
    engine = compiled(chain, tmp_path)
    require_home(engine)
    mujoco.mj_kinematics(engine.model, engine.data)
    site = engine.data.site(chain.platform)
    pose = stp.platform_pose(chain, chain.q_home)
    np.testing.assert_allclose(site.xpos, pose.translation, rtol=0, atol=1e-14)
    np.testing.assert_allclose(site.xmat.reshape(3, 3), pose.rotation, rtol=0, atol=1e-14)
    if chain.loops:
        assert np.abs(engine.loops()[0]).max() < 1e-12


def test_loops_allow_the_same_motions(chain: stp.ClosedChain, closed_states, tmp_path: Path) -> None:
    if not chain.loops:
        pytest.skip("no loops")
    engine = compiled(chain, tmp_path)
    for state in closed_states(chain, 5):
        turn = engine.set(state.q)
        residual, jacobian = engine.loops()
        assert np.abs(residual).max() < 1e-12
        # The loops are closed to 1e-13, and so are two descriptions of their motions.
        assert same_row_space(jacobian @ turn, stp.loop_jacobian(chain, state.q)) < 1e-10


def test_connect_rows_are_ours_in_world_axes(chain: stp.ClosedChain, closed_states, tmp_path: Path) -> None:
    if not chain.loops or any(loop.kind is not JointKind.SPHERICAL for loop in chain.loops):
        pytest.skip("not all loops are spherical")
    engine = compiled(chain, tmp_path)
    data = pin.Data(chain.model)
    for state in closed_states(chain, 3):
        turn = engine.set(state.q)
        theirs = (engine.loops()[1] @ turn).reshape(-1, 3, chain.nv)
        ours = stp.loop_jacobian(chain, state.q).reshape(-1, 3, chain.nv)
        pin.framesForwardKinematics(chain.model, data, state.q)
        for loop, one, two in zip(chain.loops, theirs, ours, strict=True):
            frame1 = data.oMf[chain.model.getFrameId(loop.link1)] * loop.placement1
            # Their residual is site 1 less site 2, in the world; ours is 2 less 1, in frame 1.
            np.testing.assert_allclose(-frame1.rotation.T @ one, two, rtol=0, atol=1e-12)


def test_motor_efforts(chain: stp.ClosedChain, closed_states, project, tmp_path: Path) -> None:
    """MuJoCo's tree, MuJoCo's loop Jacobian, MuJoCo's actuators: nothing of ours but the state."""
    engine = compiled(chain, tmp_path)
    motors = engine.model.jnt_dofadr[engine.model.actuator_trnid[:, 0]]
    for state in closed_states(chain, 5):
        ours = stp.inverse_dynamics(chain, state.q, state.v, state.a)
        engine.set(state.q, state.v, ours.a)
        needed = engine.tree_efforts()
        theirs = project(needed, engine.loops()[1], motors)
        # Law 9.
        assert np.abs(theirs - ours.tau_motor).max() <= 1e-9 * np.abs(ours.tau_motor).max()


def test_motor_efforts_under_wrenches(
    chain: stp.ClosedChain, closed_states, project, rng: np.random.Generator, tmp_path: Path
) -> None:
    """MuJoCo's ``xfrc_applied``, which acts at the centre of mass of a body, in world axes."""
    engine = compiled(chain, tmp_path)
    model, data = engine.model, engine.data
    motors = model.jnt_dofadr[model.actuator_trnid[:, 0]]
    bodies = {model.body(k).name for k in range(model.nbody)}
    # Of a link that is fixed to another MuJoCo makes one body with it, whose frame is the other's.
    links = [link.name for link in chain.mechanism.links if link.inertia is not None and link.name in bodies]
    assert links
    unit = 9.81 * sum(body.mass for body in chain.model.inertias) * np.repeat([1.0, chain.length_scale], 3)
    for state in closed_states(chain, 3):
        wrenches = {name: unit * rng.normal(size=6) for name in links}
        ours = stp.inverse_dynamics(chain, state.q, state.v, state.a, wrenches=wrenches)
        engine.set(state.q, state.v, ours.a)
        needed = engine.tree_efforts()
        data.xfrc_applied[:] = 0.0
        mujoco.mj_forward(model, data)
        free = data.qfrc_smooth.copy()
        for name, wrench in wrenches.items():
            body = data.body(name)
            arm = body.xpos - body.xipos
            data.xfrc_applied[model.body(name).id] = [*wrench[:3], *(wrench[3:] + np.cross(arm, wrench[:3]))]
        mujoco.mj_forward(model, data)
        theirs = project(needed - (data.qfrc_smooth - free), engine.loops()[1], motors)
        # Law 9.
        assert np.abs(theirs - ours.tau_motor).max() <= 1e-9 * np.abs(ours.tau_motor).max()


KINDS = (
    JointKind.SPHERICAL,
    JointKind.FIXED,
    JointKind.REVOLUTE,
    JointKind.UNIVERSAL,
    JointKind.DISTANCE,
)


def workshop(kind: JointKind | None, rng: np.random.Generator) -> stp.ClosedChain:
    """Build a mechanism with every joint, skew axes, a leaf without mass, and one loop that closes at home."""

    def inertia() -> pin.Inertia:
        size = rng.uniform(0.1, 1.0, 3)
        box = pin.Inertia.FromBox(rng.uniform(1, 3), *size)
        return place().act(box)

    def skew() -> np.ndarray:
        axis = rng.normal(size=3)
        return axis / np.linalg.norm(axis)

    def place() -> pin.SE3:
        return pin.exp6(rng.uniform(-1, 1, 6))

    J = JointKind
    massive = ("plate", "arm", "hand", "slider", "rotor", "floater", "stump")
    links = [Link("base"), *(Link(name, inertia()) for name in massive)]
    links += [Link(name) for name in ("cross", "bracket", "sleeve", "flange", "tool", "frame")]
    joints = [
        Joint("weld1", J.FIXED, "base", "plate", place()),
        Joint("a1", J.REVOLUTE, "plate", "cross", place(), skew(), -3.0, 3.0, independent=True),
        # A bracket without mass between two joints vanishes with the cross.
        Joint("a2", J.FIXED, "cross", "bracket", place()),
        Joint("a3", J.PRISMATIC, "bracket", "arm", place(), skew(), lower=-2.0),
        # Hinge, then ball, in one body.
        Joint("b1", J.REVOLUTE, "arm", "sleeve", place(), skew()),
        Joint("b2", J.SPHERICAL, "sleeve", "hand", place()),
        # Ball, then slide, in one body.
        Joint("c1", J.SPHERICAL, "base", "flange", place()),
        Joint("c2", J.PRISMATIC, "flange", "slider", place(), skew()),
        Joint("c3", J.FIXED, "slider", "tool", place()),
        # A moving link without mass of its own, with a body fixed to it.
        Joint("d1", J.REVOLUTE, "slider", "frame", place(), skew()),
        Joint("d2", J.FIXED, "frame", "stump", place()),
        Joint("d3", J.REVOLUTE, "frame", "rotor", place(), skew()),
        Joint("afloat", J.FLOATING, "plate", "floater", place()),
    ]
    tree = Mechanism("workshop", tuple(links), tuple(joints), platform="tool")
    chain = build_chain(tree)
    if kind is None:
        return chain
    q = pin.integrate(chain.model, chain.q_home, rng.uniform(-1, 1, chain.nv))
    data = pin.Data(chain.model)
    pin.framesForwardKinematics(chain.model, data, q)
    end1 = place()
    oM1 = data.oMf[chain.model.getFrameId("floater")] * end1
    end2 = data.oMf[chain.model.getFrameId("tool")].inverse() * oM1
    length = 0.0
    if kind is J.DISTANCE:
        length = 0.7
        end2 = end2 * pin.SE3(np.eye(3), length * skew())
    axis, across = skew(), skew()
    # Both frames coincide at home, where the axes of a universal joint are perpendicular.
    across -= axis * (axis @ across)
    across /= np.linalg.norm(across)
    loop = Loop("closure", kind, "floater", "tool", end1, end2, axis, across, length)
    home = {
        name: q[joint.idx_q : joint.idx_q + joint.nq]
        for name, joint in zip(chain.model.names[1:], chain.model.joints[1:], strict=True)
    }
    return build_chain(
        Mechanism("workshop", tuple(links), tuple(joints), (loop,), platform="tool", home=home)
    )


def test_every_joint_and_merged_links(rng: np.random.Generator, tmp_path: Path) -> None:
    engine = compiled(workshop(None, rng), tmp_path)
    names = {engine.model.body(k).name for k in range(engine.model.nbody)}
    assert names == {
        "world", "base", "plate", "arm", "hand", "slider", "tool", "frame", "stump", "rotor", "floater",
    }  # fmt: skip
    require_same_tree(engine, rng)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_loop(kind: JointKind, rng: np.random.Generator, closed_states, tmp_path: Path) -> None:
    chain = workshop(kind, rng)
    engine = compiled(chain, tmp_path)
    require_home(engine)
    assert np.abs(engine.loops()[0]).max() < 1e-12
    for state in closed_states(chain, 5):
        turn = engine.set(state.q)
        residual, jacobian = engine.loops()
        assert np.abs(residual).max() < 1e-12
        assert same_row_space(jacobian @ turn, stp.loop_jacobian(chain, state.q)) < 1e-10


def test_gears(rng: np.random.Generator, closed_states, project, tmp_path: Path) -> None:
    """A cam, a belt and a thread: the same tree, the same rows, and the same motor efforts past them."""
    chain = gear_train(rng)
    engine = compiled(chain, tmp_path)
    require_same_tree(engine, rng)
    require_home(engine)
    motors = engine.model.jnt_dofadr[engine.model.actuator_trnid[:, 0]]
    assert [engine.model.joint(int(j)).name for j in engine.model.actuator_trnid[:, 0]] == list(chain.motors)
    for state in closed_states(chain, 5):
        ours = stp.inverse_dynamics(chain, state.q, state.v, state.a)
        turn = engine.set(state.q, state.v, ours.a)
        needed = engine.tree_efforts()
        residual, jacobian = engine.loops()
        # Degree three: round-off of the polynomials.
        assert np.abs(residual).max() < 1e-12
        assert same_row_space(jacobian @ turn, stp.loop_jacobian(chain, state.q)) < 1e-10
        theirs = project(needed, jacobian, motors)
        # Law 9.
        assert np.abs(theirs - ours.tau_motor).max() <= 1e-9 * np.abs(ours.tau_motor).max()


def test_laminae_keep_their_inertia(rng: np.random.Generator, tmp_path: Path) -> None:
    """Rounded to double, a lamina in skew axes breaks the triangle inequality two times in five; MuJoCo refuses."""
    for _ in range(20):
        turn = pin.exp3(rng.uniform(-3, 3, 3))
        a, b = rng.uniform(0.01, 2, 2)
        matrix = turn @ np.diag([a, b, a + b]) @ turn.T
        matrix = (matrix + matrix.T) / 2
        links = (Link("base"), Link("plate", pin.Inertia(1.0, np.zeros(3), matrix)))
        joints = (Joint("pose", JointKind.SPHERICAL, "base", "plate", pin.SE3.Identity()),)
        slide = Joint("slide", JointKind.PRISMATIC, "plate", "end", pin.SE3.Identity())
        end = Link("end", pin.Inertia.FromSphere(1.0, 0.1))
        chain = build_chain(
            Mechanism("lamina", (*links, end), (*joints, slide), platform="end"), motors=["slide"]
        )
        model = compiled(chain, tmp_path).model
        axes = np.zeros(9)
        mujoco.mju_quat2Mat(axes, model.body("plate").iquat)
        axes = axes.reshape(3, 3)
        theirs = axes @ np.diag(model.body("plate").inertia) @ axes.T
        np.testing.assert_allclose(theirs, matrix, rtol=0, atol=1e-14)


def test_limits_and_motors(tmp_path: Path) -> None:
    chain = stp.load("stewart", motors=[f"leg{k}" for k in (3, 1, 2, 6, 5, 4)])
    model = compiled(chain, tmp_path).model
    actuators = [model.actuator(k).name for k in range(model.nu)]
    assert actuators == list(chain.motors)
    for name in chain.motors:
        joint = chain.mechanism.joint(name)
        assert model.joint(name).limited[0]
        np.testing.assert_array_equal(model.joint(name).range, [joint.lower, joint.upper])
        np.testing.assert_array_equal(model.actuator(name).forcerange, [-joint.effort, joint.effort])


def test_forward_dynamics_is_soft_but_near(closed_states, tmp_path: Path) -> None:
    """No oracle: the accelerations of the exported file miss ours by thousandths, at MuJoCo's default by their size."""
    chain = stp.load("stewart")
    engine = compiled(chain, tmp_path)
    default = np.array([0.9, 0.95, 0.001, 0.5, 2.0])
    for state in closed_states(chain, 3):
        ours = stp.inverse_dynamics(chain, state.q, state.v, state.a)
        misses: list[float] = []
        for solimp in (engine.model.eq_solimp.copy(), default):
            engine.set(state.q, state.v, ours.a)
            demanded = engine.data.qacc.copy()
            engine.data.ctrl[:] = ours.tau_motor
            kept, engine.model.eq_solimp[:] = engine.model.eq_solimp.copy(), solimp
            mujoco.mj_forward(engine.model, engine.data)
            engine.model.eq_solimp[:] = kept
            misses.append(np.abs(engine.data.qacc - demanded).max() / np.abs(demanded).max())
        # Measured: 0.0005 to 0.002, and 0.6 to 2.
        assert misses[0] < 0.01 and misses[1] > 0.3


def test_constants_of_mujoco() -> None:
    assert (mujoco.mjMINVAL, mujoco.mjMAXVAL, mujoco.mjMAXIMP) == (1e-15, 1e10, 0.9999)
