"""Records: read as written, integrated exactly, at rest at the end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from stewart_pin.errors import FileFormatError, InputError
from stewart_pin.motion.earthquakes import (
    G,
    accelerogram,
    correct_baseline,
    read_at2,
    read_columns,
    resample,
    scaled,
)

AT2 = """PEER NGA STRONG MOTION DATABASE RECORD
Imaginary Valley, 01/01/2000, Station 7, 090
ACCELERATION TIME SERIES IN UNITS OF G
NPTS=      7, DT=   .0100 SEC,
   .1000000E-01  -.2000000E-01   .3000000E-01   .0000000E+00   .5000000E-01
  -.1000000E-01   .2500000E-01
"""


def test_at2_is_read_as_written(tmp_path: Path) -> None:
    path = tmp_path / "record.at2"
    path.write_text(AT2)
    record = read_at2(path)
    assert record.dt == 0.01 and record.name.startswith("Imaginary Valley")
    np.testing.assert_allclose(
        record.acceleration / G, [0.01, -0.02, 0.03, 0, 0.05, -0.01, 0.025], rtol=1e-15
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("NPTS=      7", "NPTS=      8"), "promises 8 values, the file holds 7"),
        (("DT=   .0100", "STEP"), "names NPTS and DT"),
        (("UNITS OF G", "UNITS OF CM/S/S"), "unit g"),
        ((".2500000E-01", ".25x"), "not a number"),
        ((".2500000E-01", "nan"), "finite"),
    ],
)
def test_broken_at2_is_refused(tmp_path: Path, change, words) -> None:
    path = tmp_path / "record.at2"
    path.write_text(AT2.replace(*change))
    with pytest.raises(FileFormatError, match=words):
        read_at2(path)


def test_columns_with_time_and_units(tmp_path: Path) -> None:
    path = tmp_path / "record.csv"
    path.write_text("# t, x, y\n0.00, 1, 10\n0.02, 2, 20\n\n0.04; 3; 30  # end\n")
    record = read_columns(path, unit="gal", column=2)
    assert record.dt == pytest.approx(0.02)
    np.testing.assert_allclose(record.acceleration, [0.1, 0.2, 0.3])
    assert read_columns(path, dt=0.5, column=0).dt == 0.5


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        ("0 1\n0.1 2\n0.3 3\n", {}, "equally spaced"),
        ("0 1\n0.1 2 3\n", {}, "same number of columns"),
        ("0 1\n0.1 2\n", {"column": 5}, "column 5 of 2"),
        ("0 one\n0.1 2\n", {}, "not a number"),
    ],
)
def test_broken_columns_are_refused(tmp_path: Path, text, options, words) -> None:
    path = tmp_path / "record.txt"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=words):
        read_columns(path, **options)


def test_missing_binary_and_unknown_units_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="no such file"):
        read_at2(tmp_path / "none.at2")
    (tmp_path / "binary.at2").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(FileFormatError, match="not a text file"):
        read_at2(tmp_path / "binary.at2")
    with pytest.raises(InputError, match="unit must be one of"):
        read_columns(tmp_path / "none.txt", unit="ft/s2")
    with pytest.raises(InputError, match="two or more samples"):
        accelerogram("short", 0.1, [1.0])


def test_integrals_are_exact_between_samples(rng: np.random.Generator) -> None:
    record = accelerogram("noise", 0.1, rng.normal(size=12))

    def linear(t: float) -> float:
        return float(np.interp(t, record.time, record.acceleration))

    for t in (0.05, 0.33, 1.1):
        x, v, a = (float(y[0]) for y in resample(record, [t]))
        kinks = [k for k in record.time if k < t]
        assert a == pytest.approx(linear(t), abs=1e-14)
        assert v == pytest.approx(quad(linear, 0, t, points=kinks)[0], abs=1e-12)
        assert x == pytest.approx(quad(lambda s, t=t: (t - s) * linear(s), 0, t, points=kinks)[0], abs=1e-12)
    np.testing.assert_allclose(resample(record, record.time)[0], record.displacement, atol=1e-15)


def test_outside_the_record_the_ground_rests() -> None:
    record = correct_baseline(accelerogram("pulse", 0.01, np.sin(np.linspace(0, 20, 400))))
    x, v, a = resample(record, [-1.0, 10.0])
    assert not v.any() and not a.any() and x[0] == 0.0 and abs(x[1]) < 1e-12


def test_baseline_correction_ends_at_rest_and_keeps_the_shaking(rng: np.random.Generator) -> None:
    dt = 0.005
    t = dt * np.arange(4000)
    shaking = np.exp(-(((t - 8) / 3) ** 2)) * np.sin(2 * np.pi * 2.0 * t)
    record = accelerogram("drifting", dt, shaking + 0.02 + 0.003 * t)
    corrected = correct_baseline(record)
    assert abs(record.displacement[-1]) > 1.0
    # Solved for exactly; what is left is the round-off of 4000 sums.
    assert abs(corrected.velocity[-1]) < 1e-12 and abs(corrected.displacement[-1]) < 1e-11
    # 2 Hz lies well within the band and passes; of the drift, which ends with steps of 0.03, half a step is left there.
    assert np.abs(corrected.acceleration - shaking).max() < 0.015
    assert np.abs(corrected.acceleration - shaking)[400:-400].max() < 0.01


def test_filter_stops_what_lies_outside(rng: np.random.Generator) -> None:
    dt = 0.005
    t = dt * np.arange(8000)
    record = accelerogram("two tones", dt, np.sin(2 * np.pi * 60 * t) * np.hanning(t.size))
    assert np.abs(correct_baseline(record, low=0.1, high=20.0).acceleration).max() < 1e-3
    with pytest.raises(InputError, match="low must be below high"):
        correct_baseline(record, low=30.0, high=20.0)


def test_scaling_scales_all_three_curves(rng: np.random.Generator) -> None:
    record = accelerogram("noise", 0.1, rng.normal(size=20))
    half = scaled(record, 0.5)
    again = accelerogram("noise", 0.1, half.acceleration)
    np.testing.assert_allclose(half.displacement, again.displacement, atol=1e-15)
    np.testing.assert_allclose(half.velocity, again.velocity, atol=1e-15)
