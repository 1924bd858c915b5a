"""Damaged MJCF files: MuJoCo's compiler sits behind the reader, and whatever it does comes out in our words."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest
from lxml import etree

import stewart_pin as stp
from tests.model.mutations import assert_loads_or_says_why, damaged, quick
from tests.model.small_mjcf import QPOS, TIES, WORKSHOP

hypothesis = pytest.importorskip("hypothesis")
pytest.importorskip("mujoco")


@cache
def every_tag() -> etree._Element:
    return etree.fromstring(WORKSHOP % (TIES, QPOS))


def exported(folder: Path) -> etree._Element:
    stp.export(stp.load("four_bar"), folder / "whole.xml", format="mjcf")
    return etree.parse(folder / "whole.xml").getroot()


def test_the_whole_file_loads(tmp_path: Path) -> None:
    (tmp_path / "whole.xml").write_bytes(etree.tostring(every_tag()))
    chain = stp.load(tmp_path / "whole.xml")
    assert (len(chain.loops), len(chain.couplings)) == (1, 2)


def try_damage(folder: Path, root: etree._Element, examples: int) -> None:
    path = folder / "damaged.xml"

    @quick(examples)
    @hypothesis.given(damaged(root))
    def run(content: bytes) -> None:
        path.write_bytes(content)
        assert_loads_or_says_why(path)

    run()


@pytest.mark.parametrize("origin", ["every tag", "exported"])
def test_damaged_files_are_answered_in_words(origin: str, tmp_path: Path) -> None:
    try_damage(tmp_path, every_tag() if origin == "every tag" else exported(tmp_path), 30)


@pytest.mark.slow
@pytest.mark.parametrize("origin", ["every tag", "exported"])
def test_many_damaged_files(origin: str, tmp_path: Path) -> None:
    try_damage(tmp_path, every_tag() if origin == "every tag" else exported(tmp_path), 700)
