"""Motions of one motor that turns at a constant rate, and mechanisms whose whole turns count."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import Coupling, Joint, Link, Mechanism
from tests.mechanisms import ONE, P, R, Z, at

LEAD = 0.01 / (2 * np.pi)
"""Of the screw [m/rad]."""


def screw() -> stp.ClosedChain:
    """Build a nut, the platform, on a screw with a rotary motor."""
    mass = pin.Inertia(1.0, np.zeros(3), 0.01 * np.eye(3))
    links = (Link("base"), Link("spindle", mass), Link("nut", mass))
    joints = (
        Joint("screw", R, "base", "spindle", ONE, Z, independent=True),
        Joint("slide", P, "base", "nut", at(z=0.2), Z),
    )
    thread = Coupling("thread", "slide", "screw", (0.0, LEAD))
    return build_chain(Mechanism("screw", links, joints, couplings=(thread,), platform="nut"))


def turning(
    chain: stp.ClosedChain, turns: float, count: int
) -> tuple[stp.motions.PlatformSamples, np.ndarray]:
    """Turn the motor of a chain of one freedom in a second: motion of the platform, and motor positions."""
    rate, motor = 2 * np.pi * turns, chain.motor_index[0]
    time = np.linspace(0.0, 1.0, count)
    positions = chain.q_home[chain.motor_q_index] + rate * time[:, None]
    q, rows = chain.q_home, []
    for position in positions:
        at_rest = stp.forward_kinematics(chain, position, q_guess=q, limits=False).state
        q = at_rest.q
        along = at_rest.motions.basis[:, 0] * chain.tangent_scale
        v = along * rate / along[motor]
        moving = chain.at(q, v)
        a = -moving.motions.across(moving.loop_bias / chain.row_sizes) * chain.tangent_scale
        a -= along * a[motor] / along[motor]
        here = moving.pose
        rows.append((here.translation, here.rotation, moving.P @ v, moving.P @ a + moving.platform_bias))
    return stp.motions.PlatformSamples(time, *map(np.array, zip(*rows, strict=True))), positions
