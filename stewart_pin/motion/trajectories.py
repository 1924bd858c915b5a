"""Motions of a platform over time, with their exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array, as_positive
from stewart_pin.errors import InputError
from stewart_pin.state.chain import as_pose
from stewart_pin.typing import ArrayLike, FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class PlatformSamples(Brief):
    """A platform motion at many instants.

    Attributes
    ----------
    time
        (N,) [s].
    position
        (N, 3) platform origin in the world [m].
    rotation
        (N, 3, 3) platform axes in the world.
    twist
        (N, 6) velocity of the origin and angular velocity, world axes [m/s, rad/s].
    acceleration
        (N, 6) acceleration of the origin and angular acceleration, world axes [m/s², rad/s²].
    """

    time: FloatArray
    position: FloatArray
    rotation: FloatArray
    twist: FloatArray
    acceleration: FloatArray

    def __len__(self) -> int:
        return self.time.size

    def pose(self, k: int) -> pin.SE3:
        """Return one pose.

        Parameters
        ----------
        k
            Index of the instant.

        Returns
        -------
        pinocchio.SE3
            Platform frame in the world.
        """
        return pin.SE3(self.rotation[k], self.position[k])


def sample_times(duration: float, rate: float) -> FloatArray:
    """Divide a duration into equal steps.

    Parameters
    ----------
    duration
        Length of the motion [s].
    rate
        States per second [1/s].

    Returns
    -------
    numpy.ndarray
        (N,) instants from 0 on, N = duration · rate rounded, the end excluded [s].

    Raises
    ------
    InputError
        If no instant or more than ten million result.
    """
    count = round(as_positive("duration", duration) * as_positive("rate", rate))
    if not 1 <= count <= 10_000_000:
        raise InputError(
            f"duration {duration:g} s at rate {rate:g}/s gives {count} states; choose 1 to 10 000 000"
        )
    return np.arange(count) / rate


def sinusoidal_motion(
    time: ArrayLike,
    *,
    home: pin.SE3,
    amplitude: ArrayLike = (0.02, 0.02, 0.02),
    frequency: ArrayLike = (1.0, 3.0, 4.5),
) -> PlatformSamples:
    """Shake the platform along x, y and z, each at its own frequency.

    The defaults are the composite earthquake motion of the source report: x 1 Hz, y 3 Hz, z 4.5 Hz. A single
    frequency is the same with two amplitudes zero.

    Parameters
    ----------
    time
        (N,) instants [s].
    home
        Platform frame in the world that the motion starts from.
    amplitude
        (3,) of the displacements along the world axes [m].
    frequency
        (3,) [Hz].

    Returns
    -------
    PlatformSamples
        ``amplitude · sin(2π · frequency · time)`` about home, orientation kept.

    Raises
    ------
    InputError
        If a frequency is negative, or an array has the wrong shape.
    """
    time = as_array("time", time, (None,))
    amplitude, frequency = as_array("amplitude", amplitude, (3,)), as_array("frequency", frequency, (3,))
    if (frequency < 0).any():
        raise InputError(f"frequency must be 0 or more, got {frequency.min():g} Hz")
    home = as_pose("home", home)
    omega = 2 * np.pi * frequency
    phase = omega * time[:, None]
    still = np.zeros((time.size, 3))
    return PlatformSamples(
        time=time,
        position=home.translation + amplitude * np.sin(phase),
        rotation=np.broadcast_to(home.rotation, (time.size, 3, 3)),
        twist=np.hstack([amplitude * omega * np.cos(phase), still]),
        acceleration=np.hstack([-amplitude * omega**2 * np.sin(phase), still]),
    )
