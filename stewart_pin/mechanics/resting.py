"""Whether what weight does to a motion that nothing holds is more than printed digits."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from stewart_pin.state.state import State
from stewart_pin.tolerances import PRINTED
from stewart_pin.typing import FloatArray


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
