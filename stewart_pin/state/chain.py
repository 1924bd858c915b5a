"""The closed chain: a Pinocchio tree, the loops it lacks, the motors, and the platform. Immutable."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from stewart_pin.errors import MissingRoleError
from stewart_pin.model.description import (
    Coupling,
    JointKind,
    Loop,
    Mechanism,
    Note,
    Report,
    unknown_kind,
)
from stewart_pin.model.joint_physics import with_physics_of
from stewart_pin.model.leg_points import leg_points, leg_readings
from stewart_pin.model.loop_table import LoopTable, build_loop_table, support
from stewart_pin.model.roles import mark_motors, motor_candidates, platform_candidates
from stewart_pin.model.sizes import length_scale
from stewart_pin.model.tree import Limits, build_limits, link_frame, mass_unit, with_masses_in
from stewart_pin.state.base_motion import BaseMotion, MovingGround
from stewart_pin.state.describing import describe
from stewart_pin.state.generic import Generic, find_generic
from stewart_pin.state.joint_effects import JointEffects
from stewart_pin.state.limits import Judge
from stewart_pin.state.loop_verbs import ConstrainedDynamics, unknown_to_pinocchio
from stewart_pin.state.scratch import Pool, Scratch
from stewart_pin.state.state import State, checked_state
from stewart_pin.typing import ArrayLike, Configuration, FloatArray

_WHEREVER_HOME_IS = (
    ("loop_table", "limits", "motor_index", "motor_q_index", "platform_id", "tangent_names", "length_scale")
    + (
        "tangent_scale",
        "angle_mask",
        "hinge_q_index",
        "row_sizes",
        "row_scale",
        "inertia_scale",
        "upper_index",
        "carriers",
        "carrying",
        "passive_index",
        "row_scale",
        "twist_sizes",
        "rest",
        "motor_rows",
        "platform_joint",
    )
    + ("platform_support", "mass_unit", "mass_model", "_scaled_model", "scratches")
)
"""What a chain finds out about itself that is the same for every home."""


class _MassModel:
    """The model of a chain with its masses in another unit, and rotors as they stand in the model."""

    def __get__(self, chain: ClosedChain, owner: type | None = None) -> pin.Model:
        if chain.mass_unit == 1.0:
            vars(chain)["mass_model"] = chain.model  # from now on an attribute like others
            return chain.model
        found, rotors = chain._scaled_model, np.array(chain.model.armature) / chain.mass_unit
        if not np.array_equal(found.armature, rotors):  # set by hand since
            found.armature = rotors
        return found


@dataclass(frozen=True, eq=False, repr=False)
class ClosedChain:
    """A mechanism with loops, ready for computation.

    Attributes
    ----------
    mechanism
        The description: links, joints, loops.
    model
        Pinocchio model of the spanning tree (a body without a fixed base is a free-flyer joint).
    motors
        Names of the motor joints, in the order of motor coordinates and efforts.
    platform
        Name of the platform frame, or None; see `platform_link`.
    q_home
        (nq,) home configuration, with the loops closed [m, rad, unit quaternions].
    """

    mechanism: Mechanism
    model: pin.Model = field(repr=False)
    motors: tuple[str, ...]
    platform: str | None
    q_home: Configuration = field(repr=False)

    def __post_init__(self) -> None:
        home = np.array(self.q_home, dtype=float)
        home.setflags(write=False)
        object.__setattr__(self, "q_home", home)

    def __reduce__(self) -> tuple[Any, ...]:
        # What a chain has found out about itself stays here: scratch memory cannot travel, and the rest is found again.
        return ClosedChain, (self.mechanism, self.model, self.motors, self.platform, self.q_home)

    def __repr__(self) -> str:
        roles = f"{len(self.motors)} motors, platform {self.platform!r}"
        return f"<ClosedChain {self.name!r}: nq {self.nq}, nv {self.nv}, nc {self.nc}, {roles}>"

    def __str__(self) -> str:
        """Tell what it is, its motors with units and limits, its freedoms, and which entry of q is which joint."""
        return describe(self)

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self.mechanism.name

    @property
    def loops(self) -> tuple[Loop, ...]:
        """Loops that the spanning tree leaves open."""
        return self.mechanism.loops

    @property
    def couplings(self) -> tuple[Coupling, ...]:
        """Joints that move together by gears, belts or threads."""
        return self.mechanism.couplings

    @property
    def report(self) -> Report:
        """What the file held and the chain does not; print it."""
        return Report(self.mechanism.notes)

    @cached_property
    def nq(self) -> int:
        """Size of the configuration."""
        return self.model.nq

    @cached_property
    def nv(self) -> int:
        """Size of the tangent."""
        return self.model.nv

    @cached_property
    def nu(self) -> int:
        """Number of motors."""
        return len(self.motors)

    @cached_property
    def nc(self) -> int:
        """Number of rows of loops and couplings."""
        return self.loop_table.size

    @property
    def gravity(self) -> FloatArray:
        """(3,) acceleration of free fall in the world frame [m/s²]."""
        return np.array(self.model.gravity.linear)

    @cached_property
    def joint_effects(self) -> JointEffects:
        """What joints do by themselves, see `with_joint_physics`."""
        return JointEffects(self)

    @cached_property
    def loop_table(self) -> LoopTable:
        """Loops as arrays, for vectorised evaluation."""
        return build_loop_table(self.mechanism, self.model)

    @cached_property
    def limits(self) -> Limits:
        """What joints, motors and joints that close loops may do, as far as anything is stated; print it."""
        return build_limits(self.mechanism, self.model)

    @cached_property
    def judge(self) -> Judge:
        """Judge of these limits, see `limits_exceeded`."""
        return Judge(self)

    @cached_property
    def motor_index(self) -> np.ndarray:
        """(nu,) index of each motor in the tangent."""
        joints = [self.model.joints[self.model.getJointId(name)] for name in self.motors]
        return np.array([joint.idx_v for joint in joints], dtype=int)

    @cached_property
    def motor_q_index(self) -> np.ndarray:
        """(nu,) index of each motor in the configuration."""
        joints = [self.model.joints[self.model.getJointId(name)] for name in self.motors]
        return np.array([joint.idx_q for joint in joints], dtype=int)

    @cached_property
    def hinge_q_index(self) -> np.ndarray:
        """Index of each angle of a hinge in the configuration, whose whole turns count."""
        joints = self.model.joints[1:]
        return np.array(
            [j.idx_q for j in joints if j.nq == j.nv == 1 and self.angle_mask[j.idx_v]], dtype=int
        )

    @property
    def platform_link(self) -> str:
        """Name of the platform frame; an error that names the candidates where there is none."""
        if self.platform is None:
            raise self._missing("platform", platform_candidates(self.mechanism))
        return self.platform

    def require_motors(self) -> None:
        """Refuse a chain without motors.

        Raises
        ------
        MissingRoleError
            Naming the joints that could be motors.
        """
        if not self.motors:
            raise self._missing("motors", motor_candidates(self.mechanism))

    def _missing(self, role: str, candidates: tuple[str, ...]) -> MissingRoleError:
        """Say what is missing, with the candidates for the platform and for the motors where both are."""
        said = []
        if self.platform is None:
            links = ", ".join(platform_candidates(self.mechanism)) or "none: no link moves"
            said.append(f"platform=... or with_platform (candidates, best guess first: {links})")
        if not self.motors:
            joints = ", ".join(motor_candidates(self.mechanism)) or "none: no joint has one freedom"
            said.append(f"motors=[...] or with_motors (candidates, best guess first: {joints})")
        what = "no platform" if role == "platform" else "no motors"
        both = self.platform is None and not self.motors
        return MissingRoleError(
            f"'{self.name}' has {'neither platform nor motors' if both else what}, and the {role} "
            f"{'is' if role == 'platform' else 'are'} needed here; tell load {', and '.join(said)}",
            missing=role,
            candidates=candidates,
        )

    @cached_property
    def platform_id(self) -> int:
        """Pinocchio frame id of the platform."""
        return link_frame(self.model, self.platform_link)

    @cached_property
    def tangent_names(self) -> tuple[str, ...]:
        """Readable name of every tangent entry: the joint, with an axis when the joint has several."""
        names: list[str] = []
        for name, joint in zip(self.model.names[1:], self.model.joints[1:], strict=True):
            axes = {1: ("",), 3: (" wx", " wy", " wz"), 6: (" vx", " vy", " vz", " wx", " wy", " wz")}[
                joint.nv
            ]
            names.extend(name + axis for axis in axes)
        return tuple(names)

    @cached_property
    def length_scale(self) -> float:
        """Size of the robot: how far joints lie apart on one body, wherever the robot stands [m]; see `model.sizes`."""
        return length_scale(self.mechanism, self.platform)

    @cached_property
    def tangent_scale(self) -> FloatArray:
        """(nv,) natural size of each tangent entry: `length_scale` for lengths [m], 1 for angles [rad]."""
        return np.where(self.angle_mask, 1.0, self.length_scale)

    @cached_property
    def angle_mask(self) -> np.ndarray:
        """(nv,) mask of the tangent entries that are angles, dimensionless."""
        lengths = np.zeros(self.nv, dtype=bool)
        kinds = {joint.name: joint.kind for joint in self.mechanism.joints}
        for name, joint in zip(self.model.names[1:], self.model.joints[1:], strict=True):
            match kinds[name]:
                case JointKind.REVOLUTE | JointKind.SPHERICAL:
                    pass
                case JointKind.PRISMATIC:
                    lengths[joint.idx_v] = True
                case JointKind.FLOATING:
                    lengths[joint.idx_v : joint.idx_v + 3] = True
                case kind:
                    raise unknown_kind(f"joint '{name}'", kind, "the table of natural sizes")
        return ~lengths

    @cached_property
    def row_sizes(self) -> FloatArray:
        """(nc,) natural size of each loop row: `length_scale` for lengths [m], 1 for angles and their sines."""
        sizes = np.full(self.nc, self.length_scale)
        sizes[self.loop_table.angle.index] = 1.0
        coupling = self.loop_table.coupling
        sizes[coupling.index] = self.tangent_scale[coupling.v1]
        return sizes

    @cached_property
    def row_scale(self) -> FloatArray:
        """(nc, nv) by which a loop Jacobian is multiplied to stand in natural units [per m, m or 1]."""
        return self.tangent_scale / self.row_sizes[:, None]

    @cached_property
    def inertia_scale(self) -> FloatArray:
        """(nv, nv) by which an inertia matrix is multiplied to stand in natural units [m², m or 1]."""
        return np.outer(self.tangent_scale, self.tangent_scale)

    @cached_property
    def carrying(self) -> FloatArray:
        """(nv, nv) number of joints of the tree that both of two tangent entries carry, dimensionless."""
        return self.carriers.T @ self.carriers

    @cached_property
    def carriers(self) -> FloatArray:
        """(njoints, nv) 1 where a tangent entry moves what a joint of the tree carries, else 0, dimensionless."""
        carries = np.zeros((self.model.njoints, self.nv))
        for number, joint in enumerate(self.model.joints[1:], start=1):
            carries[number] = carries[self.model.parents[number]]
            carries[number, joint.idx_v : joint.idx_v + joint.nv] = 1.0
        return carries

    @cached_property
    def upper_index(self) -> np.ndarray:
        """(nv, nv) index of each entry of a symmetric matrix in the upper triangle of its flat array."""
        i, j = np.indices((self.nv, self.nv))
        return np.minimum(i, j) * self.nv + np.maximum(i, j)

    @cached_property
    def passive_index(self) -> np.ndarray:
        """(nv - nu,) index of every tangent entry that no motor drives."""
        return np.setdiff1d(np.arange(self.nv), self.motor_index)

    @cached_property
    def twist_sizes(self) -> FloatArray:
        """(6,) natural size of each component of a twist: `length_scale` for velocities [m], 1 for angular ones."""
        return np.repeat([self.length_scale, 1.0], 3)

    @cached_property
    def rest(self) -> FloatArray:
        """(nv,) zeros, read-only [m/s, rad/s]."""
        rest = np.zeros(self.nv)
        rest.setflags(write=False)
        return rest

    @cached_property
    def motor_rows(self) -> FloatArray:
        """(nu, nv) S, which picks the motor rates out of a tangent velocity, dimensionless."""
        return np.eye(self.nv)[self.motor_index]

    @cached_property
    def platform_joint(self) -> tuple[int, pin.SE3]:
        """Pinocchio joint that carries the platform frame, and the frame in it."""
        frame = self.model.frames[self.platform_id]
        return frame.parentJoint, pin.SE3(frame.placement)

    @cached_property
    def platform_support(self) -> FloatArray:
        """(nv,) 1 where a tangent entry moves the platform, else 0, dimensionless."""
        return support(self.model, self.platform_joint[0])

    @cached_property
    def mass_unit(self) -> float:
        """Power of two by which masses are counted inside: Pinocchio loses sums of masses below 2e-16 [kg]."""
        return mass_unit(inertia.mass for inertia in self.model.inertias)

    mass_model = _MassModel()
    """Pinocchio model with masses in units of `mass_unit`: `model` itself but for micro-robots."""

    @cached_property
    def _scaled_model(self) -> pin.Model:
        return with_masses_in(self.model, self.mass_unit)

    @cached_property
    def _home_quantities(self) -> dict[str, Any]:
        """What solvers ask of home, computed once."""
        home = State(self, self.q_home)
        wanted = ["largest_gap", "rows", *(["_pose", "P"] if self.platform is not None else [])]
        [getattr(home, name) for name in wanted]
        return dict(vars(home))

    def home_state(self) -> State:
        """Return home as a state of its own, with what solvers ask of it.

        Returns
        -------
        State
            At rest.
        """
        home = State(self, self.q_home)
        vars(home).update(self._home_quantities)
        return home

    @cached_property
    def scratches(self) -> Pool[Scratch]:
        """Memory for the states of this chain."""
        return Pool(lambda: Scratch(self.model))

    @cached_property
    def moving_ground(self) -> MovingGround:
        """The tree on a ground that moves, see `BaseMotion`."""
        return MovingGround(self)

    @cached_property
    def constrained_dynamics(self) -> Pool[ConstrainedDynamics]:
        """Memory for Pinocchio's constrained dynamics of this chain, see `known_to_pinocchio`."""
        return Pool(lambda: ConstrainedDynamics(self))

    @cached_property
    def known_to_pinocchio(self) -> bool:
        """Whether Pinocchio's constrained algorithms know every loop, and none is redundant."""
        return unknown_to_pinocchio(self) is None and self.generic.rank == self.nc

    @cached_property
    def found(self) -> dict[str, Any]:
        """What higher floors found out about this very chain, each once; a chain made of it starts with nothing."""
        return {}

    @cached_property
    def generic(self) -> Generic:
        """Ranks and freedoms that belong to the mechanism, found once at closed configurations near home."""
        return find_generic(self)

    def with_home(self, q: Configuration, *notes: Note) -> ClosedChain:
        """Set the home configuration of a chain that is being built.

        Parameters
        ----------
        q
            (nq,) configuration with closed loops [m, rad, unit quaternions].
        *notes
            What to add to the report.

        Returns
        -------
        ClosedChain
            The same chain, with what does not depend on home.
        """
        mechanism = self.mechanism
        if notes:
            mechanism = replace(mechanism, notes=(*mechanism.notes, *notes))
        moved = replace(self, q_home=q, mechanism=mechanism)
        kept = {name: value for name, value in self.__dict__.items() if name in _WHEREVER_HOME_IS}
        moved.__dict__.update(kept)
        return moved

    def at(
        self,
        q: ArrayLike,
        v: ArrayLike | None = None,
        a: ArrayLike | None = None,
        *,
        base_motion: BaseMotion | None = None,
    ) -> State:
        """Make a state of this chain, of which every quantity is computed once, when it is first asked for.

        Parameters
        ----------
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity; default: rest [m/s, rad/s].
        a
            (nv,) tangent acceleration; default: zero at rest, otherwise none [m/s², rad/s²].
        base_motion
            How the ground moves in an inertial frame, as of a ship; q, v, a and poses are relative to it, gravity and
            wrenches from outside stand in inertial axes; default: it rests.

        Returns
        -------
        State
            For every verb of one state.

        Raises
        ------
        InputError
            If a shape is wrong, an entry is not finite, a quaternion is not of unit length, or the motion is none.

        Examples
        --------
        >>> import stewart_pin as stp
        >>> chain = stp.load("stewart")
        >>> state = chain.at(chain.q_home)
        >>> stp.inverse_dynamics(state).tau_motor.round(2)
        array([49.99, 49.99, 49.99, 49.99, 49.99, 49.99])
        """
        return checked_state(self, q, v, a, base_motion)

    def described(self) -> Mechanism:
        """Return the description with this chain's own motors, platform, home, gravity and rotors written into it.

        The motors stand in their order, each where the description had one of them.

        Returns
        -------
        Mechanism
            What a writer needs.
        """
        home: dict[str, FloatArray] = {}
        for name, joint in zip(self.model.names[1:], self.model.joints[1:], strict=True):
            home[name] = self.q_home[joint.idx_q : joint.idx_q + joint.nq]
        x, y, z = map(float, self.gravity)
        return replace(
            with_physics_of(self.model, mark_motors(self.mechanism, self.motors)),
            platform=self.platform,
            home=home,
            home_is_guess=False,
            gravity=(x, y, z),
        )

    def leg_points(self) -> tuple[FloatArray, FloatArray]:
        """Find the ends of the legs that the motors drive.

        Returns
        -------
        base_points : numpy.ndarray
            (nu, 3) in the world frame [m].
        platform_points : numpy.ndarray
            (nu, 3) in the platform frame [m].
        """
        return leg_points(self.mechanism, self.motors, self.platform_link)

    @cached_property
    def leg_readings(self) -> tuple[FloatArray, FloatArray]:
        """What motors of legs read, length = offset + sign × reading: (nu,) signs and (nu,) offsets [m]."""
        return leg_readings(self.mechanism, self.motors, self.platform_link, self.q_home[self.motor_q_index])
