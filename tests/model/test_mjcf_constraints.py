"""Constraints of MJCF: loops and couplings, their names and order, and what switches them off."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError, MechanismError
from stewart_pin.model.description import JointKind
from tests.model.small_mjcf import (
    ARM,
    BOTH,
    DRIVEN,
    HAND,
    body,
    equality,
    hinge,
    mjcf,
    notes,
    read,
    write,
)

pytest.importorskip("mujoco")


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


def test_sums_of_many_joints_and_of_two_tendons(tmp_path: Path) -> None:
    """Lengths stand out from those at zero joint values, the second tendon's by the slope of the polynomial."""
    world = BOTH + body("c", hinge("third", ref="0.5"))
    sums = (
        '<tendon><fixed name="s"><joint joint="wrist" coef="2"/><joint joint="motor" coef="-4"/>'
        '<joint joint="third" coef="3"/></fixed><fixed name="t"><joint joint="third" coef="-1"/>'
        '<joint joint="motor" coef="2"/></fixed></tendon>'
    )
    (one,) = read(tmp_path, world, sums, equality('<tendon tendon1="s" polycoef="6 0 0 0 0"/>')).couplings
    assert (one.joint1, one.joint2, one.others) == ("wrist", "motor", (("third", -1.5),))
    assert one.polynomial == (3.75, 2.0)  # 2 wrist - 4 motor + 3 third = 6 + 3 · 0.5
    (two,) = read(
        tmp_path, world, sums, equality('<tendon tendon1="s" tendon2="t" polycoef="0 2 0 0 0"/>')
    ).couplings
    # 2 wrist - 4 motor + 3 third - 1.5 = 2 (2 motor - third + 0.5)
    assert (two.joints, two.others, two.polynomial) == (
        ("wrist", "motor", "third"),
        (("third", -2.5),),
        (1.25, 4.0),
    )
    for polynomial, second in (("0 1 1 0 0", "t"), ("0 1 0 0 0", "line")):
        sites = '<spatial name="line"><site site="anchor"/><site site="palm"/></spatial></tendon>'
        tie = equality(f'<tendon name="hold" tendon1="s" tendon2="{second}" polycoef="{polynomial}"/>')
        with pytest.raises(FileFormatError, match=r"'hold': .*two of them in proportion"):
            read(tmp_path, '<site name="anchor"/>' + world, sums.replace("</tendon>", sites), tie)


def test_a_loop_of_one_body_is_refused(tmp_path: Path) -> None:
    sites = '<site name="a"/><site name="b" pos="0 0 1"/>'
    path = write(tmp_path, mjcf(ARM % sites, equality('<connect name="knot" site1="a" site2="b"/>'), DRIVEN))
    with pytest.raises(MechanismError, match="loop 'knot' joins link 'arm' to itself"):
        stp.load(path, platform="arm")
