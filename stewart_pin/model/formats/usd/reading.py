"""From an OpenUSD file to a mechanism.

Joints between bodies are the edges of a graph. A spanning tree takes motors first, then joints that the file keeps in
an articulation, then the others; what is left closes loops. Bodies stand where the stage places them, which is home.

References
----------
.. [1] Pixar, "Rigid Body Physics in USD", UsdPhysics.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from stewart_pin.errors import FileFormatError
from stewart_pin.model.description import (
    Coupling,
    Joint,
    JointKind,
    Mechanism,
)
from stewart_pin.model.formats.precision import Precision, half_unit
from stewart_pin.model.formats.usd.bodies import Body, body_above, quaternion_of, read_bodies, read_frames
from stewart_pin.model.formats.usd.joints import CHANCE, GROUND, Edge, JointReader
from stewart_pin.model.formats.usd.stage import OWN, PLATFORM, Stage, meant, open_stage, same_single
from stewart_pin.model.formats.usd.tree import TreeMaker
from stewart_pin.typing import FloatArray

_PHYSX_MIMIC = re.compile(r"physxMimicJoint:\w+:referenceJoint")
_EARTH = 9.81
"""What stands for a magnitude of gravity that is not stated [m/s²]."""


def read_usd(path: Path) -> Mechanism:
    """Read all rigid bodies and joints of an OpenUSD stage as one mechanism.

    Parameters
    ----------
    path
        Text, binary or package; what it refers to has to lie on this machine.

    Returns
    -------
    Mechanism
        Description, not yet validated.

    Raises
    ------
    MissingExtraError
        If OpenUSD is not installed.
    FileFormatError
        If the file is broken, refers to what is missing, or would have masses computed from shapes.
    UnsupportedError
        If it refers to another machine, or ties bodies together in a way that is not read.
    """
    stage = open_stage(path)
    bodies = read_bodies(stage)
    if not bodies:
        raise FileFormatError(
            "the stage holds no rigid body: nothing has the schema PhysicsRigidBodyAPI",
            path=str(path),
            culprit="stage",
        )
    reader = JointReader(stage, bodies)
    edges = reader.read()
    digits = _with_places(stage, bodies, edges, reader.digits)
    ground = _ground(bodies, edges)
    if ground is not None:
        edges = [_without(edge, ground) for edge in edges if GROUND not in edge.bodies]
    edges += [
        Edge(
            f"{body.link.name}_static",
            body.path,
            JointKind.FIXED,
            (GROUND, body.path),
            (body.pose, pin.SE3.Identity()),
        )
        for body in bodies.values()
        if body.still and body.path != ground
    ]
    _require_masses(bodies, edges, ground)
    maker = TreeMaker(stage, bodies, edges, ground)
    made = maker.make(_couplings(stage, edges))
    root = stage.stage.GetDefaultPrim() or stage.stage.GetPseudoRoot()
    frames = read_frames(stage, bodies)
    links = [*made.links, *(frame.link for frame in frames)]
    mounts = [
        Joint(frame.joint, JointKind.FIXED, maker.names[frame.owner], frame.link.name, frame.placement)
        for frame in frames
    ]
    platform = stage.own(root, "platform")
    if platform is None and any(link.name == PLATFORM for link in links):
        platform = PLATFORM
    odd = {
        bodies[str(prim.GetPath())].link.name
        for prim in stage.prims()
        if stage.own(prim, "odd_inertia", False) and str(prim.GetPath()) in bodies
    }
    mechanism = replace(
        made,
        name=stage.own(root, "robot", root.GetName() or path.stem),
        links=tuple(links),
        joints=(*made.joints, *mounts),
        platform=platform,
        source=str(path),
        notes=tuple(stage.notes),
        gravity=_gravity(stage, root, bodies),
        odd_inertias=frozenset(odd),
        digits=(digits.length, digits.angle),
    )
    told = stage.own(root, "assembled")
    if told is not None and all(edge.told or edge.name.endswith("_static") for edge in edges):
        mechanism = replace(mechanism, assembled=bool(told))
    return mechanism


def _gravity(stage: Stage, root: Any, bodies: Mapping[str, Body]) -> tuple[float, float, float] | None:
    modules = stage.usd
    weightless = [
        path
        for path, body in bodies.items()
        if not body.still
        and stage.value(stage.stage.GetPrimAtPath(path), "physxRigidBody:disableGravity", False)
    ]
    if weightless:
        if len(weightless) < sum(not body.still for body in bodies.values()):
            raise stage.error(
                weightless[0], "has physxRigidBody:disableGravity, and others have not; make them alike"
            )
        return 0.0, 0.0, 0.0
    upright = modules.UsdGeom.GetStageUpAxis(stage.stage)
    down = -np.eye(3)["XYZ".index(str(upright))]
    found: list[FloatArray] = []
    for prim in stage.prims():
        if not prim.IsA(modules.UsdPhysics.Scene):
            continue
        direction = meant(stage.value(prim, "physics:gravityDirection", (0.0, 0.0, 0.0)))
        size = float(meant([stage.value(prim, "physics:gravityMagnitude", -np.inf)])[0])
        size = _EARTH if size < 0 else size * stage.metre
        if not np.isfinite([*direction, max(size, 0.0)]).all():
            raise stage.error(str(prim.GetPath()), "states a gravity that is not finite")
        length = float(np.linalg.norm(direction))
        fall = size * (direction / length if length > 0 else down)
        if found and not np.allclose(fall, found[0]):
            raise stage.error(str(prim.GetPath()), "is a second scene with another gravity; keep one")
        found.append(fall)
    if not found:
        fall = _EARTH * down
        found.append(fall)
        if str(upright) == "Z":
            return None
    told = stage.own(root, "gravity")
    if told is not None and same_single(np.array(told), found[0], _EARTH):
        found[0] = np.array(told)
    x, y, z = (float(part) + 0.0 for part in found[0])
    return x, y, z


# ----------------------------------------------------------------------------------------------------
# Digits of what stands still: where joints end on several such bodies, their places are as much geometry as frames
# ----------------------------------------------------------------------------------------------------


def _with_places(
    stage: Stage, bodies: Mapping[str, Body], edges: Sequence[Edge], digits: Precision
) -> Precision:
    """Count the digits of what places bodies that do not move, and other prims on which joints end."""
    placed: dict[str, list[Any]] = {}
    for edge in edges:
        joint = stage.stage.GetPrimAtPath(edge.path)
        for number in (0, 1) if joint else ():
            found = stage.targets(joint, f"physics:body{number}")
            prim = stage.stage.GetPrimAtPath(found[0]) if found else None
            owner = None if prim is None else body_above(stage, prim)
            body = None if owner is None else bodies.get(str(owner.GetPath()))
            if body is None or body.still:
                still = owner or prim
                key = "" if still is None else str(still.GetPath())
                placed[key] = [] if prim is None else [*_upward(prim)]
    if len(placed) < 2:  # all stand on one, wherever that is
        return digits
    places = {str(prim.GetPath()): prim for prims in placed.values() for prim in prims}
    open_by = [_open_by(stage, prim) for prim in places.values()]
    lengths, angles = ([getattr(each, key) for each in open_by] for key in ("length", "angle"))
    return Precision(max([digits.length, *lengths]), max([digits.angle, *angles]))


def _upward(prim: Any) -> Iterator[Any]:
    while prim and str(prim.GetPath()) != "/":
        yield prim
        prim = prim.GetParent()


def _open_by(stage: Stage, prim: Any) -> Precision:
    """Find what the digits of the operations leave open that place a prim in its parent."""
    geometry = stage.usd.UsdGeom
    if not prim.IsA(geometry.Xformable):
        return Precision()
    lengths, angles = [0.0], [0.0]
    for operation in geometry.Xformable(prim).GetOrderedXformOps():
        value, kind = operation.Get(stage.cache.GetTime()), str(operation.GetOpType())
        single = operation.GetPrecision() != geometry.XformOp.PrecisionDouble
        if value is None or kind.endswith("TypeScale"):
            continue
        if kind.endswith("TypeTransform"):
            matrix = np.array(value)
            lengths += [_left_open(x, single=single) for x in matrix[3, :3]]
            angles += [_left_open(x, single=single) for x in matrix[:3, :3].flat]
        elif kind.endswith("TypeOrient"):
            # An entry of a quaternion is half an angle.
            angles += [2 * _left_open(x, single=single) for x in quaternion_of(value)]
        elif kind.endswith("TypeTranslate"):
            lengths += [_left_open(x, single=single) for x in value]
        else:
            angles += [np.deg2rad(_left_open(x, single=single)) for x in np.atleast_1d(value)]
    above = prim.GetParent()
    scale = 1.0 if above.IsPseudoRoot() else float(stage.pose(above)[1].max())
    return Precision(max(lengths) * scale * stage.metre, float(max(angles)))


def _left_open(value: float, *, single: bool) -> float:
    """Half a unit of the last digit of a number, or of the last bit where it is of single precision."""
    if single:  # a place is computed of the number as it is, not of the decimals that it stands for
        number = np.float32(value)
        return max(half_unit(str(number)), float(np.spacing(np.abs(number))) / 2 if number else 0.0)
    found = half_unit(repr(float(value)))
    return found if found > CHANCE else 0.0


# ----------------------------------------------------------------------------------------------------
# The ground: the world, or the one body that is fixed to it without a shift
# ----------------------------------------------------------------------------------------------------


def _ground(bodies: Mapping[str, Body], edges: Sequence[Edge]) -> str | None:
    """Find the body that stands for the world, where nothing else is joined to it."""
    on_world = [edge for edge in edges if GROUND in edge.bodies]
    if len(on_world) != 1 or on_world[0].kind is not JointKind.FIXED or on_world[0].excluded:
        return None
    edge = on_world[0]
    path = next(end for end in edge.bodies if end != GROUND)
    one = np.eye(4)
    placed = [*edge.frames, bodies[path].pose]
    if any(body.still for body in bodies.values()) or any(
        np.abs(at.homogeneous - one).max() for at in placed
    ):
        return None
    return path


def _without(edge: Edge, ground: str) -> Edge:
    first, second = (GROUND if end == ground else end for end in edge.bodies)
    return replace(edge, bodies=(first, second))


def _require_masses(bodies: Mapping[str, Body], edges: Sequence[Edge], ground: str | None) -> None:
    """Refuse bodies whose mass cannot be told, unless the world holds them."""
    held = {GROUND, ground}
    rigid = [edge.bodies for edge in edges if edge.kind is JointKind.FIXED]
    while True:
        more = {end for ends in rigid if held & {*ends} for end in ends} - held
        if not more:
            break
        held |= more
    for path, body in bodies.items():
        if body.fault is not None and path not in held:
            raise body.fault


# ----------------------------------------------------------------------------------------------------
# Couplings: our own words, or those of Newton and PhysX
# ----------------------------------------------------------------------------------------------------


def _couplings(stage: Stage, edges: Sequence[Edge]) -> list[Coupling]:
    by_path = {edge.path: edge for edge in edges}
    found: list[Coupling] = []
    told: dict[str, Coupling] = {}
    for prim in stage.prims():
        name = stage.own(prim, "coupling")
        if name is not None:
            joint2 = stage.own(prim, "joint2")
            polynomial = tuple(float(number) for number in stage.own(prim, "polynomial", ()))
            if not polynomial:
                raise stage.error(
                    str(prim.GetPath()),
                    f"is a coupling without {OWN}polynomial; give its coefficients, constant first",
                )
            coupling = Coupling(name, stage.own(prim, "joint1", ""), joint2, polynomial)
            found.append(coupling)
            told.setdefault(coupling.joint1, coupling)
    for prim in stage.prims():
        edge = by_path.get(str(prim.GetPath()))
        mimic = None if edge is None else _mimic(stage, prim, edge, by_path)
        if edge is None or mimic is None:
            continue
        known = told.get(edge.name)
        if known is None:
            found.append(mimic)
        elif known.joint2 != mimic.joint2 or not same_single(
            np.array((*known.polynomial, 0.0)[:2]), np.array(mimic.polynomial)
        ):
            raise stage.error(
                edge.path,
                f"follows another joint, or by other numbers, than {OWN}polynomial says; remove one of them",
            )
    return found


def _mimic(stage: Stage, prim: Any, edge: Edge, by_path: Mapping[str, Edge]) -> Coupling | None:
    """Read a joint that follows another: angles are degrees, and PhysX has the other signs."""
    targets: list[Any] = []
    offset = factor = 0.0
    newton = stage.targets(prim, "newton:mimicJoint")
    if newton and stage.value(prim, "newton:mimicEnabled", True):
        targets = newton
        offset, factor = (
            float(meant([stage.value(prim, f"newton:mimicCoef{k}", float(k))])[0]) for k in (0, 1)
        )
    # One instance, whose name is that of the coordinate: rotX, transY, Z or linear, as writers have it.
    physx = [
        (target, str(rel.GetName()).rpartition(":")[0])
        for rel in prim.GetRelationships()
        if _PHYSX_MIMIC.fullmatch(str(rel.GetName()))
        for target in stage.targets(prim, str(rel.GetName()))
    ]
    if physx and not targets:
        targets = [target for target, _ in physx]
        offset, factor = (
            -float(meant([stage.value(prim, f"{physx[0][1]}:{word}", default)])[0])
            for word, default in (("offset", 0.0), ("gearing", 1.0))
        )
    if not targets:
        return None
    leader = by_path.get(str(targets[0]))
    one_freedom = (JointKind.REVOLUTE, JointKind.PRISMATIC)
    if len(targets) != 1 or leader is None or edge.kind not in one_freedom or leader.kind not in one_freedom:
        raise stage.error(
            edge.path,
            f"follows {[str(target) for target in targets]}; hinges and slides follow one of these each",
        )
    units = [np.radians(1.0) if one.kind is JointKind.REVOLUTE else stage.metre for one in (edge, leader)]
    return Coupling(
        f"{edge.name}_mimic", edge.name, leader.name, (offset * units[0], factor * units[0] / units[1])
    )
