"""The points of a study, a grid over named axes or a list that the axes share; and its tasks on an executor."""

from __future__ import annotations

import functools
import hashlib
import inspect
import math
import os
import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from typing import Any

import numpy as np

from stewart_pin.errors import InputError
from stewart_pin.typing import ArrayLike

MOST_POINTS = 100_000_000
"""Points whose results still fit in memory."""
Point = dict[str, Any]
"""Value of each parameter, as Python's own numbers and strings."""


@dataclass(frozen=True, eq=False)
class Points:
    """Values of named parameters at the points of a study.

    Attributes
    ----------
    axes
        Values along each axis, by the name of its parameter [any unit].
    paired
        Whether the k-th values of all axes belong together; otherwise every value meets every other.
    """

    axes: Mapping[str, np.ndarray]
    paired: bool

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the grid, or (N,) of a list of points."""
        lengths = tuple(values.size for values in self.axes.values())
        return lengths[:1] if self.paired else lengths

    @property
    def size(self) -> int:
        """Number of points."""
        return math.prod(self.shape)

    def index(self, number: int) -> tuple[int, ...]:
        """Find where a point stands in arrays of results.

        Parameters
        ----------
        number
            Number of the point, counted with the last axis running fastest.

        Returns
        -------
        tuple of int
            Its index.
        """
        return tuple(int(i) for i in np.unravel_index(number, self.shape))

    def at(self, number: int) -> Point:
        """Look up the parameters of a point.

        Parameters
        ----------
        number
            Number of the point, counted with the last axis running fastest.

        Returns
        -------
        dict
            Value of each parameter.
        """
        index = self.index(number)
        index = index * len(self.axes) if self.paired else index
        return {name: values[i].item() for (name, values), i in zip(self.axes.items(), index, strict=True)}

    def groups(self, names: Sequence[str]) -> np.ndarray:
        """Tell which points share the values of some parameters.

        Parameters
        ----------
        names
            Names of the parameters.

        Returns
        -------
        numpy.ndarray
            (N,) index of the group of each point; points of a group have the same values.
        """
        group = np.zeros(self.size, dtype=np.int64)
        for k, (name, values) in enumerate(self.axes.items()):
            if name not in names:
                continue
            own, index = np.unique(values, return_inverse=True)
            along = [-1 if self.paired or j == k else 1 for j in range(len(self.shape))]
            both = group.reshape(self.shape) * own.size + index.reshape(along)
            group = np.unique(both, return_inverse=True)[
                1
            ].ravel()  # small again, whatever the number of axes
        return group

    def described(self) -> dict[str, Any]:
        """Describe the points so that two studies of other points can be told apart.

        Returns
        -------
        dict
            Of each axis its length, its ends, and a digest of all its values.
        """
        axes = {
            name: {
                "values": values.size,
                "ends": [values[k].item() for k in (0, -1)] if values.size else [],
                "sha256": hashlib.sha256(repr(values.tolist()).encode()).hexdigest(),
            }
            for name, values in self.axes.items()
        }
        return {"paired": self.paired, "axes": axes}


def as_points(axes: Mapping[str, ArrayLike], *, paired: bool = False) -> Points:
    """Check axes at the door.

    Parameters
    ----------
    axes
        Values along each axis, by the name of its parameter: numbers or strings [any unit].
    paired
        Whether the k-th values of all axes belong together.

    Returns
    -------
    Points
        The points.

    Raises
    ------
    InputError
        If there is no axis, one is no list of finite numbers or of strings, paired axes are not of the same length, or
        there are too many points.
    """
    if not isinstance(axes, Mapping) or not axes:
        raise InputError(f"axes must map names of parameters to their values, got {axes!r}")
    points = Points({name: _as_axis(name, values) for name, values in axes.items()}, bool(paired))
    lengths = {name: values.size for name, values in points.axes.items()}
    if paired and len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {n}" for name, n in lengths.items())
        raise InputError(f"paired axes need the same number of values, got {listed}")
    if points.size > MOST_POINTS:
        raise InputError(f"axes give {points.size} points; {MOST_POINTS} is the most")
    return points


def _as_axis(name: str, values: ArrayLike) -> np.ndarray:
    if not isinstance(name, str):
        raise InputError(f"axes must have names of parameters, got {name!r}")
    try:
        array = np.array(values)
    except ValueError:  # rows of different lengths
        array = np.array(None)
    kind = array.dtype.kind
    # NumPy writes numbers beside strings as strings.
    texts = kind == "U" and all(isinstance(value, str) for value in np.array(values, dtype=object).flat)
    if array.ndim != 1 or not (kind in "biuf" or texts):
        raise InputError(f"axis {name!r} must be a list of numbers or of strings, got {values!r:.60}")
    if kind == "f":
        array = array.astype(np.float64)
        if not np.isfinite(array).all():
            bad = array[~np.isfinite(array)][0]
            raise InputError(f"axis {name!r} must be finite, got {bad}")
    array.setflags(write=False)
    return array


def words(point: Point) -> str:
    """Write a point for a message.

    Parameters
    ----------
    point
        Value of each parameter.

    Returns
    -------
    str
        As ``amplitude=0.02, frequency=3.0``.
    """
    return ", ".join(f"{name}={value!r}" for name, value in point.items())


def require_parameters(function: Callable[..., Any], names: Sequence[str], *, what: str = "function") -> None:
    """Check that a function takes the parameters of a study, all of them and no other.

    Parameters
    ----------
    function
        Function of named parameters.
    names
        Names of the parameters that it will be given.
    what
        What to call it in the message.

    Raises
    ------
    InputError
        If it cannot be called, or not with these names.
    """
    if not callable(function):
        raise InputError(f"{what} must be a function of {', '.join(names)}, got {function!r:.60}")
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # some functions written in C do not say what they take
        return
    try:
        signature.bind(**dict.fromkeys(names))
    except TypeError as error:
        raise InputError(
            f"{what} {function_name(function)}{signature} does not fit the parameters {', '.join(names)}: {error}"
        ) from None


def function_name(function: Callable[..., Any]) -> str:
    """Name a function, for messages and journals.

    Parameters
    ----------
    function
        Function, partial function, or object that can be called.

    Returns
    -------
    str
        Module and name, of an object those of its class; of a partial function also numbers and strings that are bound.
    """
    if isinstance(function, functools.partial):
        bound = [*map(_short, function.args), *(f"{k}={_short(v)}" for k, v in function.keywords.items())]
        return f"{function_name(function.func)}({', '.join(bound)})"
    named = function if inspect.isroutine(function) or inspect.isclass(function) else type(function)
    return f"{named.__module__}.{named.__qualname__}"


def _short(value: object) -> str:
    return repr(value) if isinstance(value, (bool, int, float, str)) else f"<{type(value).__name__}>"


# ----------------------------------------------------------------------------------------------------
# Tasks on an executor, a few at a time: neither the queue nor an interrupt waits for all of them
# ----------------------------------------------------------------------------------------------------

_EACH = 4
"""Tasks for every worker: one that runs, and enough that none waits for the next."""


def tasks_in_flight(executor: Executor | None, wanted: int | None) -> int:
    """Choose how many tasks an executor holds at a time.

    Parameters
    ----------
    executor
        Any executor, or None.
    wanted
        What the caller asked for; None: four for every worker of a pool, or for every processor where an executor does
        not say how many workers it has.

    Returns
    -------
    int
        Number of tasks.

    Raises
    ------
    InputError
        If it is no number above zero, or `executor` none.
    """
    if executor is not None and not isinstance(executor, Executor):
        raise InputError(
            f"executor must be a concurrent.futures.Executor or None, got {executor!r:.60}; "
            "of a Dask client pass client.get_executor()"
        )
    if wanted is None:
        # Pools have no public word for it.
        return _EACH * (getattr(executor, "_max_workers", None) or os.cpu_count() or 1)
    if isinstance(wanted, bool) or not isinstance(wanted, int) or wanted < 1:
        raise InputError(f"in_flight must be a number of tasks, 1 or more, got {wanted!r}")
    return wanted


def require_portable(executor: Executor | None, work: object, name: str) -> None:
    """Check that a function can be sent to other processes, before a pool fails one task after the other.

    Parameters
    ----------
    executor
        Where it is to run.
    work
        What is sent.
    name
        What to call it in the message.

    Raises
    ------
    InputError
        If it cannot be pickled.
    """
    if not isinstance(executor, ProcessPoolExecutor):
        return
    try:
        pickle.dumps(work)
    except Exception as error:
        raise InputError(
            f"{name} cannot be sent to other processes ({error}); define it at the top of a module, with all that it "
            "uses as arguments or functools.partial, or use threads"
        ) from None


def run_tasks(
    work: Callable[[Any], Any],
    tasks: Iterator[tuple[Any, Any]],
    done: Callable[[Any, Any], None],
    *,
    executor: Executor | None,
    in_flight: int,
) -> None:
    """Run tasks, here or on an executor, and hand over each result as soon as it is there.

    Parameters
    ----------
    work
        Function of one argument.
    tasks
        Label and argument of each task.
    done
        Called with label and result, in this thread; perhaps twice for a result that an interrupt came upon.
    executor
        Any executor; None: this thread.
    in_flight
        Most tasks that it holds at a time.
    """
    if executor is None:
        for label, argument in tasks:
            done(label, work(argument))
        return
    pending: dict[Future[Any], Any] = {}
    try:
        while True:
            for label, argument in tasks:
                pending[executor.submit(work, argument)] = label
                if len(pending) >= in_flight:
                    break
            if not pending:
                return
            for future in wait(pending, return_when=FIRST_COMPLETED).done:
                done(pending[future], future.result())
                del pending[future]
    except BaseException:
        for future in pending:
            future.cancel()
        for future, label in pending.items():
            if future.done() and not future.cancelled() and future.exception() is None:
                done(label, future.result())
        raise
