"""Projection of a state onto closed loops: the shortest displacement, and a velocity that keeps them closed."""

from __future__ import annotations

import casadi as ca
import numpy as np

from stewart_pin.kernels.graph.driven_tree import integrated
from stewart_pin.kernels.graph.functions import shared
from stewart_pin.kernels.graph.loop_gaps import loop_gaps
from stewart_pin.kernels.graph.whole_tree import ClosedTree
from stewart_pin.kernels.planning.elimination import eliminate_square
from stewart_pin.kernels.planning.spatial import constant


def projection_function(closed: ClosedTree) -> ca.Function:
    """Write the projection.

    With J the loop rows that imply the others and W the natural sizes of the tangent, ``dq = -W² Jᵀ (J W² Jᵀ)⁻¹ gap``,
    once from the state and once more, with the same matrix, from where that leads; the velocity likewise, with J v for
    the gap. From a gap g the first move leaves c g², the second c² g³.

    Parameters
    ----------
    closed
        Chain with its loop rows eliminated.

    Returns
    -------
    casadi.Function
        ``(q, v) -> (q_next, v_next, gap, before, left)``: the largest entry of the gap after [m], and the largest
        before and after in robot sizes and radians.
    """
    tree, chain = closed.tree, closed.chain
    rows = sorted(column for _, column in closed.reduced.pivots.places)
    sizes = chain.row_sizes
    v = ca.SX.sym("v", tree.nv)
    # Rows of equal size, so that pivots can be compared.
    jacobian = constant(np.diag(sizes[rows] ** -1.0)) @ closed.columns.transpose[:, rows].T
    weighted = constant(np.diag(chain.tangent_scale**2.0)) @ jacobian.T
    square = jacobian @ weighted
    reduced = eliminate_square(square, closed.values(square), "the projection")

    def spread(residual: ca.SX) -> ca.SX:
        return weighted @ reduced.solve(residual)

    def close(gap: ca.SX) -> ca.SX:
        return -spread((closed.columns.turn.T @ gap)[rows] / constant(sizes[rows]))

    gap_at = ca.Function("gap", [closed.q], [loop_gaps(tree, closed.at, closed.q)])
    first = gap_at(closed.q)
    between = integrated(tree, closed.q, close(first))
    q_next = integrated(tree, between, close(gap_at(between)))
    last = gap_at(q_next)
    return shared(
        "projection",
        {"q": closed.q, "v": v},
        {
            "q_next": q_next,
            "v_next": v - spread(jacobian @ v),
            "gap": ca.norm_inf(last),
            "before": ca.norm_inf(first / constant(sizes)),
            "left": ca.norm_inf(last / constant(sizes)),
        },
    )
