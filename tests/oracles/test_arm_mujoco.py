"""The seven-joint arm against MuJoCo, on the ground and on a free base (S2.3, S2.4).

The comparison model is built here from the chain's numbers, link by link, so that no exporter stands between.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.model.description import Joint, JointKind
from tests.mechanics.arm_motion import simulate, source_torque

mujoco = pytest.importorskip("mujoco")


def _numbers(values) -> str:
    return " ".join(repr(float(x)) for x in np.ravel(values))


def _body(chain: stp.ClosedChain, joint: Joint) -> str:
    """Write one link and what hangs on it as MJCF."""
    quaternion = pin.Quaternion(joint.placement.rotation)
    place = (
        f'pos="{_numbers(joint.placement.translation)}" '
        f'quat="{_numbers([quaternion.w, quaternion.x, quaternion.y, quaternion.z])}"'
    )
    inner = ""
    if joint.kind is JointKind.REVOLUTE:
        inner += f'<joint name="{joint.name}" type="hinge" axis="{_numbers(joint.axis)}"/>'
    elif joint.kind is JointKind.FLOATING:
        inner += f'<freejoint name="{joint.name}"/>'
    inertia = chain.mechanism.link(joint.child).inertia
    if inertia is not None:
        m = inertia.inertia
        full = [m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2]]
        inner += (
            f'<inertial pos="{_numbers(inertia.lever)}" mass="{inertia.mass!r}" '
            f'fullinertia="{_numbers(full)}"/>'
        )
    inner += "".join(_body(chain, below) for below in chain.mechanism.joints if below.parent == joint.child)
    return f'<body name="{joint.child}" {place}>{inner}</body>'


def mujoco_model(chain: stp.ClosedChain, step: float = 0.01):
    mechanism = chain.mechanism
    bodies = "".join(_body(chain, j) for j in mechanism.joints if j.parent == mechanism.root)
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian"/><option timestep="{step!r}" integrator="RK4" '
        f'gravity="{_numbers(chain.gravity)}"/><worldbody>{bodies}</worldbody></mujoco>'
    )


class _Arm:
    """MuJoCo's view of a chain, with the free joint translated: its linear rates are in world axes there."""

    def __init__(self, chain: stp.ClosedChain, step: float = 0.01) -> None:
        self.model = mujoco_model(chain, step)
        self.data = mujoco.MjData(self.model)
        self.free = chain.nq != chain.nv

    def set(self, q, v) -> None:
        q, v = np.array(q), np.array(v)
        if self.free:
            v[:3] = pin.XYZQUATToSE3(q[:7]).rotation @ v[:3]
            q[3:7] = q[[6, 3, 4, 5]]  # w first
        self.data.qpos, self.data.qvel = q, v

    def get(self) -> np.ndarray:
        q = np.array(self.data.qpos)
        if self.free:
            q[3:7] = q[[4, 5, 6, 3]]
        return q

    def acceleration(self, q, v, tau) -> np.ndarray:
        self.set(q, v)
        self.data.qfrc_applied[self.model.nv - len(tau) :] = tau
        mujoco.mj_forward(self.model, self.data)
        a = np.array(self.data.qacc)
        if self.free:
            # From d(world velocity)/dt to that of the body components: R' = R [ω]×.
            a[:3] = pin.XYZQUATToSE3(q[:7]).rotation.T @ a[:3] - np.cross(v[3:6], v[:3])
        return a

    def motion(self, q, v, torque, duration: float) -> np.ndarray:
        """Return the final configuration; a passive force puts the torque into every stage of the integrator."""
        self.set(q, v)
        nu = len(torque(0.0))

        def apply(model, data) -> None:
            data.qfrc_passive[model.nv - nu :] += torque(data.time)

        mujoco.set_mjcb_passive(apply)
        try:
            for _ in range(round(duration / self.model.opt.timestep)):
                mujoco.mj_step(self.model, self.data)
        finally:
            mujoco.set_mjcb_passive(None)
        return self.get()


@pytest.fixture
def arm() -> stp.ClosedChain:
    return stp.load("arm_7r", gravity=(0, 0, 0))


@pytest.fixture
def satellite(arm: stp.ClosedChain) -> stp.ClosedChain:
    bus = pin.Inertia(150.0, np.array([0.02, 0.0, -0.3]), np.diag([20.0, 18.0, 15.0]))
    return stp.on_floating_base(arm, bus)


@pytest.mark.parametrize("name", ["arm_7r", "arm_3r_planar", "arm_3r_spatial"])
@pytest.mark.parametrize("gravity", [(0, 0, 0), (0, -9.81, 3.0)])
def test_accelerations_equal_mujoco(name: str, gravity, rng: np.random.Generator) -> None:
    chain = stp.load(name, gravity=gravity)
    other = _Arm(chain)
    for _ in range(20):
        q, v = rng.uniform(-np.pi, np.pi, chain.nq), rng.normal(0, 2, chain.nv)
        tau = rng.normal(0, 20, chain.nu)
        ours = stp.articulated_body_acceleration(chain, q, v, tau)
        # Two factorisations in doubles; the condition number of M is below 1e3.
        assert np.abs(ours - other.acceleration(q, v, tau)).max() <= 1e-11 * max(1.0, np.abs(ours).max())


def test_free_base_accelerations_equal_mujoco(satellite: stp.ClosedChain, rng: np.random.Generator) -> None:
    other = _Arm(satellite)
    for _ in range(20):
        q = pin.integrate(satellite.model, satellite.q_home, rng.normal(size=satellite.nv))
        v, tau = rng.normal(size=satellite.nv), rng.normal(0, 20, 7)
        ours = stp.articulated_body_acceleration(satellite, q, v, np.concatenate([np.zeros(6), tau]))
        assert np.abs(ours - other.acceleration(q, v, tau)).max() <= 1e-11 * max(1.0, np.abs(ours).max())


@pytest.mark.parametrize("which", ["arm", "satellite"])
def test_motions_differ_by_mujocos_integrator_only(which: str, request: pytest.FixtureRequest) -> None:
    # Halving MuJoCo's step divides the distance by 2⁴: all of it is the error of its fourth-order integrator.
    chain = request.getfixturevalue(which)
    q = np.array(chain.q_home)
    q[-6] = -np.pi / 2
    v = np.zeros(chain.nv)
    exact = simulate(chain, q, v, source_torque, 10.0).q[-1]
    gaps = []
    for step in (0.04, 0.02, 0.01):
        final = _Arm(chain, step).motion(q, v, source_torque, 10.0)
        gaps.append(np.abs(pin.difference(chain.model, exact, final)).max())
    orders = np.log2(np.divide(gaps[:-1], gaps[1:]))
    assert np.abs(orders - 4.0).max() < 0.25, (gaps, orders)
    assert gaps[-1] < 1e-8
