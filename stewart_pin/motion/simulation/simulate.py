"""The verb: simulate a closed chain under a controller, from a state or from where an earlier run ended."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from stewart_pin.checks import as_array, as_positive
from stewart_pin.errors import ClosureError, ConvergenceError, InputError, SingularityError
from stewart_pin.kernels.choosing import simulation_kernels
from stewart_pin.motion.simulation.drive import (
    Controller,
    ControllerFailure,
    Drive,
    DynamicController,
    Flow,
    Sampled,
)
from stewart_pin.motion.simulation.events import (
    KINDS,
    SHARE,
    EnergyAccount,
    Event,
    EventKind,
    LoopNearness,
    Watcher,
)
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
    METHODS,
    ChartStepper,
    Phase,
    RungeKuttaStepper,
    ScipyMethod,
)
from stewart_pin.state.chain import ClosedChain, as_configuration
from stewart_pin.state.state import State, as_chain
from stewart_pin.tolerances import EPS
from stewart_pin.typing import ArrayLike, Configuration, Tangent

_FEW_RECORDS = 10_000
"""Instants recorded when no rate is asked for."""
_MOST_RECORDS = 2_000_000
_MOST_STEPS = 1e12
Method = Literal["fixed"] | ScipyMethod
_WATCH_RATE = 50.0
"""How often singularities are looked for, and loop rows chosen anew [1/s]."""

Progress = Callable[[str, int, int], None]
"""Called with the stage, the steps done and their number."""


@dataclass(frozen=True)
class _Options:
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


def simulate(
    chain: ClosedChain,
    q: ArrayLike,
    v: ArrayLike,
    controller: Controller | DynamicController | Sampled | None = None,
    *,
    duration: float,
    dt: float = 1e-3,
    method: Method = "fixed",
    motors: Motors | None = None,
    start_time: float = 0.0,
    record_rate: float | None = None,
    singular: float = 1e-3,
    stop_on: EventKind | Collection[EventKind] = (),
    rtol: float = 1e-9,
    atol: float = 1e-9,
    kernels: bool | None = None,
    progress: Progress | None = None,
) -> Simulation:
    """Simulate a closed chain; its loops stay closed to round-off for a run of any length.

    Nothing that happens within the run is raised: it is named in the result, which holds all that was recorded.
    A step that is too large for the motion is found by the energy account, at each recorded instant: what was gained
    or lost may be 1 % of what the motion exchanged or held, and then the run ends. Ctrl-C reaches the caller, as a
    `SimulationInterrupted` with the part that ran.

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
        lengths in robot sizes, looked for 50 times per second; and of the loops, as a share of its usual size, looked
        for as often as the motion asks for.
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
    SimulationInterrupted
        If the user interrupts the run; a `KeyboardInterrupt` whose `simulation` is the part that ran.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> fall = stp.simulate(chain, chain.q_home, np.zeros(chain.nv), duration=0.1, dt=1e-3)
    >>> fall.success, fall.largest_gap < 1e-10, bool(abs(fall.energy[-1] - fall.energy[0]) < 1e-9)
    (True, True, True)
    """
    as_chain(chain)
    q, v = as_configuration(chain, "q", q), as_array("v", v, (chain.nv,))
    dt = as_positive("dt", _number("dt", dt))
    drive = Drive(chain, controller, dt)
    start_time = _number("start_time", start_time)
    state = SimulationState(start_time, 0, dt, q, v, np.zeros(drive.state_size), np.zeros(chain.nu))
    options = _options(duration, dt, method, record_rate, singular, stop_on, rtol, atol, kernels, progress)
    return _run(chain, state, drive, _motors(motors), options)


def _motors(motors: Motors | None) -> Motors:
    if motors is not None and not isinstance(motors, Motors):
        raise InputError(f"motors must be Motors, got {type(motors).__name__}")
    return motors or Motors()


def resume(
    chain: ClosedChain,
    state: SimulationState,
    controller: Controller | DynamicController | Sampled | None = None,
    *,
    duration: float,
    dt: float | None = None,
    method: Method = "fixed",
    motors: Motors | None = None,
    record_rate: float | None = None,
    singular: float = 1e-3,
    stop_on: EventKind | Collection[EventKind] = (),
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
        As in `simulate`; `kernels` None: as in the earlier run.

    Returns
    -------
    Simulation
        The further motion; its first record is the state passed. With the same arguments it has the bits of a run that
        was not cut.

    Raises
    ------
    InputError
        If an argument makes no sense, or the state is that of another controller.
    SimulationInterrupted
        As in `simulate`.
    """
    if not isinstance(state, SimulationState):
        raise InputError(f"state must be the final_state of a simulation, got {type(state).__name__}")
    as_configuration(chain, "state.q", state.q)
    as_array("state.v", state.v, (chain.nv,))
    as_array("state.held", state.held, (chain.nu,))
    dt = state.dt if dt is None else as_positive("dt", _number("dt", dt))
    drive = Drive(chain, controller, dt)
    if state.controller.shape != (drive.state_size,):
        raise InputError(
            f"state belongs to another controller, with {state.controller.size} states; this one has "
            f"{drive.state_size}"
        )
    if dt != state.dt:
        acted = 0 if state.sampled == state.steps else -1
        state = replace(state, origin=state.time, steps=0, dt=dt, sampled=acted)
    if kernels is None and state.memory is not None:
        kernels = state.memory.plant.kernel or state.memory.plant.projector
    options = _options(duration, dt, method, record_rate, singular, stop_on, rtol, atol, kernels, progress)
    return _run(chain, state, drive, _motors(motors), options)


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
    loops = LoopNearness(plant.chain, options.singular)
    memory, pending = state.memory, list[Event]()
    account = EnergyAccount(plant.weight_by_size, None if memory is None else memory.account)
    motor_q, flow = chain.motor_q_index, Flow(drive, bank, plant)

    def passed(t: float, h: float, before: Phase, after: Phase) -> None:
        near = loops.passed(h, before.q, before.v, after.q)
        if near:
            pending.append(watcher.note(Event(t, "singularity", near[1], near[0], loops.limit)))

    if options.method == "fixed":
        stepper = RungeKuttaStepper(plant, flow.rates, passed)
    else:
        stepper = ChartStepper(plant, flow.rates, options.method, options.rtol, options.atol, passed)
    if memory is not None:
        plant.recall(memory.plant)
        watcher.memory, loops.memory = memory.watcher, memory.loops
        stepper.first_step, stepper.doubt = memory.first_step, memory.doubt

    def record(t: float, phase: Phase) -> str:
        """Record an instant, and say what is wrong with its energy."""
        here = t, phase.q, phase.v, phase.x
        a, given = flow.rates(*here)[0], flow.delivered(*here)
        kinetic, potential = plant.energy(phase.q, phase.v)
        potential += bank.stored(phase.q[motor_q])
        numbers = (kinetic + potential, phase.x[0], phase.x[1], phase.gap)
        recorder.add(t, phase.q, phase.v, a, given, numbers)
        error, scale = account.off(kinetic, potential, phase.x[0], phase.x[1], stepper.doubt, k == last)
        if not error:
            return ""
        watcher.note(Event(t, "energy", "energy", error, SHARE * scale))
        remedy = (
            f"the step dt = {dt:g} s is too large for this motion; choose a smaller dt, or method='DOP853'"
            if options.method == "fixed"
            else f"choose smaller rtol and atol than {options.rtol:g} and {options.atol:g}, or another method"
        )
        return (
            f"energy account off at {t:g} s by {error:.3g} J of {scale:.3g} J that the motion holds: {remedy}"
        )

    def events(k: int, phase: Phase) -> list[Event]:
        t = state.origin + k * dt
        found = watcher.limits(t, phase.q, phase.v, flow.command(t, phase.q, phase.v, phase.x))
        if k % watch == 0:
            plant.watch(phase.q, phase.v)
            flow.forget()
            found += watcher.singularity(t, phase.q)
        found += pending
        pending.clear()
        return found

    q, v, gap = _closed(plant, state)
    x = np.concatenate([[state.supplied, state.dissipated], state.controller])
    phase, k, largest = Phase(q, v, x, gap), state.steps, gap
    last, recorded, sampled = k + count, -1, state.sampled
    reason, mute = "", False
    interrupt: KeyboardInterrupt | None = None
    try:
        while True:
            t = state.origin + k * dt
            if drive.every and k % drive.every == 0 and k != sampled:
                x = phase.x.copy()
                x[2:] = drive.sample(t, phase.q, phase.v, x[2:])
                phase, sampled = phase._replace(x=x), k
                stepper.restart()
            if (k - state.steps) % stride == 0 or k == last:
                reason = record(t, phase)
                recorded = k
            stopping = [event for event in events(k, phase) if event.kind in options.stop_on]
            if stopping and not reason:
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
        remedy = (
            "choose a smaller dt"
            if options.method == "fixed"
            else "choose another method or larger tolerances"
        )
        reason = f"loops lost in the step from {state.origin + k * dt:g} s: {error}; {remedy}"
    except SingularityError as error:
        worst = chain.tangent_names[int(np.argmax(np.abs(phase.v / chain.tangent_scale)))]
        measure = error.smallest_singular_value
        watcher.note(Event(state.origin + (k + 1) * dt, "singularity", worst, measure, loops.limit))
        reason = f"singular in the step from {state.origin + k * dt:g} s: {error}"
    except (ConvergenceError, np.linalg.LinAlgError) as error:
        worst = chain.tangent_names[int(np.argmax(np.abs(phase.v / chain.tangent_scale)))]
        watcher.note(Event(state.origin + (k + 1) * dt, "diverged", worst, math.inf, 0.0))
        reason = f"diverged in the step from {state.origin + k * dt:g} s: {error}; choose a smaller dt"
    except ControllerFailure as error:
        if recorded < 0:
            raise InputError(str(error)) from error
        watcher.note(Event(state.origin + k * dt, "controller", ", ".join(chain.motors), math.nan, math.nan))
        reason, mute = str(error), True
    except KeyboardInterrupt as error:
        reason, interrupt = f"interrupted at {state.origin + k * dt:g} s", error
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
        memory=Memory(
            phase.q,
            phase.v,
            plant.memory,
            phase.gap,
            stepper.first_step,
            account.memory,
            stepper.doubt,
            watcher.memory,
            loops.memory,
        ),
    )
    simulation = recorder.finish(
        largest_gap=largest,
        events=watcher.events,
        dropped=watcher.dropped,
        final_state=final,
        success=not reason,
        reason=reason or "reached the end",
    )
    if interrupt is not None:
        raise SimulationInterrupted(reason, simulation) from interrupt
    return simulation


