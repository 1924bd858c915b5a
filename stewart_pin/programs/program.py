"""A straight-line program: named inputs, one operation after another, named outputs.

Each operation makes one value and names the values that it needs by their index in the list, so the list is its own
order of evaluation, and nothing is ever overwritten. A builder puts a program together, and NumPy can run it.
"""

from __future__ import annotations

import enum
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from stewart_pin.errors import InputError
from stewart_pin.typing import FloatArray


class Kind(enum.StrEnum):
    """Operation; the names are those of the C library where it has the operation."""

    INPUT = "input"
    CONSTANT = "constant"
    ADD = "add"
    SUB = "sub"
    MUL = "mul"
    DIV = "div"
    FMA = "fma"  # a b + c, rounded once where the machine can
    NEG = "neg"
    SQRT = "sqrt"
    FABS = "fabs"
    FLOOR = "floor"
    CEIL = "ceil"
    SIGN = "sign"
    FMIN = "fmin"
    FMAX = "fmax"
    COPYSIGN = "copysign"
    LT = "lt"
    LE = "le"
    EQ = "eq"
    NE = "ne"
    NOT = "not"
    AND = "and"
    OR = "or"
    IF_ELSE_ZERO = "if_else_zero"  # b where a is not zero, else 0
    SIN = "sin"
    COS = "cos"
    TAN = "tan"
    ASIN = "asin"
    ACOS = "acos"
    ATAN = "atan"
    ATAN2 = "atan2"
    SINH = "sinh"
    COSH = "cosh"
    TANH = "tanh"
    ASINH = "asinh"
    ACOSH = "acosh"
    ATANH = "atanh"
    EXP = "exp"
    EXPM1 = "expm1"
    LOG = "log"
    LOG1P = "log1p"
    POW = "pow"
    HYPOT = "hypot"
    FMOD = "fmod"


_LIBRARY_OF_ONE = "sin cos tan asin acos atan sinh cosh tanh asinh acosh atanh exp expm1 log log1p"
_LIBRARY_OF_TWO = "atan2 pow hypot fmod"
LIBRARY = frozenset(Kind(name) for name in f"{_LIBRARY_OF_ONE} {_LIBRARY_OF_TWO}".split())
"""Operations that no machine has and the C library does."""
_OF_TWO = f"add sub mul div fmin fmax copysign lt le eq ne and or if_else_zero {_LIBRARY_OF_TWO}"
_TWO = frozenset(Kind(name) for name in _OF_TWO.split())


def n_operands(kind: Kind) -> int:
    """Count the values that an operation needs.

    Parameters
    ----------
    kind
        Operation.

    Returns
    -------
    int
        None for an input or a constant, one, two, or three for a fused multiply-add.
    """
    if kind in {Kind.INPUT, Kind.CONSTANT}:
        return 0
    return 3 if kind is Kind.FMA else 2 if kind in _TWO else 1


class Instruction(NamedTuple):
    """One operation.

    Attributes
    ----------
    kind
        What is done.
    args
        Indices of the values that it needs, all smaller than its own.
    constant
        Value of a constant.
    place
        (port, entry) of an input.
    """

    kind: Kind
    args: tuple[int, ...] = ()
    constant: float = 0.0
    place: tuple[int, int] = (0, 0)


