"""Gepetto's YAML beside a URDF: pairs of frames that coincide, motors, and joints that are more than URDF can say.

``closed_loop`` lists pairs of frames (links, or joints, for the frame of their child), ``type`` says of each pair
whether points (``3d``) or whole frames (``6d``) coincide, ``name_mot`` lists the motors in their order. ``joint_type``
makes the joints of ``joint_name`` a ball (``SPHERICAL``), a universal joint about two axes of the joint's frame
(``UJOINT_ZY``: z, then y) or rigid (``FIXED``). Besides these types of loops, ``revolute``, ``prismatic``,
``cylindrical``, ``planar`` and ``point_on_line`` are read, along z of both frames; no other software reads them.

References
----------
.. [1] V. Batto, L. de Matteis, N. Mansard, "Extended URDF: Accounting for parallel mechanism in robot description",
   2025, arXiv:2504.04767.
"""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from stewart_pin.errors import FileFormatError, FileMissingError, MissingExtraError, UnsupportedError
from stewart_pin.model.description import Joint, JointKind, Link, Loop, Mechanism, Note, Outcome
from stewart_pin.model.formats.dialect import (
    Dialect,
    Parts,
    add_parts,
    carrier,
    find_frame,
    note_lost_limits,
    side_car_text,
)
from stewart_pin.model.formats.dialects.mimic import write_mimics
from stewart_pin.model.formats.dynamics import note_lost_physics, note_unheard
from stewart_pin.model.formats.urdf_writer import save, tree_element
from stewart_pin.model.formats.words import meant_word
from stewart_pin.model.joint_physics import NO_PHYSICS
from stewart_pin.model.roles import mark_motors
from stewart_pin.model.unfolding import unfold_universal

_KEYS = ("closed_loop", "type", "name_mot", "joint_name", "joint_type")
_TYPES = {
    "3d": JointKind.SPHERICAL,
    "6d": JointKind.FIXED,
    "spherical": JointKind.SPHERICAL,
    "fixed": JointKind.FIXED,
    **{
        str(kind): kind
        for kind in (
            JointKind.REVOLUTE,
            JointKind.PRISMATIC,
            JointKind.CYLINDRICAL,
            JointKind.PLANAR,
            JointKind.POINT_ON_LINE,
        )
    },
}
_AXES = dict(zip("XYZ", np.eye(3), strict=True))
_UJOINTS = {f"UJOINT_{a}{b}": (_AXES[a], _AXES[b]) for a in _AXES for b in _AXES if a != b}
_TITLE = "Gepetto YAML"


def _add(mechanism: Mechanism, path: Path) -> Mechanism:
    return _SideCar(mechanism, path).added()


