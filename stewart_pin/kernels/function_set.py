"""CasADi functions of a chain by name, each written when it is asked for.

Two ways lead from the platform's motion to the motors. Where the chain comes apart into legs with closed forms, the
functions take the pose itself. Elsewhere, and from motor coordinates, they take the configuration, which Newton steps
find first.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from typing import Literal

import casadi as ca

from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.kernels.graph import (
    conditioning,
    driven_tree,
    leg_reactions,
    platform_dynamics,
    platform_frame,
    platform_kinematics,
    state_functions,
    whole_tree,
)
from stewart_pin.kernels.graph.derivatives import dynamics_derivatives, platform_derivatives
from stewart_pin.kernels.graph.driven_tree import DrivenTree
from stewart_pin.kernels.graph.geometry_by_legs import leg_displacements, leg_geometry_derivatives
from stewart_pin.kernels.graph.geometry_by_tree import tree_geometry_derivatives
from stewart_pin.kernels.graph.held_motion import HeldMotion, hold
from stewart_pin.kernels.graph.leg_regressor import platform_regressor
from stewart_pin.kernels.graph.newton_steps import NewtonEquations, damped_step, double_step
from stewart_pin.kernels.graph.platform_dynamics import PlacedPlatform
from stewart_pin.kernels.graph.projection import projection_function
from stewart_pin.kernels.graph.regressor import driven_regressor, tree_regressor
from stewart_pin.kernels.graph.whole_tree import ClosedTree
from stewart_pin.kernels.idle_freedoms import require_idle_without_effect
from stewart_pin.kernels.mobile_displacements import MobileDisplacements, mobile_displacements
from stewart_pin.kernels.plan import plan_platform
from stewart_pin.kernels.samples import closed_samples
from stewart_pin.model.chain import ClosedChain

Coordinates = Literal["platform", "motor", "tree"]

_LEGS: dict[str, Callable[[PlacedPlatform], ca.Function]] = {
    "inverse_dynamics": platform_dynamics.inverse_dynamics_function,
    "forward_dynamics": platform_dynamics.forward_dynamics_function,
    "inverse_kinematics": platform_kinematics.inverse_kinematics_function,
    "motor_jacobian": platform_kinematics.motor_jacobian_function,
    "conditioning": conditioning.platform_conditioning,
    "regressor": platform_regressor,
}
_DRIVEN: dict[str, Callable[[DrivenTree], ca.Function]] = {
    "inverse_dynamics": driven_tree.driven_inverse_dynamics,
    "forward_dynamics": driven_tree.driven_forward_dynamics,
    "reactions": driven_tree.driven_reactions,
    "regressor": driven_regressor,
    "motor_jacobian": driven_tree.driven_motor_jacobian,
    "conditioning": lambda driven: conditioning.tree_conditioning(driven.closed, driven),
}
_TREE: dict[str, Callable[[ClosedTree], ca.Function]] = {
    "tree_inverse_dynamics": state_functions.inverse_dynamics_function,
    "tree_forward_dynamics": state_functions.forward_dynamics_function,
    "tree_projection": projection_function,
    "platform_pose": platform_frame.platform_pose_function,
}
_STATE: dict[str, Callable[[ClosedTree], ca.Function]] = {
    "inverse_dynamics": state_functions.judged_inverse_dynamics,
    "forward_dynamics": state_functions.judged_forward_dynamics,
    "reactions": state_functions.judged_reactions,
    "regressor": tree_regressor,
    "conditioning": conditioning.tree_conditioning,
}
_STEPS: dict[str, Callable[[str, NewtonEquations], ca.Function]] = {
    "_double_step": double_step,
    "_step": damped_step,
}
_DERIVATIVES = ("inverse_dynamics_derivatives", "forward_dynamics_derivatives")
_HELD = ("inverse_dynamics", "reactions", "regressor")
"""What the motors hold: their share of the forces is solved for."""
_FOLLOWING = ("forward_dynamics", "motor_jacobian")
_BY_TREE = ("inverse_dynamics_by_tree", "forward_dynamics_by_tree")
_BY_LEGS = ("inverse_dynamics_by_legs", "forward_dynamics_by_legs")


class FunctionSet:
    """Functions of a chain.

    Parameters
    ----------
    chain
        Closed chain.
    coordinates
        ``"platform"``, ``"motor"`` or ``"tree"``.

    Raises
    ------
    UnsupportedError
        If the coordinates do not determine the chain's motion or its efforts, or a joint or closure has no graph.
    """

    def __init__(self, chain: ClosedChain, coordinates: Coordinates) -> None:
        self.chain = chain
        self.coordinates: Coordinates = coordinates
        self.placed: PlacedPlatform | None = None
        self.why_whole_tree = f"{coordinates} coordinates"
        self._written: dict[str, ca.Function] = {}
        if coordinates != "tree":
            require_idle_without_effect(chain, closed_samples(chain, count=1)[0])
        if coordinates == "platform":
            try:
                self.placed = platform_dynamics.place_platform(plan_platform(chain))
                self.why_whole_tree = ""
            except UnsupportedError as reason:
                self.why_whole_tree = str(reason)
        if self.placed is not None:
            self.freedoms = self.placed.plan.twists.shape[1]
        elif coordinates == "tree":
            self.freedoms = self.closed.motions.shape[1]
        else:
            self.freedoms = self.driven.determined

    @cached_property
    def closed(self) -> ClosedTree:
        """The whole tree with its loop rows eliminated."""
        return whole_tree.close_tree(self.chain)

    @cached_property
    def driven(self) -> DrivenTree:
        """The whole tree, driven by its platform or its motors."""
        return driven_tree.drive_tree(self.closed, "motor" if self.coordinates == "motor" else "platform")

    @cached_property
    def motor_driven(self) -> DrivenTree:
        """The whole tree, driven by its motors."""
        return self.driven if self.coordinates == "motor" else driven_tree.drive_tree(self.closed, "motor")

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the functions."""
        if self.coordinates == "tree":
            return (*_STATE, *_BY_TREE, *_TREE)
        if self.coordinates == "motor":
            own = [name for name in _DRIVEN if name != "motor_jacobian"]
        elif self.placed is None:
            own = [*_DRIVEN]
        else:
            own = [*_LEGS, "reactions", *(_BY_LEGS if self.leg_displacements else ())]
        steps = (equations + kind for equations in self._equations for kind in _STEPS)
        return (*own, *steps, *_DERIVATIVES, *_BY_TREE, *_TREE)

    @cached_property
    def _equations(self) -> dict[str, Callable[[], NewtonEquations]]:
        """What Newton steps solve, by name."""
        closing = {"closing": lambda: driven_tree.closing_equations(self.driven)}
        if self.coordinates == "motor":
            return closing
        if self.placed is None:
            return {**closing, "motor_closing": lambda: driven_tree.closing_equations(self.motor_driven)}
        placed = self.placed
        return {**closing, "forward_kinematics": lambda: platform_kinematics.pose_equations(placed)}

    @cached_property
    def leg_displacements(self) -> tuple[int, ...]:
        """Displacements of the geometry by which the legs can be differentiated in closed form."""
        return () if self.placed is None else leg_displacements(self.placed)

    @cached_property
    def displacements(self) -> MobileDisplacements:
        """Displacements of the geometry along which there is a derivative."""
        return mobile_displacements(self.closed, self._drive, lambda: self._by_tree(_BY_TREE[0]))

    @cached_property
    def held(self) -> HeldMotion:
        """What of a motion is held while the geometry changes."""
        return hold(self.closed, self._drive)

    @property
    def _drive(self) -> DrivenTree | None:
        return None if self.coordinates == "tree" else self.driven

    def _by_tree(self, name: str) -> ca.Function:
        if name not in self._written:
            verb = name.removesuffix("_by_tree")
            self._written[name] = tree_geometry_derivatives(self.held, self._drive, verb)
        return self._written[name]

    @property
    def pivot_score(self) -> float:
        """Smallest pivot relative to its column, over the samples."""
        if self.placed is not None:
            return min(leg.reduced.pivots.score for leg in self.placed.legs)
        own = self.closed.reduced.pivots.score
        return own if self.coordinates == "tree" else min(self.driven.reduced.pivots.score, own)

    def function(self, name: str) -> ca.Function:
        """Write a function.

        Parameters
        ----------
        name
            One of `names`.

        Returns
        -------
        casadi.Function
            The function.

        Raises
        ------
        InputError
            If there is no such function.
        """
        if name not in self.names:
            raise InputError(f"name must be one of {', '.join(self.names)}, got {name!r}")
        if name in _TREE:
            return _TREE[name](self.closed)
        if name in _BY_TREE:
            return self._by_tree(name)
        if self.coordinates == "tree":
            return _STATE[name](self.closed)
        if name in _DERIVATIVES:
            verb = name.removesuffix("_derivatives")
            if self.placed is not None and self.freedoms == self.chain.nu:
                return platform_derivatives(self.placed, verb)
            function = self.function(verb)
            return dynamics_derivatives(function, None if self.placed is not None else self.driven)
        if self.placed is not None and name in _BY_LEGS:
            return leg_geometry_derivatives(self.placed, name.removesuffix("_by_legs"))
        if self.placed is not None and name in _LEGS:
            return _LEGS[name](self.placed)
        if self.placed is not None and name == "reactions":
            with suppress(UnsupportedError):  # rows that need the whole configuration, or the norm over it
                return leg_reactions.reactions_function(self.placed)
        for kind, write in _STEPS.items():
            if name.removesuffix(kind) in self._equations:
                return write(name, self._equations[name.removesuffix(kind)]())
        return _DRIVEN[name](self.driven)

    def conditioning_of(self, name: str, function: ca.Function) -> ca.Function | None:
        """Write the conditioning of the states of a function.

        Parameters
        ----------
        name
            One of `names`.
        function
            What it stands for.

        Returns
        -------
        casadi.Function or None
            Of the function's first input; None where nothing is divided by, or where only steps are taken.
        """
        kind = name.removesuffix("_derivatives").removesuffix("_by_tree").removesuffix("_by_legs")
        if kind not in _HELD and kind not in _FOLLOWING:
            return None
        motors = kind in _HELD
        if self.placed is not None and function.name_in(0) == "pose":
            return conditioning.platform_conditioning(
                self.placed, motors=motors, reactions=kind == "reactions"
            )
        held = self.held if name in _BY_TREE else None
        return conditioning.tree_conditioning(self.closed, self._drive, motors=motors, held=held)
