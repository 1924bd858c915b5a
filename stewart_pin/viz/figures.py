"""Matplotlib, when it is installed, drawing to files without a display; constraint matrices and comparisons."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from stewart_pin.errors import InputError, MissingExtraError
from stewart_pin.mechanics.constraint_matrix.system import ConstraintMatrixSystem
from stewart_pin.studies.comparison import Comparison


def new_figure(width: float, height: float) -> Any:
    """Create an empty figure that belongs to no window.

    Parameters
    ----------
    width, height
        Size [inch].

    Returns
    -------
    matplotlib.figure.Figure
        Figure with constrained layout.

    Raises
    ------
    MissingExtraError
        If Matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure  # noqa: PLC0415 - optional
    except ImportError:
        raise MissingExtraError("matplotlib", "plot") from None
    return Figure(figsize=(width, height), layout="constrained")


def check_picture_path(path: Path | None) -> Path | None:
    """Refuse a picture that could not be written, before anything is computed for it.

    Parameters
    ----------
    path
        File to create, or None for no picture.

    Returns
    -------
    pathlib.Path or None
        The same.

    Raises
    ------
    InputError
        If the suffix is of no known format, or the path is a folder.
    MissingExtraError
        If Matplotlib is not installed.
    """
    if path is None:
        return None
    try:
        from matplotlib.backend_bases import FigureCanvasBase  # noqa: PLC0415 - optional
    except ImportError:
        raise MissingExtraError("matplotlib", "plot") from None
    known = FigureCanvasBase.get_supported_filetypes()
    if path.suffix and path.suffix[1:].lower() not in known:
        raise InputError(
            f"--plot {path}: pictures end in .{', .'.join(sorted(known))}; choose another suffix"
        )
    if path.is_dir():
        raise InputError(f"--plot {path}: is a folder; name a file in it")
    return path


def save_figure(figure: Any, path: Path) -> None:
    """Write a figure as PNG.

    Parameters
    ----------
    figure
        What to write.
    path
        File to create or overwrite; missing folders are made.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130)


# ----------------------------------------------------------------------------------------------------
# The constraint matrix as a picture: bodies down, joints across
# ----------------------------------------------------------------------------------------------------


def plot_constraint_matrix(system: ConstraintMatrixSystem) -> Any:
    """Draw the entries of C, with a line between bodies and between groups of like joints.

    Parameters
    ----------
    system
        What `constraint_matrix_system` returned.

    Returns
    -------
    matplotlib.figure.Figure
        The figure; positive entries red, negative ones blue, zeros white.
    """
    matrix = system.C.toarray()
    # Entries span forces and moments: the picture shows signs and rough sizes.
    shade = np.sign(matrix) * np.minimum(np.abs(matrix), 1.0) ** 0.5
    figure = new_figure(9.5, 8.5)
    axis = figure.subplots()
    axis.imshow(shade, cmap="RdBu_r", vmin=-1.2, vmax=1.2, aspect="auto", interpolation="nearest")
    rows = 6 * np.arange(len(system.bodies))
    axis.set_yticks(rows + 2.5, system.bodies, fontsize=8)
    for row in rows[1:]:
        axis.axhline(row - 0.5, color="0.8", linewidth=0.6)
    labels, centres = [], []
    for label, members in groupby(zip(system.kinds, system.columns, strict=True), key=lambda entry: entry[0]):
        columns = [columns for _, columns in members]
        first, last = columns[0].start, columns[-1].stop
        labels.append(f"{label}\n{len(columns)} × {(last - first) // len(columns)}")
        centres.append((first + last - 1) / 2)
        axis.axvline(last - 0.5, color="0.3", linewidth=0.8)
    axis.set_xticks(centres, labels, fontsize=8)
    axis.xaxis.tick_top()
    axis.tick_params(length=0)
    axis.grid(visible=False)
    axis.set_xlabel(f"C: {matrix.shape[0]} × {matrix.shape[1]}, rank {np.linalg.matrix_rank(matrix)}")
    return figure


# ----------------------------------------------------------------------------------------------------
# Motor forces over time, all methods overlaid, and their differences on a logarithmic axis
# ----------------------------------------------------------------------------------------------------

_STYLES = {
    "pinocchio": {"color": "C0", "linewidth": 3.0, "alpha": 0.5},
    "constraint_matrix": {"color": "C1", "linewidth": 1.4, "linestyle": "--"},
    "closed_form": {"color": "k", "linewidth": 0.8, "linestyle": ":"},
    "point_mass": {"color": "C3", "linewidth": 1.0},
}


def plot_comparison(comparison: Comparison) -> Any:
    """Draw one column per three motors: forces above, differences between the methods below.

    Parameters
    ----------
    comparison
        What `compare_methods` returned.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.
    """
    count = len(comparison.motors)
    width = min(3, count)
    rows = -(-count // width)
    figure = new_figure(4.3 * width, 3.0 * rows + 2.8)
    upper, lower = figure.subfigures(2, 1, height_ratios=[3.0 * rows, 2.8])
    axes = upper.subplots(rows, width, sharex=True, sharey=True, squeeze=False)
    for k, motor in enumerate(comparison.motors):
        axis = axes.flat[k]
        for method, forces in comparison.forces.items():
            axis.plot(comparison.time, forces[:, k], label=method, **_STYLES.get(method, {}))
        point = comparison.simplified.get("point_mass")
        if point is not None:
            axis.plot(comparison.time, point[:, k], label="point_mass", **_STYLES["point_mass"])
        axis.set_title(motor, fontsize=10)
        axis.grid(alpha=0.3)
    for axis in axes[:, 0]:
        axis.set_ylabel("effort [N or N m]" if count != 6 else "force [N]")
    for axis in axes.flat[count:]:
        axis.set_visible(False)
    handles, labels = axes.flat[0].get_legend_handles_labels()
    upper.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)
    _plot_differences(lower.subplots(1, 2, sharey=True), comparison)
    return figure


def _plot_differences(axes: Any, comparison: Comparison) -> None:
    titles = ("with the robot's masses", "massless legs and a point platform")
    for axis, title, forces in zip(axes, titles, (comparison.forces, comparison.simplified), strict=True):
        reference = forces["pinocchio"]
        scale = np.abs(reference).max()
        for method, values in forces.items():
            if method == "pinocchio":
                continue
            # Differences of exactly zero are drawn at the unit of round-off.
            difference = np.maximum(np.abs(values - reference).max(axis=1) / scale, np.finfo(float).eps / 4)
            style = {"color": _STYLES[method]["color"]} if method in _STYLES else {}
            axis.semilogy(comparison.time, difference, linewidth=0.8, label=f"{method} - pinocchio", **style)
        axis.axhline(1e-10, color="0.5", linestyle="--", linewidth=0.8)
        axis.set_title(title, fontsize=10)
        axis.set_xlabel("time [s]")
        axis.set_ylim(1e-17, 1e-8)
        axis.legend(fontsize=8, loc="upper right")
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("relative difference")
