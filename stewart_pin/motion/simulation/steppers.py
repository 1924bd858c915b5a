"""One step on the manifold of closed loops: of the classical Runge-Kutta method, or of SciPy's integrators."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, NamedTuple, Protocol, get_args

import numpy as np
import pinocchio as pin
from scipy import integrate
from scipy.linalg import get_lapack_funcs

from stewart_pin.errors import ClosureError, InputError, SingularityError
from stewart_pin.motion.simulation.friction import first_change
from stewart_pin.motion.simulation.plant import Plant
from stewart_pin.state.state import State
from stewart_pin.tolerances import CLOSED, EPS
from stewart_pin.typing import Configuration, FloatArray, Tangent

# ----------------------------------------------------------------------------------------------------
# Displacements of a step on the manifold: how their rates depend on the velocity of the chain
# ----------------------------------------------------------------------------------------------------


class Displacements:
    """Displacements ξ with q = q0 ⊕ ξ of one model.

    Joints with one freedom add up; those that turn about several axes do not, and need a correction.

    Parameters
    ----------
    model
        Tree.
    """

    def __init__(self, model: pin.Model) -> None:
        self._bodies = [joint.idx_v for joint in model.joints[1:] if joint.nv == 6]
        self._balls = [joint.idx_v for joint in model.joints[1:] if joint.nv == 3]

    def rate(self, displacement: Tangent, v: Tangent) -> Tangent:
        """Compute the rate of a displacement that moves the chain at a velocity.

        Parameters
        ----------
        displacement
            (nv,) ξ [m, rad].
        v
            (nv,) tangent velocity at q0 ⊕ ξ [m/s, rad/s].

        Returns
        -------
        numpy.ndarray
            (nv,) ``v + [ξ, v] / 2 + [ξ, [ξ, v]] / 12``, exact to third order in ξ: enough for an integrator of order
            four [m/s, rad/s].

        References
        ----------
        .. [1] A. Iserles, H. Munthe-Kaas, S. Nørsett, A. Zanna, "Lie-group methods", Acta Numerica, 2000, eq. (2.46).
        """
        if not (self._bodies or self._balls):
            return v
        rate = v.copy()
        for k in self._bodies:
            part = slice(k, k + 6)
            step = pin.Motion(displacement[part])
            once = step ^ pin.Motion(v[part])
            rate[part] += once.vector / 2 + (step ^ once).vector / 12
        for k in self._balls:
            part = slice(k, k + 3)
            turn = pin.skew(np.array(displacement[part]))
            once = turn @ v[part]
            rate[part] += once / 2 + turn @ once / 12
        return rate


def displacement_jacobian(model: pin.Model, q: FloatArray, q_moved: FloatArray) -> FloatArray:
    """Differentiate a displacement by where it leads.

    Parameters
    ----------
    model
        Tree.
    q, q_moved
        (nq,) configurations [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nv, nv) rate of ``difference(q, q_moved)`` per tangent velocity at `q_moved`, dimensionless.
    """
    return pin.dDifference(model, q, q_moved, pin.ArgumentPosition.ARG1)


# ----------------------------------------------------------------------------------------------------


ACCOUNTS = 6
"""Entries of x before the controller's own: work of the drives, work of the wrenches from outside, and heat of dampers,
of dry friction, of what the motors add to both, and of end stops [J]."""


class Phase(NamedTuple):
    """What is integrated.

    Attributes
    ----------
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].
    x
        (m,) `ACCOUNTS` of energy [J], and the controller's own state.
    gap
        Largest entry of the loop gap [m].
    """

    q: Configuration
    v: Tangent
    x: FloatArray
    gap: float


Rates = Callable[[float, Configuration, Tangent, FloatArray], tuple[Tangent, FloatArray]]
"""(t, q, v, x) to the acceleration (nv,) and the rate of x (m,)."""


class Sticking(Protocol):
    """What ends a smooth stretch of a motion with dry friction, and begins the next."""

    def margin(self, t: float, phase: Phase) -> float:
        """Tell how far a state is from the end of its stretch; below zero beyond it."""
        ...

    def settle(self, t: float, phase: Phase, *, within: bool) -> Phase:
        """Begin another stretch."""
        ...

    def require_charted(self) -> None:
        """Refuse what no chart can hold."""
        ...

    def too_many(self, t: float, h: float, count: int) -> Exception:
        """Say that stretches have no length."""
        ...


_MOST_CHANGES = 200
"""Times that friction may stick and slip within a step, before the motion is taken to be beyond it."""
_LOOKS = 16
"""Steps of an interval at least while something is stuck: it may be pulled loose and held again in between."""


Passed = Callable[[float, float, Phase, Phase], None]
"""Called with the time at the end of a step, its length, and the states at its ends."""


class RungeKuttaStepper:
    """Classical Runge-Kutta method of order four in the tangent of each step's start, then projection.

    Parameters
    ----------
    plant
        Chain.
    rates
        Right-hand side.
    passed
        Told of every step.
    friction
        Where there is dry friction; else None.

    Attributes
    ----------
    doubt
        Estimated error of the quadrature of work and heat so far [J].
    first_step
        None: steps are given.
    """

    def __init__(self, plant: Plant, rates: Rates, passed: Passed, friction: Sticking | None = None) -> None:
        self._plant, self._rates, self._passed, self._friction = plant, rates, passed, friction
        self.doubt = 0.0
        self.first_step: float | None = None
        self._displacements = Displacements(plant.model)

    def restart(self) -> None:
        """Forget the past: one-step methods have none."""

    def advance(self, t: float, phase: Phase, h: float) -> Phase:
        """Go one step.

        Parameters
        ----------
        t
            Time at its start [s].
        phase
            State there.
        h
            Its length [s].

        Returns
        -------
        Phase
            State at its end, loops closed.

        Raises
        ------
        ClosureError
            If the loops cannot be closed there.
        """
        friction, left = self._friction, h
        if friction is None:
            return self._accept(t, h, phase, *self._stage(t, phase, h))
        for _ in range(_MOST_CHANGES):
            tried = self._stage(t, phase, left)
            if not friction.margin(t + left, tried[0]) < 0.0:
                return self._accept(t, left, phase, *tried)
            # A shorter step to where something sticks or slips: each stretch is smooth.
            start, since = phase, t
            s, tried = first_change(
                lambda s: self._stage(since, start, s),  # noqa: B023 - called here
                lambda s, tried: friction.margin(since + s, tried[0]),  # noqa: B023
                left,
            )
            if s:
                phase = self._accept(t, s, phase, *tried)
            t, left = t + s, left - s
            phase = friction.settle(t, phase, within=True)
            if not left > 4 * EPS * h:
                return phase
        raise friction.too_many(t, h, _MOST_CHANGES)

    def _accept(self, t: float, h: float, phase: Phase, moved: Phase, doubt: float) -> Phase:
        self.doubt += doubt
        self._passed(t + h, h, phase, moved)
        return moved

    def _stage(self, t: float, phase: Phase, h: float) -> tuple[Phase, float]:
        """Go a step, and estimate the error of its accounts."""
        model, rates, rate = self._plant.model, self._rates, self._displacements.rate
        q, v, x, _ = phase
        a1, x1 = rates(t, q, v, x)
        v2 = v + h / 2 * a1
        step = h / 2 * v
        a2, x2 = rates(t + h / 2, pin.integrate(model, q, step), v2, x + h / 2 * x1)
        d2 = rate(step, v2)
        v3 = v + h / 2 * a2
        step = h / 2 * d2
        a3, x3 = rates(t + h / 2, pin.integrate(model, q, step), v3, x + h / 2 * x2)
        d3 = rate(step, v3)
        v4 = v + h * a3
        step = h * d3
        a4, x4 = rates(t + h, pin.integrate(model, q, step), v4, x + h * x3)
        d4 = rate(step, v4)
        q = pin.integrate(model, q, h / 6 * (v + 2 * (d2 + d3) + d4))
        v = v + h / 6 * (a1 + 2 * (a2 + a3) + a4)
        # Simpson's rule with four stages, against the trapezium with two of them.
        doubt = h / 3 * float(np.abs(x2 + x3 - x1 - x4)[:ACCOUNTS].sum())
        x = x + h / 6 * (x1 + 2 * (x2 + x3) + x4)
        if self._plant.still:
            return Phase(phase.q, phase.v, x, phase.gap), doubt
        q, v, gap = self._plant.project(q, v)
        return Phase(q, v, x, gap), doubt


# ----------------------------------------------------------------------------------------------------
# SciPy's integrators in independent coordinates: every state they see has closed loops
#
# About a base configuration, y are the coordinates of the motions N that keep the loops closed there, and u = Nᵀ v.
# Whatever y and u an integrator proposes, the loops are closed for it; when y has grown, the base moves.
# ----------------------------------------------------------------------------------------------------

(_gesv,) = get_lapack_funcs(("gesv",), dtype=np.float64)
ScipyMethod = Literal["RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA"]
METHODS: tuple[ScipyMethod, ...] = get_args(ScipyMethod)
"""Adaptive integrators of SciPy."""
_REACH = 0.25
"""Largest coordinate of a chart, in robot sizes and radians, before the base moves."""
_MAX_STEPS = 30
_SMALLEST = 1e-8
"""Smallest step, in intervals: an error that has not fallen by then is one of the equations, not of the step."""
_MOST = 1_000
"""Steps in a row that are shorter than a thousandth of the interval: a method that creeps is stopped too."""
_CREEP = 1e-3
"""Share of the interval below which a step creeps, and share of its usual size below which a singular value of the
loops may be why: rates grow with its reciprocal."""


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    _, _, solution, info = _gesv(matrix, right)
    if info:
        raise SingularityError(
            "the loops are singular here: their equations depend on each other", smallest_singular_value=0.0
        )
    return solution


class _Chart:
    """Coordinates (y, u) of closed configurations and velocities near a base, lengths in robot sizes."""

    def __init__(self, plant: Plant, phase: Phase) -> None:
        self._plant, self._base, self._guess = plant, phase.q, phase.q
        self._scale = plant.chain.tangent_scale
        self._sizes = plant.chain.row_sizes
        self._rows = plant.rows
        jacobian = plant.kept(State(plant.chain, phase.q))
        # As many motions as the mechanism has, whatever a singularity adds here.
        self._motions = np.linalg.svd(jacobian)[2][len(jacobian) :]  # Nᵀ
        self.size = self._motions.shape[0]

    def write(self, phase: Phase) -> FloatArray:
        """Coordinates of the base itself, where y is zero."""
        return np.concatenate([np.zeros(self.size), self._motions @ (phase.v / self._scale), phase.x])

    def rate(self, phase: Phase, a: FloatArray, x_rate: FloatArray) -> FloatArray:
        """Rate of the coordinates under an acceleration."""
        bent = displacement_jacobian(self._plant.model, self._base, phase.q)
        y_rate = self._motions @ ((bent @ phase.v) / self._scale)
        return np.concatenate([y_rate, self._motions @ (a / self._scale), x_rate])

    def read(self, coordinates: FloatArray) -> Phase:
        """Close the loops for given coordinates, from the configuration read last."""
        plant, n = self._plant, self.size
        y, u = coordinates[:n], coordinates[n : 2 * n]
        q, left = self._guess, np.zeros(0)
        for _ in range(_MAX_STEPS):
            state = State(plant.chain, q)
            gap = state.gap
            moved = pin.difference(plant.model, self._base, q) / self._scale
            away = plant.astray(state, moved)
            left = np.concatenate([(gap / self._sizes)[self._rows], away, self._motions @ moved - y])
            bent = displacement_jacobian(plant.model, self._base, q)
            jacobian = plant.kept(state)
            matrix = np.vstack([jacobian, (self._motions / self._scale) @ bent * self._scale])
            if np.abs(left).max(initial=0.0) <= max(CLOSED, state.round_off):
                along = np.vstack([jacobian, self._motions])
                rest = np.zeros(jacobian.shape[0])
                v = _solve(along, np.concatenate([rest, u])) * self._scale
                if plant.friction is not None:
                    q, v = plant.friction.keep(self._base, q, v)
                self._guess = q
                return Phase(q, v, coordinates[2 * n :], float(np.abs(gap).max(initial=0.0)))
            q = pin.integrate(plant.model, q, -_solve(matrix, left) * self._scale)
        raise ClosureError(
            f"the loops do not close in the chart: {np.abs(left).max():.3g} left",
            residual=float(np.abs(left).max()),
            iterations=_MAX_STEPS,
            q=q,
        )


class ChartStepper:
    """Adaptive steps by one of SciPy's methods.

    Parameters
    ----------
    plant
        Chain.
    rates
        Right-hand side.
    method
        One of `METHODS`.
    rtol, atol
        Error per step, relative and absolute, lengths in robot sizes.
    passed
        Told of every step.
    friction
        Where there is dry friction; else None.

    Attributes
    ----------
    doubt
        Zero: the method keeps the error of work and heat within its tolerances [J].
    first_step
        Step with which to go on [s].
    """

    def __init__(
        self,
        plant: Plant,
        rates: Rates,
        method: str,
        rtol: float,
        atol: float,
        passed: Passed,
        friction: Sticking | None = None,
    ) -> None:
        if method not in METHODS:
            raise InputError(f"method must be 'fixed' or one of {', '.join(METHODS)}, got {method!r}")
        self._plant, self._rates = plant, rates
        self._method = getattr(integrate, method)
        self._tolerances = {"rtol": rtol, "atol": atol}
        self._passed, self._friction = passed, friction
        self.doubt = 0.0
        self.first_step: float | None = None

    def restart(self) -> None:
        """Forget the past: nothing is kept but the size of the steps, which errors check."""

    def advance(self, t: float, phase: Phase, h: float) -> Phase:
        """Integrate over an interval.

        Parameters
        ----------
        t
            Time at its start [s].
        phase
            State there.
        h
            Its length [s].

        Returns
        -------
        Phase
            State at its end, loops closed.

        Raises
        ------
        ClosureError
            If the loops cannot be closed, or the integrator's step vanishes.
        """
        end = t + h
        friction, changes = self._friction, 0
        creeping, longest, last = 0, 0.0, np.inf
        # The right-hand side may jump at the end of an interval, so the past is kept only within it.
        while t < end:
            chart, solver = self._start(t, phase, end, h)
            while solver.status == "running" and np.abs(solver.y[: chart.size]).max(initial=0.0) < _REACH:
                message = solver.step()
                step = solver.step_size or 0.0
                creeping = creeping + 1 if step < _CREEP * h and solver.status == "running" else 0
                shrunk = creeping > 1 and step < _SMALLEST * h and step <= last
                last = step
                if solver.status == "failed" or creeping > _MOST or shrunk:
                    raise self._stopped(solver.t, step, message, phase)
                longest = max(longest, step)
                before, phase, ended, since = phase, chart.read(solver.y), solver.t, t
                changed = friction is not None and friction.margin(ended, phase) < 0.0
                if friction is not None and changed:
                    dense, changes = solver.dense_output(), changes + 1
                    s, phase = first_change(
                        lambda s: chart.read(dense(since + s)),  # noqa: B023 - called here
                        lambda s, there: friction.margin(since + s, there),  # noqa: B023
                        ended - t,
                    )
                    ended = t + s
                self._passed(ended, ended - t, before, phase)
                t = ended
                if friction is not None and changed:
                    if changes > _MOST_CHANGES:
                        raise friction.too_many(t, h, changes)
                    phase = friction.settle(t, phase, within=True)
                    break
            # The longest of the interval: what is left of it at its end may be round-off.
            self.first_step = longest or None
        return phase

    def _stopped(self, t: float, step: float, message: str | None, phase: Phase) -> Exception:
        near = State(self._plant.chain, phase.q).motions.smallest
        usual = self._plant.chain.generic.usual_loops
        why = message or f"its steps have shrunk to {step:.3g} s without meeting the tolerances"
        where = f"; the loops are near a singularity there (smallest singular value {near:.3g})"
        return ClosureError(
            f"{self._method.__name__} stops at {t:.9g} s: {why}{where if near < _CREEP * usual else ''}",
            residual=phase.gap,
            iterations=0,
            q=phase.q,
        )

    def _start(self, t: float, phase: Phase, end: float, h: float) -> tuple[_Chart, Any]:
        plant = self._plant
        plant.select_rows(State(plant.chain, phase.q))
        chart = _Chart(plant, phase)

        def rate(time: float, coordinates: FloatArray) -> FloatArray:
            here = chart.read(coordinates)
            return chart.rate(here, *self._rates(time, here.q, here.v, here.x))

        limits: dict[str, Any] = dict(self._tolerances)
        friction = plant.friction
        if self._friction is not None and friction is not None and friction.firm.any():
            self._friction.require_charted()
            limits["max_step"] = h / _LOOKS
        longest = limits.get("max_step", np.inf)
        first = None if self.first_step is None else min(self.first_step, end - t, longest)
        return chart, self._method(rate, t, chart.write(phase), end, first_step=first, **limits)
