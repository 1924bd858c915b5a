"""Platforms as shake tables: how much of a motion their joints can give."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.errors import ClosureError, EffortLimitError, InputError
from stewart_pin.mechanics.sharing import Sharing, require_sharing
from stewart_pin.model.tree import LimitKind
from stewart_pin.motion.joint_motion import asked_of_motors, asked_of_others
from stewart_pin.motion.motor_demand import MotorDemand, motor_demand
from stewart_pin.motion.trajectories import PlatformSamples
from stewart_pin.state.base_motion import BaseMotions
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.limits import Asked
from stewart_pin.state.outside import MotionWrenches
from stewart_pin.state.state import as_chain
from stewart_pin.tolerances import AT_LIMIT
from stewart_pin.typing import FloatArray

_ACCURACY = 1e-6
"""Relative accuracy of the scale found."""
_FULL = 1.0 + AT_LIMIT
"""Share of a limit that is used up, with round-off."""
_FEW = 100
"""Instants at which joints that no motor moves are looked at first; those where they go furthest are added."""
_ROUNDS = 20
"""Times that instants are added."""
_WORDS: dict[LimitKind, str] = {
    "position": "stroke",
    "velocity": "rate",
    "acceleration": "acceleration",
    "effort": "effort",
    "jerk": "jerk",
}


@dataclass(frozen=True)
class Binding:
    """The limit that a motion reaches first, relative to what is allowed.

    Attributes
    ----------
    limit
        ``"stroke"``, ``"rate"``, ``"acceleration"``, ``"jerk"`` or ``"effort"``; ``"reach"`` where joints cannot follow
        the motion.
    motor
        Name of the motor, or of the passive joint or the joint that closes a loop, as in ``chain.limits.names``; for
        ``"reach"``, of the platform.
    time
        When [s].
    value
        What is asked for [m, rad, m/s, rad/s, N or N m].
    allowed
        What the file allows, less the margin, in the same unit.
    use
        Share of the limit that is used; above 1 it is exceeded. For a stroke, counted from the middle.
    """

    limit: str
    motor: str
    time: float
    value: float
    allowed: float
    use: float


@dataclass(frozen=True, eq=False, repr=False)
class FitReport(Brief):
    """How much of a motion a robot can do.

    Attributes
    ----------
    scale
        Largest factor, at most 1, with all limits respected.
    samples
        The motion at this scale.
    demand
        What it asks of the motors.
    binding
        The limit nearest to being reached at this scale.
    unscaled
        Most used limit of each kind: of the motors at full scale; of the other joints at the largest scale that the
        motors allow. Why the motion had to be scaled, if it had.
    margin
        Part of every limit that was kept free.
    looked_at
        Joints whose limits were looked at, by kind of limit; one that is missing has none.
    """

    scale: float
    samples: PlatformSamples
    demand: MotorDemand
    binding: Binding | None
    unscaled: tuple[Binding, ...]
    margin: float
    looked_at: Mapping[str, tuple[str, ...]]

    def __str__(self) -> str:
        """Tell the scale, what binds, and what was looked at."""
        said = "no limit is stated"
        if self.binding is not None:
            said = f"{self.binding.use:.4g} of the {self.binding.limit} of {self.binding.motor}"
        looked = "; ".join(
            f"{kind} of {', '.join(names[:3])}" + (f" and {len(names) - 3} more" if len(names) > 3 else "")
            for kind, names in self.looked_at.items()
        )
        return f"scale {self.scale:.6g}: {said}\nlooked at: {looked or 'nothing'}"


def fit_to_limits(
    chain: ClosedChain,
    motion: Callable[[float], PlatformSamples],
    *,
    wrenches: MotionWrenches | None = None,
    base_motion: BaseMotions | None = None,
    margin: float = 0.0,
    sharing: Sharing | None = None,
) -> FitReport:
    """Scale a motion down until every limit that is stated holds, of passive joints and joints that close loops too.

    The poses found pass `inverse_kinematics` with limits, and the motion is within what `limits_exceeded` judges.

    Parameters
    ----------
    chain
        Closed chain.
    motion
        Factor to motion; at factor 0 the platform rests, within all limits.
    wrenches
        What acts from outside whatever the factor, as in `motor_demand` [N, N m].
    base_motion
        How the ground moves whatever the factor, as in `motor_demand`.
    margin
        Part of every limit to keep free, from 0 up to but not including 1.
    sharing
        How redundant motors share the load within their limits of effort, less the margin, as in `inverse_dynamics`: of
        cables, which only pull. Default: by least norm, whatever the limits.

    Returns
    -------
    FitReport
        The largest factor found by bisection, to six digits, the limit that binds, and which were looked at.

    Raises
    ------
    InputError
        If the margin makes no sense, or the limits are exceeded at rest.

    Notes
    -----
    The motors come first, since they have closed forms and kernels. At the scale that they allow, the other joints are
    followed through all instants; where they go too far, the scale is found at those instants, and proven at all.
    """
    as_chain(chain)
    if not (np.ndim(margin) == 0 and isinstance(margin, int | float | np.number) and 0 <= margin < 1):
        raise InputError(f"margin must be at least 0 and below 1, got {margin!r}")
    if not callable(motion):
        raise InputError(f"motion must be a function of a scale, got {type(motion).__name__}")
    if sharing is not None:
        require_sharing(sharing)
    return _Fit(chain, motion, margin, wrenches, base_motion, sharing).report()


class _Fit:
    def __init__(
        self,
        chain: ClosedChain,
        motion: Callable[[float], PlatformSamples],
        margin: float,
        wrenches: MotionWrenches | None = None,
        base_motion: BaseMotions | None = None,
        sharing: Sharing | None = None,
    ) -> None:
        self.chain, self.motion, self.margin, self._sharing = chain, motion, margin, sharing
        self._acting: dict[str, Any] = {"wrenches": wrenches, "base_motion": base_motion}
        if sharing is not None:
            self._acting |= {"effort_limit": self._effort_bounds(), "sharing": sharing}

    def _effort_bounds(self) -> FloatArray:
        """Least and greatest efforts (nu, 2) less the margin."""
        low, high = self.chain.limits.bounds("effort", self.chain.motor_index).T
        free = 1.0 - self.margin
        # As `_use` counts them: a range around zero from there, others from the middle; of one end, by its size.
        with np.errstate(invalid="ignore"):
            size = np.maximum(
                np.where(np.isfinite(low), abs(low), 0.0), np.where(np.isfinite(high), abs(high), 0.0)
            )
            least, most = (
                np.where(np.isfinite(low), low, high - size),
                np.where(np.isfinite(high), high, low + size),
            )
            around = (low <= 0) & (high >= 0)
            middle = np.where(around, 0.0, (least + most) / 2)
            ends = [np.where(np.isfinite(end), middle + free * (end - middle), end) for end in (low, high)]
        return np.array(ends).T

    def report(self) -> FitReport:
        unscaled = self._of_motors(1.0)
        scale = 1.0
        if _worst(unscaled) > _FULL:
            self._require_rest(self._of_motors(0.0))
            scale = self._bisect(1.0, self._of_motors)
        others = self._of_others(scale)
        if _worst(others) > _FULL:
            self._require_rest(self._of_others(0.0, [0]))
            unscaled += others
            scale, others = self._narrow(scale, others)
        else:
            unscaled += others
        samples = self.motion(scale)
        demand = motor_demand(self.chain, samples, **self._acting)
        uses = self._used(
            asked_of_motors(self.chain, demand.positions, demand.rates, demand.efforts), demand.time
        )
        return FitReport(
            scale=scale,
            samples=samples,
            demand=demand,
            binding=max((*uses, *others), key=lambda binding: binding.use, default=None),
            unscaled=_of_each_kind(unscaled),
            margin=self.margin,
            looked_at=self._looked_at(),
        )

    def _narrow(self, scale: float, others: list[Binding]) -> tuple[float, list[Binding]]:
        """Find the scale at which joints without motors keep their limits, at a few instants, and prove it at all."""
        samples = self.motion(scale)
        if self.chain.limits.stated("jerk").size:
            return self._prove(self._bisect(scale, self._of_others))
        step = max(1, len(samples) // _FEW)
        instants = set(range(0, len(samples), step))
        for _ in range(_ROUNDS):
            instants |= {int(np.argmin(np.abs(samples.time - binding.time))) for binding in others}
            few = sorted(instants)
            scale = self._bisect(scale, lambda factor, few=few: self._of_others(factor, few))
            others = self._of_others(scale)
            if _worst(others) <= _FULL:
                return scale, others
        return self._prove(self._bisect(scale, self._of_others))

    def _prove(self, scale: float) -> tuple[float, list[Binding]]:
        return scale, self._of_others(scale)

    def _bisect(self, high: float, uses: Callable[[float], list[Binding]]) -> float:
        if _worst(uses(high)) <= _FULL:
            return high
        low = 0.0
        while high - low > _ACCURACY * high:
            middle = (low + high) / 2
            if _worst(uses(middle)) <= _FULL:
                low = middle
            else:
                high = middle
        return low

    def _require_rest(self, uses: list[Binding]) -> None:
        resting = max(uses, key=lambda binding: binding.use)
        if resting.use > _FULL:
            raise InputError(
                f"motion at scale 0 already exceeds the {resting.limit} limit of {resting.motor}: {resting.value:.6g}, "
                f"allowed {resting.allowed:.6g}; choose another home or a smaller margin{self._hint(resting)}"
            )

    def _hint(self, binding: Binding) -> str:
        spare = self.chain.nu > self.chain.generic.count.motor if binding.limit == "effort" else False
        return (
            ", or sharing= for redundant motors to keep within their limits"
            if spare and not self._sharing
            else ""
        )

    def _of_motors(self, scale: float) -> list[Binding]:
        samples = self.motion(scale)
        try:
            demand = motor_demand(self.chain, samples, **self._acting)
        except EffortLimitError as error:
            at = float(samples.time[0 if error.sample is None else error.sample])
            found = [self._beyond(motor, at, *numbers) for motor, numbers in error.violations.items()]
            return found or [Binding("effort", self.chain.platform_link, at, error.residual, 0.0, np.inf)]
        asked = asked_of_motors(self.chain, demand.positions, demand.rates, demand.efforts)
        return self._used(asked, demand.time)

    @staticmethod
    def _beyond(motor: str, at: float, value: float, least: float, greatest: float) -> Binding:
        """Tell of an effort that has no other way than beyond its limit."""
        allowed = least if value < least else greatest
        return Binding(
            "effort", motor, at, value, allowed, 1.0 + abs(value - allowed) / max(abs(value), abs(allowed))
        )

    def _of_others(self, scale: float, instants: Sequence[int] | None = None) -> list[Binding]:
        samples = self.motion(scale)
        try:
            asked = asked_of_others(self.chain, samples, instants)
        except ClosureError as error:
            at = float(samples.time[0 if error.sample is None else error.sample])
            return [Binding("reach", self.chain.platform_link, at, error.residual, 0.0, np.inf)]
        time = samples.time if instants is None else samples.time[list(instants)]
        return self._used(asked, time)

    def _used(self, asked: list[Asked], time: FloatArray) -> list[Binding]:
        """Most used limit of each kind."""
        found: list[Binding] = []
        names = self.chain.limits.names
        for each in asked:
            if not each.values.size:
                continue
            use, allowed = self._use(each)
            at = np.unravel_index(int(np.argmax(use)), use.shape)
            value, limit = float(each.values[at]), float(allowed[at])
            if each.kind in ("velocity", "effort"):  # of which the size is told
                value, limit = abs(value), abs(limit)
            found.append(
                Binding(
                    _WORDS[each.kind], names[int(each.rows[at[1]])], float(time[at[0]]), value, limit,
                    float(use[at]),
                )
            )  # fmt: skip
        return found

    def _use(self, asked: Asked) -> tuple[FloatArray, FloatArray]:
        """Share of the limits that is used, and what is allowed, (N, k) each."""
        limits, values = self.chain.limits, asked.values
        free = 1.0 - self.margin
        lower, upper = limits.of(asked.kind)[asked.rows].T
        low, high = limits.bounds(asked.kind, asked.rows).T
        largest = np.nanmax(np.abs([lower, upper]), axis=0)
        # A stroke with one end counts from there, by the size of the robot.
        size = self.chain.judge.sizes(asked.rows) if asked.kind == "position" else largest
        least = np.where(np.isnan(lower), upper - size, lower)
        most = np.where(np.isnan(upper), lower + size, upper)
        middle, half = (least + most) / 2, free * (most - least) / 2
        off = values - middle
        with np.errstate(divide="ignore", invalid="ignore"):
            above = np.where(np.isnan(upper) | (off == 0), 0.0, off / half)
            below = np.where(np.isnan(lower) | (off == 0), 0.0, -off / half)
        use = np.maximum(np.maximum(above, below), 0.0)
        allowed = middle + np.sign(off) * half
        if asked.kind == "position":
            return use, allowed
        # A range around zero is used from zero on to either side; (0, f) is used up by what is below zero.
        around = (low <= 0) & (high >= 0)
        end = np.where(values < 0, low, high)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.abs(values) / np.abs(free * end)
        share = np.where(np.abs(values) <= AT_LIMIT * largest, 0.0, share)
        return np.where(around, share, use), np.where(around, free * end, allowed)

    def _looked_at(self) -> dict[str, tuple[str, ...]]:
        limits, chain = self.chain.limits, self.chain
        found: dict[str, tuple[str, ...]] = {}
        for kind, word in _WORDS.items():
            rows = limits.stated(kind)
            if kind == "effort":
                rows = rows[np.isin(rows, chain.motor_index)]
            elif kind == "jerk":
                rows = rows[rows < chain.nv]
            if rows.size:
                found[word] = tuple(limits.names[row] for row in rows)
        return found


def _worst(uses: Sequence[Binding]) -> float:
    return max((binding.use for binding in uses), default=0.0)


def _of_each_kind(uses: Sequence[Binding]) -> tuple[Binding, ...]:
    found: dict[str, Binding] = {}
    for binding in uses:
        if binding.limit not in found or found[binding.limit].use < binding.use:
            found[binding.limit] = binding
    return tuple(found.values())
