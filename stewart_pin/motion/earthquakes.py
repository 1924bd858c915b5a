"""Earthquakes as platform motions: recorded ones, read and integrated; synthetic ones where none can be shipped."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.integrate import cumulative_trapezoid
from scipy.signal import bilinear, butter, cont2discrete, lfilter, sosfiltfilt, ss2tf

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array, as_count, as_positive
from stewart_pin.errors import FileFormatError, FileMissingError, InputError
from stewart_pin.motion.trajectories import PlatformSamples
from stewart_pin.state.configurations import as_pose
from stewart_pin.typing import ArrayLike, FloatArray

G = 9.80665
"""Standard acceleration of free fall, the unit of strong-motion records [m/s²]."""
_UNITS = {"g": G, "m/s2": 1.0, "cm/s2": 0.01, "gal": 0.01}
_LARGEST = 50_000_000
"""Bytes beyond which a file is no strong-motion record."""


@dataclass(frozen=True, eq=False, repr=False)
class Accelerogram(Brief):
    """Ground acceleration along one direction.

    Attributes
    ----------
    name
        What the record says of itself.
    dt
        Time step [s].
    acceleration
        (N,) [m/s²].
    velocity, displacement
        (N,) integrated from rest [m/s, m].
    """

    name: str
    dt: float
    acceleration: FloatArray
    velocity: FloatArray
    displacement: FloatArray

    @property
    def time(self) -> FloatArray:
        """(N,) instants from 0 [s]."""
        return self.dt * np.arange(self.acceleration.size)


def accelerogram(name: str, dt: float, acceleration: ArrayLike) -> Accelerogram:
    """Integrate an acceleration twice from rest.

    Parameters
    ----------
    name
        Name of the record.
    dt
        Time step [s].
    acceleration
        (N,) ground acceleration, N >= 2 [m/s²].

    Returns
    -------
    Accelerogram
        With the exact integrals of the acceleration that is linear between the samples.

    Raises
    ------
    InputError
        If there are fewer than two samples, or one is not finite.
    """
    dt = as_positive("dt", dt)
    a = as_array("acceleration", acceleration, (None,))
    if a.size < 2:
        raise InputError(f"acceleration must have two or more samples, got {a.size}")
    return Accelerogram(name, dt, a, *_integrate(dt, a))


def read_at2(path: str | Path) -> Accelerogram:
    """Read a record in the AT2 format of the PEER ground-motion database.

    Parameters
    ----------
    path
        Text file: four lines of header, the last with ``NPTS= n, DT= dt SEC``, then values in units of g.

    Returns
    -------
    Accelerogram
        The record as it is, not yet corrected.

    Raises
    ------
    FileFormatError
        If the file is missing or not of this format, or holds another number of values than it says.
    """
    path = Path(path)
    lines = _read_lines(path)
    if len(lines) < 5:
        raise FileFormatError("an AT2 record has four lines of header and then values", path=str(path))
    header = " ".join(lines[:4])
    count = re.search(r"NPTS\s*=?\s*(\d+)", header, re.IGNORECASE)
    step = re.search(r"DT\s*=?\s*([0-9.]+(?:[eE][-+]?\d+)?)", header, re.IGNORECASE)
    if count is None or step is None:
        raise FileFormatError(
            "the header of an AT2 record names NPTS and DT, this one does not", path=str(path)
        )
    if not re.search(r"\bG\b|\bg\b", header):
        raise FileFormatError(
            "the header does not give the unit g; only records in g are read", path=str(path)
        )
    values = _parse_values(path, " ".join(lines[4:]).split())
    if values.size != int(count[1]):
        raise FileFormatError(
            f"the header promises {count[1]} values, the file holds {values.size}", path=str(path)
        )
    return accelerogram(lines[1].strip() or path.stem, float(step[1]), G * values)


def read_columns(
    path: str | Path, *, unit: str = "m/s2", dt: float | None = None, column: int = 1
) -> Accelerogram:
    """Read a record from a text file with columns of numbers.

    Parameters
    ----------
    path
        Text file; ``#`` starts a comment, columns are separated by blanks, commas or semicolons.
    unit
        Of the acceleration: ``"m/s2"``, ``"cm/s2"``, ``"gal"`` or ``"g"``.
    dt
        Time step [s]; default: from the first column, which must then be equally spaced time.
    column
        Column of the acceleration, counted from 0.

    Returns
    -------
    Accelerogram
        The record as it is, not yet corrected.

    Raises
    ------
    FileFormatError
        If the file is missing, has no such column, or its time is not equally spaced.
    InputError
        If the unit is unknown.
    """
    if unit not in _UNITS:
        raise InputError(f"unit must be one of {', '.join(_UNITS)}, got {unit!r}")
    path = Path(path)
    rows = [line.split("#")[0].replace(",", " ").replace(";", " ").split() for line in _read_lines(path)]
    rows = [row for row in rows if row]
    widths = {len(row) for row in rows}
    if len(widths) != 1:
        raise FileFormatError(
            f"every line needs the same number of columns, found {sorted(widths)}", path=str(path)
        )
    table = _parse_values(path, [word for row in rows for word in row]).reshape(len(rows), -1)
    if not 0 <= column < table.shape[1]:
        raise FileFormatError(
            f"column {column} of {table.shape[1]}; columns are counted from 0", path=str(path)
        )
    if dt is None:
        steps = np.diff(table[:, 0])
        if column == 0 or steps.size == 0 or steps.min() <= 0 or np.ptp(steps) > 1e-3 * steps.mean():
            raise FileFormatError("the first column is no equally spaced time; give dt=", path=str(path))
        dt = float(steps.mean())
    return accelerogram(path.stem, dt, _UNITS[unit] * table[:, column])


def correct_baseline(
    record: Accelerogram, *, low: float | None = 0.1, high: float | None = 25.0, order: int = 4
) -> Accelerogram:
    """Remove drift and noise, so that the ground comes to rest where a table can follow.

    A Butterworth band-pass runs over the record forwards and backwards (no phase shift) between quiet pads; then a
    parabola is taken out of the acceleration, so that the ground ends where it began, at rest.

    Parameters
    ----------
    record
        Record as read.
    low, high
        Corner frequencies [Hz]; None: no filter on that side.
    order
        Order of the filter, which acts twice.

    Returns
    -------
    Accelerogram
        Corrected record of the same length.

    Raises
    ------
    InputError
        If the corners are not rising, or above half the sampling rate.
    """
    nyquist = 0.5 / record.dt
    low = None if low is None else as_positive("low", low)
    high = None if high is None else min(as_positive("high", high), 0.99 * nyquist)
    if low is not None and low >= (high if high is not None else nyquist):
        raise InputError(f"low must be below high and below half the sampling rate, got {low:g} Hz")
    a = record.acceleration - record.acceleration.mean()
    if low is not None or high is not None:
        kind = (
            "bandpass" if low is not None and high is not None else "highpass" if high is None else "lowpass"
        )
        corners = [f for f in (low, high) if f is not None]
        sections = butter(
            order, corners if len(corners) == 2 else corners[0], kind, fs=1 / record.dt, output="sos"
        )
        # Pads of one and a half periods of the lowest frequency per order, as is usual in strong-motion processing.
        pad = int(1.5 * order / ((low or corners[0]) * record.dt))
        padded = np.pad(a, pad)
        a = sosfiltfilt(sections, padded, padlen=0)[pad : pad + a.size]
    return accelerogram(record.name, record.dt, _without_drift(record.dt, a))


def _without_drift(dt: float, a: FloatArray) -> FloatArray:
    """Subtract a parabola of acceleration: final velocity and displacement vanish, the displacement is least."""
    t = dt * np.arange(a.size)
    span = t[-1]

    basis = np.stack([np.ones_like(t), t / span, (t / span) ** 2], axis=1)
    motions = [_integrate(dt, column) for column in basis.T]
    velocity, displacement = _integrate(dt, a)
    # Final velocity and final displacement are to vanish exactly; the displacement in between is to be least.
    ends = np.array([[v[-1] for v, _ in motions], [d[-1] for _, d in motions]])
    target = np.array([velocity[-1], displacement[-1]])
    particular = np.linalg.lstsq(ends, target, rcond=None)[0]
    free = np.linalg.svd(ends)[2][2:].T
    moves = np.stack([d for _, d in motions], axis=1)
    rest = np.linalg.lstsq(moves @ free, displacement - moves @ particular, rcond=None)[0]
    return a - basis @ (particular + free @ rest)


def resample(record: Accelerogram, time: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Evaluate a record at any instants, the three curves consistent with each other.

    Between samples the acceleration is linear, so velocity and displacement are its exact integrals, cubic at most;
    outside the record the ground rests.

    Parameters
    ----------
    record
        Record with time step dt.
    time
        (N,) instants [s].

    Returns
    -------
    displacement, velocity, acceleration : numpy.ndarray
        (N,) each [m, m/s, m/s²].
    """
    t = as_array("time", time, (None,))
    a, velocity, displacement = record.acceleration, record.velocity, record.displacement
    dt, slope = record.dt, np.diff(a) / record.dt
    k = np.clip((t / dt).astype(int), 0, a.size - 2)
    s = t - k * dt
    inside = (t >= 0) & (t <= record.time[-1] + 1e-12)
    x = displacement[k] + velocity[k] * s + a[k] * s**2 / 2 + slope[k] * s**3 / 6
    v = velocity[k] + a[k] * s + slope[k] * s**2 / 2
    end = displacement[-1]
    return (
        np.where(inside, x, np.where(t < 0, 0.0, end)),
        np.where(inside, v, 0.0),
        np.where(inside, a[k] + slope[k] * s, 0.0),
    )


