"""Decide what the end of a path is: a solution, a point at infinity, a singular solution, or a failure.

A solution is at infinity when ⟨e, e⟩ = 0. No real pose is near infinity: there ⟨e, e⟩ is the square of the
norm of e. A small |⟨e, e⟩| alone proves nothing: planar platforms have true complex solutions with a small
one. A path left on its way was judged by its series, one that arrived is judged by whether Newton's method
still changes ⟨e, e⟩.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stewart_pin.analysis.assembly_modes.homotopy import Tracked, norm_change
from stewart_pin.analysis.assembly_modes.infinity import SMALL_ROTATION_PART, relative_norm
from stewart_pin.analysis.assembly_modes.study import ComplexArray, StudyPlatform, half_gradient, operators

_SAME = 1e-13
"""Squared sine of the angle between two points of P⁷ that are one solution, found twice."""
_BESIDE = 1e-4
"""Squared sine of the angle within which a regular solution rules out a singular one."""
_SMALL_NORM = 1e-6
"""Relative |⟨e, e⟩| below which a point may lie at infinity."""
_RANK_LOSS = 1e-14
"""Singular value of gradients of order one that is zero to double precision."""
_SINGULAR = 1e-7
"""Smallest singular value, over the largest, at a singular solution known to half the digits."""
_NEAR = 1e-2
"""A stuck path must have come this near in τ to say where it was going."""
_SETTLED, _UNSETTLED = 1e-2, 0.05
"""Relative change of ⟨e, e⟩ by a Newton step at a finite end (round-off) and at infinity (a half at least)."""


@dataclass(frozen=True, eq=False)
class Endpoints:
    """The ends of a set of paths.

    Attributes
    ----------
    regular
        (n, 8) regular finite solutions, each once.
    singular
        (m, 8) singular finite solutions, one for each path that ended there.
    infinite
        Number of paths that went to infinity.
    failed
        Number of paths whose end could not be decided.
    """

    regular: ComplexArray
    singular: ComplexArray
    infinite: int
    failed: int


def classify(target: StudyPlatform, tracked: Tracked) -> Endpoints:
    """Sort the ends of paths.

    Parameters
    ----------
    target
        The platform at the end of the homotopy.
    tracked
        Where its paths ended.

    Returns
    -------
    Endpoints
        Every path is counted once; two paths on one regular solution count one failure.
    """
    x, arrived = tracked.points, tracked.tau == 0.0
    norm = relative_norm(x)
    regular, infinite = arrived & (norm > _SMALL_NORM), tracked.infinite.copy()
    small = np.flatnonzero(arrived & ~regular)
    if small.size:
        change = norm_change(target, x[small])
        change[_ranks(target, x[small]) < 7] = np.inf
        regular[small], infinite[small] = change < _SETTLED, change > _UNSETTLED
    singular, ends = np.zeros(len(x), dtype=bool), x.copy()
    for i in np.flatnonzero(~arrived & ~infinite & (tracked.tau < _NEAR) & (norm > _SMALL_NORM)):
        ends[i], singular[i] = _settle(target, x[i].astype(complex))
    # Next to a regular solution there is no singular one: that path is lost in round-off.
    singular &= ~beside(ends, x[regular])
    once = distinct(x[regular])
    failed = int((~(regular | infinite | singular)).sum() + regular.sum() - len(once))
    return Endpoints(
        x[regular][once].astype(complex), ends[singular].astype(complex), int(infinite.sum()), failed
    )


def distinct(points: NDArray[Any]) -> NDArray[np.intp]:
    """Find the first of every set of equal points.

    Parameters
    ----------
    points
        (n, 8) Study coordinates, dimensionless.

    Returns
    -------
    numpy.ndarray
        Indices of the points that differ from all before them.
    """
    if len(points) == 0:
        return np.empty(0, dtype=np.intp)
    unit = points / np.linalg.norm(points, axis=1, keepdims=True)
    equal = 1.0 - np.abs(unit.conj() @ unit.T) ** 2 < _SAME
    return np.flatnonzero(~np.tril(equal, -1).any(axis=1))


def beside(points: ComplexArray, solutions: ComplexArray) -> NDArray[np.bool_]:
    """Find the points that lie next to a regular solution, where no singular one can be.

    Parameters
    ----------
    points
        (n, 8) Study coordinates, dimensionless.
    solutions
        (m, 8) regular solutions, dimensionless.

    Returns
    -------
    numpy.ndarray
        (n,) mask.
    """
    unit, others = (p / np.linalg.norm(p, axis=1, keepdims=True) for p in (points, solutions))
    return (1.0 - np.abs(unit.conj() @ others.T) ** 2 < _BESIDE).any(axis=1)


def _ranks(target: StudyPlatform, x: ComplexArray) -> NDArray[np.intp]:
    """Count the independent gradients at ends that have a rotation part; at the others doubles cannot tell."""
    gradient = half_gradient(operators(target.difference, target.total), target.squares, x)
    e, h = (np.linalg.norm(part, axis=1)[:, None] for part in (x[:, :4], x[:, 4:]))
    # In these units all entries but singularity are of order one, however small e is.
    columns = np.repeat(np.hstack([e, h]), 4, axis=1)
    rows = np.hstack([h * h, np.repeat(e * h, 6, axis=1)])
    scaled = (gradient * columns[:, None, :] / rows[:, :, None]).astype(complex)
    ranks = np.linalg.matrix_rank(scaled, tol=_RANK_LOSS)
    return np.where(np.abs(e[:, 0]) ** 2 < SMALL_ROTATION_PART, 7, ranks)


def _settle(target: StudyPlatform, x: ComplexArray) -> tuple[ComplexArray, bool]:
    """Go the last bit to a singular solution by Gauss–Newton, which stands rank loss."""
    matrices, here = operators(target.difference, target.total), x
    for _ in range(30):
        gradient = half_gradient(matrices, target.squares, here[None])[0]
        step = -0.5 * np.linalg.lstsq(gradient, gradient @ here, rcond=_SINGULAR)[0]
        here = here + step
        here = here / np.linalg.norm(here)
    gradient = half_gradient(matrices, target.squares, here[None])[0]
    values = np.linalg.svd(gradient, compute_uv=False)
    solved = np.abs(gradient @ here).max() < 1e-10 * values[0]
    near = 1.0 - abs(here.conj() @ x) ** 2 < 1e-4
    return here, bool(solved and near and values[-1] < 1e-4 * values[0])
