"""Singularity maps hold what they are said to hold."""

from __future__ import annotations

import numpy as np

import stewart_pin as stp
from stewart_pin.viz.figures import new_figure
from tests.closed_states import robot


def test_map_of_the_planar_platform() -> None:
    chain = robot("rpr_planar")
    found = stp.singularities.singularity_map(
        chain, np.linspace(-1, 5, 9), np.linspace(-3, 3, 9), axes=("vx", "vy", "wz")
    )
    ax = stp.viz.plot_singularity_map(chain, found, twists=3)
    assert ax.get_xlabel() == "x [m]" and ax.get_ylabel() == "y [m]"
    shades = np.asarray(ax.images[0].get_array())
    assert shades.shape == (9, 9, 3)
    # Near type II the picture is blue, elsewhere grey.
    motor = found.measures["motor"]
    nearest = np.unravel_index(np.nanargmin(motor), motor.shape)
    farthest = np.unravel_index(np.nanargmax(motor), motor.shape)
    assert shades[nearest][2] > shades[nearest][0] + 0.2
    assert np.ptp(shades[farthest]) < 1e-9
    dots = [line for line in ax.lines if line.get_linestyle() == "None" and line.get_markersize() == 3]
    assert sum(len(line.get_xdata()) for line in dots) >= len(found.crossings["motor"])
    arrows = [text for text in ax.texts if text.arrow_patch is not None]
    assert len(arrows) == 3
    assert "type II: motors do not hold it" in ax.get_legend_handles_labels()[1]


def test_the_centre_of_rotation_is_where_the_leg_lines_meet() -> None:
    chain = robot("rpr_planar")
    found = stp.singularities.singularity_map(
        chain, np.linspace(-1.5, 5.5, 15), np.linspace(-4.8, 6.2, 21), axes=("vx", "vy", "wz")
    )
    ax = new_figure(5, 5).subplots()
    stp.viz.plot_singularity_map(chain, found, twists=5, ax=ax)
    centres = [line for line in ax.lines if line.get_color() == "black" and line.get_marker() == "o"]
    for line in centres:
        centre = np.array([line.get_xdata()[0], line.get_ydata()[0]])
        # On all three lines of the legs, near the crossing: their distances from it are small beside the robot.
        dotted = next(
            x for x in ax.lines if x.get_linestyle() == ":" and np.allclose(x.get_xydata()[1], centre)
        )
        at = dotted.get_xydata()[0]
        row, column = np.abs(found.y - at[1]).argmin(), np.abs(found.x - at[0]).argmin()
        q = found.q[row, column]
        turn = stp.platform_pose(chain, q).rotation[:2, :2]
        place = np.array([found.x[column], found.y[row]])
        centre = centre - at + place
        for anchor, corner in zip([[0, 0], [5, 0], [0, 6]], [[0, 0], [3, 0], [3, 3]], strict=True):
            leg = place + turn @ corner - anchor
            off = np.cross(np.append(leg, 0) / np.linalg.norm(leg), np.append(centre - anchor, 0))[2]
            assert abs(off) < 1.0
    assert centres
