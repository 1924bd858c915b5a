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
from stewart_pin.programs.program import Program, require_output, run_program
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
    also
        Further inputs, and the outputs that they take.

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
    also: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        if self.limit < 1:
            raise InputError(f"limit must be 1 pass or more, got {self.limit}")
        if not self.tolerance >= 0.0:
            raise InputError(f"tolerance must not be negative, got {self.tolerance}")


def require_repeat(program: Program, repeat: Repeat) -> tuple[dict[int, int], int]:
    """Find what a repetition names.

    Parameters
    ----------
    program
        Program.
    repeat
        Repetition.

    Returns
    -------
    carried : dict
        Index of each input that takes the result of the pass before, and of the output that it takes.
    gap : int
        Index of the gap.

    Raises
    ------
    InputError
        If the program has no such input or output, or they differ in shape.
    """
    names = [port.name for port in program.inputs]
    carried: dict[int, int] = {}
    for name, following in ((repeat.state, repeat.following), *repeat.also):
        if name not in names:
            raise InputError(f"{program.name} has no input {name!r}, only {', '.join(names)}")
        state, result = names.index(name), require_output(program, following)
        one, two = program.inputs[state], program.outputs[result]
        if one.shape != two.shape:
            raise InputError(f"{two.name} {two.shape} cannot take the place of {one.name} {one.shape}")
        carried[state] = result
    return carried, require_output(program, repeat.gap)


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
    carried, gap = require_repeat(program, repeat)
    given = list(inputs)
    results = run_program(program, given, dtype=dtype)
    done = _closed(results[gap], repeat)
    for _ in range(repeat.limit - 1):
        if done.all():
            break
        for state, following in carried.items():
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
