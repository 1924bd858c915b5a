"""Write the bundled cable robots, frames of bars and a box on cables: ``python -m tests.zoo.make``. Metres, kilograms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from stewart_pin.building.exporting import write_urdf
from stewart_pin.model.loop_rows import orthonormal_triad
from stewart_pin.model.shapes import Material, Shape, ShapeKind

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
    ends = [(np.sign(x) * (0.25 if z < 1 else -0.25), np.sign(y) * 0.18, 0.15 if z < 1 else -0.15) for x, y, z in exits]
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


CABLE_ROBOTS: dict[str, Callable[[], stp.ClosedChain]] = {"cables_4": cables_4, "cables_8": cables_8}


def write_cable_robot(name: str, folder: Path) -> Path:
    """Write one as a robot's file in its folder."""
    path = folder / name / f"{name}.urdf"
    path.parent.mkdir(exist_ok=True)
    write_urdf(CABLE_ROBOTS[name](), path)
    return path
