"""Put a program together, instruction by instruction, without doing anything twice."""

from __future__ import annotations

from collections.abc import Iterator

from stewart_pin.kernels.programs.program import Instruction, Kind, Program

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
