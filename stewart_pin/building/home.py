"""The home configuration: as the file gives it, or found, with the loops closed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from stewart_pin.closure.newton import close_loops
from stewart_pin.errors import MechanismError
from stewart_pin.model.chain import ClosedChain
from stewart_pin.model.description import JointKind
from stewart_pin.typing import Configuration

_ATTEMPTS = 64
_CLOSED_IN_FILE = 1e-3
"""Gap that a home printed with few digits may show, relative to the robot's size; a larger one is an error."""


def settle_home(chain: ClosedChain) -> ClosedChain:
    """Close the loops at home.

    The file's home is refined by Newton's method. Without one, the search starts from the neutral configuration moved
    inside the joint limits, then from seeded random ones.

    Parameters
    ----------
    chain
        Chain whose home is a guess.

    Returns
    -------
    ClosedChain
        The same chain with a home at which every loop closes.

    Raises
    ------
    MechanismError
        If the loops do not close.
    """
    given = bool(chain.mechanism.home)
    guesses = [home_guess(chain)]
    if not given:
        rng = np.random.default_rng(0)
        guesses += [_random_configuration(chain, rng) for _ in range(_ATTEMPTS)]
    best = np.inf
    for guess in guesses:
        closure = close_loops(chain, guess, throw=False)
        best = min(best, closure.gap)
        home = replace(chain, q_home=closure.q)
        if not closure.success or _flipped(home) is not None:
            continue
        moved = np.abs(pin.difference(chain.model, guess, closure.q) / chain.tangent_scale).max(initial=0.0)
        if given and moved > _CLOSED_IN_FILE:
            raise MechanismError(
                f"the loops do not close at the home configuration of the file: closing them moves a joint by "
                f"{moved:.3g}; correct the <group_state name='home'>, or remove it",
                path=chain.mechanism.source,
                culprit="home",
            )
        return home
    raise MechanismError(
        f"the loops do not close: the smallest gap found is {best:.3g} m; check the origins of the loops, or give a "
        "home configuration as <group_state name='home'>",
        path=chain.mechanism.source,
        culprit="home",
    )


def home_guess(chain: ClosedChain) -> Configuration:
    """Assemble the home of the file; joints it does not name are neutral, or mid-way between their limits.

    Parameters
    ----------
    chain
        Chain with a description.

    Returns
    -------
    numpy.ndarray
        (nq,) configuration, loops not yet closed [m, rad, unit quaternions].

    Raises
    ------
    MechanismError
        If a value has the wrong size.
    """
    q = _clip(chain, pin.neutral(chain.model))
    for name, values in chain.mechanism.home.items():
        if chain.mechanism.joint(name).kind is JointKind.FIXED:
            continue
        joint = chain.model.joints[chain.model.getJointId(name)]
        if len(values) != joint.nq:
            raise MechanismError(
                f"the home configuration gives joint '{name}' {len(values)} values, it has {joint.nq}",
                path=chain.mechanism.source,
                culprit=name,
            )
        q[joint.idx_q : joint.idx_q + joint.nq] = values
    if not pin.isNormalized(chain.model, q, 1e-3):
        raise MechanismError(
            "the home configuration holds a quaternion that is not of unit length",
            path=chain.mechanism.source,
            culprit="home",
        )
    return pin.normalize(chain.model, q)


def _clip(chain: ClosedChain, q: Configuration) -> Configuration:
    lower, upper = chain.model.lowerPositionLimit, chain.model.upperPositionLimit
    bounded = np.isfinite(lower) & np.isfinite(upper)
    inside = np.clip(q, lower, upper)
    middle = (np.where(bounded, lower, inside) + np.where(bounded, upper, inside)) / 2
    return np.where((q < lower) | (q > upper), middle, q)


def _random_configuration(chain: ClosedChain, rng: np.random.Generator) -> Configuration:
    """Draw every coordinate within its limits, or within one robot size or half a turn of neutral."""
    reach = np.where(chain.tangent_scale == 1.0, np.pi / 2, chain.tangent_scale)
    q = pin.integrate(chain.model, pin.neutral(chain.model), rng.uniform(-1, 1, chain.nv) * reach)
    lower, upper = chain.model.lowerPositionLimit, chain.model.upperPositionLimit
    bounded = np.isfinite(lower) & np.isfinite(upper)
    low, high = np.where(bounded, lower, q), np.where(bounded, upper, q)
    return low + rng.uniform(size=chain.nq) * (high - low)


def _flipped(chain: ClosedChain) -> str | None:
    """Name a loop whose axes point against each other: its angle rows vanish, but it is not assembled so."""
    data = pin.Data(chain.model)
    pin.framesForwardKinematics(chain.model, data, chain.q_home)
    for loop in chain.loops:
        if loop.kind in (
            JointKind.SPHERICAL,
            JointKind.UNIVERSAL,
            JointKind.POINT_ON_LINE,
            JointKind.DISTANCE,
        ):
            continue
        frame1, frame2 = (
            data.oMf[chain.model.getFrameId(link)].rotation @ placement.rotation
            for link, placement in ((loop.link1, loop.placement1), (loop.link2, loop.placement2))
        )
        relative = frame1.T @ frame2
        if loop.axis @ relative @ loop.axis < 0:
            return loop.name
        whole = loop.kind in (JointKind.FIXED, JointKind.PRISMATIC)
        if whole and np.trace(relative) < 0:
            return loop.name
    return None
