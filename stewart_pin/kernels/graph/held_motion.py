"""What of a motion is held while the geometry changes, and the conditions by which the rest follows.

Of the platform's motion as many components are held as it has freedoms, of the motors' as many motors, of a whole
state as many joint coordinates as are independent. With g the displacements, a motion obeys

    gap(q, g) = 0,   J(q, g) v = rates held,   J a + J̇ v = accelerations held,

loop rows above rows of what is held. All are chosen on samples, and so are the displacements that leave a mechanism.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from scipy.linalg import qr, solve_triangular

from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.graph.displaced_tree import displaced_tree
from stewart_pin.kernels.graph.driven_tree import DrivenTree
from stewart_pin.kernels.graph.loop_rows import loop_gaps
from stewart_pin.kernels.graph.platform_kinematics import platform_bias, platform_columns, platform_placement
from stewart_pin.kernels.graph.whole_tree import ClosedTree, motor_columns, tree_bias
from stewart_pin.kernels.planning.elimination import Elimination, plan_pivots
from stewart_pin.kernels.planning.samples import closed_samples, idle_moved
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.freedom import TWIST_AXES
from stewart_pin.state.geometry_parameters import geometry_parameters
from stewart_pin.typing import FloatArray

_ZERO = 1e-9
"""Singular values below this, in robot sizes and radians, are round-off."""
_NEARLY = 0.2
"""Share of the largest safety with which earlier coordinates are preferred: position before rotation."""
_CHOICES = 10_000
"""Largest number of choices that are compared."""


@dataclass(frozen=True, eq=False)
class HeldMotion:
    """Independent rows of loops and of what is held, eliminated.

    Attributes
    ----------
    closed
        The chain as it is.
    names
        Readable name of each coordinate that is held.
    output
        (nv, n) transpose of the accelerations that forward dynamics gives.
    on_platform
        Whether the held rows, and those accelerations, depend on the geometry: those of the platform do.
    idle
        (nv, n) motions that neither loops nor what is held see; they carry no momentum.
    reduced
        Independent rows, transposed and eliminated.
    places
        Place of each of these rows among all loop rows and, after them, six rows of the platform; -1 for rows that
        the geometry does not change.
    """

    closed: ClosedTree
    names: tuple[str, ...]
    output: ca.SX
    on_platform: bool
    idle: ca.SX
    reduced: Elimination
    places: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of rows that may depend on the geometry."""
        return self.closed.tree.nc + 6 * self.on_platform

    def multipliers(self, right: ca.SX) -> ca.SX:
        """Solve the transposed rows.

        Parameters
        ----------
        right
            (nv, k) combinations of rows.

        Returns
        -------
        casadi.SX
            (size, k) the multipliers of the rows that may depend on the geometry.
        """
        found = self.reduced.back(self.reduced.forward(right), {})
        result = ca.SX.zeros(self.size, right.shape[1])
        for column, place in enumerate(self.places):
            if place >= 0:
                result[place, :] = found[column]
        return result


def hold(closed: ClosedTree, driven: DrivenTree | None) -> HeldMotion:
    """Hold the motion of what drives a chain, or that of its independent joint coordinates.

    Parameters
    ----------
    closed
        The chain, its loop rows eliminated.
    driven
        The same chain driven, or None: whole states are given.

    Returns
    -------
    HeldMotion
        The rows.

    Raises
    ------
    UnsupportedError
        If these rows are too nearly dependent.
    """
    tree, chain = closed.tree, closed.chain
    if driven is None:
        rows = ca.SX.eye(tree.nv)
        names, sizes, kept = chain.tangent_names, chain.tangent_scale, list(closed.reduced.pivots.rows)
        return _held(closed, rows, sizes, names, sorted(kept), False, ca.SX(tree.nv, 0))
    on_platform = driven.coordinates == "platform"
    if on_platform:
        names = tuple(f"platform {axis}" for axis in TWIST_AXES)
        sizes = np.repeat([chain.length_scale, 1.0], 3)
    else:
        names, sizes = chain.motors, chain.tangent_scale[list(tree.motors)]
    kept = _independent(closed, driven.drive, sizes)
    return _held(closed, driven.drive, sizes, names, kept, on_platform, driven.idle)


