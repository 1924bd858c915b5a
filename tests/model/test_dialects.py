"""The same four-bar in every dialect is the same mechanism; each dialect reads the syntax that its users write."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from lxml import etree

import stewart_pin as stp
from stewart_pin.errors import FileFormatError, MechanismError, MissingExtraError, UnsupportedError
from stewart_pin.model.description import JointKind, Loop
from stewart_pin.model.formats import dialects as folder
from stewart_pin.model.formats.dialect import claimed_tags, dialects
from stewart_pin.model.formats.urdf import read_urdf
from tests.model.mutations import assert_loads_or_says_why, damaged, hypothesis, quick
from tests.small_urdf import ARM, AXIS_Z, FOUR_BAR, MOTOR, SQUARE, home, joint, link, loop, robot, write

TIP = 'xyz="1 0 0"'
TIPS = f"<parent_origin {TIP}/><child_origin {TIP}/>"
FRAMES = (
    link("closing_pin_1", ""),
    joint("frame1", "platform", "closing_pin_1", "fixed", origin=TIP),
    link("closing_pin_2", ""),
    joint("frame2", "rocker", "closing_pin_2", "fixed", origin=TIP),
)
Z_FRAMES = (
    link("closing_pin_1_z", ""),
    joint("frame1_z", "platform", "closing_pin_1_z", "fixed", origin='xyz="1 0 0.1"'),
    link("closing_pin_2_z", ""),
    joint("frame2_z", "rocker", "closing_pin_2_z", "fixed", origin='xyz="1 0 0.1"'),
)
BALL = loop("pin", "spherical", "platform", "rocker", origin1=TIP, origin2=TIP)
HINGE = loop("pin", "revolute", "platform", "rocker", origin1=TIP, origin2=TIP, content=AXIS_Z)
ENDS = '<parent link="platform"/><child link="rocker"/>'
DRAKE_BALL = (
    '<drake:ball_constraint><drake:ball_constraint_body_A name="platform"/>'
    '<drake:ball_constraint_body_B name="rocker"/><drake:ball_constraint_p_AP value="1 0 0"/>'
    '<drake:ball_constraint_p_BQ value="1 0 0"/></drake:ball_constraint>'
)
BALLS = {
    "isaac": '<loop_joint name="pin" type="spherical"><link1 link="platform" rpy="0 0 0" xyz="1 0 0"/>'
    '<link1 link="rocker" rpy="0 0 0" xyz="1 0 0"/></loop_joint>',
    "isaac link2": '<loop_joint name="pin" type="ball"><link1 link="platform" xyz="1 0 0"/>'
    '<link2 link="rocker" xyz="1 0 0"/></loop_joint>',
    "fusion": f'<loop_joint name="pin" type="spherical">{ENDS}{TIPS}</loop_joint>',
    "drake": DRAKE_BALL,
    "urdfdom": f'<constraint name="pin" type="spherical">{ENDS}{TIPS}</constraint>',
    "closing frames": "".join(FRAMES),
}
HINGES = {
    "old drake": '<loop_joint name="pin" type="revolute"><link1 link="platform" xyz="1 0 0"/>'
    f'<link2 link="rocker" xyz="1 0 0"/>{AXIS_Z}</loop_joint>',
    "fusion": f'<loop_joint name="pin" type="revolute">{ENDS}{TIPS}'
    '<axis xyz="0 0 1" frame="parent"/></loop_joint>',
    "urdfdom": f'<constraint name="pin" type="revolute">{ENDS}<parent_origin {TIP} rpy="0 0 0.3"/>'
    f'<parent_axis xyz="0 0 1"/><child_origin {TIP} rpy="1.5707963267948966 0 0"/><child_axis xyz="0 1 0"/>'
    "</constraint>",
    "closing frames": "".join((*FRAMES, *Z_FRAMES)),
}


def square(*parts: str) -> str:
    return robot(*FOUR_BAR, *parts, home(**SQUARE), attributes='xmlns:drake="http://drake.mit.edu"')


def assert_same_motion(chain: stp.ClosedChain, other: stp.ClosedChain, rng: np.random.Generator) -> None:
    """Compare what the loops do, whatever frames they are written in: closed states, and the motor's effort."""
    assert chain.nv == other.nv and chain.motors == other.motors
    np.testing.assert_allclose(chain.q_home, other.q_home, atol=1e-9)
    q = other.q_home + 0.2 * rng.normal(size=other.nq)
    # The same loop in other frames: the same null space of its Jacobian.
    ours, theirs = (np.linalg.svd(stp.loop_jacobian(c, q)) for c in (chain, other))
    rank = int((theirs.S > 1e-9).sum())
    assert int((ours.S > 1e-9).sum()) == rank
    np.testing.assert_allclose(ours.Vh[rank:] @ theirs.Vh[:rank].T, 0, atol=1e-9)
    q = stp.close_loops(other, q).q
    assert np.abs(stp.loop_gap(chain, q)).max() < 1e-9
    v, a = np.zeros((2, other.nv))
    ours, theirs = (stp.inverse_dynamics(c, q, v, a).tau_motor for c in (chain, other))
    np.testing.assert_allclose(ours, theirs, rtol=1e-9)


