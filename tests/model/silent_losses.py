"""Misspelt, changed, removed, repeated and moved words of robot files, and what became of each."""

from __future__ import annotations

import copy
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.building.loading import load
from stewart_pin.errors import StewartPinError
from stewart_pin.model.description import Mechanism
from stewart_pin.model.formats.reading import read_mechanism
from stewart_pin.model.formats.xml import shown_tag
from stewart_pin.model.shapes import Shape

_NUMBERS = re.compile(r"\s*[-+]?\.?\d[-+.\deE]*(\s+[-+]?\.?\d[-+.\deE]*)*\s*")


@dataclass(frozen=True)
class Mutant:
    """One change of a file.

    Attributes
    ----------
    kind
        ``rename``, ``value``, ``remove``, ``repeat`` or ``move``.
    place
        Tags from the root down, then the attribute, or ``#`` for text: ``robot/link/inertial/mass@value``.
    text
        The changed file.
    word
        The word that is misspelt, as it stands in the changed file; else empty.
    holder
        Type of the joint around it, or what stands for one; else empty.
    without
        Of what is moved: the file without it; else empty.
    """

    kind: str
    place: str
    text: str
    word: str = ""
    holder: str = ""
    without: str = ""


def path_of(element: etree._Element) -> str:
    """Tags from the root down to an element."""
    return "/".join([*(shown_tag(e) for e in reversed(list(element.iterancestors()))), shown_tag(element)])


def misspellings(word: str, rng: np.random.Generator) -> list[str]:
    """Misspell a word: a letter dropped, two exchanged, its case changed."""
    head, colon, local = word.rpartition(":")
    k = int(rng.integers(len(local)))
    swaps = [j for j in range(len(local) - 1) if local[j] != local[j + 1] and local[j + 1].isalpha()]
    made = [local[:k] + local[k + 1 :], local.swapcase() if local.islower() else local.lower(), local + "s"]
    if swaps:
        j = int(rng.choice(swaps))
        made.append(local[:j] + local[j + 1] + local[j] + local[j + 2 :])
    return [
        head + colon + each for each in dict.fromkeys(made) if each not in ("", local) and each[0].isalpha()
    ]


def changed_value(text: str) -> list[str]:
    """Tell something else of the same kind: other numbers, the other flag, another name."""
    if _NUMBERS.fullmatch(text):
        numbers = [float(word) if abs(float(word)) < 1e16 else 1.0 for word in text.split()]
        # Along an axis of the frame, a longer vector is the same direction: turned about, it is another one.
        alone = len(numbers) == 3 and np.count_nonzero(numbers) == 1
        others = [-number if alone and number else number + 0.25 for number in numbers]
        return [
            " ".join(repr(others[k] if k == at else number) for k, number in enumerate(numbers))
            for at in range(len(numbers))
        ]
    flags = {"true": "false", "false": "true", "True": "false", "False": "true"}
    return [flags[text.strip()]] if text.strip() in flags else [text.strip() + "x"]


