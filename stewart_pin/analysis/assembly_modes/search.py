"""Search for all complex solutions of one platform, from as many start systems as it takes to be sure."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from stewart_pin.analysis.assembly_modes import homotopy
from stewart_pin.analysis.assembly_modes.endpoints import beside, classify, distinct
from stewart_pin.analysis.assembly_modes.extended import with_more_digits
from stewart_pin.analysis.assembly_modes.homotopy import Tracked, TrackerSettings
from stewart_pin.analysis.assembly_modes.start_systems import StartSystem
from stewart_pin.analysis.assembly_modes.study import ComplexArray, StudyPlatform
from stewart_pin.errors import InputError, MissingExtraError

Engine = Literal["numba", "numpy"]
Tracker = Callable[[StudyPlatform, StudyPlatform, ComplexArray, TrackerSettings], Tracked]


@dataclass(frozen=True, eq=False)
class Solutions:
    """The complex solutions of one platform.

    Attributes
    ----------
    regular
        (n, 8) regular finite solutions.
    singular
        (m, 8) singular finite solutions, with repetition.
    complete
        Whether all paths are accounted for.
    expected
        Finite solutions, with multiplicity, that the paths account for.
    failed
        Undecided paths of the last search.
    searches
        Start systems used.
    """

    regular: ComplexArray
    singular: ComplexArray
    complete: bool
    expected: int
    failed: int
    searches: int


def tracker_for(engine: Engine | None) -> Tracker:
    """Choose the tracker.

    Parameters
    ----------
    engine
        ``"numba"`` needs the extra ``compiled``; None takes it when it is installed.

    Returns
    -------
    callable
        `homotopy.track` or its compiled twin.

    Raises
    ------
    InputError
        If there is no such engine.
    MissingExtraError
        If numba is asked for and not installed.
    """
    if engine not in (None, "numba", "numpy"):
        raise InputError(f"engine must be 'numba', 'numpy' or None, got {engine!r}")
    if engine != "numpy":
        try:
            from stewart_pin.analysis.assembly_modes import compiled_homotopy  # noqa: PLC0415
        except ImportError:
            if engine == "numba":
                raise MissingExtraError("numba", "compiled") from None
        else:
            return compiled_homotopy.track
    return homotopy.track


def search(
    target: StudyPlatform, starts: Iterable[StartSystem], tracker: Tracker, *, real: bool
) -> Solutions:
    """Collect the solutions of a platform.

    A path that fails is not followed again with smaller steps, which would lead it into the same trouble,
    but the whole search is repeated from another start system, whose paths run elsewhere.

    Parameters
    ----------
    target
        The platform.
    starts
        Start systems, all with the same number of solutions.
    tracker
        From `tracker_for`.
    real
        Whether the parameters are real, so that the conjugate of a solution is one.

    Returns
    -------
    Solutions
        Complete when all paths of one start end at different regular solutions, or when two starts agree.
    """
    regular = np.empty((0, 8), dtype=complex)
    singular, complete, expected, failed, searches = regular, False, 0, 0, 0
    for start in starts:
        known = len(regular)
        tracked = tracker(start.platform, target, start.points, homotopy.DEFAULT)
        ends = classify(target, with_more_digits(start.platform, target, tracked))
        regular = ends.regular if searches == 0 else np.vstack([regular, ends.regular])
        regular = regular[distinct(regular)] if searches else regular
        if real and len(regular) < len(start.points):
            regular = np.vstack([regular, regular.conj()])
            regular = regular[distinct(regular)]
        searches += 1
        singular = ends.singular if len(ends.singular) >= len(singular) else singular
        failed = ends.failed
        expected = max(len(start.points) - ends.infinite, len(regular))
        agrees = searches > 1 and failed == 0 and known == len(regular) == len(ends.regular)
        complete = len(regular) == len(start.points) or agrees
        if complete:
            break
    singular = singular[~beside(singular, regular)]
    return Solutions(regular, singular, complete, expected, 0 if complete else failed, searches)
