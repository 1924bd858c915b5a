"""The closed form of six-legged platforms, for chains on which it has been compared with the general verbs."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from stewart_pin.building.hexapod_bodies import hexapod_bodies
from stewart_pin.errors import UnsupportedError
from stewart_pin.geometry.hexapod import Hexapod
from stewart_pin.geometry.hexapod_bodies import HexapodBodies
from stewart_pin.geometry.hexapod_dynamics import hexapod_inverse_dynamics
from stewart_pin.mechanics.inverse_dynamics import inverse_dynamics
from stewart_pin.mechanics.kinematics import platform_motion
from stewart_pin.state.chain import ClosedChain

_LEGS = 6
_AGREE = 1e-7
"""Share of the efforts by which the two may differ: round-off of a configuration that was solved for."""


@lru_cache(maxsize=8)
def leg_formula(chain: ClosedChain) -> tuple[Hexapod, HexapodBodies] | None:
    """Find the closed form of a chain.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    tuple or None
        Geometry and bodies for `hexapod_inverse_dynamics`, where it agrees with `inverse_dynamics` on a motion of this
        very chain; None where there is no closed form, or it leaves something out.
    """
    if chain.nu != _LEGS:
        return None
    rng = np.random.default_rng(0)
    here = chain.at(chain.generic.samples[0])
    twist = here.P @ (here.motions.basis @ rng.uniform(-1, 1, here.motions.basis.shape[1]))
    acceleration = np.repeat([chain.length_scale, 1.0], 3) * rng.uniform(-1, 1, 6)
    try:
        hexapod, bodies = Hexapod.from_chain(chain), hexapod_bodies(chain)
        place = here.pose.translation, here.pose.rotation
        forces = hexapod_inverse_dynamics(
            hexapod, bodies, *place, twist, acceleration, gravity=chain.gravity
        ).actuator
    except UnsupportedError:
        return None
    motion = platform_motion(chain, here.pose, twist, acceleration, q_guess=here.q, limits=False)
    general = inverse_dynamics(motion).tau_motor
    same = np.abs(chain.leg_readings[0] * forces - general).max() <= _AGREE * max(1.0, np.abs(general).max())
    return (hexapod, bodies) if same else None
