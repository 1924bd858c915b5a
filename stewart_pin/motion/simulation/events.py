"""What happens in a run and deserves a name: limits reached, singularities approached, loops lost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stewart_pin.mechanics.singularity.split import SingularityKind, split_jacobians
from stewart_pin.motion.simulation.motors import MotorBank
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import Configuration, FloatArray, Tangent

KINDS = ("stroke", "rate", "effort", "singularity", "closure_lost", "diverged", "controller", "energy")
"""Names of events."""
_MOST = 1000
"""Events kept of one run: more would not fit a reader, and memory must not grow with the run."""


@dataclass(frozen=True)
class Event:
    """Something that happened in a simulation.

    Attributes
    ----------
    time
        End of the step in which it began [s].
    kind
        One of ``stroke``, ``rate``, ``effort``: a motor reached its limit; ``singularity``: the motors' hold on the
        platform, or the distance of the loops to a singularity of theirs, fell below the threshold; ``closure_lost``,
        ``diverged``, ``controller`` (it gave no efforts), ``energy`` (the step is too large): the run ended there.
    joint
        The motor, the joint that moves most in the motion that is lost or gained, the loop, or ``energy``.
    value
        What was reached [m, rad, m/s, rad/s, N, N m, J, or a singular value].
    limit
        What was allowed, in the same unit.
    """

    time: float
    kind: str
    joint: str
    value: float
    limit: float

    def __str__(self) -> str:
        return f"{self.time:.6g} s: {self.kind} of {self.joint}: {self.value:.6g}, limit {self.limit:.6g}"


class Watcher:
    """Notes events when they begin, and again only after they have ended.

    Parameters
    ----------
    chain
        Closed chain.
    bank
        Its motors.
    singular
        Smallest singular value that is no event.
    """

    def __init__(self, chain: ClosedChain, bank: MotorBank, singular: float) -> None:
        self._chain, self._bank, self._singular = chain, bank, singular
        self._generic = chain.generic.count
        self._beyond = np.zeros((3, chain.nu), dtype=bool)
        self._near_singular = False
        self.events: list[Event] = []
        self.dropped = 0

    @property
    def memory(self) -> tuple[np.ndarray, bool]:
        """Which events last, (3, nu) of motors and that of a singularity, for a run that goes on; dimensionless."""
        return self._beyond, self._near_singular

    @memory.setter
    def memory(self, memory: tuple[np.ndarray, bool]) -> None:
        self._beyond, self._near_singular = memory

    def note(self, event: Event) -> Event:
        """Keep an event, if there is room.

        Parameters
        ----------
        event
            What happened.

        Returns
        -------
        Event
            The same.
        """
        if len(self.events) < _MOST:
            self.events.append(event)
        else:
            self.dropped += 1
        return event

    def limits(self, t: float, q: Configuration, v: Tangent, command: FloatArray) -> list[Event]:
        """Compare the motors with their limits.

        Parameters
        ----------
        t
            Time [s].
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        command
            (nu,) efforts asked for [N or N m].

        Returns
        -------
        list of Event
            Those that began.
        """
        bank, chain = self._bank, self._chain
        position, rate = q[chain.motor_q_index], v[chain.motor_index]
        beyond = np.array(
            [
                (position < bank.lower) | (position > bank.upper),
                np.abs(rate) > bank.rate_limit,
                np.abs(command) > bank.effort_limit,
            ]
        )
        new = beyond & ~self._beyond
        self._beyond = beyond
        if not new.any():
            return []
        values = (position, np.abs(rate), np.abs(command))
        nearest = np.where(position > bank.upper, bank.upper, bank.lower)
        limits = (nearest, bank.rate_limit, bank.effort_limit)
        return [
            self.note(Event(t, KINDS[kind], chain.motors[k], float(values[kind][k]), float(limits[kind][k])))
            for kind, k in np.argwhere(new)
        ]

    def singularity(self, t: float, q: Configuration) -> list[Event]:
        """Look how well the motors hold the platform.

        Parameters
        ----------
        t
            Time [s].
        q
            (nq,) configuration [m, rad, unit quaternions].

        Returns
        -------
        list of Event
            One, if a singularity has come near.
        """
        split = split_jacobians(self._chain.at(q), self._generic, self._chain.length_scale)
        hold = split.measures[SingularityKind.MOTOR]
        near = hold.value < self._singular
        began, self._near_singular = near and not self._near_singular, near
        if not began:
            return []
        name = self._chain.tangent_names[int(np.argmax(np.abs(hold.motion)))]
        return [self.note(Event(t, "singularity", name, hold.value, self._singular))]
