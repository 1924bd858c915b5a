"""Rigid bodies of an OpenUSD stage: where they stand, what they weigh, and how they look."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from stewart_pin.errors import FileFormatError
from stewart_pin.model.description import Link, Outcome
from stewart_pin.model.formats.precision import moved_by_digits, within_digits
from stewart_pin.model.formats.usd.stage import OWN, PLATFORM, Stage, meant, placement_of, same_single
from stewart_pin.model.shapes import Material, Shape, ShapeKind, fault_of_sizes
from stewart_pin.typing import FloatArray

_SCALED = 1e-6
"""Relative change of a length below which a scale is round-off of single precision."""
_WORLD = "world"


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body.

    Attributes
    ----------
    link
        What it is.
    path
        Path of its prim.
    pose
        Where it stands in the world.
    still
        Whether the file keeps it where it is.
    fault
        Why its mass cannot be told, or None; of a body that the world holds, none is needed.
    """

    link: Link
    path: str
    pose: pin.SE3
    still: bool
    fault: FileFormatError | None = None


def is_body(stage: Stage, prim: Any) -> bool:
    """Tell whether a prim is a rigid body.

    Parameters
    ----------
    stage
        Its stage.
    prim
        The prim.

    Returns
    -------
    bool
        Whether the schema of rigid bodies is applied to it.
    """
    return bool(prim.HasAPI(stage.usd.UsdPhysics.RigidBodyAPI))


def body_above(stage: Stage, prim: Any) -> Any:
    """Find the rigid body that a prim is a part of.

    Parameters
    ----------
    stage
        Its stage.
    prim
        The prim.

    Returns
    -------
    object
        The prim of the body, or None.
    """
    while prim and not prim.IsPseudoRoot():
        if is_body(stage, prim):
            return prim
        prim = prim.GetParent()
    return None


def read_bodies(stage: Stage) -> dict[str, Body]:
    """Read all rigid bodies.

    Parameters
    ----------
    stage
        The stage.

    Returns
    -------
    dict
        Bodies by the path of their prims, in the order of the stage.

    Raises
    ------
    FileFormatError
        If a prim is sheared, or is not read at all.
    """
    prims = [prim for prim in stage.prims() if is_body(stage, prim)]
    parts: dict[str, list[Any]] = {str(prim.GetPath()): [] for prim in prims}
    for prim in stage.prims():
        if prim.IsA(stage.usd.UsdGeom.PointInstancer):
            raise stage.error(
                str(prim.GetPath()), "is a PointInstancer, which is not read; write its copies as prims"
            )
        owner = body_above(stage, prim)
        if owner is not None and prim.IsA(stage.usd.UsdGeom.Gprim):
            parts[str(owner.GetPath())].append(prim)
    names = _names(stage, prims)
    return {str(prim.GetPath()): _body(stage, prim, names, parts[str(prim.GetPath())]) for prim in prims}


def _names(stage: Stage, prims: list[Any]) -> dict[str, str]:
    """Name bodies after their prims, where that is unique, else after their paths."""
    wanted = {str(prim.GetPath()): stage.own(prim, "link", prim.GetName()) for prim in prims}
    counts = list(wanted.values())
    own = {str(prim.GetPath()) for prim in prims if stage.own(prim, "link") is not None}
    return {
        path: name
        if counts.count(name) == 1 and (name != _WORLD or path in own)
        else path.strip("/").replace("/", "_")
        for path, name in wanted.items()
    }


def _body(stage: Stage, prim: Any, names: Mapping[str, str], parts: list[Any]) -> Body:
    path = str(prim.GetPath())
    pose, scale = stage.pose(prim)
    still = _is_still(stage, prim)
    visuals, collisions = _shapes(stage, pose, parts)
    shaped = any(part.HasAPI(stage.usd.UsdPhysics.CollisionAPI) for part in parts)
    inertia, fault = None, None
    try:
        inertia = _inertia(stage, prim, scale, shaped=shaped)
    except FileFormatError as error:
        fault = error
    return Body(Link(names[path], inertia, visuals, collisions), path, pose, still, fault)