def hold_motors(closed: ClosedTree) -> HeldMotion:
    """Hold the motors of a chain whose whole state is given: what its idle freedoms do not change.

    Parameters
    ----------
    closed
        The chain, its loop rows eliminated.

    Returns
    -------
    HeldMotion
        The rows.

    Raises
    ------
    UnsupportedError
        If these rows are too nearly dependent.
    """
    tree, chain = closed.tree, closed.chain
    rows, sizes = motor_columns(tree), chain.tangent_scale[list(tree.motors)]
    kept = _independent(closed, rows, sizes)
    return _held(closed, rows, sizes, chain.motors, kept, False, ca.SX(tree.nv, 0))


def _independent(closed: ClosedTree, rows: ca.SX, sizes: FloatArray) -> list[int]:
    """Choose coordinates that together determine all, the first ones where these are nearly as safe as any others."""
    share = closed.values(closed.motions.T @ rows) * closed.motion_scale[:, None] / sizes
    rank = int(np.linalg.matrix_rank(share, tol=_ZERO).max())
    if rank == len(sizes):
        return list(range(rank))
    choices = list(itertools.islice(itertools.combinations(range(len(sizes)), rank), _CHOICES))
    safety = [np.linalg.svd(share[:, :, choice], compute_uv=False)[:, -1].min() for choice in choices]
    best = max(safety)
    return list(next(c for c, s in zip(choices, safety, strict=True) if s >= _NEARLY * best))


def _held(
    closed: ClosedTree,
    rows: ca.SX,
    sizes: FloatArray,
    names: tuple[str, ...],
    kept: list[int],
    on_platform: bool,
    idle: ca.SX,
) -> HeldMotion:
    chain = closed.chain
    loops = sorted(column for _, column in closed.reduced.pivots.places)
    matrix = ca.horzcat(closed.columns.transpose[:, loops], rows[:, kept])
    scale = np.concatenate([chain.row_sizes[loops], sizes[kept]])
    values = closed.values(matrix) * chain.tangent_scale[:, None] / scale
    pivots = plan_pivots(values, list(range(matrix.shape[1])))
    if pivots.columns:
        raise UnsupportedError(
            f"what would be held of {chain.name} ({', '.join(names[k] for k in kept)}) does not determine its motion "
            "to enough digits, so there are no derivatives by its geometry; use other coordinates"
        )
    reduced = Elimination(matrix, pivots)
    held = [chain.nc + k if on_platform else -1 for k in kept]
    return HeldMotion(
        closed, tuple(names[k] for k in kept), rows, on_platform, idle, reduced, (*loops, *held)
    )


def condition_columns(closed: ClosedTree, on_platform: bool) -> ca.SX:
    """Write all rows that may depend on the geometry.

    Parameters
    ----------
    closed
        The chain, as it is or displaced.
    on_platform
        Whether the platform's rows are among them.

    Returns
    -------
    casadi.SX
        (nv, nc or nc + 6) transpose of the rows.
    """
    loops = closed.columns.transpose
    return ca.horzcat(loops, platform_columns(closed)) if on_platform else loops


def condition_bias(closed: ClosedTree, on_platform: bool, v: ca.SX) -> ca.SX:
    """Write the accelerations of these rows that are there without joint acceleration.

    Parameters
    ----------
    closed
        The chain, as it is or displaced.
    on_platform
        Whether the platform's rows are among them.
    v
        (nv, 1) tangent velocity.

    Returns
    -------
    casadi.SX
        (nc or nc + 6, 1).
    """
    loops = tree_bias(closed, v)
    return ca.vertcat(loops, platform_bias(closed, v)) if on_platform else loops


