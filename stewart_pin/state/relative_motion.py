"""Motion of a loop's frame 2 relative to its frame 1, with derivatives, at the origin of frame 1 and in its axes.

The relative placement 1M2 has translation t and rotation R; V and A are the spatial velocity and acceleration of
frame 2 relative to body 1. Along a displacement δ of frame 2 relative to frame 1, d(X V2) = δ × (X V2) + X dV2 with X
the action of 1M2. The derivatives of the joints' own velocities and accelerations are Pinocchio's analytical ones.
The Jacobian of the platform frame, and its rate, stand below.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from stewart_pin.state.cable_paths import CablePaths, cable_paths
from stewart_pin.typing import FloatArray, Tangent

if TYPE_CHECKING:
    from stewart_pin.state.chain import ClosedChain

_LOCAL = pin.ReferenceFrame.LOCAL


class LoopEnds:
    """Both frames of a loop at one configuration.

    Parameters
    ----------
    chain
        Closed chain.
    data
        Scratch that holds joint placements and Jacobians.
    k
        Number of the loop.
    """

    def __init__(self, chain: ClosedChain, data: pin.Data, k: int) -> None:
        table = chain.loop_table
        self.joint1, self.joint2 = table.joint1[k], table.joint2[k]
        self.frame1 = pin.SE3(table.rotation1[k], table.translation1[k])
        self.frame2 = pin.SE3(table.rotation2[k], table.translation2[k])
        self.placement = (data.oMi[self.joint1] * self.frame1).actInv(data.oMi[self.joint2] * self.frame2)
        self.t, self.rotation = np.array(self.placement.translation), np.array(self.placement.rotation)
        self.action = self.placement.toActionMatrix()
        self.jacobian1 = _local_jacobian(chain, data, self.joint1, self.frame1)
        self.jacobian2 = _local_jacobian(chain, data, self.joint2, self.frame2)

    def displacement(self) -> FloatArray:
        """Differentiate the placement 1M2.

        Returns
        -------
        numpy.ndarray
            (6, nv) spatial displacement of frame 2 relative to frame 1, in frame 1, per tangent entry [m, rad].
        """
        return self.action @ self.jacobian2 - self.jacobian1

    def moved(self, delta: FloatArray) -> FloatArray:
        """Differentiate the translation of 1M2.

        Parameters
        ----------
        delta
            (6, nv) what `displacement` gives [m, rad].

        Returns
        -------
        numpy.ndarray
            (3, nv) change of t, in frame 1, per tangent entry [m].
        """
        return delta[:3] + cross(delta[3:], self.t)


def _local_jacobian(chain: ClosedChain, data: pin.Data, joint: int, frame: pin.SE3) -> FloatArray:
    if joint == 0:
        return np.zeros((6, chain.nv))
    local = np.reshape(pin.getJointJacobian(chain.model, data, joint, _LOCAL), (6, chain.nv))
    return frame.inverse().toActionMatrix() @ local


@dataclass(frozen=True, eq=False)
class RelativeMotion:
    """Relative motion of a loop's frames.

    Attributes
    ----------
    t
        (3,) translation of 1M2 [m].
    rotation
        (3, 3) rotation of 1M2.
    V, A
        (6,) spatial velocity and acceleration [m/s, rad/s; m/s², rad/s²].
    delta
        (6, nv) displacement per tangent entry [m, rad].
    V_q, A_q, A_v
        (6, nv) derivatives [units of V and A per m or rad, of A per m/s or rad/s].
    """

    t: FloatArray
    rotation: FloatArray
    V: FloatArray
    A: FloatArray
    delta: FloatArray
    V_q: FloatArray
    A_q: FloatArray
    A_v: FloatArray

    def translation(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        r"""Differentiate t and its rates: :math:`\dot t = V_l + V_ω × t, \ddot t = A_l + A_ω × t + V_ω × \dot t`.

        Returns
        -------
        tuple of numpy.ndarray
            (3, nv) each: derivatives of t, of its rate, and of its acceleration by q and by v [m and per s, s²].
        """
        omega, alpha = self.V[3:], self.A[3:]
        rate = self.V[:3] + np.cross(omega, self.t)
        t_q = self.delta[:3] + cross(self.delta[3:], self.t)
        rate_q = self.V_q[:3] + cross(self.V_q[3:], self.t) + turn(omega, t_q)
        rate_v = t_q  # as the rate is linear in v
        by_q = (
            self.A_q[:3]
            + cross(self.A_q[3:], self.t)
            + turn(alpha, t_q)
            + cross(self.V_q[3:], rate)
            + turn(omega, rate_q)
        )
        by_v = self.A_v[:3] + cross(self.A_v[3:], self.t) + cross(self.delta[3:], rate) + turn(omega, rate_v)
        return t_q, rate_q, by_q, by_v

    def direction(self, u2: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        r"""Differentiate the rates of w = R u2: :math:`\dot w = V_ω × w, \ddot w = A_ω × w + V_ω × \dot w`.

        Parameters
        ----------
        u2
            (3,) unit vector in frame 2.

        Returns
        -------
        tuple of numpy.ndarray
            (3, nv) each: derivatives of the rate, and of the acceleration by q and by v [1/s and 1/s²].
        """
        omega, alpha = self.V[3:], self.A[3:]
        w = self.rotation @ u2
        rate = np.cross(omega, w)
        w_q = cross(self.delta[3:], w)
        rate_q = cross(self.V_q[3:], w) + turn(omega, w_q)
        by_q = cross(self.A_q[3:], w) + turn(alpha, w_q) + cross(self.V_q[3:], rate) + turn(omega, rate_q)
        by_v = cross(self.A_v[3:], w) + cross(self.delta[3:], rate) + turn(omega, w_q)
        return rate_q, by_q, by_v

    def distance(self, axis: FloatArray, radius: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        r"""Differentiate the rates of the way l of a rod or a cable, l̈ = e·ẗ + ṫᵀ (∂e/∂t) ṫ.

        Parameters
        ----------
        axis
            (3,) swivel axis of the pulley in frame 1, a unit vector.
        radius
            Its radius; 0 for a rod [m].

        Returns
        -------
        tuple of numpy.ndarray
            (nv,) each: derivatives of the rate, and of the acceleration by q and by v [m/s and m/s²].
        """
        omega = self.V[3:]
        rate = self.V[:3] + np.cross(omega, self.t)
        acceleration = self.A[:3] + np.cross(self.A[3:], self.t) + np.cross(omega, rate)
        t_q, rate_q, by_q, by_v = self.translation()
        way = cable_path(self.t, axis, radius)
        e, turned = way.along[0], way.turned(rate[None])[0]
        return (
            e @ rate_q + turned @ t_q,
            e @ by_q
            + way.turned(acceleration[None])[0] @ t_q
            + 2 * turned @ rate_q
            + way.bent(rate[None], t_q.T),
            e @ by_v + 2 * turned @ t_q,
        )


def cable_path(t: FloatArray, axis: FloatArray, radius: float) -> CablePaths:
    """Lay one cable, or a rod, in frame 1.

    Parameters
    ----------
    t
        (3,) origin of frame 2 in frame 1 [m].
    axis
        (3,) swivel axis of the pulley in frame 1, a unit vector.
    radius
        Its radius; 0 for a rod [m].

    Returns
    -------
    CablePaths
        Of one entry, which broadcasts.
    """
    return cable_paths(t[None], axis[None], np.array([radius]))


def relative_motion(chain: ClosedChain, data: pin.Data, k: int) -> RelativeMotion:
    """Evaluate the relative motion of a loop's frames and its derivatives.

    Parameters
    ----------
    chain
        Closed chain.
    data
        Scratch in which `pinocchio.computeForwardKinematicsDerivatives` has run.
    k
        Number of the loop.

    Returns
    -------
    RelativeMotion
        In frame 1.
    """
    at = LoopEnds(chain, data, k)
    one = _frame_motion(chain, data, at.joint1, at.frame1, at.jacobian1)
    two = _frame_motion(chain, data, at.joint2, at.frame2, at.jacobian2)
    X, delta = at.action, at.displacement()
    V2, A2 = X @ two.V, X @ two.A
    V = V2 - one.V
    # d(X V2) = δ × (X V2) + X dV2;  A = X A2 + V × (X V2) - A1.
    V2_q = _motion_cross(delta, V2) + X @ two.V_q
    V_q = V2_q - one.V_q
    A = A2 + _motion_cross(V[:, None], V2)[:, 0] - one.A
    A_q = (
        _motion_cross(delta, A2) + X @ two.A_q + _motion_cross(V_q, V2) + _motion_cross_by(V, V2_q) - one.A_q
    )
    A_v = X @ two.A_v + _motion_cross(delta, V2) + _motion_cross_by(V, X @ two.J) - one.A_v
    return RelativeMotion(at.t, at.rotation, V, A, delta, V_q, A_q, A_v)


@dataclass(frozen=True, eq=False)
class _FrameMotion:
    """Spatial velocity and acceleration of a frame in its own axes, with their derivatives."""

    V: FloatArray
    A: FloatArray
    J: FloatArray
    V_q: FloatArray
    A_q: FloatArray
    A_v: FloatArray


def _frame_motion(
    chain: ClosedChain, data: pin.Data, joint: int, frame: pin.SE3, jacobian: FloatArray
) -> _FrameMotion:
    if joint == 0:  # the world: Pinocchio has no derivatives for it
        none = np.zeros((6, chain.nv))
        return _FrameMotion(np.zeros(6), np.zeros(6), none, none, none, none)
    velocity_q, acceleration_q, acceleration_v, _ = (
        np.reshape(x, (6, chain.nv))
        for x in pin.getFrameAccelerationDerivatives(chain.model, data, joint, frame, _LOCAL)
    )
    return _FrameMotion(
        V=frame.actInv(data.v[joint]).vector,
        A=frame.actInv(data.a[joint]).vector,
        J=jacobian,
        V_q=velocity_q,
        A_q=acceleration_q,
        A_v=acceleration_v,
    )


def cross(columns: FloatArray, vector: FloatArray) -> FloatArray:
    """Multiply each column with a vector.

    Parameters
    ----------
    columns
        (3, n) any vectors [m, or dimensionless].
    vector
        (3,) any vector [m, or dimensionless].

    Returns
    -------
    numpy.ndarray
        (3, n) column × vector [m or rad].
    """
    return np.cross(columns, vector, axisa=0, axisc=0)


def turn(vector: FloatArray, columns: FloatArray) -> FloatArray:
    """Multiply a vector with each column.

    Parameters
    ----------
    vector
        (3,) any vector [m, or dimensionless].
    columns
        (3, n) any vectors [m, or dimensionless].

    Returns
    -------
    numpy.ndarray
        (3, n) vector × column [m or rad].
    """
    return np.cross(vector, columns, axisb=0, axisc=0)


def _motion_cross(columns: FloatArray, motion: FloatArray) -> FloatArray:
    """Spatial cross product of each column [linear; angular] with a motion: (6, n)."""
    linear = cross(columns[3:], motion[:3]) + cross(columns[:3], motion[3:])
    return np.vstack([linear, cross(columns[3:], motion[3:])])


def _motion_cross_by(motion: FloatArray, columns: FloatArray) -> FloatArray:
    """Spatial cross product of a motion with each column: (6, n)."""
    return -_motion_cross(columns, motion)


# ----------------------------------------------------------------------------------------------------
# The platform frame of a chain: its Jacobian and the rate of it, from the joint Jacobians at the world origin
# ----------------------------------------------------------------------------------------------------


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