class _Maker:
    """Makes mutants of one tree, in place, and undoes each."""

    def __init__(self, root: etree._Element, rng: np.random.Generator) -> None:
        self.root, self.rng = root, rng

    def text(self) -> str:
        return etree.tostring(self.root, encoding="unicode")

    def all(self) -> Iterator[Mutant]:
        for element in list(self.root.iter(etree.Element)):
            holder = next(
                (e.get("type", "") for e in (element, *element.iterancestors()) if "type" in e.attrib), ""
            )
            for mutant in self._of(element, path_of(element)):
                yield replace(mutant, holder=holder)

    def _of(self, element: etree._Element, place: str) -> Iterator[Mutant]:
        yield from self._renamed(element, place)
        yield from self._attributes(element, place)
        text = (element.text or "").strip()
        if text:
            for value in changed_value(text):
                element.text = value
                yield Mutant("value", f"{place}#", self.text())
            element.text = text
        if element is not self.root:
            yield from self._removed_repeated_moved(element, place)

    def _renamed(self, element: etree._Element, place: str) -> Iterator[Mutant]:
        tag = element.tag
        for word in misspellings(str(tag).rpartition("}")[2], self.rng):
            element.tag = f"{{{etree.QName(element).namespace}}}{word}" if "}" in str(tag) else word
            yield Mutant("rename", place, self.text(), shown_tag(element))
        element.tag = tag

    def _attributes(self, element: etree._Element, place: str) -> Iterator[Mutant]:
        before = dict(element.attrib)

        def put(values: Mapping[str, str]) -> None:
            element.attrib.clear()
            element.attrib.update(values)

        for name, value in before.items():
            for word in misspellings(name, self.rng):
                if word not in before:
                    put({word if key == name else key: each for key, each in before.items()})
                    yield Mutant("rename", f"{place}@{name}", self.text(), word)
            for other in changed_value(value):
                put({**before, name: other})
                yield Mutant("value", f"{place}@{name}", self.text())
            put({key: each for key, each in before.items() if key != name})
            yield Mutant("remove", f"{place}@{name}", self.text())
        put(before)

    def _removed_repeated_moved(self, element: etree._Element, place: str) -> Iterator[Mutant]:
        parent = element.getparent()
        assert parent is not None
        at = parent.index(element)
        twin = copy.deepcopy(element)
        parent.insert(at + 1, twin)
        _alter(twin)
        yield Mutant("repeat", place, self.text())
        parent.remove(twin)
        element.tail = None
        inside = set(element.iter())
        homes = [e for e in self.root.iter(etree.Element) if shown_tag(e) == shown_tag(parent)]
        homes = [e for e in homes if e is not parent and e not in inside]
        above = parent.getparent()
        parent.remove(element)
        without = self.text()
        for home in [*homes[:1], *([] if above is None else [above])]:
            home.append(element)
            yield Mutant("move", place, self.text(), without=without)
            home.remove(element)
        yield Mutant("remove", place, without)
        parent.insert(at, element)


def _alter(element: etree._Element) -> None:
    """Let an element and all inside tell other numbers."""
    for each in element.iter(etree.Element):
        for name, value in each.attrib.items():
            if _NUMBERS.fullmatch(value):
                each.set(name, changed_value(value)[0])
        if _NUMBERS.fullmatch(each.text or ""):
            each.text = changed_value(each.text or "")[0]


def mutants(text: str, seed: int = 1) -> Iterator[Mutant]:
    """Make every mutant of an XML file, each a file of its own."""
    root = etree.fromstring(text.encode(), etree.XMLParser(remove_comments=True, encoding="utf-8"))
    yield from _Maker(root, np.random.default_rng(seed)).all()


# ----------------------------------------------------------------------------------------------------
# What a file means, and what became of a mutant
# ----------------------------------------------------------------------------------------------------


def meaning(thing: object) -> object:
    """Everything that a description says, but for its notes: comparable."""
    if isinstance(thing, pin.SE3):
        return tuple(thing.homogeneous.ravel())
    if isinstance(thing, pin.Inertia):
        return (thing.mass, *thing.lever, *thing.inertia.ravel())
    if isinstance(thing, np.ndarray):
        return tuple(thing.ravel())
    if isinstance(thing, tuple | list):
        return tuple(meaning(each) for each in thing)
    if isinstance(thing, Mapping):
        return tuple((key, meaning(value)) for key, value in thing.items())
    if isinstance(thing, frozenset):
        return tuple(sorted(thing))
    if is_dataclass(thing):
        skipped = (
            {"notes", "source", "name"}
            if isinstance(thing, Mechanism)
            else {"name", "folder"}
            if isinstance(thing, Shape)
            else set()
        )
        return tuple(meaning(getattr(thing, each.name)) for each in fields(thing) if each.name not in skipped)
    return thing


@dataclass(frozen=True)
class Reader:
    """Reads texts as files of one suffix, a side-car beside them."""

    folder: Path
    suffix: str = ".urdf"
    beside: Mapping[str, str] | None = None

    def read(self, text: str) -> tuple[object, tuple[object, ...], str]:
        """Return meaning, notes, and the words of an error."""
        path = self.folder / f"sample{self.suffix}"
        path.write_text(text, encoding="utf-8")
        for name, content in (self.beside or {}).items():
            (self.folder / name).write_text(content, encoding="utf-8")
        try:
            mechanism = read_mechanism(path)
        except StewartPinError as error:
            return None, (), str(error)
        return meaning(mechanism), mechanism.notes, ""

    def blame(self, text: str) -> str:
        """Return the words of the error that loading ends in, if it does."""
        path = self.folder / f"sample{self.suffix}"
        path.write_text(text, encoding="utf-8")
        try:
            load(path)
        except StewartPinError as error:
            return str(error)
        return ""


