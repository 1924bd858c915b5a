"""The elements of URDF that every dialect shares: placements, axes, flags, shapes, and notes on what is not read."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.errors import FileFormatError
from stewart_pin.geometry.rotations import rotation_from_rpy
from stewart_pin.model.description import Note, Outcome
from stewart_pin.model.formats.dynamics import DYNAMICS, take_gazebo_springs
from stewart_pin.model.formats.words import Strange, Words
from stewart_pin.model.formats.xml import (
    INERTIA_ENTRIES,
    MIRRORED,
    PLACED_BY_JOINT,
    ElementReader,
    read_xml,
    reason_to_ignore,
    shown_tag,
)
from stewart_pin.model.shapes import Material, Shape, ShapeKind, fault_of_sizes
from stewart_pin.tolerances import NO_DIRECTION
from stewart_pin.typing import FloatArray

BOTH_SIDES = ("effort", "velocity", "acceleration", "jerk")
"""Limits of which a file gives one number for both directions."""
LIMITS = ("lower", "upper", *BOTH_SIDES, *(f"least_{key}" for key in BOTH_SIDES), "deceleration")
"""Attributes of the ``<limit>`` of a joint of one freedom."""
CONES = ("swing", "turn")
"""Attributes of the ``<limit>`` of a ball."""

_LOOK = Strange.TOLD
_ELSEWHERE = {
    "inertial": "a <link>",
    **dict.fromkeys(("mass", "inertia"), "the <inertial> of a <link>"),
    **dict.fromkeys(("parent", "child", "axis", "axis2", "limit"), "a <joint>"),
    "origin": "a <joint>, an <inertial> or a shape",
}
"""What moves or loads the mechanism where it belongs, and nothing anywhere else."""
_MATERIAL = Words(("name",), ("color", "texture"), strange=_LOOK)
CORE = {
    "robot": Words(
        ("loops", "version"),
        ("link", "joint", "material", "group_state", "end_effector", "gravity", "odd_inertia"),
        {"@name": "name of the robot"},
        elsewhere=_ELSEWHERE,
        strange=Strange.NOTED,
        told_by_reader=True,
    ),
    "robot/link": Words(
        ("name",),
        ("inertial", "visual", "collision"),
        {"@type": "a word of old files", "origin": PLACED_BY_JOINT},
        elsewhere=_ELSEWHERE,
        strange=Strange.NOTED,
        told_by_reader=True,
    ),
    "inertial": Words((), ("origin", "mass", "inertia")),
    "inertial/mass": Words(("value",)),
    "inertial/inertia": Words((*INERTIA_ENTRIES, *MIRRORED)),
    "origin": Words(("xyz", "rpy", "quat_xyzw")),
    "robot/joint": Words(
        ("name", "type", "independent"),
        ("parent", "child", "origin", "axis", "axis2", "limit", "dynamics"),
        elsewhere=_ELSEWHERE,
        strange=Strange.NOTED,
        told_by_reader=True,
    ),
    "dynamics": Words(DYNAMICS, strange=Strange.NOTED),
    "joint/parent": Words(("link",)),
    "joint/child": Words(("link",)),
    "joint/axis": Words(("xyz",), (), {"@rpy": "zero alone: no reader of URDF turns an axis by it"}),
    "axis": Words(("xyz",)),
    "axis2": Words(("xyz",)),
    "limit": Words((*LIMITS, *CONES), elsewhere=_ELSEWHERE, strange=Strange.NOTED, told_by_reader=True),
    "visual": Words(
        (),
        ("origin", "geometry", "material"),
        {"@name": "name of a shape"},
        elsewhere=_ELSEWHERE,
        strange=_LOOK,
    ),
    "collision": Words(
        (), ("origin", "geometry"), {"@name": "name of a shape"}, elsewhere=_ELSEWHERE, strange=_LOOK
    ),
    "geometry": Words((), (*ShapeKind, "drake:capsule", "drake:ellipsoid"), strange=_LOOK),
    "geometry/box": Words(("size",), strange=_LOOK),
    "geometry/cylinder": Words(("radius", "length"), strange=_LOOK),
    "geometry/sphere": Words(("radius",), strange=_LOOK),
    "geometry/capsule": Words(("radius", "length"), strange=_LOOK),
    "geometry/drake:capsule": Words(("radius", "length"), strange=_LOOK),
    "geometry/drake:ellipsoid": Words(("a", "b", "c"), strange=_LOOK),
    "geometry/mesh": Words(("filename", "scale"), strange=_LOOK),
    **{f"{holder}/material": _MATERIAL for holder in ("robot", "visual")},
    "material/color": Words(("rgba",), strange=_LOOK),
    "material/texture": Words(("filename",), strange=_LOOK),
    "group_state": Words(("name", "assembled"), ("joint",), {"@group": "all joints are read"}),
    "group_state/joint": Words(("name", "value")),
    "end_effector": Words(
        ("name", "parent_link"),
        (),
        {"@group": "the link alone is read", "@parent_group": "the link alone is read"},
        strange=Strange.NOTED,
    ),
    "robot/gravity": Words(("xyz",)),
    "odd_inertia": Words(("link",)),
}
"""Words of URDF and SRDF, and of what `save` adds."""


class UrdfElements(ElementReader):
    """Reads elements of one URDF, and keeps the notes on it.

    Parameters
    ----------
    path
        The file.

    Attributes
    ----------
    root
        The root element.
    notes
        What was kept, changed or ignored so far.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.root = read_xml(path)
        self.notes: list[Note] = []

    @cached_property
    def gazebo_springs(self) -> dict[str, dict[str, FloatArray]]:
        """Stiffness [N/m, N m/rad] and rest [m, rad] that ``<gazebo>`` gives to joints, taken out of it."""
        return {} if self.root.find("gazebo") is None else take_gazebo_springs(self)

    @cached_property
    def told_materials(self) -> dict[str | None, etree._Element]:
        """First material of each name that says what it looks like."""
        return {e.get("name"): e for e in reversed(list(self.root.iter("material"))) if len(e)}

    @cached_property
    def used_materials(self) -> set[str | None]:
        """Names of the materials that stand in shapes."""
        return {e.get("name") for e in self.root.iter("material") if e.getparent() is not self.root}

    def origin(self, element: etree._Element, owner: str, tag: str = "origin") -> pin.SE3:
        """Read the placement that an ``<origin>`` inside an element gives.

        Parameters
        ----------
        element
            Where to look.
        owner
            Named in the message.
        tag
            Tag of the origin.

        Returns
        -------
        pinocchio.SE3
            The placement; identity where there is no such tag.
        """
        origin = self.optional(element, tag, owner)
        if origin is None:
            return pin.SE3.Identity()
        return self.pose(origin, owner)

    def pose(self, element: etree._Element, owner: str) -> pin.SE3:
        """Read the attributes ``xyz`` and ``rpy``, or ``quat_xyzw``, of an element.

        Parameters
        ----------
        element
            Where to look.
        owner
            Named in the message.

        Returns
        -------
        pinocchio.SE3
            The placement; what is absent is zero.
        """
        xyz = self.numbers(element, "xyz", 3, owner, default="0 0 0")
        if "quat_xyzw" not in element.attrib:
            return pin.SE3(rotation_from_rpy(*self.numbers(element, "rpy", 3, owner, default="0 0 0")), xyz)
        where = f"{owner}: <{shown_tag(element)} quat_xyzw> (line {element.sourceline})"
        if "rpy" in element.attrib:
            raise self.error(f"{where} stands beside rpy; keep one of them", owner)
        quaternion = self.numbers(element, "quat_xyzw", 4, owner)
        size = np.linalg.norm(quaternion)
        if size < NO_DIRECTION:
            raise self.error(f"{where} is of length zero; write '0 0 0 1' for no rotation", owner)
        return pin.SE3(pin.Quaternion(quaternion / size).matrix(), xyz)

    def axis(self, element: etree._Element, owner: str, tag: str, default: str) -> FloatArray:
        """Read a direction.

        Parameters
        ----------
        element
            Where to look.
        owner
            Named in the message.
        tag
            Tag of the axis.
        default
            Text to use when the tag is absent; empty: it is required.

        Returns
        -------
        numpy.ndarray
            (3,) unit vector (dimensionless).
        """
        axis = self.optional(element, tag, owner) if default else self.child(element, tag, owner)
        if axis is None:
            return self.parse(default, 3, owner, owner)
        if axis.get("rpy") is not None and self.numbers(axis, "rpy", 3, owner).any():
            raise self.error(
                f"{owner}: rpy of <{tag}> (line {axis.sourceline}) turns the axis, which no reader of URDF does; turn "
                "xyz, and take rpy off",
                owner,
            )
        return self.direction(self.text(axis, "xyz", owner), f"{owner}: <{tag} xyz>", owner)

    def direction(self, text: str, where: str, owner: str) -> FloatArray:
        """Read a direction from text.

        Parameters
        ----------
        text
            Three numbers.
        where
            Named in the message.
        owner
            Link or joint at fault.

        Returns
        -------
        numpy.ndarray
            (3,) unit vector (dimensionless).
        """
        values = self.parse(text, 3, where, owner)
        size = np.linalg.norm(values)
        if size < NO_DIRECTION:
            raise self.error(f"{where} is of length zero; give a direction", owner)
        # A vector that is of unit length to the last digit keeps its digits, so that files survive being rewritten.
        return values if abs(size - 1) < 1e-15 else values / size

    def content(self, element: etree._Element, owner: str) -> str:
        """Read the text inside an element.

        Parameters
        ----------
        element
            The element.
        owner
            Named in the message.

        Returns
        -------
        str
            The text, without blanks around it.
        """
        text = (element.text or "").strip()
        if not text or len(element):
            raise self.error(
                f"{owner}: <{shown_tag(element)}> (line {element.sourceline}) must hold text", owner
            )
        return text

    def ends(self, joint: etree._Element, owner: str) -> tuple[str, str]:
        """Read the links that a joint joins.

        Parameters
        ----------
        joint
            Element with a ``<parent link>`` and a ``<child link>``.
        owner
            Named in the message.

        Returns
        -------
        tuple of str
            Parent and child.
        """
        elements = [self.child(joint, tag, owner) for tag in ("parent", "child")]
        parent, child = (self.text(end, "link", owner) for end in elements)
        return parent, child

    def flag(self, element: etree._Element, attribute: str, owner: str) -> bool:
        """Read an attribute that is true or false.

        Parameters
        ----------
        element
            Where to look.
        attribute
            Name of the attribute; absent: false.
        owner
            Named in the message.

        Returns
        -------
        bool
            The value.
        """
        # URDF+ files say "True", too.
        value = element.get(attribute, "false")
        if value not in ("true", "false", "True", "False"):
            raise self.error(f"{owner}: {attribute} must be 'true' or 'false', got {value!r}", owner)
        return value in ("true", "True")

    def note(self, owner: str, text: str, outcome: Outcome = Outcome.IGNORED) -> None:
        """Remember what became of a finding.

        Parameters
        ----------
        owner
            Tag or name.
        text
            What became of it, and why.
        outcome
            Kept, changed or ignored.
        """
        self.notes.append(Note(owner, text, outcome))

    def ignore(self, element: etree._Element, owner: str) -> None:
        """Note that an element is not read, or stop if it could change the mechanism.

        Parameters
        ----------
        element
            The element.
        owner
            Link or joint that holds it.
        """
        self.note(owner, f"{self.shown(element, owner)}: {reason_to_ignore(self, element, owner)}")

    def shown(self, element: etree._Element, owner: str) -> str:
        """Print an element for the report.

        Parameters
        ----------
        element
            The element.
        owner
            Link or joint that holds it.

        Returns
        -------
        str
            Its tag, with its name where the file itself holds it.
        """
        named = f" name='{element.get('name')}'" if element.get("name") and owner == "the file" else ""
        return f"<{shown_tag(element)}{named}>"


# ----------------------------------------------------------------------------------------------------
# Shapes of URDF: ``<visual>`` and ``<collision>`` of links, ``<material>`` of shapes and of the whole file
#
# A shape that cannot be read is left out with a note: no equation of motion depends on it.
#
# References
# ----------
# .. [1] ROS wiki, "urdf/XML/link".
# ----------------------------------------------------------------------------------------------------

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
        told = reader.told_materials.get(name, element)
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
    return material.get("name") in reader.used_materials


def _folder(reader: UrdfElements) -> str:
    return str(Path(reader.path).resolve().parent)
