"""Screws, gearboxes and links inside ``<gazebo>``, each against a second telling of the same mechanism."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError, StewartPinError
from stewart_pin.model.formats.reading import read_urdf
from tests.model.lifts import THREADS, lift, lift_by_hand, raised
from tests.model.sdf_reading import standing
from tests.model.small_dialects import TIP, assert_same_motion, open_square
from tests.small_urdf import AXIS_Z, MOTOR, joint, link, loop, robot, write


@pytest.mark.parametrize("word", THREADS)
def test_a_screw_closes_a_loop(tmp_path: Path, word: str) -> None:
    """As the lift by hand, whose slide follows the spindle; the axis in the model's frame is the same here."""
    text, travel = THREADS[word]
    screw = (
        '<gazebo><joint name="k" type="screw"><parent>torso</parent><child>spindle</child>'
        f"<axis><xyz>0 0 1</xyz></axis><{word}>{text}</{word}></joint></gazebo>"
    )
    chain, by_hand = (
        stp.load(write(tmp_path, content, name), motors=["lift"], platform="spindle")
        for name, content in (("one.urdf", lift(more=screw)), ("two.urdf", lift_by_hand(travel)))
    )
    assert "screw that closes a loop unfolded into" in str(chain.report)
    assert stp.mobility(chain).dof == 1
    ours, theirs = (raised(c, 15 * travel) for c in (chain, by_hand))
    np.testing.assert_allclose(ours, theirs, rtol=1e-9)


def test_a_screw_needs_a_thread(tmp_path: Path) -> None:
    screw = (
        '<gazebo><joint name="k" type="screw"><parent>torso</parent><child>spindle</child>'
        "<axis><xyz>0 0 1</xyz></axis></joint></gazebo>"
    )
    with pytest.raises(
        FileFormatError, match=r"'k' of <gazebo> .* screw without a thread; give <screw_thread"
    ):
        stp.load(write(tmp_path, lift(more=screw)))


def test_a_joint_of_a_name_that_the_urdf_has_is_called_otherwise(tmp_path: Path) -> None:
    pin_ = (
        '<gazebo><joint name="lift" type="fixed"><parent>torso</parent><child>column</child></joint></gazebo>'
    )
    chain = stp.load(write(tmp_path, lift(more=pin_)))
    assert [loop.name for loop in chain.loops] == ["lift_of_gazebo"]
    assert "called 'lift_of_gazebo' here (joint 'lift' of <gazebo>)" in str(chain.report)


# ----------------------------------------------------------------------------------------------------
# Links
# ----------------------------------------------------------------------------------------------------

BODY = (
    "<inertial><pose>0.5 0 0 0 0 0</pose><mass>2</mass><inertia><ixx>0.001</ixx><iyy>0.17</iyy><izz>0.17</izz>"
    "<ixy>0</ixy><ixz>0</ixz><iyz>0</iyz></inertia></inertial>"
)


def hinge(name: str, parent: str, child: str, pose: str, xyz: str) -> str:
    return (
        f'<joint name="{name}" type="revolute"><parent>{parent}</parent><child>{child}</child><pose>{pose}</pose>'
        f"<axis><xyz>{xyz}</xyz></axis></joint>"
    )


@pytest.mark.parametrize("is_parent", [True, False])
@pytest.mark.parametrize("later", [True, False], ids=["links after joints", "links before joints"])
def test_a_link_hangs_on_its_first_joint(
    tmp_path: Path, rng: np.random.Generator, *, is_parent: bool, later: bool
) -> None:
    """The rocker of a four-bar is Gazebo's, and the parent of both its joints, or the child, as a robot's is."""
    rocker = f'<link name="rocker"><pose>1 0 0 0 0 1.5707963267948966</pose>{BODY}</link>'
    if is_parent:
        joints = hinge("rocker_turn", "rocker", "base", "1 0 0 0 0 0", "0 0 -1")
        joints += hinge("pin", "rocker", "platform", "1 0 0 0 0 0", "0 0 1")
        ends = ("rocker", "platform")
    else:
        joints = hinge("rocker_turn", "base", "rocker", "0 0 0 0 0 0", "0 0 1")
        joints += hinge("pin", "platform", "rocker", "1 0 0 0 0 0", "0 0 1")
        ends = ("platform", "rocker")
    whole = open_square(loop("pin", "revolute", *ends, origin1=TIP, origin2=TIP, content=AXIS_Z))
    a, b = whole.index('<link name="rocker">'), whole.index('<joint name="crank_turn"')
    c = whole.index('<joint name="rocker_turn"')
    blocks = [f"<gazebo>{rocker}</gazebo>", f"<gazebo>{joints}</gazebo>"]
    text = whole[:a] + whole[b:c] + "".join(blocks[::-1] if later else blocks) + "</robot>"
    chain = stp.load(write(tmp_path, text, "one.urdf"))
    assert_same_motion(chain, stp.load(write(tmp_path, whole)), rng)
    assert "hangs link 'rocker' of <gazebo> on 'base' (joint 'rocker_turn' of <gazebo>)" in str(chain.report)