@pytest.mark.parametrize("text", BALLS.values(), ids=BALLS)
def test_balls_in_every_dialect(tmp_path: Path, text: str, rng: np.random.Generator) -> None:
    chain = stp.load(write(tmp_path, square(text)))
    assert [each.kind for each in chain.loops] == [JointKind.SPHERICAL]
    assert_same_motion(chain, stp.load(write(tmp_path, square(BALL))), rng)


@pytest.mark.parametrize("text", HINGES.values(), ids=HINGES)
def test_hinges_in_every_dialect(tmp_path: Path, text: str, rng: np.random.Generator) -> None:
    chain = stp.load(write(tmp_path, square(text)))
    assert [each.kind for each in chain.loops] == [JointKind.REVOLUTE]
    assert_same_motion(chain, stp.load(write(tmp_path, square(HINGE))), rng)


def test_every_dialect_is_reported_with_its_name(tmp_path: Path) -> None:
    text = square(BALLS["isaac"], DRAKE_BALL, BALLS["urdfdom"].replace("pin", "pin2"), loop_named("pin3"))
    report = str(stp.load(write(tmp_path, text)).report)
    for line in (
        "kept: read as Isaac <loop_joint> (loop 'pin')",
        "kept: read as Drake's tags (loop 'platform_rocker_ball')",
        "kept: read as urdfdom <constraint> (loop 'pin2')",
        "kept: read as URDF+ (loop 'pin3')",
    ):
        assert line in report.splitlines()


def loop_named(name: str) -> str:
    return BALL.replace('name="pin"', f'name="{name}"')


