"""Placements and twists of all links, by the chain of joint transforms, with own spatial algebra, not Pinocchio's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from stewart_pin.model.description import Joint, JointKind, unknown_kind
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import Configuration, FloatArray, Tangent

# ----------------------------------------------------------------------------------------------------
# Spatial algebra at the world origin, for the maximal-coordinate system
#
# References
# ----------
# .. [1] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer, 2008, ch. 2. His order is [angular; linear], the
#    order here is Pinocchio's, [linear; angular].
# ----------------------------------------------------------------------------------------------------


def skew(vector: FloatArray) -> FloatArray:
    """Build the matrix of the cross product with one vector; several times faster than `numpy.cross` on so few numbers.

    Parameters
    ----------
    vector
        (3,) vector, in any unit.

    Returns
    -------
    numpy.ndarray
        (3, 3) such that ``skew(a) @ b == a × b``, in the same unit.
    """
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def spatial_inertia(inertia: pin.Inertia, rotation: FloatArray, origin: FloatArray) -> FloatArray:
    """Express a body's inertia at the world origin.

    Parameters
    ----------
    inertia
        Mass, centre of mass and inertia about it, in the link frame.
    rotation, origin
        (3, 3) and (3,) link frame in the world [m].

    Returns
    -------
    numpy.ndarray
        (6, 6) spatial inertia, world axes [kg, kg m, kg m²].
    """
    mass, c = inertia.mass, skew(origin + rotation @ inertia.lever)
    matrix = np.empty((6, 6))
    # Featherstone (2008), eq. (2.63), rows and columns in the order [linear; angular].
    matrix[:3, :3] = mass * np.eye(3)
    matrix[:3, 3:] = -mass * c
    matrix[3:, :3] = mass * c
    matrix[3:, 3:] = rotation @ inertia.inertia @ rotation.T - mass * c @ c
    return matrix


def cross_motion(twist: FloatArray, motion: FloatArray) -> FloatArray:
    """Compute the spatial cross product ``twist × motion``.

    Parameters
    ----------
    twist
        (6,) velocity of the carrier [m/s, rad/s].
    motion
        (6,) or (6, n) motion vectors carried along [any unit].

    Returns
    -------
    numpy.ndarray
        Shape of `motion`: its rate of change [per s].
    """
    v, w = skew(twist[:3]), skew(twist[3:])
    return np.concatenate([w @ motion[:3] + v @ motion[3:], w @ motion[3:]])


def cross_force(twist: FloatArray, force: FloatArray) -> FloatArray:
    """Compute the spatial cross product ``twist ×* force``.

    Parameters
    ----------
    twist
        (6,) velocity [m/s, rad/s].
    force
        (6,) force and moment about the world origin, or a momentum [N, N m].

    Returns
    -------
    numpy.ndarray
        (6,) rate of change [per s].
    """
    v, w = skew(twist[:3]), skew(twist[3:])
    return np.concatenate([w @ force[:3], w @ force[3:] + v @ force[:3]])


def force_at(point: FloatArray, force: FloatArray, moment: FloatArray) -> FloatArray:
    """Move wrenches from a point to the world origin.

    Parameters
    ----------
    point
        (3,) where the forces act [m].
    force, moment
        (3, n) forces, and moments about the point, world axes [N, N m].

    Returns
    -------
    numpy.ndarray
        (6, n) wrenches at the world origin [N, N m].
    """
    return np.vstack([force, moment + skew(point) @ force])


def motion_about(point: FloatArray, motion: FloatArray) -> FloatArray:
    """Move motion vectors from the world origin to a point.

    Parameters
    ----------
    point
        (3,) in the world [m].
    motion
        (6, n) or (6,) motions at the world origin [any unit].

    Returns
    -------
    numpy.ndarray
        Shape of `motion`: velocity of the point, and the angular part, world axes [m/s, rad/s].
    """
    return np.concatenate([motion[:3] - skew(point) @ motion[3:], motion[3:]])


# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class LinkMotion:
    """One link in the world.

    Attributes
    ----------
    rotation, origin
        (3, 3) and (3,) link frame in the world [m].
    twist
        (6,) spatial velocity at the world origin [m/s, rad/s].
    """

    rotation: FloatArray
    origin: FloatArray
    twist: FloatArray


@dataclass(frozen=True, eq=False)
class JointMotion:
    """One tree joint in the world.

    Attributes
    ----------
    axes
        (6, n) motions per joint rate, at the world origin [1, m].
    origin
        (3,) joint origin after the motion [m].
    bias
        (6,) relative acceleration that is there without joint acceleration: rate of the axes times joint rate
        [m/s², rad/s²].
    index
        Tangent entries of the joint.
    """

    axes: FloatArray
    origin: FloatArray
    bias: FloatArray
    index: slice


def tree_motion(
    chain: ClosedChain,
    q: Configuration,
    v: Tangent,
    about: FloatArray,
    ground: FloatArray | None = None,
) -> tuple[dict[str, LinkMotion], dict[str, JointMotion]]:
    """Walk from the ground outwards.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].
    about
        (3,) point of the world that is taken for its origin [m].
    ground
        (6,) spatial velocity of the ground at that point; default: it rests [m/s, rad/s].

    Returns
    -------
    links : dict
        Placement and twist of every link.
    joints : dict
        Axes, origin and bias of every tree joint.
    """
    mechanism, model = chain.mechanism, chain.model
    links = {mechanism.root: LinkMotion(np.eye(3), -about, np.zeros(6) if ground is None else ground)}
    joints: dict[str, JointMotion] = {}
    pending = list(mechanism.joints)
    while pending:
        later: list[Joint] = []
        for joint in pending:
            if joint.parent not in links:
                later.append(joint)
                continue
            parent = links[joint.parent]
            rotation = parent.rotation @ joint.placement.rotation
            origin = parent.origin + parent.rotation @ joint.placement.translation
            values, rates, index = _coordinates(model, joint, q, v)
            turn, move, local = _joint_transform(joint, values)
            origin = origin + rotation @ move
            rotation = rotation @ turn
            linear, angular = rotation @ local[:3], rotation @ local[3:]
            # From the joint origin to the world origin: v0 = v + p × ω.
            axes = np.vstack([linear + skew(origin) @ angular, angular])
            twist = parent.twist + axes @ rates
            # All axes are constant in the child: their rate is child twist × axis.
            bias = cross_motion(twist, axes @ rates)
            links[joint.child] = LinkMotion(rotation, origin, twist)
            joints[joint.name] = JointMotion(axes, origin, bias, index)
        pending = later
    return links, joints


def _coordinates(model, joint: Joint, q: Configuration, v: Tangent) -> tuple[FloatArray, FloatArray, slice]:
    if joint.kind is JointKind.FIXED:
        return np.zeros(0), np.zeros(0), slice(0, 0)
    entry = model.joints[model.getJointId(joint.name)]
    index = slice(entry.idx_v, entry.idx_v + entry.nv)
    return q[entry.idx_q : entry.idx_q + entry.nq], v[index], index


def _joint_transform(joint: Joint, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rotation and translation of the child in the joint frame, and the (6, n) motion axes in child axes."""
    none, one = np.zeros((3, 1)), np.eye(3)
    axis = joint.axis[:, None]
    match joint.kind:
        case JointKind.REVOLUTE:
            turn = Rotation.from_rotvec(joint.axis * values[0]).as_matrix()
            return turn, np.zeros(3), np.vstack([none, axis])
        case JointKind.PRISMATIC:
            return one, joint.axis * values[0], np.vstack([axis, none])
        case JointKind.SPHERICAL:
            return Rotation.from_quat(values).as_matrix(), np.zeros(3), np.eye(6)[:, 3:]
        case JointKind.FLOATING:
            return Rotation.from_quat(values[3:]).as_matrix(), values[:3], np.eye(6)
        case JointKind.FIXED:
            return one, np.zeros(3), np.zeros((6, 0))
    raise unknown_kind(f"joint '{joint.name}'", joint.kind, "the system of maximal coordinates")
