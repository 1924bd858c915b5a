"""The twelve leg ends of a six-legged platform from a text table."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from stewart_pin.checks import as_positive
from stewart_pin.errors import FileFormatError, FileMissingError
from stewart_pin.geometry.hexapod import Hexapod

_ENDS = {
    "platform": ("platform", "plat", "top", "upper", "moving", "mobile", "effector"),
    "base": ("base", "bottom", "lower", "fixed", "ground"),
}
_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "inch": 0.0254, "ft": 0.3048}
"""Units of length that a header may name [m]."""

_LARGEST = 2**20
"""Bytes beyond which a file is no table of twelve points."""


def read_hexapod(path: str | Path, *, unit: float = 1.0) -> Hexapod:
    """Read twelve leg ends from a text table.

    Six rows hold one leg each (base x y z, platform x y z), twelve rows hold one point each (six of the base, then
    six of the platform). Numbers are separated by commas, semicolons or blanks; what follows ``#`` is a comment, and a
    first row of names is a header, which is checked against this order.

    Parameters
    ----------
    path
        File to read.
    unit
        Size of the file's unit of length, 1e-3 for millimetres [m].

    Returns
    -------
    Hexapod
        Legs in the order of the rows.

    Raises
    ------
    FileFormatError
        If the file is missing, a row cannot be read, or a header names another order or unit; names the line.
    InputError
        If the unit is not above zero.
    """
    unit, path = as_positive("unit", unit), Path(path)
    rows: list[list[float]] = []
    lines: list[int] = []
    header = False
    for line, words in _words(path):
        numbers = [_number(word) for word in words]
        if None not in numbers:
            rows.append([unit * number for number in numbers if number is not None])
            lines.append(line)
        elif rows or header or any(number is not None for number in numbers):
            stranger = words[numbers.index(None)]
            raise FileFormatError(
                f"line {line} holds {stranger!r}, which is no finite number",
                path=str(path),
                culprit=f"line {line}",
            )
        else:
            header = True
            _check_header(path, line, words)
            _check_unit(path, line, words, unit)
    width = {6: 6, 12: 3}.get(len(rows))
    if width is None:
        raise FileFormatError(
            f"{len(rows)} rows of numbers; a table has 6 (base x y z, platform x y z) or 12 (x y z)",
            path=str(path),
        )
    for row, line in zip(rows, lines, strict=True):
        if len(row) != width:
            raise FileFormatError(
                f"line {line} has {len(row)} numbers, one of {len(rows)} rows has {width}",
                path=str(path),
                culprit=f"line {line}",
            )
    return Hexapod.from_points(rows)


def _words(path: Path) -> list[tuple[int, list[str]]]:
    """Split the file into rows of words, with their line numbers; leave out comments and empty lines."""
    if not path.is_file():
        raise FileMissingError("no such file", path=str(path))
    if path.stat().st_size > _LARGEST:
        raise FileFormatError(f"more than {_LARGEST} bytes; is it a table of twelve points?", path=str(path))
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise FileFormatError("not a text file", path=str(path)) from None
    found = []
    for number, line in enumerate(lines, start=1):
        text = line.partition("#")[0].strip()
        separator = next((mark for mark in ";," if mark in text), None)
        if text:
            found.append((number, [word.strip(' "') for word in text.split(separator)]))
    return found


def _number(word: str) -> float | None:
    try:
        value = float(word)
    except ValueError:
        return None
    return value if np.isfinite(value) else None


def _check_header(path: Path, line: int, words: list[str]) -> None:
    """Refuse a header that says another order than the one read: x y z, base before platform."""
    wrong_axis = any(_axis(word) not in ("", "xyz"[k % 3]) for k, word in enumerate(words))
    wrong_end = any(_end(word) not in ("", "base" if k < 3 else "platform") for k, word in enumerate(words))
    if wrong_axis or (len(words) == 6 and wrong_end):
        raise FileFormatError(
            f"line {line} names the columns {', '.join(words)}; the order must be base x y z, platform x y z",
            path=str(path),
            culprit=f"line {line}",
        )


def _end(word: str) -> str:
    """Find the end in a column's name, as in base_x, Bx [mm], top_x, upper joint x; none where no word says it."""
    name = re.sub(r"[\[(/].*|[_ ](mm|cm|m|in|inch|ft)$", "", word.lower()).strip()
    for end, words in _ENDS.items():
        if any(each in name for each in words) or re.match(rf"{end[0]}\d*[^a-z]*[xyz]\d*$", name):
            return end
    return ""


def _check_unit(path: Path, line: int, words: list[str], unit: float) -> None:
    """Refuse a header whose unit is not the one that the numbers are multiplied by."""
    said = {found[1].strip() for word in words if (found := re.search(r"[\[(]([^\])]*)[\])]", word.lower()))}
    said |= {found[1] for word in words if (found := re.search(r"[_ /](mm|cm|m|in|inch|ft)$", word.lower()))}
    for name in sorted(said & _UNITS.keys()):
        if abs(_UNITS[name] - unit) > 1e-9 * unit:
            raise FileFormatError(
                f"line {line} says that the numbers are in {name}; pass unit={_UNITS[name]:g}, got {unit:g}",
                path=str(path),
                culprit=f"line {line}",
            )


def _axis(word: str) -> str:
    """Find the axis in a column's name, as in base_x, X1, Bx [mm], x base; none where there is no such letter."""
    name = re.sub(r"[\[(/].*|[_ ](mm|cm|m|in|inch|ft)$", "", word.lower()).strip().rstrip("0123456789")
    if name[-1:] in tuple("xyz"):
        return name[-1]
    return name[0] if re.match(r"[xyz][^a-z]", name) else ""