def test_a_new_file_is_a_new_dialect(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(
        tmp_path,
        "from stewart_pin.model.description import JointKind, Loop\n"
        "from stewart_pin.model.formats.dialect import Dialect, Parts\n"
        "import pinocchio as pin\n"
        "def read(reader, element):\n"
        "    place = pin.SE3(reader.pose(element, 'knot'))\n"
        "    return Parts(loops=(Loop('knot', JointKind.SPHERICAL, 'platform', 'rocker', place, place),))\n"
        "DIALECT = Dialect('knots', 'knots', {'robot/knot': read})\n",
        "knots.py",
    )
    monkeypatch.setattr(folder, "__path__", [*folder.__path__, str(tmp_path)])
    for found in (dialects, claimed_tags):
        found.cache_clear()
    try:
        chain = stp.load(write(tmp_path, square('<knot xyz="1 0 0"/>')))
    finally:
        monkeypatch.undo()
        for found in (dialects, claimed_tags):
            found.cache_clear()
    assert str(chain.report) == "kept: read as knots (loop 'knot')" and chain.nc == 3


def test_dialects_are_found_and_claim_each_tag_once() -> None:
    names = [dialect.name for dialect in dialects()]
    assert len(set(names)) == len(names) >= 9
    assert len(claimed_tags()) == sum(len(dialect.tags) for dialect in dialects())


# --- Gazebo ---------------------------------------------------------------------------------------------------


def open_square(*parts: str) -> str:
    """Put the four-bar together as Gazebo does: the joints' origins make the square, all values are zero."""
    up, side = 'xyz="0 0 0" rpy="0 0 1.5707963267948966"', 'xyz="1 0 0" rpy="0 0 1.5707963267948966"'
    return robot(
        *FOUR_BAR[:4],
        joint("crank_turn", "base", "crank", origin=up, attributes=MOTOR),
        joint("coupler_turn", "crank", "platform", origin='xyz="1 0 0" rpy="0 0 -1.5707963267948966"'),
        joint("rocker_turn", "base", "rocker", origin=side),
        *parts,
    )


GAZEBO = (
    '<gazebo><joint name="pin" type="{kind}"><parent>platform</parent><child>rocker</child>'
    "<pose>1 0 0 0 0 0.4</pose>{axis}</joint></gazebo>"
)


@pytest.mark.parametrize(
    ("kind", "reference"),
    [("ball", BALL), ("revolute", HINGE), ("fixed", BALL.replace("spherical", "fixed"))],
)
def test_gazebo_joints_stand_where_the_links_lie_at_zero(
    tmp_path: Path, kind: str, reference: str, rng: np.random.Generator
) -> None:
    axis = "<axis><xyz>0 0 1</xyz><limit><lower>-1</lower></limit></axis>" if kind == "revolute" else ""
    chain = stp.load(write(tmp_path, open_square(GAZEBO.format(kind=kind, axis=axis))))
    if kind == "fixed":  # the reference holds the rocker along the coupler, Gazebo across it, as it lies
        assert (
            chain.loops[0].kind is JointKind.FIXED and np.abs(stp.loop_gap(chain, np.zeros(3))).max() < 1e-15
        )
        return
    assert_same_motion(chain, stp.load(write(tmp_path, open_square(reference))), rng)
    np.testing.assert_allclose(chain.loops[0].placement1.translation, [1, 0, 0], atol=1e-15)
    assert "kept: read as Gazebo <gazebo> (loop 'pin')" in str(chain.report)
    assert "while all joints are at zero (loop 'pin')" in str(chain.report)
    assert kind == "ball" or "ignored: <limit>" in str(chain.report)


# Two links that lie askew at zero: the first three numbers of each place its joint, the others turn it.
ASKEW = (
    link("base"),
    link("platform"),
    link("rod"),
    joint("one", "base", "platform", origin='xyz="0.3 -0.2 0.1" rpy="0.4 -0.7 1.1"', attributes=MOTOR),
    joint("two", "base", "rod", origin='xyz="-0.5 0.6 0.2" rpy="-1.2 0.3 0.5"'),
)
PLATFORM, ROD = (
    pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz))
    for xyz, rpy in (([0.3, -0.2, 0.1], [0.4, -0.7, 1.1]), ([-0.5, 0.6, 0.2], [-1.2, 0.3, 0.5]))
)


def in_world(found: Loop) -> tuple[pin.SE3, pin.SE3, np.ndarray, np.ndarray]:
    """Return frames 1 and 2 and the axis in each, in the base, while the joints of `ASKEW` are at zero."""
    one, two = PLATFORM * found.placement1, ROD * found.placement2
    return one, two, one.rotation @ found.axis, two.rotation @ found.axis


