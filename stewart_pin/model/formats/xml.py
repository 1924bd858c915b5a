"""Safe XML: no document type, so no entity expansion; no network; numbers that are numbers; which tags are harmless.

A file with tags of xacro is what the package of that name makes of it (extra ``xacro``).
"""

from __future__ import annotations

import codecs
import contextlib
import io
import re
import threading
from collections.abc import Collection, Iterable, Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from stewart_pin.errors import FileFormatError, FileMissingError, MissingExtraError
from stewart_pin.typing import FloatArray

UNLIMITED = 1e30
"""Largest number that a file may hold; as a limit it stands for none (URDF cannot write infinity)."""

_WRITTEN_OUT: ContextVar[dict[Path, str] | None] = ContextVar("written out", default=None)
"""Texts of files whose macros xacro has written out; kept only within `expanding_once`."""
_CODECS = ("utf-8", "ascii", "iso8859-1", "cp1252")
_COMMENT = re.compile(r"<!\[CDATA\[.*?\]\]>|<!--.*?-->", re.DOTALL)
_DECLARED = re.compile(rb"\s*<\?xml\s[^>]*?encoding\s*=\s*[\"']([^\"']*)[\"']")


def read_xml(path: Path) -> etree._Element:
    """Parse a file and return its root element.

    Prefixes without a declared namespace are kept as part of the tag, as robot software does; the root's own default
    namespace is taken off the tags.

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
        If the file is not well-formed XML, holds a document type declaration (the place for entities), or is refused by
        xacro.
    MissingExtraError
        If the file has tags of xacro, which is not installed.
    """
    text = _COMMENT.sub(_blank, _read_text(path))
    root = _parse(path, text)
    if path.suffix.lower() != ".xacro" and not (
        "<xacro:" in text
        and any(shown_tag(element).startswith("xacro:") for element in root.iter(etree.Element))
    ):
        return root
    expanded = _parse(path, _COMMENT.sub(_blank, _written_out(path)))
    if not len(expanded) and len(root):
        raise FileFormatError(
            "the file defines macros of xacro alone, and no robot; load the file that calls them",
            path=str(path),
            culprit=f"<{shown_tag(root)}>",
        )
    return expanded


@contextlib.contextmanager
def expanding_once() -> Iterator[None]:
    """Let xacro write out the macros of a file once, however often the file is read within.

    Yields
    ------
    None
        While texts are kept.
    """
    token = _WRITTEN_OUT.set({})
    try:
        yield
    finally:
        _WRITTEN_OUT.reset(token)


def _parse(path: Path, text: str) -> etree._Element:
    """Parse a text without comments."""
    if not text.strip():
        raise FileFormatError("the file is empty", path=str(path))
    # Refused before parsing: entities would be expanded inside attributes whatever the parser's options.
    if "<!DOCTYPE" in text.upper():
        raise FileFormatError(
            "a document type declaration (<!DOCTYPE) is refused, because entities can exhaust the memory; remove it",
            path=str(path),
            culprit="<!DOCTYPE",
        )
    # The parser gets exactly the text just searched: `encoding` overrules what the file declares.
    parser = etree.XMLParser(
        encoding="utf-8", recover=True, resolve_entities=False, no_network=True, load_dtd=False,
        remove_comments=True, remove_pis=True,
    )  # fmt: skip
    try:
        root = etree.fromstring(text.encode(), parser)
    except etree.XMLSyntaxError as error:
        raise FileFormatError(f"not well-formed XML: {error}", path=str(path)) from None
    for fault in parser.error_log:
        if (
            fault.level >= etree.ErrorLevels.ERROR
            and fault.type != etree.ErrorTypes.NS_ERR_UNDEFINED_NAMESPACE
        ):
            raise FileFormatError(f"not well-formed XML: {fault.message} (line {fault.line})", path=str(path))
    if None in root.nsmap:
        own = f"{{{root.nsmap[None]}}}"
        for element in root.iter(etree.Element):
            element.tag = str(element.tag).removeprefix(own)
    return root


