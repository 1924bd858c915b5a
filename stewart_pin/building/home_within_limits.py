"""Configurations with closed loops within the limits of joints, balls and loops, searched for by bounded least squares.

Each step of Gauss and Newton is bounded by the ranges of the joints; cones of balls and ranges of joints that close
loops, which are no bounds of a step, are equations where they are passed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.configurations import clipped, random_configuration, unwound
from stewart_pin.state.limits import beyond_cones, cone_rows, in_configuration, moved_beyond, outside
from stewart_pin.state.newton import displaced, polish
from stewart_pin.state.state import State
from stewart_pin.tolerances import NOTHING
from stewart_pin.typing import BoolArray, Configuration, FloatArray

_ATTEMPTS = 16
"""Random configurations to start from."""
_STEPS = 60
"""Bounded Gauss-Newton steps from one start."""
_SLOWLY, _PATIENCE = 0.99, 6
"""Share of the gap that a step leaves where it gets nowhere, and how many such steps in a row are the end: against
limits, each step may still shrink it a little."""
_LONGEST = 0.6
"""Longest step, in robot sizes or radians."""
_CHANGES = 50
"""Changes of the entries of a step that are held at their bounds; a step that would need more is good enough."""
_SHORTEST = 1e-4
"""Share of such a change that is not halved any more: round-off."""
_ENOUGH = 1e-9
"""Gap from which on Newton's method closes the rest without moving a joint noticeably."""
_INSET = 1e-5
"""How far from a limit the search stays, in robot sizes or radians: closing the rest moves joints by less."""
_NO_SLOPE = 1e-12
"""Slope of the least squares of a step, relative to what is left, that is round-off."""
_AT_END = 1e-4
"""Room, in robot sizes or radians, that is none."""
_PRESSED = 0.05
"""Share of the steepest descent of the gap that a joint at its limit has, if that stands in the way."""


@dataclass(frozen=True, eq=False)
class Stuck:
    """Where a search ended within the limits.

    Attributes
    ----------
    q
        (nq,) configuration of the least gap [m, rad, unit quaternions].
    gap
        Largest entry of the gap there [m or rad].
    held
        Tangent entries whose limits keep the loops from closing further.
    """

    q: Configuration
    gap: float
    held: tuple[str, ...] = ()


def search_within_limits(
    chain: ClosedChain, start: Configuration, leeway: FloatArray, precision: float = 0.0
) -> Configuration | Stuck:
    """Close the loops inside the limits, from near the start first; those of balls and of loops as far as they go.

    Parameters
    ----------
    chain
        Closed chain.
    start
        (nq,) configuration [m, rad, unit quaternions].
    leeway
        (nv,) how far each tangent entry may move from there; infinite where it is to be searched for, in robot sizes
        and radians [dimensionless].
    precision
        Gap that may be left, in robot sizes and radians; 0 closes to the last bit.

    Returns
    -------
    numpy.ndarray or Stuck
        (nq,) configuration [m, rad, unit quaternions], beyond limits of balls and of loops where none is within; or
        where the search ended.
    """
    found: Configuration | Stuck = Stuck(start, np.inf)
    for cones in (False, True):
        for guess in guesses(chain, start, leeway == np.inf):
            trial = bounded(chain, guess, leeway, precision=precision, cones=cones)
            if not isinstance(trial, Stuck):
                if cones or not beyond_cones(chain, trial).any():
                    return trial
                found = trial
                break
            if isinstance(found, Stuck) and trial.gap < found.gap:
                found = trial
        if isinstance(found, Stuck):
            break  # without these limits there is none either
    return found


def guesses(chain: ClosedChain, start: Configuration, free: BoolArray) -> Iterator[Configuration]:
    """Offer configurations to search from, seeded.

    Parameters
    ----------
    chain
        Closed chain.
    start
        (nq,) configuration [m, rad, unit quaternions].
    free
        (nv,) tangent entries that may be anywhere.

    Yields
    ------
    numpy.ndarray
        (nq,) the start; then, where anything is free, it in the middle of its ranges, and random ones
        [m, rad, unit quaternions].
    """
    yield start
    if not free.any():
        return
    moving = in_configuration(chain, free)
    yield np.where(moving, clipped(chain, _outermost(chain, start)), start)
    rng = np.random.default_rng(0)
    for _ in range(_ATTEMPTS):
        yield np.where(moving, random_configuration(chain, rng), start)


