"""Fewer divisions: one reciprocal for each denominator, none for one whose inverse follows from others.

A division takes as long as ten to twenty multiplications, and symbolic algebra writes x · (1/y) as x / y wherever it
appears.
"""

from __future__ import annotations

from collections import Counter

from stewart_pin.kernels.programs.passes import drop_dead
from stewart_pin.kernels.programs.program import Instruction, Kind, Program
from stewart_pin.kernels.programs.program_builder import ProgramBuilder


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
        instead of one, and a denominator below 1e-308 gives inf where the quotient itself would be finite. Zero by its
        root is zero.
    """
    return drop_dead(_Rewriter(program).program())


_CHOICES = {Kind.FMIN, Kind.FMAX, Kind.IF_ELSE_ZERO, Kind.AND, Kind.OR, Kind.NOT, Kind.COPYSIGN}
_COMPARISONS = {Kind.LT, Kind.LE, Kind.EQ, Kind.NE}
_MASKS_NAN = _CHOICES | _COMPARISONS | {Kind.POW, Kind.HYPOT}  # nan to the power 0 is 1


def _nan_for_certain(program: Program) -> list[bool]:
    """Which values make a result nan when they are.

    1/s may be taken from the inverse of √s only where a negative s spoils the state in any case; behind a choice
    between branches it need not.
    """
    certain = [False] * len(program.instructions)
    for entries in program.results:
        for k in entries:
            certain[k] = True
    for k in reversed(range(len(certain))):
        kind, args, _, _ = program.instructions[k]
        if certain[k] and kind not in _MASKS_NAN:
            for a in args:
                certain[a] = True
    return certain


class _Rewriter:
    def __init__(self, program: Program) -> None:
        self.source = program
        self.uses = Counter(i.args[1] for i in program.instructions if i.kind is Kind.DIV)
        certain = _nan_for_certain(program)
        self.roots = {
            i.args[0]: k for k, i in enumerate(program.instructions) if i.kind is Kind.SQRT and certain[k]
        }
        self.builder = ProgramBuilder(program)
        self.new: dict[int, int] = {}
        self.inverses: dict[int, int] = {}
        self.follows: list[bool] = []
        for k in range(len(program.instructions)):
            self.follows.append(self._follows_from(k))

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
                args = tuple([self._value(a) for a in instruction.args])
                moved = Instruction(instruction.kind, args) if args else instruction
                self.new[k] = self.builder.append(moved)
        return self.new[k]

    def _quotient(self, x: int, y: int) -> int:
        if self.roots.get(x) == y:  # s / √s
            return self._value(y)
        if self.uses[y] == 1 and y not in self.inverses and not self.follows[y] and not self._is_one(x):
            return self.builder.operation(Kind.DIV, self._value(x), self._value(y))
        inverse = self._inverse(y)
        return inverse if self._is_one(x) else self.builder.operation(Kind.MUL, self._value(x), inverse)

    def _is_one(self, k: int) -> bool:
        instruction = self.source.instructions[k]
        return instruction.kind is Kind.CONSTANT and instruction.constant == 1.0

    def _follows_from(self, k: int) -> bool:
        """Whether the inverse of a value takes no division of its own; that of earlier values is known."""
        kind, args, _, _ = self.source.instructions[k]
        if kind is Kind.CONSTANT:
            return True
        if kind is Kind.DIV:
            return self._is_one(args[0]) or self._wanted(args[0])
        if kind is Kind.MUL:
            return all(self._wanted(a) for a in args)
        return self.roots.get(k) in self.uses

    def _wanted(self, k: int) -> bool:
        """Whether the inverse of a value is needed in any case, or follows."""
        return k in self.uses or self.follows[k]

    def _inverse(self, y: int) -> int:
        waiting = [y]  # a stack instead of recursion: chains of products may be long
        while waiting:
            k = waiting[-1]
            missing = [a for a in self._sources(k) if a not in self.inverses]
            waiting += missing
            if not missing:
                waiting.pop()
                if k not in self.inverses:
                    self.inverses[k] = self._new_inverse(k)
        return self.inverses[y]

    def _sources(self, k: int) -> tuple[int, ...]:
        """Values from whose inverses that of another follows."""
        kind, args, _, _ = self.source.instructions[k]
        if not self.follows[k] or kind is Kind.CONSTANT:
            return ()
        if kind is Kind.DIV:
            return () if self._is_one(args[0]) else args[:1]
        return args if kind is Kind.MUL else (self.roots[k],)

    def _new_inverse(self, k: int) -> int:
        builder = self.builder
        kind, args, constant, _ = self.source.instructions[k]
        if kind is Kind.CONSTANT:
            return builder.constant(1.0 / constant if constant else float("inf"))
        inverses = [self.inverses[a] for a in self._sources(k)]
        if not self.follows[k]:
            return builder.operation(Kind.DIV, builder.constant(1.0), self._value(k))
        if kind is Kind.DIV:
            z = self._value(args[1])
            return builder.operation(Kind.MUL, z, *inverses) if inverses else z
        if kind is Kind.MUL:
            return builder.operation(Kind.MUL, *inverses)
        return builder.operation(Kind.MUL, *inverses, *inverses)
