"""SDFormat: where links and joints stand, which joints close loops, and what becomes of everything else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError, MechanismError, StewartPinError, UnsupportedError
from stewart_pin.model.description import JointKind, Mechanism, Outcome
from stewart_pin.model.formats.sdf import read_sdf
from stewart_pin.model.tree import build_tree, link_frame
from stewart_pin.model.validation import validate
from tests.small_sdf import BODY, HOLD, TWO, axis2, frame, joint, link, sdf, write

R, P, S = JointKind.REVOLUTE, JointKind.PRISMATIC, JointKind.SPHERICAL


def read(folder: Path, *parts: str, version: str = "1.9", attributes: str = "") -> Mechanism:
    mechanism = read_sdf(write(folder, sdf(*parts, version=version, attributes=attributes)))
    validate(mechanism)
    return mechanism


def standing(mechanism: Mechanism, **values: float) -> dict[str, pin.SE3]:
    """Placements of all links in the world, at home but for the values given."""
    model = build_tree(mechanism, (0, 0, -9.81))
    data, q = pin.Data(model), pin.neutral(model)
    for name, value in {**mechanism.home, **values}.items():
        entry = model.joints[model.getJointId(name)]
        q[entry.idx_q : entry.idx_q + entry.nq] = value
    pin.framesForwardKinematics(model, data, q)
    return {link.name: data.oMf[link_frame(model, link.name)] for link in mechanism.links}


def position(mechanism: Mechanism, link: str, **values: float) -> np.ndarray:
    return np.round(standing(mechanism, **values)[link].translation, 12) + 0.0


# --- poses ------------------------------------------------------------------------------------------------------


def test_links_stand_in_the_model_and_the_model_in_the_world(tmp_path: Path) -> None:
    quarter = f"0 0 0 0 0 {np.pi / 2!r}"
    mechanism = read(tmp_path, f"<pose>10{quarter[1:]}</pose>", link("a", "1 2 3 0 0 0"))
    np.testing.assert_array_equal(position(mechanism, "a"), [8, 1, 3])
    (free,) = mechanism.joints
    assert (free.kind, free.parent, free.child) == (JointKind.FLOATING, "world", "a")


def test_a_joint_stands_in_its_child_link(tmp_path: Path) -> None:
    """The hinge is 1 m to the left of the link: a quarter turn brings the link from x = 3 to (2, 1)."""
    mechanism = read(
        tmp_path,
        link("a"),
        link("b", "3 0 0 0 0 0"),
        HOLD,
        joint("j", "a", "b", pose="-1 0 0 0 0 0"),
    )
    np.testing.assert_array_equal(position(mechanism, "b"), [3, 0, 0])
    np.testing.assert_array_equal(position(mechanism, "b", j=np.pi / 2), [2, 1, 0])


def test_a_pose_relative_to_another_frame(tmp_path: Path) -> None:
    """The hinge stands 1 m above the parent link: half a turn about y brings (3, 0, 0) to (-3, 0, 2)."""
    mechanism = read(
        tmp_path,
        link("a"),
        link("b", "3 0 0 0 0 0"),
        HOLD,
        joint("j", "a", "b", pose="0 0 1 0 0 0", relative_to="a", xyz="0 1 0"),
    )
    np.testing.assert_array_equal(position(mechanism, "b", j=np.pi), [-3, 0, 2])


@pytest.mark.parametrize(
    ("version", "axis", "expressed_in", "expected"),
    [
        # The child is turned by a quarter turn about z: its x axis is the model's y axis.
        ("1.4", "", "", [1, 0, 0]),
        ("1.6", "", "", [0, 1, 0]),
        ("1.6", "<use_parent_model_frame>true</use_parent_model_frame>", "", [1, 0, 0]),
        ("1.6", "<use_parent_model_frame>0</use_parent_model_frame>", "", [0, 1, 0]),
        ("1.7", "", "", [0, 1, 0]),
        ("1.7", "", "__model__", [1, 0, 0]),
        ("1.7", "", "a", [0, 0, 1]),
    ],
)
def test_where_an_axis_points(
    tmp_path: Path, version: str, axis: str, expressed_in: str, expected: list
) -> None:
    mechanism = read(
        tmp_path,
        link("a", f"0 0 0 0 {-np.pi / 2!r} 0"),  # its x axis is the model's z axis
        link("b", f"0 0 0 0 0 {np.pi / 2!r}"),
        HOLD,
        joint("j", "a", "b", "prismatic", xyz="1 0 0", axis=axis, expressed_in=expressed_in),
        version=version,
    )
    np.testing.assert_array_equal(position(mechanism, "b", j=1.0), expected)


def test_a_hinge_turned_in_its_link_has_another_axis(tmp_path: Path) -> None:
    """The hinge's z axis, turned by a quarter turn about x, is the link's -y axis; a slide may stand anywhere."""
    turned = f"0 0 0 {np.pi / 2!r} 0 0"
    mechanism = read(
        tmp_path,
        link("a"),
        link("b", "0 0 1 0 0 0"),
        link("c", "0 0 2 0 0 0"),
        HOLD,
        joint("j", "a", "b", pose=turned),
        joint("k", "a", "c", "prismatic", pose="5 6 7" + turned[5:]),
    )
    np.testing.assert_allclose(mechanism.joint("j").axis, [0, -1, 0], atol=1e-15)
    np.testing.assert_array_equal(position(mechanism, "c", k=0.5), [0, -0.5, 2])
    assert len(mechanism.links) == 4


def test_angles_in_degrees_and_quaternions(tmp_path: Path) -> None:
    """A third of a turn about (1, 1, 1) takes x to y; 90 degrees about z does as well."""
    poses = {
        "a": '<pose rotation_format="quat_xyzw">0 0 0 2 2 2 2</pose>',
        "b": '<pose degrees="true">0 0 0 0 0 90</pose>',
    }
    here = standing(read(tmp_path, *(f'<link name="{name}">{pose}</link>' for name, pose in poses.items())))
    for name in poses:
        np.testing.assert_allclose(here[name].rotation[:, 0], [0, 1, 0], atol=1e-15)


def test_the_pose_of_a_model_may_be_that_of_a_frame_in_it(tmp_path: Path) -> None:
    """The tip, 1 m beside the link, is placed at (5, 0, 0), turned half round: the link is at (6, 0, 0)."""
    mechanism = read(
        tmp_path,
        f"<pose>5 0 0 0 0 {np.pi!r}</pose>",
        link("a"),
        frame("tip", "1 0 0 0 0 0", attached_to="a"),
        attributes='placement_frame="tip"',
    )
    np.testing.assert_array_equal(position(mechanism, "a"), [6, 0, 0])
    np.testing.assert_array_equal(position(mechanism, "tip"), [5, 0, 0])


@pytest.mark.parametrize(("attributes", "carrier"), [("", "a"), ('canonical_link="b"', "b")])
def test_the_frame_of_the_model_goes_with_its_canonical_link(
    tmp_path: Path, attributes: str, carrier: str
) -> None:
    mechanism = read(
        tmp_path, link("a"), link("b", "0 0 1 0 0 0"), frame("f", "1 2 3 0 0 0"), attributes=attributes
    )
    assert mechanism.joint("f_frame").parent == carrier
    np.testing.assert_array_equal(position(mechanism, "f"), [1, 2, 3])


def test_frames_may_be_the_platform(tmp_path: Path) -> None:
    mechanism = read(
        tmp_path,
        link("a", "0 0 1 0 0 0"),
        joint("j", "world", "a"),
        frame("tool", "0.5 0 0 0 0 0", attached_to="a"),
        frame("platform", "0 0 0.25 0 0 0", attached_to="tool"),
    )
    assert mechanism.platform == "platform"
    np.testing.assert_array_equal(position(mechanism, "platform", j=np.pi / 2), [0, 0.5, 1.25])


def test_inertia_is_about_the_centre_of_mass_in_turned_axes(tmp_path: Path) -> None:
    (body,) = [x for x in read(tmp_path, link("a")).links if x.name == "a"]
    assert body.inertia is not None and body.inertia.mass == 2
    np.testing.assert_array_equal(body.inertia.lever, [0.1, -0.2, 0.3])
    turned = pin.rpy.rpyToMatrix(0.2, -0.1, 0.4)
    matrix = np.array([[0.5, 0.01, -0.02], [0.01, 0.6, 0.03], [-0.02, 0.03, 0.7]])
    np.testing.assert_allclose(body.inertia.inertia, turned @ matrix @ turned.T, atol=1e-15)


def test_links_keep_their_frames_by_a_link_without_inertia(tmp_path: Path) -> None:
    mechanism = read(
        tmp_path, link("a"), link("b", "3 0 0 0 0 0"), HOLD, joint("j", "a", "b", pose="-1 0 0 0 0 0")
    )
    assert [x.name for x in mechanism.links] == ["world", "a", "b", "b_at_j"]
    assert mechanism.link("b_at_j").inertia is None
    assert mechanism.joint("j").child == "b_at_j" and mechanism.joint("b_at_j_fixed").child == "b"


# --- loops ------------------------------------------------------------------------------------------------------

FOUR_BAR = (
    link("ground", "0 0 0 0 0 0"),
    joint("hold", "world", "ground", "fixed", xyz=""),
    link("crank", "0 0 0.5 0 0 0"),
    link("coupler", "0.5 0 1 0 0 0"),
    link("rocker", "1 0 0.5 0 0 0"),
    joint("crank_hinge", "ground", "crank", pose="0 0 -0.5 0 0 0", xyz="0 1 0"),
    joint("left_pin", "crank", "coupler", pose="-0.5 0 0 0 0 0", xyz="0 1 0"),
    joint("rocker_hinge", "ground", "rocker", pose="0 0 -0.5 0 0 0", xyz="0 1 0"),
)


def four_bar(*closing: str, xmlns: bool = True) -> tuple[str, dict[str, str]]:
    attributes = 'xmlns:drake="drake.mit.edu"' if xmlns else ""
    return sdf(*FOUR_BAR, *closing, attributes=attributes), {}


CLOSINGS = {
    "a second parent": (joint("right_pin", "coupler", "rocker", pose="0 0 0.5 0 0 0", xyz="0 1 0"), R),
    "a ball": (
        '<joint name="right_pin" type="ball"><pose>0 0 0.5 0 0 0</pose><parent>coupler</parent>'
        "<child>rocker</child></joint>",
        S,
    ),
    "Drake's ball constraint": (
        "<drake:ball_constraint><drake:ball_constraint_body_A>coupler</drake:ball_constraint_body_A>"
        "<drake:ball_constraint_body_B>rocker</drake:ball_constraint_body_B>"
        "<drake:ball_constraint_p_AP>0.5 0 0</drake:ball_constraint_p_AP>"
        "<drake:ball_constraint_p_BQ>0 0 0.5</drake:ball_constraint_p_BQ></drake:ball_constraint>",
        S,
    ),
}


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
    with pytest.raises(FileFormatError, match=r"'k' cannot close a loop: it is a screw.*must_be_loop_joint"):
        read(tmp_path, *TWO, HOLD, screw.replace('"k"', '"j"'), screw)


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


# --- couplings, motors, limits ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("axis", "second", "reversed_joint", "factor"),
    [
        ("0 0 1", "0 0 1", False, -0.25),
        ("0 0 1", "0 0 -1", False, 0.25),
        ("0 0 -1", "0 0 -1", False, -0.25),
        ("0 0 1", "0 0 1", True, 0.25),
    ],
)
def test_a_gearbox_couples_two_hinges(
    tmp_path: Path, axis: str, second: str, reversed_joint: bool, factor: float
) -> None:
    """θ2 = -ratio θ1, angles from the reference body to the wheels, each about its axis."""
    gear = joint(
        "gear",
        "fast",
        "slow",
        "gearbox",
        xyz=axis,
        content=f"{axis2(second)}<gearbox_ratio>0.25</gearbox_ratio>"
        "<gearbox_reference_body>case</gearbox_reference_body>",
    )
    ends = ("slow", "case") if reversed_joint else ("case", "slow")
    mechanism = read(
        tmp_path,
        link("case"),
        link("fast", "1 0 0 0 0 0"),
        link("slow", "2 0 0 0 0 0"),
        joint("input", "case", "fast"),
        joint("output", *ends),
        gear,
    )
    (coupling,) = mechanism.couplings
    assert (coupling.name, coupling.joint1, coupling.joint2) == ("gear", "output", "input")
    assert coupling.polynomial == (0.0, factor)
    assert not mechanism.loops  # it holds nothing


def test_a_gearbox_needs_its_hinges(tmp_path: Path) -> None:
    gear = joint(
        "gear",
        "a",
        "b",
        "gearbox",
        content=f"{axis2('0 0 1')}<gearbox_reference_body>c</gearbox_reference_body>",
    )
    with pytest.raises(FileFormatError, match=r"no revolute joint about its <axis> joins 'c' and 'a'"):
        read(tmp_path, *TWO, link("c"), joint("j", "a", "b"), gear)


def test_an_axis_that_mimics_another(tmp_path: Path) -> None:
    """The follower stands at multiplier (leader - reference) + offset = 3 (x - 0.5) + 2."""
    numbers = "<multiplier>3</multiplier><offset>2</offset><reference>0.5</reference>"
    rule = f'<mimic joint="u" axis="axis2">{numbers}</mimic>'
    mechanism = read(
        tmp_path,
        *TWO,
        link("c"),
        HOLD,
        joint("u", "a", "b", "universal", xyz="1 0 0", content=axis2("0 1 0")),
        joint("k", "b", "c", axis=rule),
        version="1.11",
    )
    (coupling,) = mechanism.couplings
    assert (coupling.joint1, coupling.joint2, coupling.polynomial) == ("k", "u_2", (0.5, 3.0))
    assert not mechanism.assembled


def test_drakes_mimic(tmp_path: Path) -> None:
    rule = '<drake:mimic joint="j" multiplier="-2" offset="0"/>'
    mechanism = read(
        tmp_path, *TWO, link("c"), HOLD, joint("j", "a", "b"), joint("k", "b", "c", content=rule)
    )
    assert [(x.joint1, x.joint2, x.polynomial) for x in mechanism.couplings] == [("k", "j", (0.0, -2.0))]


def test_threads_of_screws(tmp_path: Path) -> None:
    """0.3 m per turn to the right; 20 rad per metre to the left."""
    for tag, lead in (("screw_thread_pitch", 0.3), ("thread_pitch", -2 * np.pi / 20)):
        value = 0.3 if tag == "screw_thread_pitch" else 20
        mechanism = read(
            tmp_path, *TWO, HOLD, joint("j", "a", "b", "screw", content=f"<{tag}>{value}</{tag}>")
        )
        (thread,) = mechanism.couplings
        assert thread.polynomial[1] * 2 * np.pi == pytest.approx(lead, rel=1e-15)


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


# --- home ----------------------------------------------------------------------------------------------------------


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


# --- the rest -----------------------------------------------------------------------------------------------------


def test_what_is_ignored_is_noted(tmp_path: Path) -> None:
    mechanism = read(
        tmp_path,
        "<self_collide>1</self_collide>",
        '<plugin name="p" filename="libdrive.so"><joint_name>j</joint_name></plugin>',
        link("a", content=BODY + '<visual name="v"/><collision name="c"/><sensor name="s" type="imu"/>'),
        joint(
            "j",
            "world",
            "a",
            axis="<dynamics><damping>1</damping><spring_stiffness>9</spring_stiffness></dynamics>",
            content="<physics><ode/></physics>",
        ),
        "<odd_one>1</odd_one>",
    )
    ignored = {note.text.split(":")[0] for note in mechanism.notes if note.outcome is Outcome.IGNORED}
    assert ignored >= {
        "<self_collide>", "<plugin>", "<visual>", "<collision>", "<sensor>", "<dynamics>", "<physics>", "<odd_one>",
    }  # fmt: skip


def test_an_attribute_that_nobody_reads_is_noted(tmp_path: Path) -> None:
    mechanism = read(tmp_path, link("a").replace("<link ", '<link colour="red" '))
    assert "attribute 'colour' of <link>: unknown" in {note.text for note in mechanism.notes}


def test_a_joint_that_closes_a_loop_is_no_motor(tmp_path: Path) -> None:
    closing, _ = CLOSINGS["a second parent"]
    with pytest.raises(MechanismError, match="'right_pin', which closes a loop, and has no coordinate"):
        stp.load(write(tmp_path, sdf(*FOUR_BAR, closing)), motors=["right_pin"], platform="coupler")


def test_a_link_without_inertial_weighs_one_kilogram(tmp_path: Path) -> None:
    mechanism = read(tmp_path, link("a", content=""), link("b"), HOLD, joint("j", "a", "b"))
    inertia = mechanism.link("a").inertia
    assert inertia is not None and inertia.mass == 1 and (inertia.inertia == np.eye(3)).all()
    some = BODY.replace("<ixx>0.5</ixx>", "").replace("<ixy>0.01</ixy>", "").replace("<mass>2</mass>", "")
    half = read(tmp_path, link("a", content=some.replace("0.2 -0.1 0.4", "0 0 0"))).link("a").inertia
    assert half is not None and half.mass == 1
    np.testing.assert_array_equal(half.inertia, [[1, 0, -0.02], [0, 0.6, 0.03], [-0.02, 0.03, 0.7]])
    assert any("1 kg" in note.text and note.outcome is Outcome.KEPT for note in mechanism.notes)


def test_a_link_may_have_to_float(tmp_path: Path) -> None:
    base = BODY + "<must_be_base_link>1</must_be_base_link>"
    mechanism = read(tmp_path, link("a"), link("b", content=base), HOLD, joint("j", "a", "b"))
    assert [x.name for x in mechanism.joints] == ["b_floating", "hold"]
    assert [x.name for x in mechanism.loops] == ["j"]


def test_no_gravity_on_any_link_is_no_gravity(tmp_path: Path) -> None:
    light = BODY + "<gravity>false</gravity>"
    assert read(tmp_path, link("a", content=light)).gravity == (0, 0, 0)
    with pytest.raises(FileFormatError, match=r"'a' has <gravity> off, and others have it on"):
        read(tmp_path, link("a", content=light), link("b"))


A = link("a")
ODD = {
    "no version": ("<sdf><model name='m'/></sdf>", r"lacks 'version'"),
    "an old version": ("<sdf version='1.2'><model name='m'/></sdf>", r"versions 1\.4 to 1\.12 are read"),
    "a version in words": ("<sdf version='new'><model name='m'/></sdf>", "'new'"),
    "no model": ("<sdf version='1.9'/>", "keep one"),
    "two models": ("<sdf version='1.9'><model name='m'/><model name='n'/></sdf>", "2 <model>.*'m', 'n'"),
    "no link": (sdf(), "has no <link>"),
    "a reserved name": (sdf(link("world")), "'world', which SDFormat keeps for itself"),
    "two links of a name": (sdf(A, A), r"a <link> and a <link> \(line 1\).*'a'; rename one"),
    "a link and a joint of a name": (sdf(A, joint("a", "world", "a")), "a <link> and a <joint>"),
    "a missing frame": (sdf(link("a", "0 0 0 0 0 0", relative_to="nobody")), "names the frame 'nobody'.*has: a"),
    "a missing child": (sdf(A, joint("j", "world", "nobody")), "names the frame 'nobody'"),
    "the world as child": (sdf(A, joint("j", "a", "world")), "the world as its child; make it the parent"),
    "a link with itself": (sdf(A, joint("j", "a", "a")), "joins link 'a' to itself"),
    "frames in a circle": (
        sdf(A, link("b", relative_to="c"), link("c", relative_to="b")),
        "stand in each other in a circle",
    ),
    "frames attached in a circle": (
        sdf(A, frame("f", attached_to="g"), frame("g", attached_to="f")),
        "in a circle",
    ),
    "an unknown type": (sdf(A, joint("j", "world", "a", "piston")), "type 'piston'; supported: ball, continuous"),
    "no axis": (sdf(A, joint("j", "world", "a", xyz="")), "needs a <axis>"),
    "an axis of zero": (sdf(A, joint("j", "world", "a", xyz="0 0 0")), "axis of length zero"),
    "half a pose": (sdf(link("a", "1 2 3")), r"<pose> \(line 1\) must hold 6 numbers"),
    "a pose in a frame of a wrong word": (
        sdf(link("a", "1 2 3 0 0 0").replace("<pose", "<pose relativ_to='b'")),
        "attribute 'relativ_to' of <pose>.*is not understood; it may have relative_to",
    ),
    "an axis in a frame of a wrong word": (
        sdf(A, joint("j", "world", "a").replace("<xyz", "<xyz frame='b'")),
        "attribute 'frame' of <xyz>",
    ),
    "an infinite pose": (sdf(link("a", "1 2 inf 0 0 0")), "must be finite"),
    "a new flag in an old way": (
        sdf(A, joint("j", "world", "a", axis="<use_parent_model_frame>1</use_parent_model_frame>")),
        "ended with version 1.6; write <xyz expressed_in='__model__'>",
    ),
    "a screw without thread": (sdf(A, joint("j", "world", "a", "screw")), "give <screw_thread_pitch>"),
    "a screw of no pitch": (
        sdf(A, joint("j", "world", "a", "screw", content="<thread_pitch>0</thread_pitch>")),
        "must not be zero",
    ),
    "a leader that is missing": (
        sdf(A, joint("j", "world", "a", axis='<mimic joint="k"/>'), version="1.11"),
        "mimics the axis of joint 'k', which does not exist",
    ),
    "a joint that mimics itself": (
        sdf(A, joint("j", "world", "a", axis='<mimic joint="j"/>'), version="1.11"),
        "mimics itself",
    ),
    "a plugin that couples": (
        sdf(A, '<plugin name="m" filename="libmimic_joint.so"/>'),
        "could hold or couple links while the simulation runs",
    ),
    "a plugin with a mimic": (
        sdf(A, '<plugin name="p" filename="libcontrol.so"><mimicJoint>j</mimicJoint></plugin>'),
        "could hold or couple",
    ),
    "a plugin that holds": (
        sdf(A, '<plugin name="gz::sim::systems::DetachableJoint" filename="gz-sim-detachable-joint-system"/>'),
        "could hold or couple",
    ),
    "an unknown constraint": (sdf(A, "<loop_constraint/>"), "could close a loop"),
    "a bushing": (sdf(A, "<drake:linear_bushing_rpy/>"), "is a spring; write the joint"),
    "a tendon": (sdf(A, "<drake:tendon_constraint/>"), "is not understood; write <mimic>"),
    "a curved joint": (sdf(A, '<drake:joint name="c" type="curvilinear"/>'), "type 'curvilinear'; supported: planar"),
    "a kinematic link": (sdf(link("a", content="<kinematic>1</kinematic>")), "something outside the model moves it"),
    "inertia from shapes": (sdf(link("a", content='<inertial auto="true"/>')), "write <mass> and <inertia>"),
    "added mass": (
        sdf(link("a", content="<inertial><fluid_added_mass/></inertial>")),
        "<fluid_added_mass>, which no rigid body has",
    ),
    "a static robot": (
        sdf("<static>true</static>", A, joint("j", "world", "a")),
        "is static, so that its joints cannot move",
    ),
    "an odd flag": (sdf("<static>maybe</static>", A), "must be true or false, got 'maybe'"),
    "a merged include": (sdf('<include merge="true"><uri>x.sdf</uri></include>'), "merges or changes the model"),
    "an include by name": (
        sdf("<include><uri>model://arm</uri></include>"),
        "'model://arm' would be looked up in a simulator's model path; give the path",
    ),
    "an include of nothing": (sdf("<include><uri>nothing.sdf</uri></include>"), "no such file"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "words"), ODD.values(), ids=ODD)
def test_what_is_not_understood_is_refused_in_words(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises((FileFormatError, UnsupportedError), match=words) as caught:
        stp.load(write(tmp_path, text), motors=["j"], platform="a")
    assert str(tmp_path) in str(caught.value)


def test_inertia_of_no_real_body_is_kept_aloud(tmp_path: Path) -> None:
    """Simulators take it, so that who compares with them needs it; a negative moment nobody takes."""
    heavy = BODY.replace("<izz>0.7</izz>", "<izz>7</izz>")
    text = sdf(link("a", content=heavy), joint("j", "world", "a"))
    chain = stp.load(write(tmp_path, text), motors=["j"], platform="a")
    assert "link 'a'" in str(chain.report) and "triangle inequality" in str(chain.report)
    assert np.linalg.eigvalsh(chain.mechanism.link("a").inertia.inertia)[-1] > 6.5
    negative = BODY.replace("<izz>0.7</izz>", "<izz>-7</izz>")
    with pytest.raises(MechanismError, match=r"link 'a'.*negative principal moment"):
        stp.load(write(tmp_path, sdf(link("a", content=negative), joint("j", "world", "a"))), motors=["j"])


def test_long_chains_of_frames_are_followed(tmp_path: Path) -> None:
    """Five thousand frames, each in the one before: no recursion, no quadratic time."""
    frames = [frame(f"f{k}", "0.001 0 0 0 0 0", attached_to=f"f{k - 1}" if k else "a") for k in range(5000)]
    mechanism = read_sdf(write(tmp_path, sdf(A, *frames)))
    mounts = {x.name: x for x in mechanism.joints}
    np.testing.assert_allclose(mounts["f4999_frame"].placement.translation, [5, 0, 0], atol=1e-9)
    assert mounts["f4999_frame"].parent == "a"
    with pytest.raises(StewartPinError, match="circle"):
        read_sdf(write(tmp_path, sdf(A, *frames, frame("f", attached_to="f"))))