def _outermost(chain: ClosedChain, q: Configuration) -> Configuration:
    """Put coordinates that stand at a limit just beyond it, so that `clipped` takes them to the middle."""
    lower, upper = chain.model.lowerPositionLimit, chain.model.upperPositionLimit
    return np.where(q <= lower, q - 1.0, np.where(q >= upper, q + 1.0, q))


def bounded(
    chain: ClosedChain, guess: Configuration, leeway: FloatArray, *, precision: float = 0.0, cones: bool
) -> Configuration | Stuck:
    """Close the loops by bounded steps of Gauss and Newton, then to the last bit.

    Parameters
    ----------
    chain
        Closed chain.
    guess
        (nq,) configuration to start from [m, rad, unit quaternions].
    leeway
        (nv,) how far each tangent entry may move from there, in robot sizes and radians; infinite:
        anywhere within its limits [dimensionless].
    precision
        Gap that is left as it is, in robot sizes and radians.
    cones
        Whether limits of balls and of loops count.

    Returns
    -------
    numpy.ndarray or Stuck
        (nq,) configuration within these limits [m, rad, unit quaternions], or where the search ended.
    """
    room = _Room(chain, guess, leeway)
    state = chain.at(room.off_the_ends(pin.normalize(chain.model, np.array(guess))))
    (residual, jacobian), damping = _equations(chain, state, cones), 1e-3
    enough, slow = max(_enough(chain), state.round_off, precision / 2), 0
    for _ in range(_STEPS):
        if np.abs(residual).max() < enough:
            break
        system = np.vstack([jacobian, damping * np.eye(chain.nv)])
        right = np.concatenate([-residual, np.zeros(chain.nv)])
        trial = displaced(state, _within(system, right, *room.at(state.q)))
        left = _equations(chain, trial, cones)
        shrunk = np.linalg.norm(left[0]) / np.linalg.norm(residual)
        slow = 0 if shrunk < _SLOWLY else slow + (shrunk < 1)
        if slow > _PATIENCE:
            return _stuck(state, room)
        if shrunk < 1:
            state, (residual, jacobian), damping = trial, left, max(damping / 5, 1e-9)
        elif damping > 1e3:
            return _stuck(state, room)
        else:
            damping *= 5
    else:
        return _stuck(state, room)
    closure = None if precision else polish(chain, state.q)
    q = np.array(state.q) if closure is None else closure.q
    if (closure is not None and not closure.success) or moved_beyond(chain, guess, q, leeway):
        return _stuck(state, room)
    q = np.where(in_configuration(chain, leeway == np.inf), unwound(chain, q), q)
    beyond = outside(chain, q) or (cones and beyond_cones(chain, q).any())
    return _stuck(state, room) if beyond else q


