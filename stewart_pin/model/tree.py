"""From a description to the Pinocchio model of its spanning tree, and to the limits of all its joints.

Joints are visited depth-first, the children of a link in the alphabetical order of their joints: the order of
`pinocchio.buildModelFromUrdf`, so that configurations can be exchanged with it. Unlike there, every revolute joint
has one coordinate (a `continuous` joint is a revolute joint without limits).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import pinocchio as pin

from stewart_pin.brief import Brief
from stewart_pin.model.description import (
    BALL,
    Bounds,
    Joint,
    JointKind,
    Mechanism,
    loop_coordinates,
    unknown_kind,
)
from stewart_pin.model.joint_physics import NO_PHYSICS, set_joint_physics
from stewart_pin.typing import ArrayLike, BoolArray, FloatArray

_AXES = np.eye(3)
_SAFE_MASS = 1e-12
"""Mass from which on sums of masses are exact in Pinocchio, which floors them at 2e-16 [kg]."""


def build_tree(mechanism: Mechanism, gravity: ArrayLike) -> pin.Model:
    """Build the Pinocchio model of the spanning tree.

    Parameters
    ----------
    mechanism
        Valid description.
    gravity
        (3,) acceleration of free fall in the world frame [m/s²].

    Returns
    -------
    pinocchio.Model
        One joint per moving joint; a body frame per link, with the link's name.
    """
    model = pin.Model()
    model.name = mechanism.name
    model.gravity = pin.Motion(np.asarray(gravity, dtype=float), np.zeros(3))
    children: dict[str, list[Joint]] = {link.name: [] for link in mechanism.links}
    for joint in sorted(mechanism.joints, key=lambda joint: joint.name):
        children[joint.parent].append(joint)
    inertias = {link.name: link.inertia for link in mechanism.links}
    unit = mass_unit(inertia.mass for inertia in inertias.values() if inertia is not None)
    if unit != 1.0:
        inertias = {name: None if own is None else _times(own, 1 / unit) for name, own in inertias.items()}

    # Depth-first; each entry: joint to add, carrying Pinocchio joint, placement of the parent link in it, frame id.
    root = mechanism.root
    ground = _add_body(model, root, 0, pin.SE3.Identity(), 0, inertias[root])
    stack = [(joint, 0, pin.SE3.Identity(), ground) for joint in reversed(children[root])]
    while stack:
        joint, carrier, link_placement, frame = stack.pop()
        placement = link_placement * joint.placement
        if joint.kind is JointKind.FIXED:
            fixed = pin.Frame(joint.name, carrier, frame, placement, pin.FrameType.FIXED_JOINT)
            frame = model.addFrame(fixed)
        else:
            carrier = _add_joint(model, joint, carrier, placement)
            frame = model.addJointFrame(carrier, frame)
            placement = pin.SE3.Identity()
        frame = _add_body(model, joint.child, carrier, placement, frame, inertias[joint.child])
        stack += [(below, carrier, placement, frame) for below in reversed(children[joint.child])]
    model = model if unit == 1.0 else with_masses_in(model, 1 / unit)
    if any(joint.physics is not NO_PHYSICS for joint in mechanism.joints):
        set_joint_physics(model, mechanism)
    return model


def mass_unit(masses: Iterable[float]) -> float:
    """Choose a unit in which no mass is lost in Pinocchio's sums of inertias.

    Parameters
    ----------
    masses
        Masses of the bodies [kg].

    Returns
    -------
    float
        1, or for micro-robots the power of two below the smallest mass: counting in it costs no round-off [kg].
    """
    smallest = min((mass for mass in masses if mass > 0), default=1.0)
    return 1.0 if smallest >= _SAFE_MASS else 2.0 ** math.floor(math.log2(smallest))


def with_masses_in(model: pin.Model, unit: float) -> pin.Model:
    """Count masses and inertias, rotors included, in another unit.

    Parameters
    ----------
    model
        Model.
    unit
        The unit [kg].

    Returns
    -------
    pinocchio.Model
        A copy; its efforts are in units of `unit` as well.
    """
    scaled = model.copy()
    for k in range(model.njoints):
        scaled.inertias[k] = _times(model.inertias[k], 1 / unit)
    scaled.armature = np.array(model.armature) / unit
    return scaled


def _times(inertia: pin.Inertia, factor: float) -> pin.Inertia:
    return pin.Inertia(inertia.mass * factor, inertia.lever, inertia.inertia * factor)


def link_frame(model: pin.Model, link: str) -> int:
    """Find the frame of a link.

    Parameters
    ----------
    model
        Model from `build_tree`.
    link
        Name of the link, which a joint may share.

    Returns
    -------
    int
        Pinocchio frame id.
    """
    return model.getFrameId(link, pin.FrameType.BODY)


def _add_body(
    model: pin.Model, link: str, carrier: int, placement: pin.SE3, frame: int, inertia: pin.Inertia | None
) -> int:
    if inertia is not None:
        model.appendBodyToJoint(carrier, inertia, placement)
    return model.addBodyFrame(link, carrier, placement, frame)


def _add_joint(model: pin.Model, joint: Joint, carrier: int, placement: pin.SE3) -> int:
    kind = _joint_model(joint)
    nq, nv = kind.nq, kind.nv
    lower, upper = np.full(nq, -np.inf), np.full(nq, np.inf)
    effort, velocity = np.full(nv, np.inf), np.full(nv, np.inf)
    if not joint.has_axis:
        return model.addJoint(carrier, kind, placement, joint.name, effort, velocity, lower, upper)
    bounds = joint.bounds
    lower[:], upper[:] = bounds.position
    number = model.addJoint(carrier, kind, placement, joint.name, effort, velocity, lower, upper)
    _set_ends(model, number, bounds)
    return number


def set_limits(model: pin.Model, mechanism: Mechanism) -> pin.Model:
    """Give the joints of a model other limits.

    Parameters
    ----------
    model
        Model from `build_tree`.
    mechanism
        Description of the same tree, with other limits.

    Returns
    -------
    pinocchio.Model
        A copy.
    """
    changed = model.copy()
    lower, upper = np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)
    own = [joint for joint in mechanism.joints if joint.has_axis]
    for joint in own:
        entry, bounds = model.joints[model.getJointId(joint.name)], joint.bounds
        lower[entry.idx_q], upper[entry.idx_q] = bounds.position
    changed.lowerPositionLimit, changed.upperPositionLimit = lower, upper
    for joint in own:
        _set_ends(changed, changed.getJointId(joint.name), joint.bounds)
    return changed


def _set_ends(model: pin.Model, number: int, bounds: Bounds) -> None:
    """Set both ends of effort and velocity: Pinocchio's `addJoint` takes the lower ones for minus the upper ones."""
    entry = model.joints[number].idx_v
    for what, ends in (("EffortLimit", bounds.effort), ("VelocityLimit", bounds.velocity)):
        for side, end in zip(("lower", "upper"), ends, strict=True):
            values = np.array(getattr(model, side + what))
            values[entry] = end
            setattr(model, side + what, values)


