"""Six-legged platforms as shake tables: what a motion asks of the motors, and how much of it they can give."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from stewart_pin.building.hexapod_bodies import hexapod_bodies
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.geometry.hexapod import Hexapod, leg_lengths
from stewart_pin.geometry.hexapod_dynamics import hexapod_inverse_dynamics
from stewart_pin.geometry.leg_motion import leg_rates
from stewart_pin.kernels.choosing import kernels_for
from stewart_pin.kernels.compile import Kernels
from stewart_pin.mechanics.inverse_dynamics import inverse_dynamics
from stewart_pin.mechanics.kinematics import platform_motion, platform_pose
from stewart_pin.model.chain import ClosedChain
from stewart_pin.model.description import JointKind
from stewart_pin.motion.trajectories import PlatformSamples
from stewart_pin.typing import FloatArray

_ACCURACY = 1e-6
"""Relative accuracy of the scale found."""


@dataclass(frozen=True, eq=False)
class MotorDemand:
    """What a motion asks of the motors.

    Attributes
    ----------
    time
        (N,) [s].
    positions
        (N, nu) [m or rad].
    rates
        (N, nu) [m/s or rad/s].
    efforts
        (N, nu) [N or N m].
    """

    time: FloatArray
    positions: FloatArray
    rates: FloatArray
    efforts: FloatArray


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


def motor_demand(chain: ClosedChain, samples: PlatformSamples, *, kernels: bool | None = None) -> MotorDemand:
    """Compute what a platform motion asks of the motors, position limits ignored.

    Parameters
    ----------
    chain
        Closed chain.
    samples
        Motion of the platform.
    kernels
        Whether to use compiled kernels where there is no closed form; None: for more than a handful of states.

    Returns
    -------
    MotorDemand
        Positions, rates and efforts; in closed form for six-legged platforms. For other chains by kernels, or state by
        state where a state has no answer, so that the error names it.

    Raises
    ------
    ClosureError
        If the chain cannot take a pose.
    ActuationError
        If the motors cannot hold it.
    """
    try:
        hexapod, bodies = Hexapod.from_chain(chain), hexapod_bodies(chain)
    except UnsupportedError:
        compiled = kernels_for(chain, len(samples), kernels)
        found = None if compiled is None else _by_kernels(compiled, samples)
        return _state_by_state(chain, samples) if found is None else found
    home = platform_pose(chain, chain.q_home)
    # A file may count its strokes from another length than zero.
    offset = chain.q_home[chain.motor_q_index] - leg_lengths(hexapod, home.translation, home.rotation)
    forces = hexapod_inverse_dynamics(
        hexapod,
        bodies,
        samples.position,
        samples.rotation,
        samples.twist,
        samples.acceleration,
        gravity=chain.gravity,
    )
    return MotorDemand(
        time=samples.time,
        positions=leg_lengths(hexapod, samples.position, samples.rotation) + offset,
        rates=leg_rates(hexapod, samples.position, samples.rotation, samples.twist),
        efforts=forces.actuator,
    )


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
    if np.isfinite(lower).all() and np.isfinite(upper).all():
        middle, half = (lower + upper) / 2, free * (upper - lower) / 2
        off = demand.positions - middle
        allowed = middle + np.sign(off) * half
        found.append(_most_used(chain, "stroke", demand.time, np.abs(off) / half, demand.positions, allowed))
    for name, limit, values in (
        ("rate", model.velocityLimit[chain.motor_index], demand.rates),
        ("effort", model.effortLimit[chain.motor_index], demand.efforts),
    ):
        if np.isfinite(limit).all() and (limit > 0).all():
            allowed = free * np.broadcast_to(limit, values.shape)
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


def _by_kernels(kernels: Kernels, samples: PlatformSamples) -> MotorDemand | None:
    """All states at once, or None where one of them has no answer."""
    pose = np.hstack([samples.position, Rotation.from_matrix(samples.rotation).as_quat()])
    positions = kernels.inverse_kinematics(pose)
    rates = np.einsum("nij,nj->ni", kernels.motor_jacobian(pose), samples.twist)
    efforts = kernels.inverse_dynamics(pose, samples.twist, samples.acceleration)
    if not np.isfinite(efforts).all():
        return None
    # Angles are those of home's branch; they go on where a motor has turned further.
    turning = [
        joint.kind is JointKind.REVOLUTE for joint in map(kernels.chain.mechanism.joint, kernels.chain.motors)
    ]
    positions[:, turning] = np.unwrap(positions[:, turning], axis=0)
    return MotorDemand(samples.time, positions, rates, efforts)


def _state_by_state(chain: ClosedChain, samples: PlatformSamples) -> MotorDemand:
    shape = (len(samples), chain.nu)
    positions, rates, efforts = np.empty(shape), np.empty(shape), np.empty(shape)
    q = chain.q_home
    for k in range(len(samples)):
        state = platform_motion(
            chain, samples.pose(k), samples.twist[k], samples.acceleration[k], q_guess=q, limits=False
        )
        q = state.q
        positions[k], rates[k] = q[chain.motor_q_index], state.v[chain.motor_index]
        efforts[k] = inverse_dynamics(chain, q, state.v, state.a).tau_motor
    return MotorDemand(samples.time, positions, rates, efforts)
