"""Inverse kinematics of a part of a pose, which is what platforms of few freedoms can meet of a printed one."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import ClosureError, InputError
from tests.printed import round_places, turned_frames
from tests.zoo.table import zoo_chain

PARTS = ("x", "y", "z", "roll", "pitch", "yaw")


def left_over(chain: stp.ClosedChain, q: np.ndarray, pose: pin.SE3) -> np.ndarray:
    here = stp.platform_pose(chain, q)
    return np.concatenate([here.translation - pose.translation, pin.log3(here.rotation @ pose.rotation.T)])


@pytest.mark.parametrize("name", ["crank_rocker", "five_bar_5r", "sarrus"])
def test_a_printed_platform_says_which_parts_it_meets(name: str, tmp_path: Path) -> None:
    """Five decimals leave an exact pose beside the motions of the printed mechanism."""
    exact, rng = turned_frames(zoo_chain(name), seed=3), np.random.default_rng(0)
    path = tmp_path / "printed.urdf"
    stp.export(exact, path)
    round_places(path, "5f")
    printed = stp.load(path)
    step = 0.1 * rng.normal(size=exact.nv)
    q = stp.close_loops(exact, pin.integrate(exact.model, exact.q_home, step)).q
    pose = stp.platform_pose(exact, q)
    np.testing.assert_allclose(stp.inverse_kinematics(exact, pose, limits=False).q, q, atol=1e-9)
    with pytest.raises(ClosureError, match=r"met but for digits, ask for .* only=\(") as caught:
        stp.inverse_kinematics(printed, pose, limits=False)
    found = re.search(r"only=\(([^)]*)\)", str(caught.value))
    assert found is not None
    only: Any = tuple(re.findall(r"'(\w+)'", found[1]))
    assert len(only) == exact.generic.count.platform
    met = stp.inverse_kinematics(printed, pose, only=only, limits=False)
    assert met.success
    wrong = np.abs(left_over(printed, met.q, pose))
    assert wrong[[PARTS.index(part) for part in only]].max() < 1e-11
    # Half a unit, and what levers make of it.
    assert wrong.max() < 60 * 0.5e-5


@pytest.mark.parametrize("only", [("z",), ("x", "yaw"), ("roll", "pitch", "z"), PARTS])
def test_what_is_asked_for_is_met_and_the_rest_is_free(only: Any) -> None:
    chain = stp.load("stewart")
    pose = pin.SE3(pin.rpy.rpyToMatrix(0.05, -0.04, 0.06), np.array([0.02, -0.03, 1.03]))
    found = stp.inverse_kinematics(chain, pose, only=only)
    assert np.abs(stp.loop_gap(chain, found.q)).max() < 1e-12
    wrong = np.abs(left_over(chain, found.q, pose))
    kept = [PARTS.index(part) for part in only]
    assert wrong[kept].max() < 1e-11
    assert only == PARTS or np.delete(wrong, kept).max() > 1e-3
    if only == PARTS:
        np.testing.assert_array_equal(found.q, stp.inverse_kinematics(chain, pose).q)


@pytest.mark.parametrize("only", [(), ("vx",), ("x", "q"), "heave"])
def test_other_names_are_refused(only: Any) -> None:
    chain = stp.load("five_bar")
    with pytest.raises(InputError, match="only must name some of x, y, z, roll, pitch, yaw, got"):
        stp.inverse_kinematics(chain, stp.platform_pose(chain, chain.q_home), only=only)


def test_a_platform_of_six_freedoms_is_told_nothing_of_parts() -> None:
    chain = stp.load("hexapod_rss")
    with pytest.raises(ClosureError) as caught:
        stp.inverse_kinematics(chain, [0, 0, 9, 0, 0, 0, 1], limits=False)
    assert "only=" not in str(caught.value)
