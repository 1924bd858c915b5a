"""What the closures of a platform on legs do, row by row: the forces at the ends of its legs.

The joints of a leg and its motors determine these forces but for some: those that the leg carries without its joints
(across the plane of a planar leg), those of its ends against each other (two rods on a crank), and the moments of
hinges. Such ties hold the platform where it has no freedom. With x their sizes, A their wrenches on the platform and
b what is missing there, and R the reactions that come with them,

    least |reactions + R x|²  with  A x = b,

which leaves no choice where there are as many ties as equations.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.graph.leg_forces import LegForces, on_platform
from stewart_pin.kernels.graph.legs import PlacedLeg, PlatformMotion, platform_motion
from stewart_pin.kernels.graph.platform_dynamics import (
    PlacedPlatform,
    balance_legs,
    balancing_efforts,
    forces_of_legs,
)
from stewart_pin.kernels.planning.elimination import Elimination, plan_pivots, solve_square, solve_symmetric
from stewart_pin.kernels.planning.plan import LegEnd
from stewart_pin.kernels.planning.spatial import constant, rotation_constant, shared
from stewart_pin.model.loop_rows import AngleRow, orthonormal_triad
from stewart_pin.state.freedom import require_sufficient_motors
from stewart_pin.typing import FloatArray


@dataclass(frozen=True, eq=False)
class _Ties:
    """Forces and moments at the ends of legs that neither joints nor motors determine.

    `reactions` (m, n) are those that come with each, in the order of `_end_forces` over all legs; `wrenches` (6, n)
    what they do to the platform, in world axes; `counted` (rows, m) selects the reactions that have loop rows.
    """

    reactions: ca.SX
    wrenches: ca.SX
    counted: ca.SX


def reactions_function(placed: PlacedPlatform) -> ca.Function:
    """Write the loop reactions of a motion.

    Parameters
    ----------
    placed
        Platform and legs.

    Returns
    -------
    casadi.Function
        ``(pose, twist, acceleration) -> lambda_c``, (7, 1), (6, 1), (6, 1) to (nc, 1): what the closures do to link 2,
        row by row in loop frame 1, of least norm in natural units where rows are redundant; with `infeasible` as
        inverse dynamics.

    Raises
    ------
    ActuationError
        If the motors cannot hold the robot at home.
    UnsupportedError
        If forces within the mechanism are not determined by their norm.
    """
    plan = placed.plan
    require_sufficient_motors(plan.chain)
    twist, acceleration = ca.SX.sym("twist", 6), ca.SX.sym("acceleration", 6)
    moving = platform_motion(plan.tree, placed.pose, twist, acceleration)
    forces = forces_of_legs(placed, moving)
    wrench, columns = balance_legs(placed, moving, forces)
    tau_motor = balancing_efforts(placed, wrench, columns)
    parts = [_end_forces(leg, force, tau_motor) for leg, force in zip(placed.legs, forces, strict=True)]
    reactions = _tied(placed, _ties(placed, moving), ca.vertcat(*parts), wrench - columns @ tau_motor)
    lambda_c, start = ca.SX(plan.chain.nc, 1), 0
    for leg, part in zip(placed.legs, parts, strict=True):
        lambda_c += _rows(leg, moving, reactions[start : start + part.shape[0]], plan.chain.nc)
        start += part.shape[0]
    return shared(
        "reactions",
        {"pose": placed.pose, "twist": twist, "acceleration": acceleration, **placed.outside},
        {"lambda_c": lambda_c, **placed.infeasible(twist, acceleration)},
    )


def _end_forces(placed: PlacedLeg, force: LegForces, tau_motor: ca.SX) -> ca.SX:
    """Add up forces on a leg in axes of its last bodies, end by end, and two moments on body 2 of each hinge."""
    reactions = force.reactions
    for motor, column in force.reaction_columns.items():
        reactions = reactions + column * tau_motor[motor]
    return ca.vertcat(reactions, ca.SX(2 * len(_hinges(placed)), 1))


def _hinges(placed: PlacedLeg) -> list[tuple[LegEnd, FloatArray]]:
    """List hinges, with the world axes of their two moments, (3, 2): they turn in planes that are fixed."""
    return [
        (end, np.column_stack(orthonormal_triad(end.hinge)[1:]))
        for end in placed.leg.ends
        if end.hinge is not None
    ]


def _ties(placed: PlacedPlatform, moving: PlatformMotion) -> _Ties:
    reactions, wrenches, counted = [], [], []
    for leg in placed.legs:
        ends, hinges = leg.leg.ends, _hinges(leg)
        columns = [_unfelt(leg, column) for column in leg.reduced.pivots.columns]
        own = ca.horzcat(*columns) if columns else ca.SX(3 * len(ends), 0)
        reactions.append(ca.diagcat(own, ca.SX.eye(2 * len(hinges))))
        wrenches += [on_platform(leg, moving, {}, column) for column in columns]
        for end, axes in hinges:
            # Body 2 is the platform or the leg; a leg on the platform hands on what it gets, another one reverses it.
            sign = 1.0 if end.body_first != leg.leg.on_platform else -1.0
            wrenches += ca.horzsplit(constant(np.vstack([np.zeros((3, 2)), sign * axes])))
        counted += [bool(end.loop.index) for end in ends for _ in range(3)]
        counted += [bool(end.loop.index) for end, _ in hinges for _ in range(2)]
    return _Ties(
        ca.diagcat(*reactions),
        ca.horzcat(*wrenches) if wrenches else ca.SX(6, 0),
        ca.sparsify(constant(np.eye(len(counted))[counted])),
    )


def _unfelt(placed: PlacedLeg, column: int) -> ca.SX:
    """Find forces at the ends that no joint feels, with one at a dependent column of the Jacobian."""
    dependent = {k: ca.SX(float(k == column)) for k in placed.reduced.pivots.columns}
    found = placed.reduced.back(ca.SX(placed.leg.nv, 1), dependent)
    return ca.sparsify(ca.vertcat(*(found.get(k, ca.SX(0)) for k in range(3 * len(placed.leg.ends)))))


def _tied(placed: PlacedPlatform, ties: _Ties, reactions: ca.SX, missing: ca.SX) -> ca.SX:
    """Add the ties that balance the platform, and of all such the least."""
    if not ties.wrenches.shape[1]:
        return reactions
    rest, share, right, _ = _held_by(placed, ties, missing)
    if share.shape[0] == share.shape[1]:
        sizes = solve_square(share, right, placed.values(share), "what holds the platform")[0]
    else:
        counted = ca.diag(constant(_natural(placed))) @ ties.counted
        sizes = _least(placed, counted @ ties.reactions[:, rest], counted @ reactions, share, right)
    return reactions + ties.reactions[:, rest] @ sizes


def _natural(placed: PlacedPlatform) -> FloatArray:
    """By what the counted reactions are multiplied to be forces all, moments over the size of the robot."""
    length, sizes = placed.plan.chain.length_scale, []
    for leg in placed.legs:
        sizes += [1.0 for end in leg.leg.ends if end.loop.index for _ in range(3)]
        sizes += [1.0 / length for end, _ in _hinges(leg) if end.loop.index for _ in range(2)]
    return np.array(sizes)


def _held_by(
    placed: PlacedPlatform, ties: _Ties, missing: ca.SX
) -> tuple[list[int], ca.SX, ca.SX, Elimination]:
    """Say which ties have loop rows, ``share @ sizes = right`` for these, and what the others were divided by.

    What holds the platform without loop rows, the joint that leads to it, takes all it can.
    """
    norm = ca.sparsify(ties.counted @ ties.reactions)
    free = [k for k in range(norm.shape[1]) if not norm[:, k].nnz()]
    rest = [k for k in range(norm.shape[1]) if norm[:, k].nnz()]
    held = constant(placed.plan.held).T
    share, right = held @ ties.wrenches, held @ missing
    pivots = plan_pivots(placed.values(share[:, free]), list(range(len(free))))
    first = Elimination(share[:, free], pivots)
    left = first.forward(ca.horzcat(share[:, rest], right))[list(pivots.rows), :]
    return rest, left[:, : len(rest)], left[:, len(rest) :], first


def holding_share(placed: PlacedPlatform) -> tuple[ca.SX, Elimination]:
    """Tell how forces that the motors do not determine hold the platform; reactions are lost where they do not.

    Parameters
    ----------
    placed
        Platform and legs.

    Returns
    -------
    share : casadi.SX
        (m, n) what n of them give in the m directions in which they have to hold it; it must keep its rank.
    before : Elimination
        What has been divided by before.
    """
    still = ca.SX.zeros(6)
    ties = _ties(placed, platform_motion(placed.plan.tree, placed.pose, still, still))
    _, share, _, before = _held_by(placed, ties, ca.SX(6, 0))
    return share, before


def _least(placed: PlacedPlatform, norm: ca.SX, reactions: ca.SX, share: ca.SX, right: ca.SX) -> ca.SX:
    """Sizes with the least |reactions + norm sizes| among those with ``share @ sizes = right``."""
    square, count = norm.T @ norm, share.shape[0]
    both = ca.horzcat(share.T, norm.T @ reactions)
    found, undetermined, _ = solve_symmetric(square, both, placed.values(square))
    if undetermined:
        raise UnsupportedError(
            f"{len(undetermined)} force(s) within {placed.plan.chain.name} have no part in its loop rows"
        )
    solved = ca.vertcat(*found)
    spread, already = solved[:, :count], solved[:, count:]
    if not count:
        return -already
    metric = share @ spread
    multipliers, _ = solve_square(
        metric, right + share @ already, placed.values(metric), "what holds the platform"
    )
    return spread @ multipliers - already


def _rows(placed: PlacedLeg, moving: PlatformMotion, reactions: ca.SX, nc: int) -> ca.SX:
    """Rows of the closures of a leg, (nc, 1)."""
    leg, rows = placed.leg, ca.SX(nc, 1)
    moments = iter(ca.vertsplit(reactions[3 * len(leg.ends) :], 2))
    turning = {id(end): constant(axes) @ next(moments) for end, axes in _hinges(placed)}
    for k, end in enumerate(leg.ends):
        force = reactions[3 * k : 3 * k + 3]
        moment = _in_frame1(placed, moving, k, turning.get(id(end), ca.SX(3, 1)))
        if not end.loop.index:
            continue
        if end.body_first:
            force = -(rotation_constant(end.loop.rotation1).T @ force)
        else:
            world = placed.from_end(force, k)
            force = _in_frame1(placed, moving, k, moving.rotation @ world if leg.on_platform else world)
        couples = [np.cross(end.loop.axis, row.u1) for row in end.loop.rows if isinstance(row, AngleRow)]
        rows[list(end.loop.index)] = ca.vertcat(force, *(constant(c).T @ moment for c in couples))
    return rows


def _in_frame1(placed: PlacedLeg, moving: PlatformMotion, end: int, vector: ca.SX) -> ca.SX:
    """Turn a vector from world axes into loop frame 1."""
    leg, tie = placed.leg, placed.leg.ends[end]
    if tie.body_first:
        vector = placed.to_ends(moving.rotation.T @ vector if leg.on_platform else vector, end)
    elif not leg.on_platform:
        vector = moving.rotation.T @ vector
    return rotation_constant(tie.loop.rotation1).T @ vector
