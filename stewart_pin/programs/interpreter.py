"""Run a straight-line program with NumPy: one array operation per instruction, any floating-point type.

Needs no compiler, and in `numpy.longdouble` judges the one that is used.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from stewart_pin.programs.program import Kind, Program
from stewart_pin.typing import FloatArray


def run_program(
    program: Program, inputs: Sequence[FloatArray], *, dtype: DTypeLike = np.float64
) -> list[FloatArray]:
    """Evaluate a program for many states.

    Parameters
    ----------
    program
        Program.
    inputs
        For each input (N, size) or (size,), which then holds for all states [any unit].
    dtype
        Floating-point type of every operation; constants are rounded to it.

    Returns
    -------
    list of numpy.ndarray
        For each output (N, size) [any unit].

    Notes
    -----
    A state that divides by zero or leaves the domain of a function gives inf or nan, as on the machine, without
    warning.
    """
    number: Callable[[float], Any] = np.dtype(dtype).type  # pyright: ignore[reportAssignmentType]
    arrays = [np.atleast_2d(np.asarray(x, dtype=dtype)) for x in inputs]
    n = max((len(x) for x in arrays if len(x) != 1), default=len(arrays[0]) if arrays else 1)
    last_use = _last_use(program)
    values: dict[int, Any] = {}
    with np.errstate(all="ignore"):
        for k, (kind, args, constant, place) in enumerate(program.instructions):
            if kind is Kind.INPUT:
                values[k] = arrays[place[0]][:, place[1]]
            elif kind is Kind.CONSTANT:
                values[k] = number(constant)
            else:
                values[k] = _OPERATIONS[kind](*(values[a] for a in args))
            for a in {*args, k}:
                if last_use[a] <= k:
                    del values[a]
    return [_stacked([values[k] for k in entries], n, dtype) for entries in program.results]


def _stacked(columns: list[Any], n: int, dtype: DTypeLike) -> FloatArray:
    out = np.empty((n, len(columns)), dtype=dtype)
    for k, column in enumerate(columns):
        out[:, k] = column
    return out


def _last_use(program: Program) -> list[int]:
    """Index of the instruction after which a value is needed no more, so that few arrays are alive at a time."""
    last = list(range(len(program.instructions)))
    for k, instruction in enumerate(program.instructions):
        for a in instruction.args:
            last[a] = k
    for entries in program.results:
        for k in entries:
            last[k] = len(program.instructions)
    return last


def _like(test: Callable[..., Any]) -> Callable[..., Any]:
    """Make a comparison give one or zero in the type of its operands, as CasADi's do."""
    return lambda *x: np.asarray(test(*x)).astype(np.result_type(*x))


_OPERATIONS: dict[Kind, Callable[..., Any]] = {
    Kind.ADD: np.add,
    Kind.SUB: np.subtract,
    Kind.MUL: np.multiply,
    Kind.DIV: np.divide,
    Kind.FMA: lambda a, b, c: a * b + c,
    Kind.NEG: np.negative,
    Kind.SQRT: np.sqrt,
    Kind.FABS: np.fabs,
    Kind.FLOOR: np.floor,
    Kind.CEIL: np.ceil,
    Kind.SIGN: lambda a: np.where(a < 0, -1, np.where(a > 0, 1, a)).astype(np.result_type(a)),
    Kind.FMIN: np.fmin,
    Kind.FMAX: np.fmax,
    Kind.COPYSIGN: np.copysign,
    Kind.LT: _like(np.less),
    Kind.LE: _like(np.less_equal),
    Kind.EQ: _like(np.equal),
    Kind.NE: _like(np.not_equal),
    Kind.NOT: _like(np.logical_not),
    Kind.AND: _like(np.logical_and),
    Kind.OR: _like(np.logical_or),
    Kind.IF_ELSE_ZERO: lambda a, b: np.where(a != 0, b, np.zeros((), np.result_type(a))),
    Kind.SIN: np.sin,
    Kind.COS: np.cos,
    Kind.TAN: np.tan,
    Kind.ASIN: np.arcsin,
    Kind.ACOS: np.arccos,
    Kind.ATAN: np.arctan,
    Kind.ATAN2: np.arctan2,
    Kind.SINH: np.sinh,
    Kind.COSH: np.cosh,
    Kind.TANH: np.tanh,
    Kind.ASINH: np.arcsinh,
    Kind.ACOSH: np.arccosh,
    Kind.ATANH: np.arctanh,
    Kind.EXP: np.exp,
    Kind.EXPM1: np.expm1,
    Kind.LOG: np.log,
    Kind.LOG1P: np.log1p,
    Kind.POW: np.power,
    Kind.HYPOT: np.hypot,
    Kind.FMOD: np.fmod,
}
