"""Platforms as shake tables: how much of a motion their motors can give."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stewart_pin.errors import InputError
from stewart_pin.motion.motor_demand import MotorDemand, motor_demand
from stewart_pin.motion.trajectories import PlatformSamples
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import FloatArray

_ACCURACY = 1e-6
"""Relative accuracy of the scale found."""


@dataclass(frozen=True)
class Binding:
    """The limit that a motion reaches first, relative to what is allowed.

    Attributes
    ----------
    limit
        ``"stroke"``, ``"rate"`` or ``"effort"``.
    motor
        Name of the motor.
    time
        When [s].
    value
        What is asked for [m, rad, m/s, rad/s, N or N m].
    allowed
        What the file allows, less the margin, in the same unit.
    use
        Share of the limit that is used; above 1 it is exceeded. For a stroke, counted from the middle.
    """

    limit: str
    motor: str
    time: float
    value: float
    allowed: float
    use: float


@dataclass(frozen=True, eq=False)
class FitReport:
    """How much of a motion a robot can do.

    Attributes
    ----------
    scale
        Largest factor, at most 1, with all limits respected.
    samples
        The motion at this scale.
    demand
        What it asks of the motors.
    binding
        The limit nearest to being reached at this scale.
    unscaled
        Most used limit of each kind at full scale: why the motion had to be scaled, if it had.
    margin
        Part of every limit that was kept free.
    """

    scale: float
    samples: PlatformSamples
    demand: MotorDemand
    binding: Binding | None
    unscaled: tuple[Binding, ...]
    margin: float


def fit_to_limits(
    chain: ClosedChain, motion: Callable[[float], PlatformSamples], *, margin: float = 0.0
) -> FitReport:
    """Scale a motion down until stroke, rate and effort limits of the file are respected.

    Parameters
    ----------
    chain
        Closed chain.
    motion
        Factor to motion; at factor 0 the platform rests, within all limits.
    margin
        Part of every limit to keep free, from 0 up to but not including 1.

    Returns
    -------
    FitReport
        The largest factor found by bisection, to six digits, and the limit that binds.

    Raises
    ------
    InputError
        If the margin makes no sense, or the limits are exceeded at rest.
    """
    if not 0 <= margin < 1:
        raise InputError(f"margin must be at least 0 and below 1, got {margin}")
    full = _uses(chain, motor_demand(chain, motion(1.0)), margin)
    worst = max(full, key=lambda binding: binding.use, default=None)
    if worst is None or worst.use <= 1:
        return _report(chain, motion, 1.0, full, margin)
    rest = _uses(chain, motor_demand(chain, motion(0.0)), margin)
    resting = max(rest, key=lambda binding: binding.use)
    if resting.use > 1:
        raise InputError(
            f"motion at scale 0 already exceeds the {resting.limit} limit of {resting.motor}: {resting.value:.6g}, "
            f"allowed {resting.allowed:.6g}; choose another home or a smaller margin"
        )
    low, high = 0.0, 1.0
    while high - low > _ACCURACY * high:
        middle = (low + high) / 2
        uses = _uses(chain, motor_demand(chain, motion(middle)), margin)
        if all(binding.use <= 1 for binding in uses):
            low = middle
        else:
            high = middle
    return _report(chain, motion, low, full, margin)


def _report(
    chain: ClosedChain,
    motion: Callable[[float], PlatformSamples],
    scale: float,
    full: tuple[Binding, ...],
    margin: float,
) -> FitReport:
    samples = motion(scale)
    demand = motor_demand(chain, samples)
    uses = _uses(chain, demand, margin)
    return FitReport(
        scale=scale,
        samples=samples,
        demand=demand,
        binding=max(uses, key=lambda binding: binding.use, default=None),
        unscaled=full,
        margin=margin,
    )


def _uses(chain: ClosedChain, demand: MotorDemand, margin: float) -> tuple[Binding, ...]:
    """Most used limit of each kind that the file has."""
    model = chain.model
    free = 1.0 - margin
    lower = model.lowerPositionLimit[chain.motor_q_index]
    upper = model.upperPositionLimit[chain.motor_q_index]
    found: list[Binding] = []
    # A limit that one motor lacks leaves those of the others in force; a stroke with one end counts from there, by the
    # size of the robot.
    size = chain.length_scale
    low, high = (
        np.where(np.isfinite(lower), lower, upper - size),
        np.where(np.isfinite(upper), upper, lower + size),
    )
    known = np.isfinite(low) & np.isfinite(high)
    if known.any():
        middle = np.where(known, (low + high) / 2, 0.0)
        half = np.where(known, free * (high - low) / 2, 1.0)
        off = demand.positions - middle
        above, below = known & np.isfinite(upper), known & np.isfinite(lower)
        use = np.maximum(np.where(above, off / half, 0.0), np.where(below, -off / half, 0.0))
        allowed = middle + np.sign(off) * half
        found.append(_most_used(chain, "stroke", demand.time, use, demand.positions, allowed))
    for name, limit, values in (
        ("rate", model.velocityLimit[chain.motor_index], demand.rates),
        ("effort", model.effortLimit[chain.motor_index], demand.efforts),
    ):
        stated = np.isfinite(limit) & (limit > 0)
        if stated.any():
            allowed = np.broadcast_to(np.where(stated, free * limit, np.inf), values.shape)
            found.append(
                _most_used(chain, name, demand.time, np.abs(values) / allowed, np.abs(values), allowed)
            )
    return tuple(found)


def _most_used(
    chain: ClosedChain, name: str, time: FloatArray, use: FloatArray, values: FloatArray, allowed: FloatArray
) -> Binding:
    at = np.unravel_index(int(np.argmax(use)), use.shape)
    return Binding(
        name,
        chain.motors[int(at[1])],
        float(time[at[0]]),
        float(values[at]),
        float(allowed[at]),
        float(use[at]),
    )
