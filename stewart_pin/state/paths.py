r"""From a closed configuration to a demand, on the same branch: a platform pose, or motor positions.

A mechanism has several configurations for one demand. The one that continues the guess is found by moving the demand
along a path and following it; Newton's method from far away may end on any other. A stretch of the path is accepted
only where Newton's steps contract at once, ‖Δ₁‖ ≤ ‖Δ₀‖ / 4: then, by the theorem of Newton and Kantorovich in its
affine covariant form [1]_, every demand on the stretch has exactly one solution near the beginning, and no singularity
lies between. Otherwise the stretch is shortened; where it shrinks to nothing the path has met a singularity, beyond
which there is no branch to be kept.

References
----------
.. [1] P. Deuflhard, "Newton Methods for Nonlinear Problems", Springer, 2004, theorem 2.1 and section 5.1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin
from scipy.linalg import get_lapack_funcs

from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.freedom import TWIST_AXES, TwistAxis, counted, split_motions
from stewart_pin.state.generic import generic_freedom
from stewart_pin.state.newton import Closure, System, displaced, judged, solve
from stewart_pin.state.state import State
from stewart_pin.tolerances import CLOSED, CONTRACTION, SHORTEST_STRETCH, SINGULAR
from stewart_pin.typing import FloatArray, Tangent

_gesv, _getrs = get_lapack_funcs(("gesv", "getrs"), dtype=np.float64)
_TURN = 0.6
"""Largest angle by which the first Newton step of a stretch may turn a joint [rad]: farther sines are not straight."""
_OF_THE_REST, _SHORTEST_OF_ALL = 0.01, 1e-7
"""A good part of what is left, and the share below which none is shortened: before a fold stretches shrink with the
distance to it, so that a demand just before one takes shorter ones; below this there are residuals `_ON_THE_WAY`."""
_Side = tuple[FloatArray, ...] | None
"""The matrix of loops and demand, and its factors where it is square; None where there is none."""
_LITTLE = 0.7
"""Relative change of the matrix by the first step of a stretch with which the next, by a third more, stay below 1."""
_ON_THE_WAY = 1e-8
"""Largest residual at the end of a stretch that is not the last, in natural units."""
_STANDS_STILL = 1e-9
"""Newton step below which nothing more is won: where motors contradict each other a residual stays."""
_AT_THE_END = 0.999
"""Share of a path beyond which what ends it may be the demand itself: a pose at the border of the workspace."""
_AT_A_FOLD = 1e-4
"""Singular value at a demand where two branches meet: residuals of round-off move such a double root by their roots."""
_MAX_STEPS = 12
"""Newton steps of one stretch: six of them square round-off out of a contraction of a quarter."""


@dataclass(frozen=True, eq=False)
class Path:
    """A demand that moves from where the chain is to what is asked for.

    Attributes
    ----------
    residual
        (m,) at a state, for a share of the path from 0 to 1, in natural units.
    rows
        (m, nv) its Jacobian at a state, in natural units; up to terms of the size of the residual.
    sizes
        (m,) natural size of each residual: the robot's size [m], or 1 [rad].
    rank
        Number of independent rows that the mechanism has beside its loops.
    demand
        What is asked for, in words.
    onward
        Leads from a state on the way to the same end; None where the path goes through what the mechanism can do.
    """

    residual: Callable[[State, float], FloatArray]
    rows: Callable[[State], FloatArray]
    sizes: FloatArray
    rank: int
    demand: str
    onward: Callable[[State], Path] | None = None

    def system(self, chain: ClosedChain) -> System:
        """Return loops and the end of the path as a system for `solve`.

        Parameters
        ----------
        chain
            The chain.

        Returns
        -------
        System
            Of as many directions as the mechanism has.
        """

        def evaluate(state: State) -> tuple[FloatArray, FloatArray]:
            return self.residuals(state, 1.0), np.concatenate([state.rows, self.rows(state)])

        sizes = np.concatenate([chain.row_sizes, self.sizes])
        return System(evaluate, sizes, chain.generic.rank + self.rank, self.demand)

    def residuals(self, state: State, share: float) -> FloatArray:
        """Stack the gap on the residual.

        Parameters
        ----------
        state
            The state.
        share
            Of the path.

        Returns
        -------
        numpy.ndarray
            (nc + m,) dimensionless.
        """
        return np.concatenate([state.gap / state.chain.row_sizes, self.residual(state, share)])


def pose_path(start: State, target: pin.SE3, axes: Sequence[TwistAxis] = TWIST_AXES) -> Path:
    """Move the platform to a pose along the screw between the two.

    Parameters
    ----------
    start
        Where it is.
    target
        Platform frame in the world.
    axes
        Components of position error and rotation vector that are asked for, of `TWIST_AXES`; the others are free.

    Returns
    -------
    Path
        Position error, and rotation vector of R R_targetᵀ in world axes.
    """
    chain, begin = start.chain, start.pose
    every = tuple(axes) == TWIST_AXES
    kept = slice(None) if every else np.flatnonzero(counted(axes))
    sizes = chain.twist_sizes[kept]
    screw: list[pin.Motion] = []  # of the whole path, found where a part of it is asked for
    last = target.translation, target.rotation.T

    def residual(state: State, share: float) -> FloatArray:
        place, unturned = last
        if share < 1.0:  # the end of the path is the pose itself, not its logarithm's exponential
            if not screw:
                screw.append(pin.log6(begin.actInv(target)))
            goal = begin * pin.exp6(share * screw[0])
            place, unturned = goal.translation, goal.rotation.T
        here = state.pose
        error = np.empty(6)
        np.subtract(here.translation, place, out=error[:3])
        error[3:] = pin.log3(here.rotation @ unturned)
        return (error if every else error[kept]) / sizes

    def rows(state: State) -> FloatArray:
        # d log3(R R_targetᵀ) = ω up to the error itself.
        return state.P[kept] * chain.tangent_scale / sizes[:, None]

    rank = generic_freedom(chain, axes).platform
    # Of few freedoms, a platform follows no screw: it goes as near as it can, and on from there.
    onward = (lambda state: pose_path(state, target, axes)) if rank < len(sizes) else None
    return Path(residual, rows, sizes, rank, "the pose", onward)


def motor_path(start: State, target: FloatArray) -> Path:
    """Move the motors to their positions, all in proportion.

    Parameters
    ----------
    start
        Where they are.
    target
        (nu,) motor positions [m or rad].

    Returns
    -------
    Path
        Error of the motor positions.
    """
    chain = start.chain
    at, sizes = chain.motor_q_index, chain.tangent_scale[chain.motor_index]
    begin = start.q[at]

    def residual(state: State, share: float) -> FloatArray:
        goal = target if share == 1.0 else begin + share * (target - begin)
        return (state.q[at] - goal) / sizes

    return Path(
        residual, lambda state: chain.motor_rows, sizes, chain.generic.count.motor, "the motor positions"
    )


def follow_path(start: State, path: Path) -> Closure:
    """Follow a path to its end, on the branch of its beginning.

    Parameters
    ----------
    start
        State with closed loops.
    path
        What is asked for.

    Returns
    -------
    Closure
        Configuration at the end; or the reason why the path does not lead there, with the residual that is left where
        the chain comes nearest.
    """
    state, share, stretch, iterations = start, 0.0, 1.0, 0
    system, residual, way, done = path.system(start.chain), np.zeros(0), path, 0.0
    while share < 1.0:
        end = min(1.0, share + stretch)
        # What lies before the state the way now begins at is done.
        found = _stretch(state, way, 1.0 if end == 1.0 else (end - done) / (1.0 - done))
        iterations += found.steps
        if found.state is None:
            stretch *= found.shorten
            if stretch < max(_SHORTEST_OF_ALL, min(SHORTEST_STRETCH, _OF_THE_REST * (1.0 - share))):
                return _lost(start, state, share, path, system, iterations)
            continue
        state, share, residual = found.state, end, found.residual
        stretch *= 2
        if path.onward is not None and share < 1.0:
            way, done = path.onward(state), share
    closure = judged(state, residual, system, iterations)
    if not closure.success and _largest(residual) < _ON_THE_WAY:
        # Beside a singularity plain steps lose digits that damped ones keep.
        closure = solve(start.chain, state.q, system)
        return replace(closure, iterations=iterations + closure.iterations)
    return closure


@dataclass(frozen=True, eq=False)
class _Stretch:
    """Where a stretch of a path leads, and the residual there; without a state it has to be shortened by a factor."""

    steps: int
    state: State | None = None
    residual: FloatArray = field(default_factory=lambda: np.zeros(0))
    shorten: float = 0.5


def _stretch(begin: State, path: Path, share: float) -> _Stretch:
    """Newton's method from the beginning of a stretch to its end, as long as it contracts."""
    state, residual = begin, path.residuals(begin, share)
    goal = CLOSED / 10 if share == 1.0 else _ON_THE_WAY
    angles, rank = begin.chain.angle_mask, begin.chain.generic.rank + path.rank
    before, worst = 0.0, _largest(residual)
    first: _Side = None
    turned = np.inf
    for count in range(_MAX_STEPS):
        if worst <= goal:
            # Short steps leave so little that no second one has seen what the first has passed.
            passed = count == 1 and _change(first, _newton_step(state, path, residual)[1], rank) >= 1.0
            return _Stretch(count) if passed else _Stretch(count, state, residual)
        step, side = _newton_step(state, path, residual)
        if step is None:
            return _Stretch(count)
        # Where two branches nearly meet, straight on leads to the other one.
        first = side if count == 0 else first
        # Steps that shrink to a quarter each add at most a third to what the matrix has changed by the first of them.
        if count and turned > _LITTLE:
            turned = _change(first, side, rank)
            if turned >= 1.0:
                return _Stretch(count)
        size = float(np.sqrt(step @ step))
        if count == 0:
            turn = _largest(step[angles])
            if turn > _TURN:
                return _Stretch(count, shorten=max(0.1, 0.9 * _TURN / turn))
        elif size > CONTRACTION * before:
            if worst <= max(CLOSED, state.round_off):  # round-off does not contract
                return _Stretch(count, state, residual)
            return _Stretch(count, shorten=_shortening(size / before))
        following = displaced(state, step)
        left = path.residuals(following, share)
        worst, last = _largest(left), worst
        if worst > last / 2 and (size < _STANDS_STILL or last <= max(CLOSED, state.round_off)):
            return _Stretch(count, state, residual) if worst >= last else _Stretch(count, following, left)
        state, residual, before = following, left, size
    closed = worst <= max(CLOSED, state.round_off)
    return _Stretch(_MAX_STEPS, state, residual) if closed else _Stretch(_MAX_STEPS)


