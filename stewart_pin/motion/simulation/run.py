"""One run of a simulation: its steps, what is recorded and noted on the way, and what ends it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from stewart_pin.checks import as_number, as_positive
from stewart_pin.errors import ClosureError, ConvergenceError, InputError, SingularityError
from stewart_pin.kernels.choosing import simulation_kernels
from stewart_pin.motion.simulation.drive import ControllerFailure, Drive, Flow, Push, WrenchFailure
from stewart_pin.motion.simulation.events import SHARE, EnergyAccount, Event, LoopNearness, Watcher
from stewart_pin.motion.simulation.motors import MotorBank, Motors
from stewart_pin.motion.simulation.plant import Plant
from stewart_pin.motion.simulation.record import (
    Memory,
    Recorder,
    Simulation,
    SimulationInterrupted,
    SimulationState,
)
from stewart_pin.motion.simulation.steppers import (
    ACCOUNTS,
    ChartStepper,
    Phase,
    RungeKuttaStepper,
    ScipyMethod,
)
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import State
from stewart_pin.tolerances import WHOLE_STEPS
from stewart_pin.typing import Configuration, Tangent

Method = Literal["fixed"] | ScipyMethod
Progress = Callable[[str, int, int], None]
"""Called with the stage, the steps done and their number."""

_FEW_RECORDS = 10_000
"""Instants recorded when no rate is asked for."""
_MOST_RECORDS = 2_000_000
_MOST_STEPS = 1e12
"""Steps beyond which a duration or dt is a slip: a year even at thirty microseconds each."""
_FASTEST = (2.78, 2.82)
"""Decay, and swing in radians, per step of the classical Runge-Kutta method beyond which what fades is made to grow."""
_WATCH_RATE = 50.0
"""How often singularities are looked for, and loop rows chosen anew [1/s]."""


@dataclass(frozen=True)
class Options:
    """What `simulate` was asked for, checked.

    Attributes
    ----------
    duration, dt
        Length of the run and of a step [s].
    method
        ``"fixed"`` or one of SciPy's.
    record_rate
        Records per second, or None [1/s].
    singular
        Nearness below which a singularity is an event, dimensionless.
    stop_on
        Kinds of events that end the run.
    rtol, atol
        Tolerances of SciPy's methods, dimensionless.
    kernels
        Whether kernels answer; None: where they pay.
    progress
        Called on the way, or None.
    """

    duration: float
    dt: float
    method: Method
    record_rate: float | None
    singular: float
    stop_on: frozenset[str]
    rtol: float
    atol: float
    kernels: bool | None
    progress: Progress | None

    @property
    def is_fixed(self) -> bool:
        """Whether steps have one length."""
        return self.method == "fixed"


class Run:
    """A chain, its motors and its controller on their way from one instant to another.

    Parameters
    ----------
    chain
        Closed chain.
    start
        Where the run begins, or an earlier one ended.
    drive
        The controller.
    push
        Wrenches from outside.
    motors
        What its efforts go through.
    options
        The rest.
    """

    def __init__(
        self,
        chain: ClosedChain,
        start: SimulationState,
        drive: Drive,
        push: Push,
        motors: Motors,
        options: Options,
    ) -> None:
        self.chain, self.start, self.drive, self.options = chain, start, drive, options
        count = _steps(options.duration, options.dt)
        self.first, self.last = start.steps, start.steps + count
        self.stride = _stride(count, options.dt, options.record_rate)
        self.watch = max(1, round(1 / (_WATCH_RATE * options.dt)))
        self.bank = MotorBank(chain, motors)
        # Four calls a step of the fixed method; SciPy's own number is not known beforehand.
        kernels = simulation_kernels(chain, 4 * count, options.kernels)
        self.plant = Plant(chain, start.q, start.v, self.bank.inertia, kernels, self.bank.coulomb)
        drive.hold(start.held)
        self.watcher = Watcher(chain, self.bank, options.singular)
        self.recorder = Recorder(chain, count // self.stride + 2)
        self.loops = LoopNearness(self.plant.chain, options.singular)
        self.pending: list[Event] = []
        memory = start.memory
        self.account = EnergyAccount(self.plant.weight_by_size, None if memory is None else memory.account)
        self.flow = Flow(drive, self.bank, self.plant, push)
        sticking = None if self.plant.friction is None else self.flow
        if options.method == "fixed":
            self.stepper = RungeKuttaStepper(self.plant, self.flow.rates, self._passed, sticking)
        else:
            accuracy = options.rtol, options.atol
            self.stepper = ChartStepper(
                self.plant, self.flow.rates, options.method, *accuracy, self._passed, sticking
            )
        if memory is not None:
            self.plant.recall(memory.plant)
            self.watcher.memory, self.loops.memory = memory.watcher, memory.loops
            self.stepper.first_step, self.stepper.doubt = memory.first_step, memory.doubt
        q, v, gap = _closed(self.plant, start)
        x = np.concatenate([[start.supplied, start.outside], start.dissipated, start.controller])
        self.here = Phase(q, v, x, gap), start.steps
        """What has been reached, and by how many steps: one attribute, so that an interrupt leaves both or neither."""
        self.largest_gap = gap
        self.recorded, self.sampled = -1, start.sampled
        self.reason, self.speechless = "", False
        too_fast = self._too_fast(self.here[0])
        if too_fast is not None:
            raise InputError(too_fast[1])

    def _time(self, k: int) -> float:
        """Give the instant of a step."""
        return self.start.origin + k * self.options.dt

    def go(self) -> Simulation:
        """Step to the end, or to what ends the run before.

        Returns
        -------
        Simulation
            What was recorded.

        Raises
        ------
        InputError
            If the controller fails at once.
        SimulationInterrupted
            If the user interrupts; carries what ran.
        """
        interrupt: KeyboardInterrupt | None = None
        try:
            while not self._ends():
                self._step()
        except (ClosureError, SingularityError, ConvergenceError, np.linalg.LinAlgError) as error:
            self.reason = self._note_failure(error)
        except ControllerFailure as error:
            if self.recorded < 0:
                raise InputError(str(error)) from error
            at = self._time(self.here[1])
            outside = isinstance(error, WrenchFailure)
            kind, name = ("wrenches",) * 2 if outside else ("controller", ", ".join(self.chain.motors))
            self.watcher.note(Event(at, kind, name, math.nan, math.nan))
            self.reason, self.speechless = str(error), True
        except KeyboardInterrupt as error:
            self.reason, interrupt = f"interrupted at {self._time(self.here[1]):g} s", error
        simulation = self._finished()
        if interrupt is not None:
            raise SimulationInterrupted(self.reason, simulation) from interrupt
        return simulation

    def _ends(self) -> bool:
        """Sample the controller, record, and note events at an instant; tell whether the run ends there."""
        drive, (phase, k) = self.drive, self.here
        t = self._time(k)
        if drive.every and k % drive.every == 0 and k != self.sampled:
            x = phase.x.copy()
            x[ACCOUNTS:] = drive.sample(t, phase.q, phase.v, x[ACCOUNTS:])
            phase = phase._replace(x=x)
            self.here, self.sampled = (phase, k), k
            self.stepper.restart()
        if self.plant.friction is not None:
            phase = self.flow.settle(t, phase, within=False)
            self.here = phase, k
        if (k - self.first) % self.stride == 0 or k == self.last:
            self.reason = self._record(t, phase, last=k == self.last)
            self.recorded = k
        stopping = [event for event in self._events(k, phase) if event.kind in self.options.stop_on]
        if stopping and not self.reason:
            self.reason = f"stopped at {stopping[0]}"
        return bool(self.reason) or k == self.last

    def _step(self) -> None:
        phase, k = self.here
        self.here = self.stepper.advance(self._time(k), phase, self.options.dt), k + 1
        phase, k = self.here
        self.largest_gap = max(self.largest_gap, phase.gap)
        if self.options.progress and (k % self.watch == 0 or k == self.last):
            self.options.progress("simulation", k - self.first, self.last - self.first)

    def _too_fast(self, phase: Phase) -> tuple[str, str] | None:
        """Name a joint whose damper or spring is too stiff for fixed steps here, and say so."""
        if not self.options.is_fixed:
            return None
        dt = self.options.dt
        words = zip(
            ("dampers", "springs"), ("decay at {:.3g}/s", "swing at {:.3g} rad/s"), _FASTEST, strict=True
        )
        found = self.plant.fastest(phase.q, phase.v, self.bank.viscous)
        for (rate, joint), (what, how, most) in zip(found, words, strict=True):
            if rate * dt > most:
                return joint, (
                    f"the step dt = {dt:g} s is too large for the {what} of the joints, which let '{joint}' "
                    f"{how.format(rate)}; choose dt below {most / rate:.2g} s, or method='Radau'"
                )
        return None

    def _passed(self, t: float, h: float, before: Phase, after: Phase) -> None:
        """Look for a singularity of the loops within a step."""
        near = self.loops.passed(h, before.q, before.v, after.q)
        if near:
            self.pending.append(
                self.watcher.note(Event(t, "singularity", near[1], near[0], self.loops.limit))
            )

    def _events(self, k: int, phase: Phase) -> list[Event]:
        """Look for events at an instant, and for what ends the run there."""
        t, flow = self._time(k), self.flow
        found = self.watcher.limits(t, phase.q, phase.v, flow.command(t, phase.q, phase.v, phase.x))
        if k % self.watch == 0:
            self.plant.watch(phase.q, phase.v)
            flow.forget()
            found += self.watcher.singularity(t, phase.q)
            too_fast = self._too_fast(phase)
            if too_fast is not None:
                self.watcher.note(Event(t, "diverged", too_fast[0], math.inf, 0.0))
                self.reason = self.reason or too_fast[1]
        found += self.pending
        self.pending.clear()
        return found

    def _record(self, t: float, phase: Phase, *, last: bool) -> str:
        """Record an instant, and say what is wrong with its energy."""
        here = t, phase.q, phase.v, phase.x
        a, given = self.flow.rates(*here)[0], self.flow.delivered(*here)
        kinetic, weight, elastic = self.plant.energy(phase.q, phase.v)
        stops = self.bank.stored(phase.q[self.chain.motor_q_index])
        potential = weight + elastic + stops
        supplied, outside, *losses = phase.x[:ACCOUNTS]
        heat = sum(losses)
        numbers = (kinetic, weight, elastic, stops, supplied, outside, *losses, phase.gap)
        self.recorder.add(t, phase.q, phase.v, a, given, self.flow.outside(*here), numbers)
        error, scale = self.account.off(kinetic, potential, supplied, heat, outside, self.stepper.doubt, last)
        if not error:
            return ""
        self.watcher.note(Event(t, "energy", "energy", error, SHARE * scale))
        options = self.options
        remedy = (
            f"the step dt = {options.dt:g} s is too large for this motion; choose a smaller dt, or method='DOP853'"
            if options.is_fixed
            else f"choose smaller rtol and atol than {options.rtol:g} and {options.atol:g}, or another method"
        )
        return (
            f"energy account off at {t:g} s by {error:.3g} J of {scale:.3g} J that the motion holds: {remedy}"
        )

    def _note_failure(self, error: Exception) -> str:
        """Note why a step failed, and say it."""
        phase, k = self.here
        since, end = self._time(k), self._time(k + 1)
        if isinstance(error, ClosureError):
            culprit = str(error).split(" row ")[0]
            self.watcher.note(Event(end, "closure_lost", culprit, error.residual, 0.0))
            remedy = (
                "choose a smaller dt"
                if self.options.is_fixed
                else "choose another method or larger tolerances"
            )
            return f"loops lost in the step from {since:g} s: {error}; {remedy}"
        worst = self.chain.tangent_names[int(np.argmax(np.abs(phase.v / self.chain.tangent_scale)))]
        if isinstance(error, SingularityError):
            measure = error.smallest_singular_value
            self.watcher.note(Event(end, "singularity", worst, measure, self.loops.limit))
            return f"singular in the step from {since:g} s: {error}"
        self.watcher.note(Event(end, "diverged", worst, math.inf, 0.0))
        return f"diverged in the step from {since:g} s: {error}; choose a smaller dt"

    def _finished(self) -> Simulation:
        phase, k = self.here
        if self.recorded != k and not self.speechless:
            self._record(self._time(k), phase, last=k == self.last)
        memory = Memory(
            phase.q,
            phase.v,
            self.plant.memory,
            phase.gap,
            self.stepper.first_step,
            self.account.memory,
            self.stepper.doubt,
            self.watcher.memory,
            self.loops.memory,
        )
        final = replace(
            self.start,
            steps=k,
            q=phase.q,
            v=phase.v,
            controller=phase.x[ACCOUNTS:],
            held=self.drive.held,
            sampled=self.sampled,
            supplied=float(phase.x[0]),
            outside=float(phase.x[1]),
            dissipated=phase.x[2:ACCOUNTS],
            memory=memory,
        )
        return self.recorder.finish(
            largest_gap=self.largest_gap,
            events=self.watcher.events,
            dropped=self.watcher.dropped,
            final_state=final,
            success=not self.reason,
            reason=self.reason or "reached the end",
        )


def _closed(plant: Plant, start: SimulationState) -> tuple[Configuration, Tangent, float]:
    """Remove what a printed or computed state lacks of closed loops; nothing from one that a run left."""
    state = State(plant.chain, start.q, start.v)
    state.require_moving()
    left = start.memory
    if left is not None and np.array_equal(left.q, start.q) and np.array_equal(left.v, start.v):
        return start.q, start.v, left.gap
    return plant.project(start.q, start.v)


def _steps(duration: float, dt: float) -> int:
    duration = as_positive("duration", duration)
    if not duration / dt < _MOST_STEPS:
        raise InputError(
            f"duration {duration:g} s has more than {_MOST_STEPS:g} steps of dt = {dt:g} s; choose fewer"
        )
    count = max(1, round(duration / dt))
    if abs(count * dt - duration) > WHOLE_STEPS * duration:
        raise InputError(
            f"duration {duration:g} s must be a multiple of dt = {dt:g} s; choose dt = {duration / count:.12g} s"
        )
    return count


def _stride(count: int, dt: float, record_rate: float | None) -> int:
    if record_rate is None:
        return -(-count // _FEW_RECORDS)
    rate = as_positive("record_rate", as_number("record_rate", record_rate))
    stride = max(1, round(min(1 / (rate * dt), count)))
    if count // stride > _MOST_RECORDS:
        raise InputError(
            f"record_rate {record_rate:g}/s gives {count // stride} records; ask for {_MOST_RECORDS} at most"
        )
    return stride
