"""The MJCF reader alone: what becomes of each element, and what is refused. MuJoCo as the judge is in the oracles."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError, MechanismError, MissingExtraError
from stewart_pin.model.description import JointKind, Mechanism
from stewart_pin.model.formats.mjcf.reading import read_mjcf
from tests.model.small_mjcf import ARM, BALL, DRIVEN, QPOS, WORKSHOP, mjcf, write

pytest.importorskip("mujoco")


def body(name: str, inside: str = "", **attributes: str) -> str:
    listed = "".join(f' {key}="{value}"' for key, value in attributes.items())
    return f'<body name="{name}"{listed}>{BALL}{inside}</body>'


def hinge(name: str, **attributes: str) -> str:
    listed = "".join(f' {key}="{value}"' for key, value in attributes.items())
    return f'<joint name="{name}"{listed}/>'


HAND = body("hand", hinge("wrist") + '<site name="palm" pos="0.1 0 0"/>', pos="0.5 0 0")
BOTH = ARM % HAND


def read(folder: Path, *sections: str) -> Mechanism:
    return read_mjcf(write(folder, mjcf(*sections)))


def equality(*elements: str) -> str:
    return f"<equality>{''.join(elements)}</equality>"


def actuator(*elements: str) -> str:
    return f"<actuator>{''.join(elements)}</actuator>"


def notes(mechanism: Mechanism) -> str:
    return "\n".join(f"{note.outcome} {note.subject} {note.text}" for note in mechanism.notes)


# --- what other readers of MJCF lose -------------------------------------------------------------------------


def test_every_body_of_the_world_is_kept(tmp_path: Path) -> None:
    found = read(tmp_path, body("a", hinge("ja")) + body("b", hinge("jb")) + body("c", hinge("jc")))
    assert [link.name for link in found.links] == ["world", "a", "b", "c"]
    assert {joint.parent for joint in found.joints} == {"world"}


def test_unnamed_connects_on_one_pair_are_all_kept(tmp_path: Path) -> None:
    pair = '<connect body1="arm" body2="hand" anchor="{} {} 0"/>'
    three = [pair.format(0, 0), pair.format(1, 0), pair.format(0, 1)]
    found = read(tmp_path, BOTH, equality(*three))
    # Two make a hinge; the third point, beside its axis, holds it.
    assert [(loop.name, loop.kind) for loop in found.loops] == [
        ("connect_1", JointKind.REVOLUTE),
        ("connect_3", JointKind.SPHERICAL),
    ]


def test_points_of_a_hinge_printed_with_few_digits_make_a_hinge(tmp_path: Path) -> None:
    """Rigid links could never meet in both points: they are 0.2 m apart on one, and 0.200002 m on the other."""
    sites = '<site name="a" pos="0.4 0 0"/><site name="b" pos="0.6 0 0"/>'
    hand = HAND.replace("<site", '<site name="c" pos="-0.1 0 0"/><site name="d" pos="0.100002 0 0"/><site', 1)
    ties = equality('<connect name="k" site1="a" site2="c"/>', '<connect site1="b" site2="d"/>')
    path = write(
        tmp_path, mjcf(ARM % (sites + hand.replace('"wrist"', '"wrist" axis="1 0 0"')), ties, DRIVEN)
    )
    chain = stp.load(path, platform="hand")
    assert [(loop.name, loop.kind) for loop in chain.loops] == [("k", JointKind.REVOLUTE)]
    assert "its points are 2e-06 m farther apart on one link" in str(chain.report)


def test_the_same_connect_twice_stays_two_loops(tmp_path: Path) -> None:
    pair = '<connect body1="arm" body2="hand" anchor="0.2 0 0"/>'
    found = read(tmp_path, BOTH, equality(pair, pair))
    assert [loop.kind for loop in found.loops] == [JointKind.SPHERICAL] * 2


def test_names_and_order_of_constraints_are_those_of_the_file(tmp_path: Path) -> None:
    ties = (
        '<weld name="z" body1="arm" body2="hand"/>',
        '<joint name="m" joint1="wrist" joint2="motor"/>',
        '<connect name="a" body1="hand" anchor="0 0 0"/>',
        '<weld name="b" body1="hand"/>',
    )
    found = read(tmp_path, BOTH, equality(*ties))
    assert [loop.name for loop in found.loops] == ["z", "a", "b"]
    assert [loop.link2 for loop in found.loops] == ["hand", "world", "world"]
    assert [coupling.name for coupling in found.couplings] == ["m"]


def test_inactive_constraints_are_left_out_aloud(tmp_path: Path) -> None:
    ties = (
        '<weld name="off" body1="arm" body2="hand" active="false"/>',
        '<joint name="idle" joint1="wrist" active="false"/>',
    )
    found = read(tmp_path, BOTH, equality(*ties))
    assert not found.loops and not found.couplings
    assert "weld 'off' left out: it is not active" in notes(found)
    assert "joint 'idle' left out" in notes(found)


@pytest.mark.parametrize("flag", ["equality", "constraint"])
def test_disabled_constraints_are_left_out_aloud(tmp_path: Path, flag: str) -> None:
    option = f'<option><flag {flag}="disable"/></option>'
    found = read(tmp_path, BOTH, equality('<weld name="w" body1="arm"/>'), option)
    assert not found.loops and "weld 'w' left out: the file disables" in notes(found)


def test_unknown_sites_and_bodies_are_errors(tmp_path: Path) -> None:
    for tie in ('<connect site1="palm" site2="plam"/>', '<weld body1="plam"/>', '<joint joint1="plam"/>'):
        with pytest.raises(FileFormatError, match=r"small\.xml: MuJoCo refuses the file: .*plam"):
            read(tmp_path, BOTH, equality(tie))


def test_sites_in_the_world_close_loops_too(tmp_path: Path) -> None:
    anchor = '<site name="anchor" pos="0 0 1"/>'
    found = read(tmp_path, anchor + BOTH, equality('<connect name="c" site1="palm" site2="anchor"/>'))
    (loop,) = found.loops
    assert (loop.link1, loop.link2) == ("hand", "world")
    np.testing.assert_array_equal(loop.placement1.translation, [0.1, 0, 0])
    np.testing.assert_array_equal(loop.placement2.translation, [0, 0, 1])
    # They are frames of the loop, and no links.
    assert [link.name for link in found.links] == ["world", "arm", "hand"]


# --- coordinates ---------------------------------------------------------------------------------------------


def test_couplings_count_from_the_drawn_configuration(tmp_path: Path) -> None:
    """MuJoCo: y - 0.5 = 1 + 2 (x + 0.25) + 4 (x + 0.25)², so y = 2.25 + 4 x + 4 x²; all exact in binary."""
    arm = body("arm", hinge("x", ref="-0.25") + body("hand", hinge("y", ref="0.5")))
    found = read(tmp_path, arm, equality('<joint name="g" joint1="y" joint2="x" polycoef="1 2 4 0 0"/>'))
    (gear,) = found.couplings
    assert (gear.joint1, gear.joint2, gear.polynomial) == ("y", "x", (2.25, 4.0, 4.0))


def test_a_joint_held_by_itself(tmp_path: Path) -> None:
    arm = body("arm", hinge("x", ref="0.5"))
    (held,) = read(tmp_path, arm, equality('<joint name="h" joint1="x" polycoef="0.25 3 0 0 0"/>')).couplings
    assert (held.joint1, held.joint2, held.polynomial) == ("x", None, (0.75,))


def test_sums_of_joints_become_couplings(tmp_path: Path) -> None:
    """2 wrist - 4 motor = 6 gives wrist = 3 + 2 motor."""
    sums = '<tendon><fixed name="s"><joint joint="wrist" coef="2"/><joint joint="motor" coef="-4"/></fixed></tendon>'
    found = read(tmp_path, BOTH, sums, equality('<tendon name="d" tendon1="s" polycoef="6 0 0 0 0"/>'))
    (gear,) = found.couplings
    assert (gear.joint1, gear.joint2, gear.polynomial) == ("wrist", "motor", (3.0, 2.0))


TENDONS = {
    "three joints": '<fixed name="t"><joint joint="motor" coef="1"/><joint joint="wrist" coef="1"/>'
    '<joint joint="third" coef="1"/></fixed>',
    "three sites": '<spatial name="t"><site site="palm"/><site site="anchor"/><site site="tip"/></spatial>',
    "pulley": '<spatial name="t"><site site="palm"/><site site="anchor"/><pulley divisor="2"/>'
    '<site site="palm"/><site site="tip"/></spatial>',
    "no coefficient": '<fixed name="t"><joint joint="motor" coef="0"/></fixed>',
}


@pytest.mark.parametrize("tendon", TENDONS.values(), ids=TENDONS)
def test_other_tendon_constraints_are_refused_by_name(tmp_path: Path, tendon: str) -> None:
    world = '<site name="anchor"/><site name="tip" pos="0 1 0"/>' + BOTH + body("c", hinge("third"))
    with pytest.raises(FileFormatError, match=r"<tendon> 'hold': .*remove it") as caught:
        read(tmp_path, world, f"<tendon>{tendon}</tendon>", equality('<tendon name="hold" tendon1="t"/>'))
    assert caught.value.culprit == "hold"


def test_two_tendons_are_refused(tmp_path: Path) -> None:
    tendons = "".join(
        f'<fixed name="{joint}"><joint joint="{joint}" coef="1"/></fixed>' for joint in ("motor", "wrist")
    )
    tie = '<tendon name="hold" tendon1="motor" tendon2="wrist"/>'
    with pytest.raises(FileFormatError, match=r"'hold': .*without a second tendon"):
        read(tmp_path, BOTH, f"<tendon>{tendons}</tendon>", equality(tie))


def test_limits_keep_their_side_and_their_switch(tmp_path: Path) -> None:
    free = hinge("b", axis="0 1 0", range="-1 2", limited="false")
    arm = body(
        "arm",
        hinge("a", range="-1 2")
        + free
        + hinge("c", axis="1 0 0", range="-1e10 2")
        + hinge("d", axis="1 1 0", range="-3 1e10"),
    )
    limits = {joint.name: (joint.lower, joint.upper) for joint in read(tmp_path, arm).joints}
    assert limits == {"a": (-1, 2), "b": (-np.inf, np.inf), "c": (-np.inf, 2), "d": (-3, np.inf)}
    off = '<option><flag limit="disable"/></option>'
    found = read(tmp_path, arm, off)
    assert {joint.upper for joint in found.joints} == {np.inf}
    assert "joint 'a' its limits: the file disables all limits" in notes(found)


def test_limits_of_balls_are_named(tmp_path: Path) -> None:
    found = read(tmp_path, body("arm", '<joint name="b" type="ball" range="0 0.5"/>'))
    assert "ignored joint 'b' the cone of 0.5 rad" in notes(found)


def test_gravity_is_that_of_the_file(tmp_path: Path) -> None:
    path = write(tmp_path, mjcf(BOTH, '<option gravity="1 2 3"/>', DRIVEN))
    np.testing.assert_array_equal(stp.load(path, platform="hand").gravity, [1, 2, 3])
    np.testing.assert_array_equal(stp.load(path, platform="hand", gravity=(0, 0, -1)).gravity, [0, 0, -1])
    path = write(tmp_path, mjcf(BOTH, '<option gravity="1 2 3"><flag gravity="disable"/></option>', DRIVEN))
    np.testing.assert_array_equal(stp.load(path, platform="hand").gravity, [0, 0, 0])


# --- motors --------------------------------------------------------------------------------------------------


def test_motors_stand_in_the_order_of_the_actuators(tmp_path: Path) -> None:
    arm = body("arm", hinge("a") + hinge("b", axis="0 1 0") + hinge("c", axis="1 0 0"))
    drives = actuator('<motor joint="c"/>', '<position joint="a" kp="3"/>', '<velocity joint="b" kv="3"/>')
    found = read(tmp_path, arm, drives)
    assert [joint.name for joint in found.joints if joint.independent] == ["c", "a", "b"]
    assert "its gains and dynamics" in notes(found)


EFFORTS = {
    "force": ('<motor joint="motor" forcerange="-3 3"/>', 3),
    "gear": ('<motor joint="motor" forcerange="-3 3" gear="-2"/>', 6),
    "control": ('<motor joint="motor" ctrlrange="-0.5 0.5" gear="8"/>', 4),
    "gain": ('<general joint="motor" gainprm="3" ctrlrange="-2 2"/>', 6),
    "smaller of both": ('<motor joint="motor" ctrlrange="-2 2" forcerange="-1 1"/>', 1),
    "angle of a servo": ('<position joint="motor" kp="5" ctrlrange="-1 1"/>', np.inf),
    "none": ('<motor joint="motor"/>', np.inf),
    "two": ('<motor joint="motor" forcerange="-1 1"/><motor joint="motor" forcerange="-2 2"/>', 3),
    "uneven": ('<motor joint="motor" forcerange="-1 4"/>', 1),
    "one side": ('<motor joint="motor" forcerange="0 4"/>', np.inf),
}


@pytest.mark.parametrize(("drive", "effort"), EFFORTS.values(), ids=EFFORTS)
def test_largest_efforts(tmp_path: Path, drive: str, effort: float) -> None:
    found = read(tmp_path, BOTH, actuator(drive))
    assert found.joint("motor").effort == effort
    assert found.joint("motor").independent and not found.joint("wrist").independent
    if "forcerange" in drive and "-1 4" in drive:
        assert "forcerange -1 to 4: efforts are limited alike" in notes(found)
    if "0 4" in drive:
        assert "forcerange 0 to 4: effort limits of one side are not kept" in notes(found)


def test_the_joint_itself_may_limit_the_effort(tmp_path: Path) -> None:
    arm = body("arm", hinge("a", actuatorfrcrange="-2 2"))
    assert read(tmp_path, arm, actuator('<motor joint="a" forcerange="-3 3"/>')).joint("a").effort == 2
    assert read(tmp_path, arm).joint("a").effort == 2


NO_MOTORS = {
    "tendon": ('<motor name="m" tendon="t"/>', "acts on a tendon"),
    "site": ('<motor name="m" site="palm"/>', "acts on a site"),
    "body": ('<adhesion name="m" body="hand" ctrlrange="0 1"/>', "acts on a body"),
    "ball": ('<motor name="m" joint="ball"/>', "acts on joint 'ball', which has not one freedom"),
    "brake": ('<damper name="m" joint="motor" kv="2" ctrlrange="0 1"/>', "a brake"),
    "no gear": ('<motor name="m" joint="motor" gear="0"/>', "gear 0"),
}


@pytest.mark.parametrize(("drive", "words"), NO_MOTORS.values(), ids=NO_MOTORS)
def test_actuators_that_are_no_motors_are_named(tmp_path: Path, drive: str, words: str) -> None:
    tendon = '<tendon><fixed name="t"><joint joint="wrist" coef="1"/></fixed></tendon>'
    world = BOTH + body("c", '<joint type="ball" name="ball"/>')
    found = read(tmp_path, world, tendon, actuator(drive))
    assert not any(joint.independent for joint in found.joints)
    assert f"ignored actuator 'm' {words}" in notes(found)


@pytest.mark.parametrize("option", ['<flag actuation="disable"/>', 'actuatorgroupdisable="2"'])
def test_disabled_actuators_are_no_motors(tmp_path: Path, option: str) -> None:
    section = f"<option>{option}</option>" if option.startswith("<") else f"<option {option}/>"
    drives = actuator(
        '<motor name="m" joint="motor" group="2"/>', '<motor name="n" joint="wrist" group="1"/>'
    )
    found = read(tmp_path, BOTH, drives, section)
    assert "actuator 'm' the file disables it: no motor" in notes(found)
    assert found.joint("wrist").independent == ("group" in option)


# --- platform, home, names -----------------------------------------------------------------------------------


def test_the_platform_is_the_body_or_site_of_that_name(tmp_path: Path) -> None:
    assert read(tmp_path, BOTH).platform is None
    assert read(tmp_path, BOTH.replace('"palm"', '"platform"')).platform == "platform"
    found = read(tmp_path, BOTH.replace('"hand"', '"platform"').replace('"palm"', '"platform"'))
    assert found.platform == "platform"
    assert {"platform", "platform_site"} <= {link.name for link in found.links}


def test_a_platform_may_close_a_loop(tmp_path: Path) -> None:
    world = '<site name="anchor" pos="0 0 1"/>' + BOTH.replace('"palm"', '"platform"')
    found = read(tmp_path, world, equality('<connect site1="platform" site2="anchor"/>'))
    assert found.platform == "platform" and found.loops[0].link1 == "hand"


def test_a_missing_platform_lists_sites_too(tmp_path: Path) -> None:
    path = write(tmp_path, mjcf(BOTH, DRIVEN))
    with pytest.raises(MechanismError, match=r"candidates are: .*hand.*palm"):
        stp.load(path)
    assert stp.load(path, platform="palm").platform == "palm"


def test_parts_without_names_get_some(tmp_path: Path) -> None:
    world = f"<body><joint/><joint axis='0 1 0'/>{BALL}<body>{BALL}</body></body><body name='body_1'>{BALL}</body>"
    found = read(tmp_path, world)
    # One link between the two joints; 'body_1' is taken.
    assert [link.name for link in found.links if link.inertia] == ["body_1_2", "body_2", "body_1"]
    assert [joint.name for joint in found.joints if joint.has_axis] == ["body_1_2_joint", "body_1_2_joint_2"]
    stp.load(tmp_path / "small.xml", motors=["body_1_2_joint"], platform="body_2")


KEYS = '<keyframe><key name="{}" qpos="0.1 0.2"/><key name="{}" qpos="0.3 0.4"/></keyframe>'


@pytest.mark.parametrize(("names", "home"), [(("a", "home"), [0.3, 0.4]), (("a", "b"), [0.1, 0.2])])
def test_home_is_the_key_of_that_name_or_the_first(tmp_path: Path, names: tuple, home: list) -> None:
    path = write(tmp_path, mjcf(BOTH, DRIVEN, KEYS.format(*names)))
    chain = stp.load(path, platform="hand")
    np.testing.assert_array_equal(chain.q_home, home)
    assert "only one keyframe is home" in str(chain.report)
    assert ("none is called 'home'" in str(chain.report)) == ("home" not in names)


def test_home_without_keys_is_the_drawn_configuration(tmp_path: Path) -> None:
    arm = body("arm", hinge("a", ref="0.3") + hinge("b", axis="0 1 0", ref="0.5", range="0.7 1"))
    chain = stp.load(write(tmp_path, mjcf(arm, actuator('<motor joint="a"/>'))), platform="arm")
    # b is drawn beyond its range, so it stands in the middle of that.
    np.testing.assert_allclose(chain.q_home, [0.3, 0.85], rtol=0, atol=1e-15)
    assert "moves joint 'b' by 0.35" in str(chain.report)


def test_a_home_with_open_loops_is_closed_aloud(tmp_path: Path) -> None:
    """MuJoCo's loops are soft, so its keyframes leave gaps."""
    world = '<site name="anchor" pos="0.55 0 0.05"/>' + BOTH
    tie = equality('<connect site1="palm" site2="anchor"/>')
    hands = world.replace('name="wrist"', 'name="wrist" axis="0 1 0"')
    path = write(tmp_path, mjcf(hands, tie, DRIVEN))
    chain = stp.load(path, platform="hand")
    assert np.abs(stp.loop_gap(chain, chain.q_home)).max() < 1e-12
    assert "closing them moves joint" in str(chain.report)


