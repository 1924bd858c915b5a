"""Forward dynamics of chains with loops: the three passes, then the forces that keep the loops closed."""

from __future__ import annotations

import numpy as np

from stewart_pin.checks import as_array
from stewart_pin.errors import InputError, SingularityError
from stewart_pin.mechanics.articulated_body.base_motion import BaseMotion
from stewart_pin.mechanics.articulated_body.bodies import tree_bodies
from stewart_pin.mechanics.articulated_body.gears import coupling_rows
from stewart_pin.mechanics.articulated_body.loop_wrenches import loop_wrenches
from stewart_pin.mechanics.articulated_body.passes import first_pass, respond, without_inertia
from stewart_pin.mechanics.effort import Motion
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import State, as_state
from stewart_pin.tolerances import NOTHING
from stewart_pin.typing import ArrayLike, FloatArray

_LENT = 0.1
"""Arm, in robot sizes, at which a lent rotor has all the mass of the robot."""


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
        Closed chain, or a state of it. Bodies may be without mass as long as every motion that keeps the loops closed
        moves some.
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
        If a motion moves nothing that has inertia, or the loops have lost a row here.

    Notes
    -----
    The tree with open loops answers several load cases in the same passes: the state itself, and a unit wrench pair on
    each row of a loop (a pair of joint efforts for a coupling). With A the relative accelerations that these cause and
    b those of the state, the loop forces follow from A λ + b = 0 ([1]_, ch. 8, with responses instead of matrices).

    A joint beyond which the tree has no inertia is lent a rotor, and an effort f that is to cancel what it costs: with
    rotor r, f = r q̈, one more row q̈ - f / r = 0 for each. The solution has the rotor in it no more.

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

    rotors = np.array(chain.model.armature)
    lent = without_inertia(bodies, rotors, motion.to_parent) if chain.nc else []
    rotors[lent] += _rotors(chain)[lent]
    # Case 0 is the state with open loops, case k a unit force of row k alone, at rest and without gravity; then a unit
    # effort on each joint that has been lent a rotor.
    cases = 1 + chain.nc + len(lent)
    tau = np.zeros((chain.nv, cases))
    tau[chain.motor_index, 0] = tau_motor
    bias, product = np.zeros((2, len(bodies), 6, cases))
    bias[:, :, 0], product[:, :, 0] = motion.bias, motion.velocity_product
    # A gear's unit force is a pair of joint efforts.
    tau[:, 1 + chain.nc - gears.jacobian.shape[0] : 1 + chain.nc] = gears.jacobian.T
    tau[lent, np.arange(1 + chain.nc, cases)] = 1.0
    base = np.zeros((6, cases))
    base[:, 0] = base_acceleration
    start = 1
    for loop in loops:
        columns = slice(start, start + loop.gap.size)
        # External forces enter the bias with a minus sign; link 1 feels the opposite of link 2.
        bias[loop.body2][:, columns] -= loop.wrench2
        bias[loop.body1][:, columns] += loop.wrench1
        start = columns.stop
    response = respond(bodies, rotors, motion.to_parent, tau, bias, product, base)
    if not chain.nc:
        return Motion(a=np.ascontiguousarray(response.joint[:, 0]), lambda_c=np.zeros(0))
    relative = np.vstack(
        [
            *(x.wrench2.T @ response.body[x.body2] - x.wrench1.T @ response.body[x.body1] for x in loops),
            gears.jacobian @ response.joint,
            response.joint[lent],
        ]
    )
    open_loops = relative[:, 0] + np.concatenate(
        [*(loop.bias for loop in loops), gears.bias, np.zeros(len(lent))]
    )
    rows = relative[:, 1:]
    at = np.arange(chain.nc, rows.shape[0])
    rows[at, at] -= 1 / rotors[lent]
    forces = _loop_forces(chain, rows, open_loops, lent)
    return Motion(a=response.joint[:, 0] + response.joint[:, 1:] @ forces, lambda_c=forces[: chain.nc])


def _rotors(chain: ClosedChain) -> FloatArray:
    """Inertia of a rotor that is neither much more nor much less than what joints move (nv,) [kg m², kg]."""
    mass = sum(body.mass for body in chain.model.inertias) or 1.0
    return mass * (_LENT * chain.length_scale / chain.tangent_scale) ** 2


def _loop_forces(
    chain: ClosedChain, response: FloatArray, open_loops: FloatArray, lent: list[int]
) -> FloatArray:
    """Solve A λ + b = 0 with as many directions as the loops have; the least forces where rows are redundant."""
    sizes = np.concatenate([chain.row_sizes, chain.tangent_scale[lent]])
    rank = chain.generic.rank + len(lent)
    # Per natural effort and in natural units: A is symmetric, its rank that of the loop rows.
    u, s, vt = np.linalg.svd(response / sizes / sizes[:, None])
    if lent and s[rank - 1] <= NOTHING * s[0]:
        name = chain.tangent_names[lent[int(np.argmax(np.abs(vt[rank - 1, chain.nc :])))]]
        raise SingularityError(
            f"a motion in which '{name}' takes part moves nothing that has inertia, so no effort determines its "
            "acceleration; give the links beyond it mass, or use forward_dynamics",
            smallest_singular_value=float(s[rank - 1]),
            names=(name,),
        )
    forces = -(vt[:rank].T @ ((u[:, :rank].T @ (open_loops / sizes)) / s[:rank])) / sizes
    beside = vt[rank:].T / sizes[:, None]
    return forces - beside @ np.linalg.lstsq(beside, forces, rcond=None)[0] if beside.size else forces