class _SideCar:
    def __init__(self, mechanism: Mechanism, path: Path) -> None:
        self.mechanism = mechanism
        self.path = path
        self.lists = read_lists(path)

    def error(self, text: str, culprit: str) -> FileFormatError:
        return FileFormatError(text, path=str(self.path), culprit=culprit)

    def added(self) -> Mechanism:
        for key in self.lists:
            if key not in _KEYS:
                meant = meant_word(key, _KEYS)
                remedy = f"is '{meant}' meant?" if meant else f"known: {', '.join(_KEYS)}"
                raise self.error(f"the key '{key}' is not understood; {remedy}", key)
        loops = self._loops()
        upgrades = self._pairs("joint_name", "joint_type")
        mechanism = self.mechanism
        for name, written in upgrades:
            mechanism = self._upgraded(mechanism, name, written)
        mechanism = add_parts(mechanism, Parts(loops=loops), _TITLE)
        return self._with_motors(mechanism) if "name_mot" in self.lists else mechanism

    def _names(self, key: str) -> list[str]:
        entries = self.lists.get(key, [])
        names = [each for each in entries if isinstance(each, str)]
        if len(names) != len(entries):
            raise self.error(f"'{key}' must hold names, not lists", key)
        return names

    def _pairs(self, key1: str, key2: str) -> list[tuple[str, str]]:
        first, second = self._names(key1), self._names(key2)
        if len(first) != len(second):
            raise self.error(
                f"'{key1}' has {len(first)} entries, '{key2}' {len(second)}; they belong together", key1
            )
        for name in first:
            if first.count(name) > 1:
                raise self.error(f"'{key1}' names '{name}' twice; keep one", name)
        return list(zip(first, second, strict=True))

    def _loops(self) -> tuple[Loop, ...]:
        pairs, types = self.lists.get("closed_loop", []), self._names("type")
        if len(pairs) != len(types):
            raise self.error(
                f"'closed_loop' has {len(pairs)} entries, 'type' {len(types)}; say '3d' or '6d' for each loop",
                "type",
            )
        loops: list[Loop] = []
        for pair, written in zip(pairs, types, strict=True):
            if isinstance(pair, str) or len(pair) != 2:
                raise self.error(f"'closed_loop' must hold pairs of frames, got {pair!r}", "closed_loop")
            if written.lower() not in _TYPES:
                raise self.error(
                    f"loop {pair} has the type '{written}'; supported: {', '.join(_TYPES)}", "type"
                )
            taken = [loop.name for loop in (*self.mechanism.loops, *loops)]
            loops.append(self._loop(pair[0], pair[1], _TYPES[written.lower()], taken))
        return tuple(loops)

    def _loop(self, frame1: str, frame2: str, kind: JointKind, taken: list[str]) -> Loop:
        owner = f"{self.path.name}: loop ['{frame1}', '{frame2}']"
        (link1, place1), (link2, place2) = (
            carrier(self.mechanism, find_frame(self.mechanism, frame, owner)) for frame in (frame1, frame2)
        )
        return Loop(_common_name(frame1, frame2, taken), kind, link1, link2, place1, place2)

    def _upgraded(self, mechanism: Mechanism, name: str, written: str) -> Mechanism:
        old = next((joint for joint in mechanism.joints if joint.name == name), None)
        if old is None:
            raise self.error(f"'joint_name' names the missing joint '{name}'; correct the name", name)
        kinds = {"SPHERICAL": JointKind.SPHERICAL, "FIXED": JointKind.FIXED}
        keeps = (
            old.kind is not JointKind.PRISMATIC and written != "FIXED"
        )  # numbers of a turn are those of its turns
        physics = old.physics if keeps else NO_PHYSICS
        if written in kinds:
            joints: tuple[Joint, ...] = (
                Joint(name, kinds[written], old.parent, old.child, old.placement, physics=physics),
            )
            links: tuple[Link, ...] = ()
        elif written in _UJOINTS:
            row = unfold_universal(name, old.parent, old.child, old.placement, *_UJOINTS[written])
            row = row.doing((physics, physics))
            joints, links = row.joints, row.links
        else:
            known = ", ".join([*kinds, *_UJOINTS])
            raise self.error(f"joint '{name}' has the type '{written}'; supported: {known}", name)
        at = mechanism.joints.index(old)
        notes = [
            Note(f"joint '{name}'", f"{old.kind} in the URDF, {written} in {self.path.name}", Outcome.CHANGED)
        ]
        if old.physics and written != "SPHERICAL":
            became = "of both of its turns alike" if physics else "left out"
            text = f"its <dynamics> in the URDF, {old.physics}: {became}"
            notes.append(Note(f"joint '{name}'", text, Outcome.KEPT if physics else Outcome.IGNORED))
        told = mechanism.home.get(name)
        if told is not None and not _fits(written, told):
            notes.append(Note(f"joint '{name}'", f"its home in the URDF: that of a {old.kind} joint"))
        return replace(
            mechanism,
            joints=(*mechanism.joints[:at], *joints, *mechanism.joints[at + 1 :]),
            links=mechanism.links + links,
            home={
                key: value for key, value in mechanism.home.items() if key != name or _fits(written, value)
            },
            notes=(*mechanism.notes, *notes),
        )

    def _with_motors(self, mechanism: Mechanism) -> Mechanism:
        motors = self._names("name_mot")
        movable = [joint.name for joint in mechanism.joints if joint.has_axis]
        for name in motors:
            if name not in movable:
                raise self.error(
                    f"'name_mot' names joint '{name}', which is missing or has not one freedom; the candidates are: "
                    f"{', '.join(movable)}",
                    name,
                )
            if motors.count(name) > 1:
                raise self.error(f"'name_mot' names '{name}' twice; keep one", name)
        note = Note("motors", f"as 'name_mot' of {self.path.name} says", Outcome.KEPT)
        return replace(mark_motors(mechanism, motors), notes=(*mechanism.notes, note))


