"""Damaged dialects and side-cars: a chain, or words."""

from __future__ import annotations

from pathlib import Path

import pytest
from lxml import etree

from tests.model.mutations import assert_loads_or_says_why, damaged, hypothesis, quick
from tests.model.small_dialects import BALL, BALLS, GAZEBO, PLUGIN, YAML, five_bar, square, transmission
from tests.small_urdf import joint, link, write

ALL_AT_ONCE = square(
    *BALLS.values(),
    GAZEBO.format(kind="ball", axis=""),
    BALL.replace("pin", "plus"),
    link("wheel"),
    joint("wheel_turn", "base", "wheel", content='<mimic joint="crank_turn" multiplier="2"/>'),
    '<coupling name="gear"><predecessor link="crank"/><successor link="wheel"/><ratio value="2"/></coupling>',
    transmission("crank_turn"),
    PLUGIN.replace("follow", "wheel_turn").replace("elbow", "crank_turn"),
    '<gravity xyz="0 0 -9.81"/>',
)


def damaged_yaml():
    """Return a strategy of a YAML with a hole or a stray word in it."""
    st = hypothesis.strategies
    text = YAML.format(kind="3d") + "joint_name: [free1]\njoint_type: [SPHERICAL]\n"
    words = [
        "",
        "[",
        "]",
        "'",
        ":",
        "mot1",
        "free2",
        "*a",
        "&a ",
        "\n",
        "!!python/x ",
        "\0",
        "{",
        "?",
        "- ",
        "|",
        "%",
        "#",
    ]
    step = st.tuples(st.integers(0, len(text)), st.integers(0, 8), st.sampled_from(words))

    def apply(steps: list) -> str:
        result = text
        for at, cut, put in steps:
            result = result[:at] + put + result[at + cut :]
        return result

    return st.lists(step, min_size=1, max_size=3).map(apply)


@quick()
@hypothesis.given(content=damaged(etree.fromstring(ALL_AT_ONCE)))
def test_damaged_dialects_load_or_fail_with_our_errors(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "fuzzed.urdf"
    path.write_bytes(content)
    assert_loads_or_says_why(path)


@quick()
@hypothesis.given(text=damaged_yaml())
def test_damaged_yaml_loads_or_fails_with_our_errors(tmp_path: Path, text: str) -> None:
    path = write(tmp_path, five_bar(), "robot.urdf")
    assert_loads_or_says_why(path, loops=write(tmp_path, text, "loops.yaml"))


@pytest.mark.slow
@quick(750)
@hypothesis.given(content=damaged(etree.fromstring(ALL_AT_ONCE)), text=damaged_yaml())
def test_many_damaged_files(tmp_path: Path, content: bytes, text: str) -> None:
    path = tmp_path / "fuzzed.urdf"
    path.write_bytes(content)
    assert_loads_or_says_why(path)
    path = write(tmp_path, five_bar(), "robot.urdf")
    assert_loads_or_says_why(path, loops=write(tmp_path, text, "loops.yaml"))
