"""Mechanisms whose loops move only as far as the digits of their file allow.

A planar, spherical or otherwise overconstrained loop needs axes that are exactly parallel, or meet in a point. Printed
with few digits they are not: the loops close to these digits only, rows that depended on each other are independent,
and the freedom is gone. The rank is then judged at the file's precision, the least singular values apart from the rest
by a gap, and joints and loops are moved by the least that lets the loops close exactly, all along the motion: at many
configurations U⊥ᵀ gap = 0, for the combinations U⊥ of rows that follow from the others. What results is an exact
mechanism, of the freedom that was meant, proven at configurations that took no part; it is taken only where the moves
are no larger than the digits explain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from stewart_pin.building.home import keep_home, near_home, settle_alone, settle_parts
from stewart_pin.building.near_mechanism import (
    Place,
    all_closed,
    closed_everywhere,
    none_near,
    of_size,
    placement_of,
    places_of,
)
from stewart_pin.errors import MechanismError
from stewart_pin.model.description import Note, Outcome
from stewart_pin.model.formats.precision import Precision
from stewart_pin.model.sizes import length_scale
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.newton import close_at_precision, displaced
from stewart_pin.state.state import State
from stewart_pin.tolerances import HOME_IN_FILE
from stewart_pin.typing import Configuration, FloatArray

_COARSEST = 5e-3
"""Largest gap that digits may explain unasked, in robot sizes and radians: beyond it a file is wrong, not coarse."""
_MARGIN = 8.0
"""How much more than all roundings together is forgiven: levers multiply them, and a short line between two points of a
file, as of two balls that make a hinge, turns by more than its ends are off."""
_EXACT = 1e-13
"""Singular values below this are round-off of a mechanism whose numbers are exact."""
_SAMPLES = 8
"""Configurations along the motion, and as many for each of its freedoms, that join the equations at a time."""
_LARGEST = 2400
"""Places times configurations that join at a time, beyond which the equations may take minutes."""
_PROBES = 2
"""Configurations on which a mechanism that is exact at home is tried."""
_ROUNDS = 4
"""Times that configurations join."""
_DOUBTS = 2
"""Sets of configurations at which no near mechanism closes the loops, after which none is looked for any more."""
_STRIDE = 0.6
"""How far the next configuration is from the one before, in robot sizes and radians."""
_WANDERING = 0.4
"""How far from straight on it goes, for each freedom."""
_REGULAR = (0.02, 0.02, 0.1, 0.02, 0.3, 0.05, 0.02, 0.1)
"""Share of its size at home that the smallest singular value of a configuration needs to have to be used: as far as
possible along the motion first, since that tells moves apart best."""


def settle_printed(chain: ClosedChain, forgiven: float | Precision) -> ClosedChain:
    """Close the loops at home, as exactly as the digits of the file allow.

    Parameters
    ----------
    chain
        Chain whose home is a guess.
    forgiven
        Largest gap and singular value that digits may have made, in robot sizes and radians; or the precision of the
        file, of which they are found.

    Returns
    -------
    ClosedChain
        The same chain where its numbers are exact; else one whose joints and loops were moved by what the digits had
        left open, with notes that tell it. Home closes every loop.

    Raises
    ------
    MechanismError
        As `settle_home`, where digits do not explain that the loops stay open.
    """

    def settle(part: ClosedChain) -> ClosedChain:
        size, own = _measured(part, forgiven)
        return _settle_part(part, own, size)

    return settle_parts(chain, settle, _measured(chain, forgiven)[0])


def _measured(chain: ClosedChain, forgiven: float | Precision) -> tuple[float, float]:
    """Size of a chain [m], and what digits may have left open, in this size and radians."""
    # Axes that meet in a point but for digits have no size between them: these are no length of the robot.
    places = places_of(chain)

    def explained(size: float) -> float:
        return _explained(forgiven, size, places) if isinstance(forgiven, Precision) else forgiven

    size = length_scale(chain.mechanism, chain.platform, digits=explained(chain.length_scale))
    return size, explained(size)


def _settle_part(chain: ClosedChain, forgiven: float, size: float) -> ClosedChain:
    """Settle loops that share joints with no others: neither digits nor size of one leg are those of another."""
    places = places_of(chain)
    if not (forgiven > 0 and chain.loops):
        return settle_alone(chain)
    printed = chain if size == chain.length_scale else of_size(chain, size)
    try:
        moved = _absorbed(printed, near_home(printed, forgiven, searching=False), places, forgiven)
    except _Undecided as undecided:
        return _as_it_stands(chain, undecided)
    if moved is not None:
        return moved
    try:
        settled = settle_alone(chain, max(HOME_IN_FILE, forgiven))
    except MechanismError:
        near = near_home(printed, forgiven, searching=True)
        try:
            moved = None if near is None else _absorbed(printed, near, places, forgiven)
        except _Undecided as undecided:
            return _as_it_stands(chain, undecided)
        if moved is None:
            raise
        return moved
    try:
        moved = _absorbed(printed, settled.q_home, places, forgiven)
    except _Undecided as undecided:
        return _with_note(settled, undecided)
    return settled if moved is None else moved


def _explained(precision: Precision, size: float, places: Sequence[Place]) -> float:
    """Gap that the digits of a file explain, in robot sizes and radians."""
    half_unit = max(precision.angle, precision.length / size)
    return min(_COARSEST, _MARGIN * half_unit * np.sqrt(6 * max(1, len(places))))


class _Undecided(Exception):
    """By the digits of the file there are more freedoms than by its numbers, and no mechanism near that has them."""


def _as_it_stands(chain: ClosedChain, undecided: _Undecided) -> ClosedChain:
    """Take the numbers as they are, where the loops close with them, and say so."""
    try:
        settled = settle_alone(chain)
    except MechanismError:
        source = chain.mechanism.source
        raise MechanismError(f"{undecided}; print more digits", path=source, culprit="loops") from None
    return _with_note(settled, undecided)


def _with_note(chain: ClosedChain, undecided: _Undecided) -> ClosedChain:
    note = Note(_name_loops(chain), f"{undecided}; its numbers were taken as they stand", Outcome.KEPT)
    return replace(chain, mechanism=replace(chain.mechanism, notes=(*chain.mechanism.notes, note)))


def _absorbed(
    chain: ClosedChain, q: Configuration | None, places: Sequence[Place], forgiven: float
) -> ClosedChain | None:
    """Move joints and loops so that the rank at the file's precision is the exact one; None where it is already."""
    if q is None:
        return None
    home = close_at_precision(chain, q, forgiven)
    if home.state.largest_gap > forgiven:
        return None
    if home.rank == chain.nc:
        return None
    # Home may stand near a singularity, where more rows depend on each other than along the motion.
    for rank in range(home.rank, max(home.rank + 1, min(chain.nc, chain.nv))):
        motion = _Motion(chain, home.state, rank, places, forgiven)
        beyond = motion.walk(_REGULAR[0], np.random.default_rng(0)).on(chain, _PROBES)
        if beyond is not None:
            return None if motion.exact(beyond) else motion.absorbed()
    return None


