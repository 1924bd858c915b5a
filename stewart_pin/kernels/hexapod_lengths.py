"""Leg lengths of a six-legged platform that does not turn, as a kernel: for grids of many millions of points."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stewart_pin.errors import MissingExtraError
from stewart_pin.geometry.hexapod import Hexapod, leg_lengths
from stewart_pin.kernels.choosing import require_choice
from stewart_pin.typing import FloatArray

_WORTH = 2_000_000
"""Points below which compiling takes longer than it saves, a tenth of a microsecond a point."""


def lengths_at(
    hexapod: Hexapod, rotation: FloatArray, points: int, wanted: bool | None = None
) -> Callable[[FloatArray], FloatArray]:
    """Choose how to compute leg lengths at one orientation.

    Parameters
    ----------
    hexapod
        Geometry.
    rotation
        (3, 3) platform axes in the base frame.
    points
        Number of points to come.
    wanted
        False: NumPy; True: a kernel, or the error that says why not; None: a kernel for many points, where CasADi is
        installed.

    Returns
    -------
    callable
        Positions (n, 3) to leg lengths (n, 6) [m].

    Raises
    ------
    MissingExtraError
        If a kernel is wanted and CasADi is not installed.
    InputError
        If `wanted` is neither True, False nor None.
    """
    require_choice(wanted)
    if wanted or (wanted is None and points >= _WORTH):
        try:
            return _compiled(hexapod, rotation)
        except MissingExtraError:
            if wanted:
                raise
    return lambda position: leg_lengths(hexapod, position, rotation)


def _compiled(hexapod: Hexapod, rotation: FloatArray) -> Callable[[FloatArray], FloatArray]:
    try:
        import casadi as ca  # noqa: PLC0415 - optional
    except ImportError:
        raise MissingExtraError("casadi", "kernels") from None
    from stewart_pin.programs.compile_function import compile_function  # noqa: PLC0415 - optional

    # At one orientation leg i is as long as the platform origin is away from B_i - R P_i.
    centres = hexapod.base_points - hexapod.platform_points @ np.asarray(rotation).T
    position = ca.SX.sym("position", 3)
    lengths = [ca.norm_2(position - ca.DM(centre)) for centre in centres]
    kernel = compile_function(ca.Function("lengths", [position], [ca.vertcat(*lengths)]))
    return lambda points: np.asarray(kernel(points))