def condition_gaps(displaced: ClosedTree, closed: ClosedTree, on_platform: bool) -> ca.SX:
    """Write how displacements open the loops and carry the platform away.

    Parameters
    ----------
    displaced
        The displaced chain.
    closed
        The chain as it is.
    on_platform
        Whether the platform's rows are among them.

    Returns
    -------
    casadi.SX
        (nc or nc + 6, 1) gaps of the rows as they are turned, and shift and rotation vector of the platform in world
        axes to the first order.
    """
    gaps = closed.columns.turn.T @ loop_gaps(displaced.tree, displaced.at, closed.q)
    if not on_platform:
        return gaps
    position, rotation = platform_placement(displaced)
    start, before = platform_placement(closed)
    turn = rotation @ before.T
    half = ca.vertcat(turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]) / 2
    return ca.vertcat(gaps, position - start, half)


# ----------------------------------------------------------------------------------------------------
# Which displacements of the geometry leave a mechanism, to the first order, and determine its dynamics
#
# Where loop rows are redundant, as in planar mechanisms, most displacements would lock it: a combination l of rows that
# vanishes, lᵀ J = 0, must not be opened, lᵀ ∂gap/∂g = 0 at every configuration. And where idle freedoms are left to
# themselves, as the spin of a rod between balls is, a displacement may make it matter where they stand, which neither
# platform nor motors tell.
# ----------------------------------------------------------------------------------------------------

_OPEN = 1e-8
"""Share of a displacement, in robot sizes and radians, that may open redundant rows: round-off of closed loops."""
_MATTERS = 1e-6
"""Share of the largest derivative by which it may depend on idle freedoms: what closing the loops again leaves."""
_AT_ONCE, _AT_MOST = 8, 64
"""Samples that are looked at together, until they tell nothing new, and of all."""


@dataclass(frozen=True, eq=False)
class MobileDisplacements:
    """Displacements along which there is a derivative.

    Attributes
    ----------
    obstacles
        (m, n) rows, dimensionless: combinations of the n displacements, in robot sizes and radians, that must vanish.
    sizes
        (n,) natural size of each displacement [m or rad].
    """

    obstacles: FloatArray
    sizes: FloatArray

    @property
    def alone(self) -> np.ndarray:
        """(n,) of bool, dimensionless: whether each displacement may be made by itself."""
        return np.logical_not(self.obstacles.any(axis=0))

    @property
    def basis(self) -> FloatArray:
        """(n, k) displacements that may be made [m or rad per unit]: single ones, then combinations.

        Each combination displaces one more parameter by 1 m or 1 rad, and others so that the mechanism moves.
        """
        count, alone = len(self.sizes), self.alone
        single = np.eye(count)[:, alone]
        rest = np.flatnonzero(~alone)
        if not rest.size:
            return single
        factors: Any = qr(self.obstacles[:, rest], mode="r", pivoting=True)
        upper, order = factors
        rank = len(self.obstacles)
        follow = -solve_triangular(upper[:rank, :rank], upper[:rank, rank:])
        leaders, followers = rest[order[rank:]], rest[order[:rank]]
        combined = np.zeros((count, len(leaders)))
        combined[leaders, np.arange(len(leaders))] = 1.0
        combined[followers] = np.where(np.abs(follow) > _OPEN, follow, 0.0)
        combined *= self.sizes[:, None] / self.sizes[leaders]
        return np.hstack([single, combined])

    def blocked(self, displacements: FloatArray) -> np.ndarray:
        """Tell which displacements may not be made.

        Parameters
        ----------
        displacements
            (n, k) columns of displacements [m or rad per unit].

        Returns
        -------
        numpy.ndarray
            (k,) of bool, dimensionless.
        """
        scaled = displacements / self.sizes[:, None]
        opened = np.abs(self.obstacles @ scaled).max(axis=0, initial=0.0)
        return opened > _MATTERS * np.abs(scaled).max(axis=0, initial=0.0)


