"""Bodies of the tree, each in its own axes: how they move by their joints, and the joint efforts of wrenches on them.

Accelerations are classical ones of the body's origin, less that of free fall, so that no velocity of an origin
enters the dynamics. Where Pinocchio's spatial acceleration of a floating joint enters, ω × v is added.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from stewart_pin.kernels.planning.spatial import (
    constant,
    couple,
    inertial_force,
    rotation_constant,
    signed_permutation,
    skew,
    turn_about,
    turn_from_quaternion,
    turning_matrix,
)
from stewart_pin.kernels.planning.tree import OutsidePoint, TreeJoint, path_down
from stewart_pin.model.description import JointKind, unknown_kind

JointPlacement = tuple[ca.SX, ca.SX]
"""(3, 3) rotation and (3, 1) translation of the child in the joint frame."""


@dataclass(frozen=True, eq=False)
class Placements:
    """Where every body is; entry 0 is the root.

    Attributes
    ----------
    to_parent
        (3, 3) rotation of each body in its parent.
    origin
        (3, 1) of each body in its parent [m].
    to_world
        (3, 3) rotation of each body in the root.
    in_world
        (3, 1) origin of each body in the root [m].
    closed
        Whether the loops are known to be closed here: of the whole tree, in motor or platform coordinates.
    """

    to_parent: tuple[ca.SX, ...]
    origin: tuple[ca.SX, ...]
    to_world: tuple[ca.SX, ...]
    in_world: tuple[ca.SX, ...]
    closed: bool = False


@dataclass(frozen=True, eq=False)
class Motions:
    """How every body moves, in its own axes; entry 0 is the root.

    Attributes
    ----------
    omega
        (3, 1) angular velocities [rad/s].
    omega_rate
        (3, 1) angular accelerations [rad/s²].
    velocity
        (3, 1) of the origins [m/s].
    acceleration
        (3, 1) of the origins, less that of free fall [m/s²].
    turning
        (3, 3) `turning_matrix` of each [1/s²].
    """

    omega: tuple[ca.SX, ...]
    omega_rate: tuple[ca.SX, ...]
    velocity: tuple[ca.SX, ...]
    acceleration: tuple[ca.SX, ...]
    turning: tuple[ca.SX, ...]


@dataclass(frozen=True, eq=False)
class RootMotion:
    """How the body that carries the tree moves, in its own axes.

    Attributes
    ----------
    omega
        (3, 1) angular velocity [rad/s].
    omega_rate
        (3, 1) angular acceleration [rad/s²].
    velocity
        (3, 1) of its origin [m/s].
    acceleration
        (3, 1) of its origin, less that of free fall [m/s²].
    """

    omega: ca.SX
    omega_rate: ca.SX
    velocity: ca.SX
    acceleration: ca.SX


def at_rest(gravity: ca.SX) -> RootMotion:
    """Let the ground carry the tree.

    Parameters
    ----------
    gravity
        (3, 1) acceleration of free fall in world axes [m/s²].

    Returns
    -------
    RootMotion
        No motion, but what falls is left behind.
    """
    zero = ca.SX.zeros(3)
    return RootMotion(zero, zero, zero, -gravity)


def placements(
    joints: Sequence[TreeJoint], moved: Sequence[JointPlacement], *, closed: bool = False
) -> Placements:
    """Place every body.

    Parameters
    ----------
    joints
        Joints of a tree; its root stands for the world.
    moved
        How each joint has moved, from `joint_placement` or a closed form.
    closed
        Whether the loops are known to be closed.

    Returns
    -------
    Placements
        Of root and bodies.
    """
    to_parent, origin = [ca.SX.eye(3)], [ca.SX.zeros(3)]
    to_world, in_world = [ca.SX.eye(3)], [ca.SX.zeros(3)]
    for joint, (turn, shift) in zip(joints, moved, strict=True):
        to_parent.append(rotation_constant(joint.rotation) @ turn)
        origin.append(constant(joint.translation) + rotation_constant(joint.rotation) @ shift)
        to_world.append(to_world[joint.parent] @ to_parent[-1])
        in_world.append(in_world[joint.parent] + to_world[joint.parent] @ origin[-1])
    return Placements(tuple(to_parent), tuple(origin), tuple(to_world), tuple(in_world), closed)


def motions(
    joints: Sequence[TreeJoint],
    at: Placements,
    v: ca.SX,
    a: ca.SX,
    root: RootMotion,
    *,
    known: Mapping[int, tuple[ca.SX, ca.SX]] | None = None,
) -> Motions:
    """Move every body.

    Parameters
    ----------
    joints
        Joints of a tree.
    at
        Placements of the bodies.
    v, a
        (nv, 1) tangent velocity and acceleration, Pinocchio's convention.
    root
        Motion of the root.
    known
        ``{body: (point, acceleration)}`` for bodies of which the acceleration of a point is known otherwise, both in
        their axes; it saves the way through the joints.

    Returns
    -------
    Motions
        Of root and bodies.
    """
    known = known or {}
    omega, omega_rate, velocity, acceleration = (
        [x] for x in (root.omega, root.omega_rate, root.velocity, root.acceleration)
    )
    turning = [turning_matrix(root.omega, root.omega_rate)]
    for k, joint in enumerate(joints, start=1):
        parent, back, arm = joint.parent, at.to_parent[k].T, at.origin[k]
        slide, turn = joint_velocity(joint, v[joint.v])
        slide_rate, turn_rate = joint_velocity(joint, a[joint.v])
        if joint.kind is JointKind.FLOATING:
            slide_rate = slide_rate + ca.cross(turn, slide)
        carried = back @ omega[parent]
        omega.append(carried + turn)
        omega_rate.append(back @ omega_rate[parent] + ca.cross(carried, turn) + turn_rate)
        velocity.append(back @ (velocity[parent] + ca.cross(omega[parent], arm)) + slide)
        turning.append(_turning(joint, back, turning[parent], omega[-1], omega_rate[-1]))
        if k in known:
            point, felt = known[k]
            acceleration.append(felt - turning[-1] @ point)
            continue
        through = back @ (acceleration[parent] + turning[parent] @ arm)
        acceleration.append(through + 2 * ca.cross(carried, slide) + slide_rate)
    return Motions(*map(tuple, (omega, omega_rate, velocity, acceleration, turning)))


def _turning(joint: TreeJoint, back: ca.SX, parent: ca.SX, omega: ca.SX, omega_rate: ca.SX) -> ca.SX:
    """Matrix of accelerations; a body that only slides on another one, with equal axes, has that one's."""
    if joint.kind is JointKind.PRISMATIC and signed_permutation(joint.rotation):
        return back @ parent @ back.T
    return turning_matrix(omega, omega_rate)


