"""A leg at a pose of the platform: its joints, the Jacobian of its ends, and joint rates from their motion.

The balls at the ends of a leg are released along the axes of the leg's last body, where the Jacobian of the usual leg
is diagonal. With J the Jacobian of the ends, in those axes,

    J dq/dt = velocity of the ends,    needed = S tau + Jᵀ force,

one elimination of Jᵀ serves both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from stewart_pin.kernels.graph.bodies import (
    Placements,
    Wrench,
    at_rest,
    carry_down,
    efforts_of_wrenches,
    inertial_wrenches,
    motions,
    placements,
    to_body,
)
from stewart_pin.kernels.graph.leg_positions import LegPositions, leg_positions
from stewart_pin.kernels.planning.elimination import Elimination, plan_pivots, solve_symmetric
from stewart_pin.kernels.planning.joint_physics import are_passive
from stewart_pin.kernels.planning.plan import Leg, LegEnd
from stewart_pin.kernels.planning.samples import at_samples
from stewart_pin.kernels.planning.spatial import (
    Masses,
    constant,
    skew,
    turn_from_quaternion,
    turning_matrix,
)
from stewart_pin.kernels.planning.tree import Tree, path_down
from stewart_pin.typing import FloatArray

# ----------------------------------------------------------------------------------------------------
# The platform's motion as the input of a graph
# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PlatformMotion:
    """How the body that carries the platform frame moves, in world axes.

    Attributes
    ----------
    rotation
        (3, 3) rotation of the body in the world.
    position
        (3, 1) origin of the body [m].
    velocity, omega
        (3, 1) of the origin, and angular [m/s, rad/s].
    felt, omega_rate
        (3, 1) acceleration of the origin less that of free fall, and angular acceleration [m/s², rad/s²].
    turning
        (3, 3) `turning_matrix` [1/s²].
    gravity
        (3,) acceleration of free fall [m/s²].
    """

    rotation: ca.SX
    position: ca.SX
    velocity: ca.SX
    omega: ca.SX
    felt: ca.SX
    omega_rate: ca.SX
    turning: ca.SX
    gravity: FloatArray

    def at_rest(self, acceleration: ca.SX) -> PlatformMotion:
        """Accelerate from rest, without gravity.

        Parameters
        ----------
        acceleration
            (6, 1) in world axes [m/s², rad/s²].

        Returns
        -------
        PlatformMotion
            At the same pose.
        """
        zero, rate = ca.SX.zeros(3), acceleration[3:]
        return PlatformMotion(
            rotation=self.rotation,
            position=self.position,
            velocity=zero,
            omega=zero,
            felt=acceleration[:3],
            omega_rate=rate,
            turning=skew(rate),
            gravity=np.zeros(3),
        )


def platform_motion(
    tree: Tree, pose: ca.SX, twist: ca.SX, acceleration: ca.SX, *, gravity: bool = True
) -> PlatformMotion:
    """Read the platform's motion from the inputs; its body frame is the platform frame.

    Parameters
    ----------
    tree
        Constants.
    pose
        (7, 1) position [m] and unit quaternion x y z w of the platform.
    twist
        (6, 1) [v; ω] of its origin in world axes [m/s, rad/s].
    acceleration
        (6, 1) [dv/dt; dω/dt] of its origin in world axes [m/s², rad/s²].
    gravity
        Whether the body feels its weight.

    Returns
    -------
    PlatformMotion
        Of the body.
    """
    fall = tree.gravity if gravity else np.zeros(3)
    return PlatformMotion(
        rotation=turn_from_quaternion(pose[3:]),
        position=pose[:3],
        velocity=twist[:3],
        omega=twist[3:],
        felt=acceleration[:3] - constant(fall),
        omega_rate=acceleration[3:],
        turning=turning_matrix(twist[3:], acceleration[3:]),
        gravity=fall,
    )


def platform_wrench(masses: Masses, moving: PlatformMotion) -> ca.SX:
    """Compute the wrench that makes the platform move as it does.

    Second moments are taken along their principal axes c: with s the middle one of them, the moment is
    ``2 s dω/dt + Σ (s_c - s) c × (B c)``, which leaves one product for a platform of revolution.

    Parameters
    ----------
    masses
        Of the platform.
    moving
        Its motion.

    Returns
    -------
    casadi.SX
        (6, 1) force, and moment about the body's origin, in world axes [N, N m].
    """
    force, moment = masses.mass * moving.felt, ca.SX.zeros(3)
    if masses.first.any():
        first = moving.rotation @ constant(masses.first)
        force, moment = force + moving.turning @ first, moment + ca.cross(first, moving.felt)
    middle, others = _principal(masses.second)
    moment = moment + 2 * middle * moving.omega_rate
    for value, axis in others:
        along = moving.rotation @ constant(axis)
        moment = moment + value * ca.cross(along, moving.turning @ along)
    return ca.vertcat(force, moment)


def platform_inertia(masses: Masses, rotation: ca.SX) -> ca.SX:
    """Compute the matrix that maps accelerations of the platform to the wrench that they take.

    Parameters
    ----------
    masses
        Of the platform.
    rotation
        (3, 3) rotation of the platform in the world.

    Returns
    -------
    casadi.SX
        (6, 6), symmetric, in world axes [kg, kg m, kg m²].
    """
    middle, others = _principal(masses.second)
    turning = 2 * middle * ca.SX.eye(3)
    for value, axis in others:
        along = rotation @ constant(axis)
        turning = turning + value * (ca.SX.eye(3) - along @ along.T)
    first = skew(rotation @ constant(masses.first))
    return ca.vertcat(ca.horzcat(masses.mass * ca.SX.eye(3), -first), ca.horzcat(first, turning))


def _principal(second: np.ndarray) -> tuple[float, list[tuple[float, np.ndarray]]]:
    """Middle principal second moment, and by how much those along other axes differ from it.

    The axes are those of the frame itself where these will do.
    """
    diagonal = np.array_equal(second, np.diag(np.diag(second)))
    moments, axes = (np.diag(second), np.eye(3)) if diagonal else np.linalg.eigh(second)
    middle = float(np.sort(moments)[1])
    least = 1e-14 * np.abs(moments).max(initial=0.0)
    others = [(float(m - middle), axis) for m, axis in zip(moments, axes.T, strict=True)]
    return middle, [(value, axis) for value, axis in others if abs(value) > least]


# ----------------------------------------------------------------------------------------------------

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
    scale
        (nv,) natural sizes of its tangent entries [m or rad].
    passive
        Whether its joints do nothing by themselves, but for their rotors.
    """

    leg: Leg
    positions: LegPositions
    at: Placements
    targets: tuple[ca.SX, ...]
    reduced: Elimination
    idle: ca.SX
    samples: Samples
    scale: FloatArray
    passive: bool

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
        return to_body(self.leg.joints, self.at, self.leg.ends[end].body, vectors)

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
        for body in path_down(self.leg.joints, self.leg.ends[end].body):
            vectors = self.at.to_parent[body] @ vectors
        return vectors

    def solve(self, needed: ca.SX) -> ca.SX:
        """Find the forces at the ends that joint efforts ask for, without motors.

        Parameters
        ----------
        needed
            (nv, k) joint efforts, none along idle motions.

        Returns
        -------
        casadi.SX
            (3 ends, k) forces on the leg, in axes of its last bodies; those that the leg's joints do not feel are zero.
        """
        found = self.reduced.back(self.reduced.forward(needed), {})
        none = ca.SX(1, needed.shape[1])
        return ca.vertcat(*(found.get(k, none) for k in range(3 * len(self.leg.ends))))

    def values(self, matrix: ca.SX) -> FloatArray:
        """Evaluate a matrix of the pose at samples.

        Parameters
        ----------
        matrix
            (m, n) expressions.

        Returns
        -------
        numpy.ndarray
            (samples, m, n), in the same unit as the matrix.
        """
        return at_samples(*self.samples, matrix)


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
    return PlacedLeg(
        leg, positions, at, targets, reduced, idle, samples, scale, passive=are_passive(leg.joints)
    )


