"""What a platform can do within the limits of its motors and joints.

All its twists and all wrenches that it can exert, for any chain; the greatest speeds and loads of a six-legged platform
from its geometry alone.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.optimize import linprog

from stewart_pin.checks import as_array
from stewart_pin.errors import (
    ConvergenceError,
    InputError,
    SingularityError,
    UnreachableError,
    UnsupportedError,
)
from stewart_pin.geometry.hexapod import Hexapod, leg_forces_for_wrench, leg_jacobian
from stewart_pin.mechanics.capability.enumeration import image_of_limits, maximise
from stewart_pin.mechanics.capability.platform_space import as_limit, motor_limits, platform_space
from stewart_pin.mechanics.capability.polytope import Polytope
from stewart_pin.mechanics.effort import hangs
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.freedom import require_held
from stewart_pin.state.outside import Wrenches, as_wrenches, given_efforts
from stewart_pin.state.state import State, as_state
from stewart_pin.tolerances import JACOBIAN_SINGULAR, SINGULAR, TAKES_PART
from stewart_pin.typing import ArrayLike, Configuration, FloatArray

# ----------------------------------------------------------------------------------------------------
# Which limits still bind a motion where others are free to compensate for it: idle spins, a redundant arm's inside
#
# With y = K f a motion that does not count, limits ``rows @ y <= bounds`` are to be projected along f. A limit that
# some f relaxes without tightening another one binds nothing, for that f may be as large as it likes; by the theorem
# of Tucker these are the limits that take part in no λ ≥ 0 with λᵀ rows K = 0. Those that stay are constant along
# every f that they let go on for ever, so that what they leave is bounded across these f.
# ----------------------------------------------------------------------------------------------------


_FARTHEST = 1 / SINGULAR
"""How far a compensating motion may go for a limit to be let off by one: what needs more leans on round-off."""
_LET_OFF = 0.5
"""Amount, of one, by which a limit has to be let off to count as such."""


def binding_limits(
    rows: FloatArray, lower: FloatArray, upper: FloatArray, free: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Drop the limits that motions which do not count can always keep.

    Parameters
    ----------
    rows
        (m, k) rows of the limits, of natural size [any unit].
    lower, upper
        (m,) bounds, infinite where there is none; the lower one is nowhere above the upper one [any unit].
    free
        (k, n) orthonormal basis of the motions that do not count [dimensionless].

    Returns
    -------
    lower : numpy.ndarray
        (m,) bounds, infinite where none binds [any unit].
    upper : numpy.ndarray
        (m,) the same [any unit].

    Raises
    ------
    ConvergenceError
        If the linear programme that tells them apart was not solved.
    """
    lower, upper = lower.copy(), upper.copy()
    along = rows @ free
    sizes = np.linalg.norm(along, axis=1)
    moved = np.flatnonzero(sizes > TAKES_PART * np.linalg.norm(rows, axis=1).max(initial=0.0))
    along = along[moved] / sizes[moved, None]
    while True:
        stated = np.isfinite(lower[moved]) | np.isfinite(upper[moved])
        moved, along = moved[stated], along[stated]
        high, low = np.isfinite(upper[moved]), np.isfinite(lower[moved])
        off = _off(np.vstack([along[high], -along[low]]))
        off_high, off_low = off[: np.count_nonzero(high)], off[np.count_nonzero(high) :]
        alone = _alone(along)
        if not (off.any() or alone.any()):
            return lower, upper
        upper[moved[high][off_high]], lower[moved[low][off_low]] = np.inf, -np.inf
        upper[moved[alone]], lower[moved[alone]] = np.inf, -np.inf


def _alone(along: FloatArray) -> np.ndarray:
    """Rows that no others make up: some motion meets any value of such a row and leaves the others as they are."""
    u, s, _ = np.linalg.svd(along)
    dependent = u[:, np.count_nonzero(s > SINGULAR) :]
    return np.linalg.norm(dependent, axis=1) < SINGULAR


def _off(sides: FloatArray) -> np.ndarray:
    """Sides ``sides @ f <= bound`` that some f lets off without tightening another."""
    m, n = sides.shape
    if m == 0:
        return np.zeros(0, dtype=bool)
    # sides f + t <= 0 with 0 <= t <= 1: such motions add up, so that the largest sum of t shows all at once.
    answer = linprog(
        np.r_[np.zeros(n), -np.ones(m)],
        A_ub=np.c_[sides, np.eye(m)],
        b_ub=np.zeros(m),
        bounds=[(-_FARTHEST, _FARTHEST)] * n + [(0.0, 1.0)] * m,
        method="highs-ds",
    )
    if answer.status != 0:
        raise ConvergenceError(
            f"the limits that bind the platform could not be told from those that do not: {answer.message}",
            residual=np.inf,
        )
    return answer.x[n:] > _LET_OFF


