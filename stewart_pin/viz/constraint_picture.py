"""The constraint matrix as a picture: bodies down, joints across."""

from __future__ import annotations

from itertools import groupby
from typing import Any

import numpy as np

from stewart_pin.mechanics.constraint_matrix.system import ConstraintMatrixSystem
from stewart_pin.viz.figures import new_figure


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
