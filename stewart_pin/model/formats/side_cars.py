"""Files beside a URDF that declare its loops."""

from __future__ import annotations

from pathlib import Path

from stewart_pin.errors import UnsupportedError
from stewart_pin.model.description import Mechanism
from stewart_pin.model.formats.dialect import Dialect, dialects

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
