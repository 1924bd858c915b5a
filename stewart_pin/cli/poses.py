"""The pose that a command is asked for, and the same in words."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from stewart_pin.cli.output import parse_numbers
from stewart_pin.geometry.rotations import rotation_from_rpy, rpy_from_rotation
from stewart_pin.mechanics.kinematics import inverse_kinematics
from stewart_pin.state.chain import ClosedChain


def configuration_of(chain: ClosedChain, pose: str | None, limits: bool) -> np.ndarray:
    """Find the configuration of a pose.

    Parameters
    ----------
    chain
        Closed chain.
    pose
        ``x,y,z,roll,pitch,yaw``, or None for home.
    limits
        Whether joint limits must hold.

    Returns
    -------
    numpy.ndarray
        (nq,) configuration [m, rad, unit quaternions].

    Raises
    ------
    InputError
        If the text holds no six numbers.
    """
    if pose is None:
        return chain.q_home
    x, y, z, roll, pitch, yaw = parse_numbers("--pose", pose, 6)
    target = pin.SE3(rotation_from_rpy(roll, pitch, yaw), np.array([x, y, z]))
    return inverse_kinematics(chain, target, limits=limits).q


def describe_pose(pose: pin.SE3) -> dict[str, float]:
    """Write a pose as six numbers.

    Parameters
    ----------
    pose
        Platform frame in the world.

    Returns
    -------
    dict
        x, y, z [m], roll, pitch, yaw [rad].
    """
    values = [*pose.translation, *rpy_from_rotation(pose.rotation)]
    return {k: float(v) for k, v in zip(("x", "y", "z", "roll", "pitch", "yaw"), values, strict=True)}
