"""A judge of mobility that shares nothing with the package: joint screws, read from the file, closed by exponentials.

Every joint, those that close loops among them, has its own coordinates; a loop is six equations, that its screws add up
to nothing. The freedoms are the coordinates less the rank.

References
----------
.. [1] Murray, Li, Sastry, "A Mathematical Introduction to Robotic Manipulation", 1994, ch. 2 and 3.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import scipy.linalg

AXES = np.eye(3)


@dataclass(frozen=True)
class Screws:
    """Screws (v, ω) of every coordinate in the world at home, and which of them lie between the base and each link."""

    screws: np.ndarray
    above: dict[str, tuple[int, ...]]
    loops: tuple[tuple[str, tuple[int, ...], str], ...]
    gears: tuple[tuple[int, int, float], ...]
    motors: tuple[int, ...]

    @property
    def size(self) -> int:
        return len(self.screws)


def _numbers(element: ET.Element | None, key: str = "xyz") -> np.ndarray:
    return np.zeros(3) if element is None else np.array([float(x) for x in element.attrib[key].split()])


def _turn(axis: np.ndarray, point: np.ndarray) -> np.ndarray:
    return np.concatenate([np.cross(point, axis), axis])


def _slide(axis: np.ndarray) -> np.ndarray:
    return np.concatenate([axis, np.zeros(3)])


def _free(kind: str, point: np.ndarray, axis: np.ndarray, axis2: np.ndarray) -> list[np.ndarray]:
    ball = [_turn(x, point) for x in AXES]
    return {
        "fixed": [],
        "continuous": [_turn(axis, point)],
        "revolute": [_turn(axis, point)],
        "prismatic": [_slide(axis)],
        "cylindrical": [_slide(axis), _turn(axis, point)],
        "universal": [_turn(axis, point), _turn(axis2, point)],
        "spherical": ball,
        "floating": [*map(_slide, AXES), *ball],
    }[kind]


def _placed(element: ET.Element | None) -> np.ndarray:
    """Placement (4, 4) of an <origin>: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    T = np.eye(4)
    T[:3, 3] = _numbers(element)
    if element is not None and "rpy" in element.attrib:
        for axis, angle in zip(AXES[::-1], _numbers(element, "rpy")[::-1], strict=True):
            T[:3, :3] = T[:3, :3] @ scipy.linalg.expm(_hat(_turn(axis, np.zeros(3))) * angle)[:3, :3]
    return T


def _moved(kind: str, axis: np.ndarray, value: list[float]) -> np.ndarray:
    """Placement that a joint has at home; floating ones stand upright there."""
    if kind == "floating":
        assert value[3:] == [0, 0, 0, 1]
        return scipy.linalg.expm(_hat(_slide(np.array(value[:3]))))
    screw = _slide(axis) if kind == "prismatic" else _turn(axis, np.zeros(3))
    return scipy.linalg.expm(_hat(screw) * value[0])


@cache
def read(path: Path) -> Screws:
    """Read a file of the zoo."""
    root = ET.parse(path).getroot()
    home = {
        joint.attrib["name"]: [float(x) for x in joint.attrib["value"].split()]
        for joint in root.findall("group_state/joint")
    }
    place, above = {"base": np.eye(4)}, {"base": ()}
    screws: list[np.ndarray] = []
    number: dict[str, int] = {}
    motors, loops = [], []
    for joint in root.findall("joint"):
        parent, child = joint.find("parent").attrib["link"], joint.find("child").attrib["link"]
        kind, name, axis = joint.attrib["type"], joint.attrib["name"], _numbers(joint.find("axis"))
        stand = place[parent] @ _placed(joint.find("origin"))
        place[child] = stand @ (_moved(kind, axis, home[name]) if name in home else np.eye(4))
        free = _free(kind, place[child][:3, 3], stand[:3, :3] @ axis, np.zeros(3))
        number[name] = len(screws)
        motors += [len(screws)] if joint.get("independent") else []
        above[child] = (*above[parent], *range(len(screws), len(screws) + len(free)))
        screws += free
    for loop in root.findall("loop"):
        links = [loop.find(tag).attrib["link"] for tag in ("predecessor", "successor")]
        stand = place[links[0]] @ _placed(loop.find("predecessor/origin"))
        axes = (stand[:3, :3] @ _numbers(loop.find(tag)) for tag in ("axis", "axis2"))
        free = _free(loop.attrib["type"], stand[:3, 3], *axes)
        loops.append((links[0], tuple(range(len(screws), len(screws) + len(free))), links[1]))
        screws += free
    gears = [
        (
            number[gear.find("follower").attrib["joint"]],
            number[gear.find("leader").attrib["joint"]],
            float(gear.find("polynomial").attrib["value"].split()[1]),
        )
        for gear in root.findall("coupling")
    ]
    return Screws(np.array(screws).reshape(-1, 6), above, tuple(loops), tuple(gears), tuple(motors))


def _hat(screw: np.ndarray) -> np.ndarray:
    v, (x, y, z) = screw[:3], screw[3:]
    return np.array([[0, -z, y, v[0]], [z, 0, -x, v[1]], [-y, x, 0, v[2]], [0, 0, 0, 0]])


def _carried(T: np.ndarray, screw: np.ndarray) -> np.ndarray:
    w = T[:3, :3] @ screw[3:]
    return np.concatenate([T[:3, :3] @ screw[:3] + np.cross(T[:3, 3], w), w])


def _path(
    told: Screws, x: np.ndarray, indices: tuple[int, ...], start: np.ndarray
) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Displacement along a path of joints, and each of its screws where it has been carried."""
    T, columns = start, {}
    for i in indices:
        columns[i] = _carried(T, told.screws[i])
        T = T @ scipy.linalg.expm(_hat(told.screws[i]) * x[i])
    return T, columns


def equations(told: Screws, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far the loops are open at coordinates, and the rows of their rates."""
    gaps, rows = [], []
    for link1, free, link2 in told.loops:
        T1, columns1 = _path(told, x, (*told.above[link1], *free), np.eye(4))
        T2, columns2 = _path(told, x, told.above[link2], np.eye(4))
        between = np.real(scipy.linalg.logm(T1 @ np.linalg.inv(T2)))
        gaps.append([*between[:3, 3], between[2, 1], between[0, 2], between[1, 0]])
        block = np.zeros((6, told.size))
        for i, column in columns1.items():
            block[:, i] += column
        for i, column in columns2.items():
            block[:, i] -= column
        rows.append(block)
    for follower, leader, ratio in told.gears:
        row = np.zeros((1, told.size))
        row[0, follower], row[0, leader] = 1.0, -ratio
        gaps.append([x[follower] - ratio * x[leader]])
        rows.append(row)
    return np.concatenate(gaps), np.vstack(rows)


def move(told: Screws, rank: int, direction: np.ndarray, length: float = 0.3, steps: int = 12) -> np.ndarray:
    """Follow a direction along the closed configurations: a finite motion, if the loops can be closed on the way."""
    x = np.zeros(told.size)
    for _ in range(steps):
        vt = np.linalg.svd(equations(told, x)[1])[2]
        tangent = vt[rank:].T @ (vt[rank:] @ direction)
        x = x + length / steps * tangent / np.linalg.norm(tangent)
        for _ in range(8):
            gap, rows = equations(told, x)
            if np.abs(gap).max() < 1e-14:
                break
            u, s, vt = np.linalg.svd(rows)
            x = x - vt[:rank].T @ ((u[:, :rank].T @ gap) / s[:rank])
    return x
