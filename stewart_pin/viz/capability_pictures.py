"""What a platform can do, in pictures: velocity and force polytopes, singularity maps, the workspace."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from stewart_pin.analysis.singularity_map import SingularityMap
from stewart_pin.analysis.workspace import WorkspaceSamples
from stewart_pin.errors import InputError
from stewart_pin.mechanics.capability.polytope import Polytope, inscribed_ball
from stewart_pin.mechanics.singularity import Screw, SingularityKind, classify_singularity
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.freedom import TWIST_AXES
from stewart_pin.state.generic import generic_freedom
from stewart_pin.viz.figures import new_figure


def plot_polytopes(polytopes: Sequence[Polytope], *, titles: Sequence[str] = (), ball: bool = True) -> Any:
    """Draw three-dimensional polytopes side by side, their faces coloured by the joint that limits.

    Parameters
    ----------
    polytopes
        With three coordinates each; see `polytope_section` and `polytope_projection`.
    titles
        One for each, or none.
    ball
        Whether the largest ball about rest and the worst direction are drawn, where zero lies inside. The axes have
        their own scales, so the ball may look like an ellipsoid.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    InputError
        If a polytope has not three coordinates, or the number of titles does not fit.
    """
    for polytope in polytopes:
        if len(polytope.names) != 3:
            raise InputError(
                f"a polytope to be drawn must have 3 coordinates, got {len(polytope.names)}; "
                "use polytope_section or polytope_projection"
            )
    if not polytopes:
        raise InputError("polytopes must hold at least one polytope")
    if titles and len(titles) != len(polytopes):
        raise InputError(f"titles must be {len(polytopes)} strings, got {len(titles)}")
    figure = new_figure(4.8 * len(polytopes), 4.9)
    axes = figure.subplots(1, len(polytopes), subplot_kw={"projection": "3d"}, squeeze=False)[0]
    joints: dict[str, str] = {}
    for k, (axis, polytope) in enumerate(zip(axes, polytopes, strict=True)):
        _draw(axis, polytope, joints, ball=ball)
        if titles:
            axis.set_title(titles[k], fontsize=10)
    _polytope_legend(figure, joints)
    return figure


def _draw(axis: Any, polytope: Polytope, joints: dict[str, str], *, ball: bool) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # noqa: PLC0415 - optional; new_figure has checked

    size = np.abs(polytope.vertices * polytope.scale).max()
    for normal, offset, limit in zip(polytope.normals, polytope.offsets, polytope.limits, strict=True):
        corners = polytope.vertices[np.abs(polytope.vertices @ normal - offset) < 1e-7 * size]
        if len(corners) < 3:
            continue
        joint = limit.split(" at ")[0] or "several motors"
        colour = joints.setdefault(joint, f"C{len(joints)}")
        face = Poly3DCollection([_around(corners, normal)], facecolor=colour, edgecolor="0.25", linewidth=0.7)
        face.set_alpha(0.35)
        axis.add_collection3d(face)
    largest = inscribed_ball(polytope)
    if ball and largest.radius > 0:
        u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 33), np.linspace(0, np.pi, 17))
        unit = np.array([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
        points = largest.radius * unit / polytope.scale[:, None, None]
        axis.plot_surface(*points, color="0.2", alpha=0.35, linewidth=0)
        axis.plot(*np.array([np.zeros(3), largest.direction]).T, color="k", linewidth=2)
    axis.scatter(0, 0, 0, color="k", s=8)
    low, high = polytope.vertices.min(axis=0), polytope.vertices.max(axis=0)
    margin = 0.02 * np.maximum(high - low, 0.05 * (high - low).max())
    labels = [f"{name} [{unit}]" for name, unit in zip(polytope.names, polytope.units, strict=True)]
    for name, start, end, label in zip("xyz", low - margin, high + margin, labels, strict=True):
        axis.set(**{f"{name}lim": (start, end), f"{name}label": label})
        axis.locator_params(axis=name, nbins=5)
    # Sets ten times longer than wide are usual: true proportions would hide them, so the axes differ in scale.
    extent = (high - low) * polytope.scale
    axis.set_box_aspect(np.clip(extent / extent.max(), 0.6, 1.0), zoom=0.85)
    axis.tick_params(labelsize=8)
    axis.view_init(elev=22, azim=-55)


def _around(corners: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Put the corners of a face in order around its middle."""
    out = corners - corners.mean(axis=0)
    across = np.cross(normal, out[0])
    angle = np.arctan2(
        out @ across / np.linalg.norm(across), out @ np.cross(across, normal) / np.linalg.norm(across)
    )
    return corners[np.argsort(angle)]


def _polytope_legend(figure: Any, joints: dict[str, str]) -> None:
    from matplotlib.patches import Patch  # noqa: PLC0415 - optional; new_figure has checked

    handles = [Patch(color=colour, alpha=0.5, label=joint) for joint, colour in sorted(joints.items())]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=max(1, min(8, len(handles))), frameon=False
    )


# ----------------------------------------------------------------------------------------------------
# Singularity maps: classes in colour over a plane of the workspace, with the motions that are gained
# ----------------------------------------------------------------------------------------------------

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


# ----------------------------------------------------------------------------------------------------
# The workspace of a six-legged platform: how well it moves inside, what stops it at the boundary, and slices
# ----------------------------------------------------------------------------------------------------

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
    skin.set_title("boundary, by what limits", fontsize=10)
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
    colours = full[samples.limiting_leg % len(full)]
    short = samples.limiting_end < 0
    colours[short, :3] = 1 - 0.45 * (1 - colours[short, :3])
    return colours


def _legend(figure: Any, samples: WorkspaceSamples, chosen: np.ndarray) -> None:
    from matplotlib.lines import Line2D  # noqa: PLC0415 - optional; new_figure has checked

    colours = _patch_colours(samples)
    handles = []
    for end, word in ((1, "greatest"), (-1, "least")):
        for leg, name in enumerate(samples.limits):
            found = np.flatnonzero(chosen & (samples.limiting_leg == leg) & (samples.limiting_end == end))
            if len(found):
                colour = tuple(colours[found[0]])
                mark = Line2D([], [], marker="o", linestyle="", color=colour, label=f"{name} {word}")
                handles.append(mark)
    figure.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False, fontsize=8)
