"""CasADi's expressions: one thread at a time works with them, and functions of them are read as programs.

Equal constants are one node to CasADi, and nodes are counted without a lock. From 3.8 on its functions let go of
Python's lock as well, so that two threads that write expressions, or drop them, end the process.
"""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Collection, Iterator
from typing import Any, Generic, TypeVar, overload

from stewart_pin.errors import InputError, MissingExtraError, UnsupportedError
from stewart_pin.programs.program import Instruction, Kind, Port, Program, ProgramBuilder, n_operands

T = TypeVar("T")

_LOCK = threading.RLock()
_LEFT: deque[dict[str, Any]] = deque()
"""What nobody needs any more, by threads that did not have the lock: the next one that has it drops it."""


@contextlib.contextmanager
def writing() -> Iterator[None]:
    """Keep other threads from CasADi while this one writes, reads or drops expressions.

    Yields
    ------
    None
        May be entered again inside.
    """
    with _LOCK:
        _LEFT.clear()
        yield


def drop(holder: object) -> None:
    """Let go of the expressions that an object holds; for ``__del__``, which may run in any thread, inside any lock.

    Parameters
    ----------
    holder
        The object; its attributes are gone then.
    """
    _LEFT.append(dict(vars(holder)))
    vars(holder).clear()
    if _LOCK.acquire(blocking=False):  # a finaliser that waits may wait for its own thread
        try:
            _LEFT.clear()
        finally:
            _LOCK.release()


class written_once(Generic[T]):
    """A property that is written when it is first asked for, by one thread, and kept.

    `functools.cached_property` has a lock of its own in Python 3.11, which two threads could take in two orders.

    Parameters
    ----------
    write
        The property.
    """

    def __init__(self, write: Callable[[Any], T]) -> None:
        self._write, self._name = write, write.__name__
        self.__doc__ = write.__doc__

    @overload
    def __get__(self, instance: None, owner: type[Any]) -> written_once[T]: ...
    @overload
    def __get__(self, instance: object, owner: type[Any]) -> T: ...
    def __get__(self, instance: object | None, owner: type[Any]) -> written_once[T] | T:
        """Write the property; from then on the instance's own attribute stands before this one."""
        if instance is None:
            return self
        own = vars(instance)
        with writing():
            if self._name not in own:
                own[self._name] = self._write(instance)
            return own[self._name]


# ----------------------------------------------------------------------------------------------------
# From a CasADi function to a program
#
# CasADi keeps a scalar symbolic function as instructions on work registers that are used again and again. Here each
# register write becomes a value of its own, which is what the passes and the compiler need.
# ----------------------------------------------------------------------------------------------------


def program_from_casadi(function: Any, *, matrices: Collection[str] = ()) -> Program:
    """Turn a CasADi function into a straight-line program.

    Parameters
    ----------
    function
        `casadi.Function` of scalar symbols (SX), or one that can be expanded to such. The entries of its matrices
        count in C order here, not column by column; structural zeros are zeros.
    matrices
        Outputs that stay matrices where they have one column; others become vectors.

    Returns
    -------
    Program
        The same operations in the same order, repeated ones shared, dead ones left out by CasADi.

    Raises
    ------
    InputError
        If it is no CasADi function, or has symbols that are no inputs.
    MissingExtraError
        If CasADi is not installed.
    UnsupportedError
        If it calls functions or operations that have no straight-line form here.
    """
    try:
        import casadi  # noqa: PLC0415 - optional
    except ImportError:
        raise MissingExtraError("casadi", "kernels") from None
    if not isinstance(function, casadi.Function):
        raise InputError(f"function must be a casadi.Function, got {type(function).__name__}")
    with writing():
        function = _expanded(function)
        if function.has_free():
            raise InputError(
                f"function {function.name()!r} has symbols that are no inputs: {function.get_free()}"
            )
        return _Reader(casadi, function, matrices).program()


