"""The elements of URDF that every dialect shares: placements, axes, flags, and notes on what is not read."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.geometry.rotations import rotation_from_rpy
from stewart_pin.model.description import Note, Outcome
from stewart_pin.model.formats.xml import ElementReader, read_xml, reason_to_ignore, shown_tag
from stewart_pin.typing import FloatArray

INERTIA_ENTRIES = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
"""Attributes of ``<inertia>`` and their places in the matrix."""

_NO_DIRECTION = 1e-12
"""Length below which an axis has no direction."""


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
        self.only(origin, owner, ("xyz", "rpy"))
        return self.pose(origin, owner)

    def pose(self, element: etree._Element, owner: str) -> pin.SE3:
        """Read the attributes ``xyz`` and ``rpy`` of an element.

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
        return pin.SE3(rotation_from_rpy(*self.numbers(element, "rpy", 3, owner, default="0 0 0")), xyz)

    def axis(
        self, element: etree._Element, owner: str, tag: str, default: str, extra: Collection[str] = ()
    ) -> FloatArray:
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
        extra
            Attributes besides ``xyz`` that the caller reads.

        Returns
        -------
        numpy.ndarray
            (3,) unit vector (dimensionless).
        """
        axis = self.optional(element, tag, owner) if default else self.child(element, tag, owner)
        if axis is None:
            return self.parse(default, 3, owner, owner)
        self.only(axis, owner, ("xyz", *extra))
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
        if size < _NO_DIRECTION:
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
        for end in elements:
            self.only(end, owner, ("link",))
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

    def ignore_attributes(self, element: etree._Element, owner: str, known: Collection[str]) -> None:
        """Note the attributes that are not read.

        Parameters
        ----------
        element
            The element.
        owner
            Link or joint that holds it.
        known
            Attributes that are read.
        """
        for name in element.attrib:
            if name not in known:
                self.note(owner, f"attribute '{name}' of <{shown_tag(element)}>: unknown")
