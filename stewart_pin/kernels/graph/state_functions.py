"""Functions of a whole state (q, v, a) of any chain, how far it is from closed loops, and its projection onto them."""

from __future__ import annotations

import casadi as ca
import numpy as np

from stewart_pin.kernels.graph.driven_tree import integrated
from stewart_pin.kernels.graph.joint_effects import resting
from stewart_pin.kernels.graph.loop_rows import loop_gaps, opposed_axes
from stewart_pin.kernels.graph.whole_tree import (
    ClosedTree,
    natural_share,
    tree_bias,
    tree_forward_dynamics,
    tree_inverse_dynamics,
)
from stewart_pin.kernels.planning.elimination import eliminate_square
from stewart_pin.kernels.planning.spatial import constant, shared
from stewart_pin.model.description import JointKind


def inverse_dynamics_function(closed: ClosedTree) -> ca.Function:
    """Write inverse dynamics.

    Parameters
    ----------
    closed
        Chain with its loop rows eliminated.

    Returns
    -------
    casadi.Function
        ``(q, v, a) -> (tau_motor, lambda_c)``, (nq, 1), (nv, 1), (nv, 1) to (nu, 1), (nc, 1).

    Raises
    ------
    ActuationError
        If the motors cannot hold the robot at home.
    """
    v, a = ca.SX.sym("v", closed.tree.nv), ca.SX.sym("a", closed.tree.nv)
    tau_motor, lambda_c = tree_inverse_dynamics(closed, v, a)
    return shared(
        "inverse_dynamics",
        {"q": closed.q, "v": v, "a": a, **closed.outside},
        {"tau_motor": tau_motor, "lambda_c": lambda_c},
    )


def forward_dynamics_function(closed: ClosedTree) -> ca.Function:
    """Write forward dynamics.

    Parameters
    ----------
    closed
        Chain with its loop rows eliminated.

    Returns
    -------
    casadi.Function
        ``(q, v, tau_motor) -> (a, lambda_c)``, (nq, 1), (nv, 1), (nu, 1) to (nv, 1), (nc, 1); with dry friction a third
        output ``resting``, 1 where a joint that has it is at rest: results are then those without its friction.

    Raises
    ------
    SingularityError
        If a motion that motors or platform take part in has no inertia.
    """
    v, tau_motor = ca.SX.sym("v", closed.tree.nv), ca.SX.sym("tau_motor", len(closed.tree.motors))
    a, lambda_c = tree_forward_dynamics(closed, v, tau_motor)
    return shared(
        "forward_dynamics",
        {"q": closed.q, "v": v, "tau_motor": tau_motor, **closed.outside},
        {"a": a, "lambda_c": lambda_c, **resting(closed, v)},
    )


def judged_inverse_dynamics(closed: ClosedTree) -> ca.Function:
    """Write inverse dynamics, with a measure of how far the state is from closed loops.

    Parameters
    ----------
    closed
        Chain with its loop rows eliminated.

    Returns
    -------
    casadi.Function
        ``(q, v, a) -> (tau_motor, open)``.
    """
    motion, (tau_motor, _) = _of_state(closed)
    outputs = {"tau_motor": tau_motor, "open": openness(closed, **motion)}
    return shared("inverse_dynamics", {**motion, **closed.outside}, outputs)


def judged_motor_share(closed: ClosedTree) -> ca.Function:
    """Write inverse dynamics together with what each motor contributes, with the same measure.

    Parameters
    ----------
    closed
        Chain with its loop rows eliminated.

    Returns
    -------
    casadi.Function
        ``(q, v, a) -> (tau_motor, share, open)``, share (dof, nu) of efforts in natural units.
    """
    motion, (tau_motor, _) = _of_state(closed)
    outputs = {"tau_motor": tau_motor, "share": natural_share(closed), "open": openness(closed, **motion)}
    return shared("motor_share", {**motion, **closed.outside}, outputs)


def judged_forward_dynamics(closed: ClosedTree) -> ca.Function:
    """Write forward dynamics, with the same measure.

    Parameters
    ----------
    closed
        Chain with its loop rows eliminated.

    Returns
    -------
    casadi.Function
        ``(q, v, tau_motor) -> (a, open)``.
    """
    v, tau_motor = ca.SX.sym("v", closed.tree.nv), ca.SX.sym("tau_motor", len(closed.tree.motors))
    a, _ = tree_forward_dynamics(closed, v, tau_motor)
    return shared(
        "forward_dynamics",
        {"q": closed.q, "v": v, "tau_motor": tau_motor, **closed.outside},
        {"a": a, "open": openness(closed, closed.q, v), **resting(closed, v)},
    )


def judged_reactions(closed: ClosedTree) -> ca.Function:
    """Write the loop reactions of a motion, with the same measure.

    Parameters
    ----------
    closed
        Chain with its loop rows eliminated.

    Returns
    -------
    casadi.Function
        ``(q, v, a) -> (lambda_c, open)``.
    """
    motion, (_, lambda_c) = _of_state(closed)
    outputs = {"lambda_c": lambda_c, "open": openness(closed, **motion)}
    return shared("reactions", {**motion, **closed.outside}, outputs)


def _of_state(closed: ClosedTree) -> tuple[dict[str, ca.SX], tuple[ca.SX, ca.SX]]:
    v, a = ca.SX.sym("v", closed.tree.nv), ca.SX.sym("a", closed.tree.nv)
    return {"q": closed.q, "v": v, "a": a}, tree_inverse_dynamics(closed, v, a)


def openness(closed: ClosedTree, q: ca.SX, v: ca.SX, a: ca.SX | None = None) -> ca.SX:
    """Measure how far a state is from closed loops and unit quaternions.

    Parameters
    ----------
    closed
        The chain.
    q, v
        (nq, 1) configuration and (nv, 1) velocity.
    a
        (nv, 1) acceleration, if it is demanded.

    Returns
    -------
    casadi.SX
        (1, 1) in robot sizes and radians, relative to 1 and to the largest entry of v or a; as the one-state verbs do.
    """
    scale = constant(closed.chain.tangent_scale)
    sizes = constant(closed.chain.row_sizes)
    parts = [ca.norm_inf(loop_gaps(closed.tree, closed.at, q) / sizes)] if closed.tree.nc else []
    demands = [(v, ca.SX.zeros(closed.tree.nc))]
    if a is not None:
        demands.append((a, tree_bias(closed, v)))
    for value, bias in demands if closed.tree.nc else []:
        left = closed.columns.turn @ (closed.columns.transpose.T @ value + bias)
        parts.append(ca.norm_inf(left / sizes) / ca.fmax(1, ca.norm_inf(value / scale)))
    parts.append(opposed_axes(closed.tree, closed.at))
    for joint in closed.tree.joints:
        if joint.kind in (JointKind.SPHERICAL, JointKind.FLOATING):
            quaternion = q[joint.q][-4:]
            parts.append(ca.fabs(ca.dot(quaternion, quaternion) - 1) / 2)
    worst = ca.SX(0)
    for part in parts:
        worst = ca.fmax(worst, part)
    return worst


# ----------------------------------------------------------------------------------------------------
# Projection of a state onto closed loops: the shortest displacement, and a velocity that keeps them closed
# ----------------------------------------------------------------------------------------------------


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
