"""What every motion of a family asks of the motors: amplitudes and frequencies, directions, designs of the robot."""

from __future__ import annotations

import functools
import hashlib
import inspect
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from stewart_pin.errors import InputError
from stewart_pin.kernels.choosing import require_choice
from stewart_pin.kernels.kernels import Kernels
from stewart_pin.mechanics.sharing import Sharer, Sharing, require_sharing, sharer
from stewart_pin.model.tree import KINDS
from stewart_pin.motion.motor_demand import (
    MotorDemand,
    demand_by_formula,
    demand_kernels,
    demands_by_kernels,
)
from stewart_pin.motion.trajectories import PlatformSamples
from stewart_pin.state.base_motion import BaseMotion, BaseMotions, base_motions
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.outside import MotionWrenches, WrenchSamples, wrench_samples
from stewart_pin.studies.answers import Answer, Carried, NoAnswer, Results, Sweep, ask
from stewart_pin.studies.comparison import Progress
from stewart_pin.studies.points import (
    Point,
    Points,
    as_points,
    function_name,
    require_parameters,
    require_portable,
    words,
)
from stewart_pin.studies.sweep import sweep_study
from stewart_pin.typing import ArrayLike, FloatArray

# ----------------------------------------------------------------------------------------------------
# Many motions at once: as few calls of kernels as memory allows, and figures that do not depend on the company
# ----------------------------------------------------------------------------------------------------


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
    sharing
        How redundant motors share within the limits of the chain; None: whatever the limits.
    wrenches, base_motion
        What acts from outside, and how the ground moves, as in `motor_demand` [N, N m].
    """

    chain: Carried | Callable[..., ClosedChain]
    motion: Callable[..., PlatformSamples]
    of_chain: tuple[str, ...]
    of_motion: tuple[str, ...]
    kernels: bool | None
    share: float
    limits: bool = False
    sharing: Sharing | None = None
    wrenches: MotionWrenches | None = None
    base_motion: BaseMotions | None = None

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
                demand = ask(self.formula(case), point)
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

    def sharer(self, chain: ClosedChain) -> Sharer | None:
        """Read how the motors of a chain share.

        Parameters
        ----------
        chain
            Closed chain.

        Returns
        -------
        Sharer or None
            None: by least norm, whatever the limits.
        """
        return None if self.sharing is None else sharer(chain, chain.limits, self.sharing)

    def formula(self, case: Case, suspect: int | None = None) -> Callable[[], MotorDemand]:
        """Prepare what computes a demand without kernels.

        Parameters
        ----------
        case
            Robot and motion.
        suspect
            Index of a state that no leg reaches, or None.

        Returns
        -------
        callable
            Gives the demand.
        """
        by = self.sharer(case.chain)
        return partial(
            demand_by_formula,
            case.chain,
            case.samples,
            suspect=suspect,
            outside=case.outside,
            grounds=case.grounds,
            sharing=by,
        )

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
        outside = wrench_samples(chain, self.wrenches, samples.time)
        grounds = base_motions(self.base_motion, samples.time)
        kernels = ask(
            lambda: demand_kernels(
                chain,
                len(samples) * self.share,
                self.kernels,
                outside,
                sharing=self.sharing,
                ground_moves=grounds is not None,
            ),
            point,
        )
        if isinstance(kernels, NoAnswer):
            return kernels
        return Case(point, chain, samples, kernels, outside, grounds)


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
    outside
        What acts from outside, or None.
    grounds
        Motion of the ground at every instant, or None: it rests.
    """

    point: Point
    chain: ClosedChain
    samples: PlatformSamples
    kernels: Kernels | None
    outside: WrenchSamples | None = None
    grounds: tuple[BaseMotion, ...] | None = None


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
        by = study.sharer(self.cases[0].chain)
        pushed = [case.outside.rows for case in self.cases if case.outside is not None]
        grounds = [motion for case in self.cases for motion in case.grounds or ()]
        found = demands_by_kernels(
            kernels,
            [case.samples for case in self.cases],
            pushed=np.concatenate(pushed) if pushed else None,
            grounds=grounds or None,
            sharing=by,
        )
        for k, case, demand in zip(self.numbers, self.cases, found, strict=True):
            if demand is None or isinstance(demand, int):  # an error, or a motion to be followed
                demand = ask(study.formula(case, demand), case.point)
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


# ----------------------------------------------------------------------------------------------------


