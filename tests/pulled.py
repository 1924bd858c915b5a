"""Platforms on massless legs that pull as cables do: a motor reads what is wound in, its effort is the tension."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import Joint, Link, Loop, Mechanism
from tests.mechanisms import FREE, ONE, P, R, S, X, Y, Z, at

WOUND = 10.0
"""Length of a leg at reading zero [m]."""


def spatial(
    base: np.ndarray,
    top: np.ndarray,
    pose: pin.SE3,
    *,
    mass: float = 10.0,
    efforts: tuple[float, float] = (1.0, 500.0),
) -> stp.ClosedChain:
    """Hold a platform by legs from base points (n, 3) to points (n, 3) of the platform, as many as there are."""
    links = [
        Link("ground"),
        Link("platform", pin.Inertia(mass, np.array([0.01, 0.02, -0.03]), np.diag([0.3, 0.4, 0.5]))),
    ]
    joints, loops = [Joint("pose", FREE, "ground", "platform", ONE)], []
    home = {"pose": pin.SE3ToXYZQUAT(pose)}
    for k, (foot, head) in enumerate(zip(base, top, strict=True)):
        along = pose.act(head) - foot
        # The legs' own z points inwards, so that their universal joints stand far from where these are singular.
        side = np.cross(along, [0.3, 0.5, 0.8])
        frame = np.array([np.cross(side, along), side, along]).T
        frame = frame / np.linalg.norm(frame, axis=0)
        links += [Link(f"cross{k}"), Link(f"drum{k}"), Link(f"cable{k}")]
        joints += [
            Joint(f"swing{k}", R, "ground", f"cross{k}", pin.SE3(frame, foot), X),
            Joint(f"tilt{k}", R, f"cross{k}", f"drum{k}", ONE, Y),
            Joint(f"winch{k}", P, f"drum{k}", f"cable{k}", at(z=WOUND), -Z, independent=True),
        ]
        home |= {f"winch{k}": np.array([WOUND - np.linalg.norm(along)])}
        loops.append(Loop(f"ball{k}", S, f"cable{k}", "platform", ONE, pin.SE3(np.eye(3), head)))
    return _limited(
        Mechanism("pulled", tuple(links), tuple(joints), tuple(loops), platform="platform", home=home),
        efforts,
    )


def boxed(n: int = 8, **options) -> stp.ClosedChain:
    """Hang a plate in a frame by eight legs, from whose corners they cross over to it; n more, or fewer."""
    corners = np.array(
        [[x, y, z] for z in (0.0, 2.0) for x, y in ((-2, -1.5), (2, -1.5), (2, 1.5), (-2, 1.5))]
    )
    plate = np.array(
        [[x, y, z] for z in (0.15, -0.15) for x, y in ((-0.2, 0.3), (0.2, 0.3), (0.25, -0.2), (-0.25, -0.2))]
    )
    pose = pin.SE3(pin.exp3(np.array([0.03, -0.02, 0.1])), np.array([0.1, 0.05, 0.9]))
    return spatial(corners[:n], plate[:n], pose, **options)


def planar(
    base: Sequence[Sequence[float]],
    top: Sequence[Sequence[float]] | None = None,
    *,
    at_rest: tuple[float, float, float] = (0.0, 0.0, 0.0),
    mass: float = 2.0,
    efforts: tuple[float, float] = (0.0, 100.0),
    gravity: tuple[float, float, float] = (0.0, -9.81, 0.0),
) -> stp.ClosedChain:
    """Hold a platform in the x-y plane by legs from base points to its own; without these, a point that cannot turn."""
    links, joints, loops = (
        [Link("ground"), Link("sled"), Link("platform", pin.Inertia(mass, np.zeros(3), 0.1 * np.eye(3)))],
        [],
        [],
    )
    joints = [Joint("x", P, "ground", "sled", ONE, X)]
    if top is None:
        joints.append(Joint("y", P, "sled", "platform", ONE, Y))
    else:
        links.append(Link("cart"))
        joints += [Joint("y", P, "sled", "cart", ONE, Y), Joint("turn", R, "cart", "platform", ONE, Z)]
    home = {
        name: np.array([value])
        for name, value in zip(("x", "y", "turn"), at_rest, strict=True)
        if name != "turn" or top is not None
    }
    turn = pin.exp3(at_rest[2] * Z)
    for k, foot in enumerate(np.array(base, dtype=float)):
        head = np.zeros(3) if top is None else np.append(top[k], 0.0)
        along = (turn @ head)[:2] + at_rest[:2] - foot
        links += [Link(f"drum{k}"), Link(f"cable{k}")]
        joints += [
            Joint(f"swing{k}", R, "ground", f"drum{k}", at(*foot), Z),
            Joint(f"winch{k}", P, f"drum{k}", f"cable{k}", at(WOUND), -X, independent=True),
        ]
        home |= {
            f"swing{k}": np.array([np.arctan2(along[1], along[0])]),
            f"winch{k}": np.array([WOUND - np.linalg.norm(along)]),
        }
        loops.append(Loop(f"pin{k}", R, f"cable{k}", "platform", ONE, pin.SE3(np.eye(3), head), Z))
    mechanism = Mechanism(
        "pulled_flat", tuple(links), tuple(joints), tuple(loops), platform="platform", home=home
    )
    return _limited(mechanism, efforts, gravity)


def _limited(
    mechanism: Mechanism,
    efforts: tuple[float, float],
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81),
) -> stp.ClosedChain:
    chain = build_chain(mechanism, gravity=gravity)
    return stp.with_limits(chain, {motor: {"effort": efforts} for motor in chain.motors})
