"""Machine code of a module, alive as long as the function that it becomes."""

from __future__ import annotations

import contextlib
import ctypes
import weakref
from typing import Any

from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.llvm.session import inside_llvm
from stewart_pin.kernels.llvm.target import Target, load_llvm


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
