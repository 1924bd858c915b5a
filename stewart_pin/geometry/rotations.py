"""Rotations in the conventions of the package: R = Rz(yaw) Ry(pitch) Rx(roll)."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from stewart_pin.checks import as_batch
from stewart_pin.errors import InputError
from stewart_pin.typing import ArrayLike, FloatArray

_IDENTITY = np.eye(3)
_ORTHOGONALITY = 1e-8
"""Largest entry of RᵀR - 1 that still counts as round-off of a rotation built in double precision."""


def rotation_from_rpy(roll: ArrayLike, pitch: ArrayLike, yaw: ArrayLike) -> FloatArray:
    """Build R = Rz(yaw) Ry(pitch) Rx(roll).

    Parameters
    ----------
    roll, pitch, yaw
        Angles about the fixed x, y and z axes, broadcast against each other [rad].

    Returns
    -------
    numpy.ndarray
        (..., 3, 3) columns are the axes of the turned frame, in the fixed frame.

    Examples
    --------
    >>> rotation_from_rpy(0.0, 0.0, np.pi / 2).round(6) @ [1.0, 0.0, 0.0]
    array([0., 1., 0.])
    """
    roll, pitch, yaw = (as_batch(n, a, ()) for n, a in (("roll", roll), ("pitch", pitch), ("yaw", yaw)))
    angles = np.stack(np.broadcast_arrays(yaw, pitch, roll), axis=-1)
    flat = Rotation.from_euler("ZYX", angles.reshape(-1, 3)).as_matrix()
    return flat.reshape(*angles.shape[:-1], 3, 3)


def rpy_from_rotation(rotation: ArrayLike) -> FloatArray:
    """Recover roll, pitch and yaw.

    Parameters
    ----------
    rotation
        (..., 3, 3) rotation matrices.

    Returns
    -------
    numpy.ndarray
        (..., 3) roll, pitch, yaw with pitch in [-π/2, π/2] [rad]. At ±π/2 only yaw -+ roll is determined.
    """
    r = as_rotation("rotation", rotation)
    # Roll is measured after yaw is taken out, so that the three give back the rotation at gimbal lock too, where the
    # two entries that define yaw are noise.
    yaw = np.arctan2(r[..., 1, 0], r[..., 0, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    pitch = np.arctan2(-r[..., 2, 0], c * r[..., 0, 0] + s * r[..., 1, 0])
    roll = np.arctan2(s * r[..., 0, 2] - c * r[..., 1, 2], c * r[..., 1, 1] - s * r[..., 0, 1])
    return np.stack([roll, pitch, yaw], axis=-1)


def skew(vector: FloatArray) -> FloatArray:
    """Build the matrix of the cross product, ``skew(a) @ b == a × b``.

    Parameters
    ----------
    vector
        (..., 3) vectors, in any unit.

    Returns
    -------
    numpy.ndarray
        (..., 3, 3) skew-symmetric matrices, in the same unit.
    """
    matrix = np.zeros((*vector.shape[:-1], 3, 3))
    x, y, z = np.moveaxis(vector, -1, 0)
    matrix[..., 0, 1], matrix[..., 0, 2], matrix[..., 1, 2] = -z, y, -x
    matrix[..., 1, 0], matrix[..., 2, 0], matrix[..., 2, 1] = z, -y, x
    return matrix


def as_rotation(name: str, value: ArrayLike) -> FloatArray:
    """Check that an array holds rotation matrices.

    Parameters
    ----------
    name
        Name of the argument, for the message.
    value
        (..., 3, 3) what the caller passed as rotation matrices.

    Returns
    -------
    numpy.ndarray
        (..., 3, 3) rotation matrices as float64.

    Raises
    ------
    InputError
        If the shape is wrong, or a matrix is not orthogonal with determinant +1.
    """
    rotation = as_batch(name, value, (3, 3))
    error = np.abs(rotation.swapaxes(-1, -2) @ rotation - _IDENTITY).max(initial=0.0)
    if error > _ORTHOGONALITY:
        raise InputError(f"{name} must hold rotation matrices; RᵀR differs from the identity by {error:.2g}")
    if (np.linalg.det(rotation) < 0).any():
        raise InputError(f"{name} must hold rotation matrices; a determinant is -1 (a reflection)")
    return rotation
