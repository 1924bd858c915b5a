"""One configuration, velocity and acceleration of one chain: each quantity is computed once, when first asked for."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from scipy.linalg import get_lapack_funcs

from stewart_pin.checks import as_array
from stewart_pin.errors import InputError, SingularityError, UnsupportedError
from stewart_pin.state.base_motion import BaseMotion
from stewart_pin.state.freedom import Freedom, Motions, split_motions
from stewart_pin.state.joint_effects import Effects
from stewart_pin.state.loop_rows import (
    Drive,
    MovingLoops,
    PlacedLoops,
    alignment_of,
    bias_of,
    gap_of,
    jacobian_of,
    jacobian_rate_of,
    move_loops,
    opposed_loops,
    place_loops,
    wrenches_of,
)
from stewart_pin.state.relative_motion import platform_jacobian, platform_jacobian_rate
from stewart_pin.state.scratch import PlacedJoints, once
from stewart_pin.tolerances import CONSISTENT, DIGITS, NO_INERTIA, ROUND_OFF, SHOWN, SINGULAR, UNIT_QUATERNION
from stewart_pin.typing import ArrayLike, Configuration, FloatArray, Tangent

if TYPE_CHECKING:
    from stewart_pin.state.chain import ClosedChain

(_potrf,) = get_lapack_funcs(("potrf",), dtype=np.float64)
_SMALL = CONSISTENT**2
"""Sum of squares below which no entry is larger than `CONSISTENT`."""


class State:
    """A state of a closed chain, made by ``chain.at(q, v, a)``; immutable.

    Shapes, finiteness and quaternions have been checked; whether the state keeps the loops closed is checked once, by
    the first verb that needs it. A state is for one thread at a time, a chain for any number.

    Attributes
    ----------
    chain
        The chain.
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity; at rest unless given [m/s, rad/s].
    a
        (nv,) tangent acceleration; zero for a state at rest, None for a moving one unless given [m/s², rad/s²].
    base_motion
        How the ground moves in an inertial frame, None: it rests. Positions, velocities and poses are relative to it.
    """

    chain: ClosedChain
    q: Configuration
    v: Tangent
    a: Tangent | None
    base_motion: BaseMotion | None

    def __init__(
        self,
        chain: ClosedChain,
        q: Configuration,
        v: Tangent | None = None,
        a: Tangent | None = None,
        base_motion: BaseMotion | None = None,
    ) -> None:
        own = self.__dict__
        own["chain"], own["q"], own["base_motion"] = chain, _frozen(q), base_motion
        if v is None:
            own["v"] = chain.rest
            own["a"] = chain.rest if a is None else _frozen(a)
        else:
            own["v"], own["a"] = _frozen(v), None if a is None else _frozen(a)

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(
            f"a State does not change; make another one by chain.at(...), with another {name}"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return State, (self.chain, self.q, self.v, self.a, self.base_motion)

    def __repr__(self) -> str:
        moving = "at rest" if not self.v.any() else f"largest rate {np.abs(self.v).max():.3g}"
        return f"State of '{self.chain.name}': {moving}, largest loop gap {self.largest_gap:.3g}"

    # -- placements and loops ------------------------------------------------------------------------------------

    @once
    def _placed(self) -> PlacedJoints:
        """Placements and Jacobians of the joints: copies, since Pinocchio's memory is of the size nv³."""
        scratches = self.chain.scratches
        scratch = scratches.take()
        placed = scratch.placed(self.q)
        scratches.give(scratch)
        return placed

    @once
    def _joints(self) -> FloatArray:
        """(6, nv) joint Jacobians at the world origin."""
        return self._placed.jacobian

    @once
    def loops(self) -> PlacedLoops:
        """Loop frames in the world."""
        return place_loops(self.chain.loop_table, self._placed)

    @once
    def gap(self) -> FloatArray:
        """(nc,) residual of the loops, in loop frame 1, then of the couplings [m; sines of angles; m or rad]."""
        return gap_of(self.chain.loop_table, self.loops, self.q)

    @once
    def row_wrenches(self) -> FloatArray:
        """(nc, 6) what a unit of each reaction does to link 2, about the world origin, in world axes [1, m]."""
        return wrenches_of(self.chain.loop_table, self.loops)

    @once
    def J_c(self) -> FloatArray:
        """(nc, nv) loop Jacobian, the rate of the gap per tangent velocity [m and 1 per m or rad]."""
        return jacobian_of(self.chain.loop_table, self.row_wrenches, self._joints, self.q)

    @once
    def alignment(self) -> tuple[FloatArray, FloatArray]:
        """(3 n,) by how much directions that loops hold together differ, and its (3 n, nv) Jacobian; dimensionless."""
        return alignment_of(self.chain.loop_table, self._placed, self._joints)

    @once
    def _joint_rates(self) -> FloatArray:
        """(6, nv) rates of the joint Jacobians."""
        scratches = self.chain.scratches
        scratch = scratches.take()
        rates = np.array(scratch.place_rates(self.q, self.v)[1])
        scratches.give(scratch)
        return rates

    @once
    def moving_loops(self) -> MovingLoops:
        """How the loop rows move along the velocity."""
        table = self.chain.loop_table
        return move_loops(table, self.loops, self._joints, self._joint_rates, self.v)

    @once
    def J_c_rate(self) -> FloatArray:
        """(nc, nv) rate of the loop Jacobian along the velocity [per s]."""
        given = self.row_wrenches, self.moving_loops, self._joints, self._joint_rates, self.q, self.v
        return jacobian_rate_of(self.chain.loop_table, *given)

    @once
    def loop_bias(self) -> FloatArray:
        """(nc,) second derivative of the gap that is there without acceleration [m/s² and 1/s²]."""
        if self.v is self.chain.rest or not self.v.any():
            return np.zeros(self.chain.nc)
        return bias_of(self.chain.loop_table, self.row_wrenches, self.moving_loops, self.q, self.v)

    @once
    def relative_gap(self) -> FloatArray:
        """(nc,) gap in robot sizes and radians, dimensionless."""
        return self.gap / self.chain.row_sizes

    @once
    def largest_gap(self) -> float:
        """Largest entry of the gap, in robot sizes or radians, dimensionless."""
        return float(np.abs(self.relative_gap).max()) if self.chain.nc else 0.0

    @once
    def round_off(self) -> float:
        """What round-off makes of a gap, in robot sizes, dimensionless: more where the robot stands far away.

        More after many turns as well: the sine of an angle is no better than the angle.
        """
        chain = self.chain
        reach = float(np.abs(self.loops.origin2).max(initial=0.0))
        turned = float(np.abs(self.q[chain.hinge_q_index]).max(initial=0.0))
        return ROUND_OFF * max(1.0, reach / chain.length_scale, turned)

    def joint_twists(self, v: Tangent) -> FloatArray:
        """Tell how what each joint of the tree carries moves.

        Parameters
        ----------
        v
            (nv,) tangent velocity [m/s, rad/s].

        Returns
        -------
        numpy.ndarray
            (njoints, 6) spatial velocity at the world origin, in world axes [m/s, rad/s].
        """
        return (self.chain.carriers * v) @ self._joints.T

    # -- platform ------------------------------------------------------------------------------------------------

    @property
    def pose(self) -> pin.SE3:
        """Platform frame in the world, oMp: a fresh object each time, for a placement cannot be made read-only."""
        return pin.SE3(self._pose)

    @once
    def _pose(self) -> pin.SE3:
        joint, placement = self.chain.platform_joint
        return pin.SE3(self._placed.rotation[joint], self._placed.translation[joint]) * placement

    @once
    def P(self) -> FloatArray:
        """(6, nv) platform Jacobian: twist [v; ω] of its origin, world axes, per tangent rate [m, rad per m or rad]."""
        return platform_jacobian(self.chain, self._joints, self._pose.translation)

    @once
    def P_rate(self) -> FloatArray:
        """(6, nv) its rate along the velocity [per s]."""
        return platform_jacobian_rate(
            self.chain, self._joints, self._joint_rates, self._pose.translation, self.v
        )

    @once
    def twist(self) -> FloatArray:
        """(6,) twist [v; ω] of the platform origin, world axes [m/s, rad/s]."""
        return self.P @ self.v

    @once
    def platform_bias(self) -> FloatArray:
        """(6,) acceleration of the platform origin, and angular, without tangent acceleration [m/s², rad/s²]."""
        return self.P_rate @ self.v if self.v.any() else np.zeros(6)

    @once
    def turning(self) -> FloatArray:
        """(nv, nv) Σ Jᵢᵀ Jᵢ in natural units, J v the angular velocity of each link in the world, dimensionless."""
        return self.chain.carrying * (self._turns.T @ self._turns)

    @once
    def turning_bias(self) -> FloatArray:
        """(nv,) Σ Jᵢᵀ J̇ᵢ v in natural units: angular accelerations without tangent acceleration [1/s²]."""
        rates = self._joint_rates[3:] * self.chain.tangent_scale
        return (self.chain.carrying * (self._turns.T @ rates)) @ (self.v / self.chain.tangent_scale)

    @once
    def _turns(self) -> FloatArray:
        """(3, nv) angular part of the joint Jacobians, in natural units, dimensionless."""
        return self._joints[3:] * self.chain.tangent_scale

    # -- dynamics of the tree ------------------------------------------------------------------------------------

    @once
    def M(self) -> FloatArray:
        """(nv, nv) inertia matrix of the spanning tree, both halves [kg, kg m, kg m²]."""
        # Pinocchio fills the upper triangle only.
        return np.ravel(self._by_pinocchio(pin.crba)).take(self.chain.upper_index)

    @once
    def nle(self) -> FloatArray:
        """(nv,) joint efforts without acceleration: against weight, Coriolis and centrifugal forces [N, N m]."""
        if self.base_motion is not None:
            return self._on_moving_ground(pin.rnea, "qva", self.chain.rest)
        return self._by_pinocchio(pin.nonLinearEffects, self.v)

    @once
    def weight(self) -> FloatArray:
        """(nv,) joint efforts against weight alone [N, N m]."""
        if self.base_motion is not None:
            return self._on_moving_ground(pin.computeGeneralizedGravity, "q")
        return self._by_pinocchio(pin.computeGeneralizedGravity)

    @once
    def coriolis(self) -> FloatArray:
        """(nv, nv) Coriolis matrix C of the tree; the rate of M is C + Cᵀ [kg/s, kg m/s, kg m²/s]."""
        nv = self.chain.nv
        if self.base_motion is not None:
            return self._on_moving_ground(pin.computeCoriolisMatrix, "qv")[:, 6:]
        return np.reshape(self._by_pinocchio(pin.computeCoriolisMatrix, self.v), (nv, nv))

    @once
    def effects(self) -> Effects | None:
        """What joints do by themselves: springs, damping, dry friction; None where they do nothing."""
        own, model = self.chain.joint_effects, self.chain.model
        if not (own.pushes or model.damping.any() or model.upperDryFrictionLimit.any()):
            return None
        return own.in_state(self)

    def tree_efforts(self, a: Tangent) -> FloatArray:
        """Compute joint efforts of the tree with open loops, M a + nle.

        Parameters
        ----------
        a
            (nv,) tangent acceleration [m/s², rad/s²].

        Returns
        -------
        numpy.ndarray
            (nv,) [N, N m].
        """
        if self.base_motion is not None:
            # Rotors turn with their joints alone, wherever the ground goes.
            return self._on_moving_ground(pin.rnea, "qva", a) + np.array(self.chain.model.armature) * a
        return self._by_pinocchio(pin.rnea, self.v, a)

    def _on_moving_ground(
        self, algorithm: Callable[..., FloatArray], given: str, a: Tangent | None = None
    ) -> FloatArray:
        """Ask Pinocchio about the tree on its moving ground; the rows of the joints, masses in kg."""
        assert self.base_motion is not None
        ground, scratch = self.chain.moving_ground, self.chain.moving_ground.scratches.take()
        whole = ground.state(self.base_motion, self.q, self.v, self.chain.rest if a is None else a)
        found = algorithm(ground.model, scratch.data, *whole[: len(given)])
        found = self.chain.mass_unit * np.array(found)[6:]
        ground.scratches.give(scratch)
        return found

    def _by_pinocchio(self, algorithm: Callable[..., FloatArray], *given: Tangent) -> FloatArray:
        """Ask Pinocchio about the tree; a copy of what it finds, masses in kg."""
        chain = self.chain
        scratch = chain.scratches.take()
        found = chain.mass_unit * algorithm(chain.mass_model, scratch.data, self.q, *given)
        chain.scratches.give(scratch)
        return found

    # -- freedom -------------------------------------------------------------------------------------------------

    @once
    def rows(self) -> FloatArray:
        """(nc, nv) loop Jacobian in natural units, dimensionless."""
        chain = self.chain
        return self.J_c * chain.row_scale

    @once
    def row_factors(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(nc, nc), (k,) and (nv, nv) singular value decomposition of these rows, dimensionless."""
        u, s, vt = np.linalg.svd(self.rows)
        return u, s, vt

    @once
    def motions(self) -> Motions:
        """The motions that the loops leave, exactly as many as the mechanism has."""
        return split_motions(self.rows, self.chain.generic.rank)

    @once
    def freedom(self) -> Freedom:
        """Which of the motions the motors hold, and which move nothing that matters."""
        return Freedom.of(self)

    @once
    def drive(self) -> Drive | None:
        """Rows of loops and motors factorised, where they determine every motion and are far from singular."""
        return Drive.of(self) if self.chain.generic.motors_determine and self.chain.nu else None

    @once
    def inertia(self) -> FloatArray:
        """(nv, nv) inertia matrix of the spanning tree per natural unit of motion [kg m²]."""
        return self.M * self.chain.inertia_scale

    @once
    def motor_motions(self) -> FloatArray:
        """(nv, nu) motion per motor rate, the loops closed; needs `drive`, dimensionless."""
        assert self.drive is not None
        return self.drive.motions()

    @once
    def drift(self) -> Tangent:
        """(nv,) acceleration that is there without that of the motors; needs `drive`, dimensionless."""
        assert self.drive is not None
        return self.drive.across(-self.loop_bias / self.chain.row_sizes)

    @once
    def motor_inertia(self) -> FloatArray | None:
        """(nu, nu) Cholesky factor of the inertia that motors feel; None where one has none; needs `drive` [kg m²]."""
        G = self.motor_motions
        factor, failed = _potrf(G.T @ (self.inertia @ G), lower=1)
        diagonal = factor.diagonal()
        return None if failed or diagonal.min() ** 2 <= NO_INERTIA * diagonal.max() ** 2 else factor

    # -- checks --------------------------------------------------------------------------------------------------

    def require_closed(self) -> State:
        """Refuse a configuration that leaves the loops open, or is too near a singularity of theirs.

        Returns
        -------
        State
            This one.

        Raises
        ------
        InputError
            If q leaves a loop open, or holds one with its axes against each other.
        SingularityError
            If the loops have lost a row here: what their reactions and velocities are is then undetermined.
        """
        self._closed  # noqa: B018 - raises
        return self

    def require_regular(self) -> State:
        """Refuse a configuration at a singularity of the loops; see `require_closed`.

        Returns
        -------
        State
            This one.

        Raises
        ------
        InputError
            As `require_closed`.
        SingularityError
            If the loops have lost a row here.
        """
        self._closed  # noqa: B018 - raises
        if self.drive is None or self.largest_gap > DIGITS * self.drive.regularity:
            self._regular  # noqa: B018 - raises
        return self

    def require_still_ground(self, verb: str) -> State:
        """Refuse a ground that moves, where a verb does not know of it.

        Parameters
        ----------
        verb
            Its name.

        Returns
        -------
        State
            This one.

        Raises
        ------
        UnsupportedError
            If the state has a `BaseMotion`.
        """
        if self.base_motion is not None:
            raise UnsupportedError(
                f"{verb} knows of no ground that moves; pass a state without base_motion, or ask inverse_dynamics, "
                "forward_dynamics, joint_reactions or operational_dynamics"
            )
        return self

    def require_moving(self) -> State:
        """Refuse a velocity that opens the loops; `require_regular` first.

        Returns
        -------
        State
            This one.

        Raises
        ------
        InputError
            As `require_closed`, or if v opens a loop.
        SingularityError
            If the loops have lost a row here.
        """
        self.require_regular()._moving  # noqa: B018 - raises
        return self

    def require_accelerating(self) -> Tangent:
        """Refuse an acceleration that is missing or opens the loops; `require_moving` first.

        Returns
        -------
        numpy.ndarray
            (nv,) the acceleration [m/s², rad/s²].

        Raises
        ------
        InputError
            As `require_moving`, or if there is no acceleration, or it opens a loop.
        SingularityError
            If the loops have lost a row here.
        """
        self.require_moving()
        return self._accelerating

    def opposed(self) -> list[int]:
        """Find loops that are closed with their axes against each other.

        Returns
        -------
        list of int
            Numbers of these loops.
        """
        return opposed_loops(self.chain.loop_table, self._placed)

    @once
    def _closed(self) -> bool:
        worst = self.largest_gap
        if worst > CONSISTENT:
            row = int(np.argmax(np.abs(self.relative_gap)))
            raise InputError(
                f"q does not keep the loops closed: {abs(self.gap[row]):.3g} is left over in "
                f"{self.chain.loop_table.names[row]}; see close_loops"
            )
        opposed = self.opposed()
        if opposed:
            raise InputError(
                f"q holds loop '{self.chain.loops[opposed[0]].name}' with its axes against each other; see close_loops"
            )
        return True

    @once
    def _regular(self) -> bool:
        measure, usual = self.motions.smallest, self.chain.generic.usual_loops
        if measure < SINGULAR * usual:
            raise loop_singularity(self)
        # Near a singularity the error of a configuration counts more than at ordinary ones.
        if self.largest_gap > max(DIGITS * measure, self.round_off):
            raise SingularityError(
                f"q leaves the loops open by {self.largest_gap:.3g} robot sizes or radians, too much so near a "
                f"singularity of theirs (smallest singular value {measure:.3g}); see close_loops",
                smallest_singular_value=measure,
            )
        return True

    @once
    def _moving(self) -> bool:
        left = self.rows.dot(self.v / self.chain.tangent_scale)
        if not left.dot(left) <= _SMALL:
            _require_small(self, left, self.v, "v")
        return True

    @once
    def _accelerating(self) -> Tangent:
        a = self.a
        if a is None:
            raise InputError(
                "the state has a velocity, but no acceleration; pass a, or chain.at(q, v, a); see platform_motion"
            )
        left = self.rows.dot(a / self.chain.tangent_scale) + self.loop_bias / self.chain.row_sizes
        if not left.dot(left) <= _SMALL:
            _require_small(self, left, a, "a")
        return a


def as_state(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    a: ArrayLike | None = None,
) -> State:
    """Take what a verb of one state is given: a state, or a chain with q, v, a.

    Parameters
    ----------
    chain
        State, or closed chain.
    q
        (nq,) configuration, with a chain [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].
    a
        (nv,) tangent acceleration [m/s², rad/s²].

    Returns
    -------
    State
        The state.

    Raises
    ------
    InputError
        If it is neither, or a state comes with further arguments.
    """
    if isinstance(chain, State):
        if not (q is None and v is None and a is None):
            raise InputError(
                "a state holds q, v and a already; pass the state alone, all else by its name, or chain, q, v, a"
            )
        return chain
    if not hasattr(chain, "loop_table"):
        raise InputError(
            f"the first argument must be a ClosedChain (see load) or a State (chain.at), got {type(chain).__name__}"
        )
    if q is None:
        raise InputError("q is missing; pass chain, q, v, a, or a state made by chain.at(q, v, a)")
    return checked_state(chain, q, v, a)


def checked_state(
    chain: ClosedChain,
    q: ArrayLike,
    v: ArrayLike | None = None,
    a: ArrayLike | None = None,
    base_motion: BaseMotion | None = None,
) -> State:
    """Check what makes a state; see `ClosedChain.at`.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].
    a
        (nv,) tangent acceleration [m/s², rad/s²].
    base_motion
        How the ground moves; default: it rests.

    Returns
    -------
    State
        The state.

    Raises
    ------
    InputError
        If a shape is wrong, an entry is not finite, a quaternion is not of unit length, or the motion is none.
    """
    if base_motion is not None and not isinstance(base_motion, BaseMotion):
        raise InputError(f"base_motion must be a BaseMotion, got {type(base_motion).__name__}")
    return State(
        chain,
        as_configuration(chain, "q", q),
        None if v is None else _checked("v", v, chain.nv),
        None if a is None else _checked("a", a, chain.nv),
        base_motion,
    )


def as_configuration(chain: ClosedChain, name: str, q: ArrayLike) -> Configuration:
    """Check a configuration at the door.

    Parameters
    ----------
    chain
        Closed chain.
    name
        Name of the argument, for the message.
    q
        (nq,) what the caller passed [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nq,) the configuration as float64 [m, rad, unit quaternions].

    Raises
    ------
    InputError
        If the shape is wrong, an entry is not finite, or a quaternion is not of unit length.
    """
    q = _checked(name, q, chain.nq)
    if not pin.isNormalized(chain.model, q, UNIT_QUATERNION):
        raise InputError(
            f"{name} holds a quaternion that is not of unit length; pass pinocchio.normalize(model, q)"
        )
    return q


def _checked(name: str, value: ArrayLike, size: int) -> FloatArray:
    # The usual case at a third of the cost: a sum of squares is finite only if every entry is.
    if (
        type(value) is np.ndarray
        and value.dtype == np.float64
        and value.shape == (size,)
        and math.isfinite(np.vdot(value, value))
    ):
        return value
    return as_array(name, value, (size,))


def as_chain(chain: ClosedChain) -> ClosedChain:
    """Check a chain at the door.

    Parameters
    ----------
    chain
        What the caller passed.

    Returns
    -------
    ClosedChain
        The chain.

    Raises
    ------
    InputError
        If it is none.
    """
    if isinstance(chain, State):
        raise InputError(
            "the first argument must be a ClosedChain (see load), got State; pass state.chain, and state.q"
        )
    if not hasattr(chain, "loop_table"):
        raise InputError(f"the first argument must be a ClosedChain (see load), got {type(chain).__name__}")
    return chain


def loop_singularity(state: State) -> SingularityError:
    """Describe a configuration at which the loops have lost a row.

    Parameters
    ----------
    state
        The state.

    Returns
    -------
    SingularityError
        With the motion that is gained.
    """
    chain, motions = state.chain, state.motions
    direction = motions.gained * chain.tangent_scale
    direction = direction / np.abs(direction).max()
    return SingularityError(
        f"the loops are singular here: a row depends on the others (smallest singular value {motions.smallest:.3g}), "
        f"and the motion {named_motion(chain, direction)} is gained; move away from this configuration",
        smallest_singular_value=motions.smallest,
        direction=direction,
        names=chain.tangent_names,
    )


def named_motion(chain: ClosedChain, direction: FloatArray) -> str:
    """Spell out the largest entries of a motion.

    Parameters
    ----------
    chain
        Closed chain.
    direction
        (nv,) the motion [m, rad].

    Returns
    -------
    str
        Tangent names with their values.
    """
    order = np.argsort(-np.abs(direction))[:6]
    largest = np.abs(direction).max()
    return ", ".join(
        f"{chain.tangent_names[k]} {direction[k]:+.3g}" for k in order if abs(direction[k]) > SHOWN * largest
    )


def _require_small(state: State, left: FloatArray, value: Tangent, name: str) -> None:
    """Refuse what opens the loops, told relative to its size where that is more than one."""
    chain = state.chain
    worst = float(np.abs(left).max())
    if worst > CONSISTENT * max(1.0, float(np.abs(value / chain.tangent_scale).max())):
        row = int(np.argmax(np.abs(left)))
        raise InputError(
            f"{name} does not keep the loops closed: {abs(left[row]) * chain.row_sizes[row]:.3g} is left over in "
            f"{chain.loop_table.names[row]}; see platform_motion"
        )


def _frozen(array: FloatArray) -> FloatArray:
    copy = np.array(array, dtype=float)
    copy.setflags(write=False)
    return copy
