"""The verbs of the kernels: what each is written by, of legs with closed forms, of a driven tree, of a whole state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import casadi as ca

from stewart_pin.kernels.graph import (
    driven_tree,
    leg_reactions,
    platform_dynamics,
    platform_kinematics,
    state_functions,
)
from stewart_pin.kernels.graph.conditioning import platform_conditioning, tree_conditioning
from stewart_pin.kernels.graph.driven_tree import DrivenTree
from stewart_pin.kernels.graph.platform_dynamics import PlacedPlatform
from stewart_pin.kernels.graph.platform_frame import platform_pose_function
from stewart_pin.kernels.graph.regressor import driven_regressor, platform_regressor, tree_regressor
from stewart_pin.kernels.graph.whole_tree import ClosedTree

Solved = Literal["nothing", "motions", "motors", "reactions"]
"""What is solved for besides the motion of the joints, and divided by: see `FunctionSet.conditioning_of`."""


@dataclass(frozen=True)
class Verb:
    """A verb, and how its function is written.

    Attributes
    ----------
    legs
        Of a platform on legs with closed forms: takes the pose.
    driven
        Of a whole tree that its platform or its motors drive: takes the configuration, and the motion of what drives.
    state
        Of a whole tree: takes q, v, a.
    solves
        ``"motions"``: accelerations, or motor rates; ``"motors"``: the motors' share of the forces; ``"reactions"``:
        the loops' as well.
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

DIFFERENTIABLE = ("inverse_dynamics", "forward_dynamics")
"""Verbs that are differentiated too: by the state (``_derivatives``), by the geometry (``_by_tree``, ``_by_legs``)."""

ANY_STATE: dict[str, Callable[[ClosedTree], ca.Function]] = {
    "tree_inverse_dynamics": state_functions.inverse_dynamics_function,
    "tree_forward_dynamics": state_functions.forward_dynamics_function,
    "tree_projection": state_functions.projection_function,
    "platform_pose": platform_pose_function,
}
"""Functions of any configuration of the whole tree, whatever the coordinates of the kernels."""