def _joint_model(joint: Joint) -> pin.JointModel:
    match joint.kind:
        case JointKind.FLOATING:
            return pin.JointModelFreeFlyer()
        case JointKind.SPHERICAL:
            return pin.JointModelSpherical()
        case JointKind.REVOLUTE:
            aligned = (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ)
            general = pin.JointModelRevoluteUnaligned
        case JointKind.PRISMATIC:
            aligned = (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ)
            general = pin.JointModelPrismaticUnaligned
        case _:
            raise unknown_kind(f"joint '{joint.name}'", joint.kind, "the model of the tree")
    for model, axis in zip(aligned, _AXES, strict=True):
        if np.array_equal(joint.axis, axis):
            return model()
    return general(joint.axis)


# ----------------------------------------------------------------------------------------------------
# What every joint may do, in one record: positions, velocities, accelerations, efforts and jerks, at both ends
#
# What a file does not state is ``nan``, a value of its own: no comparison with it holds, and no sum hides it.
# ----------------------------------------------------------------------------------------------------

LimitKind = Literal["position", "velocity", "acceleration", "effort", "jerk"]
KINDS: tuple[LimitKind, ...] = get_args(LimitKind)
"""What can be limited."""
_UNITS: dict[LimitKind, tuple[str, str]] = {
    "position": ("m", "rad"),
    "velocity": ("m/s", "rad/s"),
    "acceleration": ("m/s²", "rad/s²"),
    "effort": ("N", "N m"),
    "jerk": ("m/s³", "rad/s³"),
}
_ENTRIES = {1: ("",), 3: (" wx", " wy", " wz"), 6: (" vx", " vy", " vz", " wx", " wy", " wz")}