def _expanded(function: Any) -> Any:
    if function.is_a("SXFunction"):
        return function
    try:
        return function.expand()
    except RuntimeError as error:
        raise UnsupportedError(
            f"function {function.name()!r} cannot be expanded to scalar operations: {error}"
        ) from None


class _Reader:
    """One pass over the instructions, with the value that each work register holds at the moment."""

    def __init__(self, casadi: Any, function: Any, matrices: Collection[str]) -> None:
        self.function = function
        self.casadi = casadi
        ours = {Kind.INPUT, Kind.CONSTANT, Kind.FMA}  # all others have CasADi's names
        self.kinds = {getattr(casadi, f"OP_{kind.name}"): kind for kind in Kind if kind not in ours}
        inputs = tuple(_port(function.name_in(i), function.sparsity_in(i)) for i in range(function.n_in()))
        outputs = tuple(
            _port(name, function.sparsity_out(i), matrix=name in matrices)
            for i, name in enumerate(function.name_out())
        )
        self.builder = ProgramBuilder(Program(function.name(), inputs, outputs, (), ()))
        self.entries_in = [_entries(function.sparsity_in(i)) for i in range(function.n_in())]
        self.entries_out = [_entries(function.sparsity_out(i)) for i in range(function.n_out())]
        self.register: dict[int, int] = {}

    def program(self) -> Program:
        casadi, function, register = self.casadi, self.function, self.register
        written: dict[tuple[int, int], int] = {}
        for k in range(function.n_instructions()):
            operation, o, i = (
                function.instruction_id(k),
                function.instruction_output(k),
                function.instruction_input(k),
            )
            if operation == casadi.OP_OUTPUT:
                written[o[0], self.entries_out[o[0]][o[1]]] = register[i[0]]
            elif operation == casadi.OP_INPUT:
                place = (i[0], self.entries_in[i[0]][i[1]])
                register[o[0]] = self.builder.append(Instruction(Kind.INPUT, place=place))
            elif operation == casadi.OP_CONST:
                register[o[0]] = self.builder.constant(float(function.instruction_constant(k)))
            else:
                register[o[0]] = self._value(operation, [register[j] for j in i])
        zero = self.builder.constant(0.0)
        sizes = [function.size1_out(p) * function.size2_out(p) for p in range(function.n_out())]
        return self.builder.finish(
            tuple(written.get((p, e), zero) for e in range(size)) for p, size in enumerate(sizes)
        )

    def _value(self, operation: int, args: list[int]) -> int:
        casadi, builder = self.casadi, self.builder
        if operation in self.kinds:
            kind = self.kinds[operation]
            # CasADi lists the operand of a unary operation twice.
            return builder.operation(kind, *args[: n_operands(kind)])
        x = args[0]
        if operation in {casadi.OP_ASSIGN, casadi.OP_LIFT}:
            return x
        if operation == casadi.OP_SQ:
            return builder.operation(Kind.MUL, x, x)
        if operation == casadi.OP_TWICE:
            return builder.operation(Kind.ADD, x, x)
        if operation == casadi.OP_INV:
            return builder.operation(Kind.DIV, builder.constant(1.0), x)
        if operation == casadi.OP_CONSTPOW:
            return builder.operation(Kind.POW, *args)
        names = [n for n in dir(casadi) if n.startswith("OP_") and getattr(casadi, n) == operation]
        raise UnsupportedError(
            f"function {self.function.name()!r} uses the CasADi operation {'/'.join(names) or operation}, which has "
            "no straight-line form here; inline its calls (always_inline) or write it with other operations"
        )


def _port(name: str, sparsity: Any, *, matrix: bool = False) -> Port:
    rows, columns = sparsity.size1(), sparsity.size2()
    return Port(name, (rows,) if columns == 1 and not matrix else (rows, columns))


def _entries(sparsity: Any) -> list[int]:
    """Place of each structural nonzero in C order."""
    columns = sparsity.size2()
    rows_of, columns_of = sparsity.get_triplet()
    return [r * columns + c for r, c in zip(rows_of, columns_of, strict=True)]
