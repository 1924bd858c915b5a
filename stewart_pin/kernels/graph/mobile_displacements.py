"""Which displacements of the geometry leave a mechanism, to the first order, and determine its dynamics.

Where loop rows are redundant, as in planar mechanisms, most displacements would lock it: a combination l of rows that
vanishes, lᵀ J = 0, must not be opened, lᵀ ∂gap/∂g = 0 at every configuration. And where idle freedoms are left to
themselves, as the spin of a rod between balls is, a displacement may make it matter where they stand, which neither
platform nor motors tell.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from scipy.linalg import qr, solve_triangular

from stewart_pin.kernels.graph.displaced_tree import displaced_tree
from stewart_pin.kernels.graph.driven_tree import DrivenTree
from stewart_pin.kernels.graph.held_motion import condition_gaps
from stewart_pin.kernels.graph.whole_tree import ClosedTree
from stewart_pin.kernels.planning.idle_freedoms import idle_moved
from stewart_pin.kernels.planning.samples import closed_samples
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.geometry_parameters import geometry_parameters
from stewart_pin.typing import FloatArray

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
    closed: ClosedTree, driven: DrivenTree | None, write: Callable[[], ca.Function]
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
        obstacles = _spanned(_undetermined(driven, write(), sizes), obstacles, _MATTERS)
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


def _undetermined(driven: DrivenTree, function: ca.Function, sizes: FloatArray) -> Iterator[FloatArray]:
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
        here, there = (np.array(function(x, rows @ v, rows @ a + bias)[0]) * sizes for x in (q, moved))
        yield (here - there) / np.abs(here).max()


def _samples(chain: ClosedChain) -> Iterator[FloatArray]:
    for seed in range(1, 1 + _AT_MOST // _AT_ONCE):
        yield from closed_samples(chain, count=_AT_ONCE, seed=seed)
