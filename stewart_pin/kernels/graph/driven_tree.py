"""The whole chain driven by its platform or by its motors, for chains that do not come apart into legs.

The configuration comes from Newton steps; velocity and acceleration follow from the loop rows stacked on the rows of
what drives, by one elimination with pivots chosen on samples. Idle freedoms carry no momentum, as in
`stewart_pin.platform_motion`, see `stewart_pin.state.freedom`; how they accelerate is left to their own inertia
where efforts are written.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import casadi as ca
import numpy as np

from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.graph.bodies import turned_by_small
from stewart_pin.kernels.graph.joint_effects import resting
from stewart_pin.kernels.graph.loop_rows import loop_gaps, opposed_axes
from stewart_pin.kernels.graph.newton_steps import Approach, NewtonEquations, any_direction
from stewart_pin.kernels.graph.platform_kinematics import platform_bias, platform_columns, platform_placement
from stewart_pin.kernels.graph.whole_tree import (
    ClosedTree,
    motor_columns,
    natural_share,
    tree_bias,
    tree_forward_dynamics,
    tree_inverse_dynamics,
    without_momentum,
)
from stewart_pin.kernels.planning.elimination import Elimination, plan_pivots, solve_symmetric
from stewart_pin.kernels.planning.spatial import constant, shared, turn_from_quaternion
from stewart_pin.kernels.planning.tree import Tree
from stewart_pin.model.description import JointKind
from stewart_pin.typing import FloatArray

Coordinates = Literal["platform", "motor"]
_INFEASIBLE = 1e-9
"""Entries of idle motions below this are round-off."""


@dataclass(frozen=True, eq=False)
class DrivenTree:
    """A chain at a symbolic configuration, and the rows that drive it.

    Attributes
    ----------
    closed
        The chain.
    coordinates
        What drives: the platform's six motions in world axes, or the motors.
    drive
        (nv, 6 or nu) rows of what drives, transposed.
    reduced
        Loop rows and driving rows, transposed and eliminated.
    idle
        (nv, n) motions that neither loops nor drive see.
    """

    closed: ClosedTree
    coordinates: Coordinates
    drive: ca.SX
    reduced: Elimination
    idle: ca.SX

    @property
    def surplus(self) -> bool:
        """Whether rows of the drive follow from the others: then not every demand is within reach."""
        return bool(_dropped(self) or _broken(self))

    @property
    def rows(self) -> ca.SX:
        """(nv, nc + 6 or nu) rows of loops and drive, transposed."""
        return ca.horzcat(self.closed.columns.transpose, self.drive)

    @property
    def determined(self) -> int:
        """Number of freedoms that the drive determines."""
        return self.closed.motions.shape[1] - self.idle.shape[1]

    @property
    def idle_scale(self) -> FloatArray:
        """(n,) natural sizes of the idle motions [m or rad]."""
        return self.closed.chain.tangent_scale[list(self.reduced.pivots.rows)]


def drive_tree(closed: ClosedTree, coordinates: Coordinates) -> DrivenTree:
    """Drive a chain.

    Parameters
    ----------
    closed
        The chain, its loop rows eliminated.
    coordinates
        What drives it.

    Returns
    -------
    DrivenTree
        The chain, driven.

    Raises
    ------
    UnsupportedError
        If motors or platform can move while what drives is at rest.
    """
    chain, tree = closed.chain, closed.tree
    on_platform = platform_columns(closed)
    motors = motor_columns(tree)
    drive = on_platform if coordinates == "platform" else motors
    sizes = np.repeat([chain.length_scale, 1.0], 3) if coordinates == "platform" else _motor_sizes(closed)
    matrix = ca.horzcat(closed.columns.transpose, drive)
    scale = chain.tangent_scale[:, None] / np.concatenate([chain.row_sizes, sizes])
    values = closed.values(matrix) * scale
    count = chain.generic.count
    rank = chain.generic.rank + (count.platform if coordinates == "platform" else count.motor)
    reduced = Elimination(matrix, plan_pivots(values, list(range(matrix.shape[1])), rank=rank), scale)
    idle = reduced.forward(ca.SX.eye(tree.nv))[list(reduced.pivots.rows), :].T
    seen = np.abs(closed.values(ca.horzcat(on_platform, motors).T @ idle)).max(initial=0.0)
    if seen > _INFEASIBLE * max(1.0, chain.length_scale):
        other = "motor" if coordinates == "platform" else "platform"
        raise UnsupportedError(
            f"the {coordinates} coordinates of {chain.name} leave {idle.shape[1]} freedom(s) open in which the {other} "
            f"moves; use coordinates='{other}' or 'tree'"
        )
    return DrivenTree(closed, coordinates, drive, reduced, idle)


def _motor_sizes(closed: ClosedTree) -> np.ndarray:
    return closed.chain.tangent_scale[list(closed.tree.motors)]


def follow(driven: DrivenTree, k: int) -> ca.SX:
    """Move the chain with one of its driving coordinates, some idle coordinates at rest.

    Parameters
    ----------
    driven
        The chain.
    k
        Which coordinate.

    Returns
    -------
    casadi.SX
        (nv, 1) tangent velocity at unit rate of that coordinate, the others at rest.
    """
    demand = ca.SX.zeros(driven.closed.tree.nc + driven.drive.shape[1])
    demand[driven.closed.tree.nc + k] = 1
    return driven.reduced.transposed(demand)


def _infeasible(driven: DrivenTree, motion: ca.SX, loops: ca.SX, demand: ca.SX) -> ca.SX:
    """Part of a demand on loops and drive that the chain cannot follow, relative to 1 and to the demand on the drive.

    Where rows depend on each other, those of the drive may be what the motion meets, and those of the loops be left.
    """
    nc = driven.closed.tree.nc
    rows = [*_broken(driven), *(nc + k for k in _dropped(driven))]
    if not rows:
        return ca.SX(0)
    left = driven.rows[:, rows].T @ motion - ca.vertcat(loops, demand)[rows]
    return ca.norm_inf(left) / (1 + ca.norm_inf(demand))


def driven_inverse_dynamics(driven: DrivenTree) -> ca.Function:
    """Write inverse dynamics.

    Parameters
    ----------
    driven
        The chain.

    Returns
    -------
    casadi.Function
        ``(q, velocity, acceleration) -> (tau_motor, infeasible)``: q (nq, 1) with closed loops; the other two are those
        of what drives, (6, 1) or (nu, 1). `infeasible` is the part of the demanded motion that the chain cannot do,
        relative to 1 and to the demand.
    """
    inputs, tau_motor, _, infeasible = _inverse(driven)
    return shared("inverse_dynamics", inputs, {"tau_motor": tau_motor, "infeasible": infeasible})


def driven_motor_share(driven: DrivenTree) -> ca.Function:
    """Write inverse dynamics together with what each motor contributes.

    Parameters
    ----------
    driven
        The chain.

    Returns
    -------
    casadi.Function
        ``(q, velocity, acceleration) -> (tau_motor, share, infeasible)``, share (dof, nu) of efforts in natural units.
    """
    inputs, tau_motor, _, infeasible = _inverse(driven)
    outputs = {"tau_motor": tau_motor, "share": natural_share(driven.closed), "infeasible": infeasible}
    return shared("motor_share", inputs, outputs)


def driven_reactions(driven: DrivenTree) -> ca.Function:
    """Write the loop reactions of a motion.

    Parameters
    ----------
    driven
        The chain.

    Returns
    -------
    casadi.Function
        ``(q, velocity, acceleration) -> (lambda_c, infeasible)``, as for inverse dynamics; lambda_c (nc, 1).
    """
    inputs, _, lambda_c, infeasible = _inverse(driven)
    return shared("reactions", inputs, {"lambda_c": lambda_c, "infeasible": infeasible})


def _inverse(driven: DrivenTree) -> tuple[dict[str, ca.SX], ca.SX, ca.SX, ca.SX]:
    inputs, v, a, infeasible = driven_motion(driven)
    tau_motor, lambda_c = tree_inverse_dynamics(driven.closed, v, a)
    return {**inputs, **driven.closed.outside}, tau_motor, lambda_c, infeasible


def driven_velocity(driven: DrivenTree) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Express the velocity of the whole tree by that of what drives it.

    Parameters
    ----------
    driven
        The chain.

    Returns
    -------
    velocity
        (6 or nu, 1) symbols.
    v : casadi.SX
        (nv, 1).
    infeasible : casadi.SX
        (1, 1) part of the demand that the chain cannot do.
    """
    velocity = ca.SX.sym("velocity", driven.drive.shape[1])
    v = driven.reduced.transposed(ca.vertcat(ca.SX.zeros(driven.closed.tree.nc), velocity))
    if driven.idle.shape[1]:
        v = without_momentum(driven.closed, v, driven.idle, driven.idle_scale)
    return velocity, v, _infeasible(driven, v, ca.SX.zeros(driven.closed.tree.nc), velocity)


