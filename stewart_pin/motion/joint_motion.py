"""How all joints move when the platform does: what limits ask of joints that no motor moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stewart_pin.errors import ClosureError
from stewart_pin.mechanics.kinematics import inverse_kinematics, platform_motion
from stewart_pin.model.tree import LimitKind
from stewart_pin.motion.trajectories import PlatformSamples
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.limits import Asked
from stewart_pin.typing import FloatArray


@dataclass(frozen=True, eq=False)
class JointMotion:
    """Motion of all joints, followed from home on one branch.

    Attributes
    ----------
    q
        (N, nq) configurations [m, rad, unit quaternions].
    v
        (N, nv) tangent velocities, or None [m/s, rad/s].
    a
        (N, nv) tangent accelerations, or None [m/s², rad/s²].
    """

    q: FloatArray
    v: FloatArray | None = None
    a: FloatArray | None = None


def joint_motion(
    chain: ClosedChain, samples: PlatformSamples, instants: Sequence[int] | None = None, *, rates: bool
) -> JointMotion:
    """Follow a motion of the platform with all joints, whatever their limits.

    Parameters
    ----------
    chain
        Closed chain.
    samples
        Motion of the platform.
    instants
        Which samples, in their order; default: all [index].
    rates
        Whether velocities and accelerations are wanted as well.

    Returns
    -------
    JointMotion
        One row per instant.

    Raises
    ------
    ClosureError
        If the chain cannot take a pose, or follow the motion; it carries the sample.
    """
    wanted = range(len(samples)) if instants is None else instants
    q = np.empty((len(wanted), chain.nq))
    v, a = np.empty((2, len(wanted), chain.nv))
    guess = None
    for n, k in enumerate(wanted):
        try:
            if rates:
                here = (samples.pose(k), samples.twist[k], samples.acceleration[k])
                state = platform_motion(chain, *here, q_guess=guess, limits=False)
                q[n], v[n], a[n] = state.q, state.v, state.a
            else:
                q[n] = inverse_kinematics(chain, samples.pose(k), q_guess=guess, limits=False).q
        except ClosureError as error:
            error.sample = int(k)
            raise
        guess = q[n]
    return JointMotion(q, v, a) if rates else JointMotion(q)


def asked_of_motors(
    chain: ClosedChain, positions: FloatArray, rates: FloatArray, efforts: FloatArray
) -> list[Asked]:
    """Tell what a motion asks of the motors.

    Parameters
    ----------
    chain
        Closed chain.
    positions
        (N, nu) [m or rad].
    rates
        (N, nu) [m/s or rad/s].
    efforts
        (N, nu) [N or N m].

    Returns
    -------
    list of Asked
        Of the motors that have such a limit.
    """
    found: list[Asked] = []
    asked: tuple[tuple[LimitKind, FloatArray], ...] = (
        ("position", positions),
        ("velocity", rates),
        ("effort", efforts),
    )
    for kind, values in asked:
        has = ~np.isnan(chain.limits.of(kind)[chain.motor_index]).all(axis=1)
        if has.any():
            found.append(Asked(kind, chain.motor_index[has], values[:, has]))
    return found


def asked_of_others(
    chain: ClosedChain, samples: PlatformSamples, instants: Sequence[int] | None = None
) -> list[Asked]:
    """Tell what a motion asks of passive joints and of joints that close loops, and which accelerations of the motors.

    Parameters
    ----------
    chain
        Closed chain.
    samples
        Motion of the platform.
    instants
        Which samples; default: all [index]. Jerks need them all.

    Returns
    -------
    list of Asked
        Of the joints that have such a limit; nothing is computed where none is stated.

    Raises
    ------
    ClosureError
        If the chain cannot take a pose, or follow the motion.
    """
    limits, motors = chain.limits, chain.motor_index
    passive = {kind: np.setdiff1d(limits.stated(kind), motors) for kind in ("position", "velocity")}
    second = limits.stated("acceleration").size or limits.stated("jerk").size
    if not (second or any(rows.size for rows in passive.values())):
        return []
    motion = joint_motion(chain, samples, instants, rates=bool(second or passive["velocity"].size))
    return asked_of_motion(chain, samples.time, motion, leave=motors)


def asked_of_motion(
    chain: ClosedChain, time: FloatArray, motion: JointMotion, *, leave: np.ndarray | None = None
) -> list[Asked]:
    """Tell what a motion of all joints asks of those that have limits, efforts left aside.

    Parameters
    ----------
    chain
        Closed chain.
    time
        (N,) instants [s].
    motion
        Of all joints.
    leave
        Tangent entries whose positions and velocities are not looked at [index].

    Returns
    -------
    list of Asked
        Positions, velocities, accelerations; jerks by differences of the accelerations.
    """
    found = chain.judge.asked(motion.q, motion.v, leave=leave)
    if motion.a is None:
        return found
    found += [each for each in chain.judge.asked(motion.q, motion.v, motion.a) if each.kind == "acceleration"]
    rows = chain.limits.stated("jerk")
    rows = rows[rows < chain.nv]
    if rows.size and len(time) > 1 and len(time) == len(motion.a):
        found.append(Asked("jerk", rows, np.gradient(motion.a[:, rows], time, axis=0)))
    return found
