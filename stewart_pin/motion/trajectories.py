"""Motions of a platform over time, with their exact derivatives: sinusoids, chirps, moves, splines through poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array, as_positive
from stewart_pin.errors import InputError
from stewart_pin.state.configurations import as_pose
from stewart_pin.typing import ArrayLike, FloatArray

_SIZES: dict[str, tuple[int, ...]] = {
    "time": (),
    "position": (3,),
    "rotation": (3, 3),
    "twist": (6,),
    "acceleration": (6,),
}
"""Shape of each array of a motion at one instant."""


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

    Raises
    ------
    InputError
        If the arrays are not of as many instants, or of other shapes.
    """

    time: FloatArray
    position: FloatArray
    rotation: FloatArray
    twist: FloatArray
    acceleration: FloatArray

    def __post_init__(self) -> None:
        count = np.size(self.time)
        for name, size in _SIZES.items():
            found = np.shape(getattr(self, name))
            if found != (count, *size):
                raise InputError(
                    f"{name} must have shape {(count, *size)}, one row for each of {count} times, got {found}"
                )

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


# ----------------------------------------------------------------------------------------------------
# Test motions beside sinusoids: chirps, minimum-jerk moves, and splines through poses
# ----------------------------------------------------------------------------------------------------


def chirp_motion(
    time: ArrayLike,
    *,
    home: pin.SE3,
    direction: ArrayLike = (0.0, 0.0, 1.0),
    amplitude: float = 0.01,
    start_frequency: float = 0.5,
    end_frequency: float = 10.0,
    duration: float,
) -> PlatformSamples:
    """Shake along one direction with a frequency that rises linearly.

    Parameters
    ----------
    time
        (N,) instants within 0 and the duration [s].
    home
        Platform frame in the world that the motion starts from.
    direction
        (3,) in the world, dimensionless; its length does not matter.
    amplitude
        Of the displacement [m].
    start_frequency, end_frequency
        At 0 and at the duration [Hz].
    duration
        Time of the sweep [s].

    Returns
    -------
    PlatformSamples
        ``amplitude · sin φ(t)`` with ``φ' = 2π (f0 + (f1 - f0) t / duration)``, orientation kept.

    Raises
    ------
    InputError
        If an instant lies outside the sweep, or a number makes no sense.
    """
    duration = as_positive("duration", duration)
    time = _times(time, duration)
    unit = _unit(direction)
    home = as_pose("home", home)
    f0, f1 = as_positive("start_frequency", start_frequency), as_positive("end_frequency", end_frequency)
    slope = 2 * np.pi * (f1 - f0) / duration
    phase = 2 * np.pi * f0 * time + slope * time**2 / 2
    rate = 2 * np.pi * f0 + slope * time
    move = amplitude * np.sin(phase)
    speed = amplitude * rate * np.cos(phase)
    push = amplitude * (slope * np.cos(phase) - rate**2 * np.sin(phase))
    still = np.zeros((time.size, 3))
    return PlatformSamples(
        time=time,
        position=home.translation + np.outer(move, unit),
        rotation=np.broadcast_to(home.rotation, (time.size, 3, 3)),
        twist=np.hstack([np.outer(speed, unit), still]),
        acceleration=np.hstack([np.outer(push, unit), still]),
    )


def minimum_jerk_motion(time: ArrayLike, *, start: pin.SE3, end: pin.SE3, duration: float) -> PlatformSamples:
    """Move from rest to rest with the least integral of squared jerk.

    The origin moves on a straight line, the orientation about one fixed axis.

    Parameters
    ----------
    time
        (N,) instants within 0 and the duration [s].
    start, end
        Platform frames in the world.
    duration
        Time of the move [s].

    Returns
    -------
    PlatformSamples
        The share of the way is ``10 τ³ - 15 τ⁴ + 6 τ⁵`` [1]_, τ = t / duration.

    References
    ----------
    .. [1] T. Flash, N. Hogan, "The coordination of arm movements", J. Neuroscience, 1985, eq. (A.12).
    """
    duration = as_positive("duration", duration)
    time = _times(time, duration)
    start, end = as_pose("start", start), as_pose("end", end)
    t = time / duration
    share = t**3 * (10 + t * (-15 + 6 * t))
    rate = t**2 * (30 + t * (-60 + 30 * t)) / duration
    bend = t * (60 + t * (-180 + 120 * t)) / duration**2
    # World rotation vector from start to end: R(s) = exp(s φ) R_start, so ω = φ ds/dt.
    turn = Rotation.from_matrix(end.rotation @ start.rotation.T).as_rotvec()
    way = np.concatenate([end.translation - start.translation, turn])
    return PlatformSamples(
        time=time,
        position=start.translation + np.outer(share, way[:3]),
        rotation=Rotation.from_rotvec(np.outer(share, turn)).as_matrix() @ start.rotation,
        twist=np.outer(rate, way),
        acceleration=np.outer(bend, way),
    )


