"""The home configuration: as written, refined, completed or found; never with open, flipped or overstretched loops."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import MechanismError
from stewart_pin.model.description import Joint, JointKind, Link
from stewart_pin.tolerances import HOME_IN_FILE
from tests.closed_states import NAMES
from tests.small_urdf import (
    ARM,
    AXIS_Z,
    CLOSED,
    FOUR_BAR,
    SQUARE,
    bundled,
    home,
    joint,
    link,
    loop,
    robot,
    write,
)

HOME = re.compile(r"<group_state.*</group_state>", re.DOTALL)
# At home the rocker stands a quarter turn ahead of the coupler; half a turn about x turns the pin over.
TURNED_OVER = 'xyz="1 0 0" rpy="3.141592653589793 0 -1.5707963267948966"'


def assert_closed(chain: stp.ClosedChain) -> None:
    assert np.abs(stp.loop_gap(chain, chain.q_home)).max(initial=0.0) < 1e-12 * chain.length_scale
    lower, upper = chain.model.lowerPositionLimit, chain.model.upperPositionLimit
    assert (chain.q_home >= lower).all() and (chain.q_home <= upper).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_missing_home_is_found(name: str, tmp_path: Path) -> None:
    path = write(tmp_path, HOME.sub("", bundled(name).read_text()))
    chain = stp.load(path)
    assert_closed(chain)
    # The search is seeded.
    np.testing.assert_array_equal(stp.load(path).q_home, chain.q_home)


@pytest.mark.parametrize("name", NAMES)
def test_a_home_of_few_digits_is_refined(name: str, tmp_path: Path) -> None:
    def shorten(match: re.Match) -> str:
        return 'value="' + " ".join(f"{float(word):.4g}" for word in match[1].split()) + '"'

    start, state, end = bundled(name).read_text().partition("<group_state")
    short = start + state + re.sub(r'value="([^"]*)"', shorten, end)
    chain, exact = stp.load(write(tmp_path, short)), stp.load(name)
    assert_closed(chain)
    # Half a unit of the fourth digit in the values, which the closing may gather.
    moved = pin.difference(chain.model, exact.q_home, chain.q_home) / chain.tangent_scale
    assert np.abs(moved).max() < 5e-3


def test_an_exact_home_is_kept(tmp_path: Path) -> None:
    chain = stp.load(write(tmp_path, robot(*FOUR_BAR, CLOSED, home(**SQUARE))))
    for name, value in SQUARE.items():
        assert chain.q_home[chain.model.joints[chain.model.getJointId(name)].idx_q] == pytest.approx(
            float(value), abs=1e-14
        )
    assert not chain.q_home.flags.writeable


def test_joints_that_the_home_leaves_out_are_found(tmp_path: Path) -> None:
    chain = stp.load(write(tmp_path, robot(*FOUR_BAR, CLOSED, home(crank_turn="1.2"))))
    assert_closed(chain)
    assert stp.motor_positions(chain, chain.q_home)[0] == pytest.approx(1.2, abs=1e-3)


def test_the_platform_alone_makes_a_home(tmp_path: Path) -> None:
    pose = "0.1 -0.05 1.1 0 0 0 1"
    text = HOME.sub(home(platform_pose=pose), bundled("stewart").read_text())
    chain = stp.load(write(tmp_path, text))
    assert_closed(chain)
    np.testing.assert_allclose(
        stp.platform_pose(chain, chain.q_home).translation, [0.1, -0.05, 1.1], atol=1e-3
    )


@pytest.mark.parametrize(("joint_name", "value"), [("crank_turn", "2.0"), ("rocker_turn", "1.5")])
def test_a_wrong_home_is_an_error(joint_name: str, value: str, tmp_path: Path) -> None:
    text = robot(*FOUR_BAR, CLOSED, home(**SQUARE | {joint_name: value}))
    with pytest.raises(MechanismError, match=r"closing them moves joint '\w+' by .*group_state") as caught:
        stp.load(write(tmp_path, text))
    assert caught.value.culprit == "home"


def test_a_home_beyond_the_limits_is_an_error(tmp_path: Path) -> None:
    text = bundled("stewart").read_text().replace('lower="0.5" upper="1.8"', 'lower="1.2" upper="1.8"')
    with pytest.raises(
        MechanismError, match=r"joint 'leg1' would stand at 1\.0523\d*, beyond its limits 1\.2 to"
    ):
        stp.load(write(tmp_path, text))


def test_a_home_is_found_within_the_limits(tmp_path: Path) -> None:
    # The square closes as itself or folded; the limits of the coupler leave one way, then the other.
    for low, high in ((-3.0, -0.1), (0.1, 3.0)):
        limit = f'<limit lower="{low}" upper="{high}" effort="1" velocity="1"/>'
        bars = [
            part.replace("</joint>", f"{limit}</joint>") if "coupler_turn" in part else part
            for part in FOUR_BAR
        ]
        assert_closed(stp.load(write(tmp_path, robot(*bars, CLOSED))))


@pytest.mark.parametrize(("low", "high"), [(1.8, 2.5), (0.4, 0.6), (-1.2, -0.7), (-2.9, -2.5)])
def test_home_is_within_the_limits_of_what_closes_its_loops(low: float, high: float, tmp_path: Path) -> None:
    """The hinge that closes the four-bar has no coordinate; its limits are sought as those of the others are."""
    limited = CLOSED.replace("</loop>", f'<limit lower="{low}" upper="{high}"/></loop>')
    chain = stp.load(write(tmp_path, robot(*FOUR_BAR, limited)))
    assert_closed(chain)
    assert not stp.limits_exceeded(chain.at(chain.q_home))
    assert "beyond its limits" not in str(chain.report)


def test_a_home_that_the_limits_of_a_loop_exclude_is_told(tmp_path: Path) -> None:
    limited = CLOSED.replace("</loop>", '<limit lower="0.4" upper="0.6"/></loop>')
    chain = stp.load(write(tmp_path, robot(*FOUR_BAR, limited, home(**SQUARE))))
    assert_closed(chain)
    assert "home is beyond its limits by 0.97: 'hinge' at 1.5708, allowed 0.4 to 0.6" in str(chain.report)


@pytest.mark.parametrize("width", [0.0, 1e-8, 1e-4])
@pytest.mark.parametrize("name", ["crank_turn", "coupler_turn", "rocker_turn", "hinge"])
def test_a_range_far_narrower_than_digits_is_kept(name: str, width: float, tmp_path: Path) -> None:
    """Joints that the home does not name are searched for until they are inside, not only nearly so."""
    middle = {"crank_turn": 0.9, "coupler_turn": -0.9, "rocker_turn": 0.9, "hinge": 0.9}[name]
    limit = f'<limit lower="{middle - width}" upper="{middle + width}" effort="1" velocity="1"/>'
    tag = "loop" if name == "hinge" else "joint"
    parts = [
        part.replace(f"</{tag}>", f"{limit}</{tag}>") if f'name="{name}"' in part else part
        for part in (*FOUR_BAR, CLOSED)
    ]
    if name == "hinge":
        parts[-1] = parts[-1].replace(' effort="1" velocity="1"', "")
    chain = stp.load(write(tmp_path, robot(*parts)))
    assert np.abs(stp.loop_gap(chain, chain.q_home)).max() < 1e-12
    assert not stp.limits_exceeded(chain.at(chain.q_home))


def test_a_named_home_barely_beyond_its_limits_is_told(tmp_path: Path) -> None:
    """Digits explain it, so that it is kept; the verbs that judge limits see it."""
    bars = [
        part.replace("</joint>", '<limit lower="-2" upper="1.5707" effort="1" velocity="1"/></joint>')
        if "rocker_turn" in part
        else part
        for part in FOUR_BAR
    ]
    chain = stp.load(write(tmp_path, robot(*bars, CLOSED, home(**SQUARE))))
    assert "home is beyond its limits by 9.6e-05: 'rocker_turn' at 1.5708" in str(chain.report)
    assert [excess.joint for excess in stp.limits_exceeded(chain.at(chain.q_home))] == ["rocker_turn"]


def test_limits_that_leave_no_home_are_named(tmp_path: Path) -> None:
    span = {"crank_turn": (2.0, 2.2), "rocker_turn": (0.9, 1.1), "coupler_turn": (-3.0, 3.0)}
    bars = [
        next(
            (
                part.replace(
                    "</joint>", f'<limit lower="{low}" upper="{high}" effort="1" velocity="1"/></joint>'
                )
                for name, (low, high) in span.items()
                if f'"{name}"' in part
            ),
            part,
        )
        for part in FOUR_BAR
    ]
    with pytest.raises(
        MechanismError,
        match=r"beyond its limits .*; within all limits a gap of 0\.\d+ m or rad is left, where",
    ) as caught:
        stp.load(write(tmp_path, robot(*bars, CLOSED)))
    # The tips of crank and rocker are farther apart than the coupler is long; each could come nearer.
    gap = np.hypot(1 + np.cos(1.1) - np.cos(2.0), np.sin(1.1) - np.sin(2.0)) - 1
    told = float(re.search(r"a gap of ([\d.]+)", str(caught.value))[1])  # type: ignore[index]
    assert "those of 'crank_turn', 'rocker_turn'" in str(caught.value)
    assert gap / np.sqrt(2) <= told <= gap + 1e-3  # the larger of two components


@pytest.mark.slow
def test_limits_of_a_large_mechanism_are_named_where_newton_closes_none(tmp_path: Path) -> None:
    """Twenty four-bars on one shaft, each a step further; the range of their cranks is less than all steps."""
    bars, loops = [], []
    limit = '<limit lower="-0.1" upper="0.1" effort="1" velocity="1"/></joint>'
    for k in range(20):
        geared = f'<mimic joint="crank_turn0" multiplier="1" offset="{0.1 * k}"/>' if k else ""
        bars += [
            *(link(f"{name}{k}") for name in ("crank", "coupler", "rocker")),
            joint(f"crank_turn{k}", "base", f"crank{k}", origin=f'xyz="0 {k} 0"', content=geared).replace(
                "</joint>", limit
            ),
            joint(f"coupler_turn{k}", f"crank{k}", f"coupler{k}", "continuous", origin='xyz="0.3 0 0"'),
            joint(f"rocker_turn{k}", "base", f"rocker{k}", "continuous", origin=f'xyz="0.9 {k} 0"'),
        ]
        ends = {"origin1": 'xyz="0.8 0 0"', "origin2": 'xyz="0.6 0 0"', "content": AXIS_Z}
        loops.append(loop(f"pin{k}", "revolute", f"coupler{k}", f"rocker{k}", **ends))
    with pytest.raises(MechanismError, match=r"'crank_turn0' would stand at .* stand in the way"):
        stp.load(write(tmp_path, robot(link("base"), *bars, *loops)))


def test_welds_are_not_closed_half_a_turn_off(rng: np.random.Generator) -> None:
    """A ball and a weld in place of each ball that closes a loop; half of the welds start beyond a right angle."""
    old = stp.load("stewart").described()
    tips = {loop.name: f"{loop.name}_tip" for loop in old.loops}
    joints = [
        Joint(f"{loop.name}_ball", JointKind.SPHERICAL, loop.link1, tips[loop.name], loop.placement1)
        for loop in old.loops
    ]
    loops = [
        replace(
            loop,
            kind=JointKind.FIXED,
            link1=tips[loop.name],
            placement1=pin.SE3.Identity(),
            placement2=loop.placement2 * pin.SE3(Rotation.random(rng=rng).as_matrix(), np.zeros(3)),
        )
        for loop in old.loops
    ]
    mechanism = replace(
        old,
        links=(*old.links, *(Link(tip) for tip in tips.values())),
        joints=(*old.joints, *joints),
        loops=tuple(loops),
        home={},
    )
    chain = build_chain(mechanism)
    assert chain.nc == 36
    assert_closed(chain)


def test_what_cannot_close_names_its_loop_and_leaves_the_others_out(tmp_path: Path) -> None:
    """Two four-bars in one file: the second one's loop is told, by the name it has."""
    second = [part.replace("base", "base").replace('name="', 'name="other_') for part in FOUR_BAR[1:]]
    second = [re.sub(r'link="(?!base)', 'link="other_', part) for part in second]
    far = (
        CLOSED.replace('name="', 'name="other_')
        .replace('link="', 'link="other_')
        .replace("1 0 0", "9 0 0", 1)
    )
    with pytest.raises(MechanismError, match=r"the smallest gap found is \d.* m, at loop 'other_hinge'"):
        stp.load(write(tmp_path, robot(*FOUR_BAR, CLOSED, *second, far)))


