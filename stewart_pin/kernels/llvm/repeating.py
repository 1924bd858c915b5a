"""Write a program and its repetition: every state stops by itself, whatever its neighbours do."""

from __future__ import annotations

from collections.abc import Sequence

from stewart_pin.kernels.llvm.operations import write_program
from stewart_pin.kernels.llvm.writer import Writer
from stewart_pin.kernels.programs.program import Program
from stewart_pin.kernels.programs.repeating import Repeat, require_repeat


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
