"""Motors, limits and home of an SDFormat file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import MechanismError
from tests.model.sdf_reading import CLOSINGS, FOUR_BAR, read
from tests.small_sdf import HOLD, TWO, joint, link, sdf, write


def test_motors_where_every_axis_states_its_effort(tmp_path: Path) -> None:
    def effort(value: float) -> str:
        return f"<limit><effort>{value}</effort></limit>"

    parts = (*TWO, link("c"), HOLD, joint("j", "a", "b", axis=effort(5)))
    marked = read(tmp_path, *parts, joint("k", "b", "c", axis=effort(0)))
    assert [x.name for x in marked.joints if x.independent] == ["j"]
    for rest in (
        (joint("k", "b", "c"),),
        (joint("k", "b", "c", axis=effort(0)), link("d"), joint("m", "c", "d")),
        (joint("k", "b", "c", axis=effort(3)),),
    ):
        assert not any(x.independent for x in read(tmp_path, *parts, *rest).joints)


def test_limits(tmp_path: Path) -> None:
    axis = "<limit><lower>-1e16</lower><upper>inf</upper><effort>-1</effort><velocity>2</velocity></limit>"
    mechanism = read(
        tmp_path,
        *TWO,
        link("c"),
        HOLD,
        joint("j", "a", "b", axis=axis),
        joint("k", "b", "c", axis="<limit><lower>-0.5</lower><upper>1.5</upper><effort>7</effort></limit>"),
    )
    endless = joint("j", "a", "b", "continuous", axis="<limit><lower>-1</lower><upper>1</upper></limit>")
    (turn,) = [x for x in read(tmp_path, *TWO, HOLD, endless).joints if x.name == "j"]
    assert (turn.lower, turn.upper) == (-np.inf, np.inf)
    j, k = mechanism.joint("j"), mechanism.joint("k")
    assert (j.lower, j.upper, j.effort, j.velocity) == (-np.inf, np.inf, np.inf, 2)
    assert (k.lower, k.upper, k.effort, k.velocity) == (-0.5, 1.5, 7, np.inf)


def test_home_is_the_pose_of_the_file(tmp_path: Path) -> None:
    closing, _ = CLOSINGS["a second parent"]
    chain = stp.load(write(tmp_path, sdf(*FOUR_BAR, closing)), motors=["crank_hinge"], platform="coupler")
    np.testing.assert_array_equal(chain.q_home, np.zeros(3))


@pytest.mark.parametrize("at", ["crank_hinge", "rocker_hinge"])
def test_home_is_carried_inside_the_limits(tmp_path: Path, at: str) -> None:
    closing, _ = CLOSINGS["a second parent"]
    limit = "</xyz><limit><lower>0.4</lower><upper>0.8</upper></limit></axis>"
    parts = [
        part.replace("</xyz></axis>", limit) if f'"{at}"' in part else part for part in (*FOUR_BAR, closing)
    ]
    chain = stp.load(write(tmp_path, sdf(*parts)), motors=["crank_hinge"], platform="coupler")
    assert 0.399 <= chain.q_home[0] <= 0.801 and np.abs(stp.loop_gap(chain, chain.q_home)).max() < 1e-12
    assert "they were moved inside" in str(chain.report)


def test_home_stays_where_the_loops_let_nothing_move(tmp_path: Path) -> None:
    """Two hinges with parallel axes between the same links hold everything; the limits exclude where they stand."""
    limit = "<limit><lower>0.4</lower><upper>0.8</upper></limit>"
    text = sdf(
        link("a"),
        HOLD,
        link("b", "1 0 0 0 0 0"),
        joint("j", "a", "b", axis=limit),
        joint("k", "a", "b", pose="0.5 0 0 0 0 0"),
    )
    chain = stp.load(write(tmp_path, text), motors=["j"], platform="b")
    np.testing.assert_array_equal(chain.q_home, [0])
    assert "it stays there" in str(chain.report)


def test_a_joint_that_closes_a_loop_is_no_motor(tmp_path: Path) -> None:
    closing, _ = CLOSINGS["a second parent"]
    with pytest.raises(MechanismError, match="'right_pin', which closes a loop, and has no coordinate"):
        stp.load(write(tmp_path, sdf(*FOUR_BAR, closing)), motors=["right_pin"], platform="coupler")