def _target(leg: Leg, moving: PlatformMotion, end: LegEnd) -> ca.SX:
    if leg.on_platform:
        return moving.rotation.T @ (far_point(end) - moving.position)
    target = moving.position + moving.rotation @ far_point(end)
    # Nothing depends on where on the ground a leg stands, but on where its ends are from there.
    return target if leg.shift is None else target - leg.shift


def far_point(end: LegEnd) -> ca.SX:
    """Tell where an end is in what it ties the leg to.

    Parameters
    ----------
    end
        End of a leg.

    Returns
    -------
    casadi.SX
        (3, 1) in axes of the platform or the ground [m].
    """
    return constant(end.other) if end.shift is None else constant(end.other) + end.shift


def _forces_at(point: ca.SX, forces: ca.SX) -> Wrench:
    moments = [ca.cross(point, forces[:, k]) for k in range(forces.shape[1])]
    return forces, ca.horzcat(*moments)


def leg_rates(placed: PlacedLeg, moving: PlatformMotion) -> ca.SX:
    """Compute the joint rates that follow the platform; idle motions carry no momentum.

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
            velocity = moving.velocity + ca.cross(moving.omega, moving.rotation @ far_point(end))
        relative.append(placed.to_ends(velocity, k))
    rates = placed.reduced.transposed(ca.vertcat(*relative))
    momenta = idle_momenta(placed)
    if momenta:
        carried = [carry_down(placed.leg.joints, placed.at, momentum, 1) for momentum in momenta]
        efforts = ca.horzcat(*(each for each, _ in carried))
        overlap, inertia = efforts.T @ rates, placed.idle.T @ efforts
        if placed.leg.on_platform:
            slide, turn = (moving.rotation.T @ each for each in (moving.velocity, moving.omega))
            overlap += ca.vertcat(*(force.T @ slide + moment.T @ turn for _, (force, moment) in carried))
        parts, _, _ = solve_symmetric(inertia, overlap, placed.values(inertia))
        rates = rates - placed.idle @ ca.vertcat(*parts)
    return rates


def idle_momenta(placed: PlacedLeg) -> list[dict[int, Wrench]]:
    """Compute the momenta of a leg's bodies in its idle motions, its root at rest.

    Parameters
    ----------
    placed
        The leg.

    Returns
    -------
    list of dict
        Of each motion ``{body: (momentum, its moment about the body's origin)}``, in axes of the body; also the
        wrenches that accelerate it from rest.
    """
    joints, still, resting = placed.leg.joints, ca.SX.zeros(placed.leg.nv), at_rest(ca.SX.zeros(3))
    return [
        inertial_wrenches(joints, motions(joints, placed.at, still, idle, resting))
        for idle in (placed.idle[:, k] for k in range(placed.idle.shape[1]))
    ]


def turning_of(placed: PlacedLeg, body: int, rates: ca.SX) -> ca.SX:
    """Turn a body of a leg whose root is at rest.

    Parameters
    ----------
    placed
        The leg.
    body
        Number of the body within the leg.
    rates
        (nv, k) rates of its joints.

    Returns
    -------
    casadi.SX
        (3, k) angular velocities, in axes of the body.
    """
    still, resting = ca.SX.zeros(placed.leg.nv), at_rest(ca.SX.zeros(3))
    moved = [motions(placed.leg.joints, placed.at, x, still, resting) for x in ca.horzsplit(rates)]
    return ca.sparsify(ca.horzcat(*(x.omega[body] for x in moved)))
