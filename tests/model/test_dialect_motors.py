"""Motors that transmissions and controllers name."""

from __future__ import annotations

from pathlib import Path

import pytest

import stewart_pin as stp
from tests.model.small_dialects import transmission
from tests.small_urdf import ARM, MOTOR, robot, write


def controlled(*names: str) -> str:
    joints = "".join(f'<joint name="{n}"><command_interface name="effort"/></joint>' for n in names)
    return f'<ros2_control name="c" type="system">{joints}<joint name="other"/></ros2_control>'


UNMARKED = [part.replace(MOTOR, "") for part in ARM]


def test_transmissions_name_the_motors(tmp_path: Path) -> None:
    parts = (transmission("elbow"), transmission("shoulder"), controlled("shoulder", "elbow"))
    chain = stp.load(write(tmp_path, robot(*UNMARKED, *parts)))
    assert chain.motors == ("elbow", "shoulder")
    report = str(chain.report)
    assert "kept: names the motors (<transmission name='t_elbow'>" in report
    assert chain.mechanism.joint("elbow").physics.armature == 1.0
    marked = stp.load(write(tmp_path, robot(*ARM, *parts)))
    assert marked.motors == ("shoulder", "elbow")
    assert "motors are the joints marked independent (<transmission" in str(marked.report)


AMBIGUOUS = {
    "differ": ((transmission("elbow"), controlled("shoulder")), "<transmission> and <ros2_control> differ"),
    "missing": ((transmission("wrist"),), "joint 'wrist' is missing or has not one freedom"),
    "twice": ((transmission("elbow"), transmission("elbow")), "joint 'elbow' is named twice"),
    "two": (
        (transmission("elbow").replace("<joint", '<joint name="shoulder"/><joint'),),
        "leads to 2 joints",
    ),
}


@pytest.mark.parametrize(("parts", "words"), AMBIGUOUS.values(), ids=AMBIGUOUS)
def test_ambiguous_motors_are_not_guessed(tmp_path: Path, parts: tuple[str, ...], words: str) -> None:
    path = write(tmp_path, robot(*UNMARKED, *parts))
    assert stp.load(path).motors == ()
    assert words in str(stp.load(path, motors=["elbow"]).report)
