"""Damping, friction, springs and rotors of URDF and SDFormat, in hand-written files: what each number becomes."""

from __future__ import annotations

from pathlib import Path

import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError, MechanismError
from stewart_pin.model.description import Mechanism
from stewart_pin.model.formats.reading import read_urdf
from stewart_pin.model.joint_physics import JointPhysics
from tests.model.sdf_reading import read
from tests.model.small_dialects import BALLS, GAZEBO, HINGE, HINGES, TIP, drake_joint, open_square, square
from tests.small_sdf import BODY, HOLD, axis2
from tests.small_sdf import joint as sdf_joint
from tests.small_sdf import link as sdf_link
from tests.small_urdf import ARM, AXIS_Z, joint, link, loop, robot, write

BOTH = '<dynamics damping="0.5" friction="0.2"/>'


def urdf(folder: Path, *parts: str, attributes: str = "") -> Mechanism:
    return read_urdf(write(folder, robot(*parts, attributes=attributes)))


def hung(folder: Path, kind: str, dynamics: str, axis: str = AXIS_Z) -> Mechanism:
    return urdf(
        folder,
        link("base"),
        link("platform"),
        joint("j", "base", "platform", kind, axis=axis, content=dynamics),
    )


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic", "spherical", "floating"])
def test_the_words_of_urdf(kind: str, tmp_path: Path) -> None:
    limit = (
        '<limit lower="-1" upper="1" effort="1" velocity="1"/>' if kind in ("revolute", "prismatic") else ""
    )
    (made,) = hung(tmp_path, kind, BOTH + limit).joints
    assert made.physics == JointPhysics(damping=0.5, friction=0.2)


def test_words_of_our_own_hold_all(tmp_path: Path) -> None:
    text = '<dynamics armature="0.1" damping="0.2" stiffness="3 0 5" rest="-0.3" force="7"/>'
    (made,) = hung(tmp_path, "continuous", text).joints
    assert made.physics == JointPhysics(0.1, 0.2, 0.0, (3.0, 0.0, 5.0), -0.3, 7.0)


def test_a_joint_of_several_freedoms_has_one_number_for_all_or_one_for_each(tmp_path: Path) -> None:
    alike = hung(tmp_path, "planar", '<dynamics damping="0.5"/>')
    assert [each.physics.damping for each in alike.joints] == [0.5] * 3
    assert "one number tells of its 3 coordinates alike" in str([note.text for note in alike.notes])
    each = hung(tmp_path, "planar", '<dynamics damping="1 2 3" friction="4"/>')
    assert [(j.physics.damping, j.physics.friction) for j in each.joints] == [(1, 4), (2, 4), (3, 4)]
    row = hung(tmp_path, "cylindrical", '<dynamics damping="1 2"/>')
    assert [(j.name, j.physics.damping) for j in row.joints] == [("j_slide", 1), ("j_turn", 2)]


REFUSED = {
    "negative": (
        '<dynamics damping="-1"/>',
        "joint 'j': the damping is -1; it must be zero or more .<dynamics>, line",
    ),
    "friction": ('<dynamics friction="-0.1"/>', "friction is -0.1"),
    "rotor": ('<dynamics armature="-0.1"/>', "armature is -0.1"),
    "no number": (
        '<dynamics damping="much"/>',
        "joint 'j': <dynamics damping> .* must hold numbers, got 'much'",
    ),
    "nothing": ('<dynamics damping=""/>', "joint 'j': <dynamics> .* lacks 'damping'"),
    "infinite": ('<dynamics damping="inf"/>', "must be finite"),
    "two": ('<dynamics damping="1 2"/>', "must hold one number, got 2"),
    "twice": ('<dynamics damping="1"/><dynamics damping="2"/>', "has 2 <dynamics>; keep one"),
    "misspelt": ('<dynamics dampng="1"/>', "'dampng' of <dynamics> .* is 'damping' meant"),
}