def _is_still(stage: Stage, prim: Any) -> bool:
    path = str(prim.GetPath())
    if not stage.value(prim, "physics:rigidBodyEnabled", True):
        stage.note(path, "physics:rigidBodyEnabled is off: fixed where it stands", Outcome.KEPT)
        return True
    if not stage.value(prim, "physics:kinematicEnabled", False):
        return False
    if stage.usd.UsdGeom.Xformable(prim).TransformMightBeTimeVarying():
        raise stage.error(
            path, "is kinematic, and an animation moves it; remove physics:kinematicEnabled, or the body"
        )
    stage.note(path, "physics:kinematicEnabled, and nothing moves it: fixed where it stands", Outcome.KEPT)
    return True


# ----------------------------------------------------------------------------------------------------
# Masses: nothing is computed from densities and shapes
# ----------------------------------------------------------------------------------------------------


def _inertia(stage: Stage, prim: Any, scale: FloatArray, *, shaped: bool) -> pin.Inertia | None:
    path, own = str(prim.GetPath()), stage.own(prim, "inertia")
    mass = float(stage.value(prim, "physics:mass", 0.0))
    if mass == 0 and own is not None and np.array(own)[0] == 0:
        # What has no mass is not written in the schema's words.
        return _unpacked(np.array(own))
    if mass == 0:
        if stage.own(prim, "massless", False) or stage.own(prim, "link") is not None:
            return None
        raise stage.error(
            path,
            "is a rigid body without physics:mass: engines compute it from density and shapes, which is not done here; "
            f"write mass, centre and moments, or 'custom bool {OWN}massless = 1' for a link without any",
        )
    if own is None and not prim.HasAPI(stage.usd.UsdPhysics.MassAPI):
        raise stage.error(
            path,
            "has physics:mass, but not the schema PhysicsMassAPI, without which engines pass it over; apply the schema",
        )
    moments = np.array(stage.value(prim, "physics:diagonalInertia", (0.0, 0.0, 0.0)), dtype=float)
    if own is not None and _agrees(stage, prim, np.array(own)):
        return _unpacked(np.array(own))
    if own is not None:
        stage.note(
            path,
            f"its mass was changed since {OWN}inertia was written, which is passed over",
            Outcome.CHANGED,
        )
    if not moments.any():
        raise stage.error(
            path,
            "has no physics:diagonalInertia: engines compute it from its shapes, which is not done here; write it",
        )
    centre = np.array(stage.value(prim, "physics:centerOfMass", (-np.inf,) * 3), dtype=float)
    if not np.isfinite([mass, *moments]).all():
        raise stage.error(path, f"has the mass {mass:g} and moments {moments.tolist()}: write finite numbers")
    if not np.isfinite(centre).all():
        if shaped:
            raise stage.error(
                path,
                "has no physics:centerOfMass: engines compute it from its shapes, which is not done; write it",
            )
        stage.note(path, "has no physics:centerOfMass: taken to be at its origin", Outcome.KEPT)
        centre = np.zeros(3)
    if np.abs(scale - 1).max() > _SCALED and centre.any():
        raise stage.error(
            path,
            f"is scaled by {scale.round(6).tolist()}, and engines do not agree whether physics:centerOfMass is; write "
            "the body without xformOp:scale",
        )
    axes = _rotation(stage, path, stage.value(prim, "physics:principalAxes"), none=np.eye(3))
    matrix, moved = within_digits((axes * meant(moments)) @ axes.T, (str(np.float32(one)) for one in moments))
    unit = stage.kilogram * stage.metre**2
    if moved:
        stage.note(path, moved_by_digits(moved * unit), Outcome.CHANGED)
    matrix = matrix * unit
    inertia = pin.Inertia(
        float(meant([mass])[0]) * stage.kilogram, meant(centre) * stage.metre, np.zeros((3, 3))
    )
    inertia.inertia = (matrix + matrix.T) / 2
    return inertia


