"""Joints of SDFormat that close loops."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.model.description import JointKind, Outcome
from tests.model.lifts import THREADS, lift_by_hand, raised
from tests.model.sdf_reading import CLOSINGS, four_bar, read, standing
from tests.small_sdf import BODY, HOLD, TWO, axis2, joint, link, sdf, write

R, P, S = JointKind.REVOLUTE, JointKind.PRISMATIC, JointKind.SPHERICAL


@pytest.mark.parametrize("name", CLOSINGS)
@pytest.mark.parametrize("xmlns", [True, False], ids=["declared prefix", "bare prefix"])
def test_a_four_bar_closes(tmp_path: Path, name: str, xmlns: bool) -> None:
    closing, kind = CLOSINGS[name]
    text, _ = four_bar(closing, xmlns=xmlns)
    chain = stp.load(write(tmp_path, text), motors=["crank_hinge"], platform="coupler")
    (loop,) = chain.loops
    assert (loop.kind, loop.link1, loop.link2) == (kind, "coupler", "rocker")
    np.testing.assert_allclose(loop.placement1.translation, [0.5, 0, 0], atol=1e-15)
    np.testing.assert_allclose(loop.placement2.translation, [0, 0, 0.5], atol=1e-15)
    assert stp.mobility(chain).dof == 1
    # A square of unit sides stays a parallelogram: the coupler goes round without turning.
    pose = stp.platform_pose(chain, stp.forward_kinematics(chain, [0.4]).q)
    np.testing.assert_allclose(pose.translation, [0.5 + np.sin(0.4), 0, np.cos(0.4)], atol=1e-12)
    np.testing.assert_allclose(pose.rotation, np.eye(3), atol=1e-12)


def test_the_loop_syntax_of_cassie(tmp_path: Path) -> None:
    """A ball whose child hangs on another joint already: the joint's frame is that of the child."""
    mechanism = read(
        tmp_path,
        link("right-tarsus", "0 0 1 0 0 0"),
        joint("hold", "world", "right-tarsus", "fixed", xyz=""),
        link("right-foot", "0 0 0 0.1 0.2 0.3"),
        link("right-plantar-rod", "0.1 0 0 0 0 0"),
        joint("right-foot-op", "right-tarsus", "right-foot"),
        joint("right-crank-rod-joint", "right-tarsus", "right-plantar-rod"),
        """<joint name="right-plantar-foot-joint" type="ball">
          <pose>0.055 0 -0.008 0 0 0</pose>
          <parent>right-plantar-rod</parent> <child>right-foot</child>
        </joint>""",
        version="1.6",
    )
    (loop,) = mechanism.loops
    assert (loop.name, loop.kind) == ("right-plantar-foot-joint", S)
    np.testing.assert_array_equal(loop.placement2.translation, [0.055, 0, -0.008])
    here = standing(mechanism)
    one, two = here["right-plantar-rod"] * loop.placement1, here["right-foot"] * loop.placement2
    assert np.abs((one.inverse() * two).homogeneous - np.eye(4)).max() < 1e-15
    assert any(note.outcome is Outcome.CHANGED and "loop" in note.text for note in mechanism.notes)


@pytest.mark.parametrize(
    ("kind", "closing", "expected"),
    [
        ("fixed", "", JointKind.FIXED),
        ("prismatic", "", P),
        ("continuous", "", R),
        ("universal", axis2("1 0 0"), JointKind.UNIVERSAL),
        ("revolute2", axis2("1 0 0"), JointKind.UNIVERSAL),
        ("ball", "", S),
    ],
)
def test_kinds_that_close_loops(tmp_path: Path, kind: str, closing: str, expected: JointKind) -> None:
    mechanism = read(
        tmp_path, *TWO, HOLD, joint("j", "a", "b"), joint("k", "a", "b", kind, xyz="0 0 1", content=closing)
    )
    (loop,) = mechanism.loops
    assert (loop.name, loop.kind) == ("k", expected)
    np.testing.assert_array_equal(loop.axis, [0, 0, 1])
    if closing:
        np.testing.assert_array_equal(loop.axis2, [1, 0, 0])


