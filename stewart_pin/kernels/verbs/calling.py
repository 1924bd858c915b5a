"""From the name of a verb and arrays of states to its results: compile once, find configurations, judge rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import DTypeLike

from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.kernels.verbs.configurations import (
    POOR,
    Starts,
    as_poses,
    as_rows,
    configurations,
    judged,
    lost_on_the_way,
    poses_between,
    serves,
    with_unit_quaternions,
)
from stewart_pin.kernels.verbs.ground import GroundMotions, felt_by_ground, read_motions, to_ground
from stewart_pin.kernels.verbs.newton import NewtonSteps, OneSearch, Plans, Solved, straight
from stewart_pin.kernels.verbs.searching import OtherPivots, SearchingState
from stewart_pin.kernels.verbs.sharing import SharingState
from stewart_pin.mechanics.sharing import Sharing
from stewart_pin.model.tree import Limits
from stewart_pin.programs.array_kernel import ArrayKernel, Engine, compile_function
from stewart_pin.programs.arrays import SingleState, as_real, require_apart, require_out
from stewart_pin.programs.status import StateStatus
from stewart_pin.programs.symbolic import drop, writing
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


SingleVerb = Literal[
    "inverse_dynamics",
    "forward_dynamics",
    "reactions",
    "regressor",
    "inverse_kinematics",
    "forward_kinematics",
    "motor_jacobian",
    "inverse_dynamics_derivatives",
    "forward_dynamics_derivatives",
    "inverse_dynamics_geometry",
    "forward_dynamics_geometry",
]
"""Verbs of `Kernels` for one state at a time."""

_GIVEN = {"platform": "pose", "tree": "q"}
"""What kernels take as it is given, by coordinates; motor positions are never enough."""
_SEARCHES = {"pose": "forward_kinematics", "q": "closing"}
"""Equations that lead to what kernels take."""
_NO_STEP = np.zeros(1)
"""Contraction before the first step."""
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
        self._dtype = as_real(dtype)
        self._engine: Engine | None = engine
        self._written: dict[str, Any] = {}
        self._kernels: dict[tuple[str, bool, bool], ArrayKernel] = {}
        self._measures: dict[str, Any] = {}
        self._starts: dict[str, Starts] = {}
        self._others: OtherPivots[Caller] = OtherPivots(functions, lambda f: type(self)(f, dtype, engine))

    def __del__(self) -> None:
        drop(self)

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
            Symbolic function of one state, columns in and out. CasADi is not for several threads at once; kernels are.

        Raises
        ------
        InputError
            If there is no such function.
        UnsupportedError
            If armature, damping or friction of the model have been changed since.
        """
        self._functions.require_same_joints()
        if name not in self._written:
            with writing():
                if name not in self._written:
                    self._written[name] = self._functions.function(name)
        return self._written[name]

    def single_state(
        self,
        verb: SingleVerb,
        *,
        effort_limit: ArrayLike | Limits | None = None,
        sharing: Sharing = "least_norm",
    ) -> SingleState | SearchingState | SharingState:
        """Compile a verb for one state at a time, called with a tenth of the overhead.

        Parameters
        ----------
        verb
            Name of a verb, as ``"inverse_dynamics"``; those that differentiate by the geometry do so by each parameter.
        effort_limit, sharing
            Of ``"inverse_dynamics"``, as of the verb [N or N m].

        Returns
        -------
        SingleState, SearchingState or SharingState
            Function of one state; its results are those of the verb, bit for bit, in fresh arrays unless it is called
            with ``out=``. The second looks for the pose or the configuration first, as the verb does. Armature, damping
            and friction are those of now, whatever becomes of the model.

        Raises
        ------
        InputError
            If there is no such verb.
        UnsupportedError
            If the verb is not for these coordinates, or armature, damping or friction have been changed.
        """
        self._require_resting_ground(f"single_state({verb!r})", verb in _OF_POSES)
        if effort_limit is not None or sharing != "least_norm":
            if verb != "inverse_dynamics":
                raise InputError(f"effort_limit and sharing are for 'inverse_dynamics', got {verb!r}")
            return SharingState(self, effort_limit, sharing)
        if verb in _OF_POSES:
            self._require_platform(verb)
            if verb == "forward_kinematics" or (verb == "inverse_kinematics" and not self.by_legs):
                return SearchingState(self, verb)
        if verb.endswith("_derivatives"):
            self._require_drive(verb)
        if verb in ("inverse_dynamics_geometry", "forward_dynamics_geometry"):
            return SearchingState(self, verb)
        self.casadi(verb)
        kernel = self._kernel(verb)
        if kernel.program.inputs[0].name not in _SEARCHES or (
            self._takes_state(kernel) and not self._wary(verb)
        ):
            return kernel.single_state()
        return SearchingState(self, verb)

    def single_share(self) -> SingleState | SearchingState:
        """Compile the efforts of one state with what motors contribute, as `sharing` takes them.

        Returns
        -------
        SingleState or SearchingState
            The second where pose or configuration must be found first, or other pivots may serve better.
        """
        kernel = self._kernel("motor_share")
        if self._takes_state(kernel) and not self._wary("motor_share"):
            return kernel.single_state()
        return SearchingState(self, "motor_share")

    def answer(self, name: str, *inputs: ArrayLike, status: np.ndarray | None = None) -> Any:
        """Evaluate a function as verbs do, looking for poses and configurations first where these are needed.

        Parameters
        ----------
        name
            One of `names`.
        *inputs
            (N, size) what verbs of the same motion take [any unit].
        status
            (N,) int8 array for the codes of the states, or None, dimensionless.

        Returns
        -------
        numpy.ndarray or tuple of numpy.ndarray
            (N, ...) what it gives [any unit].
        """
        return self._call(name, inputs, Places(None, status, None, 1))

    def single_program(self, name: str) -> SingleState:
        """Compile a function for one state at a time, as it is.

        Parameters
        ----------
        name
            One of `names`.

        Returns
        -------
        SingleState
            Of what the function takes: pose or configuration where these must be found first; of states on which other
            pivots may serve better it makes nothing.
        """
        return self._kernel(name, wary=self._wary(name)).single_state()

    def search(self, state: str, equations: str | None = None) -> OneSearch:
        """Prepare the search for what a function takes.

        Parameters
        ----------
        state
            ``"pose"`` or ``"q"``.
        equations
            What is solved, from starts that calls name; default: what leads from the kernels' coordinates to that
            state, from home.

        Returns
        -------
        OneSearch
            For one state at a time.
        """
        if equations is not None:
            return OneSearch(self._steps(equations), None)
        starts = self._starting(state).states
        return OneSearch(self._steps(_SEARCHES[state]), starts[0] if len(starts) == 1 else None)

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

    @property
    def wrenches(self) -> tuple[str, ...]:
        """Links on which wrenches act from outside, in the order of the argument `wrenches` of the verbs."""
        return self._functions.wrenches

    @property
    def ground_moves(self) -> bool:
        """Whether the verbs of dynamics take how the ground moves."""
        return self._functions.ground_moves

    def _loaded(
        self,
        inputs: tuple[ArrayLike, ...],
        wrenches: ArrayLike | None,
        base_motion: GroundMotions | None = None,
    ) -> tuple[ArrayLike, ...]:
        """Add what acts from outside and how the ground moves, where these kernels take that."""
        links = self.wrenches
        if wrenches is not None and not links:
            raise InputError(
                "wrenches are given, and these kernels were compiled without; "
                "use compile_kernels(chain, wrenches=(link, ...))"
            )
        if wrenches is None and links:
            size = 6 * len(links)
            raise InputError(
                f"wrenches must be given, (N, {size}) or ({size},), [force; moment] on {', '.join(links)}: these "
                "kernels were compiled for them; zero where nothing acts"
            )
        rotation, ground = self._ground(base_motion)
        if wrenches is None:
            return (*inputs, *ground)
        if rotation is not None:
            wrenches = to_ground(rotation, wrenches, len(links)).astype(self._dtype)
        return (*inputs, wrenches, *ground)

    def _ground(self, base_motion: GroundMotions | None) -> tuple[FloatArray | None, tuple[FloatArray, ...]]:
        """Axes of a ground that moves, and what kernels take of its motion; nothing where these know of none."""
        if base_motion is None and not self.ground_moves:
            return None, ()
        if not self.ground_moves:
            raise InputError(
                "base_motion is given, and these kernels were compiled for a ground at rest; "
                "use compile_kernels(chain, base_motion=True)"
            )
        if base_motion is None:
            raise InputError(
                "base_motion must be given, a BaseMotion, one per state or (N, 16): these kernels were compiled for a "
                "ground that moves; BaseMotion() where it rests"
            )
        rotation, motion = read_motions(base_motion)
        return rotation, (felt_by_ground(rotation, motion, self.chain.gravity).astype(self._dtype),)

    def _require_resting_ground(self, verb: str, of_poses: bool = False) -> None:
        if self.ground_moves and not of_poses:
            raise UnsupportedError(
                f"{verb} is for kernels whose ground rests, these were compiled with base_motion=True; "
                "dynamics.inverse_dynamics_derivatives differentiates one state on a ground that moves"
            )

    def _call(self, name: str, inputs: tuple[ArrayLike, ...], places: Places) -> Any:
        kernel = self._kernel(name, graded=places.conditioning is not None, wary=self._wary(name))
        if self._takes_state(kernel):
            count = count_states(inputs)
            out = self._room(kernel, places, 1 if count is None else count, single=count is None)
            codes = places.status
            if codes is None and self._wary(name):
                codes = np.zeros(1 if count is None else count, dtype=np.int8)
            values = kernel(*inputs, out=out, status=codes, threads=places.threads)
            if codes is not None and self._wary(name):
                self._look_again(name, inputs, values, codes, places, single=count is None)
            return values if places.conditioning is None else _without_last(values)
        return self._call_configurations(name, kernel, inputs, places)

    def _call_configurations(
        self, name: str, kernel: ArrayKernel, inputs: tuple[ArrayLike, ...], places: Places
    ) -> Any:
        states, single = self._states(inputs[0])
        solved = self._configurations(states, places.threads, kernel.program.inputs[0].name)
        many = count_states(inputs[1:])
        if many is not None and len(solved.states) == 1:  # one position, several motions of it
            solved, single = solved.with_rows_of(np.zeros(many, dtype=int)), False
            states = np.repeat(states, many, axis=0)
        count = len(solved.states)
        codes = np.zeros(count, dtype=np.int8)
        out = self._room(kernel, places, count, single=single)
        if single and out is not None:
            out = [None if x is None else x[None] for x in out]
        values = kernel(solved.states, *inputs[1:], out=out, status=codes, threads=places.threads)
        values = values if isinstance(values, tuple) else (values,)
        if self._wary(name):
            self._look_again(name, (solved.states, *inputs[1:]), values, codes, places, targets=states)
        if places.conditioning is not None:
            lost_on_the_way(places.conditioning)
        rows = self._beyond_legs(states, solved, codes)
        if len(rows):
            solved = self._by_whole_tree(name, (states, *inputs[1:]), rows, solved, values, codes, places)
        given = self._given(solved, values, places.status, single=single, codes=codes)
        if places.conditioning is None:
            return given
        return _without_last(given)

    def _beyond_legs(self, states: FloatArray, solved: Solved, codes: np.ndarray) -> np.ndarray:
        """Rows that legs in closed form do not answer from their motors, and the whole tree may."""
        if not self.by_legs or self.coordinates != "motor":
            return np.zeros(0, dtype=int)
        # Pivots of legs are what they are: of the whole tree there are others.
        lost = codes == StateStatus.SINGULAR
        if self._functions.other_elbows:
            lost |= ~solved.kept & np.isfinite(states).all(axis=1)
        return np.flatnonzero(lost)

    def _by_whole_tree(
        self,
        name: str,
        inputs: Sequence[ArrayLike],
        rows: np.ndarray,
        solved: Solved,
        values: Sequence[FloatArray],
        codes: np.ndarray,
        places: Places,
    ) -> Solved:
        """Answer rows that legs with elbows as at home do not: motors may lead through dead centres."""
        taken = [_rows_of(x, rows) for x in inputs]
        status = np.zeros(len(rows), dtype=np.int8)
        graded: Any = np.zeros(len(rows), dtype=self._dtype)
        conditioning: FloatArray | None = None if places.conditioning is None else graded
        found = self._others.at_home()._call(
            name, tuple(taken), Places(None, status, conditioning, places.threads)
        )
        for value, new in zip(values, found if isinstance(found, tuple) else (found,), strict=False):
            value[rows] = new
        if conditioning is not None and places.conditioning is not None:
            places.conditioning[rows] = conditioning
        codes[rows] = status
        closed, kept = solved.closed.copy(), solved.kept.copy()
        closed[rows], kept[rows] = True, True  # what became of them stands in their codes
        return Solved(solved.states, closed, kept)

    def _wary(self, name: str) -> bool:
        """Whether other pivots may serve a verb where the usual ones do not."""
        return (
            self._functions.replanned and not name.endswith("_by_tree") and self._measured(name) is not None
        )

    def _look_again(
        self,
        name: str,
        inputs: Sequence[ArrayLike],
        values: Any,
        codes: np.ndarray,
        places: Places,
        *,
        single: bool = False,
        targets: FloatArray | None = None,
    ) -> None:
        """Answer poor rows by the choice of pivots that serves them best, also to close on their targets."""
        rows = np.flatnonzero(codes == StateStatus.SINGULAR)
        if not len(rows):
            return
        taken = [_rows_of(x, rows) for x in inputs]
        first = np.atleast_2d(taken[0])
        taken[0] = np.repeat(first, len(rows), axis=0) if len(first) == 1 else first
        aims = None if targets is None else targets[rows]
        best, best_codes, known = self._best(name, taken, aims, None, 0, places.threads)
        while True:
            poor = np.flatnonzero(~(best[-1][:, 0] >= POOR))
            if not len(poor) or not self._others.around_one_of(taken[0][poor], best[-1][poor, 0]):
                break
            best, best_codes, known = self._best(name, taken, aims, (best, best_codes), known, places.threads)
        codes[rows] = best_codes
        given = values if isinstance(values, tuple) else (values,)
        for value, found in zip(given, best, strict=False):
            if single:
                value[...] = found[0]
            else:
                value[rows] = found
        if places.conditioning is not None and len(given) < len(best):
            places.conditioning[rows] = best[-1][:, 0]

    def _best(
        self,
        name: str,
        inputs: Sequence[Any],
        targets: FloatArray | None,
        best: tuple[list[FloatArray], np.ndarray] | None,
        known: int,
        threads: int,
    ) -> tuple[list[FloatArray], np.ndarray, int]:
        """Compare choices of pivots by the conditioning they have, from one on; the last value is the conditioning."""
        plans = (self, *self._others)
        values, codes = best if best is not None else ([], np.zeros(0))
        for plan in plans[known:]:
            status, own = np.zeros(len(inputs[0]), dtype=np.int8), list(inputs)
            if targets is not None and plan is not self:  # by poor pivots a configuration is known less well
                own[0] = plan._steps(_SEARCHES["q"]).double(inputs[0], targets, _NO_STEP, threads=threads)[0]
            found = list(plan._kernel(name, graded=True, wary=False)(*own, status=status, threads=threads))
            if not values:
                values, codes = found, status
                continue
            better = np.flatnonzero(~(values[-1][:, 0] >= found[-1][:, 0]) & np.isfinite(found[-1][:, 0]))
            codes[better] = status[better]
            for old, new in zip(values, found, strict=True):
                old[better] = new[better]
        return values, codes, len(plans)

    def _measured(self, name: str) -> Any | None:
        """Conditioning of a function."""
        if name not in self._measures:
            with writing():
                self._measures[name] = self._functions.conditioning_of(name, self.casadi(name))
        return self._measures[name]

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
        between = poses_between if self.coordinates == "platform" else straight
        plans = self._plans(_SEARCHES[state])
        return configurations(plans, self._starting(state), targets, between, threads=threads)

    def _starting(self, state: str) -> Starts:
        """Tell where searches start."""
        if state not in self._starts:
            home, target, beside = self._functions.around_home(state)
            if serves(self._steps(_SEARCHES[state]), home, target):
                self._starts[state] = Starts(home[None], target[None])
            elif state == "pose":
                self._starts[state] = Starts(beside, self._kernel("inverse_kinematics")(beside))
            else:
                self._starts[state] = Starts(beside, self._met(beside))
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
        every = bool(solved.kept.all())
        if status is not None:
            require_out("status", status, solved.closed.shape, np.dtype(np.int8))
            require_apart("status", status, [("a result", value) for value in values])
            status[:] = StateStatus.OK if codes is None else codes
            if not every:
                status[~solved.kept] = StateStatus.BRANCH_LOST
                status[~solved.closed] = StateStatus.OUT_OF_BOUNDS
        if not every:
            for value in values:
                value[~solved.kept] = np.nan
        given = [value[0] if single else value for value in values]
        return given[0] if len(given) == 1 else tuple(given)

    def _require_platform(self, verb: str) -> None:
        if self.coordinates != "platform":
            raise UnsupportedError(f"{verb} is for kernels with coordinates='platform'")

    def _require_drive(self, verb: str) -> None:
        if self.coordinates == "tree":
            raise UnsupportedError(
                f"{verb} is for kernels with coordinates='platform' or 'motor'; of the whole tree differentiate "
                "casadi('tree_inverse_dynamics') or casadi('tree_forward_dynamics')"
            )

    def _steps(self, equations: str) -> NewtonSteps:
        return NewtonSteps(
            self._kernel(f"{equations}_double_step"),
            lambda: self._kernel(f"{equations}_step"),
            lambda: self._kernel(f"{equations}_stretch_step"),
        )

    def _plans(self, equations: str) -> Plans:
        """Give steps by all choices of pivots."""
        met = None
        if equations == "closing" and self._functions.driven.surplus:
            met = self._met
        elif equations == "motor_closing" and self._functions.motor_driven.surplus:
            met = self._motors
        if equations == "forward_kinematics" or not self._functions.replanned:
            return Plans(lambda: [self._steps(equations)], met=met)
        return Plans(
            lambda: [one._steps(equations) for one in (self, *self._others)], self._others.around_one_of, met
        )

    def _met(self, states: FloatArray) -> FloatArray:
        """Targets that configurations meet."""
        if self.coordinates == "motor":
            return self._motors(states)
        return as_poses(*self._kernel("platform_pose")(states))

    def _motors(self, states: FloatArray) -> FloatArray:
        return states[:, self.chain.motor_q_index]

    def _takes_state(self, kernel: ArrayKernel) -> bool:
        """Whether a kernel takes what its verb is given, and no configuration that must be found first."""
        return kernel.program.inputs[0].name == _GIVEN.get(self.coordinates)

    def _kernel(self, name: str, *, graded: bool = False, wary: bool = False) -> ArrayKernel:
        """Compile a function, at first use; graded: with its conditioning as the last output; wary: see `judged`."""
        self._functions.require_same_joints()
        if (name, graded, wary) not in self._kernels:
            with writing():
                if (name, graded, wary) not in self._kernels:
                    self._kernels[name, graded, wary] = self._compiled(name, graded=graded, wary=wary)
        return self._kernels[name, graded, wary]

    def _compiled(self, name: str, *, graded: bool, wary: bool) -> ArrayKernel:
        function, measure = self.casadi(name), self._measured(name)
        if graded and measure is None:
            raise UnsupportedError(
                f"{name!r} divides by nothing, and has no conditioning; leave out conditioning="
            )
        found, push = self.coordinates == "motor", self._functions.push_of(name, function)
        function, bounds = judged(function, measure, self._dtype, push, graded=graded, wary=wary, found=found)
        derivatives = [output for output in function.name_out() if output.startswith("by_")]
        return compile_function(
            function, bounds=bounds, dtype=self._dtype, engine=self._engine, matrices=derivatives
        )


def count_states(inputs: Sequence[ArrayLike]) -> int | None:
    """Count the states that arrays hold; where they differ, kernels say so.

    Parameters
    ----------
    inputs
        (N, size), (1, size) or (size,) each [any unit].

    Returns
    -------
    int or None
        N; None where all are of one state without an axis.
    """
    lengths = {len(np.asarray(x)) for x in inputs if np.ndim(x) > 1}
    return max(lengths - {1}, default=1) if lengths else None


def _rows_of(value: ArrayLike, rows: np.ndarray) -> np.ndarray:
    """Pick states; one for all of them stays."""
    array = np.asarray(value)
    return array[rows] if array.ndim > 1 and len(array) > 1 else array


def _without_last(values: tuple[FloatArray, ...]) -> Any:
    return values[0] if len(values) == 2 else values[:-1]