@pytest.mark.parametrize("kind", ["revolute", "cylindrical", "planar", "prismatic", "fixed"])
@pytest.mark.parametrize("given", [True, False])
def test_flipped_axes_are_refused(kind: str, given: bool, tmp_path: Path) -> None:
    """Rows of a closure also vanish with axes against each other; a pin does not sit in its hole like that."""
    flipped = loop(
        "hinge", kind, "platform", "rocker", origin1='xyz="1 0 0"', origin2=TURNED_OVER,
        content="" if kind == "fixed" else AXIS_Z,
    )  # fmt: skip
    text = robot(*FOUR_BAR, flipped, home(**SQUARE) if given else "")
    with pytest.raises(MechanismError, match="'hinge' point against each other"):
        stp.load(write(tmp_path, text))


@pytest.mark.parametrize("kind", ["prismatic", "fixed"])
def test_half_turns_about_the_axis_are_refused(kind: str, tmp_path: Path) -> None:
    """What may not turn may not be assembled half a turn off, though the axes agree."""
    turned = loop(
        "hinge", kind, "platform", "rocker", origin1='xyz="1 0 0"', origin2='xyz="1 0 0" rpy="0 0 1.5707963267948966"',
        content="" if kind == "fixed" else AXIS_Z,
    )  # fmt: skip
    with pytest.raises(MechanismError, match="'hinge' point against each other"):
        stp.load(write(tmp_path, robot(*FOUR_BAR, turned, home(**SQUARE))))
    straight = turned.replace('"0 0 1.5707963267948966"', '"0 0 -1.5707963267948966"')
    assert_closed(stp.load(write(tmp_path, robot(*FOUR_BAR, straight, home(**SQUARE)))))


