"""Platform, home, limits and gravity of an MJCF file, and what else acts on the motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import MissingRoleError
from stewart_pin.model.formats.mjcf.reading import read_mjcf
from tests.model.small_mjcf import (
    BALL,
    BOTH,
    DRIVEN,
    QPOS,
    WORKSHOP,
    actuator,
    body,
    equality,
    hinge,
    mjcf,
    notes,
    read,
    write,
)

pytest.importorskip("mujoco")


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


def test_limits_of_balls_are_kept(tmp_path: Path) -> None:
    text = body("arm", '<joint name="b" type="ball" range="0 0.5"/>')
    assert read(tmp_path, text).joint("b").turn == 0.5
    off = '<option><flag limit="disable"/></option>'
    found = read(tmp_path, text, off)
    assert found.joint("b").turn == np.inf
    assert "joint 'b' its limits: the file disables all limits" in notes(found)


def test_gravity_is_that_of_the_file(tmp_path: Path) -> None:
    path = write(tmp_path, mjcf(BOTH, '<option gravity="1 2 3"/>', DRIVEN))
    np.testing.assert_array_equal(stp.load(path, platform="hand").gravity, [1, 2, 3])
    np.testing.assert_array_equal(stp.load(path, platform="hand", gravity=(0, 0, -1)).gravity, [0, 0, -1])
    path = write(tmp_path, mjcf(BOTH, '<option gravity="1 2 3"><flag gravity="disable"/></option>', DRIVEN))
    np.testing.assert_array_equal(stp.load(path, platform="hand").gravity, [0, 0, 0])


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
    with pytest.raises(MissingRoleError, match=r"candidates, best guess first: hand, palm") as caught:
        stp.load(path).platform_link  # noqa: B018 - raises
    assert caught.value.candidates == ("hand", "palm", "arm")
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
    # b is drawn beyond its range, so it stands at the nearer end of that.
    np.testing.assert_allclose(chain.q_home, [0.3, 0.7], rtol=0, atol=1e-15)
    assert "moves joint 'b' by 0.2" in str(chain.report)


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
        "body 'block' gravcomp 0.5",
        "<option> density 1.2, viscosity 0",
        "actuator 'pull' acts on a tendon",
        "body 'hand' a mocap body",
        "<geom> shapes give bodies their inertia",
    ):
        assert words in said, words


def test_words_that_look_like_ours_are_told(tmp_path: Path) -> None:
    custom = (
        '<custom><text name="platfrom" data="a"/><numeric name="velocty:motor" data="2"/>'
        '<text name="colour" data="b"/><numeric name="velocity:motor" data="1 2 3"/></custom>'
    )
    report = str(stp.load(write(tmp_path, mjcf(BOTH, custom, DRIVEN))).report)
    assert "the name 'platfrom': unknown, is 'platform' meant?" in report
    assert "the name 'velocty:motor': unknown, is 'velocity:' meant?" in report
    assert "the name 'velocity:motor': unknown; it takes one number or two" in report
    assert "colour" not in report
