"""Derivatives of the dynamics of arrays of states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stewart_pin.errors import UnsupportedError
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

    def inverse_dynamics_geometry(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        acceleration: ArrayLike,
        *,
        out: Sequence[FloatArray] | None = None,
        status: np.ndarray | None = None,
        conditioning: FloatArray | None = None,
        threads: int = 1,
    ) -> tuple[FloatArray, FloatArray]:
        """Differentiate the motor efforts with respect to where the legs are attached.

        Parameters
        ----------
        pose, twist, acceleration
            Motion of the platform [m, unit quaternion; per s; per s²].
        out, status, conditioning, threads
            Where to write, in any unit, and by how many threads: see `Kernels`.

        Returns
        -------
        by_base, by_platform : numpy.ndarray
            (N, nu, 18) each [N/m]: per x, y, z of the point where each leg stands, in world axes, and of the point
            where it carries the platform, in platform axes; legs in the order of their motors. The motion of the
            platform is held, and the bodies keep their inertia about the joints that carry them.

        Raises
        ------
        UnsupportedError
            If the platform has not six freedoms and six motors on legs that stand on the ground.
        """
        self._require_geometry("inverse_dynamics_geometry")
        return self._call(
            "inverse_dynamics_geometry",
            (pose, twist, acceleration),
            Places(out, status, conditioning, threads),
        )

    def forward_dynamics_geometry(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        tau_motor: ArrayLike,
        *,
        out: Sequence[FloatArray] | None = None,
        status: np.ndarray | None = None,
        conditioning: FloatArray | None = None,
        threads: int = 1,
    ) -> tuple[FloatArray, FloatArray]:
        """Differentiate the acceleration under motor efforts with respect to where the legs are attached.

        Parameters
        ----------
        pose, twist
            State of the platform [m, unit quaternion; per s].
        tau_motor
            (N, nu) motor efforts [N or N m].
        out, status, conditioning, threads
            Where to write, in any unit, and by how many threads: see `Kernels`.

        Returns
        -------
        by_base, by_platform : numpy.ndarray
            (N, 6, 18) each [1/s², 1/(m s²)], in the order of `inverse_dynamics_geometry`.

        Raises
        ------
        UnsupportedError
            If the platform has not six freedoms and six motors on legs that stand on the ground.
        """
        self._require_geometry("forward_dynamics_geometry")
        return self._call(
            "forward_dynamics_geometry", (pose, twist, tau_motor), Places(out, status, conditioning, threads)
        )

    def _require_geometry(self, verb: str) -> None:
        if verb not in self.names:
            why = self._functions.why_whole_tree
            raise UnsupportedError(f"{verb} needs legs in closed form: {why}")
