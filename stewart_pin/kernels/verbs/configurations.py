"""Whole configurations of arrays of poses or motor positions, or poses of motor positions, where kernels need them."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from stewart_pin.errors import InputError
from stewart_pin.kernels.verbs.newton import NewtonSteps, Solved, damped_newton
from stewart_pin.typing import ArrayLike, FloatArray

UNIT = 2e-6
"""Deviation of a squared quaternion from 1: twice that of its length which the one-state verbs allow."""


def starts(steps: NewtonSteps, home: FloatArray, target: FloatArray, beside: FloatArray) -> FloatArray:
    """Choose where Newton's method starts: at home, or beside it where home is singular as a stretched arm is.

    Parameters
    ----------
    steps
        Towards a target.
    home
        (n,) state at home: configuration or pose [m, rad, unit quaternions].
    target
        (m,) what it meets: pose or motor positions [m, rad, unit quaternions].
    beside
        (samples, n) states around home [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (1 or samples, n) states to try in turn [m, rad, unit quaternions].
    """
    stays = steps.double(home, target)[0]
    return home[None] if np.allclose(stays, home, atol=1e-6) else beside


def configurations(steps: NewtonSteps, begin: FloatArray, targets: FloatArray, *, threads: int = 1) -> Solved:
    """Find the configurations, or poses, that meet targets.

    Parameters
    ----------
    steps
        Towards a target.
    begin
        (n, size) configurations or poses to try in turn [m, rad, unit quaternions].
    targets
        (N, 7) poses or (N, nu) motor positions [m, rad, unit quaternions].
    threads
        Number of threads.

    Returns
    -------
    Solved
        Configurations or poses.
    """
    found: Solved | None = None
    for q in begin:
        left = np.arange(len(targets)) if found is None else np.flatnonzero(~found.closed)
        solved = damped_newton(steps, np.broadcast_to(q, (len(left), len(q))), targets[left], threads=threads)
        found = solved if found is None else found.with_rows(left, solved)
    assert found is not None
    return found


def as_rows(name: str, value: ArrayLike, size: int) -> tuple[FloatArray, bool]:
    """Read states that may hold nan, which becomes a code.

    Parameters
    ----------
    name
        Name of the argument, for the message.
    value
        (N, size) or (size,) [any unit].
    size
        Entries of a state.

    Returns
    -------
    rows : numpy.ndarray
        (N, size) or (1, size) [any unit].
    single : bool
        Whether there was no axis of states.

    Raises
    ------
    InputError
        If the shape is wrong.
    """
    array = np.asarray(value, dtype=float)
    if array.ndim not in (1, 2) or array.shape[-1] != size:
        raise InputError(f"{name} must have shape (N, {size}) or ({size},), got {array.shape}")
    return np.atleast_2d(array), array.ndim == 1


def with_unit_quaternions(poses: FloatArray) -> FloatArray:
    """Strike out poses whose quaternion is not of unit length.

    Parameters
    ----------
    poses
        (N, 7) position and quaternion [m, dimensionless].

    Returns
    -------
    numpy.ndarray
        (N, 7) with nan for these [m, unit quaternion].
    """
    square = np.einsum("ni,ni->n", poses[:, 3:], poses[:, 3:])
    unit = np.abs(square - 1) <= UNIT
    if unit.all():
        return poses
    return np.where(unit[:, None], poses, np.nan)


def normalised(poses: FloatArray) -> FloatArray:
    """Give quaternions unit length; none has no direction, and becomes nan.

    Parameters
    ----------
    poses
        (N, 7) position and quaternion [m, dimensionless].

    Returns
    -------
    numpy.ndarray
        (N, 7) position and unit quaternion [m, unit quaternion].
    """
    length = np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    return np.hstack([poses[:, :3], poses[:, 3:] / np.where(length > 0, length, np.nan)])


def as_poses(position: FloatArray, rotation: FloatArray) -> FloatArray:
    """Join positions and rotations.

    Parameters
    ----------
    position
        (N, 3) [m].
    rotation
        (N, 3, 3) rotations; nan stays nan.

    Returns
    -------
    numpy.ndarray
        (N, 7) position and quaternion x y z w [m, unit quaternion].
    """
    found = np.full((len(rotation), 4), np.nan)
    good = np.isfinite(rotation).all(axis=(1, 2))
    if good.any():
        found[good] = Rotation.from_matrix(rotation[good]).as_quat()
    return np.hstack([position, found])
