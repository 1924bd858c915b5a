"""Inverse dynamics of a six-legged platform whose legs have mass, in closed form for any batch shape.

Newton and Euler, leg by leg: the balance of moments about its lower joint gives the force that a leg passes
across its own line to the platform; what is then left of the platform's balance gives the six forces along
the legs. No coordinates, no tree, no multipliers: an oracle for formulations that have them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array, as_batch
from stewart_pin.errors import UnsupportedError
from stewart_pin.geometry.hexapod import STANDARD_GRAVITY, Hexapod, leg_forces_for_wrench, leg_jacobian
from stewart_pin.geometry.hexapod_bodies import HexapodBodies, RigidBody
from stewart_pin.geometry.leg_motion import LegAttitude, TipMotion, dot, leg_attitude, tip_motion
from stewart_pin.geometry.rotations import as_rotation
from stewart_pin.typing import ArrayLike, FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class HexapodForces(Brief):
    """Forces that move a six-legged platform.

    Attributes
    ----------
    actuator
        (..., 6) between lower and upper part of each leg, positive pushing the platform away from the base
        [N].
    platform_joint
        (..., 6, 3) of each leg on the platform, in base axes [N].
    """

    actuator: FloatArray
    platform_joint: FloatArray


def hexapod_inverse_dynamics(
    hexapod: Hexapod,
    bodies: HexapodBodies,
    position: ArrayLike,
    rotation: ArrayLike,
    twist: ArrayLike,
    acceleration: ArrayLike,
    *,
    gravity: ArrayLike = STANDARD_GRAVITY,
) -> HexapodForces:
    """Compute the actuator forces for a motion of the platform, with the inertia of the legs.

    Parameters
    ----------
    hexapod
        Geometry.
    bodies
        Masses of the platform and of the legs, and the kind of lower joint.
    position
        (..., 3) platform origin in the base frame [m].
    rotation
        (..., 3, 3) platform axes in the base frame.
    twist
        (..., 6) [v; ω] of the platform origin, in base axes [m/s, rad/s].
    acceleration
        (..., 6) [dv/dt; dω/dt] of the platform origin, in base axes [m/s², rad/s²].
    gravity
        (3,) acceleration of free fall in base axes [m/s²].

    Returns
    -------
    HexapodForces
        Force of each actuator, and of each leg on the platform.

    Raises
    ------
    InputError
        If an argument has the wrong shape, is not finite, or its batch shape does not fit the others.
    SingularityError
        If the leg Jacobian is singular, a leg has no length, or a leg lies along its first axis (gimbal lock).
    UnsupportedError
        If the lower joints are spherical and a part of a leg is not axisymmetric about the leg: its spin then
        has a motion of its own, which the platform's motion does not determine.

    Notes
    -----
    With u along a leg of length l, f its force on the platform, n the normal of the universal joint and τ the
    torque the joint transmits about it, the balance of moments of the whole leg about its base point is

        τ n - l u × f = M,

    M being the moment of inertial and gravity forces, with sign reversed. Along u it gives τ = M·u / cos β;
    across u it gives f⊥ = (τ n - M) × u / l. The platform's balance then is Jᵀ (f·u) = wrench - Σ f⊥, and the
    actuator also carries the upper part along the leg.

    A leg on a spherical joint has a third angle, about itself, and no τ. Its idle spin is free to choose: here it
    carries no momentum, ω·u = 0, and its acceleration is the one for which M·u = 0. If the leg is axisymmetric, M·u
    is its axial moment of inertia times u·dω/dt and nothing else, so the spin rate ω·u stays zero. Another spin rate
    gives other forces, by the gyroscopic moment.
    """
    rotation = as_rotation("rotation", rotation)
    free_fall = as_array("gravity", gravity, (3,))
    tip = tip_motion(hexapod, position, rotation, twist, acceleration)
    leg = leg_attitude(tip, np.asarray(bodies.first_axes))
    if bodies.lower_joint == "spherical":
        leg = _with_idle_spin(leg, tip, bodies)

    moment, upper_force = _leg_loads(bodies, tip, leg, free_fall)
    torque = dot(moment, tip.direction) / leg.tilt_cosine
    passed = torque[..., None] * leg.normal - moment
    transverse = np.cross(passed, tip.direction) / tip.length[..., None]

    wrench = _platform_wrench(bodies.platform, rotation, twist, acceleration, free_fall)
    carried = np.concatenate([transverse, np.cross(tip.arms, transverse)], axis=-1).sum(axis=-2)
    axial = leg_forces_for_wrench(leg_jacobian(hexapod, position, rotation), wrench - carried)
    return HexapodForces(
        actuator=axial + dot(upper_force, tip.direction),
        platform_joint=axial[..., None] * tip.direction + transverse,
    )


def _with_idle_spin(leg: LegAttitude, tip: TipMotion, bodies: HexapodBodies) -> LegAttitude:
    for name in ("lower", "upper"):
        for number, body in enumerate(_six(getattr(bodies, name)), start=1):
            if not body.is_axisymmetric():
                raise UnsupportedError(
                    f"the {name} part of leg {number} is not axisymmetric about the leg, so on a spherical "
                    f"joint its spin depends on more than the platform's motion; make it axisymmetric or use "
                    f"lower_joint='universal'"
                )
    # ω = u × u̇, and its derivative u × ü: without the spin s u, and its derivative ṡ u + s u̇.
    spin, spin_rate = (
        dot(x, tip.direction)[..., None] for x in (leg.angular_velocity, leg.angular_acceleration)
    )
    return replace(
        leg,
        angular_velocity=leg.angular_velocity - spin * tip.direction,
        angular_acceleration=leg.angular_acceleration - spin_rate * tip.direction - spin * tip.swing,
    )


def _leg_loads(
    bodies: HexapodBodies, tip: TipMotion, leg: LegAttitude, gravity: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return what accelerates each leg: moment about the base point, and force on the upper part."""
    turning = leg.rotation, leg.angular_velocity, leg.angular_acceleration
    foot_acceleration = np.zeros_like(tip.acceleration)
    lower_arm, lower_force, lower_moment = _newton_euler(bodies.lower, foot_acceleration - gravity, *turning)
    upper_arm, upper_force, upper_moment = _newton_euler(bodies.upper, tip.acceleration - gravity, *turning)
    upper_arm = upper_arm + tip.length[..., None] * tip.direction
    moment = lower_moment + np.cross(lower_arm, lower_force) + upper_moment + np.cross(upper_arm, upper_force)
    return moment, upper_force