REVERSED = {
    "revolute": ("<axis><xyz>0.6 0 0.8</xyz></axis>", "<axis><xyz>-0.6 0 -0.8</xyz></axis>", 1),
    "prismatic": ("<axis><xyz>0.6 0 0.8</xyz></axis>", "<axis><xyz>-0.6 0 -0.8</xyz></axis>", 1),
    "screw": (
        "<axis><xyz>0.6 0 0.8</xyz></axis><screw_thread_pitch>0.3</screw_thread_pitch>",
        "<axis><xyz>-0.6 0 -0.8</xyz></axis><screw_thread_pitch>0.3</screw_thread_pitch>",
        1,
    ),
    "universal": (
        "<axis><xyz>1 0 0</xyz></axis><axis2><xyz>0 0.6 0.8</xyz></axis2>",
        "<axis><xyz>0 -0.6 -0.8</xyz></axis><axis2><xyz>-1 0 0</xyz></axis2>",
        2,
    ),
    "fixed": ("", "", 0),
}


@pytest.mark.parametrize("kind", REVERSED)
def test_a_joint_hangs_a_link_from_either_side(tmp_path: Path, kind: str) -> None:
    """R = exp(a α) exp(b β) of the arm in the base is exp(-b β) exp(-a α) of the base in the arm."""
    straight, turned, n = REVERSED[kind]
    in_arm = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.2, 0.5), np.array([0.1, 0.2, -0.3]))
    arm = pin.SE3(pin.rpy.rpyToMatrix(-0.4, 0.8, 0.2), np.array([1.0, -0.5, 0.4]))
    texts = []
    for parent, child, axes, frame in (
        ("base", "arm", straight, in_arm),
        ("arm", "base", turned, arm * in_arm),
    ):
        poses = [
            " ".join(map(repr, [*place.translation.tolist(), *pin.rpy.matrixToRpy(place.rotation).tolist()]))
            for place in (arm, frame)
        ]
        texts.append(
            f'<gazebo><link name="arm"><pose>{poses[0]}</pose>{BODY}</link><joint name="j" type="{kind}">'
            f"<parent>{parent}</parent><child>{child}</child><pose>{poses[1]}</pose>{axes}</joint></gazebo>"
        )
    other = (link("wheel"), joint("w", "base", "wheel"))
    found = [read_urdf(write(tmp_path, robot(link("base"), *other, text))) for text in texts]
    names = {1: ("j",), 2: ("j_1", "j_2"), 0: ()}[n]
    values = dict(zip(names, (0.7, -1.1), strict=False))
    if kind == "screw":
        values["j_slide"] = 0.7 * 0.3 / (2 * np.pi)
        assert [m.couplings[0].polynomial for m in found] == [(0.0, 0.3 / (2 * np.pi))] * 2
    ours, theirs = (standing(m, **values)["arm"] for m in found)
    np.testing.assert_allclose(ours.homogeneous, theirs.homogeneous, atol=1e-14)
    assert kind == "fixed" or np.abs(ours.homogeneous - arm.homogeneous).max() > 0.01
    at_rest = standing(found[1])["arm"]
    np.testing.assert_allclose(at_rest.homogeneous, arm.homogeneous, atol=1e-14)


def test_links_that_nothing_holds_are_left_out(tmp_path: Path) -> None:
    text = (
        f'<gazebo><link name="lamp">{BODY}</link><link name="bulb">{BODY}</link>'
        '<joint name="socket" type="fixed"><parent>lamp</parent><child>bulb</child></joint></gazebo>'
    )
    chain = stp.load(write(tmp_path, lift(more=text)))
    assert chain.nv == 2
    assert "a body of its own in Gazebo, left out (link 'lamp' of <gazebo>, link 'bulb'" in str(chain.report)


