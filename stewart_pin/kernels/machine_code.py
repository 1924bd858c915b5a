"""Machine code of a module, alive as long as the function that it becomes."""

from __future__ import annotations

import ctypes
import weakref
from typing import Any

from stewart_pin.kernels.target import Target, load_llvm


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
    llvm = load_llvm()
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    return _machine(llvm, target).emit_assembly(llvm.parse_assembly(text, llvm.create_context()))


def _compiled(text: str, target: Target, prototype: Any) -> Any:
    llvm = load_llvm()
    # A context of its own, so that kernels can be compiled in several threads at once.
    context = llvm.create_context()
    machine = _machine(llvm, target, jit=True)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(text, context), machine)
    engine.finalize_object()
    function = prototype(engine.get_function_address("run"))
    # The code goes when the function does, the engine before its context: left to a collection of cycles, the order
    # would be any, and llvmlite crashes where the context goes first.
    end = weakref.finalize(function, _dispose, engine, machine, context)
    end.atexit = False  # what still runs when the interpreter ends may call the function
    return function


def _dispose(engine: Any, *others: Any) -> None:
    engine.close()
    for other in others:
        other.close()


def _machine(llvm: Any, target: Target, *, jit: bool = False) -> Any:
    # No passes over the IR: it is written the way it should run. Level 2 instead of 3 compiles faster to the same.
    return llvm.Target.from_triple(target.triple).create_target_machine(
        cpu=target.cpu, features=target.features, opt=2, jit=jit
    )
