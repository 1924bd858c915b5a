"""Mechanisms of many loops, for tests and benchmarks: bundled robots put together, and scissors on scissors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import Joint, JointKind, Link, Loop, Mechanism


def joined(parts: Sequence[str], *, stacked: bool = False) -> stp.ClosedChain:
    """Put bundled robots side by side on one ground, or each on the platform of the one before."""
    links, joints, loops, home = [Link("ground")], [], [], {}
    carrier, platform = "ground", None
    for k, part in enumerate(parts):
        own, mark = stp.load(part).described(), f"{k}_"
        links += [replace(link, name=mark + link.name) for link in own.links]
        at = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.1] if stacked else [0.7 * k, 0.0, 0.0]))
        joints.append(Joint(f"{mark}stand", JointKind.FIXED, carrier, mark + own.root, at))
        joints += [
            replace(j, name=mark + j.name, parent=mark + j.parent, child=mark + j.child) for j in own.joints
        ]
        loops += [
            replace(loop, name=mark + loop.name, link1=mark + loop.link1, link2=mark + loop.link2)
            for loop in own.loops
        ]
        home |= {mark + joint: values for joint, values in own.home.items()}
        platform = mark + str(own.platform)
        carrier = platform if stacked else "ground"
    name = f"{len(parts)}_robots"
    return build_chain(
        Mechanism(name, tuple(links), tuple(joints), tuple(loops), platform=platform, home=home)
    )


def scissors(stages: int) -> stp.ClosedChain:
    """Crossed arms on crossed arms, every loop of which shares joints with its neighbours; the platform on top."""
    half, rise = 0.4, 0.6
    inertia = pin.Inertia(1.0, np.array([half, 0.0, 0.0]), np.diag([0.01, 0.1, 0.1]))
    x, y = np.eye(3)[0], np.array([0.0, -1.0, 0.0])

    def along(way: float) -> pin.SE3:
        return pin.SE3(np.eye(3), way * x)

    links = [Link("ground"), Link("foot", inertia)]
    joints = [Joint("drive", JointKind.PRISMATIC, "ground", "foot", along(0.0), x, independent=True)]
    loops, home = [], {"drive": np.array([2 * half * np.cos(rise)])}
    # Arm a rises from the left end to the right, b from the right to the left: the next left end is the tip of b.
    ends, turned = ("ground", "foot"), (0.0, 0.0)
    for k in range(stages):
        arms, turns = (f"a{k}", f"b{k}"), (rise, np.pi - rise)
        for arm, end, turn, before in zip(arms, ends, turns, turned, strict=True):
            links.append(Link(arm, inertia))
            place = along(2 * half if k else 0.0)
            joints.append(Joint(f"hinge_{arm}", JointKind.REVOLUTE, end, arm, place, y))
            home[f"hinge_{arm}"] = np.array([turn - before])
        loops.append(Loop(f"cross{k}", JointKind.SPHERICAL, *arms, along(half), along(half)))
        ends, turned = arms[::-1], turns[::-1]
    mechanism = Mechanism(
        f"{stages}_scissors", tuple(links), tuple(joints), tuple(loops), platform=ends[0], home=home
    )
    return build_chain(mechanism)
