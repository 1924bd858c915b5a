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
            "motor 'leg1' .* 'leg1_y' does not turn about z",
        ),
        (
            lambda: stp.with_platform(
                robot("rpr_planar"),
                "platform",
                placement=pin.SE3(pin.rpy.rpyToMatrix(0.1, 0, 0), np.zeros(3)),
            ),
            "platform 'platform_frame' has its z axis not along z",
        ),
        (lambda: changed(leg2={"placement": at(0, 0.1, 0)}), "motor 'leg2' .* does not slide along the line"),
        (
            lambda: changed(leg3={"placement": at(0.5, 0, 0)}),
            r"motor 'leg3' .* it stands at .* where the leg is .* m long",
        ),
    ],
)
def test_other_chains_are_refused(chain, words: str) -> None:
    with pytest.raises(UnsupportedError, match=words):
        stp.planar.planar_rpr(chain())