def spline_motion(time: ArrayLike, *, knots: ArrayLike, poses: Sequence[pin.SE3]) -> PlatformSamples:
    """Move smoothly through poses, starting and ending at rest.

    Parameters
    ----------
    time
        (N,) instants within the first and the last knot [s].
    knots
        (K,) rising instants of the poses, K >= 2 [s].
    poses
        K platform frames in the world.

    Returns
    -------
    PlatformSamples
        Positions by a cubic spline, orientations by a cubic spline of rotations, both eased in over the first segment
        and out over the last, from zero velocity and acceleration; acceleration is continuous.

    Raises
    ------
    InputError
        If the knots do not rise, their number differs from that of the poses, or an instant lies outside.
    """
    knots = as_array("knots", knots, (None,))
    if knots.size < 2 or (np.diff(knots) <= 0).any():
        raise InputError(f"knots must be two or more rising instants, got {knots}")
    if len(poses) != knots.size:
        raise InputError(f"there are {knots.size} knots and {len(poses)} poses; give one pose per knot")
    poses = [as_pose(f"poses[{k}]", pose) for k, pose in enumerate(poses)]
    time = as_array("time", time, (None,))
    if time.size and (time.min() < knots[0] or time.max() > knots[-1]):
        raise InputError(f"time must lie within the knots, {knots[0]:g} to {knots[-1]:g} s")
    along, rate, bend = _eased(time, knots)
    line = CubicSpline(knots, np.array([pose.translation for pose in poses]), bc_type="natural")
    turn = RotationSpline(knots, Rotation.from_matrix(np.array([pose.rotation for pose in poses])))
    rotation = turn(along).as_matrix()
    # SciPy gives angular rates and accelerations in the turning frame; both have the same vectors in the world.
    first = np.hstack([line(along, 1), np.einsum("nij,nj->ni", rotation, turn(along, 1))])
    second = np.hstack([line(along, 2), np.einsum("nij,nj->ni", rotation, turn(along, 2))])
    return PlatformSamples(
        time=time,
        position=line(along),
        rotation=rotation,
        twist=first * rate[:, None],
        acceleration=second * rate[:, None] ** 2 + first * bend[:, None],
    )


def _eased(time: FloatArray, knots: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Run the first and last segment with a start and a stop: spline parameter, its rate and its second derivative.

    Elsewhere the parameter is time itself, so every pose is met at its knot.
    """
    along, rate, bend = time.copy(), np.ones_like(time), np.zeros_like(time)
    if knots.size == 2:
        a, h = knots[0], knots[1] - knots[0]
        s = (time - a) / h
        along = a + h * s**3 * (10 + s * (-15 + 6 * s))
        return along, s**2 * (30 + s * (-60 + 30 * s)), s * (60 + s * (-180 + 120 * s)) / h
    for end, inner, sign in ((knots[0], knots[1], 1.0), (knots[-1], knots[-2], -1.0)):
        h = abs(inner - end)
        here = (time - end) * sign < h
        s = (time[here] - end) * sign / h
        # The quintic with u = u' = u'' = 0 at the end, u = 1, u' = 1, u'' = 0 at the inner knot; it rises throughout.
        along[here] = end + sign * h * s**3 * (6 + s * (-8 + 3 * s))
        rate[here] = s**2 * (18 + s * (-32 + 15 * s))
        bend[here] = sign * s * (36 + s * (-96 + 60 * s)) / h
    return along, rate, bend


def _times(time: ArrayLike, duration: float) -> FloatArray:
    time = as_array("time", time, (None,))
    if time.size and (time.min() < 0 or time.max() > duration * (1 + 1e-12)):
        raise InputError(
            f"time must lie within 0 and the duration {duration:g} s, got up to {time.max():g} s"
        )
    return time


def _unit(direction: ArrayLike) -> FloatArray:
    vector = as_array("direction", direction, (3,))
    size = np.linalg.norm(vector)
    if size == 0:
        raise InputError("direction must not be zero")
    return vector / size
