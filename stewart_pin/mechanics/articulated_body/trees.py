"""Forward dynamics of trees: serial arms, spanning trees, fixed, prescribed or free-floating base."""

from __future__ import annotations

import numpy as np

from stewart_pin.checks import as_array
from stewart_pin.mechanics.articulated_body.bodies import tree_bodies
from stewart_pin.mechanics.articulated_body.passes import BaseMotion, first_pass, respond
from stewart_pin.state.chain import ClosedChain, as_configuration
from stewart_pin.state.state import as_chain
from stewart_pin.typing import ArrayLike, Tangent


def articulated_body_acceleration(
    chain: ClosedChain, q: ArrayLike, v: ArrayLike, tau: ArrayLike, *, base_motion: BaseMotion | None = None
) -> Tangent:
    """Compute the acceleration of the spanning tree by the articulated-body algorithm.

    Loops are left open; `closed_chain_articulated_body` closes them.

    Parameters
    ----------
    chain
        Chain; a serial arm is one without loops.
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].
    tau
        (nv,) efforts of all tree joints, not of the motors only [N, N m].
    base_motion
        How the ground link moves; default: at rest. For a base that is free to move see `on_floating_base`.

    Returns
    -------
    numpy.ndarray
        (nv,) tangent acceleration [m/s², rad/s²].

    Raises
    ------
    InputError
        If an argument has the wrong shape or is not finite.
    SingularityError
        If a joint moves nothing that has inertia.

    Notes
    -----
    Three passes: outwards for velocities and bias forces, inwards for the inertia that each subtree shows at its joint,
    outwards again for the accelerations. The cost is proportional to the number of bodies.

    References
    ----------
    .. [1] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer, 2008, table 7.1.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> arm = stp.load("arm_3r_planar", gravity=(0, -9.81, 0))
    >>> rest = np.zeros(3)
    >>> stp.articulated_body_acceleration(arm, rest, rest, rest).round(3)
    array([-25.628,  35.802, -18.032])
    """
    as_chain(chain)
    q, v = as_configuration(chain, "q", q), as_array("v", v, (chain.nv,))
    tau = as_array("tau", tau, (chain.nv,))
    base_velocity, base_acceleration = (base_motion or BaseMotion()).spatial(chain.gravity)
    bodies = tree_bodies(chain)
    motion = first_pass(bodies, q, v, base_velocity)
    response = respond(
        bodies,
        np.array(chain.model.armature),
        motion.to_parent,
        tau[:, None],
        motion.bias[:, :, None],
        motion.velocity_product[:, :, None],
        base_acceleration[:, None],
    )
    return np.ascontiguousarray(response.joint[:, 0])
