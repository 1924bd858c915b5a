"""Wrap a program in the two functions that are called: one for ranges of states, one for a single state.

The function for ranges takes a table of addresses: for each input and output the first entry and the distance between
states in bytes, then the status bytes, or null. It always works on full vectors; lanes beyond the end repeat the last
state and write the same values to the same place again, so a state's result does not depend on where it stands. The
function for one state knows its addresses, and takes no argument. Outputs that only judge a state are not written.
States come from memory, and go back, by transposition in registers.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from stewart_pin.programs.llvm.machine_code import Target
from stewart_pin.programs.llvm.operations import write_program, write_repeatedly
from stewart_pin.programs.llvm.writer import Writer
from stewart_pin.programs.program import Program, require_output
from stewart_pin.programs.repeating import Repeat
from stewart_pin.programs.status import StateBound, StateStatus, written_outputs

# ----------------------------------------------------------------------------------------------------
# Move rows of several states to vectors of one entry each, and back: transposition in registers
#
# States lie in memory row after row, (N, size); the operations want one entry of `lanes` states in one register.
# A state of 19 numbers in and 6 out takes 5.1 ns so; loads of single numbers take 6.1 ns, the gather instruction 9.5 ns
# (float64, AVX-512, Zen 5).
# ----------------------------------------------------------------------------------------------------


def load_columns(writer: Writer, rows: Sequence[str], size: int) -> list[str]:
    """Load one row per lane and transpose.

    Parameters
    ----------
    writer
        Function under construction.
    rows
        Pointer to the row of each lane.
    size
        Entries of a row.

    Returns
    -------
    list of str
        For each entry, the name of the vector over the lanes.
    """
    columns: list[str] = []
    for first, width in _pieces(size, writer.lanes):
        kind = writer.vector(width)
        pieces = [
            writer.put(f"load {kind}, ptr {_at(writer, row, first)}, align {_align(writer)}") for row in rows
        ]
        columns += _transposed(writer, _joined(writer, pieces, width), width)
    return columns


def store_columns(writer: Writer, rows: Sequence[str], columns: Sequence[str]) -> None:
    """Transpose and store one row per lane.

    Parameters
    ----------
    writer
        Function under construction.
    rows
        Pointer to the row of each lane.
    columns
        For each entry, the name of the vector over the lanes.
    """
    for first, width in _pieces(len(columns), writer.lanes):
        blocks = _transposed(writer, list(columns[first : first + width]), width)
        for lane, row in enumerate(rows):
            piece = _cut(writer, blocks[lane % width], lane - lane % width, width)
            at = _at(writer, row, first)
            writer.lines.append(f"  store {writer.vector(width)} {piece}, ptr {at}, align {_align(writer)}")


def _pieces(size: int, lanes: int) -> list[tuple[int, int]]:
    """Cut a row into powers of two, none wider than a register."""
    pieces, first, width = [], 0, lanes
    while first < size:
        while width > size - first:
            width //= 2
        pieces.append((first, width))
        first += width
    return pieces


def _align(writer: Writer) -> int:
    return 8 if writer.scalar == "double" else 4


def _at(writer: Writer, row: str, entry: int) -> str:
    return row if entry == 0 else writer.put(f"getelementptr {writer.scalar}, ptr {row}, i64 {entry}")


def _joined(writer: Writer, pieces: list[str], width: int) -> list[str]:
    """Put the pieces of rows j, j + width, j + 2 width, ... side by side in vector j."""
    if width == 1:
        return [_gathered(writer, pieces)]
    whole = [pieces[j::width] for j in range(width)]
    size = width
    while size < writer.lanes:
        kind = writer.vector(size)
        mask = _mask(range(2 * size))
        whole = [
            [
                writer.put(f"shufflevector {kind} {a}, {kind} {b}, {mask}")
                for a, b in zip(group[::2], group[1::2], strict=True)
            ]
            for group in whole
        ]
        size *= 2
    return [group[0] for group in whole]


def _gathered(writer: Writer, scalars: list[str]) -> str:
    if writer.lanes == 1:
        return scalars[0]
    whole = "poison"
    for lane, scalar in enumerate(scalars):
        whole = writer.put(f"insertelement {writer.type} {whole}, {writer.scalar} {scalar}, i32 {lane}")
    return whole


def _cut(writer: Writer, whole: str, first: int, width: int) -> str:
    if width == writer.lanes:
        return whole
    if width == 1:
        return writer.put(f"extractelement {writer.type} {whole}, i32 {first}")
    mask = _mask(range(first, first + width))
    return writer.put(f"shufflevector {writer.type} {whole}, {writer.type} poison, {mask}")


def _transposed(writer: Writer, vectors: list[str], width: int) -> list[str]:
    """Transpose each block of width × width, one exchange of halves per bit of the index."""
    lanes, bit = writer.lanes, 1
    while bit < width:
        upper = [lanes + lane - bit if lane & bit else lane for lane in range(lanes)]
        lower = [lanes + lane if lane & bit else lane + bit for lane in range(lanes)]
        new = list(vectors)
        for k in (k for k in range(width) if not k & bit):
            pair = f"{writer.type} {vectors[k]}, {writer.type} {vectors[k | bit]}"
            new[k] = writer.put(f"shufflevector {pair}, {_mask(upper)}")
            new[k | bit] = writer.put(f"shufflevector {pair}, {_mask(lower)}")
        vectors, bit = new, 2 * bit
    return vectors


def _mask(lanes: Sequence[int] | range) -> str:
    return f"<{len(lanes)} x i32> <{', '.join(f'i32 {k}' for k in lanes)}>"


# ----------------------------------------------------------------------------------------------------


def module_for_ranges(
    program: Program,
    bounds: Sequence[StateBound],
    dtype: np.dtype[Any],
    target: Target,
    repeat: Repeat | None = None,
) -> str:
    """Write the LLVM module of a program for ranges of states.

    Parameters
    ----------
    program
        Program.
    bounds
        Bounds of outputs that judge a state.
    dtype
        numpy.float64 or numpy.float32.
    target
        Machine.
    repeat
        How it is repeated, if it is.

    Returns
    -------
    str
        LLVM IR with the function ``run(begin, end, table)``.
    """
    writer = Writer(dtype, target.vector_bytes // dtype.itemsize, fused=target.fused)
    _write_loop(writer, program, bounds, repeat)
    return _module(writer, target, "i64 %begin, i64 %end, ptr noalias %table")


def module_for_one(
    program: Program,
    bounds: Sequence[StateBound],
    dtype: np.dtype[Any],
    target: Target,
    addresses: Sequence[int],
    repeat: Repeat | None = None,
) -> str:
    """Write the LLVM module of a program for one state at a fixed place.

    Parameters
    ----------
    program
        Program.
    bounds
        Bounds of outputs that judge a state.
    dtype
        numpy.float64 or numpy.float32.
    target
        Machine.
    addresses
        Where the first entry of each input and output lies, and the status byte.
    repeat
        How it is repeated, if it is.

    Returns
    -------
    str
        LLVM IR with the function ``run()``.
    """
    writer = Writer(dtype, 1, fused=target.fused)
    *ports, status = (f"inttoptr (i64 {address} to ptr)" for address in addresses)
    n = len(program.inputs)
    inputs = [
        load_columns(writer, [at], port.size) for at, port in zip(ports[:n], program.inputs, strict=True)
    ]
    results, code = _judged(writer, program, bounds, inputs, _written(writer, program, repeat, inputs))
    for at, entries in zip(ports[n:], results, strict=True):
        store_columns(writer, [at], entries)
    writer.lines += [f"  store i8 {code}, ptr {status}", "  ret void"]
    return _module(writer, target, "")


def _module(writer: Writer, target: Target, arguments: str) -> str:
    return "\n".join(
        [
            f'target triple = "{target.triple}"',
            *sorted(writer.declared),
            *itertools.chain.from_iterable(writer.helpers.values()),
            f"define void @run({arguments}) #0 {{",
            *writer.lines,
            "}",
            # Some processors are tuned to halves of their widest registers unless asked.
            f'attributes #0 = {{ nounwind "min-legal-vector-width"="{8 * target.vector_bytes}" }}',
            '!0 = !{!"branch_weights", i32 1, i32 1000000}',  # of what happens seldom
        ]
    )


def _write_loop(
    writer: Writer, program: Program, bounds: Sequence[StateBound], repeat: Repeat | None
) -> None:
    ports = [*program.inputs, *written_outputs(program, bounds)]
    writer.lines.append("entry:")
    bases = [_entry(writer, "ptr", 2 * p) for p in range(len(ports))]
    strides = [_entry(writer, "i64", 2 * p + 1) for p in range(len(ports))]
    status = _entry(writer, "ptr", 2 * len(ports))
    last = writer.put("sub i64 %end, 1")
    writer.lines += [
        "  %go = icmp slt i64 %begin, %end",
        "  %judged = icmp ne ptr " + status + ", null",
        "  br i1 %go, label %loop, label %done",
        "loop:",
        "  %i = phi i64 [ %begin, %entry ], [ %next, %again ]",
    ]
    states = [_clamped(writer, "%i", lane, last) for lane in range(writer.lanes)]

    def rows(p: int) -> list[str]:
        offsets = [writer.put(f"mul i64 {s}, {strides[p]}") for s in states]
        return [writer.put(f"getelementptr i8, ptr {bases[p]}, i64 {o}") for o in offsets]

    inputs = [load_columns(writer, rows(p), port.size) for p, port in enumerate(program.inputs)]
    results = _written(writer, program, repeat, inputs)
    results, codes = _judged(writer, program, bounds, inputs, results)
    for p, columns in enumerate(results, len(program.inputs)):
        store_columns(writer, rows(p), columns)
    writer.lines += ["  br i1 %judged, label %judge, label %again", "judge:"]
    for lane, state in enumerate(states):
        code = writer.put(f"extractelement {_bytes(writer)} {codes}, i32 {lane}")
        at = writer.put(f"getelementptr i8, ptr {status}, i64 {state}")
        writer.lines.append(f"  store i8 {code}, ptr {at}")
    writer.lines += [
        "  br label %again",
        "again:",
        f"  %next = add i64 %i, {writer.lanes}",
        "  %more = icmp slt i64 %next, %end",
        "  br i1 %more, label %loop, label %done",
        "done:",
        "  ret void",
    ]


def _written(
    writer: Writer, program: Program, repeat: Repeat | None, inputs: list[list[str]]
) -> list[list[str]]:
    if repeat is None:
        return write_program(writer, program, inputs)
    return write_repeatedly(writer, program, repeat, inputs)


def _entry(writer: Writer, kind: str, index: int) -> str:
    at = writer.put(f"getelementptr i64, ptr %table, i64 {index}")
    return writer.put(f"load {kind}, ptr {at}")


def _clamped(writer: Writer, i: str, lane: int, last: str) -> str:
    if lane == 0:
        return i
    state = writer.put(f"add i64 {i}, {lane}")
    inside = writer.put(f"icmp slt i64 {state}, {last}")
    return writer.put(f"select i1 {inside}, i64 {state}, i64 {last}")


def _bytes(writer: Writer) -> str:
    return "i8" if writer.lanes == 1 else f"<{writer.lanes} x i8>"


def _judged(
    writer: Writer,
    program: Program,
    bounds: Sequence[StateBound],
    inputs: list[list[str]],
    results: list[list[str]],
) -> tuple[list[list[str]], str]:
    """Replace the results of bad states by nan, and give the codes."""
    inputs_finite = _all_finite(writer, [x for entries in inputs for x in entries])
    finite = _all_finite(writer, [x for entries in results for x in entries])
    good = writer.put(f"and {writer.mask} {inputs_finite}, {finite}")
    judges, known = [(finite, StateStatus.RESULT_NOT_FINITE)], {}
    for bound in bounds:
        within = writer.every
        for x in results[require_output(program, bound.output)]:
            for test, value in (("oge", bound.lower), ("ole", bound.upper)):
                if not math.isinf(value):
                    ok = writer.compare(test, x, writer.constant(value))
                    within = writer.put(f"and {writer.mask} {within}, {ok}")
        good = writer.put(f"and {writer.mask} {good}, {within}")
        judges.append((within, bound.code))
        beyond = writer.put(f"xor {writer.mask} {within}, {writer.every}")
        sure = writer.put(f"or {writer.mask} {finite}, {beyond}")
        known[bound.output] = writer.put(f"and {writer.mask} {inputs_finite}, {sure}")
    nan = writer.constant(float("nan"))
    written = written_outputs(program, bounds)
    results = [
        [writer.select(known.get(port.name, good), x, nan) for x in entries]
        for port, entries in zip(program.outputs, results, strict=True)
        if port in written
    ]
    code = _code(writer, StateStatus.OK)
    for mask, status in (*judges, (inputs_finite, StateStatus.INPUT_NOT_FINITE)):
        kind = _bytes(writer)
        code = writer.put(f"select {writer.mask} {mask}, {kind} {code}, {kind} {_code(writer, status)}")
    return results, code


def _code(writer: Writer, status: StateStatus) -> str:
    return str(int(status)) if writer.lanes == 1 else f"splat (i8 {int(status)})"


def _all_finite(writer: Writer, values: list[str]) -> str:
    """Mask of the lanes where all values are finite: zero times one that is not gives nan."""
    zero = total = writer.constant(0.0)
    for x in values:
        total = writer.multiply_add(x, zero, total)
    return writer.compare("oeq", total, zero)
