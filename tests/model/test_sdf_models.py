"""Which model of an SDFormat file is read: worlds, nested and included models."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError, FileMissingError, UnsupportedError
from stewart_pin.model.description import JointKind
from stewart_pin.model.formats.sdf import read_sdf
from tests.model.sdf_reading import position
from tests.small_sdf import BODY, joint, link, sdf, write

ARM = (link("a", "0 0 1 0 0 0"), joint("j", "world", "a"))


def world(*parts: str, version: str = "1.6") -> str:
    return f'<sdf version="{version}"><world name="w">{"".join(parts)}</world></sdf>'


def model(name: str, *parts: str, attributes: str = "") -> str:
    return f'<model name="{name}" {attributes}>{"".join(parts)}</model>'


def test_a_world_with_one_model(tmp_path: Path) -> None:
    parts = ("<gravity>0 0 -1.62</gravity>", "<light name='sun' type='directional'/>", model("arm", *ARM))
    mechanism = read_sdf(write(tmp_path, world(*parts)))
    assert (mechanism.name, mechanism.gravity) == ("arm", (0, 0, -1.62))


def test_gravity_of_old_worlds_stands_in_their_physics(tmp_path: Path) -> None:
    physics = '<physics type="ode"><gravity>0 0 -3.7</gravity></physics>'
    assert read_sdf(write(tmp_path, world(physics, model("arm", *ARM), version="1.5"))).gravity == (
        0,
        0,
        -3.7,
    )
    assert read_sdf(write(tmp_path, world(model("arm", *ARM)))).gravity is None
    assert read_sdf(write(tmp_path, sdf(*ARM))).gravity is None


def test_the_model_with_joints_is_the_robot(tmp_path: Path) -> None:
    ground = model("ground", "<static>1</static>", link("plate"))
    sun = "<include><uri>model://sun</uri></include>"
    mechanism = read_sdf(write(tmp_path, world(sun, ground, model("arm", *ARM))))
    assert mechanism.name == "arm"
    assert {note.text for note in mechanism.notes} >= {
        "<include> 'model://sun': another model",
        "<model> 'ground': another model",
    }


def test_several_robots_of_a_world_are_one_mechanism(tmp_path: Path) -> None:
    aside = "<pose>3 0 0 0 0 0</pose>"
    text = world(model("one", *ARM), model("house", link("wall")), model("two", aside, *ARM, link("b")))
    mechanism = read_sdf(write(tmp_path, text))
    assert {(x.name, x.kind, x.parent) for x in mechanism.joints} == {
        ("one::j", JointKind.REVOLUTE, "world"),
        ("two::j", JointKind.REVOLUTE, "world"),
        ("two::b_floating", JointKind.FLOATING, "world"),
    }
    np.testing.assert_array_equal(position(mechanism, "two::a"), [3, 0, 1])
    told = {note.text for note in mechanism.notes}
    assert told >= {
        "<model> 'house': another model",
        "models 'one', 'two': read as one mechanism, their links and joints as model::name",
    }
    chain = stp.load(tmp_path / "small.sdf", motors=["one::j"], platform="two::a")
    assert chain.nv == 8
    with pytest.raises(FileFormatError, match="are called 'one'; rename one"):
        read_sdf(write(tmp_path, world(model("one", *ARM), model("one", *ARM))))


def test_models_without_joints_are_listed(tmp_path: Path) -> None:
    boxes = (model("one", link("a")), model("two", link("a")))
    with pytest.raises(
        FileFormatError, match=r"not one model.*'one', 'two'; load the file of the robot alone"
    ):
        read_sdf(write(tmp_path, world(*boxes)))
    with pytest.raises(FileFormatError, match=r"not one model.*: none"):
        read_sdf(write(tmp_path, world()))


def test_a_world_may_hold_the_robot(tmp_path: Path) -> None:
    """By joints of its own, to itself or to its frames: 1 m above the table, half a turn about x from there."""
    parts = (
        '<frame name="table"><pose>0 0 1 0 0 0</pose></frame>',
        model(
            "arm",
            link("base", "0 0 2 0 0 0"),
            link("tip", "0 0 3 0 0 0"),
            joint("j", "base", "tip", xyz="1 0 0"),
        ),
        joint("hold", "table", "arm::base", "fixed", xyz=""),
    )
    mechanism = read_sdf(write(tmp_path, world(*parts, version="1.10")))
    assert {(x.name, x.kind, x.parent) for x in mechanism.joints} == {
        ("hold", JointKind.FIXED, "world"),
        ("j", JointKind.REVOLUTE, "base"),
    }
    np.testing.assert_array_equal(position(mechanism, "tip"), [0, 0, 3])
    hinge = joint("turn", "world", "arm::base", pose="0 0 -1 0 0 0", xyz="1 0 0")
    mechanism = read_sdf(write(tmp_path, world(*parts[:2], hinge, version="1.10")))
    np.testing.assert_array_equal(position(mechanism, "tip", turn=np.pi), [0, 0, -1])


def test_a_model_that_a_world_joins_to_the_robot_belongs_to_it(tmp_path: Path) -> None:
    """It floats, and the joint closes a loop; a table that stands still is the ground."""
    for attributes, extra in (("", 1), ("<static>true</static>", 0)):
        table = model("table", attributes, link("plate", "0 0 1 0 0 0"))
        text = world(table, model("one", *ARM), joint("k", "table::plate", "one::a"), version="1.10")
        mechanism = read_sdf(write(tmp_path, text))
        assert [(x.name, x.link1, x.link2) for x in mechanism.loops] == [("k", "table::plate", "one::a")]
        floating = [x.name for x in mechanism.joints if x.kind is JointKind.FLOATING]
        assert floating == ["table::plate_floating"] * extra


def test_a_detachable_joint_holds_a_model_beside_the_robot(tmp_path: Path) -> None:
    plugin = (
        '<plugin filename="gz-sim-detachable-joint-system" name="gz::sim::systems::DetachableJoint">'
        "<parent_link>a</parent_link><child_model>box</child_model><child_link>shell</child_link></plugin>"
    )
    box = model("box", "<pose>1 0 1 0 0 0</pose>", link("shell"))
    text = world(model("arm", *ARM, plugin), box, model("house", link("wall")))
    mechanism = read_sdf(write(tmp_path, text))
    (loop,) = mechanism.loops
    assert (loop.kind, loop.link1, loop.link2) == (JointKind.FIXED, "arm::a", "box::shell")
    np.testing.assert_array_equal(loop.placement1.translation, [1, 0, 0])
    assert stp.mobility(stp.load(tmp_path / "small.sdf")).dof == 1
    with pytest.raises(FileFormatError, match="DetachableJoint"):
        read_sdf(write(tmp_path, world(model("arm", *ARM, plugin))))


def test_frames_of_a_world_place_models(tmp_path: Path) -> None:
    parts = (
        '<frame name="table"><pose>1 2 0 0 0 0</pose></frame>',
        model("arm", '<pose relative_to="table">0 0 0.5 0 0 0</pose>', link("a", "0 0 1 0 0 0")),
    )
    mechanism = read_sdf(write(tmp_path, world(*parts, version="1.9")))
    np.testing.assert_array_equal(position(mechanism, "a"), [1, 2, 1.5])


def test_a_static_model_inside_is_the_ground(tmp_path: Path) -> None:
    stand = model("stand", "<pose>5 0 0 0 0 0</pose><static>true</static>", link("plate", "0 0 1 0 0 0"))
    mechanism = read_sdf(
        write(tmp_path, sdf(stand, link("a", "5 0 2 0 0 0"), joint("j", "stand::plate", "a")))
    )
    assert [(x.name, x.kind, x.parent) for x in mechanism.joints] == [
        ("stand::plate_static", JointKind.FIXED, "world"),
        ("j", JointKind.REVOLUTE, "stand::plate"),
    ]
    np.testing.assert_array_equal(position(mechanism, "a"), [5, 0, 2])


def included(folder: Path) -> str:
    (folder / "hand").mkdir()
    write(
        folder / "hand",
        sdf(link("palm"), link("finger", "0 0 1 0 0 0"), joint("f", "palm", "finger")),
        "new.sdf",
    )
    write(
        folder / "hand",
        '<model><name>hand</name><sdf version="1.4">old.sdf</sdf><sdf version="1.9">new.sdf</sdf></model>',
        "model.config",
    )
    return "<include><uri>{}</uri><name>{}</name><pose relative_to='a'>0 0 0.5 0 0 0</pose></include>"


@pytest.mark.parametrize(
    "uri", ["hand", "hand/new.sdf", "file://hand/new.sdf", "model://hand", "model://hand/new.sdf"]
)
def test_files_beside_are_included(tmp_path: Path, uri: str) -> None:
    text = included(tmp_path)
    twice = text.format(uri, "left") + text.format(uri, "right")
    mechanism = read_sdf(
        write(tmp_path, sdf(*ARM, twice, joint("m", "a", "left::palm", "fixed", xyz=""), version="1.8"))
    )
    assert [x.name for x in mechanism.links][:6] == [
        "world", "a", "left::palm", "left::finger", "right::palm", "right::finger",
    ]  # fmt: skip
    assert {x.name for x in mechanism.joints} == {"j", "m", "left::f", "right::f", "right::palm_floating"}
    np.testing.assert_array_equal(position(mechanism, "left::finger"), [0, 0, 2.5])


def test_models_next_to_a_model_are_included_by_name(tmp_path: Path) -> None:
    """As in a collection of models, which is a simulator's model path; no other folder is opened."""
    shelf(tmp_path, robot=sdf(*ARM, "<include><uri>model://box</uri></include>"))
    assert "small::crate" in {each.name for each in read_sdf(tmp_path / "arm" / "model.sdf").links}
    config = tmp_path / "box" / "model.config"
    config.write_text(config.read_text().replace("model.sdf", "../arm/model.sdf"))
    with pytest.raises(FileFormatError, match=r"names no <sdf> file beside it"):
        read_sdf(tmp_path / "arm" / "model.sdf")
    config.unlink()
    with pytest.raises(UnsupportedError, match=r"would be looked up in a simulator's model path"):
        read_sdf(tmp_path / "arm" / "model.sdf")


