"""Loops of any configuration, closed or open: gap, Jacobian and bias for users; Pinocchio's own constraints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from stewart_pin.checks import as_array
from stewart_pin.errors import UnsupportedError
from stewart_pin.model.description import JointKind
from stewart_pin.state.state import State, as_chain, as_state
from stewart_pin.typing import ArrayLike, Configuration, FloatArray, Tangent

if TYPE_CHECKING:
    from stewart_pin.state.chain import ClosedChain


def loop_gap(chain: ClosedChain | State, q: ArrayLike | None = None) -> FloatArray:
    """Measure how far the loops are from closed.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration of the spanning tree, with a chain [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nc,) residual of 1M2, loop after loop, in loop frame 1 [m; angle rows are sines, dimensionless], then of the
        couplings [m or rad].
    """
    return as_state(chain, q).gap.copy()


def loop_jacobian(chain: ClosedChain | State, q: ArrayLike | None = None) -> FloatArray:
    r"""Differentiate the loop gap along the tangent of the spanning tree.

    The sign is that of a derivative, :math:`\dot\phi = J_c(q)\, v`, for every q, closed or open. Pinocchio's
    ``RigidConstraintModel`` has the opposite sign, its ``PointAnchorConstraintModel`` this one. Where the ends of a
    distance loop coincide, the distance has a kink and no derivative; its row is then that along x of frame 1.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration of the spanning tree, with a chain [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (nc, nv) rate of the gap, in loop frame 1, per tangent velocity [m/s and 1/s per m/s or rad/s].
    """
    return as_state(chain, q).J_c.copy()


def loop_bias(
    chain: ClosedChain | State, q: ArrayLike | None = None, v: ArrayLike | None = None
) -> FloatArray:
    r"""Compute the part of the gap's second derivative that is there without acceleration, :math:`\dot J_c v`.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration of the spanning tree, with a chain [m, rad, unit quaternions].
    v
        (nv,) tangent velocity, with a chain [m/s, rad/s].

    Returns
    -------
    numpy.ndarray
        (nc,) such that the gap's second derivative is ``loop_jacobian @ a + loop_bias`` [m/s² and 1/s²].

    Raises
    ------
    SingularityError
        If the ends of a distance loop coincide.
    """
    state = as_state(chain, q, v)
    return state.J_c_rate @ state.v  # a distance loop without direction is refused at rest, too


def loop_jacobian_rate(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    motions: ArrayLike | None = None,
) -> FloatArray:
    r"""Differentiate the loop Jacobian along a velocity, times some motions: :math:`\dot J_c(q, v)\, U`.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration of the spanning tree, with a chain [m, rad, unit quaternions].
    v
        (nv,) tangent velocity along which the chain moves, with a chain [m/s, rad/s].
    motions
        (nv, k) tangent vectors, U; default: the identity, for the whole matrix [m/s, rad/s].

    Returns
    -------
    numpy.ndarray
        (nc, k) in loop frame 1 [m/s² and 1/s²].

    Raises
    ------
    SingularityError
        If the ends of a distance loop coincide.
    """
    state = as_state(chain, q, v)
    rate = np.array(state.J_c_rate)
    return rate if motions is None else rate @ as_array("motions", motions, (state.chain.nv, None))


# ----------------------------------------------------------------------------------------------------
# Loops as Pinocchio's own constraint models, for its constrained algorithms
# ----------------------------------------------------------------------------------------------------

_PROXIMAL = pin.ProximalSettings(1e-14, 0.0, 1)
"""No regularisation, one step: the loops' rows are independent where these algorithms are used."""
_NEAR_MASSLESS = 1e-8
"""Share of a joint's inertia that is left to it while all others move freely, below which a body lacks mass."""
_TYPES = {JointKind.SPHERICAL: pin.ContactType.CONTACT_3D, JointKind.FIXED: pin.ContactType.CONTACT_6D}


class ConstrainedDynamics:
    """Memory of `pinocchio.constraintDynamics` for one chain; for one thread at a time.

    Its data are used for nothing else: other algorithms would leave desired accelerations behind in them.

    Parameters
    ----------
    chain
        Closed chain whose loops are spherical or fixed, and not redundant.
    """

    def __init__(self, chain: ClosedChain) -> None:
        self._unit, self._model = chain.mass_unit, chain.mass_model
        self._data, self._models = pin.Data(self._model), constraint_models(chain)
        self._datas = pin.StdVec_RigidConstraintData()
        for model in self._models:
            self._datas.append(model.createData())
        pin.initConstraintDynamics(self._model, self._data, self._models, self._datas)

    def accelerate(self, q: Configuration, v: Tangent, tau: Tangent) -> tuple[Tangent, FloatArray] | None:
        """Solve for acceleration and multipliers.

        Parameters
        ----------
        q
            (nq,) configuration [m, rad, unit quaternions].
        v
            (nv,) tangent velocity [m/s, rad/s].
        tau
            (nv,) joint efforts [N, N m].

        Returns
        -------
        a : numpy.ndarray
            (nv,) tangent acceleration [m/s², rad/s²].
        lambda_c : numpy.ndarray
            (nc,) Pinocchio's multipliers, see `reactions_from_pinocchio` [N, N m].

        None if the inertia matrix of the open loops is next to singular: the algorithm starts by its inverse.
        """
        data, unit = self._data, self._unit
        a = pin.constraintDynamics(self._model, data, q, v, tau / unit, self._models, self._datas, _PROXIMAL)
        # Elimination leaves every joint the inertia that it has while the joints above it move freely.
        left, own = data.constraint_chol.D[-self._model.nv :], data.M.diagonal()
        if not (left > _NEAR_MASSLESS * own).all():
            return None
        return np.array(a), unit * data.lambda_c


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
    as_chain(chain)
    unknown = unknown_to_pinocchio(chain)
    if unknown is not None:
        raise UnsupportedError(f"{unknown}; use method='projection'")
    table = chain.loop_table
    models = pin.StdVec_RigidConstraintModel()
    for k, loop in enumerate(chain.loops):
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


def unknown_to_pinocchio(chain: ClosedChain) -> str | None:
    """Find what Pinocchio's constrained algorithms do not know.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    str or None
        What it is, in words; None if they know all loops.
    """
    for coupling in chain.couplings:
        return (
            f"coupling '{coupling.name}' of joint '{coupling.joint1}' is not known to Pinocchio's constrained "
            "algorithms"
        )
    for loop in chain.loops:
        if loop.kind not in _TYPES:
            known = "Pinocchio's constrained algorithms know spherical and fixed loops"
            return f"loop '{loop.name}' is {loop.kind}; {known}"
    return None


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
    if table.only_normals:
        return reactions
    # Normal rows are x, y, z in either convention; the angle rows of a closed loop turn about u2 × u1.
    axes = np.cross(table.angle.vector2, table.angle.vector1)
    for row, loop, axis in zip(table.angle.index, table.angle.loop, axes, strict=True):
        last = table.slices[loop].stop
        reactions[row] = -axis @ lambda_c[last - 3 : last]
    return reactions
