"""Generic complex platforms with their 40 solutions, from which every other platform is reached.

They are found by monodromy: one solution is made by choosing the lengths that fit a random pose, and loops
through random complex platforms permute the solutions until all are known. The group is transitive, so the
loops reach all; 40 is their proven number [1]_. Run this module to make the data file again::

    python -m stewart_pin.analysis.assembly_modes.start_systems

References
----------
.. [1] F. Ronga, T. Vust, "Stewart platforms without computer?", in Real Analytic and Algebraic Geometry, de
   Gruyter, 1995.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from stewart_pin.analysis.assembly_modes.certificates import distinct
from stewart_pin.analysis.assembly_modes.homotopy import DEFAULT, track
from stewart_pin.analysis.assembly_modes.study import ComplexArray, StudyPlatform, operators
from stewart_pin.errors import ConvergenceError

GENERIC_COUNT = 40
"""Number of finite complex solutions of a generic platform."""
_FILE = Path(__file__).with_name("start_systems.npz")
_SEEDS = (1, 2, 3, 4)
_MAX_LOOPS = 100


@dataclass(frozen=True, eq=False)
class StartSystem:
    """A platform whose solutions are all known.

    Attributes
    ----------
    platform
        Its parameters.
    points
        (n, 8) its solutions in Study coordinates.
    """

    platform: StudyPlatform
    points: ComplexArray


@cache
def start_systems() -> tuple[StartSystem, ...]:
    """Read the start systems that come with the package.

    Returns
    -------
    tuple of StartSystem
        Independent generic platforms with 40 solutions each.
    """
    with np.load(_FILE) as data:
        return tuple(
            StartSystem(StudyPlatform(d, t, q), x)
            for d, t, q, x in zip(
                data["difference"], data["total"], data["squares"], data["points"], strict=True
            )
        )


def build_start_system(rng: np.random.Generator) -> StartSystem:
    """Find all solutions of a random complex platform by monodromy.

    Parameters
    ----------
    rng
        Source of the platform and of the loops.

    Returns
    -------
    StartSystem
        With 40 solutions.

    Raises
    ------
    ConvergenceError
        If the loops do not end with 40 solutions.
    """
    home, points = _platform_with_one_solution(rng)
    for _ in range(_MAX_LOOPS):
        moved, here = points, home
        for corner in (_random_platform(rng), _random_platform(rng), home):
            ends = track(here, corner, moved, DEFAULT)
            moved, here = ends.points[ends.tau == 0.0], corner
        points = np.vstack([points, moved])
        points = points[distinct(points)]
        if len(points) == GENERIC_COUNT:
            return StartSystem(home, points)
    raise ConvergenceError(
        f"monodromy found {len(points)} of {GENERIC_COUNT} solutions; try another seed",
        residual=float(GENERIC_COUNT - len(points)),
    )


def _gauss(rng: np.random.Generator, *shape: int) -> ComplexArray:
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2.0)


def _random_platform(rng: np.random.Generator) -> StudyPlatform:
    return StudyPlatform.from_points(_gauss(rng, 5, 3), _gauss(rng, 5, 3), 2.0 * _gauss(rng, 6))


def _platform_with_one_solution(rng: np.random.Generator) -> tuple[StudyPlatform, ComplexArray]:
    base, platform, e, h = _gauss(rng, 5, 3), _gauss(rng, 5, 3), _gauss(rng, 4), _gauss(rng, 4)
    h -= e * (e @ h) / (e @ e)
    legs = np.vstack([h, h + operators(platform - base, platform + base) @ e])
    squares = (legs * legs).sum(axis=1) / (e @ e)
    point = np.concatenate([e, h])[None]
    return StudyPlatform.from_points(base, platform, squares), point / np.linalg.norm(point)


def _write(path: Path = _FILE) -> None:
    systems = [build_start_system(np.random.default_rng(seed)) for seed in _SEEDS]
    np.savez(
        path,
        difference=np.array([s.platform.difference for s in systems]),
        total=np.array([s.platform.total for s in systems]),
        squares=np.array([s.platform.squares for s in systems]),
        points=np.array([s.points for s in systems]),
    )


if __name__ == "__main__":
    _write()