def driven_motion(driven: DrivenTree) -> tuple[dict[str, ca.SX], ca.SX, ca.SX, ca.SX]:
    """Express the motion of the whole tree by that of what drives it.

    Parameters
    ----------
    driven
        The chain.

    Returns
    -------
    inputs : dict
        ``q``, ``velocity`` and ``acceleration``.
    v, a : casadi.SX
        (nv, 1) each.
    infeasible : casadi.SX
        (1, 1) part of the demand that the chain cannot do.
    """
    closed, size = driven.closed, driven.drive.shape[1]
    velocity, v, lost = driven_velocity(driven)
    acceleration = ca.SX.sym("acceleration", size)
    bias = platform_bias(closed, v) if driven.coordinates == "platform" else ca.SX.zeros(size)
    demand = acceleration - bias
    loops = -tree_bias(closed, v)
    a = driven.reduced.transposed(ca.vertcat(loops, demand))
    infeasible = ca.fmax(lost, _infeasible(driven, a, loops, demand))
    return {"q": closed.q, "velocity": velocity, "acceleration": acceleration}, v, a, infeasible


def driven_forward_dynamics(driven: DrivenTree) -> ca.Function:
    """Write forward dynamics.

    Parameters
    ----------
    driven
        The chain.

    Returns
    -------
    casadi.Function
        ``(q, velocity, tau_motor) -> (acceleration, infeasible)``, velocity and acceleration of what drives; with dry
        friction ``resting`` as well.
    """
    closed, tree = driven.closed, driven.closed.tree
    velocity, v, infeasible = driven_velocity(driven)
    tau_motor = ca.SX.sym("tau_motor", len(tree.motors))
    a, _ = tree_forward_dynamics(closed, v, tau_motor)
    acceleration = driven.drive.T @ a
    if driven.coordinates == "platform":
        acceleration = acceleration + platform_bias(closed, v)
    return shared(
        "forward_dynamics",
        {"q": closed.q, "velocity": velocity, "tau_motor": tau_motor, **closed.outside},
        {"acceleration": acceleration, "infeasible": infeasible, **resting(closed, v)},
    )


