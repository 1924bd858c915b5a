"""Pictures of all assembly modes of a six-legged platform side by side (extra ``plot``)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stewart_pin.analysis.assembly_modes import AssemblyModes, describe_modes
from stewart_pin.checks import as_positive
from stewart_pin.errors import InputError, MissingExtraError
from stewart_pin.geometry.hexapod import Hexapod
from stewart_pin.typing import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
