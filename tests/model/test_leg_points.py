"""Leg ends are found wherever the loop was cut and however the joints were written, or the reason is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.model.description import Joint, JointKind, Link, Loop, Mechanism
from stewart_pin.model.leg_points import leg_points

X, Y, Z = np.eye(3)
ONE = pin.SE3.Identity()
R, P, S, F, U = (
    JointKind.REVOLUTE, JointKind.PRISMATIC, JointKind.SPHERICAL, JointKind.FIXED, JointKind.UNIVERSAL,
)  # fmt: skip
BODY = pin.Inertia(1.0, np.zeros(3), np.eye(3))
FOOT, HEAD = np.array([0.3, -0.2, 0.1]), np.array([0.1, 0.2, -0.1])


def at(*xyz: float) -> pin.SE3:
    return pin.SE3(np.eye(3), np.array(xyz, dtype=float))


def turned(rng: np.random.Generator) -> pin.SE3:
    return pin.SE3(pin.exp3(rng.uniform(-2, 2, 3)), rng.uniform(-1, 1, 3))


def one_leg(
    *, joints: tuple[Joint, ...] = (), loops: tuple[Loop, ...] = (), links: tuple[str, ...] = ()
) -> Mechanism:
    """One UPS leg from FOOT to HEAD, with parts replaced or added by name."""
    parts = {
        joint.name: joint
        for joint in (
            Joint("fly", JointKind.FLOATING, "base", "platform", ONE),
            Joint("x", R, "base", "cross", at(*FOOT), X),
            Joint("y", R, "cross", "lower", ONE, Y),
            Joint("leg", P, "lower", "upper", ONE, Z, independent=True),
            *joints,
        )
    }
    names = ("base", "platform", "cross", "lower", "upper", *links)
    ball = Loop("ball", S, "platform", "upper", at(*HEAD), ONE)
    return Mechanism("leg", tuple(Link(name) for name in names), tuple(parts.values()), loops or (ball,))


def assert_ends(mechanism: Mechanism) -> None:
    base, platform = leg_points(mechanism, ["leg"], "platform")
    np.testing.assert_allclose(base, [FOOT], atol=1e-14)
    np.testing.assert_allclose(platform, [HEAD], atol=1e-14)


def test_the_plain_leg() -> None:
    assert_ends(one_leg())


def test_joint_frames_may_sit_anywhere_on_axes_that_meet() -> None:
    # The frames of the cross are shifted along their own axes; the axes still meet at the foot.
    shifted = (
        Joint("x", R, "base", "cross", at(*(FOOT + 0.4 * X)), X),
        Joint("y", R, "cross", "lower", at(*(-0.4 * X + 0.7 * Y)), Y),
        Joint("leg", P, "lower", "upper", at(*(-0.7 * Y + 0.2 * Z)), Z),
    )
    assert_ends(one_leg(joints=shifted))


def test_legs_may_share_a_link_that_is_fixed_to_the_ground_or_the_platform(rng: np.random.Generator) -> None:
    """Files of simulators fix the base to a world, and a flange to the platform; all legs start from those."""
    stand, flange = turned(rng), turned(rng)
    joints = (
        Joint("stand", F, "base", "plinth", stand),
        Joint("flange", F, "platform", "flange", flange),
        Joint("x", R, "plinth", "cross", stand.inverse() * at(*FOOT), X),
        Joint("x2", R, "plinth", "cross2", stand.inverse() * at(*HEAD), X),
        Joint("y2", R, "cross2", "lower2", ONE, Y),
        Joint("leg2", P, "lower2", "upper2", ONE, Z),
    )
    loops = (
        Loop("ball", S, "flange", "upper", flange.inverse() * at(*HEAD), ONE),
        Loop("ball2", S, "upper2", "flange", ONE, flange.inverse() * at(*FOOT)),
    )
    mechanism = one_leg(joints=joints, loops=loops, links=("plinth", "flange", "cross2", "lower2", "upper2"))
    base, platform = leg_points(mechanism, ["leg", "leg2"], "platform")
    np.testing.assert_allclose(base, [FOOT, HEAD], atol=1e-14)
    np.testing.assert_allclose(platform, [HEAD, FOOT], atol=1e-14)


def test_skew_frames_and_fixed_links_in_between(rng: np.random.Generator) -> None:
    """The same leg written in turned frames, its parts in two links each, covers hanging on them."""
    mount, tube, clamp, socket, cover = (turned(rng) for _ in range(5))
    joints = (
        Joint("mount", F, "base", "foot", mount),
        Joint("x", R, "foot", "cross", mount.inverse() * at(*FOOT), X),
        Joint("y", R, "cross", "tube", ONE, Y),
        Joint("tube", F, "tube", "lower", tube),
        Joint("leg", P, "lower", "upper", tube.inverse(), Z),
        Joint("clamp", F, "upper", "rod", clamp),
        Joint("socket", F, "platform", "cup", socket),
        Joint("cover", F, "tube", "lid", cover),
        Joint("hinge", R, "lid", "flap", cover),
    )
    ball = Loop("ball", S, "rod", "cup", clamp.inverse(), socket.inverse() * at(*HEAD))
    links = ("foot", "tube", "rod", "cup", "lid", "flap")
    assert_ends(one_leg(joints=joints, loops=(ball,), links=links))


def test_a_ball_of_three_axes_and_a_universal_loop() -> None:
    joints = (
        Joint("a", R, "upper", "ring1", ONE, X),
        Joint("b", R, "ring1", "ring2", ONE, Y),
        Joint("c", R, "ring2", "platform", ONE, Z),
        Joint("fly", F, "lower", "cap", ONE),
        Joint("x", JointKind.FLOATING, "base", "lower", ONE),
        Joint("y", F, "base", "cross", ONE),
    )
    foot = Loop("foot", U, "base", "lower", at(*FOOT), ONE, X, Y)
    mechanism = one_leg(joints=joints, loops=(foot,), links=("ring1", "ring2", "cap"))
    base, platform = leg_points(mechanism, ["leg"], "platform")
    np.testing.assert_array_equal(base, [FOOT])
    np.testing.assert_array_equal(platform, [[0, 0, 0]])


def cut_elsewhere(hexapod: stp.Hexapod, length: float) -> Mechanism:
    """Hang the platform on leg 1 by three revolute joints, and legs 2 to 6 on the platform."""
    links, joints, loops = [Link("base"), Link("platform", BODY)], [], []
    home = {}
    for k, (foot, head) in enumerate(zip(hexapod.base_points, hexapod.platform_points, strict=True), start=1):
        names = [f"{part}{k}" for part in ("cross", "lower", "upper", "ring", "fork")]
        links += [Link(name, BODY if name[:5] in ("lower", "upper") else None) for name in names]
        cross, lower, upper, ring, fork = names
        home[f"leg{k}"] = np.array([length])
        if k == 1:
            joints += [
                Joint("x1", R, "base", cross, at(*foot), X),
                Joint("y1", R, cross, lower, ONE, Y),
                Joint("leg1", P, lower, upper, ONE, Z, independent=True),
                Joint("a1", R, upper, ring, ONE, X),
                Joint("b1", R, ring, fork, ONE, Y),
                # The platform's origin seen from its point.
                Joint("c1", R, fork, "hub", ONE, Z),
                Joint("hub", F, "hub", "platform", at(*-head)),
            ]
            links.append(Link("hub"))
        else:
            links = [link for link in links if link.name != cross]
            joints += [
                Joint(f"a{k}", R, "platform", ring, at(*head), X),
                Joint(f"b{k}", R, ring, fork, ONE, Y),
                Joint(f"c{k}", R, fork, upper, ONE, Z),
                # Lower moves down from upper: positive still pushes the platform away.
                Joint(f"leg{k}", P, upper, lower, ONE, -Z, independent=True),
            ]
            loops.append(Loop(f"foot{k}", U, "base", lower, at(*foot), ONE, X, Y))
    return Mechanism("cut", tuple(links), tuple(joints), tuple(loops), platform="platform", home=home)


def test_a_hexapod_cut_elsewhere_is_the_same_hexapod(report_ideal: stp.Hexapod) -> None:
    usual = stp.load("stewart")
    length = stp.motor_positions(usual, usual.q_home)[0]
    chain = build_chain(cut_elsewhere(report_ideal, length))
    assert (chain.nv, chain.nc) == (6 + 5 * 4, 5 * 4)
    hexapod = stp.Hexapod.from_chain(chain)
    np.testing.assert_allclose(hexapod.base_points, report_ideal.base_points, atol=1e-15)
    np.testing.assert_allclose(hexapod.platform_points, report_ideal.platform_points, atol=1e-15)
    pose = stp.platform_pose(chain, chain.q_home)
    lengths = stp.leg_lengths(hexapod, pose.translation, pose.rotation)
    np.testing.assert_allclose(stp.motor_positions(chain, chain.q_home), lengths, rtol=1e-12)


def test_points_follow_the_order_of_the_motors() -> None:
    chain = stp.load("stewart", motors=["leg3", "leg1"])
    base, platform = chain.leg_points()
    whole = stp.Hexapod.from_chain(stp.load("stewart"))
    np.testing.assert_array_equal(base, whole.base_points[[2, 0]])
    np.testing.assert_array_equal(platform, whole.platform_points[[2, 0]])
    with pytest.raises(InputError, match=r"base_points must have shape \(6, 3\)"):
        stp.Hexapod.from_chain(chain)


NOT_A_LEG = {
    "no slider": (one_leg(joints=(Joint("leg", R, "lower", "upper", ONE, Z),)), "it is revolute, not prismatic"),
    "fixed to the ground": (
        one_leg(joints=(Joint("x", F, "base", "cross", ONE), Joint("y", F, "cross", "lower", ONE))),
        "it is fixed to link 'base'",
    ),
    "one axis at the ground": (one_leg(joints=(Joint("y", F, "cross", "lower", ONE),)), "about an axis of link 'base'"),
    "one axis at the platform": (
        one_leg(loops=(Loop("pin", R, "platform", "upper", at(*HEAD), ONE),)), "about an axis of link 'platform'",
    ),
    "axes that pass each other": (
        one_leg(joints=(Joint("y", R, "cross", "lower", at(0, 0, 0.01), Y),)), "'x' misses it by 0.01 m",
    ),
    "parallel axes": (one_leg(joints=(Joint("y", R, "cross", "lower", at(0, 0, 1), X),)), "parallel axes (joint 'x')"),
    "slider beside the line": (
        one_leg(joints=(Joint("leg", P, "lower", "upper", at(0.02, 0, 0), Z),)), "between the leg's ends by 0.02 m",
    ),
    "slider across the line": (
        one_leg(joints=(Joint("leg", P, "lower", "upper", at(0, 0, 0.5), X),)), "between the leg's ends by 0.5 m",
    ),
    "second slider": (one_leg(joints=(Joint("y", P, "cross", "lower", ONE, Y),)), "joint 'y' is prismatic"),
    "cylindrical end": (
        one_leg(loops=(Loop("rod", JointKind.CYLINDRICAL, "platform", "upper", ONE, ONE),)), "'rod' is cylindrical",
    ),
    "two ways": (
        one_leg(loops=(
            Loop("ball", S, "platform", "upper", at(*HEAD), ONE), Loop("stay", S, "base", "upper", ONE, ONE),
        )),
        "2 ways lead on from link 'upper'",
    ),
    "open end": (one_leg(loops=(Loop("stay", S, "base", "platform", ONE, ONE),)), "0 ways lead on from link 'lower'"),
    "ground to ground": (
        one_leg(loops=(Loop("ball", S, "base", "upper", at(*HEAD), ONE),)), "does not lead from link 'base'",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("mechanism", "words"), NOT_A_LEG.values(), ids=NOT_A_LEG)
def test_what_is_no_leg_is_told(mechanism: Mechanism, words: str) -> None:
    with pytest.raises(UnsupportedError) as caught:
        leg_points(mechanism, ["leg"], "platform")
    assert words in str(caught.value)
    assert str(caught.value).startswith("motor 'leg' does not drive a leg")
    assert "the other verbs do not" in str(caught.value)


def test_tolerance_grows_with_the_robot() -> None:
    """A robot in millimetres is read like the same robot in metres."""
    for scale in (1e-3, 1.0, 1e3):
        printed = one_leg(joints=(Joint("x", R, "base", "cross", at(*(FOOT * scale)), X),))
        good = replace(printed.joints[2], placement=at(0, 0, 1e-6 * scale))
        bad = replace(good, placement=at(0, 0, 1e-4 * scale))
        ball = Loop("ball", S, "platform", "upper", at(*(HEAD * scale)), at(0, 0, 0))
        joints = {joint.name: joint for joint in printed.joints}
        leg_points(
            replace(printed, joints=tuple((joints | {"y": good}).values()), loops=(ball,)),
            ["leg"],
            "platform",
        )
        with pytest.raises(UnsupportedError, match="misses it by"):
            leg_points(
                replace(printed, joints=tuple((joints | {"y": bad}).values()), loops=(ball,)),
                ["leg"],
                "platform",
            )
