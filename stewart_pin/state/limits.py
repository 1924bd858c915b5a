"""The one judge of limits: what a state, or a row of states, asks of each joint, and by how much that is too much."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from stewart_pin.brief import Brief
from stewart_pin.model.tree import LimitKind, Limits
from stewart_pin.state.joint_coordinates import JointCoordinates
from stewart_pin.state.scratch import PlacedJoints
from stewart_pin.tolerances import AT_LIMIT, HOME_IN_FILE
from stewart_pin.typing import BoolArray, Configuration, FloatArray, Tangent

if TYPE_CHECKING:
    from stewart_pin.state.chain import ClosedChain

_BY_DIFFERENCES = 1e-6
"""The same for accelerations of coordinates of balls and loops, which are differences of velocities."""
_STEP = 1e-5
"""Displacement, in radians and robot sizes, by which rates of these are differentiated: with rounding 1e-16 and
curvature one, accelerations are right to 1e-10."""
_DERIVED: tuple[LimitKind, ...] = ("velocity", "acceleration")


@dataclass(frozen=True, repr=False)
class Excess(Brief):
    """A limit that does not hold.

    Attributes
    ----------
    joint
        Joint, with the coordinate where it has several: one of ``chain.limits.names``.
    kind
        ``"position"``, ``"velocity"``, ``"acceleration"``, ``"effort"`` or ``"jerk"``.
    value
        What is asked for; of a motion, at its worst [any unit].
    limit
        The end that is passed [any unit].
    by
        How far it is passed, above zero [any unit].
    unit
        Unit of the three numbers.
    least, most
        Both ends, nan where one is not stated [any unit].
    time
        When, of a motion [s]; None: of one state.
    """

    joint: str
    kind: LimitKind
    value: float
    limit: float
    by: float
    unit: str
    least: float
    most: float
    time: float | None = None

    @property
    def allowed(self) -> tuple[float, float]:
        """Both ends to reckon with: infinite where one is not stated [any unit]."""
        return (-np.inf if np.isnan(self.least) else self.least, np.inf if np.isnan(self.most) else self.most)

    def __str__(self) -> str:
        """Tell joint, value and what is allowed."""
        what = "" if self.kind == "position" else f"{self.kind} of "
        allowed = " ".join(
            f"{word} {end:.6g}" for word, end in (("from", self.least), ("to", self.most)) if end == end
        ).removeprefix("from ")
        when = "" if self.time is None else f" at {self.time:.6g} s"
        return f"{what}'{self.joint}' at {self.value:.6g}, allowed {allowed}{when}"


@dataclass(frozen=True, eq=False)
class Asked:
    """What states ask of some coordinates.

    Attributes
    ----------
    kind
        Positions, velocities, accelerations, efforts or jerks.
    rows
        (k,) rows of the limits [index].
    values
        (N, k) what is asked for, one row per state [any unit].
    """

    kind: LimitKind
    rows: np.ndarray
    values: FloatArray


class Judge:
    """Judge of the limits of one chain; none that is not stated costs anything.

    Parameters
    ----------
    chain
        Closed chain.
    """

    def __init__(self, chain: ClosedChain) -> None:
        limits = chain.limits
        self._chain = chain
        self._q = np.full(chain.nv, -1)
        for joint in chain.model.joints[1:]:
            if joint.nv == 1:
                self._q[joint.idx_v] = joint.idx_q
        stated = limits.stated("position")
        self._tree, self._extra = stated[stated < chain.nv], stated[stated >= chain.nv]
        self._at = self._q[self._tree]
        slack = AT_LIMIT * self.sizes(self._tree)
        lower, upper = limits.bounds("position", self._tree).T
        self._least, self._most = lower - slack, upper + slack

    @cached_property
    def coordinates(self) -> JointCoordinates:
        """Coordinates of balls, and of joints that close loops."""
        return JointCoordinates(self._chain)

    def positions(
        self, q: Configuration, *, slack: float = AT_LIMIT, entries: np.ndarray | None = None
    ) -> tuple[Excess, ...]:
        """List the joints that are beyond their ranges at one configuration.

        Parameters
        ----------
        q
            (nq,) configuration [m, rad, unit quaternions].
        slack
            Excess that is let pass, in robot sizes or radians [dimensionless].
        entries
            Tangent entries to look at, which leaves out what closes loops and the cones of balls; default: all
            [index].

        Returns
        -------
        tuple of Excess
            In the order of the limits.
        """
        value = q[self._at]
        inside = np.count_nonzero((value >= self._least) & (value <= self._most)) == value.size
        if inside and slack >= AT_LIMIT and (entries is not None or not self._extra.size):
            return ()
        if entries is not None:
            rows = self._tree[np.isin(self._tree, entries)]
            asked = [Asked("position", rows, q[self._q[rows]][None])]
        else:
            asked = self.asked(q[None])
        return self.excesses(asked, slack=slack)

    def asked(
        self,
        q: FloatArray,
        v: FloatArray | None = None,
        a: FloatArray | None = None,
        *,
        leave: np.ndarray | None = None,
    ) -> list[Asked]:
        """Tell what states ask of the coordinates that have limits.

        Parameters
        ----------
        q
            (N, nq) configurations [m, rad, unit quaternions].
        v
            (N, nv) tangent velocities, or None: they are not looked at [m/s, rad/s].
        a
            (N, nv) tangent accelerations, likewise [m/s², rad/s²].
        leave
            Tangent entries to leave out; default: none [index].

        Returns
        -------
        list of Asked
            Positions, then velocities and accelerations where limits of them are stated.
        """
        limits, nv = self._chain.limits, self._chain.nv
        found: list[Asked] = []
        given: tuple[tuple[LimitKind, FloatArray | None], ...] = (
            ("position", q),
            ("velocity", v),
            ("acceleration", a),
        )
        for kind, motion in given:
            rows = limits.stated(kind)
            if leave is not None:
                rows = rows[~np.isin(rows, leave)]
            if motion is None or not rows.size:
                continue
            tree = rows[rows < nv]
            own = motion[:, self._q[tree]] if kind == "position" else motion[:, tree]
            extra = self._of_loops(kind, rows[rows >= nv], q, v, a)
            found.append(Asked(kind, rows, np.hstack([own, extra])))
        return found

    def rates(self, q: Configuration, motions: FloatArray, rows: np.ndarray) -> FloatArray:
        """Tell how fast coordinates change along motions.

        Parameters
        ----------
        q
            (nq,) configuration [m, rad, unit quaternions].
        motions
            (nv, k) tangent velocities, one in each column [m/s, rad/s].
        rows
            (r,) rows of the limits [index].

        Returns
        -------
        numpy.ndarray
            (r, k) rates [m/s or rad/s].
        """
        nv = self._chain.nv
        tree, extra = rows[rows < nv], rows[rows >= nv]
        if not extra.size:
            return motions[tree]
        return np.vstack([motions[tree], self._jacobian(q, extra) @ motions])

    def excesses(
        self, asked: Iterable[Asked], *, time: FloatArray | None = None, slack: float = AT_LIMIT
    ) -> tuple[Excess, ...]:
        """Compare what is asked for with the limits.

        Parameters
        ----------
        asked
            What states ask for.
        time
            (N,) when they do; default: one state [s].
        slack
            Excess that is let pass: of positions in robot sizes or radians, of the rest as a share of the limit
            [dimensionless].

        Returns
        -------
        tuple of Excess
            One per end that is passed, at the state where it is passed most.
        """
        found: list[Excess] = []
        limits = self._chain.limits
        for each in asked:
            if not each.values.size:
                continue
            free = self.slack(each, slack)
            for beyond, end in ((_below, 0), (_above, 1)):
                ends = limits.of(each.kind)[each.rows, end]
                over = beyond(each.values, ends)
                # nan, where nothing is stated, is above nothing; but what is no number keeps no limit, told once.
                told = ~np.isnan(ends) & (np.isnan(limits.of(each.kind)[each.rows, 1]) | (end == 1))
                over[np.isnan(each.values) & told] = np.inf
                worst = np.argmax(np.where(np.isnan(over), -np.inf, over), axis=0)
                most = over[worst, np.arange(each.rows.size)]
                for k in np.flatnonzero(most > free[:, end]):
                    row = int(each.rows[k])
                    least, greatest = map(float, limits.of(each.kind)[row])
                    found.append(
                        Excess(
                            joint=limits.names[row],
                            kind=each.kind,
                            value=float(each.values[worst[k], k]),
                            limit=float(ends[k]),
                            by=float(most[k]),
                            unit=limits.unit(each.kind, row),
                            least=least,
                            most=greatest,
                            time=None if time is None else float(time[worst[k]]),
                        )
                    )
        return tuple(found)

    def slack(self, asked: Asked, slack: float = AT_LIMIT) -> FloatArray:
        """Tell what excess is round-off.

        Parameters
        ----------
        asked
            Coordinates.
        slack
            Of positions in robot sizes or radians, of the rest as a share of the limit [dimensionless].

        Returns
        -------
        numpy.ndarray
            (k, 2) at either end [any unit].
        """
        if asked.kind == "position":
            return np.repeat(slack * self.sizes(asked.rows)[:, None], 2, axis=1)
        own = asked.rows >= self._chain.nv
        differences = own & (slack < _BY_DIFFERENCES) & (asked.kind == "acceleration")
        share = np.where(differences, _BY_DIFFERENCES, slack)
        return share[:, None] * np.abs(self._chain.limits.of(asked.kind)[asked.rows])

    def sizes(self, rows: np.ndarray) -> FloatArray:
        """Tell natural sizes of coordinates.

        Parameters
        ----------
        rows
            (k,) rows of the limits [index].

        Returns
        -------
        numpy.ndarray
            (k,) the size of the robot [m], or 1 [rad].
        """
        return np.where(self._chain.limits.is_length[rows], self._chain.length_scale, 1.0)

    def _of_loops(
        self,
        kind: LimitKind,
        rows: np.ndarray,
        q: FloatArray,
        v: FloatArray | None,
        a: FloatArray | None,
    ) -> FloatArray:
        """(N, k) coordinates that only limits know, or their derivatives along the motion."""
        chain = self._chain
        if not rows.size:
            return np.zeros((len(q), 0))
        if kind == "position":
            found = np.empty((len(q), rows.size))
            for n, at in enumerate(q):
                found[n] = self.coordinates.values(self._placed(at), at, rows)
            # Angles by the turn nearest to their range.
            turns = np.round((_middle(chain.limits, rows) - found) / (2 * np.pi))
            return found + 2 * np.pi * np.where(chain.limits.is_length[rows], 0.0, turns)
        assert v is not None
        found = np.zeros((len(q), rows.size))
        for n, at in enumerate(q):
            if kind == "velocity":
                found[n] = self._jacobian(at, rows) @ v[n]
            elif a is not None:
                found[n] = self._accelerations(at, v[n], a[n], rows)
        return found

    def _accelerations(self, q: Configuration, v: Tangent, a: Tangent, rows: np.ndarray) -> FloatArray:
        """(k,) rates of the velocities along q(t), by differences."""
        chain = self._chain
        rate, bend = (np.abs(along / chain.tangent_scale).max(initial=0.0) for along in (v, a))
        if rate == bend == 0.0:
            return np.zeros(rows.size)
        h = _STEP / max(rate, np.sqrt(bend * _STEP))
        before, after = (
            self._jacobian(pin.integrate(chain.model, q, t * v + t * t / 2 * a), rows) @ (v + t * a)
            for t in (-h, h)
        )
        return (after - before) / (2 * h)

    def _jacobian(self, q: Configuration, rows: np.ndarray) -> FloatArray:
        """(k, nv) derivatives of coordinates that only limits know."""
        return self.coordinates.jacobian(self._placed(q), q, rows)

    def _placed(self, q: Configuration) -> PlacedJoints:
        scratch = self._chain.scratches.take()
        placed = scratch.placed(q)
        self._chain.scratches.give(scratch)
        return placed


def _below(values: FloatArray, ends: FloatArray) -> FloatArray:
    return ends - values


def _above(values: FloatArray, ends: FloatArray) -> FloatArray:
    return values - ends


def _middle(limits: Limits, rows: np.ndarray) -> FloatArray:
    lower, upper = limits.position[rows].T
    return np.where(np.isnan(lower + upper), 0.0, (lower + upper) / 2)


# ----------------------------------------------------------------------------------------------------
# How far a configuration is beyond what it may be: of ranges, of cones, of a way from a guess
# ----------------------------------------------------------------------------------------------------


def cone_rows(chain: ClosedChain) -> np.ndarray:
    """Find the rows of the limits of what has no coordinate of its own: cones of balls, joints that close loops.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    numpy.ndarray
        (k,) of those that are stated [index].
    """
    stated = chain.limits.stated("position")
    return stated[stated >= chain.nv]


def beyond_cones(chain: ClosedChain, q: Configuration, inset: float = -HOME_IN_FILE) -> FloatArray:
    """Tell how far limits of balls and of joints that close loops are passed.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration [m, rad, unit quaternions].
    inset
        How far within them counts as passed, in robot sizes and radians.

    Returns
    -------
    numpy.ndarray
        (k,) excess of each, below zero at its lower end, in robot sizes and radians; 0 for what is within
        [dimensionless].
    """
    rows = cone_rows(chain)
    if not rows.size:
        return np.zeros(0)
    [asked] = chain.judge.asked(q[None], leave=np.arange(chain.nv))
    sizes = chain.judge.sizes(rows)
    values = asked.values[0] / sizes
    lower, upper = chain.limits.bounds("position", rows).T / sizes
    inset = np.minimum(inset, (upper - lower) / 4)
    return values - np.clip(values, lower + inset, upper - inset)


def in_configuration(chain: ClosedChain, entries: BoolArray) -> BoolArray:
    """Carry a mark per tangent entry over to the configuration.

    Parameters
    ----------
    chain
        Closed chain.
    entries
        (nv,) marks, the same for all entries of a joint.

    Returns
    -------
    numpy.ndarray
        (nq,) marks.
    """
    return np.concatenate([np.full(joint.nq, entries[joint.idx_v]) for joint in chain.model.joints[1:]])


def moved_beyond(chain: ClosedChain, guess: Configuration, q: Configuration, leeway: FloatArray) -> str:
    """Say which joint was moved most beyond its leeway.

    Parameters
    ----------
    chain
        Closed chain.
    guess, q
        (nq,) configurations before and after [m, rad, unit quaternions].
    leeway
        (nv,) how far each may move, in robot sizes and radians [dimensionless].

    Returns
    -------
    str
        In words; empty where none was.
    """
    moved = np.abs(pin.difference(chain.model, guess, q) / chain.tangent_scale)
    worst = int(np.argmax(np.where(moved > leeway, moved, 0.0)))
    if not moved[worst] > leeway[worst]:
        return ""
    return f"closing them moves joint '{chain.tangent_names[worst]}' by {moved[worst]:.3g} robot sizes or radians"


def outside(chain: ClosedChain, q: Configuration) -> tuple[Excess, ...]:
    """List joints of the tree beyond their ranges; a home with few digits may be so by what it lacks.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration [m, rad, unit quaternions].

    Returns
    -------
    tuple of Excess
        In the order of the limits.
    """
    return chain.judge.positions(q, slack=HOME_IN_FILE, entries=np.arange(chain.nv))
