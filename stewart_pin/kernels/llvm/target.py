"""The machine that a kernel is made for: its name, what it can do, and how many bytes one register holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from stewart_pin.errors import InputError, MissingExtraError

_X86 = {
    64: ("x86-64-v4", "+avx512f,+avx512vl,+avx512dq,+avx512bw,+avx512cd,+fma,+avx2"),
    32: ("x86-64-v3", "+fma,+avx2"),
    16: ("x86-64", "+sse2"),
}


@dataclass(frozen=True)
class Target:
    """A machine, as LLVM names it.

    Attributes
    ----------
    triple
        Architecture, vendor, system.
    cpu
        Processor.
    features
        Instruction sets, as "+avx2,-avx512f".
    vector_bytes
        Size of the widest register.
    fused
        Whether a b + c is one operation.
    """

    triple: str
    cpu: str
    features: str
    vector_bytes: int
    fused: bool


def load_llvm() -> Any:
    """Import the compiler.

    Returns
    -------
    module
        `llvmlite.binding`, with the code generator of this machine ready.

    Raises
    ------
    MissingExtraError
        If llvmlite is not installed.
    """
    try:
        import llvmlite.binding as llvm  # noqa: PLC0415 - optional
    except ImportError:
        raise MissingExtraError("llvmlite", "kernels") from None
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm


def host_target() -> Target:
    """Describe the machine that runs this process, with its widest vectors.

    Returns
    -------
    Target
        This machine.

    Raises
    ------
    MissingExtraError
        If llvmlite is not installed.
    """
    llvm = load_llvm()
    triple = llvm.get_process_triple()
    features = llvm.get_host_cpu_features()  # empty where LLVM cannot ask the processor
    if not triple.startswith(("x86_64", "amd64")):
        arm = triple.startswith(("aarch64", "arm64"))
        return Target(triple, llvm.get_host_cpu_name(), features.flatten(), 16, arm)
    fused = bool(features.get("fma"))
    # AVX without FMA has the registers, and half the speed; AVX-512 without DQ or VL is a coprocessor of the past.
    wide = all(features.get(f) for f in ("avx512f", "avx512vl", "avx512dq"))
    vector_bytes = 64 if wide else 32 if features.get("avx2") else 16
    return Target(triple, llvm.get_host_cpu_name(), features.flatten(), vector_bytes, fused)


def narrow_target(vector_bytes: int) -> Target:
    """Describe an older x86-64 machine, whose code this one also runs if it has the registers.

    Parameters
    ----------
    vector_bytes
        64 (AVX-512), 32 (AVX2 with FMA) or 16 (SSE2, no FMA).

    Returns
    -------
    Target
        That machine.

    Raises
    ------
    InputError
        If there is none with such registers.
    """
    if vector_bytes not in _X86:
        raise InputError(f"vector_bytes must be 16, 32 or 64, got {vector_bytes!r}")
    cpu, features = _X86[vector_bytes]
    return Target(load_llvm().get_process_triple(), cpu, features, vector_bytes, vector_bytes > 16)
