"""Fewer divisions: one reciprocal for each denominator, none for one whose inverse follows from others.

A division takes as long as ten to twenty multiplications, and symbolic algebra writes x · (1/y) as x / y wherever it
appears.
"""

from __future__ import annotations

from collections import Counter

from stewart_pin.kernels.passes import drop_dead
from stewart_pin.kernels.program import Kind, Program, ProgramBuilder


def share_reciprocals(program: Program) -> Program:
    """Divide once by each denominator.

    Parameters
    ----------
    program
        Program.

    Returns
    -------
    Program
        With x / y turned into x · (1/y) where y divides more than once, or where 1/y is known: y is a quotient, a
        root, a square or a product whose factors have been inverted. A quotient then carries two or three roundings
        instead of one, and a denominator below 1e-308 gives inf where the quotient itself would be finite.
    """
    return drop_dead(_Rewriter(program).program())


class _Rewriter:
    def __init__(self, program: Program) -> None:
        self.source = program
        self.uses = Counter(i.args[1] for i in program.instructions if i.kind is Kind.DIV)
        self.roots = {i.args[0]: k for k, i in enumerate(program.instructions) if i.kind is Kind.SQRT}
        self.builder = ProgramBuilder(program)
        self.new: dict[int, int] = {}
        self.inverses: dict[int, int] = {}
        self.follows: dict[int, bool] = {}

    def program(self) -> Program:
        for k in range(len(self.source.instructions)):
            self._value(k)
        return self.builder.finish(tuple(self.new[k] for k in entries) for entries in self.source.results)

    def _value(self, k: int) -> int:
        if k not in self.new:
            instruction = self.source.instructions[k]
            if instruction.kind is Kind.DIV:
                self.new[k] = self._quotient(*instruction.args)
            else:
                args = tuple(self._value(a) for a in instruction.args)
                self.new[k] = self.builder.append(instruction._replace(args=args))
        return self.new[k]

    def _quotient(self, x: int, y: int) -> int:
        if self.roots.get(x) == y:  # s / √s
            return self._value(y)
        if self.uses[y] == 1 and y not in self.inverses and not self._follows(y) and not self._is_one(x):
            return self.builder.operation(Kind.DIV, self._value(x), self._value(y))
        inverse = self._inverse(y)
        return inverse if self._is_one(x) else self.builder.operation(Kind.MUL, self._value(x), inverse)

    def _is_one(self, k: int) -> bool:
        instruction = self.source.instructions[k]
        return instruction.kind is Kind.CONSTANT and instruction.constant == 1.0

    def _follows(self, y: int) -> bool:
        """Whether the inverse of a value takes no division of its own."""
        if y not in self.follows:
            self.follows[y] = self._follows_from(*self.source.instructions[y][:2], y)
        return self.follows[y]

    def _follows_from(self, kind: Kind, args: tuple[int, ...], y: int) -> bool:
        if kind is Kind.CONSTANT:
            return True
        if kind is Kind.DIV:
            return self._is_one(args[0]) or self._wanted(args[0])
        if kind is Kind.MUL and args[0] != args[1]:
            return all(self._wanted(a) for a in args)
        if kind is Kind.MUL:
            return self._wanted(args[0])
        return self.roots.get(y) in self.uses

    def _wanted(self, y: int) -> bool:
        """Whether the inverse of a value is needed in any case, or follows."""
        return y in self.uses or self._follows(y)

    def _inverse(self, y: int) -> int:
        if y not in self.inverses:
            self.inverses[y] = self._new_inverse(y)
        return self.inverses[y]

    def _new_inverse(self, y: int) -> int:
        builder = self.builder
        kind, args, constant, _ = self.source.instructions[y]
        if not self._follows(y):
            return builder.operation(Kind.DIV, builder.constant(1.0), self._value(y))
        if kind is Kind.CONSTANT:
            return builder.constant(1.0 / constant) if constant else builder.constant(float("inf"))
        if kind is Kind.DIV:
            z = self._value(args[1])
            return z if self._is_one(args[0]) else builder.operation(Kind.MUL, z, self._inverse(args[0]))
        if kind is Kind.MUL:
            return builder.operation(Kind.MUL, self._inverse(args[0]), self._inverse(args[1]))
        root = self._inverse(self.roots[y])
        return builder.operation(Kind.MUL, root, root)
