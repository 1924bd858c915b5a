"""How many freedoms a mechanism has, which are idle, and whether its motors hold the rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import scipy.linalg

from stewart_pin.brief import Brief
from stewart_pin.mechanics.motor_sets import analyse_motors
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import State, as_chain
from stewart_pin.tolerances import SINGULAR
from stewart_pin.typing import FloatArray

_REST = 1e-8
"""Velocities below this count as rest, relative to the largest."""


@dataclass(frozen=True, repr=False)
class Mobility(Brief):
    """Freedoms of a mechanism, what its loops repeat, and what its motors are good for.

    The numbers belong to the mechanism: they hold at configurations that are nothing special.

    Attributes
    ----------
    dof
        Number of independent motions that keep the loops closed, at a generic configuration.
    idle
        One readable name per idle freedom: a motion that moves neither motors nor platform. Where only these are given,
        idle freedoms carry no momentum and follow their own inertia, see `platform_motion`.
    redundant_rows
        Number of equations of loops and couplings that follow from the others.
    motors_sufficient
        Whether the motors hold everything but the idle freedoms.
    redundant
        Names of as many rows that follow from the others; which ones is a choice.
    lost
        Number of motions of the platform that locked motors leave.
    home_singular
        Whether home has more freedoms, or its motors hold less, than usual.
    dof_home
        Number of motions at home.
    dof_samples
        Number of motions at each of the random configurations near home that were looked at; of home where no other
        one closed.
    surplus_motors
        Number of motors beyond those that move independently of each other.
    spare_motors
        Sets of as many motors that could be left out together, at most 64 of them.
    free_joints
        Joints that take part in motions of the platform with all motors locked.
    suggestion
        Motors that hold the robot: the given ones where they do; empty where no joints with one freedom can.
    verdict
        The motors in a word: ``"sufficient"``, ``"redundant"`` where they hold the robot with some to spare,
        ``"wrongly chosen"`` where the suggestion needs no more of them, or else ``"too few"``.
    """

    dof: int
    idle: tuple[str, ...]
    redundant_rows: int
    motors_sufficient: bool
    redundant: tuple[str, ...]
    lost: int
    home_singular: bool
    dof_home: int
    dof_samples: tuple[int, ...]
    surplus_motors: int
    spare_motors: tuple[tuple[str, ...], ...]
    free_joints: tuple[str, ...]
    suggestion: tuple[str, ...]
    verdict: str


def mobility(chain: ClosedChain) -> Mobility:
    """Count the freedoms of a mechanism at home and at seeded random configurations near it.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    Mobility
        The generic numbers; ``home_singular`` tells when home differs, ``dof_samples`` what was seen elsewhere.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> found = stp.mobility(stp.load("five_bar", motors=["left_hip"]))
    >>> found.dof, found.verdict, found.free_joints, found.suggestion
    (2, 'too few', ('left_knee', 'right_hip', 'right_knee'), ('left_hip', 'right_hip'))
    """
    as_chain(chain)
    usual = chain.generic
    home, samples = chain.at(chain.q_home), [chain.at(q) for q in usual.samples]
    # The state that is farthest from singular shows most clearly who takes part in what.
    state = max(samples, key=lambda s: min(s.motions.smallest, s.freedom.smallest_singular_value))
    motors = analyse_motors(state)
    lost = usual.count.uncontrolled
    verdict = "redundant" if motors.surplus else "sufficient"
    if lost:
        verdict = "wrongly chosen" if 0 < len(motors.suggestion) <= chain.nu else "too few"
    return Mobility(
        dof=usual.count.dof,
        idle=_idle_names(state),
        redundant_rows=chain.nc - usual.rank,
        motors_sufficient=lost == 0,
        redundant=_redundant_rows(state),
        lost=lost,
        home_singular=_motions(home) > usual.count.dof or home.freedom.lost.shape[1] > lost,
        dof_home=_motions(home),
        dof_samples=tuple(_motions(sample) for sample in samples),
        surplus_motors=motors.surplus,
        spare_motors=motors.spare,
        free_joints=motors.free_joints,
        suggestion=motors.suggestion,
        verdict=verdict,
    )


def _motions(state: State) -> int:
    """Count the motions at a configuration: the usual ones, and those that a singularity of the loops adds."""
    usual = state.chain.generic
    gained = np.count_nonzero(state.motions.values < SINGULAR * usual.usual_loops)
    return usual.count.dof + int(gained)


def _redundant_rows(state: State) -> tuple[str, ...]:
    chain, rank = state.chain, state.chain.generic.rank
    if rank == chain.nc:
        return ()
    # Pivoted QR of the transpose picks `rank` independent rows; the others follow from them.
    pivots = np.asarray(scipy.linalg.qr(state.rows.T, pivoting=True)[-1])
    return tuple(chain.loop_table.names[k] for k in sorted(pivots[rank:]))


def _idle_names(state: State) -> tuple[str, ...]:
    # In robot sizes, so that the unit of length does not decide which vectors make the basis.
    chain = state.chain
    scale = chain.tangent_scale[:, None]
    basis = scale * _sparse_basis(state.freedom.idle / scale)
    return tuple(_describe(chain, state.q, motion) for motion in basis.T)


def _sparse_basis(columns: FloatArray) -> FloatArray:
    """Reduce an orthonormal basis: each vector has one coordinate to itself, and moves few joints.

    Pivots are the rows of largest norm, which no rotation of the basis changes: the result does not depend on it.
    """
    count = columns.shape[1]
    if not count:
        return columns
    order = np.asarray(scipy.linalg.qr(columns.T, mode="r", pivoting=True)[-1])
    return columns @ np.linalg.inv(columns[np.sort(order[:count])])


def _describe(chain: ClosedChain, q: FloatArray, motion: FloatArray) -> str:
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
