"""The command line as a user meets it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.running import run
from tests.small_urdf import bundled, write


def test_the_module_is_a_command() -> None:
    command = [sys.executable, "-m", "stewart_pin", "modes", "nosuch"]
    answer = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert answer.returncode == 2 and not answer.stdout
    assert len(answer.stderr.strip().splitlines()) == 1 and "nosuch" in answer.stderr


def test_help_comes_without_arguments() -> None:
    answer = run()
    assert "compare" in answer.stdout + answer.stderr and "inspect" in answer.stdout + answer.stderr


def test_compare_prints_a_table_draws_a_picture_and_writes_figures(tmp_path: Path) -> None:
    plot, figures = tmp_path / "new" / "forces.png", tmp_path / "figures.json"
    answer = run("compare", "--duration", "0.04", "--json", str(figures), "--plot", str(plot))
    assert answer.returncode == 0, answer.stderr
    assert "leg6" in answer.stdout and "20/20" in answer.stdout
    assert plot.read_bytes().startswith(b"\x89PNG")
    written = json.loads(figures.read_text())
    agreements = [value for key, value in written.items() if "agreement" in key]
    assert len(agreements) == 2 and max(agreements) < 1e-12
    assert [leg["motor"] for leg in written["legs"]] == [f"leg{k}" for k in range(1, 7)]
    assert all(leg["peak"] >= leg["rms"] > 0 for leg in written["legs"])


def test_compare_takes_the_motion_from_its_options(tmp_path: Path) -> None:
    # Standing still: the legs carry the weight, so RMS and peak are the same.
    figures = tmp_path / "figures.json"
    answer = run(
        "compare", "--robot", "stewart_sps", "--amplitude", "0", "--duration", "0.2", "--rate", "10",
        "--json", str(figures), "--plot", str(tmp_path / "p.png"),
    )  # fmt: skip
    assert answer.returncode == 0, answer.stderr
    written = json.loads(figures.read_text())
    assert written["motion"]["states"] == 2
    assert all(leg["peak"] == pytest.approx(leg["rms"]) for leg in written["legs"])


def test_inspect_tells_the_mobility(tmp_path: Path) -> None:
    figures = tmp_path / "figures.json"
    answer = run("inspect", "stewart_sps", "--json", str(figures))
    assert answer.returncode == 0, answer.stderr
    assert "leg 3: spin about its axis" in answer.stdout
    assert "12, at home and at 5 random" in answer.stdout
    assert json.loads(figures.read_text())["mobility"]["dof"] == 12


def test_inspect_tells_what_was_made_of_a_file(tmp_path: Path) -> None:
    text = bundled("stewart").read_text().replace(' independent="true"', "").replace('"platform"', '"plate"')
    path, figures = write(tmp_path, text), tmp_path / "figures.json"
    legs = ",".join(f"leg{k}" for k in range(1, 7))
    answer = run("inspect", str(path), "--motors", legs, "--platform", "plate", "--json", str(figures))
    assert answer.returncode == 0, answer.stderr
    assert "read as URDF+" in answer.stdout
    assert {"subject": "loop 'leg6_ball'", "text": "read as URDF+", "outcome": "kept"} in json.loads(
        figures.read_text()
    )["notes"]


def test_inspect_shows_what_cannot_be_used(tmp_path: Path) -> None:
    """A pin 9 m away: no loop closes, and all that was read is shown before the error."""
    path, figures, plot = tmp_path / "wide.urdf", tmp_path / "wide.json", tmp_path / "wide.png"
    text = (Path(__file__).parents[1] / "zoo" / "urdf" / "crank_rocker.urdf").read_text()
    path.write_text(text.replace('<origin xyz="-0.2000', '<origin xyz="-9.2000'))
    answer = run("inspect", str(path), "--json", str(figures), "--plot", str(plot))
    assert answer.returncode == 2 and "the loops do not close" in answer.stderr
    assert "cannot be used as it is" in answer.stdout and "Traceback" not in answer.stderr
    written = json.loads(figures.read_text())
    assert written["joints"]["crank_turn"] == "revolute" and list(written["loops"].values()) == [5]
    assert written["freedoms_by_count"] == sum(kind != "fixed" for kind in written["joints"].values()) - 5
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_inspect_draws_a_robot(tmp_path: Path) -> None:
    plot = tmp_path / "five_bar.png"
    assert run("inspect", "five_bar", "--plot", str(plot)).returncode == 0
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_inspect_judges_other_motors() -> None:
    few = run("inspect", "five_bar", "--motors", "left_hip").stdout
    assert "no, too few: 1 freedom(s) left over" in few and "left_knee, right_hip, right_knee" in few
    assert "left_hip, right_hip" in few
    many = run("inspect", "five_bar", "--motors", "left_hip, right_hip, left_knee").stdout
    assert "yes, 1 to spare" in many and "left_hip; right_hip; left_knee" in many


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("inspect", "stewart", "--loops", "loops.json"), "side-car files of type '.json' are not supported"),
        (("compare", "--robot", "no_such_robot"), "bundled robots are: "),
        (("compare", "--amplitude", "far"), "--amplitude must be numbers"),
        (("compare", "--frequencies", "1,2"), "--frequencies must be one number or 3"),
        (("compare", "--duration", "-1"), "duration must be"),
        (("compare", "--amplitude", "3"), "out of reach"),
        (("inspect", "nowhere.urdf"), "no such file"),
        (("inspect", "five_bar", "--motors", "hip"), "motors name the joint 'hip'"),
        (("inspect", "five_bar", "--platform", "hip"), "no moving link 'hip'"),
    ],
)
def test_bad_input_ends_in_one_line_and_code_2(arguments, words) -> None:
    answer = run(*arguments)
    assert answer.returncode == 2
    assert words in answer.stderr and answer.stderr.count("\n") == 1 and "Traceback" not in answer.stderr


def test_json_into_nowhere_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    answer = run("inspect", "stewart", "--json", str(tmp_path / "file" / "x.json"))
    assert answer.returncode == 2 and "--json" in answer.stderr


@pytest.mark.parametrize("command", ["compare", "capability", "modes", "simulate", "shake", "sweep"])
def test_a_picture_of_unknown_format_ends_before_computing(command: str, tmp_path: Path) -> None:
    for path, words in ((tmp_path / "x.xyz", "pictures end in"), (tmp_path, "is a folder")):
        arguments = [] if command == "compare" else ["stewart"]
        answer = run(command, *arguments, "--plot", str(path))
        assert answer.returncode == 2 and not answer.stdout.strip()
        assert len(answer.stderr.strip().splitlines()) == 1 and words in answer.stderr