def sweep_demand(
    chain: ClosedChain | Callable[..., ClosedChain],
    motion: Callable[..., PlatformSamples],
    axes: Mapping[str, ArrayLike],
    *,
    paired: bool = False,
    kernels: bool | None = None,
    limits: bool = False,
    sharing: Sharing | None = None,
    wrenches: MotionWrenches | None = None,
    base_motion: BaseMotions | None = None,
    executor: Executor | None = None,
    journal: str | Path | None = None,
    name: str | None = None,
    progress: Progress | None = None,
    chunk: int | None = None,
    in_flight: int | None = None,
) -> Sweep:
    """Compute what motions ask of the motors, over a grid of their parameters.

    Parameters
    ----------
    chain
        Closed chain; or a function of some of the parameters that builds it, for a sweep over designs.
    motion
        Function of the other parameters that gives the samples of a motion, in equal steps of time, a whole number of
        periods for means. If it has a parameter ``chain`` that is not bound, it is given the chain.
    axes
        Values along each axis, by the name of its parameter: numbers or strings [any unit].
    paired
        Whether the k-th values of all axes belong together: a list of points instead of a grid.
    kernels
        Whether to use compiled kernels, where a design can be compiled; None: where it has enough states, too. Without
        them each motion is computed by `motor_demand`, to the same numbers.
    limits
        Whether each motion is judged by all limits that are stated, of passive joints and joints that close loops too,
        which takes a tenth of a millisecond for every instant at which the motors keep theirs.
    sharing
        How redundant motors share the load within the effort limits of each chain, as in `inverse_dynamics`: of cables,
        which only pull; motions beyond them have no answer. Default: by least norm, whatever the limits.
    wrenches, base_motion
        What acts from outside during each motion, and how the ground moves, as in `motor_demand` [N, N m].
    executor, journal
        As in `sweep`.
    name
        What to call the study, which tells its journal from others; default: the names of chain and motion, with a
        digest of a chain that is given.
    progress
        As in `sweep`.
    chunk
        Motions in a task; None: as many as keep a worker busy for some ten milliseconds.
    in_flight
        As in `sweep`.

    Returns
    -------
    Sweep
        For each motor in the order of ``chain.motors``, arrays ``(*shape, nu)``: ``peak_effort`` and ``rms_effort``
        [N or N m]; ``lowest_position``, ``highest_position`` and their difference ``travel`` [m or rad]; ``peak_rate``
        [m/s or rad/s]; ``peak_power``, the largest of abs(effort · rate), and ``mean_power``, its mean: that of a drive
        that gets nothing back when it brakes [W]. Peaks are those of the samples. With `limits`, ``within_limits`` as
        well, ``(*shape,)``: 1 where every limit holds, else 0 [dimensionless].

    Raises
    ------
    InputError
        If a parameter is unknown or missing, the functions give no chain or no samples, or as in `sweep`.
    MissingExtraError
        If kernels are wanted and CasADi is not installed.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> home, phase = stp.platform_pose(chain, chain.q_home), np.arange(40) / 40
    >>> def shake(amplitude, frequency):
    ...     along_x = {"amplitude": [amplitude, 0, 0], "frequency": [frequency, 0, 0]}
    ...     return stp.motions.sinusoidal_motion(phase / frequency, home=home, **along_x)
    >>> found = stp.sweep_demand(chain, shake, {"amplitude": [0.01, 0.1], "frequency": [1.0, 5.0]})
    >>> found["peak_effort"].max(axis=-1).round()
    array([[  64.,  327.],
           [ 185., 2825.]])
    """
    points = as_points(axes, paired=paired)
    require_choice(kernels)
    if sharing is not None:
        require_sharing(sharing)
    of_chain, of_motion = _parameters(chain, motion, list(points.axes))
    groups = points.groups(of_chain) if of_chain else None
    designs = 1 if groups is None else int(groups.max(initial=-1)) + 1
    carried = Carried(_digest(chain), chain) if isinstance(chain, ClosedChain) else chain
    study = DemandStudy(
        carried,
        motion,
        of_chain,
        of_motion,
        kernels,
        points.size / max(1, designs),
        limits=limits,
        sharing=sharing,
        wrenches=wrenches,
        base_motion=base_motion,
    )
    for given in (wrenches, base_motion):
        require_portable(executor, given, "what acts on the motions")
    if not isinstance(chain, ClosedChain):
        require_portable(executor, chain, function_name(chain))
    require_portable(executor, motion, function_name(motion))
    called = _name(chain, motion) if name is None else name
    rules = (" within limits" if limits else "") + (f" by {sharing}" if sharing else "")
    rules += _acting(" with wrenches", wrenches) + _acting(" on a ground that moves by", base_motion)
    return sweep_study(
        study,
        points,
        name=called + rules,
        chunk=motions_in_a_task(study, points) if chunk is None else chunk,
        groups=groups,
        executor=executor,
        journal=journal,
        progress=progress,
        in_flight=in_flight,
    )


