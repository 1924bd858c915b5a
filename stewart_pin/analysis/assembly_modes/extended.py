"""Follow paths that are lost next to infinity to their ends with more digits.

There the gradients are so nearly singular that the last digits of doubles decide. It takes few geometries in a
thousand, but the classes whose paths go to infinity have finite solutions beside it. Where the platform's
compiler has no longer floats than doubles nothing is gained, and such paths stay undecided.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stewart_pin.analysis.assembly_modes.homotopy import DEFAULT, Tracked, track
from stewart_pin.analysis.assembly_modes.infinity import CLOSE, SMALL_ROTATION_PART, relative_norm
from stewart_pin.analysis.assembly_modes.linear_systems import EXTENDED
from stewart_pin.analysis.assembly_modes.study import StudyPlatform

_AT_MOST = 10
"""More lost paths than chance explains: the geometry is architecturally singular, and digits do not help."""
_BEYOND = 1e-22
"""Relative |⟨e, e⟩| of a lost path that went to infinity: its end would depend on the last digits of the input."""


def with_more_digits(start: StudyPlatform, target: StudyPlatform, tracked: Tracked) -> Tracked:
    """Go on with the paths that were lost next to infinity, and correct the ends that are there.

    Parameters
    ----------
    start, target
        The ends of the homotopy.
    tracked
        What double precision made of it.

    Returns
    -------
    Tracked
        The same with those paths replaced; in extended precision where there were any.
    """
    # An end at infinity that has a rotation part was reached by a jump from afar, and is told in doubles.
    small = (np.abs(tracked.points[:, :4]) ** 2).sum(axis=1) < SMALL_ROTATION_PART
    close = (relative_norm(tracked.points) < CLOSE[1]) & ~tracked.infinite & (small | (tracked.tau > 0.0))
    if not 0 < close.sum() <= _AT_MOST:
        return tracked
    points, tau = tracked.points.astype(EXTENDED), tracked.tau.copy()
    infinite, steps = tracked.infinite.copy(), tracked.steps.copy()
    for i in np.flatnonzero(close):
        here = _between(start, target, tracked.tau[i])
        # A path that had arrived stays where it is, and is corrected.
        on = track(here, _between(start, target, 0.0), points[i : i + 1], DEFAULT)
        points[i], tau[i], infinite[i] = on.points[0], on.tau[0] * tracked.tau[i], on.infinite[0]
        steps[i] += on.steps[0]
    infinite |= close & (tau > 0.0) & (relative_norm(points) < _BEYOND)
    return replace(tracked, points=points, tau=tau, infinite=infinite, steps=steps)


def _between(start: StudyPlatform, target: StudyPlatform, tau: float) -> StudyPlatform:
    ends = [
        [np.asarray(a, dtype=EXTENDED) for a in (p.difference, p.total, p.squares)] for p in (start, target)
    ]
    return StudyPlatform(*(b + np.longdouble(tau) * (a - b) for a, b in zip(*ends, strict=True)))
