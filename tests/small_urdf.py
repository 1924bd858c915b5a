"""Pieces of URDF text for small robots, and the bundled files as text."""

from __future__ import annotations

from pathlib import Path

from stewart_pin.building.loading import urdf_root

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
ROD = (
    '<inertial><origin xyz="0.5 0 0"/><mass value="2"/>'
    '<inertia ixx="0.001" ixy="0" ixz="0" iyy="0.17" iyz="0" izz="0.17"/></inertial>'
)


def robot(*parts: str, attributes: str = "") -> str:
    return f'<robot name="small" {attributes}>{"".join(parts)}</robot>'


def link(name: str, content: str = INERTIAL) -> str:
    return f'<link name="{name}">{content}</link>'


def joint(
    name: str,
    parent: str,
    child: str,
    kind: str = "revolute",
    *,
    origin: str = "",
    axis: str = '<axis xyz="0 0 1"/>',
    attributes: str = "",
    content: str = "",
) -> str:
    placed = f"<origin {origin}/>" if origin else ""
    return (
        f'<joint name="{name}" type="{kind}" {attributes}>'
        f'<parent link="{parent}"/><child link="{child}"/>{placed}{axis}{content}</joint>'
    )


def loop(
    name: str, kind: str, link1: str, link2: str, *, origin1: str = "", origin2: str = "", content: str = ""
) -> str:
    ends = [
        f'<{tag} link="{link}">{f"<origin {origin}/>" if origin else ""}</{tag}>'
        for tag, link, origin in (("predecessor", link1, origin1), ("successor", link2, origin2))
    ]
    return f'<loop name="{name}" type="{kind}">{"".join(ends)}{content}</loop>'


def home(**values: str) -> str:
    """Write the home configuration of joints."""
    inner = "".join(f'<joint name="{name}" value="{value}"/>' for name, value in values.items())
    return f'<group_state name="home" group="all">{inner}</group_state>'


MOTOR = 'independent="true"'
AXIS_Z = '<axis xyz="0 0 1"/>'
ARM = (
    link("base"),
    link("arm"),
    link("platform"),
    joint("shoulder", "base", "arm", attributes=MOTOR),
    joint("elbow", "arm", "platform", origin='xyz="1 0 0"', attributes=MOTOR),
)
"""The smallest robot here: two motors and no loop."""

# Square of unit rods: crank and rocker stand up, the coupler lies on top; joint values at home are 90°, -90°, 90°.
FOUR_BAR = (
    link("base"),
    *(link(name, ROD) for name in ("crank", "platform", "rocker")),
    joint("crank_turn", "base", "crank", attributes=MOTOR),
    joint("coupler_turn", "crank", "platform", origin='xyz="1 0 0"'),
    joint("rocker_turn", "base", "rocker", origin='xyz="1 0 0"'),
)
CLOSED = loop(
    "hinge", "revolute", "platform", "rocker", origin1='xyz="1 0 0"', origin2='xyz="1 0 0"', content=AXIS_Z
)
SQUARE = {
    "crank_turn": "1.5707963267948966",
    "coupler_turn": "-1.5707963267948966",
    "rocker_turn": "1.5707963267948966",
}


def write(folder: Path, text: str, name: str = "small.urdf") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def bundled(name: str) -> Path:
    return urdf_root() / name / f"{name}.urdf"
