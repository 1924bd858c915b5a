"""Placements and twists of all links, by the chain of joint transforms: own formulas, no Pinocchio algorithm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from stewart_pin.mechanics.constraint_matrix.spatial import cross_motion, skew
from stewart_pin.model.description import Joint, JointKind
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import Configuration, FloatArray, Tangent


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
    chain: ClosedChain, q: Configuration, v: Tangent, about: FloatArray
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

    Returns
    -------
    links : dict
        Placement and twist of every link.
    joints : dict
        Axes, origin and bias of every tree joint.
    """
    mechanism, model = chain.mechanism, chain.model
    links = {mechanism.root: LinkMotion(np.eye(3), -about, np.zeros(6))}
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
        case _:
            return one, np.zeros(3), np.zeros((6, 0))
