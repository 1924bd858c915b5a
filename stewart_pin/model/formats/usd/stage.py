"""What reader and writer of OpenUSD share: the package, stages, our own words, and joints in the schema's numbers.

The schema holds the frames of joints, masses and limits in single precision. The numbers meant stand beside them in
attributes of our own, in double precision; they are believed where they round to the schema's, which another programme
may have changed since.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin

from stewart_pin.errors import FileFormatError, MissingExtraError, UnsupportedError
from stewart_pin.model.description import JointKind, Note, Outcome
from stewart_pin.model.loop_rows import orthonormal_triad
from stewart_pin.typing import FloatArray

OWN = "stewart_pin:"
"""Namespace of our own attributes."""
SUFFIXES = (".usda", ".usd", ".usdc", ".usdz")
PLATFORM = "platform"
SINGLE = 2.0**-22
"""How far numbers may be apart, relatively, that single precision does not tell apart: a few times its last bit."""
BOUNDS = ("position", "velocity", "acceleration", "effort", "jerk")
"""Limits of a coordinate, in the order in which our own word holds them, both ends of each."""
PHYSICS = ("armature", "damping", "friction", "stiffness", "rest", "force")
"""What a joint does by itself along each of its coordinates, in words of our own."""
DOFS = ("transX", "transY", "transZ", "rotX", "rotY", "rotZ")
FREE_DOFS = {
    # About or along x of both frames; a universal joint turns about y of frame 0 and x of frame 1.
    JointKind.CYLINDRICAL: ("transX", "rotX"),
    JointKind.PLANAR: ("transY", "transZ", "rotX"),
    JointKind.POINT_ON_LINE: ("transX", "rotX", "rotY", "rotZ"),
    JointKind.UNIVERSAL: ("rotY", "rotX"),
    JointKind.FLOATING: DOFS,
}
"""What joints leave free for which the schema has no type of its own, in the order of their coordinates."""
TYPES = {
    JointKind.FIXED: "PhysicsFixedJoint",
    JointKind.REVOLUTE: "PhysicsRevoluteJoint",
    JointKind.PRISMATIC: "PhysicsPrismaticJoint",
    JointKind.SPHERICAL: "PhysicsSphericalJoint",
    JointKind.DISTANCE: "PhysicsDistanceJoint",
}
PERPENDICULAR = 1e-12
"""Cosine between the two axes of a universal joint, in the same frame, below which its frames can be turned alike."""
WITH_AXIS = (JointKind.REVOLUTE, JointKind.PRISMATIC, JointKind.SPHERICAL)
"""Kinds whose schema names one of the axes of the frame."""


def usd() -> Any:
    """Import OpenUSD.

    Returns
    -------
    types.SimpleNamespace
        Its modules ``Gf``, ``Sdf``, ``Tf``, ``Usd``, ``UsdGeom``, ``UsdPhysics``.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    try:
        from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdPhysics  # noqa: PLC0415
    except ImportError:
        raise MissingExtraError("usd-core", "usd") from None
    return SimpleNamespace(Gf=Gf, Sdf=Sdf, Tf=Tf, Usd=Usd, UsdGeom=UsdGeom, UsdPhysics=UsdPhysics)


@dataclass(frozen=True, eq=False)
class Frames:
    """The frames of a joint as the schema has them.

    Attributes
    ----------
    token
        Axis of the frames that is the joint's, for kinds in `WITH_AXIS`.
    frame0, frame1
        Placements in the two bodies.
    """

    token: str
    frame0: pin.SE3
    frame1: pin.SE3