def _closed(plant: Plant, start: SimulationState) -> tuple[Configuration, Tangent, float]:
    """Remove what a printed or computed state lacks of closed loops; nothing from one that a run left."""
    state = State(plant.chain, start.q, start.v)
    state.require_moving()
    left = start.memory
    if left is not None and np.array_equal(left.q, start.q) and np.array_equal(left.v, start.v):
        return start.q, start.v, left.gap
    return plant.project(start.q, start.v)


def _options(
    duration: float,
    dt: float,
    method: Method,
    record_rate: float | None,
    singular: float,
    stop_on: EventKind | Collection[EventKind],
    rtol: float,
    atol: float,
    kernels: bool | None,
    progress: Progress | None,
) -> _Options:
    if method not in ("fixed", *METHODS):
        raise InputError(f"method must be 'fixed' or one of {', '.join(METHODS)}, got {method!r}")
    if progress is not None and not callable(progress):
        raise InputError(f"progress must be a function (stage, done, total) or None, got {progress!r}")
    rtol, atol = _number("rtol", rtol), _number("atol", atol)
    for name, value, low, high in (("rtol", rtol, 100 * EPS, 0.1), ("atol", atol, 0.0, 0.1)):
        if not low < value <= high:
            raise InputError(
                f"{name} must be above {low:.2g} and at most {high:g}, got {value:g}; 1e-9 is usual"
            )
    singular = _number("singular", singular)
    if not 0.0 <= singular < 1.0:
        raise InputError(
            f"singular must be 0 (no events) or more and below 1, got {singular:g}; 1e-3 is usual"
        )
    duration = _number("duration", duration)
    return _Options(
        duration, dt, method, record_rate, singular, _kinds(stop_on), rtol, atol, kernels, progress
    )


