"""The chain as a simulation sees it: acceleration, projection onto closed loops, energy; scratch that is reused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.linalg import get_lapack_funcs, qr

from stewart_pin.closure.equations import row_sizes
from stewart_pin.closure.newton import RANK, TOLERANCE
from stewart_pin.closure.pinocchio_constraints import constraint_models
from stewart_pin.closure.scratch import LoopScratch
from stewart_pin.errors import ClosureError, UnsupportedError
from stewart_pin.kernels.choosing import SimulationKernels
from stewart_pin.kernels.programs.status import StateStatus
from stewart_pin.kernels.running.single_state import SingleState
from stewart_pin.mechanics.constrained import forward_dynamics
from stewart_pin.model.chain import ClosedChain
from stewart_pin.typing import Configuration, FloatArray, Tangent

_factorise, _solve = get_lapack_funcs(("potrf", "potrs"), dtype=np.float64)
_MAX_STEPS = 20
"""Newton steps of one projection: with a sensible time step one or two are enough."""


class Plant:
    """Mass, loops and scratch of one simulated chain.

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
    """

    def __init__(
        self,
        chain: ClosedChain,
        q: Configuration,
        v: Tangent,
        motor_inertia: FloatArray,
        kernels: SimulationKernels | None = None,
    ) -> None:
        self.chain = chain
        self.loops = LoopScratch(chain)
        self.model = chain.model.copy()
        armature = np.array(self.model.armature)
        armature[chain.motor_index] += motor_inertia
        self.model.armature = armature
        self._data = pin.Data(self.model)
        self._scale = chain.tangent_scale
        self._sizes = row_sizes(chain)
        self._tolerance = TOLERANCE * self._sizes
        self._tau = np.zeros(chain.nv)
        self.rows = np.arange(chain.nc)
        self._candidates = kernels
        self._prepare(q, v)

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
        self.loops.place(q)

    def _prepare(self, q: Configuration, v: Tangent) -> None:
        chain = self.chain
        self.loops.place(q)
        self.select_rows(q)
        # The careful verb knows every reason why there is no acceleration, and says which.
        moved = chain if not self.model.armature.any() else _with_armature(chain, self.model)
        expected = forward_dynamics(moved, q, v, np.zeros(chain.nu)).a
        self._constrained: tuple[pin.StdVec_RigidConstraintModel, pin.StdVec_RigidConstraintData] | None = (
            None
        )
        self._weightless = False
        self._kernel: SingleState | None = None
        self._projector: SingleState | None = None
        if self._candidates is not None:
            if not self.model.armature.any():
                self._kernel = self._candidates.acceleration
                if not self._fits(q, v, expected):
                    self._kernel = None
            self._projector = self._candidates.projection
            self._leave_wrong_projector(q, v)
        if self._try_constraint_dynamics(q, v, expected):
            return
        saddle = self._saddle(q)
        self._weightless = bool(np.linalg.matrix_rank(saddle, rtol=RANK * 1e-3) < saddle.shape[0])

    def _try_constraint_dynamics(self, q: Configuration, v: Tangent, expected: Tangent) -> bool:
        """Use Pinocchio's own algorithm where it gives what the projection gives."""
        if self.rows.size < self.chain.nc:
            return False
        try:
            models = constraint_models(self.chain)
        except UnsupportedError:
            return False
        datas = pin.StdVec_RigidConstraintData()
        for model in models:
            datas.append(model.createData())
        pin.initConstraintDynamics(self.model, self._data, models, datas)
        self._settings = pin.ProximalSettings(1e-14, 0.0, 1)
        self._constrained = (models, datas)
        kernel, self._kernel = self._kernel, None
        fits = self._fits(q, v, expected)
        self._kernel = kernel
        if not fits:
            self._constrained = None
        return fits

    def watch(self, q: Configuration, v: Tangent) -> None:
        """Choose loop rows anew, and leave kernels for good where their fixed pivots have lost too many digits.

        Parameters
        ----------
        q
            (nq,) configuration with closed loops, placed in `loops` [m, rad, unit quaternions].
        v
            (nv,) tangent velocity that keeps them closed [m/s, rad/s].
        """
        self.select_rows(q)
        if self._kernel is not None:
            kernel, self._kernel = self._kernel, None
            careful = self.acceleration(q, v, np.zeros(self.chain.nu))
            self._kernel = kernel
            if not self._fits(q, v, careful):
                self._kernel = None
            self.loops.place(q)
        self._leave_wrong_projector(q, v)

    def select_rows(self, q: Configuration) -> None:
        """Choose loop rows that imply the others here, where `loops` has been placed.

        Parameters
        ----------
        q
            (nq,) the configuration placed [m, rad, unit quaternions].
        """
        jacobian = self.loops.jacobian() * self._scale / self._sizes[:, None]
        if not jacobian.size:
            return
        decomposition: Any = qr(jacobian.T, mode="economic", pivoting=True)
        _, upper, order = decomposition
        diagonal = np.abs(np.diag(upper))
        self.rows = np.sort(order[: int(np.count_nonzero(diagonal > RANK * diagonal[0]))])

    def acceleration(self, q: Configuration, v: Tangent, tau_motor: FloatArray) -> Tangent:
        """Compute the acceleration under motor efforts.

        Parameters
        ----------
        q
            (nq,) configuration, loops closed or nearly so [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        tau_motor
            (nu,) efforts on the motor coordinates [N or N m].

        Returns
        -------
        numpy.ndarray
            (nv,) tangent acceleration; not finite where the equations are singular [m/s², rad/s²].
        """
        if self._kernel is not None:
            a, _ = self._kernel(q, v, tau_motor)
            if self._kernel.status is StateStatus.OK:
                return np.array(a)
            # A pivot has grown small, or the state is singular: the careful way knows.
        tau = self._tau
        tau[self.chain.motor_index] = tau_motor
        if self._constrained is not None:
            return np.array(
                pin.constraintDynamics(self.model, self._data, q, v, tau, *self._constrained, self._settings)
            )
        push = tau - pin.nonLinearEffects(self.model, self._data, q, v)
        self.loops.place(q)
        saddle = self._saddle(q)
        right = np.concatenate([push, -self.loops.bias(q, v)[self.rows]])
        if self._weightless:
            return np.linalg.lstsq(saddle, right, rcond=RANK * 1e-3)[0][: self.chain.nv]
        try:
            return np.linalg.solve(saddle, right)[: self.chain.nv]
        except np.linalg.LinAlgError:
            return np.full(self.chain.nv, np.nan)

    def _saddle(self, q: Configuration) -> FloatArray:
        """Mass matrix and chosen loop rows, where `loops` has been placed: [[M, -Jᵀ], [J, 0]]."""
        nv, rows = self.chain.nv, self.rows
        saddle = np.zeros((nv + rows.size, nv + rows.size))
        upper = np.triu(pin.crba(self.model, self._data, q))
        saddle[:nv, :nv] = upper + np.triu(upper, 1).T
        jacobian = self.loops.jacobian()[rows]
        saddle[nv:, :nv], saddle[:nv, nv:] = jacobian, -jacobian.T
        return saddle

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
        if self._projector is not None:
            closed_q, closed_v, gap = self._projector(q, v)
            if self._projector.status is StateStatus.OK:
                return np.array(closed_q), np.array(closed_v), float(gap[0])
            # Farther from closed, singular, or the step was too long: the careful way knows.
        gap = self.loops.place(q)
        if not gap.size:
            return q, v, 0.0
        spread = self._spread()
        v = v - spread(self.loops.jacobian()[self.rows] @ v)
        worst = float((np.abs(gap) / self._sizes).max())
        for count in range(_MAX_STEPS):
            if (np.abs(gap) <= self._tolerance).all():
                if count > 1:  # the loops stand elsewhere than where v was projected
                    v = v - self._spread()(self.loops.jacobian()[self.rows] @ v)
                return q, v, float(np.abs(gap).max())
            q = pin.integrate(self.model, q, -spread(gap[self.rows]))
            gap, before = self.loops.place(q), worst
            worst = float((np.abs(gap) / self._sizes).max())
            # A factorisation from before the step does as long as it wins a factor of ten.
            if count and not worst < before / 10:
                spread = self._spread()
        row = int(np.argmax(np.abs(gap) / self._sizes)) if np.isfinite(gap).all() else 0
        raise ClosureError(
            f"{self.chain.loop_table.names[row]} does not close: {abs(gap[row]):.3g} left",
            residual=float(np.abs(gap).max()),
            iterations=_MAX_STEPS,
            q=q,
        )

    def _spread(self) -> Callable[[FloatArray], Tangent]:
        """Least-norm tangent of a loop residual, lengths in robot sizes, factorised where `loops` stands."""
        scaled = self.loops.jacobian()[self.rows] * self._scale
        factor, failed = _factorise(scaled @ scaled.T, lower=1)
        if failed:
            raise ClosureError(
                "the loops are singular here: their equations depend on each other",
                residual=np.inf,
                iterations=0,
                q=self.chain.q_home,
            )
        back = self._scale[:, None] * scaled.T
        return lambda residual: back @ _solve(factor, residual, lower=1)[0]

    def energy(self, q: Configuration, v: Tangent) -> float:
        """Compute kinetic and potential energy, motor inertia included.

        Parameters
        ----------
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].

        Returns
        -------
        float
            [J].
        """
        kinetic = pin.computeKineticEnergy(self.chain.model, self.loops.data, q, v)
        potential = pin.computePotentialEnergy(self.chain.model, self.loops.data, q)
        return float(kinetic + potential + 0.5 * (self.model.armature * v) @ v)


def _with_armature(chain: ClosedChain, model: pin.Model) -> ClosedChain:
    return ClosedChain(chain.mechanism, model, chain.motors, chain.platform, chain.q_home)