@pytest.mark.parametrize(("text", "words"), REFUSED.values(), ids=REFUSED)
def test_numbers_that_cannot_be_are_refused_with_file_and_joint(
    text: str, words: str, tmp_path: Path
) -> None:
    with pytest.raises(FileFormatError, match=words) as caught:
        hung(tmp_path, "continuous", text)
    assert str(tmp_path) in str(caught.value)


def test_several_freedoms_have_no_spring_of_their_own(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="along which coordinate of a planar joint is not said"):
        hung(tmp_path, "planar", '<dynamics stiffness="1"/>')


def test_what_does_not_move_has_none(tmp_path: Path) -> None:
    made = hung(tmp_path, "fixed", BOTH)
    assert not made.joints[0].physics and "a joint that does not move has none" in str(made.notes)


UNIVERSAL = loop(
    "pin", "universal", "platform", "rocker", origin1=TIP, origin2=TIP,
    content='<axis xyz="1 0 0"/><axis2 xyz="0 1 0"/>{}',
)  # fmt: skip
IN_LOOPS = {
    "hinge": (square(HINGE.replace("</loop>", f"{BOTH}</loop>")), [(0.5, 0.2)]),
    "both turns alike": (square(UNIVERSAL.format(BOTH)), [(0.5, 0.2)] * 2),
    "one of two": (
        square(UNIVERSAL.format('<dynamics coordinate="angle 2" damping="3"/>')), [(0.0, 0.0), (3.0, 0.0)],
    ),
    "ball": (
        square(BALLS["isaac"].replace("</loop_joint>", '<dynamics damping="0.5"/></loop_joint>')), [(0.5, 0.0)],
    ),
    "old drake": (square(HINGES["old drake"].replace("</loop_joint>", f"{BOTH}</loop_joint>")), [(0.5, 0.2)]),
    "urdfdom": (square(HINGES["urdfdom"].replace("</constraint>", f"{BOTH}</constraint>")), [(0.5, 0.2)]),
    "second parent": (square(joint("pin", "platform", "rocker", "continuous", content=BOTH)), [(0.5, 0.2)]),
    "gazebo": (
        open_square(GAZEBO.format(kind="revolute", axis="<axis><xyz>0 0 1</xyz><dynamics><damping>0.5</damping>"
                    "<friction>0.2</friction><spring_stiffness>7</spring_stiffness><spring_reference>0.3</spring_reference>"
                    "</dynamics></axis>")),
        [(0.5, 0.2)],
    ),
}  # fmt: skip


@pytest.mark.parametrize(("text", "wanted"), IN_LOOPS.values(), ids=IN_LOOPS)
def test_joints_that_close_loops(text: str, wanted: list[tuple[float, float]], tmp_path: Path) -> None:
    (closing,) = read_urdf(write(tmp_path, text)).loops
    assert [(each.damping, each.friction) for each in closing.physics] == wanted
    assert closing.physics[0].stiffness == ((7.0,) if "spring" in text else ())
    assert closing.physics[0].rest == (0.3 if "spring" in text else 0.0)


def test_a_coordinate_that_a_loop_lacks_is_refused(tmp_path: Path) -> None:
    for wrong in ("angle", "x"):
        with pytest.raises(
            FileFormatError, match=f"coordinate='{wrong}'.*a universal joint has angle 1, angle 2"
        ):
            read_urdf(
                write(tmp_path, square(UNIVERSAL.format(f'<dynamics coordinate="{wrong}" damping="1"/>')))
            )


def test_a_rotor_in_a_loop_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(MechanismError, match="'pin' closes a loop and has a rotor"):
        stp.load(write(tmp_path, square(HINGE.replace("</loop>", '<dynamics armature="1"/></loop>'))))


# ----------------------------------------------------------------------------------------------------
# Springs of Gazebo beside the joints of a URDF
# ----------------------------------------------------------------------------------------------------

