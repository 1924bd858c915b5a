"""Inverse and forward dynamics of any chain from the whole state (q, v, a) of its spanning tree.

The laws are those of `stewart_pin.mechanics`, written out: N spans the motions that keep the loops
closed, the motor efforts follow from Nᵀ Sᵀ tau_motor = Nᵀ (M a + nle), the reactions from the rest. Redundant motors
share by least norm; idle freedoms obey their own inertia, whatever the demand asks of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from stewart_pin.errors import SingularityError
from stewart_pin.kernels.graph.bodies import (
    Placements,
    RootMotion,
    at_rest,
    joint_placement,
    motions,
    outside_input,
    outside_wrenches,
    placements,
    tree_efforts,
)
from stewart_pin.kernels.graph.joint_effects import joint_efforts
from stewart_pin.kernels.graph.loop_rows import LoopColumns, loop_bias, loop_columns
from stewart_pin.kernels.planning.elimination import (
    REGULAR,
    Elimination,
    Pivots,
    plan_pivots,
    solve_square,
    solve_symmetric,
)
from stewart_pin.kernels.planning.samples import at_samples, pivot_samples
from stewart_pin.kernels.planning.spatial import constant
from stewart_pin.kernels.planning.tree import Tree, tree_of
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.freedom import require_sufficient_motors
from stewart_pin.typing import Configuration, FloatArray


@dataclass(frozen=True, eq=False)
class ClosedTree:
    """A chain at a symbolic configuration, its loop rows eliminated.

    Attributes
    ----------
    chain
        The chain.
    tree
        Its constants.
    q
        (nq, 1) symbols.
    at
        Placements of the bodies.
    columns
        Loop rows.
    reduced
        Loop rows, eliminated.
    motions
        (nv, dof) N, motions that keep the loops closed.
    samples
        (samples, nq) configurations that the pivots were chosen on [m, rad, unit quaternions].
    around_home
        (samples, nq) configurations around home, by which it is judged what is usual [m, rad, unit quaternions].
    wrenches
        (n, 1) symbols of what acts from outside, in world axes.
    ground
        (9, 1) symbols of how the ground moves, in its own axes: the acceleration of its origin less that of free fall,
        its angular velocity and its angular acceleration; (0, 1) where it rests.
    """

    chain: ClosedChain
    tree: Tree
    q: ca.SX
    at: Placements
    columns: LoopColumns
    reduced: Elimination
    motions: ca.SX
    samples: FloatArray
    around_home: FloatArray
    wrenches: ca.SX
    ground: ca.SX

    @property
    def outside(self) -> dict[str, ca.SX]:
        """Inputs of functions on which something acts from outside, or whose ground moves; nothing for the others."""
        return {**outside_input(self.wrenches), **self.moving_ground}

    @property
    def moving_ground(self) -> dict[str, ca.SX]:
        """Input of functions whose ground moves, by its name; nothing for the others."""
        return {"ground": self.ground} if self.ground.shape[0] else {}

    @property
    def root(self) -> RootMotion:
        """How the ground moves, free fall among its acceleration."""
        if not self.ground.shape[0]:
            return at_rest(constant(self.tree.gravity))
        felt, omega, omega_rate = ca.vertsplit(self.ground, 3)
        return RootMotion(omega, omega_rate, ca.SX.zeros(3), felt)  # no velocity of an origin enters

    def usual(self, pivots: ca.SX) -> FloatArray:
        """Tell how large pivots usually are: where they were chosen, or around home if they are larger there.

        Parameters
        ----------
        pivots
            (n, 1) expressions of the configuration.

        Returns
        -------
        numpy.ndarray
            (n,) medians, in the same units.
        """
        here, home = (
            np.median(np.abs(at_samples([self.q], [samples], pivots)), axis=0).ravel()
            for samples in (self.samples, self.around_home)
        )
        # By these pivots home may be singular, and what is divided by others has no size there.
        return np.where(home <= here / REGULAR, np.maximum(here, home), here)

    def values(self, matrix: ca.SX) -> FloatArray:
        """Evaluate a matrix of the configuration at the samples.

        Parameters
        ----------
        matrix
            (m, n) expressions.

        Returns
        -------
        numpy.ndarray
            (samples, m, n), in the same unit as the matrix.
        """
        return at_samples([self.q], [self.samples], matrix)

    @property
    def motion_scale(self) -> FloatArray:
        """(dof,) natural sizes of the independent coordinates [m or rad]."""
        return self.chain.tangent_scale[list(self.reduced.pivots.rows)]


def close_tree(
    chain: ClosedChain,
    around: Configuration | None = None,
    *,
    closed: bool = False,
    wrenches: Sequence[str] = (),
    ground_moves: bool = False,
) -> ClosedTree:
    """Eliminate the loop rows of a chain.

    Parameters
    ----------
    chain
        Closed chain.
    around
        (nq,) regular configuration around which the pivots serve; None is home [m, rad, unit quaternions].
    closed
        Whether the loops will be closed to round-off, as where the configuration is solved for: it takes fewer
        operations.
    wrenches
        Links on which wrenches act from outside.
    ground_moves
        Whether the ground moves.

    Returns
    -------
    ClosedTree
        The chain at a symbolic configuration.

    Raises
    ------
    UnsupportedError
        If a joint or a closure has no graph, or no closed states are found to choose pivots on.
    """
    tree = tree_of(chain, wrenches)
    q = ca.SX.sym("q", tree.nq)
    at = placements(tree.joints, [joint_placement(joint, q[joint.q]) for joint in tree.joints], closed=closed)
    columns = loop_columns(tree, at, q)
    around_home = pivot_samples(chain)
    samples = around_home if around is None else pivot_samples(chain, around)
    values = at_samples([q], [samples], columns.transpose)
    scale = chain.tangent_scale[:, None] / chain.row_sizes
    values = values * scale
    pivots: Pivots = plan_pivots(values, list(range(tree.nc)), rank=chain.generic.rank)
    reduced = Elimination(columns.transpose, pivots, scale)
    free = reduced.forward(ca.SX.eye(tree.nv))[list(pivots.rows), :].T
    acting = ca.SX.sym("wrenches", 6 * len(tree.outside))
    ground = ca.SX.sym("ground", 9 * ground_moves)
    return ClosedTree(chain, tree, q, at, columns, reduced, free, samples, around_home, acting, ground)


def tree_inverse_dynamics(closed: ClosedTree, v: ca.SX, a: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Express motor efforts and loop reactions by a motion.

    Parameters
    ----------
    closed
        Chain with its loop rows eliminated.
    v, a
        (nv, 1) tangent velocity and acceleration that keep the loops closed.

    Returns
    -------
    tau_motor, lambda_c : casadi.SX
        (nu, 1) and (nc, 1).

    Raises
    ------
    ActuationError
        If the motors cannot hold the robot at home.
    """
    tree, chain = closed.tree, closed.chain
    require_sufficient_motors(chain)
    demanded = demanded_efforts(closed, v, a)
    tau_motor, needed = motor_efforts(
        closed, demanded, lambda idle, scale: let_idle_go(closed, demanded, idle, scale)
    )
    return tau_motor, _reactions(closed, needed - motor_columns(tree) @ tau_motor)


