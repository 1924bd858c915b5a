"""The public judge of limits: of a state, of what a motion asks for, and of what a simulation did."""

from __future__ import annotations

import numpy as np

from stewart_pin.checks import as_array
from stewart_pin.errors import InputError
from stewart_pin.motion.motor_demand import MotorDemand
from stewart_pin.motion.simulation.record import Simulation
from stewart_pin.state.limits import Asked, Excess
from stewart_pin.state.newton import Closure
from stewart_pin.state.state import State
from stewart_pin.typing import ArrayLike


def limits_exceeded(
    what: State | Closure | MotorDemand | Simulation, *, tau_motor: ArrayLike | None = None
) -> tuple[Excess, ...]:
    """List the limits that do not hold.

    Kinematics, simulations, fits, sweeps, polytopes and the command line ask the same judge.

    Parameters
    ----------
    what
        A state, whose positions, velocities and accelerations are judged, or a solution of kinematics; what a motion
        asks of the motors, by `motor_demand`; or a simulation.
    tau_motor
        (nu,) motor efforts to judge together with a state [N or N m].

    Returns
    -------
    tuple of Excess
        Motors, passive joints and joints that close loops, each with its value, the limit and by how much it is passed;
        of a motion at its worst instant. Empty where all limits hold that are stated.

    Raises
    ------
    InputError
        If it is none of these.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> long = stp.forward_kinematics(chain, [1.85, 1.7, 1.7, 1.7, 1.7, 1.7], limits=False)
    >>> print(*stp.limits_exceeded(long))
    'leg1' at 1.85, allowed 0.5 to 1.8
    """
    if isinstance(what, MotorDemand | Simulation):
        if tau_motor is not None:
            raise InputError("tau_motor is for a state; demands and simulations have efforts of their own")
        return what.check()
    state = what.state if isinstance(what, Closure) else what
    if not isinstance(state, State):
        raise InputError(
            f"limits_exceeded takes a State (chain.at(q, v, a)), a MotorDemand or a Simulation, got "
            f"{type(what).__name__}"
        )
    chain = state.chain
    a = None if state.a is None else state.a[None]
    asked = chain.judge.asked(state.q[None], state.v[None], a)
    if tau_motor is not None:
        efforts = as_array("tau_motor", tau_motor, (chain.nu,))
        asked.append(Asked("effort", np.asarray(chain.motor_index), efforts[None]))
    return chain.judge.excesses(asked)
