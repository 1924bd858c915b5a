"""From the name of a verb and arrays of states to its results: compile once, find configurations, judge rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import DTypeLike

from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.kernels.compile_function import compile_function
from stewart_pin.kernels.programs.status import StateStatus
from stewart_pin.kernels.running.array_kernel import ArrayKernel, Engine
from stewart_pin.kernels.running.arrays import require_apart, require_out
from stewart_pin.kernels.running.single_state import SingleState
from stewart_pin.kernels.verbs.configurations import as_rows, configurations, starts, with_unit_quaternions
from stewart_pin.kernels.verbs.judges import judged
from stewart_pin.kernels.verbs.newton import NewtonSteps, OneSearch, Solved
from stewart_pin.kernels.verbs.searching import SearchingState
from stewart_pin.typing import ArrayLike, FloatArray

if TYPE_CHECKING:
    from stewart_pin.kernels.graph.function_set import FunctionSet


@dataclass(frozen=True, eq=False)
class Places:
    """Where a verb writes, and with how many threads.

    Attributes
    ----------
    out
        Array for each result, or None [any unit].
    status
        (N,) int8 array for the codes of the states, or None, dimensionless.
    conditioning
        (N,) array for the conditioning of the states, or None, dimensionless.
    threads
        Number of threads.
    """

    out: FloatArray | Sequence[FloatArray] | None
    status: np.ndarray | None
    conditioning: FloatArray | None
    threads: int


_GIVEN = {"platform": "pose", "tree": "q"}
"""What kernels take as it is given, by coordinates; motor positions are never enough."""
_SEARCHES = {"pose": "forward_kinematics", "q": "closing"}
"""Equations that lead to what kernels take."""
_OF_POSES = ("inverse_kinematics", "forward_kinematics", "motor_jacobian")
"""Verbs of platform coordinates alone."""


class Caller:
    """Compiled functions of a chain by name.

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
        self._dtype = np.dtype(dtype)
        self._engine: Engine | None = engine
        if self._dtype not in (np.float64, np.float32):
            raise InputError(f"dtype must be float64 or float32, got {self._dtype}")
        self._written: dict[str, Any] = {}
        self._kernels: dict[tuple[str, bool], ArrayKernel] = {}
        self._starts: dict[str, FloatArray] = {}

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

    def single_state(self, verb: str) -> SingleState | SearchingState:
        """Compile a verb for one state at a time, called with a tenth of the overhead.

        Parameters
        ----------
        verb
            Name of a verb, as ``"inverse_dynamics"``; those that differentiate by the geometry do so by each parameter.

        Returns
        -------
        SingleState or SearchingState
            Function of one state; its results are those of the verb, bit for bit, in fresh arrays unless it is called
            with ``out=``. The second looks for the pose or the configuration first, as the verb does.

        Raises
        ------
        InputError
            If there is no such verb.
        UnsupportedError
            If the verb is not for these coordinates.
        """
        if verb in _OF_POSES:
            self._require_platform(verb)
            if verb == "forward_kinematics" or (verb == "inverse_kinematics" and not self.by_legs):
                return SearchingState(self, verb)
        if verb in ("inverse_dynamics_geometry", "forward_dynamics_geometry"):
            return SearchingState(self, verb)
        self.casadi(verb)
        kernel = self._kernel(verb)
        if self._takes_state(kernel) or kernel.program.inputs[0].name not in _SEARCHES:
            return kernel.single_state()
        return SearchingState(self, verb)

    def single_program(self, name: str) -> SingleState:
        """Compile a function for one state at a time, as it is.

        Parameters
        ----------
        name
            One of `names`.

        Returns
        -------
        SingleState
            Of what the function takes: pose or configuration where these must be found first.
        """
        return self._kernel(name).single_state()

    def search(self, state: str, equations: str | None = None, *, from_home: bool = True) -> OneSearch:
        """Prepare the search for what a function takes.

        Parameters
        ----------
        state
            ``"pose"`` or ``"q"``.
        equations
            What is solved; default: what leads from the kernels' coordinates to that state.
        from_home
            Whether calls need no start of their own.

        Returns
        -------
        OneSearch
            For one state at a time.
        """
        steps = self._steps(_SEARCHES[state] if equations is None else equations)
        return OneSearch(steps, self._start(state, steps) if from_home else np.zeros((0, 0)))

    def takes(self, state: str) -> bool:
        """Tell whether what a function takes is what its verb is given.

        Parameters
        ----------
        state
            ``"pose"`` or ``"q"``.

        Returns
        -------
        bool
            False where it must be found first.
        """
        return state == _GIVEN.get(self.coordinates)

    @property
    def blocked(self) -> np.ndarray:
        """(parameters,) of bool, dimensionless: displacements of the geometry along which there is no derivative."""
        return ~self._functions.displacements.alone

    @property
    def by_legs(self) -> bool:
        """Whether the chain comes apart into a platform and legs with closed forms."""
        return self._functions.placed is not None

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the arrays and of every operation."""
        return self._dtype

    def _call(self, name: str, inputs: tuple[ArrayLike, ...], places: Places) -> Any:
        kernel = self._kernel(name, graded=places.conditioning is not None)
        if self._takes_state(kernel):
            count = next((len(np.asarray(x)) for x in inputs if np.ndim(x) > 1), None)
            out = self._room(kernel, places, 1 if count is None else count, single=count is None)
            values = kernel(*inputs, out=out, status=places.status, threads=places.threads)
            return values if places.conditioning is None else _without_last(values)
        return self._call_configurations(kernel, inputs, places)

    def _call_configurations(self, kernel: ArrayKernel, inputs: tuple[ArrayLike, ...], places: Places) -> Any:
        states, single = self._states(inputs[0])
        solved = self._configurations(states, places.threads, kernel.program.inputs[0].name)
        many = [len(np.asarray(x)) for x in inputs[1:] if np.ndim(x) > 1]
        if single and many:  # one position, several motions of it
            solved, single = solved.with_rows_of(np.zeros(many[0], dtype=int)), False
        count = len(solved.states)
        codes = np.zeros(count, dtype=np.int8)
        out = self._room(kernel, places, count, single=single)
        if single and out is not None:
            out = [None if x is None else x[None] for x in out]
        values = kernel(solved.states, *inputs[1:], out=out, status=codes, threads=places.threads)
        values = values if isinstance(values, tuple) else (values,)
        given = self._given(solved, values, places.status, single=single, codes=codes)
        return given if places.conditioning is None else _without_last(given)

    def _room(
        self, kernel: ArrayKernel, places: Places, count: int, *, single: bool
    ) -> list[FloatArray | None] | None:
        """Arrays for all that a kernel writes; None for what it makes itself."""
        if places.out is None and places.conditioning is None:
            return None
        given = places.out
        wanted = len(kernel.outputs) - (places.conditioning is not None)
        own: list[FloatArray | None]
        own = [None] * wanted if given is None else [given] if isinstance(given, np.ndarray) else list(given)
        if places.conditioning is None:
            return own
        require_out("conditioning", places.conditioning, (count,), self._dtype)
        return [*own, places.conditioning if single else places.conditioning[:, None]]

    def _configurations(self, targets: FloatArray, threads: int, state: str = "q") -> Solved:
        """Find configurations, or poses where the kernel that takes them is satisfied with these."""
        steps = self._steps(_SEARCHES[state])
        return configurations(steps, self._start(state, steps), targets, threads=threads)

    def _start(self, state: str, steps: NewtonSteps) -> FloatArray:
        if state not in self._starts:
            self._starts[state] = starts(steps, *self._functions.around_home(state))
        return self._starts[state]

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
        *,
        single: bool,
        codes: np.ndarray | None = None,
    ) -> Any:
        """Strike out rows without a configuration."""
        every = bool(solved.closed.all())
        if status is not None:
            require_out("status", status, solved.closed.shape, np.dtype(np.int8))
            require_apart("status", status, [("a result", value) for value in values])
            status[:] = StateStatus.OK if codes is None else codes
            if not every:
                status[~solved.closed] = StateStatus.OUT_OF_BOUNDS
        if not every:
            for value in values:
                value[~solved.closed] = np.nan
        given = [value[0] if single else value for value in values]
        return given[0] if len(given) == 1 else tuple(given)

    def _require_platform(self, verb: str) -> None:
        if self.coordinates != "platform":
            raise UnsupportedError(f"{verb} is for kernels with coordinates='platform'")

    def _steps(self, equations: str) -> NewtonSteps:
        return NewtonSteps(
            self._kernel(f"{equations}_double_step"), lambda: self._kernel(f"{equations}_step")
        )

    def _takes_state(self, kernel: ArrayKernel) -> bool:
        """Whether a kernel takes what its verb is given, and no configuration that must be found first."""
        return kernel.program.inputs[0].name == _GIVEN.get(self.coordinates)

    def _kernel(self, name: str, *, graded: bool = False) -> ArrayKernel:
        """Compile a function, at first use; graded: with its conditioning as the last output."""
        if (name, graded) not in self._kernels:
            function = self.casadi(name)
            measure = self._functions.conditioning_of(name, function)
            function, bounds = judged(function, measure, self._dtype, graded=graded)
            self._kernels[name, graded] = compile_function(
                function, bounds=bounds, dtype=self._dtype, engine=self._engine
            )
        return self._kernels[name, graded]


def _without_last(values: tuple[FloatArray, ...]) -> Any:
    return values[0] if len(values) == 2 else values[:-1]
