"""Habits of published files that are read in one call: a world that goes without saying, loops held by a plugin."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError
from stewart_pin.model.description import JointKind
from tests.small_sdf import BODY, joint, link, sdf, write
from tests.small_urdf import joint as urdf_joint
from tests.small_urdf import link as urdf_link
from tests.small_urdf import robot
from tests.small_urdf import write as write_urdf

PLUGIN = (
    '<plugin filename="gz-sim-detachable-joint-system" name="gz::sim::systems::DetachableJoint">'
    "<parent_link>c</parent_link><child_model>{}</child_model><child_link>d</child_link></plugin>"
)
SQUARE = (
    link("a"),
    link("b", "1 0 0 0 0 0.2"),
    link("c", "1 1 0 0 0 -0.3"),
    link("d", "0.4 1 0 0 0 0.7"),
    joint("base", "world", "a", "fixed"),
    joint("one", "a", "b"),
    joint("two", "b", "c"),
    joint("three", "a", "d"),
)


@pytest.mark.parametrize("name", ["small", "__model__"])
def test_a_detachable_joint_in_one_model_closes_a_loop(name: str, tmp_path: Path) -> None:
    # Three parallel hinges, and both ends of the chain held together: nothing is left to move but what is redundant.
    chain = stp.load(write(tmp_path, sdf(*SQUARE, PLUGIN.format(name))))
    (loop,) = chain.loops
    assert (loop.kind, loop.link1, loop.link2) == (JointKind.FIXED, "c", "d")
    assert np.abs(stp.loop_gap(chain, chain.q_home)).max() < 1e-15 and not chain.q_home.any()
    assert stp.mobility(chain).dof == 0 and "never detached" in str(chain.report)
    with pytest.raises(FileFormatError, match="DetachableJoint"):
        stp.load(write(tmp_path, sdf(*SQUARE, PLUGIN.format("other"))))


@pytest.mark.parametrize("endless", ["1e16", "1.79769e+308", "1.7976931348623157e308", "3.40282e+38"])
def test_numbers_for_no_limit(endless: str, tmp_path: Path) -> None:
    limit = f"<limit><lower>-{endless}</lower><upper>{endless}</upper></limit>"
    chain = stp.load(write(tmp_path, sdf(link("a"), joint("j", "world", "a", axis=limit))))
    assert (chain.mechanism.joint("j").lower, chain.mechanism.joint("j").upper) == (-np.inf, np.inf)
    with pytest.raises(FileFormatError, match=r"<lower>.*'nan'"):
        stp.load(
            write(
                tmp_path, sdf(link("a"), joint("j", "world", "a", axis="<limit><lower>nan</lower></limit>"))
            )
        )


def test_an_axis_without_numbers_is_z(tmp_path: Path) -> None:
    text = sdf(link("a"), joint("j", "world", "a")).replace("<xyz>0 0 1</xyz>", "")
    assert "<xyz>" not in text
    chain = stp.load(write(tmp_path, text))
    np.testing.assert_array_equal(chain.mechanism.joint("j").axis, [0, 0, 1])
    assert "<axis> has no <xyz>: z, the format's default" in str(chain.report)


def test_version_1_3_is_read_as_1_4(tmp_path: Path) -> None:
    # Both have axes in the frame of the model.
    parts = link("a", "0 0 1 0.3 0 0", BODY), joint("j", "world", "a", xyz="0 1 0")
    one, other = (stp.load(write(tmp_path, sdf(*parts, version=version))) for version in ("1.3", "1.4"))
    axes = [chain.mechanism.joint("j").axis for chain in (one, other)]
    np.testing.assert_array_equal(*axes)
    assert abs(axes[0][1]) < 0.999


def test_the_world_of_a_urdf_goes_without_saying(tmp_path: Path) -> None:
    parts = (
        urdf_link("a"),
        urdf_joint("hold", "world", "a", "fixed"),
        urdf_link("b"),
        urdf_joint("turn", "a", "b"),
    )
    chain = stp.load(write_urdf(tmp_path, robot(*parts)))
    assert chain.nv == 1 and chain.mechanism.root == "world"
    assert "joints hang on it, and it is not written" in str(chain.report)
    with pytest.raises(FileFormatError, match="missing parent link 'earth'"):
        stp.load(write_urdf(tmp_path, robot(*parts).replace('"world"', '"earth"')))
