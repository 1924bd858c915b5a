"""Print operations on vectors as LLVM IR."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from stewart_pin.kernels.program import LIBRARY, Kind, Program

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


class Writer:
    """Lines of one IR function, with fresh names and the type it works in.

    Parameters
    ----------
    dtype
        numpy.float64 or numpy.float32.
    lanes
        States at a time; 1 for scalars.
    fused
        Whether the machine has fused multiply-add.
    """

    def __init__(self, dtype: np.dtype, lanes: int, *, fused: bool) -> None:
        self.scalar = {8: "double", 4: "float"}[dtype.itemsize]
        self.lanes = lanes
        self.type = self.vector(lanes)
        self.mask = "i1" if lanes == 1 else f"<{lanes} x i1>"
        self.fused = fused
        self.lines: list[str] = []
        self.declared: set[str] = set()
        self._names = 0
        self._dtype = dtype

    def vector(self, n: int) -> str:
        """Type of n numbers.

        Parameters
        ----------
        n
            How many.

        Returns
        -------
        str
            LLVM type.
        """
        return self.scalar if n == 1 else f"<{n} x {self.scalar}>"

    def put(self, text: str) -> str:
        """Write an instruction that makes a value.

        Parameters
        ----------
        text
            Right-hand side.

        Returns
        -------
        str
            Fresh name of the value.
        """
        self._names += 1
        name = f"%t{self._names}"
        self.lines.append(f"  {name} = {text}")
        return name

    def constant(self, value: float) -> str:
        """Spell a constant in every lane.

        Parameters
        ----------
        value
            Its value.

        Returns
        -------
        str
            LLVM constant.
        """
        if self.scalar == "float":
            with np.errstate(over="ignore"):
                value = float(np.float32(value))
        bits = f"0x{struct.unpack('>Q', struct.pack('>d', value))[0]:016X}"
        return bits if self.lanes == 1 else f"splat ({self.scalar} {bits})"

    def call(self, intrinsic: str, *args: str) -> str:
        """Call an LLVM intrinsic of the vector type.

        Parameters
        ----------
        intrinsic
            Its name without type, as "sqrt".
        *args
            Operands.

        Returns
        -------
        str
            Name of the value.
        """
        suffix = {"double": "f64", "float": "f32"}[self.scalar]
        suffix = suffix if self.lanes == 1 else f"v{self.lanes}{suffix}"
        function = f"@llvm.{intrinsic}.{suffix}"
        self.declared.add(f"declare {self.type} {function}({', '.join([self.type] * len(args))})")
        return self.put(f"call {self.type} {function}({', '.join(f'{self.type} {a}' for a in args)})")

    def library(self, name: str, *args: str) -> str:
        """Call the C library for each lane.

        Parameters
        ----------
        name
            Function of doubles; that of floats has an f more.
        *args
            Operands.

        Returns
        -------
        str
            Name of the value.
        """
        name = name if self.scalar == "double" else f"{name}f"
        signature = ", ".join([self.scalar] * len(args))
        self.declared.add(f"declare {self.scalar} @{name}({signature}) nounwind willreturn memory(none)")
        if self.lanes == 1:
            return self.put(f"call {self.scalar} @{name}({', '.join(f'{self.scalar} {a}' for a in args)})")
        whole = "poison"
        for lane in range(self.lanes):
            parts = [self.put(f"extractelement {self.type} {a}, i32 {lane}") for a in args]
            value = self.put(f"call {self.scalar} @{name}({', '.join(f'{self.scalar} {p}' for p in parts)})")
            whole = self.put(f"insertelement {self.type} {whole}, {self.scalar} {value}, i32 {lane}")
        return whole

    def compare(self, test: str, a: str, b: str) -> str:
        """Compare, giving a mask.

        Parameters
        ----------
        test
            LLVM predicate.
        a, b
            Operands.

        Returns
        -------
        str
            Name of the mask.
        """
        return self.put(f"fcmp {test} {self.type} {a}, {b}")

    def select(self, mask: str, a: str, b: str) -> str:
        """Choose a where the mask is set, else b.

        Parameters
        ----------
        mask
            Mask.
        a, b
            Operands.

        Returns
        -------
        str
            Name of the value.
        """
        return self.put(f"select {self.mask} {mask}, {self.type} {a}, {self.type} {b}")


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
        if w.fused:
            return w.call("fma", *x)
        return w.put(f"fadd {w.type} {w.put(f'fmul {w.type} {x[0]}, {x[1]}')}, {x[2]}")
    if kind in INTRINSICS:
        return w.call(INTRINSICS[kind], *x)
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
