"""Shapes of links as ``<visual>``, ``<collision>`` and ``<material>`` of a URDF."""

from __future__ import annotations

from pathlib import Path
from typing import TypeGuard

from lxml import etree

from stewart_pin.model.description import Link, Note, Outcome
from stewart_pin.model.formats.urdf_placements import write_origin
from stewart_pin.model.formats.urdf_shapes import SIZE_ATTRIBUTES
from stewart_pin.model.formats.xml import number_text
from stewart_pin.model.shapes import Material, MaterialNames, Shape, ShapeKind, path_from, rounded_as_three


class UrdfShapes:
    """Writes the shapes of one file.

    Parameters
    ----------
    folder
        Folder of the file: meshes and textures are named as seen from there.

    Attributes
    ----------
    notes
        What URDF has no word for.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.notes: list[Note] = []
        self.materials = MaterialNames()

    def write(self, element: etree._Element, link: Link) -> None:
        """Write the shapes of a link.

        Parameters
        ----------
        element
            The ``<link>``.
        link
            What it describes.
        """
        for tag, shapes in (("visual", link.visuals), ("collision", link.collisions)):
            for shape in shapes:
                self._write(element, tag, shape, f"link '{link.name}'")

    def write_materials(self, robot: etree._Element) -> None:
        """Write what the shapes are made of, before all links.

        Parameters
        ----------
        robot
            The ``<robot>``, with its links.
        """
        for number, (name, material) in enumerate(self.materials.named.items()):
            element = etree.Element("material", name=name)
            if material.rgba is not None:
                etree.SubElement(element, "color", rgba=number_text(material.rgba))
            if material.texture:
                picture = path_from(self.folder, material.texture, material.folder)
                etree.SubElement(element, "texture", filename=picture)
            robot.insert(number, element)

    def _write(self, link: etree._Element, tag: str, shape: Shape, owner: str) -> None:
        match shape.kind:
            case ShapeKind.CAPSULE:
                text = f"{tag}: URDF has no capsules; written as a cylinder and two balls"
                self.notes.append(Note(owner, text, Outcome.CHANGED))
                for part in rounded_as_three(shape):
                    if all(part.sizes):
                        self._write(link, tag, part, owner)
            case ShapeKind.ELLIPSOID:
                self.notes.append(Note(owner, f"{tag}: URDF has no ellipsoids; left out"))
            case _:
                self._element(link, tag, shape)

    def _element(self, link: etree._Element, tag: str, shape: Shape) -> None:
        element = etree.SubElement(link, tag, {"name": shape.name} if shape.name else {})
        write_origin(element, shape.placement)
        geometry = etree.SubElement(element, "geometry")
        if shape.kind is ShapeKind.MESH:
            mesh = etree.SubElement(
                geometry, "mesh", filename=path_from(self.folder, shape.mesh, shape.folder)
            )
            if any(size != 1 for size in shape.sizes):
                mesh.set("scale", number_text(shape.sizes))
        else:
            attributes = SIZE_ATTRIBUTES[shape.kind]
            values = [shape.sizes] if len(attributes) == 1 else [[size] for size in shape.sizes]
            texts = (number_text(value) for value in values)
            etree.SubElement(geometry, str(shape.kind), dict(zip(attributes, texts, strict=True)))
        if tag == "visual" and _says_something(shape.material):
            etree.SubElement(element, "material", name=self.materials.name(shape.material))


def _says_something(material: Material | None) -> TypeGuard[Material]:
    return material is not None and bool(material.name or material.texture or material.rgba)
