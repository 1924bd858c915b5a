"""Wrenches on the bodies of the tree, from their inertia and from outside, and the joint efforts that do the same work.

This is the backward pass of Newton and Euler; what acts from outside is taken off what the bodies need.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from stewart_pin.kernels.graph.joint_motion import Motions, Placements
from stewart_pin.kernels.planning.spatial import constant, couple, inertial_force
from stewart_pin.kernels.planning.tree import OutsidePoint, TreeJoint, path_down
from stewart_pin.model.description import JointKind, unknown_kind

Wrench = tuple[ca.SX, ca.SX]
"""Force and moment about the body's origin, (3, k) each, in the body's axes."""


def tree_efforts(
    joints: Sequence[TreeJoint],
    at: Placements,
    moving: Motions,
    a: ca.SX,
    outside: Mapping[int, Wrench] | None = None,
) -> ca.SX:
    """Compute the joint efforts that make the tree move as it does.

    Parameters
    ----------
    joints
        Joints of a tree.
    at
        Placements of the bodies.
    moving
        Motions of the bodies, gravity among their accelerations.
    a
        (nv, 1) accelerations of the joints, for their rotors.
    outside
        What acts on the bodies beside the joints.

    Returns
    -------
    casadi.SX
        (nv, 1) efforts of all joints.
    """
    efforts = efforts_of_wrenches(joints, at, less(inertial_wrenches(joints, moving), outside or {}), 1)
    for joint in joints:
        if joint.rotor.any():
            efforts[joint.v] += constant(joint.rotor) * a[joint.v]
    return efforts


def inertial_wrenches(joints: Sequence[TreeJoint], moving: Motions) -> dict[int, Wrench]:
    """Compute the wrenches that make the bodies move as they do.

    Parameters
    ----------
    joints
        Joints of a tree.
    moving
        Motions of the bodies, gravity among their accelerations.

    Returns
    -------
    dict
        ``{body: (force, moment)}`` of the bodies that need one.
    """
    # A prismatic joint hands a couple on unchanged: bodies that slide on each other turn as one.
    second = [np.zeros((3, 3)), *(joint.masses.second for joint in joints)]
    for k in range(len(joints), 0, -1):
        joint = joints[k - 1]
        if joint.kind is JointKind.PRISMATIC and joint.parent and not isinstance(joint.rotation, ca.SX):
            second[joint.parent] = second[joint.parent] + joint.rotation @ second[k] @ joint.rotation.T
            second[k] = np.zeros((3, 3))
    wrenches: dict[int, Wrench] = {}
    for k, joint in enumerate(joints, start=1):
        if not joint.masses.empty or second[k].any():
            force, moment = inertial_force(joint.masses, moving.acceleration[k], moving.turning[k])
            wrenches[k] = force, moment + couple(moving.turning[k], constant(second[k]))
    return wrenches


def outside_input(wrenches: ca.SX) -> dict[str, ca.SX]:
    """Name the input of a function that tells what acts from outside.

    Parameters
    ----------
    wrenches
        (n, 1) symbols.

    Returns
    -------
    dict
        Empty where nothing acts.
    """
    return {"wrenches": wrenches} if wrenches.shape[0] else {}


def outside_wrenches(
    joints: Sequence[TreeJoint], at: Placements, points: Sequence[OutsidePoint], wrenches: ca.SX
) -> dict[int, Wrench]:
    """Tell what acts on the bodies from outside.

    Parameters
    ----------
    joints
        Joints of a tree.
    at
        Placements of the bodies.
    points
        Where wrenches act.
    wrenches
        (n, 1) [force; moment] of each at its point, in axes of the root [N, N m].

    Returns
    -------
    dict
        ``{body: (force, moment)}`` of the bodies that bear one; the root bears it by itself.
    """
    found: dict[int, Wrench] = {}
    for act in points:
        if not act.body:
            continue
        wrench = to_body(joints, at, act.body, ca.reshape(wrenches[act.entries], 3, 2))
        force, moment = wrench[:, 0], wrench[:, 1] + ca.cross(constant(act.point), wrench[:, 0])
        beside = found.get(act.body, (ca.SX(3, 1), ca.SX(3, 1)))
        found[act.body] = beside[0] + force, beside[1] + moment
    return found


def to_body(joints: Sequence[TreeJoint], at: Placements, body: int, vectors: ca.SX) -> ca.SX:
    """Turn vectors from axes of the root into those of a body, joint by joint.

    Parameters
    ----------
    joints
        Joints of a tree.
    at
        Placements of the bodies.
    body
        Number of the body.
    vectors
        (3, k).

    Returns
    -------
    casadi.SX
        (3, k).
    """
    for k in reversed(path_down(joints, body)):
        vectors = at.to_parent[k].T @ vectors
    return vectors


def less(wrenches: Mapping[int, Wrench], others: Mapping[int, Wrench]) -> dict[int, Wrench]:
    """Take wrenches from others, body by body.

    Parameters
    ----------
    wrenches, others
        ``{body: (force, moment)}``.

    Returns
    -------
    dict
        The differences.
    """
    left = dict(wrenches)
    for body, (force, moment) in others.items():
        beside = left.get(body)
        left[body] = (-force, -moment) if beside is None else (beside[0] - force, beside[1] - moment)
    return left


def efforts_of_wrenches(
    joints: Sequence[TreeJoint], at: Placements, wrenches: Mapping[int, Wrench], columns: int
) -> ca.SX:
    """Compute the joint efforts that do the same work as wrenches on the bodies.

    Parameters
    ----------
    joints
        Joints of a tree.
    at
        Placements of the bodies.
    wrenches
        ``{body: (force, moment)}`` that act on the bodies, several columns at once.
    columns
        Number of columns.

    Returns
    -------
    casadi.SX
        (nv, columns) joint efforts.
    """
    return carry_down(joints, at, wrenches, columns)[0]


def carry_down(
    joints: Sequence[TreeJoint], at: Placements, wrenches: Mapping[int, Wrench], columns: int
) -> tuple[ca.SX, Wrench]:
    """Carry wrenches from the bodies down to the root of the tree.

    Parameters
    ----------
    joints
        Joints of a tree.
    at
        Placements of the bodies.
    wrenches
        ``{body: (force, moment)}`` that act on the bodies, several columns at once.
    columns
        Number of columns.

    Returns
    -------
    efforts : casadi.SX
        (nv, columns) joint efforts that do the same work.
    root : tuple
        The wrench that arrives at the root, in its axes.
    """
    carried = {0: (ca.SX(3, columns), ca.SX(3, columns)), **wrenches}
    efforts = ca.SX(max((joint.v.stop for joint in joints), default=0), columns)
    for k in range(len(joints), 0, -1):
        if k not in carried:
            continue
        joint = joints[k - 1]
        force, moment = carried.pop(k)
        efforts[joint.v, :] = joint_effort(joint, force, moment)
        force = at.to_parent[k] @ force
        moment = at.to_parent[k] @ moment + moments_of(at.origin[k], force)
        if joint.parent in carried:
            beside = carried[joint.parent]
            force, moment = force + beside[0], moment + beside[1]
        carried[joint.parent] = force, moment
    return efforts, carried[0]


def joint_effort(joint: TreeJoint, force: ca.SX, moment: ca.SX) -> ca.SX:
    """Project a wrench on the motions of a joint.

    Parameters
    ----------
    joint
        The joint.
    force, moment
        (3, k) about the origin of the joint frame, in the child's axes.

    Returns
    -------
    casadi.SX
        (1, 3 or 6, k) efforts.
    """
    match joint.kind:
        case JointKind.REVOLUTE:
            return constant(joint.axis).T @ moment
        case JointKind.PRISMATIC:
            return constant(joint.axis).T @ force
        case JointKind.SPHERICAL:
            return moment
        case JointKind.FLOATING:
            return ca.vertcat(force, moment)
    raise unknown_kind(f"joint '{joint.name}'", joint.kind, "the motion of joints in kernels")


def moments_of(arm: ca.SX, forces: ca.SX) -> ca.SX:
    """Take moments of several forces at one point.

    Parameters
    ----------
    arm
        (3, 1) point [m].
    forces
        (3, k) forces.

    Returns
    -------
    casadi.SX
        (3, k).
    """
    return ca.horzcat(*(ca.cross(arm, forces[:, k]) for k in range(forces.shape[1])))
