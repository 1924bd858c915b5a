"""Tell an isolated singular solution from a point of a curve of solutions."""

from __future__ import annotations

import numpy as np

from stewart_pin.analysis.assembly_modes.study import ComplexArray, StudyPlatform, half_gradient, operators

_STEP = 1e-2
"""Distance at which a neighbour is sought; near an isolated point the residual is its square at least."""
_SOLVED = 1e-11
"""Residual of a neighbour that solves the equations, relative to the gradients, dimensionless."""


def lies_on_curve(platform: StudyPlatform, point: ComplexArray) -> bool:
    """Find out whether the equations hold along a curve through a singular solution.

    Parameters
    ----------
    platform
        Parameters.
    point
        (8,) singular solution, Study coordinates of norm one.

    Returns
    -------
    bool
        True when neighbours on either side at a finite distance solve the equations as well.
    """
    matrices = operators(platform.difference, platform.total)
    gradient = half_gradient(matrices, platform.squares, point[None])[0]
    border = np.vstack([gradient, point.conj()])
    # Rows of Vᴴ: the last is the direction in which the equations do not change to first order.
    direction = np.linalg.svd(border)[2][-1].conj()
    return all(_has_neighbour(platform, point, direction, sign * _STEP) for sign in (1.0, -1.0))


def _has_neighbour(
    platform: StudyPlatform, point: ComplexArray, direction: ComplexArray, step: float
) -> bool:
    matrices = operators(platform.difference, platform.total)
    here, scale = point + step * direction, 1.0
    for _ in range(12):
        gradient = half_gradient(matrices, platform.squares, here[None])[0]
        rows = np.vstack([2.0 * gradient, point.conj(), direction.conj()])
        offset = here - point
        values = np.concatenate([gradient @ here, [point.conj() @ offset, direction.conj() @ offset - step]])
        here = here - np.linalg.lstsq(rows, values, rcond=1e-9)[0]
        scale = float(np.abs(gradient).max())
    gradient = half_gradient(matrices, platform.squares, here[None])[0]
    away = abs(direction.conj() @ (here - point)) > 0.5 * abs(step)
    return bool(away and np.abs(gradient @ here).max() < _SOLVED * scale)
