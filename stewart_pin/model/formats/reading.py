"""URDF, with loops and couplings in any dialect that `dialect` finds; and which reader a file of any format goes to.

The core of URDF is read by `urdf_core`. Every other tag belongs to a dialect, is known to be harmless, or is refused.
Then come the file beside the URDF, if there is one, and what stands in the names and in the shape of the tree: a joint
that gives a link a second parent becomes a loop. Where no joint is marked, motors are those that the file names. The
notes say what was done.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pinocchio as pin
from lxml import etree

from stewart_pin.errors import FileFormatError, UnsupportedError
from stewart_pin.model.description import Joint, JointKind, Link, Mechanism, Note, Outcome
from stewart_pin.model.formats.dialect import (
    COMPLETE,
    Parts,
    add_parts,
    add_side_car,
    claimed_tags,
    dialects,
    find_beside,
    found_notes,
    grammar,
    side_car_suffixes,
)
from stewart_pin.model.formats.dynamics import with_rotors
from stewart_pin.model.formats.mjcf.compiling import Names
from stewart_pin.model.formats.mjcf.reading import read_mjcf
from stewart_pin.model.formats.sdf import read_sdf
from stewart_pin.model.formats.urdf_core import (
    joint_tags,
    read_assembled,
    read_gravity,
    read_home,
    read_joint,
    read_link,
    read_odd_inertias,
    read_platform,
)
from stewart_pin.model.formats.urdf_elements import SHAPE_TAGS, UrdfElements, is_used
from stewart_pin.model.formats.usd.reading import read_usd
from stewart_pin.model.formats.usd.stage import SUFFIXES as USD_SUFFIXES
from stewart_pin.model.formats.words import check_words, telling_strangers
from stewart_pin.model.formats.xml import read_xml, reason_to_ignore, shown_tag
from stewart_pin.model.roles import mark_motors
from stewart_pin.model.unfolding import cut_second_parents

# ----------------------------------------------------------------------------------------------------
# Motors that a file names beside its joints: taken where no joint is marked independent and nothing is ambiguous
# ----------------------------------------------------------------------------------------------------


_WORLD, _DRAKE = "world", "drake"
_VERSIONS = ("1.0", "1.1", "1.2")
_MARKED = "motors are the joints marked independent"


def choose_motors(mechanism: Mechanism, named: Sequence[tuple[str, str, tuple[str, ...]]]) -> Mechanism:
    """Let tags that name joints mark the motors, if they can only mean one thing.

    Parameters
    ----------
    mechanism
        What the rest of the file says.
    named
        Per tag of the file: its kind, how the report calls it, and the joints that it names.

    Returns
    -------
    Mechanism
        With motors in the order of the tags, where no joint was marked independent, every named joint exists, has one
        freedom and is named once, and all kinds of tags name the same joints; else as it was. The notes say which.
    """
    if not named:
        return mechanism
    fault = _MARKED if any(joint.independent for joint in mechanism.joints) else _ambiguity(mechanism, named)
    if fault:
        ignored = tuple(Note(subject, fault) for _, subject, _ in named)
        movable = {joint.name for joint in mechanism.joints if joint.has_axis}
        hints = dict.fromkeys(joint for _, _, joints in named for joint in joints if joint in movable)
        return replace(mechanism, notes=mechanism.notes + ignored, motor_hints=tuple(hints))
    first = named[0][0]
    motors = [joint for kind, _, joints in named for joint in joints if kind == first]
    kept = tuple(Note(subject, "names the motors", Outcome.KEPT) for _, subject, joints in named if joints)
    return replace(mark_motors(mechanism, motors), notes=mechanism.notes + kept)


def _ambiguity(mechanism: Mechanism, named: Sequence[tuple[str, str, tuple[str, ...]]]) -> str:
    """Say why named joints cannot be taken for the motors; empty: they can."""
    movable = {joint.name for joint in mechanism.joints if joint.has_axis}
    by_kind: dict[str, list[str]] = {}
    for kind, subject, joints in named:
        if kind == "transmission" and len(joints) != 1:
            return f"not taken for motors: {subject} leads to {len(joints)} joints; pass motors=[...]"
        by_kind.setdefault(kind, []).extend(joints)
    for joints in by_kind.values():
        for joint in joints:
            if joint not in movable:
                return f"not taken for motors: joint '{joint}' is missing or has not one freedom; pass motors=[...]"
            if joints.count(joint) > 1:
                return f"not taken for motors: joint '{joint}' is named twice; pass motors=[...]"
    if len({frozenset(joints) for joints in by_kind.values()}) > 1:
        return (
            f"not taken for motors: {' and '.join(f'<{kind}>' for kind in by_kind)} differ; pass motors=[...]"
        )
    return ""


# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Found:
    """What one tag held, and how the report calls tag and dialect."""

    parts: Parts
    title: str = ""
    tag: str = ""
    subject: str = ""


def read_urdf(path: Path, *, loops: Path | None = None) -> Mechanism:
    """Read a URDF with or without loops.

    Parameters
    ----------
    path
        File to read.
    loops
        Side-car file that declares loops; None: one that lies beside the file under the file's own name, if any.

    Returns
    -------
    Mechanism
        Description, not yet validated.

    Raises
    ------
    FileFormatError
        If the file is broken, or holds a tag that could mean a loop in a dialect that is not understood.
    MechanismError
        If a joint that would have to be cut is a motor.
    """
    reader = _UrdfReader(path)
    with telling_strangers(reader.notes):
        mechanism = reader.read()
        is_complete = reader.root.get(COMPLETE[0]) is not None
        if is_complete and loops is not None:
            raise reader.error(
                f"<robot {COMPLETE[0]}='{COMPLETE[1]}'> has all its loops, and {loops.name} would add them again; "
                f"load the URDF alone, or take the attribute '{COMPLETE[0]}' off",
                "<robot>",
            )
        beside = find_beside(path) if loops is None and not is_complete else []
        if len(beside) > 1:
            raise reader.error(
                f"{' and '.join(each.name for each in beside)} lie beside the file, and each declares loops; name the "
                f"one that is meant: loops={str(beside[0])!r}",
                beside[1].name,
            )
        for side_car in beside if loops is None else (loops,):
            mechanism = add_side_car(mechanism, side_car)
        for dialect in dialects():
            if dialect.complete is not None:
                mechanism = dialect.complete(mechanism)
        second_parents = len(mechanism.joints) > len({joint.child for joint in mechanism.joints})
        return cut(mechanism) if second_parents else mechanism


class _UrdfReader(UrdfElements):
    def read(self) -> Mechanism:
        if self.root.tag != "robot":
            raise self.error(f"the root element is <{shown_tag(self.root)}>, a URDF has <robot>", "<robot>")
        check_words(self, self.root, grammar(), self.note)
        if self.root.get(*COMPLETE) != COMPLETE[1]:
            raise self.error(
                f"<robot {COMPLETE[0]}='{self.root.get(COMPLETE[0])}'>: it may be '{COMPLETE[1]}', for a file that no "
                "other file adds loops to, or absent",
                "<robot>",
            )
        version = self.root.get("version", _VERSIONS[0])
        if version not in _VERSIONS:
            text = f"version '{version}': read as {_VERSIONS[-1]}, the newest that is known"
            self.note("the file", text, Outcome.CHANGED)
        found: list[_Found] = []
        for element in self.root.iterchildren(etree.Element):
            tag = shown_tag(element)
            if tag == "link":
                found.append(_Found(read_link(self, element)))
                found.extend(self._inner(element, ("inertial", *SHAPE_TAGS)))
            elif tag == "joint":
                found.append(_Found(read_joint(self, element)))
                found.extend(self._inner(element, joint_tags(element)))
            elif tag == "material" and is_used(self, element):
                reason_to_ignore(
                    self, element, "the file"
                )  # read with the shapes; stops at what could close a loop
            elif tag not in ("group_state", "end_effector", "gravity", "odd_inertia"):
                found.extend(self._in_a_dialect(element, "the file"))
        parts = [each.parts for each in found]
        links = tuple(link for part in parts for link in part.links)
        links += self._world(links, [joint for part in parts for joint in part.joints])
        mechanism = Mechanism(
            name=self.root.get("name") or Path(self.path).stem,
            links=links,
            joints=tuple(joint for part in parts for joint in part.joints),
            loops=tuple(loop for part in parts for loop in part.loops),
            couplings=tuple(coupling for part in parts for coupling in part.couplings),
            platform=read_platform(self, links),
            home=read_home(self),
            source=self.path,
            gravity=read_gravity(self),
            assembled=read_assembled(self),
            odd_inertias=read_odd_inertias(self, links),
            notes=(*self.notes, *(note for part in parts for note in part.notes)),
        )
        mechanism = self._floating(mechanism)
        rotors = [rotor for each in found for rotor in each.parts.rotors]
        if rotors:
            told = len(self.notes)
            mechanism = with_rotors(self, mechanism, rotors)
            mechanism = replace(mechanism, notes=(*mechanism.notes, *self.notes[told:]))
        for each in found:
            if each.parts.later is not None:
                mechanism = add_parts(mechanism, each.parts.later(mechanism), each.title)
        named = [
            (each.tag, each.subject, each.parts.motors) for each in found if each.parts.motors is not None
        ]
        return choose_motors(mechanism, named)

    def _world(self, links: tuple[Link, ...], joints: list[Joint]) -> tuple[Link, ...]:
        """Add the link ``world`` where a joint hangs on it and none is written: Drake has it from the start."""
        if _WORLD in (link.name for link in links) or all(joint.parent != _WORLD for joint in joints):
            return ()
        self.note(f"link '{_WORLD}'", "joints hang on it, and it is not written: the ground", Outcome.CHANGED)
        return (Link(_WORLD),)

    def _floating(self, mechanism: Mechanism) -> Mechanism:
        """Let links without a parent float, in a file of Drake's that has its ``world`` besides: so does Drake."""
        children = {joint.child for joint in mechanism.joints}
        roots = [link.name for link in mechanism.links if link.name not in children]
        of_drake = _DRAKE in self.root.nsmap or any(
            shown_tag(element).startswith(f"{_DRAKE}:") for element in self.root.iter(etree.Element)
        )
        if _WORLD not in roots or len(roots) == 1 or not of_drake:
            return mechanism
        names = Names(joint.name for joint in mechanism.joints)
        floating = tuple(
            Joint(names.fresh(f"{name}_floats"), JointKind.FLOATING, _WORLD, name, pin.SE3.Identity())
            for name in roots
            if name != _WORLD
        )
        notes = tuple(
            Note(f"link '{each.child}'", f"has no parent: floats in '{_WORLD}', as in Drake", Outcome.CHANGED)
            for each in floating
        )
        return replace(mechanism, joints=mechanism.joints + floating, notes=mechanism.notes + notes)

    def _in_a_dialect(self, element: etree._Element, owner: str) -> list[_Found]:
        """Read a tag by the dialect that claims it; note it, or refuse it, where none does."""
        parent = element.getparent()
        tag = f"{'' if parent is None else shown_tag(parent)}/{shown_tag(element)}"
        dialect = claimed_tags().get(tag)
        if dialect is None:
            self.ignore(element, owner)
            return []
        part = dialect.tags[tag](self, element)
        self.notes += found_notes(part, dialect.title)
        return [_Found(part, dialect.title, shown_tag(element), self.shown(element, owner))]

    def _inner(self, element: etree._Element, known: tuple[str, ...]) -> list[_Found]:
        """Read the children of a link or joint that are not of the core."""
        owner = f"{shown_tag(element)} '{element.get('name')}'"
        inner = [child for child in element.iterchildren(etree.Element) if shown_tag(child) not in known]
        return [found for child in inner for found in self._in_a_dialect(child, owner)]


