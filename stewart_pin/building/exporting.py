"""From a closed chain to files that other software reads, and to the same mechanism with displaced geometry."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from stewart_pin.building.joints import require_no_rotors, with_rotors_of
from stewart_pin.errors import InputError
from stewart_pin.model.description import Mechanism, Note, Report
from stewart_pin.model.formats.dialect import dialects, side_car_suffixes
from stewart_pin.model.formats.mjcf.writing import write_mjcf_file
from stewart_pin.model.formats.sdf.writing import write_sdf
from stewart_pin.model.formats.usd.writing import write_usd
from stewart_pin.model.tree import build_tree
from stewart_pin.model.validation import validate
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.geometry_parameters import (
    Attachment,
    Displacement,
    GeometryParameter,
    geometry_parameters,
)
from stewart_pin.state.newton import close_loops
from stewart_pin.state.state import as_chain
from stewart_pin.typing import FloatArray


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

        - ``"usd"``: OpenUSD in text, for Isaac Sim and Newton (extra ``usd``); all loops and couplings, and in words of
          our own all that a chain can hold, read back the same. Others see frames and masses in single precision.

        The other dialects of URDF and SDFormat write couplings as ``<mimic>``, which has to be linear. Limits of joints
        that close loops stand in the first, in SDFormat and OpenUSD, those of balls there and, of the angle, in MJCF.

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
    require_no_rotors(chain, "the file")
    if not isinstance(path, str | os.PathLike) or not Path(path).name:
        raise InputError(f"path must name a file, got {path!r}")
    if Path(path).suffix.lower() in side_car_suffixes():
        raise InputError(
            f"path: {str(path)!r} ends as a file beside a URDF does; give the URDF's name, as "
            f"{Path(path).with_suffix('.urdf').name!r}"
        )
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


# ----------------------------------------------------------------------------------------------------
# The same mechanism with joints and loops attached elsewhere, as tolerances and calibration have it
# ----------------------------------------------------------------------------------------------------

_Moves = dict[tuple[str, Attachment], FloatArray]
"""(6,) shift and rotation vector of each place that moves."""


def displace_geometry(chain: ClosedChain, displacements: Mapping[GeometryParameter, float]) -> ClosedChain:
    """Attach joints and loops elsewhere.

    Parameters
    ----------
    chain
        Closed chain.
    displacements
        How far each of `geometry_parameters` is displaced [m or rad]; what is not named stays. The turns of a frame
        form one rotation vector.

    Returns
    -------
    ClosedChain
        Same links, masses, motors and platform; its home is the old one with the loops closed again.

    Raises
    ------
    InputError
        If a parameter is not one of the chain's, or a displacement is not finite.
    MechanismError
        If what results is no mechanism, as with a rod of negative length.
    ClosureError
        If the loops do not close any more, as where a planar mechanism is bent out of its plane.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> first = stp.build.geometry_parameters(chain)[0]
    >>> moved = stp.build.displace_geometry(chain, {first: 1e-3})
    """
    as_chain(chain)
    known = set(geometry_parameters(chain))
    moves: _Moves = {}
    if not isinstance(displacements, Mapping):
        raise InputError(
            f"displacements must give an amount to each parameter, got {type(displacements).__name__}"
        )
    for parameter, amount in displacements.items():
        if parameter not in known:
            raise InputError(
                f"{parameter} is no parameter of {chain.name}; stewart_pin.build.geometry_parameters lists them"
            )
        if not np.isfinite(amount):
            raise InputError(f"the displacement of {parameter} must be finite, got {amount}")
        place = moves.setdefault((parameter.owner, parameter.attachment), np.zeros(6))
        place[parameter.axis + (3 if parameter.displacement is Displacement.TURN else 0)] = amount
    mechanism = _moved(chain.mechanism, moves)
    validate(mechanism)
    moved = replace(chain, mechanism=mechanism, model=build_tree(mechanism, chain.gravity))
    moved = with_rotors_of(chain, moved)
    return replace(moved, q_home=close_loops(moved, chain.q_home).q)


def _moved(mechanism: Mechanism, moves: _Moves) -> Mechanism:
    def placed(placement: pin.SE3, owner: str, attachment: Attachment) -> pin.SE3:
        move = moves.get((owner, attachment))
        if move is None:
            return placement
        return pin.SE3(pin.exp3(move[3:]) @ placement.rotation, placement.translation + move[:3])

    joints = tuple(
        replace(joint, placement=placed(joint.placement, joint.name, Attachment.JOINT))
        for joint in mechanism.joints
    )
    loops = tuple(
        replace(
            loop,
            placement1=placed(loop.placement1, loop.name, Attachment.FRAME1),
            placement2=placed(loop.placement2, loop.name, Attachment.FRAME2),
            length=loop.length + float(moves.get((loop.name, Attachment.ROD), np.zeros(1))[0]),
        )
        for loop in mechanism.loops
    )
    return replace(mechanism, joints=joints, loops=loops)
