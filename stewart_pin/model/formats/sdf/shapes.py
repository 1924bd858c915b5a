"""Shapes of SDFormat: ``<visual>`` and ``<collision>`` of links, and their colours.

A shape that cannot be read is left out with a note: no equation of motion depends on it.
"""

from __future__ import annotations

from pathlib import Path

from lxml import etree

from stewart_pin.errors import FileFormatError
from stewart_pin.model.formats.sdf.elements import SdfReader
from stewart_pin.model.formats.xml import shown_tag
from stewart_pin.model.shapes import Material, Shape, ShapeKind, fault_of_sizes

SHAPE_TAGS = ("visual", "collision")
"""Children of a ``<link>`` that are shapes."""
_SIZES = {
    ShapeKind.CYLINDER: ("radius", "length"),
    ShapeKind.CAPSULE: ("radius", "length"),
    ShapeKind.SPHERE: ("radius",),
}
_VECTORS = {ShapeKind.BOX: "size", ShapeKind.ELLIPSOID: "radii"}


def read_shapes(
    reader: SdfReader, link: etree._Element, tag: str, owner: str, frames: tuple[str, ...]
) -> tuple[Shape, ...]:
    """Read the shapes of a link.

    Parameters
    ----------
    reader
        Reader of the file.
    link
        The ``<link>``.
    tag
        ``visual`` or ``collision``.
    owner
        Named in messages and notes.
    frames
        Names under which a pose may call the frame of the link itself.

    Returns
    -------
    tuple of Shape
        Those that can be read; the others are noted.
    """
    shapes: list[Shape] = []
    for element in reader.children(link, tag):
        try:
            shapes.append(_shape(reader, element, owner, frames))
        except FileFormatError as error:
            why = str(error).removeprefix(f"{reader.path}: ").removeprefix(owner).lstrip(": ")
            reader.note(owner, f"<{tag}>: left out, {why}")
    return tuple(shapes)


def _shape(reader: SdfReader, element: etree._Element, owner: str, frames: tuple[str, ...]) -> Shape:
    placement, relative_to = reader.pose(element, owner)
    if relative_to not in ("", *frames):
        raise reader.error(f"its <pose> is relative to '{relative_to}', not to its link", owner)
    geometry = reader.child(element, "geometry", owner)
    inside = list(geometry.iterchildren(etree.Element))
    if len(inside) != 1:
        raise reader.error(f"its <geometry> holds {len(inside)} shapes, and is to hold one", owner)
    told, written = inside[0], shown_tag(inside[0])
    if written not in list(ShapeKind):
        raise reader.error(f"shapes of type <{written}> are not understood", owner)
    kind = ShapeKind(written)
    sizes = _sizes(reader, told, kind, owner)
    fault = fault_of_sizes(kind, sizes)
    if fault:
        raise reader.error(fault, owner)
    name, mesh = element.get("name", ""), ""
    if kind is ShapeKind.MESH:
        if reader.children(told, "submesh"):
            raise reader.error("it shows a part of a mesh only, a <submesh>", owner)
        mesh = reader.content(told, "uri", owner)
    return Shape(
        kind, sizes, placement, name, mesh.removeprefix("file://"),
        str(Path(reader.path).resolve().parent) if mesh else "", _material(reader, element, owner),
    )  # fmt: skip


def _sizes(reader: SdfReader, told: etree._Element, kind: ShapeKind, owner: str) -> tuple[float, ...]:
    if kind in _SIZES:
        return tuple(reader.number(told, tag, owner) for tag in _SIZES[kind])
    if kind in _VECTORS:
        return tuple(map(float, reader.vector(told, _VECTORS[kind], 3, owner)))
    return tuple(map(float, reader.vector(told, "scale", 3, owner, "1 1 1")))


def _material(reader: SdfReader, element: etree._Element, owner: str) -> Material | None:
    material = reader.optional(element, "material", owner)
    if material is None:
        return None
    for tag in ("diffuse", "ambient"):
        told = reader.optional(material, tag, owner)
        if told is not None:
            values = [
                float(value) for value in reader.parse((told.text or ""), None, f"{owner}: <{tag}>", owner)
            ]
            if len(values) not in (3, 4):
                raise reader.error(f"<{tag}> must hold 3 or 4 numbers, got {len(values)}", owner)
            red, green, blue, opacity = (*values, 1.0)[:4]
            return Material(rgba=(red, green, blue, opacity))
    reader.note(owner, "<material>: only <diffuse> and <ambient> are read")
    return None
