"""Shapes of links, for viewers and collision checkers: no equation of motion depends on them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path

import numpy as np
import pinocchio as pin

DRAWN = "stewart_pin_drawn_"
"""How the names of shapes begin that a writer added so that something is seen, and that readers take off again."""


class ShapeKind(StrEnum):
    """What a shape is."""

    BOX = "box"
    CYLINDER = "cylinder"
    SPHERE = "sphere"
    CAPSULE = "capsule"
    ELLIPSOID = "ellipsoid"
    MESH = "mesh"


SIZES = {
    ShapeKind.BOX: 3,
    ShapeKind.CYLINDER: 2,
    ShapeKind.SPHERE: 1,
    ShapeKind.CAPSULE: 2,
    ShapeKind.ELLIPSOID: 3,
    ShapeKind.MESH: 3,
}
"""How many sizes each kind has."""


@dataclass(frozen=True)
class Material:
    """What a surface looks like.

    Attributes
    ----------
    name
        Name in the file, perhaps empty.
    rgba
        Red, green, blue and opacity, 0 to 1 (dimensionless); None: not stated.
    texture
        Picture, as the file names it; empty: none.
    folder
        Folder from which a relative path of the texture starts.
    """

    name: str = ""
    rgba: tuple[float, float, float, float] | None = None
    texture: str = ""
    folder: str = ""


@dataclass(frozen=True, eq=False)
class Shape:
    """A shape that is fixed to a link.

    Attributes
    ----------
    kind
        What it is.
    sizes
        Box: its edges; cylinder and capsule, along z: radius, length without caps; sphere: radius; ellipsoid: half-axes
        [m]. Mesh: scale along each axis (dimensionless).
    placement
        Frame of the shape, in the middle of all but meshes, in the link frame.
    name
        Name in the file, perhaps empty.
    mesh
        File of a mesh, as the file of the robot names it.
    folder
        Folder from which a relative path of the mesh starts.
    material
        What it looks like, if anything says so.
    """

    kind: ShapeKind
    sizes: tuple[float, ...]
    placement: pin.SE3 = field(default_factory=pin.SE3.Identity)
    name: str = ""
    mesh: str = ""
    folder: str = ""
    material: Material | None = None


def fault_of_sizes(kind: ShapeKind, sizes: tuple[float, ...]) -> str | None:
    """Say why numbers are no sizes of a shape.

    Parameters
    ----------
    kind
        What the shape is.
    sizes
        Its sizes [m], or scales (dimensionless).

    Returns
    -------
    str or None
        The reason, or None.
    """
    if kind is ShapeKind.MESH:
        return None if all(sizes) else "a scale is zero"
    # A capsule without length is a ball.
    least = (min(sizes[0], np.inf if sizes[1] >= 0 else -1.0),) if kind is ShapeKind.CAPSULE else sizes
    return None if min(least) > 0 else f"a size of its {kind} is not above zero"


def rounded_as_three(capsule: Shape) -> tuple[Shape, Shape, Shape]:
    """Make a capsule of a cylinder and two balls, for formats without a word for it.

    Parameters
    ----------
    capsule
        The capsule.

    Returns
    -------
    tuple of Shape
        Together the same surface.
    """
    radius, length = capsule.sizes
    stem = capsule.name

    def part(number: int, kind: ShapeKind, sizes: tuple[float, ...], height: float) -> Shape:
        placement = capsule.placement * pin.SE3(np.eye(3), np.array([0.0, 0.0, height]))
        return replace(capsule, kind=kind, sizes=sizes, placement=placement, name=stem and f"{stem}_{number}")

    return (
        part(1, ShapeKind.CYLINDER, (radius, length), 0.0),
        part(2, ShapeKind.SPHERE, (radius,), -length / 2),
        part(3, ShapeKind.SPHERE, (radius,), length / 2),
    )


def path_from(folder: Path, file: str, start: str) -> str:
    """Name a file as seen from another folder.

    Parameters
    ----------
    folder
        Folder of the file that is to name it.
    file
        Path or URI, as it stood.
    start
        Folder from which a relative path started.

    Returns
    -------
    str
        A URI or an absolute path as it was, a relative path from `folder`.
    """
    if not file or "://" in file or Path(file).is_absolute() or not start:
        return file
    return Path(os.path.relpath(Path(start) / file, folder)).as_posix()


class MaterialNames:
    """Gives every material a name of its own.

    Attributes
    ----------
    named
        Materials by name, in the order in which they were met.
    """

    def __init__(self) -> None:
        self.named: dict[str, Material] = {}

    def name(self, material: Material) -> str:
        """Find the name under which a material is written.

        Parameters
        ----------
        material
            The material.

        Returns
        -------
        str
            Its own, unless that is empty, or taken by a material that looks otherwise.
        """
        for name in _endless(material.name or "material"):
            known = self.named.setdefault(name, material)
            if replace(known, name="") == replace(material, name=""):
                return name
        raise AssertionError  # names do not end


def _endless(stem: str) -> Iterator[str]:
    yield stem
    number = 2
    while True:
        yield f"{stem}_{number}"
        number += 1
