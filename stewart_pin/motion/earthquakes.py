"""Earthquakes as platform motions: synthetic accelerograms, response spectra, the motion of a shake table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.signal import bilinear, cont2discrete, lfilter, ss2tf

from stewart_pin.checks import as_array, as_count, as_positive
from stewart_pin.errors import InputError
from stewart_pin.motion.accelerograms import Accelerogram, accelerogram, correct_baseline, resample, scaled
from stewart_pin.motion.trajectories import PlatformSamples
from stewart_pin.state.configurations import as_pose
from stewart_pin.typing import ArrayLike, FloatArray

_AXES = ("x", "y", "z")
_LONGEST = 10_000_000
"""Time steps of a record: half a day at a hundredth of a second takes 40 MB; more is a slip."""


def synthetic_accelerogram(
    *,
    seed: int = 0,
    duration: float = 20.0,
    dt: float = 0.005,
    peak: float = 3.0,
    ground_frequency: float = 2.5,
    ground_damping: float = 0.6,
) -> Accelerogram:
    """Make an earthquake: white noise, coloured by the ground, under an envelope.

    Parameters
    ----------
    seed
        Of the noise; the same seed gives the same record.
    duration
        Length [s].
    dt
        Time step [s].
    peak
        Largest absolute acceleration of the corrected record [m/s²].
    ground_frequency
        Resonance of the ground layer; 2.5 Hz is firm soil [Hz].
    ground_damping
        Its damping ratio; 0.6 is firm soil [dimensionless].

    Returns
    -------
    Accelerogram
        Corrected record that starts and ends at rest.

    Notes
    -----
    The spectral density is Kanai and Tajimi's, S(ω) ∝ (1 + 4ζ²r²) / ((1 - r²)² + 4ζ²r²), r = ω / ω_ground [1]_: the
    absolute acceleration of a damped oscillator on a white rock. The envelope rises as t² over the first eighth,
    stays, and decays exponentially over the second half [2]_.

    References
    ----------
    .. [1] H. Tajimi, "A statistical method of determining the maximum response of a building structure during an
       earthquake", Proc. 2nd WCEE, 1960.
    .. [2] P. Jennings, G. Housner, N. Tsai, "Simulated earthquake motions", Caltech, 1968.
    """
    dt, duration = as_positive("dt", dt), as_positive("duration", duration)
    if duration < 100 * dt:
        raise InputError(f"duration must be at least a hundred time steps, got {duration:g} s at dt {dt:g} s")
    steps = as_count("duration / dt", round(min(duration / dt, 2.0 * _LONGEST)), most=_LONGEST)
    noise = np.random.default_rng(as_count("seed", seed, most=None)).standard_normal(steps + 1)
    ground = colour_by_ground(noise, dt, frequency=ground_frequency, damping=ground_damping)
    t = dt * np.arange(noise.size) / duration
    envelope = np.where(t < 0.125, (t / 0.125) ** 2, np.where(t < 0.5, 1.0, np.exp(-6.0 * (t - 0.5))))
    record = correct_baseline(accelerogram(f"synthetic, seed {seed}", dt, ground * envelope))
    return scaled(record, as_positive("peak", peak) / float(np.abs(record.acceleration).max()))


def colour_by_ground(noise: ArrayLike, dt: float, *, frequency: float, damping: float) -> FloatArray:
    """Pass noise through the Kanai-Tajimi filter.

    Parameters
    ----------
    noise
        (N,) [m/s²].
    dt
        Time step [s].
    frequency
        Resonance of the ground [Hz].
    damping
        Its damping ratio [dimensionless].

    Returns
    -------
    numpy.ndarray
        (N,) absolute acceleration of the ground layer [m/s²].
    """
    omega, zeta = 2 * np.pi * as_positive("frequency", frequency), as_positive("damping", damping)
    b, a = bilinear(
        [2 * zeta * omega, omega**2], [1.0, 2 * zeta * omega, omega**2], fs=1 / as_positive("dt", dt)
    )
    return np.asarray(lfilter(b, a, as_array("noise", noise, (None,))))


def response_spectrum(
    acceleration: ArrayLike, dt: float, periods: ArrayLike, *, damping: float = 0.05
) -> FloatArray:
    """Compute the pseudo-acceleration response spectrum.

    Parameters
    ----------
    acceleration
        (N,) of the ground or table [m/s²].
    dt
        Time step [s].
    periods
        (P,) natural periods of the oscillators [s].
    damping
        Damping ratio, below 1 [dimensionless].

    Returns
    -------
    numpy.ndarray
        (P,) ω² times the largest relative displacement of each oscillator [m/s²].

    Notes
    -----
    Exact for an acceleration that is linear between the samples (first-order hold), as Nigam and Jennings' method, and
    that rises from zero within one step before the first sample; the largest displacement is looked for at the samples.
    """
    ground = as_array("acceleration", acceleration, (None,))
    dt = as_positive("dt", dt)
    periods = as_array("periods", periods, (None,))
    if (periods <= 0).any() or not 0 <= damping < 1:
        raise InputError("periods must be above zero, damping at least 0 and below 1")
    spectrum = np.empty(periods.size)
    for k, omega in enumerate(2 * np.pi / periods):
        # d'' + 2ζω d' + ω² d = -ground; output ω² d, scaled so that the filter's coefficients stay near one.
        state = np.array([[0.0, 1.0], [-(omega**2), -2 * damping * omega]])
        push, watch = np.array([[0.0], [-(omega**2)]]), np.array([[1.0, 0.0]])
        discrete: Any = cont2discrete((state, push, watch, np.zeros((1, 1))), dt, method="foh")
        numerator, denominator = ss2tf(*discrete[:4])
        spectrum[k] = np.abs(lfilter(numerator[0], denominator, ground)).max()
    return spectrum


def earthquake_motion(
    time: ArrayLike, *, home: pin.SE3, records: Mapping[str, Accelerogram], scale: float = 1.0
) -> PlatformSamples:
    """Shake the platform as recorded.

    Parameters
    ----------
    time
        (N,) instants [s].
    home
        Platform frame in the world that the motion starts from.
    records
        Corrected record for some of the world axes ``"x"``, ``"y"``, ``"z"``.
    scale
        Factor of all records [dimensionless].

    Returns
    -------
    PlatformSamples
        Orientation kept; acceleration linear between the samples of the record, velocity and position its exact
        integrals.

    Raises
    ------
    InputError
        If a key is no axis, or there is no record.
    """
    time = as_array("time", time, (None,))
    home = as_pose("home", home)
    unknown = set(records) - set(_AXES)
    if unknown or not records:
        raise InputError(f"records must be keyed by x, y or z, got {sorted(records)}")
    curves = np.zeros((3, time.size, 3))
    for axis, record in records.items():
        curves[:, :, _AXES.index(axis)] = resample(record, time)
    curves *= scale
    still = np.zeros((time.size, 3))
    return PlatformSamples(
        time=time,
        position=home.translation + curves[0],
        rotation=np.broadcast_to(home.rotation, (time.size, 3, 3)),
        twist=np.hstack([curves[1], still]),
        acceleration=np.hstack([curves[2], still]),
    )
