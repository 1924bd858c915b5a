"""One step of the classical Runge-Kutta method on the manifold of closed loops."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from stewart_pin.motion.simulation.lie import Displacements
from stewart_pin.motion.simulation.plant import Plant
from stewart_pin.typing import Configuration, FloatArray, Tangent


class Phase(NamedTuple):
    """What is integrated.

    Attributes
    ----------
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].
    x
        (m,) supplied work, heat [J], and the controller's own state.
    gap
        Largest entry of the loop gap [m].
    """

    q: Configuration
    v: Tangent
    x: FloatArray
    gap: float


Rates = Callable[[float, Configuration, Tangent, FloatArray], tuple[Tangent, FloatArray]]
"""(t, q, v, x) to the acceleration (nv,) and the rate of x (m,)."""


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

    Attributes
    ----------
    doubt
        Estimated error of the quadrature of work and heat so far [J].
    first_step
        None: steps are given.
    """

    def __init__(self, plant: Plant, rates: Rates, passed: Passed) -> None:
        self._plant, self._rates, self._passed = plant, rates, passed
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
        self.doubt += h / 3 * float(np.abs(x2 + x3 - x1 - x4)[:2].sum())
        x = x + h / 6 * (x1 + 2 * (x2 + x3) + x4)
        q, v, gap = self._plant.project(q, v)
        moved = Phase(q, v, x, gap)
        self._passed(t + h, h, phase, moved)
        return moved