def _platform_wrench(
    body: RigidBody, rotation: FloatArray, twist: ArrayLike, acceleration: ArrayLike, gravity: FloatArray
) -> FloatArray:
    """Return the force and the moment about the platform origin that accelerate the platform."""
    twist, acceleration = as_batch("twist", twist, (6,)), as_batch("acceleration", acceleration, (6,))
    turning = (array[..., None, :] for array in (twist[..., 3:], acceleration[..., 3:]))
    felt = acceleration[..., None, :3] - gravity
    arm, force, moment = _newton_euler((body,), felt, rotation[..., None, :, :], *turning)
    return np.concatenate([force, moment + np.cross(arm, force)], axis=-1)[..., 0, :]


def _newton_euler(
    bodies: RigidBody | Sequence[RigidBody],
    felt: FloatArray,
    rotation: FloatArray,
    omega: FloatArray,
    omega_rate: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return arm to the centre of mass, m (a - g) there, and I dω/dt + ω × I ω, all in base axes.

    `felt` is the acceleration of the body's origin less that of free fall.
    """
    bodies = _six(bodies)
    mass = np.array([body.mass for body in bodies])
    com = np.stack([body.com for body in bodies])
    inertia = np.stack([body.inertia for body in bodies])
    arm = np.einsum("...bij,bj->...bi", rotation, com)
    force = mass[:, None] * (felt + np.cross(omega_rate, arm) + np.cross(omega, np.cross(omega, arm)))
    in_base = rotation @ inertia @ np.swapaxes(rotation, -1, -2)
    spin, spin_rate = (np.einsum("...bij,...bj->...bi", in_base, w) for w in (omega, omega_rate))
    return arm, force, spin_rate + np.cross(omega, spin)


def _six(bodies: RigidBody | Sequence[RigidBody]) -> Sequence[RigidBody]:
    return (bodies,) * 6 if isinstance(bodies, RigidBody) else bodies
