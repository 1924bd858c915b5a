"""Whole configurations of arrays of poses or motor positions, or poses of motor positions, where kernels need them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from stewart_pin.errors import InputError
from stewart_pin.kernels.verbs.newton import Between, NewtonSteps, Plans, Solved, solve_on_branch
from stewart_pin.typing import ArrayLike, FloatArray

UNIT = 2e-6
"""Deviation of a squared quaternion from 1: twice that of its length which the one-state verbs allow."""


@dataclass(frozen=True, eq=False)
class Starts:
    """Where Newton's method starts: at home, or beside it where home is singular as a stretched arm is.

    Attributes
    ----------
    states
        (n, size) configurations or poses to try in turn [m, rad, unit quaternions].
    targets
        (n, m) poses or motor positions there [m, rad, unit quaternions].
    """

    states: FloatArray
    targets: FloatArray


def serves(steps: NewtonSteps, state: FloatArray, target: FloatArray) -> bool:
    """Whether steps can start from a state: they stay where nothing is to be done.

    Parameters
    ----------
    steps
        Towards a target.
    state
        (n,) configuration or pose [m, rad, unit quaternions].
    target
        (m,) what it meets: pose or motor positions [m, rad, unit quaternions].

    Returns
    -------
    bool
        Whether they do.
    """
    stays = steps.double(state, target, np.zeros(1))[0]
    return bool(np.allclose(stays, state, atol=1e-6))


def configurations(
    plans: Plans, starts: Starts, targets: FloatArray, between: Between, *, threads: int = 1
) -> Solved:
    """Find the configurations, or poses, that meet targets, on the branch of where they are looked for from.

    Parameters
    ----------
    plans
        Steps towards a target.
    starts
        From where, in turn.
    targets
        (N, 7) poses or (N, nu) motor positions [m, rad, unit quaternions].
    between
        Leads from one target to another.
    threads
        Number of threads.

    Returns
    -------
    Solved
        Configurations or poses.
    """
    found: Solved | None = None
    for q, met in zip(starts.states, starts.targets, strict=True):
        left = np.arange(len(targets)) if found is None else np.flatnonzero(~found.kept)
        if found is not None and not len(left):
            break

        def begin(
            rows: np.ndarray, q: FloatArray = q, met: FloatArray = met
        ) -> tuple[FloatArray, FloatArray]:
            return np.tile(q, (len(rows), 1)), np.tile(met, (len(rows), 1))

        aims = targets if len(left) == len(targets) else targets[left]
        solved = solve_on_branch(plans, q, begin, aims, between, threads=threads)
        found = solved if found is None else found.with_rows(left, solved)
    assert found is not None
    # Where home is singular branches meet, and any of them will do.
    return found if len(starts.states) == 1 else Solved(found.states, found.closed, found.closed)


def poses_between(begin: FloatArray, end: FloatArray, share: FloatArray) -> FloatArray:
    """Go from one pose to another along a screw, as the verbs of one state do.

    Parameters
    ----------
    begin, end
        (k, 7) position and unit quaternion x y z w [m].
    share
        (k,) of the way, dimensionless.

    Returns
    -------
    numpy.ndarray
        (k, 7) poses [m, unit quaternion].
    """
    first = Rotation.from_quat(begin[:, 3:])
    turn = (first.inv() * Rotation.from_quat(end[:, 3:])).as_rotvec()
    shift = first.inv().apply(end[:, :3] - begin[:, :3])
    # log6 and exp6: with V(φ) ρ the shift of the whole way, V(s φ) s ρ is that of a share s.
    rho = np.linalg.solve(_shifts(turn), shift[..., None])
    part = (_shifts(share[:, None] * turn) @ rho)[..., 0] * share[:, None]
    turned = first * Rotation.from_rotvec(share[:, None] * turn)
    return np.hstack([begin[:, :3] + first.apply(part), turned.as_quat()])


def _shifts(turn: FloatArray) -> FloatArray:
    """Left Jacobians of rotation vectors: (k, 3, 3)."""
    angle = np.linalg.norm(turn, axis=1)
    x, y, z = turn.T
    zero = np.zeros(len(turn))
    cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    half = np.sinc(angle / (2 * np.pi))
    small = angle < 1e-3
    safe = np.where(small, 1.0, angle)
    third = np.where(small, 1 / 6 - angle**2 / 120, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) + (half**2 / 2)[:, None, None] * cross + third[:, None, None] * (cross @ cross)


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
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} must be an array of numbers, got {type(value).__name__}") from None
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