_XACRO = threading.Lock()
"""The package keeps the file that it works on in variables of its own."""
_UPWARD = 8
"""Folders above a file that may hold, or be, the package that a file of xacro refers to."""


def _written_out(path: Path) -> str:
    """Text of a file without macros, from `expanding_once` where it was written out before."""
    kept = _WRITTEN_OUT.get()
    if kept is None:
        return _expand(path)
    if path not in kept:
        kept[path] = _expand(path)
    return kept[path]


def _names_package(folder: Path, package: str) -> bool:
    """Tell whether a folder is a package of ROS of that name."""
    told = folder / "package.xml"
    return (
        told.is_file()
        and re.search(rf"<name>\s*{re.escape(package)}\s*</name>", _read_text(told)) is not None
    )


def _expand(path: Path) -> str:
    """Let xacro write out the macros of a file; it opens what the file includes, and no network."""
    try:
        import xacro  # noqa: PLC0415
        from xacro import substitution_args  # noqa: PLC0415
    except ImportError:
        raise MissingExtraError("xacro", "xacro") from None

    place = path.absolute()
    installed = substitution_args._eval_find

    def find(package: str) -> str:
        for folder in place.parents[:_UPWARD]:
            if folder.name == package or _names_package(folder, package):
                return str(folder)
            if (folder / package).is_dir():
                return str(folder / package)
        try:
            return str(installed(package))
        except Exception:
            raise substitution_args.ArgException(
                f"$(find {package}), as no folder of that name holds the file or lies beside one that does"
            ) from None

    with _XACRO, contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
        substitution_args._eval_find = find
        try:
            document: Any = xacro.process_file(str(place))
            return str(document.toprettyxml(indent=" "))
        # What a file makes it do has no base of its own: any error of Python may come out of an expression.
        except Exception as error:
            missing = isinstance(getattr(error, "exc", None), OSError)  # told twice
            said = " ".join((str(error.args[0] if missing else error) or type(error).__name__).split())
            raise FileFormatError(
                f"xacro refuses the file: {said}; give the arguments their default values in the file, and put what "
                "it includes where it looks for it",
                path=str(path),
                culprit="<xacro>",
            ) from None
        finally:
            substitution_args._eval_find = installed


def _blank(found: re.Match[str]) -> str:
    """Blank out a comment, lines kept: many hold a double hyphen, which XML forbids and robot software reads."""
    return found[0] if found[0].startswith("<![") else " " + "\n" * found[0].count("\n")


def _read_text(path: Path) -> str:
    try:
        content = path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        raise FileMissingError("no such file", path=str(path)) from None
    except OSError as error:
        raise FileFormatError(f"the file cannot be read: {error.strerror}", path=str(path)) from None
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        name = codec = "utf-16"
    else:
        content = content.removeprefix(codecs.BOM_UTF8)
        declared = _DECLARED.match(content)
        name = declared[1].decode("ascii", "replace") if declared else "utf-8"
        try:
            codec = codecs.lookup(name).name
        except LookupError:
            codec = ""
        if codec not in _CODECS:
            raise FileFormatError(f"the encoding {name!r} is refused; save the file as UTF-8", path=str(path))
    try:
        return content.decode(codec)
    except UnicodeDecodeError as error:
        raise FileFormatError(
            f"not text in the encoding {name} (byte {error.start}); save the file as UTF-8", path=str(path)
        ) from None


def shown_tag(element: etree._Element) -> str:
    """Print an element's tag as it stands in the file, with its prefix.

    Parameters
    ----------
    element
        The element.

    Returns
    -------
    str
        ``prefix:name`` or ``name``.
    """
    local = str(element.tag).rpartition("}")[2]
    return f"{element.prefix}:{local}" if element.prefix else local


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
    # Some readers of XML do not know "e+30".
    return " ".join(repr(float(value) + 0.0).removesuffix(".0").replace("e+", "e") for value in values)