@dataclass(frozen=True, eq=False, repr=False)
class Limits(Brief):
    """Limits of all joints of a chain, those that close loops included; ``nan`` where nothing is stated.

    The first nv rows are the tangent entries of the chain, so that ``chain.motor_index`` picks those of the motors; a
    joint of several freedoms has no position there. Then come the coordinates that only limits know: the swing of a
    ball's axis and the whole angle by which it has turned, and the coordinates of the joints that close loops.

    Attributes
    ----------
    names
        (n,) joint of each row, with the coordinate where a joint has several.
    position
        (n, 2) least and greatest position [m or rad].
    velocity
        (n, 2) least and greatest velocity [m/s or rad/s].
    acceleration
        (n, 2) least and greatest acceleration [m/s² or rad/s²].
    effort
        (n, 2) least and greatest effort of a motor; (0, f) is a cable [N or N m].
    jerk
        (n, 2) least and greatest rate of the acceleration [m/s³ or rad/s³].
    is_length
        (n,) whether a row is a length, in metres, and not an angle [dimensionless].

    Examples
    --------
    >>> import stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> print(chain.limits)
    leg1_x, leg1_y and 10 more: position -1.5 to 1.5 rad
    leg1, leg2 and 4 more: position 0.5 to 1.8 m, velocity -2 to 2 m/s, effort -10000 to 10000 N
    """

    names: tuple[str, ...]
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    effort: FloatArray
    jerk: FloatArray
    is_length: BoolArray

    def __post_init__(self) -> None:
        for kind in KINDS:
            self.of(kind).setflags(write=False)

    def of(self, kind: LimitKind) -> FloatArray:
        """Return the limits of one kind.

        Parameters
        ----------
        kind
            ``"position"``, ``"velocity"``, ``"acceleration"``, ``"effort"`` or ``"jerk"``.

        Returns
        -------
        numpy.ndarray
            (n, 2) least and greatest, nan where nothing is stated [any unit].
        """
        return getattr(self, kind)

    def bounds(self, kind: LimitKind, rows: np.ndarray | slice = slice(None)) -> FloatArray:
        """Return limits to reckon with: infinite where nothing is stated.

        Parameters
        ----------
        kind
            What is limited.
        rows
            Which rows; default: all [index].

        Returns
        -------
        numpy.ndarray
            (k, 2) least and greatest [any unit].
        """
        found = self.of(kind)[rows]
        return np.where(np.isnan(found), [-np.inf, np.inf], found)

    def stated(self, kind: LimitKind) -> np.ndarray:
        """List the rows that have a limit of one kind, at one end at least.

        Parameters
        ----------
        kind
            What is limited.

        Returns
        -------
        numpy.ndarray
            (k,) rows [index].
        """
        return np.flatnonzero(~np.isnan(self.of(kind)).all(axis=1))

    def unit(self, kind: LimitKind, row: int) -> str:
        """Name the unit of a limit.

        Parameters
        ----------
        kind
            What is limited.
        row
            Of which coordinate [index].

        Returns
        -------
        str
            For example ``"m/s"``.
        """
        return _UNITS[kind][0 if self.is_length[row] else 1]

    def __len__(self) -> int:
        return len(self.names)

    def __str__(self) -> str:
        """Tell what is stated, joints of the same limits together, one line each."""
        owners: dict[str, list[str]] = {}
        for row, name in enumerate(self.names):
            said = ", ".join(self.words(row))
            if said:
                owners.setdefault(said, []).append(name)
        lines: list[str] = []
        for said, names in owners.items():
            shown = ", ".join(names[:2]) + (f" and {len(names) - 2} more" if len(names) > 2 else "")
            lines.append(f"{shown}: {said}")
        return "\n".join(lines) or "no limit is stated"

    def words(self, row: int) -> Iterator[str]:
        """Tell the limits of one coordinate.

        Parameters
        ----------
        row
            Of which coordinate [index].

        Yields
        ------
        str
            One kind of limit, with its unit.
        """
        for kind in KINDS:
            least, most = self.of(kind)[row]
            if np.isnan(least) and np.isnan(most):
                continue
            if np.isnan(least) or np.isnan(most):
                ends = f"up to {most:g}" if np.isnan(least) else f"from {least:g}"
            else:
                ends = f"{least:g} to {most:g}"
            yield f"{kind} {ends} {self.unit(kind, row)}"


def build_limits(mechanism: Mechanism, model: pin.Model) -> Limits:
    """Gather what the description states.

    Parameters
    ----------
    mechanism
        Description.
    model
        Pinocchio model of its spanning tree, which tells the order of the coordinates.

    Returns
    -------
    Limits
        One row per tangent entry, then swing and angle of the balls, then the coordinates of loops.
    """
    joints = {joint.name: joint for joint in mechanism.joints}
    rows: list[tuple[str, bool, Bounds]] = []
    extra: list[tuple[str, bool, Bounds]] = []
    for name, entry in zip(model.names[1:], model.joints[1:], strict=True):
        joint = joints[name]
        if joint.has_axis:
            rows.append((name, joint.kind is JointKind.PRISMATIC, joint.bounds))
            continue
        rows += [(name + axis, axis.startswith(" v"), Bounds()) for axis in _ENTRIES[entry.nv]]
        if joint.kind is JointKind.SPHERICAL:
            extra += [
                (f"{name} {said}", False, Bounds(position=(-np.inf, most)))
                for said, most in zip(BALL, (joint.swing, joint.turn), strict=True)
            ]
    for loop in mechanism.loops:
        own = loop_coordinates(loop.kind)
        for k, coordinate in enumerate(own):
            name = loop.name if len(own) == 1 else f"{loop.name} {coordinate}"
            bounds = loop.bounds[k] if loop.bounds else Bounds()
            extra.append((name, coordinate in ("length", "x", "y"), bounds))
    rows += extra

    def table(kind: LimitKind) -> FloatArray:
        values = np.array([getattr(bounds, kind) for _, _, bounds in rows], dtype=float).reshape(-1, 2)
        return np.where(np.isfinite(values), values, np.nan)

    return Limits(
        names=tuple(name for name, _, _ in rows),
        position=table("position"),
        velocity=table("velocity"),
        acceleration=table("acceleration"),
        effort=table("effort"),
        jerk=table("jerk"),
        is_length=np.array([length for _, length, _ in rows], dtype=bool),
    )
