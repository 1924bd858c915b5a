"""Columns of couplings: a gear between two joints, which may hang on four bodies.

With q1 = p(q2), the gear gives joint 1 an effort η and joint 2 the effort -p' η, and demands a1 - p' a2 = p'' v2².
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from stewart_pin.mechanics.constraint_matrix.columns import Columns, Freedoms, effort_column
from stewart_pin.mechanics.constraint_matrix.topology import Topology
from stewart_pin.model.description import Coupling
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import Configuration, Tangent


def coupling_parts(
    chain: ClosedChain,
    coupling: Coupling,
    layout: Topology,
    freedoms: Sequence[Freedoms],
    number: Mapping[str, int],
    q: Configuration,
    v: Tangent,
) -> list[tuple[int | None, int, Columns]]:
    """Build what a coupling does at each of its joints.

    Parameters
    ----------
    chain
        Closed chain.
    coupling
        The gear.
    layout
        Bodies and compound joints.
    freedoms
        Freedoms of each compound joint.
    number
        Index of each body.
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].

    Returns
    -------
    list
        Predecessor, successor and column of either joint.
    """
    power = np.polynomial.Polynomial(coupling.polynomial)
    parts = [(coupling.joint1, 1.0, 0.0)]
    if coupling.joint2 is not None:
        q2, v2 = _coordinate(chain, coupling.joint2, q, v)
        parts.append((coupling.joint2, -float(power.deriv()(q2)), float(power.deriv(2)(q2)) * v2**2))
    built = []
    for name, ratio, demand in parts:
        at = layout.compound(name)
        compound = layout.tree[at]
        entry = chain.model.joints[chain.model.getJointId(name)].idx_v
        column = effort_column(freedoms[at], entry, 0.0)
        scaled = Columns(ratio * column.wrenches, ratio * column.acceleration + demand)
        built.append((number[compound.predecessor], number[compound.successor], scaled))
    return built


def coupling_opening(
    chain: ClosedChain, coupling: Coupling, q: Configuration, v: Tangent, a: Tangent
) -> tuple[float, float, float]:
    """Measure how far a coupling is from being kept, by the joints' own coordinates.

    Parameters
    ----------
    chain
        Closed chain.
    coupling
        The gear.
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].
    a
        (nv,) tangent acceleration [m/s², rad/s²].

    Returns
    -------
    tuple of float
        Residual of position, velocity and acceleration [m or rad, per s, per s²].
    """
    power = np.polynomial.Polynomial(coupling.polynomial)
    q1, v1 = _coordinate(chain, coupling.joint1, q, v)
    a1 = _coordinate(chain, coupling.joint1, q, a)[1]
    if coupling.joint2 is None:
        return q1 - float(power(0.0)), v1, a1
    q2, v2 = _coordinate(chain, coupling.joint2, q, v)
    a2 = _coordinate(chain, coupling.joint2, q, a)[1]
    slope, curve = float(power.deriv()(q2)), float(power.deriv(2)(q2))
    return q1 - float(power(q2)), v1 - slope * v2, a1 - slope * a2 - curve * v2**2


def _coordinate(chain: ClosedChain, name: str, q: Configuration, v: Tangent) -> tuple[float, float]:
    joint = chain.model.joints[chain.model.getJointId(name)]
    return float(q[joint.idx_q]), float(v[joint.idx_v])
