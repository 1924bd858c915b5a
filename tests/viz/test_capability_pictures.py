"""Pictures of workspaces and polytopes show what they are given."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError

STROKE = (2.20147, 2.70147)


@pytest.fixture(scope="module")
def samples() -> stp.workspaces.WorkspaceSamples:
    hexapod = stp.Hexapod.from_chain(stp.load("stewart_cad"))
    return stp.workspaces.sample_workspace(hexapod, np.eye(3), stroke=STROKE, spacing=0.15)


def test_workspace_picture_shows_inside_and_boundary(samples: stp.workspaces.WorkspaceSamples) -> None:
    figure = stp.viz.plot_workspace(samples)
    cloud, skin = figure.axes[:2]
    assert len(skin.collections[0]._offsets3d[0]) == np.count_nonzero(samples.boundary)
    shades = cloud.collections[0].get_array()
    assert 0 < len(shades) < np.count_nonzero(samples.inside)
    assert shades.max() <= samples.dexterity[samples.inside].max()
    (legend,) = figure.legends
    assert "leg 4 least" in {text.get_text() for text in legend.get_texts()}


@pytest.mark.parametrize("count", [1, 4])
def test_slices_cover_the_height(samples: stp.workspaces.WorkspaceSamples, count: int) -> None:
    figure = stp.viz.plot_workspace_slices(samples, count=count)
    pictures = [axis for axis in figure.axes if axis.get_visible() and axis.images]
    assert len(pictures) == count
    heights = [float(axis.get_title().split()[2]) for axis in pictures]
    z = samples.position[samples.inside, 2]
    assert z.min() < min(heights) and max(heights) < z.max()
    middle = pictures[-1].images[0].get_array()
    assert np.isfinite(middle.filled(np.nan)).any()


def test_slices_of_nothing_are_refused(samples: stp.workspaces.WorkspaceSamples) -> None:
    with pytest.raises(InputError, match="count must be 1 or more"):
        stp.viz.plot_workspace_slices(samples, count=0)
    apart = stp.Hexapod(20 * np.eye(6, 3) + np.arange(18).reshape(6, 3), np.eye(6, 3))
    empty = stp.workspaces.sample_workspace(apart, np.eye(3), stroke=(0.1, 0.2))
    with pytest.raises(InputError, match="no points to draw"):
        stp.viz.plot_workspace(empty)


def test_polytope_picture_has_a_polygon_for_every_face() -> None:
    chain = stp.load("stewart_cad")
    velocity = stp.polytopes.polytope_section(stp.polytopes.velocity_polytope(chain, chain.q_home))
    force = stp.polytopes.polytope_projection(stp.polytopes.wrench_polytope(chain, chain.q_home))
    figure = stp.viz.plot_polytopes([velocity, force], titles=["velocity", "force"])
    for axis, polytope in zip(figure.axes, (velocity, force), strict=True):
        faces = [
            c for c in axis.collections if type(c).__name__ == "Poly3DCollection" and c.get_alpha() == 0.35
        ]
        polygons = [face for face in faces if len(face._faces) == 1]
        assert len(polygons) == len(polytope.offsets)
        assert axis.get_xlabel() == f"{polytope.names[0]} [{polytope.units[0]}]"
        # Each corner is drawn by the faces that meet there.
        drawn = np.unique(np.round(np.concatenate([face._faces[0] for face in polygons]), 6), axis=0)
        assert len(drawn) == len(polytope.vertices)
    labels = {text.get_text() for text in figure.legends[0].get_texts()}
    assert {"leg1", "leg6", "several motors"} <= labels


def test_polytopes_that_cannot_be_drawn_are_refused() -> None:
    chain = stp.load("stewart")
    whole = stp.polytopes.velocity_polytope(chain, chain.q_home)
    with pytest.raises(InputError, match="must have 3 coordinates, got 6"):
        stp.viz.plot_polytopes([whole])
    with pytest.raises(InputError, match="titles must be 1"):
        stp.viz.plot_polytopes([stp.polytopes.polytope_section(whole)], titles=["a", "b"])
    with pytest.raises(InputError, match="at least one"):
        stp.viz.plot_polytopes([])
