"""The platform frame of a chain: its Jacobian, its bias, and the matrix of all motions."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from stewart_pin.closure.equations import jacobian_from_data
from stewart_pin.model.chain import ClosedChain
from stewart_pin.typing import Configuration, FloatArray, Tangent


def motion_matrix(chain: ClosedChain, q: Configuration) -> FloatArray:
    """Stack the loop Jacobian on the platform Jacobian.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nc + 6, nv) rates of the gap in loop frames 1, then twist in world axes [per m/s or rad/s].
    """
    data = pin.Data(chain.model)
    pin.computeJointJacobians(chain.model, data, q)
    pin.updateFramePlacement(chain.model, data, chain.platform_id)
    return np.vstack([jacobian_from_data(chain, data, q), platform_jacobian(chain, data)])


def platform_bias(chain: ClosedChain, q: Configuration, v: Tangent) -> FloatArray:
    """Compute the platform's acceleration that is there without tangent acceleration.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].

    Returns
    -------
    numpy.ndarray
        (6,) classical acceleration of the platform origin and angular acceleration, world axes [m/s², rad/s²].
    """
    data = pin.Data(chain.model)
    pin.forwardKinematics(chain.model, data, q, v, np.zeros(chain.nv))
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    return pin.getFrameClassicalAcceleration(chain.model, data, chain.platform_id, axes).vector


def platform_jacobian(chain: ClosedChain, data: pin.Data) -> FloatArray:
    """Map tangent velocities to the platform's twist, where the joint Jacobians have been computed.

    Parameters
    ----------
    chain
        Closed chain.
    data
        Scratch that holds the joint Jacobians and the platform's placement.

    Returns
    -------
    numpy.ndarray
        (6, nv) twist [v; ω] of the platform origin in world axes, per tangent velocity [m/s, rad/s].
    """
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    # Pinocchio hands a matrix of one column over as a vector.
    return pin.getFrameJacobian(chain.model, data, chain.platform_id, axes).reshape(6, -1)
