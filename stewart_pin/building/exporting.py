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
from stewart_pin.model.description import Joint, JointKind, Link, Loop, Mechanism, Note, Report
from stewart_pin.model.formats.dialect import dialects, side_car_suffixes
from stewart_pin.model.formats.mjcf.writing import write_mjcf_file
from stewart_pin.model.formats.sdf.writing import write_sdf
from stewart_pin.model.formats.usd.writing import write_usd
from stewart_pin.model.loop_rows import orthonormal_triad
from stewart_pin.model.shapes import DRAWN, Material, Shape, ShapeKind
from stewart_pin.model.tree import build_tree
from stewart_pin.model.unfolding import fixed_to
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
        - ``"usd"``: OpenUSD in text, for Isaac Sim and Newton (extra ``usd``); all loops and couplings, and in words of
          our own all that a chain can hold, read back the same. Others see frames and masses in single precision.

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
    require_no_rotors(chain, "the file")
    if not isinstance(path, str | os.PathLike) or not Path(path).name or "\0" in os.fspath(path):
        raise InputError(f"path must name a file, got {path!r}")
    if Path(path).suffix.lower() in side_car_suffixes():
        raise InputError(
            f"path: {str(path)!r} ends as a file beside a URDF does; give the URDF's name, as "
            f"{Path(path).with_suffix('.urdf').name!r}"
        )
    try:
        return Report(writers[format](_drawn(chain) if simple_shapes else chain, Path(path)))
    except OSError as error:
        raise InputError(f"path: cannot write {str(path)!r}: {error.strerror}") from None


def _describing(
    write: Callable[[Mechanism, Path], tuple[Note, ...]],
) -> Callable[[ClosedChain, Path], tuple[Note, ...]]:
    return lambda chain, path: write(chain.described(), path)


def _write_mjcf(chain: ClosedChain, path: Path) -> tuple[Note, ...]:
    return write_mjcf_file(chain.described(), path, motors=chain.motors, gravity=chain.gravity)


# ----------------------------------------------------------------------------------------------------
# The points at which joints and loops hold the bodies of a chain: what a body looks like when no file says so
# ----------------------------------------------------------------------------------------------------


_SAME = 1e-6
"""Points nearer than this are one point, in robot sizes."""


def body_points(chain: ClosedChain) -> dict[str, FloatArray]:
    """Collect the points of every link.

    Where all joints meet in one point, as those of a spherical linkage, hinges hold the bodies along their axes, at
    `hinge_reach` from there.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    dict
        ``{link: (n, 3) points in the link frame [m]}``, each point once.
    """
    points = _held_points(chain, hinge_reach(chain))
    same = _SAME * chain.length_scale
    # A flange is the only far end that a last link has; a payload is no corner of a platform.
    for joint in chain.mechanism.joints:
        if _holds_nothing(chain, joint):
            points[joint.child].append(np.zeros(3))
            if len(_distinct(points[joint.parent], same)) < 2:
                points[joint.parent].append(np.array(joint.placement.translation))
    return {link: _distinct(found, same) for link, found in points.items()}


def hinge_reach(chain: ClosedChain) -> float:
    """Tell how far from their frames hinges are drawn, along their axes.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    float
        Zero; the size of the robot where every body that several joints or loops hold is held at one point [m].
    """
    held = [points for points in _held_points(chain, 0.0).values() if len(points) > 1]
    same = _SAME * chain.length_scale
    return chain.length_scale if held and all(len(_distinct(points, same)) == 1 for points in held) else 0.0


def off_centre(joint: Joint | Loop, reach: float) -> FloatArray:
    """Place the mark of a joint or loop in its own frame.

    Parameters
    ----------
    joint
        Joint or loop.
    reach
        What `hinge_reach` says [m].

    Returns
    -------
    numpy.ndarray
        (3,) point [m].
    """
    return reach * np.asarray(joint.axis) if joint.kind is JointKind.REVOLUTE else np.zeros(3)


