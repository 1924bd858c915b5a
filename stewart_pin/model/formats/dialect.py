"""What a loop dialect of URDF is: the tags it claims, how they are read, and how a mechanism is written in it.

Three things that dialects share stand below: how files are written, files beside a URDF that declare its loops, and
frames that a file names.
"""

from __future__ import annotations

import codecs
import importlib
import os
import pkgutil
import stat
import threading
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.errors import FileFormatError, InputError, UnsupportedError
from stewart_pin.model.description import (
    BALL,
    Bounds,
    Coupling,
    Joint,
    JointKind,
    Link,
    Loop,
    Mechanism,
    Note,
    Outcome,
)
from stewart_pin.model.formats.urdf_elements import CORE, UrdfElements
from stewart_pin.model.formats.words import Grammar, Words
from stewart_pin.model.unfolding import Unfolded


@dataclass(frozen=True, eq=False)
class Parts:
    """What one tag of a dialect adds to a mechanism.

    Attributes
    ----------
    links, joints, loops, couplings
        New parts.
    notes
        What the reader made of the tag.
    motors
        Joints that the tag names as driven; None: it is no list of motors.
    rotors
        Joints that get a rotor, with its inertia times the square of the gear ratio [kg or kg m²].
    later
        What the tag adds once all links and joints are known: called with the mechanism, in the order of the file.
    """

    links: tuple[Link, ...] = ()
    joints: tuple[Joint, ...] = ()
    loops: tuple[Loop, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    notes: tuple[Note, ...] = ()
    motors: tuple[str, ...] | None = None
    rotors: tuple[tuple[str, float], ...] = ()
    later: Callable[[Mechanism], Parts] | None = None

    @classmethod
    def of(cls, unfolded: Unfolded, notes: tuple[Note, ...] = ()) -> Parts:
        """Make parts of a joint that was unfolded.

        Parameters
        ----------
        unfolded
            The row of joints.
        notes
            Notes besides its own.

        Returns
        -------
        Parts
            Links, joints, couplings and notes.
        """
        return cls(unfolded.links, unfolded.joints, (), unfolded.couplings, (unfolded.note, *notes))


TagReader = Callable[[UrdfElements, etree._Element], Parts]
"""Reads one element; its owner is the element's parent."""


@dataclass(frozen=True, eq=False)
class Dialect:
    """One way of writing loops and couplings into, or beside, a URDF.

    Attributes
    ----------
    name
        Short name; with a writer, the ``format`` of `export`.
    title
        How messages call it.
    tags
        Reader of every tag that belongs to the dialect: ``{"robot/loop": read_loop, "joint/mimic": read_mimic}``,
        the parent's tag first, prefixes as in the file.
    words
        What its elements may hold.
    complete
        Last step, after all tags of the file have been read: finds what stands in names or in the shape of the
        tree; None: there is no such step.
    suffixes
        Endings of the side-car files in which the dialect stands beside a URDF, in small letters.
    is_side_car
        Tells from its text a side-car file of the dialect that was not asked for from other files.
    add_side_car
        Adds what a side-car file says to a mechanism; None: the dialect has no side-car files.
    write
        Writes a mechanism, its home complete, and notes what it has no word for; None: the dialect is only read.
    """

    name: str
    title: str
    tags: Mapping[str, TagReader] = field(default_factory=dict)
    words: Mapping[str, Words] = field(default_factory=dict)
    complete: Callable[[Mechanism], Mechanism] | None = None
    suffixes: tuple[str, ...] = ()
    is_side_car: Callable[[str], bool] = bool
    add_side_car: Callable[[Mechanism, Path], Mechanism] | None = None
    write: Callable[[Mechanism, Path], tuple[Note, ...]] | None = None


@cache
def dialects() -> tuple[Dialect, ...]:
    """Find all dialects: every module in the folder ``dialects`` that holds a ``DIALECT``, or several ``DIALECTS``.

    Returns
    -------
    tuple of Dialect
        In the alphabetical order of the modules.
    """
    folder = importlib.import_module("stewart_pin.model.formats.dialects")
    modules = sorted(module.name for module in pkgutil.iter_modules(folder.__path__))
    found = (importlib.import_module(f"{folder.__name__}.{name}") for name in modules)
    held = (getattr(module, "DIALECTS", (getattr(module, "DIALECT", None),)) for module in found)
    return tuple(dialect for several in held for dialect in several if dialect is not None)


@cache
def claimed_tags() -> Mapping[str, Dialect]:
    """Collect the tags of all dialects.

    Returns
    -------
    dict
        Dialect of each ``parent/tag``.
    """
    return {tag: dialect for dialect in dialects() for tag in dialect.tags}


@cache
def grammar() -> Grammar:
    """Collect the words of URDF and of all dialects.

    Returns
    -------
    dict
        What each element may hold; the tags that dialects claim among them.
    """
    words = dict(CORE)
    for dialect in dialects():
        words |= dialect.words
    for claimed in claimed_tags():
        parent, _, tag = claimed.partition("/")
        key = f"robot/{parent}" if f"robot/{parent}" in words else parent
        words[key] = replace(words[key], tags=(*words[key].tags, tag))
    return words


def add_parts(mechanism: Mechanism, parts: Parts, title: str) -> Mechanism:
    """Add what a tag holds to a mechanism, and note where it was found.

    Parameters
    ----------
    mechanism
        What has been read so far.
    parts
        What the tag adds.
    title
        How the report calls the dialect.

    Returns
    -------
    Mechanism
        Both together.
    """
    return replace(
        mechanism,
        links=mechanism.links + parts.links,
        joints=mechanism.joints + parts.joints,
        loops=mechanism.loops + parts.loops,
        couplings=mechanism.couplings + parts.couplings,
        notes=(*mechanism.notes, *found_notes(parts, title), *parts.notes),
    )


def found_notes(parts: Parts, title: str) -> tuple[Note, ...]:
    """Note in which dialect loops and couplings were found.

    Parameters
    ----------
    parts
        What a tag holds.
    title
        How the report calls the dialect.

    Returns
    -------
    tuple of Note
        One per loop and coupling.
    """
    names = [f"loop '{loop.name}'" for loop in parts.loops]
    names += [f"coupling '{coupling.name}'" for coupling in parts.couplings]
    return tuple(Note(name, f"read as {title}", Outcome.KEPT) for name in names)


# ----------------------------------------------------------------------------------------------------
# Files of any format, written whole or not at all
# ----------------------------------------------------------------------------------------------------


def write_files(contents: Mapping[Path, etree._Element | str]) -> None:
    """Write files whole or not at all: each is written beside its place first, and put there when all are complete.

    What a link points to is replaced, and the link stays; of a file with several names, this one gets the new content.

    Parameters
    ----------
    contents
        Root element, or text, of each file; they are put in place in this order.

    Raises
    ------
    InputError
        If a file has no place there.
    OSError
        If a disk is full, or fails; what was there before is still there, or, of several files, the later ones.
    """
    ready: dict[Path, Path] = {}
    try:
        for path, content in contents.items():
            place = _place(path)
            whole = (
                content.encode()
                if isinstance(content, str)
                else etree.tostring(content, pretty_print=True, xml_declaration=True, encoding="utf-8")
            )
            written = place.with_name(f".{place.name[:100]}.{os.getpid()}.{threading.get_ident()}.part")
            ready[written] = place
            # Opened by name, so that the system takes its mask of permissions into account.
            with written.open("wb") as file:
                file.write(whole)
                file.flush()
                os.fsync(file.fileno())
            if place.exists():
                written.chmod(stat.S_IMODE(place.stat().st_mode))
        for written, place in ready.items():
            written.replace(place)
    finally:
        for written in ready:
            written.unlink(missing_ok=True)


def _place(path: Path) -> Path:
    """Find where a file is to stand, or say why it cannot."""
    place = Path(os.path.realpath(path))
    fault = ""
    if place.is_dir():
        fault = "it is a folder; give the name of a file in it"
    elif not place.parent.is_dir():
        fault = f"the folder '{place.parent}' does not exist; make it first"
    elif place.exists() and not place.is_file():
        fault = "it is no plain file; write a file, and copy it there"
    elif place.exists() and not os.access(place, os.W_OK):
        fault = "the file is write-protected; allow writing, or choose another name"
    elif not os.access(place.parent, os.W_OK):
        fault = f"nothing may be written into the folder '{place.parent}'; choose another one"
    if fault:
        raise InputError(f"path: cannot write {str(path)!r}: {fault}")
    return place


# ----------------------------------------------------------------------------------------------------
# Limits that a format has no word for
# ----------------------------------------------------------------------------------------------------


def note_lost_limits(mechanism: Mechanism, format: str, *, balls: Collection[str] = BALL) -> tuple[Note, ...]:
    """Note limits of loops, and of balls of the tree, which a format leaves out.

    Parameters
    ----------
    mechanism
        What is written.
    format
        Named in the notes.
    balls
        Which limits of balls of the tree are left out.

    Returns
    -------
    tuple of Note
        One per loop and ball that has such limits.
    """
    notes = [
        Note(f"loop '{loop.name}'", f"its limits are left out: '{format}' has no word for them")
        for loop in mechanism.loops
        if any(bounds != Bounds() for bounds in loop.bounds)
    ]
    for joint in mechanism.joints:
        stated = [key for key, end in zip(BALL, (joint.swing, joint.turn), strict=True) if end < np.inf]
        lost = [key for key in stated if key in balls]
        if lost:
            text = f"its limits of {' and '.join(lost)} are left out: '{format}' has no word for them"
            notes.append(Note(f"joint '{joint.name}'", text))
    return tuple(notes)


# ----------------------------------------------------------------------------------------------------
# Files beside a URDF that declare its loops
# ----------------------------------------------------------------------------------------------------

COMPLETE = ("loops", "here")
"""Attribute of ``<robot>`` in a URDF that has all its loops, whatever lies beside it."""


def add_side_car(mechanism: Mechanism, path: Path) -> Mechanism:
    """Add what a side-car file says.

    Parameters
    ----------
    mechanism
        What the URDF says.
    path
        The side-car file.

    Returns
    -------
    Mechanism
        Both together.

    Raises
    ------
    UnsupportedError
        If no dialect has side-car files of that type.
    """
    by_suffix = side_car_suffixes()
    dialect = by_suffix.get(path.suffix.lower())
    if dialect is None or dialect.add_side_car is None:
        raise UnsupportedError(
            f"loops={str(path)!r}: side-car files of type '{path.suffix}' are not supported; supported: "
            f"{', '.join(by_suffix)}"
        )
    return dialect.add_side_car(mechanism, path)


def find_beside(path: Path) -> list[Path]:
    """Find the side-car files of a URDF: of the same name, but for the ending, and with loops in them.

    Parameters
    ----------
    path
        The URDF.

    Returns
    -------
    list of pathlib.Path
        Whatever the case of their endings, and in UTF-8 or UTF-16.
    """
    by_suffix = side_car_suffixes()
    try:
        beside = sorted(each for each in path.parent.iterdir() if each.stem == path.stem)
    except OSError:  # the folder is not to be listed
        beside = [path.with_suffix(suffix) for suffix in by_suffix]
    return [
        each
        for each in beside
        if (dialect := by_suffix.get(each.suffix.lower())) is not None
        and each.is_file()
        and dialect.is_side_car(side_car_text(each.read_bytes()))
    ]


def side_car_text(content: bytes) -> str:
    """Decode a file that may hold loops.

    Parameters
    ----------
    content
        The file.

    Returns
    -------
    str
        Its text; what is no UTF-16 with its mark, and no UTF-8, is replaced.
    """
    marked = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    return content.decode("utf-16" if marked else "utf-8-sig", errors="replace")


def side_car_suffixes() -> dict[str, Dialect]:
    """List the endings of side-car files.

    Returns
    -------
    dict
        Dialect by ending.
    """
    return {suffix: dialect for dialect in dialects() for suffix in dialect.suffixes}


# ----------------------------------------------------------------------------------------------------
# Frames that a file names: which link carries them, and where links stand while all joints are at zero
# ----------------------------------------------------------------------------------------------------

AT_ZERO = "the file places it in one link; the other is taken to lie as it does while all joints are at zero"
"""Note on a loop that was placed by `relative_at_zero`."""


def find_frame(mechanism: Mechanism, name: str, owner: str) -> str:
    """Find the link whose frame a name stands for.

    Parameters
    ----------
    mechanism
        What has been read so far.
    name
        Name of a link, or of a joint: the frame of its child, which moves with it.
    owner
        Named in the message.

    Returns
    -------
    str
        Name of a link.

    Raises
    ------
    FileFormatError
        If no frame has that name, or if a link and a joint to another link have it.
    """
    found = {joint.child for joint in mechanism.joints if joint.name == name}
    found |= {link.name for link in mechanism.links if link.name == name}
    if len(found) != 1:
        have = ", ".join(sorted(link.name for link in mechanism.links))
        fault = (
            f"there is no link or joint '{name}'" if not found else f"a link and a joint are called '{name}'"
        )
        raise FileFormatError(f"{owner}: {fault}; the links are: {have}", path=mechanism.source, culprit=name)
    return found.pop()


def carrier(mechanism: Mechanism, link: str) -> tuple[str, pin.SE3]:
    """Find the body that carries a link which is there for its frame only.

    Parameters
    ----------
    mechanism
        What has been read so far.
    link
        Name of the link.

    Returns
    -------
    link : str
        The parent, if the link is fixed to it and carries nothing itself; else the link.
    placement : pinocchio.SE3
        Frame of the given link in the returned one.
    """
    above = [joint for joint in mechanism.joints if joint.child == link]
    carries = any(joint.parent == link for joint in mechanism.joints)
    if carries or len(above) != 1 or above[0].kind is not JointKind.FIXED:
        return link, pin.SE3.Identity()
    return above[0].parent, above[0].placement


def placement_at_zero(mechanism: Mechanism, link: str) -> pin.SE3:
    """Place a link in the root of its tree while all joints are at zero.

    Parameters
    ----------
    mechanism
        What has been read so far.
    link
        Name of the link.

    Returns
    -------
    pinocchio.SE3
        Placement of the link; where several joints lead to a link, the first counts.
    """
    placement = pin.SE3.Identity()
    for joint in upward(mechanism, link):
        placement = joint.placement * placement
    return placement


def relative_at_zero(mechanism: Mechanism, link1: str, link2: str, owner: str) -> pin.SE3:
    """Place one link in another while all joints are at zero.

    Parameters
    ----------
    mechanism
        What has been read so far.
    link1, link2
        Names of the links.
    owner
        Named in the message.

    Returns
    -------
    pinocchio.SE3
        Placement of link 2 in link 1.

    Raises
    ------
    FileFormatError
        If a link is missing.
    """
    require_links(mechanism, (link1, link2), owner)
    return placement_at_zero(mechanism, link1).actInv(placement_at_zero(mechanism, link2))


def require_links(mechanism: Mechanism, links: Collection[str], owner: str) -> None:
    """Refuse names of links that are not there.

    Parameters
    ----------
    mechanism
        What has been read so far.
    links
        Names of links.
    owner
        Named in the message.

    Raises
    ------
    FileFormatError
        If a link is missing.
    """
    names = {link.name for link in mechanism.links}
    for link in links:
        if link not in names:
            raise FileFormatError(
                f"{owner} names the missing link '{link}'; the links are: {', '.join(sorted(names))}",
                path=mechanism.source,
                culprit=owner,
            )


def upward(mechanism: Mechanism, link: str) -> list[Joint]:
    """List the joints between a link and the root of its tree.

    Parameters
    ----------
    mechanism
        What has been read so far.
    link
        Name of the link.

    Returns
    -------
    list of Joint
        From the link up.
    """
    above: dict[str, Joint] = {}
    for joint in mechanism.joints:
        above.setdefault(joint.child, joint)
    path: list[Joint] = []
    while link in above and above[link] not in path:
        path.append(above[link])
        link = above[link].parent
    return path
