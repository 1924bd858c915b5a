"""What stands between a controller and the chain: limits, friction, end stops and the inertia of the motors."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.checks import as_spread
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import ArrayLike, FloatArray

_RAMP = 0.05
"""Last part of the rate limit, over which a motor's effort fades out."""


@dataclass(frozen=True, eq=False, repr=False)
class Motors(Brief):
    """Properties of all motors. Each is one number for all, or one per motor; the unit N stands for N m as well.

    Attributes
    ----------
    inertia
        Inertia of rotor and screw, reflected to the motor coordinate: added to the mass matrix [kg or kg m²].
    viscous
        Viscous friction [N s/m or N m s/rad].
    coulomb
        Dry friction, which adds to that of the motors' joints [N].
    effort_limit
        Largest effort to both sides [N]; default: the file's limits, which may differ between the sides.
    rate_limit
        Rate at which a motor no longer pushes in the direction of its motion; its effort fades out over the last 5 %
        [m/s or rad/s]. Default: none.
    stop_stiffness, stop_damping
        End stops at the file's position limits: a one-sided spring and damper, which never pulls [N/m, N s/m]. Default:
        no stops.
    """

    inertia: ArrayLike = 0.0
    viscous: ArrayLike = 0.0
    coulomb: ArrayLike = 0.0
    effort_limit: ArrayLike | None = None
    rate_limit: ArrayLike | None = None
    stop_stiffness: ArrayLike = 0.0
    stop_damping: ArrayLike = 0.0


class MotorBank:
    """The motors of one chain, their numbers checked and spread over the motors.

    Parameters
    ----------
    chain
        Closed chain.
    motors
        Their properties.
    """

    def __init__(self, chain: ClosedChain, motors: Motors) -> None:
        index_v = chain.motor_index
        values = {field.name: getattr(motors, field.name) for field in fields(motors)}
        stated = {name: values[name] is not None for name in ("effort_limit", "rate_limit")}
        values |= {name: np.inf for name, given in stated.items() if not given}
        self._spread = {name: as_spread(name, value, chain.nu) for name, value in values.items()}
        self.inertia, self.viscous = self._spread["inertia"], self._spread["viscous"]
        self.coulomb = self._spread["coulomb"]
        limits = chain.limits
        self.lower, self.upper = limits.bounds("position", index_v).T
        self.efforts, self.rates = limits.bounds("effort", index_v), limits.bounds("velocity", index_v)
        if stated["effort_limit"]:
            self.efforts = self._spread["effort_limit"][:, None] * [-1.0, 1.0]
        if stated["rate_limit"]:
            self.rates = self._spread["rate_limit"][:, None] * [-1.0, 1.0]
        self._least, self._most = self.efforts.T.copy()
        self._fades = motors.rate_limit is not None
        self._rubs = bool(self.viscous.any())
        self._stops = bool(self._spread["stop_stiffness"].any() or self._spread["stop_damping"].any())

    def delivered(self, command: FloatArray, rate: FloatArray) -> FloatArray:
        """Limit what a controller asks for.

        Parameters
        ----------
        command
            (nu,) efforts asked for [N or N m].
        rate
            (nu,) motor rates [m/s or rad/s].

        Returns
        -------
        numpy.ndarray
            (nu,) efforts that the drives give [N or N m].
        """
        effort = np.minimum(np.maximum(command, self._least), self._most)
        if not self._fades:
            return effort
        fade = np.clip((1.0 - np.abs(rate) / self._spread["rate_limit"]) / _RAMP, 0.0, 1.0)
        return np.where(effort * rate > 0, effort * fade, effort)

    def losses(self, position: FloatArray, rate: FloatArray) -> tuple[FloatArray | float, float, float]:
        """Compute what viscous friction and end stops do; dry friction is the joints'.

        Parameters
        ----------
        position
            (nu,) motor positions [m or rad].
        rate
            (nu,) motor rates [m/s or rad/s].

        Returns
        -------
        effort : numpy.ndarray
            (nu,) effort on the motor coordinates [N or N m].
        viscous, stops : float
            What is turned into heat; the springs of the stops give back what they take [W].
        """
        effort: FloatArray | float = 0.0
        viscous = stops = 0.0
        if self._rubs:
            effort = -self.viscous * rate
            viscous = -float(effort @ rate)
        if self._stops:
            push, spring = self._stop_effort(position, rate)
            effort = effort + push
            stops = float((spring - push) @ rate)
        return effort, viscous, stops

    def stored(self, position: FloatArray) -> float:
        """Compute the energy in the springs of the end stops.

        Parameters
        ----------
        position
            (nu,) motor positions [m or rad].

        Returns
        -------
        float
            [J].
        """
        if not self._stops:
            return 0.0
        return float(self._spread["stop_stiffness"] @ self._beyond(position) ** 2) / 2

    def _beyond(self, position: FloatArray) -> FloatArray:
        """Distance past the upper stop, or minus that past the lower one."""
        return np.maximum(position - self.upper, 0.0) + np.minimum(position - self.lower, 0.0)

    def _stop_effort(self, position: FloatArray, rate: FloatArray) -> tuple[FloatArray, FloatArray]:
        beyond = self._beyond(position)
        spring = -self._spread["stop_stiffness"] * beyond
        push = np.where(beyond != 0, spring - self._spread["stop_damping"] * rate, 0.0)
        # A stop pushes back or lets go; it never pulls.
        return np.where(push * beyond < 0, push, 0.0), spring