def test_faults_of_links_are_named(tmp_path: Path) -> None:
    fixed = '<joint name="j" type="fixed"><parent>column</parent><child>box</child></joint>'
    for content, words in (
        ('<pose relative_to="torso">0 0 0 0 0 0</pose>', r"'box' of <gazebo>: <pose relative_to='torso'>"),
        ("<inertial><mas>1</mas></inertial>", r"<mas> of <inertial> .* is 'mass' meant"),
        ("<kinematic>1</kinematic>", "is <kinematic>"),
    ):
        text = f'<gazebo><link name="box">{content}</link>{fixed}</gazebo>'
        with pytest.raises(StewartPinError, match=words):
            stp.load(write(tmp_path, lift(more=text)))


# ----------------------------------------------------------------------------------------------------
# Gearboxes
# ----------------------------------------------------------------------------------------------------


def gears(*more: str) -> str:
    """Two wheels on plates that are fixed to the base, turned against it; the second turns backwards about x."""
    return robot(
        link("base"),
        link("plate"),
        link("fast"),
        link("slow"),
        joint("mount", "base", "plate", "fixed", origin='xyz="0 0 1" rpy="0 1.5707963267948966 0"'),
        joint("input", "base", "fast", attributes=MOTOR, axis='<axis xyz="1 0 0"/>'),
        joint("output", "plate", "slow", origin='xyz="0 1 0"', axis='<axis xyz="0 0 -1"/>'),
        *more,
    )


def gearbox(body: str, axis: str, axis2: str, flag: str = "") -> str:
    return (
        '<gazebo><joint name="gear" type="gearbox"><parent>fast</parent><child>slow</child>'
        f"<gearbox_reference_body>{body}</gearbox_reference_body><gearbox_ratio>0.25</gearbox_ratio>"
        f"<axis><xyz>{axis}</xyz>{flag}</axis><axis2><xyz>{axis2}</xyz>{flag}</axis2></joint></gazebo>"
    )


IN_MODEL = "<use_parent_model_frame>1</use_parent_model_frame>"


@pytest.mark.parametrize("body", ["base", "plate"])
@pytest.mark.parametrize(
    ("axes", "sign"),
    [
        (("0 0 1", "0 0 1", ""), 1),
        (("0 0 1", "0 0 -1", ""), -1),
        (("1 0 0", "1 0 0", IN_MODEL), 1),
        (("-1 0 0", "1 0 0", IN_MODEL), -1),
    ],
)
def test_a_gearbox_couples_two_joints(
    tmp_path: Path, rng: np.random.Generator, body: str, axes: tuple[str, str, str], sign: int
) -> None:
    """θ2 = -0.25 θ1 about one direction; the output turns backwards about it: output = 0.25 input."""
    by_hand = f'<follower joint="output"/><leader joint="input"/><polynomial value="0 {sign * 0.25}"/>'
    other = gears(f'<coupling name="gear" type="polynomial">{by_hand}</coupling>')
    chain = stp.load(write(tmp_path, gears(gearbox(body, *axes))))
    assert_same_motion(chain, stp.load(write(tmp_path, other, "two.urdf")), rng)
    assert "kept: gearbox: a coupling of two joints" in str(chain.report)


def test_a_gearbox_across_both_joints_couples_nothing(tmp_path: Path) -> None:
    """Both angles about its axes are zero, whatever the joints do: published hands of Atlas have such ones."""
    chain = stp.load(write(tmp_path, gears(gearbox("base", "0 1 0", "0 1 0"))))
    assert stp.mobility(chain).dof == 2
    told = "gearbox left out: joints 'input' and 'output' turn at right angles to its <axis> and <axis2>"
    assert told in str(chain.report)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            gearbox("base", "0 1 0", "0 0 1"),
            r"its <axis> joins 'base' and 'fast'; joint 'input' turns at right",
        ),
        (
            gearbox("base", "0 0 1", "0 0.6 0.8"),
            r"no revolute joint about its <axis2> joins 'base' and 'slow'",
        ),
        (gearbox("slow", "0 0 1", "0 0 1"), r"no revolute joint about its <axis> joins 'slow' and 'fast'"),
        (gearbox("nut", "0 0 1", "0 0 1"), r"'gear' of <gazebo> names the missing link 'nut'"),
        (gearbox("base", "0 0 1", "0 0 1").replace("0.25", "much"), r"<gearbox_ratio> must hold numbers"),
    ],
)
def test_faults_of_gearboxes_are_named(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(FileFormatError, match=words):
        stp.load(write(tmp_path, gears(text)))
