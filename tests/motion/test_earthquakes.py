"""Synthetic earthquakes have the spectrum they claim; response spectra are those of oscillators."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import welch

from stewart_pin.errors import InputError
from stewart_pin.motion.earthquakes import (
    colour_by_ground,
    earthquake_motion,
    response_spectrum,
    synthetic_accelerogram,
)


def test_coloured_noise_has_the_spectrum_of_kanai_and_tajimi(rng: np.random.Generator) -> None:
    dt, frequency, damping = 0.005, 2.5, 0.6
    noise = rng.standard_normal(400_000)
    measured = welch(colour_by_ground(noise, dt, frequency=frequency, damping=damping), 1 / dt, nperseg=2048)
    f, density = measured
    r = f / frequency
    white = 2 * dt  # one-sided density of unit white noise
    exact = white * (1 + 4 * damping**2 * r**2) / ((1 - r**2) ** 2 + 4 * damping**2 * r**2)
    band = (f > 0.3) & (f < 12.0)
    # 390 averaged periodograms scatter by 1/sqrt(390) = 5 %; the mean over the band by far less.
    assert np.abs(density[band] / exact[band] - 1).max() < 0.25
    assert np.mean(density[band] / exact[band]) == pytest.approx(1.0, abs=0.02)


def test_synthetic_record_is_seeded_and_at_rest_at_both_ends() -> None:
    record = synthetic_accelerogram(seed=3, peak=2.0)
    np.testing.assert_array_equal(record.acceleration, synthetic_accelerogram(seed=3, peak=2.0).acceleration)
    assert np.abs(record.acceleration).max() == pytest.approx(2.0)
    assert abs(record.velocity[-1]) < 1e-12 and abs(record.displacement[-1]) < 1e-11
    assert np.abs(record.displacement).max() < 0.5
    other = synthetic_accelerogram(seed=4, peak=2.0)
    assert np.abs(other.acceleration - record.acceleration).max() > 0.5


def test_response_spectrum_is_that_of_integrated_oscillators() -> None:
    record = synthetic_accelerogram(seed=1, duration=4.0, dt=0.01)
    periods = np.array([0.15, 0.6, 2.0])
    spectrum = response_spectrum(record.acceleration, record.dt, periods, damping=0.05)
    # The ground rests one step before the record and reaches the first sample linearly.
    time, ground = record.time, np.concatenate([[0.0], record.acceleration])
    padded = np.concatenate([[-record.dt], time])
    for period, value in zip(periods, spectrum, strict=True):
        omega = 2 * np.pi / period

        def oscillator(t, y, omega=omega):
            push = -np.interp(t, padded, ground)
            return [y[1], push - 0.1 * omega * y[1] - omega**2 * y[0]]

        answer = solve_ivp(
            oscillator, (-record.dt, time[-1]), [0, 0], t_eval=time, rtol=1e-8, atol=1e-12, max_step=record.dt
        )
        # The reference integrates across the kinks of the record with relative tolerance 1e-8 per step.
        assert value == pytest.approx(omega**2 * np.abs(answer.y[0]).max(), rel=1e-5)


def test_response_spectrum_of_stiff_oscillators_is_the_peak_acceleration() -> None:
    record = synthetic_accelerogram(seed=1)
    (stiff,) = response_spectrum(record.acceleration, record.dt, [1e-3])
    assert stiff == pytest.approx(np.abs(record.acceleration).max(), rel=1e-2)


def test_earthquake_motion_is_consistent() -> None:
    home = pin.SE3(np.eye(3), np.array([0.0, 0.0, 1.0]))
    records = {"x": synthetic_accelerogram(seed=1), "z": synthetic_accelerogram(seed=2, peak=1.0)}
    time, h = np.linspace(1.0, 15.0, 57), 1e-4
    before, here, after = (
        earthquake_motion(time + s, home=home, records=records, scale=0.5) for s in (-h, 0, h)
    )
    # Acceleration is continuous, its slope up to 500 m/s³: one-sided kinks leave h · slope / 4 at most.
    np.testing.assert_allclose((after.twist - before.twist) / (2 * h), here.acceleration, atol=2e-2)
    np.testing.assert_allclose((after.position - before.position) / (2 * h), here.twist[:, :3], atol=1e-6)
    assert not here.position[:, 1].any()


@pytest.mark.parametrize("records", [{}, {"up": None}])
def test_records_need_an_axis(records) -> None:
    with pytest.raises(InputError, match="keyed by x, y or z"):
        earthquake_motion([0.0], home=pin.SE3.Identity(), records=records)
