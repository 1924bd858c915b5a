"""Passes that make a program shorter without changing what it computes, beyond round-off where that is said.

Each is a function from program to program; `prepare` chains them in the order that pays.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np

from stewart_pin.programs.program import Instruction, Kind, Program, ProgramBuilder, run_program


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


# ----------------------------------------------------------------------------------------------------
# Fewer divisions: one reciprocal for each denominator, none for one whose inverse follows from others
#
# A division takes as long as ten to twenty multiplications, and symbolic algebra writes x · (1/y) as x / y wherever
# it appears.
# ----------------------------------------------------------------------------------------------------


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


# ----------------------------------------------------------------------------------------------------
# Multiply and add in one operation, where that saves the multiplication
#
# The choice is made here, not by the compiler, so that every vector width and the single state round alike, bit
# for bit.
# ----------------------------------------------------------------------------------------------------


def fuse(program: Program) -> Program:
    """Turn sums with a product into fused multiply-adds.

    Parameters
    ----------
    program
        Program.

    Returns
    -------
    Program
        A product disappears if all that use it are sums; other products stay, since a fused sum would save nothing.
        Fused sums are rounded once instead of twice.
    """
    claimed = _claims(program)

    def rule(builder: ProgramBuilder, instruction: Instruction, k: int) -> int:
        product = claimed.get(k)
        if product is None:
            return builder.append(instruction)
        left = program.instructions[k].args[0] == product
        index, other = instruction.args if left else instruction.args[::-1]
        a, b = builder.instructions[index].args
        if instruction.kind is Kind.SUB and left:
            other = builder.operation(Kind.NEG, other)
        elif instruction.kind is Kind.SUB:
            a = builder.operation(Kind.NEG, a)
        return builder.operation(Kind.FMA, a, b, other)

    return drop_dead(rewrite(program, rule))


def _claims(program: Program) -> dict[int, int]:
    """For each sum that is to be fused, the product that it swallows."""
    users: dict[int, list[int]] = {k: [] for k, i in enumerate(program.instructions) if i.kind is Kind.MUL}
    kept = {k for entries in program.results for k in entries}
    for k, instruction in enumerate(program.instructions):
        for a in instruction.args:
            if a in users:
                users[a].append(k)
                if instruction.kind not in {Kind.ADD, Kind.SUB}:
                    kept.add(a)
    claimed: dict[int, int] = {}
    # Products with one user first: the others need all of theirs.
    for product in sorted(users, key=lambda k: (len(users[k]), k)):
        sums = users[product]
        if (
            product not in kept
            and len(set(sums)) == len(sums)  # x y + x y is no sum of a product and something else
            and not any(k in claimed for k in sums)
        ):
            claimed.update(dict.fromkeys(sums, product))
    return claimed


# ----------------------------------------------------------------------------------------------------
# All passes in the order that pays
# ----------------------------------------------------------------------------------------------------


def prepare(program: Program) -> Program:
    """Make a program short for the machine.

    Parameters
    ----------
    program
        Program as it was read.

    Returns
    -------
    Program
        With few divisions, free signs, shared operations and fused multiply-adds: the same values within round-off.

    Notes
    -----
    Largest errors of the inverse dynamics of ``stewart`` over 100 000 states, against long double, in units of 2.2e-16
    of the largest force: 7.8 as read, 7.5 with shared reciprocals, 7.4 with fused operations as well (medians 0.64,
    0.65, 0.57). Machines with and without fused operations differ by up to 8.7 of these units; the width of the vectors
    changes no bit. In float32, 6.5 units of 1.2e-7.

    The order of the operations stays. Orders that keep fewer values alive at a time were tried and gave nothing: the
    compiler puts what does not fit the registers on the stack, which the processor hides.
    """
    return fuse(simplify(share_reciprocals(simplify(program))))
