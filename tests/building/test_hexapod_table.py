"""Twelve points from an array or a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
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


@pytest.mark.parametrize(
    "names",
    ["p{0},b{0}", "p_{0},b_{0}", "top_{0},bottom_{0}", "upper {0},lower {0}", "P{0}1,B{0}1", "P1{0},B1{0}"],
)
def test_a_header_that_puts_the_platform_first_is_refused(
    tmp_path: Path, table: np.ndarray, names: str
) -> None:
    head = [each.format(axis) for each in names.split(",") for axis in "xyz"]
    lines = [",".join(map(str, row)) for row in table.tolist()]
    with pytest.raises(FileFormatError, match="order must be base x y z"):
        stp.read_hexapod(written(tmp_path, [",".join(head), *lines]), unit=1e-3)
    hexapod = stp.read_hexapod(written(tmp_path, [",".join(head[3:] + head[:3]), *lines]), unit=1e-3)
    np.testing.assert_allclose(hexapod.base_points, 1e-3 * table[:, :3], rtol=1e-15)


@pytest.mark.parametrize("style", ["{} [mm]", "{}(mm)", "{}_mm", "{}/mm"])
def test_a_unit_in_the_header_is_not_passed_over(tmp_path: Path, table: np.ndarray, style: str) -> None:
    head = ",".join(style.format(name) for name in ("bx", "by", "bz", "px", "py", "pz"))
    path = written(tmp_path, [head, *(",".join(map(str, row)) for row in table.tolist())])
    with pytest.raises(FileFormatError, match=r"in mm; pass unit=0\.001"):
        stp.read_hexapod(path)
    np.testing.assert_allclose(stp.read_hexapod(path, unit=1e-3).base_points, 1e-3 * table[:, :3], rtol=1e-15)
