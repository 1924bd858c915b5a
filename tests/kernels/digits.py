"""Programs evaluated to 50 digits, the configuration that they take closed to as many: what round-off has cost."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mpmath
import numpy as np

import stewart_pin as stp
from stewart_pin.programs.program import Kind, Program

DIGITS = 50
_MP = mpmath.mp.clone()
_MP.dps = DIGITS
_OPERATIONS: dict[Kind, Callable[..., Any]] = {
    Kind.ADD: lambda a, b: a + b,
    Kind.SUB: lambda a, b: a - b,
    Kind.MUL: lambda a, b: a * b,
    Kind.DIV: lambda a, b: a / b,
    Kind.FMA: lambda a, b, c: a * b + c,
    Kind.NEG: lambda a: -a,
    Kind.SQRT: _MP.sqrt,
    Kind.FABS: abs,
    Kind.FLOOR: _MP.floor,
    Kind.CEIL: _MP.ceil,
    Kind.SIGN: _MP.sign,
    Kind.FMIN: min,
    Kind.FMAX: max,
    Kind.COPYSIGN: lambda a, b: abs(a) if b >= 0 else -abs(a),
    Kind.LT: lambda a, b: _MP.mpf(a < b),
    Kind.LE: lambda a, b: _MP.mpf(a <= b),
    Kind.EQ: lambda a, b: _MP.mpf(a == b),
    Kind.NE: lambda a, b: _MP.mpf(a != b),
    Kind.NOT: lambda a: _MP.mpf(not a),
    Kind.AND: lambda a, b: _MP.mpf(bool(a) and bool(b)),
    Kind.OR: lambda a, b: _MP.mpf(bool(a) or bool(b)),
    Kind.IF_ELSE_ZERO: lambda a, b: b if a else _MP.mpf(0),
    Kind.SIN: _MP.sin,
    Kind.COS: _MP.cos,
    Kind.TAN: _MP.tan,
    Kind.ATAN: _MP.atan,
    Kind.ATAN2: _MP.atan2,
}
Numbers = Sequence[Any]


def run(program: Program, inputs: Sequence[Numbers]) -> dict[str, list[Any]]:
    """Evaluate a program at one state; numbers of the file, and those given, are taken as exact."""
    given = [[_MP.mpf(x) for x in one] for one in inputs]
    values: list[Any] = []
    for kind, args, constant, (port, entry) in program.instructions:
        if kind is Kind.INPUT:
            values.append(given[port][entry])
        elif kind is Kind.CONSTANT:
            values.append(_MP.mpf(constant))
        else:
            values.append(_OPERATIONS[kind](*(values[k] for k in args)))
    return {
        port.name: [values[k] for k in entries]
        for port, entries in zip(program.outputs, program.results, strict=True)
    }


def efforts(kernels: stp.compiled.Kernels, given: Sequence[np.ndarray]) -> np.ndarray:
    """Efforts of one state to 50 digits, rounded at last, by the choice of pivots that serves it best."""
    program = kernels._kernel("inverse_dynamics").program
    state = program.inputs[0].name
    place: Numbers = given[0]
    plan = kernels
    if not kernels.takes(state):
        begun = kernels._configurations(given[0][None], 1, state).states
        if state == "q":
            plan = max((kernels, *kernels._others), key=lambda one: _conditioning(one, begun, given))
        equations = {"q": "closing", "pose": "forward_kinematics"}[state]
        steps = plan._kernel(f"{equations}_double_step").program
        place = list(begun[0])
        for _ in range(4):  # each leaves the third power of what the one before has left
            place = run(steps, [place, given[0], [0]])["next"]
    elif state == "q":
        plan = max((kernels, *kernels._others), key=lambda one: _conditioning(one, given[0][None], given))
    found = run(plan._kernel("inverse_dynamics").program, [place, *given[1:]])
    return np.array([float(x) for x in found["tau_motor"]])


def _conditioning(plan: Any, q: np.ndarray, given: Sequence[np.ndarray]) -> float:
    return float(np.nan_to_num(plan._kernel("inverse_dynamics", graded=True)(q, *given[1:])[-1][0, 0]))
