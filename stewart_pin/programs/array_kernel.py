"""A program as a function of arrays of states: checks, memory, threads, and one of two engines below.

``"llvm"`` runs machine code on full vectors, ``"numpy"`` interprets the same list. `compile_function` makes such a
function from one of CasADi in one step.
"""

from __future__ import annotations

import importlib.util
import itertools
import struct
import threading
from collections.abc import Collection, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import DTypeLike

from stewart_pin.errors import InputError
from stewart_pin.programs.arrays import (
    SingleState,
    as_real,
    as_states,
    n_states,
    require_apart,
    require_out,
)
from stewart_pin.programs.llvm.machine_code import Target, compile_for_ranges, host_target
from stewart_pin.programs.llvm.module import module_for_ranges
from stewart_pin.programs.passes import prepare
from stewart_pin.programs.program import Program
from stewart_pin.programs.repeating import Repeat, interpreted, require_repeat
from stewart_pin.programs.status import StateBound, judge, require_bounds, written_outputs
from stewart_pin.programs.symbolic import program_from_casadi
from stewart_pin.typing import ArrayLike, FloatArray

Engine = Literal["llvm", "numpy"]
_LEAST_SHARE = 1024
"""States that a thread must have to be worth its start, about 50 µs."""
_CHUNK = 4096
"""States that the interpreter treats at a time, so that its values stay in the cache."""


