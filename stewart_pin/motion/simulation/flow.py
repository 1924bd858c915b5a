"""What moves a state on: efforts of the drives, losses and accelerations, asked once where they are needed twice."""

from __future__ import annotations

import math

import numpy as np

from stewart_pin.errors import ConvergenceError
from stewart_pin.motion.simulation.drive import Drive
from stewart_pin.motion.simulation.motors import MotorBank
from stewart_pin.motion.simulation.plant import Plant
from stewart_pin.typing import Configuration, FloatArray, Tangent


class Flow:
    """Rates of a state under its controller; those of the state that was asked for last are known.

    A recorded instant, its events and the first stage of the step from there ask for the same: controllers are asked
    once. Arrays of a state are never written to, so that a state is known by them.

    Parameters
    ----------
    drive
        Controller.
    bank
        Motors.
    plant
        Mechanism.
    """

    def __init__(self, drive: Drive, bank: MotorBank, plant: Plant) -> None:
        self._drive, self._bank, self._plant = drive, bank, plant
        self._motor_q, self._motor_v = plant.chain.motor_q_index, plant.chain.motor_index
        self.forget()

    def forget(self) -> None:
        """Compute anew next time: the plant has chosen other ways."""
        self._asked: tuple[float, Configuration, Tangent, FloatArray] | None = None
        self._rates: tuple[Tangent, FloatArray] | None = None

    def command(self, t: float, q: Configuration, v: Tangent, x: FloatArray) -> FloatArray:
        """Ask the controller.

        Parameters
        ----------
        t
            Time [s].
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        x
            Work supplied, heat [J], and the state of the controller [m s or rad s].

        Returns
        -------
        numpy.ndarray
            (nu,) efforts asked for [N or N m].
        """
        known = self._asked
        if known is None or known[0] != t or known[1] is not q or known[2] is not v or known[3] is not x:
            self._command = self._drive.effort(t, q, v, x[2:])
            self._asked, self._rates = (t, q, v, x), None
        return self._command

    def delivered(self, t: float, q: Configuration, v: Tangent, x: FloatArray) -> FloatArray:
        """Compute what the motors give.

        Parameters
        ----------
        t
            Time [s].
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        x
            Work supplied, heat [J], and the state of the controller [m s or rad s].

        Returns
        -------
        numpy.ndarray
            (nu,) efforts [N or N m].
        """
        return self._bank.delivered(self.command(t, q, v, x), v[self._motor_v])

    def rates(self, t: float, q: Configuration, v: Tangent, x: FloatArray) -> tuple[Tangent, FloatArray]:
        """Compute how a state moves on.

        Parameters
        ----------
        t
            Time [s].
        q
            (nq,) configuration, loops closed or nearly so [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        x
            Work supplied, heat [J], and the state of the controller [m s or rad s].

        Returns
        -------
        a : numpy.ndarray
            (nv,) tangent acceleration [m/s², rad/s²].
        x_rate : numpy.ndarray
            Rate of `x` [W, and the controller's per s].

        Raises
        ------
        ConvergenceError
            If the velocity is no number.
        """
        if not math.isfinite(v @ v):
            raise ConvergenceError("the velocity grows beyond all numbers", residual=math.inf)
        given, rate = self.delivered(t, q, v, x), v[self._motor_v]
        if self._rates is None:
            loss, heat = self._bank.losses(q[self._motor_q], rate)
            x_rate = np.empty(x.size)
            x_rate[0], x_rate[1] = given @ rate, heat
            x_rate[2:] = self._drive.state_rate(t, q, v, x[2:])
            self._rates = self._plant.acceleration(q, v, given + loss), x_rate
        return self._rates
