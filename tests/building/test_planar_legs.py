"""A planar 3-RPR platform read off its chain, however it is cut."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.errors import UnsupportedError
from tests.closed_states import random_configuration, robot
from tests.mechanisms import at
from tests.retelling.changes import all_at_once as everything
from tests.retelling.changes import changed as changed_mechanism
from tests.rewritten import recut

CORNERS = [[0, 0], [3, 0], [3, 3]]
ANCHORS = [[0, 0], [5, 0], [0, 6]]


@pytest.mark.parametrize("rewritten", [False, True])
def test_the_bundled_platform(rewritten: bool, rng: np.random.Generator) -> None:
    chain = recut(robot("rpr_planar")) if rewritten else robot("rpr_planar")
    assert chain is not None
    planar = stp.planar.planar_rpr(chain)
    np.testing.assert_allclose(planar.anchors, ANCHORS, atol=1e-12)
    np.testing.assert_allclose(planar.corners, CORNERS, atol=1e-12)
    q = random_configuration(chain, rng)
    pose = stp.platform_pose(chain, q)
    angle = np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0])
    lengths = stp.planar.planar_leg_lengths(planar, pose.translation[:2], angle)
    np.testing.assert_allclose(stp.motor_positions(chain, q), lengths, atol=1e-11)


def test_platform_frame_and_order() -> None:
    chain = stp.with_motors(robot("rpr_planar"), ["leg3", "leg1", "leg2"])
    frame = pin.SE3(pin.rpy.rpyToMatrix(0, 0, 0.4), np.array([1.0, 0.5, 0.2]))
    planar = stp.planar.planar_rpr(stp.with_platform(chain, "platform", placement=frame))
    np.testing.assert_allclose(planar.anchors, np.array(ANCHORS)[[2, 0, 1]], atol=1e-12)
    back = planar.corners @ frame.rotation[:2, :2].T + frame.translation[:2]
    np.testing.assert_allclose(back, np.array(CORNERS)[[2, 0, 1]], atol=1e-12)


def changed(**joints):
    """Rebuild the bundled platform with some joints changed."""
    old = robot("rpr_planar").described()
    parts = tuple(replace(part, **joints.get(part.name, {})) for part in old.joints)
    return build_chain(replace(old, joints=parts, home={"leg1": old.home["leg1"]}))


@pytest.mark.parametrize(
    ("chain", "words"),
    [
        (lambda: robot("stewart"), "has three motors, stewart has 6"),
        (lambda: robot("delta"), "motor 'motor1' .*: it is revolute, not prismatic"),
        (lambda: robot("arm_3r_planar"), "motor 'joint1' .*: it is revolute"),
        (
            lambda: stp.with_motors(robot("stewart"), ["leg1", "leg2", "leg3"]),
            "motor 'leg1' .* 'leg1_upper' is not held by one revolute joint",
        ),
        (lambda: changed(leg2={"placement": at(0, 0.1, 0)}), "motor 'leg2' .* does not slide along the line"),
    ],
)
def test_other_chains_are_refused(chain, words: str) -> None:
    with pytest.raises(UnsupportedError, match=words):
        stp.planar.planar_rpr(chain())


@pytest.mark.parametrize(
    "told",
    [
        # A platform frame that leans out of the plane; a motor that counts from elsewhere; a hinge told as two balls.
        lambda: stp.with_platform(
            robot("rpr_planar"),
            "platform",
            placement=pin.SE3(pin.rpy.rpyToMatrix(1.1, 0.4, 0.7), np.array([0.3, 0.1, 0.2])),
        ),
        lambda: changed(leg3={"placement": at(0.5, 0, 0)}),
        lambda: stp.build.loops_by_balls(robot("rpr_planar")),
        lambda: all_at_once(),
    ],
)
def test_the_plane_stands_anywhere_and_motors_read_anything(told, rng: np.random.Generator) -> None:
    chain = told()
    planar, (sign, offset) = stp.planar.planar_rpr(chain), chain.leg_readings
    for q in chain.generic.samples:
        pose = stp.platform_pose(chain, q)
        position, angle = planar.coordinates(pose.translation, pose.rotation)
        lengths = stp.planar.planar_leg_lengths(planar, position, angle)
        np.testing.assert_allclose(offset + sign * stp.motor_positions(chain, q), lengths, atol=1e-11)
        back = pin.SE3(*planar.placement(position, angle)[::-1])
        np.testing.assert_allclose(back.homogeneous, pose.homogeneous, atol=1e-11)


def all_at_once() -> stp.ClosedChain:
    chain = robot("rpr_planar")
    mechanism, _ = changed_mechanism(chain.described(), everything(chain))
    return build_chain(mechanism, platform=chain.platform)