def driven_motor_jacobian(driven: DrivenTree) -> ca.Function:
    """Write the motor Jacobian of a chain that its platform drives.

    Parameters
    ----------
    driven
        The chain.

    Returns
    -------
    casadi.Function
        ``q -> jacobian``, (nq, 1) to (nu, 6), which holds for twists that the platform can do.
    """
    closed, tree = driven.closed, driven.closed.tree
    columns = [
        motor_columns(tree).T @ driven.reduced.transposed(ca.vertcat(ca.SX.zeros(tree.nc), unit))
        for unit in ca.horzsplit(ca.SX.eye(6))
    ]
    return shared("motor_jacobian", {"q": closed.q}, {"jacobian": ca.horzcat(*columns)})


def closing_equations(driven: DrivenTree) -> NewtonEquations:
    """Write the equations of closed loops with what drives at a target.

    Parameters
    ----------
    driven
        The chain.

    Returns
    -------
    NewtonEquations
        Of the configuration, (nq, 1), and the target: (7, 1) pose or (nu, 1) motor positions. The last entries of
        the size are 1 where a loop has closed with its axes opposed, or the platform is half a turn off.
    """
    closed, tree, chain = driven.closed, driven.closed.tree, driven.closed.chain
    loops = loop_gaps(tree, closed.at, closed.q)
    opposed = opposed_axes(tree, closed.at)
    if driven.coordinates == "platform":
        target = ca.SX.sym("target", 7)
        (off, cosine), sizes = _pose_error(closed, target), np.repeat([chain.length_scale, 1.0], 3)
        opposed = ca.vertcat(opposed, ca.fmax(-cosine, 0))
    else:
        target = ca.SX.sym("target", len(tree.motors))
        off, sizes = closed.q[list(tree.motors_q)] - target, _motor_sizes(closed)
    scaled = ca.vertcat(loops, off) / constant(np.concatenate([chain.row_sizes, sizes]))
    return NewtonEquations(
        state=closed.q,
        target=target,
        gap=ca.vertcat(closed.columns.turn.T @ loops, off),
        size=ca.vertcat(scaled, opposed),
        close=lambda gap: driven.reduced.transposed(-gap),
        move=lambda q, step: integrated(tree, q, step),
        sizes=chain.tangent_scale,
        determinant=driven.reduced.determinant(closed.usual),
        direction=_beside(closed, driven.reduced.pivots.rows),
        approach=_approach(driven, sizes) if driven.surplus else None,
    )


