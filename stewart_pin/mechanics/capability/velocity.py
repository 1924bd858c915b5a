"""All twists that a platform can have within the rate limits of its joints."""

from __future__ import annotations

import numpy as np

from stewart_pin.errors import UnreachableError, UnsupportedError
from stewart_pin.mechanics.capability.enumeration import image_of_limits
from stewart_pin.mechanics.capability.platform_space import motor_limits, platform_space
from stewart_pin.mechanics.capability.polytope import Polytope
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.freedom import require_held
from stewart_pin.state.state import State, as_state
from stewart_pin.tolerances import SINGULAR
from stewart_pin.typing import ArrayLike, Configuration


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
    passive joint, or joint that closes a loop, for which a velocity limit is stated counts as well. A joint that stands
    at the end of its range cannot leave it, which takes away the motions to that side.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration with closed loops, with a chain [m, rad, unit quaternions].
    rate_limit
        (nu,) or one number: largest absolute motor rate, nan for a motor's own limit; default: the limits of the chain,
        which may differ between the directions [m/s or rad/s].
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
    motor_rates = motor_limits(chain, "rate_limit", rate_limit, "velocity")
    require_held(state)
    space = platform_space(state, length)

    ends = chain.limits.bounds("velocity")
    ends[chain.motor_index] = motor_rates
    lower, upper = ends.T
    if limits:
        low, high = _stops(chain, state.q)
        lower[low], upper[high] = np.maximum(lower[low], 0.0), np.minimum(upper[high], 0.0)
    limited = np.flatnonzero(np.isfinite(lower) | np.isfinite(upper))
    rows = chain.judge.rates(state.q, freedom.motions, limited)
    # Motions that no limit sees (an idle spin) do not move the platform, because the motors hold it.
    _, s, vt = np.linalg.svd(rows / chain.judge.sizes(limited)[:, None])
    seen = vt[: np.count_nonzero(s >= SINGULAR)].T
    names = tuple(
        (f"{chain.limits.names[k]} at {lower[k]:+.6g}", f"{chain.limits.names[k]} at {upper[k]:+.6g}")
        for k in limited
    )
    shape = image_of_limits(
        rows @ seen, lower[limited], upper[limited], names, space.share @ seen, np.zeros(space.basis.shape[1])
    )
    if shape is None:
        raise UnsupportedError("the rate limits contradict each other")
    return space.polytope(shape, "velocity")


def _stops(chain: ClosedChain, q: Configuration) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the limits that stand at their lower and at their upper end."""
    outside = chain.judge.positions(q)
    if outside:
        listed = "; ".join(map(str, outside))
        raise UnreachableError(
            f"joints exceed their ranges: {listed}; choose another configuration, or limits=False",
            violations={excess.joint: (excess.value, *excess.allowed) for excess in outside},
            residual=max(excess.by for excess in outside),
            iterations=0,
            q=q,
        )
    low: list[int] = []
    high: list[int] = []
    for asked in chain.judge.asked(q[None]):
        slack = chain.judge.slack(asked)
        lower, upper = chain.limits.bounds("position", asked.rows).T
        low += asked.rows[asked.values[0] <= lower + slack[:, 0]].tolist()
        high += asked.rows[asked.values[0] >= upper - slack[:, 1]].tolist()
    return np.array(low, dtype=int), np.array(high, dtype=int)
