"""What inverse and forward dynamics answer, what joints give by themselves, and what weight is no more than digits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.brief import Brief
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import State, as_state
from stewart_pin.tolerances import PRINTED
from stewart_pin.typing import ArrayLike, FloatArray, Tangent


@dataclass(frozen=True, eq=False, repr=False)
class Effort(Brief):
    """Efforts that make a chain move as asked.

    Attributes
    ----------
    tau_motor
        (nu,) motor efforts, positive along the motor coordinate; for a leg, pushing the platform away [N or N m].
    lambda_c
        (nc,) loop reactions: what the closure does to link 2, row by row in loop frame 1 [N and N m].
    unique
        Whether the motor efforts are the only possible ones; otherwise they are the least-norm ones, or what `sharing`
        asked for, in natural units: forces count by ``chain.length_scale``, moments by one.
    reactions_unique
        Whether the loop reactions are the only possible ones; otherwise they are the least-norm ones, counted likewise.
    a
        (nv,) acceleration that these efforts cause: the demand, but for idle freedoms, which obey their own inertia;
        idle freedoms without inertia, as the spins of massless legs, are left as near to the demand as can be
        [m/s², rad/s²].
    residual
        Largest part of the equation of motion that no motor and no reaction can supply [N or N m].
    band
        (nu, 2) least and greatest efforts that dry friction of joints at rest allows, each with the others where they
        then have to be; `tau_motor` in their middle where friction has no idle freedoms to hold as well. None where no
        joint is held so [N or N m].
    """

    tau_motor: FloatArray
    lambda_c: FloatArray
    unique: bool
    reactions_unique: bool
    a: Tangent
    residual: float
    band: FloatArray | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Motion(Brief):
    """What a chain does under given efforts.

    Attributes
    ----------
    a
        (nv,) tangent acceleration [m/s², rad/s²].
    lambda_c
        (nc,) loop reactions: what the closure does to link 2, row by row in loop frame 1 [N and N m].
    """

    a: Tangent
    lambda_c: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class JointEfforts(Brief):
    """What joints give by themselves in a state, as efforts of the tree.

    Attributes
    ----------
    elastic
        (nv,) of springs and constant forces [N, N m].
    viscous
        (nv,) of damping [N, N m].
    dry
        (nv,) of dry friction of joints that move; those at rest give what equilibrium asks for [N, N m].
    energy
        Held by springs, and by constant forces counted from their rest position [J].
    dissipation
        Turned into heat by damping and dry friction, zero or more [W].
    """

    elastic: Tangent
    viscous: Tangent
    dry: Tangent
    energy: float
    dissipation: float


def joint_efforts(
    chain: ClosedChain | State, q: ArrayLike | None = None, v: ArrayLike | None = None
) -> JointEfforts:
    """Compute what the joints of a chain give by themselves: springs, damping, dry friction.

    Parameters
    ----------
    chain
        Closed chain, or a state of it; its loops may be open.
    q
        (nq,) configuration, with a chain [m, rad, unit quaternions].
    v
        (nv,) tangent velocity; default: rest [m/s, rad/s].

    Returns
    -------
    JointEfforts
        Efforts on the right of M a + nle = Sᵀ τ + J_cᵀ λ + these, their energy and what they turn into heat.

    Raises
    ------
    InputError
        If an argument has the wrong shape or is not finite.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> chain = stp.with_joint_physics(stp.load("five_bar"), {"left_knee": {"stiffness": 2.0, "rest": -0.5}})
    >>> stp.dynamics.joint_efforts(chain, chain.q_home).elastic.round(4)
    array([0.    , 0.4298, 0.    , 0.    ])
    """
    state = as_state(chain, q, v)
    effects, none = state.effects, np.zeros(state.chain.nv)
    if effects is None:
        return JointEfforts(none, none, none, 0.0, 0.0)
    dry = effects.efforts() - effects.smooth
    lost = -float((effects.viscous + dry) @ state.v)
    return JointEfforts(
        effects.elastic, effects.viscous, dry, state.chain.joint_effects.elastic_energy(state), lost
    )


# ----------------------------------------------------------------------------------------------------
# Whether what weight does to a motion that nothing holds is more than printed digits
# ----------------------------------------------------------------------------------------------------


def hangs(state: State, motions: FloatArray, loads: FloatArray) -> bool:
    """Tell whether loads on motions are what a few printed digits make of bodies that hang, or stand in balance.

    A rod that is round but for its sixth digit has some weight beside its axis. Its spin then accelerates, since next
    to nothing turns with it, and yet it is at rest as well as it was told.

    Parameters
    ----------
    state
        State of a chain.
    motions
        (nv, k) tangent vectors [m, rad].
    loads
        (k,) effort of the weight along each, that nothing balances [N m].

    Returns
    -------
    bool
        True if each is a small share of the weight of the bodies that the motion moves, at the arm by which it moves
        them.
    """
    return bool((np.abs(loads) <= PRINTED * weight_moved(state, motions)).all())


def weight_moved(state: State, motions: FloatArray) -> FloatArray:
    """Sum up the weight of each body, times how far a motion moves its joint and its centre at the end of its arm.

    Parameters
    ----------
    state
        State of a chain.
    motions
        (nv, k) tangent vectors [m, rad].

    Returns
    -------
    numpy.ndarray
        (k,) size of the efforts of weight along each, before they cancel [N m].
    """
    model, size = state.chain.model, np.zeros(motions.shape[1])
    data = pin.Data(model)
    pin.computeJointJacobians(model, data, state.q)
    gravity = float(np.linalg.norm(state.chain.gravity))
    for number, body in enumerate(model.inertias):
        if number == 0 or body.mass == 0.0:
            continue
        J = pin.getJointJacobian(model, data, number, pin.ReferenceFrame.LOCAL)
        J = J.reshape(6, -1) @ motions  # of one coordinate Pinocchio gives (6,)
        arm = float(np.linalg.norm(body.lever))
        moved = np.linalg.norm(J[:3], axis=0) + arm * np.linalg.norm(J[3:], axis=0)
        size += body.mass * gravity * moved
    return size
