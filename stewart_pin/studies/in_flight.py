"""Tasks on an executor, a few at a time: neither the queue nor an interrupt waits for all of them."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from typing import Any

from stewart_pin.errors import InputError

_EACH = 4
"""Tasks for every worker: one that runs, and enough that none waits for the next."""


def tasks_in_flight(executor: Executor | None, wanted: int | None) -> int:
    """Choose how many tasks an executor holds at a time.

    Parameters
    ----------
    executor
        Any executor, or None.
    wanted
        What the caller asked for; None: four for every worker of a pool, or for every processor where an executor does
        not say how many workers it has.

    Returns
    -------
    int
        Number of tasks.

    Raises
    ------
    InputError
        If it is no number above zero, or `executor` none.
    """
    if executor is not None and not isinstance(executor, Executor):
        raise InputError(
            f"executor must be a concurrent.futures.Executor or None, got {executor!r:.60}; "
            "of a Dask client pass client.get_executor()"
        )
    if wanted is None:
        # Pools have no public word for it.
        return _EACH * (getattr(executor, "_max_workers", None) or os.cpu_count() or 1)
    if isinstance(wanted, bool) or not isinstance(wanted, int) or wanted < 1:
        raise InputError(f"in_flight must be a number of tasks, 1 or more, got {wanted!r}")
    return wanted


def require_portable(executor: Executor | None, work: object, name: str) -> None:
    """Check that a function can be sent to other processes, before a pool fails one task after the other.

    Parameters
    ----------
    executor
        Where it is to run.
    work
        What is sent.
    name
        What to call it in the message.

    Raises
    ------
    InputError
        If it cannot be pickled.
    """
    if not isinstance(executor, ProcessPoolExecutor):
        return
    try:
        pickle.dumps(work)
    except Exception as error:
        raise InputError(
            f"{name} cannot be sent to other processes ({error}); define it at the top of a module, with all that it "
            "uses as arguments or functools.partial, or use threads"
        ) from None


def run_tasks(
    work: Callable[[Any], Any],
    tasks: Iterator[tuple[Any, Any]],
    done: Callable[[Any, Any], None],
    *,
    executor: Executor | None,
    in_flight: int,
) -> None:
    """Run tasks, here or on an executor, and hand over each result as soon as it is there.

    Parameters
    ----------
    work
        Function of one argument.
    tasks
        Label and argument of each task.
    done
        Called with label and result, in this thread; perhaps twice for a result that an interrupt came upon.
    executor
        Any executor; None: this thread.
    in_flight
        Most tasks that it holds at a time.
    """
    if executor is None:
        for label, argument in tasks:
            done(label, work(argument))
        return
    pending: dict[Future[Any], Any] = {}
    try:
        while True:
            for label, argument in tasks:
                pending[executor.submit(work, argument)] = label
                if len(pending) >= in_flight:
                    break
            if not pending:
                return
            for future in wait(pending, return_when=FIRST_COMPLETED).done:
                done(pending[future], future.result())
                del pending[future]
    except BaseException:
        for future in pending:
            future.cancel()
        for future, label in pending.items():
            if future.done() and not future.cancelled() and future.exception() is None:
                done(label, future.result())
        raise
