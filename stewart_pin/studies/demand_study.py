"""Many motions at once: as few calls of kernels as memory allows, and figures that do not depend on the company."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any

import numpy as np

from stewart_pin.errors import InputError
from stewart_pin.kernels.kernels import Kernels
from stewart_pin.motion.motor_demand import (
    MotorDemand,
    demand_by_formula,
    demand_kernels,
    demands_by_kernels,
)
from stewart_pin.motion.trajectories import PlatformSamples
from stewart_pin.state.chain import ClosedChain
from stewart_pin.studies.answers import Answer, NoAnswer, Results, ask
from stewart_pin.studies.carried import Carried
from stewart_pin.studies.points import Point, Points, function_name, words
from stewart_pin.typing import FloatArray

_STATES = 50_000
"""States that are held at a time: 25 MB."""
_INSTANTS = 400
"""Guess of the length of a motion where the first one fails."""


@dataclass(frozen=True, eq=False)
class DemandStudy:
    """What motions ask of the motors, for `sweep_study`.

    Attributes
    ----------
    chain
        A closed chain, carried; or a function that builds one.
    motion
        Function that gives samples.
    of_chain, of_motion
        Parameters that each is given.
    kernels
        True, False or None, as in `motor_demand`.
    share
        Points that a design has on average: kernels are compiled where its states are worth it.
    limits
        Whether motions are judged by all limits.
    """

    chain: Carried | Callable[..., ClosedChain]
    motion: Callable[..., PlatformSamples]
    of_chain: tuple[str, ...]
    of_motion: tuple[str, ...]
    kernels: bool | None
    share: float
    limits: bool = False

    def __call__(self, points: Sequence[Point]) -> list[Answer]:
        """Answer points.

        Parameters
        ----------
        points
            Where.

        Returns
        -------
        list
            Figures of each, or why there are none.
        """
        answers: dict[int, Answer] = {}
        batch, states = _Batch(), 0
        for k, point in enumerate(points):
            case = self.case(point)
            if isinstance(case, NoAnswer):
                answers[k] = case
                continue
            if case.kernels is None:
                demand = ask(partial(demand_by_formula, case.chain, case.samples), point)
                answers[k] = demand if isinstance(demand, NoAnswer) else self.figures([demand])[0]
                continue
            if batch.cases and (case.kernels is not batch.cases[0].kernels or states > _STATES):
                answers |= batch.answers(self)
                batch, states = _Batch(), 0
            states += len(case.samples)
            batch.numbers.append(k)
            batch.cases.append(case)
        if batch.cases:
            answers |= batch.answers(self)
        return [answers[k] for k in range(len(points))]

    def figures(self, demands: Sequence[MotorDemand]) -> list[Results]:
        """Condense demands.

        Parameters
        ----------
        demands
            Of one chain.

        Returns
        -------
        list
            Figures of each.
        """
        found = _figures(demands)
        if self.limits:
            for figures, demand in zip(found, demands, strict=True):
                figures["within_limits"] = np.array(float(demand.holds()))
        return found

    def case(self, point: Point) -> Case | NoAnswer:
        """Make the robot and the motion of a point.

        Parameters
        ----------
        point
            Where.

        Returns
        -------
        Case or NoAnswer
            What is to be computed, or why it cannot be.

        Raises
        ------
        InputError
            If the functions give something else.
        """
        chain = ask(lambda: _built(self, tuple((name, point[name]) for name in self.of_chain)), point)
        if isinstance(chain, NoAnswer):
            return chain
        _require(chain, ClosedChain, "chain", self.chain, point)
        given = point | {"chain": chain}
        samples = ask(lambda: self.motion(**{name: given[name] for name in self.of_motion}), point)
        if isinstance(samples, NoAnswer):
            return samples
        _require(samples, PlatformSamples, "motion", self.motion, point)
        if not len(samples):
            raise InputError(f"motion {function_name(self.motion)} gives no instant at {words(point)}")
        kernels = ask(lambda: demand_kernels(chain, len(samples) * self.share, self.kernels), point)
        return kernels if isinstance(kernels, NoAnswer) else Case(point, chain, samples, kernels)


@dataclass(frozen=True, eq=False)
class Case:
    """The robot and the motion of a point.

    Attributes
    ----------
    point
        Where.
    chain
        Closed chain.
    samples
        Motion.
    kernels
        What the demand is computed by; None: by formula.
    """

    point: Point
    chain: ClosedChain
    samples: PlatformSamples
    kernels: Kernels | None


def motions_in_a_task(study: DemandStudy, points: Points) -> int:
    """Choose how many points a task has: one, or as many as kernels do in some ten milliseconds.

    Parameters
    ----------
    study
        The study.
    points
        Its points, of which the first is tried.

    Returns
    -------
    int
        Number of points.

    Raises
    ------
    MissingExtraError
        If kernels are wanted and CasADi is not installed.
    """
    if not points.size:
        return 1
    if isinstance(study.chain, Carried) and study.kernels:
        demand_kernels(study.chain.value, 1, True)
    case = study.case(points.at(0))
    if isinstance(case, NoAnswer):
        return 1 if study.kernels is False else max(1, _STATES // _INSTANTS)
    return 1 if case.kernels is None else max(1, _STATES // len(case.samples))


@dataclass(frozen=True, eq=False)
class _Batch:
    """Cases of one chain that wait for its kernels."""

    numbers: list[int] = field(default_factory=list)
    cases: list[Case] = field(default_factory=list)

    def answers(self, study: DemandStudy) -> dict[int, Answer]:
        kernels = self.cases[0].kernels
        assert kernels is not None
        answers: dict[int, Answer] = {}
        known: dict[int, MotorDemand] = {}
        found = demands_by_kernels(kernels, [case.samples for case in self.cases])
        for k, case, demand in zip(self.numbers, self.cases, found, strict=True):
            if isinstance(demand, int):  # an error, most likely, which the verbs of one state can word
                demand = ask(partial(demand_by_formula, case.chain, case.samples, suspect=demand), case.point)
            if isinstance(demand, NoAnswer):
                answers[k] = demand
            else:
                known[k] = demand
        if known:
            answers |= zip(known, study.figures(list(known.values())), strict=True)
        return answers


@lru_cache(maxsize=8)
def _built(study: DemandStudy, parameters: tuple[tuple[str, Any], ...]) -> ClosedChain:
    """Build a design once for all its motions, so that its kernels are compiled once."""
    return study.chain.value if isinstance(study.chain, Carried) else study.chain(**dict(parameters))


def _require(value: object, kind: type, what: str, function: Any, point: Point) -> None:
    if not isinstance(value, kind):
        raise InputError(
            f"{what} {function_name(function)} must give a {kind.__name__}, at {words(point)} it gives {value!r:.60}"
        )


def _figures(demands: Sequence[MotorDemand]) -> list[Results]:
    """Condense demands; sums run along each motion by itself, so that no bit depends on the others."""
    lengths = np.array([demand.time.size for demand in demands])
    begins = np.cumsum(lengths) - lengths
    positions = np.concatenate([demand.positions for demand in demands])
    rates = np.concatenate([demand.rates for demand in demands])
    efforts = np.concatenate([demand.efforts for demand in demands])
    power = np.abs(efforts * rates)

    def largest(values: FloatArray) -> FloatArray:
        return np.maximum.reduceat(values, begins, axis=0)

    def mean(values: FloatArray) -> FloatArray:
        return np.add.reduceat(values, begins, axis=0) / lengths[:, None]

    lowest, highest = np.minimum.reduceat(positions, begins, axis=0), largest(positions)
    figures = {
        "peak_effort": largest(np.abs(efforts)),
        "rms_effort": np.sqrt(mean(efforts**2)),
        "lowest_position": lowest,
        "highest_position": highest,
        "travel": highest - lowest,
        "peak_rate": largest(np.abs(rates)),
        "peak_power": largest(power),
        "mean_power": mean(power),
    }
    return [{name: values[k] for name, values in figures.items()} for k in range(len(demands))]
