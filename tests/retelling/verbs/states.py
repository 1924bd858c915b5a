"""Loops, states, kinematics."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import stewart_pin as stp
from tests.retelling.case import Case
from tests.retelling.telling import Telling
from tests.retelling.verbs.asking import Answers, Sized, asks, told_pose


def _of_rows(t: Telling, q: np.ndarray, rows: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Bring back what rows of loops do to the joints, whatever frames they stand in."""
    return t.cotangent(stp.loop_jacobian(t.chain, q).T @ rows(q))


@asks("loop_gap", "loop_jacobian", "loop_jacobian_rate", "loop_bias")
def loops(t: Telling, c: Case) -> Answers:
    if not (t.joint_by_joint and t.same_rows):
        return {}
    q, v, _ = t.state(c.q, c.v)
    J, N = stp.loop_jacobian(t.chain, q), t.T @ c.chain.at(c.q).freedom.motions
    is_open = t.q(c.q_open)
    # A gap has no frame to stand in but that of its first end.
    gap = {"gap": _of_rows(t, is_open, lambda q: stp.loop_gap(t.chain, q))} if t.same_gap else {}
    return {
        **gap,
        "jacobian": t.cotangent(t.cotangent(J.T @ J).T),
        # Along motions that keep the loops closed, where frames that turn have no gap to turn.
        "rate": t.cotangent(J.T @ stp.loops.loop_jacobian_rate(t.chain, q, v) @ N),
        "rate of motions": t.cotangent(J.T @ stp.loops.loop_jacobian_rate(t.chain, q, v, N)),
        "bias": _of_rows(t, q, lambda q: stp.loop_bias(t.chain, q, v)),
    }


@asks("State", "platform_pose", "motor_positions", "motor_jacobian")
def state(t: Telling, c: Case) -> Answers:
    q, v, a = t.state(c.q, c.v, c.a)
    told = t.chain.at(q, v, a)
    answers = {
        "pose": t.pose(stp.platform_pose(told)),
        "twist": t.twists(told.twist),
        "acceleration": t.twists(told.P @ a + told.platform_bias),
        "motor positions": t.positions(stp.motor_positions(t.chain, q)),
        "motor rates": t.motors(told.v[t.chain.motor_index]),
        "motor jacobian": t.motors(stp.motor_jacobian(t.chain, q) @ told.twist),
        "energy": v @ told.M @ v,
    }
    if t.same_size:
        answers["all of it"] = t.motors(t.twists(stp.motor_jacobian(t.chain, q)), axis=0)
    if t.joint_by_joint and t.same_rows:
        answers["size"] = t.chain.length_scale
    if t.joint_by_joint:
        answers |= {
            "M": t.cotangent(t.cotangent(told.M).T),
            "nle": t.cotangent(told.nle),
            "coriolis": t.cotangent(told.coriolis @ v) if np.ndim(told.coriolis) == 2 else told.coriolis,
            "weight": Sized(t.cotangent(told.weight), c.effort),
            "platform rows": t.twists(t.cotangent(told.P.T).T, axis=0),
        }
    return answers


@asks("close_loops", "Closure")
def close_loops(t: Telling, c: Case) -> Answers:
    if not t.joint_by_joint:
        return {}
    found = stp.close_loops(t.chain, t.q(c.q_open))
    if not (t.same_rows and t.same_gap):
        return {"success": found.success}  # Newton's steps from open loops are others
    return {"q": t.configuration(found.q), "iterations": found.iterations}


@asks("inverse_kinematics")
def inverse_kinematics(t: Telling, c: Case) -> Answers:
    answers: Answers = {}
    # Home may stand at a limit, which printed digits put on either side.
    for limits in (True, False):
        found = stp.inverse_kinematics(t.chain, told_pose(t, c, c.near), limits=limits)
        answers |= _found(t, found, f", limits {limits}")
    return answers


