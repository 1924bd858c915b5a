"""CasADi functions of a chain by name, each written when it is asked for.

Two ways lead between the platform's motion and the motors. Where the chain comes apart into legs with closed forms,
the functions take the pose, in motor coordinates too: there Newton steps find it first. Elsewhere they take the
configuration, which Newton steps find first.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import casadi as ca
import numpy as np
import pinocchio as pin

from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.kernels.graph import (
    conditioning,
    driven_platform,
    driven_tree,
    platform_dynamics,
    platform_frame,
    platform_kinematics,
    state_functions,
    whole_tree,
)
from stewart_pin.kernels.graph.derivatives import dynamics_derivatives
from stewart_pin.kernels.graph.driven_platform import DrivenPlatform
from stewart_pin.kernels.graph.driven_tree import DrivenTree
from stewart_pin.kernels.graph.geometry_derivatives import leg_displacements, tree_geometry_derivatives
from stewart_pin.kernels.graph.held_motion import HeldMotion, MobileDisplacements, hold, mobile_displacements
from stewart_pin.kernels.graph.leg_functions import BY_LEGS, DERIVATIVES, LEG_FUNCTIONS, leg_function
from stewart_pin.kernels.graph.newton_steps import NewtonEquations, damped_step, double_step, stretch_step
from stewart_pin.kernels.graph.platform_dynamics import PlacedPlatform
from stewart_pin.kernels.graph.regressor import driven_regressor, tree_regressor
from stewart_pin.kernels.graph.state_functions import projection_function
from stewart_pin.kernels.graph.whole_tree import ClosedTree
from stewart_pin.kernels.planning.plan import plan_platform
from stewart_pin.kernels.planning.samples import closed_samples, require_idle_without_effect
from stewart_pin.kernels.planning.tree import tree_of
from stewart_pin.mechanics.kinematics import platform_pose
from stewart_pin.model.description import JointKind
from stewart_pin.programs.symbolic import drop, writing, written_once
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import BoolArray, Configuration, FloatArray

Coordinates = Literal["platform", "motor", "tree"]

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
    "_stretch_step": stretch_step,
    "_step": damped_step,
}
_HELD = ("inverse_dynamics", "reactions", "regressor")
"""What the motors hold: their share of the forces is solved for."""
_FOLLOWING = ("forward_dynamics", "motor_jacobian")
_BY_TREE = ("inverse_dynamics_by_tree", "forward_dynamics_by_tree")


class FunctionSet:
    """Functions of a chain.

    Parameters
    ----------
    chain
        Closed chain.
    coordinates
        ``"platform"``, ``"motor"`` or ``"tree"``.
    around
        (nq,) regular configuration around which functions of the whole tree serve; None is home, where the chain is
        taken apart into legs if it can be [m, rad, unit quaternions].

    Raises
    ------
    UnsupportedError
        If the coordinates do not determine the chain's motion or its efforts, or a joint or closure has no graph.
    """

    def __init__(
        self, chain: ClosedChain, coordinates: Coordinates, around: Configuration | None = None
    ) -> None:
        if coordinates == "platform":
            chain.platform_link  # noqa: B018 - raises
        elif coordinates == "motor":
            chain.require_motors()
        self.chain = chain
        self._around = around
        self.coordinates: Coordinates = coordinates
        self.placed: PlacedPlatform | None = None
        self.driven_platform: DrivenPlatform | None = None
        self.why_whole_tree = f"{coordinates} coordinates"
        self._written: dict[str, ca.Function] = {}
        with writing():
            self._begin()

    def __del__(self) -> None:
        drop(self)

    def _begin(self) -> None:
        chain, coordinates, around = self.chain, self.coordinates, self._around
        if coordinates != "tree" and around is None:
            require_idle_without_effect(chain, closed_samples(chain, count=1)[0])
            try:
                if chain.platform is not None:
                    self._take_apart()
                self.why_whole_tree = "no platform" if chain.platform is None else ""
            except UnsupportedError as reason:
                self.why_whole_tree = str(reason)
        if self.placed is not None:
            self.freedoms = self.placed.plan.twists.shape[1]
        elif coordinates == "tree":
            self.freedoms = self.closed.motions.shape[1]
        else:
            self.freedoms = self.driven.determined

    def _take_apart(self) -> None:
        placed = platform_dynamics.place_platform(plan_platform(self.chain))
        if self.coordinates == "motor":
            platform_kinematics.motor_position_expressions(placed)  # refuses what its equations cannot say
            self.driven_platform = driven_platform.drive_platform(placed)
        self.placed = placed

    @written_once
    def closed(self) -> ClosedTree:
        """The whole tree with its loop rows eliminated."""
        return whole_tree.close_tree(self.chain, self._around, closed=self.coordinates != "tree")

    @written_once
    def any_state(self) -> ClosedTree:
        """The same for states that may be a little off closed loops."""
        return self.closed if self.coordinates == "tree" else whole_tree.close_tree(self.chain)

    @property
    def replanned(self) -> bool:
        """Whether other pivots may serve where these do not: legs with closed forms have no choice."""
        return self.placed is None

    def around(self, q: Configuration) -> FunctionSet:
        """Choose pivots around another configuration.

        Parameters
        ----------
        q
            (nq,) regular configuration with closed loops [m, rad, unit quaternions].

        Returns
        -------
        FunctionSet
            Of the same chain, in the same coordinates.

        Raises
        ------
        UnsupportedError
            If the loops close at no displacement.
        """
        return FunctionSet(self.chain, self.coordinates, q)

    def around_home(self, state: str) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Tell from where Newton steps look for a state.

        Parameters
        ----------
        state
            ``"pose"`` of the platform, or configuration ``"q"``.

        Returns
        -------
        home, target, beside : numpy.ndarray
            (n,) state at home, (m,) pose or motor positions there, as the coordinates are, and (samples, n) states
            around it with closed loops [m, rad, unit quaternions].
        """
        chain = self.chain
        pose = np.zeros(0) if chain.platform is None else pin.SE3ToXYZQUAT(platform_pose(chain, chain.q_home))
        target = pose if self.coordinates == "platform" else chain.q_home[chain.motor_q_index]
        if state == "pose" and self.placed is not None:
            return pose, target, self.placed.plan.poses
        return chain.q_home, target, self.closed.samples

    @property
    def other_elbows(self) -> bool:
        """Whether motors may lead where the closed forms of legs, on the branch of home, do not."""
        return (
            self.placed is not None
            and self.coordinates == "motor"
            and any(leg.positions.elbow for leg in self.placed.legs)
        )

    @written_once
    def turning(self) -> BoolArray:
        """(nu,) whether a motor turns, whose position then counts modulo a turn where a pose tells it."""
        kinds = {
            joint.v.start: joint.kind
            for joint in tree_of(self.chain).joints
            if joint.v.stop - joint.v.start == 1
        }
        return np.array([kinds.get(int(k)) is JointKind.REVOLUTE for k in self.chain.motor_index])

    @written_once
    def driven(self) -> DrivenTree:
        """The whole tree, driven by its platform or its motors."""
        return driven_tree.drive_tree(self.closed, "motor" if self.coordinates == "motor" else "platform")

    @written_once
    def motor_driven(self) -> DrivenTree:
        """The whole tree, driven by its motors."""
        return self.driven if self.coordinates == "motor" else driven_tree.drive_tree(self.closed, "motor")

    @written_once
    def names(self) -> tuple[str, ...]:
        """Names of the functions."""
        if self.coordinates == "tree":
            return (*_STATE, *_BY_TREE, *_TREE)
        if self.coordinates == "motor":
            own = [name for name in _DRIVEN if name != "motor_jacobian"]
        elif self.placed is None:
            own = [*_DRIVEN]
        else:
            own = [*LEG_FUNCTIONS, *(BY_LEGS if self.leg_displacements else ())]
        steps = (equations + kind for equations in self._equations for kind in _STEPS)
        return (*own, *steps, *DERIVATIVES, *_BY_TREE, *_TREE)

    @written_once
    def _equations(self) -> dict[str, Callable[[], NewtonEquations]]:
        """What Newton steps solve, by name."""
        closing = {"closing": lambda: driven_tree.closing_equations(self.driven)}
        placed = self.placed
        if placed is not None:
            return {**closing, "forward_kinematics": lambda: platform_kinematics.pose_equations(placed)}
        if self.coordinates == "motor":
            return closing
        return {**closing, "motor_closing": lambda: driven_tree.closing_equations(self.motor_driven)}

    @written_once
    def leg_displacements(self) -> tuple[int, ...]:
        """Displacements of the geometry by which the legs can be differentiated in closed form."""
        if (
            self.placed is None or self.coordinates == "motor"
        ):  # motors held, the pose changes with the geometry
            return ()
        return leg_displacements(self.placed)

    @written_once
    def displacements(self) -> MobileDisplacements:
        """Displacements of the geometry along which there is a derivative."""
        return mobile_displacements(self.closed, self._drive, lambda: self._by_tree(_BY_TREE[0]))

    @written_once
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
            reduced = [leg.reduced for leg in self.placed.legs]
            if self.driven_platform is not None:
                reduced.append(self.driven_platform.reduced)
            return min(one.pivots.score for one in reduced)
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
        with writing():
            return self._function(name)

    def _function(self, name: str) -> ca.Function:
        if name not in self.names:
            raise InputError(f"name must be one of {', '.join(self.names)}, got {name!r}")
        if name == "platform_pose":
            self.chain.platform_link  # noqa: B018 - raises
        if name in _TREE:
            return _TREE[name](self.any_state)
        if name in _BY_TREE:
            return self._by_tree(name)
        if self.coordinates == "tree":
            return _STATE[name](self.closed)
        for kind, write in _STEPS.items():
            if name.removesuffix(kind) in self._equations:
                return write(name, self._equations[name.removesuffix(kind)]())
        if self.placed is not None:
            try:
                return leg_function(name, self.placed, self.driven_platform)
            except UnsupportedError:
                if name != "reactions":  # whose rows may need the whole configuration, or the norm over it
                    raise
        if name in DERIVATIVES:
            return dynamics_derivatives(self._function(name.removesuffix("_derivatives")), self.driven)
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
        with writing():
            return self._conditioning_of(name, function)

    def _conditioning_of(self, name: str, function: ca.Function) -> ca.Function | None:
        kind = name.removesuffix("_derivatives").removesuffix("_by_tree").removesuffix("_by_legs")
        if kind not in _HELD and kind not in _FOLLOWING:
            return None
        motors = kind in _HELD
        if self.placed is not None and function.name_in(0) == "pose":
            driving = None if self.driven_platform is None else self.driven_platform.reduced
            return conditioning.platform_conditioning(
                self.placed, motors=motors, reactions=kind == "reactions", driving=driving
            )
        held = self.held if name in _BY_TREE else None
        return conditioning.tree_conditioning(self.closed, self._drive, motors=motors, held=held)
