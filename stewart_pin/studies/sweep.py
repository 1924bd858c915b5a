"""A function of named parameters over a grid or a list of points, on any executor."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Mapping
from concurrent.futures import BrokenExecutor, Executor
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from stewart_pin.errors import InputError
from stewart_pin.studies.answers import Answer, Carried, EachPoint, Study, Sweep
from stewart_pin.studies.comparison import Progress
from stewart_pin.studies.journal import Journal, Ledger, open_journal
from stewart_pin.studies.points import (
    Points,
    as_points,
    function_name,
    require_parameters,
    require_portable,
    run_tasks,
    tasks_in_flight,
    words,
)
from stewart_pin.typing import ArrayLike

_LISTED = 8
"""Points that an error lists."""


def sweep(
    function: Callable[..., Any],
    axes: Mapping[str, ArrayLike],
    *,
    paired: bool = False,
    executor: Executor | None = None,
    journal: str | Path | None = None,
    name: str | None = None,
    progress: Progress | None = None,
    chunk: int = 1,
    in_flight: int | None = None,
) -> Sweep:
    """Evaluate a function at all points of a grid, or of a list.

    Parameters
    ----------
    function
        Function of the parameters, given by name. It returns a number, an array, or a dict of them; names and shapes
        are those of every other point.
    axes
        Values along each axis, by the name of its parameter: numbers or strings [any unit].
    paired
        Whether the k-th values of all axes belong together: a list of points instead of a grid, as for random studies.
    executor
        Any ``concurrent.futures.Executor``: threads, processes, ``client.get_executor()`` of Dask; None: this thread.
        It is not shut down.
    journal
        File in which the points that are done are kept. If it exists, the sweep goes on where it was.
    name
        What to call the study; default: the name of the function. A journal of another name is refused, so give one
        that says what the function depends on besides its parameters.
    progress
        Called with ``"points"``, the number of points done, and of all.
    chunk
        Points in a task; more where a point takes less than a millisecond and workers are other processes.
    in_flight
        Most tasks that the executor holds at a time; None: four for every worker.

    Returns
    -------
    Sweep
        Results in arrays of the grid's shape. Neither the executor nor the order in which points get done changes them.

    Raises
    ------
    InputError
        If the function does not take these parameters, cannot be sent to other processes, or gives no real numbers of
        a fixed shape; if the journal is in use or belongs to another study; or an option makes no sense.
    FileFormatError
        If the journal is damaged, or no journal.

    Notes
    -----
    Where the function raises an error of this package (out of reach, singular), the point is listed in ``failures``
    with the message, and its results are nan. Any other error stops the sweep with a note that names the point. What
    was done by then, or by an interrupt, stands in the journal.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> def force(height, yaw):
    ...     pose = pin.SE3(pin.rpy.rpyToMatrix(0, 0, yaw), np.array([0, 0, height]))
    ...     q = stp.inverse_kinematics(chain, pose, limits=False).q
    ...     return stp.inverse_dynamics(chain, q, np.zeros(chain.nv), np.zeros(chain.nv)).tau_motor
    >>> import pinocchio as pin
    >>> found = stp.sweep(force, {"height": [0.9, 1.0], "yaw": [0.0, 0.2, 0.4]})
    >>> found["value"].shape
    (2, 3, 6)
    """
    points = as_points(axes, paired=paired)
    require_parameters(function, list(points.axes))
    require_portable(executor, function, function_name(function))
    return sweep_study(
        EachPoint(function),
        points,
        name=function_name(function) if name is None else name,
        chunk=chunk,
        executor=executor,
        journal=journal,
        progress=progress,
        in_flight=in_flight,
    )


def sweep_study(
    study: Study,
    points: Points,
    *,
    name: str,
    chunk: int,
    groups: np.ndarray | None = None,
    executor: Executor | None = None,
    journal: str | Path | None = None,
    progress: Progress | None = None,
    in_flight: int | None = None,
) -> Sweep:
    """Evaluate a study that answers many points at once.

    Parameters
    ----------
    study
        Answers a sequence of points; an answer must not depend on the company that its point is in.
    points
        The points.
    name
        What to call the study.
    chunk
        Most points in a task.
    groups
        (N,) index of the group of each point; a task holds points of one group. None: all are of one.
    executor, journal, progress, in_flight
        As in `sweep`.

    Returns
    -------
    Sweep
        Results in arrays of the grid's shape.

    Raises
    ------
    InputError
        If points give results of different names or shapes, or an option makes no sense.
    """
    if isinstance(chunk, bool) or not isinstance(chunk, int) or chunk < 1:
        raise InputError(f"chunk must be a number of points, 1 or more, got {chunk!r}")
    most = tasks_in_flight(executor, in_flight)
    say = progress or (lambda stage, done, total: None)
    ledger = Ledger(points)

    def record(numbers: list[int], answers: list[Answer], kept: Journal | None) -> None:
        if ledger.done[numbers].all():
            return
        ledger.require_alike(numbers, answers)
        if kept is not None:
            kept.append(numbers, answers)
        ledger.enter(numbers, answers)
        say("points", ledger.count, points.size)

    header = {"study": name, **points.described()}
    with nullcontext() if journal is None else open_journal(journal, header) as kept:
        if kept is not None:
            for numbers, answers in kept.entries(points.size):
                ledger.enter(numbers, answers)
        if ledger.count:
            say("points", ledger.count, points.size)
        try:
            run_tasks(
                Carried(uuid.uuid4().hex, study),
                ledger.tasks(groups, chunk),
                lambda numbers, answers: record(numbers, answers, kept),
                executor=executor,
                in_flight=most,
            )
        except BrokenExecutor as error:
            lost = "; ".join(map(words, ledger.in_hand(_LISTED)))
            error.add_note(
                f"a worker ended without an answer; among the points of the sweep in hand were {lost}"
            )
            raise
    return ledger.closed(name)
