"""Vectors, rotations and rigid-body inertia on CasADi expressions.

Everything is a (3, 1) or (3, 3) `casadi.SX`. CasADi drops products with 0 and 1 while it builds, so that axes and
placements which are aligned cost nothing. `shared` makes functions of the expressions.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from stewart_pin.typing import ArrayLike, FloatArray

_ROUND_OFF = 1e-15
"""Entries of constants this near to 0, 1 or -1, where 1 is the largest entry of a rotation, are meant to be those."""


def constant(values: ArrayLike | ca.SX) -> ca.SX:
    """Turn an array into an expression without inputs.

    Parameters
    ----------
    values
        (n,) or (m, n) numbers, any unit; expressions stay what they are.

    Returns
    -------
    casadi.SX
        (n, 1) or (m, n).
    """
    if isinstance(values, ca.SX):
        return values
    return ca.SX(ca.DM(np.asarray(values, dtype=float)))


def rotation_constant(rotation: ArrayLike | ca.SX) -> ca.SX:
    """Turn a rotation into an expression, with round-off beside 0 and ±1 removed.

    Parameters
    ----------
    rotation
        (3, 3) rotation; expressions stay what they are.

    Returns
    -------
    casadi.SX
        (3, 3).
    """
    if isinstance(rotation, ca.SX):
        return rotation
    rotation = np.array(rotation, dtype=float)
    nearest = np.round(rotation)
    return constant(np.where(np.abs(rotation - nearest) < _ROUND_OFF, nearest, rotation))


def signed_permutation(rotation: ArrayLike | ca.SX) -> bool:
    """Tell whether a rotation only swaps axes, so that applying it costs nothing.

    Parameters
    ----------
    rotation
        (3, 3) rotation.

    Returns
    -------
    bool
        Whether every entry is 0 or ±1, to round-off; expressions are not.
    """
    if isinstance(rotation, ca.SX):
        return False
    rotation = np.asarray(rotation, dtype=float)
    return bool((np.abs(rotation - np.round(rotation)) < _ROUND_OFF).all())


def skew(vector: ca.SX) -> ca.SX:
    """Build the matrix of a cross product.

    Parameters
    ----------
    vector
        (3, 1).

    Returns
    -------
    casadi.SX
        (3, 3) with ``skew(a) @ b = a × b``.
    """
    x, y, z = ca.vertsplit(vector)
    return ca.vertcat(ca.horzcat(0, -z, y), ca.horzcat(z, 0, -x), ca.horzcat(-y, x, 0))


def turn_about(axis: ArrayLike, cosine: ca.SX, sine: ca.SX) -> ca.SX:
    """Rotate about a constant axis.

    Parameters
    ----------
    axis
        (3,) unit vector.
    cosine, sine
        Of the angle.

    Returns
    -------
    casadi.SX
        (3, 3) from the turned axes to the fixed ones.
    """
    n = np.asarray(axis, dtype=float)
    along = np.outer(n, n)
    return constant(along) + cosine * constant(np.eye(3) - along) + sine * skew(constant(n))


def turn_from_quaternion(quaternion: ca.SX) -> ca.SX:
    """Rotate by a unit quaternion.

    Parameters
    ----------
    quaternion
        (4, 1) x, y, z, w of unit length.

    Returns
    -------
    casadi.SX
        (3, 3) from the turned axes to the fixed ones.
    """
    x, y, z, w = ca.vertsplit(quaternion)
    x2, y2, z2 = x + x, y + y, z + z
    xx, yy, zz = x * x2, y * y2, z * z2
    xy, xz, yz = x * y2, x * z2, y * z2
    wx, wy, wz = w * x2, w * y2, w * z2
    return ca.vertcat(
        ca.horzcat(1 - (yy + zz), xy - wz, xz + wy),
        ca.horzcat(xy + wz, 1 - (xx + zz), yz - wx),
        ca.horzcat(xz - wy, yz + wx, 1 - (xx + yy)),
    )


def turning_matrix(omega: ca.SX, omega_rate: ca.SX) -> ca.SX:
    """Build the matrix of a turning body's accelerations.

    Parameters
    ----------
    omega
        (3, 1) angular velocity [rad/s].
    omega_rate
        (3, 1) angular acceleration [rad/s²].

    Returns
    -------
    casadi.SX
        (3, 3) B with ``B @ p = dω/dt × p + ω × (ω × p)`` [1/s²].
    """
    wx, wy, wz = ca.vertsplit(omega)
    ax, ay, az = ca.vertsplit(omega_rate)
    xx, yy, zz = wx * wx, wy * wy, wz * wz
    xy, xz, yz = wx * wy, wx * wz, wy * wz
    return ca.vertcat(
        ca.horzcat(-(yy + zz), xy - az, xz + ay),
        ca.horzcat(xy + az, -(xx + zz), yz - ax),
        ca.horzcat(xz - ay, yz + ax, -(xx + yy)),
    )


@dataclass(frozen=True, eq=False)
class Masses:
    """Mass, first and second moments of a rigid body about the origin of its frame.

    Attributes
    ----------
    mass
        Mass [kg].
    first
        (3,) mass times centre of mass [kg m].
    second
        (3, 3) sum of ``mass * p pᵀ`` over the particles [kg m²].
    """

    mass: float
    first: np.ndarray
    second: np.ndarray

    @property
    def empty(self) -> bool:
        """Whether nothing has mass."""
        return self.mass == 0.0 and not self.second.any()

    def seen_from(self, rotation: FloatArray, translation: FloatArray) -> Masses:
        """Take moments about another frame.

        Parameters
        ----------
        rotation
            (3, 3) rotation of that frame in this one.
        translation
            (3,) its origin in this one [m].

        Returns
        -------
        Masses
            Of the same body.
        """
        first = self.first - self.mass * translation
        second = self.second - np.outer(first, translation) - np.outer(translation, self.first)
        return Masses(self.mass, rotation.T @ first, rotation.T @ second @ rotation)


def inertial_force(masses: Masses, acceleration: ca.SX, turning: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Compute the wrench that moves a body, but for the `couple` of its second moments.

    With B the matrix of the accelerations, particles at p accelerate by a + B p, so that
    ``f = m a + B s`` and ``n = s × a + Σ m p × (B p)``; the last sum is the couple.

    Parameters
    ----------
    masses
        Of the body.
    acceleration
        (3, 1) of its frame's origin, less that of free fall, in its axes [m/s²].
    turning
        (3, 3) `turning_matrix` in its axes [1/s²].

    Returns
    -------
    force : casadi.SX
        (3, 1) in its axes [N].
    moment : casadi.SX
        (3, 1) about the origin of its frame, in its axes, without the couple [N m].
    """
    first = constant(masses.first)
    return masses.mass * acceleration + turning @ first, ca.cross(first, acceleration)


def couple(turning: ca.SX, second: ca.SX) -> ca.SX:
    """Compute the moment that turns masses about the origin of their frame.

    Parameters
    ----------
    turning
        (3, 3) `turning_matrix` [1/s²].
    second
        (3, 3) second moments [kg m²].

    Returns
    -------
    casadi.SX
        (3, 1) sum of ``m p × (B p)``: twice the antisymmetric part of B times the second moments [N m].
    """
    product = turning @ second
    return ca.vertcat(
        product[2, 1] - product[1, 2], product[0, 2] - product[2, 0], product[1, 0] - product[0, 1]
    )


# ----------------------------------------------------------------------------------------------------
# From expressions to functions
# ----------------------------------------------------------------------------------------------------


def shared(name: str, inputs: dict[str, ca.SX], outputs: dict[str, ca.SX]) -> ca.Function:
    """Make a function, in which equal expressions are computed once.

    Parameters
    ----------
    name
        Of the function.
    inputs, outputs
        By name, in order.

    Returns
    -------
    casadi.Function
        The function.
    """
    results = ca.cse(list(outputs.values()))
    return ca.Function(name, list(inputs.values()), results, list(inputs), list(outputs))
