"""The chain as a simulation sees it: acceleration, projection onto closed loops, energy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from scipy.linalg import eigh, get_lapack_funcs, qr

from stewart_pin.errors import ClosureError, UnsupportedError
from stewart_pin.kernels.choosing import SimulationKernels
from stewart_pin.mechanics.forward_dynamics import forward_dynamics
from stewart_pin.mechanics.inverse_dynamics import require_idle_inertia
from stewart_pin.model.joint_physics import read_fields, write_fields
from stewart_pin.motion.simulation.friction import Friction, FrictionMemory
from stewart_pin.programs.arrays import SingleState
from stewart_pin.programs.status import StateStatus
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.loop_verbs import constraint_models
from stewart_pin.state.state import State
from stewart_pin.tolerances import CLOSED, NO_INERTIA
from stewart_pin.typing import Configuration, FloatArray, Tangent

_factorise, _solve = get_lapack_funcs(("potrf", "potrs"), dtype=np.float64)
_MAX_STEPS = 20
"""Newton steps of one projection: with a sensible time step one or two are enough."""
_STUCK = 100.0
"""Part of round-off up to which loops may stay open whose joints are stuck."""
_DEPENDENT = 1e-9
"""Singular value, relative to the largest, of rows that say the same: loops whose joints are stuck."""


class PlantMemory(NamedTuple):
    """Ways of computing that a plant has chosen.

    Attributes
    ----------
    rows
        (rank,) index of the loop rows that stand for all.
    kernel, projector, constrained, weightless
        Which ways are in use.
    friction
        What slips and what is stuck, or None.
    """

    rows: np.ndarray
    kernel: bool
    projector: bool
    constrained: bool
    weightless: bool
    friction: FrictionMemory | None


class JointForces(NamedTuple):
    """What the joints of a plant do by themselves in a state.

    Attributes
    ----------
    state
        The state.
    efforts
        (nv,) joint efforts of springs, dampers, and friction of what slips [N, N m].
    damping
        What their dampers turn into heat [W].
    friction
        (k,) what each coordinate with dry friction does [W].
    """

    state: State
    efforts: Tangent
    damping: float
    friction: FloatArray


class Plant:
    """Mass and loops of one simulated chain.

    Between two calls of `select_rows` a redundant loop is represented by rows that suffice, chosen there: off the
    closed loops, where the stages of an integrator lie, redundant rows contradict each other.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration with closed loops [m, rad, unit quaternions].
    v
        (nv,) tangent velocity that keeps them closed [m/s, rad/s].
    motor_inertia
        (nu,) added to the mass matrix [kg or kg m²].
    kernels
        Acceleration and projection from compiled code, or None. They are used where they give what the careful ways
        give.
    motor_friction
        (nu,) added to the dry friction of the motors' joints; default: none [N or N m].

    Attributes
    ----------
    friction
        Coordinates with dry friction, or None.
    """

    def __init__(
        self,
        chain: ClosedChain,
        q: Configuration,
        v: Tangent,
        motor_inertia: FloatArray,
        kernels: SimulationKernels | None = None,
        motor_friction: FloatArray | None = None,
    ) -> None:
        self.chain = _with_motors(chain, motor_inertia, motor_friction)
        self.model = self.chain.model
        self._data = pin.Data(self.model)
        self._scale, self._sizes = chain.tangent_scale, chain.row_sizes
        self._tau = np.zeros(chain.nv)
        effects = State(self.chain, q, v).effects
        self._acts = effects is not None
        rubs = effects is not None and effects.rubbing.limits.size
        self.friction = Friction(self.chain) if rubs else None
        self._bodies, self._rotors = _without_rotors(self.chain.mass_model)
        self.rows = np.arange(chain.nc)
        self._candidates = kernels
        self._prepare(q, v, own_rotors=self.chain is not chain)

    @property
    def memory(self) -> PlantMemory:
        """Ways of computing chosen so far."""
        return PlantMemory(
            self.rows,
            self._kernel is not None,
            self._projector is not None,
            self._constrained is not None,
            self._weightless,
            None if self.friction is None else self.friction.memory,
        )

    def recall(self, memory: PlantMemory) -> None:
        """Go on with ways chosen earlier.

        Parameters
        ----------
        memory
            Of the plant of an earlier run.
        """
        candidates = self._candidates
        self.rows, self._weightless = memory.rows, memory.weightless
        self._kernel = candidates.acceleration if memory.kernel and candidates is not None else None
        self._projector = candidates.projection if memory.projector and candidates is not None else None
        if memory.constrained and self._constrained is None:
            self._make_constrained()
        elif not memory.constrained:
            self._constrained = None
        if self.friction is not None and memory.friction is not None:
            self.friction.recall(memory.friction)

    def _fits(self, q: Configuration, v: Tangent, expected: Tangent) -> bool:
        a = self.acceleration(q, v, np.zeros(self.chain.nu))
        # Round-off of a chain of factorisations, with room; a chain without mass gives NaN or nonsense.
        return bool(np.abs(a - expected).max(initial=0.0) < 1e-8 * max(1.0, float(np.abs(expected).max())))

    def _leave_wrong_projector(self, q: Configuration, v: Tangent) -> None:
        """Compare what compiled code makes of a velocity that opens the loops, and leave it where that is wrong."""
        projector, self._projector = self._projector, None
        if projector is None:
            return
        open_v = v + self._scale
        expected, found = self.project(q, open_v)[1], projector(q, open_v)[1]
        off = np.abs((found - expected) / self._scale).max(initial=0.0)
        usual = max(1.0, float(np.abs(open_v / self._scale).max(initial=0.0)))
        if projector.status is StateStatus.OK and off < 1e-8 * usual:
            self._projector = projector

    def _prepare(self, q: Configuration, v: Tangent, *, own_rotors: bool) -> None:
        state = State(self.chain, q, v)
        self.select_rows(state)
        # The careful verb knows every reason why there is no acceleration, and says which.
        expected = forward_dynamics(state, tau_motor=np.zeros(self.chain.nu)).a
        self._constrained: tuple[pin.StdVec_RigidConstraintModel, pin.StdVec_RigidConstraintData] | None = (
            None
        )
        self._weightless = False
        self._kernel: SingleState | None = None
        self._projector: SingleState | None = None
        if self._candidates is not None:
            # Compiled code knows the rotors of the model, not those of the simulation, and no springs and dampers.
            if not own_rotors and not self._acts:
                self._kernel = self._candidates.acceleration
                if not self._fits(q, v, expected):
                    self._kernel = None
            self._projector = self._candidates.projection
            self._leave_wrong_projector(q, v)
        if self._try_constraint_dynamics(q, v, expected):
            return
        saddle = self._saddle(state, state.J_c[self.rows])
        self._weightless = bool(np.linalg.matrix_rank(saddle, rtol=NO_INERTIA) < saddle.shape[0])

    def _try_constraint_dynamics(self, q: Configuration, v: Tangent, expected: Tangent) -> bool:
        """Use Pinocchio's own algorithm where it gives what the projection gives."""
        if self._acts or self.rows.size < self.chain.nc:
            return False
        try:
            self._make_constrained()
        except UnsupportedError:
            return False
        kernel, self._kernel = self._kernel, None
        fits = self._fits(q, v, expected)
        self._kernel = kernel
        if not fits:
            self._constrained = None
        return fits

    def _make_constrained(self) -> None:
        models = constraint_models(self.chain)
        datas = pin.StdVec_RigidConstraintData()
        for model in models:
            datas.append(model.createData())
        pin.initConstraintDynamics(self.model, self._data, models, datas)
        self._settings = pin.ProximalSettings(1e-14, 0.0, 1)
        self._constrained = (models, datas)

    def watch(self, q: Configuration, v: Tangent) -> None:
        """Choose loop rows anew, and leave kernels for good where their fixed pivots have lost too many digits.

        Parameters
        ----------
        q
            (nq,) configuration with closed loops [m, rad, unit quaternions].
        v
            (nv,) tangent velocity that keeps them closed [m/s, rad/s].
        """
        state = State(self.chain, q, v)
        self.select_rows(state)
        if self.friction is not None:
            self.friction.choose(state)
        if self._kernel is not None:
            kernel, self._kernel = self._kernel, None
            careful = self.acceleration(q, v, np.zeros(self.chain.nu))
            self._kernel = kernel
            if not self._fits(q, v, careful):
                self._kernel = None
        self._leave_wrong_projector(q, v)

    def select_rows(self, state: State) -> None:
        """Choose loop rows that imply the others here: as many as the mechanism has independent ones.

        Parameters
        ----------
        state
            State with closed loops.
        """
        rank = self.chain.generic.rank
        if rank < self.chain.nc:
            decomposition: Any = qr(state.rows.T, mode="economic", pivoting=True)
            self.rows = np.sort(decomposition[2][:rank])

    @property
    def weightless(self) -> bool:
        """Whether some motion of the chain has no inertia."""
        return self._weightless

    def joint_forces(self, q: Configuration, v: Tangent) -> JointForces | None:
        """Compute what springs, dampers, and dry friction of what slips do.

        Parameters
        ----------
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].

        Returns
        -------
        JointForces or None
            None where joints do nothing by themselves.
        """
        if not self._acts:
            return None
        state = State(self.chain, q, v)
        effects = state.effects
        assert effects is not None
        if self._weightless:
            require_idle_inertia(state, effects.smooth)
        efforts, heat = effects.smooth, np.zeros(0)
        if self.friction is not None:
            slips, heat = self.friction.slipping(state)
            efforts = efforts + slips
        return JointForces(state, efforts, -float(effects.viscous @ v), heat)

    def acceleration(
        self,
        q: Configuration,
        v: Tangent,
        tau_motor: FloatArray,
        pushed: FloatArray | None = None,
        joints: JointForces | None = None,
        *,
        held: bool = True,
    ) -> Tangent:
        """Compute the acceleration under motor efforts.

        Parameters
        ----------
        q
            (nq,) configuration, loops closed or nearly so [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        tau_motor
            (nu,) efforts on the motor coordinates [N or N m].
        pushed
            (nv,) joint efforts of wrenches from outside, which compiled code does not take; or None [N, N m].
        joints
            `joint_forces` of the state, if they are known.
        held
            Whether what is stuck stays so.

        Returns
        -------
        numpy.ndarray
            (nv,) tangent acceleration; not finite where the equations are singular [m/s², rad/s²].
        """
        if self._kernel is not None and pushed is None:
            a, _ = self._kernel(q, v, tau_motor)
            if self._kernel.status is StateStatus.OK:
                return a
            # A pivot has grown small, or the state is singular: the careful way knows.
        tau = self._tau
        tau[self.chain.motor_index] = tau_motor
        if pushed is not None:
            tau = tau + pushed
        if self._constrained is not None:
            return np.array(
                pin.constraintDynamics(self.model, self._data, q, v, tau, *self._constrained, self._settings)
            )
        joints = joints or self.joint_forces(q, v)
        state = State(self.chain, q, v) if joints is None else joints.state
        if joints is not None:
            tau = tau + joints.efforts
        stuck = self.friction if held and self.friction is not None and self.friction.firm.any() else None
        if stuck is not None and stuck.still:
            return np.zeros(self.chain.nv)
        rows, bias = state.J_c[self.rows], state.loop_bias[self.rows]
        if stuck is not None:
            kept, kept_bias = stuck.held(state)
            rows, bias = np.vstack([rows, kept]), np.concatenate([bias, kept_bias])
        saddle = self._saddle(state, rows)
        right = np.concatenate([tau - state.nle, -bias])
        if self._weightless:
            a = np.linalg.lstsq(saddle, right, rcond=NO_INERTIA)[0][: self.chain.nv]
        else:
            try:
                a = np.linalg.solve(saddle, right)[: self.chain.nv]
            except np.linalg.LinAlgError:
                return np.full(self.chain.nv, np.nan)
        if stuck is not None:
            a[stuck.stuck_entries] = 0.0
        return a

    def fastest(
        self, q: Configuration, v: Tangent, viscous: FloatArray
    ) -> tuple[tuple[float, str], tuple[float, str]]:
        """Find the fastest decay and the fastest swing that dampers and springs make of motions of the chain.

        Parameters
        ----------
        q
            (nq,) configuration with closed loops [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        viscous
            (nu,) viscous friction of the motors besides [N s/m or N m s/rad].

        Returns
        -------
        decay, swing : tuple
            Rate [1/s, rad/s] of each, and the joint that moves most in it; zero without dampers, or springs.
        """
        nothing = (0.0, "")
        if self._weightless or not (self._acts or viscous.any()):
            return nothing, nothing
        state, chain = State(self.chain, q, v), self.chain
        by_q, by_v = (np.zeros((2, chain.nv, chain.nv))) if state.effects is None else state.effects.slopes()
        by_v[chain.motor_index, chain.motor_index] -= viscous
        motions, scale = state.motions.basis, chain.tangent_scale
        if not motions.size:
            return nothing, nothing
        inertia, found = motions.T @ state.inertia @ motions, []
        for slope, power in ((by_v, 1.0), (by_q, 0.5)):
            across = -motions.T @ ((slope + slope.T) / 2 * np.outer(scale, scale)) @ motions
            try:
                values, modes = eigh(across, inertia)
            except np.linalg.LinAlgError:  # all but weightless: the account of energy has to tell
                return nothing, nothing
            most = int(np.argmax(np.abs(motions @ modes[:, -1])))
            found.append((max(0.0, float(values[-1])) ** power, str(chain.tangent_names[most])))
        return found[0], found[1]

    def _saddle(self, state: State, rows: FloatArray) -> FloatArray:
        """Mass matrix and rows that the motion keeps: [[M, -Jᵀ], [J, 0]]."""
        nv = self.chain.nv
        saddle = np.zeros((nv + len(rows), nv + len(rows)))
        saddle[:nv, :nv] = state.M
        saddle[nv:, :nv], saddle[:nv, nv:] = rows, -rows.T
        return saddle

    def kept(self, state: State) -> FloatArray:
        """Give the rows that a motion keeps, of loops and of what is stuck.

        Parameters
        ----------
        state
            The state.

        Returns
        -------
        numpy.ndarray
            (n, nv) in natural units, dimensionless.
        """
        rows, stuck = state.rows[self.rows], self.friction
        if stuck is None or not stuck.chosen.size:
            return rows
        return np.vstack([rows, stuck.held_rows(state)])

    def astray(self, state: State, moved: FloatArray) -> FloatArray:
        """Measure how far what is stuck has moved, one entry per row of `kept` after those of loops.

        Parameters
        ----------
        state
            The state.
        moved
            (nv,) displacement in natural units since it stuck, dimensionless.

        Returns
        -------
        numpy.ndarray
            (n,) dimensionless.
        """
        stuck = self.friction
        if stuck is None or not stuck.chosen.size:
            return np.zeros(0)
        tree = stuck.chosen < len(stuck.entries)
        away = stuck.astray(state)
        away[tree] = moved[stuck.entries[stuck.chosen[tree]]]
        return away

    @property
    def still(self) -> bool:
        """Whether friction lets nothing move."""
        return self.friction is not None and self.friction.still and bool(self.friction.firm.any())

    def project(self, q: Configuration, v: Tangent) -> tuple[Configuration, Tangent, float]:
        """Close the loops by the shortest displacement, and make the velocity keep them closed.

        One factorisation of the loop Jacobian serves both, and further steps while they converge.

        Parameters
        ----------
        q
            (nq,) configuration, loops nearly closed [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].

        Returns
        -------
        q : numpy.ndarray
            (nq,) closed to round-off [m, rad, unit quaternions].
        v : numpy.ndarray
            (nv,) with J_c v = 0 [m/s, rad/s].
        gap : float
            Largest entry left of the gap [m].

        Raises
        ------
        ClosureError
            If the loops do not close.
        """
        if self.friction is not None and self.friction.firm.any():
            return self._project_stuck(self.friction, q, v)
        if self._projector is not None:
            closed_q, closed_v, gap = self._projector(q, v)
            if self._projector.status is StateStatus.OK:
                return closed_q, closed_v, float(gap[0])
            # Farther from closed, singular, or the step was too long: the careful way knows.
        state = State(self.chain, q)
        if not self.rows.size:
            return q, v, 0.0
        spread = self._spread(state)
        v = v - spread(state.J_c[self.rows] @ v)
        worst, before = state.largest_gap, np.inf
        for count in range(_MAX_STEPS):
            # On to round-off: what each of thousands of steps left over would add up.
            if worst <= CLOSED / 10 or (worst <= max(CLOSED, state.round_off) and worst > before / 10):
                if count > 1:  # the loops stand elsewhere than where v was projected
                    v = v - self._spread(state)(state.J_c[self.rows] @ v)
                return np.array(state.q), v, float(np.abs(state.gap).max())
            step = -spread(state.gap[self.rows])
            state = State(self.chain, pin.integrate(self.model, state.q, step))
            before, worst = worst, state.largest_gap
            # A factorisation from before the step does as long as it wins a factor of ten.
            if count and not worst < before / 10:
                spread = self._spread(state)
        raise self._open(state)

    def _open(self, state: State) -> ClosureError:
        row = int(np.argmax(np.abs(state.relative_gap))) if np.isfinite(state.gap).all() else 0
        return ClosureError(
            f"{self.chain.loop_table.names[row]} does not close: {abs(state.gap[row]):.3g} left",
            residual=float(np.abs(state.gap).max()),
            iterations=_MAX_STEPS,
            q=state.q,
        )

    def _project_stuck(
        self, friction: Friction, q: Configuration, v: Tangent
    ) -> tuple[Configuration, Tangent, float]:
        """Do the same while some joints are stuck: those of the tree to the bit."""
        state = State(self.chain, q)
        gap = float(np.abs(state.gap).max(initial=0.0))
        if friction.still:
            return q, np.zeros(self.chain.nv), gap
        scale, fixed, before = self._scale, friction.stuck_entries, np.inf
        for _ in range(_MAX_STEPS):
            rows = self.kept(state)
            rows[:, fixed] = 0.0
            left = np.concatenate([state.relative_gap[self.rows], friction.astray(state)])
            worst = float(np.abs(left).max(initial=0.0))
            # Loops that friction all but holds leave more of what is open: their joints stay where they are.
            enough = _STUCK * max(CLOSED, state.round_off)
            if worst <= CLOSED / 10 or (worst <= enough and worst > before / 10):
                along = v / scale
                along[fixed] = 0.0
                along -= np.linalg.lstsq(rows, rows @ along, rcond=_DEPENDENT)[0]
                along[fixed] = 0.0
                return np.array(state.q), along * scale, float(np.abs(state.gap).max(initial=0.0))
            step = np.linalg.lstsq(rows, -left, rcond=_DEPENDENT)[0] * scale
            step[fixed] = 0.0
            state, before = State(self.chain, pin.integrate(self.model, state.q, step)), worst
        raise self._open(state)

    def _spread(self, state: State) -> Callable[[FloatArray], Tangent]:
        """Least-norm tangent of a loop residual in natural units, factorised at a state."""
        scaled = state.rows[self.rows]
        factor, failed = _factorise(scaled @ scaled.T, lower=1)
        if failed:
            raise ClosureError(
                "the loops are singular here: their equations depend on each other",
                residual=np.inf,
                iterations=0,
                q=state.q,
            )
        back, sizes = self._scale[:, None] * scaled.T, self._sizes[self.rows]
        return lambda residual: back @ _solve(factor, residual / sizes, lower=1)[0]

    def energy(self, q: Configuration, v: Tangent) -> tuple[float, float, float]:
        """Compute kinetic and potential energy, motor inertia included, and that of the joints' springs.

        Parameters
        ----------
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].

        Returns
        -------
        kinetic, potential, elastic : float
            [J].
        """
        unit, data = self.chain.mass_unit, self._data
        # Rotors by themselves: Pinocchio's kinetic energy has those of some kinds of joints only.
        kinetic = pin.computeKineticEnergy(self._bodies, data, q, v) + self._rotors @ (v * v) / 2
        potential = pin.computePotentialEnergy(self._bodies, data)
        elastic = self.chain.joint_effects.elastic_energy(State(self.chain, q)) if self._acts else 0.0
        return float(unit * kinetic), float(unit * potential), elastic

    @property
    def weight_by_size(self) -> float:
        """Weight of the robot times its size [J]."""
        mass = self.chain.mass_unit * pin.computeTotalMass(self.chain.mass_model)
        return float(mass * np.linalg.norm(self.model.gravity.linear) * self.chain.length_scale)


def _without_rotors(model: pin.Model) -> tuple[pin.Model, FloatArray]:
    """Tree of bodies alone, and the (nv,) inertias of the rotors."""
    bodies, rotors = model.copy(), np.array(model.armature)
    bodies.armature = np.zeros(model.nv)
    return bodies, rotors


def _with_motors(chain: ClosedChain, inertia: FloatArray, friction: FloatArray | None) -> ClosedChain:
    """Add inertia and dry friction to the motors' own coordinates, where Pinocchio keeps those of joints."""
    rubs = friction is not None and friction.any()
    if not (inertia.any() or rubs):
        return chain
    model = chain.model.copy()
    fields = read_fields(model)
    fields["armature"][chain.motor_index] += inertia
    if friction is not None:
        fields["friction"][chain.motor_index] += friction
    write_fields(model, fields)
    moved = replace(chain, model=model)
    moved.__dict__["generic"] = chain.generic  # ranks know nothing of masses
    return moved
