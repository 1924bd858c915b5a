"""Damaged SDFormat files: a chain, or words; never a crash, a hang or a wrong tree."""

from __future__ import annotations

from pathlib import Path

import pytest
from lxml import etree

from tests.model.mutations import assert_loads_or_says_why, damaged, hypothesis, quick
from tests.model.sdf_reading import CLOSINGS, FOUR_BAR
from tests.small_sdf import TREES, axis2, joint, link, sdf

GEARS = (
    link("fast", "1 0 0 0 0 0"),
    link("slow", "2 0 0 0 0 0"),
    joint("in", "ground", "fast"),
    joint("out", "ground", "slow"),
    joint(
        "gear", "fast", "slow", "gearbox",
        content=f"{axis2('0 0 1')}<gearbox_ratio>0.5</gearbox_ratio>"
        "<gearbox_reference_body>ground</gearbox_reference_body>",
    ),
)  # fmt: skip
BAR = etree.fromstring(sdf(*FOUR_BAR, CLOSINGS["a second parent"][0], *GEARS, version="1.11"))
WORLD = etree.fromstring(
    '<sdf version="1.10"><world name="w"><gravity>0 0 -9.8</gravity><frame name="f"><pose>1 0 0 0 0 0</pose></frame>'
    f"{etree.tostring(BAR[0], encoding='unicode')}"
    '<model name="plate"><static>1</static><link name="p"/></model></world></sdf>'
)
NESTED = etree.fromstring(TREES["nested models"])


def _load(folder: Path, content: bytes, motor: str, platform: str) -> None:
    path = folder / "small.sdf"
    path.write_bytes(content)
    assert_loads_or_says_why(path, motors=[motor], platform=platform)


@quick()
@hypothesis.given(content=damaged(BAR))
def test_damaged_loops(tmp_path: Path, content: bytes) -> None:
    _load(tmp_path, content, "crank_hinge", "coupler")


@quick(30)
@hypothesis.given(content=damaged(NESTED))
def test_damaged_models(tmp_path: Path, content: bytes) -> None:
    _load(tmp_path, content, "j", "b")


@quick(30)
@hypothesis.given(content=damaged(WORLD))
def test_damaged_worlds(tmp_path: Path, content: bytes) -> None:
    _load(tmp_path, content, "crank_hinge", "coupler")


@pytest.mark.slow
@quick(1500)
@hypothesis.given(content=damaged(BAR))
def test_many_damaged_loops(tmp_path: Path, content: bytes) -> None:
    _load(tmp_path, content, "crank_hinge", "coupler")


@pytest.mark.slow
@quick(1000)
@hypothesis.given(content=damaged(NESTED))
def test_many_damaged_models(tmp_path: Path, content: bytes) -> None:
    _load(tmp_path, content, "j", "b")