def _within(system: FloatArray, right: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Solve linear least squares of full column rank within bounds, by Newton steps that are projected onto them [1]_.

    References
    ----------
    .. [1] D. P. Bertsekas, "Projected Newton methods for optimization problems with simple constraints", SIAM J.
       Control Optim. 20(2), 1982, eq. (3) to (8).
    """
    x = np.clip(np.linalg.lstsq(system, right)[0], lower, upper)
    left = system @ x - right
    for _ in range(_CHANGES):
        uphill = system.T @ left
        free = ~(((x <= lower) & (uphill > 0)) | ((x >= upper) & (uphill < 0)))
        if np.abs(uphill[free]).max(initial=0.0) <= _NO_SLOPE * np.linalg.norm(left):
            break
        step, share = np.zeros_like(x), 1.0
        step[free] = -np.linalg.lstsq(system[:, free], left)[0]
        while share > _SHORTEST:
            trial = np.clip(x + share * step, lower, upper)
            after = system @ trial - right
            if after @ after < left @ left:
                break
            share /= 2
        else:
            break
        x, left = trial, after
    return x


def _enough(chain: ClosedChain) -> float:
    """Gap from which on Newton's method closes the rest without leaving the narrowest range."""
    stated = chain.limits.stated("position")
    lower, upper = chain.limits.bounds("position", stated).T / chain.judge.sizes(stated)
    return float(np.clip((upper - lower).min(initial=np.inf) / 8, NOTHING, _ENOUGH))


def _equations(chain: ClosedChain, state: State, cones: bool) -> tuple[FloatArray, FloatArray]:
    """Gap and its derivative in natural units; directions held together as a whole, or they end against each other."""
    apart, turning = state.alignment
    residual, jacobian = [state.relative_gap, apart], [state.rows, turning * chain.tangent_scale]
    if cones:
        passed = beyond_cones(chain, state.q, _INSET)
        residual.append(passed)
        jacobian.append(_cone_rates(chain, state.q, passed != 0.0))
    return np.concatenate(residual), np.vstack(jacobian)


def _stuck(state: State, room: _Room) -> Stuck:
    """Name the joints at whose limits the gap would shrink beyond."""
    chain = state.chain
    lower, upper = room.at(state.q)
    downhill = -state.rows.T @ state.relative_gap
    pressed = ((lower > -_AT_END) & (downhill < 0)) | ((upper < _AT_END) & (downhill > 0))
    share = np.abs(downhill) >= _PRESSED * np.abs(downhill).max(initial=0.0)
    names = [chain.tangent_names[k] for k in np.flatnonzero(pressed & ~room.named & share)]
    return Stuck(np.array(state.q), float(np.abs(state.gap).max(initial=0.0)), tuple(names))


class _Room:
    """How far each tangent entry may go at once in natural units: to its limits, and named joints hardly at all."""

    def __init__(self, chain: ClosedChain, guess: Configuration, leeway: FloatArray) -> None:
        self._chain, self._guess, self._leeway = chain, guess, leeway
        self.named = leeway < np.inf
        single = [joint for joint in list(chain.model.joints)[1:] if joint.nq == joint.nv == 1]
        self._in_q = np.array([joint.idx_q for joint in single], dtype=int)
        self._in_v = np.array([joint.idx_v for joint in single], dtype=int)
        self._scale = chain.tangent_scale[self._in_v]
        least = chain.model.lowerPositionLimit[self._in_q] / self._scale
        most = chain.model.upperPositionLimit[self._in_q] / self._scale
        # The last bits of closing may move a joint a little.
        inset = np.minimum(_INSET, (most - least) / 4)
        self._least, self._most, self._inset = least + inset, most - inset, inset

    def off_the_ends(self, q: Configuration) -> Configuration:
        """Move joints that may be anywhere and stand at a limit a little inwards: there they would stay all the way."""
        value = q[self._in_q] / self._scale
        inside = np.clip(value, self._least, self._most)
        at_end = (np.abs(inside - value) <= 2 * self._inset) & ~self.named[self._in_v]
        moved = q.copy()
        moved[self._in_q] = np.where(at_end, inside * self._scale, q[self._in_q])
        return moved

    def at(self, q: Configuration) -> tuple[FloatArray, FloatArray]:
        """(nv,) least and largest step."""
        lower, upper = np.full(self._chain.nv, -_LONGEST), np.full(self._chain.nv, _LONGEST)
        value = q[self._in_q] / self._scale
        # A start outside its range, as a home with few digits may be, is not thrown back at once.
        lower[self._in_v] = np.maximum(-_LONGEST, np.minimum(self._least - value, 0.0))
        upper[self._in_v] = np.minimum(_LONGEST, np.maximum(self._most - value, 0.0))
        moved = pin.difference(self._chain.model, self._guess, q) / self._chain.tangent_scale
        reach = 0.9 * self._leeway[self.named]
        lower[self.named], upper[self.named] = -reach - moved[self.named], reach - moved[self.named]
        return np.minimum(lower, -1e-12), np.maximum(upper, 1e-12)


def _cone_rates(chain: ClosedChain, q: Configuration, passed: BoolArray) -> FloatArray:
    """(k, nv) derivative of what is passed, in natural units; 0 for what is within."""
    rows = cone_rows(chain)
    found = np.zeros((rows.size, chain.nv))
    if passed.any():
        rates = chain.judge.rates(q, np.diag(chain.tangent_scale), rows[passed])
        found[passed] = rates / chain.judge.sizes(rows[passed])[:, None]
    return found
