"""Inertias of real bodies whose last printed digit makes them odd.

A flat plate, a thin rod and a point on a rod have one principal moment that is the sum of the others. Rounded to the
digits of a file it is a little more.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from stewart_pin.model.formats.precision import half_unit
from stewart_pin.typing import FloatArray

_ROUNDS = 40
"""Steps, each of which leaves a third of what is odd."""
_REACH = 3.0
"""Change of a moment per change of an entry: the spectral norm of a matrix (3, 3) whose entries are one at most."""


def within_digits(matrix: FloatArray, texts: Iterable[str]) -> tuple[FloatArray, float]:
    """Bring principal moments back to those of a body, where the rounding of their entries has led them off.

    Parameters
    ----------
    matrix
        (3, 3) rotational inertia as it was read, symmetric [kg m²].
    texts
        Its entries as they are printed.

    Returns
    -------
    tuple
        (3, 3) the nearest inertia that a body has, or the one given where digits do not explain what is odd, or nothing
        is; and by how much its moments were moved [kg m²].
    """
    rounding = max((half_unit(text) for text in texts), default=0.0)
    if not (rounding > 0 and np.isfinite(matrix).all()):
        return matrix, 0.0
    moments, axes = np.linalg.eigh(matrix)
    real = moments.copy()
    for _ in range(_ROUNDS):
        largest = int(np.argmax(real))
        odd = float(2 * real[largest] - real.sum())
        if odd <= 0:
            break
        # All three give way alike, the least change; the second largest may be the largest then.
        real += odd / 3
        real[largest] -= 2 * odd / 3
    moved = float(np.abs(real - moments).max())
    if not 0 < moved <= _REACH * rounding:
        return matrix, 0.0
    return (axes * real) @ axes.T, moved


def moved_by_digits(move: float) -> str:
    """Tell it for the report.

    Parameters
    ----------
    move
        By how much moments were moved [kg m²].

    Returns
    -------
    str
        What was made of the inertia.
    """
    return f"its principal moments were moved by {move:.2g} kg m², as its digits leave open, to be those of a body"
