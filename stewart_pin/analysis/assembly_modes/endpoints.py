"""Decide what the end of a path is: a solution, a point at infinity, a singular solution, or a failure.

A solution is at infinity when ⟨e, e⟩ = 0; a solution whose matrix has entries above 1e9 cannot be told from
one. No real pose is ever that near to infinity: there ⟨e, e⟩ is the square of the norm of e. A small |⟨e,
e⟩| alone proves nothing: planar platforms have true complex solutions with a small one. A path that arrived
is judged by whether Newton's method still changes ⟨e, e⟩, a path that got stuck by the power of τ with
which ⟨e, e⟩ vanishes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stewart_pin.analysis.assembly_modes.homotopy import Tracked, tangent
from stewart_pin.analysis.assembly_modes.study import ComplexArray, StudyPlatform, half_gradient, operators
from stewart_pin.typing import FloatArray

_SAME = 1e-13
"""Squared sine of the angle between two points of P⁷ that are one solution, found twice."""
_BESIDE = 1e-4
"""Squared sine of the angle within which a regular solution rules out a singular one."""
_SMALL_NORM = 1e-6
"""Relative |⟨e, e⟩| below which a point may lie at infinity."""
_RANK_LOSS = 1e-12
"""Smallest singular value, over the largest, that is zero to double precision."""
_SINGULAR = 1e-7
"""Smallest singular value, over the largest, at a singular solution known to half the digits."""
_NEAR = 1e-2
"""A stuck path must have come this near in τ to say where it was going."""
_VANISHES = 0.5, 6.0
"""Powers of τ with which ⟨e, e⟩ may vanish towards infinity; 1, 2, 4 occur. A finite end shows zero."""


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


def classify(start: StudyPlatform, target: StudyPlatform, tracked: Tracked) -> Endpoints:
    """Sort the ends of paths.

    Parameters
    ----------
    start, target
        The ends of the homotopy.
    tracked
        Where its paths ended.

    Returns
    -------
    Endpoints
        Every path is counted once; two paths on one regular solution count one failure.
    """
    x, arrived = tracked.points, tracked.tau == 0.0
    norm = relative_norm(x)
    regular, infinite = arrived & (norm > _SMALL_NORM), np.zeros(len(x), dtype=bool)
    singular = infinite.copy()
    ends, stuck = x.copy(), (tracked.tau > 0.0) & (tracked.tau < _NEAR)
    infinite[stuck] = _norm_vanishes(start, target, x[stuck], tracked.tau[stuck])
    for i in np.flatnonzero(~regular):
        if arrived[i]:
            regular[i] = _norm_is_settled(target, x[i])
            infinite[i] = not regular[i]
        elif stuck[i] and not infinite[i] and norm[i] > _SMALL_NORM:
            ends[i], singular[i] = _settle(target, x[i])
    # Next to a regular solution there is no singular one: that path is lost in round-off.
    singular &= ~beside(ends, x[regular])
    once = distinct(x[regular])
    failed = int((~(regular | infinite | singular)).sum() + regular.sum() - len(once))
    return Endpoints(x[regular][once], ends[singular], int(infinite.sum()), failed)


def relative_norm(points: ComplexArray) -> FloatArray:
    """Compute |⟨e, e⟩| over the squared Hermitian norm of the point.

    Parameters
    ----------
    points
        (n, 8) Study coordinates, dimensionless.

    Returns
    -------
    numpy.ndarray
        (n,) zero at infinity, dimensionless.
    """
    e = points[:, :4]
    return np.abs((e * e).sum(axis=1)) / (np.abs(points) ** 2).sum(axis=1)


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


def _norm_is_settled(target: StudyPlatform, x: ComplexArray) -> bool:
    # At infinity the gradients are singular: Newton is slow there, and every step shrinks ⟨e, e⟩ again.
    gradient = half_gradient(operators(target.difference, target.total), target.squares, x[None])[0]
    step, _, _, values = np.linalg.lstsq(gradient, -0.5 * (gradient @ x), rcond=None)
    if values[-1] < _RANK_LOSS * values[0]:
        return False
    e, moved = x[:4], x[:4] + step[:4]
    return bool(abs(moved @ moved - e @ e) < 1e-3 * abs(e @ e))


def _norm_vanishes(
    start: StudyPlatform, target: StudyPlatform, x: ComplexArray, tau: FloatArray
) -> NDArray[np.bool_]:
    # d log⟨e, e⟩ / d log τ; the tangent is orthogonal to x, so the Hermitian norm does not change.
    if len(x) == 0:
        return np.empty(0, dtype=bool)
    e, de = x[:, :4], tangent(start, target, x, tau)[:, :4]
    power = tau * np.real(2.0 * (e * de).sum(axis=1) / (e * e).sum(axis=1))
    return (_VANISHES[0] < power) & (power < _VANISHES[1])


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
