"""Where a path meets its first singularity, found as the root of a signed measure.

The measures of `stewart_pin.mechanics.singularity` are singular values. Along a path each is the absolute value
of a smooth function, which changes sign where it crosses zero: the singular vectors on both sides then fit with one
of the pair turned round. Intervals are halved until the singular values at both ends and in the middle are larger than
the change of the matrix in between (no singular value changes by more, Weyl's inequality), or the sign at both ends is
known.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pinocchio as pin
from scipy.optimize import brentq, minimize_scalar

from stewart_pin.analysis.point_by_point import Path, closed_path
from stewart_pin.brief import Brief
from stewart_pin.checks import as_array, as_count, as_positive
from stewart_pin.errors import InputError
from stewart_pin.mechanics.singularity import (
    ALIGNED,
    Measure,
    Singularity,
    SingularityKind,
    classify_singularity,
    signed_measure,
    split_jacobians,
)
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.freedom import TWIST_AXES, TwistAxis
from stewart_pin.state.generic import generic_freedom
from stewart_pin.state.state import as_chain, as_configuration
from stewart_pin.typing import ArrayLike, Configuration

_SHORTEST = 1e-6
"""Share of the path below which an interval is not halved."""
_SHORT = 1e-3
"""Share of the path below which a measure without change of sign is minimised instead."""
_ZERO = 1e-6
"""Measure at a root: a path may pass it as steeply as its shortest interval allows."""
_FAR = 0.5
"""Step of a configuration, in robot sizes and radians, whose ends tell nothing of what lies between."""
_JUMP = 0.03
"""Step of a configuration within the shortest interval that is no motion, in robot sizes and radians."""


@dataclass(frozen=True, eq=False, repr=False)
class SingularityOnPath(Brief):
    """The first singularity on a path, or how near the path comes to one.

    Attributes
    ----------
    found
        Whether there is one.
    at
        Parameter of the path there; where none was found, that of the smallest measure seen.
    q
        (nq,) configuration there [m, rad, unit quaternions].
    kind
        The measure that vanishes, or that was smallest.
    crossed
        Whether the path passes to the other side, or only touches.
    distance
        Length of the path up to there, as the tangent measures it: lengths in robot sizes, angles in radians.
    margin
        The measure there: round-off at a singularity.
    singularity
        What the configuration is like there.
    """

    found: bool
    at: float
    q: Configuration
    kind: SingularityKind
    crossed: bool
    distance: float
    margin: float
    singularity: Singularity


def find_singularity(
    chain: ClosedChain,
    path: Path | ArrayLike,
    *,
    interval: tuple[float, float] = (0.0, 1.0),
    kinds: Iterable[SingularityKind | str] | None = None,
    axes: Sequence[TwistAxis] = TWIST_AXES,
    samples: int = 33,
    tolerance: float = 1e-8,
    length: float | None = None,
) -> SingularityOnPath:
    """Find the first singularity along a motion, or between closed configurations.

    Parameters
    ----------
    chain
        Closed chain.
    path
        (nq,) closed configuration as a continuous function of one parameter, for instance of time; or (n, nq)
        configurations to be joined by `closed_path`, with the parameter from 0 to n - 1 [m, rad, unit quaternions].
    interval
        First and last parameter of a function; for configurations the whole path is searched.
    kinds
        Which to look for, of ``"loop"``, ``"motor"``, ``"platform"``, ``"passive"``; default: all.
    axes
        Components of the twist that count as motion of the platform, as in `classify_singularity`.
    samples
        Number of points to begin with; between them intervals are halved as far as needed.
    tolerance
        Largest measure that counts as zero where a path touches a singularity without crossing it.
    length
        Length that makes turning and shifting of the platform comparable; default: ``chain.length_scale`` [m].

    Returns
    -------
    SingularityOnPath
        The first one, or the place where the path comes nearest.

    Raises
    ------
    InputError
        If an argument makes no sense, or the path jumps.
    ClosureError
        If loops do not close between configurations.

    Notes
    -----
    A path from a singular configuration starts on one: it is found at once, with ``at`` the start.
    """
    as_chain(chain)
    chain.platform_link  # noqa: B018 - raises
    if not callable(path):
        stops = as_array("path", path, (None, chain.nq))
        path, interval = closed_path(chain, stops), (0.0, len(stops) - 1.0)
    start, end = (float(x) for x in as_array("interval", interval, (2,)))
    if not start < end:
        raise InputError(f"interval must rise, got {interval}")
    samples = as_count("samples", samples, 2)
    search = _Search(
        chain, path, _chosen(kinds), as_positive("tolerance", tolerance), length, (start, end), axes
    )
    return search.run(np.linspace(start, end, samples))


def _chosen(kinds: Iterable[SingularityKind | str] | None) -> tuple[SingularityKind, ...]:
    try:
        chosen = tuple(SingularityKind if kinds is None else (SingularityKind(kind) for kind in kinds))
    except ValueError:
        chosen = ()
    if isinstance(kinds, str) or not chosen:
        raise InputError(f"kinds must be some of {', '.join(SingularityKind)}, got {kinds!r}")
    return chosen


@dataclass(frozen=True, eq=False)
class _Sample:
    s: float
    q: Configuration
    measures: dict[SingularityKind, Measure]


class _Search:
    """Samples of a path, and what lies between them."""

    def __init__(
        self,
        chain: ClosedChain,
        path: Path,
        kinds: tuple[SingularityKind, ...],
        tolerance: float,
        length: float | None,
        interval: tuple[float, float],
        axes: Sequence[TwistAxis],
    ) -> None:
        self._chain, self._path, self._kinds, self._tolerance = chain, path, kinds, tolerance
        self._span, self._end = interval[1] - interval[0], interval[1]
        self._length = chain.length_scale if length is None else as_positive("length", length)
        self._generic = generic_freedom(chain, axes)
        self._seen: dict[float, _Sample] = {}

    def run(self, grid: np.ndarray) -> SingularityOnPath:
        here, zero = self._sample(grid[0]), max(_ZERO, self._tolerance)
        for s in grid[1:]:
            ahead = [self._sample(s)]
            while ahead:
                there = ahead[-1]
                for kind in self._kinds:
                    if here.measures[kind].value <= self._tolerance:
                        return self._result(here, kind, crossed=False)
                roots = self._roots(here, there, zero)
                if roots is None:
                    ahead.append(self._sample((here.s + there.s) / 2))
                    continue
                if roots:
                    at, crossed, kind = min(roots, key=lambda root: root[0].s)
                    return self._result(at, kind, crossed=crossed)
                here = ahead.pop()
        kind = min(self._kinds, key=lambda k: min(x.measures[k].value for x in self._seen.values()))
        nearest = min(self._seen.values(), key=lambda x: x.measures[kind].value)
        return self._result(
            nearest, kind, crossed=False, found=nearest.measures[kind].value <= self._tolerance
        )

    def _roots(
        self, here: _Sample, there: _Sample, zero: float
    ) -> list[tuple[_Sample, bool, SingularityKind]] | None:
        """Singularities in an interval, whether each is crossed, and its kind; None where a shorter one would tell."""
        verdicts = {kind: self._between(here, there, kind) for kind in self._kinds}
        wide = there.s - here.s > _SHORTEST * self._span
        if "unsure" in verdicts.values() and wide:
            return None
        self._require_motion(here, there)
        # What is still unsure in the shortest interval: vectors that turn fast beside a value that is not zero.
        sure = {kind: verdict for kind, verdict in verdicts.items() if verdict not in ("clear", "unsure")}
        roots = [(*self._root(here, there, kind, verdict), kind) for kind, verdict in sure.items()]
        true = [root for root in roots if root[0].measures[root[2]].value <= zero]
        # A change of sign without a zero: the vectors of two values that come near each other were exchanged.
        return None if wide and len(true) < len(roots) else true

    def _sample(self, s: float) -> _Sample:
        s = float(s)
        if s not in self._seen:
            q = as_configuration(self._chain, "path", self._path(s))
            split = split_jacobians(self._chain.at(q), self._generic, self._length)
            self._seen[s] = _Sample(s, q, split.measures)
        return self._seen[s]

    def _between(self, a: _Sample, b: _Sample, kind: SingularityKind) -> str:
        """Tell what a measure does in an interval: clear, crossed, touched, or unsure."""
        first, last = a.measures[kind], b.measures[kind]
        if not np.isfinite(first.value):
            return "clear"
        if np.abs(self._step(a, b)).max() > _FAR:
            return "unsure"
        if last.value <= self._tolerance:
            # On a singularity by chance: its vectors say nothing.
            return "ends" if b.s - a.s <= _SHORT * self._span else "unsure"
        middle = self._sample((a.s + b.s) / 2).measures[kind]
        change = sum(np.linalg.norm(x.matrix - middle.matrix, 2) for x in (first, last))
        if min(first.value, middle.value, last.value) > change:
            return "clear"
        if min(abs(first.left @ last.left), abs(first.motion @ last.motion)) < ALIGNED:
            return "unsure"
        # From one value to minus the other is no farther than the matrix goes.
        if signed_measure(first, last) < 0 and first.value + last.value <= change:
            return "crossed"
        if b.s - a.s > _SHORT * self._span:
            return "unsure"
        return "touched" if self._lowest(a, b, kind).measures[kind].value <= self._tolerance else "clear"

    def _lowest(self, a: _Sample, b: _Sample, kind: SingularityKind) -> _Sample:
        def value(s: float) -> float:
            return signed_measure(a.measures[kind], self._sample(s).measures[kind])

        options = {"xatol": 1e-12 * max(1.0, abs(a.s), abs(b.s))}
        found = minimize_scalar(value, bounds=(a.s, b.s), method="bounded", options=options)
        return self._sample(float(found.x))

    def _root(self, a: _Sample, b: _Sample, kind: SingularityKind, verdict: str) -> tuple[_Sample, bool]:
        """Locate where a measure vanishes, and tell whether the path crosses there."""
        first = a.measures[kind]
        if verdict == "ends":
            beyond = 2 * b.s - a.s
            return b, beyond < self._end and signed_measure(first, self._sample(beyond).measures[kind]) < 0
        if verdict == "touched":
            return self._lowest(a, b, kind), False
        tight = 4e-15 * max(1.0, abs(a.s), abs(b.s))
        root = brentq(lambda s: signed_measure(first, self._sample(s).measures[kind]), a.s, b.s, xtol=tight)
        return self._sample(float(root)), True  # pyright: ignore[reportArgumentType]

    def _step(self, a: _Sample, b: _Sample) -> np.ndarray:
        return pin.difference(self._chain.model, a.q, b.q) / self._chain.tangent_scale

    def _require_motion(self, a: _Sample, b: _Sample) -> None:
        step = self._step(a, b)
        if b.s - a.s <= _SHORTEST * self._span and np.abs(step).max() > _JUMP:
            joint = self._chain.tangent_names[int(np.argmax(np.abs(step)))]
            raise InputError(
                f"path jumps between {a.s:.8g} and {b.s:.8g}: {joint} moves by {np.abs(step).max():.3g} [robot sizes, "
                "rad]; pass a continuous path, or configurations on one assembly mode"
            )

    def _result(
        self, at: _Sample, kind: SingularityKind, *, crossed: bool, found: bool = True
    ) -> SingularityOnPath:
        before = sorted((x for x in self._seen.values() if x.s <= at.s), key=lambda x: x.s)
        return SingularityOnPath(
            found=found,
            at=at.s,
            q=at.q,
            kind=kind,
            crossed=crossed,
            distance=float(sum(np.linalg.norm(self._step(x, y)) for x, y in pairwise(before))),
            margin=at.measures[kind].value,
            singularity=classify_singularity(self._chain, at.q, length=self._length, generic=self._generic),
        )
