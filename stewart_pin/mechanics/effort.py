"""What inverse and forward dynamics answer, whatever the method; and whether weight on a motion is more than digits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.brief import Brief
from stewart_pin.state.state import State
from stewart_pin.tolerances import PRINTED
from stewart_pin.typing import FloatArray, Tangent


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
        Whether the motor efforts are the only possible ones; otherwise they are the least-norm ones, in natural units:
        forces count by ``chain.length_scale``, moments by one.
    reactions_unique
        Whether the loop reactions are the only possible ones; otherwise they are the least-norm ones, counted likewise.
    a
        (nv,) acceleration that these efforts cause: the demand, but for idle freedoms, which obey their own inertia;
        idle freedoms without inertia, as the spins of massless legs, are left as near to the demand as can be
        [m/s², rad/s²].
    residual
        Largest part of the equation of motion that no motor and no reaction can supply [N or N m].
    band
        (nu, 2) least and greatest efforts that dry friction of joints at rest allows, `tau_motor` in their middle; None
        where no joint is held so [N or N m].
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
    return bool((np.abs(loads) <= PRINTED * _sizes(state, motions)).all())


def _sizes(state: State, motions: FloatArray) -> FloatArray:
    """Weight of each body, times how far its joint and its centre at the end of its arm are moved (k,) [N m]."""
    model, size = state.chain.model, np.zeros(motions.shape[1])
    data = pin.Data(model)
    pin.computeJointJacobians(model, data, state.q)
    gravity = float(np.linalg.norm(state.chain.gravity))
    for number, body in enumerate(model.inertias):
        if number == 0 or body.mass == 0.0:
            continue
        J = pin.getJointJacobian(model, data, number, pin.ReferenceFrame.LOCAL) @ motions
        arm = float(np.linalg.norm(body.lever))
        moved = np.linalg.norm(J[:3], axis=0) + arm * np.linalg.norm(J[3:], axis=0)
        size += body.mass * gravity * moved
    return size
