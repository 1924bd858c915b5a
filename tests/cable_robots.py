"""Cable robots for tests: boxes on cables in frames of bars, and mechanisms whose pulleys move. Metres, kilograms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import Cable, JointKind, Loop
from stewart_pin.model.loop_rows import orthonormal_triad
from stewart_pin.model.shapes import Material, Shape, ShapeKind
from stewart_pin.state.cable_paths import cable_paths

STEEL, GREEN = Material(rgba=(0.55, 0.57, 0.6, 1.0)), Material(rgba=(0.17, 0.55, 0.24, 1.0))


def _box(mass: float, size: Sequence[float]) -> pin.Inertia:
    x, y, z = np.square(size)
    moments = mass / 12 * np.array([y + z, x + z, x + y])
    return pin.Inertia(mass, np.zeros(3), np.diag([float(f"{m:.6g}") for m in moments]))


def _bar(a: np.ndarray, b: np.ndarray, radius: float) -> Shape:
    along = b - a
    length = float(np.linalg.norm(along))
    normal, x, y = orthonormal_triad(along / length)
    placement = pin.SE3(np.column_stack([x, y, normal]), (a + b) / 2)
    return Shape(ShapeKind.CYLINDER, (radius, length), placement, material=STEEL)


def _dressed(chain: stp.ClosedChain, bars: Sequence[Shape], size: Sequence[float]) -> stp.ClosedChain:
    shapes = {
        "base": tuple(bars),
        "platform": (Shape(ShapeKind.BOX, tuple(size), pin.SE3.Identity(), material=GREEN),),
    }
    mechanism = chain.mechanism
    links = tuple(replace(link, visuals=shapes.get(link.name, ())) for link in mechanism.links)
    return replace(chain, mechanism=replace(mechanism, links=links))


def cables_8() -> stp.ClosedChain:
    """Eight cables over pulleys from the corners of a frame; those from above hold the box on its far side."""
    exits = np.array([(x, y, z) for z in (0.2, 2.6) for x in (-2.0, 2.0) for y in (-1.5, 1.5)])
    ends = [
        (np.sign(x) * (0.25 if z < 1 else -0.25), np.sign(y) * 0.18, 0.15 if z < 1 else -0.15)
        for x, y, z in exits
    ]
    size = (0.5, 0.36, 0.3)
    chain = stp.cables.cable_robot(
        exits, ends, platform=_box(12.0, size), home=[0, 0, 1.3, 0, 0, 0, 1], pulleys=0.05,
        tension=(20.0, 2500.0), lengths=(0.2, 6.0), speed=3.0, name="cables_8",
    )  # fmt: skip
    corners = exits.copy()
    corners[:, 2] = np.where(exits[:, 2] < 1, 0.0, 2.7)
    edges = [(i, j) for i in range(8) for j in range(i) if np.count_nonzero(corners[i] != corners[j]) == 1]
    return _dressed(chain, [_bar(corners[j], corners[i], 0.03) for i, j in edges], size)


def cables_4() -> stp.ClosedChain:
    """Four cables from points in the corners of an upright rectangle; crossed, so that they turn the plate too."""
    exits = np.array([(0.0, 0.0), (3.0, 0.0), (3.0, 2.0), (0.0, 2.0)])
    size = (0.3, 0.05, 0.2)
    chain = stp.cables.cable_robot(
        exits, [(-0.15, 0.1), (0.15, 0.1), (0.15, -0.1), (-0.15, -0.1)], platform=_box(4.0, size),
        home=[1.5, 1.0, 0.0], tension=(10.0, 600.0), lengths=(0.1, 4.0), speed=5.0, name="cables_4",
    )  # fmt: skip
    corners = np.insert(exits, 1, 0.0, axis=1)
    return _dressed(chain, [_bar(corners[k - 1], corners[k], 0.02) for k in range(4)], size)


def pulleys_that_move() -> stp.ClosedChain:
    """Put the eight cables, with their pulleys and drums, on the box, at an angle; drums turn."""
    plain = cables_8().described()
    tilted = np.array([0.6, 0.0, 0.8])
    joints = tuple(
        replace(joint, kind=JointKind.REVOLUTE, parent="platform", lower=-np.inf, upper=np.inf)
        if joint.independent
        else joint
        for joint in plain.joints
    )

    def turned_round(loop: Loop) -> Loop:
        cable = Cable(loop.cable.reel, 0.04, 0.03)
        apart = plain_home.actInv(np.array(loop.placement1.translation)) - loop.placement2.translation
        length = cable_paths(apart[None], tilted[None], np.array([0.03])).length[0]
        return replace(
            loop, link1="platform", link2="base", placement1=loop.placement2, placement2=loop.placement1,
            axis=tilted, length=float(length), cable=cable,
        )  # fmt: skip

    plain_home = pin.XYZQUATToSE3(plain.home["platform_pose"])
    loops = tuple(turned_round(loop) for loop in plain.loops)
    return build_chain(replace(plain, name="pulleys_that_move", joints=joints, loops=loops))


def cables_on_drums() -> stp.ClosedChain:
    """Wind the eight cables onto drums of 8 mm, which turn seventeen times for 0.85 m."""
    plain = cables_8().described()
    joints = tuple(
        replace(joint, kind=JointKind.REVOLUTE, lower=-np.inf, upper=np.inf) if joint.independent else joint
        for joint in plain.joints
    )
    loops = tuple(replace(loop, cable=replace(loop.cable, ratio=0.008)) for loop in plain.loops)
    return build_chain(replace(plain, name="cables_on_drums", joints=joints, loops=loops))


CABLE_ROBOTS: dict[str, Callable[[], stp.ClosedChain]] = {
    "cables_4": cables_4,
    "cables_8": cables_8,
    "pulleys_that_move": pulleys_that_move,
    "cables_on_drums": cables_on_drums,
}