def _shortening(contraction: float) -> float:
    """Factor that brings a contraction, which grows as the square of a stretch does in its worst part, to a quarter."""
    # Deuflhard, eq. (5.19), for a tangent predictor; not below a tenth, not above a half.
    return float(np.clip(0.9 * np.sqrt(CONTRACTION / contraction), 0.1, 0.5))


def _newton_step(state: State, path: Path, residual: FloatArray) -> tuple[Tangent | None, _Side]:
    """Least motion that removes a residual to the first order, None at a singularity; and the side of one it is on."""
    usual, chain = state.chain.generic, state.chain
    rows = path.rows(state)
    if usual.rank == chain.nc and path.rank == rows.shape[0] and chain.nc + path.rank == chain.nv:
        matrix = np.concatenate([state.rows, rows])
        factors, swaps, step, info = _gesv(matrix, -residual)
        return step if info == 0 and np.isfinite(step @ step) else None, (matrix, factors, swaps)
    motions = state.motions
    if motions.smallest <= 0:
        return None, None
    across = motions.across(-residual[: chain.nc])
    if not path.rank:
        return across, (state.rows,)
    driven = rows @ motions.basis
    share = split_motions(driven, path.rank)
    if share.smallest <= 0:
        return None, None
    step = across + motions.basis @ share.across(-residual[chain.nc :] - rows @ across)
    return step, (np.concatenate([state.rows, rows]),)


