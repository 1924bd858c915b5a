"""What a body looks like when no file says so."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.building.drawn_shapes import body_points


@pytest.mark.parametrize("robot", ["stewart", "stewart_sps", "four_bar"])
def test_a_payload_is_no_corner(robot: str) -> None:
    chain = stp.load(robot)
    loaded = stp.attach_payload(chain, pin.Inertia(1.0, np.array([0.0, 0.02, 0.1]), np.eye(3)))
    bare, heavy = body_points(chain), body_points(loaded)
    np.testing.assert_array_equal(heavy[chain.platform], bare[chain.platform])
