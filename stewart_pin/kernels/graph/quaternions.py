"""Steps on unit quaternions x, y, z, w."""

from __future__ import annotations

import casadi as ca


def product(a: ca.SX, b: ca.SX) -> ca.SX:
    """Multiply quaternions.

    Parameters
    ----------
    a, b
        (4, 1).

    Returns
    -------
    casadi.SX
        (4, 1): the rotation b, then a.
    """
    vector = a[3] * b[:3] + b[3] * a[:3] + ca.cross(a[:3], b[:3])
    return ca.vertcat(vector, a[3] * b[3] - ca.dot(a[:3], b[:3]))


def turned_by_small(quaternion: ca.SX, angle: ca.SX, *, body: bool = False) -> ca.SX:
    """Turn a quaternion by a rotation vector that is small.

    Parameters
    ----------
    quaternion
        (4, 1) of unit length.
    angle
        (3, 1) rotation vector [rad]; errors are of its third order.
    body
        Whether it stands in the turned axes.

    Returns
    -------
    casadi.SX
        (4, 1) of unit length.
    """
    small = ca.vertcat(angle / 2, 1)
    turned = product(quaternion, small) if body else product(small, quaternion)
    return turned / ca.norm_2(turned)
