"""From a closed chain to files that other software reads."""

from __future__ import annotations

from pathlib import Path

from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.model.chain import ClosedChain
from stewart_pin.model.formats.dialects.urdf_plus import write_urdf_plus
from stewart_pin.model.formats.mjcf import write_mjcf_file


def write_urdf(chain: ClosedChain, path: str | Path) -> None:
    """Write a chain as URDF, its loops in the URDF+ dialect, so that `load` reads the same chain back.

    A file holds no gravity; pass it to `load` again where it is not the usual one.

    Parameters
    ----------
    chain
        Closed chain.
    path
        File to create or overwrite.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    _refuse_couplings(chain, "urdf+")
    try:
        write_urdf_plus(chain.described(), Path(path))
    except OSError as error:
        raise InputError(f"path: cannot write {str(path)!r}: {error.strerror}") from None


def export(chain: ClosedChain, path: str | Path, *, format: str = "urdf+") -> None:
    """Write a chain in a format of another simulator.

    Parameters
    ----------
    chain
        Closed chain.
    path
        File to create or overwrite.
    format
        ``"urdf+"``, or ``"mjcf"`` for MuJoCo, whose loops are soft constraints: mass matrix and bias of its tree are
        exact, its accelerations are not.

    Raises
    ------
    InputError
        If the format is unknown.
    UnsupportedError
        If the format cannot express the chain; names the link, joint, loop or motor at fault.
    """
    writers = {"urdf+": write_urdf, "mjcf": _write_mjcf}
    if format not in writers:
        raise InputError(f"format must be one of {', '.join(writers)}, got {format!r}")
    if format != "mjcf":
        _refuse_couplings(chain, format)
    writers[format](chain, path)


def _refuse_couplings(chain: ClosedChain, format: str) -> None:
    for coupling in chain.couplings:
        raise UnsupportedError(f"coupling '{coupling.name}' cannot be written as {format}")


def _write_mjcf(chain: ClosedChain, path: str | Path) -> None:
    write_mjcf_file(chain.described(), Path(path), motors=chain.motors, gravity=chain.gravity)
