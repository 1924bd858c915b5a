"""Spatial algebra at the world origin, for the maximal-coordinate system.

References
----------
.. [1] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer, 2008, ch. 2. His order is [angular; linear], the
   order here is Pinocchio's, [linear; angular].
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from stewart_pin.typing import FloatArray


def skew(vector: FloatArray) -> FloatArray:
    """Build the matrix of the cross product with one vector; several times faster than `numpy.cross` on so few numbers.

    Parameters
    ----------
    vector
        (3,) vector, in any unit.

    Returns
    -------
    numpy.ndarray
        (3, 3) such that ``skew(a) @ b == a × b``, in the same unit.
    """
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def spatial_inertia(inertia: pin.Inertia, rotation: FloatArray, origin: FloatArray) -> FloatArray:
    """Express a body's inertia at the world origin.

    Parameters
    ----------
    inertia
        Mass, centre of mass and inertia about it, in the link frame.
    rotation, origin
        (3, 3) and (3,) link frame in the world [m].

    Returns
    -------
    numpy.ndarray
        (6, 6) spatial inertia, world axes [kg, kg m, kg m²].
    """
    mass, c = inertia.mass, skew(origin + rotation @ inertia.lever)
    matrix = np.empty((6, 6))
    # Featherstone (2008), eq. (2.63), rows and columns in the order [linear; angular].
    matrix[:3, :3] = mass * np.eye(3)
    matrix[:3, 3:] = -mass * c
    matrix[3:, :3] = mass * c
    matrix[3:, 3:] = rotation @ inertia.inertia @ rotation.T - mass * c @ c
    return matrix


def cross_motion(twist: FloatArray, motion: FloatArray) -> FloatArray:
    """Compute the spatial cross product ``twist × motion``.

    Parameters
    ----------
    twist
        (6,) velocity of the carrier [m/s, rad/s].
    motion
        (6,) or (6, n) motion vectors carried along [any unit].

    Returns
    -------
    numpy.ndarray
        Shape of `motion`: its rate of change [per s].
    """
    v, w = skew(twist[:3]), skew(twist[3:])
    return np.concatenate([w @ motion[:3] + v @ motion[3:], w @ motion[3:]])


def cross_force(twist: FloatArray, force: FloatArray) -> FloatArray:
    """Compute the spatial cross product ``twist ×* force``.

    Parameters
    ----------
    twist
        (6,) velocity [m/s, rad/s].
    force
        (6,) force and moment about the world origin, or a momentum [N, N m].

    Returns
    -------
    numpy.ndarray
        (6,) rate of change [per s].
    """
    v, w = skew(twist[:3]), skew(twist[3:])
    return np.concatenate([w @ force[:3], w @ force[3:] + v @ force[:3]])


def force_at(point: FloatArray, force: FloatArray, moment: FloatArray) -> FloatArray:
    """Move wrenches from a point to the world origin.

    Parameters
    ----------
    point
        (3,) where the forces act [m].
    force, moment
        (3, n) forces, and moments about the point, world axes [N, N m].

    Returns
    -------
    numpy.ndarray
        (6, n) wrenches at the world origin [N, N m].
    """
    return np.vstack([force, moment + skew(point) @ force])


def motion_about(point: FloatArray, motion: FloatArray) -> FloatArray:
    """Move motion vectors from the world origin to a point.

    Parameters
    ----------
    point
        (3,) in the world [m].
    motion
        (6, n) or (6,) motions at the world origin [any unit].

    Returns
    -------
    numpy.ndarray
        Shape of `motion`: velocity of the point, and the angular part, world axes [m/s, rad/s].
    """
    return np.concatenate([motion[:3] - skew(point) @ motion[3:], motion[3:]])
