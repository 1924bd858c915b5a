"""Passes that make a program shorter without changing what it computes, beyond round-off where that is said.

Each is a function from program to program; `prepared` chains them in the order that pays.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stewart_pin.kernels.programs.interpreter import run_program
from stewart_pin.kernels.programs.program import Instruction, Kind, Program
from stewart_pin.kernels.programs.program_builder import ProgramBuilder


def rewrite(program: Program, rule: Callable[[ProgramBuilder, Instruction, int], int]) -> Program:
    """Rebuild a program instruction by instruction; equal operations are shared on the way.

    Parameters
    ----------
    program
        Program.
    rule
        Gets the new list, an instruction whose arguments already point into it, and the instruction's old index;
        gives the index of its value in the new list.

    Returns
    -------
    Program
        The new program.
    """
    builder, new = ProgramBuilder(program), []
    for k, instruction in enumerate(program.instructions):
        args = instruction.args
        moved = Instruction(instruction.kind, tuple([new[a] for a in args])) if args else instruction
        new.append(rule(builder, moved, k))
    return builder.finish(tuple(new[k] for k in entries) for entries in program.results)


def drop_dead(program: Program) -> Program:
    """Leave out what no output needs.

    Parameters
    ----------
    program
        Program.

    Returns
    -------
    Program
        Without dead operations, the rest in the same order.
    """
    alive = [False] * len(program.instructions)
    for entries in program.results:
        for k in entries:
            alive[k] = True
    for k in reversed(range(len(alive))):
        if alive[k]:
            for a in program.instructions[k].args:
                alive[a] = True
    new = (np.cumsum(alive) - 1).tolist()
    kept = tuple(
        Instruction(i.kind, tuple([new[a] for a in i.args])) if i.args else i
        for i, keep in zip(program.instructions, alive, strict=True)
        if keep
    )
    results = tuple(tuple(new[k] for k in entries) for entries in program.results)
    return Program(program.name, program.inputs, program.outputs, kept, results)


def simplify(program: Program) -> Program:
    """Compute what is constant, drop neutral operands, and move signs to where they cost nothing.

    Exact, but for the sign of a zero.

    Parameters
    ----------
    program
        Program.

    Returns
    -------
    Program
        The same values from fewer operations.
    """
    return drop_dead(rewrite(program, _simpler))


def _simpler(builder: ProgramBuilder, instruction: Instruction, _: int) -> int:
    kind, args = instruction.kind, instruction.args
    made = [builder.instructions[a] for a in args]
    if args and all(m.kind is Kind.CONSTANT for m in made):
        return builder.constant(_constant_value(kind, [m.constant for m in made]))
    rule = _SIGNS.get(kind)
    return rule(builder, *args) if rule else builder.append(instruction)


def _constant_value(kind: Kind, values: list[float]) -> float:
    instructions = [Instruction(Kind.CONSTANT, (), v) for v in values]
    last = Instruction(kind, tuple(range(len(values))))
    single = Program("constant", (), (), (*instructions, last), ((len(values),),))
    return float(run_program(single, [])[0][0, 0])


def _is(builder: ProgramBuilder, index: int, value: float) -> bool:
    kind, _, constant, _ = builder.instructions[index]
    return kind is Kind.CONSTANT and constant == value


def _negated(builder: ProgramBuilder, index: int) -> int | None:
    """Index of x where the value is -x."""
    kind, args, _, _ = builder.instructions[index]
    return args[0] if kind is Kind.NEG else None


def _add(builder: ProgramBuilder, a: int, b: int) -> int:
    for x, y in ((a, b), (b, a)):
        if _is(builder, y, 0.0):
            return x
        minus = _negated(builder, y)
        if minus is not None:
            return _sub(builder, x, minus)
    return builder.operation(Kind.ADD, a, b)


def _sub(builder: ProgramBuilder, a: int, b: int) -> int:
    if _is(builder, b, 0.0):
        return a
    if _is(builder, a, 0.0):
        return _neg(builder, b)
    minus = _negated(builder, b)
    if minus is not None:
        return _add(builder, a, minus)
    minus = _negated(builder, a)
    if minus is not None:
        return _neg(builder, _add(builder, minus, b))
    return builder.operation(Kind.SUB, a, b)


def _neg(builder: ProgramBuilder, a: int) -> int:
    minus = _negated(builder, a)
    return builder.operation(Kind.NEG, a) if minus is None else minus


def _mul(builder: ProgramBuilder, a: int, b: int) -> int:
    for x, y in ((a, b), (b, a)):
        if _is(builder, y, 1.0):
            return x
        if _is(builder, y, -1.0):
            return _neg(builder, x)
        minus = _negated(builder, y)
        if minus is not None:
            return _neg(builder, _mul(builder, x, minus))
    return builder.operation(Kind.MUL, a, b)


def _div(builder: ProgramBuilder, a: int, b: int) -> int:
    if _is(builder, b, 1.0):
        return a
    for x, left in ((a, True), (b, False)):
        minus = _negated(builder, x)
        if minus is not None:
            return _neg(builder, _div(builder, minus, b) if left else _div(builder, a, minus))
    return builder.operation(Kind.DIV, a, b)


_SIGNS = {Kind.ADD: _add, Kind.SUB: _sub, Kind.NEG: _neg, Kind.MUL: _mul, Kind.DIV: _div}