def test_mocap_bodies_stand_where_the_keyframe_puts_them(tmp_path: Path) -> None:
    world = body("arm", hinge("a")) + f'<body name="target" mocap="true" pos="1 2 3">{BALL}</body>'
    found = read(tmp_path, world)
    np.testing.assert_array_equal(found.joints[-1].placement.translation, [1, 2, 3])
    assert "changed body 'target' a mocap body" in notes(found)
    found = read(tmp_path, world, '<keyframe><key qpos="0" mpos="4 5 6"/></keyframe>')
    np.testing.assert_array_equal(found.joints[-1].placement.translation, [4, 5, 6])


def test_what_acts_on_the_motion_is_named_with_its_value(tmp_path: Path) -> None:
    said = notes(read_mjcf(write(tmp_path, WORKSHOP % ("", QPOS))))
    for words in (
        "joint 'crank' armature 0.05",
        "joint 'crank' damping 0.4 0 0",
        "joint 'crank' stiffness 3 0 0 about 0.349066",
        "joint 'coupler_joint' frictionloss 0.2",
        "body 'block' gravcomp 0.5",
        "<option> density 1.2, viscosity 0",
        "actuator 'pull' acts on a tendon",
        "body 'hand' a mocap body",
        "<geom> shapes give bodies their inertia",
    ):
        assert words in said, words


