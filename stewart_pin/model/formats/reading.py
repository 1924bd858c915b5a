"""Which reader a file goes to: by its root element, whatever its name; by its suffix where it is no XML."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from stewart_pin.errors import FileFormatError, UnsupportedError
from stewart_pin.model.description import Mechanism
from stewart_pin.model.formats.dialect import side_car_suffixes
from stewart_pin.model.formats.mjcf.reading import read_mjcf
from stewart_pin.model.formats.sdf import read_sdf
from stewart_pin.model.formats.urdf import read_urdf
from stewart_pin.model.formats.usd.reading import read_usd
from stewart_pin.model.formats.usd.stage import SUFFIXES as USD_SUFFIXES
from stewart_pin.model.formats.xml import read_xml, shown_tag

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
