"""Compiled kernels."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from tests.retelling.case import Case
from tests.retelling.telling import Telling
from tests.retelling.verbs.asking import Answers, asks, keeps_closed, moves, told_pose


@asks("compile_kernels", kind="compiled")
def kernels_of_the_tree(t: Telling, c: Case) -> Answers:
    q, v, a = t.state(c.q, c.v, c.a)
    many = stp.compile_kernels(t.chain, coordinates="tree", engine="numpy")
    answers = moves(t, q, v, many.forward_dynamics(q[None], v[None], t.efforts(c.tau_motor)[None])[0])
    return answers | {"efforts": t.motors(many.inverse_dynamics(q[None], v[None], a[None])[0])}


@asks("compile_kernels", kind="compiled")
def kernels_of_motors(t: Telling, c: Case) -> Answers:
    chain = c.chain
    x, rates = stp.motor_positions(chain, c.near)[None], c.v[None, chain.motor_index]
    accelerations = c.a[None, chain.motor_index]
    many = stp.compile_kernels(t.chain, coordinates="motor", engine="numpy")
    state = t.readings(x), t.efforts(rates)
    tau = many.inverse_dynamics(*state, t.efforts(accelerations))
    return {
        "efforts": t.motors(tau),
        "accelerations": t.motors(many.forward_dynamics(*state, t.efforts(c.tau_motor[None]))),
    }


@asks("compile_kernels", kind="compiled")
def kernel_derivatives(t: Telling, c: Case) -> Answers:
    if c.chain.nv > 12:
        return {}  # long programs
    x, index = stp.motor_positions(c.chain, c.near)[None], c.chain.motor_index
    many = stp.compile_kernels(t.chain, coordinates="motor", engine="numpy")
    state = t.readings(x), t.efforts(c.v[None, index]), t.efforts(c.a[None, index])
    found = many.inverse_dynamics_derivatives(*state)
    names = ("position", "rate", "acceleration")
    return {name: t.motors(t.motors(d[0], axis=0)) for name, d in zip(names, found, strict=True)}


@asks("compile_kernels", "Kernels", kind="compiled")
def kernels_of_the_platform(t: Telling, c: Case) -> Answers:
    q, v, _ = t.state(c.near, keeps_closed(c, c.near))
    told = t.chain.at(q, v)
    pose, twist = _xyzquat(t, c.near, c), told.twist[None]
    acceleration = (told.P @ stp.dynamics.motion_map(told).gamma + told.platform_bias)[None]
    many = stp.compile_kernels(t.chain, coordinates="platform", engine="numpy")
    readings = t.readings(stp.motor_positions(c.chain, c.near))[None]
    home = _xyzquat(t, c.chain.q_home, c)
    return {
        "efforts": t.motors(many.inverse_dynamics(pose, twist, acceleration)),
        "acceleration": t.twists(many.forward_dynamics(pose, twist, t.efforts(c.tau_motor[None]))),
        "motors": t.positions(many.inverse_kinematics(pose)),
        "rates": t.motors(many.motor_jacobian(pose)[0] @ twist[0]),
        "pose": t.pose(pin.XYZQUATToSE3(many.forward_kinematics(readings, home)[0])),
    }


def _xyzquat(t: Telling, q: np.ndarray, c: Case) -> np.ndarray:
    return np.asarray(pin.SE3ToXYZQUAT(told_pose(t, c, q)))[None]
