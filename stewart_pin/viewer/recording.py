"""A motion to be played: configurations, velocities and efforts at many instants."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from stewart_pin.errors import InputError
from stewart_pin.mechanics.inverse_dynamics import motor_efforts
from stewart_pin.motion.joint_motion import joint_motion
from stewart_pin.motion.motor_demand import MotorDemand
from stewart_pin.motion.simulation.record import Simulation
from stewart_pin.motion.trajectories import PlatformSamples
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.outside import as_wrenches
from stewart_pin.state.state import State
from stewart_pin.typing import FloatArray

Motion: TypeAlias = PlatformSamples | MotorDemand | Simulation
"""What can be played: a motion of the platform, what it asks of the motors, or a simulation."""


@dataclass(frozen=True, eq=False)
class Recording:
    """A motion of all joints.

    Attributes
    ----------
    time
        (N,) instants, rising [s].
    q
        (N, nq) configurations with closed loops [m, rad, unit quaternions].
    v
        (N, nv) tangent velocities [m/s, rad/s].
    tau_motor
        (N, nu) efforts of the motors [N or N m].
    """

    time: FloatArray
    q: FloatArray
    v: FloatArray
    tau_motor: FloatArray

    def at(self, time: float) -> int:
        """Find the instant next to a time.

        Parameters
        ----------
        time
            Since the beginning of time, not of the recording [s].

        Returns
        -------
        int
            Number of the instant.
        """
        after = int(np.clip(np.searchsorted(self.time, time), 1, max(len(self.time) - 1, 1)))
        if len(self.time) == 1:
            return 0
        return after - 1 if time - self.time[after - 1] <= self.time[after] - time else after


def record(chain: ClosedChain, motion: Motion) -> Recording:
    """Follow a motion with all joints.

    Parameters
    ----------
    chain
        Closed chain that moves.
    motion
        What is to be played.

    Returns
    -------
    Recording
        One row per instant.

    Raises
    ------
    ClosureError
        If the chain cannot take a pose, or follow the motion; names the sample.
    InputError
        If it is no motion, or one of another chain, or has no instant.
    """
    if isinstance(motion, Simulation):
        if motion.q.shape[1] != chain.nq or motion.v.shape[1] != chain.nv:
            raise InputError(
                f"the simulation is one of '{motion.chain.name}' with nq {motion.q.shape[1]}, and '{chain.name}' has "
                f"nq {chain.nq}; pass view(simulation.chain, motion=simulation)"
            )
        recording = Recording(motion.time, motion.q, motion.v, motion.tau_motor)
    elif isinstance(motion, PlatformSamples | MotorDemand):
        samples = motion.samples if isinstance(motion, MotorDemand) else motion
        joints = joint_motion(chain, samples, rates=True)
        assert joints.v is not None
        assert joints.a is not None
        acting = motion.wrenches if isinstance(motion, MotorDemand) else None
        efforts = np.empty((len(samples), chain.nu))
        for k, (q, v, a) in enumerate(zip(joints.q, joints.v, joints.a, strict=True)):
            # By name: a demand may be one of another chain, with other numbers of joints.
            outside = None if acting is None else as_wrenches(chain, acting.at(k).by_link())
            if chain.nu:
                efforts[k] = motor_efforts(State(chain, q, v), a, outside)
        recording = Recording(samples.time, joints.q, joints.v, efforts)
    else:
        raise InputError(
            "motion must be a motion of the platform (PlatformSamples), a MotorDemand or a Simulation, got "
            f"{type(motion).__name__}"
        )
    if not len(recording.time):
        raise InputError("motion holds no instant, there is nothing to play")
    return recording