def _fits(written: str, value: np.ndarray) -> bool:
    # A number is the angle of the hinge; what else is no quaternion is refused later.
    return written == "SPHERICAL" and np.size(value) != 1


def _common_name(frame1: str, frame2: str, taken: list[str]) -> str:
    """Name a loop by what its frames share: ``loop1_A`` and ``loop1_B`` make ``loop1``."""
    stem = frame1[:-1].rstrip("_")
    if stem and frame1[:-1] == frame2[:-1] and stem not in taken:
        return stem
    return f"{frame1}_{frame2}"


def write_gepetto(mechanism: Mechanism, path: Path) -> tuple[Note, ...]:
    """Write a mechanism as a URDF that every reader opens, and Gepetto's YAML of the same name beside it.

    The loops' frames become links without mass, ``<loop>_A`` and ``<loop>_B``; spherical joints stand in the URDF as
    continuous ones, which the YAML makes balls.

    Parameters
    ----------
    mechanism
        What to write.
    path
        URDF to create or overwrite; the YAML takes its place beside it.

    Returns
    -------
    tuple of Note
        What the dialect has no word for.

    Raises
    ------
    UnsupportedError
        If a loop is neither spherical nor fixed, a coupling is no ``<mimic>``, or a frame's name is taken.
    """
    kinds = {JointKind.SPHERICAL: "3d", JointKind.FIXED: "6d"}
    balls = [joint.name for joint in mechanism.joints if joint.kind is JointKind.SPHERICAL]
    tree, pairs = mechanism, []
    for loop in mechanism.loops:
        if loop.kind not in kinds:
            raise UnsupportedError(
                f"loop '{loop.name}' is of type '{loop.kind}'; Gepetto's YAML knows '3d' (spherical) and '6d' (fixed)"
            )
        for letter, link, placement in (
            ("A", loop.link1, loop.placement1),
            ("B", loop.link2, loop.placement2),
        ):
            tree = _with_frame(tree, f"{loop.name}_{letter}", link, placement)
        pairs.append([f"{loop.name}_A", f"{loop.name}_B"])
    plain = tuple(
        replace(joint, kind=JointKind.REVOLUTE) if joint.name in balls else joint for joint in tree.joints
    )
    robot, notes = tree_element(replace(tree, joints=plain), path)
    write_mimics(robot, mechanism, "gepetto")
    lists = {
        "closed_loop": pairs,
        "type": [kinds[loop.kind] for loop in mechanism.loops],
        "name_mot": [joint.name for joint in mechanism.joints if joint.independent],
        "joint_name": balls,
        "joint_type": ["SPHERICAL"] * len(balls),
    }
    # JSON's lists and strings are YAML's, and quoted, so that names like "on" stay names.
    text = "".join(f"{key}: {json.dumps(value, ensure_ascii=False)}\n" for key, value in lists.items())
    lost = (*note_lost_limits(mechanism, "gepetto"), *note_lost_physics(mechanism, "gepetto"))
    unheard = note_unheard(mechanism, "Gepetto's software")
    saved = save(robot, mechanism, path, side_car={path.with_suffix(".yaml"): text})
    return (*notes, *lost, *unheard, *saved)


def _with_frame(mechanism: Mechanism, name: str, link: str, placement: pin.SE3) -> Mechanism:
    """Add a link for a frame, unless it is there already."""
    if any(each.name == name for each in mechanism.links):
        parent, place = carrier(mechanism, name)
        if parent == link and np.array_equal(place.homogeneous, placement.homogeneous):
            return mechanism
        raise UnsupportedError(f"a link is called '{name}', the name that the loop's frame needs; rename it")
    if any(joint.name in (name, f"{name}_fixed") for joint in mechanism.joints):
        raise UnsupportedError(
            f"a joint is called '{name}' or '{name}_fixed', names that the loop's frame needs"
        )
    joint = Joint(f"{name}_fixed", JointKind.FIXED, link, name, placement)
    return replace(mechanism, links=(*mechanism.links, Link(name)), joints=(*mechanism.joints, joint))