class _Motion:
    """What a chain would do if only `rank` of its rows were independent, all along its motion from home."""

    def __init__(
        self, chain: ClosedChain, home: State, rank: int, places: Sequence[Place], forgiven: float
    ) -> None:
        self.chain, self.home, self.rank = chain, home, rank
        self.places, self.forgiven = places, forgiven
        _, values, vt = home.row_factors
        self.spurious = values[rank:]
        # The spin of a rod between two balls is one of its own whatever the digits, and tells nothing of them.
        self.samples = _SAMPLES * (1 + _not_idle(home, vt[rank:].T, forgiven))

    def walk(self, regular: float, rng: np.random.Generator) -> _Walk:
        return _Walk(self.home, self.rank, self.forgiven, regular, self.samples, rng)

    def exact(self, beyond: Sequence[State]) -> bool:
        """Whether rows that should repeat do so to round-off: home may be exact by symmetry, and the motion not."""
        open_by = max(self.home.largest_gap, self.spurious.max(initial=0.0))
        return open_by <= max(_EXACT, self.home.round_off) and all_closed(beyond)

    def absorbed(self) -> ClosedChain:
        """Move joints and loops so that they do so exactly."""
        chain, rank, places, forgiven = self.chain, self.rank, self.places, self.forgiven
        if len(places) * self.samples > _LARGEST:
            raise self.undecided("the mechanism is too large to look for one that keeps them")
        ease, rng, doubts = np.ones(6 * len(places)), np.random.default_rng(0), 0
        for regular in _REGULAR:
            walk = self.walk(regular, rng)
            moved, states = chain, [self.home]
            for number in range(_ROUNDS):
                fresh = walk.on(moved)
                if fresh is None:
                    break
                if moved is not chain and all_closed(fresh):
                    # Home has followed; Newton's method without the rank would drift where it is all but closed.
                    return keep_home(self.told(moved), states[0].q)
                # From the start again: moves that closed a part of the motion lie in a narrow valley of those for the
                # rest.
                again = [
                    close_at_precision(chain, state.q, forgiven, rank=rank).state for state in states + fresh
                ]
                if not number and none_near(again, rank, places, forgiven):
                    doubts += 1
                    break
                moved, states = closed_everywhere(chain, again, rank, places, forgiven, ease)
                walk.at = states[-1]
                if not all_closed(states) and number:
                    break
            if doubts == _DOUBTS:
                break
            # Between two families of mechanisms no small move leads to either; unequal ones leave the middle.
            ease = 10.0 ** rng.uniform(-1.0, 0.0, ease.size)
        raise self.undecided("no mechanism that keeps this freedom was found as near as the digits explain")

    @property
    def freedoms(self) -> int:
        return self.chain.nv - self.rank

    def undecided(self, why: str) -> _Undecided:
        return _Undecided(
            f"the loops close to {self.home.largest_gap:.2g} robot sizes or radians, and their rows have the singular "
            f"value {self.spurious.max(initial=0.0):.2g}: by the digits of the file there are {self.freedoms} "
            f"freedoms, by its numbers fewer, and {why}"
        )

    def told(self, moved: ClosedChain) -> ClosedChain:
        """Add notes of what was moved."""
        notes: list[Note] = []
        for place in self.places:
            before, after = (placement_of(one.mechanism, place) for one in (self.chain, moved))
            move = before.inverse() * after
            # The logarithm of a rotation is lost in round-off where the angle is below 1e-8.
            turn = float(np.linalg.norm(pin.unSkew((move.rotation - move.rotation.T) / 2)))
            shift = float(np.linalg.norm(move.translation))
            text = f"moved by {shift:.2g} m and turned by {turn:.2g} rad, as the loops need to keep their freedom"
            notes.append(Note(str(place), text, Outcome.CHANGED))
        shown = ", ".join(f"{value:.2g}" for value in self.spurious[:6]) + ", ..." * (self.spurious.size > 6)
        summary = Note(
            _name_loops(self.chain),
            f"close only to the digits of the file: the gap was {self.home.largest_gap:.2g} robot sizes or radians at "
            f"home, and the singular values {shown} were taken for digits; the mechanism has {self.freedoms} freedoms",
            Outcome.CHANGED,
        )
        mechanism = moved.mechanism
        return replace(moved, mechanism=replace(mechanism, notes=(*mechanism.notes, summary, *notes)))


