"""Singularities over a plane of the workspace: measures on a grid, and where they vanish between its points."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array, as_positive
from stewart_pin.errors import InputError
from stewart_pin.mechanics.kinematics import platform_pose
from stewart_pin.mechanics.singularity import (
    ALIGNED,
    Measure,
    SingularityKind,
    signed_measure,
    split_jacobians,
)
from stewart_pin.model.description import JointKind
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.freedom import TWIST_AXES, TwistAxis, counted
from stewart_pin.state.generic import generic_freedom
from stewart_pin.state.newton import Closure, close_loops, solve
from stewart_pin.state.paths import pose_path
from stewart_pin.state.state import as_chain
from stewart_pin.typing import ArrayLike, Configuration, FloatArray

_FAR = 0.5
"""Step of a configuration between cells, in robot sizes and radians, that leaves the branch."""
_MAX_ITERATIONS = 25
"""Newton steps from a neighbour: where more are needed there is nothing to reach."""


@dataclass(frozen=True, eq=False, repr=False)
class SingularityMap(Brief):
    """Measures over a grid of platform positions, on the branch of one configuration.

    Attributes
    ----------
    plane
        The two axes of the grid, of ``"vx"``, ``"vy"``, ``"vz"``.
    axes
        Components of the twist that count as motion of the platform; those not in the plane are held.
    x, y
        (nx,) and (ny,) positions along the two axes [m].
    q
        (ny, nx, nq) configurations, not a number where the branch does not reach [m, rad, unit quaternions].
    measures
        Of each kind (ny, nx) the measure, lengths in robot sizes; not a number where the branch does not reach
        [dimensionless].
    crossings
        Of each kind (n, 2) points between neighbours of the grid at which the measure changes its sign, by linear
        interpolation: their error falls with the square of the grid's width [m].
    length
        What velocities were divided by [m].
    """

    plane: tuple[str, str]
    axes: tuple[TwistAxis, ...]
    x: FloatArray
    y: FloatArray
    q: FloatArray
    measures: dict[SingularityKind, FloatArray]
    crossings: dict[SingularityKind, FloatArray]
    length: float

    @property
    def reached(self) -> np.ndarray:
        """(ny, nx) whether the branch reaches a position, dimensionless."""
        return np.isfinite(self.measures[SingularityKind.PLATFORM])


def singularity_map(
    chain: ClosedChain,
    x: ArrayLike,
    y: ArrayLike,
    *,
    plane: tuple[str, str] = ("vx", "vy"),
    axes: Sequence[TwistAxis] = TWIST_AXES,
    q_guess: ArrayLike | None = None,
    length: float | None = None,
) -> SingularityMap:
    """Measure how near every position of a grid is to each kind of singularity.

    Starting at the configuration given, the platform is moved from cell to cell by Newton's method, so that the map
    shows one branch (working mode). The sign of a measure is continued between neighbours, as along a path. A branch
    that winds round a singular point comes back on another sheet: the map then has a cut, on which nothing is marked.

    Parameters
    ----------
    chain
        Closed chain.
    x, y
        (nx,) and (ny,) rising positions of the platform origin along the two axes, in the world frame [m].
    plane
        The two axes.
    axes
        Components of the twist that count as motion of the platform: those not in the plane are held as at the start,
        those not named are free. ``("vx", "vy")`` for a five-bar's tip.
    q_guess
        (nq,) configuration on the branch to show; default: home [m, rad, unit quaternions].
    length
        Length that makes turning and shifting of the platform comparable; default: ``chain.length_scale`` [m].

    Returns
    -------
    SingularityMap
        Configurations, measures, and the points where these change sign.

    Raises
    ------
    InputError
        If an argument makes no sense, or the branch reaches no cell next to its start.
    """
    as_chain(chain)
    x, y = (_rising(name, value) for name, value in (("x", x), ("y", y)))
    counted(axes)
    if np.shape(plane) != (2,) or len(set(plane)) != 2 or not set(plane) <= set(TWIST_AXES[:3]) & set(axes):
        raise InputError(f"plane must be two of vx, vy, vz that axes hold, got {plane!r}")
    length = chain.length_scale if length is None else as_positive("length", length)
    start = chain.q_home if q_guess is None else close_loops(chain, q_guess).q
    field = _Field(chain, x, y, plane, tuple(axes), start, length)
    field.spread(start)
    return SingularityMap(plane, tuple(axes), x, y, field.q, field.measures, field.crossings(), length)


class _Field:
    """A grid that fills from its seed."""

    def __init__(
        self,
        chain: ClosedChain,
        x: FloatArray,
        y: FloatArray,
        plane: tuple[str, str],
        axes: tuple[TwistAxis, ...],
        start: Configuration,
        length: float,
    ) -> None:
        self._chain, self._x, self._y, self._length = chain, x, y, length
        self._axes = axes
        self._plane = [TWIST_AXES.index(name) for name in plane]
        self._pose = platform_pose(chain, start)
        self._hinges = [
            joint.idx_v
            for name, joint in zip(chain.model.names[1:], chain.model.joints[1:], strict=True)
            if chain.mechanism.joint(name).kind is JointKind.REVOLUTE
        ]
        self._generic = generic_freedom(chain, axes)
        shape = (len(y), len(x))
        self.q = np.full((*shape, chain.nq), np.nan)
        self.measures = {kind: np.full(shape, np.nan) for kind in SingularityKind}
        self._found: dict[tuple[int, int], dict[SingularityKind, Measure]] = {}

    def spread(self, start: Configuration) -> None:
        at = self._pose.translation[self._plane]
        seed = (int(np.argmin(np.abs(self._y - at[1]))), int(np.argmin(np.abs(self._x - at[0]))))
        closure = self._solve(start, seed)
        if not closure.success:
            raise InputError(
                f"the branch does not reach the cell next to its start, ({self._x[seed[1]]:.4g}, "
                f"{self._y[seed[0]]:.4g}); choose x and y around ({at[0]:.4g}, {at[1]:.4g})"
            )
        self._keep(seed, closure.q)
        queue = deque([seed])
        while queue:
            cell = queue.popleft()
            for beside in self._neighbours(cell):
                if beside in self._found:
                    continue
                closure = self._solve(self.q[cell], beside)
                if closure.success and self._step(self.q[cell], closure.q) < _FAR:
                    self._keep(beside, closure.q)
                    queue.append(beside)

    def _step(self, a: Configuration, b: Configuration) -> float:
        step = pin.difference(self._chain.model, a, b)
        # A hinge that went once round is where it was.
        step[self._hinges] = (step[self._hinges] + np.pi) % (2 * np.pi) - np.pi
        return float(np.abs(step / self._chain.tangent_scale).max())

    def _far(self, a: tuple[int, int], b: tuple[int, int]) -> bool:
        return self._step(self.q[a], self.q[b]) >= _FAR

    def _neighbours(self, cell: tuple[int, int]) -> list[tuple[int, int]]:
        row, column = cell
        around = [(row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1)]
        return [(r, c) for r, c in around if 0 <= r < len(self._y) and 0 <= c < len(self._x)]

    def _solve(self, guess: Configuration, cell: tuple[int, int]) -> Closure:
        place = self._pose.translation.copy()
        place[self._plane] = self._x[cell[1]], self._y[cell[0]]
        start, goal = self._chain.at(guess), pin.SE3(self._pose.rotation, place)
        system = pose_path(start, goal, self._axes).system(self._chain)
        return solve(self._chain, guess, system, max_iterations=_MAX_ITERATIONS)

    def _keep(self, cell: tuple[int, int], q: Configuration) -> None:
        split = split_jacobians(self._chain.at(q), self._generic, self._length)
        self.q[cell] = q
        for kind, measure in split.measures.items():
            self.measures[kind][cell] = measure.value
        self._found[cell] = split.measures

    def crossings(self) -> dict[SingularityKind, FloatArray]:
        points: dict[SingularityKind, list[FloatArray]] = {kind: [] for kind in SingularityKind}
        for (row, column), here in self._found.items():
            for beside in ((row + 1, column), (row, column + 1)):
                if beside in self._found and self._far((row, column), beside):
                    continue  # reached by different ways: between them is the cut of two sheets
                for kind, measure in self._found.get(beside, {}).items():
                    share = _zero_between(here[kind], measure)
                    if share is not None:
                        first = np.array([self._x[column], self._y[row]])
                        last = np.array([self._x[beside[1]], self._y[beside[0]]])
                        points[kind].append(first + share * (last - first))
        return {kind: np.array(found).reshape(-1, 2) for kind, found in points.items()}


def _zero_between(here: Measure, there: Measure) -> float | None:
    """Find the share of the way at which a measure vanishes, if its vectors fit and its sign changes."""
    fit = min(abs(here.left @ there.left), abs(here.motion @ there.motion))
    if fit < ALIGNED or signed_measure(here, there) >= 0:
        return None
    return here.value / (here.value + there.value)


def _rising(name: str, value: ArrayLike) -> FloatArray:
    array = as_array(name, value, (None,))
    if len(array) < 2 or (np.diff(array) <= 0).any():
        raise InputError(f"{name} must hold two or more rising numbers")
    return array
