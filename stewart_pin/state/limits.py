"""The one judge of limits: what a state, or a row of states, asks of each joint, and by how much that is too much.

A joint that closes a loop has no coordinate of its own; its position is read off the relative placement 1M2 of the loop
frames, with translation t and rotation R. With a the axis in both frames (a universal joint: a in frame 1, b in frame
2) and d perpendicular to a,

========= ==================================================================
angle     of R about a: from d to R d, seen along a
length    a · t
angle 1   of a universal joint: from b to R b about a, with R = exp(a α) exp(b β)
angle 2   from Rᵀ a to a about b
swing     of a ball: the angle between a and R a
angle     of a ball: that of its whole rotation
========= ==================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from stewart_pin.brief import Brief
from stewart_pin.model.description import BALL, JointKind, loop_coordinates
from stewart_pin.model.loop_rows import orthonormal_triad
from stewart_pin.model.tree import LimitKind, Limits
from stewart_pin.tolerances import AT_LIMIT
from stewart_pin.typing import Configuration, FloatArray

if TYPE_CHECKING:
    from stewart_pin.state.chain import ClosedChain

_Read = Callable[[Sequence[pin.SE3], Configuration], float]
_BY_DIFFERENCES = 1e-6
"""The same for rates of coordinates of loops, which are differences of positions."""
_STEP = 1e-4
"""Displacement, in radians and robot sizes, by which coordinates of loops are differentiated: with rounding 1e-16 and
curvature one, rates are right to 1e-9 and accelerations to 1e-7."""
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
    def readers(self) -> list[_Read]:
        """One function of placements and configuration per row beyond the tangent entries, in their order."""
        return _readers(self._chain)

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
            (r,) rows of the limits; those of loops are differentiated by differences [index].

        Returns
        -------
        numpy.ndarray
            (r, k) rates [m/s or rad/s].
        """
        nv = self._chain.nv
        tree, extra = rows[rows < nv], rows[rows >= nv]
        if not extra.size:
            return motions[tree]
        along = np.repeat(q[None], motions.shape[1], axis=0)
        return np.vstack([motions[tree], self._of_loops("velocity", extra, along, motions.T, None).T])

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
        differences = (asked.rows >= self._chain.nv) & (slack < _BY_DIFFERENCES)
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
        """(N, k) coordinates that only limits know, or their derivatives along the motion, by differences."""
        chain = self._chain
        if not rows.size:
            return np.zeros((len(q), 0))
        if kind == "position":
            return _coordinates(chain, rows, q)
        assert v is not None
        found = np.zeros((len(q), rows.size))
        for n in range(len(q)):
            rate = np.abs(v[n] / chain.tangent_scale).max(initial=0.0)
            bend = 0.0 if a is None else np.abs(a[n] / chain.tangent_scale).max(initial=0.0)
            h = _STEP / max(rate, np.sqrt(bend * _STEP), 1e-30)
            if rate == bend == 0.0:
                continue
            curve = 0.0 if a is None else a[n] * h / 2
            moved = [pin.integrate(chain.model, q[n], h * (sign * v[n] + curve)) for sign in (-1.0, 1.0)]
            before, here, after = _coordinates(chain, rows, np.array([moved[0], q[n], moved[1]]))
            forth, back = _nearest_turn(after - here, chain, rows), _nearest_turn(here - before, chain, rows)
            found[n] = (forth + back) / (2 * h) if kind == "velocity" else (forth - back) / h**2
        return found


def _below(values: FloatArray, ends: FloatArray) -> FloatArray:
    return ends - values


def _above(values: FloatArray, ends: FloatArray) -> FloatArray:
    return values - ends


def _nearest_turn(step: FloatArray, chain: ClosedChain, rows: np.ndarray) -> FloatArray:
    turns = 2 * np.pi * np.round(step / (2 * np.pi))
    return np.where(chain.limits.is_length[rows], step, step - turns)