# --- what is refused -----------------------------------------------------------------------------------------

REFUSED = {
    "another root": ("<mujocoinclude/>", "<mujocoinclude>"),
    "unknown tag": (mjcf(BOTH, "<springs/>"), "unrecognized element"),
    "unknown attribute": (mjcf(BOTH.replace("axis=", "achse=")), "unrecognized attribute"),
    "no mass": (mjcf('<body name="a"><joint/></body>'), "mass and inertia of moving bodies"),
    "two names": (mjcf(BOTH + BOTH), "repeated name 'arm'"),
    "not a number": (mjcf(BOTH.replace("0.5 0 0", "0 NaN 0")), r"pos of <body> \(line 1\) holds 'nan'"),
    "overflow": (mjcf(BOTH.replace("0.5 0 0", "0 1e40 0")), "'body_pos' that are not finite"),
    "deformable": (mjcf('<flexcomp type="grid" count="3 3 1" name="cloth"/>'), "<flexcomp>.*deformable"),
    "replicas": (mjcf(f'<replicate count="30000">{BOTH}</replicate>'), "more than 20000 elements"),
    "nested replicas": (
        mjcf(f'<replicate count="300"><replicate count="300">{BOTH}</replicate></replicate>'),
        "more than 20000 elements",
    ),
    "height field": (
        mjcf(BOTH, '<asset><hfield name="h" nrow="90000" ncol="90000" size="1 1 1 1"/></asset>'),
        "more than 4000000 cells",
    ),
    "fine mesh": (
        mjcf(BOTH, '<asset><mesh name="m" builtin="supersphere" params="900 1 1"/></asset>'),
        "resolution above 200",
    ),
    "absent include": (mjcf(BOTH, '<include file="nowhere.xml"/>'), "nowhere.xml"),
    "itself": (mjcf(BOTH, '<include file="small.xml"/>'), "already included"),
    "absent mesh": (
        mjcf(
            '<body name="a"><joint/><geom type="mesh" mesh="m"/></body>',
            '<asset><mesh name="m" file="nowhere.stl"/></asset>',
        ),
        "nowhere.stl.*give it an <inertial>",
    ),
    "document type": ("<!DOCTYPE mujoco []>" + mjcf(BOTH), "<!DOCTYPE"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "words"), REFUSED.values(), ids=REFUSED)
