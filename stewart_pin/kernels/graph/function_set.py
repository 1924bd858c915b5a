"""CasADi functions of a chain by name, each written when it is asked for.

Two ways lead between the platform's motion and the motors. Where the chain comes apart into legs with closed forms,
the functions take the pose, in motor coordinates too: there Newton steps find it first. Elsewhere they take the
configuration, which Newton steps find first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Literal, NamedTuple

import casadi as ca
import numpy as np
import pinocchio as pin

from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.kernels.graph import (
    driven_platform,
    driven_tree,
    platform_dynamics,
    platform_kinematics,
)
from stewart_pin.kernels.graph.derivatives import dynamics_derivatives, platform_derivatives
from stewart_pin.kernels.graph.driven_platform import DrivenPlatform
from stewart_pin.kernels.graph.driven_tree import DrivenTree
from stewart_pin.kernels.graph.geometry_derivatives import (
    leg_displacements,
    leg_geometry_derivatives,
    tree_geometry_derivatives,
)
from stewart_pin.kernels.graph.held_motion import HeldMotion, MobileDisplacements, hold, mobile_displacements
from stewart_pin.kernels.graph.joint_effects import with_resting
from stewart_pin.kernels.graph.newton_steps import NewtonEquations, damped_step, double_step, stretch_step
from stewart_pin.kernels.graph.platform_dynamics import PlacedPlatform
from stewart_pin.kernels.graph.verbs import (
    ANY_STATE,
    BESIDE,
    DIFFERENTIABLE,
    VERBS,
    Solved,
    Verb,
    platform_conditioning,
    platform_push,
    tree_conditioning,
    tree_push,
)
from stewart_pin.kernels.graph.whole_tree import ClosedTree, close_tree
from stewart_pin.kernels.planning.joint_physics import has_friction
from stewart_pin.kernels.planning.plan import plan_platform
from stewart_pin.kernels.planning.samples import (
    closed_samples,
    pushes_idle,
    require_idle_without_effect,
    require_idle_without_physics,
    require_standing_frames,
    require_standing_points,
    telling_wrenches,
)
from stewart_pin.kernels.planning.tree import tree_of
from stewart_pin.mechanics.kinematics import platform_pose
from stewart_pin.model.joint_physics import FIELDS
from stewart_pin.programs.symbolic import drop, writing, written_once
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.configurations import turning_motors
from stewart_pin.state.outside import outside_places
from stewart_pin.typing import BoolArray, Configuration, FloatArray

Coordinates = Literal["platform", "motor", "tree"]

_ELSEWHERE = 2.0
"""How far from home arms start that stand stretched there, in radians and robot sizes."""
_STEPS: dict[str, Callable[[str, NewtonEquations], ca.Function]] = {
    "_double_step": double_step,
    "_stretch_step": stretch_step,
    "_step": damped_step,
}


class _Row(NamedTuple):
    """How a set writes a function, what that solves for, and whether it is of what is held as the geometry changes."""

    write: Callable[[FunctionSet], ca.Function]
    solves: Solved = "nothing"
    held: bool = False


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
    wrenches
        Links on which wrenches act from outside.
    ground_moves
        Whether the ground moves: then the whole tree is asked, for legs with closed forms stand on one at rest.

    Raises
    ------
    UnsupportedError
        If the coordinates do not determine the chain's motion or its efforts, or a joint or closure has no graph.
    InputError
        If a link is unknown.
    """

    def __init__(
        self,
        chain: ClosedChain,
        coordinates: Coordinates,
        around: Configuration | None = None,
        *,
        wrenches: Sequence[str] = (),
        ground_moves: bool = False,
    ) -> None:
        if coordinates == "platform":
            chain.platform_link  # noqa: B018 - raises
        elif coordinates == "motor":
            chain.require_motors()
        outside_places(chain, wrenches)
        self.chain = chain
        self._fields = {field: getattr(chain.model, field) for field in FIELDS}  # the model's own memory
        self._then = {field: values.tobytes() for field, values in self._fields.items()}
        self.wrenches, self.ground_moves = tuple(wrenches), ground_moves
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

    def require_same_joints(self) -> None:
        """Refuse to answer for joints as they are no more: armature, damping and friction of a model may be set.

        Raises
        ------
        UnsupportedError
            Naming the joint, the field and both values.
        """
        for field, values in self._fields.items():
            if values.tobytes() == self._then[field]:
                continue
            then = np.frombuffer(self._then[field])
            for k in np.flatnonzero(values != then):
                raise UnsupportedError(
                    f"{field} of '{self.chain.tangent_names[k]}' was {then[k]:g} when the kernels of "
                    f"{self.chain.name} were compiled and is {values[k]:g} now; compile them again"
                )

    def _begin(self) -> None:
        chain, coordinates, around = self.chain, self.coordinates, self._around
        if around is None:
            require_idle_without_physics(chain, told=coordinates == "tree")
        if coordinates != "tree" and around is None:
            require_idle_without_effect(chain, closed_samples(chain, count=1)[0])
            require_standing_points(chain, self.wrenches)
            try:
                if self.ground_moves:
                    raise UnsupportedError("the ground moves")
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
        placed = platform_dynamics.place_platform(plan_platform(self.chain, self.wrenches))
        if self.coordinates == "motor":
            platform_kinematics.motor_position_expressions(placed)  # refuses what its equations cannot say
            self.driven_platform = driven_platform.drive_platform(placed)
        self.placed = placed

    @written_once
    def closed(self) -> ClosedTree:
        """The whole tree with its loop rows eliminated."""
        closed = self.coordinates != "tree"
        return self._close(self._around, closed=closed)

    @written_once
    def any_state(self) -> ClosedTree:
        """The same for states that may be a little off closed loops."""
        return self.closed if self.coordinates == "tree" else self._close(None, closed=False)

    def _close(self, around: Configuration | None, *, closed: bool) -> ClosedTree:
        return close_tree(
            self.chain, around, closed=closed, wrenches=self.wrenches, ground_moves=self.ground_moves
        )

    @property
    def rubs(self) -> bool:
        """Whether joints have dry friction."""
        return has_friction(tree_of(self.chain))

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
        return FunctionSet(
            self.chain, self.coordinates, q, wrenches=self.wrenches, ground_moves=self.ground_moves
        )

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
            around it with closed loops, of arms elsewhere too [m, rad, unit quaternions].
        """
        chain = self.chain
        pose = np.zeros(0) if chain.platform is None else pin.SE3ToXYZQUAT(platform_pose(chain, chain.q_home))
        target = pose if self.coordinates == "platform" else chain.q_home[chain.motor_q_index]
        if state == "pose" and self.placed is not None:
            return pose, target, self.placed.plan.poses
        if chain.nc:
            return chain.q_home, target, self.closed.samples
        # A stretched arm: from beside home every way to some poses is blocked, from elsewhere none is.
        rng = np.random.default_rng(0)
        steps = (
            rng.uniform(-_ELSEWHERE, _ELSEWHERE, (len(self.closed.samples), chain.nv)) * chain.tangent_scale
        )
        far = [pin.integrate(chain.model, chain.q_home, step) for step in steps]
        return chain.q_home, target, np.vstack([self.closed.samples, *far])

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
        return turning_motors(self.chain)

    @written_once
    def driven(self) -> DrivenTree:
        """The whole tree, driven by its platform or its motors."""
        return driven_tree.drive_tree(self.closed, "motor" if self.coordinates == "motor" else "platform")

    @written_once
    def motor_driven(self) -> DrivenTree:
        """The whole tree, driven by its motors."""
        return self.driven if self.coordinates == "motor" else driven_tree.drive_tree(self.closed, "motor")

    @property
    def pivots(self) -> tuple[frozenset[tuple[int, int]], ...]:
        """What is divided by: rows and columns of loops, and of loops and drive."""
        reduced = (
            [self.closed.reduced]
            if self.coordinates == "tree"
            else [self.closed.reduced, self.driven.reduced]
        )
        return tuple(frozenset(one.pivots.places) for one in reduced)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the functions."""
        return (*self._rows, *self._leg_rows)

    def _row(self, name: str) -> _Row:
        row = self._rows.get(name) or self._leg_rows.get(name)
        if row is None:
            raise InputError(f"name must be one of {', '.join(self.names)}, got {name!r}")
        return row

    @written_once
    def _rows(self) -> dict[str, _Row]:
        """Functions by their names: verbs, Newton steps, derivatives, and what takes any state."""
        cls = FunctionSet  # rows that held this set would keep it, and its expressions, alive
        rows = {
            name: _Row(partial(cls._verb, verb=verb), verb.solves)
            for name, verb in (VERBS | BESIDE).items()
            if self._knows(verb)
        }
        if self.coordinates != "tree":
            for equations in self._equations:
                for kind in _STEPS:
                    rows[equations + kind] = _Row(partial(cls._step, equations=equations, kind=kind))
        for name in DIFFERENTIABLE:
            solves = VERBS[name].solves
            if self.coordinates != "tree":
                rows[f"{name}_derivatives"] = _Row(partial(cls._derivatives, name=name), solves)
            rows[f"{name}_by_tree"] = _Row(partial(cls._by_tree, name=name), solves, held=True)
        for name in ANY_STATE:
            rows[name] = _Row(partial(cls._any_state, name=name))
        return rows

    @written_once
    def _leg_rows(self) -> dict[str, _Row]:
        """Derivatives by the geometry in closed form; whether the legs have them takes a look at all they are."""
        names = DIFFERENTIABLE if self.leg_displacements else ()
        write = FunctionSet._by_legs
        return {f"{name}_by_legs": _Row(partial(write, name=name), VERBS[name].solves) for name in names}

    def _knows(self, verb: Verb) -> bool:
        if self.coordinates == "tree":
            return verb.state is not None
        if self.coordinates == "motor":
            return verb.driven is not None and not verb.of_poses
        return verb.driven is not None or (self.placed is not None and verb.legs is not None)

    def _verb(self, verb: Verb) -> ca.Function:
        if self.coordinates == "tree":
            assert verb.state is not None
            return verb.state(self.closed)
        if verb.solves == "reactions":
            require_standing_frames(self.chain)
        if self.placed is not None and verb.legs is not None:
            try:
                return self._by_closed_forms(verb)
            except UnsupportedError:
                if verb.solves != "reactions":  # which may need the norm over the whole configuration
                    raise
        assert verb.driven is not None
        return verb.driven(self.driven)

    def _by_closed_forms(self, verb: Verb) -> ca.Function:
        placed, driven = self.placed, self.driven_platform
        assert placed is not None and verb.legs is not None
        if driven is None:
            return verb.legs(placed)
        if verb.legs is platform_conditioning:
            return platform_conditioning(placed, driving=driven.reduced)
        return driven_platform.by_motors(driven, verb.legs(placed))

    def _derivatives(self, name: str) -> ca.Function:
        found = self._slopes(name)
        return with_resting(found, self._verb(VERBS["forward_dynamics"])) if self.rubs else found

    def _slopes(self, name: str) -> ca.Function:
        placed, driven, verb = self.placed, self.driven_platform, VERBS[name]
        if placed is None:
            return dynamics_derivatives(self._verb(verb), self.driven)
        assert verb.legs is not None
        function, plan = verb.legs(placed), placed.plan
        if plan.twists.shape[1] == len(plan.tree.motors):
            derivatives = platform_derivatives(placed, name)
        else:
            derivatives = dynamics_derivatives(function, None)
        if driven is None:
            return derivatives
        return driven_platform.derivatives_by_motors(driven, function, derivatives)

    def _by_legs(self, name: str) -> ca.Function:
        assert self.placed is not None
        found = leg_geometry_derivatives(self.placed, name)
        return with_resting(found, self._verb(VERBS["forward_dynamics"])) if self.rubs else found

    def _any_state(self, name: str) -> ca.Function:
        if name == "platform_pose":
            self.chain.platform_link  # noqa: B018 - raises
        return ANY_STATE[name](self.any_state)

    def _step(self, equations: str, kind: str) -> ca.Function:
        return _STEPS[kind](equations + kind, self._equations[equations]())

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
        size = np.tile(np.repeat([1.0, self.chain.length_scale], 3), len(self.wrenches))
        spun = np.tile(np.repeat([0.0, 1.0], 3), len(self.wrenches)) * self._told
        write = partial(self._by_tree, DIFFERENTIABLE[0])
        return mobile_displacements(self.closed, self._drive, write, size * (1 - spun))

    @written_once
    def held(self) -> HeldMotion:
        """What of a motion is held while the geometry changes."""
        return hold(self.closed, self._drive)

    @property
    def _drive(self) -> DrivenTree | None:
        return None if self.coordinates == "tree" else self.driven

    def _by_tree(self, name: str) -> ca.Function:
        if name not in self._written:
            found = tree_geometry_derivatives(self.held, self._drive, name)
            if self.rubs:
                forward, drive = VERBS["forward_dynamics"], self._drive
                assert forward.state is not None and forward.driven is not None
                found = with_resting(
                    found, forward.state(self.closed) if drive is None else forward.driven(drive)
                )
            self._written[name] = found
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
            return self._row(name).write(self)

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
        row = self._row(name)
        if row.solves == "nothing":
            return None
        motors = row.solves in ("motors", "reactions")
        with writing():
            if self.placed is not None and function.name_in(0) == "pose":
                driving = None if self.driven_platform is None else self.driven_platform.reduced
                return platform_conditioning(
                    self.placed, motors=motors, reactions=row.solves == "reactions", driving=driving
                )
            held = self.held if row.held else None
            return tree_conditioning(self.closed, self._drive, motors=motors, held=held)

    def push_of(self, name: str, function: ca.Function) -> ca.Function | None:
        """Write by how much wrenches push idle motions of which nothing says how they accelerate.

        Parameters
        ----------
        name
            One of `names`.
        function
            What it stands for.

        Returns
        -------
        casadi.Function or None
            Of the function's first input and its wrenches; None where that cannot be, or nothing is judged.
        """
        if self._row(name).solves == "nothing" or "wrenches" not in function.name_in():
            return None
        with writing():
            if not pushes_idle(self.chain, self.wrenches):
                return None
            if self.placed is not None and function.name_in(0) == "pose":
                return platform_push(self.placed, self._told)
            return tree_push(self.closed, self._told)

    @written_once
    def _told(self) -> FloatArray:
        """(n,) one for wrenches whose effect depends on where idle freedoms stand, where that is not given."""
        told = () if self.coordinates == "tree" else telling_wrenches(self.chain, self.wrenches)
        return np.repeat([float(link in told) for link in self.wrenches], 6)