def test_gazebo_places_the_joint_in_the_child(tmp_path: Path) -> None:
    pose, axis = "0.1 0.2 0.3 0.4 0.5 0.6", np.array([0.48, 0.6, 0.64])
    text = (
        '<gazebo><joint name="pin" type="revolute"><parent>platform</parent><child>rod</child>'
        f"<pose>{pose}</pose><axis><xyz>0.48 0.6 0.64</xyz></axis></joint></gazebo>"
    )
    one, two, axis1, axis2 = in_world(read_urdf(write(tmp_path, robot(*ASKEW, text))).loops[0])
    there = ROD * pin.SE3(pin.rpy.rpyToMatrix(0.4, 0.5, 0.6), np.array([0.1, 0.2, 0.3]))
    for frame in (one, two):
        np.testing.assert_allclose(frame.homogeneous, there.homogeneous, atol=1e-15)
    np.testing.assert_allclose([axis1, axis2], [there.rotation @ axis] * 2, atol=1e-15)


@pytest.mark.parametrize("turned", ["", ' rpy="0.3 0.2 0.1"'])
def test_the_exporters_axis_is_in_the_parent_link(tmp_path: Path, turned: str) -> None:
    text = (
        '<loop_joint name="pin" type="revolute"><parent link="platform"/><child link="rod"/>'
        f'<parent_origin xyz="0.1 0.2 0.3"{turned}/><child_origin xyz="0.4 0.5 0.6"/>'
        '<axis xyz="0.48 0.6 0.64" frame="parent"/></loop_joint>'
    )
    one, two, axis1, axis2 = in_world(read_urdf(write(tmp_path, robot(*ASKEW, text))).loops[0])
    # Two points, one axis; the frames are parallel at zero, the points are where the file has them.
    np.testing.assert_allclose([axis1, axis2], [PLATFORM.rotation @ [0.48, 0.6, 0.64]] * 2, atol=1e-15)
    np.testing.assert_allclose(one.rotation, two.rotation, atol=1e-15)
    np.testing.assert_allclose(two.translation, ROD.act(np.array([0.4, 0.5, 0.6])), atol=1e-15)


def test_the_rest_of_gazebo_is_still_read(tmp_path: Path) -> None:
    text = GAZEBO.format(kind="ball", axis="").replace(
        "</gazebo>", "<plugin><joint>pin</joint></plugin></gazebo>"
    )
    report = str(stp.load(write(tmp_path, open_square(text))).report)
    assert "ignored: <gazebo>: simulator settings (the file)" in report


# --- Gepetto's YAML -------------------------------------------------------------------------------------------

YAML = """closed_loop: [['closedloop1_A', 'closedloop1_B']]
type: ['{kind}']
name_mot: ['mot1', 'mot2']
"""


def five_bar(*parts: str) -> str:
    """Write a five-bar as the dialect's own example does: the loop's frames are joints that only carry a frame."""
    x, half = 'xyz="1 0 0"', 'rpy="0 0 -1.5707963267948966"'
    return robot(
        link("base"),
        *(link(name) for name in ("left", "platform", "right", "far")),
        *(link(name, "") for name in ("sphere", "sphere_2")),
        joint("mot2", "base", "right", origin=f'{x} rpy="0 0 1.5707963267948966"'),
        joint("mot1", "base", "left", origin='rpy="0 0 1.5707963267948966"'),
        joint("free1", "left", "platform", origin=f"{x} {half}"),
        joint("free2", "right", "far", origin=f"{x} {half}"),
        joint("closedloop1_A", "platform", "sphere", "fixed", origin='xyz="0.5 0.5 0"'),
        joint("closedloop1_B", "far", "sphere_2", "fixed", origin='xyz="-0.5 0.5 0"'),
        *parts,
    )


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


# --- couplings ------------------------------------------------------------------------------------------------

LEG = (
    link("base"),
    link("abduct"),
    link("abduct_rotor"),
    link("platform"),
    joint("abduct_turn", "base", "abduct", attributes='independent="True"'),
    joint("rotor_turn", "base", "abduct_rotor", attributes='independent="False"'),
    joint("hip", "abduct", "platform", origin=TIP, attributes=MOTOR),
)
"""The abduction joint of a legged robot, with the rotor of its motor on the same parent."""


