"""Enter LLVM and leave it in order: what is opened is closed, and nobody is inside when the process ends."""

from __future__ import annotations

import atexit
import contextlib
import os
import threading
from collections.abc import Iterator

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
