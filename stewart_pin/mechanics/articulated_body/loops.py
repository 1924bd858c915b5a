"""Forward dynamics of chains with loops: the three passes, then the forces that keep the loops closed."""

from __future__ import annotations

import numpy as np

from stewart_pin.checks import as_array
from stewart_pin.errors import InputError
from stewart_pin.mechanics.articulated_body.base_motion import BaseMotion
from stewart_pin.mechanics.articulated_body.bodies import tree_bodies
from stewart_pin.mechanics.articulated_body.gears import coupling_rows, require_coupled
from stewart_pin.mechanics.articulated_body.loop_wrenches import LoopWrenches, loop_wrenches
from stewart_pin.mechanics.articulated_body.passes import first_pass, respond
from stewart_pin.mechanics.effort import Motion
from stewart_pin.model.chain import ClosedChain, as_configuration
from stewart_pin.typing import ArrayLike, FloatArray

_RANK = 1e-12
"""Singular values of the loops' inverse inertia below this, relative to the largest, belong to redundant rows: the
square of what counts as redundant in a Jacobian would drown in round-off."""
_CONSISTENT = 1e-6
"""How far a state may be from closed loops, relative to its size: round-off of user data, not a wrong state."""


def closed_chain_articulated_body(
    chain: ClosedChain,
    q: ArrayLike,
    v: ArrayLike,
    tau_motor: ArrayLike,
    *,
    base_motion: BaseMotion | None = None,
) -> Motion:
    """Compute the acceleration under given motor efforts, loops closed, by the articulated-body algorithm.

    An independent second opinion on `forward_dynamics`: neither joint-space inertia nor loop Jacobian is formed.

    Parameters
    ----------
    chain
        Closed chain whose bodies have mass.
    q
        (nq,) configuration with closed loops [m, rad, unit quaternions].
    v
        (nv,) tangent velocity that keeps them closed [m/s, rad/s].
    tau_motor
        (nu,) motor efforts in the order of ``chain.motors`` [N or N m].
    base_motion
        How the ground link moves; default: at rest. For a base that is free to move see `on_floating_base`.

    Returns
    -------
    Motion
        Acceleration and loop reactions (of least norm where loops are redundant).

    Raises
    ------
    InputError
        If an argument is wrong, or the state does not keep the loops closed.
    SingularityError
        If a joint moves nothing that has inertia.

    Notes
    -----
    The tree with open loops answers several load cases in the same passes: the state itself, and a unit wrench pair on
    each row of a loop (a pair of joint efforts for a coupling). With A the relative accelerations that these cause and
    b those of the state, the loop forces follow from A λ + b = 0 ([1]_, ch. 8, with responses instead of matrices).

    References
    ----------
    .. [1] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer, 2008.
    """
    q, v = as_configuration(chain, "q", q), as_array("v", v, (chain.nv,))
    tau_motor = as_array("tau_motor", tau_motor, (chain.nu,))
    base_velocity, base_acceleration = (base_motion or BaseMotion()).spatial(chain.gravity)
    bodies = tree_bodies(chain)
    motion = first_pass(bodies, q, v, base_velocity)
    loops = [loop_wrenches(loop, bodies, motion) for loop in chain.loops]
    _require_closed(chain, loops, v)
    gears = coupling_rows(chain, bodies, q, v)
    require_coupled(chain, gears, v)

    # Case 0 is the state with open loops, case k a unit force of row k alone, at rest and without gravity.
    cases = 1 + chain.nc
    tau = np.zeros((chain.nv, cases))
    tau[chain.motor_index, 0] = tau_motor
    bias, product = np.zeros((2, len(bodies), 6, cases))
    bias[:, :, 0], product[:, :, 0] = motion.bias, motion.velocity_product
    # A gear's unit force is a pair of joint efforts.
    tau[:, cases - gears.jacobian.shape[0] :] = gears.jacobian.T
    base = np.zeros((6, cases))
    base[:, 0] = base_acceleration
    start = 1
    for loop in loops:
        columns = slice(start, start + loop.gap.size)
        # External forces enter the bias with a minus sign; link 1 feels the opposite of link 2.
        bias[loop.body2][:, columns] -= loop.wrench2
        bias[loop.body1][:, columns] += loop.wrench1
        start = columns.stop
    response = respond(bodies, motion.to_parent, tau, bias, product, base)
    if not chain.nc:
        return Motion(a=np.ascontiguousarray(response.joint[:, 0]), lambda_c=np.zeros(0))
    relative = np.vstack(
        [
            *(x.wrench2.T @ response.body[x.body2] - x.wrench1.T @ response.body[x.body1] for x in loops),
            gears.jacobian @ response.joint,
        ]
    )
    open_loops = relative[:, 0] + np.concatenate([*(loop.bias for loop in loops), gears.bias])
    lambda_c = -np.linalg.lstsq(relative[:, 1:], open_loops, rcond=_RANK)[0]
    return Motion(a=response.joint[:, 0] + response.joint[:, 1:] @ lambda_c, lambda_c=lambda_c)


def _require_closed(chain: ClosedChain, loops: list[LoopWrenches], v: FloatArray) -> None:
    """Refuse a state that does not keep the loops closed."""
    speed = max(1.0, float(np.abs(v).max(initial=0.0)))
    for loop, wrenches in zip(chain.loops, loops, strict=True):
        for name, left, size in (("q", wrenches.gap, chain.length_scale), ("v", wrenches.rate, speed)):
            worst = float(np.abs(left).max(initial=0.0))
            if worst > _CONSISTENT * max(1.0, size):
                raise InputError(
                    f"{name} does not keep loop '{loop.name}' closed: {worst:.3g} is left over; "
                    "see close_loops and platform_motion"
                )
