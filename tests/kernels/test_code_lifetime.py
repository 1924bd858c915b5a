"""Machine code is there as long as it may be called, and what cannot become code is an error, no crash."""

from __future__ import annotations

import gc
import subprocess
import sys
import weakref

import pytest

from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.machine_code import assembly, compile_for_one, object_file
from tests.kernels.targets import TARGETS

pytest.importorskip("llvmlite")


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
from stewart_pin.kernels.compile_function import compile_function
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
