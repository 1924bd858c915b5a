"""Platforms on legs of many kinds, for kernels in platform coordinates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import Joint, JointKind, Link, Loop, Mechanism
from tests import mechanisms
from tests.closed_states import robot
from tests.mechanisms import FREE, ONE, F, P, R, S, X, Y, Z, at, body, rod
from tests.rewritten import recut


def delta(*, ball_elbows: bool = True, shifts: tuple[float, ...] = (0.06, -0.06)) -> stp.ClosedChain:
    """Build a delta robot: three cranks with two or more parallel rods each, so that the platform only shifts."""
    crank, length = 0.2, 0.5
    links = [
        Link("ground"),
        Link("platform", pin.Inertia(0.8, np.array([0, 0, 0.01]), np.diag([2, 2, 3]) * 1e-3)),
    ]
    joints, loops = [Joint("pose", FREE, "ground", "platform", ONE)], []
    home: dict[str, object] = {"pose": [0, 0, -0.42, 0, 0, 0, 1]}
    for k in range(3):
        out = pin.exp3(np.array([0, 0, 2 * np.pi * k / 3]))
        links.append(Link(f"crank{k}", rod(crank, 0.3)))
        base = pin.SE3(out, out @ [0.15, 0, 0])
        joints.append(Joint(f"motor{k}", R, "ground", f"crank{k}", base, Y, independent=True))
        home[f"motor{k}"] = [0.2]
        for side, shift in zip("abc", shifts, strict=False):
            name = f"{k}{side}"
            links.append(Link(f"rod{name}", rod(length, 0.1)))
            elbow = at(crank, shift)
            towards = out @ [0.05, shift, 0] + [0, 0, -0.42] - base.act(pin.exp3(0.2 * Y) @ elbow.translation)
            local = pin.exp3(-0.2 * Y) @ out.T @ towards / np.linalg.norm(towards)
            if ball_elbows:
                joints.append(Joint(f"elbow{name}", S, f"crank{k}", f"rod{name}", elbow))
                home[f"elbow{name}"] = pin.Quaternion.FromTwoVectors(X, local).coeffs()
            else:
                # Hinges about the crank's y and then z: the rod stands along x.
                links.append(Link(f"cross{name}"))
                joints.append(Joint(f"elbow{name}", R, f"crank{k}", f"cross{name}", elbow, Y))
                joints.append(Joint(f"swing{name}", R, f"cross{name}", f"rod{name}", ONE, Z))
                home[f"elbow{name}"] = [np.arctan2(-local[2], local[0])]
                home[f"swing{name}"] = [np.arcsin(local[1])]
            head = pin.SE3(np.eye(3), out @ [0.05, shift, 0])
            loops.append(Loop(f"ball{name}", S, "platform", f"rod{name}", head, at(length)))
    parts = tuple(links), tuple(joints), tuple(loops)
    motors = tuple(f"motor{k}" for k in range(3))
    return mechanisms._near(Mechanism("delta", *parts, platform="platform"), home, motors)


def rails() -> stp.ClosedChain:
    """Build a platform on six rods with universal joints on vertical rails, the platform frame off its body."""
    rng = np.random.default_rng(11)
    links = [Link("ground"), Link("plate", body(rng, 4.0)), Link("platform")]
    off = pin.SE3(pin.exp3(np.array([0.1, -0.2, 0.3])), np.array([0.02, 0.01, 0.05]))
    joints = [
        Joint("pose", FREE, "ground", "plate", ONE),
        Joint("mark", F, "plate", "platform", off),
    ]
    loops, home = [], {"pose": [0, 0, 0.5, 0, 0, 0, 1]}
    for k in range(6):
        foot_angle = 2 * np.pi * (k // 2) / 3 + (0.3 if k % 2 else -0.3)
        head_angle = 2 * np.pi * (k // 2) / 3 + (0.8 if k % 2 else -0.8)
        foot = 0.5 * np.array([np.cos(foot_angle), np.sin(foot_angle), 0])
        head = 0.2 * np.array([np.cos(head_angle), np.sin(head_angle), 0.02 * k])
        links += [Link(f"cart{k}", body(rng, 0.5)), Link(f"cross{k}"), Link(f"rod{k}", body(rng, 0.3))]
        joints += [
            Joint(f"motor{k}", P, "ground", f"cart{k}", pin.SE3(np.eye(3), foot), Z, independent=True),
            Joint(f"swing{k}", R, f"cart{k}", f"cross{k}", ONE, X),
            Joint(f"tilt{k}", R, f"cross{k}", f"rod{k}", ONE, Y),
        ]
        towards = head - foot
        height = np.sqrt(0.6**2 - towards[0] ** 2 - towards[1] ** 2)
        home[f"motor{k}"] = [0.5 + head[2] - height]
        aim = np.array([towards[0], towards[1], height]) / 0.6
        home[f"swing{k}"] = [np.arctan2(-aim[1], aim[2])]
        home[f"tilt{k}"] = [np.arcsin(aim[0])]
        loops.append(Loop(f"ball{k}", S, f"rod{k}", "plate", at(z=0.6), pin.SE3(np.eye(3), head)))
    parts = tuple(links), tuple(joints), tuple(loops)
    motors = tuple(f"motor{k}" for k in range(6))
    return mechanisms._near(Mechanism("rails", *parts, platform="platform"), home, motors)


def hanging() -> stp.ClosedChain:
    """Hang the legs of a hexapod on its platform: balls there, and universal joints cut at the ground."""
    chain = robot("stewart_sps")
    old = chain.described()
    joints, loops, links, home = [], [], [], dict(old.home)
    for joint in old.joints:
        if joint.kind is JointKind.FLOATING:
            joints.append(joint)
    rng = np.random.default_rng(5)
    base, top = chain.leg_points()
    for k in range(6):
        links += [Link(f"rod{k}", body(rng, 0.7)), Link(f"tube{k}", body(rng, 0.9)), Link(f"cross{k}")]
        joints += [
            Joint(f"a{k}", R, "platform", f"cross{k}", pin.SE3(np.eye(3), top[k]), X),
            Joint(f"b{k}", R, f"cross{k}", f"rod{k}", ONE, Y),
            Joint(f"motor{k}", P, f"rod{k}", f"tube{k}", at(z=-0.1), Z, independent=True),
        ]
        pose = stp.platform_pose(chain, chain.q_home)
        aim = pose.actInv(base[k]) - top[k]
        length = np.linalg.norm(aim)
        aim = -aim / length
        home |= {
            f"a{k}": np.array([np.arctan2(-aim[1], aim[2])]),
            f"b{k}": np.array([np.arcsin(aim[0])]),
            f"motor{k}": np.array([0.3 - length]),
        }
        loops.append(Loop(f"ball{k}", S, f"tube{k}", old.root, at(z=-0.2), pin.SE3(np.eye(3), base[k])))
    kept = tuple(link for link in old.links if link.name in (old.root, "platform"))
    mechanism = Mechanism("hanging", (*kept, *links), tuple(joints), tuple(loops), platform="platform")
    values = {joint.name: home[joint.name] for joint in joints}
    return mechanisms._near(mechanism, values, tuple(f"motor{k}" for k in range(6)))


def skew_rods() -> stp.ClosedChain:
    """Describe the rods of six cranks in frames that stand askew to them: an idle spin then is no single coordinate."""
    old = mechanisms.rotary_hexapod().described()
    turn = pin.SE3(pin.exp3(np.array([0.4, -0.7, 0.5])), np.zeros(3))
    links = tuple(
        replace(link, inertia=turn.act(link.inertia)) if link.name.startswith("rod") else link
        for link in old.links
    )
    loops = tuple(replace(loop, placement2=turn * loop.placement2) for loop in old.loops)
    home = {
        name: pin.Quaternion(pin.Quaternion(value).matrix() @ turn.rotation.T).coeffs()
        if name.startswith("elbow")
        else value
        for name, value in old.home.items()
    }
    return build_chain(
        replace(old, links=links, loops=loops, home=home), motors=tuple(f"motor{k}" for k in range(6))
    )


def planar(first: JointKind) -> stp.ClosedChain:
    """Build a plate in the plane on three driven cranks or rails with hinged rods, the plane askew in space."""
    rng = np.random.default_rng(13)
    plane = pin.SE3(pin.exp3(np.array([0.3, -0.5, 0.2])), np.array([0.1, 0.2, 0.3]))
    links, joints = (
        [Link("ground"), Link("platform", body(rng, 2.0))],
        [Joint("pose", FREE, "ground", "platform", plane)],
    )
    loops, home = [], {"pose": [0, 0, 0, 0, 0, 0, 1]}
    for k in range(3):
        angle = 2 * np.pi * k / 3
        turn = pin.exp3(angle * Z)
        foot, head = turn @ [0.8, 0, 0], pin.exp3((angle + 0.7) * Z) @ [0.25, 0, 0]
        # A crank of 0.5 that stands across the spoke, or a cart on a rail that leans against the rod.
        elbow = foot + turn @ [0, 0.5, 0] if first is R else foot
        length = float(np.linalg.norm(head - elbow))
        towards = turn.T @ (head - elbow) / length
        links += [Link(f"crank{k}", body(rng, 0.4)), Link(f"rod{k}", body(rng, 0.3))]
        here = plane * pin.SE3(turn, foot)
        if first is R:
            joints.append(Joint(f"motor{k}", R, "ground", f"crank{k}", here, Z, independent=True))
            home[f"motor{k}"] = [np.pi / 2]
            home[f"hinge{k}"] = [np.arctan2(towards[1], towards[0]) - np.pi / 2]
        else:
            lean = np.array([np.sin(0.9), np.cos(0.9), 0.0])
            joints.append(Joint(f"motor{k}", P, "ground", f"crank{k}", here, lean, independent=True))
            home[f"motor{k}"] = [0.0]
            home[f"hinge{k}"] = [np.arctan2(towards[1], towards[0])]
        arm = at(0.5) if first is R else ONE
        joints.append(Joint(f"hinge{k}", R, f"crank{k}", f"rod{k}", arm, Z))
        loops.append(Loop(f"pin{k}", R, "platform", f"rod{k}", pin.SE3(np.eye(3), head), at(length), Z))
    parts = tuple(links), tuple(joints), tuple(loops)
    return mechanisms._near(
        Mechanism("planar", *parts, platform="platform"), home, ("motor0", "motor1", "motor2")
    )


def motor_to_spare() -> stp.ClosedChain:
    """Drive an elbow of a planar platform too: four motors share three freedoms by least norm."""
    return build_chain(planar(R).described(), motors=("motor0", "motor1", "motor2", "hinge0"))


def crossed_hinge() -> stp.ClosedChain:
    """End the legs of a hexapod, which turn about two axes, in a hinge, which no leg in closed form may do."""
    chain = hanging()
    old, data = chain.described(), pin.Data(chain.model)
    pin.forwardKinematics(chain.model, data, chain.q_home)
    turned = data.oMi[chain.model.getJointId("motor0")].rotation
    loop = old.loops[0]
    there = pin.SE3(turned, loop.placement2.translation)
    first = replace(loop, kind=JointKind.REVOLUTE, axis=X, placement2=there)
    motors = tuple(f"motor{k}" for k in range(1, 6))
    return build_chain(replace(old, loops=(first, *old.loops[1:])), motors=motors)


def other_cut(name: str) -> stp.ClosedChain:
    """Cut a robot elsewhere, so that a joint of one leg carries the platform."""
    other = recut(robot(name))
    assert other is not None
    return other


PLATFORMS = {
    **{
        name: lambda name=name: robot(name)
        for name in ("stewart", "stewart_sps", "stewart_cad", "stewart_s1")
    },
    "six cranks": mechanisms.rotary_hexapod,
    "six cranks, rods askew": skew_rods,
    "six rails": rails,
    "legs on the platform": hanging,
    "ball in the tree": lambda: other_cut("stewart"),
    "ball in the tree, idle spins": lambda: other_cut("stewart_sps"),
    "3-RPR": lambda: robot("rpr_planar"),
    "3-RPR, hinge in the tree": lambda: other_cut("rpr_planar"),
    "3-RRR": lambda: planar(R),
    "3-PRR": lambda: planar(P),
    "3-RRR, motor to spare": motor_to_spare,
    "delta, balls": delta,
    "delta, hinges": lambda: delta(ball_elbows=False),
}
"""Chains that come apart into a platform and legs with closed forms."""
FEW_PLATFORMS = ("stewart", "legs on the platform", "3-RPR", "3-RRR, motor to spare")
"""Those that stand for the others in the quick tests."""
