"""What became of each state of an array: a code, and the bounds that lead to one."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stewart_pin.errors import InputError
from stewart_pin.programs.program import Port, Program, require_output
from stewart_pin.typing import BoolArray, FloatArray


class StateStatus(enum.IntEnum):
    """Code of a state; the results of a state that is not OK are nan.

    ``BRANCH_LOST``: what is asked for is met on another branch alone than that of home, or of the guess: on the way
    from there is a singularity. ``RESTING``: a joint with dry friction is at rest, and whether that lets it go takes a
    search. ``OUT_OF_LIMITS``: no efforts within their limits make the motion.
    """

    OK = 0
    INPUT_NOT_FINITE = 1
    OUT_OF_BOUNDS = 2
    RESULT_NOT_FINITE = 3
    SINGULAR = 4
    BRANCH_LOST = 5
    RESTING = 6
    OUT_OF_LIMITS = 7


@dataclass(frozen=True)
class StateBound:
    """Bounds of an output that judges a state, such as the smallest pivot of an elimination.

    Attributes
    ----------
    output
        Name of the output.
    lower
        Least good value of each entry, in the unit of the output.
    upper
        Largest good value of each entry.
    code
        What becomes of a state beyond; of several, the last in the list of bounds counts.
    written
        Whether the output is given back as well, and of bad states too.

    Raises
    ------
    InputError
        If no value lies within.
    """

    output: str
    lower: float = -math.inf
    upper: float = math.inf
    code: StateStatus = StateStatus.OUT_OF_BOUNDS
    written: bool = False

    def __post_init__(self) -> None:
        if not self.lower <= self.upper:
            raise InputError(f"bound of {self.output!r}: no value lies between {self.lower} and {self.upper}")


def require_bounds(program: Program, bounds: Sequence[StateBound]) -> None:
    """Check that each bound names an output.

    Parameters
    ----------
    program
        Program.
    bounds
        Bounds.

    Raises
    ------
    InputError
        If there is no such output.
    """
    for bound in bounds:
        require_output(program, bound.output)


def written_outputs(program: Program, bounds: Sequence[StateBound]) -> list[Port]:
    """List the outputs that a kernel gives: those that do not only judge a state.

    Parameters
    ----------
    program
        Program.
    bounds
        Bounds.

    Returns
    -------
    list of Port
        Outputs without a bound, or whose bound says so.
    """
    judging = {bound.output for bound in bounds if not bound.written}
    return [port for port in program.outputs if port.name not in judging]


def judge(
    program: Program,
    bounds: Sequence[StateBound],
    inputs: Sequence[FloatArray],
    outputs: Sequence[FloatArray],
) -> tuple[dict[str, FloatArray], np.ndarray]:
    """Find the code of each state, and strike out what is not known; the machine code does the same on its way.

    Parameters
    ----------
    program
        Program.
    bounds
        Bounds.
    inputs
        For each input (N, size) or (1, size) [any unit].
    outputs
        For each output (N, size) [any unit].

    Returns
    -------
    results : dict
        For each written output (N, size), nan where a state is not OK; those that judge as well only where they are
        not known [any unit].
    codes : numpy.ndarray
        (N,) int8 codes, dimensionless.
    """
    n = len(outputs[0])
    finite, inputs_finite = _all_finite(outputs, n), _all_finite(inputs, n)
    codes = np.zeros(n, dtype=np.int8)
    codes[~finite] = StateStatus.RESULT_NOT_FINITE
    known: dict[str, Any] = {}
    for bound in bounds:
        x = outputs[require_output(program, bound.output)]
        within: Any = ((x >= bound.lower) & (x <= bound.upper)).all(axis=1)
        codes[~within] = bound.code
        known[bound.output] = inputs_finite & (finite | ~within)
    codes[~inputs_finite] = StateStatus.INPUT_NOT_FINITE
    written = {port.name for port in written_outputs(program, bounds)}
    ok: Any = codes == StateStatus.OK
    results = {
        port.name: np.where(known.get(port.name, ok)[:, None], x, np.nan)
        for port, x in zip(program.outputs, outputs, strict=True)
        if port.name in written
    }
    return results, codes


def _all_finite(arrays: Sequence[FloatArray], n: int) -> BoolArray:
    finite = np.ones(n, dtype=bool)
    for x in arrays:
        finite &= np.isfinite(x).all(axis=1)
    return finite
