"""Tell a mechanism where its joints stand in the world at home; out comes a small URDF.

Every joint is zero at home and every link frame stands parallel to the world at the joint that carries the link, so
that a loop closes to the round-off of a few differences whatever the mechanism.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

X, Y, Z = np.eye(3)


def xz(x: float, z: float) -> np.ndarray:
    """Place a point of a planar mechanism: it stands upright, hinged about y."""
    return np.array([x, 0.0, z])


def unit(x: np.ndarray) -> np.ndarray:
    return np.asarray(x) / np.linalg.norm(x)


def about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Turn about an axis (Rodrigues)."""
    x, y, z = unit(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def meet(p: np.ndarray, r: float, q: np.ndarray, s: float, side: float = 1.0) -> np.ndarray:
    """Cut two circles of the xz plane: on the left (side 1) or right (-1) of the way from p to q."""
    d = np.linalg.norm(q - p)
    u = (q - p) / d
    along = (d**2 + r**2 - s**2) / (2 * d)
    return p + along * u + side * np.sqrt(r**2 - along**2) * np.array([-u[2], 0, u[0]])


def _text(*numbers: float) -> str:
    return " ".join(repr(float(x) + 0.0) for x in numbers)


class Telling:
    """A mechanism being told: links, joints and loops, by points and axes in the world at home."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.origin: dict[str, np.ndarray] = {"base": np.zeros(3)}
        self.points: dict[str, list[np.ndarray]] = {}
        self.lines: list[str] = []
        self.moving: list[str] = []
        self.kinds: list[str] = []

    def _link(self, name: str, origin: np.ndarray, *, massless: bool = False) -> None:
        assert name not in self.origin, name
        self.origin[name] = origin
        self.points[name] = [] if massless else [origin]

    def _touch(self, link: str, point: np.ndarray) -> None:
        if self.points.get(link):
            self.points[link].append(point)

    def joint(self, kind, parent, child, point, axis=None, *, motor=False, massless=False) -> None:
        point = np.asarray(point, dtype=float)
        self._touch(parent, point)
        name = f"{child}_{'slide' if kind == 'prismatic' else 'turn'}"
        shift = point - self.origin[parent]
        self._link(child, point, massless=massless or kind == "fixed")
        written = "" if axis is None else f'<axis xyz="{_text(*unit(axis))}"/>'
        driven = ' independent="true"' if motor else ""
        self.lines.append(
            f'<joint name="{name}" type="{kind}"{driven}><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{_text(*shift)}"/>{written}{_LIMIT if kind == "prismatic" else ""}</joint>'
        )
        if kind not in ("fixed", "spherical"):
            self.moving.append(name)

    def r(self, parent, child, point, axis=Y, *, motor=False, massless=False) -> None:
        self.joint("continuous", parent, child, point, axis, motor=motor, massless=massless)

    def p(self, parent, child, point, axis, *, motor=False, massless=False) -> None:
        self.joint("prismatic", parent, child, point, axis, motor=motor, massless=massless)

    def s(self, parent, child, point) -> None:
        self.joint("spherical", parent, child, point)

    def u(self, parent, child, point, axis1, axis2, *, motor=False) -> None:
        self.r(parent, f"{child}_cross", point, axis1, motor=motor, massless=True)
        self.r(f"{child}_cross", child, point, axis2)

    def tip(self, body: str, point: np.ndarray) -> None:
        """Mark the platform: a frame on a body."""
        self.joint("fixed", body, "platform", point)

    def close(self, link1, link2, point, axis=Y, kind="revolute", axis2=None) -> None:
        ends = ""
        for tag, link in (("predecessor", link1), ("successor", link2)):
            self._touch(link, np.asarray(point))
            ends += f'<{tag} link="{link}"><origin xyz="{_text(*(point - self.origin[link]))}"/></{tag}>'
        axes = "" if kind == "spherical" else f'<axis xyz="{_text(*unit(axis))}"/>'
        axes += "" if axis2 is None else f'<axis2 xyz="{_text(*unit(axis2))}"/>'
        number = sum(line.startswith("<loop") for line in self.lines) + 1
        self.lines.append(f'<loop name="loop{number}" type="{kind}">{ends}{axes}</loop>')

    def gear(self, follower: str, leader: str, ratio: float) -> None:
        """Couple the joints above two links."""
        number = sum(line.startswith("<coupling") for line in self.lines) + 1
        above = {name.rsplit("_", 1)[0]: name for name in self.moving}
        self.lines.append(
            f'<coupling name="gear{number}" type="polynomial"><follower joint="{above[follower]}"/>'
            f'<leader joint="{above[leader]}"/><polynomial value="{_text(0.0, ratio)}"/></coupling>'
        )

    def text(self) -> str:
        links, number = ['<link name="base"/>'], 0
        for name, points in self.points.items():
            if not points:
                links.append(f'<link name="{name}"/>')
                continue
            number += 1
            mass = 1 + number / 10
            # Nothing is balanced: gravity works on every freedom, whatever stands symmetrically.
            centre = np.round(np.mean(points, axis=0) - self.origin[name] + [0.01, 0.02, 0.03], 6)
            inertia = "".join(
                f' {k}="{_text(round(mass * s, 6))}"'
                for k, s in (("ixx", 0.02), ("ixy", 0), ("ixz", 0), ("iyy", 0.03), ("iyz", 0), ("izz", 0.04))
            )
            links.append(
                f'<link name="{name}"><inertial><origin xyz="{_text(*centre)}"/><mass value="{_text(mass)}"/>'
                f"<inertia{inertia}/></inertial></link>"
            )
        home = "".join(f'<joint name="{name}" value="0"/>' for name in self.moving)
        group = f'<group_state name="home" group="all">{home}</group_state>'
        body = "\n".join(f"  {line}" for line in [*links, *self.lines, group])
        return f'<?xml version="1.0"?>\n<robot name="{self.name}">\n{body}\n</robot>\n'

    def write(self, folder: Path) -> None:
        (folder / f"{self.name}.urdf").write_text(self.text(), encoding="utf-8")


# The format wants a stroke for a slide; its half is the size of a mechanism that has no other length.
_LIMIT = '<limit lower="-2.0" upper="2.0" effort="1e+30" velocity="1e+30"/>'
