"""Twelve points from an array or a file, and bodies that fit them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError, FileMissingError, InputError


@pytest.fixture
def table(report_cad: stp.Hexapod) -> np.ndarray:
    """Return the twelve points of a platform, a leg per row [mm]."""
    return 1e3 * np.hstack([report_cad.base_points, report_cad.platform_points])


def written(folder: Path, lines: list[str]) -> Path:
    path = folder / "points.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("separator", [", ", ";", "  ", "\t"])
@pytest.mark.parametrize("rows", [6, 12])
def test_a_file_gives_its_points(
    tmp_path: Path, table: np.ndarray, report_cad: stp.Hexapod, separator: str, rows: int
) -> None:
    values = table if rows == 6 else np.vstack([table[:, :3], table[:, 3:]])
    lines = [separator.join(f"{value:.17g}" for value in row) for row in values]
    head = separator.join(
        ["base_x", "base_y", "base_z", "platform_x", "platform_y", "platform_z"] if rows == 6 else "xyz"
    )
    path = written(tmp_path, ["\ufeff# lengths in mm", head, "", *lines[:3], "# the other half", *lines[3:]])
    hexapod = stp.read_hexapod(path, unit=1e-3)
    np.testing.assert_allclose(hexapod.base_points, report_cad.base_points, rtol=1e-15)
    np.testing.assert_allclose(hexapod.platform_points, report_cad.platform_points, rtol=1e-15)
    again = stp.Hexapod.from_points(1e-3 * values)
    np.testing.assert_allclose(again.base_points, hexapod.base_points, rtol=1e-15)
    np.testing.assert_allclose(again.platform_points, hexapod.platform_points, rtol=1e-15)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda rows: rows[:5], "5 rows of numbers; a table has 6 .* or 12"),
        (lambda rows: [*rows[:2], rows[2] + ",7", *rows[3:]], "line 3 has 7 numbers, one of 6 rows has 6"),
        (lambda rows: [*rows[:3], rows[3].replace("4", "four"), *rows[4:]], "line 4 holds '.*four.*', which is no"),
        (lambda rows: [*rows[:5], "1,2,3,4,5,nan"], "line 6 holds 'nan', which is no finite number"),
        (lambda rows: ["leg,1,2,3,4,5", *rows[1:]], "line 1 holds 'leg'"),
        (lambda rows: ["platform x,platform y,platform z,base x,base y,base z", *rows], "order must be base x y z"),
        (lambda rows: ["bx,bz,by,px,py,pz", *rows], "line 1 names the columns bx, bz, by, px, py, pz; the order"),
        (lambda rows: [*rows[:3], "a,b,c,d,e,f", *rows[3:]], "line 4 holds 'a'"),
        (lambda rows: ["a,b,c,d,e,f", "a,b,c,d,e,f", *rows], "line 2 holds 'a'"),
        (lambda rows: [], "0 rows of numbers"),
    ],
)  # fmt: skip
def test_bad_files_name_the_line(tmp_path: Path, table: np.ndarray, change, words: str) -> None:
    path = written(tmp_path, change([",".join(map(str, row)) for row in table.tolist()]))
    with pytest.raises(FileFormatError, match=words) as caught:
        stp.read_hexapod(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_missing_and_foreign_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(FileMissingError, match=r"nowhere\.csv: no such file"):
        stp.read_hexapod(tmp_path / "nowhere.csv")
    (tmp_path / "picture").write_bytes(b"\x89PNG\xff")
    with pytest.raises(FileFormatError, match="not a text file"):
        stp.read_hexapod(tmp_path / "picture")
    with pytest.raises(InputError, match="unit must be a finite number above zero"):
        stp.read_hexapod(tmp_path / "picture", unit=0)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (np.zeros((6, 5)), "table row 1 has 5 numbers, one of 6 rows has 6"),
        ([[0.0] * 6] * 5 + [[0.0] * 7], "table row 6 has 7 numbers"),
        ([[0.0] * 6] * 5 + [[0.0] * 5 + [np.inf]], r"table row 6 must be finite, got inf at index \(5,\)"),
        ([[0.0] * 6] * 5 + [["a"] * 6], "table row 6 must be an array of real numbers"),
        (np.zeros((7, 6)), "table must have 6 rows .*, got 7 rows"),
        (3.0, "table must be rows of numbers, got float"),
    ],
)
def test_bad_tables_name_the_row(rows, words: str) -> None:
    with pytest.raises(InputError, match=words):
        stp.Hexapod.from_points(rows)


def test_estimated_bodies_are_a_disc_and_rods(report_ideal: stp.Hexapod) -> None:
    bodies = stp.hexapod_inertias(report_ideal, platform=20.0, lower=2.0, upper=1.5, leg_length=1.0)
    assert [bodies[name].mass for name in ("platform", "lower", "upper")] == [20.0, 2.0, 1.5]
    np.testing.assert_allclose(
        bodies["platform"].lever, report_ideal.platform_points.mean(axis=0), atol=1e-15
    )
    radius = np.linalg.norm(report_ideal.platform_points, axis=1).max()
    assert bodies["platform"].inertia[2, 2] == pytest.approx(20 * radius**2 / 2, rel=1e-14)
    # Slender rods over 0.6 m from either end: m l² / 12 but for their thickness.
    np.testing.assert_allclose([bodies["lower"].lever[2], bodies["upper"].lever[2]], [0.3, -0.3], rtol=1e-15)
    assert bodies["lower"].inertia[0, 0] == pytest.approx(2 * 0.6**2 / 12, rel=0.01)
    assert bodies["upper"].inertia[1, 1] == pytest.approx(1.5 * 0.6**2 / 12, rel=0.01)
    for name in bodies:
        moments = np.linalg.eigvalsh(bodies[name].inertia)
        assert moments[0] > 0 and moments[2] < moments[0] + moments[1]


@pytest.mark.parametrize(
    "hexapod",
    [
        stp.semi_regular_hexapod(0.5, 0.4, 0.2, 0.3),
        stp.hexapod_6_3(0.5, 0.4, 0.2),
        stp.cubic_hexapod(0.6, 0.4),
    ],
)
def test_every_design_becomes_a_robot(hexapod: stp.Hexapod, rng: np.random.Generator) -> None:
    bodies = stp.hexapod_inertias(hexapod, platform=20.0, lower=2.0, upper=1.5)
    chain = stp.hexapod_chain(hexapod, **bodies)
    found = stp.mobility(chain)
    assert (found.dof, found.motors_sufficient, found.redundant_rows) == (6, True, 0)
    # Two formulations agree on a robot that no file describes.
    home = stp.platform_pose(chain, chain.q_home)
    pose = pin.SE3(pin.exp3(rng.uniform(-0.1, 0.1, 3)), home.translation + rng.uniform(-0.05, 0.05, 3))
    state = stp.platform_motion(chain, pose, rng.normal(size=6), rng.normal(size=6))
    efforts = [
        stp.inverse_dynamics(chain, state.q, state.v, state.a, method=method).tau_motor
        for method in ("pinocchio", "constraint_matrix")
    ]
    np.testing.assert_allclose(*efforts, rtol=1e-9)


def test_estimated_bodies_refuse_what_has_no_size(report_ideal: stp.Hexapod) -> None:
    with pytest.raises(InputError, match="upper must be a finite number above zero, got 0"):
        stp.hexapod_inertias(report_ideal, platform=1.0, lower=1.0, upper=0.0)
    point = stp.Hexapod(report_ideal.base_points, np.zeros((6, 3)))
    with pytest.raises(InputError, match="all platform points coincide"):
        stp.hexapod_inertias(point, platform=1.0, lower=1.0, upper=1.0)
