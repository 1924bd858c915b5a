"""Motor efforts of a platform on legs as a matrix times the inertial parameters of its bodies.

What a parameter asks of a motor is the power of its wrench when that motor alone moves at unit rate: with Z the
platform's twists and G the rates of a leg's joints for each motor,

    column = Zᵀ wrench of the platform    or    Gᵀ (joint efforts of a body of the leg).
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from stewart_pin.kernels.graph.functions import shared
from stewart_pin.kernels.graph.joint_efforts import carry_down
from stewart_pin.kernels.graph.leg_forces import leg_motions, leg_velocities
from stewart_pin.kernels.graph.legs import PlacedLeg, leg_rates
from stewart_pin.kernels.graph.platform_dynamics import PlacedPlatform, motor_columns, motor_efforts
from stewart_pin.kernels.graph.platform_motion import PlatformMotion, platform_motion
from stewart_pin.kernels.graph.regressor import PER_BODY, not_linear, wrenches_per_parameter
from stewart_pin.kernels.planning.spatial import constant, rotation_constant, turning_matrix
from stewart_pin.state.freedom import require_sufficient_motors


def platform_regressor(placed: PlacedPlatform) -> ca.Function:
    """Write the regressor of a motion of the platform.

    Parameters
    ----------
    placed
        Platform and legs.

    Returns
    -------
    casadi.Function
        ``(pose, twist, acceleration) -> regressor``, (7, 1), (6, 1), (6, 1) to (nu, 10 bodies), with `infeasible` as
        inverse dynamics.

    Raises
    ------
    UnsupportedError
        If there are idle freedoms.
    ActuationError
        If the motors cannot hold the robot at home.
    """
    plan, chain = placed.plan, placed.plan.chain
    require_sufficient_motors(chain)
    idle = sum(leg.idle.shape[1] for leg in placed.legs)
    if idle:
        raise not_linear(chain, idle)
    twist, acceleration = ca.SX.sym("twist", 6), ca.SX.sym("acceleration", 6)
    moving = platform_motion(plan.tree, placed.pose, twist, acceleration)
    driven = motor_efforts(placed, ca.SX.eye(6), motor_columns(placed)).T
    columns = {plan.tree.platform: _of_platform(placed, moving, driven)}
    for leg in placed.legs:
        columns |= _of_leg(placed, leg, moving, driven)
    return shared(
        "regressor",
        {"pose": placed.pose, "twist": twist, "acceleration": acceleration},
        {
            "regressor": ca.horzcat(*(columns[k] for k in range(1, len(plan.tree.joints) + 1))),
            **placed.infeasible(twist, acceleration),
        },
    )


def _of_platform(placed: PlacedPlatform, moving: PlatformMotion, driven: ca.SX) -> ca.SX:
    """Columns of the platform's parameters, which are about the frame of its joint, (nu, 10)."""
    chain = placed.plan.chain
    frame = chain.model.frames[chain.platform_id].placement.inverse()
    arm = moving.rotation @ constant(np.array(frame.translation))
    back = (moving.rotation @ rotation_constant(frame.rotation)).T
    omega, rate = back @ moving.omega, back @ moving.omega_rate
    force, moment = wrenches_per_parameter(
        back @ (moving.felt + moving.turning @ arm), omega, rate, turning_matrix(omega, rate)
    )
    linear = [back @ (t[:3] + ca.cross(t[3:], arm)) for t in ca.horzsplit(driven)]
    return ca.horzcat(*linear).T @ force + (back @ driven[3:, :]).T @ moment


def _of_leg(
    placed: PlacedPlatform, leg: PlacedLeg, moving: PlatformMotion, driven: ca.SX
) -> dict[int, ca.SX]:
    """Columns of the parameters of a leg's bodies, (nu, 10) for each."""
    joints = leg.leg.joints
    moved = leg_motions(leg, moving, leg_rates(leg, moving))
    alone = [platform_motion(placed.plan.tree, placed.pose, t, ca.SX.zeros(6)) for t in ca.horzsplit(driven)]
    rates = _driven_rates(placed, leg, alone)
    columns = {}
    for k, body in enumerate(leg.leg.bodies, start=1):
        force, moment = wrenches_per_parameter(
            moved.acceleration[k], moved.omega[k], moved.omega_rate[k], moved.turning[k]
        )
        if leg.leg.on_platform:
            own = [leg_velocities(leg, one, rates[:, m]) for m, one in enumerate(alone)]
            columns[body] = ca.vertcat(*(x.velocity[k].T @ force + x.omega[k].T @ moment for x in own))
        else:  # joint efforts take fewer operations, as long as the root of the leg is at rest
            efforts, _ = carry_down(joints, leg.at, {k: (force, moment)}, PER_BODY)
            columns[body] = rates.T @ efforts
    return columns


def _driven_rates(placed: PlacedPlatform, leg: PlacedLeg, alone: list[PlatformMotion]) -> ca.SX:
    """Rates of a leg's joints for a unit rate of each motor, (nv, nu)."""
    rates = ca.horzcat(*(leg_rates(leg, moving) for moving in alone))
    if len(alone) == placed.plan.twists.shape[1]:  # motors to spare move with the others
        for motor, entry in leg.leg.motors:
            rates[entry, :] = constant(np.eye(len(alone))[motor]).T
    return rates