@dataclass(frozen=True)
class Port:
    """A named input or output.

    Attributes
    ----------
    name
        Its name.
    shape
        Its shape for one state, (n,) or (rows, columns); entries count in C order.
    """

    name: str
    shape: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of entries."""
        return int(np.prod(self.shape))


@dataclass(frozen=True)
class Program:
    """A straight-line program for one state.

    Attributes
    ----------
    name
        Name of the function.
    inputs
        What it reads.
    outputs
        What it writes.
    instructions
        Operations, each after those that it needs.
    results
        For each output, the index of the value of each entry.
    """

    name: str
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    instructions: tuple[Instruction, ...]
    results: tuple[tuple[int, ...], ...]

    def __repr__(self) -> str:
        arguments = ", ".join(f"{p.name} {p.shape}" for p in self.inputs)
        gives = ", ".join(f"{p.name} {p.shape}" for p in self.outputs)
        return f"Program({self.name}: {arguments} -> {gives}; {n_operations(self)} operations)"


def operation_counts(program: Program) -> dict[Kind, int]:
    """Count the operations of each kind.

    Parameters
    ----------
    program
        Program.

    Returns
    -------
    dict
        Number of each kind that occurs, most frequent first; inputs and constants count as well.
    """
    return dict(Counter(i.kind for i in program.instructions).most_common())


def n_operations(program: Program) -> int:
    """Count the operations that compute something.

    Parameters
    ----------
    program
        Program.

    Returns
    -------
    int
        Number of instructions that are neither inputs nor constants.
    """
    return sum(i.kind not in {Kind.INPUT, Kind.CONSTANT} for i in program.instructions)


def require_output(program: Program, name: str) -> int:
    """Find an output by its name.

    Parameters
    ----------
    program
        Program.
    name
        Name of the output.

    Returns
    -------
    int
        Its index.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    names = [port.name for port in program.outputs]
    if name not in names:
        raise InputError(f"{program.name} has no output {name!r}, only {', '.join(names)}")
    return names.index(name)


# ----------------------------------------------------------------------------------------------------
# Put a program together, instruction by instruction, without doing anything twice
# ----------------------------------------------------------------------------------------------------

COMMUTATIVE = frozenset(
    {Kind.ADD, Kind.MUL, Kind.EQ, Kind.NE, Kind.AND, Kind.OR, Kind.HYPOT},
)
"""Operations whose two operands may be exchanged without changing a bit of the result."""


class ProgramBuilder:
    """List of instructions that grows and gives an operation that is there already a second time for nothing.

    Parameters
    ----------
    source
        Program whose name, inputs and outputs the new one takes over.
    """

    def __init__(self, source: Program) -> None:
        self._source = source
        self._known: dict[tuple[object, ...], int] = {}
        self.instructions: list[Instruction] = []

    def append(self, instruction: Instruction) -> int:
        """Append an instruction, or find the equal one.

        Parameters
        ----------
        instruction
            What to append.

        Returns
        -------
        int
            Index of its value.
        """
        kind, args, constant, place = instruction
        if kind in COMMUTATIVE and args[0] > args[1]:
            instruction = Instruction(kind, args[::-1])
            args = instruction.args
        # The bits, because 0.0 == -0.0 and nan != nan.
        key = (kind, args, constant.hex() if kind is Kind.CONSTANT else place)
        index = self._known.get(key)
        if index is None:
            index = self._known[key] = len(self.instructions)
            self.instructions.append(instruction)
        return index

    def operation(self, kind: Kind, *args: int) -> int:
        """Append an operation on values, or find the equal one.

        Parameters
        ----------
        kind
            Operation.
        *args
            Indices of values.

        Returns
        -------
        int
            Index of its value.
        """
        return self.append(Instruction(kind, args))

    def constant(self, value: float) -> int:
        """Append a constant, or find the equal one.

        Parameters
        ----------
        value
            Its value.

        Returns
        -------
        int
            Index of its value.
        """
        return self.append(Instruction(Kind.CONSTANT, (), value))

    def finish(self, results: Iterator[tuple[int, ...]]) -> Program:
        """Close the list.

        Parameters
        ----------
        results
            For each output, the index of the value of each entry.

        Returns
        -------
        Program
            The program, with the name, inputs and outputs of the source.
        """
        source = self._source
        return Program(source.name, source.inputs, source.outputs, tuple(self.instructions), tuple(results))


# ----------------------------------------------------------------------------------------------------
# Run a straight-line program with NumPy: one array operation per instruction, any floating-point type
#
# Needs no compiler, and in `numpy.longdouble` judges the one that is used.
# ----------------------------------------------------------------------------------------------------


