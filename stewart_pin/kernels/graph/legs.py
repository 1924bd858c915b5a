"""A leg in motion: joint rates from the motion of its ends, and the forces that it takes there.

The balls at the ends of a leg are released along the axes of the leg's last body, where the Jacobian of the usual leg
is diagonal. With J the Jacobian of the ends, in those axes,

    J dq/dt = velocity of the ends,    needed = S tau + Jᵀ force,

one elimination of Jᵀ serves both. Motor efforts stay unknown: forces are those without motors, and a column for each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.elimination import Elimination, plan_pivots, solve_symmetric
from stewart_pin.kernels.graph.joint_efforts import Wrench, carry_down, efforts_of_wrenches, inertial_wrenches
from stewart_pin.kernels.graph.joint_motion import Placements, RootMotion, motions, placements
from stewart_pin.kernels.graph.leg_positions import LegPositions, leg_positions
from stewart_pin.kernels.graph.platform_motion import PlatformMotion
from stewart_pin.kernels.plan import Leg, LegEnd
from stewart_pin.kernels.samples import at_samples
from stewart_pin.kernels.spatial import constant, skew
from stewart_pin.typing import FloatArray

Samples = tuple[Sequence[ca.SX], Sequence[FloatArray]]
"""Symbols, and values of each at samples."""


@dataclass(frozen=True, eq=False)
class PlacedLeg:
    """A leg at a symbolic pose.

    Attributes
    ----------
    leg
        Its constants.
    positions
        Its joints.
    at
        Placements of its bodies in axes of what it hangs on.
    targets
        (3, 1) each: its ends in those axes [m].
    reduced
        Jᵀ, eliminated.
    idle
        (nv, n) motions that its ends do not see.
    samples
        Symbols that it depends on, and (samples, n) values of each [m, unit quaternion].
    """

    leg: Leg
    positions: LegPositions
    at: Placements
    targets: tuple[ca.SX, ...]
    reduced: Elimination
    idle: ca.SX
    samples: Samples

    @property
    def score(self) -> float:
        """Smallest pivot relative to its column."""
        return self.reduced.pivots.score

    def to_ends(self, vectors: ca.SX, end: int) -> ca.SX:
        """Turn vectors from the root's axes into those of the body at an end.

        Parameters
        ----------
        vectors
            (3, k).
        end
            Number of the end.

        Returns
        -------
        casadi.SX
            (3, k).
        """
        for body in reversed(self._path(end)):
            vectors = self.at.to_parent[body].T @ vectors
        return vectors

    def from_end(self, vectors: ca.SX, end: int) -> ca.SX:
        """Turn vectors from axes of the body at an end into the root's.

        Parameters
        ----------
        vectors
            (3, k).
        end
            Number of the end.

        Returns
        -------
        casadi.SX
            (3, k).
        """
        for body in self._path(end):
            vectors = self.at.to_parent[body] @ vectors
        return vectors

    def _path(self, end: int) -> list[int]:
        path, body = [], self.leg.ends[end].body
        while body:
            path.append(body)
            body = self.leg.joints[body - 1].parent
        return path


def place_leg(leg: Leg, moving: PlatformMotion, samples: Samples, scale: FloatArray) -> PlacedLeg:
    """Place a leg and eliminate the Jacobian of its ends.

    Parameters
    ----------
    leg
        The leg.
    moving
        Motion of the platform.
    samples
        Symbols that it depends on, and (samples, n) values of each [m, unit quaternion].
    scale
        (nv,) natural sizes of the leg's tangent entries [m or rad].

    Returns
    -------
    PlacedLeg
        The leg at that pose.

    Raises
    ------
    UnsupportedError
        If the leg has no closed form.
    """
    targets = tuple(_target(leg, moving, end) for end in leg.ends)
    positions = leg_positions(leg, targets)
    at = placements(leg.joints, positions.moved)
    columns = [
        efforts_of_wrenches(leg.joints, at, {end.body: _forces_at(constant(end.point), ca.SX.eye(3))}, 3)
        for end in leg.ends
    ]
    transpose = ca.horzcat(*columns)
    values = at_samples(*samples, transpose) * scale[:, None]
    reduced = Elimination(transpose, plan_pivots(values, list(range(transpose.shape[1]))))
    idle = reduced.forward(ca.SX.eye(leg.nv))[list(reduced.pivots.rows), :].T
    return PlacedLeg(leg, positions, at, targets, reduced, idle, samples)


def _target(leg: Leg, moving: PlatformMotion, end: LegEnd) -> ca.SX:
    if leg.on_platform:
        return moving.rotation.T @ (_other(end) - moving.position)
    target = moving.position + moving.rotation @ _other(end)
    # Nothing depends on where on the ground a leg stands, but on where its ends are from there.
    return target if leg.shift is None else target - leg.shift


def _other(end: LegEnd) -> ca.SX:
    return constant(end.other) if end.shift is None else constant(end.other) + end.shift


def _forces_at(point: ca.SX, forces: ca.SX) -> Wrench:
    moments = [ca.cross(point, forces[:, k]) for k in range(forces.shape[1])]
    return forces, ca.horzcat(*moments)


def leg_rates(placed: PlacedLeg, moving: PlatformMotion) -> ca.SX:
    """Compute the joint rates that follow the platform; idle motions get the least norm.

    Parameters
    ----------
    placed
        The leg.
    moving
        Motion of the platform.

    Returns
    -------
    casadi.SX
        (nv, 1) rates.
    """
    relative = []
    for k, end in enumerate(placed.leg.ends):
        if placed.leg.on_platform:
            carried = moving.velocity + ca.cross(moving.omega, moving.rotation @ placed.targets[k])
            velocity = -(moving.rotation.T @ carried)
        else:
            velocity = moving.velocity + ca.cross(moving.omega, moving.rotation @ _other(end))
        relative.append(placed.to_ends(velocity, k))
    rates = placed.reduced.transposed(ca.vertcat(*relative))
    if placed.idle.shape[1]:
        overlap = placed.idle.T @ rates
        if not all(overlap[k].is_zero() for k in range(overlap.shape[0])):
            square = placed.idle.T @ placed.idle
            parts, _, _ = solve_symmetric(square, overlap, _at(placed, square))
            rates = rates - placed.idle @ ca.vertcat(*parts)
    return rates


def _at(placed: PlacedLeg, matrix: ca.SX) -> FloatArray:
    return at_samples(*placed.samples, matrix)


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


def leg_forces(placed: PlacedLeg, moving: PlatformMotion, rates: ca.SX) -> LegForces:
    """Compute the forces that a leg takes to move as it does.

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
    LegForces
        What it does to the platform.

    Raises
    ------
    UnsupportedError
        If a motor drives a motion that the platform does not see.
    """
    leg, at = placed.leg, placed.at
    root, felt = _root(placed, moving), _felt_at_ends(placed, moving)
    drifting = motions(leg.joints, at, rates, ca.SX.zeros(leg.nv), root)
    bias = [drifting.acceleration[e.body] + drifting.turning[e.body] @ constant(e.point) for e in leg.ends]
    a = placed.reduced.transposed(ca.vertcat(*felt) - ca.vertcat(*bias))
    known = {e.body: (constant(e.point), felt[k]) for k, e in enumerate(leg.ends)}
    if placed.idle.shape[1]:
        known = {}
    wrenches = inertial_wrenches(leg.joints, motions(leg.joints, at, rates, a, root, known=known))
    needed, wrenches = _idle_obey(placed, wrenches)
    reactions = _solve(placed, needed)
    columns = {motor: _motor_response(placed, entry) for motor, entry in leg.motors}
    return LegForces(
        wrench=_on_platform(placed, moving, wrenches, reactions),
        columns={motor: _on_platform(placed, moving, {}, column) for motor, column in columns.items()},
        reactions=reactions,
        reaction_columns=columns,
    )


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
    leg, arms = placed.leg, [moving.rotation @ _other(end) for end in placed.leg.ends]
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
        columns.append(_solve(placed, _idle_obey(placed, wrenches)[0]))
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
            arm = moving.rotation @ _other(end)
            felt.append(placed.to_ends(moving.felt + moving.turning @ arm, k))
    return felt


def _idle_obey(placed: PlacedLeg, wrenches: dict[int, Wrench]) -> tuple[ca.SX, dict[int, Wrench]]:
    """Joint efforts and wrenches with idle motions left to their own inertia."""
    joints, at, idle = placed.leg.joints, placed.at, placed.idle
    needed = efforts_of_wrenches(joints, at, wrenches, 1)
    if not idle.shape[1]:
        return needed, wrenches
    zero, still = ca.SX.zeros(3), ca.SX.zeros(placed.leg.nv)
    resting = RootMotion(zero, zero, zero, zero)
    moved = [
        inertial_wrenches(joints, motions(joints, at, still, idle[:, k], resting))
        for k in range(idle.shape[1])
    ]
    pushed = ca.horzcat(*(efforts_of_wrenches(joints, at, wrench, 1) for wrench in moved))
    inertia = idle.T @ pushed
    steps, _, _ = solve_symmetric(inertia, -(idle.T @ needed), _at(placed, inertia))
    for wrench, step in zip(moved, steps, strict=True):
        needed = needed + efforts_of_wrenches(joints, at, wrench, 1) * step
        for body, (force, moment) in wrench.items():
            beside = wrenches.get(body, (zero, zero))
            wrenches = {**wrenches, body: (beside[0] + force * step, beside[1] + moment * step)}
    return needed, wrenches


def _solve(placed: PlacedLeg, needed: ca.SX) -> ca.SX:
    found = placed.reduced.back(placed.reduced.forward(needed), {})
    return ca.vertcat(*(found.get(k, ca.SX(0)) for k in range(3 * len(placed.leg.ends))))


def _motor_response(placed: PlacedLeg, entry: int) -> ca.SX:
    """Solve for forces at the ends under a unit effort of one motor."""
    push = ca.SX(placed.leg.nv, 1)
    push[entry] = -1
    unseen = placed.idle.T @ push
    if unseen.nnz() and np.abs(_at(placed, unseen)).max(initial=0.0) > 1e-9:
        joint = next(joint for joint in placed.leg.joints if joint.v.start == entry)
        raise UnsupportedError(f"motor '{joint.name}' drives a motion that the platform does not see")
    return _solve(placed, push)


def _on_platform(
    placed: PlacedLeg, moving: PlatformMotion, wrenches: dict[int, Wrench], reactions: ca.SX
) -> ca.SX:
    """Wrench on the platform: the balls' forces reversed, or what the joints on the platform have to carry."""
    leg = placed.leg
    forces = [reactions[3 * k : 3 * k + 3] for k in range(len(leg.ends))]
    if not leg.on_platform:
        total = ca.SX.zeros(6)
        for k, end in enumerate(leg.ends):
            force = -placed.from_end(forces[k], k)
            total = total + ca.vertcat(force, ca.cross(moving.rotation @ _other(end), force))
        return total
    net = dict(wrenches)
    zero = ca.SX.zeros(3)
    for end, force in zip(leg.ends, forces, strict=True):
        beside = net.get(end.body, (zero, zero))
        net[end.body] = beside[0] - force, beside[1] - ca.cross(constant(end.point), force)
    force, moment = carry_down(leg.joints, placed.at, net, 1)[1]
    return -ca.vertcat(moving.rotation @ force, moving.rotation @ moment)
