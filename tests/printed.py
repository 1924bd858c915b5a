"""The same mechanism in another file: its frames turned so that every number has digits, and few of them printed."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import Joint, JointKind, Link
from tests.small_usd import as_others_see_it

_NUMBER = re.compile(r"-?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?")
_PLACES = {
    ".urdf": re.compile(r'((?:xyz|rpy|pos|quat|axis|anchor|relpose)=")([^"]*)'),
    ".sdf": re.compile(r"(<(?:pose|xyz)(?: [^>]*)?>)([^<]*)"),
    ".usda": re.compile(
        r"((?:xformOp:(?:orient|translate)|physics:local(?:Pos|Rot)[01]|stewart_pin:(?:frame|place|axis)\w*) = )(.*)"
    ),
    ".yaml": re.compile(r"()(-?\d+\.\d+(?:e[-+]?\d+)?)"),
}
_PLACES[".xml"] = _PLACES[".urdf"]


def turned_frames(chain: stp.ClosedChain, seed: int, *, slide: float = 0.0) -> stp.ClosedChain:
    """Turn the frame of every moving link, and slide it along its axis; home has to be zero, and is again."""
    rng, old = np.random.default_rng(seed), chain.described()
    turn = {link.name: pin.SE3(Rotation.random(rng=rng).as_matrix(), np.zeros(3)) for link in old.links}
    turn[old.root] = pin.SE3.Identity()
    for joint in old.joints:
        if joint.kind is JointKind.REVOLUTE:
            turn[joint.child].translation = slide * rng.uniform(0.5, 1.0) * np.asarray(joint.axis)
    along = [pin.SE3(np.eye(3), slide * np.asarray(loop.axis)) for loop in old.loops]
    mechanism = replace(
        old,
        links=tuple(
            link if link.inertia is None else replace(link, inertia=turn[link.name].actInv(link.inertia))
            for link in old.links
        ),
        joints=tuple(
            replace(
                joint,
                placement=turn[joint.parent].inverse() * joint.placement * turn[joint.child],
                axis=turn[joint.child].rotation.T @ joint.axis,
            )
            for joint in old.joints
        ),
        loops=tuple(
            replace(
                loop,
                placement1=turn[loop.link1].inverse() * loop.placement1 * shift,
                placement2=turn[loop.link2].inverse() * loop.placement2 * shift,
            )
            for loop, shift in zip(old.loops, along, strict=True)
        ),
        home={},
    )
    return build_chain(mechanism, motors=chain.motors, platform=chain.platform, gravity=chain.gravity)


def round_places(path: Path, style: str) -> None:
    """Print the numbers of a file that place something in a style: ``"6f"`` six decimals, ``"6g"`` six digits."""

    def shorter(found: re.Match[str]) -> str:
        return f"{float(found[0]):.{style}}"

    text = _PLACES[path.suffix].sub(lambda found: found[1] + _NUMBER.sub(shorter, found[2]), path.read_text())
    path.write_text(text)


def half_unit(style: str) -> float:
    """How far a number below ten is from what was meant, at most."""
    decimals = int(style[:-1]) - (style[-1] == "g")
    return 0.5 * 10.0**-decimals


def on_kinematic_bodies(chain: stp.ClosedChain, folder: Path) -> tuple[stp.ClosedChain, Path]:
    """Put each joint of the ground on a body of its own that stands still, askew in the world; write it as OpenUSD."""
    old, rng = chain.described(), np.random.default_rng(0)
    world = pin.SE3(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3))
    posts: list[Joint] = []

    def post(placement: pin.SE3) -> str:
        name = f"post_{len(posts)}"
        posts.append(Joint(f"hold_{name}", JointKind.FIXED, old.root, name, world * placement))
        return name

    one = pin.SE3.Identity()
    joints = [
        replace(joint, parent=post(joint.placement), placement=one) if joint.parent == old.root else joint
        for joint in old.joints
    ]
    bodies = tuple(Link(joint.child, pin.Inertia.FromSphere(1.0, 0.1)) for joint in posts)
    mechanism = replace(old, links=(*old.links, *bodies), joints=(*posts, *joints))
    exact = build_chain(mechanism, motors=chain.motors, platform=chain.platform, gravity=chain.gravity)
    stp.export(exact, folder / "posts.usda", format="usd")
    path = as_others_see_it(folder / "posts.usda")
    text = re.sub(r'\n +def PhysicsFixedJoint "hold_post_\d+"[^{]*\{[^}]*\}\n', "\n", path.read_text())
    still = r"\1\n        bool physics:kinematicEnabled = 1"
    path.write_text(re.sub(r'(def Xform "post_\d+"[^{]*\{)', still, text))
    return exact, path