def demanded_efforts(closed: ClosedTree, v: ca.SX, a: ca.SX, *, starts: bool = True) -> ca.SX:
    """Express the joint efforts that a motion needs beside what acts from outside and what joints do by themselves.

    They are M a + nle - Σ J_fᵀ w_f - efforts of joints.

    Parameters
    ----------
    closed
        Chain at its configuration.
    v, a
        (nv, 1) tangent velocity and acceleration.
    starts
        Whether the acceleration tells where joints at rest are about to move; else their dry friction is left out.

    Returns
    -------
    casadi.SX
        (nv, 1).
    """
    joints, at = closed.tree.joints, closed.at
    moving = motions(joints, at, v, a, closed.root)
    acting = outside_wrenches(joints, at, closed.tree.outside, closed.wrenches)
    efforts = tree_efforts(joints, at, moving, a, acting)
    own = joint_efforts(closed, v, a if starts else None)
    return efforts if own is None else efforts - own


def motor_efforts(
    closed: ClosedTree, needed: ca.SX, let_go: Callable[[ca.SX, FloatArray], ca.SX]
) -> tuple[ca.SX, ca.SX]:
    """Find the motor efforts that joint efforts of the whole tree ask for.

    Parameters
    ----------
    closed
        Chain with its loop rows eliminated.
    needed
        (nv, 1) joint efforts.
    let_go
        Changes the joint efforts where there are idle motions, given as (nv, n) with their natural sizes.

    Returns
    -------
    tau_motor, needed : casadi.SX
        (nu, 1) of least norm in natural units where motors are redundant, and (nv, 1) joint efforts as changed.
    """
    tree, chain = closed.tree, closed.chain
    share = closed.motions.T @ motor_columns(tree)
    scale = closed.motion_scale
    values = closed.values(share) * scale[:, None] / chain.tangent_scale[list(tree.motors)]
    pivots = plan_pivots(values, list(range(len(tree.motors))))
    reduced = Elimination(share, pivots)
    if pivots.rows:
        idle = closed.motions @ reduced.forward(ca.SX.eye(share.shape[0]))[list(pivots.rows), :].T
        needed = let_go(idle, scale[list(pivots.rows)])
    load = closed.motions.T @ needed
    if pivots.columns:
        return _least_norm(closed, share, load, [i for i, _ in pivots.places]), needed
    found = reduced.back(reduced.forward(load), {})
    return ca.vertcat(*(found[k] for k in range(len(tree.motors)))), needed


