"""Cranks and rods read off a chain, however it is built and cut."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import UnsupportedError
from stewart_pin.model.description import Joint, JointKind, Link
from tests.building.test_parallel_robots import delta
from tests.building.test_parallel_robots import rotary_hexapod as hexapod_of_the_source
from tests.closed_states import random_configuration, robot
from tests.mechanisms import at, rod, rotary_hexapod
from tests.rewritten import in_other_unit, recut

FIELDS = ("base_points", "axes", "zeros", "platform_points", "cranks", "rods")


@pytest.mark.parametrize(("name", "expected"), [("delta", delta()), ("hexapod_rss", hexapod_of_the_source())])
@pytest.mark.parametrize("rewritten", [False, True])
def test_bundled_robots(name: str, expected: stp.rotary.RotaryLegs, rewritten: bool) -> None:
    chain = recut(robot(name)) if rewritten else robot(name)
    assert chain is not None
    found = stp.rotary.rotary_legs(chain)
    for field in FIELDS:
        np.testing.assert_allclose(getattr(found, field), getattr(expected, field), atol=1e-12)


def test_balls_in_the_tree(rng: np.random.Generator) -> None:
    """The same leg built of spherical joints: crank angles in closed form are the motor positions everywhere."""
    chain = rotary_hexapod()
    legs = stp.rotary.rotary_legs(chain)
    np.testing.assert_allclose(legs.rods, 0.45, rtol=1e-12)
    for _ in range(5):
        q = random_configuration(chain, rng)
        pose = stp.platform_pose(chain, q)
        angles = stp.rotary.crank_angles(legs, pose.translation, pose.rotation).angle
        apart = np.abs(angles - stp.motor_positions(chain, q)[:, None])
        assert apart.min(axis=1).max() < 1e-10


def test_unit_platform_frame_and_order() -> None:
    chain = robot("hexapod_rss")
    in_mm = stp.rotary.rotary_legs(in_other_unit(chain, 1e3))
    np.testing.assert_allclose(in_mm.base_points, 1e3 * stp.rotary.rotary_legs(chain).base_points, atol=1e-9)
    frame = pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.3])), np.array([0.0, 0.05, 0.1]))
    moved = stp.rotary.rotary_legs(stp.with_platform(chain, "platform", placement=frame))
    np.testing.assert_allclose(
        moved.platform_points @ frame.rotation.T + frame.translation,
        stp.rotary.rotary_legs(chain).platform_points,
        atol=1e-14,
    )
    back = stp.rotary.rotary_legs(stp.with_motors(chain, chain.motors[::-1]))
    np.testing.assert_array_equal(back.base_points, stp.rotary.rotary_legs(chain).base_points[::-1])


def test_counterweights_are_no_rods() -> None:
    old = robot("hexapod_rss").described()
    weight = Joint("swing", JointKind.REVOLUTE, "crank2", "weight", at(-0.05))
    chain = build_chain(
        replace(old, links=(*old.links, Link("weight", rod(0.1))), joints=(*old.joints, weight)),
    )
    found, expected = stp.rotary.rotary_legs(chain), stp.rotary.rotary_legs(robot("hexapod_rss"))
    np.testing.assert_allclose(found.base_points, expected.base_points, atol=1e-14)


@pytest.mark.parametrize(
    ("chain", "words"),
    [
        (lambda: robot("stewart"), "motor 'leg1' does not drive a crank .*: it is prismatic, not revolute"),
        (lambda: robot("four_bar"), "motor 'crank_motor' .* five or six joint axes, about one point"),
        (
            lambda: robot("arm_7r"),
            "motor 'joint2' .* its axis stands on link 'link1', not on the ground|'joint1'",
        ),
        (lambda: stp.with_motors(robot("delta"), []), "without motors"),
        (
            lambda: stp.with_motors(robot("delta"), ["rod1a_x"]),
            "'rod1a_x' .* link 'rod1a_cross1', not on the ground",
        ),
        (
            lambda: stp.lock_joints(robot("delta"), ["rod1a_x", "rod1a_y"]),
            "motor 'motor1' .* five or six joint axes",
        ),
    ],
)
def test_other_legs_are_refused_by_name(chain, words: str) -> None:
    with pytest.raises(UnsupportedError, match=words):
        stp.rotary.rotary_legs(chain())


def test_rods_that_are_not_parallel_are_two_legs_on_one_crank() -> None:
    """A Delta whose parallelograms are bent to trapezia: the platform turns, and no single rod stands for both."""
    old = robot("delta").described()

    def wider(loop):
        shift = {"rod1a_ball": 0.005, "rod1b_ball": -0.005}.get(loop.name, 0.0)
        return replace(loop, placement1=pin.SE3(np.eye(3), loop.placement1.translation + [0.0, shift, 0.0]))

    bent = build_chain(
        replace(old, loops=tuple(map(wider, old.loops)), home={}), motors=["motor1", "motor2", "motor3"]
    )
    with pytest.raises(UnsupportedError, match="the two rods of its crank are not parallel"):
        stp.rotary.rotary_legs(bent)


def test_the_crank_may_stand_beside_its_axis_frame() -> None:
    """Motor frames anywhere along the axis: the centre of the circle is where the tip turns, not where the frame is."""
    old = robot("delta").described()
    cranks = {f"crank{k}" for k in (1, 2, 3)}

    def shifted(joint: Joint) -> Joint:
        along = 0.02 if joint.child in cranks else -0.02 if joint.parent in cranks else 0.0
        return replace(
            joint,
            placement=at(0, along, 0).act(joint.placement)
            if along < 0
            else joint.placement * at(0, along, 0),
        )

    chain = build_chain(replace(old, joints=tuple(map(shifted, old.joints))))
    found = stp.rotary.rotary_legs(chain)
    for field in FIELDS:
        np.testing.assert_allclose(getattr(found, field), getattr(delta(), field), atol=1e-12)


def test_rods_between_universal_joints_hold_more_than_a_distance() -> None:
    chain = stp.lock_joints(robot("hexapod_rss"), [f"rod{k}_spin" for k in range(1, 7)])
    assert len(stp.rotary.rotary_legs(chain).rods) == 6  # a cross and a ball will do
    old, data = chain.described(), pin.Data(chain.model)
    pin.framesForwardKinematics(chain.model, data, chain.q_home)

    def crossed(loop):
        rod_frame = data.oMf[chain.model.getFrameId(loop.link2, pin.FrameType.BODY)].rotation
        level = np.cross([0, 0, 1], rod_frame[:, 2])
        axis2 = rod_frame.T @ level / np.linalg.norm(level)
        return replace(loop, kind=JointKind.UNIVERSAL, axis=np.array([0.0, 0.0, 1.0]), axis2=axis2)

    stiff = build_chain(replace(old, loops=tuple(map(crossed, old.loops))))
    with pytest.raises(UnsupportedError, match="five or six joint axes"):
        stp.rotary.rotary_legs(stiff)