def _is_side_car(text: str) -> bool:
    """Tell a YAML of loops, motors or types of joints from others; a misspelt key is to be named, not passed over."""
    keys = re.findall(r"^[\"']?([\w-]+)[\"']?\s*:", text, re.MULTILINE)
    return (
        "closed_loop" in text
        or any(meant_word(key, ("closed_loop", "name_mot")) for key in keys)
        or {"joint_name", "joint_type"} <= set(keys)
    )


DIALECT = Dialect(
    "gepetto",
    _TITLE,
    suffixes=(".yaml", ".yml"),
    is_side_car=_is_side_car,
    add_side_car=_add,
    write=write_gepetto,
)


# ----------------------------------------------------------------------------------------------------
# Safe YAML: one mapping of names to lists of names; nothing is constructed, no aliases, each key once
# ----------------------------------------------------------------------------------------------------

_DEEPEST = 3
"""A mapping, of lists, of pairs."""

Names = list[str]
"""A list of the file."""


def read_lists(path: Path) -> dict[str, list[str | Names]]:
    """Read a file of lists.

    Scalars stay the text of the file, so that a joint may be called ``on`` or ``1``.

    Parameters
    ----------
    path
        File to read.

    Returns
    -------
    dict
        Per key its list; entries are text, or lists of text.

    Raises
    ------
    FileFormatError
        If the file is missing or broken, holds anything else, an alias, or a key twice.
    MissingExtraError
        If PyYAML is not installed.
    """
    try:
        import yaml  # noqa: PLC0415
    except ImportError:
        raise MissingExtraError("pyyaml", "yaml") from None
    try:
        content = path.read_bytes()
        text = side_car_text(content) if content[:1] in (b"\xff", b"\xfe") else content.decode("utf-8-sig")
    except (FileNotFoundError, NotADirectoryError):
        raise FileMissingError("no such file", path=str(path)) from None
    except (OSError, ValueError) as error:
        raise FileFormatError(f"the file cannot be read as UTF-8 text: {error}", path=str(path)) from None
    try:
        depth = 0
        for event in yaml.parse(text, Loader=yaml.SafeLoader):
            if isinstance(event, yaml.AliasEvent):
                raise FileFormatError("aliases (*name) are refused", path=str(path), culprit="*")
            # Refused at the first event: the parser's time goes with the square of the depth.
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > _DEEPEST:
                raise FileFormatError("lists are nested too deep", path=str(path), culprit="[")
        # Nodes, not objects: constructing would guess types; SafeLoader parses without running anything.
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except (yaml.YAMLError, ValueError) as error:
        reason = " ".join(str(error).split())[:200]
        raise FileFormatError(f"not well-formed YAML: {reason}", path=str(path)) from None
    return _Reader(path).mapping(root)


class _Reader:
    def __init__(self, path: Path) -> None:
        self.path = path

    def error(self, text: str, node: Any) -> FileFormatError:
        return FileFormatError(
            f"{text} (line {node.start_mark.line + 1})", path=str(self.path), culprit="YAML"
        )

    def mapping(self, root: Any) -> dict[str, list[str | Names]]:
        if root is None:
            raise FileFormatError("the file is empty", path=str(self.path))
        if root.id != "mapping":
            raise self.error("the file must hold keys with lists", root)
        found: dict[str, list[str | Names]] = {}
        for key, value in root.value:
            name = self.scalar(key)
            if name in found:
                raise self.error(f"the key '{name}' stands there twice; keep one", key)
            if value.id != "sequence":
                raise self.error(f"'{name}' must hold a list", value)
            found[name] = [self.entry(each) for each in value.value]
        return found

    def entry(self, node: Any) -> str | Names:
        return [self.scalar(each) for each in node.value] if node.id == "sequence" else self.scalar(node)

    def scalar(self, node: Any) -> str:
        if node.id != "scalar" or not node.value:
            raise self.error("a name is missing", node)
        return node.value
