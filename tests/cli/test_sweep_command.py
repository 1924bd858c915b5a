"""The command ``sweep`` as a user meets it."""

from __future__ import annotations

import functools
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from tests.cli import running

ROOT = Path(__file__).parents[2]
SMALL = ("--amplitude", "0.01:0.3:3", "--frequency", "1,5", "--instants", "40")


def run(*arguments: str) -> tuple[int, str, str]:
    answer = running.run("sweep", *arguments)
    return answer.returncode, answer.stdout, answer.stderr


def test_figures_are_those_of_each_motion(tmp_path: Path) -> None:
    file, picture = tmp_path / "figures.json", tmp_path / "new" / "map.png"
    code, out, err = run("stewart", *SMALL, "--axis", "y", "--json", str(file), "--plot", str(picture))
    assert code == 0, err
    written = json.loads(file.read_text())
    assert written["axes"] == {
        "amplitude": [0.01, pytest.approx(0.003**0.5), pytest.approx(0.3)],
        "frequency": [1.0, 5.0],
    }
    assert written["points"] == 6 and written["failures"] == [] and len(written["motors"]) == 6
    chain = stp.load("stewart")
    peaks = np.array(written["results"]["peak_effort"])

    def motion(amplitude: float, frequency: float, scale: float = 1.0) -> stp.motions.PlatformSamples:
        return stp.motions.sinusoidal_motion(
            np.arange(40) / 40 / frequency,
            home=stp.platform_pose(chain, chain.q_home),
            amplitude=(0.0, scale * amplitude, 0.0),
            frequency=(0.0, frequency, 0.0),
        )

    within = 0
    for i, amplitude in enumerate(written["axes"]["amplitude"]):
        for j, frequency in enumerate(written["axes"]["frequency"]):
            demand = stp.motor_demand(chain, motion(amplitude, frequency))
            np.testing.assert_allclose(peaks[i, j], np.abs(demand.efforts).max(axis=0), rtol=1e-10)
            within += stp.fit_to_limits(chain, functools.partial(motion, amplitude, frequency)).scale == 1.0
    assert written["within_limits"] == within == 5
    assert f"{peaks.max():.4g}" in out and "5 of 6 points are within the limits of the file" in out
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_angles_have_their_units_and_lost_points_their_reason(tmp_path: Path) -> None:
    file = tmp_path / "figures.json"
    code, out, err = run(
        "delta", "--amplitude", "0.01,0.3", "--frequency", "2", "--json", str(file), "--axis", "z"
    )
    assert code == 0, err
    assert "effort [N m]" in out and "travel [rad]" in out
    assert "1 points have no answer; the first, amplitude 0.3 m at 2 Hz: the pose (the platform" in out
    written = json.loads(file.read_text())
    assert written["results"]["travel"][1] == [[None] * 3]
    assert written["failures"][0]["error"] == "ClosureError" and written["failures"][0]["amplitude"] == 0.3


def test_a_journal_saves_the_work(tmp_path: Path) -> None:
    journal, files = tmp_path / "journal", [tmp_path / "one.json", tmp_path / "two.json"]
    for file in files:
        assert run("stewart", *SMALL, "--journal", str(journal), "--json", str(file))[0] == 0
    assert files[0].read_text() == files[1].read_text()
    lines = journal.read_text().splitlines()
    code, _, err = run("stewart", *SMALL, "--journal", str(journal), "--axis", "z")
    assert code == 2 and "belongs to another study" in err and "axis='z'" in err
    assert journal.read_text().splitlines() == lines


