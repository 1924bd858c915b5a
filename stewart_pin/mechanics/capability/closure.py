r"""Which wrenches motors that only pull, or only push, can balance: all of them, or those of a set.

With A the wrenches that efforts exert on the platform, in the coordinates of its freedoms, and E what they do to
motions that leave it at rest (the inside of a redundant arm), efforts of the allowed signs give :math:`\{A x: E x =
0\}`, a cone. By Stiemke's theorem it is the whole space if and only if A has full rank there and some x that balances
itself, A x = 0 and E x = 0, pulls with every motor that can pull at all; otherwise some w has :math:`w^\top A x \le 0`
for all of them, and w cannot be exerted. Both are linear programmes; no determinant is asked.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.optimize import linprog

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array
from stewart_pin.errors import ConvergenceError, InputError
from stewart_pin.mechanics.capability.enumeration import maximise
from stewart_pin.mechanics.capability.platform_space import PlatformSpace, platform_space
from stewart_pin.mechanics.inverse_dynamics import let_idle_go, natural_share
from stewart_pin.mechanics.sharing import Free, Slack, effort_bounds, most_slack, without_noise
from stewart_pin.model.tree import Limits
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.freedom import require_held
from stewart_pin.state.state import State, as_state
from stewart_pin.tolerances import SINGULAR
from stewart_pin.typing import ArrayLike, FloatArray

_DRIVEN = 1e-10
"""Share of all that the motors do above which a motion is driven by them."""
_PULLS = 1e-9
"""Smallest share of the largest tension that is more than round-off of a state and of a linear programme."""


@dataclass(frozen=True, eq=False, repr=False)
class WrenchClosure(Brief):
    """Whether motors can balance any wrench with efforts of the allowed signs, however large these may be.

    Attributes
    ----------
    holds
        Whether they can.
    margin
        Smallest over largest effort of the motors with one sign, in natural units, where they balance each other as
        evenly as they can: 1 where all pull alike, 0 where there is no closure; infinite where motors that push and
        pull suffice [dimensionless].
    tension
        (nu,) these efforts, the largest being one in natural units; zero where there are none [1/m or 1].
    wrench
        (6,) [force; moment] on the platform from outside, at its origin in world axes, that no such efforts balance;
        None where there is none [N, N m].
    """

    holds: bool
    margin: float
    tension: FloatArray
    wrench: FloatArray | None


@dataclass(frozen=True, eq=False, repr=False)
class WrenchFeasibility(Brief):
    """Whether motors can balance all wrenches of a set within their limits.

    Attributes
    ----------
    holds
        Whether they can.
    margin
        Least distance of an effort to its limit, at the worst wrench, if motors share it so that this is as large as
        can be; negative: by how much limits are passed at least; infinite: there are none [N or N m].
    motors
        Those whose limits leave no more.
    wrench
        (6,) the worst wrench of the set [N, N m].
    efforts
        (nu,) of all motors there [N or N m].
    margins
        (n,) the same margin at each corner of the set [N or N m].
    """

    holds: bool
    margin: float
    motors: tuple[str, ...]
    wrench: FloatArray
    efforts: FloatArray
    margins: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class WrenchPath(Brief):
    """Closure and feasibility along a path.

    Attributes
    ----------
    holds
        Whether there is closure all along and, if wrenches were asked for, all are balanced.
    closure
        (N,) margins of `WrenchClosure`, dimensionless.
    feasible
        (N,) margins of `WrenchFeasibility`; None without wrenches [N or N m].
    worst
        Index of the state with the least of the latter, else of the former.
    detail
        Feasibility there; None without wrenches.
    """

    holds: bool
    closure: FloatArray
    feasible: FloatArray | None
    worst: int
    detail: WrenchFeasibility | None


def wrench_closure(
    chain: ClosedChain | State, q: ArrayLike | None = None, *, effort_limit: ArrayLike | Limits | None = None
) -> WrenchClosure:
    """Tell whether the motors of a platform can balance any wrench, however large, with efforts of the allowed signs.

    A motor whose least effort is zero or more only pulls, in the sense of a cable; one whose greatest is zero or less
    only pushes; all others do both. How large limits are does not count here: see `wrench_feasible`. Of a platform with
    fewer than six freedoms the question is about the wrenches that do work on these. No weight is counted: a robot that
    hangs by its weight has no closure.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration with closed loops, with a chain [m, rad, unit quaternions].
    effort_limit
        As in `inverse_dynamics`; default: ``chain.limits`` [N or N m].

    Returns
    -------
    WrenchClosure
        With a margin and the efforts behind it, or with a wrench that cannot be balanced.

    Raises
    ------
    UnsupportedError
        If the platform cannot move.
    InputError
        If the loops are open at q, or limits have the wrong shape or order.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> pushing = stp.with_limits(chain, {motor: {"effort": (0, 400)} for motor in chain.motors})
    >>> stp.polytopes.wrench_closure(pushing, chain.q_home).holds  # six that push cannot pull down
    False
    >>> stp.polytopes.wrench_closure(chain, chain.q_home).holds
    True
    """
    state = as_state(chain, q).require_regular()
    bounds = _limits(state, effort_limit)
    space = platform_space(state, None)
    exerted, inner = _exerted(state, space)
    # Motors of one sign, turned so that they pull; those whose limits leave nothing at all are out.
    pulls = (bounds[:, 0] >= 0) & (bounds[:, 1] > 0)
    pushes = (bounds[:, 1] <= 0) & (bounds[:, 0] < 0)
    usable = np.flatnonzero((bounds[:, 0] < 0) | (bounds[:, 1] > 0))
    sign = np.where(pushes, -1.0, 1.0)
    exerted, inner = exerted * sign, inner * sign
    one = (pulls | pushes)[usable]
    if len(inner):
        usable = usable[_usable(inner[:, usable], one)]
        one = (pulls | pushes)[usable]
    A, E = exerted[:, usable], inner[:, usable]
    lost = _lost(A, E)
    tension, margin = np.zeros(bounds.shape[0]), 0.0
    if lost is None:
        even, margin = _most_even(np.vstack([A, E]), one)
        tension[usable] = even
        lost = _never_exerted(A, E, one) if margin <= _PULLS else None
    holds = lost is None
    stretch = np.repeat([1.0, space.length], 3)
    wrench = None if lost is None else -(space.basis @ (lost / np.linalg.norm(lost))) * stretch
    sizes = state.chain.tangent_scale[state.chain.motor_index]
    return WrenchClosure(holds, margin if holds else 0.0, sign * tension / sizes * holds, wrench)


def _limits(state: State, limit: ArrayLike | Limits | None) -> FloatArray:
    state.chain.require_motors()
    return effort_bounds(state.chain, state.chain.limits if limit is None else limit)


def _exerted(state: State, space: PlatformSpace) -> tuple[FloatArray, FloatArray]:
    """Tell what efforts in natural units exert on the platform (d, nu), and on motions that leave it (e, nu)."""
    share = natural_share(state)[0]
    inside = np.linalg.svd(space.share)[2][space.share.shape[0] :] @ share
    _, s, vt = np.linalg.svd(inside, full_matrices=False)
    driven = s > _DRIVEN * np.linalg.norm(share, 2)
    return np.linalg.pinv(space.share.T) @ share, s[driven, None] * vt[driven]


def _usable(inner: FloatArray, one: np.ndarray) -> np.ndarray:
    """Motors (indices) that may give anything while the motions inside stay in balance."""
    n = one.size
    # x of one sign at least t, 0 <= t <= 1: such x add up, so that the largest sum of t shows all at once.
    answer = linprog(
        np.r_[np.zeros(n), -one.astype(float)],
        A_ub=np.hstack([-np.eye(n), np.eye(n)])[one],
        b_ub=np.zeros(np.count_nonzero(one)),
        A_eq=np.hstack([inner, np.zeros_like(inner)]),
        b_eq=np.zeros(len(inner)),
        bounds=[(0 if k else None, None) for k in one] + [(0, 1)] * n,
        method="highs-ds",
    )
    if answer.status != 0:
        raise ConvergenceError(f"which motors can pull was not found: {answer.message}", residual=np.inf)
    return np.flatnonzero(~one | (answer.x[n:] > 0.5))


def _lost(A: FloatArray, E: FloatArray) -> FloatArray | None:
    """Find a wrench that no efforts exert at all, whatever their signs."""
    rank = np.linalg.matrix_rank(E) if len(E) else 0
    free = np.linalg.svd(E)[2][rank:].T if len(E) else np.eye(A.shape[1])
    u, s, _ = np.linalg.svd(A @ free)
    full = np.count_nonzero(s > SINGULAR * np.linalg.norm(A, 2)) if s.size else 0
    return u[:, full] if full < A.shape[0] else None


def _most_even(balance: FloatArray, one: np.ndarray) -> tuple[FloatArray, float]:
    """Efforts (n,) that balance themselves, and the smallest of those with one sign; the largest of them is one."""
    n = one.size
    if not one.any():
        return np.zeros(n), np.inf
    _, s, vt = np.linalg.svd(balance)
    null = without_noise(vt[np.count_nonzero(s > SINGULAR * s[0]) :].T)
    pulling = null[one]
    # What moves no motor of one sign is left at rest.
    _, s, vt = np.linalg.svd(pulling)
    seen = vt[: np.count_nonzero(s > SINGULAR)].T
    if not seen.shape[1]:
        return np.zeros(n), 0.0
    rows = without_noise(pulling @ seen)
    k = len(rows)
    stacked = np.vstack([np.hstack([rows, -np.ones((k, 1))]), np.hstack([rows, np.zeros((k, 1))])])
    none = np.full(k, np.inf)
    best = maximise(np.eye(stacked.shape[1])[-1], stacked, np.r_[np.zeros(k), -none], np.r_[none, np.ones(k)])
    even = null @ seen @ best[:-1]
    largest = float(even[one].max())
    if largest <= _PULLS:
        return np.zeros(n), 0.0
    return even / largest, max(0.0, float(even[one].min()) / largest)


def _never_exerted(A: FloatArray, E: FloatArray, one: np.ndarray) -> FloatArray:
    """Find w with w @ A @ x <= 0 for all efforts x of the allowed signs that balance the motions inside."""
    both, d = np.vstack([A, E]).T, A.shape[0]
    single, double = both[one], both[~one]
    answer = linprog(
        single.sum(axis=0),
        A_ub=np.vstack([single, -single]),
        b_ub=np.r_[np.zeros(len(single)), np.ones(len(single))],
        A_eq=double if len(double) else None,
        b_eq=np.zeros(len(double)) if len(double) else None,
        bounds=(None, None),
        method="highs-ds",
    )
    if answer.status != 0:
        raise ConvergenceError(
            f"a wrench that cannot be balanced was not found: {answer.message}", residual=np.inf
        )
    return answer.x[:d]


# ----------------------------------------------------------------------------------------------------
# Sets of wrenches within limits
# ----------------------------------------------------------------------------------------------------


def wrench_box(least: ArrayLike, most: ArrayLike) -> FloatArray:
    """List the corners of a box of wrenches.

    Parameters
    ----------
    least, most
        (6,) [force; moment], component by component [N, N m].

    Returns
    -------
    numpy.ndarray
        (n, 6) its corners; equal components are counted once [N, N m].

    Raises
    ------
    InputError
        If a component of `least` is above that of `most`, or a shape is wrong.
    """
    low, high = as_array("least", least, (6,)), as_array("most", most, (6,))
    if (low > high).any():
        raise InputError(f"least must nowhere be above most, got {low} and {high}")
    ends = [(a,) if a == b else (a, b) for a, b in zip(low, high, strict=True)]
    return np.array(list(product(*ends)))


def wrench_feasible(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    a: ArrayLike | None = None,
    *,
    wrenches: ArrayLike,
    effort_limit: ArrayLike | Limits | None = None,
) -> WrenchFeasibility:
    """Tell whether motors can balance a set of wrenches within their limits, and by what margin.

    Weight, inertia of the motion and what joints do by themselves count. The margin is a concave function of the
    wrench, so that the corners of a convex set tell all of it.

    Parameters
    ----------
    chain
        Closed chain, or a state of it; without an acceleration it does not accelerate.
    q
        (nq,) configuration with closed loops, with a chain [m, rad, unit quaternions].
    v
        (nv,) tangent velocity; default: rest [m/s, rad/s].
    a
        (nv,) tangent acceleration; default: none [m/s², rad/s²].
    wrenches
        (n, 6) or (6,) corners of the set, as of `wrench_box`: [force; moment] on the platform from outside, at its
        origin in world axes [N, N m].
    effort_limit
        As in `inverse_dynamics`; default: ``chain.limits`` [N or N m].

    Returns
    -------
    WrenchFeasibility
        The margin, the motors and the wrench that set it.

    Raises
    ------
    ActuationError
        If the motors cannot hold the robot.
    InputError
        If an argument has the wrong shape, or the state does not keep the loops closed.
    MissingRoleError
        If the chain has no motors or no platform.
    """
    state = as_state(chain, q, v, a)
    bounds = _limits(state, effort_limit)
    if state.a is None:
        state = _resting(state)
    acceleration = state.require_accelerating()
    require_held(state)
    corners = np.atleast_2d(as_array("wrenches", wrenches, (6,) if np.ndim(wrenches) == 1 else (None, 6)))
    if not len(corners):
        raise InputError("wrenches must hold a wrench at least, got none")
    freedom = state.freedom
    share, sizes = natural_share(state)
    needed, _ = let_idle_go(state, acceleration, freedom.idle, None)
    loads = freedom.motions.T @ (needed[:, None] - state.P.T @ corners.T)
    rank = freedom.count.motor
    u, s, vt = np.linalg.svd(share)
    least = vt[:rank].T @ ((u[:, :rank].T @ loads) / s[:rank, None])
    null, ends = without_noise(vt[rank:].T), bounds * sizes[:, None]
    size = max(float(np.abs(least).max()), float(np.abs(ends[np.isfinite(ends)]).max(initial=0.0))) or 1.0
    found = [_slack(Free(x / size, null, *(ends / size).T)) for x in least.T]
    units = size / sizes
    margins = np.array([float((one.slack * units)[one.pushed].min(initial=np.inf)) for one in found])
    worst = int(np.argmin([one.slack for one in found]))
    return WrenchFeasibility(
        holds=bool(found[worst].slack >= -_PULLS),
        margin=float(margins[worst]),
        motors=tuple(m for m, held in zip(state.chain.motors, found[worst].pushed, strict=True) if held),
        wrench=corners[worst],
        efforts=found[worst].efforts * units,
        margins=margins,
    )


def _resting(state: State) -> State:
    """Let a state that has no acceleration stay at rest."""
    if state.v.any():
        raise InputError("a must be given with a velocity that is not zero; see platform_motion")
    return state.chain.at(state.q, state.v, np.zeros(state.chain.nv))


def _slack(free: Free) -> Slack:
    """Distance to the limits; infinite where there are none."""
    if free.null.shape[1]:
        found = most_slack(free)
        if found is not None:
            return found
        return Slack(np.inf, free.start, np.zeros(free.start.size, dtype=bool))
    room = np.minimum(free.start - free.least, free.most - free.start)
    slack = float(room.min(initial=np.inf))
    pushed = (room <= slack + _PULLS) & np.isfinite(room)
    return Slack(slack, free.start, pushed)


def wrench_path(
    states: Iterable[State],
    *,
    wrenches: ArrayLike | None = None,
    effort_limit: ArrayLike | Limits | None = None,
) -> WrenchPath:
    """Ask for closure, and for a set of wrenches, along a path.

    Parameters
    ----------
    states
        States of a chain, as `platform_motion` gives, or ``inverse_kinematics(chain, pose).state`` of poses.
    wrenches
        (n, 6) corners of a set that is to be balanced at each state, as in `wrench_feasible`; or None [N, N m].
    effort_limit
        As in `wrench_closure` [N or N m].

    Returns
    -------
    WrenchPath
        Margins, state by state.

    Raises
    ------
    InputError
        If there are no states, or as in `wrench_feasible`.
    """
    path = list(states)
    if not path:
        raise InputError("states must hold a state at least, got none")
    closed = [wrench_closure(state, effort_limit=effort_limit) for state in path]
    closure = np.array([one.margin for one in closed])
    if wrenches is None:
        return WrenchPath(all(one.holds for one in closed), closure, None, int(closure.argmin()), None)
    found = [wrench_feasible(state, wrenches=wrenches, effort_limit=effort_limit) for state in path]
    margins = np.array([one.margin for one in found])
    worst = int(margins.argmin())
    holds = all(one.holds for one in closed) and all(one.holds for one in found)
    return WrenchPath(holds, closure, margins, worst, found[worst])
