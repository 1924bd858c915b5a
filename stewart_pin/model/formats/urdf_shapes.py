"""Shapes of URDF: ``<visual>`` and ``<collision>`` of links, ``<material>`` of shapes and of the whole file.

A shape that cannot be read is left out with a note: no equation of motion depends on it.

References
----------
.. [1] ROS wiki, "urdf/XML/link".
"""

from __future__ import annotations

from pathlib import Path

from lxml import etree

from stewart_pin.errors import FileFormatError
from stewart_pin.model.formats.urdf_elements import UrdfElements
from stewart_pin.model.formats.xml import reason_to_ignore, shown_tag
from stewart_pin.model.shapes import Material, Shape, ShapeKind, fault_of_sizes

SHAPE_TAGS = ("visual", "collision")
"""Children of a ``<link>`` that are shapes."""
SIZE_ATTRIBUTES = {
    ShapeKind.BOX: ("size",),
    ShapeKind.CYLINDER: ("radius", "length"),
    ShapeKind.SPHERE: ("radius",),
    ShapeKind.CAPSULE: ("radius", "length"),
}
"""Attributes that hold the sizes of a shape; of a mesh there may be a ``scale``."""


def read_shapes(reader: UrdfElements, link: etree._Element, tag: str, owner: str) -> tuple[Shape, ...]:
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

    Returns
    -------
    tuple of Shape
        Those that can be read; the others are noted.
    """
    shapes: list[Shape] = []
    for element in link.iterchildren(etree.Element):
        if shown_tag(element) != tag:
            continue
        reason_to_ignore(reader, element, owner)  # stops at what could close a loop
        known = len(reader.notes)
        try:
            shapes.append(_shape(reader, element, owner))
        except FileFormatError as error:
            del reader.notes[known:]
            why = str(error).removeprefix(f"{reader.path}: ").removeprefix(f"{owner}: ").removeprefix(owner)
            reader.note(owner, f"<{tag}> left out: {why.strip()}")
    return tuple(shapes)


def _shape(reader: UrdfElements, element: etree._Element, owner: str) -> Shape:
    tag = shown_tag(element)
    material = reader.optional(element, "material", owner) if tag == "visual" else None
    for inner in element.iterchildren(etree.Element):
        if shown_tag(inner) not in ("origin", "geometry", *(("material",) if tag == "visual" else ())):
            reader.ignore(inner, f"<{tag}> of {owner}")
    geometry = reader.child(element, "geometry", owner)
    inside = list(geometry.iterchildren(etree.Element))
    if len(inside) != 1:
        raise reader.error(f"its <geometry> holds {len(inside)} shapes, and is to hold one", owner)
    written = shown_tag(inside[0]).removeprefix("drake:")
    if written not in list(ShapeKind):
        raise reader.error(f"shapes of type <{written}> are not understood", owner)
    kind = ShapeKind(written)
    sizes = _sizes(reader, inside[0], kind, owner)
    fault = fault_of_sizes(kind, sizes)
    if fault:
        raise reader.error(fault, owner)
    is_mesh = kind is ShapeKind.MESH
    return Shape(
        kind,
        sizes,
        reader.origin(element, owner),
        element.get("name", ""),
        reader.text(inside[0], "filename", owner) if is_mesh else "",
        _folder(reader) if is_mesh else "",
        None if material is None else _material(reader, material, owner),
    )


def _sizes(reader: UrdfElements, element: etree._Element, kind: ShapeKind, owner: str) -> tuple[float, ...]:
    match kind:
        case ShapeKind.BOX:
            sizes = reader.numbers(element, "size", 3, owner)
        case ShapeKind.MESH:
            sizes = reader.numbers(element, "scale", 3, owner, default="1 1 1")
        case ShapeKind.ELLIPSOID:  # Drake's
            return tuple(float(reader.numbers(element, key, 1, owner)[0]) for key in "abc")
        case _:
            return tuple(float(reader.numbers(element, key, 1, owner)[0]) for key in SIZE_ATTRIBUTES[kind])
    return tuple(map(float, sizes))


def _material(reader: UrdfElements, element: etree._Element, owner: str) -> Material:
    """Read a material, or find the one of its name that says what it looks like, anywhere in the file."""
    name = element.get("name", "")
    told = element
    if name and not len(element):
        same = (e for e in reader.root.iter("material") if e.get("name") == name and len(e))
        told = next(same, element)
    color, texture = (reader.optional(told, tag, owner) for tag in ("color", "texture"))
    red, green, blue, opacity = (
        (None,) * 4 if color is None else map(float, reader.numbers(color, "rgba", 4, owner))
    )
    rgba = (
        None
        if red is None or green is None or blue is None or opacity is None
        else (red, green, blue, opacity)
    )
    picture = "" if texture is None else reader.text(texture, "filename", owner)
    return Material(name, rgba, picture, _folder(reader) if picture else "")


def is_used(reader: UrdfElements, material: etree._Element) -> bool:
    """Tell whether a shape is made of a material of the whole file.

    Parameters
    ----------
    reader
        Reader of the file.
    material
        Child of the root.

    Returns
    -------
    bool
        Whether any names it.
    """
    same = [e for e in reader.root.iter("material") if e.get("name") == material.get("name")]
    return any(element.getparent() is not reader.root for element in same)


def _folder(reader: UrdfElements) -> str:
    return str(Path(reader.path).resolve().parent)