def test_coupling_of_a_rotor(tmp_path: Path) -> None:
    text = (
        '<coupling name="abduct_transmission" type="rolling"><predecessor link="abduct"/>'
        '<successor link="abduct_rotor"/><ratio value="6.0"/></coupling>'
    )
    (found,) = read_urdf(write(tmp_path, robot(*LEG, text))).couplings
    assert found.name == "abduct_transmission"
    # ratio × Σ q(ancestor to predecessor) = Σ q(ancestor to successor): the rotor turns six times as fast.
    assert (found.joint1, found.joint2, found.polynomial) == ("rotor_turn", "abduct_turn", (0.0, 6.0))
    chain = stp.load(write(tmp_path, robot(*LEG, text.replace(' type="rolling"', ""))))
    assert (chain.nc, chain.couplings[0].polynomial) == (1, (0.0, 6.0))


def test_coupling_of_sums_is_refused_by_name(tmp_path: Path) -> None:
    text = (
        '<coupling name="belt"><predecessor link="platform"/><successor link="abduct_rotor"/><ratio value="2"/>'
        "</coupling>"
    )
    with pytest.raises(
        UnsupportedError, match="coupling 'belt' couples joint 'rotor_turn' to the sum of hip, abduct_turn"
    ):
        stp.load(write(tmp_path, robot(*LEG, text)))


def test_mimic(tmp_path: Path) -> None:
    follower = joint("follow", "base", "shell", content='<mimic joint="elbow" multiplier="-2" offset="0.5"/>')
    chain = stp.load(write(tmp_path, robot(*ARM, link("shell"), follower)))
    (found,) = chain.couplings
    assert (found.name, found.joint1, found.joint2) == ("follow_mimic", "follow", "elbow")
    assert found.polynomial == (0.5, -2.0)
    q = dict(zip(chain.tangent_names, chain.q_home, strict=True))
    assert abs(q["follow"] - 0.5 + 2 * q["elbow"]) < 1e-12
    plain = follower.replace(' multiplier="-2" offset="0.5"', "")
    assert stp.load(write(tmp_path, robot(*ARM, link("shell"), plain))).couplings[0].polynomial == (0.0, 1.0)


PLUGIN = (
    '<gazebo><plugin filename="libroboticsgroup_gazebo_mimic_joint_plugin.so" name="m"><joint>elbow</joint>'
    "<mimicJoint>follow</mimicJoint><multiplier>-2.0</multiplier><offset>0.5</offset><hasPID/></plugin></gazebo>"
)


def test_mimic_plugins_of_gazebo(tmp_path: Path) -> None:
    follower = joint("follow", "base", "shell")
    chain = stp.load(write(tmp_path, robot(*ARM, link("shell"), follower, PLUGIN)))
    (found,) = chain.couplings
    assert (found.joint1, found.joint2, found.polynomial) == ("follow", "elbow", (0.5, -2.0))
    assert "kept: read as Gazebo <gazebo> (coupling 'follow_mimic')" in str(chain.report)
    bare = PLUGIN.replace("<multiplier>-2.0</multiplier><offset>0.5</offset>", "").replace(
        "joint>el", "jointName>el"
    )
    bare = bare.replace("elbow</joint>", "elbow</jointName>")
    chain = stp.load(write(tmp_path, robot(*ARM, link("shell"), follower, bare)))
    assert chain.couplings[0].polynomial == (0.0, 1.0)