SPRING = "<springStiffness>9</springStiffness><springReference>0.4</springReference>"


def test_springs_that_gazebo_puts_into_joints(tmp_path: Path) -> None:
    spring = f'<gazebo reference="elbow">{SPRING}</gazebo>'
    made = urdf(tmp_path, *ARM, spring)
    assert made.joint("elbow").physics == JointPhysics(stiffness=(9.0,), rest=0.4)
    assert not made.joint("shoulder").physics and not made.notes
    more = urdf(
        tmp_path, *ARM, spring.replace("</gazebo>", "<implicitSpringDamper>1</implicitSpringDamper></gazebo>")
    )
    assert more.joint("elbow").physics == made.joint("elbow").physics and "simulator settings" in str(
        more.notes
    )


def test_springs_of_nothing_are_told_and_two_are_refused(tmp_path: Path) -> None:
    lost = urdf(tmp_path, *ARM, f'<gazebo reference="arm">{SPRING}</gazebo>')
    assert "<springStiffness>: no joint of one freedom is called so" in str(lost.notes)
    with pytest.raises(FileFormatError, match="'elbow'> has <springStiffness> twice"):
        urdf(tmp_path, *ARM, f'<gazebo reference="elbow">{SPRING}</gazebo>' * 2)
    own = joint("elbow", "arm", "platform", "continuous", content='<dynamics stiffness="1"/>')
    parts = [own if 'name="elbow"' in part else part for part in ARM]
    with pytest.raises(FileFormatError, match="a spring in <dynamics> and one in <gazebo>"):
        urdf(tmp_path, *parts, f'<gazebo reference="elbow">{SPRING}</gazebo>')


# ----------------------------------------------------------------------------------------------------
# Drake's words
# ----------------------------------------------------------------------------------------------------

ROTOR = '<drake:rotor_inertia value="0.01"/><drake:gear_ratio value="-3"/>'


def transmission(name: str, rotor: str = ROTOR) -> str:
    return (
        f'<transmission name="t_{name}"><type>transmission_interface/SimpleTransmission</type><joint name="{name}"/>'
        f'<actuator name="m_{name}">{rotor}</actuator></transmission>'
    )


def test_a_rotor_counts_by_the_square_of_its_gear(tmp_path: Path) -> None:
    made = urdf(tmp_path, *ARM, transmission("elbow"))
    assert made.joint("elbow").physics.armature == pytest.approx(0.09, rel=1e-15)
    bare = urdf(tmp_path, *ARM, transmission("elbow", ROTOR.partition("/>")[0] + "/>"))
    assert bare.joint("elbow").physics.armature == 0.01


def test_rotors_that_drake_does_not_have_are_told(tmp_path: Path) -> None:
    still = joint(
        "elbow",
        "arm",
        "platform",
        "revolute",
        content='<limit lower="-1" upper="1" effort="0" velocity="1"/>',
    )
    parts = [still if 'name="elbow"' in part else part for part in ARM]
    made = urdf(tmp_path, *parts, transmission("elbow"))
    assert not made.joint("elbow").physics.armature and "its rotor of 0.09 is left out" in str(made.notes)
    lost = urdf(tmp_path, *ARM, transmission("wrist"))
    assert "joint 'wrist'" in str(lost.notes) and "its rotor of 0.09 is left out" in str(lost.notes)
    with pytest.raises(FileFormatError, match=r"has two rotors, of 0\.09 and 0\.5; keep one"):
        urdf(
            tmp_path, *ARM, transmission("elbow"), transmission("elbow", '<drake:rotor_inertia value="0.5"/>')
        )
    with pytest.raises(FileFormatError, match=r"rotor_inertia> .line 1. is -1; it must be zero or more"):
        urdf(tmp_path, *ARM, transmission("elbow", '<drake:rotor_inertia value="-1"/>'))