def _held_points(chain: ClosedChain, reach: float) -> dict[str, list[FloatArray]]:
    """Collect where joints and loops hold each link to others, hinges off centre."""
    points: dict[str, list[FloatArray]] = {link.name: [] for link in chain.mechanism.links}
    for joint in chain.mechanism.joints:
        # A free body is held by nothing.
        if joint.kind is not JointKind.FLOATING and not _holds_nothing(chain, joint):
            points[joint.parent].append(np.array(joint.placement.act(off_centre(joint, reach))))
            points[joint.child].append(off_centre(joint, reach))
    for loop in chain.loops:
        points[loop.link1].append(np.array(loop.placement1.act(off_centre(loop, reach))))
        points[loop.link2].append(np.array(loop.placement2.act(off_centre(loop, reach))))
    return points


def _holds_nothing(chain: ClosedChain, joint: Joint) -> bool:
    """Tell whether a joint fixes a link that no other joint or loop holds, such as a payload or a frame."""
    held = {other.parent for other in chain.mechanism.joints}
    held |= {link for loop in chain.loops for link in (loop.link1, loop.link2)}
    return joint.kind is JointKind.FIXED and joint.child not in held


def _distinct(points: list[FloatArray], same: float) -> FloatArray:
    kept: list[FloatArray] = []
    for point in points:
        if all(np.linalg.norm(point - other) > same for other in kept):
            kept.append(point)
    return np.array(kept).reshape(-1, 3)


_STICK = 0.01
"""Radius of the simple shapes, in robot sizes."""
_GROUND, _PLATFORM, _BODY = (0.43, 0.43, 0.43, 1.0), (0.12, 0.47, 0.71, 1.0), (0.3, 0.3, 0.3, 1.0)


def _drawn(chain: ClosedChain) -> ClosedChain:
    """Give bodies simple shapes where no link has any that can be seen: sticks between the points that hold them."""
    mechanism = chain.mechanism
    if any(link.visuals for link in mechanism.links):
        return chain
    points = body_points(chain)
    # Formats that call their ground so add a link of this name, to which the ground is fixed.
    still = fixed_to(mechanism, mechanism.root).keys() - {"world"}
    ground = still & {joint.parent for joint in mechanism.joints}
    for name in ground:
        points[name] = _distinct([np.zeros(3), *points[name]], _SAME * chain.length_scale)
    links = tuple(
        replace(link, visuals=_sticks(chain, link, points[link.name]))
        if link.inertia is not None or link.name in ground
        else link
        for link in mechanism.links
    )
    return replace(chain, mechanism=replace(mechanism, links=links))


def _sticks(chain: ClosedChain, link: Link, points: FloatArray) -> tuple[Shape, ...]:
    """One stick between two points, a star from the middle of more, a stick through the centre of mass from one."""
    radius = _STICK * chain.length_scale
    if len(points) == 1 and link.inertia is not None:
        points = np.array([points[0], 2 * np.array(link.inertia.lever) - points[0]])
    elif len(points) == 0:
        points = np.zeros((1, 3)) if link.inertia is None else np.array([link.inertia.lever])
    colour = (
        _GROUND
        if link.name in fixed_to(chain.mechanism, chain.mechanism.root)
        else _PLATFORM
        if link.name == chain.platform
        else _BODY
    )
    middle = points[0] if len(points) <= 2 else points.mean(axis=0)
    shapes: list[Shape] = []
    for number, end in enumerate(points if len(points) > 2 else points[-1:], start=1):
        along = end - middle
        length = float(np.linalg.norm(along))
        name = f"{DRAWN}{link.name}_{number}"
        if length > radius:
            normal, x, y = orthonormal_triad(along / length)
            turn = np.column_stack([x, y, normal])
            kind, sizes, place = ShapeKind.CYLINDER, (radius, length), pin.SE3(turn, (middle + end) / 2)
        else:
            kind, sizes, place = ShapeKind.SPHERE, (2 * radius,), pin.SE3(np.eye(3), end)
        shapes.append(Shape(kind, sizes, place, name, material=Material(rgba=colour)))
    return tuple(shapes)


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
