r"""The spatial arm with a vertical joint and two parallel horizontal ones: velocities and Jacobians in closed form.

Frame {i} sits on joint i, z along its axis, x along the link; {4} is the tool. Joint 1 turns about z of the base, L1
leads from axis 1 to axis 2, then z turns by 90° about x: axes 2 and 3 are horizontal. At q = 0 the arm is stretched
along x of the base. c23 stands for cos(θ2 + θ3).

References
----------
.. [1] J. J. Craig, "Introduction to Robotics: Mechanics and Control", ch. 5: outward propagation of velocities.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.checks import as_batch, require_broadcast
from stewart_pin.errors import InputError
from stewart_pin.geometry.serial import as_link_lengths
from stewart_pin.typing import ArrayLike, FloatArray

_FRAMES = (3, 4)


@dataclass(frozen=True, eq=False, repr=False)
class LinkVelocities(Brief):
    """Velocities of the frames {1} to {4}, each in its own axes.

    Attributes
    ----------
    angular
        (..., 4, 3) angular velocities ⁱω_i [rad/s].
    linear
        (..., 4, 3) velocities ⁱv_i of the frame origins [m/s].
    """

    angular: FloatArray
    linear: FloatArray


def spatial_arm_velocities(lengths: ArrayLike, q: ArrayLike, rates: ArrayLike) -> LinkVelocities:
    """Propagate velocities outwards, from link to link.

    Parameters
    ----------
    lengths
        (3,) link lengths L1, L2, L3 [m].
    q
        (..., 3) joint angles [rad].
    rates
        (..., 3) joint rates [rad/s].

    Returns
    -------
    LinkVelocities
        Angular and linear velocity of every frame.

    Raises
    ------
    InputError
        If an argument has the wrong shape, is not finite, or a length is not above zero.

    Notes
    -----
    From frame i to frame i+1 at p in i, with the rotation R of i+1 in i ([1]_, ch. 5):

        ω' = Rᵀ ω + θ' z,    v' = Rᵀ (v + ω × p).
    """
    lengths, q, rates = as_link_lengths(lengths), as_batch("q", q, (3,)), as_batch("rates", rates, (3,))
    require_broadcast(q=q.shape[:-1], rates=rates.shape[:-1])
    q, rates = np.broadcast_arrays(q, rates)
    zeros = np.zeros(q.shape[:-1])
    # The tool frame follows without a joint.
    q, rates = (np.concatenate([x, zeros[..., None]], axis=-1) for x in (q, rates))
    omega, velocity = np.zeros((2, *q.shape[:-1], 3))
    angular, linear = [], []
    for i, along in enumerate((0.0, *lengths)):
        velocity = velocity + np.cross(omega, [along, 0.0, 0.0])
        if i == 1:  # from {1} to {2}, z turns by 90° about x: (x, y, z) reads (x, z, -y)
            omega, velocity = (
                np.stack([x[..., 0], x[..., 2], -x[..., 1]], axis=-1) for x in (omega, velocity)
            )
        omega, velocity = (_turned(x, q[..., i]) for x in (omega, velocity))
        omega = omega + np.stack([zeros, zeros, rates[..., i]], axis=-1)
        angular.append(omega)
        linear.append(velocity)
    return LinkVelocities(np.stack(angular, axis=-2), np.stack(linear, axis=-2))


def spatial_arm_jacobian(
    lengths: ArrayLike, q: ArrayLike, *, frame: int = 4, axes: str = "base"
) -> FloatArray:
    """Map joint rates to the twist of frame {3} or of the tool frame {4}.

    Parameters
    ----------
    lengths
        (3,) link lengths L1, L2, L3 [m].
    q
        (..., 3) joint angles [rad].
    frame
        3 or 4: whose origin.
    axes
        ``"base"``, or ``"frame"`` for the frame's own axes ({3} and {4} have the same).

    Returns
    -------
    numpy.ndarray
        (..., 6, 3) such that [v; ω] = J @ rates [m and 1].

    Raises
    ------
    InputError
        If an argument has the wrong shape or value.

    Notes
    -----
    In the tool frame, with L = L1 + L2 c2 + L3 c23:

        ⁴v = [[0, L2 s3, 0], [0, L2 c3 + L3, L3], [-L, 0, 0]] θ',    ω = [[s23, 0, 0], [c23, 0, 0], [0, 1, 1]] θ'

    and {3} is the same with L3 = 0. Printed forms that circulate have L2 c3 for the element (2, 2), a bracket misplaced
    in (3, 1), and s2 s3 + c2 c3 for s23.
    """
    lengths, q = as_link_lengths(lengths), as_batch("q", q, (3,))
    if frame not in _FRAMES:
        raise InputError(f"frame must be one of {_FRAMES}, got {frame!r}")
    if axes not in ("base", "frame"):
        raise InputError(f"axes must be 'base' or 'frame', got {axes!r}")
    one, two, three = lengths[0], lengths[1], lengths[2] if frame == 4 else 0.0
    first, second, third = np.moveaxis(q, -1, 0)
    jacobian = np.zeros((*q.shape[:-1], 6, 3))
    (c1, s1), (c2, s2), (c3, s3) = ((np.cos(x), np.sin(x)) for x in (first, second, third))
    c23, s23 = np.cos(second + third), np.sin(second + third)
    reach = one + two * c2 + three * c23
    if axes == "frame":
        jacobian[..., 0, 1] = two * s3
        jacobian[..., 1, 1] = two * c3 + three
        jacobian[..., 1, 2] = three
        jacobian[..., 2, 0] = -reach
        jacobian[..., 3, 0], jacobian[..., 4, 0] = s23, c23
        jacobian[..., 5, 1:] = 1.0
        return jacobian
    sink = two * s2 + three * s23
    jacobian[..., 0, 0], jacobian[..., 1, 0] = -s1 * reach, c1 * reach
    for k, (down, out) in ((1, (sink, two * c2 + three * c23)), (2, (three * s23, three * c23))):
        jacobian[..., 0, k], jacobian[..., 1, k], jacobian[..., 2, k] = -c1 * down, -s1 * down, out
        jacobian[..., 3, k], jacobian[..., 4, k] = s1, -c1
    jacobian[..., 5, 0] = 1.0
    return jacobian


def _turned(vector: FloatArray, angle: FloatArray) -> FloatArray:
    """Express a vector in axes turned about z."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = np.moveaxis(vector, -1, 0)
    return np.stack([c * x + s * y, c * y - s * x, z], axis=-1)