DRAKES = {
    "ball": ("", "0.5", [0.5]),
    "universal": ("", "0.5", [0.5, 0.5]),
    "planar": (AXIS_Z, "0.5 0.6 0.7", [0.5, 0.6, 0.7]),
    "screw": (f'{AXIS_Z}<drake:screw_thread_pitch value="0.2"/>', "0.5", [0.5, 0.0]),
}


@pytest.mark.parametrize(
    ("kind", "content", "damping", "wanted"), [(k, *v) for k, v in DRAKES.items()], ids=DRAKES
)
def test_damping_of_drakes_joints(
    kind: str, content: str, damping: str, wanted: list[float], tmp_path: Path
) -> None:
    dynamics = f'<dynamics damping="{damping}"/>'
    made = urdf(tmp_path, link("base"), link("platform"), drake_joint(kind, content + dynamics))
    assert [each.physics.damping for each in made.joints] == wanted


def test_drakes_axes_in_a_plane_are_not_guessed(tmp_path: Path) -> None:
    parts = (
        link("base"),
        link("platform"),
        drake_joint("planar", '<axis xyz="1 0 0"/><dynamics damping="{}"/>'),
    )
    with pytest.raises(FileFormatError, match="tells otherwise of x than of y"):
        urdf(tmp_path, *(part.replace("{}", "1 2 3") for part in parts))
    made = urdf(tmp_path, *(part.replace("{}", "1 1 3") for part in parts))
    assert [each.physics.damping for each in made.joints] == [1, 1, 3]


def test_springs_between_points_are_told_with_their_numbers(tmp_path: Path) -> None:
    numbers = {"stiffness": "700", "damping": "3", "free_length": "0.4"}
    for suffix, text in (("", '<{0} value="{1}"/>'), ("s", "<{0}>{1}</{0}>")):
        inner = "".join(
            text.format(f"drake:linear_spring_damper_{key}", value) for key, value in numbers.items()
        )
        spring = f"<drake:linear_spring_damper>{inner}</drake:linear_spring_damper>"
        made = read(tmp_path, sdf_link("a"), spring) if suffix else urdf(tmp_path, *ARM, spring)
        (told,) = (note.text for note in made.notes if "spring" in note.text + note.subject)
        assert "which no joint is; a joint may have one (stiffness 700, damping 3, free_length 0.4)" in told


# ----------------------------------------------------------------------------------------------------
# SDFormat
# ----------------------------------------------------------------------------------------------------

DYNAMICS = (
    "<dynamics><damping>0.5</damping><friction>0.2</friction><spring_stiffness>9</spring_stiffness>"
    "<spring_reference>0.3</spring_reference></dynamics>"
)
ALL = JointPhysics(0.0, 0.5, 0.2, (9.0,), 0.3)
DRAKE_ROTOR = "<drake:rotor_inertia>0.01</drake:rotor_inertia><drake:gear_ratio>-3</drake:gear_ratio>"


def sdf(folder: Path, kind: str, axis: str = DYNAMICS, content: str = "", xyz: str = "0 0 1") -> Mechanism:
    return read(
        folder, sdf_link("a"), sdf_joint("j", "world", "a", kind, xyz=xyz, axis=axis, content=content)
    )


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic"])
def test_the_words_of_sdformat(kind: str, tmp_path: Path) -> None:
    assert sdf(tmp_path, kind).joint("j").physics == ALL
    assert sdf(tmp_path, kind, "<dynamics><damping/></dynamics>").joint("j").physics == JointPhysics()


def test_each_axis_of_a_universal_joint_does_its_own(tmp_path: Path) -> None:
    made = sdf(tmp_path, "universal", content=axis2("0 1 0", "<dynamics><friction>3</friction></dynamics>"))
    assert [made.joint(f"j_{k}").physics for k in (1, 2)] == [ALL, JointPhysics(friction=3.0)]


