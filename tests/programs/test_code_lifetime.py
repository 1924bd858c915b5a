"""Machine code is there as long as it may be called, and what cannot become code is an error, no crash."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import weakref

import pytest

from stewart_pin.errors import UnsupportedError
from stewart_pin.programs.llvm.machine_code import assembly, compile_for_one, object_file
from tests.programs.targets import TARGETS

pytest.importorskip("llvmlite")


@pytest.mark.slow
def test_code_in_a_cycle_of_references_is_disposed_of_in_order() -> None:
    """Collected in any order, a context may go before its engine, which ends the interpreter."""
    text = 'define void @"run"() {\n  ret void\n}\n'
    for _ in range(20):
        function = compile_for_one(text, TARGETS["host"])
        gone = weakref.ref(function)
        function.itself = [function]
        function()
        del function
        gc.collect()
        assert gone() is None


def test_code_outlives_what_is_called_when_the_interpreter_ends() -> None:
    script = """
import atexit
held = []
atexit.register(lambda: print(held[0](np.array([[3.0]]))[0, 0], held[1](np.array([4.0]))[0]))
import casadi as ca
import numpy as np
from stewart_pin.programs.array_kernel import compile_function
x = ca.SX.sym("x")
kernel = compile_function(ca.Function("f", [x], [x * x]))
held += [kernel, kernel.single_state()]
"""
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout) == (0, "9.0 16.0\n"), run.stderr


NOT_DOMINATED = """
define void @run() {
entry:
  br i1 true, label %a, label %b
a:
  %x = fadd double 1.0, 2.0
  br label %b
b:
  %y = fadd double %x, 1.0
  store double %y, ptr null
  ret void
}"""


@pytest.mark.parametrize("make", [compile_for_one, assembly, object_file])
def test_wrong_modules_end_in_an_error(make) -> None:
    """Compiled without a look at it, this one ends the interpreter."""
    with pytest.raises(RuntimeError, match="does not dominate all uses"):
        make(NOT_DOMINATED, TARGETS["host"])
    with pytest.raises(RuntimeError, match="expected instruction opcode"):
        make("define void @run() { bad", TARGETS["host"])


def test_functions_that_the_process_lacks_are_refused() -> None:
    text = """
declare double @not_in_any_library(double)
define void @run() {
  %x = call double @not_in_any_library(double 1.0)
  ret void
}"""
    with pytest.raises(UnsupportedError, match="has no 'not_in_any_library'; take engine='numpy'"):
        compile_for_one(text, TARGETS["host"])


def test_the_interpreter_waits_for_a_daemon_thread_inside_llvm() -> None:
    script = """
import os, threading, time
from stewart_pin.programs.llvm.machine_code import inside_llvm
inside = threading.Event()
def work():
    with inside_llvm():
        inside.set()
        time.sleep(0.3)
        os.write(1, b"left ")
    with inside_llvm():
        os.write(1, b"entered again")
threading.Thread(target=work, daemon=True).start()
inside.wait()
"""
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout) == (0, "left "), run.stderr


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no processes are forked here")
def test_a_process_forked_while_a_thread_compiles_can_compile() -> None:
    script = """
import os, threading, time
from stewart_pin.programs.llvm.machine_code import inside_llvm
inside = threading.Event()
def work():
    with inside_llvm():
        inside.set()
        time.sleep(0.3)
        os.write(1, b"left ")
threading.Thread(target=work).start()
inside.wait()
child = os.fork()
with inside_llvm():
    os.write(1, b"child " if child == 0 else b"parent ")
if child == 0:
    os._exit(0)
os.waitpid(child, 0)
"""
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=60
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith("left ") and sorted(run.stdout.split()) == ["child", "left", "parent"]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="looks on while glibc ends the process")
def test_a_process_ends_well_while_a_daemon_thread_compiles() -> None:
    """LLVM's tables are freed, and filled with rubbish, a second before the process is gone."""
    script = """
import ctypes, threading
libc = ctypes.CDLL(None)
libc["__cxa_atexit"](libc.usleep, ctypes.c_void_p(1_000_000), None)
from stewart_pin.programs.llvm.machine_code import compile_for_one
from stewart_pin.programs.llvm.machine_code import host_target, load_llvm
lines = "".join(f"  %x{k + 1} = fadd double %x{k}, {k}.0\\n" for k in range(100))
one = "define void @{}() {{\\n  %x0 = load double, ptr null\\n" + lines
one += "  store double %x100, ptr null\\n  ret void\\n}}\\n"
text = "".join(one.format(name) for name in ("run", *(f"f{k}" for k in range(500))))
begun, engine = threading.Event(), load_llvm().ExecutionEngine
plain = engine.finalize_object
engine.finalize_object = lambda self: (begun.set(), plain(self))
def work():
    while True:
        compile_for_one(text, target)
target = host_target()
threading.Thread(target=work, daemon=True).start()
begun.wait()
"""
    environment = {**os.environ, "MALLOC_PERTURB_": "85"}
    for _ in range(3):  # half of them used to end in an abort
        run = subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True, check=False, env=environment
        )
        assert run.returncode == 0, run.stderr
