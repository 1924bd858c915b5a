"""What a loop dialect of URDF is: the tags it claims, how they are read, and how a mechanism is written in it."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

from lxml import etree

from stewart_pin.errors import UnsupportedError
from stewart_pin.model.description import Coupling, Joint, Link, Loop, Mechanism, Note, Outcome
from stewart_pin.model.formats.urdf_elements import UrdfElements
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
    later
        What the tag adds once all links and joints are known: called with the mechanism, in the order of the file.
    """

    links: tuple[Link, ...] = ()
    joints: tuple[Joint, ...] = ()
    loops: tuple[Loop, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    notes: tuple[Note, ...] = ()
    motors: tuple[str, ...] | None = None
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
    complete
        Last step, after all tags of the file have been read: finds what stands in names or in the shape of the
        tree; None: there is no such step.
    suffixes
        Endings of the side-car files in which the dialect stands beside a URDF, in small letters.
    mark
        Word that a side-car file of the dialect holds, by which one that was not asked for is told from other files.
    add_side_car
        Adds what a side-car file says to a mechanism; None: the dialect has no side-car files.
    write
        Writes a mechanism, its home complete, and notes what it has no word for; None: the dialect is only read.
    """

    name: str
    title: str
    tags: Mapping[str, TagReader] = field(default_factory=dict)
    complete: Callable[[Mechanism], Mechanism] | None = None
    suffixes: tuple[str, ...] = ()
    mark: str = ""
    add_side_car: Callable[[Mechanism, Path], Mechanism] | None = None
    write: Callable[[Mechanism, Path], tuple[Note, ...]] | None = None


@cache
def dialects() -> tuple[Dialect, ...]:
    """Find all dialects: every module in the folder ``dialects`` that holds a ``DIALECT``.

    Returns
    -------
    tuple of Dialect
        In the alphabetical order of the modules.
    """
    folder = importlib.import_module("stewart_pin.model.formats.dialects")
    modules = sorted(module.name for module in pkgutil.iter_modules(folder.__path__))
    found = (importlib.import_module(f"{folder.__name__}.{name}") for name in modules)
    return tuple(module.DIALECT for module in found if hasattr(module, "DIALECT"))


@cache
def claimed_tags() -> Mapping[str, Dialect]:
    """Collect the tags of all dialects.

    Returns
    -------
    dict
        Dialect of each ``parent/tag``.
    """
    return {tag: dialect for dialect in dialects() for tag in dialect.tags}


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


def find_beside(path: Path) -> Path | None:
    """Find the side-car file of a URDF: of the same name, but for the ending, and with loops in it.

    Parameters
    ----------
    path
        The URDF.

    Returns
    -------
    pathlib.Path or None
        The first that exists.
    """
    for suffix, dialect in side_car_suffixes().items():
        beside = path.with_suffix(suffix)
        if beside.is_file() and dialect.mark.encode() in beside.read_bytes():
            return beside
    return None


def side_car_suffixes() -> dict[str, Dialect]:
    """List the endings of side-car files.

    Returns
    -------
    dict
        Dialect by ending.
    """
    return {suffix: dialect for dialect in dialects() for suffix in dialect.suffixes}
