"""No word of a file is lost in silence: what is misspelt, changed, repeated or moved changes the robot or is told."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from zlib import crc32

import pytest
from lxml import etree

import stewart_pin as stp
from stewart_pin.errors import FileFormatError, StewartPinError
from stewart_pin.model.formats.dialect import claimed_tags
from stewart_pin.model.formats.reading import read_mechanism
from stewart_pin.model.formats.words import meant_word
from tests.model import sdf_reading, small_mjcf, test_sdf_fuzz, words_page
from tests.model.silent_losses import Reader, fate, mutants, silent_losses
from tests.model.small_dialects import (
    BALLS,
    GAZEBO,
    HINGE,
    HINGES,
    PLUGIN,
    YAML,
    drake_joint,
    five_bar,
    open_square,
    square,
    transmission,
)
from tests.small_sdf import TREES, sdf
from tests.small_sdf import joint as sdf_joint
from tests.small_sdf import link as sdf_link
from tests.small_urdf import ARM, AXIS_Z, MOTOR, bundled, joint, link, loop, robot, write

LIMITS = "<limit><lower>-1</lower><upper>1</upper><velocity>3</velocity></limit>"
CONTROL = (
    '<ros2_control name="r" type="system"><hardware><plugin>x/Y</plugin></hardware><joint name="shoulder">'
    '<command_interface name="position"><param name="min">-1</param></command_interface>'
    '<state_interface name="position"/></joint><joint name="follow"><param name="mimic">shoulder</param>'
    '<param name="multiplier">-2</param></joint></ros2_control>'
)
WORLD = (
    '<physics name="first"><gravity>0 0 -1</gravity></physics><state world_name="w"/><plugin name="p" filename="f"/>'
    '<physics name="second" default="1"><gravity>0 0 -3</gravity></physics>'
)
FOLLOWER = (link("s"), joint("follow", "base", "s"))
DYNAMICS = '<dynamics armature="0.1" damping="0.5" friction="0.2" stiffness="3 4" rest="0.2" force="7"/>'
UNIVERSAL = loop(
    "cross", "universal", "platform", "rocker", origin1='xyz="1 0 0"', origin2='xyz="1 0 0"',
    content='<axis xyz="1 0 0"/><axis2 xyz="0 1 0"/><dynamics coordinate="angle 2" damping="3"/>',
)  # fmt: skip
SDF_DYNAMICS = (
    "<dynamics><damping>0.5</damping><friction>0.2</friction><spring_stiffness>9</spring_stiffness>"
    "<spring_reference>0.3</spring_reference></dynamics>"
)
SDF_ROTOR = "<drake:rotor_inertia>0.01</drake:rotor_inertia><drake:gear_ratio>3</drake:gear_ratio>"
SAMPLES: dict[str, tuple[str, str]] = {
    **{kind: (square(text), ".urdf") for kind, text in BALLS.items()},
    **{f"{kind} hinge": (square(text), ".urdf") for kind, text in HINGES.items()},
    "urdf+": (square(HINGE), ".urdf"),
    "gazebo": (
        open_square(GAZEBO.format(kind="revolute", axis=f"<axis><xyz>0 0 1</xyz>{LIMITS}</axis>")), ".urdf",
    ),
    "yaml": (five_bar(), ".urdf"),
    "plugin": (robot(*ARM, *FOLLOWER, PLUGIN.replace("elbow", "shoulder")), ".urdf"),
    "transmission": (square(HINGE, transmission("crank_turn")).replace(MOTOR, ""), ".urdf"),
    "ros2_control": (robot(*ARM, *FOLLOWER, CONTROL).replace(MOTOR, ""), ".urdf"),
    **{
        f"drake {kind}": (
            robot(link("base"), link("platform"), drake_joint(kind, content), attributes='xmlns:drake="d"'), ".urdf",
        )
        for kind, content in {
            "ball": "", "planar": AXIS_Z, "universal": "",
            "screw": f'{AXIS_Z}<drake:screw_thread_pitch value="0.2"/>',
        }.items()
    },
    "physics": (
        robot(
            *ARM[:4], joint("elbow", "arm", "platform", "continuous", content=DYNAMICS), transmission("shoulder"),
            '<gazebo reference="shoulder"><springStiffness>9</springStiffness><springReference value="0.2"/></gazebo>',
            attributes='xmlns:drake="d"',
        ), ".urdf",
    ),
    "physics of loops": (
        square(HINGE.replace("</loop>", DYNAMICS.replace(' armature="0.1"', "") + "</loop>"), UNIVERSAL), ".urdf",
    ),
    "sdf, physics": (
        sdf(
            *(sdf_link(name) for name in "abc"), sdf_joint("j", "world", "a", axis=SDF_DYNAMICS, content=SDF_ROTOR),
            sdf_joint("ball", "world", "c", "ball", xyz="",
                      content="<axis><dynamics><damping>0.3</damping></dynamics></axis>"),
            '<drake:joint name="plane" type="planar"><drake:parent>a</drake:parent><drake:child>b</drake:child>'
            "<drake:damping>0.1 0.2 0.5</drake:damping></drake:joint>",
        ).replace("<sdf ", '<sdf xmlns:drake="drake.mit.edu" '), ".sdf",
    ),
    **{f"sdf, {kind}": (text, ".sdf") for kind, text in TREES.items()},
    **{f"sdf, {kind}": (sdf_reading.four_bar(text)[0], ".sdf") for kind, (text, _) in sdf_reading.CLOSINGS.items()},
    "sdf, gears": (etree.tostring(test_sdf_fuzz.BAR, encoding="unicode"), ".sdf"),
    **({"mjcf": (small_mjcf.WORKSHOP % (small_mjcf.TIES, small_mjcf.QPOS), ".xml")} if find_spec("mujoco") else {}),
    "sdf, a world": (etree.tostring(test_sdf_fuzz.WORLD, encoding="unicode"), ".sdf"),
}  # fmt: skip
"""A small file of every dialect, and its suffix."""


def read_by(folder: Path, name: str, suffix: str) -> Reader:
    return Reader(folder, suffix, {"sample.yaml": YAML.format(kind="3d")} if name == "yaml" else None)


def test_a_sample_of_mutants_of_every_dialect(tmp_path: Path) -> None:
    tried, lost = 0, {}
    for at, (name, (text, suffix)) in enumerate(SAMPLES.items()):
        (tmp_path / str(at)).mkdir()
        # By its name: another sample does not change which mutants of this one are tried.
        start = crc32(name.encode())
        count, bad = silent_losses(text, read_by(tmp_path / str(at), name, suffix), every=40, start=start)
        tried += count
        lost |= {name: dict(bad)} if bad else {}
    assert lost == {}
    assert tried > 300


@pytest.mark.slow
@pytest.mark.parametrize("name", SAMPLES)
def test_all_mutants(tmp_path: Path, name: str) -> None:
    text, suffix = SAMPLES[name]
    tried, bad = silent_losses(text, read_by(tmp_path, name, suffix), every=4)
    assert dict(bad) == {} and tried > 20


@pytest.mark.slow
@pytest.mark.parametrize("name", stp.robots())
def test_many_mutants_of_bundled_robots(tmp_path: Path, name: str) -> None:
    tried, bad = silent_losses(bundled(name).read_text(encoding="utf-8"), Reader(tmp_path), every=97)
    assert dict(bad) == {} and tried > 5


def test_the_judge_sees_a_loss(tmp_path: Path) -> None:
    # MuJoCo's settings inside a URDF are noted as a whole: what they hold may change unseen, and the judge sees it.
    _, bad = silent_losses(robot(*ARM, '<mujoco><compiler a="1"/></mujoco>'), Reader(tmp_path))
    assert any("robot/mujoco/compiler@a" in each for each in bad)


def test_a_default_that_moves_is_no_loss(tmp_path: Path) -> None:
    text, suffix = SAMPLES["sdf, gears"]
    reader = read_by(tmp_path, "sdf, gears", suffix)
    before = reader.read(text)
    moved = [m for m in mutants(text) if (m.kind, m.place) == ("move", "sdf/model/link/pose")]
    assert len(moved) > 5 and {fate(mutant, reader, before) for mutant in moved} <= {"changed", "refused"}


SLIPS = {
    "a tag of a joint": ('<orign xyz="1 0 0"/>', "<orign> of <joint> .line 2.*is <origin> meant"),
    "a case": ('<Axis xyz="1 0 0"/>', "<Axis> of <joint> .line 2.*is <axis> meant"),
    "a plural": ('<limits lower="-1" upper="1"/>', "<limits> of <joint> .line 2.*is <limit> meant"),
    "an attribute": ('<limit lowr="-1" upper="1"/>', "'lowr' of <limit> .line 2.*is 'lower' meant"),
    "text": ("<origin>0 0 1</origin>", "the text '0 0 1' in <origin> .line 2.*it may have xyz, rpy"),
}


@pytest.mark.parametrize(("text", "words"), SLIPS.values(), ids=SLIPS)
def test_misspelt_words_are_refused_with_the_right_one(tmp_path: Path, text: str, words: str) -> None:
    wrong = robot(*ARM[:3], "\n", joint("j", "base", "arm", axis="", content=text), ARM[4])
    with pytest.raises(FileFormatError, match=words) as caught:
        stp.load(write(tmp_path, wrong))
    assert str(tmp_path) in str(caught.value)


def test_an_error_that_comes_later_tells_what_was_not_understood(tmp_path: Path) -> None:
    text = robot(*ARM, link("lost"), '<jt name="hold" type="fixed"/>', joint("j2", "lost", "nowhere"))
    with pytest.raises(StewartPinError, match=r"nowhere.*not understood in this file: <jt name='hold'>"):
        stp.load(write(tmp_path, text))


def beside(folder: Path, content: bytes, suffix: str = ".yaml") -> stp.ClosedChain:
    (folder / f"small{suffix}").write_bytes(content)
    return stp.load(write(folder, five_bar()))


@pytest.mark.parametrize("suffix", [".yaml", ".yml", ".YAML", ".Yml"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_yaml_beside_is_found_however_it_is_written(tmp_path: Path, suffix: str, encoding: str) -> None:
    chain = beside(tmp_path, YAML.format(kind="3d").encode(encoding), suffix)
    assert [loop.name for loop in chain.loops] == ["closedloop1"] and chain.motors == ("mot1", "mot2")


def test_a_yaml_beside_with_types_of_joints_alone_counts(tmp_path: Path) -> None:
    assert beside(tmp_path, b"joint_name: [free1]\njoint_type: [SPHERICAL]\n").nv == 6
    assert beside(tmp_path, b"controllers: {joint_names: [free1]}\n").nv == 4


def test_a_misspelt_key_of_a_yaml_beside_is_named(tmp_path: Path) -> None:
    wrong = YAML.format(kind="3d").replace("closed_loop", "closed_lop")
    with pytest.raises(FileFormatError, match="'closed_lop' is not understood; is 'closed_loop' meant"):
        beside(tmp_path, wrong.encode())


def test_paths_of_side_cars_that_are_none_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError):
        stp.load(write(tmp_path, five_bar()), loops="a\0b.yaml")


def test_of_two_closures_at_one_place_none_is_lost_in_silence(tmp_path: Path) -> None:
    hinge, ball = HINGES["old drake"].replace("pin", "own"), BALLS["isaac"].replace("pin", "own")
    frames = BALLS["closing frames"]
    assert "closed already by the revolute loop 'own'" in str(
        stp.load(write(tmp_path, square(frames, hinge))).report
    )
    with pytest.raises(FileFormatError, match="are those of a hinge, and loop 'own' is spherical"):
        stp.load(write(tmp_path, square(HINGES["closing frames"], ball)))
    away = BALLS["isaac"].replace('"pin"', '"closing_pin"').replace('xyz="1 0 0"', 'xyz="0.5 0 0"')
    with pytest.raises(FileFormatError, match="have one name, and close at different places"):
        stp.load(write(tmp_path, square(frames, away)))


def test_two_motors_of_one_name_are_refused(tmp_path: Path) -> None:
    twice = square(HINGE, transmission("crank_turn"), joint("crank_turn", "base", "rocker")).replace(
        MOTOR, ""
    )
    with pytest.raises(FileFormatError, match="joints are called 'crank_turn'"):
        stp.load(write(tmp_path, twice))


def test_states_and_plugins_of_a_world_are_told(tmp_path: Path) -> None:
    text = SAMPLES["sdf, a world"][0].replace("<gravity>0 0 -9.8</gravity>", WORLD)
    chain = stp.load(write(tmp_path, text, "world.sdf"))
    assert chain.gravity[2] == -3.0
    assert all(word in str(chain.report) for word in ("<state>", "<plugin> 'p'", "<physics> 'first'"))
    with pytest.raises(StewartPinError, match="could hold or couple"):
        stp.load(write(tmp_path, text.replace('name="p"', 'name="gearbox"'), "world.sdf"))


def test_a_misspelt_follower_of_a_plugin_is_refused(tmp_path: Path) -> None:
    text = SAMPLES["plugin"][0].replace("mimicJoint>", "mimcJoint>")
    with pytest.raises(FileFormatError, match=r"<mimcJoint> of a <plugin> .line 1. .*is <mimicJoint> meant"):
        stp.load(write(tmp_path, text))


def test_params_of_ros2_control_couple(tmp_path: Path) -> None:
    chain = stp.load(write(tmp_path, SAMPLES["ros2_control"][0]))
    (coupling,) = chain.couplings
    assert (coupling.joint1, coupling.joint2, coupling.polynomial) == ("follow", "shoulder", (0.0, -2.0))


def test_words_that_are_meant() -> None:
    known = ("origin", "axis", "axis2", "least_effort")
    pairs = {"orign": "origin", "roigin": "origin", "Origin": "origin", "originn": "origin", "axes": "axis"}
    assert {word: meant_word(word, known) for word in pairs} == pairs
    assert meant_word("least-effort", known) == "least_effort"
    assert [meant_word(word, known) for word in ("dynamics", "ax", "rigid", "")] == [""] * 4


def test_words_of_other_programs_are_told_as_they_stand_in_the_file(tmp_path: Path) -> None:
    drake = 'xmlns:drake="http://drake.mit.edu"'
    turn = joint("j", "base", "arm", content='<limit effort="3" drake:acceleration="2"/>')
    look = "<visual><geometry><drake:capsule radius='1' length='2'/></geometry></visual></link>"
    paint = "<gazebo><material>Gazebo/Red</material></gazebo>"
    text = robot(link("base"), link("arm").replace("</link>", look), turn, paint, attributes=drake)
    notes = [note.text for note in read_mechanism(write(tmp_path, text)).notes]
    assert "attribute 'drake:acceleration' of <limit>: unknown" in notes
    assert not [note for note in notes if "capsule" in note or "the text in" in note]


def test_the_page_of_words_is_that_of_the_readers() -> None:
    assert words_page.PAGE.read_text(encoding="utf-8") == words_page.page(), (
        "write it anew: python -m tests.model.words_page"
    )


def test_every_tag_that_a_dialect_claims_has_its_words() -> None:
    unknown = [tag for tag in claimed_tags() if f"`<{tag.partition('/')[2]}>`" not in words_page.page()]
    assert unknown == []
    formats = ("URDF and SRDF", "Gepetto YAML", "SDFormat", "MJCF", "OpenUSD")
    assert [each for each in formats if f"## {each}\n" not in words_page.page()] == []


MISPLACED = {
    "axis in a link": (link("s", '<axis xyz="0 0 1"/>'), "link 's': <axis>", "<link>; put it into a <joint>"),
    "mass in a link": (link("s", '<mass value="1"/>'), "link 's': <mass>", "into the <inertial> of a <link>"),
    "mass in a shape": (link("s", '<collision><mass value="1"/></collision>'), "<mass>", "<collision>; put it into"),
    "inertial of the file": ("<inertial/>", "<inertial>", "<robot>; put it into a <link>"),
    "limit in a link": (link("s", '<limit lower="1"/>'), "link 's': <limit>", "into a <joint>"),
    "inertial in a joint": (joint("j", "base", "s", content="<inertial/>"), "joint 'j': <inertial>", "into a <link>"),
    "origin in a limit": (
        joint("j", "base", "s", content='<limit lower="0"><origin xyz="1 0 0"/></limit>'),
        "joint 'j': <origin>", "<limit>; put it into a <joint>, an <inertial> or a shape",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("content", "word", "remedy"), MISPLACED.values(), ids=MISPLACED)
def test_known_words_at_a_wrong_place_are_refused(
    tmp_path: Path, content: str, word: str, remedy: str
) -> None:
    with pytest.raises(FileFormatError, match=f"{word} \\(line 3\\) means nothing in .*{remedy}"):
        stp.load(write(tmp_path, robot(*ARM, "\n\n", content)))


def test_an_origin_of_a_link_is_told(tmp_path: Path) -> None:
    text = robot(*ARM).replace('<link name="arm">', '<link name="arm"><origin xyz="0 0 1"/>')
    report = str(stp.load(write(tmp_path, text)).report)
    assert "<origin>: a link stands where its joint places it (link 'arm')" in report
