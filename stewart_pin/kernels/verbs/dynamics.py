"""Efforts, accelerations and reactions of arrays of states, and the derivatives of the dynamics."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stewart_pin.kernels.verbs.calling import Caller, Places
from stewart_pin.typing import ArrayLike, FloatArray


class DynamicsVerbs(Caller):
    """Verbs of motion and effort."""

    def inverse_dynamics(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        acceleration: ArrayLike,
        *,
        out: FloatArray | None = None,
        status: np.ndarray | None = None,
        conditioning: FloatArray | None = None,
        threads: int = 1,
    ) -> FloatArray:
        """Compute the motor efforts of a motion.

        Parameters
        ----------
        pose, twist, acceleration
            Motion in the kernels' coordinates, see `Kernels` [m, rad, unit quaternions; per s; per s²].
        out, status, conditioning, threads
            Where to write, in any unit, and by how many threads: see `Kernels`.

        Returns
        -------
        numpy.ndarray
            (N, nu) motor efforts in the order of ``chain.motors``; of least norm in natural units, forces times
            ``chain.length_scale`` beside moments, where motors are redundant [N or N m].
        """
        return self._call(
            "inverse_dynamics", (pose, twist, acceleration), Places(out, status, conditioning, threads)
        )

    def forward_dynamics(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        tau_motor: ArrayLike,
        *,
        out: FloatArray | None = None,
        status: np.ndarray | None = None,
        conditioning: FloatArray | None = None,
        threads: int = 1,
    ) -> FloatArray:
        """Compute the acceleration under motor efforts.

        Parameters
        ----------
        pose, twist
            State in the kernels' coordinates, see `Kernels` [m, rad, unit quaternions; per s].
        tau_motor
            (N, nu) motor efforts in the order of ``chain.motors`` [N or N m].
        out, status, conditioning, threads
            Where to write, in any unit, and by how many threads: see `Kernels`.

        Returns
        -------
        numpy.ndarray
            (N, size) acceleration in the same coordinates [m/s², rad/s²].
        """
        return self._call(
            "forward_dynamics", (pose, twist, tau_motor), Places(out, status, conditioning, threads)
        )

    def reactions(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        acceleration: ArrayLike,
        *,
        out: FloatArray | None = None,
        status: np.ndarray | None = None,
        conditioning: FloatArray | None = None,
        threads: int = 1,
    ) -> FloatArray:
        """Compute the loop reactions of a motion.

        Parameters
        ----------
        pose, twist, acceleration
            Motion in the kernels' coordinates, see `Kernels` [m, rad, unit quaternions; per s; per s²].
        out, status, conditioning, threads
            Where to write, in any unit, and by how many threads: see `Kernels`.

        Returns
        -------
        numpy.ndarray
            (N, nc) what the closures do to link 2, row by row in loop frame 1; of least norm in natural units where
            rows are redundant [N and N m].
        """
        return self._call(
            "reactions", (pose, twist, acceleration), Places(out, status, conditioning, threads)
        )

    def regressor(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        acceleration: ArrayLike,
        *,
        out: FloatArray | None = None,
        status: np.ndarray | None = None,
        conditioning: FloatArray | None = None,
        threads: int = 1,
    ) -> FloatArray:
        """Write the motor efforts as a matrix times the inertial parameters, for identification.

        Parameters
        ----------
        pose, twist, acceleration
            Motion in the kernels' coordinates, see `Kernels` [m, rad, unit quaternions; per s; per s²].
        out, status, conditioning, threads
            Where to write, in any unit, and by how many threads: see `Kernels`.

        Returns
        -------
        numpy.ndarray
            (N, nu, 10 bodies and the rotors), such that motor efforts are ``regressor @ inertial_parameters`` [N or N m
            per kg, kg m, kg m²].

        Raises
        ------
        UnsupportedError
            If there are idle freedoms: they obey their own inertia, and efforts are not linear in it.
        """
        return self._call(
            "regressor", (pose, twist, acceleration), Places(out, status, conditioning, threads)
        )

    @property
    def inertial_parameters(self) -> FloatArray:
        """(10 bodies and the rotors,) of the chain's bodies in Pinocchio's order [kg, kg m, kg m²].

        Of each body mass, mass times centre of mass, and inertia about its joint frame as xx, xy, yy, xz, yz, zz; then
        the inertia of each rotor, those entries of the model's armature that are not zero.
        """
        armature = np.array(self.chain.model.armature)
        return np.concatenate(
            [*(y.toDynamicParameters() for y in self.chain.model.inertias[1:]), armature[armature != 0]]
        )


# ----------------------------------------------------------------------------------------------------
# Derivatives of the dynamics of arrays of states
# ----------------------------------------------------------------------------------------------------


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
        self._require_drive("inverse_dynamics_derivatives")
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
        self._require_drive("forward_dynamics_derivatives")
        return self._call(
            "forward_dynamics_derivatives",
            (pose, twist, tau_motor),
            Places(out, status, conditioning, threads),
        )
