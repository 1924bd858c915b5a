"""What happens in a run and deserves a name: limits reached, singularities approached, loops lost; its energy."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import pinocchio as pin

from stewart_pin.mechanics.singularity import SingularityKind, split_jacobians
from stewart_pin.motion.simulation.motors import MotorBank
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import State
from stewart_pin.tolerances import EPS
from stewart_pin.typing import Configuration, FloatArray, Tangent

EventKind = Literal[
    "stroke", "rate", "effort", "singularity", "closure_lost", "diverged", "controller", "wrenches", "energy"
]
KINDS: tuple[EventKind, ...] = get_args(EventKind)
"""Names of events."""
_WORDS: dict[str, EventKind] = {"position": "stroke", "velocity": "rate", "effort": "effort"}
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
        One of ``stroke``, ``rate``, ``effort``: a motor or another joint passed its limit; ``singularity``: the
        motors' hold on the platform, or the distance of the loops to a singularity of theirs, fell below the
        threshold; ``closure_lost``, ``diverged``, ``controller`` (no efforts), ``wrenches`` (their function gave
        none), ``energy`` (the step is too large): the run ended there.
    joint
        The motor or other joint, the joint that moves most in the motion that is lost or gained, the loop,
        ``wrenches`` or ``energy``.
    value
        What was reached [m, rad, m/s, rad/s, N, N m, J, or a singular value].
    limit
        What was allowed, in the same unit.
    """

    time: float
    kind: EventKind
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
        self._chain, self._singular = chain, singular
        self._generic = chain.generic.count
        limits, nv = chain.limits, chain.nv
        self._tree = np.arange(nv)
        # Motors may have been given other limits than those of the chain.
        ends = {kind: np.array(limits.bounds(kind)) for kind in ("position", "velocity", "effort")}
        ends["velocity"][chain.motor_index], ends["effort"][chain.motor_index] = bank.rates, bank.efforts
        rows = {kind: np.flatnonzero(np.isfinite(ends[kind]).any(axis=1)) for kind in ends}
        position, velocity = (rows[kind][rows[kind] < nv] for kind in ("position", "velocity"))
        self._driven = np.flatnonzero(np.isin(chain.motor_index, rows["effort"]))
        self._v, self._q = velocity, np.array([_entry(chain, row) for row in position], dtype=int)
        # What closes loops, and the cones of balls, cost more, and are looked at only where they have limits.
        beyond = [(kind, rows[kind][rows[kind] >= nv]) for kind in ("position", "velocity")]
        self._others = any(own.size for _, own in beyond)
        watched = [
            ("position", position),
            ("velocity", velocity),
            ("effort", chain.motor_index[self._driven]),
            *(one for one in beyond if one[1].size),
        ]
        self._least, self._most = np.concatenate([ends[kind][own] for kind, own in watched]).T.copy()
        self._kinds: list[EventKind] = [_WORDS[kind] for kind, own in watched for _ in own]
        self._names = [limits.names[row] for _, own in watched for row in own]
        self._beyond = np.zeros(len(self._names), dtype=bool)
        self._near_singular = False
        self.events: list[Event] = []
        self.dropped = 0

    @property
    def memory(self) -> tuple[np.ndarray, bool]:
        """Which events last, (k,) of limits and that of a singularity, for a run that goes on; dimensionless."""
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
        """Compare motors, passive joints and joints that close loops with their limits.

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
        values = self._values(q, v, command)
        beyond = (values < self._least) | (values > self._most)
        new = beyond & ~self._beyond
        self._beyond = beyond
        if np.count_nonzero(new) == 0:
            return []
        found: list[Event] = []
        for k in np.flatnonzero(new):
            value = float(values[k])
            limit = float(self._most[k] if value > self._most[k] else self._least[k])
            kind = self._kinds[k]
            if kind != "stroke":
                value, limit = abs(value), abs(limit)
            found.append(self.note(Event(t, kind, self._names[k], value, limit)))
        return found

    def _values(self, q: Configuration, v: Tangent, command: FloatArray) -> FloatArray:
        found = [q[self._q], v[self._v], command[self._driven]]
        if self._others:
            asked = self._chain.judge.asked(q[None], v[None], leave=self._tree)
            found += [each.values[0] for each in asked]
        return np.concatenate(found)

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


def _entry(chain: ClosedChain, row: int) -> int:
    """Index in the configuration of a tangent entry that is a coordinate."""
    return next(joint.idx_q for joint in chain.model.joints[1:] if joint.idx_v == row)


# ----------------------------------------------------------------------------------------------------
# What a run watches between its records: loops that come near a singularity of theirs
# ----------------------------------------------------------------------------------------------------

_LEAST_SLOPE = 0.05
"""Least change of the distance per way that is reckoned with: it may be steeper than before."""
_HALVINGS = 12
"""Thirds by which the nearest point of one step is found: to a hundredth of the step."""


class LoopNearness:
    """Distance of the loops to a singularity of theirs, looked at as often as the motion asks for.

    Singular values of rows of natural size change no faster than the configuration, so a look is due when it has gone
    a part of the last distance.

    Parameters
    ----------
    chain
        Closed chain.
    threshold
        Share of the usual distance that is near.
    """

    def __init__(self, chain: ClosedChain, threshold: float) -> None:
        self._chain = chain
        self._usual = chain.generic.usual_loops if chain.nc and chain.generic.rank else math.inf
        self.limit = threshold * self._usual if math.isfinite(self._usual) else 0.0
        self.near = False
        self._left, self._seen, self._slope, self._gone = 0.0, math.inf, 1.0, 0.0

    @property
    def memory(self) -> tuple[bool, float, float, float, float]:
        """What a run that goes on has to know."""
        return self.near, self._left, self._seen, self._slope, self._gone

    @memory.setter
    def memory(self, memory: tuple[bool, float, float, float, float]) -> None:
        self.near, self._left, self._seen, self._slope, self._gone = memory

    def passed(
        self, h: float, q: Configuration, v: Tangent, q_next: Configuration
    ) -> tuple[float, str] | None:
        """Look at a step.

        Parameters
        ----------
        h
            Its length [s].
        q
            (nq,) configuration at its start [m, rad, unit quaternions].
        v
            (nv,) velocity there [m/s, rad/s].
        q_next
            (nq,) configuration at its end [m, rad, unit quaternions].

        Returns
        -------
        tuple or None
            Smallest singular value of the loops in the step, where it has come near a singularity that the step before
            was not near to, and the joint that moves most in the motion that is gained.
        """
        if not self.limit or not np.isfinite(q_next).all():
            return None
        way = h * float(np.linalg.norm(v / self._chain.tangent_scale))
        self._left -= way
        self._gone += way
        if self._left > 0.0:
            return None
        state = State(self._chain, q_next)
        here, before = state.motions.smallest, self._seen
        # A large step may jump over the singularity, if the distance falls on as before: look between its ends.
        if here > self.limit and here + before < 2 * self._slope * self._gone:
            state = self._nearest(q, q_next)
        if math.isfinite(before) and self._gone:
            self._slope = max(_LEAST_SLOPE, abs(here - before) / self._gone)
        self._seen, self._left, self._gone = here, here / 2, 0.0
        reached = state.motions.smallest
        began, self.near = reached < self.limit and not self.near, reached < self.limit
        if not began:
            return None
        gained = state.motions.gained
        return reached, str(self._chain.tangent_names[int(np.argmax(np.abs(gained)))])

    def _nearest(self, q: Configuration, q_next: Configuration) -> State:
        chain, lower, upper = self._chain, 0.0, 1.0

        def at(share: float) -> State:
            return State(chain, pin.interpolate(chain.model, q, q_next, share))

        for _ in range(_HALVINGS):
            third = (upper - lower) / 3
            if at(lower + third).motions.smallest < at(upper - third).motions.smallest:
                upper -= third
            else:
                lower += third
        return at((lower + upper) / 2)


# ----------------------------------------------------------------------------------------------------
# The energy account of a run, which tells when a step is too large for the motion
# ----------------------------------------------------------------------------------------------------

SHARE = 0.01
"""Energy that may be missing, as a share of what the motion has exchanged: half of it is the error of a speed, which a
reader of a plot begins to see. The methods lose less than a hundredth of it with a step that resolves the motion."""
_DOUBT = 0.05
"""Largest share by which the work's own quadrature may excuse a difference at the end of a run: with more, the step
does not resolve the work. A transient at its start may be a little coarse, while little is exchanged."""
_STILL = EPS**0.5
"""Share of the weight times the size of a robot below which a difference is round-off: half of the digits."""


class EnergyAccount:
    """What energy there is, what was supplied or came from outside, and what became heat, since the first start.

    Parameters
    ----------
    floor
        Weight times size of the robot [J].
    start
        Energy less work plus heat at the start, lowest and highest potential energy, largest kinetic energy since, as
        `memory` gave them [J]; None at a first start.
    """

    def __init__(self, floor: float, start: tuple[float, float, float, float] | None = None) -> None:
        self._floor, self.memory = _STILL * floor, start

    def off(
        self,
        kinetic: float,
        potential: float,
        supplied: float,
        heat: float,
        outside: float,
        doubt: float,
        last: bool,
    ) -> tuple[float, float]:
        """Compare the account with its start.

        Parameters
        ----------
        kinetic, potential
            Energies now, springs with the latter [J].
        supplied, heat, outside
            Work of the motors, heat, and work of wrenches from outside, since the first start [J].
        doubt
            Estimated error of their quadrature [J].
        last
            Whether the run ends here.

        Returns
        -------
        error : float
            Energy gained from nowhere, or lost, where it is more than the account allows; else zero [J].
        scale : float
            Energy that the motion has exchanged or held in motion [J].
        """
        balance = kinetic + potential - supplied - outside + heat
        if self.memory is None:
            self.memory = (balance, potential, potential, kinetic)
        first, lowest, highest, fastest = self.memory
        lowest, highest, fastest = min(lowest, potential), max(highest, potential), max(fastest, kinetic)
        self.memory = (first, lowest, highest, fastest)
        scale = max(fastest, highest - lowest, abs(supplied), abs(outside), heat)
        error = balance - first
        allowed = (
            SHARE * scale
            + (min(doubt, _DOUBT * scale) if last else doubt)
            + self._floor
            + 64 * EPS * abs(potential)
        )
        return (0.0 if abs(error) <= allowed else error), scale
