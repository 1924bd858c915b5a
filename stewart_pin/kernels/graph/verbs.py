"""The verbs of the kernels: what each is written by, of legs with closed forms, of a driven tree, of a whole state.

How near a state is to a singularity is told by the pivots that a verb divides by.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import casadi as ca
import numpy as np

from stewart_pin.kernels.graph import (
    driven_tree,
    leg_reactions,
    platform_dynamics,
    platform_kinematics,
    state_functions,
)
from stewart_pin.kernels.graph.bodies import efforts_of_wrenches, outside_input, outside_wrenches
from stewart_pin.kernels.graph.driven_tree import DrivenTree
from stewart_pin.kernels.graph.held_motion import HeldMotion
from stewart_pin.kernels.graph.leg_forces import acting_on
from stewart_pin.kernels.graph.leg_reactions import holding_share
from stewart_pin.kernels.graph.legs import idle_momenta, platform_motion
from stewart_pin.kernels.graph.platform_dynamics import PlacedPlatform, motor_columns
from stewart_pin.kernels.graph.platform_kinematics import platform_columns, platform_pose_function
from stewart_pin.kernels.graph.regressor import driven_regressor, platform_regressor, tree_regressor
from stewart_pin.kernels.graph.whole_tree import ClosedTree, inertia_times
from stewart_pin.kernels.graph.whole_tree import motor_columns as tree_motor_columns
from stewart_pin.kernels.planning.elimination import Elimination, plan_pivots, solve_symmetric
from stewart_pin.kernels.planning.plan import PlatformPlan
from stewart_pin.kernels.planning.spatial import constant, shared
from stewart_pin.typing import FloatArray

_NOTHING = 1e-6
"""Size, in robot sizes and radians, of what printed digits may leave of entries that vanish; a thousand times that is
no state at which they do."""
_NO_WRENCH = 1e-30
"""Wrench [N m] beside which any other is large: none leaves nothing, relative to none."""
_SMALL = 1e-3
"""Pivots of ordinary robots are larger, relative to the largest entry of their matrix."""


# ----------------------------------------------------------------------------------------------------
# How near a state is to a singularity, by the pivots that the kernels divide by
# ----------------------------------------------------------------------------------------------------


def platform_conditioning(
    placed: PlacedPlatform,
    *,
    motors: bool = True,
    reactions: bool = False,
    driving: Elimination | None = None,
) -> ca.Function:
    """Write the conditioning of a pose.

    Parameters
    ----------
    placed
        Platform and legs.
    motors
        Whether the motors must hold the platform, or the legs only follow it.
    reactions
        Whether what holds it where it has no freedom must be determined too.
    driving
        By what the motors' motion is turned into that of the platform, if it is.

    Returns
    -------
    casadi.Function
        ``pose -> conditioning``, (7, 1) to (1, 1): the smallest pivot, each relative to its median over samples, or to
        a thousandth of the largest entry of its matrix if that is more; or the product of those by which the motors'
        motion is turned into the platform's, if that is less. Near one where the robot is as regular as
        around home, near zero at a singularity of a leg or of the platform.
    """
    reduced = [leg.reduced for leg in placed.legs]
    if driving is not None:
        reduced.append(driving)
    if motors:
        share = placed.project(motor_columns(placed))
        reduced.append(_share_reduced(share, placed.values, placed.twist_scale, _motor_sizes(placed.plan)))
    if reactions:
        share, before = holding_share(placed)
        reduced += [before, _share_reduced(share, placed.values, *map(np.ones, share.shape))]
    measure = _smallest(reduced, placed.usual, driving)
    return shared("conditioning", {"pose": placed.pose}, {"conditioning": measure})


def tree_conditioning(
    closed: ClosedTree,
    driven: DrivenTree | None = None,
    *,
    motors: bool = True,
    held: HeldMotion | None = None,
) -> ca.Function:
    """Write the conditioning of a configuration.

    Parameters
    ----------
    closed
        The chain.
    driven
        The same, driven, if its motion is to follow from that of its drive.
    motors
        Whether the motors must hold it.
    held
        What is held of its motion while the geometry changes, if that is the question.

    Returns
    -------
    casadi.Function
        ``q -> conditioning``, (nq, 1) to (1, 1), as `platform_conditioning`.
    """
    reduced = [closed.reduced] if driven is None else [closed.reduced, driven.reduced]
    if held is not None:
        reduced.append(held.reduced)
    if motors:
        share = closed.motions.T @ tree_motor_columns(closed.tree)
        reduced.append(_share_reduced(share, closed.values, closed.motion_scale, _motor_sizes(closed)))
    return shared("conditioning", {"q": closed.q}, {"conditioning": _smallest(reduced, closed.usual)})


def platform_push(placed: PlacedPlatform, told: FloatArray) -> ca.Function | None:
    """Measure by how much wrenches push idle motions of which nothing says how they accelerate.

    These are those without inertia, and those of links of which it would tell where they stand.

    Parameters
    ----------
    placed
        Platform and legs.
    told
        (n,) one for entries of wrenches that may not push any idle motion, zero for the others, dimensionless.

    Returns
    -------
    casadi.Function or None
        ``(pose, wrenches) -> pushed``, (1, 1) relative to the wrenches, lengths in robot sizes; None where there are
        no such motions.
    """
    still = ca.SX.zeros(6)
    moving = platform_motion(placed.plan.tree, placed.pose, still, still)
    pushes = []
    for leg in placed.legs:
        if leg.leg.outside and leg.idle.shape[1]:
            joints, moved = leg.leg.joints, idle_momenta(leg)
            momenta = ca.horzcat(*(efforts_of_wrenches(joints, leg.at, wrench, 1) for wrench in moved))
            efforts, telling = (
                efforts_of_wrenches(joints, leg.at, acting_on(leg, moving, wrenches), 1)
                for wrenches in (placed.wrenches, constant(told) * placed.wrenches)
            )
            pushes += _unanswered(leg.idle, momenta, efforts, leg.values)
            pushes += ca.vertsplit(leg.idle.T @ telling)
    return _pushed({"pose": placed.pose, **placed.outside}, pushes, placed.plan.chain.length_scale)


def tree_push(closed: ClosedTree, told: FloatArray) -> ca.Function | None:
    """Measure the same of the whole tree.

    Parameters
    ----------
    closed
        The chain.
    told
        (n,) as in `platform_push`, dimensionless.

    Returns
    -------
    casadi.Function or None
        ``(q, wrenches) -> pushed``, as `platform_push`.
    """
    tree, columns = closed.tree, tree_motor_columns(closed.tree)
    if closed.chain.platform is not None:
        columns = ca.horzcat(columns, platform_columns(closed))
    share = closed.motions.T @ columns
    values = closed.values(share) * closed.motion_scale[:, None]
    reduced = Elimination(share, plan_pivots(values, list(range(share.shape[1]))))
    idle = closed.motions @ reduced.forward(ca.SX.eye(share.shape[0]))[list(reduced.pivots.rows), :].T
    efforts, telling = (
        efforts_of_wrenches(
            tree.joints, closed.at, outside_wrenches(tree.joints, closed.at, tree.outside, wrenches), 1
        )
        for wrenches in (closed.wrenches, constant(told) * closed.wrenches)
    )
    pushes = _unanswered(idle, inertia_times(closed, idle), efforts, closed.values)
    pushes += ca.vertsplit(idle.T @ telling)
    return _pushed({"q": closed.q, **outside_input(closed.wrenches)}, pushes, closed.chain.length_scale)


def _unanswered(
    idle: ca.SX, momenta: ca.SX, efforts: ca.SX, values: Callable[[ca.SX], FloatArray]
) -> list[ca.SX]:
    """Keep of efforts along idle motions what those with inertia leave unanswered: one for each without."""
    inertia, right = idle.T @ momenta, idle.T @ efforts
    steps, light, _ = solve_symmetric(inertia, right, values(inertia))
    return [right[k] - inertia[k, :] @ ca.vertcat(*steps) for k in light]


def _pushed(inputs: dict[str, ca.SX], pushes: list[ca.SX], length: float) -> ca.Function | None:
    pushes = [push for push in pushes if not ca.sparsify(push).is_zero()]
    if not pushes:
        return None
    size = constant(np.tile(np.repeat([length, 1.0], 3), inputs["wrenches"].shape[0] // 6))
    worst = ca.norm_inf(ca.vertcat(*pushes)) / (_NO_WRENCH + ca.norm_inf(size * inputs["wrenches"]))
    return shared("pushed", inputs, {"pushed": worst})


def _motor_sizes(of: PlatformPlan | ClosedTree) -> FloatArray:
    """Natural sizes of the motors' coordinates [m or rad]."""
    return of.chain.tangent_scale[list(of.tree.motors)]