def _unpacked(numbers: FloatArray) -> pin.Inertia:
    matrix = np.zeros((3, 3))
    matrix[np.triu_indices(3)] = numbers[4:]
    inertia = pin.Inertia(float(numbers[0]), numbers[1:4], np.zeros((3, 3)))
    inertia.inertia = matrix + np.triu(matrix, 1).T
    return inertia


def _agrees(stage: Stage, prim: Any, numbers: FloatArray) -> bool:
    """Tell whether our own numbers round to those of the schema, which are in kg and m in our files."""
    own = _unpacked(numbers)
    if not np.isfinite(stage.value(prim, "physics:diagonalInertia", (0.0,) * 3)).all():
        return False
    centre = np.array(stage.value(prim, "physics:centerOfMass", (-np.inf,) * 3), dtype=float)
    moments = np.array(stage.value(prim, "physics:diagonalInertia", (0.0,) * 3), dtype=float)
    axes = _rotation(stage, str(prim.GetPath()), stage.value(prim, "physics:principalAxes"), none=np.eye(3))
    told = (axes * moments) @ axes.T
    return (
        stage.metre == stage.kilogram == 1.0
        and same_single(np.array([own.mass]), np.array([stage.value(prim, "physics:mass", 0.0)]))
        and same_single(own.lever, centre)
        # Quaternions of single precision turn a matrix by a few last bits.
        and bool(np.abs(told - own.inertia).max() <= 2e-6 * np.abs(own.inertia).max())
    )


def _rotation(stage: Stage, path: str, quaternion: Any, *, none: FloatArray) -> FloatArray:
    if quaternion is None:
        return none
    numbers = quaternion_of(quaternion)
    size = float(np.linalg.norm(numbers))
    if size == 0:
        return none
    if not np.isfinite(size):
        raise stage.error(path, "has a quaternion that is not finite")
    return rotation_of(numbers)


def quaternion_of(quaternion: Any) -> FloatArray:
    """Take a quaternion apart.

    Parameters
    ----------
    quaternion
        A ``Gf.Quatf`` or the like.

    Returns
    -------
    numpy.ndarray
        (4,) w x y z as in the file (dimensionless).
    """
    return np.array([quaternion.GetReal(), *quaternion.GetImaginary()], dtype=float)


def rotation_of(quaternion: FloatArray) -> FloatArray:
    """Make a rotation of a quaternion of any length.

    Parameters
    ----------
    quaternion
        (4,) w x y z, of single precision (dimensionless).

    Returns
    -------
    numpy.ndarray
        (3, 3) rotation matrix.
    """
    w, x, y, z = (float(number) for number in meant(quaternion))
    return pin.Quaternion(w, x, y, z).normalized().toRotationMatrix()