def test_a_screw_is_damped_as_it_turns(tmp_path: Path) -> None:
    made = sdf(tmp_path, "screw", content="<screw_thread_pitch>0.2</screw_thread_pitch>" + DRAKE_ROTOR)
    assert made.joint("j").physics.damping == 0.5 and not made.joint("j_slide").physics
    assert made.joint("j").physics.armature == pytest.approx(0.09, rel=1e-15)


def test_a_ball_is_damped_where_drake_looks(tmp_path: Path) -> None:
    made = sdf(tmp_path, "ball")
    assert made.joint("j").physics == JointPhysics(damping=0.5)
    assert {"<friction>: unknown tag", "<xyz>: a ball has none"} <= {note.text for note in made.notes}


def test_drakes_planar_joint_is_damped_along_each_coordinate(tmp_path: Path) -> None:
    text = (
        '<drake:joint name="j" type="planar"><drake:parent>a</drake:parent><drake:child>b</drake:child>'
        "<drake:damping>0.5 0.6 0.7</drake:damping></drake:joint>"
    )
    made = read(tmp_path, sdf_link("a"), sdf_link("b"), HOLD, text)
    assert [made.joint(f"j_{part}").physics.damping for part in ("x", "y", "turn")] == [0.5, 0.6, 0.7]


def test_rotors_of_sdformat(tmp_path: Path) -> None:
    assert sdf(tmp_path, "revolute", content=DRAKE_ROTOR).joint("j").physics.armature == pytest.approx(
        0.09, rel=1e-15
    )
    still = sdf(tmp_path, "revolute", "<limit><effort>0</effort></limit>", DRAKE_ROTOR)
    assert not still.joint("j").physics and "its rotor of 0.09 is left out" in str(still.notes)


def test_a_free_body_has_words_of_our_own_and_others_are_told(tmp_path: Path) -> None:
    own = sdf_link("a", content=BODY + '<stewart_pin:dynamics damping="0.5"/>')
    assert read(tmp_path, own).joint("a_floating").physics == JointPhysics(damping=0.5)
    held = read(tmp_path, own, HOLD)
    assert not any(joint.physics for joint in held.joints)
    assert "<stewart_pin:dynamics>: damping 0.5 left out, as it does not float" in {
        n.text for n in held.notes
    }


SDF_REFUSED = {
    "negative": (
        "<dynamics><damping>-1</damping></dynamics>",
        "",
        "joint 'j': the damping is -1; it must be zero or more",
    ),
    "no number": (
        "<dynamics><friction>much</friction></dynamics>",
        "",
        "joint 'j': <friction> .* must hold numbers",
    ),
    "misspelt": (
        "<dynamics><dampng>1</dampng></dynamics>",
        "",
        "<dampng> of <dynamics> .* is 'damping' meant",
    ),
    "rotor": (
        "",
        "<drake:rotor_inertia>-1</drake:rotor_inertia>",
        "rotor_inertia> is -1; it must be zero or more",
    ),
}


@pytest.mark.parametrize(("axis", "content", "words"), SDF_REFUSED.values(), ids=SDF_REFUSED)
def test_numbers_that_cannot_be_in_sdformat(axis: str, content: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=words):
        sdf(tmp_path, "revolute", axis, content)


def test_a_rotor_stays_in_the_tree(tmp_path: Path) -> None:
    """Of two joints with one child, the one that is cut has no rotor, wherever it stands in the file."""
    text = (
        sdf_joint("pin", "b", "a", "revolute", content=DRAKE_ROTOR),
        sdf_joint("last", "world", "a", axis=DYNAMICS),
    )
    for parts in (text, text[::-1]):
        made = read(tmp_path, sdf_link("a"), sdf_link("b"), sdf_joint("first", "world", "b"), *parts)
        assert [closing.name for closing in made.loops] == ["last"]
        assert made.joint("pin").physics.armature > 0 and made.loops[0].physics == (ALL,)


