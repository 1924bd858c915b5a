"""Dry friction in a simulation: what slips, and which way, and what is stuck, until something changes that.

Between two changes every equation is smooth: friction of what slips is constant, and what is stuck is a row more that
the motion keeps, like a loop, with friction as its reaction. A coordinate that slips may stick when its rate passes
zero; stuck ones begin to slip when no friction within their limits holds them any more.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np
from scipy.linalg import null_space, qr
from scipy.optimize import brentq, linprog

from stewart_pin.errors import ConvergenceError, UnsupportedError
from stewart_pin.mechanics.forward_dynamics import friction_at_rest
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.joint_effects import Effects, moving
from stewart_pin.state.state import State
from stewart_pin.tolerances import EPS
from stewart_pin.typing import BoolArray, Configuration, FloatArray, Tangent

_INDEPENDENT = 1e-8
"""Part of a row of natural size that must move along what the others leave, so that it holds something."""
_OVER = 1e-9
"""Friction beyond its limit, as a share, at which what is stuck begins to slip: round-off of what is solved for it."""
_JUMP = 1e-6
"""The same at the start of a step, where an effort may have jumped; and what the limit is lessened by to see which way
it goes, where friction stands at its limit."""
_HALVINGS = 60
_BESIDE = np.array([1e-15, 1e-14, 1e-13, 1e-12, 1e-11, 1e-10, 1e-9])
"""Parts of a stretch by which one looks beside a root for the other side of it."""


class FrictionMemory(NamedTuple):
    """What a run that goes on has to know.

    Attributes
    ----------
    modes
        (k,) 1 or -1 where a coordinate slips, 0 where it is stuck, dimensionless.
    places
        (k,) positions at which those of loops are stuck [m or rad].
    firm
        (k,) mask of those that friction holds.
    chosen
        (n,) stuck ones that imply the others [index].
    still
        Whether they leave no motion.
    settled
        Whether the modes have been found.
    """

    modes: FloatArray
    places: FloatArray
    firm: BoolArray
    chosen: np.ndarray
    still: bool
    settled: bool


class Friction:
    """Coordinates of a chain with dry friction.

    Parameters
    ----------
    chain
        Closed chain, friction of the motors in its model.

    Attributes
    ----------
    modes
        (k,) 1 or -1 where a coordinate slips, 0 where it is stuck, dimensionless.
    firm
        (k,) mask of those of the latter that friction holds, rather than loops that leave them no rate here.
    chosen
        (n,) ones of these that imply the others [index].
    still
        Whether they leave no motion.
    settled
        Whether the modes have been found.
    names
        Of the coordinates.
    """

    def __init__(self, chain: ClosedChain) -> None:
        self._chain, table = chain, chain.joint_effects
        self.entries = np.flatnonzero(chain.model.upperDryFrictionLimit)
        self._own = np.flatnonzero(table.own_friction)
        self.count = len(self.entries) + len(self._own)
        names = [str(chain.tangent_names[k]) for k in self.entries]
        self.names = names + [f"loop coordinate '{table.coordinates[k].coordinate}'" for k in self._own]
        # Of what turns about several axes a position along one is none, once it turns about the others.
        joints = {joint.idx_v + k: joint for joint in chain.model.joints[1:] for k in range(joint.nv)}
        self._groups = [(joints[k].id, joints[k].nv) for k in self.entries]
        self._in_q = np.array([joints[k].idx_q if joints[k].nv == 1 else -1 for k in self.entries], dtype=int)
        self.modes = np.ones(self.count)  # nothing is held before it is known to be at rest
        self._places = np.zeros(self.count)
        self.settled = False
        self.firm = np.zeros(self.count, dtype=bool)
        self.chosen = np.zeros(0, dtype=int)
        self.still = False

    @property
    def memory(self) -> FrictionMemory:
        """What a run that goes on has to know."""
        return FrictionMemory(self.modes, self._places, self.firm, self.chosen, self.still, self.settled)

    def recall(self, memory: FrictionMemory) -> None:
        """Go on from an earlier run, if it knew the same coordinates.

        Parameters
        ----------
        memory
            What it knew.
        """
        if len(memory.modes) == self.count:
            self.modes, self._places, self.firm, self.chosen, self.still, self.settled = memory

    @property
    def stuck(self) -> BoolArray:
        """(k,) mask of the coordinates that are stuck."""
        return self.modes == 0

    @property
    def stuck_entries(self) -> np.ndarray:
        """Tangent entries that friction holds, rather than loops that leave them no rate here [index]."""
        return self.entries[self.firm[: len(self.entries)]]

    def shares(self, entries: np.ndarray, friction: FloatArray) -> FloatArray:
        """Tell which share of each friction is a part that was added to entries of the tangent.

        Parameters
        ----------
        entries
            (n,) entries [index].
        friction
            (n,) what was added [N or N m].

        Returns
        -------
        numpy.ndarray
            (k,) dimensionless.
        """
        added = np.zeros(self._chain.nv)
        added[entries] = friction
        return np.concatenate([added[self.entries], np.zeros(len(self._own))]) / self._limits

    # -- equations of a smooth stretch -----------------------------------------------------------------------------

    def rows(self, state: State) -> FloatArray:
        """Differentiate the coordinates.

        Parameters
        ----------
        state
            The state.

        Returns
        -------
        numpy.ndarray
            (k, nv) rates per tangent velocity [m and rad per m or rad].
        """
        rows = np.eye(self._chain.nv)[self.entries]
        return np.vstack([rows, _effects(state).rows[self._own]]) if self._own.size else rows

    def slipping(self, state: State) -> tuple[Tangent, FloatArray]:
        """Compute what friction of the coordinates that slip does, and what it turns into heat.

        Parameters
        ----------
        state
            The state.

        Returns
        -------
        efforts : numpy.ndarray
            (nv,) joint efforts [N, N m].
        heat : numpy.ndarray
            (k,) power lost in each coordinate [W].
        """
        rows, limits = self.rows(state), self._limits
        push = -(limits * self.modes)
        return push @ rows, -push * (rows @ state.v)

    def held(self, state: State) -> tuple[FloatArray, FloatArray]:
        """Give independent rows that keep what is stuck.

        Parameters
        ----------
        state
            The state.

        Returns
        -------
        rows : numpy.ndarray
            (n, nv) rows R with R v = 0 [m and rad per m or rad].
        bias : numpy.ndarray
            (n,) b with R a + b = 0 [m/s² or rad/s²].
        """
        if (self.chosen < len(self.entries)).all():
            return np.eye(self._chain.nv)[self.entries[self.chosen]], np.zeros(len(self.chosen))
        rub = _effects(state).rubbing
        return rub.rows[self.chosen], rub.bias[self.chosen]

    def held_rows(self, state: State, which: np.ndarray | None = None) -> FloatArray:
        """Give such rows in natural units.

        Parameters
        ----------
        state
            The state.
        which
            Of which coordinates; default: those of `held` [index].

        Returns
        -------
        numpy.ndarray
            (n, nv) dimensionless.
        """
        which = self.chosen if which is None else which
        return self.rows(state)[which] * (self._chain.tangent_scale / self._sizes[which][:, None])

    def astray(self, state: State) -> FloatArray:
        """Measure how far what is stuck and chosen has moved.

        Parameters
        ----------
        state
            The state.

        Returns
        -------
        numpy.ndarray
            (n,) displacements from where it stuck, in natural units; zero for entries of the tree, whose columns do
            not move, dimensionless.
        """
        away = np.zeros(len(self.chosen))
        loops = self.chosen >= len(self.entries)
        if loops.any():
            away[loops] = (self._positions(state) - self._places)[self.chosen[loops]]
            own = self._own[self.chosen[loops] - len(self.entries)]
            angles = self._chain.joint_effects.own_angles[own]
            turned = (away[loops] + np.pi) % (2 * np.pi) - np.pi
            away[loops] = np.where(angles, turned, away[loops])
        return away / self._sizes[self.chosen]

    def keep(self, q_from: Configuration, q: Configuration, v: Tangent) -> tuple[Configuration, Tangent]:
        """Put what is stuck exactly where it was.

        Parameters
        ----------
        q_from
            (nq,) configuration from which the motion started [m, rad, unit quaternions].
        q
            (nq,) configuration that it reached [m, rad, unit quaternions].
        v
            (nv,) velocity there [m/s, rad/s].

        Returns
        -------
        q, v : numpy.ndarray
            The same with stuck joints of the tree to the bit where they were, and at rest [m, rad, m/s, rad/s].
        """
        q, v = q.copy(), v.copy()
        v[self.stuck_entries] = 0.0
        own = self._in_q[self.firm[: len(self.entries)]]
        own = own[own >= 0]
        q[own] = q_from[own]
        return q, v

    @property
    def _limits(self) -> FloatArray:
        chain = self._chain
        friction = np.array(chain.model.upperDryFrictionLimit)[self.entries]
        return np.concatenate([friction, chain.joint_effects.own_friction[self._own]])

    @property
    def _sizes(self) -> FloatArray:
        chain, coordinates = self._chain, self._chain.joint_effects.coordinates
        lengths = [1.0 if coordinates[k].is_angle else chain.length_scale for k in self._own]
        return np.concatenate([chain.tangent_scale[self.entries], lengths])

    def _positions(self, state: State) -> FloatArray:
        """(k,) positions of those of loops; zero for entries of the tree."""
        found = np.zeros(self.count)
        if self._own.size:
            found[len(self.entries) :] = self._chain.joint_effects.positions(state)[self._own]
        return found

    # -- what ends it ------------------------------------------------------------------------------------------------

    def margin(self, state: State, a: Tangent, given: Tangent) -> float:
        """Tell how far a state is from the end of its smooth stretch.

        Parameters
        ----------
        state
            The state.
        a
            (nv,) its acceleration [m/s², rad/s²].
        given
            (nv,) joint efforts of all but loops and what is stuck [N, N m].

        Returns
        -------
        float
            Least rate in its direction of what slips [1/s], or what is left of the friction of what is stuck, as a
            share; below zero where the stretch has ended.
        """
        rates = self.modes * (self.rows(state) @ state.v) / self._sizes
        least = float(rates[~self.stuck].min(initial=np.inf))
        return min(least, 1.0 + _OVER - self.needed(state, a, given))

    def needed(self, state: State, a: Tangent, given: Tangent) -> float:
        """Tell which share of their friction holds what is stuck, at least.

        Parameters
        ----------
        state
            The state.
        a
            (nv,) its acceleration [m/s², rad/s²].
        given
            (nv,) joint efforts of all but loops and what is stuck [N, N m].

        Returns
        -------
        float
            The largest share of a limit, as small as friction can be shared out, dimensionless.
        """
        stuck = self.firm
        if not stuck.any():
            return 0.0
        motions = self._chain.tangent_scale[:, None] * state.motions.basis
        asked = motions.T @ (state.M @ a + state.nle - given)
        unit = motions.T @ (self.rows(state)[stuck].T * self._limits[stuck])
        share = np.linalg.lstsq(unit, asked, rcond=_INDEPENDENT)[0]
        most = float(np.abs(share).max())
        if most <= 1.0 or len(self.chosen) == np.count_nonzero(stuck):
            return most
        # Several frictions hold one motion: least of all is the largest share where they help each other.
        spare = null_space(unit, rcond=_INDEPENDENT)
        if not spare.shape[1]:
            return most
        ones = np.ones((len(share), 1))
        bounds = np.vstack([np.hstack([spare, -ones]), np.hstack([-spare, -ones])])
        cost = np.append(np.zeros(spare.shape[1]), 1.0)
        found = linprog(cost, A_ub=bounds, b_ub=np.concatenate([-share, share]), bounds=(None, None))
        return float(found.x[-1]) if found.success else most

    def unsettled(self, state: State, a: Tangent, given: Tangent) -> bool:
        """Tell whether something has jumped, so that modes have to be found anew.

        Parameters
        ----------
        state
            State at the start of a step.
        a
            (nv,) its acceleration [m/s², rad/s²].
        given
            (nv,) joint efforts of all but loops and what is stuck [N, N m].

        Returns
        -------
        bool
            Whether to call `settle`.
        """
        stuck = self.stuck
        if not stuck.any():
            return False
        strays = not self._at_rest(state)[stuck].all()
        return strays or self.needed(state, a, given) > 1.0 + _JUMP

    # -- changes -------------------------------------------------------------------------------------------------------

    def settle(
        self,
        state: State,
        free: Callable[[State], Tangent],
        project: Callable[[Configuration, Tangent], tuple[Configuration, Tangent, float]],
        *,
        within: bool,
    ) -> State:
        """Find anew what slips and what is stuck.

        Parameters
        ----------
        state
            State with closed loops.
        free
            Tells the acceleration of a state with what slips, nothing stuck being held [m/s², rad/s²].
        project
            Brings a state onto loops and what is stuck.
        within
            Whether a stretch has ended here, rather than an effort jumped.

        Returns
        -------
        State
            The same, what is stuck exactly at rest.
        """
        rates = self.rows(state) @ state.v
        ended = ~self.stuck & (self.modes * rates <= 0.0) & within
        share = 1.0
        if within and self._at_rest(state)[~self.stuck].sum() + ended.sum() == 0:
            # Friction stands at its limit: a little less of it tells which way the motion goes.
            share = 1.0 - _JUMP
        for _ in range(self.count + 1):
            resting = self._at_rest(state) | ended
            self.modes = np.where(resting, 0.0, np.sign(self.rows(state) @ state.v))
            if resting.any():
                a = free(state)
                efforts, left = friction_at_rest(state, a, resting, share)
                self.modes[resting] = np.where(left != 0.0, -np.sign(efforts), 0.0)
                self._let_go(state, a, resting)
            self._places = np.where(self.stuck, self._positions(state), 0.0)
            self.choose(state)
            if not self.stuck.any():
                break
            state = State(self._chain, *project(state.q, state.v)[:2])
            # What has come to rest with the others is looked at again.
            if not (self._at_rest(state) & ~resting).any():
                break
            ended = np.zeros(self.count, dtype=bool)
        self.settled = True
        return state

    def _let_go(self, state: State, a: Tangent, resting: BoolArray) -> None:
        """Let what loops alone turn back, as at a dead centre, go on: friction has no hold on it there."""
        rub = _effects(state).rubbing
        pull = rub.rows @ a + rub.bias
        along = np.linalg.norm(self.held_rows(state, resting) @ state.motions.basis, axis=1)
        turns = moving(pull, a, self._sizes, self._chain)[resting] & (along <= _INDEPENDENT)
        self.modes[np.flatnonzero(resting)[turns]] = np.sign(pull[resting][turns])

    def _at_rest(self, state: State) -> BoolArray:
        """(k,) mask of the coordinates that do not move."""
        return ~moving(self.rows(state) @ state.v, state.v, self._sizes, self._chain)

    def choose(self, state: State) -> None:
        """Choose, of what is stuck, rows that imply the others.

        Parameters
        ----------
        state
            State with closed loops.
        """
        stuck = np.flatnonzero(self.stuck)
        motions = state.motions.basis
        self.chosen, self.still = stuck[:0], not motions.shape[1]
        self.firm = np.zeros(self.count, dtype=bool)
        if not stuck.size:
            return
        scale = self._chain.tangent_scale / self._sizes[stuck][:, None]
        along = (self.rows(state)[stuck] * scale) @ motions
        self.firm[stuck] = np.linalg.norm(along, axis=1) > _INDEPENDENT
        decomposition: Any = qr(along.T, mode="economic", pivoting=True)
        _, triangle, order = decomposition
        rank = int(np.count_nonzero(np.abs(np.diag(triangle)) > _INDEPENDENT))
        self.chosen, self.still = np.sort(stuck[order[:rank]]), rank == motions.shape[1]

    def require_charted(self) -> None:
        """Refuse what no chart can hold: rotations that are stuck about some axes of several.

        Raises
        ------
        UnsupportedError
            Naming one.
        """
        own = np.flatnonzero(self.firm[: len(self.entries)])
        joints = [self._groups[k][0] for k in own]
        for k, joint in zip(own, joints, strict=True):
            if joints.count(joint) < self._groups[k][1] and not self.still:
                raise UnsupportedError(
                    f"{self.names[k]} is stuck about some axes alone, which methods of SciPy's cannot keep; "
                    "use method='fixed'"
                )


def _effects(state: State) -> Effects:
    effects = state.effects
    assert effects is not None
    return effects


Reached = TypeVar("Reached")


def first_change(
    reach: Callable[[float], Reached], margin: Callable[[float, Reached], float], h: float
) -> tuple[float, Reached]:
    """Find where the margin of a stretch runs out that is above zero within it and below zero at its end.

    Parameters
    ----------
    reach
        What is reached after a time [s].
    margin
        The margin there.
    h
        End of the stretch [s].

    Returns
    -------
    s : float
        Time from its start, just after the change [s]; zero where the margin has run out from the start.
    reached
        What is reached just before it.
    """
    upper, lower = h, 0.0
    for _ in range(_HALVINGS):
        half = upper / 2
        if margin(half, reach(half)) > 0.0:
            lower = half
            break
        upper = half
    if not lower:
        return 0.0, reach(0.0)
    found: Any = brentq(lambda s: margin(s, reach(s)), lower, upper, xtol=4 * EPS * h)
    root, beyond = float(found), float(found)
    reached = reach(root)
    # What is reached just before, and the time just after: where an effort jumps, as that of a controller that reckons
    # with friction, the stretch before sees none of what is beyond, nor the next one of what was before.
    inside = margin(root, reached) > 0.0
    for step in _BESIDE * h:
        if inside:
            beyond = min(root + step, upper)
            if margin(beyond, reach(beyond)) <= 0.0:
                return beyond, reached
        else:
            before = max(root - step, lower)
            reached = reach(before)
            if margin(before, reached) > 0.0:
                return root, reached
    return root, reach(root)


def too_many(names: list[str], t: float, h: float, count: int) -> ConvergenceError:
    """Say that friction changes without end.

    Parameters
    ----------
    names
        Of the coordinates that change.
    t
        When [s].
    h
        Step [s].
    count
        How often it did.

    Returns
    -------
    ConvergenceError
        To raise.
    """
    return ConvergenceError(
        f"dry friction of {', '.join(names)} sticks and slips {count} times within {h:g} s at {t:.9g} s",
        residual=float(count),
    )