def mobile_displacements(
    closed: ClosedTree, driven: DrivenTree | None, write: Callable[[], ca.Function], acting: FloatArray
) -> MobileDisplacements:
    """Find the displacements along which there is a derivative, on samples around home.

    Parameters
    ----------
    closed
        The chain, its loop rows eliminated.
    driven
        The same chain, driven; None for functions of whole states.
    write
        Writes the derivatives of inverse dynamics by the geometry, which are looked at where freedoms are idle.
    acting
        (n,) size of the wrenches from outside under which they are looked at [N, N m].

    Returns
    -------
    MobileDisplacements
        What may be displaced.
    """
    chain = closed.chain
    parameters = geometry_parameters(chain)
    sizes = np.array([chain.length_scale if p.unit == "m" else 1.0 for p in parameters])
    obstacles = np.zeros((0, len(sizes)))
    if closed.reduced.pivots.columns:
        obstacles = _spanned(_opened(closed, sizes), obstacles, _OPEN)
    if driven is not None and driven.idle.shape[1]:
        obstacles = _spanned(_undetermined(driven, write(), sizes, acting), obstacles, _MATTERS)
    return MobileDisplacements(obstacles, sizes)


def _spanned(rows: Iterator[FloatArray], known: FloatArray, tolerance: float) -> FloatArray:
    """Add rows until some samples in a row add nothing new; orthonormal."""
    without_news = 0
    touched = np.abs(known).max(axis=0, initial=0.0)
    for row in rows:
        touched = np.maximum(touched, np.abs(row).max(axis=0, initial=0.0))
        new = row - row @ known.T @ known
        _, s, right = np.linalg.svd(new, full_matrices=False)
        fresh = right[s > tolerance]
        without_news = 0 if len(fresh) else without_news + 1
        known = np.linalg.qr(np.vstack([known, fresh]).T)[0].T
        if without_news >= _AT_ONCE or len(known) == known.shape[1]:
            break
    # Displacements that no row touches are exactly free: what a small new direction has there is round-off, enlarged.
    known[:, touched < tolerance] = 0.0
    return known


def _opened(closed: ClosedTree, sizes: FloatArray) -> Iterator[FloatArray]:
    """How displacements open the redundant rows, sample by sample."""
    chain = closed.chain
    displaced, symbols = displaced_tree(closed)
    gaps = ca.jacobian(condition_gaps(displaced, closed, False), symbols)
    gaps = ca.substitute(gaps, symbols, ca.SX.zeros(*symbols.shape))
    function = ca.Function("rows", [closed.q], [ca.densify(closed.columns.transpose.T), ca.densify(gaps)])
    rank = len(closed.reduced.pivots.places)
    for q in _samples(chain):
        rows, opened = (np.array(x) / chain.row_sizes[:, None] for x in function(q))
        redundant = np.linalg.svd(rows * chain.tangent_scale)[0][:, rank:]
        yield redundant.T @ opened * sizes


def _undetermined(
    driven: DrivenTree, function: ca.Function, sizes: FloatArray, acting: FloatArray
) -> Iterator[FloatArray]:
    """How derivatives differ with where the idle freedoms stand, relative to the largest, sample by sample."""
    chain = driven.closed.chain
    rng = np.random.default_rng(0)
    for q in _samples(chain):
        freedom = chain.at(q).freedom
        v, a = (freedom.motions @ rng.normal(size=freedom.motions.shape[1]) for _ in range(2))
        moved = idle_moved(chain, q, freedom.idle @ rng.uniform(0.5, 1.0, freedom.idle.shape[1]))
        if driven.coordinates == "platform":
            state = chain.at(q, v)
            rows, bias = state.P, state.platform_bias
        else:
            rows, bias = chain.motor_rows, np.zeros(chain.nu)
        motion, loads = (rows @ v, rows @ a + bias), (acting * rng.normal(size=len(acting)),)
        none = (np.zeros(len(acting)),) if len(acting) else ()
        here, there = (np.array(function(x, *motion, *none)[0]) * sizes for x in (q, moved))
        yield (here - there) / np.abs(here).max()
        if acting.any():  # derivatives are linear in the wrenches: their share by itself
            shares = [
                np.array(function(x, *motion, *loads)[0]) * sizes - free
                for x, free in ((q, here), (moved, there))
            ]
            yield (shares[0] - shares[1]) / np.abs(shares[0]).max()


def _samples(chain: ClosedChain) -> Iterator[FloatArray]:
    for seed in range(1, 1 + _AT_MOST // _AT_ONCE):
        yield from closed_samples(chain, count=_AT_ONCE, seed=seed)