@pytest.mark.slow
def test_an_interrupted_command_goes_on(tmp_path: Path) -> None:
    """Workers are processes; a terminal sends its interrupt to all of them."""
    journal, file = tmp_path / "journal", tmp_path / "figures.json"
    arguments = (
        "delta",
        "--axis",
        "z",
        "--no-kernels",
        "--instants",
        "25",
        "--amplitude",
        "0.001:0.03:4",
        "--frequency",
        "1:10:4",
    )
    command = [
        sys.executable,
        "-m",
        "stewart_pin",
        "sweep",
        *arguments,
        "--workers",
        "2",
        "--journal",
        str(journal),
    ]
    child = subprocess.Popen(
        command, cwd=ROOT, start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    begin = time.monotonic()
    while not journal.exists() or journal.read_bytes().count(b"\n") < 5:
        assert child.poll() is None and time.monotonic() - begin < 100
        time.sleep(0.01)
    os.killpg(child.pid, signal.SIGINT)
    out, err = child.communicate(timeout=60)
    assert child.returncode == 130 and "Traceback" not in err, err
    assert "the same command goes on from there" in out
    assert 5 <= len(journal.read_text().splitlines()) < 17
    code, _, err = run(*arguments, "--journal", str(journal), "--json", str(file))
    assert code == 0, err
    results = json.loads(file.read_text())["results"]["peak_effort"]
    code, _, err = run(*(a for a in arguments if a != "--no-kernels"), "--json", str(file))
    assert code == 0, err
    np.testing.assert_allclose(results, json.loads(file.read_text())["results"]["peak_effort"], rtol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--axis", "w"), "--axis must be x, y or z"),
        (("--show", "beauty"), "--show must be one of peak_effort"),
        (("--amplitude", "0:1:3"), "--amplitude: equal ratios need values above zero"),
        (("--amplitude", "1:2"), "--amplitude must be LOW:HIGH:COUNT or numbers"),
        (("--amplitude", "a,b"), "--amplitude must be LOW:HIGH:COUNT or numbers"),
        (("--amplitude", "0.1:0.2:0"), "--amplitude: a range has 1 to"),
        (("--amplitude", "nan"), "--amplitude must be finite"),
        (("--frequency", "-1,1"), "--frequency must be above zero"),
        (("--workers", "0"), "--workers must be 1 to"),
        (("--instants", "1"), "--instants must be 4 to"),
        (("--journal", "/"), "cannot be opened"),
        (("--amplitude", "9"), "all 20 points failed"),
    ],
)
def test_bad_input_ends_in_one_line(arguments: tuple[str, ...], words: str) -> None:
    code, _, err = run("delta", *arguments)
    assert code == 2 and words in err and err.startswith("error: ") and err.count("\n") == 1


def test_wrenches_count(tmp_path: Path) -> None:
    file = tmp_path / "figures.json"
    small = ("--amplitude", "0.01", "--frequency", "1", "--instants", "8", "--json", str(file))
    code, _, err = run("stewart", *small, "--wrench", "platform:0,3,-600,1,0,0")
    assert code == 0, err
    chain = stp.load("stewart")
    samples = stp.motions.sinusoidal_motion(
        np.arange(8) / 8,
        home=stp.platform_pose(chain, chain.q_home),
        amplitude=(0.01, 0.0, 0.0),
        frequency=(1.0, 0.0, 0.0),
    )
    demand = stp.motor_demand(chain, samples, wrenches={"platform": [0, 3, -600, 1, 0, 0]})
    peaks = json.loads(file.read_text())["results"]["peak_effort"][0][0]
    np.testing.assert_allclose(peaks, np.abs(demand.efforts).max(axis=0), rtol=1e-10)
    for text, words in (
        ("platform:1,2", "LINK:fx,fy,fz,mx,my,mz"),
        ("1,2,3,4,5,6", "LINK:fx,fy,fz,mx,my,mz"),
        ("platfrm:1,2,3,4,5,6", "'platform'"),
    ):
        code, _, err = run("stewart", *small, "--wrench", text)
        assert code and words in err and "Traceback" not in err


def test_equal_steps_on_demand(tmp_path: Path) -> None:
    file = tmp_path / "figures.json"
    arguments = ("stewart", "--amplitude", "0:0.1:3", "--frequency", "1:2:3", "--linear", "--json", str(file))
    assert run(*arguments)[0] == 0
    assert json.loads(file.read_text())["axes"] == {
        "amplitude": [0.0, 0.05, 0.1],
        "frequency": [1.0, 1.5, 2.0],
    }