def test_an_include_may_be_the_robot_of_a_world(tmp_path: Path) -> None:
    write(tmp_path, sdf(*ARM), "arm.sdf")
    include = "<include><uri>arm.sdf</uri><pose>7 0 0 0 0 0</pose></include>"
    mechanism = read_sdf(write(tmp_path, world(include)))
    np.testing.assert_array_equal(position(mechanism, "a"), [7, 0, 1])


GROUND = model("ground_plane", "<static>true</static>", link("plate"))
SUN = "<include><uri>model://sun</uri></include>"


def shelf(folder: Path, *, robot: str = "") -> None:
    """Lay down a table that is static, and a robot."""
    for name, text in (
        ("arm", robot or sdf(*ARM)),
        ("table", sdf("<static>1</static>", link("plate"))),
        ("box", sdf(link("crate"))),
    ):
        (folder / name).mkdir()
        write(
            folder / name,
            f'<model><name>{name}</name><sdf version="1.6">model.sdf</sdf></model>',
            "model.config",
        )
        write(folder / name, text, "model.sdf")


WORLDS = {
    "a ground": ("<include><name>bob</name><uri>arm</uri></include>", GROUND),
    "by name, with a sun": (SUN, GROUND, "<include><uri>model://arm</uri></include>"),
    "a file": ("<include><uri>arm/model.sdf</uri></include>", GROUND, SUN),
    "a table": ("<include><uri>model://table</uri></include>", "<include><uri>model://arm</uri></include>"),
    "a box that moves": ("<include><uri>box</uri></include>", "<include><uri>model://arm</uri></include>"),
    "a box held": (
        "<include><uri>box</uri><static>true</static></include>",
        "<include><uri>model://arm</uri></include>",
    ),
    "a wrapper": (GROUND, model("cell", "<include><uri>model://arm</uri></include>")),
}


