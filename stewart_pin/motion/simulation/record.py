"""What a simulation leaves behind, in memory that is fixed before it starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from stewart_pin.brief import Brief
from stewart_pin.errors import ConvergenceError
from stewart_pin.motion.joint_motion import JointMotion, asked_of_motion, asked_of_motors
from stewart_pin.motion.simulation.events import Event
from stewart_pin.motion.simulation.plant import PlantMemory
from stewart_pin.motion.trajectories import PlatformSamples
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.limits import Excess
from stewart_pin.state.outside import OutsideWrenches, WrenchSamples, gathered_samples
from stewart_pin.typing import Configuration, FloatArray, Tangent


@dataclass(frozen=True, eq=False)
class Memory:
    """What the parts of a run remember, so that another one goes on to the same bits.

    Attributes
    ----------
    q, v
        Configuration (nq,) and velocity (nv,) that a run left [m, rad, m/s, rad/s].
    plant
        Ways of computing chosen so far, and the loop rows.
    gap
        Largest entry of the loop gap [m].
    first_step
        Step of an adaptive method [s].
    account
        Of the energy account [J].
    doubt
        Error of the quadrature of work [J].
    watcher, loops
        Which events last, (k,) of limits and that of a singularity; of the loops with the distance seen
        (dimensionless).
    """

    q: Configuration
    v: Tangent
    plant: PlantMemory
    gap: float
    first_step: float | None
    account: tuple[float, float, float, float] | None
    doubt: float
    watcher: tuple[np.ndarray, bool]
    loops: tuple[bool, float, float, float, float]


@dataclass(frozen=True, eq=False, repr=False)
class SimulationState(Brief):
    """All that a simulation needs to go on as if it had never stopped.

    Attributes
    ----------
    origin
        Time at which steps were counted from [s].
    steps
        Steps since then.
    dt
        Their length [s].
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].
    controller
        (n,) state of the controller [m s or rad s].
    held
        (nu,) efforts that a sampled controller holds [N or N m].
    sampled
        Step at which a sampled controller acted last, or -1.
    supplied, outside
        Work of the motors, and of wrenches from outside, since the first start [J].
    dissipated
        (4,) heat of dampers, of dry friction, of the motors, and of end stops, since then [J].
    memory
        What the parts of the run remember; None: a state made by hand.
    """

    origin: float
    steps: int
    dt: float
    q: Configuration
    v: Tangent
    controller: FloatArray
    held: FloatArray
    sampled: int = -1
    supplied: float = 0.0
    outside: float = 0.0
    dissipated: FloatArray = field(default_factory=lambda: np.zeros(4))
    memory: Memory | None = None

    @property
    def time(self) -> float:
        """Instant of the state [s]."""
        return self.origin + self.steps * self.dt


@dataclass(frozen=True, eq=False, repr=False)
class EnergyAudit(Brief):
    """Where the energy of a simulation is, came from and went, at each recorded instant.

    Attributes
    ----------
    kinetic
        (N,) energy of bodies and rotors [J].
    potential
        (N,) energy of the weight [J].
    elastic
        (N,) energy in springs and constant forces of the joints [J].
    stops
        (N,) energy in the springs of end stops [J].
    supplied
        (N,) work of the drives since the first start [J].
    outside
        (N,) work of the wrenches from outside [J].
    by_damping
        (N,) heat in dampers of joints [J].
    by_friction
        (N,) heat of dry friction of joints [J].
    by_motors
        (N,) heat of the viscous and dry friction that `Motors` add [J].
    by_stops
        (N,) heat in end stops [J].
    """

    kinetic: FloatArray
    potential: FloatArray
    elastic: FloatArray
    stops: FloatArray
    supplied: FloatArray
    outside: FloatArray
    by_damping: FloatArray
    by_friction: FloatArray
    by_motors: FloatArray
    by_stops: FloatArray

    @property
    def stored(self) -> FloatArray:
        """(N,) energy that there is [J]."""
        return self.kinetic + self.potential + self.elastic + self.stops

    @property
    def dissipated(self) -> FloatArray:
        """(N,) heat of all causes [J]."""
        return self.by_damping + self.by_friction + self.by_motors + self.by_stops

    @property
    def unexplained(self) -> FloatArray:
        """(N,) energy gained from nowhere since the first of these instants, by the steps and their projection [J]."""
        balance = self.stored + self.dissipated - self.supplied - self.outside
        return balance - balance[:1]


@dataclass(frozen=True, eq=False, repr=False)
class Simulation(Brief):
    """A simulated motion.

    Attributes
    ----------
    time
        (N,) recorded instants [s].
    q
        (N, nq) configurations, angles with their whole turns [m, rad, unit quaternions].
    v
        (N, nv) tangent velocities [m/s, rad/s].
    tau_motor
        (N, nu) efforts that the drives gave, limits included, friction not [N or N m].
    platform
        Measured motion of the platform frame at these instants, in the world; None where there is no platform.
    audit
        Energy by what holds it, work by what did it, heat by what made it.
    wrenches
        What acted from outside at these instants; None where nothing ever did.
    gap
        (N,) largest entry of the loop gap [m].
    largest_gap
        The same over all steps, recorded or not [m].
    events
        What happened, in order; at most a thousand.
    events_dropped
        How many more there were.
    final_state
        Where to go on: pass it to `resume`.
    success
        Whether the run reached its end.
    reason
        Why it ended.
    chain
        What moved.
    """

    time: FloatArray
    q: FloatArray
    v: FloatArray
    tau_motor: FloatArray
    platform: PlatformSamples | None
    audit: EnergyAudit
    wrenches: WrenchSamples | None
    gap: FloatArray
    largest_gap: float
    events: tuple[Event, ...]
    events_dropped: int
    final_state: SimulationState
    success: bool
    reason: str
    chain: ClosedChain = field(repr=False)

    def __len__(self) -> int:
        return self.time.size

    @property
    def energy(self) -> FloatArray:
        """(N,) kinetic, potential and elastic energy, rotors and springs of end stops included [J]."""
        return self.audit.stored

    @property
    def supplied(self) -> FloatArray:
        """(N,) work of the drives since the start [J]."""
        return self.audit.supplied

    @property
    def dissipated(self) -> FloatArray:
        """(N,) heat in joints, motors and end stops since the start [J]."""
        return self.audit.dissipated

    @property
    def outside(self) -> FloatArray:
        """(N,) work of the wrenches from outside since the start [J].

        `energy` is what it was at the start, plus `supplied` and this, less `dissipated`.
        """
        return self.audit.outside

    def check(self) -> tuple[Excess, ...]:
        """List the limits that did not hold at the recorded instants.

        Returns
        -------
        tuple of Excess
            Of positions, velocities and efforts of all joints, each at its worst instant; of accelerations and jerks,
            where they have limits, by differences of the recorded velocities.
        """
        chain, second = self.chain, None
        if len(self) > 1 and any(chain.limits.stated(kind).size for kind in ("acceleration", "jerk")):
            second = np.gradient(self.v, self.time, axis=0)
        asked = asked_of_motion(chain, self.time, JointMotion(self.q, self.v, second))
        at = (self.q[:, chain.motor_q_index], self.v[:, chain.motor_index], self.tau_motor)
        asked += [each for each in asked_of_motors(chain, *at) if each.kind == "effort"]
        return chain.judge.excesses(asked, time=self.time)

    def or_raise(self) -> Simulation:
        """Return the simulation, or raise what kept it from its end.

        Returns
        -------
        Simulation
            This record.

        Raises
        ------
        ConvergenceError
            If it is no success.
        """
        if self.success:
            return self
        raise ConvergenceError(f"the simulation ended early: {self.reason}", residual=self.largest_gap)


class SimulationInterrupted(KeyboardInterrupt):
    """Ctrl-C during a simulation: a `KeyboardInterrupt` that holds the part that ran.

    Parameters
    ----------
    message
        When it was interrupted.
    simulation
        What was recorded until then; its ``final_state`` can be passed to `resume`.
    """

    def __init__(self, message: str, simulation: Simulation) -> None:
        super().__init__(message, simulation)
        self.simulation = simulation

    def __str__(self) -> str:
        return str(self.args[0])


class Recorder:
    """Arrays of a run, filled in order.

    Parameters
    ----------
    chain
        Closed chain.
    size
        Number of instants that will be recorded at most.
    """

    def __init__(self, chain: ClosedChain, size: int) -> None:
        self._chain, self._data = chain, pin.Data(chain.model)
        self._count = 0
        self._time = np.empty(size)
        self._q, self._v = np.empty((size, chain.nq)), np.empty((size, chain.nv))
        self._tau = np.empty((size, chain.nu))
        self._position, self._rotation = np.empty((size, 3)), np.empty((size, 3, 3))
        self._twist, self._acceleration = np.empty((size, 6)), np.empty((size, 6))
        self._numbers = np.empty((size, 11))
        self._outside: list[OutsideWrenches | None] = []

    def add(
        self,
        t: float,
        q: Configuration,
        v: Tangent,
        a: Tangent,
        tau_motor: FloatArray,
        outside: OutsideWrenches | None,
        numbers: Sequence[float],
    ) -> None:
        """Record one instant.

        Parameters
        ----------
        t
            Time [s].
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        a
            (nv,) tangent acceleration [m/s², rad/s²].
        tau_motor
            (nu,) efforts given [N or N m].
        outside
            Wrenches from outside, or None.
        numbers
            What `EnergyAudit` has, in its order [J], and gap [m].
        """
        k, data = self._count, self._data
        # Without a platform the frame of the ground is looked at, and nothing is said of it.
        platform = 0 if self._chain.platform is None else self._chain.platform_id
        pin.forwardKinematics(self._chain.model, data, q, v, a)
        pose = pin.updateFramePlacement(self._chain.model, data, platform)
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        self._time[k], self._q[k], self._v[k], self._tau[k] = t, q, v, tau_motor
        self._position[k], self._rotation[k] = pose.translation, pose.rotation
        self._twist[k] = pin.getFrameVelocity(self._chain.model, data, platform, axes).vector
        self._acceleration[k] = pin.getFrameClassicalAcceleration(
            self._chain.model, data, platform, axes
        ).vector
        self._numbers[k] = numbers
        self._outside.append(outside)
        self._count += 1

    def finish(
        self,
        *,
        largest_gap: float,
        events: list[Event],
        dropped: int,
        final_state: SimulationState,
        success: bool,
        reason: str,
    ) -> Simulation:
        """Hand over what was recorded.

        Parameters
        ----------
        largest_gap
            Over all steps [m].
        events
            What happened.
        dropped
            How many more events there were.
        final_state
            Where to go on.
        success
            Whether the run reached its end.
        reason
            Why it ended.

        Returns
        -------
        Simulation
            The record.
        """
        n = slice(0, self._count)
        samples = PlatformSamples(
            self._time[n], self._position[n], self._rotation[n], self._twist[n], self._acceleration[n]
        )
        *accounts, gap = self._numbers[n].T
        return Simulation(
            time=self._time[n],
            q=self._q[n],
            v=self._v[n],
            tau_motor=self._tau[n],
            platform=None if self._chain.platform is None else samples,
            audit=EnergyAudit(*accounts),
            wrenches=gathered_samples(self._outside),
            gap=gap,
            largest_gap=largest_gap,
            events=tuple(events),
            events_dropped=dropped,
            final_state=final_state,
            success=success,
            reason=reason,
            chain=self._chain,
        )
