"""All twists that a platform can have within the rate limits of its joints."""

from __future__ import annotations

import numpy as np

from stewart_pin.errors import UnreachableError, UnsupportedError
from stewart_pin.mechanics.capability.enumeration import image_of_limits
from stewart_pin.mechanics.capability.platform_space import motor_limit, platform_space, stated
from stewart_pin.mechanics.capability.polytope import Polytope
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.freedom import require_held
from stewart_pin.state.state import State, as_state
from stewart_pin.tolerances import SINGULAR
from stewart_pin.typing import ArrayLike, Configuration

_AT_LIMIT = 1e-9
"""Distance from a joint limit at which it counts as reached, in robot sizes or radians."""


def velocity_polytope(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    *,
    rate_limit: ArrayLike | None = None,
    limits: bool = True,
    length: float | None = None,
) -> Polytope:
    """Find all twists of the platform that the joints' rate limits allow.

    The set is exact: a skewed box with 64 corners for six motors and six freedoms, a zonotope for a redundant arm. A
    passive joint for which the file states a velocity limit counts as well. A joint that stands at the end of its
    range cannot leave it, which takes away the motions to that side.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration with closed loops, with a chain [m, rad, unit quaternions].
    rate_limit
        (nu,) or one number: largest absolute motor rate; default: the file's velocity limits [m/s or rad/s].
    limits
        Whether joint ranges must hold.
    length
        Length that makes turning and shifting comparable; default: ``chain.length_scale`` [m].

    Returns
    -------
    Polytope
        Twists [v; ω] of the platform origin in world axes, or the coordinates that a platform with fewer freedoms has.

    Raises
    ------
    ActuationError
        If the platform can move with all motors locked, so that their rates do not limit its motion.
    UnreachableError
        If a joint is outside its range.
    InputError
        If the loops are open at q, or neither the file nor the caller states a limit.
    """
    state = as_state(chain, q).require_regular()
    chain, freedom = state.chain, state.freedom
    motor_rate = motor_limit(chain, "rate_limit", rate_limit, chain.model.upperVelocityLimit)
    require_held(state)
    space = platform_space(state, length)

    upper = stated(np.array(chain.model.upperVelocityLimit))
    upper[chain.motor_index] = motor_rate
    lower = -upper
    if limits:
        low, high = _stops(chain, state.q)
        lower[low], upper[high] = 0.0, 0.0
    limited = np.flatnonzero(np.isfinite(lower) | np.isfinite(upper))
    rows = freedom.motions[limited]
    # Motions that no limit sees (an idle spin) do not move the platform, because the motors hold it.
    _, s, vt = np.linalg.svd(state.motions.basis[limited])
    seen = vt[: np.count_nonzero(s >= SINGULAR)].T
    names = tuple(
        (f"{chain.tangent_names[k]} at {lower[k]:+.6g}", f"{chain.tangent_names[k]} at {upper[k]:+.6g}")
        for k in limited
    )
    shape = image_of_limits(
        rows @ seen, lower[limited], upper[limited], names, space.share @ seen, np.zeros(space.basis.shape[1])
    )
    if shape is None:
        raise UnsupportedError("the rate limits contradict each other")
    return space.polytope(shape, "velocity")


def _stops(chain: ClosedChain, q: Configuration) -> tuple[list[int], list[int]]:
    """Tangent entries that stand at their lower and at their upper end."""
    model = chain.model
    low: list[int] = []
    high: list[int] = []
    outside: dict[str, tuple[float, float, float]] = {}
    for name, joint in zip(model.names[1:], model.joints[1:], strict=True):
        if joint.nq != 1:
            continue
        value, k = float(q[joint.idx_q]), joint.idx_v
        least, most = (float(x[joint.idx_q]) for x in (model.lowerPositionLimit, model.upperPositionLimit))
        slack = _AT_LIMIT * float(chain.tangent_scale[k])
        if not least - slack <= value <= most + slack:
            outside[name] = (value, least, most)
        if value <= least + slack:
            low.append(k)
        if value >= most - slack:
            high.append(k)
    if outside:
        listed = "; ".join(
            f"'{n}' at {x:.6g}, allowed {a:.6g} to {b:.6g}" for n, (x, a, b) in outside.items()
        )
        raise UnreachableError(
            f"joints exceed their ranges: {listed}; choose another configuration, or limits=False",
            violations=outside,
            residual=max(max(a - x, x - b) for x, a, b in outside.values()),
            iterations=0,
            q=q,
        )
    return low, high
