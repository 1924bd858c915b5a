"""Mechanisms at configurations whose singularities are known in closed form, without looking at any Jacobian."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import Joint, JointKind, Link, Loop, Mechanism
from tests.mechanisms import FREE, ONE, P, R, X, Y, Z, at, rod


def at_angles(chain: stp.ClosedChain, **angles: float) -> np.ndarray:
    """Close a configuration that is nearly closed, with some joints at given values."""
    q = chain.q_home.copy()
    for name, value in angles.items():
        q[chain.model.joints[chain.model.getJointId(name)].idx_q] = value
    return stp.close_loops(chain, q).q


def three_upu(base: float, platform: float, height: float = 1.0) -> stp.ClosedChain:
    """Build a translational 3-UPU (Tsai): outer axes tangent to circles of these radii, inner ones parallel."""
    links = [Link("ground"), Link("platform", pin.Inertia(3.0, np.zeros(3), np.diag([0.05, 0.05, 0.08])))]
    joints = [Joint("pose", FREE, "ground", "platform", ONE)]
    loops, home = [], {"pose": np.array([0, 0, height, 0, 0, 0, 1.0])}
    for k in range(3):
        turn = pin.exp3(2 * np.pi / 3 * k * Z)
        lean = np.arctan2(platform - base, height)
        links += [Link(f"cross{k}"), Link(f"tube{k}", rod(0.2, 0.5)), Link(f"rod{k}", rod(0.2, 0.3))]
        joints += [
            Joint(f"outer{k}", R, "ground", f"cross{k}", pin.SE3(turn, turn @ [base, 0, 0]), Y),
            Joint(f"inner{k}", R, f"cross{k}", f"tube{k}", ONE, X),
            Joint(f"leg{k}", P, f"tube{k}", f"rod{k}", ONE, Z, independent=True),
        ]
        # The rod's inner axis is x; in the platform the outer axis is y of the leg's own turn.
        loops.append(
            Loop(
                f"joint{k}", JointKind.UNIVERSAL, f"rod{k}", "platform",
                ONE, pin.SE3(turn, turn @ [platform, 0, 0]), X, Y,
            )
        )  # fmt: skip
        home |= {f"outer{k}": np.array([lean]), f"leg{k}": np.array([np.hypot(height, platform - base)])}
    parts = tuple(links), tuple(joints), tuple(loops)
    return build_chain(Mechanism("three_upu", *parts, platform="platform", home=home))


def in_line() -> stp.ClosedChain:
    """Build a five-bar in a vertical plane whose distal links lie in line at home: type II."""
    knee, far = np.array([-0.2, 0.6, 0.0]), np.array([0.2, 0.6, 0.0])
    links = (
        Link("ground"),
        Link("left", pin.Inertia(1.0, knee / 2, 0.01 * np.eye(3))),
        Link("tip", pin.Inertia(1.0, 0.25 * X, 0.01 * np.eye(3))),
        Link("right", pin.Inertia(1.0, far / 2, 0.01 * np.eye(3))),
        Link("other", pin.Inertia(1.0, -0.25 * X, 0.01 * np.eye(3))),
    )
    joints = (
        Joint("left_hip", R, "ground", "left", at(-0.3), Z, independent=True),
        Joint("left_knee", R, "left", "tip", pin.SE3(np.eye(3), knee), Z),
        Joint("right_hip", R, "ground", "right", at(0.3), Z, independent=True),
        Joint("right_knee", R, "right", "other", pin.SE3(np.eye(3), far), Z),
    )
    loop = Loop("pin", R, "tip", "other", at(0.5), at(-0.5), Z)
    return build_chain(
        Mechanism("in_line", links, joints, (loop,), platform="tip", gravity=np.array([0, -9.81, 0]))
    )


def moved(
    chain: stp.ClosedChain, x: float, y: float, z: float, guess: np.ndarray | None = None
) -> np.ndarray:
    """Place the platform, turned as at home."""
    turn = stp.platform_pose(chain, chain.q_home).rotation
    pose = pin.SE3(turn, np.array([x, y, z]))
    return stp.inverse_kinematics(chain, pose, q_guess=guess, limits=False).q


def at_pin(chain: stp.ClosedChain) -> stp.ClosedChain:
    """Put the platform of the five-bar of `tests.mechanisms` at its pin, on a link without mass."""
    old = chain.described()
    return build_chain(
        replace(
            old,
            links=(*old.links, Link("point")),
            joints=(*old.joints, Joint("point_fixed", JointKind.FIXED, "tip", "point", at(0.4))),
            platform="point",
        )
    )


def tilted(chain: stp.ClosedChain, turn: np.ndarray) -> stp.ClosedChain:
    """Turn a whole robot, its base included."""
    old, place = chain.described(), pin.SE3(turn, np.zeros(3))
    joints = tuple(
        replace(joint, placement=place * joint.placement) if joint.parent == old.root else joint
        for joint in old.joints
    )
    assert not old.loops  # the free bodies of closed chains would need their home turned as well
    return build_chain(replace(old, joints=joints))
