"""Joints of Gazebo and of the exporter from Fusion: where they stand, and in whose axes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.errors import FileFormatError
from stewart_pin.model.description import JointKind, Loop
from stewart_pin.model.formats.reading import read_urdf
from tests.model.small_dialects import BALL, GAZEBO, HINGE, assert_same_motion, open_square
from tests.small_urdf import MOTOR, joint, link, robot, write


@pytest.mark.parametrize(
    ("kind", "reference"),
    [("ball", BALL), ("revolute", HINGE), ("fixed", BALL.replace("spherical", "fixed"))],
)
def test_gazebo_joints_stand_where_the_links_lie_at_zero(
    tmp_path: Path, kind: str, reference: str, rng: np.random.Generator
) -> None:
    axis = "<axis><xyz>0 0 1</xyz><limit><lower>-1</lower></limit></axis>" if kind == "revolute" else ""
    chain = stp.load(write(tmp_path, open_square(GAZEBO.format(kind=kind, axis=axis))))
    if kind == "fixed":  # the reference holds the rocker along the coupler, Gazebo across it, as it lies
        assert (
            chain.loops[0].kind is JointKind.FIXED and np.abs(stp.loop_gap(chain, np.zeros(3))).max() < 1e-15
        )
        return
    assert_same_motion(chain, stp.load(write(tmp_path, open_square(reference))), rng)
    np.testing.assert_allclose(chain.loops[0].placement1.translation, [1, 0, 0], atol=1e-15)
    assert "kept: read as Gazebo <gazebo> (loop 'pin')" in str(chain.report)
    assert "while all joints are at zero (loop 'pin')" in str(chain.report)
    assert kind == "ball" or chain.limits.position[chain.nv].tolist()[0] == -1.0


# Two links that lie askew at zero: the first three numbers of each place its joint, the others turn it.
ASKEW = (
    link("base"),
    link("platform"),
    link("rod"),
    joint("one", "base", "platform", origin='xyz="0.3 -0.2 0.1" rpy="0.4 -0.7 1.1"', attributes=MOTOR),
    joint("two", "base", "rod", origin='xyz="-0.5 0.6 0.2" rpy="-1.2 0.3 0.5"'),
)
PLATFORM, ROD = (
    pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz))
    for xyz, rpy in (([0.3, -0.2, 0.1], [0.4, -0.7, 1.1]), ([-0.5, 0.6, 0.2], [-1.2, 0.3, 0.5]))
)


def in_world(found: Loop) -> tuple[pin.SE3, pin.SE3, np.ndarray, np.ndarray]:
    """Return frames 1 and 2 and the axis in each, in the base, while the joints of `ASKEW` are at zero."""
    one, two = PLATFORM * found.placement1, ROD * found.placement2
    return one, two, one.rotation @ found.axis, two.rotation @ found.axis


def test_gazebo_places_the_joint_in_the_child(tmp_path: Path) -> None:
    pose, axis = "0.1 0.2 0.3 0.4 0.5 0.6", np.array([0.48, 0.6, 0.64])
    text = (
        '<gazebo><joint name="pin" type="revolute"><parent>platform</parent><child>rod</child>'
        f"<pose>{pose}</pose><axis><xyz>0.48 0.6 0.64</xyz></axis></joint></gazebo>"
    )
    one, two, axis1, axis2 = in_world(read_urdf(write(tmp_path, robot(*ASKEW, text))).loops[0])
    there = ROD * pin.SE3(pin.rpy.rpyToMatrix(0.4, 0.5, 0.6), np.array([0.1, 0.2, 0.3]))
    for frame in (one, two):
        np.testing.assert_allclose(frame.homogeneous, there.homogeneous, atol=1e-15)
    np.testing.assert_allclose([axis1, axis2], [there.rotation @ axis] * 2, atol=1e-15)


@pytest.mark.parametrize("turned", ["", ' rpy="0.3 0.2 0.1"'])
def test_the_exporters_axis_is_in_the_parent_link(tmp_path: Path, turned: str) -> None:
    text = (
        '<loop_joint name="pin" type="revolute"><parent link="platform"/><child link="rod"/>'
        f'<parent_origin xyz="0.1 0.2 0.3"{turned}/><child_origin xyz="0.4 0.5 0.6"/>'
        '<axis xyz="0.48 0.6 0.64" frame="parent"/></loop_joint>'
    )
    one, two, axis1, axis2 = in_world(read_urdf(write(tmp_path, robot(*ASKEW, text))).loops[0])
    # Two points, one axis; the frames are parallel at zero, the points are where the file has them.
    np.testing.assert_allclose([axis1, axis2], [PLATFORM.rotation @ [0.48, 0.6, 0.64]] * 2, atol=1e-15)
    np.testing.assert_allclose(one.rotation, two.rotation, atol=1e-15)
    np.testing.assert_allclose(two.translation, ROD.act(np.array([0.4, 0.5, 0.6])), atol=1e-15)


def test_the_rest_of_gazebo_is_still_read(tmp_path: Path) -> None:
    text = GAZEBO.format(kind="ball", axis="").replace(
        "</gazebo>", "<plugin><joint>pin</joint></plugin></gazebo>"
    )
    report = str(stp.load(write(tmp_path, open_square(text))).report)
    assert "ignored: <gazebo>: simulator settings (the file)" in report


@pytest.mark.parametrize("words", ["<turnGravityOff>true</turnGravityOff>", "<gravity>0</gravity>"])
def test_gravity_that_is_off_for_a_link_is_told(words: str, tmp_path: Path) -> None:
    text = GAZEBO.format(kind="ball", axis="") + f'<gazebo reference="rod">{words}</gazebo>'
    report = str(stp.load(write(tmp_path, open_square(text))).report)
    assert "gravity is off for this link in Gazebo, and stays on here" in report


def test_models_of_gazebo_are_left_out_with_the_joint_that_hangs_them_on_the_robot(tmp_path: Path) -> None:
    lamp = "<gazebo><model name='lamp'><link name='light'/></model></gazebo>"
    hung = "<gazebo><joint name='h{}' type='fixed'><parent>{}</parent><child>lamp::light</child></joint></gazebo>"
    chain = stp.load(write(tmp_path, robot(*ASKEW, lamp, hung.format(1, "rod"))))
    assert chain.nv == 2 and not chain.loops
    assert "hangs the <gazebo> model 'lamp' on the robot: both left out (joint 'h1' of <gazebo>)" in str(
        chain.report
    )
    both = (lamp, hung.format(1, "rod"), hung.format(2, "platform"))
    with pytest.raises(FileFormatError, match=r"'h2' of <gazebo> is the second .* may close a loop"):
        stp.load(write(tmp_path, robot(*ASKEW, *both)))
    with pytest.raises(FileFormatError, match=r"missing link 'lamp::light'"):
        stp.load(write(tmp_path, robot(*ASKEW, hung.format(1, "rod"))))
