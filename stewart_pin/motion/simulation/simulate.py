"""The verb: simulate a closed chain under a controller, from a state or from where an earlier run ended."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from stewart_pin.checks import as_array, as_number, as_positive
from stewart_pin.errors import InputError
from stewart_pin.motion.simulation.drive import (
    Controller,
    Drive,
    DynamicController,
    Push,
    Sampled,
    SimulationBase,
    SimulationWrenches,
)
from stewart_pin.motion.simulation.events import (
    KINDS,
    EventKind,
)
from stewart_pin.motion.simulation.motors import Motors
from stewart_pin.motion.simulation.record import (
    Simulation,
    SimulationState,
)
from stewart_pin.motion.simulation.run import Method, Options, Progress, Run
from stewart_pin.motion.simulation.steppers import (
    METHODS,
)
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import as_chain, as_configuration
from stewart_pin.tolerances import EPS
from stewart_pin.typing import ArrayLike


def simulate(
    chain: ClosedChain,
    q: ArrayLike,
    v: ArrayLike,
    controller: Controller | DynamicController | Sampled | None = None,
    *,
    duration: float,
    dt: float = 1e-3,
    method: Method = "fixed",
    wrenches: SimulationWrenches | None = None,
    base_motion: SimulationBase | None = None,
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

    Springs, dampers and dry friction of joints act. What dry friction holds stays where it is to the last bit; the
    instants at which something sticks or slips are found within steps, which end there. Between two steps, or a
    sixteenth of dt with a method of SciPy's, something may be pulled loose and held again unseen: dt has to resolve
    what drives the motion.

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
    wrenches
        What acts from outside: {link: (6,)} [force; moment] on the link, at the origin of its frame, world axes; or a
        function of the instant and the `State`, called like the controller, that returns them, or None; the platform is
        ``chain.platform`` [N, N m].
    base_motion
        How the ground moves: a `dynamics.BaseMotion`, or a function of the instant that returns one. Records are
        relative to the ground, wrenches have the axes of the inertial frame, and what a moving ground makes the bodies
        feel counts as work from outside. Default: it rests.
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
        compared with the careful ways 50 times per second of the run, and left where they lose digits. Under wrenches
        or on a moving ground they compute the projection alone.
    progress
        Told from time to time.

    Returns
    -------
    Simulation
        The recorded motion, and whether and why it ended.

    Raises
    ------
    InputError
        If an argument makes no sense, the state does not keep the loops closed, the controller returns no efforts, the
        function no wrenches, or fixed steps are too long for dampers or springs.
    UnsupportedError
        If dry friction of a ball or a floating joint sticks about some axes alone, with a method of SciPy's.
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
    dt = as_positive("dt", as_number("dt", dt))
    drive = Drive(chain, controller, dt)
    start_time = as_number("start_time", start_time)
    state = SimulationState(start_time, 0, dt, q, v, np.zeros(drive.state_size), np.zeros(chain.nu))
    options = _options(duration, dt, method, record_rate, singular, stop_on, rtol, atol, kernels, progress)
    return Run(chain, state, drive, Push(chain, wrenches, base_motion), _motors(motors), options).go()


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
    wrenches: SimulationWrenches | None = None,
    base_motion: SimulationBase | None = None,
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
    method, wrenches, base_motion, motors, record_rate, singular, stop_on, rtol, atol, kernels, progress
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
    dt = state.dt if dt is None else as_positive("dt", as_number("dt", dt))
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
    return Run(chain, state, drive, Push(chain, wrenches, base_motion), _motors(motors), options).go()


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
) -> Options:
    if method not in ("fixed", *METHODS):
        raise InputError(f"method must be 'fixed' or one of {', '.join(METHODS)}, got {method!r}")
    if progress is not None and not callable(progress):
        raise InputError(f"progress must be a function (stage, done, total) or None, got {progress!r}")
    rtol, atol = as_number("rtol", rtol), as_number("atol", atol)
    for name, value, low, high in (("rtol", rtol, 100 * EPS, 0.1), ("atol", atol, 0.0, 0.1)):
        if not low < value <= high:
            raise InputError(
                f"{name} must be above {low:.2g} and at most {high:g}, got {value:g}; 1e-9 is usual"
            )
    singular = as_number("singular", singular)
    if not 0.0 <= singular < 1.0:
        raise InputError(
            f"singular must be 0 (no events) or more and below 1, got {singular:g}; 1e-3 is usual"
        )
    duration = as_number("duration", duration)
    return Options(
        duration, dt, method, record_rate, singular, _kinds(stop_on), rtol, atol, kernels, progress
    )


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
