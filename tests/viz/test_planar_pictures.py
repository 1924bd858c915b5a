"""The pictures of planar platforms show what the solver found."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import stewart_pin as stp
from stewart_pin.errors import InputError, MissingExtraError
from stewart_pin.viz.planar import plot_mode_count, plot_pose_polynomial, plot_poses


@pytest.fixture
def exercise() -> stp.PlanarRPR:
    """Return the platform of S1.4 to S1.7."""
    return stp.PlanarRPR.from_sides(3.0, 3 * 2**0.5, 3.0, np.pi / 4, 5.0, 0.0, 6.0)


@pytest.fixture
def pyplot():
    """Return pyplot without a display, and close its figures."""
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    from matplotlib import pyplot

    yield pyplot
    pyplot.close("all")


def test_polynomial_with_its_roots(exercise: stp.PlanarRPR, pyplot) -> None:
    ax = plot_pose_polynomial(exercise, [5.0, 5.0, 3.0])
    roots = ax.lines[-1].get_xdata()
    np.testing.assert_allclose(
        roots, [-0.720849204460390, -0.331005184283869, 1.143685517821374, 2.115909014086458], atol=1e-14
    )
    ax.figure.canvas.draw()
    other = pyplot.figure().add_subplot()
    assert plot_pose_polynomial(exercise, [5.0, 5.0, 3.0], ax=other) is other


def test_every_pose_in_its_own_frame(exercise: stp.PlanarRPR, pyplot) -> None:
    figure = plot_poses(exercise, [5.0, 7.0, 3.0])
    drawn = [ax for ax in figure.axes if ax.patches]
    assert len(drawn) == 6
    modes = stp.planar_assembly_modes(exercise, [5.0, 7.0, 3.0])
    for ax, position in zip(drawn, modes.position, strict=True):
        # The first corner of S1.4 is the platform origin.
        np.testing.assert_allclose(ax.patches[0].get_xy()[0], position, atol=1e-12)
    figure.canvas.draw()
    with pytest.raises(InputError, match="no isolated pose"):
        plot_poses(exercise, [1.0, 1.0, 30.0])


def test_count_over_one_leg(exercise: stp.PlanarRPR, pyplot) -> None:
    ax, found = plot_mode_count(exercise, [5.0, 0.0, 3.0], 1)
    assert [text.get_text() for text in ax.texts] == [f"{x:.4f}" for x in found.lengths]
    assert ax.patches[0].get_data().values.tolist() == [0, 2, 4, 6, 4, 2, 0]
    ax.figure.canvas.draw()


def test_missing_matplotlib_is_named(exercise: stp.PlanarRPR, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match=r"stewart_pin\[plot\]"):
        plot_pose_polynomial(exercise, [5.0, 5.0, 3.0])
