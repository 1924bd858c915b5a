"""Finite solutions beside infinity are told from solutions at infinity, in double and in extended precision."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.analysis.assembly_modes.certificates import classify, start_systems
from stewart_pin.analysis.assembly_modes.homotopy import DEFAULT, EXTENDED, solve
from stewart_pin.analysis.assembly_modes.solver import Engine, tracker_for
from stewart_pin.analysis.assembly_modes.study import Scaling, StudyPlatform, foresees_infinity
from tests.analysis.platforms import CLASSES, draw

has_more_digits = np.finfo(EXTENDED).eps < np.finfo(float).eps

# Drawn by the benchmark of completeness: |⟨e, e⟩| of a finite solution over that of a real one, about.
BESIDE_INFINITY = [
    ("planar 6-6", 569, 1e-18, False),
    ("planar 6-6", 4431, 1e-14, False),
    ("mirror-symmetric planar", 5, 4e-11, False),
    ("mirror-symmetric planar", 2, 3e-16, True),
    ("mirror-symmetric planar", 847, 2e-19, True),
    ("semi-regular hexagons", 254, 2e-14, True),
]


@pytest.mark.parametrize(("name", "number", "norm", "needs_digits"), BESIDE_INFINITY)
def test_solutions_beside_infinity_are_counted(
    name: str, number: int, norm: float, needs_digits: bool
) -> None:
    hexapod, *pose = draw(name, np.random.default_rng((1, number)))
    modes = stp.assembly_modes(hexapod, stp.leg_lengths(hexapod, *pose))
    if needs_digits and not has_more_digits:
        assert not modes.complete, f"{norm:.0e} is beyond doubles"
    else:
        assert modes.complete and modes.n_complex == CLASSES[name][0]


@pytest.mark.parametrize("engine", ["numpy", "numba"])
@pytest.mark.parametrize("name", ["5-3", "3-3", "semi-regular hexagons", "similar planar"])
def test_every_path_ends_or_is_foreseen(name: str, engine: Engine, rng: np.random.Generator) -> None:
    if engine == "numba":
        pytest.importorskip("numba")
    for _ in range(2):
        hexapod, *pose = draw(name, rng)
        lengths = stp.leg_lengths(hexapod, *pose)
        scaling = Scaling.of(hexapod, lengths)
        target = StudyPlatform.from_points(*scaling.points(hexapod), (lengths / scaling.size) ** 2)
        start = start_systems()[0]
        tracked = tracker_for(engine)(start.platform, target, start.points, DEFAULT)
        ends = classify(target, tracked)
        assert len(ends.regular) == CLASSES[name][0] and ends.failed == 0
        assert ends.infinite == 40 - len(ends.regular)
        # Foresight leaves a path long before τ = 0; the search for the end alone took 40 steps.
        assert tracked.infinite.any() and tracked.tau[tracked.infinite].min() > 1e-9
        assert tracked.steps.mean() < 50


def _with_norm(size: complex, norm: complex) -> np.ndarray:
    # e = size (1, i √(1 - norm), 0, 0), so ⟨e, e⟩ = size² norm.
    return np.array([size, 1j * size * np.sqrt(1 - norm), 0, 0, 1, 1j, 0, 0])


@pytest.mark.parametrize(
    ("here", "end", "infinite"),
    [
        ((1e-2, 0.5), (1e-8, 0.5), True),  # the rotation part vanishes
        ((1e-2, 0.5), (1e-3, 0.5), False),  # it decreases, to a finite value
        ((3e-6, 0.5), (7e-7, 0.5), False),  # small already, and no longer decreasing
        ((0.5, 1e-4), (0.5, 1e-13), True),  # the norm vanishes, the rotation part does not
        ((0.5, 1e-4), (0.5, 1e-8), False),
        ((1e-3, 1e-6), (2e-4, 4e-8), False),  # as |e|⁴: a finite solution beside infinity
    ],
)
def test_foresight(here, end, infinite: bool) -> None:
    x, y = _with_norm(*here)[None], _with_norm(*end)[None]
    assert foresees_infinity(x, y)[0] == infinite
    # A series that has not converged foresees nothing.
    y[:, 4:] *= 9.0
    assert not foresees_infinity(x, y)[0]


def test_systems_in_extended_precision(rng: np.random.Generator) -> None:
    a, b = rng.normal(size=(5, 8, 8)) + 1j * rng.normal(size=(5, 8, 8)), rng.normal(size=(5, 8, 3))
    a[0, 0, 0] = 0.0  # needs a pivot
    more = solve(a.astype(EXTENDED), b)
    np.testing.assert_allclose(more.astype(complex), np.linalg.solve(a, b), rtol=1e-11)
    residual = np.abs(a.astype(EXTENDED) @ more - b).max()
    # Condition below 1e3 in this draw.
    assert residual < 1e4 * np.finfo(EXTENDED).eps


@pytest.mark.parametrize(("name", "number"), [("5-5 disjoint", 5526), ("affine planar", 9211)])
def test_nearly_double_poses_are_reported(name: str, number: int) -> None:
    """Two poses so near each other that doubles count one, or one that they count twice: the record says so."""
    hexapod, *pose = draw(name, np.random.default_rng((1, number)))
    modes = stp.assembly_modes(hexapod, stp.leg_lengths(hexapod, *pose))
    assert not modes.certified.all()
    assert modes.n_complex == CLASSES[name][0] or modes.n_complex < modes.expected or not modes.complete