def scaled(record: Accelerogram, factor: float) -> Accelerogram:
    """Multiply a record.

    Parameters
    ----------
    record
        Record.
    factor
        Of all three curves.

    Returns
    -------
    Accelerogram
        Scaled record.
    """
    return replace(
        record,
        acceleration=factor * record.acceleration,
        velocity=factor * record.velocity,
        displacement=factor * record.displacement,
    )


def _integrate(dt: float, a: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Velocity and displacement from rest: exact integrals of the piecewise linear acceleration."""
    velocity = cumulative_trapezoid(a, dx=dt, initial=0.0)
    steps = velocity[:-1] * dt + (2 * a[:-1] + a[1:]) * dt**2 / 6
    return velocity, np.concatenate([[0.0], np.cumsum(steps)])


def _read_lines(path: Path) -> list[str]:
    if not path.is_file():
        raise FileMissingError("no such file", path=str(path))
    if path.stat().st_size > _LARGEST:
        raise FileFormatError(f"the file has more than {_LARGEST} bytes; is it a record?", path=str(path))
    try:
        return path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise FileFormatError("not a text file", path=str(path)) from None


def _parse_values(path: Path, words: list[str]) -> FloatArray:
    try:
        values = np.array([float(word) for word in words])
    except ValueError as error:
        raise FileFormatError(f"not a number: {error}", path=str(path)) from None
    if not np.isfinite(values).all() or values.size < 2:
        raise FileFormatError("a record needs two or more finite values", path=str(path))
    return values


# ----------------------------------------------------------------------------------------------------
# Synthetic accelerograms, response spectra, the motion of a shake table
# ----------------------------------------------------------------------------------------------------

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
