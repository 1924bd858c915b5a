"""Forward dynamics of chains with loops: the three passes, then the forces that keep the loops closed."""

from __future__ import annotations

import numpy as np

from stewart_pin.checks import as_array
from stewart_pin.errors import InputError
from stewart_pin.mechanics.articulated_body.base_motion import BaseMotion
from stewart_pin.mechanics.articulated_body.bodies import tree_bodies
from stewart_pin.mechanics.articulated_body.gears import coupling_rows
from stewart_pin.mechanics.articulated_body.loop_wrenches import loop_wrenches
from stewart_pin.mechanics.articulated_body.passes import first_pass, respond
from stewart_pin.mechanics.effort import Motion
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import State, as_state
from stewart_pin.typing import ArrayLike, FloatArray


def closed_chain_articulated_body(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    tau_motor: ArrayLike | None = None,
    *,
    base_motion: BaseMotion | None = None,
) -> Motion:
    """Compute the acceleration under given motor efforts, loops closed, by the articulated-body algorithm.

    An independent second opinion on `forward_dynamics`: neither joint-space inertia nor loop Jacobian is formed.

    Parameters
    ----------
    chain
        Closed chain whose bodies have mass, or a state of it.
    q
        (nq,) configuration with closed loops, with a chain [m, rad, unit quaternions].
    v
        (nv,) tangent velocity that keeps them closed, with a chain [m/s, rad/s].
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
        If a joint moves nothing that has inertia, or the loops have lost a row here.

    Notes
    -----
    The tree with open loops answers several load cases in the same passes: the state itself, and a unit wrench pair on
    each row of a loop (a pair of joint efforts for a coupling). With A the relative accelerations that these cause and
    b those of the state, the loop forces follow from A λ + b = 0 ([1]_, ch. 8, with responses instead of matrices).

    References
    ----------
    .. [1] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer, 2008.
    """
    state = as_state(chain, q, v).require_moving()
    chain, q, v = state.chain, state.q, state.v
    if tau_motor is None and not chain.nu:
        tau_motor = np.zeros(0)
    if tau_motor is None:
        raise InputError("tau_motor is missing; pass the motor efforts, in the order of chain.motors")
    tau_motor = as_array("tau_motor", tau_motor, (chain.nu,))
    base_velocity, base_acceleration = (base_motion or BaseMotion()).spatial(chain.gravity)
    bodies = tree_bodies(chain)
    motion = first_pass(bodies, q, v, base_velocity)
    loops = [loop_wrenches(loop, bodies, motion) for loop in chain.loops]
    gears = coupling_rows(chain, bodies, q, v)

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
    response = respond(bodies, np.array(chain.model.armature), motion.to_parent, tau, bias, product, base)
    if not chain.nc:
        return Motion(a=np.ascontiguousarray(response.joint[:, 0]), lambda_c=np.zeros(0))
    relative = np.vstack(
        [
            *(x.wrench2.T @ response.body[x.body2] - x.wrench1.T @ response.body[x.body1] for x in loops),
            gears.jacobian @ response.joint,
        ]
    )
    open_loops = relative[:, 0] + np.concatenate([*(loop.bias for loop in loops), gears.bias])
    lambda_c = _loop_forces(chain, relative[:, 1:], open_loops)
    return Motion(a=response.joint[:, 0] + response.joint[:, 1:] @ lambda_c, lambda_c=lambda_c)


def _loop_forces(chain: ClosedChain, response: FloatArray, open_loops: FloatArray) -> FloatArray:
    """Solve A λ + b = 0 with as many directions as the loops have; the least forces where rows are redundant."""
    sizes, rank = chain.row_sizes, chain.generic.rank
    # Per natural effort and in natural units: A is symmetric, its rank that of the loop rows.
    u, s, vt = np.linalg.svd(response / sizes / sizes[:, None])
    forces = -(vt[:rank].T @ ((u[:, :rank].T @ (open_loops / sizes)) / s[:rank])) / sizes
    beside = vt[rank:].T / sizes[:, None]
    return forces - beside @ np.linalg.lstsq(beside, forces, rcond=None)[0] if beside.size else forces