def test_loops_that_cannot_close_name_the_gap(tmp_path: Path) -> None:
    far = CLOSED.replace('xyz="1 0 0"', 'xyz="9 0 0"', 1)
    with pytest.raises(MechanismError, match=r"the smallest gap found is \d") as caught:
        stp.load(write(tmp_path, robot(*FOUR_BAR, far)))
    assert "origins of the loops" in str(caught.value) and "small.urdf" in str(caught.value)


def test_a_tree_starts_within_its_limits(tmp_path: Path) -> None:
    limits = {"a": (1.0, 3.0), "b": (0.5, 1e30), "c": (-1e30, -0.5), "d": (-1.0, 2.0)}
    parts = [
        link(f"l{name}") + joint(
            name, "arm", f"l{name}",
            content=f'<limit lower="{low}" upper="{high}" effort="1" velocity="1"/>',
        )
        for name, (low, high) in limits.items()
    ]  # fmt: skip
    chain = stp.load(write(tmp_path, robot(*ARM, *parts)))
    home_of = dict(zip(chain.model.names[1:], chain.q_home, strict=True))
    # Neutral where the limits allow, else at the limit that is nearest to it.
    assert [home_of[name] for name in "abcd"] == [1.0, 0.5, -0.5, 0.0]


def test_all_joints_of_a_sum_are_moved_into_their_limits(tmp_path: Path) -> None:
    """The sum and its first part have to leave zero, which is not enough without the other part."""
    span = {"sum": (0.8, 1.2), "first": (0.1, 0.3), "second": (-1.0, 1.0)}
    joints = [
        joint(name, "base", name, content=f'<limit lower="{low}" upper="{high}" effort="1" velocity="1"/>')
        for name, (low, high) in span.items()
    ]
    gear = (
        '<coupling name="differential" type="polynomial"><follower joint="sum"/><leader joint="first"/>'
        '<polynomial value="0 1"/><also joint="second" ratio="1"/></coupling>'
    )
    text = robot(link("base"), *(link(name) for name in span), *joints, gear)
    chain = stp.load(write(tmp_path, text))
    places = chain.q_home[[chain.model.joints[chain.model.getJointId(name)].idx_q for name in span]]
    np.testing.assert_allclose(places[0], places[1] + places[2], atol=1e-12)
    # A home may stand at a limit, as closely as one in a file is taken.
    low, high = np.array([*span.values()]).T
    assert (places >= low - HOME_IN_FILE).all() and (places <= high + HOME_IN_FILE).all()


def test_couplings_that_contradict_each_other_are_named(tmp_path: Path) -> None:
    gear = (
        '<coupling name="{}" type="polynomial"><follower joint="a"/><leader joint="b"/>'
        '<polynomial value="{} 1"/></coupling>'
    )
    parts = (joint(name, "base", name) for name in "ab")
    text = robot(link("base"), link("a"), link("b"), *parts, gear.format("one", 0.3), gear.format("two", 0.4))
    with pytest.raises(
        MechanismError, match=r"couplings do not close together.*'one', 'two'; correct their numbers"
    ):
        stp.load(write(tmp_path, text))
