"""Tell a bundled robot where its joints and bodies stand in the world at home; out comes a URDF with shapes and masses.

Where all joints are zero, every link frame stands parallel to the world, so that no frame in the tree is turned and
motors have coordinates that mean something: a leg its length, a crank its angle from level.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tests.zoo.telling import Y, Z, about, unit

STEEL, BLUE, ORANGE, GREEN = "0.55 0.57 0.6 1", "0.2 0.4 0.7 1", "0.9 0.5 0.15 1", "0.3 0.6 0.35 1"
"""Colours of the frame, of what motors drive, of what follows, and of the platform."""
Point = np.ndarray | tuple[float, float, float]


@dataclass
class Body:
    """A link: where its frame stands at home, and what it is made of, in the world."""

    origin: np.ndarray
    turn: np.ndarray
    mass: float = 0.0
    moment: np.ndarray = field(default_factory=lambda: np.zeros(3))  # mass times centre
    second: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))  # about the world's origin
    shapes: list[tuple[str, dict[str, str], np.ndarray, np.ndarray, str]] = field(default_factory=list)


def _text(*numbers: float) -> str:
    return " ".join(repr(round(float(x), 15) + 0.0) for x in numbers)


def _short(x: float) -> str:
    return f"{x + 0.0:.6g}"


def _about_point(mass: float, offset: np.ndarray) -> np.ndarray:
    return mass * (offset @ offset * np.eye(3) - np.outer(offset, offset))


def _rpy(turn: np.ndarray) -> np.ndarray:
    """Angles of R = Rz Ry Rx, not upright ones."""
    return np.array(
        [
            np.arctan2(turn[2, 1], turn[2, 2]),
            -np.arcsin(np.clip(turn[2, 0], -1, 1)),
            np.arctan2(turn[1, 0], turn[0, 0]),
        ]
    )


def along_z(axis: np.ndarray) -> np.ndarray:
    """Axes whose z lies along an axis."""
    z = unit(axis)
    x = unit(np.cross(Y, z)) if abs(z[1]) < 0.9 else unit(np.cross(z, [1.0, 0, 0]))
    return np.stack([x, np.cross(z, x), z], axis=1)


class RobotTelling:
    """A robot being told."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.bodies = {"base": Body(np.zeros(3), np.eye(3))}
        self.elements: list[ET.Element] = []
        self.home: list[tuple[str, np.ndarray]] = []

    # Joints ------------------------------------------------------------------------------------------

    def r(self, name: str, parent: str, child: str, point: Point, axis: Point, **options) -> None:
        """Hinge; `home` is its angle there, `motor` its effort and velocity, `range` what it is kept in."""
        self._joint(
            "revolute" if "range" in options else "continuous", name, parent, child, point, axis, **options
        )

    def p(self, name: str, parent: str, child: str, point: Point, axis: Point, **options) -> None:
        """Slide; at zero its child stands `home` behind the point."""
        self._joint("prismatic", name, parent, child, point, axis, **options)

    def ball(self, name: str, parent: str, child: str, point: Point, along: Point, first: Point) -> None:
        """Three hinges about one point: URDF has no ball in its tree. The last is the spin of a rod."""
        axes = {"swing": first, "tilt": np.cross(first, along), "spin": along}
        for end, axis in axes.items():
            link = child if end == "spin" else f"{child}_{end}"
            self.r(f"{name}_{end}", parent, link, point, axis)
            parent = link

    def u(self, name: str, parent: str, child: str, point: Point, axis1: Point, axis2: Point) -> None:
        self.r(f"{name}_swing", parent, f"{child}_cross", point, axis1)
        self.r(f"{name}_tilt", f"{child}_cross", child, point, axis2)

    def free(self, child: str, point: Point) -> None:
        """Let a body float that only loops hold."""
        self.bodies[child] = Body(np.asarray(point, dtype=float), np.eye(3))
        joint = ET.Element("joint", name=f"{child}_pose", type="floating")
        ET.SubElement(joint, "parent", link="base")
        ET.SubElement(joint, "child", link=child)
        self.elements.append(joint)
        self.home.append((f"{child}_pose", np.array([*np.asarray(point, dtype=float), 0, 0, 0, 1.0])))

    def frame(self, parent: str, child: str, point: Point) -> None:
        """Fix a frame on a body, parallel to the world at home."""
        body = self.bodies[parent]
        joint = self._begin("fixed", f"{child}_fixed", parent, child)
        self._origin(joint, body.turn.T @ (point - body.origin), body.turn.T)
        self.bodies[child] = Body(np.asarray(point, dtype=float), np.eye(3))

    def _begin(self, kind: str, name: str, parent: str, child: str) -> ET.Element:
        joint = ET.Element("joint", name=name, type=kind)
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=child)
        self.elements.append(joint)
        return joint

    def _joint(self, kind, name, parent, child, point, axis, *, home=0.0, motor=None, range=None) -> None:
        body, point, axis = self.bodies[parent], np.asarray(point, dtype=float), unit(axis)
        joint = self._begin(kind, name, parent, child)
        slide = kind == "prismatic"
        self._origin(joint, body.turn.T @ (point - (home * axis if slide else 0.0) - body.origin), np.eye(3))
        ET.SubElement(joint, "axis", xyz=_text(*(body.turn.T @ axis)))
        if motor is not None:
            joint.set("independent", "true")
        if range is not None:
            effort, velocity = motor or _WITHSTOOD
            numbers = {"effort": effort, "velocity": velocity, "lower": range[0], "upper": range[1]}
            ET.SubElement(joint, "limit", {key: _text(x) for key, x in numbers.items()})
        self.bodies[child] = Body(point, body.turn if slide else about(axis, home) @ body.turn)
        self.home.append((name, np.array([float(home)])))

    def close(
        self, name: str, link1: str, link2: str, point: Point, kind="spherical", axis=None, axis2=None
    ) -> None:
        """Close a loop; its axes are told in the world, along which its frames lie at home."""
        loop = ET.Element("loop", name=name, type=kind)
        for tag, link in (("predecessor", link1), ("successor", link2)):
            body = self.bodies[link]
            turn = np.eye(3) if kind == "spherical" else body.turn.T
            self._origin(
                ET.SubElement(loop, tag, link=link), body.turn.T @ (np.asarray(point) - body.origin), turn
            )
        for tag, direction in (("axis", axis), ("axis2", axis2)):
            if direction is not None:
                ET.SubElement(loop, tag, xyz=_text(*unit(direction)))
        self.elements.append(loop)

    @staticmethod
    def _origin(element: ET.Element, shift: np.ndarray, turn: np.ndarray) -> None:
        origin = {"xyz": _text(*shift)}
        if not np.allclose(turn, np.eye(3), atol=1e-15):
            origin["rpy"] = _text(*_rpy(turn))
        if origin != {"xyz": _text(0, 0, 0)}:
            ET.SubElement(element, "origin", origin)

    # Bodies ------------------------------------------------------------------------------------------

    def bar(self, link: str, a: Point, b: Point, radius: float, mass: float, colour: str = ORANGE) -> None:
        """Round bar between two points."""
        a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
        self.disc(link, (a + b) / 2, b - a, radius, float(np.linalg.norm(b - a)), mass, colour)

    def disc(self, link, centre, axis, radius, thickness, mass, colour=ORANGE) -> None:
        across = (3 * radius**2 + thickness**2) / 12
        moments = mass * np.array([across, across, radius**2 / 2])
        size = {"radius": _text(radius), "length": _text(thickness)}
        self._shape(link, "cylinder", size, centre, along_z(np.asarray(axis)), mass, moments, colour)

    def box(self, link, centre, size, mass, colour=ORANGE, turn=None) -> None:
        x, y, z = np.square(size)
        moments = mass / 12 * np.array([y + z, z + x, x + y])
        turn = np.eye(3) if turn is None else turn
        self._shape(link, "box", {"size": _text(*size)}, centre, turn, mass, moments, colour)

    def _shape(self, link, kind, size, centre, turn, mass, moments, colour) -> None:
        body, centre = self.bodies[link], np.asarray(centre, dtype=float)
        body.mass += mass
        body.moment = body.moment + mass * centre
        body.second = body.second + turn @ np.diag(moments) @ turn.T + _about_point(mass, centre)
        local = body.turn.T @ (centre - body.origin)
        body.shapes.append((kind, size, local, body.turn.T @ turn, colour))

    # Text --------------------------------------------------------------------------------------------

    def _link(self, name: str, body: Body) -> ET.Element:
        link = ET.Element("link", name=name)
        if body.mass:
            centre = body.moment / body.mass
            tensor = body.turn.T @ (body.second - _about_point(body.mass, centre)) @ body.turn
            inertial = ET.SubElement(link, "inertial")
            local = body.turn.T @ (centre - body.origin)
            ET.SubElement(inertial, "origin", xyz=" ".join(_short(round(x, 9)) for x in local))
            ET.SubElement(inertial, "mass", value=_short(body.mass))
            least = 1e-9 * np.abs(tensor).max()
            entries = {f"i{'xyz'[i]}{'xyz'[k]}": tensor[i, k] for i in range(3) for k in range(i, 3)}
            rounded = {key: _short(x if abs(x) > least else 0.0) for key, x in entries.items()}
            ET.SubElement(inertial, "inertia", rounded)
        for kind, size, shift, turn, colour in body.shapes:
            visual = ET.SubElement(link, "visual")
            place = {"xyz": " ".join(_short(round(x, 9)) for x in shift)}
            if not np.allclose(turn, np.eye(3), atol=1e-12):
                place["rpy"] = " ".join(_short(round(x, 9)) for x in _rpy(turn))
            ET.SubElement(visual, "origin", place)
            ET.SubElement(ET.SubElement(visual, "geometry"), kind, size)
            material = ET.SubElement(visual, "material", name=_COLOURS[colour])
            ET.SubElement(material, "color", rgba=colour)
        return link

    def text(self) -> str:
        robot = ET.Element("robot", name=self.name)
        robot.extend(self._link(name, body) for name, body in self.bodies.items())
        robot.extend(self.elements)
        group = ET.SubElement(robot, "group_state", name="home", group="all")
        for name, value in self.home:
            ET.SubElement(group, "joint", name=name, value=_text(*value))
        ET.indent(robot)
        return f"<?xml version='1.0' encoding='utf-8'?>\n{ET.tostring(robot, 'unicode')}\n"

    def write(self, folder: Path) -> None:
        path = folder / self.name / f"{self.name}.urdf"
        path.parent.mkdir(exist_ok=True)
        path.write_text(self.text(), encoding="utf-8")


_WITHSTOOD = (1e4, 100.0)
"""Effort and velocity of joints without a motor, of which URDF wants to hear: more than any of these robots has."""
_COLOURS = {STEEL: "steel", BLUE: "blue", ORANGE: "orange", GREEN: "green"}


def leg_axes(foot: np.ndarray, head: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Answer the axes of a universal joint: level and around the robot, then at right angles to it and the leg."""
    outer = unit(np.cross(Z, foot))
    return outer, unit(np.cross(outer, head - foot))
