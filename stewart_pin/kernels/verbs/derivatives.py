"""Derivatives of the dynamics of arrays of states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stewart_pin.kernels.verbs.calling import Caller, Places
from stewart_pin.typing import ArrayLike, FloatArray


class DerivativeVerbs(Caller):
    """Verbs that differentiate."""

    def inverse_dynamics_derivatives(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        acceleration: ArrayLike,
        *,
        out: Sequence[FloatArray] | None = None,
        status: np.ndarray | None = None,
        conditioning: FloatArray | None = None,
        threads: int = 1,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Differentiate the motor efforts.

        Parameters
        ----------
        pose, twist, acceleration
            Motion in platform or motor coordinates, see `Kernels` [m, rad, unit quaternions; per s; per s²].
        out, status, conditioning, threads
            Where to write, in any unit, and by how many threads: see `Kernels`.

        Returns
        -------
        by_pose, by_twist, by_acceleration : numpy.ndarray
            (N, nu, size) each [N or N m per unit of the coordinate]; poses are displaced by a shift and a rotation
            vector in world axes. They hold for displacements, rates and accelerations that the chain can do.
        """
        return self._call(
            "inverse_dynamics_derivatives",
            (pose, twist, acceleration),
            Places(out, status, conditioning, threads),
        )

    def forward_dynamics_derivatives(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        tau_motor: ArrayLike,
        *,
        out: Sequence[FloatArray] | None = None,
        status: np.ndarray | None = None,
        conditioning: FloatArray | None = None,
        threads: int = 1,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Differentiate the acceleration under motor efforts.

        Parameters
        ----------
        pose, twist
            State in platform or motor coordinates, see `Kernels` [m, rad, unit quaternions; per s].
        tau_motor
            (N, nu) motor efforts [N or N m].
        out, status, conditioning, threads
            Where to write, in any unit, and by how many threads: see `Kernels`.

        Returns
        -------
        by_pose, by_twist, by_tau_motor : numpy.ndarray
            (N, size, size or nu) each [m/s² or rad/s² per unit of the coordinate or effort], as for inverse dynamics.
        """
        return self._call(
            "forward_dynamics_derivatives",
            (pose, twist, tau_motor),
            Places(out, status, conditioning, threads),
        )
