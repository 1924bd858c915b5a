"""Simulating and shaking from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.running import run


def test_simulate_accounts_for_energy_and_tracking(tmp_path: Path) -> None:
    figures, plot = tmp_path / "run.json", tmp_path / "run.png"
    answer = run(
        "simulate", "stewart", "--duration", "0.05", "--dt", "0.0025", "--json", str(figures), "--plot", str(plot)
    )  # fmt: skip
    assert answer.returncode == 0, answer.stderr
    written = json.loads(figures.read_text())
    assert written["success"] is True
    assert written["largest_gap"] < 1e-10
    assert written["energy_unaccounted"] < 1e-6
    # Efforts held for 2.5 ms come half of that late, which the controller makes up for in part.
    assert written["rms_position_error"] < 3e-4
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert "rms position error" in answer.stdout


@pytest.mark.slow
def test_shake_fits_the_record_and_shakes(tmp_path: Path) -> None:
    figures = tmp_path / "shake.json"
    answer = run(
        "shake", "stewart", "--seed", "3", "--scale", "20", "--duration", "0.1", "--dt", "0.005", "--json", str(figures)
    )  # fmt: skip
    assert answer.returncode == 0, answer.stderr
    written = json.loads(figures.read_text())
    assert 0 < written["scale_fitted"] < 20
    assert written["binding"]["use"] == pytest.approx(1.0, abs=1e-5)
    assert written["binding"]["motor"].startswith("leg")
    assert written["simulation"]["success"] is True
    assert written["binding"]["limit"] in answer.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("simulate", "--controller", "magic"), "--controller must be one of"),
        (("simulate", "--dt", "0"), "dt must be"),
        (("simulate", "--method", "Euler"), "method must be"),
        (("shake", "--record", "nowhere.at2"), "no such file"),
        (("shake", "--axis", "w", "--controller", "none"), "keyed by x, y or z"),
        (("shake", "--margin", "2"), "margin must be"),
    ],
)
def test_bad_input_ends_in_one_line_and_code_2(arguments, words) -> None:
    answer = run(*arguments)
    assert answer.returncode == 2, answer.stdout
    assert words in answer.stderr and answer.stderr.count("\n") == 1 and "Traceback" not in answer.stderr
