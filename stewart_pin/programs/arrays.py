"""Arrays of states at the door of a kernel, and a kernel for one state at a time.

Said here is what is taken as it lies in memory, what is copied, what is refused.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from stewart_pin.errors import InputError
from stewart_pin.programs.llvm.machine_code import Target, compile_for_one, host_target
from stewart_pin.programs.llvm.module import module_for_one
from stewart_pin.programs.program import Port, Program
from stewart_pin.programs.repeating import Repeat, interpreted
from stewart_pin.programs.status import StateBound, StateStatus, judge, written_outputs
from stewart_pin.typing import ArrayLike, FloatArray


def as_real(dtype: DTypeLike) -> np.dtype[Any]:
    """Take the type of a kernel's numbers.

    Parameters
    ----------
    dtype
        numpy.float64 or numpy.float32.

    Returns
    -------
    numpy.dtype
        The same.

    Raises
    ------
    InputError
        If it is another, or no type.
    """
    try:
        real = np.dtype(dtype)
    except (TypeError, ValueError):
        raise InputError(f"dtype must be float64 or float32, got {dtype!r}") from None
    if real not in (np.float64, np.float32):
        raise InputError(f"dtype must be float64 or float32, got {real}")
    return real


def as_states(port: Port, value: ArrayLike, dtype: np.dtype[Any]) -> tuple[FloatArray, bool]:
    """Take an input.

    Parameters
    ----------
    port
        Which input.
    value
        (N, *shape), or (*shape,) that holds for all states [any unit]. Any distance between states is taken as it is;
        another type than that of the kernel, entries of a state that do not lie side by side, and lists are copied.
    dtype
        Type of the kernel.

    Returns
    -------
    array : numpy.ndarray
        (N, *shape) or (1, *shape) [any unit].
    many : bool
        Whether the value has an axis of states.

    Raises
    ------
    InputError
        If the shape is wrong or the entries are not real numbers.
    """
    if type(value) is not np.ndarray or value.dtype != dtype:
        value = _converted(port.name, value, dtype)
    axes = len(port.shape)
    if value.shape[value.ndim - axes :] != port.shape or value.ndim not in {axes, axes + 1}:
        inner = ", ".join(map(str, port.shape))
        single = f"({inner},)" if axes == 1 else f"({inner})"
        raise InputError(f"{port.name} must have shape (N, {inner}) or {single}, got {value.shape}")
    many = value.ndim > axes
    if not many:
        value = value[None]
    if not lies_in_rows(value):
        value = np.ascontiguousarray(value)
    return value, many


def _converted(name: str, value: ArrayLike, dtype: np.dtype[Any]) -> FloatArray:
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "fiub" or isinstance(value, np.ma.MaskedArray):  # whose mask would be lost
            raise TypeError
        with np.errstate(over="ignore"):  # becomes inf, which the status reports
            return array.astype(dtype)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} must be an array of real numbers, got {type(value).__name__}") from None


def lies_in_rows(array: FloatArray) -> bool:
    """Tell whether the entries of each state lie side by side, whatever the distance between states.

    Parameters
    ----------
    array
        (N, *shape) [any unit].

    Returns
    -------
    bool
        Whether a kernel can work on it in place.
    """
    return array.flags.aligned and (array.flags.c_contiguous or not len(array) or array[0].flags.c_contiguous)


def n_states(ports: tuple[Port, ...], arrays: list[tuple[FloatArray, bool]]) -> int | None:
    """Find the number of states that the inputs agree on.

    Parameters
    ----------
    ports
        Inputs.
    arrays
        What `as_states` gave for each [any unit].

    Returns
    -------
    int or None
        Number of states; None if no input has an axis of states.

    Raises
    ------
    InputError
        If they do not agree.
    """
    distinct = {len(a) for a, many in arrays if many}
    if not distinct:
        return None
    distinct.discard(1)
    if len(distinct) > 1:
        counts = {port.name: len(a) for port, (a, many) in zip(ports, arrays, strict=True) if many}
        listed = ", ".join(f"{name} {count}" for name, count in counts.items())
        raise InputError(f"inputs differ in the number of states: {listed}")
    return distinct.pop() if distinct else 1


def require_out(name: str, array: Any, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
    """Check an array that is to be written.

    Parameters
    ----------
    name
        Name for the message.
    array
        What the caller passed.
    shape
        Shape it must have.
    dtype
        Type it must have.

    Raises
    ------
    InputError
        If it is no writable array of that shape and type whose states lie in rows, apart from each other.
    """
    if not isinstance(array, np.ndarray) or array.dtype != dtype or array.shape != shape:
        found = f"{array.dtype} {array.shape}" if isinstance(array, np.ndarray) else type(array).__name__
        raise InputError(f"{name} must be an array {dtype} {shape}, got {found}")
    if not array.flags.writeable or not lies_in_rows(array):
        raise InputError(f"{name} must be writable, with the entries of each state side by side")
    if len(array) > 1 and abs(array.strides[0]) < array.itemsize * array[0].size:
        raise InputError(f"{name} must not have states that overlap, got strides {array.strides}")


def require_apart(name: str, array: FloatArray, others: list[tuple[str, FloatArray]]) -> None:
    """Check that an array to be written shares no memory with others.

    Parameters
    ----------
    name
        Name for the message.
    array
        Array to be written [any unit].
    others
        Names and arrays that are read or written as well [any unit].

    Raises
    ------
    InputError
        If it does, or may do in a way that takes long to find out.
    """
    for other_name, other in others:
        if not np.may_share_memory(array, other):
            continue
        try:
            shared = np.shares_memory(array, other, max_work=100_000)  # pyright: ignore[reportArgumentType]
        except np.exceptions.TooHardError:
            shared = True
        if shared:
            raise InputError(f"{name} must not share memory with {other_name}; pass a copy")


# ----------------------------------------------------------------------------------------------------
# A program for one state at a time, with its arguments in fixed places: as little overhead as Python allows
# ----------------------------------------------------------------------------------------------------


class SingleState:
    """A program that is called with one state; made by `ArrayKernel.single_state`.

    Either call it with arrays, which are copied to ``inputs``, and get fresh ones, or fill ``inputs``, call ``run()``
    and read ``outputs``, which the next call overwrites. One thread at a time: each thread makes its own.

    Parameters
    ----------
    program
        Program.
    bounds
        Bounds of outputs that judge a state.
    dtype
        numpy.float64 or numpy.float32.
    engine
        ``"llvm"`` or ``"numpy"``.
    target
        Machine; None is this one.
    repeat
        How the program is repeated; None runs it once.
    """

    def __init__(
        self,
        program: Program,
        bounds: Sequence[StateBound],
        dtype: np.dtype[Any],
        engine: str,
        target: Target | None = None,
        repeat: Repeat | None = None,
    ) -> None:
        self._made_from = (program, tuple(bounds), dtype, engine, target, repeat)
        self.inputs = tuple(np.zeros(p.shape, dtype=dtype) for p in program.inputs)
        self.outputs = tuple(np.zeros(p.shape, dtype=dtype) for p in written_outputs(program, bounds))
        buffers: Any = self.inputs
        self._places: tuple[Any, ...] = tuple(memoryview(x) for x in buffers)
        self._status = np.zeros(1, dtype=np.int8)
        self._one = self.outputs[0] if len(self.outputs) == 1 else None
        self.run: Callable[[], None] = self._interpret
        if engine == "llvm":
            target = target or host_target()
            addresses = [x.ctypes.data for x in (*self.inputs, *self.outputs, self._status)]
            function = compile_for_one(
                module_for_one(program, bounds, dtype, target, addresses, repeat), target
            )
            function.arrays = (
                self.inputs,
                self.outputs,
                self._status,
            )  # it writes there, whoever still holds it
            self.run = function

    def __repr__(self) -> str:
        return f"SingleState({self.program!r})"

    def __reduce__(self) -> tuple[Any, ...]:
        return SingleState, self._made_from

    @property
    def program(self) -> Program:
        """The program."""
        return self._made_from[0]

    @property
    def status(self) -> StateStatus:
        """What became of the last state."""
        return StateStatus(int(self._status[0]))

    def __call__(self, *inputs: ArrayLike, out: FloatArray | Sequence[FloatArray] | None = None) -> Any:
        """Evaluate the program.

        Parameters
        ----------
        *inputs
            For each input an array of its shape [any unit].
        out
            Array for the result, or one for each output, to write to [any unit]; None makes fresh ones.

        Returns
        -------
        numpy.ndarray or tuple of numpy.ndarray
            An array for each output [any unit], nan unless ``status`` is OK.

        Raises
        ------
        InputError
            If number, shape or type of an argument does not fit.
        """
        if len(inputs) != len(self._places):
            raise InputError(f"{self._made_from[0].name} takes {len(self.inputs)} arrays, got {len(inputs)}")
        try:
            # A memory view copies arrays of its own type and shape and refuses all else, in one cheap step.
            for place, value in zip(self._places, inputs):  # noqa: B905 - strict costs 0.1 µs
                place[:] = value
        except (TypeError, ValueError, NotImplementedError):
            self._take(inputs)
        self.run()
        if out is not None:
            return self._written(out)
        return self._one.copy() if self._one is not None else tuple(x.copy() for x in self.outputs)

    def _written(self, out: FloatArray | Sequence[FloatArray]) -> Any:
        given = (out,) if isinstance(out, np.ndarray) else tuple(out)
        if len(given) != len(self.outputs):
            raise InputError(f"out must hold {len(self.outputs)} arrays, got {len(given)}")
        for place, result in zip(given, self.outputs, strict=True):
            require_out("out", place, result.shape, result.dtype)
            place[...] = result
        return given[0] if len(given) == 1 else given

    def _take(self, inputs: tuple[ArrayLike, ...]) -> None:
        program = self._made_from[0]
        for port, place, value in zip(program.inputs, self.inputs, inputs, strict=True):
            array, many = as_states(port, value, place.dtype)
            if many:
                raise InputError(f"{port.name} must be one state of shape {port.shape}, got {array.shape}")
            place[...] = array[0]

    def _interpret(self) -> None:
        program, bounds, dtype = self._made_from[:3]
        inputs = [x.reshape(1, -1) for x in self.inputs]
        results = interpreted(program, inputs, dtype, self._made_from[5])
        named, self._status[:] = judge(program, bounds, inputs, results)
        for port, out in zip(written_outputs(program, bounds), self.outputs, strict=True):
            out[...] = named[port.name].reshape(port.shape)
