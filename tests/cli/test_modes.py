"""``modes`` for platforms in space and in the plane."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from tests.cli.running import run


def test_spatial_modes(tmp_path: Path) -> None:
    figures, plot = tmp_path / "modes.json", tmp_path / "modes.png"
    answer = run("modes", "stewart_cad", "--json", str(figures), "--plot", str(plot))
    assert answer.returncode == 0, answer.stderr
    written = json.loads(figures.read_text())
    assert written["complete"] and written["kind"] == "finite"
    home = [
        mode
        for mode in written["modes"]
        if max(abs(x - y) for x, y in zip(mode["position"], [0, 0, 2.4], strict=True)) < 1e-9
    ]
    assert len(home) == 1 and home[0]["certified"] and home[0]["in_stroke"]
    assert {mode["side"] for mode in written["modes"]} <= {-1, 1}
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_planar_modes_of_the_source(tmp_path: Path) -> None:
    # S1.4: four poses.
    figures = tmp_path / "modes.json"
    sides = f"3,{3 * 2**0.5},3,{3.141592653589793 / 4},5,0,6"
    answer = run("modes", "--planar", sides, "--lengths", "5,5,3", "--json", str(figures))
    assert answer.returncode == 0, answer.stderr
    angles = [mode["angle"] for mode in json.loads(figures.read_text())["modes"]]
    expected = [-0.720849204460390, -0.331005184283869, 1.143685517821374, 2.115909014086458]
    assert angles == pytest.approx(expected, abs=1e-14)


def test_planar_modes_of_a_robot(tmp_path: Path) -> None:
    # S1.4 and S1.5: the bundled robot at home, and with another second leg.
    figures, plot = tmp_path / "modes.json", tmp_path / "modes.png"
    assert run("modes", "rpr_planar", "--json", str(figures), "--plot", str(plot)).returncode == 0
    written = json.loads(figures.read_text())
    assert written["robot"] == "rpr_planar" and plot.read_bytes().startswith(b"\x89PNG")
    expected = [-0.720849204460390, -0.331005184283869, 1.143685517821374, 2.115909014086458]
    assert [mode["angle"] for mode in written["modes"]] == pytest.approx(expected, abs=1e-12)
    assert run("modes", "rpr_planar", "--lengths", "5,7,3", "--json", str(figures)).returncode == 0
    expected = [-0.673157, -0.354740, 0.037767, 0.458878, 0.977673, 2.513853]
    assert [mode["angle"] for mode in json.loads(figures.read_text())["modes"]] == pytest.approx(
        expected, abs=1e-6
    )


def test_modes_of_any_chain(tmp_path: Path) -> None:
    """A five-bar's distal links of 0.12 m meet on either side of the line between its elbows."""
    figures, plot = tmp_path / "modes.json", tmp_path / "modes.png"
    answer = run("modes", "five_bar", "--starts", "30", "--json", str(figures), "--plot", str(plot))
    assert answer.returncode == 0, answer.stderr
    written = json.loads(figures.read_text())
    assert written["kind"] == "searched" and not written["complete"]
    ends = sorted(mode["position"] for mode in written["modes"])
    chain = stp.load("five_bar")
    assert len(ends) == 2 and plot.read_bytes().startswith(b"\x89PNG")
    data = pin.Data(chain.model)
    pin.framesForwardKinematics(chain.model, data, chain.q_home)
    left, right = (
        data.oMf[chain.model.getFrameId(f"{side}_distal")].translation for side in ("left", "right")
    )
    # Mirrored about that line.
    across = (right - left) / np.linalg.norm(right - left)
    one, other = np.array(ends) - left
    np.testing.assert_allclose(one + other, 2 * across * (across @ one), atol=1e-9)


def test_motors_of_legs_are_their_lengths(tmp_path: Path) -> None:
    first, second = tmp_path / "1.json", tmp_path / "2.json"
    assert run("modes", "rpr_planar", "--lengths", "5,7,3", "--json", str(first)).returncode == 0
    chain = stp.load("rpr_planar")
    sign, offset = chain.leg_readings
    read = ",".join(str(x) for x in sign * ([5, 7, 3] - offset))
    assert run("modes", "rpr_planar", f"--motors={read}", "--json", str(second)).returncode == 0
    poses = [[mode["position"] for mode in json.loads(path.read_text())["modes"]] for path in (first, second)]
    np.testing.assert_allclose(poses[0], poses[1], atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--planar", "1,2,3"), "--planar needs --lengths"),
        (("--planar", "1,2,3", "--lengths", "1"), "--planar must be one number or 7"),
        (("--lengths", "1,2"), "--lengths must be one number or 6"),
        (("arm_7r", "--lengths", "1"), "'arm_7r' has no legs"),
        (("delta", "--lengths", "1,2,3"), "'delta' has no legs that --lengths could mean"),
        (("delta", "--motors", "1,2"), "--motors must be one number or 3"),
        (("delta", "--motors", "1,2,3", "--lengths", "1,2,3"), "say the same thing"),
    ],
)
def test_bad_modes_end_in_one_line(arguments, words) -> None:
    answer = run("modes", *arguments)
    assert answer.returncode == 2
    assert words in answer.stderr and "Traceback" not in answer.stderr
