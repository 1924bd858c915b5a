"""Spatial vectors in Featherstone's order, [angular; linear], in body coordinates.

References
----------
.. [1] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer, 2008, ch. 2.
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
        (3,) vector [any unit].

    Returns
    -------
    numpy.ndarray
        (3, 3) such that ``skew(a) @ b == a × b`` [any unit].
    """
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def motion_transform(rotation: FloatArray, origin: FloatArray) -> FloatArray:
    """Build the coordinate transform of motion vectors from frame A to frame B.

    Its transpose takes force vectors from B to A.

    Parameters
    ----------
    rotation
        (3, 3) axes of B in A; the transpose of E in [1]_, table 2.2.
    origin
        (3,) origin of B in A [m].

    Returns
    -------
    numpy.ndarray
        (6, 6) matrix ᴮX_A = [[E, 0], [-E r×, E]] [1 and m].
    """
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = matrix[3:, 3:] = rotation.T
    matrix[3:, :3] = -rotation.T @ skew(origin)
    return matrix


def cross_motion(velocity: FloatArray) -> FloatArray:
    """Build the spatial cross product of motion vectors.

    Parameters
    ----------
    velocity
        (6,) spatial velocity [rad/s, m/s].

    Returns
    -------
    numpy.ndarray
        (6, 6) matrix v× = [[ω×, 0], [v×, ω×]], eq. (2.31) of [1]_ [1/s, m/s]. That of force vectors, v×*, is minus its
        transpose, eq. (2.32).
    """
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = matrix[3:, 3:] = skew(velocity[:3])
    matrix[3:, :3] = skew(velocity[3:])
    return matrix


def spatial_inertia(inertia: pin.Inertia | None) -> FloatArray:
    """Express the inertia of a body in its link frame.

    Parameters
    ----------
    inertia
        Mass [kg], centre of mass [m] and inertia about it [kg m²]; None: no body.

    Returns
    -------
    numpy.ndarray
        (6, 6) matrix of eq. (2.63) of [1]_ [kg m², kg m, kg].
    """
    if inertia is None:
        return np.zeros((6, 6))
    mass, c = inertia.mass, skew(inertia.lever)
    return np.block([[inertia.inertia - mass * c @ c, mass * c], [-mass * c, mass * np.eye(3)]])
