"""Lines of one LLVM function under construction, on vectors of states or on scalars."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np


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
        self.helpers: dict[str, list[str]] = {}
        self.shared: dict[str, Any] = {}
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
        name = self.name()
        self.lines.append(f"  {name} = {text}")
        return name

    def name(self) -> str:
        """Make up a name for a value.

        Returns
        -------
        str
            A fresh name.
        """
        self._names += 1
        return f"%t{self._names}"

    def label(self, word: str) -> str:
        """Make up a name for a place to jump to.

        Parameters
        ----------
        word
            What it begins with.

        Returns
        -------
        str
            A fresh name.
        """
        self._names += 1
        return f"{word}{self._names}"

    @property
    def every(self) -> str:
        """Mask of all lanes."""
        return "true" if self.lanes == 1 else "splat (i1 true)"

    @property
    def none(self) -> str:
        """Mask of no lane."""
        return "false" if self.lanes == 1 else "splat (i1 false)"

    def any(self, mask: str) -> str:
        """Tell whether a mask is set in any lane.

        Parameters
        ----------
        mask
            Mask.

        Returns
        -------
        str
            Name of a bit.
        """
        if self.lanes == 1:
            return mask
        bits = self.put(f"bitcast {self.mask} {mask} to i{self.lanes}")
        return self.put(f"icmp ne i{self.lanes} {bits}, 0")

    def all_below(self, values: Sequence[str], limit: float) -> str:
        """Compare several values with a limit.

        Parameters
        ----------
        values
            Values.
        limit
            What none may exceed.

        Returns
        -------
        str
            Mask of the lanes where none does.
        """
        mask = self.every
        for value in values:
            mask = self.put(f"and {self.mask} {mask}, {self.compare('ole', value, self.constant(limit))}")
        return mask

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

    def lane_by_lane(self, name: str, *args: str) -> str:
        """Call the C library by way of a function of the whole vector, where that happens seldom.

        Parameters
        ----------
        name
            Function of doubles.
        *args
            Operands.

        Returns
        -------
        str
            Name of the value.
        """
        if self.lanes == 1:
            return self.library(name, *args)
        if name not in self.helpers:
            inner = Writer(self._dtype, self.lanes, fused=self.fused)
            names = [f"%x{k}" for k in range(len(args))]
            value = inner.library(name, *names)
            self.declared |= inner.declared
            parameters = ", ".join(f"{self.type} {x}" for x in names)
            head = f"define internal {self.type} @{name}.lanes({parameters}) noinline cold #0 {{"
            self.helpers[name] = [head, *inner.lines, f"  ret {self.type} {value}", "}"]
        return self.put(f"call {self.type} @{name}.lanes({', '.join(f'{self.type} {a}' for a in args)})")

    def seldom(self, mask: str, make: Callable[[], str], otherwise: str) -> str:
        """Compute something only if it is needed in any lane.

        Parameters
        ----------
        mask
            Where it is needed.
        make
            Writes the computation, and gives the name of its value.
        otherwise
            Value if no lane needs it.

        Returns
        -------
        str
            Name of the value.
        """
        needed = self.any(mask)
        here, rare, on = (self.label(word) for word in ("here", "rare", "on"))
        self.lines += [
            f"  br label %{here}",
            f"{here}:",
            f"  br i1 {needed}, label %{rare}, label %{on}, !prof !0",
            f"{rare}:",
        ]
        value = make()
        self.lines += [f"  br label %{on}", f"{on}:"]
        return self.put(f"phi {self.type} [ {otherwise}, %{here} ], [ {value}, %{rare} ]")

    def multiply_add(self, a: str, b: str, c: str) -> str:
        """Write a b + c, fused where the machine can.

        Parameters
        ----------
        a, b, c
            Operands.

        Returns
        -------
        str
            Name of the value.
        """
        if self.fused:
            return self.call("fma", a, b, c)
        return self.put(f"fadd {self.type} {self.put(f'fmul {self.type} {a}, {b}')}, {c}")

    def integers(self, kind: str) -> str:
        """Type of one integer for each lane.

        Parameters
        ----------
        kind
            LLVM type of one, as "i64".

        Returns
        -------
        str
            LLVM type.
        """
        return kind if self.lanes == 1 else f"<{self.lanes} x {kind}>"

    def integer(self, kind: str, value: int) -> str:
        """Spell an integer in every lane.

        Parameters
        ----------
        kind
            LLVM type of one, as "i64".
        value
            Its value.

        Returns
        -------
        str
            LLVM constant.
        """
        return str(value) if self.lanes == 1 else f"splat ({kind} {value})"

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
