"""The platform's motion as the input of a graph."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from stewart_pin.kernels.planning.spatial import (
    Masses,
    constant,
    skew,
    turn_from_quaternion,
    turning_matrix,
)
from stewart_pin.kernels.planning.tree import Tree
from stewart_pin.typing import FloatArray


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
