"""From a description to the Pinocchio model of its spanning tree.

Joints are visited depth-first, the children of a link in the alphabetical order of their joints: the order of
`pinocchio.buildModelFromUrdf`, so that configurations can be exchanged with it. Unlike there, every revolute joint
has one coordinate (a `continuous` joint is a revolute joint without limits).
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import pinocchio as pin

from stewart_pin.model.description import Bounds, Joint, JointKind, Mechanism
from stewart_pin.typing import ArrayLike

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
    return model if unit == 1.0 else with_masses_in(model, 1 / unit)


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
    effort[:], velocity[:] = bounds.effort[1], bounds.velocity[1]
    number = model.addJoint(carrier, kind, placement, joint.name, effort, velocity, lower, upper)
    _set_least(model, number, bounds)
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
    effort, velocity = np.array(model.upperEffortLimit), np.array(model.upperVelocityLimit)
    own = [joint for joint in mechanism.joints if joint.has_axis]
    for joint in own:
        entry, bounds = model.joints[model.getJointId(joint.name)], joint.bounds
        lower[entry.idx_q], upper[entry.idx_q] = bounds.position
        effort[entry.idx_v], velocity[entry.idx_v] = bounds.effort[1], bounds.velocity[1]
    changed.lowerPositionLimit, changed.upperPositionLimit = lower, upper
    changed.upperEffortLimit, changed.upperVelocityLimit = effort, velocity
    for joint in own:
        _set_least(changed, changed.getJointId(joint.name), joint.bounds)
    return changed


def _set_least(model: pin.Model, number: int, bounds: Bounds) -> None:
    """Set the lower ends of effort and velocity, which Pinocchio's `addJoint` takes for minus the upper ones."""
    entry = model.joints[number].idx_v
    for name, least in (("lowerEffortLimit", bounds.effort[0]), ("lowerVelocityLimit", bounds.velocity[0])):
        values = np.array(getattr(model, name))
        values[entry] = least
        setattr(model, name, values)


def _joint_model(joint: Joint) -> pin.JointModel:
    match joint.kind:
        case JointKind.FLOATING:
            return pin.JointModelFreeFlyer()
        case JointKind.SPHERICAL:
            return pin.JointModelSpherical()
        case JointKind.REVOLUTE:
            aligned = (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ)
            general = pin.JointModelRevoluteUnaligned
        case _:
            aligned = (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ)
            general = pin.JointModelPrismaticUnaligned
    for model, axis in zip(aligned, _AXES, strict=True):
        if np.array_equal(joint.axis, axis):
            return model()
    return general(joint.axis)