def cut(mechanism: Mechanism) -> Mechanism:
    """Turn joints that give a link a second parent into loops.

    Parameters
    ----------
    mechanism
        Mechanism whose joints need not form a tree.

    Returns
    -------
    Mechanism
        The same machine; its home keeps the values of the joints that are left.
    """
    joints, loops, notes = cut_second_parents(mechanism.joints, source=mechanism.source)
    lost = {loop.name for loop in loops}
    return replace(
        mechanism,
        joints=joints,
        loops=mechanism.loops + loops,
        notes=mechanism.notes + notes,
        home={name: value for name, value in mechanism.home.items() if name not in lost},
    )


# ----------------------------------------------------------------------------------------------------
# Which reader a file goes to: by its root element, whatever its name; by its suffix where it is no XML
# ----------------------------------------------------------------------------------------------------

_SUFFIXES = (".urdf", ".sdf", ".world", ".xml", ".mjcf", ".xacro")

_READERS: dict[str, Callable[[Path], Mechanism]] = {
    "robot": read_urdf,
    "mujoco": read_mjcf,
    "sdf": read_sdf,
}
"""Reader of a file by the tag of its root element."""


def read_mechanism(path: Path, *, loops: Path | None = None) -> Mechanism:
    """Read a mechanism from a file of any format that is understood.

    Parameters
    ----------
    path
        File to read; a side-car file stands for the URDF of the same name beside it.
    loops
        Side-car file of a URDF that declares the loops.

    Returns
    -------
    Mechanism
        Description, not yet validated.

    Raises
    ------
    FileFormatError
        If the file is missing, broken, or its root element is unknown.
    UnsupportedError
        If files of this type are not read at all, or have no side-car files.
    """
    if path.suffix.lower() in side_car_suffixes() and loops is None:
        path, loops = path.with_suffix(".urdf"), path
    if path.suffix.lower() in USD_SUFFIXES and loops is None:
        return read_usd(path)
    if path.suffix.lower() not in _SUFFIXES:
        known = ", ".join((*_SUFFIXES, *USD_SUFFIXES))
        raise UnsupportedError(f"{path}: files of type '{path.suffix}' are not supported; supported: {known}")
    root = shown_tag(read_xml(path))
    if root not in _READERS:
        known = ", ".join(f"<{tag}>" for tag in _READERS)
        raise FileFormatError(
            f"the root element is <{root}>; supported: {known}", path=str(path), culprit=f"<{root}>"
        )
    if loops is None:
        return _READERS[root](path)
    if root != "robot":
        raise UnsupportedError(f"loops={str(loops)!r}: side-car files belong to a URDF, and {path} is none")
    return read_urdf(path, loops=loops)
