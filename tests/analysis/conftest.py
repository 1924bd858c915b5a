"""Platforms with a known set of poses."""

from __future__ import annotations

import numpy as np
import pytest

import stewart_pin as stp


@pytest.fixture
def forty_real() -> tuple[stp.Hexapod, np.ndarray]:
    """Return Dietmaier's platform, all 40 of whose poses are real (Advances in Robot Kinematics, 1998)."""
    # fmt: off
    base = [[0, 0, 0], [1.107915, 0, 0], [.549094, .756063, 0], [.735077, -.223935, .525991],
            [.514188, -.526063, -.368418], [.590473, .094733, -.205018]]
    platform = [[0, 0, 0], [.542805, 0, 0], [.956919, -.528915, 0], [.665885, -.353482, 1.402538],
                [.478359, 1.158742, .107672], [-.137087, -.235121, .353913]]
    # fmt: on
    lengths = np.array([1.0, 0.645275, 1.086284, 1.503439, 1.281933, 0.771071])
    return stp.Hexapod(np.array(base), np.array(platform)), lengths


@pytest.fixture
def griffis_duffy() -> stp.Hexapod:
    """Return two triangles whose corners are joined to the midpoints of each other's sides."""
    angle = 2 * np.pi / 3 * np.arange(3)
    corners = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(3)])
    base, platform = np.empty((2, 6, 3))
    top = -0.7 * corners
    base[::2], platform[::2] = corners, np.roll(top + np.roll(top, -1, axis=0), -1, axis=0) / 2
    base[1::2], platform[1::2] = (corners + np.roll(corners, -1, axis=0)) / 2, np.roll(top, -2, axis=0)
    return stp.Hexapod(base, platform)
