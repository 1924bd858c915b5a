"""The nearest mechanism whose loops close at many configurations: places of joints and loops move by the least.

Joints and loops are attached at places. A small twist of each, along and about its own axes, opens the loops at every
state; what the state cannot follow, because rows of its loops depend on each other, the twists have to close.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from stewart_pin.model.description import JointKind, Mechanism
from stewart_pin.model.tree import build_tree
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.newton import displaced
from stewart_pin.state.state import State
from stewart_pin.tolerances import CLOSED, ROUND_OFF_STEPS
from stewart_pin.typing import FloatArray

_STEPS = 40
"""Gauss-Newton steps between two times."""
_LEAST = 1e4
"""Factor of damping from which on a step is nothing."""
_HALVINGS = 40
"""Halvings of the logarithm of a damping that is looked for."""
_FLOOR = 1e-10
"""Share of the largest singular value that moves of places have for nothing: these leave the loops as they are."""
_IN_VAIN = 0.1
"""Share of the gaps that moves as large as digits explain leave open where no mechanism is near, by linear equations.
Where one was found, they left a fortieth at most, over all mechanisms and formats of `tests.benchmarks.digits`; where
gears and springs that only seem to move left none, a quarter."""


@dataclass(frozen=True)
class Place:
    """Where a joint or a loop is attached.

    Attributes
    ----------
    owner
        Joint or loop.
    side
        0 for a joint, 1 or 2 for a frame of a loop.
    """

    owner: str
    side: int

    def __str__(self) -> str:
        return f"joint '{self.owner}'" if not self.side else f"loop '{self.owner}', frame {self.side}"


def places_of(chain: ClosedChain) -> tuple[Place, ...]:
    """List the places of the joints in loops, and of the frames of loops.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    tuple of Place
        Joints first.
    """
    found: list[Place] = []
    for joint in chain.mechanism.joints:
        if joint.kind not in (JointKind.FIXED, JointKind.FLOATING):
            entry = chain.model.joints[chain.model.getJointId(joint.name)].idx_v
            if chain.loop_table.row_difference[:, entry].any():
                found.append(Place(joint.name, 0))
    for loop in chain.loops:
        found += [Place(loop.name, 1), Place(loop.name, 2)]
    return tuple(found)


def placement_of(mechanism: Mechanism, place: Place) -> pin.SE3:
    """Look up where a place is in its link.

    Parameters
    ----------
    mechanism
        Description.
    place
        One of its places.

    Returns
    -------
    pinocchio.SE3
        In the frame of the link that carries it.
    """
    if not place.side:
        return mechanism.joint(place.owner).placement
    loop = next(loop for loop in mechanism.loops if loop.name == place.owner)
    return loop.placement1 if place.side == 1 else loop.placement2


def of_size(chain: ClosedChain, size: float) -> ClosedChain:
    """Give a chain other natural units.

    Parameters
    ----------
    chain
        Closed chain.
    size
        Natural length [m].

    Returns
    -------
    ClosedChain
        A copy.
    """
    sized = replace(chain)
    sized.__dict__["length_scale"] = size
    return sized


def all_closed(states: Sequence[State]) -> bool:
    """Tell whether the loops are closed to round-off.

    Parameters
    ----------
    states
        Of one chain.

    Returns
    -------
    bool
        Whether they are at all of these.
    """
    return all(state.largest_gap <= max(CLOSED, state.round_off) for state in states)


def none_near(states: Sequence[State], rank: int, places: Sequence[Place], forgiven: float) -> bool:
    """Tell whether small moves of places cannot close the loops, by their linear equations.

    Parameters
    ----------
    states
        Of one chain, as nearly closed as the rank allows.
    rank
        Number of rows that do not follow from the others.
    places
        Where joints and loops may be moved.
    forgiven
        Largest norm of all moves together, in robot sizes and radians.

    Returns
    -------
    bool
        Whether the best of these moves leave most of the gaps.
    """
    if all_closed(states):
        return False
    attached = _Attached.of(states[0].chain, places)
    equations = _Equations.of(states, attached, rank, np.ones(6 * len(places)))
    return equations.left_open(forgiven) > _IN_VAIN * float(np.linalg.norm(equations.right))


def closed_everywhere(
    chain: ClosedChain,
    states: Sequence[State],
    rank: int,
    places: Sequence[Place],
    forgiven: float,
    ease: FloatArray,
) -> tuple[ClosedChain, list[State]]:
    """Move places by the least that closes the loops at all states, which move along (Levenberg-Marquardt).

    Parameters
    ----------
    chain
        Closed chain.
    states
        As nearly closed as the rank allows.
    rank
        Number of rows that do not follow from the others.
    places
        Where joints and loops may be moved.
    forgiven
        Largest norm of all moves together, in robot sizes and radians.
    ease
        (6 n,) how easily each place moves along and about its own axes, dimensionless.

    Returns
    -------
    chain : ClosedChain
        With other places.
    states : list of State
        The states that have followed; whether they are closed is for `all_closed` to tell.
    """
    states = [chain.at(state.q) for state in states]
    size, extra = _size(states), 1.0
    noise = max(state.round_off for state in states) / ROUND_OFF_STEPS
    attached, equations, gone = _Attached.of(chain, places), None, np.zeros(6 * len(places))
    for _ in range(_STEPS):
        if _open(states) <= max(CLOSED, ROUND_OFF_STEPS * noise) / 40 or extra > _LEAST:
            break
        if equations is None:
            equations = _Equations.of(states, attached, rank, ease)
        # Damped by the size of the residual: the least moves, whatever the rank of these equations. Round-off, which
        # stands in every one, may not move anything farther than digits reach.
        damping = (
            extra * float(np.linalg.norm(equations.right))
            + _FLOOR * equations.values[0]
            + noise * np.sqrt(equations.right.size) / forgiven
        )
        moves = ease * equations.moves(damping)
        if np.linalg.norm(gone + moves) > forgiven:
            # A mechanism so far away is none that the digits meant, even if one is there; a nearer one may be.
            extra *= 10.0
            continue
        trial = _moved(chain, places, moves)
        trials = [
            displaced(State(trial, state.q), step)
            for state, step in zip(states, equations.following(moves), strict=True)
        ]
        if _size(trials) < size:
            chain, states, size, equations, extra = trial, trials, _size(trials), None, 1.0
            attached, gone = _Attached.of(chain, places), gone + moves
        else:
            extra *= 10.0
    return chain, states


@dataclass(frozen=True, eq=False)
class _Equations:
    """Loops at several states, linearised in the moves of places: what the combinations U⊥ of rows leave, and the rest.

    With the rows U diag(s) Vᵀ of each state, and its columns C, the rate of the gap per move: U⊥ᵀ (gap + C x) = 0 for
    the moves x, whose singular value decomposition is kept; what else opens, the state follows.
    """

    u: FloatArray
    s: FloatArray
    vt: FloatArray
    gaps: FloatArray
    columns: FloatArray
    right: FloatArray
    left: FloatArray
    values: FloatArray
    across: FloatArray

    @classmethod
    def of(cls, states: Sequence[State], attached: _Attached, rank: int, ease: FloatArray) -> _Equations:
        u, s, vt = np.linalg.svd(np.array([state.rows for state in states]))
        gaps = np.array([state.relative_gap for state in states])
        columns = attached.columns(states)
        follows = u[:, :, rank:].transpose(0, 2, 1)
        right = (follows @ gaps[:, :, None]).ravel()
        matrix = (follows @ columns).reshape(right.size, -1) * ease
        own = np.linalg.svd(matrix, full_matrices=False)
        return cls(u[:, :, :rank], s[:, :rank], vt[:, :rank], gaps, columns, right, *own)

    def moves(self, damping: float) -> FloatArray:
        """(6 n,) damped least-norm solution, in units of ease."""
        return -self.across.T @ (self.values / (self.values**2 + damping**2) * (self.left.T @ self.right))

    def left_open(self, reach: float) -> float:
        """Least norm of U⊥ᵀ (gap + C x) over all moves, in units of ease, whose norm is no larger than `reach`."""
        asked = self.left.T @ self.right
        beyond = max(0.0, float(self.right @ self.right - asked @ asked))
        # The least norm falls as the damping grows: from none to one that leaves nothing of the moves.
        low = _FLOOR * self.values[0]
        high = max(low, float(np.linalg.norm(self.right)) / reach)
        for _ in range(_HALVINGS):
            damping = np.sqrt(low * high)
            far = np.linalg.norm(self.moves(damping)) > reach
            low, high = (damping, high) if far else (low, damping)
        kept = high**2 / (self.values**2 + high**2) * asked
        return float(np.sqrt(beyond + kept @ kept))

    def following(self, moves: FloatArray) -> FloatArray:
        """(S, nv) steps of the states that close the rows that are independent, at the moved places."""
        opened = (self.gaps + self.columns @ moves)[:, :, None]
        steps = self.vt.transpose(0, 2, 1) @ ((self.u.transpose(0, 2, 1) @ opened) / self.s[:, :, None])
        return -steps[:, :, 0]


@dataclass(frozen=True, eq=False)
class _Attached:
    """Places as arrays: (n,) joints that carry them, (n, 3, 3) and (n, 3) where, (n, nc) signs in the rows of gaps."""

    carrier: np.ndarray
    rotation: FloatArray
    translation: FloatArray
    sign: FloatArray

    @classmethod
    def of(cls, chain: ClosedChain, places: Sequence[Place]) -> _Attached:
        table, model = chain.loop_table, chain.model
        numbers = {loop.name: k for k, loop in enumerate(chain.loops)}
        placements, parents = list(model.jointPlacements), list(model.parents)
        found: list[tuple[int, FloatArray, FloatArray, FloatArray]] = []
        for place in places:
            if not place.side:
                joint = model.getJointId(place.owner)
                at = placements[joint]
                sign = table.row_difference[:, model.joints[joint].idx_v]
                found.append((parents[joint], at.rotation, at.translation, sign))
                continue
            k, sign = numbers[place.owner], np.zeros(chain.nc)
            sign[table.slices[k]] = -1.0 if place.side == 1 else 1.0
            ends = (
                (table.joint1, table.rotation1, table.translation1)
                if place.side == 1
                else (table.joint2, table.rotation2, table.translation2)
            )
            found.append((ends[0][k], ends[1][k], ends[2][k], sign))
        carrier, rotation, translation, signs = zip(*found, strict=True)
        return cls(np.array(carrier), np.array(rotation), np.array(translation), np.array(signs))

    def columns(self, states: Sequence[State]) -> FloatArray:
        """(S, nc, 6 n) rates of the gaps per move of each place along and about its own axes, natural units."""
        chain = states[0].chain
        placed = [state._placed for state in states]
        carrier = np.array([each.rotation[self.carrier] for each in placed])
        origin = np.array([each.translation[self.carrier] for each in placed])
        origin = origin + (carrier @ self.translation[:, :, None])[..., 0]
        axes = carrier @ self.rotation
        # The twist [v; ω] of a place along its own axes is [R v + p × R ω; R ω] at the world origin.
        action = np.zeros((*axes.shape[:2], 6, 6))
        action[..., :3, :3] = action[..., 3:, 3:] = axes
        action[..., :3, 3:] = np.cross(origin[..., None, :], axes.swapaxes(-1, -2)).swapaxes(-1, -2)
        wrenches = np.array([state.row_wrenches for state in states])[:, None]
        rates = (wrenches @ action) * (self.sign[:, :, None] * chain.twist_sizes)
        rates = rates.transpose(0, 2, 1, 3).reshape(len(states), chain.nc, -1)
        return rates / chain.row_sizes[:, None]


def _moved(chain: ClosedChain, places: Sequence[Place], moves: FloatArray) -> ClosedChain:
    """Attach joints and loops elsewhere."""
    by_place = {
        place: pin.exp6(pin.Motion(move * chain.twist_sizes))
        for place, move in zip(places, moves.reshape(-1, 6), strict=True)
    }
    still = pin.SE3.Identity()

    def placed(placement: pin.SE3, place: Place) -> pin.SE3:
        return placement * by_place.get(place, still)

    old = chain.mechanism
    mechanism = replace(
        old,
        joints=tuple(
            replace(joint, placement=placed(joint.placement, Place(joint.name, 0)))
            if Place(joint.name, 0) in by_place
            else joint
            for joint in old.joints
        ),
        loops=tuple(
            replace(
                loop,
                placement1=placed(loop.placement1, Place(loop.name, 1)),
                placement2=placed(loop.placement2, Place(loop.name, 2)),
            )
            for loop in old.loops
        ),
    )
    return _rebuilt(chain, mechanism)


def _rebuilt(chain: ClosedChain, mechanism: Mechanism) -> ClosedChain:
    moved = replace(chain, mechanism=mechanism, model=build_tree(mechanism, chain.gravity))
    # Sizes are of the file's numbers, not of digits: natural units stay the same from step to step.
    return of_size(moved, chain.length_scale)


def _size(states: Sequence[State]) -> float:
    return float(np.linalg.norm([state.relative_gap for state in states]))


def _open(states: Sequence[State]) -> float:
    return max(state.largest_gap for state in states)
