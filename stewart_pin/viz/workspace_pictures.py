"""The workspace of a six-legged platform: how well it moves inside, what stops it at the boundary, and slices."""

from __future__ import annotations

from typing import Any

import numpy as np

from stewart_pin.analysis.workspace import WorkspaceSamples
from stewart_pin.errors import InputError
from stewart_pin.viz.figures import new_figure

_PATCHES = ("C0", "C1", "C2", "C3", "C4", "C5")
"""One colour per leg; pale where its least length limits, full where its greatest does."""


def plot_workspace(samples: WorkspaceSamples) -> Any:
    """Draw the cloud coloured by dexterity, cut open, beside its boundary coloured by the limiting leg.

    Parameters
    ----------
    samples
        What `sample_workspace` returned.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    InputError
        If the workspace is empty.
    """
    _require_points(samples)
    figure = new_figure(11.0, 5.0)
    cloud, skin = figure.subplots(1, 2, subplot_kw={"projection": "3d"})
    # The quarter towards the viewer is left out, so that the inside shows.
    middle = samples.position[samples.inside].mean(axis=0)
    away = (samples.position[:, 0] > middle[0]) & (samples.position[:, 1] < middle[1])
    shown = samples.inside & ~away
    dots = cloud.scatter(
        *samples.position[shown].T, c=samples.dexterity[shown], s=4, cmap="viridis", depthshade=False,
        linewidths=0, rasterized=True,
    )  # fmt: skip
    figure.colorbar(dots, ax=cloud, shrink=0.6, pad=0.12, label="dexterity: 1 / condition number")
    cloud.set_title("inside, one quarter cut away", fontsize=10)
    edge = samples.boundary
    skin.scatter(
        *samples.position[edge].T, c=_patch_colours(samples)[edge], s=4, depthshade=False, linewidths=0,
        rasterized=True,
    )  # fmt: skip
    skin.set_title("boundary, by the leg that limits", fontsize=10)
    _legend(figure, samples, edge)
    extent = np.ptp(samples.position[samples.inside], axis=0)
    for axis in (cloud, skin):
        axis.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
        axis.set_box_aspect(np.maximum(extent, 0.1 * extent.max()), zoom=0.9)
        axis.locator_params(nbins=5)
        axis.tick_params(labelsize=8)
        axis.view_init(elev=25, azim=-60)
    return figure


def plot_workspace_slices(samples: WorkspaceSamples, *, count: int = 6) -> Any:
    """Draw horizontal slices: dexterity inside, the limiting leg along the boundary.

    Parameters
    ----------
    samples
        What `sample_workspace` returned.
    count
        Number of slices, evenly spaced over the height.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    InputError
        If the workspace is empty, or no slice is asked for.
    """
    _require_points(samples)
    if count < 1:
        raise InputError(f"count must be 1 or more, got {count}")
    layers = np.unique(samples.index[samples.inside, 2])
    chosen = layers[np.linspace(0, len(layers) - 1, count + 2).round().astype(int)[1:-1]]
    columns = min(3, count)
    rows = -(-count // columns)
    figure = new_figure(3.6 * columns + 0.6, 3.3 * rows + 0.7)
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    scale = samples.dexterity[samples.inside]
    span = (float(scale.min()), float(scale.max()))
    start = samples.position[0] - (samples.index[0] + 0.5) * samples.spacing
    end = start + np.array(samples.shape) * samples.spacing
    colours = _patch_colours(samples)
    picture = None
    for axis, layer in zip(axes.flat, chosen, strict=False):
        here = samples.inside & (samples.index[:, 2] == layer)
        image = np.full(samples.shape[:2], np.nan)
        image[tuple(samples.index[here, :2].T)] = samples.dexterity[here]
        picture = axis.imshow(
            image.T, origin="lower", extent=(start[0], end[0], start[1], end[1]), cmap="viridis",
            vmin=span[0], vmax=span[1], interpolation="nearest",
        )  # fmt: skip
        rim = here & samples.boundary
        axis.scatter(*samples.position[rim, :2].T, c=colours[rim], s=5, linewidths=0)
        height = float(samples.position[here, 2][0])
        axis.set_title(f"z = {height:.3f} m", fontsize=10)
    for axis in axes.flat[count:]:
        axis.set_visible(False)
    low, high = (reduce(samples.position[samples.inside, :2], axis=0) for reduce in (np.min, np.max))
    margin = 2 * samples.spacing
    axes[0, 0].set(xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin, high[1] + margin))
    for axis in axes[-1]:
        axis.set_xlabel("x [m]")
    for axis in axes[:, 0]:
        axis.set_ylabel("y [m]")
    figure.colorbar(picture, ax=axes, shrink=0.7, label="dexterity: 1 / condition number")
    _legend(figure, samples, samples.boundary)
    return figure


def _require_points(samples: WorkspaceSamples) -> None:
    if not samples.inside.any():
        raise InputError("the workspace has no points to draw; choose another stroke or a smaller spacing")


def _patch_colours(samples: WorkspaceSamples) -> np.ndarray:
    """(N, 4) colour of the limiting leg."""
    from matplotlib.colors import to_rgba  # noqa: PLC0415 - optional; new_figure has checked

    full = np.array([to_rgba(colour) for colour in _PATCHES])
    colours = full[samples.limiting_leg]
    short = samples.limiting_end < 0
    colours[short, :3] = 1 - 0.45 * (1 - colours[short, :3])
    return colours


def _legend(figure: Any, samples: WorkspaceSamples, chosen: np.ndarray) -> None:
    from matplotlib.lines import Line2D  # noqa: PLC0415 - optional; new_figure has checked

    colours = _patch_colours(samples)
    handles = []
    for end, word in ((1, "longest"), (-1, "shortest")):
        for leg in range(6):
            found = np.flatnonzero(chosen & (samples.limiting_leg == leg) & (samples.limiting_end == end))
            if len(found):
                label = f"leg {leg + 1} {word}"
                mark = Line2D([], [], marker="o", linestyle="", color=tuple(colours[found[0]]), label=label)
                handles.append(mark)
    figure.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False, fontsize=8)