# ----------------------------------------------------------------------------------------------------
# Written for others
# ----------------------------------------------------------------------------------------------------


def text_of(chain: stp.ClosedChain, physics: dict, folder: Path, format: str) -> tuple[str, str]:
    path = folder / ("a.sdf" if format == "sdf" else "a.urdf")
    report = stp.export(stp.with_joint_physics(chain, physics), path, format=format)
    return path.read_text("utf-8"), str(report)


def test_a_preloaded_spring_is_one_that_rests_elsewhere(tmp_path: Path) -> None:
    """To others it stands at the place where it pushes as much; to us as it is."""
    chain = stp.load("four_bar")
    name = chain.motors[0]
    (home,) = stp.motor_positions(chain, chain.q_home)
    for rest in (home, home + 0.25):
        told, report = text_of(chain, {name: {"stiffness": 8.0, "rest": rest, "force": 2.0}}, tmp_path, "sdf")
        reference = float(told.partition("<spring_reference>")[2].partition("<")[0])
        assert reference == pytest.approx(rest - home + 0.25, abs=1e-15) and report == "nothing was ignored"
        again = stp.load(tmp_path / "a.sdf").described().joint(name).physics
        assert again.rest == pytest.approx(rest, abs=1e-15) and (again.stiffness, again.force) == (
            (8.0,),
            2.0,
        )


def test_what_others_know_needs_no_word_of_ours(tmp_path: Path) -> None:
    chain = stp.load("four_bar")
    plain = {
        chain.motors[0]: {"armature": 0.1, "damping": 0.2, "friction": 0.3, "stiffness": 8.0, "rest": 1.0}
    }
    told, report = text_of(chain, plain, tmp_path, "sdf")
    assert "<drake:rotor_inertia>0.1<" in told and "words of our own" not in report
    assert not any(
        f"stewart_pin:{key}" in told for key in ("armature", "stiffness", "rest", "force", "dynamics")
    )


def test_drake_finds_rotors_of_motors_and_hears_of_no_others(tmp_path: Path) -> None:
    chain = stp.build.loops_by_balls(stp.load("four_bar"))
    passive = next(name for name in chain.model.names[1:] if name not in chain.motors)
    told, report = text_of(
        chain, {name: {"armature": 0.1} for name in (*chain.motors, passive)}, tmp_path, "drake"
    )
    assert told.count("<drake:rotor_inertia") == 1 and told.count("armature=") == 1
    assert f"armature 0.1: in attributes of <dynamics> that Drake passes over (joint '{passive}')" in report


def test_negative_springs_do_not_end_drake(tmp_path: Path) -> None:
    chain = stp.load("four_bar")
    told, report = text_of(chain, {chain.motors[0]: {"stiffness": -2.0}}, tmp_path, "sdf")
    assert "spring_stiffness" not in told and "stiffness -2" in report
    assert stp.load(tmp_path / "a.sdf").described().joint(chain.motors[0]).physics.stiffness == (-2.0,)


def test_types_of_a_yaml_keep_what_the_urdf_tells_of_turns(tmp_path: Path) -> None:
    parts = (*ARM[:3], joint("free", "base", "arm", "continuous", content=BOTH), *ARM[4:])
    path = write(tmp_path, robot(*parts))
    for kind, names, physics in (
        ("SPHERICAL", ["free"], JointPhysics(damping=0.5, friction=0.2)),
        ("UJOINT_XY", ["free_1", "free_2"], JointPhysics(damping=0.5, friction=0.2)),
        ("FIXED", ["free"], JointPhysics()),
    ):
        path.with_suffix(".yaml").write_text(f"joint_name: [free]\njoint_type: [{kind}]\n")
        made = read_urdf(path)
        assert [made.joint(name).physics for name in names] == [physics] * len(names)
        assert ("its <dynamics> in the URDF" in str(made.notes)) == (kind != "SPHERICAL")
