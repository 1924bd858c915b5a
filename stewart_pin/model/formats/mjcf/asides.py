"""What an MJCF says besides MuJoCo's own model: shapes as they look, and words of ours in ``<custom>``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from stewart_pin.model.description import Span
from stewart_pin.model.formats.xml import UNLIMITED

PLATFORM = "platform"
"""Name of the ``<text>`` that names the platform, and of the platform where there is none."""
HOME, ASSEMBLED = "home", "assembled"
"""Name and data of the ``<text>`` that lets home stay where the keyframe has it."""
SPEED = "velocity:"
"""Begins the names of the ``<numeric>`` that hold speed limits, for which MuJoCo has no word."""
_GREY = (0.5, 0.5, 0.5, 1.0)


@dataclass(frozen=True)
class GeomSource:
    """What a compiled geom does not tell: the mesh that it stands for, and what it looks like.

    Attributes
    ----------
    mesh
        File of the mesh as the MJCF names it; empty: none.
    scale
        Scale of the mesh (dimensionless).
    folder
        Folder from which the paths of mesh and texture start.
    material
        Name of its material.
    rgba
        Its colour (dimensionless); None: MuJoCo's grey.
    texture
        Picture on it.
    left_out
        Why it is no shape of ours; empty: it is one.
    """

    mesh: str = ""
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    folder: str = ""
    material: str = ""
    rgba: tuple[float, float, float, float] | None = None
    texture: str = ""
    left_out: str = ""


@dataclass(frozen=True)
class Asides:
    """What a file says besides MuJoCo's own model.

    Attributes
    ----------
    geoms
        Source of every geom, by MuJoCo's number.
    platform
        Body or site that ``<text name="platform">`` names, else ``platform``.
    speeds
        Speed limits of joints, from ``<numeric name="velocity:JOINT">``, one number for both sides [m/s or rad/s].
    assembled
        Whether ``<text name="home" data="assembled">`` lets home stay where it is, whatever the limits say.
    """

    geoms: Mapping[int, GeomSource]
    platform: str
    speeds: Mapping[str, float | Span]
    assembled: bool = False


class AsideReader:
    """Keeps what the specification of a file says before it is stripped and compiled.

    Parameters
    ----------
    mujoco
        The package.
    spec
        ``mujoco.MjSpec``, not stripped yet.
    """

    def __init__(self, mujoco: Any, spec: Any) -> None:
        self.sources = [(geom, _geom_source(mujoco, spec, geom)) for geom in spec.geoms]
        self.texts = {text.name: str(text.data) for text in spec.texts}
        self.speeds = {
            number.name.removeprefix(SPEED): _speed(number.data)
            for number in spec.numerics
            if number.name.startswith(SPEED) and number.size in (1, 2)
        }

    def read(self) -> Asides:
        """Say what was kept, once the specification is compiled and its geoms are numbered.

        Returns
        -------
        Asides
            What the file says besides.
        """
        geoms = {int(geom.id): source for geom, source in self.sources}
        assembled = self.texts.get(HOME) == ASSEMBLED
        return Asides(geoms, self.texts.get(PLATFORM, PLATFORM), self.speeds, assembled)


def _geom_source(mujoco: Any, spec: Any, geom: Any) -> GeomSource:
    """Keep what a geom loses before it is compiled.

    Parameters
    ----------
    mujoco
        The package.
    spec
        ``mujoco.MjSpec``, not stripped yet.
    geom
        One of its geoms.

    Returns
    -------
    GeomSource
        Mesh, material and colour.
    """
    told = tuple(float(value) for value in geom.rgba)
    red, green, blue, opacity = told
    rgba = None if np.allclose(told, _GREY, rtol=0, atol=1e-6) else (red, green, blue, opacity)
    look = GeomSource(rgba=rgba)
    material = spec.material(geom.material) if geom.material else None
    if material is not None and rgba is None:
        red, green, blue, opacity = (float(value) for value in material.rgba)
        picture = next((name for name in material.textures if name), "")
        texture = spec.texture(picture) if picture else None
        look = GeomSource(
            material=material.name,
            rgba=(red, green, blue, opacity),
            texture="" if texture is None else texture.file,
            folder=str(_asset_folder(spec, spec.texturedir)),
        )
    if geom.hfieldname:
        return replace(look, left_out="a height field is no shape of ours: left out")
    if not geom.meshname:
        return look
    mesh = spec.mesh(geom.meshname)
    if geom.type != mujoco.mjtGeom.mjGEOM_MESH or mesh is None or not mesh.file:
        return replace(look, left_out="fitted to a mesh, or a mesh of numbers or formulas: left out")
    x, y, z = (float(value) for value in mesh.scale)
    return replace(look, mesh=mesh.file, scale=(x, y, z), folder=str(_asset_folder(spec, spec.meshdir)))


def _asset_folder(spec: Any, folder: str) -> Path:
    return (Path(spec.modelfiledir) / folder).resolve()


def _speed(data: Any) -> float | Span:
    """Read the largest speed to both sides, or the least and the greatest, beyond what no joint reaches none."""
    ends = [float(value) if abs(value) < UNLIMITED else float(np.copysign(np.inf, value)) for value in data]
    return ends[0] if len(ends) == 1 else (ends[0], ends[1])
