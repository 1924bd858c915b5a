"""A program for one state at a time, with its arguments in fixed places: as little overhead as Python allows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from stewart_pin.errors import InputError
from stewart_pin.programs.arrays import as_states, require_out
from stewart_pin.programs.llvm.machine_code import Target, compile_for_one, host_target
from stewart_pin.programs.llvm.module import module_for_one
from stewart_pin.programs.program import Program
from stewart_pin.programs.repeating import Repeat, interpreted
from stewart_pin.programs.status import StateBound, StateStatus, judge, written_outputs
from stewart_pin.typing import ArrayLike, FloatArray


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
