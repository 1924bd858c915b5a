"""``inspect`` on a file of another simulator."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.running import run
from tests.model.small_mjcf import QPOS, WORKSHOP, write

pytest.importorskip("mujoco")


def test_inspect_reads_mjcf(tmp_path: Path) -> None:
    pin = '<connect name="pin" body1="coupler" body2="platform" anchor="0.1 0.2 0.3"/>'
    ties = pin + '<joint name="cam" joint1="knee"/>'
    path = write(tmp_path, WORKSHOP % (ties, QPOS))
    answer = run("inspect", str(path), "--motors", "second", "--platform", "tool")
    assert answer.returncode == 0, answer.stderr
    told = answer.stdout
    assert "pin: spherical, coupler to platform" in told and "armature 0.05" in told
    assert told.count("cam: knee follows") == told.count("│ couplings  ") == 1
    answer = run("inspect", str(write(tmp_path, "<mujoco><worldbody/></mujocos>")))
    assert answer.returncode == 2 and len(answer.stderr.strip().splitlines()) <= 2
