"""The forces that a leg takes to move as it does, and what it does to the platform by them.

Motor efforts stay unknown: forces are those without motors, and a column for each.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.graph.bodies import (
    Motions,
    RootMotion,
    Wrench,
    carry_down,
    efforts_of_wrenches,
    inertial_wrenches,
    less,
    motions,
    outside_wrenches,
)
from stewart_pin.kernels.graph.joint_effects import spring_effort
from stewart_pin.kernels.graph.legs import PlacedLeg, PlatformMotion, far_point, idle_momenta
from stewart_pin.kernels.planning.elimination import solve_symmetric
from stewart_pin.kernels.planning.spatial import constant, skew
from stewart_pin.typing import FloatArray

_STILL = 1e-9
"""Entries of idle motions below this are round-off."""


@dataclass(frozen=True, eq=False)
class LegForces:
    """What a leg does to the platform, about the origin of the platform's body and in world axes.

    Attributes
    ----------
    wrench
        (6, 1) without motor efforts [N, N m].
    columns
        ``{motor: (6, 1)}`` per unit of motor effort.
    reactions, reaction_columns
        Forces that the balls put on the leg, in axes of its last bodies, in the same way: (3 ends, 1).
    """

    wrench: ca.SX
    columns: dict[int, ca.SX]
    reactions: ca.SX
    reaction_columns: dict[int, ca.SX]


@dataclass(frozen=True, eq=False)
class Rest:
    """How slow what is at rest is, in natural units: twist and accelerations of the platform tell.

    Attributes
    ----------
    rate
        (1, 1) rate below which a joint is at rest [1/s].
    acceleration
        (1, 1) acceleration below which it stays so [1/s²]; None: what starts is not asked, and dry friction of joints
        at rest is left out.
    """

    rate: ca.SX
    acceleration: ca.SX | None


def leg_forces(
    placed: PlacedLeg,
    moving: PlatformMotion,
    rates: ca.SX,
    acting: ca.SX | None = None,
    rest: Rest | None = None,
) -> LegForces:
    """Compute the forces that a leg takes to move as it does.

    Parameters
    ----------
    placed
        The leg.
    moving
        Motion of the platform, gravity among its acceleration.
    rates
        (nv, 1) rates of the joints.
    acting
        (n, 1) what acts on the chain from outside, in world axes; None for nothing.
    rest
        What counts as rest, where springs, damping and dry friction of joints are felt; None: they are left out.

    Returns
    -------
    LegForces
        What it does to the platform.

    Raises
    ------
    UnsupportedError
        If a motor drives a motion that the platform does not see.
    """
    wrenches = inertial_wrenches(placed.leg.joints, leg_motions(placed, moving, rates))
    if acting is not None:
        wrenches = less(wrenches, acting_on(placed, moving, acting))
    needed, wrenches = _idle_obey(placed, wrenches)
    # Idle motions move no joint that has something of its own.
    if any(joint.rotor.any() for joint in placed.leg.joints):
        needed = needed + _rotors(placed) * leg_accelerations(placed, moving, rates)
    if rest is not None and not placed.passive:
        needed = needed - _own_efforts(placed, moving, rates, rest)
    reactions = placed.solve(needed)
    columns = {motor: _motor_response(placed, entry) for motor, entry in placed.leg.motors}
    return LegForces(
        wrench=on_platform(placed, moving, wrenches, reactions),
        columns={motor: on_platform(placed, moving, {}, column) for motor, column in columns.items()},
        reactions=reactions,
        reaction_columns=columns,
    )


def acting_on(placed: PlacedLeg, moving: PlatformMotion, wrenches: ca.SX) -> dict[int, Wrench]:
    """Tell what acts on the bodies of a leg from outside.

    Parameters
    ----------
    placed
        The leg.
    moving
        Motion of the platform; only its pose matters.
    wrenches
        (n, 1) what acts on the whole chain, in world axes.

    Returns
    -------
    dict
        ``{body: (force, moment)}`` of the leg's bodies.
    """
    if not placed.leg.outside:
        return {}
    if placed.leg.on_platform:
        wrenches = ca.vec(moving.rotation.T @ ca.reshape(wrenches, 3, wrenches.shape[0] // 3))
    return outside_wrenches(placed.leg.joints, placed.at, placed.leg.outside, wrenches)


def leg_motions(placed: PlacedLeg, moving: PlatformMotion, rates: ca.SX) -> Motions:
    """Move the bodies of a leg with the platform; idle motions do not accelerate.

    Parameters
    ----------
    placed
        The leg.
    moving
        Motion of the platform, gravity among its acceleration.
    rates
        (nv, 1) rates of the joints.

    Returns
    -------
    Motions
        Of the leg's bodies.
    """
    leg, felt = placed.leg, _felt_at_ends(placed, moving)
    a = leg_accelerations(placed, moving, rates)
    known = {e.body: (constant(e.point), felt[k]) for k, e in enumerate(leg.ends)}
    if placed.idle.shape[1]:
        known = {}
    return motions(leg.joints, placed.at, rates, a, _root(placed, moving), known=known)


def leg_accelerations(placed: PlacedLeg, moving: PlatformMotion, rates: ca.SX) -> ca.SX:
    """Compute the joint accelerations of a leg that follows the platform; idle motions do not accelerate.

    Parameters
    ----------
    placed
        The leg.
    moving
        Motion of the platform.
    rates
        (nv, 1) rates of the joints.

    Returns
    -------
    casadi.SX
        (nv, 1) [m/s² or rad/s²].
    """
    felt, drifting = _felt_at_ends(placed, moving), leg_velocities(placed, moving, rates)
    bias = [
        drifting.acceleration[e.body] + drifting.turning[e.body] @ constant(e.point) for e in placed.leg.ends
    ]
    return placed.reduced.transposed(ca.vertcat(*felt) - ca.vertcat(*bias))


def leg_velocities(placed: PlacedLeg, moving: PlatformMotion, rates: ca.SX) -> Motions:
    """Move the bodies of a leg with the platform, joints at constant rates.

    Parameters
    ----------
    placed
        The leg.
    moving
        Motion of the platform.
    rates
        (nv, 1) rates of the joints.

    Returns
    -------
    Motions
        Of the leg's bodies.
    """
    still = ca.SX.zeros(placed.leg.nv)
    return motions(placed.leg.joints, placed.at, rates, still, _root(placed, moving))


def leg_inertia(placed: PlacedLeg, moving: PlatformMotion) -> ca.SX:
    """Compute what the platform feels of a leg's inertia.

    Parameters
    ----------
    placed
        The leg.
    moving
        Motion of the platform; only its pose matters.

    Returns
    -------
    casadi.SX
        (6, 6), symmetric: wrench that accelerates the leg, per acceleration of the platform, in world axes.
    """
    leg, arms = placed.leg, [moving.rotation @ far_point(end) for end in placed.leg.ends]
    if leg.on_platform:
        columns = []
        still = ca.SX.zeros(leg.nv)
        for k in range(6):
            pushed = moving.at_rest(ca.SX.eye(6)[:, k])
            columns.append(-leg_forces(placed, pushed, still).wrench)
        return ca.horzcat(*columns)
    response = _tip_inertia(placed)
    total = ca.SX(6, 6)
    for i, row_arm in enumerate(arms):
        for j, column_arm in enumerate(arms):
            block = response[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
            turned = placed.from_end(placed.from_end(block, i).T, j).T
            lever = skew(row_arm) @ turned
            total[:3, :3] += turned
            total[3:, :3] += lever
            total[3:, 3:] -= lever @ skew(column_arm)
            total[:3, 3:] -= turned @ skew(column_arm)
    return total


def _tip_inertia(placed: PlacedLeg) -> ca.SX:
    """Solve for forces at the ends per acceleration of the ends, in axes of the last bodies: (3 ends, 3 ends)."""
    leg, joints, at = placed.leg, placed.leg.joints, placed.at
    still, zero = ca.SX.zeros(leg.nv), ca.SX.zeros(3)
    resting = RootMotion(zero, zero, zero, zero)
    columns = []
    for unit in ca.horzsplit(ca.SX.eye(3 * len(leg.ends))):
        a = placed.reduced.transposed(unit)
        known = {e.body: (constant(e.point), unit[3 * k : 3 * k + 3]) for k, e in enumerate(leg.ends)}
        if placed.idle.shape[1]:
            known = {}
        wrenches = inertial_wrenches(joints, motions(joints, at, still, a, resting, known=known))
        columns.append(placed.solve(_idle_obey(placed, wrenches)[0] + _rotors(placed) * a))
    return ca.horzcat(*columns)


def _root(placed: PlacedLeg, moving: PlatformMotion) -> RootMotion:
    if not placed.leg.on_platform:
        zero = ca.SX.zeros(3)
        return RootMotion(zero, zero, zero, constant(-moving.gravity))
    back = moving.rotation.T
    return RootMotion(
        back @ moving.omega, back @ moving.omega_rate, back @ moving.velocity, back @ moving.felt
    )


def _felt_at_ends(placed: PlacedLeg, moving: PlatformMotion) -> list[ca.SX]:
    felt = []
    for k, end in enumerate(placed.leg.ends):
        if placed.leg.on_platform:
            felt.append(placed.to_ends(moving.rotation.T @ constant(-moving.gravity), k))
        else:
            arm = moving.rotation @ far_point(end)
            felt.append(placed.to_ends(moving.felt + moving.turning @ arm, k))
    return felt


def _idle_obey(placed: PlacedLeg, wrenches: dict[int, Wrench]) -> tuple[ca.SX, dict[int, Wrench]]:
    """Joint efforts and wrenches with idle motions left to their own inertia."""
    joints, at, idle = placed.leg.joints, placed.at, placed.idle
    needed = efforts_of_wrenches(joints, at, wrenches, 1)
    if not idle.shape[1]:
        return needed, wrenches
    zero, moved = ca.SX.zeros(3), idle_momenta(placed)
    pushed = ca.horzcat(*(efforts_of_wrenches(joints, at, wrench, 1) for wrench in moved))
    inertia = idle.T @ pushed
    steps, _, _ = solve_symmetric(inertia, -(idle.T @ needed), placed.values(inertia))
    for wrench, step in zip(moved, steps, strict=True):
        needed = needed + efforts_of_wrenches(joints, at, wrench, 1) * step
        for body, (force, moment) in wrench.items():
            beside = wrenches.get(body, (zero, zero))
            wrenches = {**wrenches, body: (beside[0] + force * step, beside[1] + moment * step)}
    return needed, wrenches


def _motor_response(placed: PlacedLeg, entry: int) -> ca.SX:
    """Solve for forces at the ends under a unit effort of one motor."""
    push = ca.SX(placed.leg.nv, 1)
    push[entry] = -1
    unseen = placed.idle.T @ push
    if unseen.nnz() and np.abs(placed.values(unseen)).max(initial=0.0) > 1e-9:
        joint = next(joint for joint in placed.leg.joints if joint.v.start == entry)
        raise UnsupportedError(f"motor '{joint.name}' drives a motion that the platform does not see")
    return placed.solve(push)


def on_platform(
    placed: PlacedLeg, moving: PlatformMotion, wrenches: dict[int, Wrench], reactions: ca.SX
) -> ca.SX:
    """Carry forces through a leg: the balls' forces reversed, or what the joints on the platform have to carry.

    Parameters
    ----------
    placed
        The leg.
    moving
        Motion of the platform; only its pose matters.
    wrenches
        ``{body: (force, moment)}`` that move the leg's bodies.
    reactions
        (3 ends, 1) forces that the balls put on the leg, in axes of its last bodies.

    Returns
    -------
    casadi.SX
        (6, 1) wrench on the platform, about the origin of its body and in world axes.
    """
    leg = placed.leg
    forces = [reactions[3 * k : 3 * k + 3] for k in range(len(leg.ends))]
    if not leg.on_platform:
        total = ca.SX.zeros(6)
        for k, end in enumerate(leg.ends):
            force = -placed.from_end(forces[k], k)
            total = total + ca.vertcat(force, ca.cross(moving.rotation @ far_point(end), force))
        return total
    net = dict(wrenches)
    zero = ca.SX.zeros(3)
    for end, force in zip(leg.ends, forces, strict=True):
        beside = net.get(end.body, (zero, zero))
        net[end.body] = beside[0] - force, beside[1] - ca.cross(constant(end.point), force)
    force, moment = carry_down(leg.joints, placed.at, net, 1)[1]
    return -ca.vertcat(moving.rotation @ force, moving.rotation @ moment)


# ----------------------------------------------------------------------------------------------------
# What the joints of a leg do by themselves
# ----------------------------------------------------------------------------------------------------


def require_known_joints(placed: PlacedLeg) -> None:
    """Refuse legs whose joints do by themselves what their motion does not tell.

    Parameters
    ----------
    placed
        The leg.

    Raises
    ------
    UnsupportedError
        If a joint has a spring and no position in closed form, or a rotor and part in an idle motion.
    """
    for k, joint in enumerate(placed.leg.joints):
        if joint.physics.pushes and k not in placed.positions.values:
            raise UnsupportedError(f"joint '{joint.name}' has a spring, and no position in closed form")
        moved = placed.idle[joint.v, :]
        if joint.rotor.any() and moved.nnz() and np.abs(placed.values(moved)).max(initial=0.0) > _STILL:
            raise UnsupportedError(f"joint '{joint.name}' has a rotor (armature), and idle motions turn it")


def friction_of(placed: PlacedLeg) -> FloatArray:
    """List dry friction.

    Parameters
    ----------
    placed
        The leg.

    Returns
    -------
    numpy.ndarray
        (nv,) of its tangent entries [N or N m].
    """
    return np.concatenate([joint.friction for joint in placed.leg.joints])


def _rotors(placed: PlacedLeg) -> ca.SX:
    return ca.sparsify(constant(np.concatenate([joint.rotor for joint in placed.leg.joints])))


def _own_efforts(placed: PlacedLeg, moving: PlatformMotion, rates: ca.SX, rest: Rest) -> ca.SX:
    """Efforts of springs, damping and dry friction, (nv, 1)."""
    efforts = ca.SX(placed.leg.nv, 1)
    for k, joint in enumerate(placed.leg.joints):
        if joint.physics.pushes:
            efforts[joint.v] += spring_effort(joint.physics, _position(placed, k))
        if joint.damping.any():
            efforts[joint.v] -= constant(joint.damping) * rates[joint.v]
    friction = friction_of(placed)
    entries = np.flatnonzero(friction).tolist()
    if not entries:
        return efforts
    sizes, starting = constant(placed.scale[entries]), ca.SX(len(entries), 1)
    if rest.acceleration is not None:
        a = leg_accelerations(placed, moving, rates)[entries]
        starting = ca.if_else(ca.fabs(a) > sizes * rest.acceleration, a, 0)
    moves = ca.fabs(rates[entries]) > sizes * rest.rate
    efforts[entries] -= constant(friction[entries]) * ca.sign(ca.if_else(moves, rates[entries], starting))
    return efforts


def _position(placed: PlacedLeg, k: int) -> ca.SX:
    """Position of a slide, or of a hinge within half a turn of home."""
    value, home = placed.positions.values[k], float(placed.leg.home[k][0])
    if value.shape[0] == 1:
        return value
    cosine, sine = value[0], value[1]
    back, across = float(np.cos(home)), float(np.sin(home))
    return home + ca.atan2(sine * back - cosine * across, cosine * back + sine * across)