@pytest.mark.parametrize(
    ("multiplier", "words"),
    [("-2", "repeats the <mimic>"), ("2", "says otherwise than -2 × 'elbow' + 0.5")],
)
def test_mimic_counts_before_a_plugin(tmp_path: Path, multiplier: str, words: str) -> None:
    own = f'<mimic joint="elbow" multiplier="{multiplier}" offset="0.5"/>'
    chain = stp.load(
        write(tmp_path, robot(*ARM, link("shell"), PLUGIN, joint("follow", "base", "shell", content=own)))
    )
    assert chain.couplings[0].polynomial == (0.5, float(multiplier)) and len(chain.couplings) == 1
    assert words in str(chain.report)


def test_mimic_of_rigid_joints(tmp_path: Path) -> None:
    own = '<mimic joint="elbow" multiplier="-2" offset="0.5"/>'
    text = robot(*ARM, link("shell"), joint("follow", "base", "shell", "fixed", content=own))
    chain = stp.load(write(tmp_path, text))
    assert chain.couplings == () and "does not follow 'elbow': it is fixed (joint 'follow')" in str(
        chain.report
    )
    text = robot(*ARM, link("shell"), joint("follow", "base", "shell", content=own))
    chain = stp.load(
        write(tmp_path, text.replace('"elbow" type="revolute" independent="true"', '"elbow" type="fixed"'))
    )
    assert (chain.couplings[0].joint2, chain.couplings[0].polynomial) == (None, (0.5,))
    assert chain.q_home[chain.model.joints[chain.model.getJointId("follow")].idx_q] == 0.5


# --- Drake's joints -------------------------------------------------------------------------------------------


def drake_joint(kind: str, content: str = "") -> str:
    return (
        f'<drake:joint name="j" type="{kind}"><parent link="base"/><child link="platform"/>'
        f"<origin {TIP}/>{content}</drake:joint>"
    )


@pytest.mark.parametrize("declared", [True, False])
def test_drake_joints(tmp_path: Path, declared: bool) -> None:
    def read(kind: str, content: str = "") -> list:
        namespace = 'xmlns:drake="http://drake.mit.edu"' if declared else ""
        text = robot(link("base"), link("platform"), drake_joint(kind, content), attributes=namespace)
        mechanism = read_urdf(write(tmp_path, text))
        return [*mechanism.joints, *mechanism.couplings]

    (ball,) = read("ball", "<dynamics damping='1'/>")
    assert ball.kind is JointKind.SPHERICAL
    np.testing.assert_array_equal(ball.placement.translation, [1, 0, 0])
    first, second = read("universal")
    np.testing.assert_array_equal([first.axis, second.axis], [[1, 0, 0], [0, 1, 0]])
    x, y, turn = read("planar", AXIS_Z)
    assert [each.kind for each in (x, y, turn)] == [JointKind.PRISMATIC] * 2 + [JointKind.REVOLUTE]
    np.testing.assert_array_equal(turn.axis, [0, 0, 1])
    turn, slide, thread = read("screw", f'{AXIS_Z}<drake:screw_thread_pitch value="0.5"/>')
    assert (thread.joint1, thread.joint2) == (slide.name, turn.name) == ("j_slide", "j")
    np.testing.assert_allclose(thread.polynomial, [0, 0.5 / (2 * np.pi)])


def test_drakes_constraints_between_two_bodies_are_numbered(tmp_path: Path) -> None:
    chain = stp.load(write(tmp_path, square(DRAKE_BALL, DRAKE_BALL.replace('"1 0 0"', '"1 0 0.1"'))))
    assert [each.name for each in chain.loops] == ["platform_rocker_ball_1", "platform_rocker_ball_2"]


# --- motors ---------------------------------------------------------------------------------------------------


def transmission(joint_name: str) -> str:
    return (
        f'<transmission name="t_{joint_name}"><type>transmission_interface/SimpleTransmission</type>'
        f'<joint name="{joint_name}"/><actuator name="m"><drake:rotor_inertia value="1"/></actuator></transmission>'
    )


def controlled(*names: str) -> str:
    joints = "".join(f'<joint name="{n}"><command_interface name="effort"/></joint>' for n in names)
    return f'<ros2_control name="c" type="system">{joints}<joint name="other"/></ros2_control>'


