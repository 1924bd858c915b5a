"""A 64-bit Arm processor, emulated, with one object file in its memory.

What surrounds the code is as hostile as the procedure call standard allows: arrays lie at the edge of unmapped memory,
registers that a callee may change hold garbage at the start and after a call to the C library, and those that it must
keep are compared when it returns.

References
----------
.. [1] "Procedure Call Standard for the Arm 64-bit Architecture" (AAPCS64), section 6: registers, stack.
"""

from __future__ import annotations

import ctypes
import ctypes.util
from functools import cache
from typing import Any

import pytest

from tests.oracles.arm_object import LIBRARY, PAGE, place_object

unicorn = pytest.importorskip("unicorn", reason="needs Unicorn: pip install 'stewart_pin[oracles]'")

arm = unicorn.arm64_const
_STACK, _STACK_SIZE, _ARRAYS = 0x7000_0000_0000, 1 << 20, 0x5678_9ABC_0000
_RETURN = bytes.fromhex("c0035fd6")
_WORD = 2**64
_PATIENCE = 60_000_000
"""Microseconds."""
_GARBAGE = 0x7FF4_BAD0_7FA4_BAD0  # signalling nan, as one double or as two floats
_VECTORS = [arm.UC_ARM64_REG_Q0 + k for k in range(32)]
_GENERAL = [arm.UC_ARM64_REG_X0 + k for k in range(29)]
_LOWER_HALF_KEPT = range(8, 16)
_OF_SYSTEM = arm.UC_ARM64_REG_X18  # any code's on Linux, nobody's on macOS and Windows
_KEPT = [*_GENERAL[19:], arm.UC_ARM64_REG_FP, arm.UC_ARM64_REG_SP]
_KEPT += [arm.UC_ARM64_REG_D0 + k for k in _LOWER_HALF_KEPT]
_OF_TWO = {"atan2", "pow", "hypot", "fmod"}


class ArmMachine:
    """A processor whose memory holds what was placed there, and the function ``run`` of an object file.

    Calls of the C library are answered by that of this process, and noted. Not on Linux, the system has a register.
    """

    def __init__(self, *, linux: bool) -> None:
        self._kept = _KEPT if linux else [*_KEPT, _OF_SYSTEM]
        self._free = _GENERAL[: 19 if linux else 18]
        self._machine = unicorn.Uc(unicorn.UC_ARCH_ARM64, unicorn.UC_MODE_ARM)
        self._machine.ctl_set_cpu_model(arm.UC_CPU_ARM64_MAX)
        # Nothing traps the use of vectors: of Neon (CPACR_EL1.FPEN) and SVE (CPACR_EL1.ZEN, CPTR_EL3.EZ).
        self._machine.reg_write(arm.UC_ARM64_REG_CPACR_EL1, 0x33_0000)
        self._machine.cpr_write(3, 6, 1, 1, 2, 0x100)
        self._map(LIBRARY, _RETURN * (PAGE // 4), unicorn.UC_PROT_READ | unicorn.UC_PROT_EXEC)
        self._machine.mem_map(_STACK - _STACK_SIZE, _STACK_SIZE)
        self._machine.hook_add(unicorn.UC_HOOK_CODE, self._answer, begin=LIBRARY + 4, end=LIBRARY + PAGE - 1)
        self._placed: dict[int, int] = {}
        self._library: dict[int, str] = {}
        self._entry = 0
        self.library_calls: list[str] = []

    def load(self, object_file: bytes) -> None:
        """Load code."""
        placed = place_object(object_file)
        self._entry, self._library = placed.entry, placed.library
        for base, (content, is_code) in placed.regions.items():
            if content:
                protection = unicorn.UC_PROT_READ | (unicorn.UC_PROT_EXEC if is_code else 0)
                self._map(base, content.ljust(-(-len(content) // PAGE) * PAGE, b"\0"), protection)

    def place(self, content: bytes, *, writable: bool, at_end: bool = True) -> int:
        """Put bytes into memory of their own, up to its end or from its beginning, and give their address."""
        if not content:
            return _ARRAYS  # where nothing is
        padding = bytes(-len(content) % PAGE)
        base = _ARRAYS + PAGE + sum(size + PAGE for size in self._placed.values())  # nothing between
        protection = unicorn.UC_PROT_READ | (unicorn.UC_PROT_WRITE if writable else 0)
        self._map(base, padding + content if at_end else content + padding, protection)
        self._placed[base] = len(padding) + len(content)
        return base + (len(padding) if at_end else 0)

    def read(self, address: int, size: int) -> bytes:
        """Read memory."""
        return bytes(self._machine.mem_read(address, size)) if size else b""

    def clear(self) -> None:
        """Take away all that was placed."""
        for base, size in self._placed.items():
            self._machine.mem_unmap(base, size)
        self._placed.clear()

    def run(self, *arguments: int) -> None:
        """Call the function with numbers and addresses."""
        read, write = self._machine.reg_read, self._machine.reg_write
        self._spoil(_GENERAL, lower_halves=True)
        for register, value in zip(_GENERAL, arguments, strict=False):
            write(register, value)
        write(arm.UC_ARM64_REG_SP, _STACK)
        write(arm.UC_ARM64_REG_LR, LIBRARY)
        kept = [read(register) for register in self._kept]
        self._machine.emu_start(self._entry, LIBRARY, timeout=_PATIENCE)
        assert read(arm.UC_ARM64_REG_PC) == LIBRARY, "still running"
        assert kept == [read(register) for register in self._kept]

    def _map(self, base: int, content: bytes, protection: int) -> None:
        self._machine.mem_map(base, len(content), protection)
        self._machine.mem_write(base, content)

    def _spoil(self, general: list[int], *, lower_halves: bool) -> None:
        for register in general:
            self._machine.reg_write(register, _GARBAGE)
        for k, register in enumerate(_VECTORS):
            kept = k in _LOWER_HALF_KEPT and not lower_halves
            lower = self._machine.reg_read(register) % _WORD if kept else _GARBAGE
            self._machine.reg_write(register, _GARBAGE * _WORD + lower)

    def _answer(self, _machine: object, address: int, _size: int, _data: object) -> None:
        """Compute a function of the C library, and spoil all that it may."""
        name = self._library[address]
        if (
            name == "__chkstk"
        ):  # of Windows: touches the pages of a large frame, and leaves nearly all registers alone
            self._machine.reg_write(arm.UC_ARM64_REG_X16, _GARBAGE)
            self._machine.reg_write(arm.UC_ARM64_REG_X17, _GARBAGE)
            return
        self.library_calls.append(name)
        function, kind = _library_function(name)
        first = arm.UC_ARM64_REG_D0 if kind is ctypes.c_double else arm.UC_ARM64_REG_S0
        bits = [self._machine.reg_read(first + k) for k in range(len(function.argtypes))]
        value = function(*(kind.from_buffer_copy(x.to_bytes(8, "little")).value for x in bits))
        self._spoil(self._free, lower_halves=False)
        self._machine.reg_write(first, int.from_bytes(bytes(kind(value)), "little"))


@cache
def _library_function(name: str) -> tuple[Any, type]:
    function = ctypes.CDLL(ctypes.util.find_library("m"))[name]
    single = name.endswith("f")
    kind = ctypes.c_float if single else ctypes.c_double
    of_two = (name.removesuffix("f") if single else name) in _OF_TWO
    function.restype, function.argtypes = kind, [kind] * (2 if of_two else 1)
    return function, kind
