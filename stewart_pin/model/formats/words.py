"""Which words a format has: what an element may hold, what becomes of each word, and which word a misspelt one means.

Each reader and each dialect has a table, a `Grammar`, by which `check_words` judges a file before anything is read.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import StrEnum
from functools import lru_cache

from lxml import etree

from stewart_pin.errors import FileFormatError, StewartPinError
from stewart_pin.model.description import Note
from stewart_pin.model.formats.xml import ElementReader, shown_tag


class Strange(StrEnum):
    """What becomes of a word that an element does not know."""

    REFUSED = "refused"
    NOTED = "noted; refused where it looks like one that is read"
    TOLD = "noted"


@dataclass(frozen=True)
class Words:
    """What an element may hold.

    Attributes
    ----------
    attributes, tags
        Attributes and children that are read.
    noted
        Children that are known and not read, with the reason; attributes (``@name``) that are names for people.
    text
        Whether the text inside it is read.
    elsewhere
        Children that mean something inside another element alone, and which that is: refused.
    strange
        What becomes of all else.
    told_by_reader
        Whether who reads the element notes the children that it does not know.
    """

    attributes: tuple[str, ...] = ()
    tags: tuple[str, ...] = ()
    noted: Mapping[str, str] = field(default_factory=dict)
    text: bool = False
    elsewhere: Mapping[str, str] = field(default_factory=dict)
    strange: Strange = Strange.REFUSED
    told_by_reader: bool = False


Grammar = Mapping[str, Words]
"""Words of each element: by its tag, or by the tags that lead to it, ``gazebo/joint/parent`` before ``parent``."""
_LONGEST_KEY = 3
"""Tags of the longest key of a grammar."""


def words_of(path: tuple[str, ...], grammar: Grammar) -> Words | None:
    """Find the words of an element.

    Parameters
    ----------
    path
        Tags that lead to it, its own the last.
    grammar
        Table of the format.

    Returns
    -------
    Words or None
        By the longest key that fits; None: nobody reads it.
    """
    for start in range(len(path)):
        found = grammar.get("/".join(path[start:]))
        if found is not None:
            return found
    return None


def check_words(
    reader: ElementReader, root: etree._Element, grammar: Grammar, note: Callable[[str, str], None]
) -> None:
    """Refuse words that are not understood where a word counts, and note them elsewhere.

    Parameters
    ----------
    reader
        Reader of the file, for the errors.
    root
        Element to begin with.
    grammar
        Table of the format; what stands inside an element that it does not know is nobody's.
    note
        Takes subject and text of a note.

    Raises
    ------
    FileFormatError
        With the line of the word, and the one that is meant.
    """
    above = [shown_tag(each) for each in root.iterancestors()][::-1]
    waiting = [(root, (*above, shown_tag(root))[-_LONGEST_KEY:])]
    while waiting:
        element, path = waiting.pop()
        words = words_of(path, grammar)
        if words is None:
            continue
        judge = _Judge(reader, element, words, note)
        for name in element.attrib:
            judge.attribute(str(name))
        known: list[tuple[etree._Element, tuple[str, ...]]] = []
        for child in element.iterchildren(etree.Element):
            tag = shown_tag(child)
            judge.child(child, tag)
            below = (*path, tag)[-_LONGEST_KEY:]
            if words_of(below, grammar) is not None:
                known.append((child, below))
        judge.text()
        waiting += reversed(known)


@dataclass(frozen=True, eq=False)
class _Judge:
    """Judges the words of one element."""

    reader: ElementReader
    element: etree._Element
    words: Words
    note: Callable[[str, str], None]

    def attribute(self, name: str) -> None:
        if name in self.words.attributes or f"@{name}" in self.words.noted:
            return
        what = f"attribute '{_shown(name, self.element)}' of <{shown_tag(self.element)}>"
        meant = meant_word(name, self.words.attributes)
        if self._stops(meant):
            raise self._error(what, self.element, f"'{meant}'" if meant else "")
        self.note(self._at(self.element), f"{what}: unknown{f', is {meant!r} meant?' if meant else ''}")

    def child(self, child: etree._Element, tag: str) -> None:
        if tag in self.words.tags:
            return
        if tag in self.words.noted:
            if not self.words.told_by_reader:
                self.note(owner_of(self.element), f"<{tag}>: {self.words.noted[tag]}")
            return
        if tag in self.words.elsewhere:
            owner = owner_of(self.element)
            raise self.reader.error(
                f"{owner}: <{tag}> (line {child.sourceline}) means nothing in <{shown_tag(self.element)}>; put it into "
                f"{self.words.elsewhere[tag]}, or remove it",
                owner,
            )
        meant = meant_word(tag, self.words.tags)
        if self._stops(meant):
            what = f"<{tag}> of <{shown_tag(self.element)}>"
            raise self._error(what, child, f"<{meant}>" if meant else "")
        if not self.words.told_by_reader:
            self.note(self._at(child), f"<{tag}>: unknown tag{f', is <{meant}> meant?' if meant else ''}")

    def text(self) -> None:
        if self.words.text:
            return
        texts = [self.element.text, *(child.tail for child in self.element)]
        stray = next((text.strip() for text in texts if text and text.strip()), "")
        if stray:
            if self._stops(""):
                what = f"the text {stray[:40]!r} in <{shown_tag(self.element)}>"
                raise self._error(what, self.element, "")
            self.note(self._at(self.element), f"the text in <{shown_tag(self.element)}>: unknown")

    def _stops(self, meant: str) -> bool:
        strange = self.words.strange
        return strange is Strange.REFUSED or (strange is Strange.NOTED and bool(meant))

    def _error(self, what: str, at: etree._Element, meant: str) -> FileFormatError:
        known = [*self.words.attributes, *(f"<{tag}>" for tag in self.words.tags)]
        remedy = f"is {meant} meant?" if meant else f"it may have {', '.join(known) or 'nothing'}"
        owner = owner_of(self.element)
        return self.reader.error(f"{owner}: {what} (line {at.sourceline}) is not understood; {remedy}", owner)

    def _at(self, at: etree._Element) -> str:
        return f"{owner_of(self.element)}, line {at.sourceline}"


def _shown(name: str, element: etree._Element) -> str:
    """Print an attribute as it stands in the file, with its prefix."""
    space, _, local = name.rpartition("}")
    prefix = next((prefix for prefix, uri in element.nsmap.items() if prefix and uri == space[1:]), "")
    return f"{prefix}:{local}" if prefix else local


def owner_of(element: etree._Element) -> str:
    """Name the part of the robot that an element belongs to.

    Parameters
    ----------
    element
        The element.

    Returns
    -------
    str
        Tag and name of the innermost element with a name, shapes aside; ``the file`` for the root.
    """
    for each in (element, *element.iterancestors()):
        if each.getparent() is None:
            return "the file"
        if each.get("name") and shown_tag(each) not in ("visual", "collision", "material"):
            return f"{shown_tag(each)} '{each.get('name')}'"
        if each.getparent().getparent() is None:
            return f"<{shown_tag(each)}>"
    return "the file"


# ----------------------------------------------------------------------------------------------------
# Misspelt words
# ----------------------------------------------------------------------------------------------------


def meant_word(word: str, known: Collection[str]) -> str:
    """Find the word that a misspelt one means.

    Parameters
    ----------
    word
        As it is written.
    known
        Words that are read.

    Returns
    -------
    str
        The known word that differs by case, by hyphens, by one letter too many or too few, another one, or by two
        neighbours exchanged; empty: none does.
    """
    plain = _plain(word)
    longest, shortened = _shortened_words(tuple(known))
    # Of two words that differ by one slip, one with a letter less is the other, or is it with a letter less, too.
    if len(plain) > longest + 1 or shortened.isdisjoint(_shortened(plain)):
        return ""
    return next((each for each in known if _plain(each) == plain), "") or next(
        (each for each in known if _one_slip(plain, _plain(each))), ""
    )


@lru_cache(maxsize=256)
def _shortened_words(known: tuple[str, ...]) -> tuple[int, frozenset[str]]:
    plain = [_plain(each) for each in known]
    return max(map(len, plain), default=0), frozenset(short for each in plain for short in _shortened(each))


def _shortened(word: str) -> list[str]:
    return [word, *(word[:k] + word[k + 1 :] for k in range(len(word)))]


def _plain(word: str) -> str:
    return word.lower().replace("-", "").replace("_", "")


def _one_slip(a: str, b: str) -> bool:
    if abs(len(a) - len(b)) > 1 or min(len(a), len(b)) < 2:
        return False
    same = next((k for k, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))
    rest_a, rest_b = a[same:], b[same:]
    if len(a) != len(b):
        return rest_a[1:] == rest_b or rest_a == rest_b[1:]
    return rest_a[1:] == rest_b[1:] or (rest_a[1::-1], rest_a[2:]) == (rest_b[:2], rest_b[2:])


# ----------------------------------------------------------------------------------------------------
# What was not understood, told by errors that come later
# ----------------------------------------------------------------------------------------------------

_MOST = 5
"""How many words an error lists."""


@contextmanager
def telling_strangers(notes: Collection[Note]) -> Iterator[None]:
    """Let an error tell as well which words of the file were not understood: one of them may be its cause.

    Parameters
    ----------
    notes
        What has been noted when the error comes.

    Yields
    ------
    None
        The errors inside are told more.
    """
    try:
        yield
    except StewartPinError as error:
        strange = [f"{note.text} ({note.subject})" for note in notes if ": unknown" in note.text]
        if strange and error.args and "not understood in this file" not in str(error):
            more = f" and {len(strange) - _MOST} more" if len(strange) > _MOST else ""
            said = f"{error.args[0]}; not understood in this file: {', '.join(strange[:_MOST])}{more}"
            error.args = (said, *error.args[1:])
        raise
