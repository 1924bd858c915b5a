"""Loops as Pinocchio's own constraint models, for its constrained algorithms."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from stewart_pin.errors import UnsupportedError
from stewart_pin.model.description import JointKind
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import FloatArray

_TYPES = {JointKind.SPHERICAL: pin.ContactType.CONTACT_3D, JointKind.FIXED: pin.ContactType.CONTACT_6D}


def constraint_models(chain: ClosedChain) -> pin.StdVec_RigidConstraintModel:
    """Translate the loops for `pinocchio.constraintDynamics` and its relatives.

    Parameters
    ----------
    chain
        Closed chain whose loops are spherical or fixed: the two kinds Pinocchio has.

    Returns
    -------
    pinocchio.StdVec_RigidConstraintModel
        One model per loop, in loop frame 1. Their Jacobian is minus the derivative of `loop_gap`.

    Raises
    ------
    UnsupportedError
        If a loop is of another kind, or joints are coupled.
    """
    for coupling in chain.couplings:
        raise UnsupportedError(
            f"coupling '{coupling.name}' of joint '{coupling.joint1}' is not known to Pinocchio's constrained "
            "algorithms; use method='projection'"
        )
    table = chain.loop_table
    models = pin.StdVec_RigidConstraintModel()
    for k, loop in enumerate(chain.loops):
        if loop.kind not in _TYPES:
            raise UnsupportedError(
                f"loop '{loop.name}' is {loop.kind}; Pinocchio's constrained algorithms know spherical and fixed "
                "loops; use method='projection'"
            )
        models.append(
            pin.RigidConstraintModel(
                _TYPES[loop.kind],
                chain.model,
                table.joint1[k],
                pin.SE3(table.rotation1[k], table.translation1[k]),
                table.joint2[k],
                pin.SE3(table.rotation2[k], table.translation2[k]),
                pin.ReferenceFrame.LOCAL,
            )
        )
    return models


def reactions_from_pinocchio(chain: ClosedChain, lambda_c: FloatArray) -> FloatArray:
    """Translate the multipliers of `constraint_models` to the rows of the loops.

    Parameters
    ----------
    chain
        Closed chain whose loops are spherical or fixed.
    lambda_c
        (nc,) Pinocchio's multipliers: per loop a force, for fixed loops also a moment, in loop frame 1 [N, N m].

    Returns
    -------
    numpy.ndarray
        (nc,) multipliers of the loop rows, in the package's sign [N and N m].
    """
    table = chain.loop_table
    # Pinocchio's Jacobian is minus the derivative of the gap.
    reactions = -lambda_c
    # Normal rows are x, y, z in either convention; the angle rows of a closed loop turn about u2 × u1.
    axes = np.cross(table.angle.vector2, table.angle.vector1)
    for row, loop, axis in zip(table.angle.index, table.angle.loop, axes, strict=True):
        last = table.slices[loop].stop
        reactions[row] = -axis @ lambda_c[last - 3 : last]
    return reactions
