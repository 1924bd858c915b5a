"""How many freedoms a mechanism has, which are idle, and whether its motors hold the rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import scipy.linalg

from stewart_pin.closure.equations import loop_jacobian
from stewart_pin.closure.newton import close_loops
from stewart_pin.mechanics.freedom import Freedom, analyse_freedom
from stewart_pin.model.chain import ClosedChain
from stewart_pin.typing import Configuration, FloatArray

_SAMPLES = 4
_SPREAD = 0.1
"""How far from home the samples are drawn, in robot sizes and radians."""
_REST = 1e-8
"""Velocities below this count as rest, relative to the largest."""


@dataclass(frozen=True)
class Mobility:
    """Freedoms of a mechanism.

    Attributes
    ----------
    dof
        Number of independent motions that keep the loops closed, at a generic configuration.
    idle
        One readable name per idle freedom: a motion that moves neither motors nor platform.
    redundant_rows
        Number of loop equations that follow from the others.
    motors_sufficient
        Whether the motors hold everything but the idle freedoms.
    redundant
        Names of loop rows that follow from the ones before them.
    lost
        Number of motions of the platform that locked motors leave.
    home_singular
        Whether home has more freedoms, or holds less, than nearby configurations.
    """

    dof: int
    idle: tuple[str, ...]
    redundant_rows: int
    motors_sufficient: bool
    redundant: tuple[str, ...]
    lost: int
    home_singular: bool


def mobility(chain: ClosedChain) -> Mobility:
    """Count the freedoms of a mechanism at home and at seeded random configurations near it.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    Mobility
        The generic numbers; ``home_singular`` tells when home differs.
    """
    home = analyse_freedom(chain, chain.q_home)
    candidates = [(chain.q_home, home)]
    rng = np.random.default_rng(0)
    for _ in range(_SAMPLES):
        nearby = pin.integrate(
            chain.model, chain.q_home, rng.uniform(-_SPREAD, _SPREAD, chain.nv) * chain.tangent_scale
        )
        closure = close_loops(chain, nearby, throw=False)
        if closure.success:
            candidates.append((closure.q, analyse_freedom(chain, closure.q)))
    # A generic configuration has the fewest freedoms, and among these the fewest lost ones.
    q, generic = min(candidates, key=lambda c: (c[1].motions.shape[1], c[1].lost.shape[1]))
    return Mobility(
        dof=generic.motions.shape[1],
        idle=_idle_names(chain, q, generic),
        redundant_rows=chain.nc - generic.rank,
        motors_sufficient=generic.lost.shape[1] == 0,
        redundant=_redundant_rows(chain, q, generic.rank),
        lost=generic.lost.shape[1],
        home_singular=(home.motions.shape[1], home.lost.shape[1])
        != (generic.motions.shape[1], generic.lost.shape[1]),
    )


def _redundant_rows(chain: ClosedChain, q: Configuration, rank: int) -> tuple[str, ...]:
    if rank == chain.nc:
        return ()
    # Pivoted QR of the transpose picks `rank` independent rows; the others follow from them.
    rows = loop_jacobian(chain, q) * chain.tangent_scale
    pivots = np.asarray(scipy.linalg.qr(rows.T, pivoting=True)[-1])
    return tuple(chain.loop_table.names[k] for k in sorted(pivots[rank:]))


def _idle_names(chain: ClosedChain, q: Configuration, freedom: Freedom) -> tuple[str, ...]:
    # In robot sizes, so that the unit of length does not decide which vectors make the basis.
    scale = chain.tangent_scale[:, None]
    return tuple(_describe(chain, q, motion) for motion in (scale * _sparse_basis(freedom.idle / scale)).T)


def _sparse_basis(columns: FloatArray) -> FloatArray:
    """Reduce an orthonormal basis: each vector has one coordinate to itself, and moves few joints.

    Pivots are the rows of largest norm, which no rotation of the basis changes: the result does not depend on it.
    """
    count = columns.shape[1]
    if not count:
        return columns
    order = np.asarray(scipy.linalg.qr(columns.T, mode="r", pivoting=True)[-1])
    return columns @ np.linalg.inv(columns[np.sort(order[:count])])


def _describe(chain: ClosedChain, q: Configuration, motion: FloatArray) -> str:
    """Name a motion by the links that move and the way they move."""
    model, data = chain.model, pin.Data(chain.model)
    pin.forwardKinematics(model, data, q, motion)
    pin.updateFramePlacements(model, data)
    twists: dict[str, FloatArray] = {}
    for link in chain.mechanism.links:
        frame = model.getFrameId(link.name, pin.FrameType.BODY)
        twist = pin.getFrameVelocity(model, data, frame, pin.ReferenceFrame.WORLD).vector.copy()
        twist[:3] /= chain.length_scale
        if np.abs(twist).max() > _REST * np.abs(motion / chain.tangent_scale).max():
            twists[link.name] = twist
    bodies = [name for name in twists if chain.mechanism.link(name).inertia is not None] or list(twists)
    first = twists[bodies[0]]
    together = all(np.allclose(twists[name], first, atol=_REST) for name in bodies)
    # A screw without pitch: v · ω = 0.
    spins = together and np.linalg.norm(first[3:]) > _REST and abs(first[:3] @ first[3:]) < _REST
    if not spins:
        return f"{', '.join(bodies)}: move with motors and platform at rest"
    for number, motor in enumerate(chain.motors, start=1):
        joint = chain.mechanism.joint(motor)
        if joint.parent in bodies or joint.child in bodies:
            return f"leg {number}: spin about its axis"
    return f"{', '.join(bodies)}: spin about its axis"
