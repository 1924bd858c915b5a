"""Inverse dynamics for inner loops: the numbers of the careful verbs, unchecked, with scratch that is used again."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from stewart_pin.closure.equations import row_sizes
from stewart_pin.closure.newton import RANK
from stewart_pin.closure.scratch import LoopScratch
from stewart_pin.mechanics.freedom import null_space
from stewart_pin.model.chain import ClosedChain
from stewart_pin.typing import Configuration, FloatArray, Tangent

_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


class ChainScratch:
    """Scratch of one thread. `place` first, then `platform`, then `follow` and `efforts`.

    Parameters
    ----------
    chain
        Closed chain.
    """

    def __init__(self, chain: ClosedChain) -> None:
        self._chain = chain
        self._loops = LoopScratch(chain)
        self._data = pin.Data(chain.model)
        self._scale = chain.tangent_scale
        self._sizes = row_sizes(chain)
        self._jacobian = np.zeros((chain.nc, chain.nv))
        self._share = np.eye(chain.nv)[:, chain.motor_index]

    def place(self, q: Configuration) -> None:
        """Move to a configuration.

        Parameters
        ----------
        q
            (nq,) with closed loops [m, rad, unit quaternions].
        """
        self._loops.place(q)
        self._jacobian = self._loops.jacobian()

    def platform(self, q: Configuration, v: Tangent) -> tuple[pin.SE3, FloatArray]:
        """Locate the platform where `place` has been.

        Parameters
        ----------
        q
            (nq,) the configuration placed [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].

        Returns
        -------
        pose : pinocchio.SE3
            In the world.
        twist : numpy.ndarray
            (6,) of its origin, in world axes [m/s, rad/s].
        """
        chain, data = self._chain, self._loops.data
        pin.forwardKinematics(chain.model, data, q, v, np.zeros(chain.nv))
        pose = pin.SE3(pin.updateFramePlacement(chain.model, data, chain.platform_id))
        return pose, np.array(pin.getFrameVelocity(chain.model, data, chain.platform_id, _AXES).vector)

    def follow(self, q: Configuration, v: Tangent, acceleration: FloatArray) -> Tangent:
        """Find the acceleration of the chain from that of the platform, where `place` has been.

        Parameters
        ----------
        q
            (nq,) the configuration placed [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        acceleration
            (6,) of the platform's origin, in world axes; what it cannot do is left out in least squares, lengths in
            robot sizes [m/s², rad/s²].

        Returns
        -------
        numpy.ndarray
            (nv,) tangent acceleration that keeps the loops closed [m/s², rad/s²].
        """
        chain, data = self._chain, self._loops.data
        bias = self._loops.bias(q, v)
        pin.updateFramePlacement(chain.model, data, chain.platform_id)
        drift = pin.getFrameClassicalAcceleration(chain.model, data, chain.platform_id, _AXES).vector
        platform = pin.getFrameJacobian(chain.model, data, chain.platform_id, _AXES)
        left = acceleration - drift
        if chain.nc + 6 == chain.nv:
            matrix = np.vstack([self._jacobian, platform])
            try:
                return np.linalg.solve(matrix, np.concatenate([-bias, left]))
            except np.linalg.LinAlgError:
                pass
        scaled = self._jacobian * self._scale / self._sizes[:, None]
        a = -self._scale * np.linalg.lstsq(scaled, bias / self._sizes, rcond=RANK)[0]
        motions = self._scale[:, None] * null_space(scaled)[0]
        unit = np.concatenate([np.full(3, chain.length_scale), np.ones(3)])
        moves = np.linalg.lstsq(platform @ motions / unit[:, None], (left - platform @ a) / unit, rcond=RANK)
        return a + motions @ moves[0]

    def efforts(self, q: Configuration, v: Tangent, a: Tangent) -> FloatArray:
        """Compute the motor efforts of a motion, where `place` has been.

        Parameters
        ----------
        q
            (nq,) the configuration placed [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        a
            (nv,) tangent acceleration [m/s², rad/s²].

        Returns
        -------
        numpy.ndarray
            (nu,) motor efforts, of least norm where they are not unique; idle freedoms carry nothing [N or N m].
        """
        chain = self._chain
        needed = np.array(pin.rnea(chain.model, self._data, q, v, a))
        if chain.nu + chain.nc == chain.nv:
            try:
                return np.linalg.solve(np.hstack([self._share, self._jacobian.T]), needed)[: chain.nu]
            except np.linalg.LinAlgError:
                pass
        motions, _ = null_space(self._jacobian * self._scale / self._sizes[:, None])
        motions = self._scale[:, None] * motions
        return np.linalg.lstsq(motions[chain.motor_index].T, motions.T @ needed, rcond=RANK)[0]
