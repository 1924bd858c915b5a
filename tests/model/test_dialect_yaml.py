"""Gepetto's YAML beside a URDF: loops, motors, other joints, and mistakes in it."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError, MechanismError, MissingExtraError, UnsupportedError
from stewart_pin.model.description import JointKind
from tests.model.small_dialects import BALLS, FRAMES, YAML, five_bar, square
from tests.small_urdf import ARM, robot, write


@pytest.mark.parametrize("where", ["beside", "named", "alone"])
@pytest.mark.parametrize("kind", ["3d", "6D"])
def test_gepetto_yaml(tmp_path: Path, where: str, kind: str) -> None:
    path = write(tmp_path, five_bar(), "robot.urdf")
    side_car = write(tmp_path, YAML.format(kind=kind), "loops.yaml" if where == "named" else "robot.yaml")
    chain = {
        "beside": lambda: stp.load(path),
        "named": lambda: stp.load(path, loops=side_car),
        "alone": lambda: stp.load(side_car),
    }[where]()
    (found,) = chain.loops
    assert (found.name, found.kind) == (
        "closedloop1",
        JointKind.SPHERICAL if kind == "3d" else JointKind.FIXED,
    )
    # The frames' links hang on the bodies by fixed joints, so the bodies carry the loop.
    assert (found.link1, found.link2) == ("platform", "far")
    np.testing.assert_array_equal(found.placement2.translation, [-0.5, 0.5, 0])
    assert chain.motors == ("mot1", "mot2")  # the order of the YAML, not of the URDF
    assert stp.mobility(chain).dof == (2 if kind == "3d" else 1)
    assert "kept: read as Gepetto YAML (loop 'closedloop1')" in str(chain.report)
    assert "as 'name_mot' of" in str(chain.report)


def test_gepetto_frames_may_be_moving_links(tmp_path: Path) -> None:
    text = five_bar().replace('name="closedloop1_A" type="fixed"', 'name="closedloop1_A" type="revolute"')
    write(tmp_path, YAML.format(kind="6d"), "robot.yaml")
    chain = stp.load(write(tmp_path, text, "robot.urdf"))
    assert (chain.loops[0].link1, chain.nv) == ("sphere", 5)


def test_gepetto_upgrades_joints(tmp_path: Path) -> None:
    more = "joint_name: [free1, free2, mot2]\njoint_type: [SPHERICAL, UJOINT_ZY, FIXED]\n"
    write(tmp_path, YAML.format(kind="3d").replace(", 'mot2'", "") + more, "robot.yaml")
    chain = stp.load(write(tmp_path, five_bar(), "robot.urdf"), platform="left")
    joints = {each.name: each for each in chain.mechanism.joints}
    assert joints["free1"].kind is JointKind.SPHERICAL and joints["mot2"].kind is JointKind.FIXED
    np.testing.assert_array_equal([joints["free2_1"].axis, joints["free2_2"].axis], [[0, 0, 1], [0, 1, 0]])
    # The first of the two sits where the one joint sat.
    np.testing.assert_array_equal(joints["free2_1"].placement.translation, [1, 0, 0])
    assert (chain.nv, chain.motors) == (1 + 3 + 2, ("mot1",))
    assert "changed: revolute in the URDF, UJOINT_ZY in robot.yaml (joint 'free2')" in str(chain.report)


def test_home_of_a_joint_that_gepetto_makes_another_one(tmp_path: Path) -> None:
    """The angle of the hinge is passed over aloud; what was meant for the ball has to be a quaternion."""
    more = "joint_name: [free1]\njoint_type: [SPHERICAL]\n"
    write(tmp_path, YAML.format(kind="3d") + more, "robot.yaml")
    state = '<group_state name="home"><joint name="free1" value="{}"/></group_state></robot>'

    def load(value: str) -> stp.ClosedChain:
        text = five_bar().replace("</robot>", state.format(value))
        return stp.load(write(tmp_path, text, "robot.urdf"), platform="left")

    said = "ignored: its home in the URDF: that of a revolute joint (joint 'free1')"
    assert said in str(load("0.1").report)
    assert said not in str(load("0 0 0 -1").report)
    with pytest.raises(MechanismError, match="gives joint 'free1' 3 values, it has 4"):
        load("0.1 0.2 0.3")


def test_a_yaml_says_what_a_closing_mate_was(tmp_path: Path) -> None:
    path = write(tmp_path, square(*FRAMES))
    assert "taken for a ball" in str(stp.load(path).report)
    write(tmp_path, "closed_loop: [[closing_pin_1, closing_pin_2]]\ntype: [revolute]\n", "small.yaml")
    chain = stp.load(path)
    assert [(each.name, each.kind) for each in chain.loops] == [("closing_pin", JointKind.REVOLUTE)]
    assert "taken for a ball" not in str(chain.report)


def test_other_yaml_files_beside_a_robot_are_left_alone(tmp_path: Path) -> None:
    write(tmp_path, "controller: {gains: [1, 2]}", "small.yaml")
    assert stp.load(write(tmp_path, robot(*ARM))).nv == 2


def test_of_two_yaml_files_with_loops_the_meant_one_is_to_be_named(tmp_path: Path) -> None:
    path = write(tmp_path, five_bar(), "robot.urdf")
    first = write(tmp_path, YAML.format(kind="3d"), "robot.yaml")
    write(tmp_path, YAML.format(kind="6d"), "robot.yml")
    with pytest.raises(
        FileFormatError, match=r"robot\.yaml and robot\.yml lie beside .* loops='.*robot\.yaml'"
    ):
        stp.load(path)
    assert stp.load(path, loops=first).loops[0].kind is JointKind.SPHERICAL
    other = stp.load(write(tmp_path, square(BALLS["drake"])))
    told = str(stp.export(other, path, format="gepetto"))
    assert "load refuses two: remove it (file 'robot.yml' beside it)" in told and "robot.yaml" not in told
    write(tmp_path, "controller: {gains: [1, 2]}", "robot.yml")  # none of loops
    assert stp.load(path).loops[0].kind is JointKind.SPHERICAL


YAML_MISTAKES = {
    "empty": ("", "the file is empty"),
    "text": ("closed_loop", "must hold keys with lists"),
    "broken": ("closed_loop: [[a, b]", "not well-formed YAML"),
    "alias": ("closed_loop: &a [[x, *a]]", r"aliases \(\*name\) are refused"),
    "twice": ("type: []\ntype: []", "'type' stands there twice"),
    "no list": ("closed_loop: a", "'closed_loop' must hold a list"),
    "nameless": ("closed_loop: [[~a, '']]", "a name is missing"),
    "deep": ("closed_loop: " + "[" * 100_000, "nested too deep"),
    "nested": ("closed_loop: [[[a], b]]", "nested too deep"),
    "other key": ("loops: []", "the key 'loops' is not understood; known: closed_loop"),
    "no type": ("closed_loop: [[mot1, mot2]]", "say '3d' or '6d' for each loop"),
    "one frame": ("closed_loop: [[mot1]]\ntype: [3d]", "must hold pairs of frames"),
    "type": ("closed_loop: [[mot1, mot2]]\ntype: [5d]", "type '5d'; supported: 3d, 6d"),
    "frame": ("closed_loop: [[mot1, nothing]]\ntype: [3d]", "there is no link or joint 'nothing'"),
    "motor": ("name_mot: [mot3]", "'name_mot' names joint 'mot3', which is missing"),
    "motor twice": ("name_mot: [mot1, mot1]", "names 'mot1' twice"),
    "ball motor": ("name_mot: [mot1]\njoint_name: [mot1]\njoint_type: [SPHERICAL]", "has not one freedom"),
    "upgrade": ("joint_name: [mot3]\njoint_type: [FIXED]", "the missing joint 'mot3'"),
    "upgrade type": (
        "joint_name: [mot1]\njoint_type: [UJOINT_ZZ]",
        "type 'UJOINT_ZZ'; supported: .*UJOINT_ZY",
    ),
    "upgrades": ("joint_name: [mot1]", "'joint_name' has 1 entries, 'joint_type' 0"),
    "upgrade twice": ("joint_name: [mot1, mot1]\njoint_type: [FIXED, FIXED]", "names 'mot1' twice"),
}


@pytest.mark.parametrize(("text", "words"), YAML_MISTAKES.values(), ids=YAML_MISTAKES)
def test_mistakes_in_a_yaml_are_named(tmp_path: Path, text: str, words: str) -> None:
    path = write(tmp_path, five_bar(), "robot.urdf")
    with pytest.raises(FileFormatError, match=words):
        stp.load(path, loops=write(tmp_path, text, "loops.yaml"))


def test_side_cars_of_other_kinds_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path, five_bar())
    with pytest.raises(UnsupportedError, match=r"type '\.json' are not supported; supported: \.yaml, \.yml"):
        stp.load(path, loops=write(tmp_path, "{}", "loops.json"))
    with pytest.raises(FileFormatError, match="no such file"):
        stp.load(path, loops=tmp_path / "none.yaml")
    with pytest.raises(UnsupportedError, match="side-car files belong to a URDF"):
        stp.load(write(tmp_path, "<mujoco/>", "a.xml"), loops=write(tmp_path, YAML, "loops.yaml"))


def test_yaml_without_pyyaml_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "yaml", None)
    write(tmp_path, YAML.format(kind="3d"), "robot.yaml")
    with pytest.raises(MissingExtraError, match="yaml"):
        stp.load(write(tmp_path, five_bar(), "robot.urdf"))
