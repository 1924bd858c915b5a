"""Chains made of a chain, and files."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from tests.retelling.case import Case
from tests.retelling.telling import Telling
from tests.retelling.verbs.asking import Answers, Sized, asks


def _holds(t: Telling, c: Case, other: stp.ClosedChain, note: str) -> Answers:
    """Ask what a chain that was made of a told one needs to hold still: the efforts of all its masses."""
    q = stp.close_loops(other, t.state(c.near)[0]).q
    rest = np.zeros(other.nv)
    return {note: Sized(t.motors(stp.inverse_dynamics(other, q, rest, rest).tau_motor), c.effort)}


@asks("attach_payload", "with_motors", "with_platform")
def other_chains(t: Telling, c: Case) -> Answers:
    mass = sum(body.mass for body in c.chain.model.inertias)
    L = c.chain.length_scale
    box = pin.Inertia(mass, L * np.array([0.1, 0.2, 0.05]), 0.01 * mass * L**2 * np.eye(3))
    answers = _holds(t, c, stp.attach_payload(t.chain, box), "payload")
    reversed_motors = stp.with_motors(t.chain, t.chain.motors[::-1])
    q = t.state(c.near)[0]
    answers["motors"] = t.positions(stp.motor_positions(reversed_motors, q)[::-1])
    place = pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.3])), L * np.array([0.1, 0, 0.2]))
    other = stp.with_platform(t.chain, t.chain.platform, placement=place, name="tip")
    return answers | {"tip": t.pose(stp.platform_pose(other, t.state(c.near)[0]))}


@asks("massless_legs")
def massless_legs(t: Telling, c: Case) -> Answers:
    answers: Answers = {}
    for point in (False, True):
        other = stp.massless_legs(t.chain, point_platform=point)
        answers |= _holds(t, c, other, f"point {point}")
    return answers


@asks("replace_inertias")
def replace_inertias(t: Telling, c: Case) -> Answers:
    # The platform's frame is told as it is.
    body = t.chain.mechanism.link(t.chain.platform).inertia
    if body is None:
        return {}
    heavy = pin.Inertia(2 * body.mass, body.lever, 2 * body.inertia)
    return _holds(t, c, stp.build.replace_inertias(t.chain, {t.chain.platform: heavy}), "heavy")


@asks("lock_joints")
def lock_joints(t: Telling, c: Case) -> Answers:
    if not t.joint_by_joint:
        return {}
    name = c.chain.motors[0]
    locked = stp.lock_joints(t.chain, [name], t.state(c.near)[0])
    rest = np.zeros(locked.nv)
    if not locked.nu:
        return {"dof": stp.mobility(locked).dof}
    tau = stp.inverse_dynamics(locked, locked.q_home, rest, rest).tau_motor
    by_name = dict(zip(locked.motors, tau, strict=True))
    left = [(k, motor) for k, motor in enumerate(c.chain.motors) if motor != name]
    return {"efforts": Sized(np.array([t.signs[k] * by_name[motor] for k, motor in left]), c.effort)}


@asks("loops_by_balls")
def loops_by_balls(t: Telling, c: Case) -> Answers:
    return _holds(t, c, stp.build.loops_by_balls(t.chain), "balls")


@asks("on_floating_base")
def on_floating_base(t: Telling, c: Case) -> Answers:
    mass, L = sum(body.mass for body in c.chain.model.inertias), c.chain.length_scale
    if t.chain.mechanism.root != c.chain.mechanism.root:
        return {}  # what is given to the ground link comes on top of what the base weighs
    # A ball about the origin of the plain world; the base's frame is the told one.
    base = pin.Inertia(mass, np.zeros(3), mass * L**2 * np.eye(3)).se3Action(t.world)
    free = stp.on_floating_base(t.chain, base)
    q = np.concatenate([free.q_home[:7], t.state(c.near)[0]])
    v = np.zeros(free.nv)
    a = stp.forward_dynamics(free, q, v, t.efforts(c.tau_motor)).a[6:]
    return {"motors": t.motors(a[t.chain.motor_index])}


@asks("write_urdf", "export")
def export(t: Telling, c: Case) -> Answers:
    answers: Answers = {}
    with TemporaryDirectory() as folder:
        for format in ("urdf+", "drake", "isaac", "gepetto", "mjcf"):
            path = Path(folder) / f"again.{'xml' if format == 'mjcf' else 'urdf'}"
            try:
                stp.export(t.chain, path, format=format)
            except stp.errors.UnsupportedError:
                continue  # the told one may have other loops
            again = stp.load(path)
            assert again.motors == t.chain.motors
            answers |= _holds(t, c, again, format)
    return answers
