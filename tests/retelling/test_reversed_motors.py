"""A motor that counts down, or from another zero, tells the same demand in its own coordinate."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from tests.rewritten import rebuild


@pytest.mark.parametrize("zero", [0.0, 0.15])
def test_demand_of_reversed_and_shifted_motors(zero):
    chain = stp.load("stewart")
    old = chain.described()

    def told(joint):
        if joint.name not in chain.motors:
            return joint
        ahead = pin.SE3(np.eye(3), zero * joint.axis)
        return replace(
            joint, placement=joint.placement * ahead, axis=-joint.axis,
            lower=zero - joint.upper, upper=zero - joint.lower,
        )  # fmt: skip

    home = {name: zero - q if name in chain.motors else q for name, q in old.home.items()}
    other = rebuild(chain, replace(old, joints=tuple(map(told, old.joints)), home=home))
    pose = stp.platform_pose(chain, chain.q_home)
    samples = stp.sinusoidal_motion(
        np.linspace(0, 1, 9), home=pose, amplitude=(0.01, 0, 0.02), frequency=(1, 1, 1)
    )
    plain, got = (stp.motor_demand(c, samples, kernels=False) for c in (chain, other))
    # Round-off of the same formulas: 1e-9 of 100 N and 1 m.
    np.testing.assert_allclose(got.positions, zero - plain.positions, atol=1e-11)
    np.testing.assert_allclose(got.rates, -plain.rates, atol=1e-11)
    np.testing.assert_allclose(got.efforts, -plain.efforts, atol=1e-7)
