"""Shapes of MuJoCo's compiled model: what its viewer shows, and what would touch other bodies.

A ``<geom>`` of the groups 0 to 2 is seen; one that may touch others, or of group 3, is a collision shape; many are
both. Meshes are not opened: their files are named as the MJCF does. How shapes of links are
written as ``<geom>`` stands below.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from stewart_pin.model.description import Link, Note
from stewart_pin.model.formats.mjcf.bodies import place, placement_of
from stewart_pin.model.formats.mjcf.compiling import GeomSource, given_names, import_mujoco
from stewart_pin.model.formats.xml import number_text
from stewart_pin.model.shapes import Material, MaterialNames, Shape, ShapeKind, path_from

_COLLISIONS = 3
"""First group that MuJoCo's viewer does not show, and that of collision shapes."""


@dataclass(frozen=True, eq=False)
class BodyShapes:
    """Shapes by body.

    Attributes
    ----------
    visuals, collisions
        Shapes of every body, by MuJoCo's number.
    notes
        What was left out.
    """

    visuals: Mapping[int, tuple[Shape, ...]]
    collisions: Mapping[int, tuple[Shape, ...]]
    notes: tuple[Note, ...]


def read_shapes(model: Any, sources: Mapping[int, GeomSource]) -> BodyShapes:
    """Read all geoms.

    Parameters
    ----------
    model
        ``mujoco.MjModel``.
    sources
        What the compiled model does not tell of its geoms.

    Returns
    -------
    BodyShapes
        Shapes by body.
    """
    visuals: dict[int, tuple[Shape, ...]] = {}
    collisions: dict[int, tuple[Shape, ...]] = {}
    notes: list[Note] = []
    for k, name in enumerate(given_names(model, "geom", model.ngeom)):
        body, group = int(model.geom_bodyid[k]), int(model.geom_group[k])
        shape = _shape(model, k, name, sources[k])
        if isinstance(shape, str):
            notes.append(Note(f"geom '{name or k + 1}'", shape))
            continue
        seen = group < _COLLISIONS
        touches = bool(model.geom_contype[k] or model.geom_conaffinity[k]) or group == _COLLISIONS
        if seen:
            visuals[body] = (*visuals.get(body, ()), shape)
        if touches:
            collisions[body] = (*collisions.get(body, ()), shape)
        if not (seen or touches):
            notes.append(Note(f"geom '{name or k + 1}'", f"of group {group}: neither seen nor touched"))
    return BodyShapes(visuals, collisions, tuple(notes))


def _shape(model: Any, k: int, name: str, source: GeomSource) -> Shape | str:
    """Read one geom; a text says why it is left out."""
    placement = placement_of(model.geom_pos[k], model.geom_quat[k])
    material = Material(source.material, source.rgba, source.texture, source.folder)
    types = import_mujoco().mjtGeom
    if source.left_out:
        return source.left_out
    if source.mesh:
        return Shape(ShapeKind.MESH, source.scale, placement, name, source.mesh, source.folder, material)
    a, b, c = (float(size) for size in model.geom_size[k])
    made = {
        types.mjGEOM_BOX: (ShapeKind.BOX, (2 * a, 2 * b, 2 * c)),
        types.mjGEOM_CYLINDER: (ShapeKind.CYLINDER, (a, 2 * b)),
        types.mjGEOM_CAPSULE: (ShapeKind.CAPSULE, (a, 2 * b)),
        types.mjGEOM_SPHERE: (ShapeKind.SPHERE, (a,)),
        types.mjGEOM_ELLIPSOID: (ShapeKind.ELLIPSOID, (a, b, c)),
    }.get(types(int(model.geom_type[k])))
    if made is None:
        return f"a {types(int(model.geom_type[k])).name.removeprefix('mjGEOM_').lower()} is no shape of ours: left out"
    if not np.isfinite(made[1]).all():
        return "its size is not finite: left out"
    return Shape(made[0], made[1], placement, name, material=material)


# ----------------------------------------------------------------------------------------------------
# Shapes of links as ``<geom>``: they are seen and found, but touch nothing, as a mechanism has no contacts
#
# As usual among files of robots, what is to be seen stands in group 2, collision shapes in group 3.
# ----------------------------------------------------------------------------------------------------

GROUPS = {"visual": 2, "collision": 3}
"""Group of each kind of shape; MuJoCo's viewer shows groups 0 to 2."""
_MESHES = (".stl", ".obj", ".msh")
_NO_FILE = "left out: MuJoCo would refuse the file, as there is no such mesh beside it"


_NOT_BINARY = "left out: MuJoCo reads only binary STL of at most 200000 faces"
_STL_HEAD, _STL_FACE, _MOST_FACES = 84, 50, 200_000
"""Bytes before the faces of a binary STL, bytes of a face, and MuJoCo's largest number of them."""