def _parameters(
    chain: object, motion: Callable[..., Any], names: Sequence[str]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Share the parameters out between the chain and the motion, by what each takes."""
    of_chain: list[str] = []
    if not isinstance(chain, ClosedChain):
        if not callable(chain):
            raise InputError(f"chain must be a ClosedChain or a function that builds one, got {chain!r:.60}")
        of_chain = _taken(chain, names)
        require_parameters(chain, of_chain, what="chain")
    if not callable(motion):
        raise InputError(f"motion must be a function that gives PlatformSamples, got {motion!r:.60}")
    of_motion = _taken(motion, names)
    if (unknown := [name for name in names if name not in (*of_chain, *of_motion)]) or "chain" in names:
        raise InputError(
            f"axis {(unknown or ['chain'])[0]!r} is no parameter of the motion {function_name(motion)}"
            f"{_signature(motion)}" + (" or of the chain" if callable(chain) else "")
        )
    bound = motion.keywords if isinstance(motion, functools.partial) else {}
    if "chain" in _signature(motion).parameters and "chain" not in bound:
        of_motion.append("chain")
    require_parameters(motion, of_motion, what="motion")
    return tuple(of_chain), tuple(of_motion)


def _taken(function: Callable[..., Any], names: Sequence[str]) -> list[str]:
    parameters = _signature(function).parameters.values()
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
        return list(names)
    known = {parameter.name for parameter in parameters}
    return [name for name in names if name in known]


def _signature(function: Callable[..., Any]) -> inspect.Signature:
    try:
        return inspect.signature(function)
    except (TypeError, ValueError):  # some functions written in C do not say what they take
        return inspect.Signature([inspect.Parameter("any", inspect.Parameter.VAR_KEYWORD)])


def _name(chain: ClosedChain | Callable[..., ClosedChain], motion: Callable[..., Any]) -> str:
    given = isinstance(chain, ClosedChain)
    robot = f"{chain.name} (digest {_digest(chain)[:8]})" if given else function_name(chain)
    return f"motor demand of {robot} under {function_name(motion)}"


def _acting(words: str, given: object) -> str:
    """Tell what acts from other such, for journals: a function by its name alone, as motions are."""
    if given is None:
        return ""
    if callable(given):
        return f"{words} {function_name(given)}"
    if isinstance(given, Mapping):
        parts: Sequence[object] = [
            (link, np.asarray(value, dtype=float).tolist()) for link, value in sorted(given.items())
        ]
    else:
        motions = [given] if isinstance(given, BaseMotion) else given
        assert isinstance(motions, Sequence)
        parts = [(m.rotation.tolist(), m.twist.tolist(), m.acceleration.tolist()) for m in motions]
    return f"{words} {hashlib.sha256(repr(parts).encode()).hexdigest()[:8]}"


def _digest(chain: ClosedChain) -> str:
    """Tell chains apart by all that their dynamics and the judgement of their limits depend on."""
    loops = [
        (
            loop.kind,
            loop.link1,
            loop.link2,
            loop.placement1.homogeneous.tolist(),
            loop.placement2.homogeneous.tolist(),
            loop.axis.tolist(),
            loop.axis2.tolist(),
            loop.length,
            loop.physics,
            loop.cable,
        )
        for loop in chain.loops
    ]
    couplings = [(one.joint1, one.joint2, one.polynomial, one.others) for one in chain.couplings]
    springs = [joint.physics for joint in chain.mechanism.joints]  # of which the model knows a part
    roles = (chain.motors, chain.platform, chain.q_home.tolist())
    # The text of the model knows only the limits of joints with one freedom, and of these not all kinds.
    limits = [chain.limits.names, *(chain.limits.of(kind).tolist() for kind in KINDS)]
    text = chain.model.saveToString() + repr((loops, couplings, springs, roles, limits))
    return hashlib.sha256(text.encode()).hexdigest()
