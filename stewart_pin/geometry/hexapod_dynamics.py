"""Inverse dynamics of a six-legged platform whose legs have mass, in closed form for any batch shape.

Newton and Euler, leg by leg: the balance of moments about its lower joint gives the force that a leg passes
across its own line to the platform; what is then left of the platform's balance gives the six forces along
the legs. No coordinates, no tree, no multipliers: an oracle for formulations that have them. The bodies that
it takes stand below.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array, as_batch, require_broadcast
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.geometry.hexapod import STANDARD_GRAVITY, Hexapod, leg_forces_for_wrench, leg_jacobian
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
    wrench: ArrayLike | None = None,
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
    wrench
        (..., 6) [force; moment] from outside on the platform at its origin, in base axes; default: none [N, N m].

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
    across u it gives f⊥ = (τ n - M) × u / l. The platform's balance then is Jᵀ (f·u) = load - Σ f⊥, and the
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

    load = _platform_wrench(bodies.platform, rotation, twist, acceleration, free_fall)
    if wrench is not None:
        outside = as_batch("wrench", wrench, (6,))
        require_broadcast(position=load.shape[:-1], wrench=outside.shape[:-1])
        load = load - outside
    carried = np.concatenate([transverse, np.cross(tip.arms, transverse)], axis=-1).sum(axis=-2)
    axial = leg_forces_for_wrench(leg_jacobian(hexapod, position, rotation), load - carried)
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


# ----------------------------------------------------------------------------------------------------
# Masses of a six-legged platform: what a body weighs, and which bodies a platform with legs is made of
# ----------------------------------------------------------------------------------------------------

LowerJoint = Literal["universal", "spherical"]
"""Joint between the base and a leg; see `HexapodBodies`."""

_ROUND_OFF = 1e-9
"""Part of the largest entry by which an inertia may miss symmetry or the triangle inequality: it has been
computed, rotated or printed in double precision, so it never meets either exactly."""


@dataclass(frozen=True, eq=False, repr=False)
class RigidBody(Brief):
    """Mass distribution of a rigid body.

    Attributes
    ----------
    mass
        Mass, zero allowed [kg].
    com
        (3,) centre of mass in the body frame [m].
    inertia
        (3, 3) moments of inertia about the centre of mass, along the axes of the body frame [kg m²].

    Raises
    ------
    InputError
        If no distribution of positive mass has these values.

    Notes
    -----
    The principal moments of a body, sorted, obey 0 <= I₁ and I₃ <= I₁ + I₂. Both are one condition on the
    second moments S = tr(I)/2 - I: S is positive semidefinite.
    """

    mass: float
    com: FloatArray
    inertia: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", _as_mass(self.mass))
        com, inertia = as_array("com", self.com, (3,)).copy(), _as_inertia(self.inertia)
        for name, array in (("com", com), ("inertia", inertia)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def is_axisymmetric(self) -> bool:
        """Tell whether a turn about the z axis of the body frame changes nothing.

        Returns
        -------
        bool
            True if the centre of mass lies on that axis, Ixx = Iyy, and no product of inertia is left, all
            within round-off.
        """
        off_axis = self.mass * np.abs(self.com[:2]).max() > _ROUND_OFF * self.mass * np.abs(self.com).max()
        uneven = abs(self.inertia[0, 0] - self.inertia[1, 1])
        products = np.abs(self.inertia[[0, 0, 1], [1, 2, 2]]).max()
        return not off_axis and bool(max(uneven, products) <= _ROUND_OFF * np.abs(self.inertia).max())


@dataclass(frozen=True, eq=False, repr=False)
class HexapodBodies(Brief):
    """Bodies of a six-legged platform.

    The leg frame has z along the leg, from base to platform, and y square to the leg and to the first axis of
    its lower joint. With this axis along base x its attitude in the base frame is Rx(α) Ry(β), with cos β > 0:
    that is how a universal joint with its second axis along leg y turns the leg.

    Attributes
    ----------
    platform
        In the platform frame.
    lower
        Cylinder, the part of a leg that is joined to the base: in the leg frame at the base point. One for
        all legs, or six; kept as six.
    upper
        Rod, the part of a leg that is joined to the platform by a ball: in the leg frame at the platform
        point, so its centre of mass has a negative z. One for all legs, or six; kept as six.
    lower_joint
        "universal" transmits a torque about the normal of its two axes, so a leg cannot spin freely;
        "spherical" transmits none, so it can.
    first_axes
        (3,) or (6, 3) direction of the first axes of the lower joints, which stand in the base, in the base frame;
        kept as six unit vectors, dimensionless. Of spherical joints it only names the leg frame.

    Raises
    ------
    InputError
        If a body is no `RigidBody`, legs are not six, the joint is unknown, or an axis has no direction.
    """

    platform: RigidBody
    lower: RigidBody | tuple[RigidBody, ...]
    upper: RigidBody | tuple[RigidBody, ...]
    lower_joint: LowerJoint = "universal"
    first_axes: ArrayLike = (1.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not isinstance(self.platform, RigidBody):
            raise InputError(f"platform must be a RigidBody, got {type(self.platform).__name__}")
        for name in ("lower", "upper"):
            object.__setattr__(self, name, _as_six(name, getattr(self, name)))
        if self.lower_joint not in get_args(LowerJoint):
            raise InputError(f"lower_joint must be 'universal' or 'spherical', got {self.lower_joint!r}")
        object.__setattr__(self, "first_axes", _as_axes(self.first_axes))


def _as_mass(value: float) -> float:
    mass = float(as_array("mass", value, ()))
    if mass < 0.0:
        raise InputError(f"mass must not be negative, got {mass:g} kg")
    return mass


def _as_inertia(value: ArrayLike) -> FloatArray:
    inertia = as_array("inertia", value, (3, 3))
    scale = np.abs(inertia).max()
    if np.abs(inertia - inertia.T).max() > _ROUND_OFF * scale:
        raise InputError(f"inertia must be symmetric, got {inertia.tolist()}")
    inertia = (inertia + inertia.T) / 2
    first, second, third = np.linalg.eigvalsh(inertia)
    if first < -_ROUND_OFF * scale:
        raise InputError(f"inertia must be positive semidefinite, got a principal moment {first:.6g} kg m²")
    if third - first - second > _ROUND_OFF * scale:
        raise InputError(
            f"inertia breaks the triangle inequality: principal moment {third:.6g} kg m² exceeds "
            f"{first:.6g} + {second:.6g}; give moments about the centre of mass"
        )
    return inertia


def _as_axes(value: ArrayLike) -> FloatArray:
    axes = np.asarray(value, dtype=float)
    axes = np.broadcast_to(as_array("first_axes", value, (6, 3) if axes.ndim == 2 else (3,)), (6, 3))
    sizes = np.linalg.norm(axes, axis=1, keepdims=True)
    if not sizes.all():
        raise InputError("first_axes must be directions, got one of length zero")
    axes = axes / sizes
    axes.setflags(write=False)
    return axes


def _as_six(name: str, value: RigidBody | tuple[RigidBody, ...]) -> tuple[RigidBody, ...]:
    if isinstance(value, RigidBody):
        return (value,) * 6
    try:
        bodies = tuple(value)
    except TypeError:
        raise InputError(f"{name} must be one RigidBody or six, got {type(value).__name__}") from None
    if len(bodies) != 6 or not all(isinstance(body, RigidBody) for body in bodies):
        listed = ", ".join(type(body).__name__ for body in bodies[:7])
        raise InputError(f"{name} must be one RigidBody or six, got {len(bodies)}: {listed}")
    return bodies
