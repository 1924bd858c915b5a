r"""How motors share what the equations of motion leave free, within their limits.

With x the efforts in natural units, all N m, every :math:`x = x_0 + Z y` carries the load: x₀ is the least of them, and
Z an orthonormal basis of what motors may do against each other. Two questions are asked of that set and the limits:

- the nearest to some efforts, a quadratic programme in y with one solution, by exchanges of the limits that hold, which
  end at it to round-off; ProxQP, which the linear one is solved by, stops short of it where limits meet;
- the linear programme :math:`\max s`, with a slack s to every limit: how far efforts may stay from all limits, the
  least peak (limits ± 0, slack - peak), and where there are none, by how much limits are passed at least.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from stewart_pin.errors import ConvergenceError, EffortLimitError, InputError
from stewart_pin.model.tree import Limits
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import ArrayLike, BoolArray, FloatArray

Sharing = Literal["least_norm", "least_peak", "mid_range"]
"""Which of the efforts that carry a load are taken: see `inverse_dynamics`."""

_EXCEEDED = 1e-9
"""Share of the load by which a limit may be passed before it counts as not kept: round-off of a state."""
_EXACT = 1e-12
"""Round-off of efforts, relative to the load or the limit."""
_PUSHES = 1e-9
"""Multiplier, of a sum of one, from which on a limit has a part in the answer of a linear programme."""


@dataclass(frozen=True, eq=False)
class Free:
    """All efforts that carry a load, in natural units over a size that makes them about one: ``start + null @ y``.

    Attributes
    ----------
    start
        (nu,) the least of them, dimensionless.
    null
        (nu, r) orthonormal basis of what motors may do against each other, dimensionless.
    least, most
        (nu,) limits, infinite where there is none, dimensionless.
    """

    start: FloatArray
    null: FloatArray
    least: FloatArray
    most: FloatArray

    def beyond(self, efforts: FloatArray) -> FloatArray:
        """Tell by how much efforts pass their limits.

        Parameters
        ----------
        efforts
            (nu,) dimensionless.

        Returns
        -------
        numpy.ndarray
            (nu,) zero or more, dimensionless.
        """
        return np.maximum(np.maximum(self.least - efforts, efforts - self.most), 0.0)


@dataclass(eq=False)
class Sharer:
    """Shares the loads of one chain; begins each with the limits that held before, which along a motion mostly hold on.

    Attributes
    ----------
    chain
        Closed chain.
    bounds
        (nu, 2) least and greatest efforts, infinite where there is none [N or N m].
    sharing
        Which efforts are taken.
    """

    chain: ClosedChain
    bounds: FloatArray
    sharing: Sharing = "least_norm"
    _last: dict[int, tuple[BoolArray, BoolArray]] = field(default_factory=dict, repr=False)

    def efforts(self, share: FloatArray, load: FloatArray, rank: int) -> FloatArray:
        """Find the efforts.

        Parameters
        ----------
        share
            (dof, nu) what efforts in natural units contribute to each motion, dimensionless.
        load
            (dof,) what the motions need [N m].
        rank
            How many independent ways the motors move.

        Returns
        -------
        numpy.ndarray
            (nu,) within the limits, to round-off [N or N m].

        Raises
        ------
        EffortLimitError
            If no efforts within the limits carry the load.
        """
        sizes = self.chain.tangent_scale[self.chain.motor_index]
        bound = self.bounds * sizes[:, None]
        # Dependent rows (idle freedoms carry no load) are taken out, and the load is scaled to about one.
        u, s, vt = np.linalg.svd(share)
        pressed = np.maximum(bound[:, 0], -bound[:, 1])  # what a motor has to give at least
        size = max(float(np.abs(load).max(initial=0.0)), float(pressed.max(initial=0.0))) or 1.0
        goal = (u[:, :rank].T @ load) / (s[:rank] * size)
        free = Free(vt[:rank].T @ goal, without_noise(vt[rank:].T), *(bound / size).T)
        efforts = self._chosen(free)
        if efforts is None or float(free.beyond(efforts).max(initial=0.0)) > _EXCEEDED:
            raise _in_the_way(self.chain, self.bounds, free, size / sizes, size)
        return np.clip(efforts * size / sizes, *self.bounds.T)

    def _chosen(self, free: Free) -> FloatArray | None:
        """Efforts (nu,) by the rule; None where the limits leave none."""
        if not free.null.shape[1]:
            return free.start
        if self.sharing == "least_peak":
            return self._least_peak(free)
        if self.sharing == "mid_range":
            middle = middle_of(free.least, free.most)
            free = Free(free.start + free.null @ (free.null.T @ middle), free.null, free.least, free.most)
        return self._nearest(free)

    def _nearest(self, free: Free) -> FloatArray | None:
        """Find the efforts nearest to where ``y`` is zero."""
        rank = free.null.shape[1]
        none = np.zeros(free.start.size, dtype=bool)
        for held in (self._last.get(rank), (none, none)):
            exact = None if held is None else _settled(free, *held)
            if exact is not None:
                assert held is not None
                self._last[rank] = held
                return exact
        found = _by_exchanges(free)
        if found is None:
            return None
        self._last[rank] = found
        return _settled(free, *found, certain=True)

    def _least_peak(self, free: Free) -> FloatArray | None:
        """Of the efforts whose largest is least, those of least norm."""
        nought = np.zeros(free.start.size)
        found = most_slack(Free(free.start, free.null, nought, nought), within=free)
        if found is None:
            return None
        peak = -found.slack
        # Limits and peaks that push are reached by all efforts of that peak: only the others are left to choose.
        pushed = found.pushed
        rows, gap = free.null[pushed], (found.efforts - free.start)[pushed]
        fixed = np.linalg.lstsq(rows, gap, rcond=1e-10)[0]
        _, s, vt = np.linalg.svd(rows)
        within = vt[np.count_nonzero(s > 1e-10) :].T
        start = free.start + free.null @ fixed
        leeway = _EXACT * max(1.0, peak)
        least, most = np.maximum(free.least, -peak) - leeway, np.minimum(free.most, peak) + leeway
        start[pushed] = found.efforts[pushed]
        if not within.shape[1]:
            return start
        best = self._nearest(Free(start, without_noise(free.null @ within), least, most))
        return found.efforts if best is None else best


def without_noise(rows: FloatArray) -> FloatArray:
    """Clear rows that are round-off: scaled to one they would be directions.

    Parameters
    ----------
    rows
        (m, n) of size one or zero, dimensionless.

    Returns
    -------
    numpy.ndarray
        (m, n) the same, dimensionless.
    """
    return np.where(np.linalg.norm(rows, axis=1)[:, None] > _EXACT, rows, 0.0)


def sharer(chain: ClosedChain, limit: ArrayLike | Limits | None, sharing: Sharing) -> Sharer | None:
    """Read how efforts are to be shared.

    Parameters
    ----------
    chain
        Closed chain.
    limit
        One number or (nu,), largest absolute efforts; (nu, 2), least and greatest ones; inf for none; or
        ``chain.limits``; or None [N or N m].
    sharing
        Which efforts are taken.

    Returns
    -------
    Sharer or None
        None where the efforts are the least-norm ones, whatever the limits.

    Raises
    ------
    InputError
        If an option is unknown, limits have the wrong shape or order, or there are none to take the middle of.
    """
    require_sharing(sharing)
    if limit is None:
        if sharing == "mid_range":
            raise InputError(
                "sharing='mid_range' needs effort_limit, as chain.limits: without limits there is no middle"
            )
        if sharing == "least_norm":
            return None
        limit = np.inf
    return Sharer(chain, effort_bounds(chain, limit), sharing)


def require_sharing(sharing: str) -> None:
    """Refuse a rule that there is not.

    Parameters
    ----------
    sharing
        What the caller passed.

    Raises
    ------
    InputError
        If it is no `Sharing`.
    """
    if sharing not in get_args(Sharing):
        raise InputError(f"sharing must be one of {', '.join(get_args(Sharing))}, got {sharing!r}")


def middle_of(least: FloatArray, most: FloatArray) -> FloatArray:
    """Find the middles of ranges.

    Parameters
    ----------
    least, most
        (nu,) limits, infinite where there is none [any unit].

    Returns
    -------
    numpy.ndarray
        (nu,) the middle of a range with two ends; of others what is nearest to zero [any unit].
    """
    both = np.isfinite(least) & np.isfinite(most)
    with np.errstate(invalid="ignore"):
        return np.where(both, (least + most) / 2, np.clip(0.0, least, most))


def effort_bounds(chain: ClosedChain, limit: ArrayLike | Limits) -> FloatArray:
    """Read limits of efforts.

    Parameters
    ----------
    chain
        Closed chain.
    limit
        As in `sharer` [N or N m].

    Returns
    -------
    numpy.ndarray
        (nu, 2) least and greatest efforts, infinite where there is none [N or N m].

    Raises
    ------
    InputError
        If limits have the wrong shape or order.
    """
    if isinstance(limit, Limits):
        limit = limit.bounds("effort", chain.motor_index)
    nu = chain.nu
    try:
        bound = np.asarray(limit, dtype=float)
        if bound.shape != (nu, 2):
            bound = np.broadcast_to(bound, (nu,))
    except (TypeError, ValueError):
        raise InputError(
            f"effort_limit must be a number or have shape ({nu},), got {np.shape(limit)} of {type(limit).__name__}; "
            f"with the least efforts first, ({nu}, 2)"
        ) from None
    if bound.ndim == 2:
        if not (bound[:, 0] <= bound[:, 1]).all():
            raise InputError(f"effort_limit must have the least effort first, got {bound.tolist()}")
        return bound
    if not (bound >= 0).all():
        raise InputError(f"effort_limit must be 0 or more (inf: no limit), got {np.min(bound):g}")
    return bound[:, None] * [-1.0, 1.0]


def _settled(free: Free, low: BoolArray, high: BoolArray, *, certain: bool = False) -> FloatArray | None:
    """Put efforts at their limits exactly there; None where that is not certainly the optimum.

    Of min y² with ``rows y = gap`` at the limits that hold, the optimum is ``y = rowsᵀ m``, with m zero or more at
    lower and zero or less at upper limits.
    """
    held = low | high
    efforts = free.start
    if held.any():
        bound = np.where(low, free.least, free.most)[held]
        rows, gap = free.null[held], bound - free.start[held]
        if len(rows) > free.null.shape[1]:
            return None
        y = np.linalg.lstsq(rows, gap, rcond=_EXACT)[0]
        if not certain:
            push = np.linalg.lstsq(rows.T, y, rcond=_EXACT)[0]
            wrong = np.where(low[held], -push, push) > _EXACT * max(1.0, float(np.abs(push).max()))
            if wrong.any() or np.abs(rows @ y - gap).max() > _EXACT * max(1.0, float(np.abs(bound).max())):
                return None
        efforts = free.start + free.null @ y
        efforts[held] = bound
    ends = np.abs([free.least, free.most])
    size = np.maximum(1.0, np.where(np.isfinite(ends), ends, 0.0).max(axis=0))
    return efforts if certain or (free.beyond(efforts) <= _EXACT * size).all() else None


def _by_exchanges(free: Free) -> tuple[BoolArray, BoolArray] | None:
    """Find the limits that hold by exchanging them one by one, or None where efforts within all of them do not exist.

    The dual method of Goldfarb and Idnani, Mathematical Programming 27, 1983: the limit that is passed most is taken
    in, and one that has come to pull the wrong way is let go. Each exchange makes y² larger.
    """
    nu, rank = free.null.shape
    y, held, signs, push = np.zeros(rank), [], [], np.zeros(0)
    for _ in range(20 * (nu + rank)):
        efforts = free.start + free.null @ y
        beyond = free.beyond(efforts)
        beyond[held] = 0.0
        worst = int(beyond.argmax())
        if beyond[worst] <= _EXACT * max(1.0, float(np.abs(efforts).max())):
            break
        sign, new = (1.0, 0.0) if efforts[worst] < free.least[worst] else (-1.0, 0.0)
        normal = sign * free.null[worst]
        bound = sign * (free.least if sign > 0 else free.most)[worst] - sign * free.start[worst]
        while True:
            rows = np.array(signs)[:, None] * free.null[held]
            step = np.linalg.lstsq(rows.T, normal, rcond=None)[0] if held else np.zeros(0)
            direction = normal - rows.T @ step
            left, gap = float(direction @ direction), bound - float(normal @ y)
            whole = gap / left if left > 1e-22 * float(normal @ normal) > 0 else np.inf
            ends = np.where(step > 1e-11, push / np.where(step > 1e-11, step, 1.0), np.inf)
            go = float(ends.min(initial=np.inf))
            if whole == go == np.inf:
                return None
            far = min(whole, go)
            push, new = push - far * step, new + far
            if whole < np.inf:
                y = y + far * direction
            if whole <= go:
                held, signs, push = [*held, worst], [*signs, sign], np.append(push, new)
                break
            drop = int(ends.argmin())
            del held[drop], signs[drop]
            push = np.delete(push, drop)
    low, high = np.zeros(nu, dtype=bool), np.zeros(nu, dtype=bool)
    low[[k for k, sign in zip(held, signs, strict=True) if sign > 0]] = True
    high[[k for k, sign in zip(held, signs, strict=True) if sign < 0]] = True
    return low, high


# ----------------------------------------------------------------------------------------------------
# The linear programme of the slack
# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Slack:
    """The efforts that stay farthest from all limits.

    Attributes
    ----------
    slack
        The least distance to a limit; negative by how much limits are passed at least, dimensionless.
    efforts
        (nu,) the efforts, dimensionless.
    pushed
        (nu,) of bool, dimensionless: motors whose limits allow no more.
    """

    slack: float
    efforts: FloatArray
    pushed: BoolArray


def most_slack(free: Free, *, within: Free | None = None) -> Slack | None:
    """Find the efforts that carry a load and stay farthest from all their limits.

    Parameters
    ----------
    free
        Efforts that carry it, and limits to stay away from, one of them finite.
    within
        Limits that hold without slack, or None.

    Returns
    -------
    Slack or None
        The efforts; None where the limits of `within` leave none, or no limit of `free` is finite.
    """
    from stewart_pin.mechanics.capability.enumeration import maximise  # noqa: PLC0415 - SciPy is slow to import

    nu, rank = free.null.shape
    one, none = np.ones((nu, 1)), np.full(nu, np.inf)
    rows = [np.hstack([free.null, -one]), np.hstack([free.null, one])]
    lower, upper = [free.least - free.start, -none], [none, free.most - free.start]
    if within is not None:
        rows.append(np.hstack([free.null, 0 * one]))
        lower.append(within.least - free.start)
        upper.append(within.most - free.start)
    stacked, low, high = np.vstack(rows), np.concatenate(lower), np.concatenate(upper)
    stated = np.isfinite(low) | np.isfinite(high)
    if not stated[: 2 * nu].any():
        return None
    stacked, low, high, motor = (
        stacked[stated],
        low[stated],
        high[stated],
        np.tile(np.arange(nu), len(rows))[stated],
    )
    cost = np.eye(rank + 1)[-1]
    # What no limit sees is left at rest.
    _, s, vt = np.linalg.svd(stacked)
    seen = vt[: np.count_nonzero(s > 1e-10)].T
    try:
        best = seen @ maximise(seen.T @ cost, without_noise(stacked @ seen), low, high)
    except ConvergenceError:
        return None
    value = stacked @ best
    bounds = np.concatenate([low, high])
    near = 1e-9 * max(1.0, float(np.abs(bounds[np.isfinite(bounds)]).max()))
    at_low, at_high = value - low < near, high - value < near
    pushed = np.zeros(nu, dtype=bool)
    normals = np.vstack([-stacked[at_low], stacked[at_high]])
    pushed[np.concatenate([motor[at_low], motor[at_high]])[_multipliers(normals, cost) > _PUSHES]] = True
    return Slack(float(best[-1]), free.start + free.null @ best[:-1], pushed)


def _multipliers(normals: FloatArray, cost: FloatArray) -> FloatArray:
    """With which weights normals of the limits that hold make up what is maximised."""
    from scipy.optimize import nnls  # noqa: PLC0415 - slow to import

    return nnls(normals.T, cost)[0] if len(normals) else np.zeros(0)


def _in_the_way(
    chain: ClosedChain, bounds: FloatArray, free: Free, units: FloatArray, size: float
) -> EffortLimitError:
    """Tell which motors' limits keep a load from being carried, and by how much they are passed at least."""
    efforts, motors = free.start, free.beyond(free.start) > 0
    if free.null.shape[1]:
        found = most_slack(free)
        if found is not None:
            efforts, motors = found.efforts, found.pushed & (free.beyond(found.efforts) > 0)
    by, values = free.beyond(efforts) * units, efforts * units
    left = float(np.linalg.norm(free.beyond(efforts))) * size
    violations, told = {}, []
    for k in np.flatnonzero(motors):
        ends = float(bounds[k, 0]), float(bounds[k, 1])
        violations[chain.motors[k]] = (float(values[k]), *ends)
        unit = "N m" if chain.angle_mask[chain.motor_index[k]] else "N"
        told.append(
            f"'{chain.motors[k]}' by {by[k]:.4g} {unit} (at {values[k]:.6g}, allowed {ends[0]:.6g} to {ends[1]:.6g})"
        )
    how = "at least, however they share, " if free.null.shape[1] else ""
    return EffortLimitError(
        f"no efforts within effort_limit carry the load ({left:.3g} N m of some motion is left over): {how}limits are "
        f"passed of {', '.join(told) or 'no single motor'}; raise the limit or slow down",
        residual=left,
        violations=violations,
    )
