"""Recorded earthquakes: read, clean, integrate; and synthetic ones where none can be shipped."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import butter, sosfiltfilt

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array, as_positive
from stewart_pin.errors import FileFormatError, FileMissingError, InputError
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
