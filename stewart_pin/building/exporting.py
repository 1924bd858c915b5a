"""From a closed chain to files that other software reads."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from stewart_pin.building.rotors import require_no_rotors
from stewart_pin.errors import InputError
from stewart_pin.model.description import Mechanism, Note, Report
from stewart_pin.model.formats.dialect import dialects
from stewart_pin.model.formats.mjcf.writing import write_mjcf_file
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import as_chain


def write_urdf(chain: ClosedChain, path: str | Path) -> Report:
    """Write a chain as URDF, its loops in the URDF+ dialect, so that `load` reads the same chain back.

    Gravity goes along, in an element of our own, where it is not the usual one.

    Parameters
    ----------
    chain
        Closed chain.
    path
        File to create or overwrite.

    Returns
    -------
    Report
        What was left out or changed, as of `export`.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    return export(chain, path, format="urdf+")


def export(chain: ClosedChain, path: str | Path, *, format: str = "urdf+") -> Report:
    """Write a chain in a format of another simulator.

    Parameters
    ----------
    chain
        Closed chain.
    path
        File to create or overwrite.
    format
        - ``"urdf+"``: all that a chain can hold, read back the same. Other readers of URDF see the spanning tree.
        - ``"drake"``: URDF with Drake's ball constraints and joints, which Drake opens with its loops. Spherical loops.
        - ``"isaac"``: URDF with Isaac Sim's loop joints. Spherical loops.
        - ``"gepetto"``: URDF, and beside it a YAML of the same name. Spherical and fixed loops.
        - ``"mjcf"``: for MuJoCo, whose loops are soft constraints: mass matrix and bias of its tree are exact, its
          accelerations are not.

        All but the first and the last write couplings as ``<mimic>``, which has to be linear. Limits of joints that
        close loops stand in the first alone, and limits of balls in the first and, of the angle, in the last.

    Returns
    -------
    Report
        What the format has no word for, and what was put in its place or left out; print it.

    Raises
    ------
    InputError
        If the format is unknown, or the file cannot be written.
    UnsupportedError
        If the format cannot express the chain; names the link, joint, loop or motor at fault.
    """
    as_chain(chain)
    writers = {"mjcf": _write_mjcf}
    writers |= {
        dialect.name: _describing(dialect.write) for dialect in dialects() if dialect.write is not None
    }
    if format not in writers:
        raise InputError(f"format must be one of {', '.join(sorted(writers))}, got {format!r}")
    require_no_rotors(chain, "the file")
    try:
        return Report(writers[format](chain, Path(path)))
    except OSError as error:
        raise InputError(f"path: cannot write {str(path)!r}: {error.strerror}") from None


def _describing(
    write: Callable[[Mechanism, Path], tuple[Note, ...]],
) -> Callable[[ClosedChain, Path], tuple[Note, ...]]:
    return lambda chain, path: write(chain.described(), path)


def _write_mjcf(chain: ClosedChain, path: Path) -> tuple[Note, ...]:
    return write_mjcf_file(chain.described(), path, motors=chain.motors, gravity=chain.gravity)
