"""Safe XML: no document type, so no entity expansion; no network; numbers that are numbers."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from lxml import etree

from stewart_pin.errors import FileFormatError, FileMissingError
from stewart_pin.typing import FloatArray


def read_xml(path: Path) -> etree._Element:
    """Parse a file and return its root element.

    Parameters
    ----------
    path
        File to read.

    Returns
    -------
    lxml.etree._Element
        Root element.

    Raises
    ------
    FileMissingError
        If there is no such file.
    FileFormatError
        If the file is not well-formed XML, or holds a document type declaration (the place for entities).
    """
    if not path.is_file():
        raise FileMissingError("no such file", path=str(path))
    content = path.read_bytes()
    # Refused before parsing: entities would be expanded inside attributes whatever the parser's options. UTF-16
    # puts a zero byte between the letters; rarer encodings are caught afterwards, libxml2 bounds what they expand.
    if b"<!DOCTYPE" in content.replace(b"\0", b"").upper():
        raise _doctype_error(path)
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True)
    try:
        root = etree.fromstring(content, parser)
    except etree.XMLSyntaxError as error:
        raise FileFormatError(f"not well-formed XML: {error}", path=str(path)) from None
    if root.getroottree().docinfo.internalDTD is not None:
        raise _doctype_error(path)
    return root


def _doctype_error(path: Path) -> FileFormatError:
    return FileFormatError(
        "a document type declaration (<!DOCTYPE) is refused, because entities can exhaust the memory; remove it",
        path=str(path),
        culprit="<!DOCTYPE",
    )


def number_text(values: Iterable[float]) -> str:
    """Print numbers so that they are read back exactly.

    Parameters
    ----------
    values
        Numbers, in the unit of the attribute [m, rad, kg, kg m²].

    Returns
    -------
    str
        The numbers, separated by blanks.
    """
    return " ".join(repr(float(value) + 0.0).removesuffix(".0") for value in values)


class ElementReader:
    """Reads attributes of one file's elements, with errors that name file, owner and attribute."""

    def __init__(self, path: Path) -> None:
        self.path = str(path)

    def error(self, text: str, culprit: str) -> FileFormatError:
        """Build the error for a fault in this file.

        Parameters
        ----------
        text
            What is wrong, and the remedy.
        culprit
            Tag, link or joint at fault.

        Returns
        -------
        FileFormatError
            To be raised.
        """
        return FileFormatError(text, path=self.path, culprit=culprit)

    def text(self, element: etree._Element, attribute: str, owner: str) -> str:
        """Read a required attribute.

        Parameters
        ----------
        element
            Where to look.
        attribute
            Name of the attribute.
        owner
            Named in the message.

        Returns
        -------
        str
            The value.
        """
        value = element.get(attribute)
        if not value:
            raise self.error(
                f"{owner}: <{element.tag}> (line {element.sourceline}) lacks '{attribute}'", owner
            )
        return value

    def child(self, element: etree._Element, tag: str, owner: str) -> etree._Element:
        """Find a required child element, of which there may be one.

        Parameters
        ----------
        element
            Where to look.
        tag
            Tag of the child.
        owner
            Named in the message.

        Returns
        -------
        lxml.etree._Element
            The child.
        """
        found = element.findall(tag)
        if len(found) != 1:
            raise self.error(f"{owner} needs one <{tag}>, found {len(found)}", owner)
        return found[0]

    def numbers(
        self, element: etree._Element, attribute: str, n: int, owner: str, default: str = ""
    ) -> FloatArray:
        """Read an attribute of n finite numbers.

        Parameters
        ----------
        element
            Where to look.
        attribute
            Name of the attribute.
        n
            How many numbers it holds.
        owner
            Named in the message.
        default
            Text to use when the attribute is absent; empty: it is required.

        Returns
        -------
        numpy.ndarray
            (n,) the numbers, in the unit of the attribute [m, rad, kg, kg m²].
        """
        text = element.get(attribute, default) if default else self.text(element, attribute, owner)
        return self.parse(text, n, f"{owner}: <{element.tag} {attribute}>", owner)

    def parse(self, text: str, n: int | None, where: str, culprit: str) -> FloatArray:
        """Read n finite numbers from text.

        Parameters
        ----------
        text
            Numbers separated by blanks.
        n
            How many; None for any positive number.
        where
            Named in the message.
        culprit
            Tag, link or joint at fault.

        Returns
        -------
        numpy.ndarray
            (n,) the numbers [unit of the attribute].
        """
        try:
            values = np.array([float(word) for word in text.split()])
        except ValueError:
            raise self.error(f"{where} must hold numbers, got {text!r}", culprit) from None
        if values.size == 0 or (n is not None and values.size != n):
            raise self.error(f"{where} must hold {n or 'some'} numbers, got {text!r}", culprit)
        if not np.isfinite(values).all():
            raise self.error(f"{where} must be finite, got {text!r}", culprit)
        return values