def _share_reduced(
    share: ca.SX, values: Callable[[ca.SX], FloatArray], scale: FloatArray, motors: FloatArray
) -> Elimination:
    """Eliminate the motors' share, or its square where motors are redundant."""
    if share.shape[0] < share.shape[1]:
        natural = share @ ca.diag(constant(1 / motors))
        share = natural @ natural.T
        sampled = values(share) * scale[:, None] * scale
    else:
        sampled = values(share) * scale[:, None]
    return Elimination(share, plan_pivots(sampled, list(range(share.shape[1])), nothing=0.0))


def _smallest(
    reduced: Sequence[Elimination], usually: Callable[[ca.SX], FloatArray], driving: Elimination | None = None
) -> ca.SX:
    """Smallest of the pivots, or the determinant of what turns motors' motion into a platform's if that is less."""
    pivots = [pivot for one in reduced for pivot in one.pivot_expressions()]
    sizes = [size for one in reduced for size in one.pivots.sizes]
    usual = usually(ca.vertcat(*pivots))
    # A pivot that is small around home already has lost digits there.
    usual = usual / np.minimum(1.0, np.array(sizes) / _SMALL)
    every = [ca.fabs(pivot) / float(size) for pivot, size in zip(pivots, usual, strict=True)]
    ratios = [ratio for ratio, pivot in zip(every, pivots, strict=True) if not pivot.is_constant()]
    if driving is not None:
        first = sum(len(one.pivots.sizes) for one in reduced[: reduced.index(driving)])
        ratios.append(functools.reduce(ca.times, every[first : first + len(driving.pivots.sizes)], ca.SX(1)))
    entries = [entry for one in reduced for entry in one.nothing if not entry.is_constant()]
    if entries:
        # Where loops have come together in another way than around home, what is nothing there is something.
        ratios.append(_NOTHING**2 / ca.fmax(ca.sumsqr(ca.vertcat(*entries)), _NOTHING**2))
    return functools.reduce(ca.fmin, ratios) if ratios else ca.SX(1)


