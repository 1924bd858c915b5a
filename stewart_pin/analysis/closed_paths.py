"""Paths between configurations on which the loops stay closed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from stewart_pin.checks import as_array
from stewart_pin.errors import InputError
from stewart_pin.state.chain import ClosedChain, as_configuration
from stewart_pin.state.newton import close_loops
from stewart_pin.state.state import as_chain
from stewart_pin.typing import ArrayLike, Configuration

Path = Callable[[float], Configuration]
"""Configuration (nq,) as a function of one parameter."""


def closed_path(chain: ClosedChain, configurations: ArrayLike) -> Path:
    """Join closed configurations by a path whose every point has closed loops.

    Parameters
    ----------
    chain
        Closed chain.
    configurations
        (n, nq) two or more configurations, the loops nearly closed [m, rad, unit quaternions].

    Returns
    -------
    callable
        Configuration (nq,) of a parameter from 0 to n - 1: the tangent's straight line between neighbours, moved to
        the nearest configuration with closed loops.

    Raises
    ------
    InputError
        If there are fewer than two.
    ClosureError
        When called: if the loops do not close in between; give more configurations.
    """
    as_chain(chain)
    stops = as_array("configurations", configurations, (None, chain.nq))
    if len(stops) < 2:
        raise InputError(f"configurations must be two or more, got {len(stops)}")
    stops = [close_loops(chain, as_configuration(chain, "configurations", q)).q for q in stops]

    def path(s: float) -> Configuration:
        k = min(max(int(np.floor(s)), 0), len(stops) - 2)
        if s == k or s == k + 1:
            return stops[k + int(s != k)]
        return close_loops(chain, pin.interpolate(chain.model, stops[k], stops[k + 1], s - k)).q

    return path
