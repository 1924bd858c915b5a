"""Which motions the loops leave, which of them the motors hold, and which move nothing that matters.

One singular value decomposition each: N spans the motions that keep the loops closed (J_c N = 0); of these, the ones
with locked motors are *idle* when the platform rests, and a *lost* freedom when it moves. All decompositions see
lengths in robot sizes, so that the unit of length decides nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stewart_pin.closure.equations import row_sizes
from stewart_pin.closure.newton import RANK
from stewart_pin.errors import InputError
from stewart_pin.mechanics.platform import motion_matrix
from stewart_pin.model.chain import ClosedChain
from stewart_pin.typing import Configuration, FloatArray

TWIST_AXES = ("vx", "vy", "vz", "wx", "wy", "wz")
"""Components of the platform's twist, in world axes."""


@dataclass(frozen=True)
class FreedomCount:
    """Numbers of motions at one configuration, or at the usual ones.

    Attributes
    ----------
    dof
        Independent motions that keep the loops closed.
    motor
        How many independent ways the motors move.
    platform
        How many independent ways the platform moves.
    either
        How many independent ways motors and platform move, taken together.
    axes
        Components of the twist that count as motion of the platform, of `TWIST_AXES`.
    """

    dof: int
    motor: int
    platform: int
    either: int
    axes: tuple[str, ...] = TWIST_AXES

    @property
    def uncontrolled(self) -> int:
        """Motions of the platform while all motors are at rest."""
        return self.either - self.motor

    @property
    def inner(self) -> int:
        """Motions of the motors while the platform is at rest."""
        return self.either - self.platform

    @property
    def idle(self) -> int:
        """Motions while motors and platform are at rest."""
        return self.dof - self.either


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
    count
        Numbers of motions, of the motors and of the platform.
    """

    motions: FloatArray
    idle: FloatArray
    lost: FloatArray
    rank: int
    smallest_singular_value: float
    weakest: FloatArray
    count: FreedomCount


def analyse_freedom(
    chain: ClosedChain, q: Configuration, *, tolerance: float = RANK, axes: Sequence[str] = TWIST_AXES
) -> Freedom:
    """Split the motions at a configuration.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration with closed loops [m, rad, unit quaternions].
    tolerance
        Singular values below this, relative to the largest or to one, count as zero.
    axes
        Components of the twist that count as motion of the platform.

    Returns
    -------
    Freedom
        The motions, sorted.
    """
    scale = chain.tangent_scale
    sizes = np.concatenate([row_sizes(chain), np.full(3, chain.length_scale), np.ones(3)])
    matrix = motion_matrix(chain, q) * scale / sizes[:, None]
    jacobian, platform = matrix[: chain.nc], matrix[chain.nc :] * counted(axes)[:, None]
    motors = np.eye(chain.nv)[chain.motor_index]
    free, rank = null_space(jacobian, tolerance)
    resting, _ = null_space(np.vstack([motors, platform]) @ free, tolerance)
    idle = free @ resting
    # What the motors must hold: the free motions without the idle ones.
    held = free @ null_space(resting.T)[0] if resting.shape[1] else free
    # Padded with zero rows, so that every column of `held` has its singular value and vector.
    share = np.vstack([motors @ held, np.zeros((max(0, held.shape[1] - chain.nu), held.shape[1]))])
    _, s, vt = np.linalg.svd(share)
    driven = _above(s, tolerance)
    lost = held @ vt[driven:].T
    weakest = held @ vt[-1] if s.size else np.zeros(chain.nv)
    column = scale[:, None]
    return Freedom(
        motions=free * column,
        idle=idle * column,
        lost=lost * column,
        rank=rank,
        smallest_singular_value=float(s[-1]) if s.size else np.inf,
        weakest=weakest * scale,
        count=FreedomCount(
            dof=free.shape[1],
            motor=driven,
            platform=_rank(platform @ free, tolerance),
            either=held.shape[1],
            axes=tuple(axes),
        ),
    )


def counted(axes: Sequence[str]) -> FloatArray:
    """Mark components of a twist.

    Parameters
    ----------
    axes
        Names, of `TWIST_AXES`.

    Returns
    -------
    numpy.ndarray
        (6,) of 1 and 0, dimensionless.

    Raises
    ------
    InputError
        If a name is none of them, or there is none.
    """
    if isinstance(axes, str) or not axes or not set(axes) <= set(TWIST_AXES):
        raise InputError(f"axes must be some of {', '.join(TWIST_AXES)}, got {axes!r}")
    return np.array([float(name in axes) for name in TWIST_AXES])


def null_space(matrix: FloatArray, tolerance: float = RANK) -> tuple[FloatArray, int]:
    """Find an orthonormal basis of the null space, and the rank.

    Parameters
    ----------
    matrix
        (m, n) any matrix, dimensionless entries.
    tolerance
        Singular values below this, relative to the largest, count as zero.

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
    rank = int(np.count_nonzero(s > tolerance * s[0])) if s[0] > 0 else 0
    return vt[rank:].T, rank


def _rank(matrix: FloatArray, tolerance: float) -> int:
    """Rank of a matrix of motions: one that is small altogether, as of a platform at a dead point, has none."""
    return _above(np.linalg.svd(matrix, compute_uv=False), tolerance) if matrix.size else 0


def _above(s: FloatArray, tolerance: float) -> int:
    return int(np.count_nonzero(s > tolerance * max(1.0, s[0] if s.size else 0.0)))
