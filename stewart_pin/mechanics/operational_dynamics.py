r"""The equation of motion in the coordinates of a controller, for any chain.

With v = G x_rate + R w, where R spans the motions that the coordinates leave at rest, and Rᵀ M G = 0, the equation
of motion of the spanning tree times Gᵀ loses loop reactions and idle freedoms:

.. math:: M_x \ddot x + C_x \dot x + g_x = (S G)^\top \tau, \qquad M_x = G^\top M G, \quad
          C_x = G^\top (M \dot G + C G), \quad g_x = G^\top g,

where C is the Coriolis matrix of the tree with :math:`\dot M = C + C^\top`, hence :math:`\dot M_x = C_x + C_x^\top`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.mechanics.coordinates import rows_rate
from stewart_pin.mechanics.motion_map import MotionMap, SolvedMap
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import State, as_state
from stewart_pin.typing import ArrayLike, FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class OperationalDynamics(Brief):
    """M x_acceleration + c + g = effort of each coordinate.

    Motor coordinates have the motor efforts on the right, platform coordinates the wrench (or its components along
    the basis), any coordinates ``motion.share.T @ tau_motor``.

    Attributes
    ----------
    motion
        The map that stands behind it, with the coordinates and their rates.
    M
        (n, n) inertia, symmetric [kg, kg m, kg m²].
    C
        (n, n) Coriolis matrix; the rate of M is C + Cᵀ, so M's rate less 2 C is skew [kg/s, kg m/s, kg m²/s].
    c
        (n,) Coriolis and centrifugal efforts: ``C @ motion.rate``, and what idle freedoms that turn add [N or N m].
    g
        (n,) efforts against gravity [N or N m].
    """

    motion: MotionMap
    M: FloatArray
    C: FloatArray
    c: FloatArray
    g: FloatArray


def operational_dynamics(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    *,
    coordinates: str | Sequence[str] | ArrayLike = "motor",
) -> OperationalDynamics:
    """Write the equation of motion of a chain in motor, joint or platform coordinates.

    Parameters
    ----------
    chain
        Closed chain, or a state of it; redundant loops and idle freedoms are no special case.
    q
        (nq,) configuration with closed loops, with a chain [m, rad, unit quaternions].
    v
        (nv,) tangent velocity that keeps them closed; default: rest [m/s, rad/s].
    coordinates
        As in `motion_map` [m/s, rad/s].

    Returns
    -------
    OperationalDynamics
        Inertia, Coriolis matrix and efforts, gravity efforts.

    Raises
    ------
    ActuationError
        If motors or joints do not determine the motion; carries the freedom left over.
    SingularityError
        If the coordinates depend on each other; proposes independent ones.
    InputError
        If the state does not keep the loops closed, or the coordinates are unknown.

    Notes
    -----
    The equation holds whatever acts on the motions in ``motion.rest``, because G is orthogonal to them in the metric
    of the inertia. With a redundant arm's twist as coordinates, M is the operational-space inertia of [1]_.

    References
    ----------
    .. [1] O. Khatib, "A unified approach for motion and force control of robot manipulators: the operational space
       formulation", IEEE Journal on Robotics and Automation 3(1), 1987, eq. (50).

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> stp.operational_dynamics(chain, chain.q_home).g.round(2)  # what the legs carry
    array([49.99, 49.99, 49.99, 49.99, 49.99, 49.99])
    """
    state = as_state(chain, q, v)
    solved = SolvedMap(state, coordinates)
    motion, scale, sizes = solved.record(), solved.scale, solved.chosen.sizes
    coriolis = scale[:, None] * state.coriolis * scale
    G, inertia = solved.G, solved.inertia
    own = scale[:, None] * G
    turning = np.concatenate([state.J_c_rate @ own, rows_rate(state, solved.chosen) @ own])
    # Up to motions of the rest, which M G does not see: Gᵀ M R = 0.
    G_rate = solved.follow(-turning)

    across = np.outer(sizes, sizes)
    M = G.T @ inertia @ G / across
    inertial = inertia @ (motion.gamma / scale)
    return OperationalDynamics(
        motion=motion,
        M=(M + M.T) / 2,
        C=G.T @ (inertia @ G_rate + coriolis @ G) / across,
        c=G.T @ (inertial + scale * (state.nle - state.weight)) / sizes,
        g=motion.G.T @ state.weight,
    )
