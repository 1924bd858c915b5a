"""Pictures of the planar 3-RPR platform: polynomial, assembly modes, how many there are; and of six-legged modes.

Needs Matplotlib (the extra ``plot``), which is imported on the first call.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stewart_pin.analysis.assembly_modes import AssemblyModes, describe_modes
from stewart_pin.checks import as_positive
from stewart_pin.errors import InputError, MissingExtraError
from stewart_pin.geometry.hexapod import Hexapod
from stewart_pin.geometry.planar import PlanarRPR, planar_legs
from stewart_pin.geometry.planar_modes import PlanarModes, planar_assembly_modes
from stewart_pin.geometry.planar_polynomial import planar_pose_polynomial
from stewart_pin.geometry.planar_transitions import PlanarTransitions, planar_transition_lengths
from stewart_pin.typing import ArrayLike, FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_PLATFORM = "#0072B2"
_LEGS = ("#D55E00", "#009E73", "#CC79A7")
_CURVE = "#333333"


def plot_pose_polynomial(planar: PlanarRPR, lengths: ArrayLike, *, ax: Axes | None = None) -> Axes:
    """Draw f(θ), whose zeros are the angles of the assembly modes, and mark them.

    Parameters
    ----------
    planar
        Geometry.
    lengths
        (3,) leg lengths [m].
    ax
        Where to draw; a new figure if None.

    Returns
    -------
    matplotlib.axes.Axes
        With θ [rad] across and f [m⁶] up, compressed by asinh because f spans decades.
    """
    modes = planar_assembly_modes(planar, lengths)
    angle = np.linspace(-np.pi, np.pi, 1001)
    values = planar_pose_polynomial(planar, lengths, angle)
    ax = _wide_axes() if ax is None else ax
    ax.axhline(0.0, color="0.6", linewidth=0.8)
    ax.plot(angle, values, color=_CURVE)
    ax.plot(modes.angle, np.zeros(len(modes)), "o", color=_LEGS[0], zorder=3)
    # Linear up to a thousandth of the peak, so that crossings stay visible.
    linear_width = max(float(np.abs(values).max()) * 1e-3, np.finfo(float).tiny)
    ax.set_yscale("asinh", linear_width=linear_width)
    ax.yaxis.set_minor_locator(_ticker().NullLocator())
    ax.yaxis.set_major_locator(_ticker().AsinhLocator(linear_width, numticks=5))
    ax.set_xlim(-np.pi, np.pi)
    ax.set_xticks(np.pi * np.arange(-2, 3) / 2, ["-π", "-π/2", "0", "π/2", "π"])
    ax.set_xlabel("platform angle θ [rad]")
    ax.set_ylabel("f(θ) [m⁶]")
    ax.set_title(_title(modes))
    return ax


def plot_poses(planar: PlanarRPR, lengths: ArrayLike, *, columns: int = 3) -> Figure:
    """Draw every assembly mode in its own frame, with the circles on which the legs keep the corners.

    Parameters
    ----------
    planar
        Geometry.
    lengths
        (3,) leg lengths [m].
    columns
        Most pictures in a row.

    Returns
    -------
    matplotlib.figure.Figure
        One set of axes [m] for each isolated pose.

    Raises
    ------
    InputError
        If there is no isolated pose to draw.
    """
    modes = planar_assembly_modes(planar, lengths)
    lengths = np.asarray(lengths, dtype=np.float64)
    if not len(modes):
        raise InputError(f"lengths {lengths.tolist()} give no isolated pose to draw: {_title(modes)}")
    rows = -(-len(modes) // columns)
    columns = -(-len(modes) // rows)
    figure, grid = _pyplot().subplots(
        rows,
        columns,
        figsize=(2.9 * columns, 2.9 * rows),
        sharex=True,
        sharey=True,
        squeeze=False,
        layout="constrained",
    )
    for k, ax in enumerate(grid.flat):
        if k >= len(modes):
            ax.set_axis_off()
            continue
        _draw_pose(ax, planar, lengths, modes, k)
    figure.suptitle(_title(modes))
    figure.supxlabel("x [m]", fontsize=9)
    figure.supylabel("y [m]", fontsize=9)
    return figure


def plot_mode_count(
    planar: PlanarRPR, lengths: ArrayLike, leg: int, *, ax: Axes | None = None
) -> tuple[Axes, PlanarTransitions]:
    """Draw the number of assembly modes over the length of one leg, and mark where it changes.

    Parameters
    ----------
    planar
        Geometry.
    lengths
        (3,) leg lengths [m]; that of `leg` is not used.
    leg
        Index of the leg that changes.
    ax
        Where to draw; a new figure if None.

    Returns
    -------
    ax : matplotlib.axes.Axes
        With the length [m] across and the number of modes up.
    transitions : PlanarTransitions
        What is marked.
    """
    transitions = planar_transition_lengths(planar, lengths, leg)
    ends = transitions.lengths
    spread = max(float(np.ptp(ends)), 0.2 * float(ends[-1])) if len(ends) else 1.0
    low = max(0.0, float(ends[0]) - 0.15 * spread) if len(ends) else 0.0
    high = (float(ends[-1]) if len(ends) else 1.0) + 0.15 * spread
    ax = _wide_axes() if ax is None else ax
    ax.stairs(transitions.counts, [low, *ends, high], color=_PLATFORM, fill=True, alpha=0.15)
    ax.stairs(transitions.counts, [low, *ends, high], color=_PLATFORM, baseline=None, linewidth=1.8)
    # Alternate the sides: an interval with the most modes is often a narrow one.
    for n, end in enumerate(ends):
        ax.axvline(end, color=_LEGS[0], linewidth=0.8, linestyle=":")
        ax.annotate(
            f"{end:.4f}",
            (end, 0.97),
            (-2 if n % 2 == 0 else 2, 0),
            xycoords=ax.get_xaxis_transform(),
            textcoords="offset points",
            rotation=90,
            va="top",
            ha="right" if n % 2 == 0 else "left",
            fontsize=8,
            color=_LEGS[0],
        )
    ax.set_xlim(low, high)
    ax.set_ylim(0, max(float(transitions.counts.max()), 2.0) * 1.6)
    ax.set_yticks(sorted({0, *transitions.counts.tolist()}))
    ax.set_xlabel(f"length of leg {leg + 1} [m]")
    ax.set_ylabel("assembly modes")
    return ax, transitions


def _draw_pose(ax: Axes, planar: PlanarRPR, lengths: Any, modes: PlanarModes, k: int) -> None:
    legs, _ = planar_legs(planar, modes.position[k], modes.angle[k])
    corners = planar.anchors + legs
    turn = np.linspace(0.0, 2 * np.pi, 181)
    for anchor, corner, length, colour in zip(planar.anchors, corners, lengths, _LEGS, strict=True):
        ax.plot(
            anchor[0] + length * np.cos(turn), anchor[1] + length * np.sin(turn), color=colour, lw=0.7, ls=":"
        )
        ax.plot(*zip(anchor, corner, strict=True), color=colour, linewidth=2.0)
        ax.plot(*anchor, "s", color=_CURVE, markersize=5)
    ax.fill(*corners.T, facecolor=_PLATFORM, edgecolor=_PLATFORM, alpha=0.35, linewidth=1.5)
    ax.plot(*corners.T, "o", color=_PLATFORM, markersize=4)
    ax.set_aspect("equal")
    merged = f", {modes.multiplicity[k]} merged" if modes.multiplicity[k] > 1 else ""
    ax.set_title(f"θ = {modes.angle[k]:.6f} rad{merged}", fontsize=9)
    ax.tick_params(labelsize=7)


def _title(modes: PlanarModes) -> str:
    poses = f"{len(modes)} assembly mode{'' if len(modes) == 1 else 's'}"
    return f"{poses}, and {modes.motion}" if modes.motion else poses


def _wide_axes() -> Axes:
    return _pyplot().subplots(figsize=(7.0, 3.2), layout="constrained")[1]


def _pyplot() -> Any:
    try:
        import matplotlib.pyplot as plt  # noqa: PLC0415
    except ImportError:
        raise MissingExtraError("matplotlib", "plot") from None
    return plt


def _ticker() -> Any:
    _pyplot()
    from matplotlib import ticker  # noqa: PLC0415

    return ticker


# ----------------------------------------------------------------------------------------------------
# Pictures of all assembly modes of a six-legged platform side by side (extra ``plot``)
# ----------------------------------------------------------------------------------------------------

_COLOURS = {1: "tab:blue", -1: "tab:orange", 0: "tab:red"}
"""Platform colour by the sign of det J; red is singular."""


def plot_assembly_modes(
    hexapod: Hexapod, modes: AssemblyModes, *, columns: int = 4, panel_size: float = 2.4
) -> Figure:
    """Draw every assembly mode in its own panel, all from the same side and to the same scale.

    Parameters
    ----------
    hexapod
        Geometry.
    modes
        From `assembly_modes`.
    columns
        Panels in a row.
    panel_size
        Width and height of a panel [inch].

    Returns
    -------
    matplotlib.figure.Figure
        Base grey, legs black, platform blue where det J > 0 and orange where det J < 0.

    Raises
    ------
    InputError
        If there is nothing to draw, or `columns` is not above zero.
    MissingExtraError
        If Matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure  # noqa: PLC0415
        from mpl_toolkits.mplot3d import Axes3D  # noqa: F401, PLC0415
    except ImportError:
        raise MissingExtraError("matplotlib", "plot") from None
    if len(modes) == 0:
        raise InputError("modes holds no pose, there is nothing to draw")
    if columns < 1:
        raise InputError(f"columns must be above zero, got {columns}")
    size = as_positive("panel_size", panel_size)
    rows = -(-len(modes) // columns)
    shown = min(columns, len(modes))
    figure = Figure(figsize=(size * shown, size * rows), layout="constrained")
    facts = describe_modes(hexapod, modes)
    tops = modes.position[:, None] + hexapod.platform_points @ np.swapaxes(modes.rotation, 1, 2)
    everything = np.vstack([hexapod.base_points, tops.reshape(-1, 3)])
    for i, top in enumerate(tops):
        axes = figure.add_subplot(rows, shown, i + 1, projection="3d")
        side = int(facts.side[i])
        _draw(axes, hexapod.base_points, top, _COLOURS[side])
        _frame(axes, everything)
        sign = {1: "det J > 0", -1: "det J < 0", 0: "det J = 0"}[side]
        proof = "" if modes.certified[i] else ", no proof"
        axes.set_title(f"{i + 1}: {sign}, cond {facts.condition[i]:.2g}{proof}", fontsize=7)
    return figure


def _draw(axes: Any, base: FloatArray, top: FloatArray, colour: str) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # noqa: PLC0415

    for points, face in ((base, "0.6"), (top, colour)):
        ring = points[_around(points)]
        axes.add_collection3d(Poly3DCollection([ring], facecolor=face, edgecolor="0.2", alpha=0.5))
    for start, end in zip(base, top, strict=True):
        axes.plot(*np.column_stack([start, end]), color="black", linewidth=0.8)


def _around(points: FloatArray) -> NDArray[np.intp]:
    """Order points by their angle in the plane that fits them best."""
    centred = points - points.mean(axis=0)
    plane = np.linalg.svd(centred)[2][:2]
    return np.argsort(np.arctan2(*(centred @ plane.T).T))


def _frame(axes: Any, everything: FloatArray) -> None:
    low, high = everything.min(axis=0), everything.max(axis=0)
    middle, half = (low + high) / 2, 0.5 * float((high - low).max())
    axes.set(
        xlim=(middle[0] - half, middle[0] + half),
        ylim=(middle[1] - half, middle[1] + half),
        zlim=(middle[2] - half, middle[2] + half),
    )
    axes.set_box_aspect((1, 1, 1))
    axes.view_init(elev=18, azim=-60)
    axes.tick_params(labelsize=5, pad=-3)
    axes.xaxis.set_ticklabels([])
    axes.yaxis.set_ticklabels([])