def schema_frames(
    kind: JointKind, frame0: pin.SE3, frame1: pin.SE3, axis: FloatArray, axis2: FloatArray
) -> Frames:
    """Turn the frames of a joint so that its axis is one of theirs, as the schema wants it.

    Parameters
    ----------
    kind
        What it leaves free.
    frame0, frame1
        Its frames in the two bodies.
    axis
        (3,) unit vector of its axis in both frames; of a universal joint, in frame 0.
    axis2
        (3,) second axis of a universal joint in frame 1, a unit vector.

    Returns
    -------
    Frames
        The frames, turned alike but for a universal joint whose axes are not at right angles in the same frame.
    """
    if kind in WITH_AXIS:
        for token, unit in zip("XYZ", np.eye(3), strict=True):
            if np.array_equal(axis, unit):
                return Frames(token, frame0, frame1)
        along, x, y = orthonormal_triad(axis)
        turn = pin.SE3(np.column_stack([x, y, along]), np.zeros(3))
        return Frames("Z", frame0 * turn, frame1 * turn)
    if kind is JointKind.UNIVERSAL and abs(axis @ axis2) < PERPENDICULAR:
        turn = pin.SE3(np.column_stack([axis2, axis, np.cross(axis2, axis)]), np.zeros(3))
        return Frames("", frame0 * turn, frame1 * turn)
    if kind is JointKind.UNIVERSAL:
        # Its angles then have other zeros.
        y0, x0, z0 = orthonormal_triad(axis)
        turn0 = pin.SE3(np.column_stack([x0, y0, -z0]), np.zeros(3))
        turn1 = pin.SE3(np.column_stack(orthonormal_triad(axis2)), np.zeros(3))
        return Frames("", frame0 * turn0, frame1 * turn1)
    if kind in (JointKind.CYLINDRICAL, JointKind.PLANAR, JointKind.POINT_ON_LINE):
        turn = pin.SE3(np.column_stack(orthonormal_triad(axis)), np.zeros(3))
        return Frames("", frame0 * turn, frame1 * turn)
    return Frames("", frame0, frame1)


def meant(values: Iterable[float]) -> FloatArray:
    """Take numbers of single precision for the shortest decimal numbers that round to them.

    Parameters
    ----------
    values
        Numbers as they were read, in the units of the file.

    Returns
    -------
    numpy.ndarray
        (n,) the decimals, in the same units: 0.1, not 0.10000000149.
    """
    return np.array([float(str(np.float32(value))) for value in values])


def same_single(one: FloatArray, other: FloatArray, size: float = 0.0) -> bool:
    """Tell whether single precision does not tell two arrays apart.

    Parameters
    ----------
    one, other
        Numbers of the same shape, in the same units.
    size
        Largest number that they were made of, where that is larger than they are.

    Returns
    -------
    bool
        Whether they agree to a few last bits of the largest; infinities have to be the same.
    """
    one, other = np.asarray(one, dtype=float), np.asarray(other, dtype=float)
    finite = np.isfinite(one)
    if one.shape != other.shape or not np.array_equal(one[~finite], other[~finite]):
        return False
    one, other = one[finite], other[finite]
    largest = max(size, float(np.abs(other).max(initial=0.0)))
    return bool(np.abs(one - other).max(initial=0.0) <= SINGLE * largest)


def matrix_of(placement: pin.SE3) -> list[list[float]]:
    """Write a placement as OpenUSD's matrices have it, vectors being rows.

    Parameters
    ----------
    placement
        The placement.

    Returns
    -------
    list
        4 × 4 numbers.
    """
    return placement.homogeneous.T.tolist()


def placement_of(matrix: Any) -> pin.SE3:
    """Read a placement from one of OpenUSD's matrices, whose vectors are rows.

    Parameters
    ----------
    matrix
        A ``Gf.Matrix4d`` without scale.

    Returns
    -------
    pinocchio.SE3
        The placement; printed with few digits, its axes are made orthogonal again.
    """
    numbers = np.array(matrix)
    rotation = numbers[:3, :3].T.copy()
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > _EXACT:
        u, _, vt = np.linalg.svd(rotation)
        rotation = u @ vt
    return pin.SE3(rotation, numbers[3, :3].copy())


# ----------------------------------------------------------------------------------------------------
# Values that are what their names say: a file may give an attribute any type
# ----------------------------------------------------------------------------------------------------

