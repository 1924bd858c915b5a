"""A verb for one state at a time that first looks for the pose or the whole configuration; and other pivots."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
import pinocchio as pin

from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.kernels.planning.elimination import REGULAR
from stewart_pin.kernels.verbs.configurations import (
    POOR,
    as_poses,
    lost_on_the_way,
    normalised,
    with_unit_quaternions,
)
from stewart_pin.programs.arrays import require_out
from stewart_pin.programs.status import StateStatus
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.generic import regularity
from stewart_pin.state.newton import close_loops
from stewart_pin.typing import ArrayLike, Configuration, FloatArray

if TYPE_CHECKING:
    from stewart_pin.kernels.graph.function_set import FunctionSet
    from stewart_pin.kernels.verbs.calling import Caller


Quick = Callable[..., tuple[FloatArray, ...] | None]
"""Results of one state, or None where more than a few steps are needed."""


class SearchingState:
    """A verb that is called with one state and looks for pose or configuration first; made by `Kernels.single_state`.

    Where a few steps leave a doubt, the verb for arrays answers. One thread at a time: each thread makes its own.

    Parameters
    ----------
    caller
        Kernels.
    verb
        Name of the verb.
    """

    def __init__(self, caller: Caller, verb: str) -> None:
        self._made_from = (caller, verb)
        self._names, self._sizes, self._quick = _prepared(caller, verb)
        self._verb: Callable[..., Any] = getattr(caller, verb, None) or partial(caller.answer, verb)
        self.status = StateStatus.OK

    def __reduce__(self) -> tuple[Any, ...]:
        return SearchingState, self._made_from

    def __call__(self, *inputs: ArrayLike, out: FloatArray | Sequence[FloatArray] | None = None) -> Any:
        """Evaluate the verb.

        Parameters
        ----------
        *inputs
            The verb's arrays, each of one state [any unit].
        out
            Array for the result, or one for each, to write to [any unit]; None makes fresh ones.

        Returns
        -------
        numpy.ndarray or tuple of numpy.ndarray
            What the verb gives for this state, bit for bit [any unit]; nan unless ``status`` is OK.

        Raises
        ------
        InputError
            If number, shape or type of an argument does not fit.
        """
        if len(inputs) != len(self._names):
            raise InputError(
                f"{self._made_from[1]} takes {len(self._names)} arrays ({', '.join(self._names)}), got {len(inputs)}"
            )
        taken = [_one(name, size, x) for name, size, x in zip(self._names, self._sizes, inputs, strict=True)]
        results = self._quick(*taken)
        self.status = StateStatus.OK
        if results is None:
            status = np.zeros(1, dtype=np.int8)
            found = self._verb(*(x[None] for x in taken), status=status)
            results = tuple(x[0] for x in (found if isinstance(found, tuple) else (found,)))
            self.status = StateStatus(int(status[0]))
        if out is not None:
            given = (out,) if isinstance(out, np.ndarray) else tuple(out)
            if len(given) != len(results):
                raise InputError(f"out must hold {len(results)} arrays, got {len(given)}")
            for place, result in zip(given, results, strict=True):
                require_out("out", place, result.shape, result.dtype)
                place[...] = result
            results = given
        return results[0] if len(results) == 1 else results


def _one(name: str, size: int, value: ArrayLike) -> FloatArray:
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be an array of real numbers, got {value!r}") from None
    if array.shape != (size,):
        raise InputError(f"{name} must be one state of shape ({size},), got {array.shape}")
    return array


def _prepared(caller: Caller, verb: str) -> tuple[tuple[str, ...], tuple[int, ...], Quick]:
    """Names and sizes of the arguments, and what answers at once where it can."""
    nu = caller.chain.nu
    if verb == "forward_kinematics":
        return ("q_motor", "pose_guess"), (nu, 7), _forward_kinematics(caller)
    first = ("pose", {"platform": 7, "motor": nu, "tree": caller.chain.nq}[caller.coordinates])
    if verb == "inverse_kinematics":
        search, motors = caller.search("q"), caller.chain.motor_q_index

        def positions(pose: FloatArray) -> tuple[FloatArray, ...] | None:
            q = search(with_unit_quaternions(pose[None])[0])
            return None if q is None else (q[motors],)

        return (first[0],), (first[1],), positions
    by_geometry = verb.endswith("_geometry")
    kernel = caller.single_program(verb.replace("_geometry", "_by_tree"))
    blocked = caller.blocked if by_geometry else None
    ports = kernel.program.inputs
    search = None if caller.takes(ports[0].name) else caller.search(ports[0].name)
    unit = caller.coordinates == "platform" and search is not None

    def answer(position: FloatArray, *rest: FloatArray) -> tuple[FloatArray, ...] | None:
        target = with_unit_quaternions(position[None])[0] if unit else position
        state = target if search is None else search(target)
        if state is None:
            return None
        found = kernel(state, *rest)
        if kernel.status is not StateStatus.OK or (verb == "conditioning" and not found[0] >= POOR):
            return None
        if blocked is not None:
            found[:, blocked] = np.nan
        if verb == "conditioning" and search is not None:
            lost_on_the_way(found)
        return found if isinstance(found, tuple) else (found,)

    names = (first[0], *(port.name for port in ports[1:]))
    return names, (first[1], *(port.size for port in ports[1:])), answer


def _forward_kinematics(caller: Caller) -> Quick:
    if caller.by_legs:
        search = caller.search("pose", "forward_kinematics")

        def by_legs(q_motor: FloatArray, guess: FloatArray) -> tuple[FloatArray, ...] | None:
            pose = search(q_motor, guess)
            return None if pose is None else (pose,)

        return by_legs
    begin, towards = caller.search("q"), caller.search("q", "motor_closing")
    platform = caller.single_program("platform_pose")

    def by_tree(q_motor: FloatArray, guess: FloatArray) -> tuple[FloatArray, ...] | None:
        start = begin(normalised(guess[None])[0])
        q = None if start is None else towards(q_motor, start)
        if q is None:
            return None
        position, rotation = platform(q)
        return (as_poses(position.reshape(1, 3), rotation.reshape(1, 3, 3))[0],)

    return by_tree


# ----------------------------------------------------------------------------------------------------
# Other choices of pivots of a chain, each made when one is wanted that the others do not give
# ----------------------------------------------------------------------------------------------------

_MOST, _TRIED, _LOOKED_AT = 8, 24, 8
"""Choices besides the usual one, how often one is asked for that may turn out to be known, and states that are looked
at for one."""
_BESIDE = 1e-3
"""How far a state that is looked at may be from closed loops. It must be `REGULAR`: where pivots are judged by the
states around which they were chosen, these must be nothing special."""
_BETTER = 10.0
"""How much more regular than the best choice so far makes of it a state must be, for another choice to be worth it."""

Kernels = TypeVar("Kernels")


class OtherPivots(Generic[Kernels]):
    """Kernels of one chain by other pivots than the usual ones; iterates over those that have been made.

    Parameters
    ----------
    functions
        Functions by the usual pivots.
    make
        Makes kernels of functions.
    """

    def __init__(self, functions: FunctionSet, make: Callable[[FunctionSet], Kernels]) -> None:
        self._functions, self._make = functions, make
        self._made: list[Kernels] = []
        self._known, self._tried = [functions.pivots], 0

    def __iter__(self) -> Iterator[Kernels]:
        return iter(self._made)

    def at_home(self) -> Kernels:
        """Return kernels of the whole tree, pivots chosen around home.

        Returns
        -------
        Kernels
            The first that have been made.
        """
        if not self._made:
            self._made.append(self._make(self._functions.around(self._functions.chain.q_home)))
        return self._made[0]

    def around_one_of(self, states: FloatArray, served: FloatArray | None = None) -> bool:
        """Choose pivots around one of several configurations, at which the chain itself is regular.

        Parameters
        ----------
        states
            (k, nq) configurations where no choice serves [m, rad, unit quaternions].
        served
            (k,) best conditioning so far, dimensionless; None where there is none.

        Returns
        -------
        bool
            Whether another choice has been made.
        """
        for k in np.unique(np.linspace(0, len(states) - 1, _LOOKED_AT).astype(int)):
            found = 0.0 if served is None else float(np.nan_to_num(served[k]))
            # On the way of a platform motors may stand at a dead centre.
            motors = served is not None or self._functions.coordinates != "platform"
            q = _regular(self._functions.chain, states[k], max(REGULAR, _BETTER * found), motors=motors)
            if q is None:
                continue
            if len(self._made) >= _MOST or self._tried >= _TRIED:
                return False
            self._tried += 1
            try:
                other = self._functions.around(q)
            except UnsupportedError:
                continue
            if other.freedoms != self._functions.freedoms:  # round-off of closed loops taken for a pivot
                continue
            if other.pivots in self._known:  # states that are poor for another reason
                continue
            self._known.append(other.pivots)
            self._made.append(self._make(other))
            return True
        return False


def _regular(chain: ClosedChain, q: FloatArray, least: float, *, motors: bool) -> Configuration | None:
    """Close the loops of a configuration, if that leads to a regular one beside it."""
    if not np.isfinite(q).all():
        return None
    q = pin.normalize(chain.model, np.array(q, dtype=float))
    closure = close_loops(chain, q, throw=False)
    moved = np.abs(pin.difference(chain.model, q, closure.q) / chain.tangent_scale).max(initial=0.0)
    good = closure.success and moved < _BESIDE and regularity(closure.state, motors=motors) >= least
    return closure.q if good else None
