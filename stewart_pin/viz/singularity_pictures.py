"""Singularity maps: classes in colour over a plane of the workspace, with the motions that are gained."""

from __future__ import annotations

from typing import Any

import numpy as np

from stewart_pin.analysis.singularity_map import SingularityMap
from stewart_pin.mechanics.singularity import Screw, SingularityKind, classify_singularity
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.freedom import TWIST_AXES
from stewart_pin.state.generic import generic_freedom
from stewart_pin.viz.figures import new_figure

_COLOURS = {
    SingularityKind.PLATFORM: "#D55E00",
    SingularityKind.MOTOR: "#0072B2",
    SingularityKind.LOOP: "#CC79A7",
    SingularityKind.PASSIVE: "#009E73",
}
_LABELS = {
    SingularityKind.PLATFORM: "type I: platform cannot move some way",
    SingularityKind.MOTOR: "type II: motors do not hold it",
    SingularityKind.LOOP: "loops leave more freedom",
    SingularityKind.PASSIVE: "passive joints move alone",
}


def plot_singularity_map(
    chain: ClosedChain, found: SingularityMap, *, near: float = 0.1, twists: int = 6, ax: Any = None
) -> Any:
    """Draw where a robot is singular, of which kind, and how it then moves by itself.

    A cell has the colour of the kind whose measure is smallest, the fuller the nearer. Dots mark where a measure
    changes its sign. Arrows show the twist that the motors cannot hold, a dot the point about which the platform turns
    instead where that lies in the picture.

    Parameters
    ----------
    chain
        Closed chain.
    found
        What `singularity_map` returned for it.
    near
        Measure below which a cell is coloured, lengths in robot sizes.
    twists
        Most arrows to draw.
    ax
        Axes to draw on; a new figure if None.

    Returns
    -------
    matplotlib.axes.Axes
        Positions in the plane [m].
    """
    if ax is None:
        ax = new_figure(7.2, 6.0).subplots()
    ax.imshow(
        _shades(found, near),
        origin="lower",
        extent=(*_edges(found.x), *_edges(found.y)),
        interpolation="nearest",
        aspect="equal",
    )
    names = [name[1] for name in found.plane]
    ax.set_xlabel(f"{names[0]} [m]")
    ax.set_ylabel(f"{names[1]} [m]")
    for kind, colour in _COLOURS.items():
        values = found.measures[kind]
        ax.plot(*found.crossings[kind].T, "o", color=colour, markersize=3, markeredgewidth=0)
        if (np.abs(values[np.isfinite(values)]) < near).any():
            ax.plot([], [], "s", color=colour, label=_LABELS[kind])
    _draw_twists(ax, chain, found, twists)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, fontsize=8, frameon=False)
    ax.set_title(f"{chain.name}: singularities of one branch")
    return ax


def _shades(found: SingularityMap, near: float) -> np.ndarray:
    """Colour of each cell, (ny, nx, 3): white out of reach, grey where regular."""
    from matplotlib.colors import to_rgb  # noqa: PLC0415 - optional

    kinds = list(_COLOURS)
    sizes = np.array([np.abs(found.measures[kind]) for kind in kinds])
    sizes = np.where(np.isnan(sizes), np.inf, sizes)
    nearest, value = sizes.argmin(axis=0), sizes.min(axis=0)
    strength = np.clip(1 - value / near, 0, 1)[..., None]
    colours = np.array([to_rgb(_COLOURS[kind]) for kind in kinds])[nearest]
    shades = (1 - strength) * np.array([0.93, 0.93, 0.93]) + strength * colours
    shades[~found.reached] = 1.0
    return shades


def _edges(values: np.ndarray) -> tuple[float, float]:
    half = (values[1] - values[0]) / 2
    return float(values[0] - half), float(values[-1] + half)


def _draw_twists(ax: Any, chain: ClosedChain, found: SingularityMap, count: int) -> None:
    points = found.crossings[SingularityKind.MOTOR]
    if not len(points) or count < 1:
        return
    generic = generic_freedom(chain, found.axes)
    span = float(np.ptp(found.x))
    columns = [TWIST_AXES.index(name) for name in found.plane]
    for at in points[_spread(points, count)]:
        row, column = np.abs(found.y - at[1]).argmin(), np.abs(found.x - at[0]).argmin()
        if not found.reached[row, column]:
            continue
        twist = classify_singularity(
            chain, found.q[row, column], generic=generic, length=found.length
        ).worst_twist
        _draw_twist(ax, at, twist, columns, span)


def _draw_twist(ax: Any, at: np.ndarray, twist: Screw, columns: list[int], span: float) -> None:
    way = twist.values[columns]
    speed = float(np.linalg.norm(way))
    if speed == 0.0:
        return
    arrow = 0.09 * span * way / speed
    ax.annotate(
        "", at + arrow, at - arrow, arrowprops={"arrowstyle": "<->", "color": "black", "linewidth": 1.4}
    )
    # Turning about the normal of the plane: the point that stands still lies at right angles to the velocity.
    i, j = columns
    normal = 3 - i - j
    spin = float(twist.values[3 + normal]) * (1 if (j - i) % 3 == 1 else -1)
    if spin:
        centre = at + np.array([-way[1], way[0]]) / spin
        low, high = np.array([ax.get_xlim(), ax.get_ylim()]).T
        if (low < centre).all() and (centre < high).all():
            ax.plot(*zip(at, centre, strict=True), ":", color="black", linewidth=0.8)
            ax.plot(*centre, "o", color="black", markersize=3)


def _spread(points: np.ndarray, count: int) -> list[int]:
    """Choose points far from each other: each time the one farthest from those chosen."""
    chosen = [0]
    while len(chosen) < min(count, len(points)):
        away = np.linalg.norm(points[:, None] - points[chosen], axis=2).min(axis=1)
        chosen.append(int(away.argmax()))
    return chosen
