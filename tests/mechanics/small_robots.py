"""Small robots for tests: planar platforms with any number of legs, and serial arms, written as URDF."""

from __future__ import annotations

from math import atan2, cos, pi, sin
from pathlib import Path

import stewart_pin as stp

_BODY = '<inertial><mass value="{m}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def planar_platform(
    folder: Path, legs: int, *, effort: float = 100.0, velocity: float = 0.5
) -> stp.ClosedChain:
    """Build a platform in the x-y plane on `legs` RPR legs: 3 hold it, more share the load."""
    parts = [_link("base", 1), _link("platform", 3), _joint("platform_pose", "floating", "base", "platform")]
    home, loops = ['<joint name="platform_pose" value="0 0 0 0 0 0 1"/>'], []
    for k in range(legs):
        turn = 2 * pi * k / legs + 0.2
        foot, head = (2 * cos(turn), 2 * sin(turn)), (0.5 * cos(turn + 0.6), 0.5 * sin(turn + 0.6))
        dx, dy = head[0] - foot[0], head[1] - foot[1]
        parts += [_link(f"lower{k}", 1), _link(f"upper{k}", 1)]
        parts.append(_joint(f"turn{k}", "revolute", "base", f"lower{k}", axis="0 0 1", xyz=f"{foot[0]} {foot[1]} 0",
                            limit='lower="-6" upper="6" effort="1e30" velocity="1e30"'))  # fmt: skip
        parts.append(_joint(f"leg{k}", "prismatic", f"lower{k}", f"upper{k}", axis="1 0 0", motor=True,
                            limit=f'lower="0.5" upper="3" effort="{effort}" velocity="{velocity}"'))  # fmt: skip
        loops.append(
            f'<loop name="pin{k}" type="revolute"><predecessor link="platform"><origin xyz="{head[0]} {head[1]} 0"/>'
            f'</predecessor><successor link="upper{k}"/><axis xyz="0 0 1"/></loop>'
        )
        home.append(f'<joint name="turn{k}" value="{atan2(dy, dx)}"/>')
        home.append(f'<joint name="leg{k}" value="{(dx**2 + dy**2) ** 0.5}"/>')
    return _load(folder, "planar", parts + loops, home)


def arm(folder: Path, axes: str, *, effort: float = 50.0, velocity: float = 1.0) -> stp.ClosedChain:
    """Build a serial arm of unequal links along x, one revolute joint for each letter of `axes`."""
    parts, home = [_link("base", 1)], []
    for k, letter in enumerate(axes):
        parent, child = ("base" if k == 0 else f"link{k}"), f"link{k + 1}"
        parts.append(_link(child, 1 + 0.1 * k))
        axis = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}[letter]
        limit = (
            f'lower="-3" upper="3" effort="{effort * (1 + 0.3 * k)}" velocity="{velocity * (1 + 0.2 * k)}"'
        )
        parts.append(_joint(f"joint{k + 1}", "revolute", parent, child, axis=axis, motor=True, limit=limit,
                            xyz=f"{0.3 + 0.05 * k} 0 0"))  # fmt: skip
        home.append(f'<joint name="joint{k + 1}" value="{0.3 + 0.17 * k}"/>')
    parts += [_link("platform", 1), _joint("tool", "fixed", f"link{len(axes)}", "platform", xyz="0.2 0.1 0")]
    return _load(folder, "arm", parts, home)


def _link(name: str, mass: float) -> str:
    return f'<link name="{name}">{_BODY.format(m=mass)}</link>'


def _joint(name: str, kind: str, parent: str, child: str, *, axis: str = "", xyz: str = "0 0 0",
           limit: str = "", motor: bool = False) -> str:  # fmt: skip
    mark = ' independent="true"' if motor else ""
    inside = f'<axis xyz="{axis}"/><limit {limit}/>' if axis else ""
    return (
        f'<joint name="{name}" type="{kind}"{mark}><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/>{inside}</joint>'
    )


def _load(folder: Path, name: str, parts: list[str], home: list[str]) -> stp.ClosedChain:
    file = folder / f"{name}.urdf"
    state = f'<group_state name="home" group="all">{"".join(home)}</group_state>'
    file.write_text(f'<robot name="{name}">{"".join(parts)}{state}</robot>')
    return stp.load(file)
