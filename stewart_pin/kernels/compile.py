"""The verbs of one state as machine code for arrays of states, of any chain."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import DTypeLike
from scipy.spatial.transform import Rotation

from stewart_pin.errors import InputError, MissingExtraError, UnsupportedError
from stewart_pin.kernels.array_kernel import ArrayKernel, Engine
from stewart_pin.kernels.compile_function import compile_function
from stewart_pin.kernels.newton import Solved, damped_newton
from stewart_pin.kernels.status import StateBound, StateStatus
from stewart_pin.mechanics.kinematics import platform_pose
from stewart_pin.model.chain import ClosedChain
from stewart_pin.typing import ArrayLike, FloatArray

if TYPE_CHECKING:
    from stewart_pin.kernels.function_set import FunctionSet

_FEASIBLE = 1e-6
"""Part of a demand that may be impossible by round-off of printed numbers, as in the one-state verbs."""
_UNIT = 2e-6
"""Deviation of a squared quaternion from 1: twice that of its length which the one-state verbs allow."""


@dataclass(frozen=True)
class KernelReport:
    """How the kernels of a chain were made.

    Attributes
    ----------
    coordinates
        ``"platform"`` or ``"motor"``.
    route
        ``"legs"``: leg by leg, in closed form; ``"tree"``: the whole tree, its configuration found by Newton steps.
    why_tree
        Why not leg by leg.
    freedoms
        Number of freedoms that the coordinates determine.
    pivot_score
        Smallest pivot relative to its column, over sampled states; near zero where a fixed order of elimination loses
        digits.
    operations
        Floating-point operations of each function that has been written.
    """

    coordinates: str
    route: str
    why_tree: str
    freedoms: int
    pivot_score: float
    operations: dict[str, int]

    def __str__(self) -> str:
        """One fact a line."""
        way = "leg by leg" if self.route == "legs" else f"the whole tree by Newton steps ({self.why_tree})"
        lines = [
            f"{self.freedoms} freedom(s) in {self.coordinates} coordinates, {way}",
            f"smallest pivot {self.pivot_score:.3g} of its column",
        ]
        return "\n".join(
            [*lines, *(f"{name}: {count} operations" for name, count in self.operations.items())]
        )


def compile_kernels(
    chain: ClosedChain,
    *,
    coordinates: Literal["platform", "motor"] = "platform",
    dtype: DTypeLike = np.float64,
    engine: Engine | None = None,
) -> Kernels:
    """Prepare the verbs of a chain for arrays of states.

    Parameters
    ----------
    chain
        Closed chain.
    coordinates
        ``"platform"``: states are poses, twists and accelerations of the platform; ``"motor"``: positions, rates and
        accelerations of the motors.
    dtype
        numpy.float64 or numpy.float32, the type of every operation.
    engine
        ``"llvm"`` for machine code, ``"numpy"`` to interpret the same program; None takes llvm when it is installed.

    Returns
    -------
    Kernels
        The verbs; each is written and compiled when it is first called.

    Raises
    ------
    MissingExtraError
        If CasADi is not installed.
    UnsupportedError
        If the chain cannot be compiled, with the reason.
    InputError
        If an option is unknown.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> kernels = stp.compile_kernels(stp.load("stewart"))
    >>> pose, rest = np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]]), np.zeros((1, 6))
    >>> kernels.inverse_dynamics(pose, rest, rest).round(2)
    array([[49.99, 49.99, 49.99, 49.99, 49.99, 49.99]])
    """
    if coordinates not in ("platform", "motor"):
        raise InputError(f"coordinates must be 'platform' or 'motor', got {coordinates!r}")
    try:
        from stewart_pin.kernels.function_set import FunctionSet  # noqa: PLC0415 - needs CasADi
    except ImportError as error:
        if error.name != "casadi":
            raise
        raise MissingExtraError("casadi", "kernels") from None
    return Kernels(FunctionSet(chain, coordinates), dtype, engine)


class Kernels:
    """Verbs of a chain for arrays of states; made by `compile_kernels`.

    Arguments are (N, size), or (size,) for a value that holds for all states. A state that cannot be answered (out of
    reach, at a singularity, a demand the platform cannot follow, a quaternion that is not of unit length, nan) comes
    out as nan, with its `StateStatus` code in the array `status`; its neighbours do not notice.

    Parameters
    ----------
    functions
        Functions of the chain.
    dtype
        numpy.float64 or numpy.float32.
    engine
        ``"llvm"``, ``"numpy"`` or None.
    """

    def __init__(self, functions: FunctionSet, dtype: DTypeLike, engine: Engine | None) -> None:
        self.chain = functions.chain
        self.coordinates = functions.coordinates
        self._functions = functions
        self._options: dict[str, Any] = {"dtype": dtype, "engine": engine}
        self._written: dict[str, Any] = {}
        self._kernels: dict[str, ArrayKernel] = {}

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
            One of `names`. Functions of the whole tree take ``q``, ``v``, ``a`` in Pinocchio's convention; the others
            say their inputs and outputs when printed.

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
        pose
            (N, 7) position and unit quaternion x y z w of the platform frame [m]; with motor coordinates (N, nu) motor
            positions [m or rad].
        twist
            (N, 6) [v; ω] of its origin in world axes [m/s, rad/s]; or (N, nu) motor rates.
        acceleration
            (N, 6) [dv/dt; dω/dt] [m/s², rad/s²]; or (N, nu) motor accelerations.
        status
            (N,) int8 array for the codes of the states, dimensionless.
        threads
            Number of threads.

        Returns
        -------
        numpy.ndarray
            (N, nu) motor efforts in the order of ``chain.motors``; of least norm where motors are redundant [N or N m].
        """
        return self._dynamics("inverse_dynamics", pose, twist, acceleration, status, threads)

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
        pose
            (N, 7) position and unit quaternion x y z w of the platform frame [m]; with motor coordinates (N, nu) motor
            positions [m or rad].
        twist
            (N, 6) [v; ω] of its origin in world axes [m/s, rad/s]; or (N, nu) motor rates.
        tau_motor
            (N, nu) motor efforts in the order of ``chain.motors`` [N or N m].
        status
            (N,) int8 array for the codes of the states, dimensionless.
        threads
            Number of threads.

        Returns
        -------
        numpy.ndarray
            (N, 6) [dv/dt; dω/dt] [m/s², rad/s²]; or (N, nu) motor accelerations.
        """
        return self._dynamics("forward_dynamics", pose, twist, tau_motor, status, threads)

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
            return self._kernel("inverse_kinematics")(pose, status=status, threads=threads)
        states, single = self._states(pose)
        closed = self._configurations(states, threads)
        return self._given(closed, closed.states[:, self.chain.motor_q_index], status, single)

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
        kernel = self._kernel("motor_jacobian")
        if self._functions.placed is not None:
            return kernel(pose, status=status, threads=threads)
        states, single = self._states(pose)
        closed = self._configurations(states, threads)
        return self._given(closed, kernel(closed.states, threads=threads), status, single)

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
        target, single = _rows("q_motor", q_motor, self.chain.nu)
        guess = np.broadcast_to(_rows("pose_guess", pose_guess, 7)[0], (len(target), 7))
        if self._functions.placed is not None:
            solved = damped_newton(self._kernel("forward_kinematics_step"), guess, target, threads=threads)
            return self._given(solved, solved.states, status, single)
        begun = self._configurations(guess, threads)
        solved = damped_newton(self._kernel("motor_closing_step"), begun.states, target, threads=threads)
        position, rotation = self._kernel("platform_pose")(solved.states, threads=threads)
        return self._given(solved, np.hstack([position, _quaternions(rotation)]), status, single)

    def _dynamics(
        self,
        name: str,
        position: ArrayLike,
        velocity: ArrayLike,
        third: ArrayLike,
        status: np.ndarray | None,
        threads: int,
    ) -> FloatArray:
        kernel = self._kernel(name)
        if self._functions.placed is not None:
            return kernel(position, velocity, third, status=status, threads=threads)
        states, single = self._states(position)
        closed = self._configurations(states, threads)
        codes = np.zeros(len(states), dtype=np.int8)
        values = kernel(closed.states, velocity, third, status=codes, threads=threads)
        single = single and np.ndim(velocity) == 1 and np.ndim(third) == 1
        return self._given(closed, values, status, single, codes)

    def _configurations(self, targets: FloatArray, threads: int) -> Solved:
        """Whole configurations of poses or motor positions, from home."""
        step = self._kernel("closing_step")
        found: Solved | None = None
        for start in self._starts:
            left = np.arange(len(targets)) if found is None else np.flatnonzero(~found.closed)
            begin = np.broadcast_to(start, (len(left), self.chain.nq))
            solved = damped_newton(step, begin, targets[left], threads=threads)
            found = solved if found is None else found.with_rows(left, solved)
        assert found is not None
        return found

    @cached_property
    def _starts(self) -> FloatArray:
        """Home; or states beside it, in turn, where home is singular as a stretched arm is."""
        home = self.chain.q_home
        target = home[self.chain.motor_q_index]
        if self.coordinates == "platform":
            target = pin.SE3ToXYZQUAT(platform_pose(self.chain, home))
        stays = self._kernel("closing_step")(home, target, np.ones(1))[0]
        return home[None] if np.allclose(stays, home, atol=1e-6) else self._functions.closed.samples

    def _states(self, position: ArrayLike) -> tuple[FloatArray, bool]:
        if self.coordinates == "platform":
            poses, single = _rows("pose", position, 7)
            poses = np.array(poses)
            square = np.einsum("ni,ni->n", poses[:, 3:], poses[:, 3:])
            poses[~(np.abs(square - 1) <= _UNIT)] = np.nan
            return poses, single
        return _rows("pose", position, self.chain.nu)

    def _given(
        self,
        solved: Solved,
        values: FloatArray,
        status: np.ndarray | None,
        single: bool,
        codes: np.ndarray | None = None,
    ) -> FloatArray:
        values = np.array(values)
        values[~solved.closed] = np.nan
        if status is not None:
            if status.shape != (len(solved.closed),) or status.dtype != np.int8:
                raise InputError(f"status must be an int8 array of shape ({len(solved.closed)},)")
            status[:] = StateStatus.OK if codes is None else codes
            status[~solved.closed] = StateStatus.OUT_OF_BOUNDS
        return values[0] if single else values

    def _require_platform(self, verb: str) -> None:
        if self.coordinates != "platform":
            raise UnsupportedError(f"{verb} is for kernels with coordinates='platform'")

    def _kernel(self, name: str) -> ArrayKernel:
        if name not in self._kernels:
            function, bounds = _with_judges(self.casadi(name))
            self._kernels[name] = compile_function(function, bounds=bounds, **self._options)
        return self._kernels[name]


def count_operations(function: Any) -> int:
    """Count the floating-point operations of a CasADi function.

    Parameters
    ----------
    function
        `casadi.Function` of scalar symbols.

    Returns
    -------
    int
        Operations, without reading inputs and constants and writing outputs.
    """
    import casadi as ca  # noqa: PLC0415 - optional; there is a function already

    kinds = [function.instruction_id(k) for k in range(function.n_instructions())]
    return sum(kind not in (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST) for kind in kinds)


def _with_judges(function: Any) -> tuple[Any, list[StateBound]]:
    """Let outputs judge a state: unit quaternions, feasible demands."""
    import casadi as ca  # noqa: PLC0415 - optional; there is a function already

    bounds = [StateBound("infeasible", upper=_FEASIBLE)] if "infeasible" in function.name_out() else []
    if "pose" not in function.name_in():
        return function, bounds
    inputs = function.sx_in()
    quaternion = inputs[function.name_in().index("pose")][3:]
    outputs = [*function.call(inputs), ca.dot(quaternion, quaternion)]
    names = [*function.name_out(), "quaternion_square"]
    bounds.append(StateBound("quaternion_square", 1 - _UNIT, 1 + _UNIT))
    return ca.Function(function.name(), inputs, outputs, function.name_in(), names), bounds


def _rows(name: str, value: ArrayLike, size: int) -> tuple[FloatArray, bool]:
    """Read (N, size) or (size,) states; nan passes, to become a status."""
    array = np.asarray(value, dtype=float)
    if array.ndim not in (1, 2) or array.shape[-1] != size:
        raise InputError(f"{name} must have shape (N, {size}) or ({size},), got {array.shape}")
    return np.atleast_2d(array), array.ndim == 1


def _quaternions(rotation: FloatArray) -> FloatArray:
    """Turn (N, 3, 3) rotations into quaternions x y z w; nan stays nan."""
    found = np.full((len(rotation), 4), np.nan)
    good = np.isfinite(rotation).all(axis=(1, 2))
    if good.any():
        found[good] = Rotation.from_matrix(rotation[good]).as_quat()
    return found
