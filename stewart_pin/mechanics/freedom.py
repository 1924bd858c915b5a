"""Which motions the loops leave, which of them the motors hold, and which move nothing that matters.

One singular value decomposition each: N spans the motions that keep the loops closed (J_c N = 0); of these, the ones
with locked motors are *idle* when the platform rests, and a *lost* freedom when it moves. All decompositions see
lengths in robot sizes, so that the unit of length decides nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stewart_pin.closure.equations import row_sizes
from stewart_pin.closure.newton import RANK
from stewart_pin.mechanics.platform import motion_matrix
from stewart_pin.model.chain import ClosedChain
from stewart_pin.typing import Configuration, FloatArray


@dataclass(frozen=True, eq=False)
class Freedom:
    """Motions of a chain at one configuration. Each basis is orthonormal when lengths are measured in robot sizes.

    Attributes
    ----------
    motions
        (nv, dof) basis of the motions that keep the loops closed, N [m, rad].
    idle
        (nv, n) basis of those that move neither motors nor platform [m, rad].
    lost
        (nv, n) motions with locked motors that move the platform, orthogonal to the idle ones [m, rad].
    rank
        Rank of the loop Jacobian.
    smallest_singular_value
        Of the motors' share of all motions but the idle ones, lengths in robot sizes; near zero at a singularity.
    weakest
        (nv,) the motion that the motors resist least [m, rad].
    """

    motions: FloatArray
    idle: FloatArray
    lost: FloatArray
    rank: int
    smallest_singular_value: float
    weakest: FloatArray


def analyse_freedom(chain: ClosedChain, q: Configuration) -> Freedom:
    """Split the motions at a configuration.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration with closed loops [m, rad, unit quaternions].

    Returns
    -------
    Freedom
        The motions, sorted.
    """
    scale = chain.tangent_scale
    sizes = np.concatenate([row_sizes(chain), np.full(3, chain.length_scale), np.ones(3)])
    matrix = motion_matrix(chain, q) * scale / sizes[:, None]
    jacobian, platform = matrix[: chain.nc], matrix[chain.nc :]
    motors = np.eye(chain.nv)[chain.motor_index]
    free, rank = null_space(jacobian)
    resting, _ = null_space(np.vstack([motors, platform]) @ free)
    idle = free @ resting
    # What the motors must hold: the free motions without the idle ones.
    held = free @ null_space(resting.T)[0] if resting.shape[1] else free
    # Padded with zero rows, so that every column of `held` has its singular value and vector.
    share = np.vstack([motors @ held, np.zeros((max(0, held.shape[1] - chain.nu), held.shape[1]))])
    _, s, vt = np.linalg.svd(share)
    lost = held @ vt[np.count_nonzero(s > RANK * max(1.0, s[0] if s.size else 0.0)) :].T
    weakest = held @ vt[-1] if s.size else np.zeros(chain.nv)
    column = scale[:, None]
    return Freedom(
        motions=free * column,
        idle=idle * column,
        lost=lost * column,
        rank=rank,
        smallest_singular_value=float(s[-1]) if s.size else np.inf,
        weakest=weakest * scale,
    )


def null_space(matrix: FloatArray) -> tuple[FloatArray, int]:
    """Find an orthonormal basis of the null space, and the rank.

    Parameters
    ----------
    matrix
        (m, n) any matrix, dimensionless entries.

    Returns
    -------
    basis : numpy.ndarray
        (n, n - rank) orthonormal columns, dimensionless.
    rank : int
        Number of singular values above round-off.
    """
    if 0 in matrix.shape:
        return np.eye(matrix.shape[1]), 0
    _, s, vt = np.linalg.svd(matrix)
    rank = int(np.count_nonzero(s > RANK * s[0])) if s[0] > 0 else 0
    return vt[rank:].T, rank
