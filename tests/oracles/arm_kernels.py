"""Kernels as an Arm processor runs them: both entry points, compiled by the package and emulated."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from stewart_pin.programs.array_kernel import ArrayKernel
from stewart_pin.programs.llvm.machine_code import Target, host_target, object_file
from stewart_pin.programs.llvm.module import module_for_one, module_for_ranges
from tests.oracles.arm_machine import ArmMachine

SYSTEMS = {
    "Linux": Target("aarch64-unknown-linux-gnu", "generic", "", 16, fused=True),
    "Linux, SVE": Target("aarch64-unknown-linux-gnu", "neoverse-v1", "", 16, fused=True),
    "macOS": Target("arm64-apple-darwin23.0.0", "apple-m1", "", 16, fused=True),
    "Windows": Target("aarch64-pc-windows-msvc-elf", "generic", "", 16, fused=True),
}
"""As `host_target` describes such machines; llvmlite itself takes ELF on Windows."""
UNTOUCHED = 77
"""What results and codes are filled with beforehand."""


@dataclass(frozen=True)
class Answer:
    """Results for each output, codes (n,), and the functions of the C library that were called."""

    outputs: list[np.ndarray]
    codes: np.ndarray
    library_calls: list[str]


class ArmKernel:
    """The program of a kernel, compiled for Arm."""

    def __init__(self, kernel: ArrayKernel, target: Target) -> None:
        self._kernel = kernel
        self._target = target
        text = module_for_ranges(kernel.program, kernel.bounds, kernel.dtype, target, kernel.repeat)
        self._machine = self._new_machine()
        self._machine.load(object_file(text, target))

    def __call__(
        self,
        *inputs: np.ndarray,
        span: tuple[int, int] | None = None,
        at_end: bool = True,
        judged: bool = True,
    ) -> Answer:
        """Run the states of a span, all by default; inputs are (n, *shape), or (1, *shape) for all states."""
        machine, dtype = self._machine, self._kernel.dtype
        n = max(map(len, inputs))
        results, codes = self._empty((n,), n)
        table = []
        for x in (np.ascontiguousarray(x, dtype=dtype) for x in inputs):
            at = machine.place(x.tobytes(), writable=False, at_end=at_end)
            table += [at, x.strides[0] if len(x) > 1 else 0]
        places = [machine.place(x.tobytes(), writable=True, at_end=at_end) for x in (*results, codes)]
        for x, at in zip(results, places[:-1], strict=True):
            table += [at, x.strides[0]]
        table.append(places[-1] if judged else 0)
        table = machine.place(struct.pack(f"{len(table)}q", *table), writable=False)
        machine.library_calls.clear()
        machine.run(*(span or (0, n)), table)
        answer = _answer(machine, places, results, codes)
        machine.clear()
        return answer

    def one(self, *inputs: np.ndarray) -> Answer:
        """Run one state by the function without arguments, whose code holds its addresses."""
        kernel, machine = self._kernel, self._new_machine()
        contents = [np.asarray(x, dtype=kernel.dtype).tobytes() for x in inputs]
        results, codes = self._empty((), 1)
        addresses = [machine.place(x, writable=False) for x in contents]
        places = [machine.place(x.tobytes(), writable=True) for x in (*results, codes)]
        made_of = kernel.program, kernel.bounds, kernel.dtype, self._target
        text = module_for_one(*made_of, [*addresses, *places], kernel.repeat)
        machine.load(object_file(text, self._target))
        machine.run()
        return _answer(machine, places, results, codes)

    def _new_machine(self) -> ArmMachine:
        return ArmMachine(linux="linux" in self._target.triple)

    def _empty(self, many: tuple[int, ...], n: int) -> tuple[list[np.ndarray], np.ndarray]:
        dtype = self._kernel.dtype
        results = [np.full((*many, *p.shape), UNTOUCHED, dtype=dtype) for p in self._kernel.outputs]
        return results, np.full(n, UNTOUCHED, dtype=np.int8)


def same(there: np.ndarray, here: np.ndarray) -> bool:
    """Tell whether results are the same bits, or nearly so if this machine rounds products that Arm fuses."""
    if host_target().fused or there.dtype == np.int8:
        return there.tobytes() == here.tobytes()
    size = np.abs(here[np.isfinite(here)]).max(initial=1.0)
    return np.allclose(there, here, rtol=0.0, atol=1e-6 * size, equal_nan=True)


def _answer(machine: ArmMachine, places: list[int], results: list[np.ndarray], codes: np.ndarray) -> Answer:
    read = [
        np.frombuffer(machine.read(at, x.nbytes), dtype=x.dtype).reshape(x.shape)
        for at, x in zip(places, (*results, codes), strict=True)
    ]
    return Answer(read[:-1], read[-1], list(machine.library_calls))
