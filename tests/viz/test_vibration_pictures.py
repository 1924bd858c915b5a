"""Pictures of vibrations: a panel per mode, curves where the platform answers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError
from tests.closed_states import robot
from tests.small_urdf import MOTOR, ROD, joint, link
from tests.small_urdf import robot as robot_text

pytest.importorskip("matplotlib")


def test_modes_stand_beside_the_robot_at_rest() -> None:
    chain = robot("five_bar")
    found = stp.natural_frequencies(chain, chain.q_home, motor_stiffness=1e4)
    figure = stp.viz.plot_mode_shapes(chain, chain.q_home, found)
    assert [axis.get_title() for axis in figure.axes] == [f"{f:.3g} Hz" for f in found.frequency]
    for axis, shape in zip(figure.axes, found.shape.T, strict=True):
        pale = [line for line in axis.lines if line.get_color() == "0.6"]
        assert pale, "the robot at rest"
        q = chain.q_home + 0.15 * shape
        end = stp.platform_pose(chain, stp.close_loops(chain, q).q).translation
        tips = np.array([line.get_data_3d() for line in axis.lines if line.get_color() in ("r", "g", "b")])
        np.testing.assert_allclose(tips[:, :, 0], np.tile(end, (3, 1)), atol=1e-9)
    wrong: Any
    for wrong in ([2], [-1], [], [0.5], "0", 1, [True]):
        with pytest.raises(InputError, match="modes must name some of the 2"):
            stp.viz.plot_mode_shapes(chain, chain.q_home, found, modes=wrong)
    for wrong in (np.nan, "x", None, [0.1, 0.2]):
        with pytest.raises(InputError, match="amplitude must"):
            stp.viz.plot_mode_shapes(chain, chain.q_home, found, amplitude=wrong)
    other = robot("stewart")
    with pytest.raises(InputError, match="vibration is one of another chain"):
        stp.viz.plot_mode_shapes(other, other.q_home, found)


def test_a_swing_is_not_looked_at_from_its_end(tmp_path: Path) -> None:
    """A rod that swings along x about an axis y is drawn aside of its bearing, in the plane of y and z."""
    file = tmp_path / "pendulum.urdf"
    tip = joint("end", "platform", "tip", "fixed", origin='xyz="1 0 0"', axis="")
    hinge = joint("hinge", "base", "platform", axis='<axis xyz="0 1 0"/>', attributes=MOTOR)
    file.write_text(robot_text(link("base"), link("platform", ROD), link("tip"), hinge, tip))
    chain, down = stp.load(file), [np.pi / 2]
    axis = stp.viz.plot_mode_shapes(
        chain, down, stp.natural_frequencies(chain, down, motor_stiffness=1.0)
    ).axes[0]
    lines = np.hstack([line.get_data_3d() for line in axis.lines])
    across = [np.sin(np.radians(axis.azim)), np.cos(np.radians(axis.azim))]
    assert np.ptp(lines[0]) > 0.1
    assert abs(across[0]) > 0.2, "x is seen"


def test_answers_to_shaking_are_drawn_with_their_numbers() -> None:
    chain = robot("five_bar")
    f = np.geomspace(1.0, 50.0, 7)[[6, 0, 1, 2, 3, 4, 5]]
    found = stp.dynamics.frequency_response(
        chain, chain.q_home, frequency=f, motor_stiffness=1e4, motor_damping=5.0
    )
    figure = stp.viz.plot_frequency_response(found, inputs=["left_hip"])
    gains, phases = figure.axes
    assert gains.get_title() == "from motor position left_hip"
    curves = {line.get_label(): line.get_ydata() for line in gains.lines}
    assert (np.diff(gains.lines[0].get_xdata()) > 0).all(), "lines run from left to right"
    assert set(curves) >= {"x", "z"} or set(curves) >= {"x", "y"}
    for label, values in curves.items():
        np.testing.assert_allclose(values, np.abs(found.values[np.argsort(f), found.outputs.index(label), 0]))
    assert len(phases.lines) == len(gains.lines)
    with pytest.raises(InputError, match="inputs must be some of left_hip, right_hip"):
        stp.viz.plot_frequency_response(found, inputs=["hip"])
    with pytest.raises(InputError, match="two frequencies above zero"):
        stp.viz.plot_frequency_response(
            stp.dynamics.frequency_response(chain, chain.q_home, frequency=[0.0], motor_stiffness=1e4)
        )
