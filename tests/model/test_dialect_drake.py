"""Drake's own joints, and its constraints between bodies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import MechanismError
from stewart_pin.model.description import JointKind
from stewart_pin.model.formats.reading import read_urdf
from tests.model.small_dialects import DRAKE_BALL, drake_joint, square
from tests.small_urdf import AXIS_Z, joint, link, robot, write


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


def test_links_without_a_parent_float_beside_drakes_world(tmp_path: Path) -> None:
    held = (
        '<drake:ball_constraint><drake:ball_constraint_body_A name="world"/>'
        '<drake:ball_constraint_body_B name="body"/><drake:ball_constraint_p_AP value="0 0 0"/>'
        '<drake:ball_constraint_p_BQ value="0 0 0"/></drake:ball_constraint>'
    )
    parts = (link("world", ""), link("body"), link("arm"), joint("turn", "body", "arm"))
    chain = stp.load(write(tmp_path, robot(*parts, held)))
    assert (chain.mechanism.joint("body_floats").kind, chain.nv) == (JointKind.FLOATING, 7)
    assert stp.mobility(chain).dof == 4
    assert "has no parent: floats in 'world', as in Drake (link 'body')" in str(chain.report)
    with pytest.raises(MechanismError, match="links without a parent: body, world"):
        stp.load(write(tmp_path, robot(*parts)))