def _name_loops(chain: ClosedChain) -> str:
    names = [f"'{loop.name}'" for loop in chain.loops]
    return f"loop{'s' * (len(names) > 1)} {', '.join(names[:3])}{' and more' * (len(names) > 3)}"


class _Walk:
    """Configurations along the motion, each near the one before, far from its singularities; seeded."""

    def __init__(
        self,
        home: State,
        rank: int,
        forgiven: float,
        regular: float,
        samples: int,
        rng: np.random.Generator,
    ) -> None:
        self.at, self.rank, self.forgiven, self.samples = home, rank, forgiven, samples
        self.least = regular * _smallest(home, rank)
        self.rng = rng
        self.along = np.zeros(home.chain.nv)

    def on(self, chain: ClosedChain, wanted: int = 0) -> list[State] | None:
        """Take the next configurations, or say that the motion is none: rows that should repeat do not."""
        freedoms = chain.nv - self.rank
        wanted = wanted or self.samples
        found, stride = [], _STRIDE
        state, along = chain.at(self.at.q), self.along
        for _ in range(4 * wanted):
            if len(found) == wanted or not freedoms:
                break
            basis = state.row_factors[2][self.rank :].T
            ahead = basis.T @ along
            way = ahead / max(float(np.linalg.norm(ahead)), 1e-3) + _WANDERING * self.rng.normal(
                size=freedoms
            )
            step = basis @ way
            step *= stride / np.abs(step).max()
            closed = close_at_precision(chain, displaced(state, step).q, self.forgiven, rank=self.rank)
            values = closed.state.row_factors[1]
            open_by = max(closed.state.largest_gap, values[self.rank :].max(initial=0.0))
            if open_by > self.forgiven or values[: self.rank].min(initial=1.0) < self.least:
                stride *= 0.6
                if stride < _STRIDE / 6:  # a singularity stands in the way
                    along, stride = -along, _STRIDE
                continue
            found.append(closed.state)
            state, along, stride = closed.state, step / stride, _STRIDE
        self.at, self.along = state, along
        return found or (None if freedoms else [state])


def _not_idle(state: State, motions: FloatArray, forgiven: float) -> int:
    """Count the motions that move motors or platform; all, where there are none of these to move."""
    chain = state.chain
    shares = [motions[chain.motor_index]]
    if chain.platform is not None:
        shares.append((state.P / chain.twist_sizes[:, None]) @ (chain.tangent_scale[:, None] * motions))
    values = np.linalg.svd(np.vstack(shares), compute_uv=False)
    return int(np.count_nonzero(values > forgiven)) or motions.shape[1]


def _smallest(state: State, rank: int) -> float:
    return float(state.row_factors[1][rank - 1]) if rank else 0.0