_FAR_UNIT = 1e15
"""Metres and kilograms per unit, and units per these, beyond which a unit is none."""
_FAR = 1e30
"""Largest entry of a transformation."""
_SHEARED = 1.5e-4
"""How far axes may be from unit length and right angles, dimensionless: what four printed decimals cost, the spectral
norm of a matrix (3, 3) of half units."""
_EXACT = 1e-13
"""The same for axes of all digits, which are kept to the last one."""
_Fitting = tuple[Callable[[Any], bool], str]


def _are_numbers(count: int | None = None, axes: int = 1, *, finite: bool = False) -> _Fitting:
    def fits(value: Any) -> bool:
        try:
            numbers = np.array(value, dtype=float)
        except (TypeError, ValueError):
            return False
        return (
            numbers.ndim == axes
            and count in (None, numbers.shape[0])
            and bool(np.isfinite(numbers).all() if finite else not np.isnan(numbers).any())
        )

    return fits, f"{count or 'some'}{' finite' if finite else ''} numbers"


def _is_placement(value: Any) -> bool:
    if not _are_numbers(4, 2)[0](value) or np.shape(value) != (4, 4):
        return False
    rotation = np.array(value)[:3, :3]
    if not (np.abs(rotation).max() <= 2 and np.isfinite(value).all()):
        return False
    apart = np.abs(np.linalg.svd(rotation, compute_uv=False) - 1).max()
    return bool(apart <= _SHEARED and np.linalg.det(rotation) > 0)


_TEXT: _Fitting = (lambda value: isinstance(value, str), "a text")
_FLAG: _Fitting = (lambda value: isinstance(value, bool | int), "a flag")
_NUMBER: _Fitting = (lambda value: isinstance(value, int | float), "a number")
_TURN: _Fitting = (lambda value: hasattr(value, "GetReal"), "a quaternion")
_FITTING: dict[str, _Fitting] = {
    "physics:localRot0": _TURN,
    "physics:localRot1": _TURN,
    "physics:principalAxes": _TURN,
    "primvars:displayColor": _are_numbers(None, 2),
    "primvars:displayOpacity": _are_numbers(),
    **{
        f"{OWN}{name}": _are_numbers(count, finite=True)
        for name, count in {"inertia": 10, "gravity": 3, "axis": 3}.items()
    },
    **{f"{OWN}{name}": _are_numbers(count, finite=True) for name, count in {"axis2": 3, "length": 1}.items()},
    **{f"{OWN}{name}": _are_numbers(finite=name != "bounds") for name in ("bounds", "home", "polynomial")},
    **{f"{OWN}{name}": _are_numbers(finite=True) for name in PHYSICS},
    **{f"{OWN}frame{number}": (_is_placement, "a placement") for number in (0, 1)},
    **{f"{OWN}{name}": _FLAG for name in ("motor", "massless", "odd_inertia", "assembled")},
    **{f"{OWN}{name}": _TEXT for name in ("link", "joint", "kind", "robot", "platform", "shape")},
    **{f"{OWN}{name}": _TEXT for name in ("coupling", "joint1", "joint2")},
}


def _like(default: Any) -> _Fitting:
    """Tell what a value is that may have this default."""
    match default:
        case bool():
            return _FLAG
        case float():
            return _NUMBER
        case str():
            return _TEXT
        case tuple():
            return _are_numbers(len(default) or None)
    return (lambda _: True), "anything"