class ArrayKernel:
    """A program that is called with arrays of states.

    Parameters
    ----------
    program
        Program.
    bounds
        Bounds of outputs that judge a state; these outputs are not given back.
    dtype
        numpy.float64 or numpy.float32: type of the arrays and of every operation.
    repeat
        How the program is repeated on its own result; None runs it once.
    engine
        ``"llvm"`` (extra ``kernels``) or ``"numpy"``; None takes llvm when it is installed.
    target
        Machine to compile for; None is this one.

    Raises
    ------
    InputError
        If an option is unknown or a bound names no output.
    MissingExtraError
        If llvm is asked for and not installed.

    Notes
    -----
    A state whose inputs or results are not finite, or that is out of bounds, comes out as nan, with its code in
    ``status``; its neighbours do not notice. The result of a state depends neither on its place in the array nor on
    the number of threads, bit for bit. Pickles as the program, and compiles again where it is loaded.
    """

    def __init__(
        self,
        program: Program,
        *,
        bounds: Sequence[StateBound] = (),
        dtype: DTypeLike = np.float64,
        repeat: Repeat | None = None,
        engine: Engine | None = None,
        target: Target | None = None,
    ) -> None:
        self.program = program
        self.bounds = tuple(bounds)
        require_bounds(program, self.bounds)
        self.repeat = repeat
        if repeat is not None:
            require_repeat(program, repeat)
        self.dtype = as_real(dtype)
        if engine not in (None, "llvm", "numpy"):
            raise InputError(f"engine must be 'llvm', 'numpy' or None, got {engine!r}")
        if engine is None:
            engine = "llvm" if importlib.util.find_spec("llvmlite") else "numpy"
        self.engine: Engine = engine
        self.outputs = tuple(written_outputs(program, self.bounds))
        self._target = target
        self._repeated: dict[Repeat, ArrayKernel] = {}
        self._code: Any = None
        if engine == "llvm":
            target = target or host_target()
            text = module_for_ranges(program, self.bounds, self.dtype, target, repeat)
            self._code = compile_for_ranges(text, target)

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuilt, (self.program, self.bounds, self.dtype, self.repeat, self.engine, self._target)

    def __repr__(self) -> str:
        return f"ArrayKernel({self.program!r}, {self.dtype}, {self.engine})"

    def __call__(
        self,
        *inputs: ArrayLike,
        out: FloatArray | Sequence[FloatArray | None] | None = None,
        status: np.ndarray | None = None,
        threads: int = 1,
    ) -> Any:
        """Evaluate the program for all states.

        Parameters
        ----------
        *inputs
            For each input (N, *shape), or (*shape,) that holds for all states [any unit]. Arrays of the kernel's type
            whose states lie in rows, at any distance, are read where they are; others are copied first.
        out
            Array (N, *shape), or one for each output, to write to [any unit]; it must not overlap anything else. None
            makes one.
        status
            (N,) int8 array to write the code of each state to, dimensionless.
        threads
            Number of threads, each for a contiguous range of states; fewer if the array is short.

        Returns
        -------
        numpy.ndarray or tuple of numpy.ndarray
            (N, *shape) for each output [any unit]; without the first axis if no input has it.

        Raises
        ------
        InputError
            If number, shape or type of an argument does not fit, or memory overlaps.
        """
        program = self.program
        if len(inputs) != len(program.inputs):
            names = ", ".join(p.name for p in program.inputs)
            raise InputError(
                f"{program.name} takes {len(program.inputs)} arrays ({names}), got {len(inputs)}"
            )
        if not isinstance(threads, int) or threads < 1:
            raise InputError(f"threads must be a number of threads, 1 or more, got {threads!r}")
        taken = [as_states(p, x, self.dtype) for p, x in zip(program.inputs, inputs, strict=True)]
        count = n_states(program.inputs, taken)
        n = 1 if count is None else count
        arrays = [a for a, _ in taken]
        results = self._results(out, n, count is None, arrays)
        if status is not None:
            self._require_status(status, n, arrays, results)
        if n:
            self._run(arrays, results, status, n, threads)
        given = tuple(r[0] for r in results) if count is None else tuple(results)
        return given[0] if len(given) == 1 else given

    def repeated(self, repeat: Repeat) -> ArrayKernel:
        """Compile the program to be repeated on its own result.

        Parameters
        ----------
        repeat
            How it is repeated.

        Returns
        -------
        ArrayKernel
            Same program, bounds, type and engine; compiled once for each way of repeating.

        Raises
        ------
        InputError
            If the program has no such inputs and outputs.
        """
        if repeat not in self._repeated:
            self._repeated[repeat] = ArrayKernel(
                self.program,
                bounds=self.bounds,
                dtype=self.dtype,
                repeat=repeat,
                engine=self.engine,
                target=self._target,
            )
        return self._repeated[repeat]

    def single_state(self) -> SingleState:
        """Compile the program for one state at a time, which is called with a tenth of the overhead.

        Returns
        -------
        SingleState
            Function of one state; its results are those of this kernel, bit for bit.
        """
        return SingleState(self.program, self.bounds, self.dtype, self.engine, self._target, self.repeat)

    def _results(
        self,
        out: FloatArray | Sequence[FloatArray | None] | None,
        n: int,
        single: bool,
        inputs: list[FloatArray],
    ) -> list[FloatArray]:
        if out is None:
            made: list[Any] = [np.empty((n, *p.shape), dtype=self.dtype) for p in self.outputs]
            return made
        given: list[Any] = [out] if isinstance(out, np.ndarray) else list(out)
        if len(given) != len(self.outputs):
            names = ", ".join(p.name for p in self.outputs)
            raise InputError(f"out must hold {len(self.outputs)} arrays ({names}), got {len(given)}")
        results: list[FloatArray] = []
        known = [(p.name, x) for p, x in zip(self.program.inputs, inputs, strict=True)]
        for port, array in zip(self.outputs, given, strict=True):
            if array is None:
                made_one: Any = np.empty((n, *port.shape), dtype=self.dtype)
                results.append(made_one)
                continue
            name = f"out for {port.name}"
            require_out(name, array, port.shape if single else (n, *port.shape), self.dtype)
            require_apart(name, array, known)
            known.append((name, array))
            results.append(array[None] if single else array)
        return results

    def _require_status(
        self, status: np.ndarray, n: int, inputs: list[FloatArray], results: list[FloatArray]
    ) -> None:
        require_out("status", status, (n,), np.dtype(np.int8))
        if not status.flags.c_contiguous:
            raise InputError("status must be contiguous")
        known = [(p.name, x) for p, x in zip(self.program.inputs, inputs, strict=True)]
        known += [(f"out for {p.name}", x) for p, x in zip(self.outputs, results, strict=True)]
        require_apart("status", status, known)

    def _run(
        self,
        inputs: list[FloatArray],
        results: list[FloatArray],
        status: np.ndarray | None,
        n: int,
        threads: int,
    ) -> None:
        if self._code is None:
            for begin in range(0, n, _CHUNK):
                self._interpret(inputs, results, status, slice(begin, min(n, begin + _CHUNK)))
            return
        run, table = self._code, _table(inputs, results, status)
        shares = min(threads, max(1, n // _LEAST_SHARE))
        if shares == 1:
            run(0, n, table)
            return
        ends = [n * (k + 1) // shares for k in range(shares)]
        # Each thread holds the arrays: an interrupted caller must not free what it still reads and writes.
        held = (inputs, results, status)
        workers = [
            threading.Thread(target=lambda begin, end, _: run(begin, end, table), args=(begin, end, held))
            for begin, end in itertools.pairwise(ends)
        ]
        for worker in workers:
            worker.start()
        run(0, ends[0], table)
        for worker in workers:
            worker.join()

    def _interpret(
        self, inputs: list[FloatArray], results: list[FloatArray], status: np.ndarray | None, part: slice
    ) -> None:
        n = part.stop - part.start
        rows = [x[part] if len(x) > 1 else x for x in inputs]
        rows = [x.reshape(len(x), -1) for x in rows]
        values = interpreted(self.program, rows, self.dtype, self.repeat)
        values = [np.broadcast_to(x, (n, x.shape[1])) for x in values]
        named, codes = judge(self.program, self.bounds, rows, values)
        for port, result in zip(self.outputs, results, strict=True):
            result[part] = named[port.name].reshape(n, *port.shape)
        if status is not None:
            status[part] = codes


def _table(inputs: list[FloatArray], results: list[FloatArray], status: np.ndarray | None) -> Any:
    """Addresses and distances between states, as the machine code wants them."""
    entries: list[int] = []
    for array in (*inputs, *results):
        entries += (array.ctypes.data, array.strides[0] if len(array) > 1 else 0)
    entries.append(0 if status is None else status.ctypes.data)
    return struct.pack(f"{len(entries)}q", *entries)


def _rebuilt(
    program: Program,
    bounds: tuple[StateBound, ...],
    dtype: np.dtype[Any],
    repeat: Repeat | None,
    engine: Engine,
    target: Target | None,
) -> ArrayKernel:
    return ArrayKernel(program, bounds=bounds, dtype=dtype, repeat=repeat, engine=engine, target=target)


# ----------------------------------------------------------------------------------------------------
# From a CasADi function to a fast function on arrays, in one step
# ----------------------------------------------------------------------------------------------------


def compile_function(
    function: Any,
    *,
    bounds: Sequence[StateBound] = (),
    dtype: DTypeLike = np.float64,
    repeat: Repeat | None = None,
    engine: Engine | None = None,
    matrices: Collection[str] = (),
) -> ArrayKernel:
    """Compile a CasADi function to a function on arrays of states.

    Parameters
    ----------
    function
        `casadi.Function` that can be written as scalar operations without branches.
    bounds
        Bounds of outputs that judge a state; these outputs are not given back.
    dtype
        numpy.float64 or numpy.float32.
    repeat
        How the function is repeated on its own result; None runs it once.
    engine
        ``"llvm"`` (extra ``kernels``) or ``"numpy"``; None takes llvm when it is installed.
    matrices
        Outputs that stay matrices where they have one column; others become vectors.

    Returns
    -------
    ArrayKernel
        Function of arrays (N, size) or (N, rows, columns), one for each input, in C order.

    Raises
    ------
    InputError
        If an argument does not fit.
    MissingExtraError
        If CasADi, or llvm when asked for, is not installed.
    UnsupportedError
        If the function cannot be written as scalar operations.

    Examples
    --------
    >>> import casadi as ca
    >>> x = ca.SX.sym("x", 2)
    >>> norm = compile_function(ca.Function("norm", [x], [ca.norm_2(x)]))
    >>> norm(np.array([[3.0, 4.0], [5.0, 12.0]]))
    array([[ 5.],
           [13.]])
    """
    return ArrayKernel(
        prepare(program_from_casadi(function, matrices=matrices)),
        bounds=bounds,
        dtype=dtype,
        repeat=repeat,
        engine=engine,
    )