def _last(place: str) -> str:
    return re.split("[/@]", place.rstrip("#"))[-1]


def _quoted(error: str) -> list[str]:
    return [*re.findall(r"'[^']*'", error), *re.findall(r"<[^>]*>", error), *re.findall(r"[\w:]+", error)]


def fate(mutant: Mutant, reader: Reader, before: tuple[object, tuple[object, ...], str]) -> str:
    """Say what became of a mutant: ``refused``, ``told``, ``changed``, or what is wrong."""
    told, notes, error = reader.read(mutant.text)
    if error:
        if mutant.kind == "rename" and not {
            mutant.word,
            f"'{_last(mutant.place)}'",
            f"<{_last(mutant.place)}>",
        } & set(_quoted(error)):
            return "blamed on something else"
        return "refused"
    if notes != before[1]:
        new = " ".join(f"{note.subject} {note.text}" for note in set(notes) - set(before[1]))
        if mutant.kind != "rename" or mutant.word in new:
            if mutant.kind == "rename":
                blame = reader.blame(mutant.text)
                if blame and mutant.word not in blame:
                    return "told, but an error of loading does not name it"
            return "told"
    if told != before[0]:
        return "changed in silence" if mutant.kind == "rename" else "changed"
    # What may as well be absent was the default, wherever it stands.
    return "changed" if mutant.without and reader.read(mutant.without) == before else "lost"


BAD = (
    "lost",
    "changed in silence",
    "blamed on something else",
    "told, but an error of loading does not name it",
)


HARMLESS = {
    r"robot@name|sdf/model@name|sdf/world@name|(visual|collision|material)@name": "what it is called",
    r"group_state@group": "all joints are read, whatever the group",
    r"plugin@(name|filename)": "what a plugin does is told by its tags",
    r"(transmission|actuator|ros2_control|command_interface|state_interface)@(name|type)": "what it is called",
    r"pose#": "a quaternion may be of any length",
    r"robot/(gazebo/(?!spring)|transmission/(?!actuator/drake)|ros2_control/).*": "told as a whole",
    r"world/(model|frame).*": "another model, told as a whole; a frame that nobody names",
    r"mujoco(/.*(site|light|sensor)(/gyro)?|/worldbody/geom|/actuator/position@kp)(@\w+)?": "told as a whole",
    r"mujoco(@model|/actuator/motor@name|/compiler)": "what it is called; the same once more",
}
"""What may change nothing, and why: places as `re.search` finds them, of mutants whose loss is no loss."""
_NO_AXIS = ("fixed",)
"""Types of joints into which exporters write an axis that says nothing."""


def is_harmless(mutant: Mutant) -> bool:
    """Tell whether a mutant that changes nothing is no loss."""
    if re.search(r"/(\w*axis|parent_axis|child_axis)2?(@|/|#|$)", mutant.place) and mutant.holder in _NO_AXIS:
        return True
    if re.fullmatch(r"robot/(gazebo/joint|transmission/joint|ros2_control/joint)(@name)?", mutant.place):
        return False
    if mutant.kind == "rename":
        return bool(re.search(r"world(/model|@name)|ros2_control/", mutant.place))
    return any(re.search(f"({place})$", mutant.place) for place in HARMLESS)


def silent_losses(text: str, reader: Reader, *, every: int = 1, start: int = 0) -> tuple[int, Counter[str]]:
    """Count the mutants of a file that were tried, and what was lost in silence: by fate, kind and place.

    What is removed and changes nothing was the default, unless another value changes nothing either, which counts.
    """
    before = reader.read(text)
    assert before[0] is not None, before[2]
    bad: Counter[str] = Counter()
    tried = 0
    for number, mutant in enumerate(mutants(text)):
        if number % every == start % every:
            tried += 1
            what = fate(mutant, reader, before)
            if what in BAD and not (what == "lost" and (mutant.kind == "remove" or is_harmless(mutant))):
                bad[f"{what}: {mutant.kind} {mutant.place}"] += 1
    return tried, bad