@dataclass(eq=False)
class Stage:
    """An open stage, with what is found in it.

    Attributes
    ----------
    usd
        Modules of OpenUSD.
    stage
        The stage.
    path
        Its file, for messages.
    metre, kilogram
        Units of the stage [m, kg].
    notes
        What was kept, changed or ignored.
    """

    usd: Any
    stage: Any
    path: Path
    metre: float
    kilogram: float
    notes: list[Note] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.cache = self.usd.UsdGeom.XformCache(self.usd.Usd.TimeCode.EarliestTime())

    def error(self, owner: str, text: str) -> FileFormatError:
        """Make an error that names the file.

        Parameters
        ----------
        owner
            Prim at fault.
        text
            What is wrong, and the remedy.

        Returns
        -------
        FileFormatError
            To be raised.
        """
        return FileFormatError(f"<{owner}> {text}", path=str(self.path), culprit=owner)

    def note(self, owner: str, text: str, outcome: Outcome = Outcome.IGNORED) -> None:
        """Add to the report.

        Parameters
        ----------
        owner
            Prim or part.
        text
            What became of it.
        outcome
            Kept, changed or ignored.
        """
        self.notes.append(Note(owner, text, outcome))

    def prims(self) -> Iterator[Any]:
        """Go through all prims that are defined, active and loaded, those of instances as well.

        Returns
        -------
        Iterator
            In the order of the stage.
        """
        usd = self.usd.Usd
        predicate = usd.TraverseInstanceProxies(usd.PrimDefaultPredicate)
        return (
            prim for prim in usd.PrimRange(self.stage.GetPseudoRoot(), predicate) if not prim.IsPseudoRoot()
        )

    def value(self, prim: Any, name: str, default: Any = None) -> Any:
        """Read an attribute.

        Parameters
        ----------
        prim
            Its prim.
        name
            Its name.
        default
            What stands for one without a value.

        Returns
        -------
        object
            Value at the first moment that the stage knows, fallbacks of schemas included.
        """
        attribute = prim.GetAttribute(name)
        value = attribute.Get(self.usd.Usd.TimeCode.EarliestTime()) if attribute else None
        if value is None:
            return default
        fits, kind = _FITTING.get(name) or _like(default)
        if not fits(value):
            raise self.error(str(prim.GetPath()), f"has {name} = {str(value)[:60]}, and it has to be {kind}")
        return value

    def targets(self, prim: Any, name: str) -> list[Any]:
        """Find what a relationship leads to.

        Parameters
        ----------
        prim
            Its prim.
        name
            Its name.

        Returns
        -------
        list
            Paths; none where the prim has no such relationship.
        """
        relation = prim.GetRelationship(name)
        try:
            return list(relation.GetForwardedTargets()) if relation else []
        except self.usd.Tf.ErrorException as error:
            raise self.error(
                str(prim.GetPath()), f"has a relationship {name} that fails: {_last(error)}"
            ) from None

    def own(self, prim: Any, name: str, default: Any = None) -> Any:
        """Read a word of our own.

        Parameters
        ----------
        prim
            Its prim.
        name
            Its name without the namespace.
        default
            What stands for one that is missing.

        Returns
        -------
        object
            Its value.
        """
        return self.value(prim, OWN + name, default)

    def pose(self, prim: Any) -> tuple[pin.SE3, FloatArray]:
        """Find where a prim stands.

        Parameters
        ----------
        prim
            Anything; what has no place stands where its parent does.

        Returns
        -------
        placement : pinocchio.SE3
            In the world, in metres.
        scale : numpy.ndarray
            (3,) scale along its axes (dimensionless).
        """
        name = str(prim.GetPath())
        try:
            matrix = np.array(self.cache.GetLocalToWorldTransform(prim))
        except self.usd.Tf.ErrorException as error:
            raise self.error(name, f"has no transformation: {_last(error)}") from None
        if not np.abs(matrix).max() <= _FAR:
            raise self.error(
                name, "has a transformation that is not finite, or far away; correct its xformOps"
            )
        columns = matrix[:3, :3].T
        scale = np.linalg.norm(columns, axis=0)
        if not (np.isfinite(matrix).all() and scale.min() > 0 and scale.max() < np.inf):
            raise self.error(
                name, "has a transformation that is not finite, or has no size; correct its xformOps"
            )
        u, s, vt = np.linalg.svd(columns / scale)
        rotation = u @ vt
        if np.abs(s - 1).max() > _SHEARED or np.linalg.det(rotation) < 0:
            raise self.error(
                name, "is sheared or mirrored by its xformOps; bodies are turned and shifted only"
            )
        return pin.SE3(rotation, matrix[3, :3] * self.metre), scale


