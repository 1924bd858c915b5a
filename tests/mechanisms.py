"""Small mechanisms built in code, each for what it shows: kinds of loops, redundant rows, idle freedoms, odd trees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import Coupling, Joint, JointKind, Link, Loop, Mechanism

X, Y, Z = np.eye(3)
ONE = pin.SE3.Identity()
R, P, S, F, FREE = (
    JointKind.REVOLUTE,
    JointKind.PRISMATIC,
    JointKind.SPHERICAL,
    JointKind.FIXED,
    JointKind.FLOATING,
)


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array([x, y, z]))


def turned(rng: np.random.Generator, size: float = 0.3) -> pin.SE3:
    """Random placement."""
    return pin.SE3(pin.exp3(rng.normal(size=3)), size * rng.normal(size=3))


def body(rng: np.random.Generator, mass: float = 1.0) -> pin.Inertia:
    """Random physical inertia: that of a cloud of particles."""
    points = 0.2 * rng.normal(size=(6, 3)) + 0.1 * rng.normal(size=3)
    total = pin.Inertia.Zero()
    for point in points:
        total += pin.Inertia(mass / len(points), point, np.zeros((3, 3)))
    return total


def rod(length: float, mass: float = 1.0) -> pin.Inertia:
    """Slender rod along x from the origin, thick enough to have inertia about its axis."""
    inertia = mass * length**2 / 12 * np.diag([1e-3, 1, 1])
    return pin.Inertia(mass, np.array([length / 2, 0, 0]), inertia + 1e-6 * np.eye(3))


def two_bodies(kind: JointKind, rng: np.random.Generator) -> stp.ClosedChain:
    """Hold a body on a ball joint on a driven sled, and a free body, together by a loop of any kind.

    The sled is the platform: all else is idle, so its motor holds the robot whatever the loop leaves free.
    """
    axis, axis2 = (x / np.linalg.norm(x) for x in rng.normal(size=(2, 3)))
    links = (
        Link("ground"),
        Link("sled", body(rng, 2.0)),
        Link("arm", body(rng)),
        Link("free", body(rng, 1.5)),
    )
    joints = (
        Joint("drive", P, "ground", "sled", turned(rng), axis2, independent=True),
        Joint("ball", S, "sled", "arm", turned(rng)),
        Joint("float", FREE, "ground", "free", ONE),
    )
    loop = Loop("loop", kind, "arm", "free", turned(rng), turned(rng), axis, axis2, length=0.4)
    return build_chain(Mechanism(str(kind), links, joints, (loop,), platform="sled"))


def four_bar(kind: JointKind = S, *, lengths=(0.3, 0.8, 0.6), ground: float = 0.9) -> stp.ClosedChain:
    """Planar four-bar about z, closed between coupler and rocker; a ball there has one redundant row, a hinge three."""
    crank, coupler, rocker = lengths
    links = (
        Link("ground"),
        Link("crank", rod(crank)),
        Link("coupler", rod(coupler)),
        Link("rocker", rod(rocker)),
    )
    joints = (
        Joint("crank_motor", R, "ground", "crank", ONE, independent=True),
        Joint("elbow", R, "crank", "coupler", at(crank)),
        Joint("rocker_hinge", R, "ground", "rocker", at(ground)),
    )
    loop = Loop("pin", kind, "coupler", "rocker", at(coupler), at(rocker))
    home = {"crank_motor": [1.0], "elbow": [-0.7], "rocker_hinge": [1.8]}
    return _near(Mechanism("four_bar", links, joints, (loop,), platform="coupler"), home)


def five_bar(
    motors: tuple[str, ...] = ("left_hip", "right_hip", "left_knee"), kind: JointKind = R
) -> stp.ClosedChain:
    """Planar five-bar about z: two freedoms, so the third motor is redundant."""
    links = (Link("ground"), *(Link(name, rod(0.4)) for name in ("left", "tip", "right", "far")))
    joints = (
        Joint("left_hip", R, "ground", "left", ONE),
        Joint("left_knee", R, "left", "tip", at(0.4)),
        Joint("right_hip", R, "ground", "right", at(0.5)),
        Joint("right_knee", R, "right", "far", at(0.4)),
    )
    loop = Loop("pin", kind, "tip", "far", at(0.4), at(0.4))
    home = {"left_hip": [2.0], "left_knee": [-1.2], "right_hip": [1.1], "right_knee": [1.2]}
    return _near(Mechanism("five_bar", links, joints, (loop,), platform="tip"), home, motors)


def gear_train(
    rng: np.random.Generator, *, driven: str = "pinion", differential: bool = False
) -> stp.ClosedChain:
    """Build two geared shafts on a swinging frame, and a screw whose nut slides on one of them.

    The wheel follows the pinion by a polynomial (a cam), the nut follows the wheel by a lead; the frame swings freely
    under its own motor. The joints between nut and wheel have no body in between on one side. A wheel of a
    differential follows a sum of three joints.
    """
    links = (
        Link("ground"),
        Link("frame", body(rng, 2.0)),
        Link("pinion", body(rng)),
        Link("wheel", body(rng, 1.5)),
        Link("shaft"),
        Link("nut", body(rng)),
    )
    axes = [x / np.linalg.norm(x) for x in rng.normal(size=(4, 3))]
    joints = (
        Joint("swing", R, "ground", "frame", turned(rng), axes[0], independent=True),
        Joint("pinion", R, "frame", "pinion", turned(rng), axes[1], independent=driven == "pinion"),
        Joint("wheel", R, "frame", "wheel", turned(rng), axes[2], independent=driven == "wheel"),
        Joint("turn", R, "wheel", "shaft", turned(rng), axes[3], independent=driven == "turn"),
        Joint("slide", P, "shaft", "nut", ONE, axes[3]),
    )
    couplings = (
        Coupling("cam", "wheel", "pinion", (0.2, -0.4, 0.1, 0.05)),
        Coupling("belt", "turn", "wheel", (0.0, 3.0)),
        Coupling("thread", "slide", "turn", (0.1, 0.02)),
    )
    if differential:
        ratios = ("turn", -0.7), ("slide", 2.0)
        couplings += (Coupling("differential", "planet", "pinion", (0.3, 0.5, -0.2), ratios),)
        links += (Link("planet", body(rng)),)
        joints += (Joint("planet", R, "frame", "planet", turned(rng), axes[0]),)
    parts = Mechanism("gear_train", links, joints, couplings=couplings, platform="nut")
    return build_chain(parts)


def arm(rng: np.random.Generator, joints: int = 3, *, tool_inertia: bool = False) -> stp.ClosedChain:
    """Build a serial arm, every joint a motor; the platform is a tool frame, by default one without mass."""
    names = [f"link{k}" for k in range(1, joints + 1)]
    links = (
        Link("ground"),
        *(Link(name, body(rng)) for name in names),
        Link("tool", body(rng) if tool_inertia else None),
    )
    tree = tuple(
        Joint(f"joint{k}", R, parent, child, turned(rng), axis / np.linalg.norm(axis), independent=True)
        for k, (parent, child, axis) in enumerate(
            zip(["ground", *names], names, rng.normal(size=(joints, 3)), strict=False), start=1
        )
    )
    tool = Joint("tool_fixed", F, names[-1], "tool", turned(rng))
    return build_chain(Mechanism("arm", links, (*tree, tool), platform="tool"))


def rotary_hexapod() -> stp.ClosedChain:
    """Build a platform on six driven cranks and six rods with balls at both ends, which may spin: six idle freedoms."""
    crank, rod_length, height = 0.12, 0.45, 0.4
    links = [Link("ground"), Link("platform", pin.Inertia(3.0, np.zeros(3), np.diag([0.05, 0.05, 0.08])))]
    joints = [Joint("pose", FREE, "ground", "platform", ONE)]
    loops, home = [], {"pose": [0, 0, height, 0, 0, 0, 1]}
    for k in range(6):
        # Feet and heads in pairs, the pairs of heads turned by 60° against those of the feet.
        foot_angle = 2 * np.pi * (k // 2) / 3 + (0.25 if k % 2 else -0.25)
        head_angle = 2 * np.pi * (k // 2) / 3 + (np.pi / 3 - 0.2 if k % 2 else -np.pi / 3 + 0.2)
        foot = 0.3 * np.array([np.cos(foot_angle), np.sin(foot_angle), 0])
        head = 0.2 * np.array([np.cos(head_angle), np.sin(head_angle), 0])
        facing = pin.exp3(np.array([0, 0, foot_angle + (np.pi / 2 if k % 2 else -np.pi / 2)]))
        links += [Link(f"crank{k}", rod(crank, 0.3)), Link(f"rod{k}", rod(rod_length, 0.2))]
        joints += [
            Joint(f"motor{k}", R, "ground", f"crank{k}", pin.SE3(facing, foot), Y, independent=True),
            Joint(f"elbow{k}", S, f"crank{k}", f"rod{k}", at(crank)),
        ]
        loops.append(Loop(f"ball{k}", S, "platform", f"rod{k}", pin.SE3(np.eye(3), head), at(rod_length)))
        elbow = foot + facing @ [crank, 0, 0]
        towards = facing.T @ (head + [0, 0, height] - elbow)
        towards /= np.linalg.norm(towards)
        home[f"elbow{k}"] = pin.Quaternion.FromTwoVectors(X, towards).coeffs()
        home[f"motor{k}"] = [0.0]
    motors = tuple(f"motor{k}" for k in range(6))
    parts = tuple(links), tuple(joints), tuple(loops)
    return _near(Mechanism("rotary_hexapod", *parts, platform="platform"), home, motors)


def _near(
    mechanism: Mechanism, home: dict[str, list[float]], motors: tuple[str, ...] | None = None
) -> stp.ClosedChain:
    """Build a chain from a home whose loops are only nearly closed."""
    bare = replace(mechanism, home={k: np.array(v) for k, v in home.items()}, loops=())
    tree = build_chain(bare, motors=motors or ("crank_motor",))
    chain = replace(tree, mechanism=replace(mechanism, home=bare.home))
    q = stp.close_loops(chain, tree.q_home).q
    closed = {
        name: q[joint.idx_q : joint.idx_q + joint.nq]
        for name, joint in zip(chain.model.names[1:], chain.model.joints[1:], strict=True)
    }
    return build_chain(replace(mechanism, home=closed), motors=motors)
