"""Fixtures shared by the whole suite."""

from __future__ import annotations

import os

# The workers of pytest-xdist take all cores; threads of BLAS beside them make the suite three times slower. NumPy reads
# this when it is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest

import stewart_pin as stp

collect_ignore = ["benchmarks"]  # run by hand; some need other engines


@pytest.fixture
def rng() -> np.random.Generator:
    """Return the one source of randomness: seeded, so that a failure repeats."""
    return np.random.default_rng(20240229)


@pytest.fixture
def report_cad() -> stp.Hexapod:
    """Return the geometry ``report_cad`` of sections 1 to 5 of the source report."""
    # fmt: off
    base = np.array([
        [-169.76, -581.96, 49.49], [ 130.07, -592.10, 49.49], [ 588.88, 143.98, 49.49],
        [ 447.74,  408.70, 49.49], [-419.12,  438.00, 49.49], [-577.81, 183.41, 49.49],
    ])
    platform = np.array([
        [-350, -346.41, -46.39], [ 350, -346.41, -46.39], [ 470, -129.9, -46.39],
        [ 125,  476.31, -46.39], [-125,  476.31, -46.39], [-475, -129.9, -46.39],
    ])
    # fmt: on
    return stp.Hexapod(base / 1e3, platform / 1e3)


@pytest.fixture
def report_ideal() -> stp.Hexapod:
    """Return the geometry ``report_ideal`` of sections 8 to 10 of the source report."""
    s = np.sqrt(3.0)
    # fmt: off
    base = [[.15, 7*s/20, 0], [.6, -s/10, 0], [.45, -s/4, 0],
            [-.45, -s/4, 0], [-.6, -s/10, 0], [-.15, 7*s/20, 0]]
    platform = [[.35, s/5, 0], [.475, 3*s/40, 0], [.125, -11*s/40, 0],
                [-.125, -11*s/40, 0], [-.475, 3*s/40, 0], [-.35, s/5, 0]]
    # fmt: on
    return stp.Hexapod(np.array(base), np.array(platform))


@pytest.fixture
def source_hexapod() -> stp.Hexapod:
    """Return the planar–planar robot of S1.8, in its own unit of length."""
    # fmt: off
    platform = [[0, 0, 0], [0, 4, 0], [-16, 13, 0], [-19, 11, 0], [-19, -7, 0], [-16, -9, 0]]
    base = [[0, 0, 0], [0, 28, 0], [-6, 31, 0], [-30, 17, 0], [-30, 11, 0], [-6, -3, 0]]
    # fmt: on
    return stp.Hexapod(np.array(base, dtype=float), np.array(platform, dtype=float))