def _change(first: _Side, last: _Side, rank: int) -> float:
    """Largest relative change of a matrix between two states near each other; ≥ 1 if a singularity lies between."""
    if first is None or last is None or not first[0].size:
        return 0.0
    if len(first) == 3:
        change = _getrs(first[1], first[2], last[0])[0]
    else:  # what depends on other rows, and idle motions, do not count
        u, s, vt = np.linalg.svd(first[0], full_matrices=False)
        change = (u[:, :rank].T @ last[0] @ vt[:rank].T) / s[:rank, None]
    # The change of the matrix is the identity where nothing moves. An eigenvalue that has gone through zero stands for
    # a singularity; two at once would leave the sign of the determinant.
    beside = change.ravel(order="K")  # no copy
    beside[:: len(change) + 1] -= 1.0
    norm = float(np.sqrt(beside @ beside))
    if norm < 1.0:
        return norm
    beside[:: len(change) + 1] += 1.0
    return 0.99 if (np.linalg.eigvals(change).real > 0.0).all() else np.inf


def _lost(start: State, state: State, share: float, path: Path, system: System, iterations: int) -> Closure:
    """Say why a path ends before its end; from a singular beginning, where branches meet, any of them will do."""
    direct = solve(start.chain, state.q, system)
    if direct.success and (
        (share == 0.0 and _is_singular(start, path, SINGULAR))
        or (share > _AT_THE_END and _is_singular(direct.state, path, _AT_A_FOLD))
    ):
        return direct
    gap = float(np.abs(path.residuals(state, 1.0) * system.sizes).max()) if direct.success else direct.gap
    where = f"{100 * share:.4g} % of the way"
    reason = (
        f"on the way from the guess the branch ends at a singularity, {where}; the demand itself is met only on "
        "another branch"
        if direct.success
        else f"the branch of the guess ends {where}, and the residual is {gap:.3g} [m or rad]"
    )
    reached = state if direct.success else direct.state
    return Closure(reached, gap, iterations + direct.iterations, success=False, reason=reason)


def _is_singular(state: State, path: Path, tolerance: float) -> bool:
    """Whether rows of loops or demand have lost a direction at a state."""
    if state.motions.smallest < tolerance * state.chain.generic.usual_loops:
        return True
    values = np.linalg.svd(path.rows(state) @ state.motions.basis, compute_uv=False)
    return bool(path.rank and values[path.rank - 1] < tolerance)


def _largest(residual: FloatArray) -> float:
    return float(np.abs(residual).max(initial=0.0))
