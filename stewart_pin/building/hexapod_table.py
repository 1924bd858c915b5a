"""A six-legged platform of one's own: twelve points from a file, and bodies of a plausible mass distribution."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pinocchio as pin

from stewart_pin.building.from_hexapod import default_home
from stewart_pin.checks import as_positive
from stewart_pin.errors import FileFormatError, FileMissingError, InputError
from stewart_pin.geometry.hexapod import Hexapod, leg_lengths

_SLENDER = 20.0
"""Length over radius of the legs' bodies."""
_FLAT = 20.0
"""Radius over thickness of the platform."""
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
        If the file is missing, or a row cannot be read; names the line.
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


def hexapod_inertias(
    hexapod: Hexapod, *, platform: float, lower: float, upper: float, leg_length: float | None = None
) -> dict[str, pin.Inertia]:
    """Estimate the inertias of a platform from its masses: a disc, and slender rods.

    The platform is a flat disc about the middle of its points, as wide as they are. Cylinders reach from the base
    points, rods from the platform points, each over 60 % of a leg, so that they overlap as telescopes do.

    Parameters
    ----------
    hexapod
        Geometry.
    platform, lower, upper
        Mass of the platform, of each cylinder and of each rod [kg].
    leg_length
        Usual length of the legs; default: the mean where `hexapod_chain` puts home by itself [m].

    Returns
    -------
    dict
        ``platform``, ``lower`` and ``upper`` for `hexapod_chain` [kg, m, kg m²].

    Raises
    ------
    InputError
        If a mass or the length is not above zero, or the platform's points coincide.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> hexapod = stp.semi_regular_hexapod(0.5, 0.4, 0.2, 0.3)
    >>> masses = stp.hexapod_inertias(hexapod, platform=20.0, lower=2.0, upper=1.5)
    >>> stp.mobility(stp.hexapod_chain(hexapod, **masses)).dof
    6
    """
    masses = {
        name: as_positive(name, mass)
        for name, mass in (("platform", platform), ("lower", lower), ("upper", upper))
    }
    if leg_length is None:
        home = default_home(hexapod, 0.0, np.inf)
        leg_length = float(leg_lengths(hexapod, home, np.eye(3)).mean())
    length = 0.6 * as_positive("leg_length", leg_length)
    centre = hexapod.platform_points.mean(axis=0)
    radius = float(np.linalg.norm(hexapod.platform_points - centre, axis=1).max())
    if radius == 0.0:
        raise InputError(
            "hexapod: all platform points coincide, so the platform has no size; give inertias by hand"
        )
    # A cylinder about z, its centre of mass where told.
    across = (3 * radius**2 + (radius / _FLAT) ** 2) / 12
    disc = masses["platform"] * np.diag([across, across, radius**2 / 2])
    thin = length / _SLENDER
    rod = np.diag([(3 * thin**2 + length**2) / 12, (3 * thin**2 + length**2) / 12, thin**2 / 2])
    half = np.array([0.0, 0.0, length / 2])
    return {
        "platform": pin.Inertia(masses["platform"], centre, disc),
        "lower": pin.Inertia(masses["lower"], half, masses["lower"] * rod),
        "upper": pin.Inertia(masses["upper"], -half, masses["upper"] * rod),
    }


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
    ends = [("base" in word.lower(), "platform" in word.lower()) for word in words]
    wrong_end = any(platform if k < 3 else base for k, (base, platform) in enumerate(ends))
    if wrong_axis or (len(words) == 6 and wrong_end):
        raise FileFormatError(
            f"line {line} names the columns {', '.join(words)}; the order must be base x y z, platform x y z",
            path=str(path),
            culprit=f"line {line}",
        )


def _axis(word: str) -> str:
    """Find the axis in a column's name, as in base_x, X1, Bx [mm], x base; none where there is no such letter."""
    name = re.sub(r"[\[(].*", "", word.lower()).strip().rstrip("0123456789")
    if name[-1:] in tuple("xyz"):
        return name[-1]
    return name[0] if re.match(r"[xyz][^a-z]", name) else ""