def joint_velocity(joint: TreeJoint, rates: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Split the tangent entries of a joint into linear and angular velocity of the child, in its axes.

    Parameters
    ----------
    joint
        The joint.
    rates
        Its tangent entries.

    Returns
    -------
    linear, angular : casadi.SX
        (3, 1) each.
    """
    zero = ca.SX.zeros(3)
    match joint.kind:
        case JointKind.REVOLUTE:
            return zero, constant(joint.axis) * rates
        case JointKind.PRISMATIC:
            return constant(joint.axis) * rates, zero
        case JointKind.SPHERICAL:
            return zero, rates
        case JointKind.FLOATING:
            return rates[:3], rates[3:]
    raise unknown_kind(f"joint '{joint.name}'", joint.kind, "the motion of joints in kernels")


def joint_placement(joint: TreeJoint, q: ca.SX) -> JointPlacement:
    """Move a joint.

    Parameters
    ----------
    joint
        The joint.
    q
        Its entries of the configuration.

    Returns
    -------
    rotation, translation : casadi.SX
        (3, 3) and (3, 1) of the child in the joint frame.
    """
    match joint.kind:
        case JointKind.REVOLUTE:
            return turn_about(joint.axis, ca.cos(q), ca.sin(q)), ca.SX.zeros(3)
        case JointKind.PRISMATIC:
            return ca.SX.eye(3), constant(joint.axis) * q
        case JointKind.SPHERICAL:
            return turn_from_quaternion(q), ca.SX.zeros(3)
        case JointKind.FLOATING:
            return turn_from_quaternion(q[3:]), q[:3]
    raise unknown_kind(f"joint '{joint.name}'", joint.kind, "the motion of joints in kernels")


# ----------------------------------------------------------------------------------------------------
# Steps on unit quaternions x, y, z, w
# ----------------------------------------------------------------------------------------------------


def product(a: ca.SX, b: ca.SX) -> ca.SX:
    """Multiply quaternions.

    Parameters
    ----------
    a, b
        (4, 1).

    Returns
    -------
    casadi.SX
        (4, 1): the rotation b, then a.
    """
    vector = a[3] * b[:3] + b[3] * a[:3] + ca.cross(a[:3], b[:3])
    return ca.vertcat(vector, a[3] * b[3] - ca.dot(a[:3], b[:3]))


def turned_by_small(quaternion: ca.SX, angle: ca.SX, *, body: bool = False) -> ca.SX:
    """Turn a quaternion by a rotation vector that is small.

    Parameters
    ----------
    quaternion
        (4, 1) of unit length.
    angle
        (3, 1) rotation vector [rad]; errors are of its third order.
    body
        Whether it stands in the turned axes.

    Returns
    -------
    casadi.SX
        (4, 1) of unit length.
    """
    small = ca.vertcat(angle / 2, 1)
    turned = product(quaternion, small) if body else product(small, quaternion)
    return turned / ca.norm_2(turned)


def configuration_chart(joints: Sequence[TreeJoint], q: ca.SX) -> ca.SX:
    """Differentiate a configuration along its tangent.

    Parameters
    ----------
    joints
        Joints of a tree.
    q
        (nq, 1) configuration.

    Returns
    -------
    casadi.SX
        (nq, nv).
    """
    chart = ca.SX(q.shape[0], max((joint.v.stop for joint in joints), default=0))
    for joint in joints:
        part = q[joint.q]
        match joint.kind:
            case JointKind.SPHERICAL:
                chart[joint.q, joint.v] = _body_turn(part)
            case JointKind.FLOATING:
                chart[joint.q, joint.v] = ca.diagcat(turn_from_quaternion(part[3:]), _body_turn(part[3:]))
            case _:
                chart[joint.q, joint.v] = ca.SX.eye(joint.v.stop - joint.v.start)
    return chart


def _body_turn(quaternion: ca.SX) -> ca.SX:
    vector, scalar = quaternion[:3], quaternion[3]
    return ca.vertcat(scalar * ca.SX.eye(3) + skew(vector), -vector.T) / 2


# ----------------------------------------------------------------------------------------------------
# Wrenches on the bodies, from their inertia and from outside, and the joint efforts that do the same work: the backward
# pass of Newton and Euler; what acts from outside is taken off what the bodies need
# ----------------------------------------------------------------------------------------------------

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