def run_program(
    program: Program, inputs: Sequence[FloatArray], *, dtype: DTypeLike = np.float64
) -> list[FloatArray]:
    """Evaluate a program for many states.

    Parameters
    ----------
    program
        Program.
    inputs
        For each input (N, size) or (size,), which then holds for all states [any unit].
    dtype
        Floating-point type of every operation; constants are rounded to it.

    Returns
    -------
    list of numpy.ndarray
        For each output (N, size) [any unit].

    Notes
    -----
    A state that divides by zero or leaves the domain of a function gives inf or nan, as on the machine, without
    warning.
    """
    number: Callable[[float], Any] = np.dtype(dtype).type  # pyright: ignore[reportAssignmentType]
    arrays = [np.atleast_2d(np.asarray(x, dtype=dtype)) for x in inputs]
    n = max((len(x) for x in arrays if len(x) != 1), default=len(arrays[0]) if arrays else 1)
    last_use = _last_use(program)
    values: dict[int, Any] = {}
    with np.errstate(all="ignore"):
        for k, (kind, args, constant, place) in enumerate(program.instructions):
            if kind is Kind.INPUT:
                values[k] = arrays[place[0]][:, place[1]]
            elif kind is Kind.CONSTANT:
                values[k] = number(constant)
            else:
                values[k] = _OPERATIONS[kind](*(values[a] for a in args))
            for a in {*args, k}:
                if last_use[a] <= k:
                    del values[a]
    return [_stacked([values[k] for k in entries], n, dtype) for entries in program.results]


def _stacked(columns: list[Any], n: int, dtype: DTypeLike) -> FloatArray:
    out = np.empty((n, len(columns)), dtype=dtype)
    for k, column in enumerate(columns):
        out[:, k] = column
    return out


def _last_use(program: Program) -> list[int]:
    """Index of the instruction after which a value is needed no more, so that few arrays are alive at a time."""
    last = list(range(len(program.instructions)))
    for k, instruction in enumerate(program.instructions):
        for a in instruction.args:
            last[a] = k
    for entries in program.results:
        for k in entries:
            last[k] = len(program.instructions)
    return last


def _like(test: Callable[..., Any]) -> Callable[..., Any]:
    """Make a comparison give one or zero in the type of its operands, as CasADi's do."""
    return lambda *x: np.asarray(test(*x)).astype(np.result_type(*x))


_OPERATIONS: dict[Kind, Callable[..., Any]] = {
    Kind.ADD: np.add,
    Kind.SUB: np.subtract,
    Kind.MUL: np.multiply,
    Kind.DIV: np.divide,
    Kind.FMA: lambda a, b, c: a * b + c,
    Kind.NEG: np.negative,
    Kind.SQRT: np.sqrt,
    Kind.FABS: np.fabs,
    Kind.FLOOR: np.floor,
    Kind.CEIL: np.ceil,
    Kind.SIGN: lambda a: np.where(a < 0, -1, np.where(a > 0, 1, a)).astype(np.result_type(a)),
    Kind.FMIN: np.fmin,
    Kind.FMAX: np.fmax,
    Kind.COPYSIGN: np.copysign,
    Kind.LT: _like(np.less),
    Kind.LE: _like(np.less_equal),
    Kind.EQ: _like(np.equal),
    Kind.NE: _like(np.not_equal),
    Kind.NOT: _like(np.logical_not),
    Kind.AND: _like(np.logical_and),
    Kind.OR: _like(np.logical_or),
    Kind.IF_ELSE_ZERO: lambda a, b: np.where(a != 0, b, np.zeros((), np.result_type(a))),
    Kind.SIN: np.sin,
    Kind.COS: np.cos,
    Kind.TAN: np.tan,
    Kind.ASIN: np.arcsin,
    Kind.ACOS: np.arccos,
    Kind.ATAN: np.arctan,
    Kind.ATAN2: np.arctan2,
    Kind.SINH: np.sinh,
    Kind.COSH: np.cosh,
    Kind.TANH: np.tanh,
    Kind.ASINH: np.arcsinh,
    Kind.ACOSH: np.arccosh,
    Kind.ATANH: np.arctanh,
    Kind.EXP: np.exp,
    Kind.EXPM1: np.expm1,
    Kind.LOG: np.log,
    Kind.LOG1P: np.log1p,
    Kind.POW: np.power,
    Kind.HYPOT: np.hypot,
    Kind.FMOD: np.fmod,
}