# ----------------------------------------------------------------------------------------------------


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
    if (lower > upper).any():
        raise UnsupportedError("the rate limits contradict each other")
    limited = np.flatnonzero(np.isfinite(lower) | np.isfinite(upper))
    rows = chain.judge.rates(state.q, freedom.motions, limited)
    # Motions that do not move the platform (an idle spin, the inside of a redundant arm) may be whatever keeps limits.
    sizes, inner = chain.judge.sizes(limited), np.linalg.svd(space.share)[2][space.share.shape[0] :].T
    least, most = binding_limits(rows / sizes[:, None], lower[limited], upper[limited], inner)
    binding = np.isfinite(least) | np.isfinite(most)
    limited, rows, least, most = limited[binding], rows[binding], least[binding], most[binding]
    # Motions that no limit sees do not move the platform either, because the motors hold it.
    _, s, vt = np.linalg.svd(rows / sizes[binding, None])
    seen = vt[: np.count_nonzero(s >= SINGULAR)].T
    names = tuple(
        (f"{chain.limits.names[k]} at {lower[k]:+.6g}", f"{chain.limits.names[k]} at {upper[k]:+.6g}")
        for k in limited
    )
    shape = image_of_limits(
        rows @ seen, least, most, names, space.share @ seen, np.zeros(space.basis.shape[1])
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


# ----------------------------------------------------------------------------------------------------
# All wrenches that a platform at rest can exert within the effort limits of its motors
# ----------------------------------------------------------------------------------------------------

_DRIVEN = 1e-10
"""Share of all that the motors do above which a motion is driven by them."""
_AT_REST = 1e-9
"""Share of the weight on freedoms without motor that is round-off."""


def wrench_polytope(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    *,
    effort_limit: ArrayLike | None = None,
    gravity: bool = False,
    wrenches: Wrenches | None = None,
    length: float | None = None,
) -> Polytope:
    r"""Find all wrenches that the platform can exert on its surroundings at rest.

    By virtual work, with N the motions that keep the loops closed and P the platform's Jacobian,

    .. math:: (P N)^\top w = (S N)^\top \tau - N^\top g(q) + N^\top \sum J_f^\top w_f, \qquad
              \tau_{min} \le \tau \le \tau_{max}.

    The set is exact: a skewed box with 64 corners for six motors and six freedoms, a zonotope for redundant motors.
    A wrench that the structure carries without any motor (across the plane of a planar robot) is left out; joints at
    the end of their range are not taken as stops that carry load.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration with closed loops, with a chain [m, rad, unit quaternions].
    effort_limit
        (nu,) or one number: largest absolute motor effort, nan for a motor's own limit; default: the limits of the
        chain, which may differ between push and pull [N or N m].
    gravity
        Whether the motors carry the weight of all bodies first; otherwise everything is weightless.
    wrenches
        {link: (6,)} what acts from outside already, as in `inverse_dynamics`, and shifts the set [N, N m].
    length
        Length that makes moments and forces comparable; default: ``chain.length_scale`` [m].

    Returns
    -------
    Polytope
        Wrenches [f; m] about the platform origin in world axes, or conjugate to the coordinates that a platform with
        fewer freedoms has. The load that can be put on the platform is minus these.

    Raises
    ------
    ActuationError
        If the motors cannot hold the robot.
    InputError
        If the loops are open at q, or neither the file nor the caller states a limit.
    UnsupportedError
        If no efforts within the limits keep the inner motions of the robot at rest.
    """
    state = as_state(chain, q).require_still_ground("wrench_polytope").require_regular()
    chain, freedom = state.chain, state.freedom
    ends = motor_limits(chain, "effort_limit", effort_limit, "effort")
    require_held(state)
    space = platform_space(state, length)

    # Efforts from the middle of their ranges, in shares of them, so that all bounds are one.
    middle, half = ends.mean(axis=1), (ends[:, 1] - ends[:, 0]) / 2
    motors = freedom.motions[chain.motor_index].T * half
    weight = -freedom.motions[chain.motor_index].T @ middle
    if gravity:
        weight = weight + freedom.motions.T @ state.weight
    given = given_efforts(State(chain, state.q), as_wrenches(chain, wrenches))
    if given is not None:
        weight = weight - freedom.motions.T @ given
    held, efforts = _inner_balance(state, space.share, motors, weight)
    to_platform = np.linalg.pinv(space.share.T)
    names = tuple(
        (f"{m} at {a:+.6g}", f"{m} at {b:+.6g}") for m, (a, b) in zip(chain.motors, ends, strict=True)
    )
    shape = image_of_limits(
        efforts, -1.0 - held, 1.0 - held, names,
        to_platform @ motors @ efforts, to_platform @ (motors @ held - weight),
    )  # fmt: skip
    if shape is None:
        raise UnsupportedError("no efforts within the limits keep the robot at rest; raise effort_limit")
    return space.polytope(shape, "wrench")


def _inner_balance(
    state: State, share: FloatArray, motors: FloatArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Keep the motions that leave the platform at rest (a redundant arm's, an idle spin) in balance for themselves.

    Gives efforts that carry the weight on these motions, and a basis of those that do not load them.
    """
    # The share has as many rows as the platform has freedoms here.
    inner = np.linalg.svd(share)[2][share.shape[0] :].T
    u, s, vt = np.linalg.svd(inner.T @ motors)
    # Relative to all that the motors do: an idle motion is driven by nothing but round-off.
    rank = int(np.count_nonzero(s > _DRIVEN * np.linalg.norm(motors, 2)))
    needed = inner.T @ weight
    held = vt[:rank].T @ ((u[:, :rank].T @ needed) / s[:rank])
    left = inner.T @ motors @ held - needed
    largest = float(np.abs(left).max(initial=0.0))
    round_off = largest <= _AT_REST * max(1.0, float(np.abs(weight).max()))
    if not round_off and not hangs(state, state.freedom.motions @ inner, left):
        raise UnsupportedError(
            f"the robot cannot rest here: {largest:.3g} N or N m of its weight, or of the wrenches, loads a "
            "motion that no motor drives"
        )
    return held, vt[rank:].T


# ----------------------------------------------------------------------------------------------------
# Greatest speeds and loads of a six-legged platform from its geometry alone
# ----------------------------------------------------------------------------------------------------


def velocity_limits(
    hexapod: Hexapod,
    position: ArrayLike,
    rotation: ArrayLike,
    *,
    rate_limit: ArrayLike,
    others: Literal["free", "zero"] = "free",
) -> FloatArray:
    """Find the greatest speed along x, y and z without turning.

    Parameters
    ----------
    hexapod
        Geometry.
    position
        (3,) platform origin in the base frame [m].
    rotation
        (3, 3) platform axes in the base frame.
    rate_limit
        (6,) or one number: largest absolute leg rate [m/s].
    others
        The other two components of the velocity: ``"free"`` to take any value (a linear programme for each axis), or
        ``"zero"`` for a motion straight along the axis.

    Returns
    -------
    numpy.ndarray
        (3,) greatest speed along each base axis [m/s].

    Raises
    ------
    SingularityError
        If the legs do not determine the platform's motion at this pose.
    InputError
        If an argument has the wrong shape, or a limit is not finite and above zero.
    """
    jacobian = leg_jacobian(
        hexapod, as_array("position", position, (3,)), as_array("rotation", rotation, (3, 3))
    )
    size = np.linalg.norm(hexapod.platform_points, axis=1).mean() or 1.0
    _require_regular(jacobian / [1, 1, 1, size, size, size], "the leg Jacobian")
    return velocity_limits_of_jacobian(jacobian[:, :3], rate_limit=rate_limit, others=others)


def velocity_limits_of_jacobian(
    jacobian: ArrayLike, *, rate_limit: ArrayLike, others: Literal["free", "zero"] = "free"
) -> FloatArray:
    """Find the greatest value of each velocity component, one after the other, from a Jacobian.

    For each component k: max v_k subject to ``|J v| <= rate_limit``.

    Parameters
    ----------
    jacobian
        (m, n) actuator rates per velocity component, of rank n [m/s or rad/s per unit].
    rate_limit
        (m,) or one number: largest absolute actuator rate [m/s or rad/s].
    others
        The other components: ``"free"`` or ``"zero"``.

    Returns
    -------
    numpy.ndarray
        (n,) greatest value of each component [m/s, or the unit of the component].

    Raises
    ------
    SingularityError
        If the Jacobian has a lower rank, so that some velocity has no bound.
    InputError
        If an argument has the wrong shape, or a limit is not finite and above zero.
    """
    jacobian = as_array("jacobian", jacobian, (None, None))
    m, n = jacobian.shape
    limit = as_limit("rate_limit", rate_limit, m)
    if others not in ("free", "zero"):
        raise InputError(f"others must be 'free' or 'zero', got {others!r}")
    if n == 0:
        raise InputError("jacobian must have at least one column")
    _require_regular(jacobian, "the Jacobian")
    if others == "zero":
        # One leg alone stops a motion along an axis; a leg across it does not.
        with np.errstate(divide="ignore"):
            return (limit[:, None] / np.abs(jacobian)).min(axis=0)
    return np.array([maximise(axis, jacobian, -limit, limit) @ axis for axis in np.eye(n)])


def load_limit(
    hexapod: Hexapod,
    position: ArrayLike,
    rotation: ArrayLike,
    *,
    force_limit: ArrayLike,
    direction: ArrayLike = (0.0, 0.0, 1.0),
) -> float:
    """Find the greatest force through the platform origin that the legs can exert without a moment.

    The leg forces f = J⁻ᵀ [d; 0] of a unit force grow in proportion; the first leg at its limit ends it.

    Parameters
    ----------
    hexapod
        Geometry.
    position
        (3,) platform origin in the base frame [m].
    rotation
        (3, 3) platform axes in the base frame.
    force_limit
        (6,) or one number: largest absolute leg force; (6, 2): least and greatest one, positive where a leg pushes the
        platform away, as (0, f) of one that only pushes [N].
    direction
        (3,) of the force, in base axes; its length does not matter [dimensionless].

    Returns
    -------
    float
        Greatest force; along +z it carries as much weight. Legs without load are within limits that hold zero; else it
        may be negative: the least that goes the other way [N].

    Raises
    ------
    SingularityError
        If the legs cannot carry every wrench at this pose.
    InputError
        If an argument has the wrong shape, the direction is zero, a limit is not finite and above zero, or no force in
        this direction keeps least forces that are not zero.
    """
    limits = _force_limits(force_limit)
    direction = as_array("direction", direction, (3,))
    size = float(np.linalg.norm(direction))
    if size == 0.0:
        raise InputError("direction must not be zero")
    jacobian = leg_jacobian(
        hexapod, as_array("position", position, (3,)), as_array("rotation", rotation, (3, 3))
    )
    forces = leg_forces_for_wrench(jacobian, np.concatenate([direction / size, np.zeros(3)]))
    idle = forces == 0.0
    if ((limits[idle, 0] > 0) | (limits[idle, 1] < 0)).any():
        raise InputError("force_limit asks for a force of a leg that no force in this direction loads")
    ends = limits[~idle] / forces[~idle, None]
    least, most = float(ends.min(axis=1).max()), float(ends.max(axis=1).min())
    if least > most:
        raise InputError(
            f"no force in this direction keeps force_limit: one leg asks for {least:.6g} N at least, another for "
            f"{most:.6g} N at most"
        )
    return most


def _force_limits(value: ArrayLike) -> FloatArray:
    """Least and greatest leg forces (6, 2)."""
    if np.shape(value) != (6, 2):
        return as_limit("force_limit", value, 6)[:, None] * [-1.0, 1.0]
    limits = as_array("force_limit", value, (6, 2))
    if (limits[:, 0] > limits[:, 1]).any():
        raise InputError(f"force_limit must have the least force first, got {limits.tolist()}")
    return limits


def _require_regular(jacobian: FloatArray, name: str) -> None:
    if jacobian.shape[0] < jacobian.shape[1]:
        raise SingularityError(
            f"{name} has {jacobian.shape[0]} rows for {jacobian.shape[1]} components: some velocity has no bound",
            smallest_singular_value=0.0,
        )
    _, s, vt = np.linalg.svd(jacobian)
    if s[-1] <= JACOBIAN_SINGULAR * s[0]:
        raise SingularityError(
            f"{name} is singular (smallest singular value {s[-1]:.3g}): the actuators do not limit every motion; "
            "move away from this pose",
            smallest_singular_value=float(s[-1]),
            direction=vt[-1],
        )
