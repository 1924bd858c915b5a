"""All poses: numbers known from the literature, the pose that made the lengths, honest incompleteness."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.analysis.assembly_modes import homotopy
from stewart_pin.analysis.assembly_modes.certificates import build_start_system, start_systems
from stewart_pin.analysis.assembly_modes.solver import search, tracker_for
from stewart_pin.analysis.assembly_modes.study import Scaling, StudyPlatform
from stewart_pin.errors import InputError, MissingExtraError
from tests.analysis.platforms import CLASSES, distance_to, draw


@pytest.mark.parametrize("name", CLASSES)
def test_number_of_complex_poses_of_a_class(name: str, rng: np.random.Generator) -> None:
    hexapod, position, rotation = draw(name, rng)
    lengths = stp.leg_lengths(hexapod, position, rotation)
    modes, solver = stp.assembly_modes(hexapod, lengths), stp.AssemblySolver(hexapod)
    for answer in (modes, solver.solve(lengths)):
        assert isinstance(answer, stp.hexapods.AssemblyModes)
        assert answer.n_complex == answer.expected == solver.n_generic == CLASSES[name][0]
        assert answer.complete and answer.failed_paths == 0 and answer.kind == "finite"
        assert answer.certified.all()
        # Round-off through Jacobians of condition 1e3 at worst in this draw.
        assert answer.residual.max() < 1e-12
        assert distance_to(answer, position, rotation) < 1e-9
        # Non-real solutions come in conjugate pairs.
        assert (answer.n_complex - len(answer)) % 2 == 0


@pytest.mark.parametrize("name", ["general 6-6", "planar 6-6", "3-3"])
def test_numpy_finds_what_numba_finds(name: str, rng: np.random.Generator) -> None:
    pytest.importorskip("numba")
    hexapod, position, rotation = draw(name, rng)
    lengths = stp.leg_lengths(hexapod, position, rotation)
    slow, fast = (stp.assembly_modes(hexapod, lengths, engine=e) for e in ("numpy", "numba"))
    assert slow.n_complex == fast.n_complex and slow.complete and fast.complete
    np.testing.assert_allclose(slow.position, fast.position, atol=1e-10)


def test_all_forty_poses_of_dietmaier_are_real(forty_real) -> None:
    modes = stp.assembly_modes(*forty_real)
    assert len(modes) == modes.n_complex == 40
    assert modes.certified.all() and modes.complete
    assert modes.residual.max() < 1e-14
    gaps = np.abs(modes.rotation[:, None] - modes.rotation).max(axis=(2, 3)) + np.eye(40)
    assert gaps.min() > 1e-3


def test_source_example_is_among_its_modes(source_hexapod: stp.Hexapod) -> None:
    lengths = np.array([20.0, 25.0, 26.0, 20.0, 20.0, 20.0])
    modes = stp.assembly_modes(source_hexapod, lengths)
    # S1.8; and a planar robot has every pose twice, mirrored in the base plane.
    printed = [-3.446955715971969876, 7.967616235254526202, 18.01764656718064983]
    assert np.abs(modes.position - printed).max(axis=1).min() < 1e-12
    assert modes.complete and modes.certified.all()
    np.testing.assert_allclose(np.sort(modes.position[:, 2]), np.sort(-modes.position[:, 2]), atol=1e-11)


def test_newton_from_random_guesses_finds_nothing_new(rng: np.random.Generator) -> None:
    hexapod, position, rotation = draw("planar 6-6", rng)
    lengths = stp.leg_lengths(hexapod, position, rotation)
    modes, found = stp.assembly_modes(hexapod, lengths), set()
    for _ in range(40):
        _, *guess = draw("planar 6-6", rng)
        pose = stp.hexapod_pose(hexapod, lengths, guess=tuple(guess), throw=False)
        if pose.success:
            gaps = np.abs(modes.position - pose.position).max(axis=1)
            assert gaps.min() < 1e-9
            found.add(int(gaps.argmin()))
    assert len(found) >= 2


def test_random_platforms_are_complete(rng: np.random.Generator) -> None:
    for _ in range(60):
        hexapod, position, rotation = draw("general 6-6", rng)
        modes = stp.assembly_modes(hexapod, stp.leg_lengths(hexapod, position, rotation))
        assert modes.complete and modes.n_complex == 40
        assert distance_to(modes, position, rotation) < 1e-8


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_unit_and_origin_do_not_matter(factor: float, rng: np.random.Generator) -> None:
    hexapod, position, rotation = draw("general 6-6", rng)
    lengths = stp.leg_lengths(hexapod, position, rotation)
    shift = np.array([10.0, -20.0, 5.0])
    moved = stp.Hexapod(factor * (hexapod.base_points + shift), factor * hexapod.platform_points)
    one, other = stp.assembly_modes(hexapod, lengths), stp.assembly_modes(moved, factor * lengths)
    assert len(one) == len(other)
    for p, r in zip(one.position, one.rotation, strict=True):
        # The shift of 20 costs two digits.
        assert distance_to(other, factor * (p + shift), r) < 1e-9 * max(1.0, factor)


def test_griffis_duffy_moves_with_all_legs_locked(
    griffis_duffy: stp.Hexapod, rng: np.random.Generator
) -> None:
    _, position, rotation = draw("general 6-6", rng)
    lengths = stp.leg_lengths(griffis_duffy, position, rotation)
    modes = stp.assembly_modes(griffis_duffy, lengths)
    assert modes.kind == "positive-dimensional"
    assert stp.AssemblySolver(griffis_duffy).n_generic == 0
    # A generic change of the lengths leaves no pose at all, and no curve.
    assert stp.assembly_modes(griffis_duffy, lengths * [1.01, 1, 1, 1, 1, 1]).kind == "finite"


def test_a_lost_path_is_reported(rng: np.random.Generator) -> None:
    hexapod, position, rotation = draw("general 6-6", rng)
    lengths = stp.leg_lengths(hexapod, position, rotation)
    scaling = Scaling.of(hexapod, lengths)
    platform = StudyPlatform.from_points(*scaling.points(hexapod), (lengths / scaling.size) ** 2)
    full = search(platform, start_systems(), tracker_for(None), real=True)
    gone = np.vstack([full.regular[:1], full.regular[:1].conj()])

    def forgetful(start, target, points, settings):
        ends = tracker_for(None)(start, target, points, settings)
        overlap = np.abs(ends.points.conj() @ gone.T).max(axis=1)
        return homotopy.Tracked(
            ends.points, np.where(overlap > 1 - 1e-9, 0.5, ends.tau), ends.steps, ends.infinite
        )

    found = search(platform, start_systems(), forgetful, real=True)
    assert full.complete and full.searches == 1
    assert not found.complete and found.failed > 0 and found.searches == len(start_systems())
    # Losing it once is repaired by the second start system.
    calls: list[int] = []

    def forgetful_once(*arguments):
        calls.append(1)
        return (forgetful if len(calls) == 1 else tracker_for(None))(*arguments)

    repaired = search(platform, start_systems(), forgetful_once, real=True)
    assert repaired.complete and repaired.searches == 2 and len(repaired.regular) == 40


def test_start_systems_are_reproducible() -> None:
    made, kept = build_start_system(np.random.default_rng(1)), start_systems()[0]
    # The lengths are computed from the pose drawn: processors and libraries differ in the last digits.
    np.testing.assert_allclose(made.platform.squares, kept.platform.squares, rtol=1e-13)
    overlap = np.abs(made.points.conj() @ kept.points.T)
    np.testing.assert_allclose(overlap.max(axis=1), 1.0, atol=1e-12)
    assert sorted(overlap.argmax(axis=1)) == list(range(40))


def test_solver_takes_a_batch(report_cad: stp.Hexapod, rng: np.random.Generator) -> None:
    lengths = stp.leg_lengths(report_cad, rng.uniform(-0.1, 0.1, (3, 3)) + [0, 0, 2.3], np.eye(3))
    solver = stp.AssemblySolver(report_cad)
    answers = solver.solve(lengths)
    assert isinstance(answers, tuple) and len(answers) == 3
    for row, answer in zip(lengths, answers, strict=True):
        single = solver.solve(row)
        assert isinstance(single, stp.hexapods.AssemblyModes)
        np.testing.assert_array_equal(answer.position, single.position)


def test_bad_input_is_named(report_cad: stp.Hexapod, monkeypatch) -> None:
    with pytest.raises(InputError, match="lengths must have shape"):
        stp.assembly_modes(report_cad, np.ones(5))
    with pytest.raises(InputError, match="lengths must be above zero"):
        stp.assembly_modes(report_cad, np.zeros(6))
    with pytest.raises(InputError, match=r"\(6,\) or \(n, 6\)"):
        stp.AssemblySolver(report_cad).solve(np.ones((2, 2, 6)))
    with pytest.raises(InputError, match="engine must be"):
        stp.assembly_modes(report_cad, np.ones(6), engine="fortran")  # type: ignore[arg-type]
    monkeypatch.setitem(sys.modules, "numba", None)
    monkeypatch.delitem(sys.modules, "stewart_pin.analysis.assembly_modes.compiled_homotopy", raising=False)
    monkeypatch.delattr("stewart_pin.analysis.assembly_modes.compiled_homotopy", raising=False)
    with pytest.raises(MissingExtraError, match=r"stewart_pin\[compiled\]"):
        stp.assembly_modes(report_cad, np.ones(6), engine="numba")
    assert tracker_for(None) is homotopy.track
