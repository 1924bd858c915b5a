"""Print operations on vectors as LLVM IR, and programs that repeat until every state has stopped."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from stewart_pin.programs.llvm.functions import (
    write_arccosine,
    write_arcsine,
    write_arctangent,
    write_cosine,
    write_sine,
)
from stewart_pin.programs.llvm.writer import Writer
from stewart_pin.programs.program import LIBRARY, Kind, Program
from stewart_pin.programs.repeating import Repeat, require_repeat

BINARY = {Kind.ADD: "fadd", Kind.SUB: "fsub", Kind.MUL: "fmul", Kind.DIV: "fdiv"}
INTRINSICS = {
    Kind.SQRT: "sqrt",
    Kind.FABS: "fabs",
    Kind.FLOOR: "floor",
    Kind.CEIL: "ceil",
    Kind.COPYSIGN: "copysign",
}
# "ne" is unordered, so that nan != nan, as in C.
COMPARISONS = {Kind.LT: "olt", Kind.LE: "ole", Kind.EQ: "oeq", Kind.NE: "une"}

WRITTEN: dict[Kind, Callable[..., str]] = {
    Kind.SIN: write_sine,
    Kind.COS: write_cosine,
    Kind.ATAN2: write_arctangent,
    Kind.ATAN: lambda w, x: write_arctangent(w, x, w.constant(1.0)),
    Kind.ASIN: write_arcsine,
    Kind.ACOS: write_arccosine,
}
"""Functions of the C library that kinematics needs all the time, for all lanes at once."""


def write_program(writer: Writer, program: Program, inputs: Sequence[Sequence[str]]) -> list[list[str]]:
    """Write all operations of a program.

    Parameters
    ----------
    writer
        Function under construction.
    program
        Program.
    inputs
        For each input, the name of the value of each entry.

    Returns
    -------
    list of list of str
        For each output, the name of the value of each entry.
    """
    values: list[str] = []
    for kind, args, constant, place in program.instructions:
        if kind is Kind.INPUT:
            values.append(inputs[place[0]][place[1]])
        elif kind is Kind.CONSTANT:
            values.append(writer.constant(constant))
        else:
            values.append(_operation(writer, kind, [values[a] for a in args]))
    return [[values[k] for k in entries] for entries in program.results]


def _operation(w: Writer, kind: Kind, x: list[str]) -> str:
    if kind in BINARY:
        return w.put(f"{BINARY[kind]} {w.type} {x[0]}, {x[1]}")
    if kind is Kind.NEG:  # costs nothing: the compiler folds it into the sum or product that uses it
        return w.put(f"fneg {w.type} {x[0]}")
    if kind is Kind.FMA:
        return w.multiply_add(*x)
    if kind in INTRINSICS:
        return w.call(INTRINSICS[kind], *x)
    if kind in WRITTEN:
        return WRITTEN[kind](w, *x)
    if kind in LIBRARY:
        return w.library(kind.value, *x)  # lane by lane, which rounds alike in every lane
    return _logical(w, kind, x)


def _logical(w: Writer, kind: Kind, x: list[str]) -> str:
    zero, one = w.constant(0.0), w.constant(1.0)
    if kind in COMPARISONS:
        return w.select(w.compare(COMPARISONS[kind], *x), one, zero)
    if kind in {Kind.FMIN, Kind.FMAX}:  # C's: a number wins over nan
        better = w.compare("olt" if kind is Kind.FMIN else "ogt", *x)
        return w.select(w.put(f"or {w.mask} {better}, {w.compare('uno', x[1], x[1])}"), *x)
    if kind is Kind.IF_ELSE_ZERO:
        return w.select(w.compare("une", x[0], zero), x[1], zero)
    if kind is Kind.NOT:
        return w.select(w.compare("oeq", x[0], zero), one, zero)
    if kind in {Kind.AND, Kind.OR}:
        truths = [w.compare("une", a, zero) for a in x]
        return w.select(w.put(f"{kind.value} {w.mask} {truths[0]}, {truths[1]}"), one, zero)
    assert kind is Kind.SIGN, kind
    negative = w.select(w.compare("olt", x[0], zero), w.constant(-1.0), x[0])
    return w.select(w.compare("ogt", x[0], zero), one, negative)


# ----------------------------------------------------------------------------------------------------
# Write a program and its repetition: every state stops by itself, whatever its neighbours do
# ----------------------------------------------------------------------------------------------------


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
    taken, gap = require_repeat(program, repeat)
    before, again, after, on = (w.label(name) for name in ("before", "again", "after", "on"))
    w.lines += [f"  br label %{before}", f"{before}:", f"  br label %{again}", f"{again}:"]
    place = len(w.lines)  # of what is carried from pass to pass; known when the pass has been written
    zero = w.constant(0.0)
    passes, done = w.name(), w.name()
    old = [[w.name() for _ in entries] for entries in program.results]
    begun = {k: [w.name() for _ in inputs[k]] for k in taken}
    given = [begun.get(k, list(entries)) for k, entries in enumerate(inputs)]
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
        for state, following in taken.items()
        for name, first, value in zip(begun[state], inputs[state], kept[following], strict=True)
    ]
    w.lines[place:place] = lines
    return kept