UNMARKED = [part.replace(MOTOR, "") for part in ARM]


def test_transmissions_name_the_motors(tmp_path: Path) -> None:
    parts = (transmission("elbow"), transmission("shoulder"), controlled("shoulder", "elbow"))
    chain = stp.load(write(tmp_path, robot(*UNMARKED, *parts)))
    assert chain.motors == ("elbow", "shoulder")
    report = str(chain.report)
    assert "kept: names the motors (<transmission name='t_elbow'>" in report
    assert "ignored: rotor inertia and gear ratio are arguments of the simulation" in report
    marked = stp.load(write(tmp_path, robot(*ARM, *parts)))
    assert marked.motors == ("shoulder", "elbow")
    assert "motors are the joints marked independent (<transmission" in str(marked.report)


AMBIGUOUS = {
    "differ": ((transmission("elbow"), controlled("shoulder")), "<transmission> and <ros2_control> differ"),
    "missing": ((transmission("wrist"),), "joint 'wrist' is missing or has not one freedom"),
    "twice": ((transmission("elbow"), transmission("elbow")), "joint 'elbow' is named twice"),
    "two": (
        (transmission("elbow").replace("<joint", '<joint name="shoulder"/><joint'),),
        "leads to 2 joints",
    ),
}


@pytest.mark.parametrize(("parts", "words"), AMBIGUOUS.values(), ids=AMBIGUOUS)
def test_ambiguous_motors_are_not_guessed(tmp_path: Path, parts: tuple[str, ...], words: str) -> None:
    path = write(tmp_path, robot(*UNMARKED, *parts))
    with pytest.raises(MechanismError, match="no joint is marked as a motor"):
        stp.load(path)
    assert words in str(stp.load(path, motors=["elbow"]).report)


# --- mistakes -------------------------------------------------------------------------------------------------

PIN = '<loop_joint name="pin" type="{kind}">{content}</loop_joint>'
LINKS = '<link1 link="arm"/><link2 link="base"/>'
MISTAKES = {
    "isaac type": (PIN.format(kind="screw", content=LINKS), "type 'screw'; supported: spherical"),
    "isaac end": (PIN.format(kind="ball", content='<link1 link="arm"/>'), "needs a <link1> and a <link2>"),
    "isaac axis": (PIN.format(kind="revolute", content=LINKS), "needs a <axis>"),
    "isaac tag": (PIN.format(kind="ball", content=f"{LINKS}<origin/>"), "<origin> of <loop_joint>"),
    "fusion axis": (
        PIN.format(kind="revolute", content=f'{ENDS}{TIPS}<axis xyz="0 0 1" frame="child"/>'),
        "<axis frame> must be 'parent'",
    ),
    "fusion origin": (PIN.format(kind="ball", content=ENDS), "needs a <parent_origin>"),
    "fusion link": (
        PIN.format(kind="fixed", content=f"{ENDS}{TIPS}"), "loop_joint 'pin' names the missing link 'rocker'",
    ),
    "drake body": (DRAKE_BALL.replace("body_A", "body_C"), "needs a <drake:ball_constraint_body_A>"),
    "drake text": (DRAKE_BALL.replace('value="1 0 0"', 'value="1 0"'), "must hold 3 numbers"),
    "drake type": (drake_joint("curvilinear"), "type 'curvilinear'; supported: ball, planar, screw, universal"),
    "drake pitch": (drake_joint("screw"), "needs a <drake:screw_thread_pitch>"),
    "bushing": ("<drake:linear_bushing_rpy/>", "closes a loop by springs"),
    "urdfdom type": (f'<constraint name="c" type="distance">{ENDS}</constraint>', "type 'distance'; supported"),
    "urdfdom axis": (f'<constraint name="c" type="revolute">{ENDS}</constraint>', "needs a <parent_axis>"),
    "gazebo type": (GAZEBO.format(kind="gearbox", axis=""), "type 'gearbox'; supported: revolute"),
    "gazebo axis": (GAZEBO.format(kind="revolute", axis=""), "needs a <axis>"),
    "gazebo link": (GAZEBO.format(kind="ball", axis=""), "names the missing link 'rocker'"),
    "gazebo pose": (GAZEBO.format(kind="ball", axis="").replace("0.4<", "<"), "<pose> must hold 6 numbers"),
    "coupling type": ('<coupling name="c" type="cam"/>', "type 'cam'; supported: rolling, polynomial"),
    "coupling ratio": (
        '<coupling name="c"><predecessor link="arm"/><successor link="base"/></coupling>', "needs a <ratio>",
    ),
    "half a pair": (
        link("closing_x_1", "") + joint("x", "arm", "closing_x_1", "fixed"), "the other half is missing",
    ),
    "mimic": (link("s") + joint("j", "base", "s", content='<mimic multiplier="2"/>'), "lacks 'joint'"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "words"), MISTAKES.values(), ids=MISTAKES)