def tree_forward_dynamics(closed: ClosedTree, v: ca.SX, tau_motor: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Express acceleration and loop reactions by a velocity and motor efforts.

    Parameters
    ----------
    closed
        Chain with its loop rows eliminated.
    v
        (nv, 1) tangent velocity that keeps the loops closed.
    tau_motor
        (nu, 1) motor efforts.

    Returns
    -------
    a, lambda_c : casadi.SX
        (nv, 1) and (nc, 1).

    Raises
    ------
    SingularityError
        If a motion that motors or platform take part in has no inertia.
    """
    tree, chain = closed.tree, closed.chain
    a = closed.reduced.transposed(-tree_bias(closed, v))
    needed = demanded_efforts(closed, v, a, starts=False)
    left = needed - motor_columns(tree) @ tau_motor
    moved = inertia_times(closed, closed.motions)
    inertia = closed.motions.T @ moved
    scale = closed.motion_scale
    values = closed.values(inertia) * scale[:, None] * scale
    steps, weightless, _ = solve_symmetric(inertia, -(closed.motions.T @ left), values)
    _require_idle(chain, closed, weightless)
    step = ca.vertcat(*steps) if steps else ca.SX(0, 1)
    a = a + closed.motions @ step
    return a, _reactions(closed, left + moved @ step)


def tree_bias(closed: ClosedTree, v: ca.SX) -> ca.SX:
    """Express the bias of the loop rows by a velocity.

    Parameters
    ----------
    closed
        Chain with its loop rows eliminated.
    v
        (nv, 1) tangent velocity.

    Returns
    -------
    casadi.SX
        (nc, 1) of the rows as they are turned.
    """
    joints, still = closed.tree.joints, ca.SX.zeros(closed.tree.nv)
    drifting = motions(joints, closed.at, v, still, at_rest(ca.SX.zeros(3)))
    return loop_bias(closed.tree, closed.at, drifting, closed.q, v)


def inertia_times(closed: ClosedTree, directions: ca.SX) -> ca.SX:
    """Multiply by the joint-space inertia.

    Parameters
    ----------
    closed
        Chain at its configuration.
    directions
        (nv, k) tangent vectors.

    Returns
    -------
    casadi.SX
        (nv, k) M times them.
    """
    joints, still, floating = closed.tree.joints, ca.SX.zeros(closed.tree.nv), at_rest(ca.SX.zeros(3))
    columns = [
        tree_efforts(joints, closed.at, motions(joints, closed.at, still, one, floating), one)
        for one in ca.horzsplit(directions)
    ]
    return ca.horzcat(*columns) if columns else ca.SX(closed.tree.nv, 0)


def motor_columns(tree: Tree) -> ca.SX:
    """Build the columns with which motor efforts enter the joint efforts.

    Parameters
    ----------
    tree
        Constants.

    Returns
    -------
    casadi.SX
        (nv, nu) Sᵀ.
    """
    columns = ca.SX(tree.nv, len(tree.motors))
    for k, index in enumerate(tree.motors):
        columns[index, k] = 1
    return columns


def natural_share(closed: ClosedTree) -> ca.SX:
    """Express what efforts of motors in natural units contribute to the motions of a chain.

    Parameters
    ----------
    closed
        Chain with its loop rows eliminated.

    Returns
    -------
    casadi.SX
        (dof, nu), rows in natural units as well.
    """
    sizes = closed.chain.tangent_scale[list(closed.tree.motors)]
    share = closed.motions.T @ motor_columns(closed.tree)
    return constant(np.diag(closed.motion_scale)) @ share @ ca.diag(constant(1 / sizes))


def idle_accelerations(closed: ClosedTree, needed: ca.SX, idle: ca.SX, scale: FloatArray) -> ca.SX:
    """Find the accelerations with which idle freedoms obey their own inertia.

    Parameters
    ----------
    closed
        Chain at its configuration.
    needed
        (nv, k) joint efforts that the demanded motion needs.
    idle
        (nv, n) idle motions.
    scale
        (n,) their natural sizes [m or rad].

    Returns
    -------
    casadi.SX
        (n, k) what is to be added to the demand along the idle motions; at rest where these have no inertia.
    """
    return _own_steps(closed, idle, inertia_times(closed, idle), -(idle.T @ needed), scale)


def without_momentum(closed: ClosedTree, v: ca.SX, idle: ca.SX, scale: FloatArray) -> ca.SX:
    """Let idle freedoms carry no momentum, Iᵀ M v = 0.

    Parameters
    ----------
    closed
        Chain at its configuration.
    v
        (nv, 1) tangent velocity.
    idle
        (nv, n) idle motions, I.
    scale
        (n,) their natural sizes [m or rad].

    Returns
    -------
    casadi.SX
        (nv, 1) changed along the idle motions; not along those without inertia, on which no effort depends.
    """
    momenta = inertia_times(closed, idle)
    return v + idle @ _own_steps(closed, idle, momenta, -(momenta.T @ v), scale)


def _own_steps(closed: ClosedTree, idle: ca.SX, momenta: ca.SX, right: ca.SX, scale: FloatArray) -> ca.SX:
    """Amounts of idle motions that bring their momentum, or its rate, to the right-hand side."""
    inertia = idle.T @ momenta
    values = closed.values(inertia) * scale[:, None] * scale
    steps, _, _ = solve_symmetric(inertia, right, values)
    return ca.vertcat(*steps)


def let_idle_go(closed: ClosedTree, needed: ca.SX, idle: ca.SX, scale: FloatArray) -> ca.SX:
    """Replace the idle freedoms' accelerations by what their own inertia makes them do.

    Parameters
    ----------
    closed
        Chain at its configuration.
    needed
        (nv, k) joint efforts that the demanded motion needs.
    idle
        (nv, n) idle motions.
    scale
        (n,) their natural sizes [m or rad].

    Returns
    -------
    casadi.SX
        (nv, k) joint efforts of the motion as it is then.
    """
    return needed + inertia_times(closed, idle) @ idle_accelerations(closed, needed, idle, scale)


def _least_norm(closed: ClosedTree, share: ca.SX, load: ca.SX, rows: list[int]) -> ca.SX:
    """Solve share tau = load for the smallest tau in natural units, as the one-state verb does."""
    sizes = constant(closed.chain.tangent_scale[list(closed.tree.motors)])
    share, load = share[rows, :] @ ca.diag(1 / sizes), load[rows, :]
    square = share @ share.T
    scale = closed.motion_scale[rows]
    multipliers, _ = solve_square(
        square, load, closed.values(square) * scale[:, None] * scale, "the motors' share"
    )
    return (share.T @ multipliers) / sizes


def _reactions(closed: ClosedTree, left: ca.SX) -> ca.SX:
    """Loop reactions of least norm in natural units, in the chain's own rows."""
    reduced, tree = closed.reduced, closed.tree
    found = reduced.back(reduced.forward(left), {})
    lambda_c = ca.vertcat(*(found.get(k, ca.SX(0)) for k in range(tree.nc)))
    if reduced.pivots.columns:
        own = [_unit_response(closed, column) for column in reduced.pivots.columns]
        basis = ca.horzcat(*own)
        natural = ca.diag(constant(closed.chain.row_sizes)) @ basis
        square = natural.T @ natural
        across = natural.T @ (constant(closed.chain.row_sizes) * lambda_c)
        parts, _ = solve_square(square, across, closed.values(square), "the redundant reactions")
        lambda_c = lambda_c - basis @ parts
    return closed.columns.turn @ lambda_c


def _unit_response(closed: ClosedTree, column: int) -> ca.SX:
    """Reactions in balance, with one at the row of a dependent column."""
    known = {k: ca.SX(float(k == column)) for k in closed.reduced.pivots.columns}
    found = closed.reduced.back(ca.SX.zeros(closed.tree.nv), known)
    return ca.vertcat(*(found.get(k, ca.SX(0)) for k in range(closed.tree.nc)))


def _require_idle(chain: ClosedChain, closed: ClosedTree, weightless: tuple[int, ...]) -> None:
    """Motions without inertia may be left at rest only if they are idle."""
    if not weightless:
        return
    idle = chain.generic.count.idle
    if len(weightless) > idle:
        raise SingularityError(
            f"{len(weightless)} motions of {chain.name} have no inertia and {idle} are idle, so accelerations are "
            "undetermined; give the bodies mass",
            smallest_singular_value=0.0,
            names=tuple(np.array(chain.tangent_names)[list(closed.reduced.pivots.rows)][list(weightless)]),
        )
