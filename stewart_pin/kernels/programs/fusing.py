"""Multiply and add in one operation, where that saves the multiplication.

The choice is made here, not by the compiler, so that every vector width and the single state round alike, bit for bit.
"""

from __future__ import annotations

from stewart_pin.kernels.programs.passes import drop_dead, rewrite
from stewart_pin.kernels.programs.program import Instruction, Kind, Program
from stewart_pin.kernels.programs.program_builder import ProgramBuilder


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
