"""Motion of the legs of a six-legged platform: rates and accelerations of length, direction and spin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stewart_pin.checks import as_batch, require_broadcast
from stewart_pin.errors import SingularityError
from stewart_pin.geometry.hexapod import Hexapod, leg_jacobian, leg_vectors
from stewart_pin.typing import ArrayLike, FloatArray

_GIMBAL_LOCK = 1e-12
"""Cosine of β below which a leg counts as lying along the first axis of its joint: its spin rate grows with the
inverse."""


@dataclass(frozen=True, eq=False)
class TipMotion:
    """Motion of the upper leg ends as points of the platform.

    Attributes
    ----------
    arms
        (..., 6, 3) from platform origin to platform point, in the base frame [m].
    direction
        (..., 6, 3) unit vectors u along the legs, from base to platform, in the base frame.
    length
        (..., 6) leg lengths l [m].
    acceleration
        (..., 6, 3) of the platform points, in base axes [m/s²].
    rate
        (..., 6) dl/dt [m/s].
    swing
        (..., 6, 3) du/dt, in base axes [1/s].
    """

    arms: FloatArray
    direction: FloatArray
    length: FloatArray
    acceleration: FloatArray
    rate: FloatArray
    swing: FloatArray


@dataclass(frozen=True, eq=False)
class LegAttitude:
    """Attitude of the legs, turned by α about a first axis of the base and by β about leg y, and how it changes.

    Attributes
    ----------
    rotation
        (..., 6, 3, 3) leg axes in the base frame; z is the direction of the leg.
    first
        (6, 3) unit vectors of the first axes, which stand in the base, in the base frame.
    normal
        (..., 6, 3) unit vectors normal to both axes of the universal joint, in the base frame.
    tilt_cosine
        (..., 6) cos β, from the normal to the leg.
    angular_velocity
        (..., 6, 3) in base axes [rad/s].
    angular_acceleration
        (..., 6, 3) in base axes [rad/s²].
    """

    rotation: FloatArray
    first: FloatArray
    normal: FloatArray
    tilt_cosine: FloatArray
    angular_velocity: FloatArray
    angular_acceleration: FloatArray


def leg_rates(hexapod: Hexapod, position: ArrayLike, rotation: ArrayLike, twist: ArrayLike) -> FloatArray:
    """Compute the rates of the leg lengths: dl/dt = u · (v + ω × R P).

    Parameters
    ----------
    hexapod
        Geometry.
    position
        (..., 3) platform origin in the base frame [m].
    rotation
        (..., 3, 3) platform axes in the base frame.
    twist
        (..., 6) [v; ω] of the platform origin, in base axes [m/s, rad/s].

    Returns
    -------
    numpy.ndarray
        (..., 6) rates, positive as a leg grows [m/s].

    Raises
    ------
    InputError
        If an argument has the wrong shape or is not finite.
    SingularityError
        If a leg has no length.
    """
    jacobian = leg_jacobian(hexapod, position, rotation)
    twist = as_batch("twist", twist, (6,))
    require_broadcast(pose=jacobian.shape[:-2], twist=twist.shape[:-1])
    return np.einsum("...ij,...j->...i", jacobian, twist)


def leg_accelerations(
    hexapod: Hexapod, position: ArrayLike, rotation: ArrayLike, twist: ArrayLike, acceleration: ArrayLike
) -> FloatArray:
    """Compute the second derivatives of the leg lengths: ``d²l/dt² = u · a + l |du/dt|²``.

    Here a is the acceleration of the platform point.

    Parameters
    ----------
    hexapod
        Geometry.
    position
        (..., 3) platform origin in the base frame [m].
    rotation
        (..., 3, 3) platform axes in the base frame.
    twist
        (..., 6) [v; ω] of the platform origin, in base axes [m/s, rad/s].
    acceleration
        (..., 6) [dv/dt; dω/dt] of the platform origin, in base axes [m/s², rad/s²].

    Returns
    -------
    numpy.ndarray
        (..., 6) accelerations, positive as the rate grows [m/s²].

    Raises
    ------
    InputError
        If an argument has the wrong shape or is not finite.
    SingularityError
        If a leg has no length.
    """
    tip = tip_motion(hexapod, position, rotation, twist, acceleration)
    return dot(tip.direction, tip.acceleration) + tip.length * dot(tip.swing, tip.swing)


def tip_motion(
    hexapod: Hexapod, position: ArrayLike, rotation: ArrayLike, twist: ArrayLike, acceleration: ArrayLike
) -> TipMotion:
    """Compute how the upper leg ends move with the platform.

    Parameters
    ----------
    hexapod
        Geometry.
    position
        (..., 3) platform origin in the base frame [m].
    rotation
        (..., 3, 3) platform axes in the base frame.
    twist
        (..., 6) [v; ω] of the platform origin, in base axes [m/s, rad/s].
    acceleration
        (..., 6) [dv/dt; dω/dt] of the platform origin, in base axes [m/s², rad/s²].

    Returns
    -------
    TipMotion
        Lengths, directions and their derivatives.
    """
    legs, arms = leg_vectors(hexapod, position, rotation)
    u = leg_jacobian(hexapod, position, rotation)[..., :3]
    twist, acceleration = as_batch("twist", twist, (6,)), as_batch("acceleration", acceleration, (6,))
    require_broadcast(pose=u.shape[:-2], twist=twist.shape[:-1], acceleration=acceleration.shape[:-1])
    linear, omega = twist[..., None, :3], twist[..., None, 3:]
    swept = np.cross(omega, arms)
    tip_velocity = linear + swept
    tip_acceleration = (
        acceleration[..., None, :3] + np.cross(acceleration[..., None, 3:], arms) + np.cross(omega, swept)
    )
    length, rate = dot(legs, u), dot(u, tip_velocity)
    swing = (tip_velocity - rate[..., None] * u) / length[..., None]
    return TipMotion(arms, u, length, tip_acceleration, rate, swing)


def leg_attitude(tip: TipMotion, first: FloatArray) -> LegAttitude:
    """Compute the attitude of legs on universal joints.

    Parameters
    ----------
    tip
        Motion of the leg directions.
    first
        (6, 3) unit vectors x of the first axes, in the base frame.

    Returns
    -------
    LegAttitude
        Rotation of each leg, with its derivatives.

    Raises
    ------
    SingularityError
        If a leg lies along the first axis of its joint: gimbal lock.

    Notes
    -----
    The direction u fixes the angular velocity up to a spin s about the leg, ω = u × u̇ + s u. The joint fixes
    s: it lets the leg turn only about its first axis x and leg y, so ω·n = 0 for their normal n, which gives
    s = -(u × u̇)·n / cos β. One derivative later, with ω = α̇ x + β̇ y and dy/dt = α̇ x × y = α̇ n, the condition
    reads ω̇·n = α̇ β̇.
    """
    u, swing = tip.direction, tip.swing
    # cos β is the smallest singular value of the map from (α̇, β̇) to du/dt.
    across_first = u - dot(u, first)[..., None] * first
    tilt_cosine = np.linalg.norm(across_first, axis=-1)
    _require_no_gimbal_lock(tilt_cosine)
    normal = across_first / tilt_cosine[..., None]
    y = np.cross(normal, first)
    rotation = np.stack([np.cross(y, u), y, u], axis=-1)

    across = np.cross(u, swing)
    spin = -dot(across, normal) / tilt_cosine
    omega = across + spin[..., None] * u
    # u × d²u/dt², from the second derivative of l u = tip - base.
    bend = np.cross(u, tip.acceleration - 2 * tip.rate[..., None] * swing) / tip.length[..., None]
    turned = dot(omega, first) * dot(omega, y)
    spin_rate = (turned - dot(bend, normal) - spin * dot(swing, normal)) / tilt_cosine
    omega_rate = bend + spin_rate[..., None] * u + spin[..., None] * swing
    return LegAttitude(rotation, first, normal, tilt_cosine, omega, omega_rate)


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Multiply vectors along the last axis.

    Parameters
    ----------
    a, b
        (..., 3) vectors in one frame, in any unit.

    Returns
    -------
    numpy.ndarray
        (...) scalar products, dimensionless if both vectors are.
    """
    return np.einsum("...i,...i->...", a, b)


def _require_no_gimbal_lock(tilt_cosine: FloatArray) -> None:
    locked = np.argwhere(tilt_cosine < _GIMBAL_LOCK)
    if locked.size:
        cosine, leg = float(tilt_cosine[tuple(locked[0])]), int(locked[0][-1]) + 1
        raise SingularityError(
            f"leg {leg} lies along the first axis of its lower joint: gimbal lock "
            f"(cos β = {cosine:.3g}), its spin is undefined; move the platform",
            smallest_singular_value=cosine,
            direction=np.array([1.0, 0.0]),
            names=(f"leg {leg} α", f"leg {leg} β"),
        )
