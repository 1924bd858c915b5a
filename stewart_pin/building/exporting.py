"""From a closed chain to files that other software reads."""

from __future__ import annotations

from pathlib import Path

from stewart_pin.errors import InputError
from stewart_pin.model.chain import ClosedChain
from stewart_pin.model.formats.urdf_plus import write_urdf_file


def write_urdf(chain: ClosedChain, path: str | Path) -> None:
    """Write a chain as URDF, its loops in the URDF+ dialect, so that `load` reads the same chain back.

    Parameters
    ----------
    chain
        Closed chain.
    path
        File to create or overwrite.
    """
    write_urdf_file(chain.described(), Path(path))


def export(chain: ClosedChain, path: str | Path, *, format: str = "urdf+") -> None:
    """Write a chain in a format of another simulator.

    Parameters
    ----------
    chain
        Closed chain.
    path
        File to create or overwrite.
    format
        ``"urdf+"``.

    Raises
    ------
    InputError
        If the format is unknown.
    """
    writers = {"urdf+": write_urdf}
    if format not in writers:
        raise InputError(f"format must be one of {', '.join(writers)}, got {format!r}")
    writers[format](chain, path)