def _coordinates(chain: ClosedChain, rows: np.ndarray, q: FloatArray) -> FloatArray:
    """(N, k) swings and angles of balls, and coordinates of loops, angles by the turn nearest to their range."""
    wanted = set(rows.tolist())
    readers = [reader for row, reader in enumerate(chain.judge.readers, start=chain.nv) if row in wanted]
    scratch = chain.scratches.take()
    try:
        found = np.empty((len(q), rows.size))
        for n, configuration in enumerate(q):
            scratch.place(configuration)
            found[n] = [reader(scratch.data.oMi, configuration) for reader in readers]
    finally:
        chain.scratches.give(scratch)
    middle = _middle(chain.limits, rows)
    turns = np.where(chain.limits.is_length[rows], 0.0, np.round((middle - found) / (2 * np.pi)))
    return found + 2 * np.pi * turns


def _middle(limits: Limits, rows: np.ndarray) -> FloatArray:
    lower, upper = limits.position[rows].T
    return np.where(np.isnan(lower + upper), 0.0, (lower + upper) / 2)


class _Reader:
    """Reads one coordinate off the relative rotation and translation of two frames."""

    def __init__(self, coordinate: str, kind: JointKind, axis: FloatArray, axis2: FloatArray) -> None:
        self.coordinate, self.kind, self.axis, self.axis2 = coordinate, kind, axis, axis2
        self.normal, self.x, self.y = orthonormal_triad(axis)

    def read(self, placement: pin.SE3) -> float:
        rotation, t, a, b = placement.rotation, placement.translation, self.axis, self.axis2
        match self.coordinate:
            case "length":
                return float(a @ t)
            case "x":
                return float(self.x @ t)
            case "y":
                return float(self.y @ t)
            case "swing":
                turned = rotation @ a
                return float(np.arctan2(np.linalg.norm(np.cross(a, turned)), a @ turned))
            case "angle 1":
                return _turn(a, b, rotation @ b)
            case "angle 2":
                return _turn(b, rotation.T @ a, a)
            case _ if self.kind is JointKind.SPHERICAL:
                return float(np.linalg.norm(pin.log3(rotation)))
            case _:
                return _turn(self.normal, self.x, rotation @ self.x)


def _turn(axis: FloatArray, before: FloatArray, after: FloatArray) -> float:
    """Angle about an axis from one direction to another, both seen along the axis."""
    across = axis @ np.cross(before, after)
    along = before @ after - (axis @ before) * (axis @ after)
    return float(np.arctan2(across, along))


def _readers(chain: ClosedChain) -> list[_Read]:
    """One function of placements and configuration per row beyond the tangent entries, in their order."""
    found: list[_Read] = []
    joints = {joint.name: joint for joint in chain.mechanism.joints}
    for number, (name, entry) in enumerate(zip(chain.model.names, chain.model.joints, strict=True)):
        joint = joints.get(name) if number else None
        if joint is not None and joint.kind is JointKind.SPHERICAL:
            for coordinate in BALL:
                reader = _Reader(coordinate, joint.kind, joint.axis, joint.axis)
                found.append(_of_ball(reader, entry.idx_q))
    table = chain.loop_table
    for k, loop in enumerate(chain.loops):
        one = pin.SE3(table.rotation1[k], table.translation1[k])
        two = pin.SE3(table.rotation2[k], table.translation2[k])
        for coordinate in loop_coordinates(loop.kind):
            reader = _Reader(coordinate, loop.kind, loop.axis, loop.axis2)
            found.append(_of_loop(reader, table.joint1[k], table.joint2[k], one, two))
    return found


def _of_ball(reader: _Reader, at: int) -> _Read:
    def read(_: object, q: Configuration) -> float:
        return reader.read(pin.SE3(pin.Quaternion(q[at : at + 4]).toRotationMatrix(), np.zeros(3)))

    return read


def _of_loop(reader: _Reader, joint1: int, joint2: int, one: pin.SE3, two: pin.SE3) -> _Read:
    def read(placed: Sequence[pin.SE3], _: Configuration) -> float:
        return reader.read((placed[joint1] * one).actInv(placed[joint2] * two))

    return read
