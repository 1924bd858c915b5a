"""The platform frame of a chain: its Jacobian and the rate of it, from the joint Jacobians at the world origin."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from stewart_pin.typing import FloatArray, Tangent

if TYPE_CHECKING:
    from stewart_pin.state.chain import ClosedChain


def platform_jacobian(chain: ClosedChain, joints: FloatArray, origin: FloatArray) -> FloatArray:
    """Map tangent velocities to the platform's twist.

    Parameters
    ----------
    chain
        Closed chain.
    joints
        (6, nv) joint Jacobians at the world origin [m, rad per m or rad].
    origin
        (3,) origin of the platform frame in the world [m].

    Returns
    -------
    numpy.ndarray
        (6, nv) twist [v; ω] of the platform origin in world axes, per tangent velocity [m/s, rad/s].
    """
    columns = joints * chain.platform_support
    columns[:3] += _skew(origin).T @ columns[3:]  # v_p = v_0 + ω × p
    return columns


def platform_jacobian_rate(
    chain: ClosedChain, joints: FloatArray, joint_rates: FloatArray, origin: FloatArray, v: Tangent
) -> FloatArray:
    """Differentiate the platform Jacobian along a velocity.

    Parameters
    ----------
    chain
        Closed chain.
    joints, joint_rates
        (6, nv) joint Jacobians at the world origin, and their rates [m, rad per m or rad; per s].
    origin
        (3,) origin of the platform frame in the world [m].
    v
        (nv,) tangent velocity [m/s, rad/s].

    Returns
    -------
    numpy.ndarray
        (6, nv) rate [per s].
    """
    turning, columns = joints[3:] * chain.platform_support, joint_rates * chain.platform_support
    twist = (joints * chain.platform_support) @ v
    velocity = twist[:3] + np.cross(twist[3:], origin)
    columns[:3] += _skew(origin).T @ columns[3:] + _skew(velocity).T @ turning
    return columns


def _skew(x: FloatArray) -> FloatArray:
    a, b, c = x
    return np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]])
