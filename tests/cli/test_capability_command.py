"""The command ``capability`` as a user meets it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli import running

ZOO = Path(__file__).parents[1] / "zoo" / "urdf"


def run(*arguments: str) -> tuple[int, str, str]:
    answer = running.run("capability", *arguments)
    return answer.returncode, answer.stdout, answer.stderr


def test_figures_of_the_report_stand_in_table_picture_and_file(tmp_path: Path) -> None:
    figures, plot = tmp_path / "figures.json", tmp_path / "new" / "sets.png"
    code, out, err = run(
        "stewart_cad", "--pose", "0,0,0.8,0,0,0", "--no-limits", "--json", str(figures), "--plot", str(plot)
    )
    assert code == 0, err
    assert "vx [m/s]" in out and "± 1.3948" in out and "leg4" in out
    assert plot.read_bytes().startswith(b"\x89PNG")
    written = json.loads(figures.read_text())
    rows = {row["coordinate"]: row for row in written["velocity"]["coordinates"]}
    # S0.5: the other two free without turning, then all others zero.
    for name, free, alone in (("vx", 1.27268, 1.20454), ("vy", 1.39477, 1.24080), ("vz", 0.54273, 0.54255)):
        assert rows[name]["others_of_its_kind_free"] == pytest.approx([-free, free], abs=0.6e-5)
        assert rows[name]["alone"] == pytest.approx([-alone, alone], abs=0.6e-5)
    assert written["velocity"]["corners"] == 64 and written["wrench"]["faces"] == 12
    assert written["motor_positions"]["leg1"] == pytest.approx(0.76404, abs=1e-5)


def test_load_of_the_report(tmp_path: Path) -> None:
    figures = tmp_path / "figures.json"
    code, _out, err = run(
        "stewart", "--pose", "1,1,1,0,0,0", "--no-limits", "--effort-limit", "1e4", "--json", str(figures)
    )
    assert code == 0, err
    (row,) = (r for r in json.loads(figures.read_text())["wrench"]["coordinates"] if r["coordinate"] == "fz")
    # S0.8.
    assert row["alone"][1] == pytest.approx(4184.660, abs=1e-3)
    assert row["limits"][1].startswith("leg6")


def test_weak_motors_are_told() -> None:
    code, out, err = run("stewart", "--effort-limit", "30")
    assert code == 0, err
    assert "cannot hold the robot's own weight" in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("nowhere.urdf",), "no such file"),
        (("stewart", "--pose", "1,2"), "--pose must be one number or 6"),
        (("stewart", "--pose", "0,0,9,0,0,0"), "out of reach"),
        (("stewart", "--pose", "0,0,1,0,0,1.5707963267948966"), "motors cannot hold the robot here"),
        ((str(ZOO / "parallelogram.urdf"),), "states no velocity limit; give --rate-limit"),
        (
            (str(ZOO / "parallelogram.urdf"), "--rate-limit", "1"),
            "states no effort limit; give --effort-limit",
        ),
        (("stewart", "--rate-limit", "0"), "rate_limit must be finite and above zero"),
    ],
)
def test_bad_input_ends_in_one_line_and_code_2(arguments, words) -> None:
    code, _out, err = run(*arguments)
    assert code == 2
    assert words in err and err.count("\n") == 1 and "Traceback" not in err
