"""Repeat a program on its own result until a gap has closed: iterations of Newton's method without leaving the machine.

Every state stops by itself, so that its result does not depend on how long its neighbours take.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from stewart_pin.errors import InputError
from stewart_pin.kernels.interpreter import run_program
from stewart_pin.kernels.llvm_operations import write_program
from stewart_pin.kernels.llvm_writer import Writer
from stewart_pin.kernels.program import Program, require_output
from stewart_pin.typing import BoolArray, FloatArray


@dataclass(frozen=True)
class Repeat:
    """How a program is repeated.

    Attributes
    ----------
    state
        Input that takes the result of the pass before.
    following
        Output that gives it.
    gap
        Output that is zero at the goal; it belongs to the state that a pass starts from.
    tolerance
        Size of each entry of the gap from which on a state is at the goal, in the unit of the gap. Such a state takes
        what that pass gives, and stops.
    limit
        Largest number of passes.

    Raises
    ------
    InputError
        If no pass is allowed, or no gap.
    """

    state: str
    following: str
    gap: str
    tolerance: float
    limit: int

    def __post_init__(self) -> None:
        if self.limit < 1:
            raise InputError(f"limit must be 1 pass or more, got {self.limit}")
        if not self.tolerance >= 0.0:
            raise InputError(f"tolerance must not be negative, got {self.tolerance}")


def require_repeat(program: Program, repeat: Repeat) -> tuple[int, int, int]:
    """Find what a repetition names.

    Parameters
    ----------
    program
        Program.
    repeat
        Repetition.

    Returns
    -------
    tuple of int
        Index of the input, of the output that it takes, and of the gap.

    Raises
    ------
    InputError
        If the program has no such input or output, or they differ in shape.
    """
    names = [port.name for port in program.inputs]
    if repeat.state not in names:
        raise InputError(f"{program.name} has no input {repeat.state!r}, only {', '.join(names)}")
    state = names.index(repeat.state)
    following, gap = (require_output(program, name) for name in (repeat.following, repeat.gap))
    one, two = program.inputs[state], program.outputs[following]
    if one.shape != two.shape:
        raise InputError(f"{two.name} {two.shape} cannot take the place of {one.name} {one.shape}")
    return state, following, gap


def run_repeatedly(
    program: Program, repeat: Repeat, inputs: Sequence[FloatArray], *, dtype: DTypeLike = np.float64
) -> list[FloatArray]:
    """Repeat a program with NumPy.

    Parameters
    ----------
    program
        Program.
    repeat
        Repetition.
    inputs
        For each input (N, size) or (1, size) [any unit].
    dtype
        Floating-point type of every operation.

    Returns
    -------
    list of numpy.ndarray
        For each output (N, size), as the last pass of each state left it [any unit].
    """
    state, following, gap = require_repeat(program, repeat)
    given = list(inputs)
    results = run_program(program, given, dtype=dtype)
    done = _closed(results[gap], repeat)
    for _ in range(repeat.limit - 1):
        if done.all():
            break
        given[state] = results[following]
        passed = run_program(program, given, dtype=dtype)
        results = [np.where(done[:, None], old, new) for old, new in zip(results, passed, strict=True)]
        done = done | _closed(passed[gap], repeat)
    return results


def interpreted(
    program: Program, inputs: Sequence[FloatArray], dtype: DTypeLike, repeat: Repeat | None
) -> list[FloatArray]:
    """Run a program with NumPy, once or repeatedly.

    Parameters
    ----------
    program
        Program.
    inputs
        For each input (N, size) or (1, size) [any unit].
    dtype
        Floating-point type of every operation.
    repeat
        Repetition; None runs it once.

    Returns
    -------
    list of numpy.ndarray
        For each output (N, size) [any unit].
    """
    if repeat is None:
        return run_program(program, inputs, dtype=dtype)
    return run_repeatedly(program, repeat, inputs, dtype=dtype)


def _closed(gap: FloatArray, repeat: Repeat) -> BoolArray:
    closed: Any = (np.abs(gap) <= repeat.tolerance).all(axis=1)
    return closed


def write_repeatedly(
    w: Writer, program: Program, repeat: Repeat, inputs: Sequence[Sequence[str]]
) -> list[list[str]]:
    """Write a program and its repetition.

    Parameters
    ----------
    w
        Function under construction.
    program
        Program.
    repeat
        Repetition.
    inputs
        For each input, the name of the value of each entry.

    Returns
    -------
    list of list of str
        For each output, the name of the value of each entry after the last pass.
    """
    state, following, gap = require_repeat(program, repeat)
    before, again, after, on = (w.label(name) for name in ("before", "again", "after", "on"))
    w.lines += [f"  br label %{before}", f"{before}:", f"  br label %{again}", f"{again}:"]
    place = len(w.lines)  # of what is carried from pass to pass; known when the pass has been written
    zero = w.constant(0.0)
    passes, done = w.name(), w.name()
    old = [[w.name() for _ in entries] for entries in program.results]
    begun = [w.name() for _ in inputs[state]]
    given = [begun if k == state else list(entries) for k, entries in enumerate(inputs)]
    new = write_program(w, program, given)
    kept = [
        [w.select(done, a, b) for a, b in zip(olds, news, strict=True)]
        for olds, news in zip(old, new, strict=True)
    ]
    closed = w.none if not new[gap] else w.all_below([w.call("fabs", x) for x in new[gap]], repeat.tolerance)
    done_now = w.put(f"or {w.mask} {done}, {closed}")
    count = w.put(f"add i64 {passes}, 1")
    left = w.any(w.put(f"xor {w.mask} {done_now}, {w.every}"))
    few = w.put(f"icmp slt i64 {count}, {repeat.limit}")
    more = w.put(f"and i1 {left}, {few}")
    w.lines += [
        f"  br label %{after}",
        f"{after}:",
        f"  br i1 {more}, label %{again}, label %{on}",
        f"{on}:",
    ]

    def carried(name: str, kind: str, first: str, later: str) -> str:
        return f"  {name} = phi {kind} [ {first}, %{before} ], [ {later}, %{after} ]"

    lines = [carried(passes, "i64", "0", count), carried(done, w.mask, w.none, done_now)]
    lines += [
        carried(name, w.type, zero, value)
        for olds, values in zip(old, kept, strict=True)
        for name, value in zip(olds, values, strict=True)
    ]
    lines += [
        carried(name, w.type, first, value)
        for name, first, value in zip(begun, inputs[state], kept[following], strict=True)
    ]
    w.lines[place:place] = lines
    return kept
