"""The same mechanism described otherwise: cut at another joint, or in another unit of length."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import (
    Coupling,
    Joint,
    JointKind,
    Link,
    Loop,
    Mechanism,
    physics_coordinates,
)
from stewart_pin.model.joint_physics import JointPhysics

_TREE_ABLE = (JointKind.SPHERICAL, JointKind.REVOLUTE, JointKind.PRISMATIC, JointKind.FIXED)


def rebuild(
    chain: stp.ClosedChain, mechanism: Mechanism, gravity: np.ndarray | None = None
) -> stp.ClosedChain:
    """Build a chain from a rewritten description, with the motors and the platform of the old one."""
    return build_chain(
        mechanism,
        motors=chain.motors,
        platform=chain.platform,
        gravity=chain.gravity if gravity is None else gravity,
    )


def told_otherwise(own: JointPhysics, sign: float = 1.0, zero: float = 0.0) -> JointPhysics:
    """Tell physics along ``sign × x + zero``: forces and even powers of springs change their sign with the axis."""
    stiffness = tuple(k * sign**n for n, k in enumerate(own.stiffness))
    return replace(own, stiffness=stiffness, rest=sign * own.rest + zero * own.pushes, force=sign * own.force)


def _physics_in_other_unit(own: JointPhysics, k: float, *, length: bool) -> JointPhysics:
    """Tell physics by numbers of another unit: forces go with k, moments with k²."""
    x, effort = (k, k) if length else (1.0, k**2)
    return JointPhysics(
        armature=own.armature * effort / x,
        damping=own.damping * effort / x,
        friction=own.friction * effort,
        stiffness=tuple(c * effort / x ** (n + 1) for n, c in enumerate(own.stiffness)),
        rest=own.rest * x,
        force=own.force * effort,
    )


def _times(bound: float | tuple[float, float], factor: float) -> float | tuple[float, float]:
    return (bound[0] * factor, bound[1] * factor) if isinstance(bound, tuple) else bound * factor


# --- another unit of length ----------------------------------------------------------------------------------


def in_other_unit(chain: stp.ClosedChain, k: float) -> stp.ClosedChain:
    """Describe a chain with lengths k times the number: k = 1000 turns metres into millimetres, N into mN."""
    old = chain.described()

    def place(m: pin.SE3) -> pin.SE3:
        return pin.SE3(m.rotation, k * m.translation)

    def heavy(y: pin.Inertia | None) -> pin.Inertia | None:
        return None if y is None else pin.Inertia(y.mass, k * y.lever, k**2 * y.inertia)

    def joint(j: Joint) -> Joint:
        length = k if j.kind is JointKind.PRISMATIC else 1.0
        return replace(
            j,
            placement=place(j.placement),
            lower=j.lower * length,
            upper=j.upper * length,
            velocity=_times(j.velocity, length),
            effort=_times(j.effort, k if j.kind is JointKind.PRISMATIC else k**2),
            physics=_physics_in_other_unit(j.physics, k, length=j.kind is JointKind.PRISMATIC),
        )

    def loop(p: Loop) -> Loop:
        words = physics_coordinates(p.kind)
        physics = tuple(
            _physics_in_other_unit(own, k, length=word in ("length", "x", "y"))
            for word, own in zip(words, p.physics, strict=False)
        )
        ends = {"placement1": place(p.placement1), "placement2": place(p.placement2)}
        ratio = p.cable.ratio * k / unit(p.cable.reel)
        cable = replace(p.cable, ratio=ratio, radius=k * p.cable.radius)
        return replace(p, **ends, length=k * p.length, physics=physics, cable=cable)

    def unit(name: str | None) -> float:
        return k if name is not None and old.joint(name).kind is JointKind.PRISMATIC else 1.0

    def coupling(c: Coupling) -> Coupling:
        numbers = tuple(x * unit(c.joint1) / unit(c.joint2) ** n for n, x in enumerate(c.polynomial))
        others = tuple((name, ratio * unit(c.joint1) / unit(name)) for name, ratio in c.others)
        return replace(c, polynomial=numbers, others=others)

    mechanism = replace(
        old,
        links=tuple(replace(link, inertia=heavy(link.inertia)) for link in old.links),
        joints=tuple(joint(j) for j in old.joints),
        couplings=tuple(coupling(c) for c in old.couplings),
        loops=tuple(loop(p) for p in old.loops),
        home={name: _longer(old.joint(name).kind, value, k) for name, value in old.home.items()},
    )
    return rebuild(chain, mechanism, k * chain.gravity)


def configuration_in_other_unit(chain: stp.ClosedChain, q: np.ndarray, k: float) -> np.ndarray:
    """Translate a configuration."""
    q = q.copy()
    for name, joint in zip(chain.model.names[1:], chain.model.joints[1:], strict=True):
        part = slice(joint.idx_q, joint.idx_q + joint.nq)
        q[part] = _longer(chain.mechanism.joint(name).kind, q[part], k)
    return q


def tangent_unit(chain: stp.ClosedChain, k: float) -> np.ndarray:
    """Factor of every tangent entry."""
    return np.where(_is_length(chain), k, 1.0)


def effort_unit(chain: stp.ClosedChain, k: float) -> np.ndarray:
    """Factor of every motor effort: forces go with k, moments with k²."""
    return np.where(_is_length(chain), k, k**2)[chain.motor_index]


def _is_length(chain: stp.ClosedChain) -> np.ndarray:
    mask = np.zeros(chain.nv, dtype=bool)
    for name, joint in zip(chain.model.names[1:], chain.model.joints[1:], strict=True):
        kind = chain.mechanism.joint(name).kind
        if kind in (JointKind.PRISMATIC, JointKind.FLOATING):
            mask[joint.idx_v : joint.idx_v + (1 if kind is JointKind.PRISMATIC else 3)] = True
    return mask


def _longer(kind: JointKind, value: np.ndarray, k: float) -> np.ndarray:
    value = np.array(value, dtype=float)
    if kind is JointKind.PRISMATIC:
        value *= k
    if kind is JointKind.FLOATING:
        value[:3] *= k
    return value


# --- another cut ---------------------------------------------------------------------------------------------


def recut(chain: stp.ClosedChain) -> stp.ClosedChain | None:
    """Make the first loop that allows it a joint of the tree, and close the loop at a joint above it instead.

    Returns None for a robot without such a loop.
    """
    old = chain.described()
    parent = {joint.child: joint for joint in old.joints}
    coupled = {name for coupling in old.couplings for name in coupling.joints}
    for loop in old.loops:
        if loop.kind not in _TREE_ABLE:
            continue
        for below, above in ((2, 1), (1, 2)):
            link = getattr(loop, f"link{below}")
            carrier = getattr(loop, f"link{above}")
            cut = parent.get(link)
            if cut is None or cut.independent or cut.name in coupled or _hangs_on(parent, carrier, link):
                continue
            return _cut(chain, old, loop, below, cut)
    return None


def _hangs_on(parent: dict[str, Joint], link: str, root: str) -> bool:
    while link != root and link in parent:
        link = parent[link].parent
    return link == root


def _cut(chain: stp.ClosedChain, old: Mechanism, loop: Loop, below: int, cut: Joint) -> stp.ClosedChain:
    above = 3 - below
    link, carrier = getattr(loop, f"link{below}"), getattr(loop, f"link{above}")
    here, there = getattr(loop, f"placement{above}"), getattr(loop, f"placement{below}")
    # The loop's frame on `link` becomes a link of its own, without mass; `link` is fixed to it.
    hook = f"{link}_hook"
    # What the loop does by itself, the joint now does, and the other way round; seen from link 2, backwards.
    own = told_otherwise(loop.physics[0] if loop.physics else JointPhysics(), 1.0 if below == 2 else -1.0)
    hung = Joint(loop.name, loop.kind, carrier, hook, here, loop.axis, physics=own)
    fixed = Joint(f"{hook}_fixed", JointKind.FIXED, hook, link, there.inverse())
    joints = tuple(j for j in old.joints if j is not cut) + (hung, fixed)
    loops = tuple(p for p in old.loops if p is not loop)
    if cut.kind is not JointKind.FLOATING:  # a floating joint is no constraint
        loops += (
            Loop(
                cut.name, cut.kind, cut.parent, cut.child, cut.placement, pin.SE3.Identity(), cut.axis,
                physics=(cut.physics,) if cut.physics else (),
            ),
        )  # fmt: skip
    home = {name: value for name, value in old.home.items() if name != cut.name}
    home[loop.name] = _value(chain, chain.q_home, hung, carrier, hook, link, there)
    mechanism = replace(old, links=(*old.links, Link(hook)), joints=joints, loops=loops, home=home)
    return rebuild(chain, mechanism)


def _value(chain, q, joint: Joint, carrier: str, hook: str, link: str, there: pin.SE3) -> np.ndarray:
    relative = _frame(chain, q, carrier, joint.placement).inverse() * _frame(chain, q, link, there)
    match joint.kind:
        case JointKind.SPHERICAL:
            return pin.Quaternion(relative.rotation).coeffs()
        case JointKind.REVOLUTE:
            return np.array([joint.axis @ pin.log3(relative.rotation)])
        case JointKind.PRISMATIC:
            return np.array([joint.axis @ relative.translation])
        case _:
            return np.zeros(0)


def _frame(chain: stp.ClosedChain, q: np.ndarray, link: str, placement: pin.SE3) -> pin.SE3:
    data = pin.Data(chain.model)
    pin.framesForwardKinematics(chain.model, data, q)
    return data.oMf[chain.model.getFrameId(link, pin.FrameType.BODY)] * placement


def carry_over(
    chain: stp.ClosedChain, other: stp.ClosedChain, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Translate a state to the other cut: joints that both have keep their values, loops give the rest."""
    guess, link = other.q_home.copy(), chain.platform
    kept_v: list[int] = []
    v_other, a_other = np.zeros(other.nv), np.zeros(other.nv)
    for name, joint in zip(other.model.names[1:], other.model.joints[1:], strict=True):
        to_q, to_v = slice(joint.idx_q, joint.idx_q + joint.nq), slice(joint.idx_v, joint.idx_v + joint.nv)
        if chain.model.existJointName(name):
            same = chain.model.joints[chain.model.getJointId(name)]
            guess[to_q] = q[same.idx_q : same.idx_q + same.nq]
            v_other[to_v] = v[same.idx_v : same.idx_v + same.nv]
            a_other[to_v] = a[same.idx_v : same.idx_v + same.nv]
            kept_v += range(to_v.start, to_v.stop)
        else:
            hung = other.mechanism.joint(name)
            link = next(j.child for j in other.mechanism.joints if j.parent == hung.child)
            there = next(j.placement for j in other.mechanism.joints if j.parent == hung.child).inverse()
            guess[to_q] = _value(chain, q, hung, hung.parent, hung.child, link, there)
    q_other = stp.close_loops(other, guess).q
    # The link that hangs elsewhere moves as before: its twist and acceleration give those of its new joint.
    new = np.setdiff1d(np.arange(other.nv), kept_v)
    jacobian = _frame_jacobian(other, q_other, link)
    missing = _frame_motion(chain, q, v, a, link)[0] - jacobian @ v_other
    v_other[new] = np.linalg.lstsq(jacobian[:, new], missing, rcond=None)[0]
    missing = (
        _frame_motion(chain, q, v, a, link)[1] - _frame_motion(other, q_other, v_other, a_other, link)[1]
    )
    a_other[new] = np.linalg.lstsq(jacobian[:, new], missing, rcond=None)[0]
    return q_other, v_other, a_other


def _frame_jacobian(chain: stp.ClosedChain, q: np.ndarray, link: str) -> np.ndarray:
    axes, data = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED, pin.Data(chain.model)
    frame = chain.model.getFrameId(link, pin.FrameType.BODY)
    return pin.computeFrameJacobian(chain.model, data, q, frame, axes).reshape(6, -1)


def _frame_motion(chain: stp.ClosedChain, q, v, a, link: str) -> tuple[np.ndarray, np.ndarray]:
    axes, data = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED, pin.Data(chain.model)
    frame = chain.model.getFrameId(link, pin.FrameType.BODY)
    pin.forwardKinematics(chain.model, data, q, v, a)
    twist = pin.getFrameVelocity(chain.model, data, frame, axes).vector
    return twist, pin.getFrameClassicalAcceleration(chain.model, data, frame, axes).vector
