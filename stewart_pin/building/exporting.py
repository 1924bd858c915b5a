"""From a closed chain to files that other software reads."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from stewart_pin.building.drawn_shapes import with_drawn_shapes
from stewart_pin.building.joints import require_describable
from stewart_pin.errors import InputError
from stewart_pin.model.description import Mechanism, Note, Report
from stewart_pin.model.formats.dialect import dialects, side_car_suffixes
from stewart_pin.model.formats.mjcf.writing import write_mjcf_file
from stewart_pin.model.formats.sdf.writing import write_sdf
from stewart_pin.model.formats.usd.writing import write_usd
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import as_chain


def write_urdf(chain: ClosedChain, path: str | Path, *, simple_shapes: bool = True) -> Report:
    """Write a chain as URDF, its loops in the URDF+ dialect, so that `load` reads the same chain back.

    Gravity goes along, in an element of our own, where it is not the usual one.

    Parameters
    ----------
    chain
        Closed chain.
    path
        File to create or overwrite.
    simple_shapes
        As of `export`.

    Returns
    -------
    Report
        What was left out or changed, as of `export`.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    return export(chain, path, format="urdf+", simple_shapes=simple_shapes)


def export(
    chain: ClosedChain, path: str | Path, *, format: str = "urdf+", simple_shapes: bool = True
) -> Report:
    """Write a chain in a format of another simulator.

    Parameters
    ----------
    chain
        Closed chain.
    path
        File to create or overwrite: it is written whole, or what was there stays.
    format
        - ``"urdf+"``: all that a chain can hold, read back the same. Other readers of URDF see the spanning tree.
        - ``"drake"``: URDF with Drake's ball constraints and joints, which Drake opens with its loops. Spherical loops.
        - ``"isaac"``: URDF with Isaac Sim's loop joints. Spherical loops.
        - ``"gepetto"``: URDF, and beside it a YAML of the same name. Spherical and fixed loops.
        - ``"sdf"``: SDFormat 1.11, for Gazebo; links where they are at home. Spherical, fixed, revolute, prismatic and
          universal loops, each a second joint with the same child, which Drake refuses; all limits.
        - ``"mjcf"``: for MuJoCo, whose loops are soft constraints: mass matrix and bias of its tree are exact, its
          accelerations are not.
        - ``"usd"``: OpenUSD in text, for Isaac Sim and Newton (extra ``usd``); all loops but cables,
          all couplings, and in words of our own all that a chain can hold, read back the same. Others see frames and
          masses in single precision.

        The other dialects of URDF and SDFormat write couplings as ``<mimic>``, which has to be linear. Limits of joints
        that close loops stand in the first, in SDFormat and OpenUSD, those of balls there and, of the angle, in MJCF.
    simple_shapes
        Whether viewers are given sticks between the joints of each body where no link has a shape to be seen; `load`
        takes them off again.

    Returns
    -------
    Report
        What the format has no word for, and what was put in its place or left out; print it.

    Raises
    ------
    InputError
        If the format is unknown, or the file cannot be written; says why, and what to do.
    UnsupportedError
        If the format cannot express the chain; names the link, joint, loop or motor at fault.
    """
    as_chain(chain)
    writers = {
        "mjcf": _write_mjcf,
        "sdf": _describing(write_sdf),
        "usd": _describing(write_usd),
    }
    writers |= {
        dialect.name: _describing(dialect.write) for dialect in dialects() if dialect.write is not None
    }
    if format not in writers:
        raise InputError(f"format must be one of {', '.join(sorted(writers))}, got {format!r}")
    require_describable(chain)
    if not isinstance(path, str | os.PathLike) or not Path(path).name or "\0" in os.fspath(path):
        raise InputError(f"path must name a file, got {path!r}")
    if Path(path).suffix.lower() in side_car_suffixes():
        raise InputError(
            f"path: {str(path)!r} ends as a file beside a URDF does; give the URDF's name, as "
            f"{Path(path).with_suffix('.urdf').name!r}"
        )
    try:
        return Report(writers[format](with_drawn_shapes(chain) if simple_shapes else chain, Path(path)))
    except OSError as error:
        raise InputError(f"path: cannot write {str(path)!r}: {error.strerror}") from None


def _describing(
    write: Callable[[Mechanism, Path], tuple[Note, ...]],
) -> Callable[[ClosedChain, Path], tuple[Note, ...]]:
    return lambda chain, path: write(chain.described(), path)


def _write_mjcf(chain: ClosedChain, path: Path) -> tuple[Note, ...]:
    return write_mjcf_file(chain.described(), path, motors=chain.motors, gravity=chain.gravity)