def _number(name: str, value: float) -> float:
    """Return a finite number; text and truth values are none."""
    wrong = isinstance(value, (str, bytes, bool, np.bool_)) or np.ndim(value) or np.iscomplexobj(value)
    try:
        number = math.nan if wrong else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{name} must be a finite number, got {value!r}")
    return number


def _steps(duration: float, dt: float) -> int:
    duration = as_positive("duration", duration)
    if not duration / dt < _MOST_STEPS:
        raise InputError(
            f"duration {duration:g} s has more than {_MOST_STEPS:g} steps of dt = {dt:g} s; choose fewer"
        )
    count = max(1, round(duration / dt))
    if abs(count * dt - duration) > 1e-6 * duration:
        raise InputError(
            f"duration {duration:g} s must be a multiple of dt = {dt:g} s; choose dt = {duration / count:.12g} s"
        )
    return count


def _stride(count: int, dt: float, record_rate: float | None) -> int:
    if record_rate is None:
        return -(-count // _FEW_RECORDS)
    rate = as_positive("record_rate", _number("record_rate", record_rate))
    stride = max(1, round(min(1 / (rate * dt), count)))
    if count // stride > _MOST_RECORDS:
        raise InputError(
            f"record_rate {record_rate:g}/s gives {count // stride} records; ask for {_MOST_RECORDS} at most"
        )
    return stride


def _kinds(stop_on: EventKind | Collection[EventKind]) -> frozenset[str]:
    try:
        kinds = frozenset([stop_on] if isinstance(stop_on, str) else stop_on)
    except TypeError:
        raise InputError(f"stop_on must be some of {', '.join(KINDS)}, got {stop_on!r}") from None
    if kinds - set(KINDS):
        raise InputError(
            f"stop_on must be some of {', '.join(KINDS)}, got {sorted(map(str, kinds - set(KINDS)))}"
        )
    return kinds
