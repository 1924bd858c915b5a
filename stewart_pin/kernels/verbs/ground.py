"""How a ground moves at every state of an array: what kernels take of it, in axes of the ground."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from stewart_pin.errors import InputError
from stewart_pin.kernels.verbs.configurations import with_unit_quaternions
from stewart_pin.state.base_motion import BaseMotion
from stewart_pin.typing import ArrayLike, FloatArray

GroundMotions: TypeAlias = BaseMotion | Sequence[BaseMotion] | ArrayLike
"""One motion for all states, one per state, or (N, 16) or (16,): unit quaternion xyzw, twist, acceleration."""


def read_motions(given: GroundMotions) -> tuple[FloatArray, FloatArray]:
    """Read how a ground moves.

    Parameters
    ----------
    given
        Motions [unit quaternions; m/s, rad/s; m/s², rad/s²].

    Returns
    -------
    rotation, motion : numpy.ndarray
        (..., 3, 3) axes of the ground, and (..., 12) twist and acceleration in inertial axes, of one state or of N
        [m/s, rad/s; m/s², rad/s²].

    Raises
    ------
    InputError
        If they are no motions.
    """
    if isinstance(given, BaseMotion):
        return given.rotation, np.concatenate([given.twist, given.acceleration])
    if isinstance(given, Sequence) and any(isinstance(each, BaseMotion) for each in given):
        motions = [each for each in given if isinstance(each, BaseMotion)]
        if len(motions) < len(given):
            other = next(each for each in given if not isinstance(each, BaseMotion))
            raise InputError(f"base_motion must hold a BaseMotion per state, got {type(other).__name__}")
        rotation = np.array([each.rotation for each in motions])
        return rotation, np.array([np.concatenate([each.twist, each.acceleration]) for each in motions])
    try:
        rows = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        rows = np.zeros(0)
    if rows.ndim not in (1, 2) or rows.shape[-1] != 16:
        got = f"shape {rows.shape}" if rows.size else type(given).__name__
        raise InputError(
            "base_motion must be a BaseMotion, one per state, or (N, 16) or (16,) of unit quaternion xyzw, twist and "
            f"acceleration; got {got}"
        )
    many = rows.reshape(-1, 16)
    pose = with_unit_quaternions(np.concatenate([np.zeros((len(many), 3)), many[:, :4]], axis=1))
    x, y, z, w = pose[:, 3:].T
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    rotation = np.moveaxis(rotation, 2, 0)
    return rotation.reshape(*rows.shape[:-1], 3, 3), rows[..., 4:]


def felt_by_ground(rotation: FloatArray, motion: FloatArray, gravity: FloatArray) -> FloatArray:
    """Tell what bodies feel of the motion of their ground.

    Parameters
    ----------
    rotation
        (..., 3, 3) axes of the ground in the inertial frame.
    motion
        (..., 12) twist and acceleration, inertial axes [m/s, rad/s; m/s², rad/s²].
    gravity
        (3,) acceleration of free fall, inertial axes [m/s²].

    Returns
    -------
    numpy.ndarray
        (..., 9) in axes of the ground: acceleration of its origin less that of free fall, angular velocity, angular
        acceleration [m/s², rad/s, rad/s²].
    """
    parts = motion[..., 6:9] - gravity, motion[..., 3:6], motion[..., 9:12]
    return np.concatenate([(part[..., None, :] @ rotation)[..., 0, :] for part in parts], axis=-1)


def to_ground(rotation: FloatArray, wrenches: ArrayLike, links: int) -> FloatArray:
    """Turn wrenches from inertial axes into those of the ground.

    Parameters
    ----------
    rotation
        (..., 3, 3) axes of the ground in the inertial frame.
    wrenches
        (..., 6 k) [force; moment] link by link [N, N m].
    links
        Number of links k.

    Returns
    -------
    numpy.ndarray
        (..., 6 k) [N, N m].

    Raises
    ------
    InputError
        If they have another size, or are of another number of states.
    """
    given = np.asarray(wrenches, dtype=float)
    if given.ndim not in (1, 2) or given.shape[-1] != 6 * links:
        raise InputError(f"wrenches must be (N, {6 * links}) or ({6 * links},), got shape {given.shape}")
    states = {len(x) for x, one in ((given, 1), (rotation, 2)) if x.ndim > one} - {1}
    if len(states) > 1:
        raise InputError(f"wrenches are of {len(given)} states, base_motion of {len(rotation)}")
    turned = given.reshape(*given.shape[:-1], 2 * links, 3) @ rotation
    return turned.reshape(*turned.shape[:-2], 6 * links)