@pytest.mark.parametrize("parts", WORLDS.values(), ids=WORLDS)
def test_the_included_robot_of_a_world_is_found(parts: tuple[str, ...], tmp_path: Path) -> None:
    shelf(tmp_path)
    mechanism = read_sdf(write(tmp_path, world(*parts)))
    assert [x.kind for x in mechanism.joints if x.kind is not JointKind.FIXED] == [JointKind.REVOLUTE]
    assert len(mechanism.links) == 2
    others = [note.text for note in mechanism.notes if "another model" in note.text]
    assert len(others) == len(parts) - 1, "not all that is left out is noted"


def test_included_models_include_others_by_name(tmp_path: Path) -> None:
    shelf(tmp_path, robot=sdf(*ARM, "<include><uri>model://box</uri></include>"))
    mechanism = read_sdf(write(tmp_path, world(GROUND, "<include><uri>model://arm</uri></include>")))
    assert "small::crate" in {x.name for x in mechanism.links}


def test_one_body_that_moves_is_the_robot_beside_static_ones(tmp_path: Path) -> None:
    shelf(tmp_path)
    mechanism = read_sdf(write(tmp_path, world(GROUND, "<include><uri>box</uri></include>")))
    assert {x.name for x in mechanism.links} == {"world", "crate"}