def test_refusals_name_the_file_and_the_fault(tmp_path: Path, text: str, words: str) -> None:
    path = write(tmp_path, text)
    start = time.perf_counter()
    with pytest.raises(FileFormatError, match=words) as caught:
        stp.load(path)
    assert str(path) in str(caught.value)
    # What is refused would take MuJoCo minutes, or all memory.
    assert time.perf_counter() - start < 2.0


def test_included_files_are_searched_as_well(tmp_path: Path) -> None:
    write(tmp_path, '<!DOCTYPE a [<!ENTITY b "c">]><mujocoinclude/>', "part.xml")
    with pytest.raises(FileFormatError, match=r"part\.xml: a document type declaration"):
        read(tmp_path, BOTH, '<include file="part.xml"/>')
    write(tmp_path, f"<mujocoinclude>{BOTH}</mujocoinclude>", "part.xml")
    assert read(tmp_path, '<include file="part.xml"/>').link("hand").inertia is not None


def test_warnings_of_the_compiler_are_in_the_report(tmp_path: Path) -> None:
    twice = body("arm", hinge("a") + hinge("b"))
    assert "MuJoCo warns: Inertia matrix is too close to singular" in notes(read(tmp_path, twice))


def test_attached_models_are_read_where_they_stand(tmp_path: Path) -> None:
    mesh = '<asset><mesh name="m" file="no.stl"/></asset>'
    part = f'<body name="tool" pos="0 0 1">{hinge("turn")}{BALL}<geom type="mesh" mesh="m"/></body>'
    write(tmp_path, mjcf(part, mesh), "part.xml")
    hand = body(
        "hand", hinge("wrist") + '<frame pos="0 2 0"><attach model="p" body="tool" prefix="a_"/></frame>'
    )
    found = read(tmp_path, ARM % hand, '<asset><model name="p" file="part.xml"/></asset>')
    turn = found.joint("a_turn")
    assert (turn.parent, turn.child) == ("hand", "a_tool")
    np.testing.assert_array_equal(turn.placement.translation, [0, 2, 1])


