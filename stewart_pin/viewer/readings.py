"""What a robot shows where it stands: efforts of motors at rest, strokes left, how near trouble is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.errors import StewartPinError
from stewart_pin.mechanics.inverse_dynamics import inverse_dynamics
from stewart_pin.mechanics.singularity import MEANING, SingularityKind, classify_singularity
from stewart_pin.state.state import State
from stewart_pin.typing import FloatArray


@dataclass(frozen=True)
class MotorReading:
    """One motor.

    Attributes
    ----------
    name
        Its joint.
    position
        Its coordinate [m or rad].
    rate
        Rate of that [m/s or rad/s].
    is_length
        Whether it is a length.
    effort
        What holds the robot at rest, or moves it as it is moved; nan where nothing does [N or N m].
    stroke_left
        Share of its range to the nearer limit, 0 at a limit and 0.5 in the middle; nan without limits.
    effort_share
        Effort as a share of its limit, with its sign; nan without a limit.
    """

    name: str
    position: float
    rate: float
    is_length: bool
    effort: float
    stroke_left: float
    effort_share: float


@dataclass(frozen=True, eq=False)
class Readings:
    """All that is shown of a state.

    Attributes
    ----------
    pose
        Platform frame in the world, or None without a platform.
    motors
        In the order of ``chain.motors``.
    moving
        Whether it is an instant of a motion.
    condition
        Condition number of the map from platform twists to motor rates, nan where there is none.
    nearest, distance
        Kind of singularity that is nearest, in words, and its singular value in robot sizes and radians.
    exceeded
        Limits that do not hold.
    missing
        Why there are no efforts or distances; empty where there are.
    """

    pose: pin.SE3 | None
    motors: tuple[MotorReading, ...]
    moving: bool
    condition: float
    nearest: str
    distance: float
    exceeded: tuple[str, ...]
    missing: str


def read_state(
    state: State, tau_motor: FloatArray | None = None, *, load: FloatArray | None = None
) -> Readings:
    """Compute what is shown of a state.

    Parameters
    ----------
    state
        Loops closed.
    tau_motor
        (nu,) efforts that move it; default: those that hold it at rest [N or N m].
    load
        (6,) [force; moment] on the platform at its origin, world axes, that it is to be held under; default: none
        [N, N m].

    Returns
    -------
    Readings
        The numbers.
    """
    chain = state.chain
    rest = State(chain, state.q)
    efforts, missing = np.full(chain.nu, np.nan), ""
    if tau_motor is not None:
        efforts = tau_motor
    elif chain.nu:
        try:
            wrenches = None if load is None or chain.platform is None else {chain.platform: load}
            efforts = inverse_dynamics(rest, wrenches=wrenches).tau_motor
        except StewartPinError as error:
            missing = f"no efforts: {error}"
    else:
        missing = "no efforts: the chain has no motors"
    condition, nearest, distance = np.nan, "", np.nan
    try:
        found = classify_singularity(rest)
        condition = found.condition_number if chain.nu and chain.platform is not None else np.nan
        kind = min(found.measures, key=lambda kind: found.measures[kind])
        nearest, distance = MEANING[SingularityKind(kind)], float(found.measures[kind])
    except StewartPinError as error:
        missing = missing or f"no distance to singularities: {error}"
    positions = rest.q[chain.motor_q_index]
    limits, most = chain.limits.position[chain.motor_index], chain.limits.effort[chain.motor_index]
    motors = tuple(
        MotorReading(
            name,
            float(positions[k]),
            float(state.v[chain.motor_index[k]]),
            not bool(chain.angle_mask[chain.motor_index[k]]),
            float(efforts[k]),
            _stroke_left(float(positions[k]), *map(float, limits[k])),
            _share(float(efforts[k]), *map(float, most[k])),
        )
        for k, name in enumerate(chain.motors)
    )
    return Readings(
        pose=None if chain.platform is None else rest.pose,
        motors=motors,
        moving=tau_motor is not None,
        condition=condition,
        nearest=nearest,
        distance=distance,
        exceeded=tuple(map(str, chain.judge.positions(rest.q))),
        missing=missing,
    )


def _stroke_left(position: float, low: float, high: float) -> float:
    return min(position - low, high - position) / (high - low) if high > low else np.nan


def _share(effort: float, low: float, high: float) -> float:
    bound = high if effort >= 0 else -low
    return effort / bound if bound > 0 and np.isfinite(bound) else np.nan