# ----------------------------------------------------------------------------------------------------

Solved = Literal["nothing", "motions", "motors", "reactions"]
"""What is solved for besides the motion of the joints, and divided by: see `FunctionSet.conditioning_of`."""


@dataclass(frozen=True)
class Verb:
    """A verb, and how its function is written.

    Attributes
    ----------
    legs
        Of a platform on legs with closed forms: takes the pose. Without it the whole tree is asked there too.
    driven
        Of a whole tree that its platform or its motors drive: takes the configuration, and the motion of what drives.
        One of a motion has the output ``infeasible``.
    state
        Of a whole tree: takes q, v, a, and has the output ``open``.
    solves
        By what it divides, and singularities are told. ``"nothing"``: positions alone; ``"motions"``: velocities of
        the joints, accelerations, or motor rates; ``"motors"``: the motors' share of the forces; ``"reactions"``: the
        loops' as well.
    of_poses
        Whether it is for platform coordinates alone.
    """

    legs: Callable[[PlacedPlatform], ca.Function] | None = None
    driven: Callable[[DrivenTree], ca.Function] | None = None
    state: Callable[[ClosedTree], ca.Function] | None = None
    solves: Solved = "nothing"
    of_poses: bool = False


VERBS = {
    "inverse_dynamics": Verb(
        platform_dynamics.inverse_dynamics_function,
        driven_tree.driven_inverse_dynamics,
        state_functions.judged_inverse_dynamics,
        solves="motors",
    ),
    "forward_dynamics": Verb(
        platform_dynamics.forward_dynamics_function,
        driven_tree.driven_forward_dynamics,
        state_functions.judged_forward_dynamics,
        solves="motions",
    ),
    "reactions": Verb(
        leg_reactions.reactions_function,
        driven_tree.driven_reactions,
        state_functions.judged_reactions,
        solves="reactions",
    ),
    "regressor": Verb(platform_regressor, driven_regressor, tree_regressor, solves="motors"),
    "inverse_kinematics": Verb(platform_kinematics.inverse_kinematics_function, of_poses=True),
    "motor_jacobian": Verb(
        platform_kinematics.motor_jacobian_function,
        driven_tree.driven_motor_jacobian,
        solves="motions",
        of_poses=True,
    ),
    "conditioning": Verb(
        platform_conditioning, lambda driven: tree_conditioning(driven.closed, driven), tree_conditioning
    ),
}
"""In any coordinates, but for those of poses."""

BESIDE = {
    "motor_share": Verb(
        platform_dynamics.motor_share_function,
        driven_tree.driven_motor_share,
        state_functions.judged_motor_share,
        solves="motors",
    )
}
"""What verbs ask beside these: efforts, and how motors share them."""

DIFFERENTIABLE = ("inverse_dynamics", "forward_dynamics")
"""Verbs that are differentiated too: by the state (``_derivatives``), by the geometry (``_by_tree``, ``_by_legs``)."""

ANY_STATE: dict[str, Callable[[ClosedTree], ca.Function]] = {
    "tree_inverse_dynamics": state_functions.inverse_dynamics_function,
    "tree_forward_dynamics": state_functions.forward_dynamics_function,
    "tree_projection": state_functions.projection_function,
    "platform_pose": platform_pose_function,
}
"""Functions of any configuration of the whole tree, whatever the coordinates of the kernels."""