def test_a_screw_stays_in_the_tree(tmp_path: Path) -> None:
    screw = joint("k", "a", "b", "screw", content="<screw_thread_pitch>0.1</screw_thread_pitch>")
    mechanism = read(tmp_path, *TWO, HOLD, joint("j", "a", "b"), screw)
    assert [loop.name for loop in mechanism.loops] == ["j"]


LIFT = (
    link("column", "0 0 0 0 0 0"),
    joint("hold", "world", "column", "fixed", xyz=""),
    link("torso", "0.1 0 0.4 0 0 0"),
    link("spindle", "0.2 0 0.3 0 0 0"),
    joint("lift", "column", "torso", "prismatic", axis="<limit><effort>9</effort></limit>"),
    joint("spin", "column", "spindle", axis="<limit><effort>0</effort></limit>"),
)


@pytest.mark.parametrize("word", THREADS)
@pytest.mark.parametrize("mark", [False, True])
def test_a_screw_closes_a_loop(tmp_path: Path, word: str, *, mark: bool) -> None:
    """Two screws end at one spindle, or the file asks for it: as the lift by hand, whose slide follows the spindle."""
    text, travel = THREADS[word]
    asked = (
        "<physics><simbody><must_be_loop_joint>true</must_be_loop_joint></simbody></physics>" if mark else ""
    )
    screw = joint("k", "torso", "spindle", "screw", content=f"<{word}>{text}</{word}>{asked}")
    twin = "" if mark else screw.replace('"k"', '"m"')
    chain = stp.load(write(tmp_path, sdf(*LIFT, screw, twin)), motors=["lift"], platform="spindle")
    by_hand = stp.load(
        write(tmp_path, lift_by_hand(travel), "lift.urdf"), motors=["lift"], platform="spindle"
    )
    assert "screw that closes a loop unfolded into" in str(chain.report)
    assert stp.mobility(chain).dof == stp.mobility(by_hand).dof == 1
    ours, theirs = (raised(c, 15 * travel) for c in (chain, by_hand))
    np.testing.assert_allclose(ours, theirs, rtol=1e-9)


def test_the_file_may_choose_the_joint_that_closes_a_loop(tmp_path: Path) -> None:
    mark = "<physics><simbody><must_be_loop_joint>true</must_be_loop_joint></simbody></physics>"
    mechanism = read(tmp_path, *TWO, HOLD, joint("j", "a", "b", content=mark), joint("k", "a", "b"))
    assert [loop.name for loop in mechanism.loops] == ["j"]
    assert any("<must_be_loop_joint>" in note.text for note in mechanism.notes)
    alone = read(tmp_path, *TWO, HOLD, joint("j", "a", "b", content=mark))
    assert [x.name for x in alone.joints if x.kind is JointKind.FLOATING] == ["b_floating"]


def test_links_that_hang_on_each_other_float(tmp_path: Path) -> None:
    """A ring of three links without any first one."""
    mechanism = read(
        tmp_path, *TWO, link("c"), joint("ab", "a", "b"), joint("bc", "b", "c"), joint("ca", "c", "a")
    )
    assert [x.name for x in mechanism.joints] == ["a_floating", "ab", "bc"]
    assert [x.name for x in mechanism.loops] == ["ca"]


def test_a_link_may_have_to_float(tmp_path: Path) -> None:
    base = BODY + "<must_be_base_link>1</must_be_base_link>"
    mechanism = read(tmp_path, link("a"), link("b", content=base), HOLD, joint("j", "a", "b"))
    assert [x.name for x in mechanism.joints] == ["b_floating", "hold"]
    assert [x.name for x in mechanism.loops] == ["j"]