def test_a_loop_of_one_body_is_refused(tmp_path: Path) -> None:
    sites = '<site name="a"/><site name="b" pos="0 0 1"/>'
    path = write(tmp_path, mjcf(ARM % sites, equality('<connect name="knot" site1="a" site2="b"/>'), DRIVEN))
    with pytest.raises(MechanismError, match="loop 'knot' joins link 'arm' to itself"):
        stp.load(path, platform="arm")


SIZES = ('memory="900T"', 'nkey="2000000000"', 'nuserdata="2000000000"', 'nuser_jnt="2000000000"')


@pytest.mark.parametrize("size", SIZES)
def test_memory_that_a_file_asks_for_is_not_set_aside(tmp_path: Path, size: str) -> None:
    assert read(tmp_path, BOTH, f"<size {size}/>").link("hand").inertia is not None


def test_files_without_weight_need_not_exist(tmp_path: Path) -> None:
    """Meshes, pictures and height fields that no inertia depends on; the arm's inertia stands in the file."""
    assets = (
        '<asset><mesh name="m" file="no.stl"/><texture name="t" type="2d" file="no.png"/>'
        '<material name="t" texture="t"/><hfield name="h" file="no.png" size="1 1 1 1"/>'
        '<mesh name="light" file="no.obj"/></asset>'
    )
    inside = '<geom type="mesh" mesh="m" material="t"/><geom name="g" type="mesh" mesh="m"/>'
    ground = '<geom type="hfield" hfield="h"/><geom type="mesh" mesh="m" name="f"/>'
    shapes = '<geom size="0.1"/><geom type="mesh" mesh="light" mass="0"/>'
    round_body = f'<body name="round"><joint name="r"/>{shapes}</body>'
    pair = '<contact><pair geom1="g" geom2="f"/></contact>'
    found = read(tmp_path, ground + ARM % inside + round_body, assets, pair)
    assert found.link("arm").inertia.mass == 1.3
    # A ball of water of radius 0.1 m.
    np.testing.assert_allclose(found.link("round").inertia.mass, 4 / 3 * np.pi, rtol=1e-12)


def test_without_mujoco_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtraError, match=r"stewart_pin\[mjcf\]"):
        stp.load(write(tmp_path, mjcf(BOTH)))


def test_nothing_is_written_beside_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """MuJoCo keeps a log of its warnings in the working directory."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileFormatError):
        read(tmp_path, BOTH.replace("0.5 0 0", "0 nan 0"))
    assert [path.name for path in tmp_path.iterdir()] == ["small.xml"]
