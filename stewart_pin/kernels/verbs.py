"""The verbs of a chain for arrays of states."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import DTypeLike

from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.kernels.array_kernel import ArrayKernel, Engine
from stewart_pin.kernels.compile_function import compile_function
from stewart_pin.kernels.configurations import (
    UNIT,
    as_poses,
    as_rows,
    configurations,
    starts,
    with_unit_quaternions,
)
from stewart_pin.kernels.newton import NewtonSteps, Solved, damped_newton
from stewart_pin.kernels.report import KernelReport, count_operations
from stewart_pin.kernels.status import StateBound, StateStatus
from stewart_pin.model.chain import ClosedChain
from stewart_pin.typing import ArrayLike, FloatArray

if TYPE_CHECKING:
    from stewart_pin.kernels.function_set import FunctionSet

_FEASIBLE = 1e-6
"""Part of a demand that may be impossible by round-off of printed numbers, as in the one-state verbs."""
_FEASIBLE_SINGLE = 1e-5
"""The same where every operation is rounded to single precision: a hundred units of it."""


class Kernels:
    """Verbs of a chain for arrays of states; made by `compile_kernels`.

    Arguments are (N, size), or (size,) for a value that holds for all states. A state that cannot be answered (out of
    reach, at a singularity, a demand that the chain cannot follow, a quaternion that is not of unit length, nan) comes
    out as nan, with its `StateStatus` code in the array `status`; its neighbours do not notice.

    What a state is depends on the coordinates:

    ============ ======================================= =========================== ===========================
    coordinates  pose                                    twist                       acceleration
    ============ ======================================= =========================== ===========================
    "platform"   (N, 7) position, unit quaternion xyzw   (N, 6) [v; ω], world axes   (N, 6) [dv/dt; dω/dt]
    "motor"      (N, nu) motor positions                 (N, nu) motor rates         (N, nu) motor accelerations
    "tree"       (N, nq) q with closed loops             (N, nv) v                   (N, nv) a
    ============ ======================================= =========================== ===========================

    Parameters
    ----------
    functions
        Functions of the chain.
    dtype
        numpy.float64 or numpy.float32.
    engine
        ``"llvm"``, ``"numpy"`` or None.

    Notes
    -----
    Pickles as the chain, and is written and compiled again where it is loaded.
    """

    def __init__(self, functions: FunctionSet, dtype: DTypeLike, engine: Engine | None) -> None:
        self.chain = functions.chain
        self.coordinates = functions.coordinates
        self._functions = functions
        self._options: dict[str, Any] = {"dtype": dtype, "engine": engine}
        if np.dtype(dtype) not in (np.float64, np.float32):
            raise InputError(f"dtype must be float64 or float32, got {np.dtype(dtype)}")
        self._feasible = _FEASIBLE if np.dtype(dtype) == np.float64 else _FEASIBLE_SINGLE
        self._written: dict[str, Any] = {}
        self._kernels: dict[str, ArrayKernel] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuilt, (self.chain, self.coordinates, self._options["dtype"], self._options["engine"])

    @property
    def report(self) -> KernelReport:
        """How the kernels were made."""
        functions = self._functions
        return KernelReport(
            coordinates=self.coordinates,
            route="tree" if functions.placed is None else "legs",
            why_tree=functions.why_whole_tree,
            freedoms=functions.freedoms,
            pivot_score=functions.pivot_score,
            operations={name: count_operations(function) for name, function in self._written.items()},
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names for `casadi`."""
        return self._functions.names

    def casadi(self, name: str) -> Any:
        """Hand out a CasADi function, for optimal control and derivatives.

        Parameters
        ----------
        name
            One of `names`. Functions whose name starts with ``tree_`` take ``q``, ``v``, ``a`` in Pinocchio's
            convention; the others say their inputs and outputs when printed.

        Returns
        -------
        casadi.Function
            Symbolic function of one state, columns in and out.

        Raises
        ------
        InputError
            If there is no such function.
        """
        if name not in self._written:
            self._written[name] = self._functions.function(name)
        return self._written[name]

    def inverse_dynamics(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        acceleration: ArrayLike,
        *,
        status: np.ndarray | None = None,
        threads: int = 1,
    ) -> FloatArray:
        """Compute the motor efforts of a motion.

        Parameters
        ----------
        pose, twist, acceleration
            Motion in the kernels' coordinates, see the table above [m, rad, unit quaternions; per s; per s²].
        status
            (N,) int8 array for the codes of the states, dimensionless.
        threads
            Number of threads.

        Returns
        -------
        numpy.ndarray
            (N, nu) motor efforts in the order of ``chain.motors``; of least norm where motors are redundant [N or N m].
        """
        return self._call("inverse_dynamics", (pose, twist, acceleration), status, threads)

    def forward_dynamics(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        tau_motor: ArrayLike,
        *,
        status: np.ndarray | None = None,
        threads: int = 1,
    ) -> FloatArray:
        """Compute the acceleration under motor efforts.

        Parameters
        ----------
        pose, twist
            State in the kernels' coordinates, see the table above [m, rad, unit quaternions; per s].
        tau_motor
            (N, nu) motor efforts in the order of ``chain.motors`` [N or N m].
        status
            (N,) int8 array for the codes of the states, dimensionless.
        threads
            Number of threads.

        Returns
        -------
        numpy.ndarray
            (N, size) acceleration in the same coordinates [m/s², rad/s²].
        """
        return self._call("forward_dynamics", (pose, twist, tau_motor), status, threads)

    def reactions(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        acceleration: ArrayLike,
        *,
        status: np.ndarray | None = None,
        threads: int = 1,
    ) -> FloatArray:
        """Compute the loop reactions of a motion.

        Parameters
        ----------
        pose, twist, acceleration
            Motion in the kernels' coordinates, see the table above [m, rad, unit quaternions; per s; per s²].
        status
            (N,) int8 array for the codes of the states, dimensionless.
        threads
            Number of threads.

        Returns
        -------
        numpy.ndarray
            (N, nc) what the closures do to link 2, row by row in loop frame 1; of least norm where rows are redundant
            [N and N m].
        """
        return self._call("reactions", (pose, twist, acceleration), status, threads)

    def inverse_dynamics_derivatives(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        acceleration: ArrayLike,
        *,
        status: np.ndarray | None = None,
        threads: int = 1,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Differentiate the motor efforts.

        Parameters
        ----------
        pose, twist, acceleration
            Motion in platform or motor coordinates, see the table above [m, rad, unit quaternions; per s; per s²].
        status
            (N,) int8 array for the codes of the states, dimensionless.
        threads
            Number of threads.

        Returns
        -------
        by_pose, by_twist, by_acceleration : numpy.ndarray
            (N, nu, size) each [N or N m per unit of the coordinate]; poses are displaced by a shift and a rotation
            vector in world axes. They hold for displacements, rates and accelerations that the chain can do.
        """
        return self._call("inverse_dynamics_derivatives", (pose, twist, acceleration), status, threads)

    def forward_dynamics_derivatives(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        tau_motor: ArrayLike,
        *,
        status: np.ndarray | None = None,
        threads: int = 1,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Differentiate the acceleration under motor efforts.

        Parameters
        ----------
        pose, twist
            State in platform or motor coordinates, see the table above [m, rad, unit quaternions; per s].
        tau_motor
            (N, nu) motor efforts [N or N m].
        status
            (N,) int8 array for the codes of the states, dimensionless.
        threads
            Number of threads.

        Returns
        -------
        by_pose, by_twist, by_tau_motor : numpy.ndarray
            (N, size, size or nu) each [m/s² or rad/s² per unit of the coordinate or effort], as for inverse dynamics.
        """
        return self._call("forward_dynamics_derivatives", (pose, twist, tau_motor), status, threads)

    def inverse_dynamics_geometry(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        acceleration: ArrayLike,
        *,
        status: np.ndarray | None = None,
        threads: int = 1,
    ) -> tuple[FloatArray, FloatArray]:
        """Differentiate the motor efforts with respect to where the legs are attached.

        Parameters
        ----------
        pose, twist, acceleration
            Motion of the platform [m, unit quaternion; per s; per s²].
        status
            (N,) int8 array for the codes of the states, dimensionless.
        threads
            Number of threads.

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
        return self._call("inverse_dynamics_geometry", (pose, twist, acceleration), status, threads)

    def forward_dynamics_geometry(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        tau_motor: ArrayLike,
        *,
        status: np.ndarray | None = None,
        threads: int = 1,
    ) -> tuple[FloatArray, FloatArray]:
        """Differentiate the acceleration under motor efforts with respect to where the legs are attached.

        Parameters
        ----------
        pose, twist
            State of the platform [m, unit quaternion; per s].
        tau_motor
            (N, nu) motor efforts [N or N m].
        status
            (N,) int8 array for the codes of the states, dimensionless.
        threads
            Number of threads.

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
        return self._call("forward_dynamics_geometry", (pose, twist, tau_motor), status, threads)

    def regressor(
        self,
        pose: ArrayLike,
        twist: ArrayLike,
        acceleration: ArrayLike,
        *,
        status: np.ndarray | None = None,
        threads: int = 1,
    ) -> FloatArray:
        """Write the motor efforts as a matrix times the inertial parameters, for identification.

        Parameters
        ----------
        pose, twist, acceleration
            Motion in the kernels' coordinates, see the table above [m, rad, unit quaternions; per s; per s²].
        status
            (N,) int8 array for the codes of the states, dimensionless.
        threads
            Number of threads.

        Returns
        -------
        numpy.ndarray
            (N, nu, 10 bodies), such that motor efforts are ``regressor @ inertial_parameters`` [N or N m per kg, kg m,
            kg m²].

        Raises
        ------
        UnsupportedError
            If there are idle freedoms: they obey their own inertia, and efforts are not linear in it.
        """
        return self._call("regressor", (pose, twist, acceleration), status, threads)

    @property
    def inertial_parameters(self) -> FloatArray:
        """(10 bodies,) of the chain's bodies in Pinocchio's order: mass, first moments, inertia [kg, kg m, kg m²].

        Of each body mass, mass times centre of mass, and inertia about its joint frame as xx, xy, yy, xz, yz, zz.
        """
        return np.concatenate([y.toDynamicParameters() for y in self.chain.model.inertias[1:]])

    def inverse_kinematics(
        self, pose: ArrayLike, *, status: np.ndarray | None = None, threads: int = 1
    ) -> FloatArray:
        """Compute the motor positions of poses.

        Parameters
        ----------
        pose
            (N, 7) position and unit quaternion x y z w of the platform frame [m].
        status
            (N,) int8 array for the codes of the states, dimensionless.
        threads
            Number of threads.

        Returns
        -------
        numpy.ndarray
            (N, nu) in the order of ``chain.motors``, on the branch of home; joint limits are not looked at [m or rad].
        """
        self._require_platform("inverse_kinematics")
        if self._functions.placed is not None:
            return self._call("inverse_kinematics", (pose,), status, threads)
        states, single = self._states(pose)
        solved = self._configurations(states, threads)
        return self._given(solved, (solved.states[:, self.chain.motor_q_index],), status, single)

    def motor_jacobian(
        self, pose: ArrayLike, *, status: np.ndarray | None = None, threads: int = 1
    ) -> FloatArray:
        """Map twists of the platform to motor rates.

        Parameters
        ----------
        pose
            (N, 7) position and unit quaternion x y z w of the platform frame [m].
        status
            (N,) int8 array for the codes of the states, dimensionless.
        threads
            Number of threads.

        Returns
        -------
        numpy.ndarray
            (N, nu, 6) motor rates per twist in world axes [m/s or rad/s per m/s or rad/s]; for a platform with fewer
            than six freedoms it holds for the twists that it can do.
        """
        self._require_platform("motor_jacobian")
        return self._call("motor_jacobian", (pose,), status, threads)

    def conditioning(
        self, pose: ArrayLike, *, status: np.ndarray | None = None, threads: int = 1
    ) -> FloatArray:
        """Tell how near states are to a singularity, by the smallest pivot that the kernels divide by.

        Parameters
        ----------
        pose
            Position in platform or motor coordinates, see the table above [m, rad, unit quaternions].
        status
            (N,) int8 array for the codes of the states, dimensionless.
        threads
            Number of threads.

        Returns
        -------
        numpy.ndarray
            (N, 1) each pivot relative to its median over samples around home, dimensionless: near one where the robot
            is as regular as there, near zero at a singularity, where efforts or accelerations lose their digits.
        """
        return self._call("conditioning", (pose,), status, threads)

    def forward_kinematics(
        self,
        q_motor: ArrayLike,
        pose_guess: ArrayLike,
        *,
        status: np.ndarray | None = None,
        threads: int = 1,
    ) -> FloatArray:
        """Find the poses of motor positions, by Newton steps from guesses.

        Parameters
        ----------
        q_motor
            (N, nu) in the order of ``chain.motors`` [m or rad].
        pose_guess
            (N, 7) or (7,) poses to start from, which choose the assembly mode [m, unit quaternion].
        status
            (N,) int8 array for the codes of the states, dimensionless.
        threads
            Number of threads.

        Returns
        -------
        numpy.ndarray
            (N, 7) position and unit quaternion x y z w of the platform frame [m]; nan where no pose was found.
        """
        self._require_platform("forward_kinematics")
        target, single = as_rows("q_motor", q_motor, self.chain.nu)
        guess = with_unit_quaternions(as_rows("pose_guess", pose_guess, 7)[0])
        if len(guess) not in (1, len(target)):
            raise InputError(f"there are {len(guess)} guesses for {len(target)} motor positions")
        if self._functions.placed is not None:
            solved = damped_newton(self._steps("forward_kinematics"), guess, target, threads=threads)
            return self._given(solved, (solved.states,), status, single)
        begun = self._configurations(np.broadcast_to(guess, (len(target), 7)), threads)
        solved = damped_newton(self._steps("motor_closing"), begun.states, target, threads=threads)
        position, rotation = self._kernel("platform_pose")(solved.states, threads=threads)
        return self._given(solved, (as_poses(position, rotation),), status, single)

    def _call(self, name: str, inputs: tuple[ArrayLike, ...], status: np.ndarray | None, threads: int) -> Any:
        kernel = self._kernel(name)
        if self.coordinates == "tree" or kernel.program.inputs[0].name == "pose":
            return kernel(*inputs, status=status, threads=threads)
        states, single = self._states(inputs[0])
        solved = self._configurations(states, threads)
        many = [len(np.asarray(x)) for x in inputs[1:] if np.ndim(x) > 1]
        if single and many:  # one position, several motions of it
            solved, single = solved.with_rows_of(np.zeros(many[0], dtype=int)), False
        codes = np.zeros(len(solved.states), dtype=np.int8)
        values = kernel(solved.states, *inputs[1:], status=codes, threads=threads)
        return self._given(solved, values if isinstance(values, tuple) else (values,), status, single, codes)

    def _configurations(self, targets: FloatArray, threads: int) -> Solved:
        return configurations(self._steps("closing"), self._starts, targets, threads=threads)

    @cached_property
    def _starts(self) -> FloatArray:
        beside = self._functions.closed.samples
        on_platform = self.coordinates == "platform"
        return starts(self.chain, self._steps("closing"), beside, on_platform=on_platform)

    def _states(self, position: ArrayLike) -> tuple[FloatArray, bool]:
        if self.coordinates == "platform":
            poses, single = as_rows("pose", position, 7)
            return with_unit_quaternions(poses), single
        return as_rows("pose", position, self.chain.nu)

    def _given(
        self,
        solved: Solved,
        values: tuple[FloatArray, ...],
        status: np.ndarray | None,
        single: bool,
        codes: np.ndarray | None = None,
    ) -> Any:
        if status is not None:
            if status.shape != solved.closed.shape or status.dtype != np.int8:
                raise InputError(f"status must be an int8 array of shape {solved.closed.shape}")
            status[:] = StateStatus.OK if codes is None else codes
            status[~solved.closed] = StateStatus.OUT_OF_BOUNDS
        if not solved.closed.all():
            for value in values:
                value[~solved.closed] = np.nan
        given = [value[0] if single else value for value in values]
        return given[0] if len(given) == 1 else tuple(given)

    def _require_geometry(self, verb: str) -> None:
        if verb not in self.names:
            why = self._functions.why_whole_tree
            raise UnsupportedError(f"{verb} needs legs in closed form: {why}")

    def _require_platform(self, verb: str) -> None:
        if self.coordinates != "platform":
            raise UnsupportedError(f"{verb} is for kernels with coordinates='platform'")

    def _steps(self, equations: str) -> NewtonSteps:
        return NewtonSteps(
            self._kernel(f"{equations}_double_step"), lambda: self._kernel(f"{equations}_step")
        )

    def _kernel(self, name: str) -> ArrayKernel:
        if name not in self._kernels:
            function, bounds = _with_judges(self.casadi(name), self._feasible)
            self._kernels[name] = compile_function(function, bounds=bounds, **self._options)
        return self._kernels[name]


def _rebuilt(chain: ClosedChain, coordinates: Any, dtype: DTypeLike, engine: Engine | None) -> Kernels:
    from stewart_pin.kernels.function_set import FunctionSet  # noqa: PLC0415 - needs CasADi

    return Kernels(FunctionSet(chain, coordinates), dtype, engine)


def _with_judges(function: Any, feasible: float) -> tuple[Any, list[StateBound]]:
    """Let outputs judge a state: unit quaternions, feasible demands, closed loops."""
    import casadi as ca  # noqa: PLC0415 - optional; there is a function already

    bounds = [
        StateBound(name, upper=feasible) for name in ("infeasible", "open") if name in function.name_out()
    ]
    if "pose" not in function.name_in():
        return function, bounds
    inputs = function.sx_in()
    quaternion = inputs[function.name_in().index("pose")][3:]
    outputs = [*function.call(inputs), ca.dot(quaternion, quaternion)]
    names = [*function.name_out(), "quaternion_square"]
    bounds.append(StateBound("quaternion_square", 1 - UNIT, 1 + UNIT))
    return ca.Function(function.name(), inputs, outputs, function.name_in(), names), bounds
