"""Efforts, accelerations and reactions of arrays of states, and the derivatives of the dynamics.

These are with respect to the state, and to where joints and loops are attached.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from stewart_pin.checks import as_array
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.kernels.verbs.calling import Caller, Places, count_states
from stewart_pin.kernels.verbs.ground import GroundMotions
from stewart_pin.kernels.verbs.sharing import LimitedSharing
from stewart_pin.mechanics.sharing import Sharing
from stewart_pin.model.tree import Limits
from stewart_pin.programs.arrays import require_apart, require_out
from stewart_pin.programs.status import StateStatus
from stewart_pin.state.geometry_parameters import GeometryParameter, geometry_parameters
from stewart_pin.typing import ArrayLike, FloatArray

if TYPE_CHECKING:
    from stewart_pin.kernels.graph.function_set import FunctionSet


class DynamicsVerbs(Caller):
    """Verbs of motion and effort."""

    def inverse_dynamics(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        acceleration: ArrayLike,
        wrenches: ArrayLike | None = None,
        *,
        effort_limit: ArrayLike | Limits | None = None,
        sharing: Sharing = "least_norm",
        base_motion: GroundMotions | None = None,
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
        wrenches
            (N, 6 k) what acts from outside, for kernels that were compiled for it, see `Kernels` [N, N m].
        effort_limit, sharing
            How redundant motors share within limits, as in the verb of one state, by ``"least_norm"`` or
            ``"mid_range"``; states that have no efforts within the limits have the code ``OUT_OF_LIMITS``. Default: by
            least norm, whatever the limits [N or N m].
        base_motion
            How the ground moves, for kernels that were compiled for it, see `Kernels` [rad, m/s, rad/s, m/s², rad/s²].
        out, status, conditioning, threads
            Where to write, in any unit, and by how many threads: see `Kernels`.

        Returns
        -------
        numpy.ndarray
            (N, nu) motor efforts in the order of ``chain.motors``; of least norm in natural units, forces times
            ``chain.length_scale`` beside moments, where motors are redundant [N or N m].

        Raises
        ------
        UnsupportedError
            If the least peak is asked for: it is for the verb of one state.
        InputError
            If an option is unknown, or limits have the wrong shape.
        """
        inputs = self._loaded((pose, twist, acceleration), wrenches, base_motion)
        if effort_limit is not None or sharing != "least_norm":
            by = LimitedSharing(self.chain, effort_limit, sharing)
            return self._shared(by, inputs, Places(out, status, conditioning, threads))
        return self._call("inverse_dynamics", inputs, Places(out, status, conditioning, threads))

    def _shared(self, by: LimitedSharing, inputs: tuple[ArrayLike, ...], places: Places) -> FloatArray:
        """Share the least efforts anew, within limits."""
        count = count_states(inputs)
        n, room = 1 if count is None else count, places.out
        codes = np.zeros(n, dtype=np.int8)
        if places.status is not None:
            require_out("status", places.status, (n,), np.dtype(np.int8))
        if room is not None:
            shape = (self.chain.nu,) if count is None else (n, self.chain.nu)
            require_out("out", np.asarray(room), shape, self._dtype)
        found, share = self._call("motor_share", inputs, replace(places, out=None, status=codes))
        efforts = np.array(found, dtype=float).reshape(n, self.chain.nu)
        share = np.ascontiguousarray(share, dtype=float).reshape(n, -1, self.chain.nu)
        codes[by.apply(share, efforts, places.threads)] = StateStatus.OUT_OF_LIMITS
        if places.status is not None:
            places.status[:] = codes
        given = efforts.astype(self._dtype, copy=False).reshape(found.shape)
        if room is None:
            return given
        np.asarray(room)[...] = given
        return np.asarray(room)

    def forward_dynamics(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        tau_motor: ArrayLike,
        wrenches: ArrayLike | None = None,
        *,
        base_motion: GroundMotions | None = None,
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
        wrenches
            (N, 6 k) what acts from outside, for kernels that were compiled for it, see `Kernels` [N, N m].
        base_motion
            How the ground moves, for kernels that were compiled for it, see `Kernels` [rad, m/s, rad/s, m/s², rad/s²].
        out, status, conditioning, threads
            Where to write, in any unit, and by how many threads: see `Kernels`.

        Returns
        -------
        numpy.ndarray
            (N, size) acceleration in the same coordinates [m/s², rad/s²].
        """
        inputs = self._loaded((pose, twist, tau_motor), wrenches, base_motion)
        return self._call("forward_dynamics", inputs, Places(out, status, conditioning, threads))

    def reactions(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        acceleration: ArrayLike,
        wrenches: ArrayLike | None = None,
        *,
        base_motion: GroundMotions | None = None,
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
        wrenches
            (N, 6 k) what acts from outside, for kernels that were compiled for it, see `Kernels` [N, N m].
        base_motion
            How the ground moves, for kernels that were compiled for it, see `Kernels` [rad, m/s, rad/s, m/s², rad/s²].
        out, status, conditioning, threads
            Where to write, in any unit, and by how many threads: see `Kernels`.

        Returns
        -------
        numpy.ndarray
            (N, nc) what the closures do to link 2, row by row in loop frame 1; of least norm in natural units where
            rows are redundant [N and N m].
        """
        inputs = self._loaded((pose, twist, acceleration), wrenches, base_motion)
        return self._call("reactions", inputs, Places(out, status, conditioning, threads))

    def regressor(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        acceleration: ArrayLike,
        *,
        base_motion: GroundMotions | None = None,
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
        base_motion
            How the ground moves, for kernels that were compiled for it, see `Kernels` [rad, m/s, rad/s, m/s², rad/s²].
        out, status, conditioning, threads
            Where to write, in any unit, and by how many threads: see `Kernels`.

        Returns
        -------
        numpy.ndarray
            (N, nu, 10 bodies and the rotors), such that motor efforts are ``regressor @ inertial_parameters`` [N or N m
            per kg, kg m, kg m²], plus ``by_wrenches @ wrenches`` where something acts from outside: the regressor does
            not depend on it.

        Raises
        ------
        UnsupportedError
            If there are idle freedoms: they obey their own inertia, and efforts are not linear in it; or joints have
            springs, damping or friction, which are in no inertial parameter.
        """
        _, ground = self._ground(base_motion)
        inputs = (pose, twist, acceleration, *ground)
        return self._call("regressor", inputs, Places(out, status, conditioning, threads))

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
        wrenches: ArrayLike | None = None,
        *,
        out: Sequence[FloatArray] | None = None,
        status: np.ndarray | None = None,
        conditioning: FloatArray | None = None,
        threads: int = 1,
    ) -> tuple[FloatArray, ...]:
        """Differentiate the motor efforts.

        Parameters
        ----------
        pose, twist, acceleration
            Motion in platform or motor coordinates, see `Kernels` [m, rad, unit quaternions; per s; per s²].
        wrenches
            (N, 6 k) what acts from outside, for kernels that were compiled for it, see `Kernels` [N, N m].
        out, status, conditioning, threads
            Where to write, in any unit, and by how many threads: see `Kernels`.

        Returns
        -------
        by_pose, by_twist, by_acceleration : numpy.ndarray
            (N, nu, size) each [N or N m per unit of the coordinate]; poses are displaced by a shift and a rotation
            vector in world axes. They hold for displacements, rates and accelerations that the chain can do. Where
            wrenches act, (N, nu, 6 k) by_wrenches comes fourth [N or N m per N or N m]; in the others these keep their
            axes, and act at points that move with their links.
        """
        self._require_drive("inverse_dynamics_derivatives")
        self._require_resting_ground("inverse_dynamics_derivatives")
        inputs = self._loaded((pose, twist, acceleration), wrenches)
        return self._call("inverse_dynamics_derivatives", inputs, Places(out, status, conditioning, threads))

    def forward_dynamics_derivatives(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        tau_motor: ArrayLike,
        wrenches: ArrayLike | None = None,
        *,
        out: Sequence[FloatArray] | None = None,
        status: np.ndarray | None = None,
        conditioning: FloatArray | None = None,
        threads: int = 1,
    ) -> tuple[FloatArray, ...]:
        """Differentiate the acceleration under motor efforts.

        Parameters
        ----------
        pose, twist
            State in platform or motor coordinates, see `Kernels` [m, rad, unit quaternions; per s].
        tau_motor
            (N, nu) motor efforts [N or N m].
        wrenches
            (N, 6 k) what acts from outside, for kernels that were compiled for it, see `Kernels` [N, N m].
        out, status, conditioning, threads
            Where to write, in any unit, and by how many threads: see `Kernels`.

        Returns
        -------
        by_pose, by_twist, by_tau_motor : numpy.ndarray
            (N, size, size or nu) each [m/s² or rad/s² per unit of the coordinate or effort], as for inverse dynamics;
            where wrenches act, (N, size, 6 k) by_wrenches comes fourth [m/s² or rad/s² per N or N m].
        """
        self._require_drive("forward_dynamics_derivatives")
        self._require_resting_ground("forward_dynamics_derivatives")
        inputs = self._loaded((pose, twist, tau_motor), wrenches)
        return self._call("forward_dynamics_derivatives", inputs, Places(out, status, conditioning, threads))


# ----------------------------------------------------------------------------------------------------
# Which derivatives by the geometry are asked for, by which way they are had, and which of them do not exist
# ----------------------------------------------------------------------------------------------------


Along: TypeAlias = ArrayLike | Sequence[GeometryParameter]
"""Displacements: some parameters, or (parameters, k) columns of all of them [m or rad per unit]."""


@dataclass(frozen=True, eq=False)
class GeometryColumns:
    """How to turn derivatives by all displacements that a function knows into those that are asked for.

    Attributes
    ----------
    function
        Ending of the function's name: ``by_legs`` where the legs know all that is asked for, or ``by_tree``.
    along
        (known, k) what is asked for [m or rad per unit], or None: all, as they come.
    blocked
        (known,) of bool, dimensionless: displacements without a derivative, if all are asked for.
    """

    function: str
    along: FloatArray | None
    blocked: np.ndarray


def geometry_columns(functions: FunctionSet, along: Along | None) -> GeometryColumns:
    """Check which derivatives are asked for.

    Parameters
    ----------
    functions
        Functions of the chain.
    along
        Parameters, or (parameters, k) displacements [m or rad per unit]; None: each parameter by itself.

    Returns
    -------
    GeometryColumns
        The way to them.

    Raises
    ------
    UnsupportedError
        If along one of them there is no derivative.
    InputError
        If the shape is wrong, an entry is not finite, or a parameter is not one of the chain's.
    """
    parameters = geometry_parameters(functions.chain)
    if along is None:
        return GeometryColumns("by_tree", None, ~functions.displacements.alone)
    matrix = _as_displacements(parameters, along)
    legs = list(functions.leg_displacements)
    none = np.zeros(len(parameters), dtype=bool)
    if legs and not np.delete(matrix, legs, axis=0).any():
        return GeometryColumns("by_legs", matrix[legs], none)
    blocked = np.flatnonzero(functions.displacements.blocked(matrix))
    if blocked.size:
        column = int(blocked[0])
        names = [str(p) for p, x in zip(parameters, matrix[:, column], strict=True) if x]
        raise UnsupportedError(
            f"there is no derivative along column {column} of along ({'; '.join(names[:3])}"
            f"{', ...' if len(names) > 3 else ''}): {functions.chain.name} would lose its mobility, or depend on where "
            "idle freedoms stand; Kernels.geometry_displacements is a basis of what may be displaced"
        )
    return GeometryColumns("by_tree", matrix, none)


def _as_displacements(parameters: Sequence[GeometryParameter], along: Any) -> FloatArray:
    if not isinstance(along, Sequence) or not any(isinstance(x, GeometryParameter) for x in along):
        return as_array("along", along, (len(parameters), None))
    places = {parameter: k for k, parameter in enumerate(parameters)}
    unknown = [x for x in along if x not in places]
    if unknown:
        raise InputError(f"along holds {unknown[0]}, which is none of Kernels.geometry_parameters")
    return np.eye(len(places))[:, [places[x] for x in along]]


# ----------------------------------------------------------------------------------------------------

_BLOCK = 4096
"""States whose derivatives by all parameters are held at once: some MB."""


class GeometryVerbs(Caller):
    """Verbs that differentiate by the geometry."""

    def inverse_dynamics_geometry(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        acceleration: ArrayLike,
        wrenches: ArrayLike | None = None,
        *,
        along: Along | None = None,
        out: FloatArray | None = None,
        status: np.ndarray | None = None,
        conditioning: FloatArray | None = None,
        threads: int = 1,
    ) -> FloatArray:
        """Differentiate the motor efforts with respect to where joints and loops are attached.

        The motion is held, as far as `geometry_held` says; bodies keep their inertia about the joints that carry them.

        Parameters
        ----------
        pose, twist, acceleration
            Motion in the kernels' coordinates, see `Kernels` [m, rad, unit quaternions; per s; per s²].
        wrenches
            (N, 6 k) what acts from outside, for kernels that were compiled for it, see `Kernels` [N, N m].
        along
            Some of `geometry_parameters`, or (parameters, k) displacements, a column each, in their order [m or rad
            per unit]; None: each parameter by itself.
        out, status, conditioning, threads
            Where to write, in any unit, and by how many threads: see `Kernels`.

        Returns
        -------
        numpy.ndarray
            (N, nu, k) efforts per displacement [N or N m per m, rad or unit of `along`]; without `along` nan for
            parameters that cannot be displaced by themselves, see `geometry_displacements`.

        Raises
        ------
        UnsupportedError
            If there is no derivative along a column of `along`.
        InputError
            If `along` has another shape, is not finite, or holds a parameter of another chain.

        Notes
        -----
        If all that is displaced are the points where the six legs of a platform stand, or those where they carry it,
        closed forms of the legs are used, at a third of the cost.
        """
        self._require_resting_ground("inverse_dynamics_geometry")
        inputs, places = (
            self._loaded((pose, twist, acceleration), wrenches),
            Places(out, status, conditioning, threads),
        )
        return self._by_geometry("inverse_dynamics", inputs, along, places)

    def forward_dynamics_geometry(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        tau_motor: ArrayLike,
        wrenches: ArrayLike | None = None,
        *,
        along: Along | None = None,
        out: FloatArray | None = None,
        status: np.ndarray | None = None,
        conditioning: FloatArray | None = None,
        threads: int = 1,
    ) -> FloatArray:
        """Differentiate the acceleration under motor efforts with respect to where joints and loops are attached.

        Parameters
        ----------
        pose, twist
            State in the kernels' coordinates, see `Kernels` [m, rad, unit quaternions; per s].
        tau_motor
            (N, nu) motor efforts [N or N m].
        wrenches
            (N, 6 k) what acts from outside, for kernels that were compiled for it, see `Kernels` [N, N m].
        along
            What is displaced, as for inverse dynamics [m or rad per unit].
        out, status, conditioning, threads
            Where to write, in any unit, and by how many threads: see `Kernels`.

        Returns
        -------
        numpy.ndarray
            (N, size, k) accelerations per displacement, of the whole platform or state [m/s² or rad/s² per m, rad or
            unit of `along`], as for inverse dynamics.

        Raises
        ------
        UnsupportedError
            If there is no derivative along a column of `along`.
        InputError
            If `along` has another shape, is not finite, or holds a parameter of another chain.
        """
        self._require_resting_ground("forward_dynamics_geometry")
        inputs, places = (
            self._loaded((pose, twist, tau_motor), wrenches),
            Places(out, status, conditioning, threads),
        )
        return self._by_geometry("forward_dynamics", inputs, along, places)

    @property
    def geometry_parameters(self) -> tuple[GeometryParameter, ...]:
        """What may be displaced, as `stewart_pin.build.geometry_parameters` of the chain; print one to read it."""
        return geometry_parameters(self.chain)

    @property
    def geometry_held(self) -> tuple[str, ...]:
        """Names of the coordinates that are held while the geometry changes; the others follow from the loops.

        Of the platform's motion as many components as it has freedoms, position before rotation; of the motors as many
        as are independent; of whole states the joint coordinates that are independent around home.
        """
        return self._functions.held.names

    @property
    def geometry_displacements(self) -> FloatArray:
        """(parameters, k) basis of the displacements along which there is a derivative [m or rad per unit].

        First single parameters, then combinations, each of which displaces one more parameter by 1 m or 1 rad and
        others so that a mechanism with redundant loop rows keeps its mobility, to the first order. What would make
        efforts depend on where idle freedoms stand is left out.
        """
        return self._functions.displacements.basis

    def _by_geometry(
        self, verb: str, inputs: tuple[ArrayLike, ...], along: Along | None, places: Places
    ) -> FloatArray:
        columns = geometry_columns(self._functions, along)
        name = f"{verb}_{columns.function}"
        if columns.along is None:
            found = self._call(name, inputs, places)
            found[..., columns.blocked] = np.nan
            return found
        return self._along(name, inputs, columns.along, places)

    def _along(
        self, name: str, inputs: tuple[ArrayLike, ...], along: FloatArray, places: Places
    ) -> FloatArray:
        """Combine displacements, block by block: all parameters of all states would take too much room."""
        count = count_states(inputs)
        rows = self.casadi(name).size1_out(0)
        shape = (rows, along.shape[1]) if count is None else (count, rows, along.shape[1])
        out: Any = places.out
        if out is None:
            out = np.empty(shape, dtype=self._dtype)
        require_out("out", out, shape, self._dtype)
        if count is None:
            np.matmul(self._call(name, inputs, replace(places, out=None)), along, out=out)
            return out
        given: list[Any] = [np.asarray(x) for x in inputs]
        require_apart("out", out, [(f"argument {k}", x) for k, x in enumerate(given, start=1)])
        for array, title, dtype in (
            (places.status, "status", np.int8),
            (places.conditioning, "conditioning", self._dtype),
        ):
            if array is not None:
                require_out(title, array, (count,), np.dtype(dtype))
        for start in range(0, count, _BLOCK):
            part = slice(start, start + _BLOCK)
            status, conditioning = (x if x is None else x[part] for x in (places.status, places.conditioning))
            block = Places(None, status, conditioning, places.threads)
            found = self._call(name, tuple(x[part] if x.ndim > 1 and len(x) > 1 else x for x in given), block)
            np.matmul(found, along, out=out[part])
        return out