class MjcfShapes:
    """Writes the shapes of one file.

    Parameters
    ----------
    folder
        Folder of the file: meshes are named as seen from there.

    Attributes
    ----------
    notes
        What MuJoCo has no word for.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.notes: list[Note] = []
        self.materials = MaterialNames()
        self.meshes: dict[tuple[str, tuple[float, ...]], str] = {}
        self.used: set[str] = set()
        self.names: set[str] = set()

    def write(self, element: etree._Element, link: Link) -> None:
        """Write the shapes of a link.

        Parameters
        ----------
        element
            Its ``<body>``.
        link
            The link.
        """
        for role, shapes in (("visual", link.visuals), ("collision", link.collisions)):
            for shape in shapes:
                fault = self._fault(shape)
                if fault:
                    self.notes.append(Note(f"link '{link.name}'", f"{role}: {fault}"))
                else:
                    self._geom(element, role, shape, link)

    def leave_out(self, link: Link) -> None:
        """Note the shapes of a link that vanishes.

        Parameters
        ----------
        link
            The link.
        """
        for role, shapes in (("visual", link.visuals), ("collision", link.collisions)):
            if shapes:
                text = f"{role}: left out, for the link has no mass, and vanishes into the next body"
                self.notes.append(Note(f"link '{link.name}'", text))

    def finish(self, root: etree._Element) -> None:
        """Write what the shapes refer to: defaults, materials and meshes, before the bodies.

        Parameters
        ----------
        root
            The ``<mujoco>``, with its bodies.
        """
        if self.used:
            defaults = root.find("default")
            if defaults is None:
                defaults = etree.Element("default")
                _before_bodies(root, defaults)
            for role in sorted(self.used):
                inner = etree.SubElement(defaults, "default", {"class": role})
                etree.SubElement(inner, "geom", contype="0", conaffinity="0", group=str(GROUPS[role]))
        if self.materials.named or self.meshes:
            assets = etree.Element("asset")
            _before_bodies(root, assets)
            for name, material in self.materials.named.items():
                element = etree.SubElement(assets, "material", name=name)
                if material.rgba is not None:
                    element.set("rgba", number_text(material.rgba))
            for (file, scale), name in self.meshes.items():
                # Of a shell MuJoCo asks no volume.
                element = etree.SubElement(assets, "mesh", name=name, file=file, inertia="shell")
                if any(size != 1 for size in scale):
                    element.set("scale", number_text(scale))

    def _fault(self, shape: Shape) -> str:
        if shape.kind is not ShapeKind.MESH:
            return ""
        if "://" in shape.mesh or not (Path(shape.folder) / shape.mesh).is_file():
            return _NO_FILE
        suffix = Path(shape.mesh).suffix
        if suffix.lower() not in _MESHES:
            return f"left out: MuJoCo reads no meshes of type '{suffix}'"
        is_stl = suffix.lower() == ".stl"
        return _NOT_BINARY if is_stl and not _is_binary_stl(Path(shape.folder) / shape.mesh) else ""

    def _geom(self, body: etree._Element, role: str, shape: Shape, link: Link) -> None:
        self.used.add(role)
        element = etree.SubElement(body, "geom", {"class": role})
        if shape.name and shape.name not in self.names:
            self.names.add(shape.name)
            element.set("name", shape.name)
        element.set("type", str(shape.kind))
        if shape.kind is ShapeKind.MESH:
            element.set("mesh", self._mesh(shape))
        else:
            element.set("size", number_text(half_sizes(shape)))
        place(element, shape.placement)
        material = shape.material
        if material is None:
            return
        if material.texture:
            self.notes.append(Note(f"link '{link.name}'", f"texture '{material.texture}': left out"))
        if material.name:
            element.set("material", self.materials.name(material))
        elif material.rgba is not None:
            element.set("rgba", number_text(material.rgba))

    def _mesh(self, shape: Shape) -> str:
        key = path_from(self.folder, shape.mesh, shape.folder), shape.sizes
        stem, taken = Path(shape.mesh).stem, self.meshes.values()
        names = (stem if k == 1 else f"{stem}_{k}" for k in range(1, len(self.meshes) + 2))
        return self.meshes.setdefault(key, next(name for name in names if name not in taken))


def half_sizes(shape: Shape) -> list[float]:
    """Convert sizes to MuJoCo's, which are half edges and half lengths.

    Parameters
    ----------
    shape
        No mesh.

    Returns
    -------
    list of float
        Attribute ``size`` [m].
    """
    match shape.kind:
        case ShapeKind.BOX:
            return [size / 2 for size in shape.sizes]
        case ShapeKind.CYLINDER | ShapeKind.CAPSULE:
            return [shape.sizes[0], shape.sizes[1] / 2]
        case _:
            return list(shape.sizes)


def _is_binary_stl(file: Path) -> bool:
    with file.open("rb") as stream:
        faces = int.from_bytes(stream.read(_STL_HEAD)[-4:], "little")
    return 0 < faces <= _MOST_FACES and file.stat().st_size == _STL_HEAD + _STL_FACE * faces


def _before_bodies(root: etree._Element, element: etree._Element) -> None:
    world = root.find("worldbody")
    assert world is not None
    world.addprevious(element)
