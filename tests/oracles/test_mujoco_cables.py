"""MuJoCo's spatial tendons are the cables: lengths, their change with the pose, and the forces that move the box."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from tests.cable_robots import cables_8

mujoco = pytest.importorskip("mujoco", reason="needs MuJoCo: pip install 'stewart_pin[oracles]'")


def _points(points: np.ndarray, prefix: str) -> str:
    return "".join(
        f'<site name="{prefix}{k}" pos="{" ".join(map(repr, point.tolist()))}"/>'
        for k, point in enumerate(points)
    )


def _engine(exits: np.ndarray, ends: np.ndarray, body: pin.Inertia) -> mujoco.MjModel:
    moments, com = np.diag(body.inertia).tolist(), body.lever.tolist()
    tendons = "".join(
        f'<spatial name="cable{k}"><site site="exit{k}"/><site site="end{k}"/></spatial>'
        for k in range(len(exits))
    )
    return mujoco.MjModel.from_xml_string(f"""
        <mujoco><compiler angle="radian"/><option gravity="0 0 -9.81"/><worldbody>{_points(exits, "exit")}
        <body name="box"><freejoint/>{_points(ends, "end")}
        <inertial mass="{body.mass!r}" pos="{" ".join(map(repr, com))}" diaginertia="{" ".join(map(repr, moments))}"/>
        </body></worldbody><tendon>{tendons}</tendon></mujoco>""")


def test_lengths_and_tensions_are_those_of_spatial_tendons(rng: np.random.Generator) -> None:
    plain = cables_8().described()
    exits = np.array([loop.placement1.translation for loop in plain.loops])
    ends = np.array([loop.placement2.translation for loop in plain.loops])
    body = pin.Inertia(12.0, np.array([0.02, -0.01, 0.03]), np.diag([0.2, 0.3, 0.4]))
    home = pin.XYZQUATToSE3(plain.home["platform_pose"])
    chain = stp.cables.cable_robot(exits, ends, platform=body, home=home)
    engine = _engine(exits, ends, body)
    data = mujoco.MjData(engine)
    for _ in range(3):
        pose = home * pin.exp6(0.2 * rng.standard_normal(6))
        twist, acceleration = rng.standard_normal((2, 6))
        state = stp.platform_motion(chain, pose, twist, acceleration)
        x, y, z, w = pin.Quaternion(pose.rotation).coeffs()
        data.qpos[:] = [*pose.translation, w, x, y, z]
        # Their velocities are linear in the world, angular in the body.
        turn = pose.rotation.T
        data.qvel[:] = [*twist[:3], *(turn @ twist[3:])]
        data.qacc[:] = [*acceleration[:3], *(turn @ acceleration[3:])]
        mujoco.mj_inverse(engine, data)
        # Lengths and their rates are quantities of forward position and velocity.
        moved = np.array(data.qfrc_inverse)
        mujoco.mj_fwdPosition(engine, data)
        mujoco.mj_fwdVelocity(engine, data)
        jacobian = np.zeros((engine.ntendon, engine.nv))
        rows = np.array(data.ten_J)
        if rows.size == jacobian.size:
            jacobian = rows.reshape(jacobian.shape)
        else:
            adr, nnz, col = data.ten_J_rowadr, data.ten_J_rownnz, data.ten_J_colind
            for k in range(engine.ntendon):
                span = slice(adr[k], adr[k] + nnz[k])
                jacobian[k, np.array(col).ravel()[span]] = rows.ravel()[span]
        assert np.abs(stp.cables.cable_lengths(state) - data.ten_length).max() < 1e-12
        motor_rates = state.v[chain.motor_index]
        assert np.abs(motor_rates + data.ten_velocity).max() < 1e-10
        tensions = stp.inverse_dynamics(state).tau_motor
        # A cable pulls its ends together.
        assert np.abs(-jacobian.T @ tensions - moved).max() < 1e-9 * np.abs(moved).max()
        least = np.linalg.lstsq(-jacobian.T, moved, rcond=None)[0]
        assert np.abs(tensions - least).max() < 1e-9 * np.abs(least).max()
