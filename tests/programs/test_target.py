"""Which machine a kernel is made for."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from stewart_pin.errors import InputError
from stewart_pin.programs.llvm import machine_code
from stewart_pin.programs.llvm.machine_code import Target, host_target, narrow_target

pytest.importorskip("llvmlite")


class Features(dict):
    """What LLVM found out about a processor."""

    def flatten(self) -> str:
        return ",".join(f"{'+' if has else '-'}{name}" for name, has in sorted(self.items()))


X86 = "x86_64-unknown-linux-gnu"
WIDE = {"avx512f": True, "avx512vl": True, "avx512dq": True, "avx2": True, "fma": True}
MACHINES = {
    "AVX-512": (X86, "znver5", WIDE, 64, True),
    "AVX-512 without DQ": (X86, "knl", WIDE | {"avx512dq": False, "avx512vl": False}, 32, True),
    "AVX2": ("x86_64-apple-darwin22", "haswell", {"avx2": True, "fma": True}, 32, True),
    "AVX": (X86, "ivybridge", {"avx2": False, "fma": False}, 16, False),
    "Arm, Linux": ("aarch64-unknown-linux-gnu", "neoverse-v2", {"neon": True, "sve": True}, 16, True),
    "Arm, macOS": ("arm64-apple-darwin23.5.0", "apple-m1", {}, 16, True),
    "Arm, Windows": ("aarch64-pc-windows-msvc", "generic", {}, 16, True),
    "another": ("riscv64-unknown-linux-gnu", "generic", {}, 16, False),
}


@pytest.mark.parametrize(("triple", "cpu", "features", "size", "fused"), MACHINES.values(), ids=MACHINES)
def test_this_machine_is_taken_as_it_is(
    monkeypatch: pytest.MonkeyPatch, triple: str, cpu: str, features: dict, size: int, fused: bool
) -> None:
    found = Features(features)
    llvm = SimpleNamespace(
        get_process_triple=lambda: triple,
        get_host_cpu_name=lambda: cpu,
        get_host_cpu_features=lambda: found,
    )
    monkeypatch.setattr(machine_code, "load_llvm", lambda: llvm)
    assert host_target() == Target(triple, cpu, found.flatten(), size, fused)


def test_unknown_width_is_refused() -> None:
    with pytest.raises(InputError, match="vector_bytes must be 16, 32 or 64, got 8"):
        narrow_target(8)
