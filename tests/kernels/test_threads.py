"""Graphs of one chain written by many threads: CasADi's expressions are for one thread at a time."""

from __future__ import annotations

import gc
import subprocess
import sys
import threading

import pytest

import stewart_pin as stp
from stewart_pin.programs import symbolic

WRITE = """
import threading
import stewart_pin as stp
from stewart_pin.kernels.graph.function_set import FunctionSet

def write(chain):
    for name in ("inverse_dynamics", "forward_dynamics", "conditioning"):
        functions = FunctionSet(chain, "platform")
        functions.conditioning_of(name, functions.function(name))

for _ in range(5):
    threads = [threading.Thread(target=write, args=(stp.load("rpr_planar"),)) for _ in range(6)]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
print("done")
"""


@pytest.mark.slow
def test_threads_write_one_after_the_other() -> None:
    """Without the lock CasADi 3.8 ends one such process in a few, in its own code."""
    run = subprocess.run(  # in a process of its own: the end would be that of the tests
        [sys.executable, "-c", WRITE], capture_output=True, text=True, timeout=300, check=False
    )
    assert (run.returncode, run.stdout) == (0, "done\n"), run.stderr[-2000:]


def test_what_is_dropped_while_another_thread_writes_is_dropped_later() -> None:
    kernels = stp.compile_kernels(stp.load("four_bar"), engine="numpy")
    kernels.casadi("inverse_dynamics")
    inside, leave = threading.Event(), threading.Event()

    def write() -> None:
        with symbolic.writing():
            inside.set()
            leave.wait()

    other = threading.Thread(target=write)
    other.start()
    inside.wait()
    try:
        del kernels
        gc.collect()  # does not wait for the other thread, and does not touch its expressions
        assert any("_written" in left for left in symbolic._LEFT)
    finally:
        leave.set()
        other.join()
    with symbolic.writing():
        assert not symbolic._LEFT