# ----------------------------------------------------------------------------------------------------
# Opening
# ----------------------------------------------------------------------------------------------------


def open_stage(path: Path) -> Stage:
    """Open a stage, after a look at what it refers to: nothing is fetched from elsewhere.

    Parameters
    ----------
    path
        File to open.

    Returns
    -------
    Stage
        The stage.

    Raises
    ------
    MissingExtraError
        If OpenUSD is not installed.
    FileFormatError
        If it is broken, or refers to what is missing.
    UnsupportedError
        If it refers to another machine.
    """
    modules = usd()
    layer = _layer(modules, str(path.resolve()), path)
    _look_through(modules, layer, path)
    try:
        stage = modules.Usd.Stage.Open(layer, modules.Usd.Stage.LoadAll)
    except modules.Tf.ErrorException as error:
        raise FileFormatError(_reason(error), path=str(path), culprit="stage") from None
    try:
        stage.GetDefaultPrim()
        modules.UsdGeom.GetStageUpAxis(stage)
        units = (
            modules.UsdGeom.GetStageMetersPerUnit(stage),
            modules.UsdPhysics.GetStageKilogramsPerUnit(stage),
        )
    except modules.Tf.ErrorException as error:
        raise FileFormatError(
            f"the stage says nothing of units or prims: {_last(error)}", path=str(path), culprit="stage"
        ) from None
    for unit in units:
        if not 1 / _FAR_UNIT <= unit <= _FAR_UNIT:
            raise FileFormatError(f"the stage has units of {units} m, kg", path=str(path), culprit="stage")
    opened = Stage(modules, stage, path, float(units[0]), float(units[1]))
    if not modules.UsdGeom.StageHasAuthoredMetersPerUnit(stage):
        opened.note("metersPerUnit", "is not stated: centimetres, as OpenUSD has it", Outcome.KEPT)
    return opened


def _layer(modules: Any, name: str, path: Path, asset: str = "") -> Any:
    """Open a file that may be open already, as it lies on the disk."""
    known = modules.Sdf.Layer.Find(name)
    if known is not None and known.dirty:
        raise FileFormatError(
            f"{asset or path.name} is open with changes that are not saved; save them",
            path=str(path),
            culprit=name,
        )
    try:
        layer = modules.Sdf.Layer.FindOrOpen(name)
        if known is not None:
            known.Reload(True)
    except modules.Tf.ErrorException as error:
        raise FileFormatError(
            f"{asset} {_reason(error)}".strip(), path=str(path), culprit=asset or "stage"
        ) from None
    if layer is None and asset:
        raise FileFormatError(
            f"refers to {asset!r}, which is missing, or is no OpenUSD file", path=str(path), culprit=asset
        )
    if layer is None:
        raise FileFormatError("OpenUSD cannot open this file", path=str(path), culprit="stage")
    return layer


def _reason(error: Exception) -> str:
    """Give what OpenUSD says, in one line."""
    return f"OpenUSD cannot open this file: {_last(error)}"


def _last(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines() if any(sign.isalpha() for sign in line)]
    return (lines[-1] if lines else "no reason given")[-300:]


def _look_through(modules: Any, layer: Any, path: Path) -> None:
    """Refuse references to other machines, and those to files that are missing, which would leave bodies out unseen."""
    seen: set[str] = set()
    waiting = [layer]
    while waiting:
        at = waiting.pop()
        if at.identifier in seen:
            continue
        seen.add(at.identifier)
        for asset in at.GetCompositionAssetDependencies():
            if not asset:  # a part of the same file
                continue
            if "://" in asset:
                raise UnsupportedError(
                    f"{path}: refers to {asset!r}, on another machine; nothing is fetched: lay a copy beside the file, "
                    "and refer to that"
                )
            below = _layer(modules, at.ComputeAbsolutePath(asset), path, asset)
            waiting.append(below)