def _found(t: Telling, found: stp.loops.Closure, note: str = "") -> Answers:
    answers = {
        "motors" + note: t.positions(stp.motor_positions(t.chain, found.q)),
        "pose" + note: t.pose(stp.platform_pose(t.chain, found.q)),
    }
    # Idle freedoms are left where Newton's steps from open loops happen to leave them.
    if t.joint_by_joint and (t.same_gap or not stp.mobility(t.chain).idle):
        answers["q" + note] = t.configuration(found.q)
    return answers


@asks("forward_kinematics")
def forward_kinematics(t: Telling, c: Case) -> Answers:
    readings = t.readings(stp.motor_positions(c.chain, c.near))
    return _found(t, stp.forward_kinematics(t.chain, readings))


@asks("all_forward_kinematics", kind="slow")
def all_forward_kinematics(t: Telling, c: Case) -> Answers:
    if c.chain.nv > 4 or not t.joint_by_joint:
        return {}  # few starts find all solutions of a planar chain only
    readings = t.readings(stp.motor_positions(c.chain, c.near))
    found = stp.loops.all_forward_kinematics(t.chain, readings, starts=60)
    poses = np.array([t.pose(pose) for pose in found.poses])
    return {"poses": poses[np.lexsort(poses.reshape(len(poses), -1).round(6).T[::-1])]}


@asks("platform_motion")
def platform_motion(t: Telling, c: Case) -> Answers:
    plain = c.chain.at(c.q, c.v)
    pose, twist, acceleration = (
        t.world * plain.pose,
        t.turned(plain.twist),
        t.turned(plain.P @ c.a + plain.platform_bias),
    )
    if not t.exact:
        q, v, a = t.state(c.q, c.v, c.a)
        told = t.chain.at(q, v)
        pose, twist, acceleration = told.pose, told.twist, told.P @ a + told.platform_bias
    found = stp.platform_motion(
        t.chain,
        pose,
        twist,
        acceleration,
        q_guess=t.state(c.q)[0],
        limits=False,
    )
    answers = {
        "motors": t.positions(found.q[t.chain.motor_q_index]),
        "rates": t.motors(found.v[t.chain.motor_index]),
        "accelerations": t.motors(found.a[t.chain.motor_index]),
    }
    if t.joint_by_joint:
        answers |= {"v": t.tangent(found.v), "a": t.tangent(found.a)}
    return answers


@asks("motion_map", "operational_dynamics")
def operational_dynamics(t: Telling, c: Case) -> Answers:
    q, v, _ = t.state(c.q, c.v)
    motor = stp.operational_dynamics(t.chain, q, v)
    answers = {
        "M": t.motors(t.motors(motor.M, 0), 1),
        "c": t.motors(motor.c),
        "g": Sized(t.motors(motor.g), c.effort),
    }
    if t.joint_by_joint:
        answers |= {
            "G": t.motors(t.tangent(motor.motion.G)),
            "gamma": t.tangent(motor.motion.gamma),
        }
    # Of a platform with fewer freedoms the coordinates are other twists in another world.
    platform = stp.dynamics.motion_map(t.chain, q, v, coordinates="platform")
    basis = platform.coordinates.basis
    assert basis is not None
    twist = t.twists(basis @ platform.rate)
    answers |= {"platform twist": twist, "share": t.motors(platform.share @ platform.rate)}
    told = stp.operational_dynamics(t.chain, q, v, coordinates="platform")
    answers["kinetic energy"] = platform.rate @ told.M @ platform.rate
    if t.same_size:
        answers["power"] = platform.rate @ told.c
    return answers


@asks("joint_motor_map")
def joint_motor_map(t: Telling, c: Case) -> Answers:
    if not t.joint_by_joint:
        return {}
    q, v, _ = t.state(c.q, c.v)
    # Joints of one freedom have a rate of their own in every telling.
    names = [j.name for j in c.chain.mechanism.joints if j.has_axis][:3]
    found = stp.dynamics.joint_motor_map(t.chain, q, names, v)
    signs = np.array([t.joints[name].sign if name in t.joints else 1.0 for name in names])
    answers = {"J": signs[:, None] * t.motors(found.J), "bias": signs * found.bias}
    if found.inverse is not None:
        answers["inverse"] = t.motors(found.inverse, 0) * signs
    return answers
