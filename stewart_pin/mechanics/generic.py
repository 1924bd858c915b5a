"""What is usual for a mechanism: its freedoms at configurations near home that are nothing special."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from stewart_pin.closure.newton import close_loops
from stewart_pin.mechanics.freedom import TWIST_AXES, Freedom, FreedomCount, analyse_freedom
from stewart_pin.model.chain import ClosedChain
from stewart_pin.typing import Configuration

SAMPLES = 4
"""Random configurations that are tried."""
_SPREAD = 0.1
"""How far from home the samples are drawn, in robot sizes and radians."""


def nearby_freedoms(
    chain: ClosedChain, axes: Sequence[str] = TWIST_AXES
) -> list[tuple[Configuration, Freedom]]:
    """Analyse home and seeded random configurations near it.

    Parameters
    ----------
    chain
        Closed chain.
    axes
        Components of the twist that count as motion of the platform.

    Returns
    -------
    list of tuple
        Configurations (nq,) and their freedoms, home first [m, rad, unit quaternions].
    """
    found = [(chain.q_home, analyse_freedom(chain, chain.q_home, axes=axes))]
    rng = np.random.default_rng(0)
    for _ in range(SAMPLES):
        nearby = pin.integrate(
            chain.model, chain.q_home, rng.uniform(-_SPREAD, _SPREAD, chain.nv) * chain.tangent_scale
        )
        closure = close_loops(chain, nearby, throw=False)
        if closure.success:
            found.append((closure.q, analyse_freedom(chain, closure.q, axes=axes)))
    return found


def generic_freedom(chain: ClosedChain, axes: Sequence[str] = TWIST_AXES) -> FreedomCount:
    """Count the motions that a mechanism has at configurations that are nothing special.

    Parameters
    ----------
    chain
        Closed chain.
    axes
        Components of the twist that count as motion of the platform.

    Returns
    -------
    FreedomCount
        Fewest motions, and of these the most that motors and platform take part in, at home and near it.
    """
    counts = [freedom.count for _, freedom in nearby_freedoms(chain, axes)]
    dof = min(count.dof for count in counts)
    usual = [count for count in counts if count.dof == dof]
    return FreedomCount(
        dof=dof,
        motor=max(count.motor for count in usual),
        platform=max(count.platform for count in usual),
        either=max(count.either for count in usual),
        axes=tuple(axes),
    )
