"""What belongs to a mechanism: the ranks that loops, motors and platform have where it is nothing special.

They are found once per chain, at home and at closed configurations near it, each closed to the last bit. There the
singular values that belong to the mechanism and those of round-off are many orders of magnitude apart, and the widest
gap tells them apart; a threshold would have to know the mechanism.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from stewart_pin.state.freedom import TWIST_AXES, FreedomCount, Motions, TwistAxis, counted, split_motions
from stewart_pin.state.state import as_chain
from stewart_pin.tolerances import EPS, NOTHING
from stewart_pin.typing import Configuration, FloatArray

if TYPE_CHECKING:
    from stewart_pin.state.chain import ClosedChain
    from stewart_pin.state.state import State

_SAMPLES = 5
"""Random configurations near home."""
_TRIALS = 25
"""Displacements of home that are tried for them."""
_SPREAD = 0.1
"""How far from home they are drawn at first, in robot sizes and radians."""
_PATIENCE = 25
"""Newton steps after which a displacement counts as too far to close: near home it takes four to seven."""
_ROUND_OFF = 1e-13
"""Singular values below this are counted as this: what closing to the last bit leaves."""


@dataclass(frozen=True, eq=False)
class Generic:
    """The usual ranks and freedoms of a mechanism.

    Attributes
    ----------
    rank
        Number of independent loop rows.
    count
        Numbers of motions: of the loops, of the motors, of the platform.
    usual_loops, usual_motors, usual_platform, usual_passive
        Median over the samples of the smallest singular value that belongs to the loops, to the motors' share of the
        motions that are not idle, to the platform's share of all, and to both shares together; at most 1. Infinite
        where there is none, dimensionless.
    motors_determine
        Whether loop rows and motors are as many as the tangent has entries, and determine it.
    samples
        Closed configurations near home; home itself only where nothing else closed [m, rad, unit quaternions].
    """

    rank: int
    count: FreedomCount
    usual_loops: float
    usual_motors: float
    usual_platform: float
    usual_passive: float
    motors_determine: bool
    samples: tuple[Configuration, ...]


@dataclass(frozen=True, eq=False)
class _Shares:
    """At one configuration: motions of the loops, and the shares of motors and platform in them, natural units."""

    motions: Motions
    motors: FloatArray
    platform: FloatArray


def find_generic(chain: ClosedChain) -> Generic:
    """Find the usual ranks of a mechanism.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    Generic
        Ranks, sizes and samples.
    """
    samples = _samples(chain)
    states = [chain.at(q) for q in samples]
    rank = max(_rank_by_gap(_singular_values(state.rows), state.round_off) for state in states)
    shares = [_shares(state, rank) for state in states]
    count = _count(chain, shares, TWIST_AXES)
    active = [_active(share, count) for share in shares]
    return Generic(
        rank=rank,
        count=count,
        usual_loops=_usual([share.motions.values for share in shares], rank),
        usual_motors=_usual(
            [_singular_values(s.motors @ a) for s, a in zip(shares, active, strict=True)], count.motor
        ),
        usual_platform=_usual([_singular_values(s.platform) for s in shares], count.platform),
        usual_passive=_usual(
            [_singular_values(np.vstack([s.motors, s.platform])) for s in shares], count.either
        ),
        motors_determine=rank == chain.nc and count.either == count.dof == count.motor == chain.nu,
        samples=samples,
    )


def regularity(state: State, *, motors: bool = True) -> float:
    """Tell how regular a configuration is: near one as usual, zero at a singularity of loops, motors or platform.

    Parameters
    ----------
    state
        State of a closed chain.
    motors
        Whether a singularity of the motors alone counts.

    Returns
    -------
    float
        The smallest singular value that belongs to the loops, the motors or the platform, relative to its usual size.
    """
    usual = state.chain.generic
    share, count = _shares(state, usual.rank), usual.count
    held = np.vstack([share.motors, share.platform])
    found = [
        (share.motions.values, usual.rank, usual.usual_loops),
        (_singular_values(share.motors @ _active(share, count)), count.motor, usual.usual_motors),
        (_singular_values(share.platform), count.platform, usual.usual_platform),
        (_singular_values(held), count.either, usual.usual_passive),
    ]
    if not motors:
        del found[1]
    return min((float(values[rank - 1]) / size for values, rank, size in found if rank), default=1.0)


def generic_freedom(chain: ClosedChain, axes: Sequence[TwistAxis] = TWIST_AXES) -> FreedomCount:
    """Count the motions that a mechanism has at configurations that are nothing special.

    Parameters
    ----------
    chain
        Closed chain.
    axes
        Components of the twist that count as motion of the platform.

    Returns
    -------
    FreedomCount
        Motions of the loops, and how many of them motors and platform take part in.
    """
    as_chain(chain)
    counted(axes)
    usual = chain.generic
    if tuple(axes) == usual.count.axes:
        return usual.count
    return _count(chain, [_shares(chain.at(q), usual.rank) for q in usual.samples], axes)


def _samples(chain: ClosedChain) -> tuple[Configuration, ...]:
    """Close displacements of home, to the last bit; smaller ones where the larger do not close.

    In long chains of loops the ends of a displacement are many robot sizes apart: after one that does not close, the
    next go along the motions at home, and no joint moves farther than before.
    """
    from stewart_pin.state.newton import polish  # noqa: PLC0415 - which needs ranks where it is asked for them

    rng = np.random.default_rng(0)
    found: list[Configuration] = []
    spread, motions = _SPREAD, None
    for _ in range(_TRIALS):
        if len(found) == _SAMPLES:
            break
        step = rng.uniform(-spread, spread, chain.nv)
        if motions is not None:
            step = motions @ (motions.T @ step)
            step *= rng.uniform(0.3, 1.0) * spread / max(float(np.abs(step).max()), spread * EPS)
        q = pin.integrate(chain.model, chain.q_home, step * chain.tangent_scale)
        closure = polish(chain, q, max_iterations=_PATIENCE)
        if closure.success:
            found.append(closure.q)
            continue
        spread *= 0.7
        if motions is None:
            home = chain.at(chain.q_home)
            motions = split_motions(
                home.rows, _rank_by_gap(_singular_values(home.rows), home.round_off)
            ).basis
    return tuple(found) or (chain.q_home,)


def _shares(state: State, rank: int) -> _Shares:
    chain = state.chain
    motions = split_motions(state.rows, rank)
    if chain.platform is None:
        twist = np.eye(motions.basis.shape[1])  # then every motion is one of the mechanism, and none is idle
    else:
        twist = (state.P / chain.twist_sizes[:, None]) @ (chain.tangent_scale[:, None] * motions.basis)
    return _Shares(motions, motions.basis[chain.motor_index], twist)


def _count(chain: ClosedChain, shares: Sequence[_Shares], axes: Sequence[str]) -> FreedomCount:
    kept = counted(axes)[:, None]
    dof = shares[0].motions.basis.shape[1]

    def rank(matrices: list[FloatArray]) -> int:
        return max(_rank_by_gap(_singular_values(matrix)) for matrix in matrices)

    if chain.platform is None:
        return FreedomCount(dof, rank([s.motors for s in shares]), dof, dof, tuple(axes))
    return FreedomCount(
        dof=dof,
        motor=rank([s.motors for s in shares]),
        platform=rank([s.platform * kept for s in shares]),
        either=rank([np.vstack([s.motors, s.platform * kept]) for s in shares]),
        axes=tuple(axes),
    )


def _active(share: _Shares, count: FreedomCount) -> FloatArray:
    """Motions that are not idle, in coordinates of N: (dof, either)."""
    if not count.idle:
        return np.eye(count.dof)
    return np.linalg.svd(np.vstack([share.motors, share.platform]))[2][: count.either].T


def _singular_values(matrix: FloatArray) -> FloatArray:
    return np.linalg.svd(matrix, compute_uv=False) if matrix.size else np.zeros(0)


def _rank_by_gap(values: FloatArray, round_off: float = 0.0) -> int:
    """Count the singular values above the widest gap; none where all are round-off, of which there is more far away."""
    values = np.maximum(values, _ROUND_OFF)
    nothing = max(NOTHING, round_off)
    if not values.size or values[0] <= nothing:
        return 0
    ratios = values / np.append(values[1:], _ROUND_OFF)
    return int(np.argmax(np.where(values > nothing, ratios, 0.0))) + 1


def _usual(values: Sequence[FloatArray], rank: int) -> float:
    if rank == 0:
        return np.inf
    return min(1.0, float(np.median([v[rank - 1] for v in values])))
