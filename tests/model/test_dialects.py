"""The same four-bar in every dialect is the same mechanism; dialects are found, and named in the report."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.model.description import JointKind
from stewart_pin.model.formats import dialects as folder
from stewart_pin.model.formats.dialect import claimed_tags, dialects
from tests.model.small_dialects import BALL, BALLS, DRAKE_BALL, HINGE, HINGES, assert_same_motion, square
from tests.small_urdf import write


@pytest.mark.parametrize("text", BALLS.values(), ids=BALLS)
def test_balls_in_every_dialect(tmp_path: Path, text: str, rng: np.random.Generator) -> None:
    chain = stp.load(write(tmp_path, square(text)))
    assert [each.kind for each in chain.loops] == [JointKind.SPHERICAL]
    assert_same_motion(chain, stp.load(write(tmp_path, square(BALL))), rng)


@pytest.mark.parametrize("text", HINGES.values(), ids=HINGES)
def test_hinges_in_every_dialect(tmp_path: Path, text: str, rng: np.random.Generator) -> None:
    chain = stp.load(write(tmp_path, square(text)))
    assert [each.kind for each in chain.loops] == [JointKind.REVOLUTE]
    assert_same_motion(chain, stp.load(write(tmp_path, square(HINGE))), rng)


def test_every_dialect_is_reported_with_its_name(tmp_path: Path) -> None:
    text = square(BALLS["isaac"], DRAKE_BALL, BALLS["urdfdom"].replace("pin", "pin2"), loop_named("pin3"))
    report = str(stp.load(write(tmp_path, text)).report)
    for line in (
        "kept: read as Isaac <loop_joint> (loop 'pin')",
        "kept: read as Drake's tags (loop 'platform_rocker_ball')",
        "kept: read as urdfdom <constraint> (loop 'pin2')",
        "kept: read as URDF+ (loop 'pin3')",
    ):
        assert line in report.splitlines()


def loop_named(name: str) -> str:
    return BALL.replace('name="pin"', f'name="{name}"')


def test_a_new_file_is_a_new_dialect(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(
        tmp_path,
        "from stewart_pin.model.description import JointKind, Loop\n"
        "from stewart_pin.model.formats.dialect import Dialect, Parts\n"
        "import pinocchio as pin\n"
        "def read(reader, element):\n"
        "    place = pin.SE3(reader.pose(element, 'knot'))\n"
        "    return Parts(loops=(Loop('knot', JointKind.SPHERICAL, 'platform', 'rocker', place, place),))\n"
        "DIALECT = Dialect('knots', 'knots', {'robot/knot': read})\n",
        "knots.py",
    )
    monkeypatch.setattr(folder, "__path__", [*folder.__path__, str(tmp_path)])
    for found in (dialects, claimed_tags):
        found.cache_clear()
    try:
        chain = stp.load(write(tmp_path, square('<knot xyz="1 0 0"/>')))
    finally:
        monkeypatch.undo()
        for found in (dialects, claimed_tags):
            found.cache_clear()
    assert str(chain.report) == "kept: read as knots (loop 'knot')" and chain.nc == 3


def test_dialects_are_found_and_claim_each_tag_once() -> None:
    names = [dialect.name for dialect in dialects()]
    assert len(set(names)) == len(names) >= 9
    assert len(claimed_tags()) == sum(len(dialect.tags) for dialect in dialects())
