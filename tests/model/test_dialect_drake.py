"""Drake's own joints, and its constraints between bodies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.model.description import JointKind
from stewart_pin.model.formats.reading import read_urdf
from tests.model.small_dialects import DRAKE_BALL, drake_joint, square
from tests.small_urdf import AXIS_Z, link, robot, write


@pytest.mark.parametrize("declared", [True, False])
def test_drake_joints(tmp_path: Path, declared: bool) -> None:
    def read(kind: str, content: str = "") -> list:
        namespace = 'xmlns:drake="http://drake.mit.edu"' if declared else ""
        text = robot(link("base"), link("platform"), drake_joint(kind, content), attributes=namespace)
        mechanism = read_urdf(write(tmp_path, text))
        return [*mechanism.joints, *mechanism.couplings]

    (ball,) = read("ball", "<dynamics damping='1'/>")
    assert ball.kind is JointKind.SPHERICAL
    np.testing.assert_array_equal(ball.placement.translation, [1, 0, 0])
    first, second = read("universal")
    np.testing.assert_array_equal([first.axis, second.axis], [[1, 0, 0], [0, 1, 0]])
    x, y, turn = read("planar", AXIS_Z)
    assert [each.kind for each in (x, y, turn)] == [JointKind.PRISMATIC] * 2 + [JointKind.REVOLUTE]
    np.testing.assert_array_equal(turn.axis, [0, 0, 1])
    turn, slide, thread = read("screw", f'{AXIS_Z}<drake:screw_thread_pitch value="0.5"/>')
    assert (thread.joint1, thread.joint2) == (slide.name, turn.name) == ("j_slide", "j")
    np.testing.assert_allclose(thread.polynomial, [0, 0.5 / (2 * np.pi)])


def test_drakes_constraints_between_two_bodies_are_numbered(tmp_path: Path) -> None:
    chain = stp.load(write(tmp_path, square(DRAKE_BALL, DRAKE_BALL.replace('"1 0 0"', '"1 0 0.1"'))))
    assert [each.name for each in chain.loops] == ["platform_rocker_ball_1", "platform_rocker_ball_2"]