def test_robots_that_are_included_are_one_mechanism(tmp_path: Path) -> None:
    shelf(tmp_path)
    twice = ("<include><uri>arm</uri></include>", "<include><name>bob</name><uri>arm</uri></include>")
    mechanism = read_sdf(write(tmp_path, world(GROUND, *twice)))
    assert {x.name for x in mechanism.links} == {"world", "small::a", "bob::a"}
    with pytest.raises(FileFormatError, match="two models called 'small'; rename one"):
        read_sdf(write(tmp_path, world(GROUND, twice[0], twice[0])))
    with pytest.raises(
        UnsupportedError, match=r"'model://leg' would be looked up.* its folder as 'leg' into"
    ):
        read_sdf(write(tmp_path, world(GROUND, "<include><uri>model://leg</uri></include>")))


@pytest.mark.parametrize(
    "uri", ["../arm", "model://../arm", "hand/../../arm", "file:///etc/arm.sdf", "linked", "..\\arm"]
)
def test_an_include_stays_in_the_folder(uri: str, tmp_path: Path) -> None:
    shelf(tmp_path)
    inside = tmp_path / "inside"
    (inside / "hand").mkdir(parents=True)
    (inside / "linked").symlink_to(tmp_path / "arm")
    with pytest.raises(UnsupportedError, match=r"only files within .* are opened; give the path"):
        read_sdf(write(inside, world(f"<include><uri>{uri}</uri></include>")))
    write(inside / "hand", '<model><sdf version="1.6">../../arm/model.sdf</sdf></model>', "model.config")
    with pytest.raises(FileFormatError, match="names no <sdf> file beside it"):
        read_sdf(write(inside, world("<include><uri>hand</uri></include>")))


def test_files_that_include_each_other_end(tmp_path: Path) -> None:
    again = "<include><uri>small.sdf</uri><name>{}</name></include>"
    with pytest.raises(FileFormatError, match="do files include each other"):
        read_sdf(write(tmp_path, sdf(*ARM, again.format("x"), again.format("y"))))


@pytest.mark.parametrize("uri", ["model://hand", "https://fuel.example.org/hand", "/etc/hand.sdf"])
def test_other_includes_are_refused(tmp_path: Path, uri: str) -> None:
    with pytest.raises(UnsupportedError, match="relative to this one, or put its <model> here"):
        read_sdf(write(tmp_path, sdf(*ARM, f"<include><uri>{uri}</uri></include>")))


def test_a_folder_needs_a_config(tmp_path: Path) -> None:
    (tmp_path / "hand").mkdir()
    with pytest.raises(FileMissingError, match=r"model\.config"):
        read_sdf(write(tmp_path, sdf(*ARM, "<include><uri>hand</uri></include>")))
    write(tmp_path / "hand", "<model/>", "model.config")
    with pytest.raises(FileFormatError, match="names no <sdf> file"):
        read_sdf(write(tmp_path, sdf(*ARM, "<include><uri>hand</uri></include>")))


def test_names_inside_are_told_apart(tmp_path: Path) -> None:
    twin = model("twin", link("a", content=BODY))
    with pytest.raises(FileFormatError, match="'twin'; rename one"):
        read_sdf(write(tmp_path, sdf(*ARM, twin, twin, version="1.6")))
    mechanism = read_sdf(write(tmp_path, sdf(*ARM, twin)))
    assert [x.name for x in mechanism.links] == ["world", "a", "twin::a"]
