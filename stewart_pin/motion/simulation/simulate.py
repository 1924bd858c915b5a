"""The verb: simulate a closed chain under a controller, from a state or from where an earlier run ended."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np

from stewart_pin.checks import as_array, as_positive
from stewart_pin.errors import ClosureError, ConvergenceError, InputError
from stewart_pin.kernels.choosing import simulation_kernels
from stewart_pin.motion.simulation.charts import ChartStepper
from stewart_pin.motion.simulation.drive import (
    Controller,
    ControllerFailure,
    Drive,
    DynamicController,
    Sampled,
)
from stewart_pin.motion.simulation.events import KINDS, Event, Watcher
from stewart_pin.motion.simulation.motors import MotorBank, Motors
from stewart_pin.motion.simulation.plant import Plant
from stewart_pin.motion.simulation.record import Recorder, Simulation, SimulationState
from stewart_pin.motion.simulation.steppers import Phase, RungeKuttaStepper
from stewart_pin.state.chain import ClosedChain, as_configuration
from stewart_pin.state.state import State
from stewart_pin.typing import ArrayLike, Configuration, FloatArray, Tangent

_FEW_RECORDS = 10_000
"""Instants recorded when no rate is asked for."""
_MOST_RECORDS = 2_000_000
_WATCH_RATE = 50.0
"""How often singularities are looked for, and loop rows chosen anew [1/s]."""

Progress = Callable[[str, int, int], None]
"""Called with the stage, the steps done and their number."""


@dataclass(frozen=True)
class _Options:
    duration: float
    dt: float
    method: str
    record_rate: float | None
    singular: float
    stop_on: frozenset[str]
    rtol: float
    atol: float
    kernels: bool | None
    progress: Progress | None


def simulate(
    chain: ClosedChain,
    q: ArrayLike,
    v: ArrayLike,
    controller: Controller | DynamicController | Sampled | None = None,
    *,
    duration: float,
    dt: float = 1e-3,
    method: str = "fixed",
    motors: Motors | None = None,
    start_time: float = 0.0,
    record_rate: float | None = None,
    singular: float = 1e-3,
    stop_on: Collection[str] = (),
    rtol: float = 1e-9,
    atol: float = 1e-9,
    kernels: bool | None = None,
    progress: Progress | None = None,
) -> Simulation:
    """Simulate a closed chain; its loops stay closed to round-off for a run of any length.

    Nothing that happens within the run is raised: it is named in the result, which holds all that was recorded.
    ``KeyboardInterrupt`` ends a run in the same way.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration with closed loops [m, rad, unit quaternions].
    v
        (nv,) tangent velocity that keeps them closed [m/s, rad/s].
    controller
        ``(t, q, v)`` to motor efforts (nu,) [N or N m]; one of `control`; or None for motors without effort. With the
        fixed step it is called four times a step, unless it is sampled.
    duration
        Length of the run [s].
    dt
        Step [s]. With a method of SciPy's, which chooses its own steps, the interval of recording and sampling.
    method
        ``"fixed"``: classical Runge-Kutta method, order 4, each step projected onto closed loops (position by Newton's
        method, velocity onto the null space of the loop Jacobian). Or a method of SciPy's, ``"RK45"``, ``"DOP853"``,
        ``"Radau"``, …, in independent coordinates about a moving base.
    motors
        Friction, end stops, inertia and limits of the motors; default: ideal ones with the file's limits of effort.
    start_time
        Time at the start [s].
    record_rate
        Recorded instants per second [1/s]; default: at most 10 000 instants, evenly spaced. The last step is always
        recorded.
    singular
        Threshold of singularity events: smallest singular value of the motors' share of the platform's motions,
        lengths in robot sizes. Looked for 50 times per second.
    stop_on
        Kinds of events that end the run, of ``"stroke"``, ``"rate"``, ``"effort"``, ``"singularity"``.
    rtol, atol
        Tolerances of SciPy's methods, lengths in robot sizes.
    kernels
        Whether compiled code computes acceleration and projection; None: in runs so long that compiling pays. They are
        compared with the careful ways 50 times per second of the run, and left where they lose digits.
    progress
        Told from time to time.

    Returns
    -------
    Simulation
        The recorded motion, and whether and why it ended.

    Raises
    ------
    InputError
        If an argument makes no sense, the state does not keep the loops closed, or the controller returns no efforts.
    SingularityError
        If nothing with inertia takes part in a motion, so that no acceleration is determined.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> fall = stp.simulate(chain, chain.q_home, np.zeros(chain.nv), duration=0.1, dt=1e-3)
    >>> fall.success, fall.largest_gap < 1e-10, bool(abs(fall.energy[-1] - fall.energy[0]) < 1e-9)
    (True, True, True)
    """
    q, v = as_configuration(chain, "q", q), as_array("v", v, (chain.nv,))
    dt = as_positive("dt", dt)
    drive = Drive(chain, controller, dt)
    state = SimulationState(float(start_time), 0, dt, q, v, np.zeros(drive.state_size), np.zeros(chain.nu))
    options = _Options(
        duration, dt, method, record_rate, float(singular), _kinds(stop_on), rtol, atol, kernels, progress
    )
    return _run(chain, state, drive, motors or Motors(), options)


def resume(
    chain: ClosedChain,
    state: SimulationState,
    controller: Controller | DynamicController | Sampled | None = None,
    *,
    duration: float,
    dt: float | None = None,
    method: str = "fixed",
    motors: Motors | None = None,
    record_rate: float | None = None,
    singular: float = 1e-3,
    stop_on: Collection[str] = (),
    rtol: float = 1e-9,
    atol: float = 1e-9,
    kernels: bool | None = None,
    progress: Progress | None = None,
) -> Simulation:
    """Go on where a simulation ended, with the controller's state, its samples and the energy account.

    Parameters
    ----------
    chain
        Closed chain.
    state
        ``final_state`` of the earlier run.
    controller
        As in `simulate`; the same one, if the run is to go on as if it had never stopped.
    duration
        Further time [s].
    dt
        Step [s]; default: the earlier one.
    method, motors, record_rate, singular, stop_on, rtol, atol, kernels, progress
        As in `simulate`.

    Returns
    -------
    Simulation
        The further motion; its first record is the state passed.

    Raises
    ------
    InputError
        If an argument makes no sense, or the state is that of another controller.
    """
    dt = state.dt if dt is None else as_positive("dt", dt)
    drive = Drive(chain, controller, dt)
    if state.controller.shape != (drive.state_size,):
        raise InputError(
            f"state belongs to another controller, with {state.controller.size} states; this one has "
            f"{drive.state_size}"
        )
    if dt != state.dt:
        acted = 0 if state.sampled == state.steps else -1
        state = replace(state, origin=state.time, steps=0, dt=dt, sampled=acted)
    options = _Options(
        duration, dt, method, record_rate, float(singular), _kinds(stop_on), rtol, atol, kernels, progress
    )
    return _run(chain, state, drive, motors or Motors(), options)


def _run(
    chain: ClosedChain, state: SimulationState, drive: Drive, motors: Motors, options: _Options
) -> Simulation:
    dt = options.dt
    count = _steps(options.duration, dt)
    stride = _stride(count, dt, options.record_rate)
    watch = max(1, round(1 / (_WATCH_RATE * dt)))
    bank = MotorBank(chain, motors)
    # Four calls a step of the fixed method; SciPy's own number is not known beforehand.
    kernels = simulation_kernels(chain, 4 * count, options.kernels)
    plant = Plant(chain, state.q, state.v, bank.inertia, kernels)
    drive.hold(state.held)
    watcher = Watcher(chain, bank, options.singular)
    recorder = Recorder(chain, count // stride + 2)
    motor_q, motor_v = chain.motor_q_index, chain.motor_index

    def rates(t: float, q: Configuration, v: Tangent, x: FloatArray) -> tuple[Tangent, FloatArray]:
        if not math.isfinite(v @ v):
            raise ConvergenceError("the velocity grows beyond all numbers", residual=math.inf)
        controller_state, rate = x[2:], v[motor_v]
        given = bank.delivered(drive.effort(t, q, v, controller_state), rate)
        loss, heat = bank.losses(q[motor_q], rate)
        x_rate = np.empty(x.size)
        x_rate[0], x_rate[1] = given @ rate, heat
        x_rate[2:] = drive.state_rate(t, q, v, controller_state)
        return plant.acceleration(q, v, given + loss), x_rate

    if options.method == "fixed":
        stepper = RungeKuttaStepper(plant, rates)
    else:
        stepper = ChartStepper(plant, rates, options.method, options.rtol, options.atol)

    def record(t: float, phase: Phase) -> None:
        a, _ = rates(t, phase.q, phase.v, phase.x)
        given = bank.delivered(drive.effort(t, phase.q, phase.v, phase.x[2:]), phase.v[motor_v])
        energy = plant.energy(phase.q, phase.v) + bank.stored(phase.q[motor_q])
        recorder.add(t, phase.q, phase.v, a, given, (energy, phase.x[0], phase.x[1], phase.gap))

    def events(k: int, phase: Phase) -> list[Event]:
        t = state.origin + k * dt
        found = watcher.limits(t, phase.q, phase.v, drive.effort(t, phase.q, phase.v, phase.x[2:]))
        if k % watch == 0:
            plant.watch(phase.q, phase.v)
            found += watcher.singularity(t, phase.q)
        return found

    q, v, gap = _closed(plant, state.q, state.v)
    x = np.concatenate([[state.supplied, state.dissipated], state.controller])
    phase, k, largest = Phase(q, v, x, gap), state.steps, gap
    last, recorded, sampled = k + count, -1, state.sampled
    reason, mute = "", False
    try:
        while True:
            t = state.origin + k * dt
            if drive.every and k % drive.every == 0 and k != sampled:
                x = phase.x.copy()
                x[2:] = drive.sample(t, phase.q, phase.v, x[2:])
                phase, sampled = phase._replace(x=x), k
                stepper.restart()
            if (k - state.steps) % stride == 0 or k == last:
                record(t, phase)
                recorded = k
            stopping = [event for event in events(k, phase) if event.kind in options.stop_on]
            if stopping:
                reason = f"stopped at {stopping[0]}"
            if reason or k == last:
                break
            moved = stepper.advance(t, phase, dt)
            # One assignment: an interrupt leaves the state before the step or the one after it.
            phase, k = moved, k + 1
            largest = max(largest, phase.gap)
            if options.progress and (k % watch == 0 or k == last):
                options.progress("simulation", k - state.steps, count)
    except ClosureError as error:
        culprit = str(error).split(" row ")[0]
        watcher.note(Event(state.origin + (k + 1) * dt, "closure_lost", culprit, error.residual, 0.0))
        reason = f"loops lost in the step from {state.origin + k * dt:g} s: {error}; choose a smaller dt"
    except (ConvergenceError, np.linalg.LinAlgError) as error:
        worst = chain.tangent_names[int(np.argmax(np.abs(phase.v / chain.tangent_scale)))]
        watcher.note(Event(state.origin + (k + 1) * dt, "diverged", worst, math.inf, 0.0))
        reason = f"diverged in the step from {state.origin + k * dt:g} s: {error}; choose a smaller dt"
    except ControllerFailure as error:
        if recorded < 0:
            raise InputError(str(error)) from error
        watcher.note(Event(state.origin + k * dt, "controller", ", ".join(chain.motors), math.nan, math.nan))
        reason, mute = str(error), True
    except KeyboardInterrupt:
        reason = f"interrupted at {state.origin + k * dt:g} s"
    if recorded != k and not mute:
        record(state.origin + k * dt, phase)
    final = replace(
        state,
        steps=k,
        q=phase.q,
        v=phase.v,
        controller=phase.x[2:],
        held=drive.held,
        sampled=sampled,
        supplied=float(phase.x[0]),
        dissipated=float(phase.x[1]),
    )
    return recorder.finish(
        largest_gap=largest,
        events=watcher.events,
        dropped=watcher.dropped,
        final_state=final,
        success=not reason,
        reason=reason or "reached the end",
    )


def _closed(plant: Plant, q: Configuration, v: Tangent) -> tuple[Configuration, Tangent, float]:
    """Remove what a printed or computed state lacks of closed loops."""
    State(plant.chain, q, v).require_moving()
    return plant.project(q, v)


def _steps(duration: float, dt: float) -> int:
    duration = as_positive("duration", duration)
    count = max(1, round(duration / dt))
    if abs(count * dt - duration) > 1e-6 * duration:
        raise InputError(
            f"duration {duration:g} s must be a multiple of dt = {dt:g} s; choose dt = {duration / count:.12g} s"
        )
    return count


def _stride(count: int, dt: float, record_rate: float | None) -> int:
    if record_rate is None:
        return -(-count // _FEW_RECORDS)
    stride = max(1, round(1 / (as_positive("record_rate", record_rate) * dt)))
    if count // stride > _MOST_RECORDS:
        raise InputError(
            f"record_rate {record_rate:g}/s gives {count // stride} records; ask for {_MOST_RECORDS} at most"
        )
    return stride


def _kinds(stop_on: Collection[str]) -> frozenset[str]:
    kinds = frozenset([stop_on] if isinstance(stop_on, str) else stop_on)
    if kinds - set(KINDS):
        raise InputError(f"stop_on must be some of {', '.join(KINDS)}, got {sorted(kinds - set(KINDS))}")
    return kinds