def _approach(driven: DrivenTree, sizes: np.ndarray) -> Approach:
    """Close the loops, and come as near to a demand as can be in all the rows of the drive; idle motions at rest."""
    closed, nc = driven.closed, driven.closed.tree.nc
    share = constant(np.diag(1 / sizes)) @ (driven.drive.T @ closed.motions)
    square, scale = share.T @ share, closed.motion_scale
    values = closed.values(square) * scale[:, None] * scale

    def close(gap: ca.SX) -> ca.SX:
        across = closed.reduced.transposed(-gap[:nc])
        left = constant(1 / sizes) * (gap[nc:] + driven.drive.T @ across)
        steps, _, _ = solve_symmetric(square, -(share.T @ left), values)
        return across + closed.motions @ ca.vertcat(*steps)

    scale, both = closed.chain.tangent_scale, 1 / np.concatenate([closed.chain.row_sizes, sizes])
    rows = (
        constant(np.diag(both))
        @ ca.horzcat(closed.columns.transpose, driven.drive).T
        @ constant(np.diag(scale))
    )
    normal = rows.T @ rows
    sampled = closed.values(normal)

    def fit(rates: ca.SX) -> ca.SX:
        found, _, _ = solve_symmetric(normal, rows.T @ (constant(both) * rates), sampled)
        return constant(scale) * ca.vertcat(*found)

    _, idle, _ = solve_symmetric(normal, ca.SX.zeros(normal.shape[0]), sampled)
    return Approach(close, fit, _beside(closed, idle))


def _beside(closed: ClosedTree, rows: Sequence[int]) -> FloatArray:
    """Draw a displacement that leaves coordinates at rest."""
    direction = any_direction(closed.chain.tangent_scale)
    direction[list(rows)] = 0.0
    return direction


def _dropped(driven: DrivenTree) -> list[int]:
    """Rows of the drive that follow from the others."""
    nc = driven.closed.tree.nc
    return [k - nc for k in driven.reduced.pivots.columns if k >= nc]


def _broken(driven: DrivenTree) -> list[int]:
    """Rows of the loops that follow from others with the drive's, but not from the loops' own."""
    left = set(driven.reduced.pivots.columns) - set(driven.closed.reduced.pivots.columns)
    return sorted(k for k in left if k < driven.closed.tree.nc)


def _pose_error(closed: ClosedTree, target: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Position error, and rotation vector of the error in world axes, to the second order; cosine of its angle."""
    position, rotation = platform_placement(closed)
    turn = rotation @ turn_from_quaternion(target[3:]).T
    half = ca.vertcat(turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]) / 2
    # 2 sin(angle / 2) along the axis of the sine; at exactly half a turn the sine has no axis and this vanishes.
    cosine = (turn[0, 0] + turn[1, 1] + turn[2, 2] - 1) / 2
    return ca.vertcat(position - target[:3], half * ca.sqrt(2 / ca.fmax(1 + cosine, 1e-6))), cosine


def integrated(tree: Tree, q: ca.SX, step: ca.SX) -> ca.SX:
    """Move a configuration along a small tangent vector.

    Parameters
    ----------
    tree
        Constants.
    q
        (nq, 1) configuration.
    step
        (nv, 1) displacement; errors are of its third order.

    Returns
    -------
    casadi.SX
        (nq, 1) with quaternions of unit length.
    """
    moved = ca.SX(q)
    for joint in tree.joints:
        part, by = q[joint.q], step[joint.v]
        match joint.kind:
            case JointKind.SPHERICAL:
                moved[joint.q] = turned_by_small(part, by, body=True)
            case JointKind.FLOATING:
                shift = turn_from_quaternion(part[3:]) @ by[:3]
                moved[joint.q] = ca.vertcat(part[:3] + shift, turned_by_small(part[3:], by[3:], body=True))
            case _:
                moved[joint.q] = part + by
    return moved
