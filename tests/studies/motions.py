"""Motions and designs for sweeps of motor demands, where worker processes find them."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

import stewart_pin as stp

PHASE = np.arange(40) / 40
"""Instants of a period; a multiple of four, so that the largest displacement and speed are among them."""


@lru_cache
def robot(name: str) -> stp.ClosedChain:
    chain = stp.load(name)
    if name.startswith("arm_3r"):  # home is stretched, where no sinusoid goes through
        chain = replace(chain, q_home=np.array([0.4, 0.9, 0.7]))
    return chain


def shake(
    chain: stp.ClosedChain, amplitude: float, frequency: float, axis: str = "x"
) -> stp.motions.PlatformSamples:
    """Shake along an axis; the amplitude is in robot sizes."""
    along = np.array([axis == name for name in "xyz"], dtype=float)
    return stp.motions.sinusoidal_motion(
        PHASE / frequency,
        home=stp.platform_pose(chain, chain.q_home),
        amplitude=amplitude * chain.length_scale * along,
        frequency=frequency * along,
    )


def shake_stewart(amplitude: float, frequency: float) -> stp.motions.PlatformSamples:
    return shake(robot("stewart"), amplitude, frequency)


def design(radius: float, half_angle: float = 0.2) -> stp.ClosedChain:
    """Build a platform on a base of another radius; base and platform are similar, and refused, at π/3 - 0.3."""
    hexapod = stp.hexapods.semi_regular_hexapod(radius, 0.4, half_angle, 0.3)
    return stp.hexapod_chain(
        hexapod, **stp.hexapods.hexapod_inertias(hexapod, platform=20.0, lower=2.0, upper=1.5)
    )
