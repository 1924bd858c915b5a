"""Configurations and the limits of their joints: random ones, and ones brought into range; poses at the door."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pinocchio as pin

from stewart_pin.checks import as_array
from stewart_pin.errors import InputError
from stewart_pin.geometry.rotations import as_rotation
from stewart_pin.model.description import JointKind
from stewart_pin.state.chain import ClosedChain
from stewart_pin.tolerances import AT_LIMIT, UNIT_QUATERNION
from stewart_pin.typing import ArrayLike, BoolArray, Configuration


def clipped(chain: ClosedChain, q: Configuration) -> Configuration:
    """Move coordinates outside their limits to the middle of the range, or to the limit of a range without end.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nq,) configuration [m, rad, unit quaternions].
    """
    lower, upper = chain.model.lowerPositionLimit, chain.model.upperPositionLimit
    inside = np.clip(q, lower, upper)
    bounded = np.isfinite(lower) & np.isfinite(upper)
    middle = (np.where(bounded, lower, inside) + np.where(bounded, upper, inside)) / 2
    return np.where(inside == q, q, middle)


def random_configuration(chain: ClosedChain, rng: np.random.Generator) -> Configuration:
    """Draw every coordinate within its limits, or within a quarter turn, or 1.6 robot sizes, of neutral.

    Parameters
    ----------
    chain
        Closed chain.
    rng
        Source of randomness.

    Returns
    -------
    numpy.ndarray
        (nq,) configuration, loops open [m, rad, unit quaternions].
    """
    reach = rng.uniform(-1, 1, chain.nv) * chain.tangent_scale
    q = clipped(chain, pin.integrate(chain.model, pin.neutral(chain.model), np.pi / 2 * reach))
    lower, upper = chain.model.lowerPositionLimit, chain.model.upperPositionLimit
    bounded = np.isfinite(lower) & np.isfinite(upper)
    low, high = np.where(bounded, lower, q), np.where(bounded, upper, q)
    return low + rng.uniform(size=chain.nq) * (high - low)


def unwound(chain: ClosedChain, q: Configuration, *, asked: Collection[str] = ()) -> Configuration:
    """Take whole turns out of revolute joints: as many as bring them within half a turn of zero or into their range.

    Joints that are coupled or wind in cables keep theirs: a gear, a screw or a drum stands elsewhere after a turn.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration [m, rad, unit quaternions].
    asked
        Joints that stand where they were asked to stand.

    Returns
    -------
    numpy.ndarray
        (nq,) configuration [m, rad, unit quaternions]; joints inside their limits and within half a turn of zero stay
        where they are.
    """
    q = np.array(q)
    kept = {
        name for coupling in chain.mechanism.couplings for name in coupling.joints
    } | chain.mechanism.reels
    for joint in chain.mechanism.joints:
        if joint.kind is JointKind.REVOLUTE and joint.name not in kept and joint.name not in asked:
            at = chain.model.joints[chain.model.getJointId(joint.name)].idx_q
            turns = np.round(q[at] / (2 * np.pi)) if abs(q[at]) > np.pi else 0.0
            value = q[at] - 2 * np.pi * turns
            if value < joint.lower - AT_LIMIT:
                value += 2 * np.pi * np.ceil((joint.lower - AT_LIMIT - value) / (2 * np.pi))
            elif value > joint.upper + AT_LIMIT:
                value -= 2 * np.pi * np.ceil((value - joint.upper - AT_LIMIT) / (2 * np.pi))
            q[at] = value
    return q


def turning_motors(chain: ClosedChain) -> BoolArray:
    """Tell which motors turn so that a pose tells their positions but for whole turns.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    numpy.ndarray
        (nu,) of bool, dimensionless: revolute motors; of those that wind in cables a pose tells the turns too.
    """
    mechanism = chain.mechanism
    return np.array(
        [
            mechanism.joint(name).kind is JointKind.REVOLUTE and name not in mechanism.reels
            for name in chain.motors
        ],
        dtype=bool,
    )


def as_pose(name: str, pose: pin.SE3 | ArrayLike) -> pin.SE3:
    """Check a placement at the door.

    Parameters
    ----------
    name
        Name of the argument, for the message.
    pose
        What the caller passed: a placement, seven numbers x y z qx qy qz qw, or a matrix (4, 4) [m].

    Returns
    -------
    pinocchio.SE3
        The placement.

    Raises
    ------
    InputError
        If it is no placement, or holds no finite numbers or no rotation.
    """
    placement: pin.SE3 = pose if isinstance(pose, pin.SE3) else _placed(name, pose)
    as_array(f"{name}.translation", placement.translation, (3,))
    as_rotation(f"{name}.rotation", placement.rotation)
    return placement


def _placed(name: str, pose: ArrayLike) -> pin.SE3:
    """Make a placement of seven numbers or a matrix."""
    wanted = f"{name} must be a pinocchio.SE3, seven numbers x y z qx qy qz qw, or a matrix (4, 4)"
    try:
        numbers = np.asarray(pose, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{wanted}, got {type(pose).__name__}") from None
    if numbers.shape == (7,):
        numbers = as_array(name, numbers, (7,))
        if abs(float(np.linalg.norm(numbers[3:])) - 1.0) > UNIT_QUATERNION:
            raise InputError(
                f"{name} holds a quaternion that is not of unit length, {numbers[3:]}; divide it by its norm"
            )
        return pin.XYZQUATToSE3(np.concatenate([numbers[:3], numbers[3:] / np.linalg.norm(numbers[3:])]))
    if numbers.shape == (4, 4):
        numbers = as_array(name, numbers, (4, 4))
        if not np.array_equal(numbers[3], [0.0, 0.0, 0.0, 1.0]):
            raise InputError(f"{name} must end with the row 0 0 0 1, got {numbers[3]}")
        return pin.SE3(numbers[:3, :3], numbers[:3, 3])
    raise InputError(f"{wanted}, got an array of shape {numbers.shape}")