class ElementReader:
    """Reads attributes of one file's elements, with errors that name file, owner and attribute.

    Attributes
    ----------
    path
        The file, for messages.
    """

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
                f"{owner}: <{shown_tag(element)}> (line {element.sourceline}) lacks '{attribute}'", owner
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
        found = self.optional(element, tag, owner)
        if found is None:
            raise self.error(f"{owner} (line {element.sourceline}) needs a <{tag}>", owner)
        return found

    def optional(self, element: etree._Element, tag: str, owner: str) -> etree._Element | None:
        """Find a child element, of which there may be at most one.

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
        lxml.etree._Element or None
            The child.
        """
        found = [child for child in element.iterchildren(etree.Element) if shown_tag(child) == tag]
        if len(found) > 1:
            raise self.error(f"{owner} has {len(found)} <{tag}>; keep one", owner)
        return found[0] if found else None

    def only(
        self, element: etree._Element, owner: str, attributes: Collection[str], tags: Collection[str] = ()
    ) -> None:
        """Refuse what an element should not hold: a number under a name that nobody reads changes the robot.

        Parameters
        ----------
        element
            Where to look.
        owner
            Named in the message.
        attributes
            Known attributes.
        tags
            Known children.
        """
        strangers = [f"attribute '{name}'" for name in element.attrib if name not in attributes]
        inner = [shown_tag(child) for child in element.iterchildren(etree.Element)]
        strangers += [f"<{tag}>" for tag in inner if tag not in tags]
        if strangers:
            raise self.error(
                f"{owner}: {strangers[0]} of <{shown_tag(element)}> (line {element.sourceline}) is not understood; "
                f"it may have {', '.join([*attributes, *(f'<{tag}>' for tag in tags)])}",
                owner,
            )

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
        return self.parse(text, n, f"{owner}: <{shown_tag(element)} {attribute}>", owner)

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
            (n,) the numbers, in the unit of the attribute [m, rad, kg, kg m²].
        """
        try:
            # Python's float also takes 1_000 and the digits of other scripts.
            values = np.array(
                [float(word if word.isascii() and "_" not in word else "") for word in text.split()]
            )
        except ValueError:
            raise self.error(f"{where} must hold numbers, got {_short(text)}", culprit) from None
        if values.size == 0 or (n is not None and values.size != n):
            wanted = "numbers" if n is None else "one number" if n == 1 else f"{n} numbers"
            raise self.error(f"{where} must hold {wanted}, got {_short(text)}", culprit)
        if not (np.abs(values) <= UNLIMITED).all():
            raise self.error(f"{where} must be finite, at most {UNLIMITED:g}; got {_short(text)}", culprit)
        return values

    def whole_inertia(
        self, found: dict[str, float], line: int | None, owner: str
    ) -> tuple[dict[str, float], tuple[str, ...]]:
        """Give entries of an ``<inertia>`` that stand below its diagonal their names above it.

        Parameters
        ----------
        found
            Entries that the file holds, by name [kg m²].
        line
            Line of the element.
        owner
            Named in the message.

        Returns
        -------
        whole : dict
            By the names of `INERTIA_ENTRIES`, those that the file holds [kg m²].
        told : tuple of str
            Which were named otherwise, for the report.

        Raises
        ------
        FileFormatError
            If both stand there and differ.
        """
        whole = {key: value for key, value in found.items() if key not in MIRRORED}
        for mirrored, key in MIRRORED.items():
            if mirrored in found and whole.setdefault(key, found[mirrored]) != found[mirrored]:
                raise self.error(
                    f"{owner}: {key} and {mirrored} of <inertia> (line {line}) differ; "
                    f"an inertia is symmetric, remove {mirrored}",
                    owner,
                )
        told = [
            (mirrored, key) for mirrored, key in MIRRORED.items() if mirrored in found and key not in found
        ]
        return whole, tuple(f"{mirrored} of <inertia>: read as {key}" for mirrored, key in told)


INERTIA_ENTRIES = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
"""Entries of ``<inertia>`` and their places in the matrix."""
MIRRORED = {"iyx": "ixy", "izx": "ixz", "izy": "iyz"}
"""Names of entries below the diagonal, and of the same above it."""


def _short(text: str) -> str:
    return repr(text if len(text) <= 60 else text[:57] + "...")


# ----------------------------------------------------------------------------------------------------
# Tags of a robot file that are not read: some are harmless, some could change the mechanism
# ----------------------------------------------------------------------------------------------------

DIALECTS = (
    "<loop>, <coupling>, <loop_joint>, <drake:ball_constraint>, <constraint>, <gazebo><joint>, <mimic>, a YAML beside "
    "the URDF, frames closing_*_1, closing_*_2, and a link with two parents"
)
"""Loop syntaxes that `load` understands."""

PLACED_BY_JOINT = "a link stands where its joint places it"
"""Why an ``<origin>`` of a link, which published files have, is not read."""
_HARMLESS = {
    "origin": PLACED_BY_JOINT,
    "visual": "for viewers",
    "collision": "collision shapes",
    "material": "colours are for viewers",
    "safety_controller": "controller settings",
    "calibration": "encoder settings",
    "contact": "simulator settings",
    "transmission": "motors are the joints marked independent",
    "ros2_control": "motors are the joints marked independent",
    "joint_properties": "a word of old files that no reader of today knows; write <dynamics>",
    "gazebo": "simulator settings",
    "mujoco": "simulator settings",
    "sensor": "sensors",
    "group": "semantic groups",
    "group_state": "only the state 'home' is read",
    "end_effector": "only the one called 'platform' is read",
    "disable_collisions": "collision settings",
    "passive_joint": "motors are the joints marked independent",
    "virtual_joint": "the root link is the ground",
}
_LOOP = re.compile("loop|constraint|closure|closing|coupling|connect|weld|mimic|equality")
_LOOP_OR_JOINT = re.compile(f"{_LOOP.pattern}|joint")
_UNEXPANDED = {
    "xacro": "expand the file with xacro first",
    "xi": "put the included text into the file",
}


def reason_to_ignore(reader: ElementReader, element: etree._Element, owner: str) -> str:
    """Say why a tag is not read, or stop: it could close a loop or couple joints, in a dialect that is not understood.

    Parameters
    ----------
    reader
        Reader of the file, for the error.
    element
        The tag.
    owner
        Link or joint that holds it, for the message.

    Returns
    -------
    str
        Why the mechanism does not need it.

    Raises
    ------
    FileFormatError
        If the tag, or one inside it, could change the mechanism.
    """
    for inner in element.iter(etree.Element):
        shown = shown_tag(inner)
        prefix, _, local = shown.rpartition(":")
        if prefix in _UNEXPANDED:
            raise reader.error(f"<{shown}> (line {inner.sourceline}): {_UNEXPANDED[prefix]}", f"<{shown}>")
        if _may_close_a_loop(inner, local.lower(), is_outermost=inner is element):
            if shown == "plugin":
                shown = f"plugin {inner.get('name') or inner.get('filename')}"
            path = "".join(f"<{tag}>" for tag in dict.fromkeys((shown_tag(element), shown)))
            raise reader.error(
                f"{path} (line {inner.sourceline}) of {owner} could close a loop or couple joints, and is not "
                f"understood; supported: {DIALECTS}",
                path,
            )
    return _HARMLESS.get(shown_tag(element), "unknown tag")


def _may_close_a_loop(element: etree._Element, name: str, *, is_outermost: bool) -> bool:
    if is_outermost:
        return name == "link" or (name not in _HARMLESS and bool(_LOOP_OR_JOINT.search(name)))
    if name == "plugin":
        words = (element.get("filename", "") + element.get("name", "")).lower()
        return "detachable" in words
    if next(element.iterancestors("plugin"), None) is not None:
        return "mimic" in name
    if _LOOP.search(name):
        return True
    # Plugins list joints by name only; a joint of a simulator's model has a type, or links.
    return name == "joint" and ("type" in element.attrib or element.find("child") is not None)
