"""The files of the zoo: one per row of the table, small, as `make` writes them, closed at home."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from tests.rewritten import in_other_unit
from tests.zoo.make import MAKERS
from tests.zoo.make_robots import ROBOT_MAKERS
from tests.zoo.robot_telling import RobotTelling
from tests.zoo.table import FOLDER, ROWS, ZOO, Row, expected, zoo_chain
from tests.zoo.telling import Telling

each = pytest.mark.parametrize("row", ZOO, ids=[row.name for row in ZOO])


def test_table_files_and_makers_name_the_same_mechanisms() -> None:
    assert len(ZOO) == len(ROWS) >= 40
    assert (
        {path.stem for path in FOLDER.glob("*.urdf")} == {r.name for r in ZOO if not r.bundled} == set(MAKERS)
    )
    assert {row.name for row in ZOO if row.bundled} == set(ROBOT_MAKERS)


@each
def test_file_is_what_the_script_writes(row: Row) -> None:
    """But for the last digit, which another mathematical library may round otherwise."""
    told = RobotTelling(row.name) if row.bundled else Telling(row.name)
    (ROBOT_MAKERS if row.bundled else MAKERS)[row.name](told)
    written, read = (
        told.text().replace('"', " ").split(),
        row.file.read_text("utf-8").replace('"', " ").split(),
    )
    assert len(written) == len(read)
    for one, other in zip(written, read, strict=True):
        assert one == other or float(one) == pytest.approx(float(other), abs=1e-15, rel=1e-14)


@each
def test_file_is_small_and_its_loops_close(row: Row) -> None:
    chain = zoo_chain(row.name)
    if not row.bundled:
        assert len(row.file.read_text("utf-8").splitlines()) <= 60
        assert not chain.q_home[chain.motor_q_index].any()
    # Differences of points of up to 2 m, in four sums.
    assert np.abs(stp.loop_gap(chain, chain.q_home)).max(initial=0.0) <= 2e-15


@pytest.mark.parametrize("name", expected("long_stroke"))
def test_long_strokes_do_not_tie_the_size_to_a_unit(name: str, tmp_path: Path) -> None:
    """Strokes of 1 km, as programs write them that have none: in millimetres the mechanism is as large."""
    text = ROWS[name].file.read_text("utf-8").replace('"-2.0"', '"-1000.0"').replace('"2.0"', '"1000.0"')
    path = tmp_path / f"{name}.urdf"
    path.write_text(text, "utf-8")
    chain = stp.load(path)
    assert in_other_unit(chain, 1e3).length_scale == pytest.approx(1e3 * chain.length_scale, rel=1e-9)
