"""What a file says is read, or reported, or refused; nothing is dropped in silence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError, MechanismError, MissingRoleError
from stewart_pin.model.description import JointKind, Report
from stewart_pin.model.formats.reading import read_urdf
from tests.small_urdf import (
    ARM,
    AXIS_Z,
    CLOSED,
    FOUR_BAR,
    INERTIAL,
    MOTOR,
    SQUARE,
    home,
    joint,
    link,
    loop,
    robot,
    write,
)


def test_loops_axes_motors_and_home(tmp_path: Path) -> None:
    swivel = loop(
        "swivel",
        "universal",
        "platform",
        "rocker",
        origin1='xyz="1 2 3" rpy="0.1 0.2 0.3"',
        content='<axis xyz="0 3 4"/><axis2 xyz="2 0 0"/>',
    )
    rod = loop("rod", "distance", "crank", "rocker", content='<length value="0.7"/>')
    mechanism = read_urdf(write(tmp_path, robot(*FOUR_BAR, CLOSED, swivel, rod, home(**SQUARE))))
    hinge, universal, distance = mechanism.loops
    assert (hinge.name, hinge.kind, hinge.link1, hinge.link2) == (
        "hinge", JointKind.REVOLUTE, "platform", "rocker",
    )  # fmt: skip
    np.testing.assert_array_equal(hinge.placement1.translation, [1, 0, 0])
    np.testing.assert_allclose(universal.axis, [0, 0.6, 0.8], atol=1e-16)
    np.testing.assert_array_equal(universal.axis2, [1, 0, 0])
    assert universal.placement2.isIdentity()
    assert (distance.kind, distance.length) == (JointKind.DISTANCE, 0.7)
    assert [joint.name for joint in mechanism.joints if joint.independent] == ["crank_turn"]
    assert mechanism.platform == "platform"
    assert {name: float(value[0]) for name, value in mechanism.home.items()} == {
        name: float(value) for name, value in SQUARE.items()
    }
    assert [(note.subject, note.text) for note in mechanism.notes] == [
        (f"loop '{name}'", "read as URDF+") for name in ("hinge", "swivel", "rod")
    ]


def test_types_have_synonyms(tmp_path: Path) -> None:
    text = robot(
        *FOUR_BAR,
        loop("a", "ball", "platform", "rocker"),
        loop("b", "continuous", "crank", "rocker", content=AXIS_Z),
    )
    kinds = [loop.kind for loop in read_urdf(write(tmp_path, text)).loops]
    assert kinds == [JointKind.SPHERICAL, JointKind.REVOLUTE]


def test_limits_of_round_1e30_stand_for_none(tmp_path: Path) -> None:
    content = '<limit lower="-1" upper="1e30" effort="1e30" velocity="2"/>'
    text = robot(link("base"), link("platform"), joint("a", "base", "platform", content=content))
    (read,) = read_urdf(write(tmp_path, text)).joints
    assert (read.lower, read.upper, read.effort, read.velocity) == (-1, np.inf, np.inf, 2)


def test_a_fixed_joint_needs_no_sense_in_its_axis(tmp_path: Path) -> None:
    # Exporters of CAD programs write this.
    text = robot(*ARM, link("cover"), joint("glue", "arm", "cover", "fixed", axis='<axis xyz="0 0 0"/>'))
    assert stp.load(write(tmp_path, text)).nv == 2


def test_a_zero_inertial_is_a_body_without_mass(tmp_path: Path) -> None:
    zero = INERTIAL.replace('"1"', '"0"')
    chain = stp.load(write(tmp_path, robot(*ARM, link("dot", zero), joint("glue", "arm", "dot", "fixed"))))
    assert chain.mechanism.link("dot").inertia is not None
    assert "body without mass" in str(chain.report)


def test_the_report_names_all_that_was_ignored(tmp_path: Path) -> None:
    decorated = link("shell", f"{INERTIAL}<visual/><visual/><collision/><glow/>")
    settings = '<dynamics damping="0.1"/><safety_controller k_velocity="1"/>'
    text = robot(
        *ARM,
        decorated,
        joint("glue", "arm", "shell", "fixed", content=settings, attributes='dont_collapse="true"'),
        '<material name="red"/>',
        '<transmission name="t"><joint name="shoulder"/></transmission>',
        "<gazebo><plugin><joint>shoulder</joint></plugin></gazebo>",
        '<mujoco><compiler boundmass="1"/></mujoco>',
        '<group_state name="folded" group="all"/>',
        '<end_effector name="gripper" parent_link="arm"/>',
        "<banana/>",
        attributes='version="1.0" colour="red"',
    )
    chain = stp.load(write(tmp_path, text))
    assert isinstance(chain.report, Report) and chain.report.notes == chain.mechanism.notes
    report = str(chain.report)
    for word in (
        "<visual> left out: (line 1) needs a <geometry> (link 'shell', link 'shell')", "<collision> left out",
        "<glow>: unknown tag", "<dynamics>",
        "<safety_controller>", "dont_collapse", "<material name='red'>", "<transmission name='t'>",
        "<gazebo>", "<mujoco>", "folded", "gripper", "<banana>", "'colour'",
    ):  # fmt: skip
        assert word in report, report
    assert "version" not in report
    assert (
        str(stp.load("stewart").report)
        == "kept: read as URDF+ (loop 'leg1_ball', loop 'leg2_ball', loop 'leg3_ball' and 3 more)"
    )


def test_a_report_gathers_equal_findings(tmp_path: Path) -> None:
    shells = [link(f"shell{k}", f"{INERTIAL}<visual/>") for k in range(5)]
    glue = [joint(f"glue{k}", "arm", f"shell{k}", "fixed") for k in range(5)]
    report = str(stp.load(write(tmp_path, robot(*ARM, *shells, *glue))).report)
    assert report == (
        "ignored: <visual> left out: (line 1) needs a <geometry> (link 'shell0', link 'shell1', link 'shell2' and 2 "
        "more)"
    )


def test_limits_that_other_readers_take_differently_are_reported(tmp_path: Path) -> None:
    half = '<limit effort="1" velocity="1" lower="-1"/>'
    spin = '<limit effort="1" velocity="1" lower="-1" upper="1"/>'
    text = robot(
        *ARM,
        link("a"),
        link("b"),
        joint("half", "arm", "a", content=half),
        joint("spin", "arm", "b", "continuous", content=spin),
    )
    chain = stp.load(write(tmp_path, text))
    assert chain.mechanism.joint("half").upper == chain.mechanism.joint("spin").upper == np.inf
    assert "where other readers assume 0 (joint 'half')" in str(chain.report)
    assert "the joint is continuous (joint 'spin')" in str(chain.report)


FOREIGN = {
    "drake": ("<drake:tendon_constraint/>", "<drake:tendon_constraint>"),
    "sdf": ("<gazebo><model><joint><child>arm</child></joint></model></gazebo>", "<gazebo><joint>"),
    "plugin": ("<gazebo><plugin><mimic>elbow</mimic></plugin></gazebo>", "<gazebo><mimic>"),
    "mujoco": ("<mujoco><equality><connect/></equality></mujoco>", "<mujoco><equality>"),
    "in a link": (link("shell", loop("l", "spherical", "arm", "base")), "<loop>"),
    "in a joint": (joint("j", "base", "arm", content='<coupling joint="elbow"/>'), "<coupling>"),
    "link in link": (link("shell", link("inner")), "<link>"),
}


@pytest.mark.parametrize(("tag", "shown"), FOREIGN.values(), ids=FOREIGN)
@pytest.mark.parametrize("declared", [True, False])
def test_loops_in_another_dialect_are_refused(tmp_path: Path, tag: str, shown: str, declared: bool) -> None:
    namespace = 'xmlns:drake="http://drake.mit.edu"' if declared else ""
    with pytest.raises(FileFormatError, match=r"supported: <loop>, .*<loop_joint>") as caught:
        stp.load(write(tmp_path, robot(*ARM, tag, attributes=namespace)))
    assert shown in str(caught.value) and "small.urdf" in str(caught.value)
    assert caught.value.culprit == shown


@pytest.mark.parametrize(
    ("tag", "remedy"),
    [
        (
            "<xacro:include filename='a'/>",
            "xacro refuses the file: (No such file or directory|unbound prefix)",
        ),
        ("<xi:include href='a'/>", "put the included text"),
    ],
)
def test_files_that_are_not_whole_are_refused(tmp_path: Path, tag: str, remedy: str) -> None:
    namespaces = 'xmlns:xacro="http://wiki.ros.org/xacro" xmlns:xi="http://www.w3.org/2001/XInclude"'
    for attributes in (namespaces, ""):
        with pytest.raises(FileFormatError, match=remedy):
            stp.load(write(tmp_path, robot(*ARM, f"<gazebo>{tag}</gazebo>", attributes=attributes)))


def test_a_default_namespace_changes_nothing(tmp_path: Path) -> None:
    # Drake's older robot files carry one.
    text = robot(*FOUR_BAR, CLOSED, home(**SQUARE), attributes='xmlns="http://drake.mit.edu"')
    chain = stp.load(write(tmp_path, text))
    assert (chain.nv, chain.nc, str(chain.report)) == (3, 5, "kept: read as URDF+ (loop 'hinge')")


def test_a_second_parent_is_cut(tmp_path: Path) -> None:
    tip = link("tip", ""), joint("weld", "rocker", "tip", "fixed", origin='xyz="1 0 0"')
    hinge = joint("hinge", "platform", "tip", origin='xyz="1 0 0"')
    chain = stp.load(write(tmp_path, robot(*FOUR_BAR, *tip, home(**SQUARE, hinge="0"), hinge)))
    assert [(cut.name, cut.kind, cut.link1, cut.link2) for cut in chain.loops] == [
        ("hinge", JointKind.REVOLUTE, "platform", "tip")
    ]
    assert (
        str(chain.report) == "changed: cut into a loop: link 'tip' hangs on 'rocker' already (joint 'hinge')"
    )
    assert set(chain.mechanism.home) == set(SQUARE)


def test_joints_of_several_freedoms_are_unfolded(tmp_path: Path) -> None:
    text = robot(
        *(link(name) for name in ("base", "a", "b", "platform")),
        joint("table", "base", "a", "planar"),
        joint("piston", "a", "b", "cylindrical", axis='<axis xyz="0 1 0"/>'),
        joint("cross", "b", "platform", "universal", axis='<axis xyz="1 0 0"/><axis2 xyz="0 0 2"/>'),
    )
    chain = stp.load(write(tmp_path, text), motors=["table_x"])
    assert chain.nv == 7
    np.testing.assert_array_equal(chain.mechanism.joint("cross_2").axis, [0, 0, 1])
    for word in ("planar joint unfolded", "cylindrical joint unfolded", "universal joint unfolded"):
        assert f"changed: {word}" in str(chain.report)


HINGE = '<predecessor link="arm"/><successor link="base"/>'
MISTAKES = {
    "type": (joint("j", "base", "arm", "screw"), "type 'screw'; supported: .*revolute"),
    "universal": (joint("j", "base", "arm", "universal"), "joint 'j' .*needs a <axis2>"),
    "planar motor": (joint("j", "base", "arm", "planar", attributes=MOTOR), "a motor drives one freedom"),
    "no type": ('<joint name="j"><parent link="a"/><child link="b"/></joint>', "lacks 'type'"),
    "no name": ("<link/>", "lacks 'name'"),
    "empty name": ('<link name=""/>', "lacks 'name'"),
    "no parent": ('<joint name="j" type="fixed"><child link="arm"/></joint>', "needs a <parent>"),
    "two parents": (joint("j", "base", "arm", axis='<parent link="arm"/>'), "has 2 <parent>"),
    "two origins": (joint("j", "base", "arm", origin='xyz="1 0 0"/><origin xyz="2 0 0"'), "has 2 <origin>"),
    "quaternion": (joint("j", "base", "arm", origin='quat_wxyz="1 0 0 0"'), "attribute 'quat_wxyz'"),
    "axis spelling": (joint("j", "base", "arm", axis='<axis xzy="0 0 1"/>'), "attribute 'xzy'"),
    "zero axis": (joint("j", "base", "arm", axis='<axis xyz="0 0 0"/>'), "<axis xyz> is of length zero"),
    "flag": (joint("j", "base", "arm", attributes='independent="yes"'), "'true' or 'false', got 'yes'"),
    "mass missing": (link("l", "<inertial><inertia/></inertial>"), "needs a <mass>"),
    "inertia entry": (link("l", INERTIAL.replace('ixy="0"', "")), "lacks 'ixy'"),
    "two inertials": (link("l", INERTIAL * 2), "has 2 <inertial>"),
    "loop type": (loop("l", "floating", "arm", "base"), "type 'floating'; supported: .*universal"),
    "loop axis": (loop("l", "revolute", "arm", "base"), "loop 'l' .*needs a <axis>"),
    "loop axis2": (loop("l", "universal", "arm", "base", content=AXIS_Z), "needs a <axis2>"),
    "loop length": (loop("l", "distance", "arm", "base"), "needs a <length>"),
    "loop child": (loop("l", "spherical", "arm", "base", content="<ratio/>"), "<ratio> of <loop>"),
    "loop end": (f'<loop name="l" type="spherical">{HINGE}<origin xyz="1 0 0"/></loop>', "<origin> of <loop>"),
    "loop attribute": (f'<loop name="l" type="spherical" axis="x">{HINGE}</loop>', "attribute 'axis' of <loop>"),
    "two homes": (home() + home(), "2 <group_state name='home'>"),
    "home value": (home(elbow="up"), "must hold numbers, got 'up'"),
    "home twice": (home(elbow="1").replace("</g", '<joint name="elbow" value="2"/></g'), "stands there twice"),
    "home child": ('<group_state name="home"><chain/></group_state>', "<chain> of <group_state>"),
    "gravity": ("<gravity>0 0 -9.81</gravity>", "the text '0 0 -9.81' .* it may have xyz"),
    "two platforms": ('<end_effector name="platform" parent_link="arm"/>' * 2, "2 <end_effector"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "words"), MISTAKES.values(), ids=MISTAKES)
def test_mistakes_are_named(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(FileFormatError, match=words) as caught:
        stp.load(write(tmp_path, robot(*ARM, text)))
    assert caught.value.culprit and str(tmp_path) in caught.value.path


NUMBERS = (
    "",
    " ",
    "one",
    "1,5",
    "0x10",
    "1_000",
    "nan",
    "inf",
    "-inf",
    "1e400",
    "2e30",
    "1 2",
    "٣",
    "${mass}",
)


@pytest.mark.parametrize("value", NUMBERS)
def test_numbers_are_plain_finite_decimals(tmp_path: Path, value: str) -> None:
    text = robot(*ARM, link("shell", INERTIAL.replace('mass value="1"', f'mass value="{value}"')))
    with pytest.raises(FileFormatError, match=r"link 'shell': <mass"):
        stp.load(write(tmp_path, text))


def test_a_long_value_is_not_repeated_in_full(tmp_path: Path) -> None:
    text = robot(*ARM, joint("j", "base", "arm", origin=f'xyz="{"9 " * 10000}"'))
    with pytest.raises(FileFormatError, match="must hold 3 numbers") as caught:
        stp.load(write(tmp_path, text))
    assert len(str(caught.value)) < 400


def test_another_link_may_be_the_platform(tmp_path: Path) -> None:
    text = robot(*ARM, '<end_effector name="platform" parent_link="arm" group="all"/>')
    chain = stp.load(write(tmp_path, text))
    assert chain.platform == "arm" and str(chain.report) == "nothing was ignored"


def test_the_motors_are_named_when_none_is_marked(tmp_path: Path) -> None:
    chain = stp.load(write(tmp_path, robot(*ARM).replace(MOTOR, "")))
    with pytest.raises(MissingRoleError, match="best guess first: shoulder, elbow"):
        chain.require_motors()


def test_an_inertia_of_no_real_body_is_refused_or_kept_aloud(tmp_path: Path) -> None:
    inertia = '<inertia ixx="1" iyy="1" izz="3" ixy="0" ixz="0" iyz="0"/>'
    path = write(
        tmp_path,
        robot(*[part.replace(INERTIAL, f'<inertial><mass value="1"/>{inertia}</inertial>') for part in ARM]),
    )
    with pytest.raises(MechanismError, match=r"triangle inequality.*leave out odd_inertias=False"):
        stp.load(path, odd_inertias=False)
    chain = stp.load(path)
    assert "triangle inequality" in str(chain.report)
    assert (
        max(np.linalg.eigvalsh(link.inertia.inertia)[-1] for link in chain.mechanism.links if link.inertia)
        == 3
    )


@pytest.mark.parametrize("style", ["5f", "6f", "9f", "4g", "6g"])
@pytest.mark.parametrize("moments", [(0.2, 0.3, 0.5), (0.4, 0.4, 0.0)])
def test_plates_and_rods_of_few_digits_are_bodies(
    moments: tuple[float, ...], style: str, tmp_path: Path, rng: np.random.Generator
) -> None:
    # One moment is the sum of the others: rounding makes it more as often as less.
    for _ in range(3):
        turn = pin.exp3(rng.normal(size=3))
        exact = turn @ np.diag(moments) @ turn.T
        names = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}
        entries = " ".join(f'{name}="{exact[at]:.{style}}"' for name, at in names.items())
        inertial = f'<inertial><mass value="1"/><inertia {entries}/></inertial>'
        chain = stp.load(write(tmp_path, robot(*[part.replace(INERTIAL, inertial) for part in ARM])))
        read = next(link.inertia.inertia for link in chain.mechanism.links if link.inertia)
        off = 0.5 * 10.0 ** -int(style[0])
        np.testing.assert_allclose(read, exact, atol=6 * off)
        # What digits do not explain is no rounding.
        wrong = inertial.replace('ixx="', 'ixx="9')
        path = write(tmp_path, robot(*[part.replace(INERTIAL, wrong) for part in ARM]))
        with pytest.raises(MechanismError, match="triangle inequality"):
            stp.load(path, odd_inertias=False)


def test_the_report_tells_which_inertia_was_moved(tmp_path: Path) -> None:
    plate = '<inertia ixx="0.2001" iyy="0.3001" izz="0.5003" ixy="0" ixz="0" iyz="0"/>'
    parts = [part.replace(INERTIAL, f'<inertial><mass value="1"/>{plate}</inertial>') for part in ARM]
    assert "moments were moved by 3.3e-05" in str(stp.load(write(tmp_path, robot(*parts))).report)


def test_an_axis_may_have_an_rpy_of_zero_that_no_reader_reads(tmp_path: Path) -> None:
    """Files have it; what turns the axis would be lost."""
    parts = [link("base"), link("arm"), joint("j", "base", "arm", axis='<axis xyz="0 1 0" rpy="0 0 0"/>')]
    chain = stp.load(write(tmp_path, robot(*parts)))
    np.testing.assert_array_equal(chain.mechanism.joint("j").axis, [0, 1, 0])
    turned = [part.replace('rpy="0 0 0"', 'rpy="0 0 1.5"') for part in parts]
    with pytest.raises(FileFormatError, match=r"joint 'j': rpy of <axis> .* turns the axis"):
        stp.load(write(tmp_path, robot(*turned)))