# ----------------------------------------------------------------------------------------------------
# Links without mass that are fixed to a body: prims below it that our own words name, or called platform
# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame on a body that is a link of its own.

    Attributes
    ----------
    link
        The link.
    joint
        Name of the joint that fixes it.
    owner
        Path of the body.
    placement
        Frame in the body.
    """

    link: Link
    joint: str
    owner: str
    placement: pin.SE3


def read_frames(stage: Stage, bodies: Mapping[str, Body]) -> list[Frame]:
    """Find the frames on bodies that are links.

    Parameters
    ----------
    stage
        The stage.
    bodies
        Its bodies.

    Returns
    -------
    list of Frame
        Those that words of our own name, or that are called ``platform``.
    """
    frames: list[Frame] = []
    taken = {body.link.name for body in bodies.values()}
    for prim in stage.prims():
        owner, name = body_above(stage, prim), stage.own(prim, "link")
        if owner is None or is_body(stage, prim) or prim.IsA(stage.usd.UsdGeom.Gprim):
            continue
        if name is None and (prim.GetName() != PLATFORM or PLATFORM in taken):
            continue
        body = bodies[str(owner.GetPath())]
        placement = body.pose.inverse() * stage.pose(prim)[0]
        told = stage.own(prim, "frame0")
        if told is not None and _near(placement_of(told), placement):
            placement = placement_of(told)
        inertia = None if stage.own(prim, "inertia") is None else pin.Inertia.Zero()
        name = prim.GetName() if name is None else name
        taken.add(name)
        joint = stage.own(prim, "joint", f"{name}_frame")
        frames.append(Frame(Link(name, inertia), joint, body.path, placement))
    return frames


def _near(one: pin.SE3, other: pin.SE3) -> bool:
    size = 1.0 + float(np.abs(one.translation).max())
    return bool(np.abs(one.homogeneous - other.homogeneous).max() <= 1e-9 * size)


# ----------------------------------------------------------------------------------------------------
# Shapes
# ----------------------------------------------------------------------------------------------------

_TURNS = {
    "X": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "Y": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    "Z": np.eye(3),
}
"""Rotations that take z to the axis of a cylinder or capsule."""


def _shapes(stage: Stage, pose: pin.SE3, parts: list[Any]) -> tuple[tuple[Shape, ...], tuple[Shape, ...]]:
    visuals: list[Shape] = []
    collisions: list[Shape] = []
    for prim in parts:
        try:
            shape = _shape(stage, pose, prim)
        except FileFormatError as error:
            stage.note(str(prim.GetPath()), f"left out: {str(error).partition('> ')[2]}")
            continue
        if shape is not None:
            collides = prim.HasAPI(stage.usd.UsdPhysics.CollisionAPI)
            guide = stage.value(prim, "purpose") == "guide"
            if collides:
                collisions.append(shape)
            if not (collides and guide):
                visuals.append(shape)
    return tuple(visuals), tuple(collisions)


def _shape(stage: Stage, pose: pin.SE3, prim: Any) -> Shape | None:
    kind = prim.GetTypeName()
    placed, scale = stage.pose(prim)
    metre = stage.metre
    sizes: tuple[float, ...]
    turn = np.eye(3)
    match kind:
        case "Cube":
            made, sizes = ShapeKind.BOX, tuple(float(stage.value(prim, "size", 2.0)) * metre * scale)
        case "Sphere":
            radius = float(stage.value(prim, "radius", 1.0)) * metre
            even = bool(np.ptp(scale) <= _SCALED * scale[0])
            made = ShapeKind.SPHERE if even else ShapeKind.ELLIPSOID
            sizes = (radius * float(scale[0]),) if even else tuple(radius * scale)
        case "Cylinder" | "Capsule":
            made = ShapeKind.CYLINDER if kind == "Cylinder" else ShapeKind.CAPSULE
            turn = _TURNS.get(stage.value(prim, "axis", "Z"), _TURNS["Z"])
            across, _, along = turn.T @ scale
            radius, height = (float(stage.value(prim, name, 1.0)) * metre for name in ("radius", "height"))
            sizes = (radius * float(abs(across)), height * float(abs(along)))
        case _:
            stage.note(str(prim.GetPath()), f"a {kind or 'shape'}: left out, only simple shapes are read")
            return None
    fault = fault_of_sizes(made, sizes)
    if fault:
        raise stage.error(str(prim.GetPath()), f"is no shape: {fault}")
    name = stage.own(prim, "shape", "")
    placement = pose.inverse() * placed * pin.SE3(turn, np.zeros(3))
    return Shape(made, tuple(map(float, sizes)), placement, name, material=_material(stage, prim))


def _material(stage: Stage, prim: Any) -> Material | None:
    colour = stage.value(prim, "primvars:displayColor")
    if colour is None or not len(colour):
        return None
    opacity = stage.value(prim, "primvars:displayOpacity")
    alpha = 1.0 if opacity is None or not len(opacity) else float(meant(opacity)[0])
    red, green, blue = map(float, meant(colour[0]))
    return Material(rgba=(red, green, blue, alpha))
