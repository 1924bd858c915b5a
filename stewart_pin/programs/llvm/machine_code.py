"""Machine code of a module, for a machine, alive as long as the function that it becomes."""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import os
import threading
import weakref
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from stewart_pin.errors import InputError, MissingExtraError, UnsupportedError

# ----------------------------------------------------------------------------------------------------
# The machine that a kernel is made for: its name, what it can do, and how many bytes one register holds
# ----------------------------------------------------------------------------------------------------


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


# ----------------------------------------------------------------------------------------------------
# Enter LLVM and leave it in order: what is opened is closed, and nobody is inside when the process ends
# ----------------------------------------------------------------------------------------------------

_INSIDE = threading.RLock()  # costs no parallelism: llvmlite lets one thread into LLVM at a time
_ENDING = threading.Event()
_PATIENCE = 30.0
"""Seconds: the largest kernels compile in ten."""


@contextlib.contextmanager
def inside_llvm() -> Iterator[contextlib.ExitStack]:
    """Hold what is opened in LLVM.

    Yields
    ------
    contextlib.ExitStack
        Closes what was entered, the last first, whatever happens. Left to a collection of cycles, the order would be
        any, and llvmlite crashes where a context goes before its engine or module.

    Notes
    -----
    When the interpreter ends, it waits for a daemon thread that is inside, and other daemon threads are not let in any
    more: the process then takes LLVM's tables apart while such threads still run.
    """
    with contextlib.ExitStack() as opened:
        with _INSIDE:
            late = _ENDING.is_set() and threading.current_thread().daemon
            if not late:
                yield opened
        if late:
            threading.Event().wait()  # until the process is gone


@atexit.register
def _end() -> None:
    _ENDING.set()
    if _INSIDE.acquire(timeout=_PATIENCE):
        _INSIDE.release()


if hasattr(os, "register_at_fork"):
    # A process that is forked while another thread is inside would find the lock taken for good, LLVM's own as well.
    os.register_at_fork(
        before=_INSIDE.acquire, after_in_parent=_INSIDE.release, after_in_child=_INSIDE.release
    )


# ----------------------------------------------------------------------------------------------------


def compile_for_ranges(text: str, target: Target) -> Any:
    """Compile a module to a function of (begin, end, table).

    Parameters
    ----------
    text
        LLVM IR with a function ``run``.
    target
        Machine; its instruction sets must be those of this one, or fewer.

    Returns
    -------
    callable
        Takes two numbers and an address, and lets other Python threads run meanwhile.
    """
    return _compiled(text, target, ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64, ctypes.c_void_p))


def compile_for_one(text: str, target: Target) -> Any:
    """Compile a module to a function without arguments.

    Parameters
    ----------
    text
        LLVM IR with a function ``run``.
    target
        Machine; its instruction sets must be those of this one, or fewer.

    Returns
    -------
    callable
        Keeps other Python threads waiting: letting them run would take longer than a state.
    """
    return _compiled(text, target, ctypes.PYFUNCTYPE(None))


def assembly(text: str, target: Target) -> str:
    """Print the machine code of a module, also for another kind of machine.

    Parameters
    ----------
    text
        LLVM IR.
    target
        Machine.

    Returns
    -------
    str
        Assembly.
    """
    with inside_llvm() as opened:
        module, machine = _read(text, target, opened, anywhere=True)
        return machine.emit_assembly(module)


def object_file(text: str, target: Target) -> bytes:
    """Compile a module to an object file, also for another kind of machine.

    Parameters
    ----------
    text
        LLVM IR.
    target
        Machine.

    Returns
    -------
    bytes
        Object file in the format of the target's system, with the code that would run there.
    """
    with inside_llvm() as opened:
        module, machine = _read(text, target, opened, anywhere=True)
        return machine.emit_object(module)


def _compiled(text: str, target: Target, prototype: Any) -> Any:
    with inside_llvm() as opened:
        module, machine = _read(text, target, opened)
        engine = opened.enter_context(load_llvm().create_mcjit_compiler(module, machine))
        _require_symbols(module)  # after the engine, which opens the process to such questions
        engine.finalize_object()
        function = prototype(engine.get_function_address("run"))
        end = weakref.finalize(function, opened.pop_all().close)  # the code goes when the function does
        end.atexit = False  # what still runs when the interpreter ends may call the function
        return function


def _read(
    text: str, target: Target, opened: contextlib.ExitStack, *, anywhere: bool = False
) -> tuple[Any, Any]:
    llvm = load_llvm()
    if anywhere:
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
    # A context of its own, so that kernels can be compiled in several threads at once.
    context = opened.enter_context(llvm.create_context())
    # No passes over the IR: it is written the way it should run. Level 2 instead of 3 compiles faster to the same.
    machine = opened.enter_context(
        llvm.Target.from_triple(target.triple).create_target_machine(
            cpu=target.cpu, features=target.features, opt=2, jit=not anywhere
        )
    )
    module = opened.enter_context(llvm.parse_assembly(text, context))
    module.verify()  # compiling what is wrong ends the interpreter
    return module, machine


def _require_symbols(module: Any) -> None:
    """Refuse what the process cannot provide: called, it would end the interpreter."""
    for function in module.functions:
        name = function.name
        if (
            function.is_declaration
            and not name.startswith("llvm.")
            and not load_llvm().address_of_symbol(name)
        ):
            raise UnsupportedError(f"the C library of this process has no {name!r}; take engine='numpy'")