def test_mistakes_are_named(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(FileFormatError, match=words) as caught:
        stp.load(write(tmp_path, robot(*ARM, text, attributes='xmlns:drake="http://drake.mit.edu"')))
    assert caught.value.culprit and str(tmp_path) in caught.value.path


ALL_AT_ONCE = square(
    *BALLS.values(),
    GAZEBO.format(kind="ball", axis=""),
    BALL.replace("pin", "plus"),
    link("wheel"),
    joint("wheel_turn", "base", "wheel", content='<mimic joint="crank_turn" multiplier="2"/>'),
    '<coupling name="gear"><predecessor link="crank"/><successor link="wheel"/><ratio value="2"/></coupling>',
    transmission("crank_turn"),
    PLUGIN.replace("follow", "wheel_turn").replace("elbow", "crank_turn"),
    '<gravity xyz="0 0 -9.81"/>',
)


def damaged_yaml():
    """Return a strategy of a YAML with a hole or a stray word in it."""
    st = hypothesis.strategies
    text = YAML.format(kind="3d") + "joint_name: [free1]\njoint_type: [SPHERICAL]\n"
    words = [
        "",
        "[",
        "]",
        "'",
        ":",
        "mot1",
        "free2",
        "*a",
        "&a ",
        "\n",
        "!!python/x ",
        "\0",
        "{",
        "?",
        "- ",
        "|",
        "%",
        "#",
    ]
    step = st.tuples(st.integers(0, len(text)), st.integers(0, 8), st.sampled_from(words))

    def apply(steps: list) -> str:
        result = text
        for at, cut, put in steps:
            result = result[:at] + put + result[at + cut :]
        return result

    return st.lists(step, min_size=1, max_size=3).map(apply)


@quick()
@hypothesis.given(content=damaged(etree.fromstring(ALL_AT_ONCE)))
def test_damaged_dialects_load_or_fail_with_our_errors(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "fuzzed.urdf"
    path.write_bytes(content)
    assert_loads_or_says_why(path)


@quick()
@hypothesis.given(text=damaged_yaml())
def test_damaged_yaml_loads_or_fails_with_our_errors(tmp_path: Path, text: str) -> None:
    path = write(tmp_path, five_bar(), "robot.urdf")
    assert_loads_or_says_why(path, loops=write(tmp_path, text, "loops.yaml"))


@pytest.mark.slow
@quick(1500)
@hypothesis.given(content=damaged(etree.fromstring(ALL_AT_ONCE)), text=damaged_yaml())
def test_many_damaged_files(tmp_path: Path, content: bytes, text: str) -> None:
    path = tmp_path / "fuzzed.urdf"
    path.write_bytes(content)
    assert_loads_or_says_why(path)
    path = write(tmp_path, five_bar(), "robot.urdf")
    assert_loads_or_says_why(path, loops=write(tmp_path, text, "loops.yaml"))
