"""The command ``singularity`` as a user meets it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from tests.cli import running


def run(*arguments: str) -> tuple[int, str, str]:
    answer = running.run("singularity", *arguments)
    return answer.returncode, answer.stdout, answer.stderr


def test_a_right_angle_is_named(tmp_path: Path) -> None:
    figures = tmp_path / "figures.json"
    code, out, err = run("stewart", "--pose", f"0,0,1,0,0,{np.pi / 2!r}", "--json", str(figures))
    assert code == 0, err
    assert "locked motors leave the platform free (type II, parallel) [RO, II]" in out
    assert "worst twist: vz -0.242 m/s, wz +0.9219 rad/s" in out
    written = json.loads(figures.read_text())
    assert written["kinds"] == ["motor"] and written["condition_number"] is None
    assert written["measures"]["motor"] < 1e-12
    assert len(written["worst_wrench"]) == 6


def test_a_regular_pose_and_its_axes(tmp_path: Path) -> None:
    figures = tmp_path / "figures.json"
    code, out, err = run("five_bar", "--axes", "vx,vy", "--length", "0.1", "--json", str(figures))
    assert code == 0, err
    assert "regular, condition number" in out and "(length 0.1 m)" in out
    assert json.loads(figures.read_text())["axes"] == ["vx", "vy"]
    code, out, err = run("arm_3r_planar", "--json", str(figures))
    assert code == 0 and "type I" in out
    assert json.loads(figures.read_text())["measures"]["loop"] is None  # no loops


def test_bad_input_ends_in_one_line() -> None:
    code, _, err = run("five_bar", "--axes", "vx,q")
    assert code == 2 and "axes must be some of vx, vy" in err
    code, _, err = run("five_bar", "--length", "0")
    assert code == 2 and "length must be a finite number above zero" in err
