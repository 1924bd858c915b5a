"""Roll, pitch and yaw at gimbal lock, where yaw -+ roll alone is determined."""

from __future__ import annotations

import numpy as np
import pytest

from stewart_pin.geometry.rotations import rotation_from_rpy, rpy_from_rotation


@pytest.mark.parametrize("short_of", [0.0, 1e-15, 1e-12, 1e-9, 1e-8, 1e-7, 1e-6, 1e-3, 1.0])
def test_angles_give_back_the_rotation(short_of: float, rng: np.random.Generator) -> None:
    angles = rng.uniform(-3, 3, (200, 3))
    angles[:, 1] = rng.choice([-1, 1], 200) * (np.pi / 2 - short_of)
    rotation = rotation_from_rpy(*angles.T)
    again = rotation_from_rpy(*rpy_from_rotation(rotation).T)
    # Half a dozen products of sines and cosines, each rounded.
    assert np.abs(again - rotation).max() < 2e-15
