"""What a loop dialect of URDF is: the tags it claims, how they are read, and how a mechanism is written in it."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from lxml import etree

from stewart_pin.model.description import Coupling, Joint, Link, Loop, Mechanism, Note
from stewart_pin.model.formats.urdf_elements import UrdfElements


@dataclass(frozen=True, eq=False)
class Parts:
    """What one tag of a dialect adds to a mechanism.

    Attributes
    ----------
    links, joints, loops, couplings
        New parts.
    notes
        What the reader made of the tag.
    """

    links: tuple[Link, ...] = ()
    joints: tuple[Joint, ...] = ()
    loops: tuple[Loop, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    notes: tuple[Note, ...] = ()


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
    write
        Writes a mechanism, its home complete; None: the dialect is only read.
    """

    name: str
    title: str
    tags: Mapping[str, TagReader] = field(default_factory=dict)
    complete: Callable[[Mechanism], Mechanism] | None = None
    write: Callable[[Mechanism, Path], None] | None = None


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
