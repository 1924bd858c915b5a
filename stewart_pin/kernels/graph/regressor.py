"""Inverse dynamics as a matrix times the inertial parameters of the bodies, for identification.

Of each body the parameters are Pinocchio's: mass, mass times centre of mass, and inertia about the joint frame's origin
as xx, xy, yy, xz, yz, zz; then the inertia of each rotor. Motor efforts are linear in them, unless idle freedoms obey
their own inertia.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.graph.bodies import Wrench, carry_down, efforts_of_wrenches, motions
from stewart_pin.kernels.graph.driven_tree import DrivenTree, driven_motion
from stewart_pin.kernels.graph.leg_forces import leg_accelerations, leg_motions, leg_velocities
from stewart_pin.kernels.graph.legs import PlacedLeg, PlatformMotion, leg_rates, platform_motion
from stewart_pin.kernels.graph.platform_dynamics import PlacedPlatform, balancing_efforts, motor_columns
from stewart_pin.kernels.graph.state_functions import openness
from stewart_pin.kernels.graph.whole_tree import ClosedTree, motor_efforts
from stewart_pin.kernels.planning.joint_physics import first_effect
from stewart_pin.kernels.planning.spatial import constant, rotation_constant, shared, skew, turning_matrix
from stewart_pin.kernels.planning.tree import Tree
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.freedom import require_sufficient_motors
from stewart_pin.typing import FloatArray

PER_BODY = 10
"""Inertial parameters of a body."""


def tree_regressor(closed: ClosedTree) -> ca.Function:
    """Write the regressor of a state of the whole tree.

    Parameters
    ----------
    closed
        Chain with its loop rows eliminated.

    Returns
    -------
    casadi.Function
        ``(q, v, a) -> (regressor, open)``, (nu, 10 bodies and the rotors), and how far the state is from closed loops.

    Raises
    ------
    UnsupportedError
        If there are idle freedoms.
    ActuationError
        If the motors cannot hold the robot at home.
    """
    v, a = ca.SX.sym("v", closed.tree.nv), ca.SX.sym("a", closed.tree.nv)
    inputs = {"q": closed.q, "v": v, "a": a}
    return shared(
        "regressor",
        {**inputs, **closed.moving_ground},
        {"regressor": _regressor(closed, v, a), "open": openness(closed, **inputs)},
    )


def driven_regressor(driven: DrivenTree) -> ca.Function:
    """Write the regressor of a motion of the platform or of the motors.

    Parameters
    ----------
    driven
        The chain.

    Returns
    -------
    casadi.Function
        ``(q, velocity, acceleration) -> (regressor, infeasible)``, as for inverse dynamics.

    Raises
    ------
    UnsupportedError
        If there are idle freedoms.
    ActuationError
        If the motors cannot hold the robot at home.
    """
    inputs, v, a, infeasible = driven_motion(driven)
    regressor = _regressor(driven.closed, v, a)
    inputs |= driven.closed.moving_ground
    return shared("regressor", inputs, {"regressor": regressor, "infeasible": infeasible})


def _regressor(closed: ClosedTree, v: ca.SX, a: ca.SX) -> ca.SX:
    chain, tree = closed.chain, closed.tree
    require_sufficient_motors(chain)
    require_inertial(chain, tree)
    bodies = PER_BODY * len(tree.joints)
    rotors = [joint.v.start + k for joint in tree.joints for k in np.flatnonzero(joint.rotor).tolist()]
    parameters = ca.SX.sym("parameters", bodies + len(rotors))
    moving = motions(tree.joints, closed.at, v, a, closed.root)
    wrenches = {}
    for k in range(1, len(tree.joints) + 1):
        force, moment = wrenches_per_parameter(
            moving.acceleration[k], moving.omega[k], moving.omega_rate[k], moving.turning[k]
        )
        own = parameters[PER_BODY * (k - 1) : PER_BODY * k]
        wrenches[k] = force @ own, moment @ own
    needed = efforts_of_wrenches(tree.joints, closed.at, wrenches, 1)
    for place, entry in enumerate(rotors, start=bodies):
        needed[entry] += parameters[place] * a[entry]

    def refuse(idle: ca.SX, scale: FloatArray) -> ca.SX:
        raise not_linear(chain, idle.shape[1])

    tau_motor, _ = motor_efforts(closed, needed, refuse)
    return ca.jacobian(tau_motor, parameters)


def require_inertial(chain: ClosedChain, tree: Tree) -> None:
    """Refuse motor efforts of which a part is in no inertial parameter.

    Parameters
    ----------
    chain
        Closed chain.
    tree
        Its constants.

    Raises
    ------
    UnsupportedError
        Naming a joint that does something by itself, and what.
    """
    effect = first_effect(tree)
    if effect is not None:
        raise UnsupportedError(
            f"{chain.name} has no regressor: {effect}, and what joints do by themselves is in no inertial parameter; "
            "take the regressor of the chain without, by with_joint_physics, and the difference of the motor efforts "
            "beside it"
        )


def not_linear(chain: ClosedChain, idle: int) -> UnsupportedError:
    """Say why there is no regressor.

    Parameters
    ----------
    chain
        Closed chain.
    idle
        How many idle freedoms it has.

    Returns
    -------
    UnsupportedError
        To be raised.
    """
    return UnsupportedError(
        f"{chain.name} has {idle} idle freedom(s), which obey their own inertia: its motor efforts are "
        "not linear in the inertial parameters"
    )


def wrenches_per_parameter(acceleration: ca.SX, omega: ca.SX, omega_rate: ca.SX, turning: ca.SX) -> Wrench:
    """Write the wrench that moves a body as a matrix times its inertial parameters.

    With B the matrix of the accelerations, f = m a + B s and n = s × a + I dω/dt + ω × (I ω).

    Parameters
    ----------
    acceleration
        (3, 1) of its frame's origin, less that of free fall, in its axes [m/s²].
    omega, omega_rate
        (3, 1) angular velocity and acceleration in its axes [rad/s, rad/s²].
    turning
        (3, 3) their `turning_matrix` [1/s²].

    Returns
    -------
    force, moment : casadi.SX
        (3, 10) each, in its axes and about its frame's origin [per kg, kg m, kg m²].
    """
    x, y, z = ca.vertsplit(omega)
    ax, ay, az = ca.vertsplit(omega_rate)
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    inertia = ca.horzcat(
        ca.vertcat(ax, xz, -xy),
        ca.vertcat(ay - xz, ax + yz, xx - yy),
        ca.vertcat(-yz, ay, xy),
        ca.vertcat(az + xy, zz - xx, ax - yz),
        ca.vertcat(yy - zz, az - xy, ay + xz),
        ca.vertcat(yz, -xz, az),
    )
    force = ca.horzcat(acceleration, turning, ca.SX(3, 6))
    return force, ca.horzcat(ca.SX(3, 1), -skew(acceleration), inertia)


# ----------------------------------------------------------------------------------------------------
# Motor efforts of a platform on legs as a matrix times the inertial parameters of its bodies
#
# What a parameter asks of a motor is the power of its wrench when that motor alone moves at unit rate: with Z the
# platform's twists and G the rates of a leg's joints for each motor,
#
#     column = Zᵀ wrench of the platform    or    Gᵀ (joint efforts of a body of the leg).
# ----------------------------------------------------------------------------------------------------


def platform_regressor(placed: PlacedPlatform) -> ca.Function:
    """Write the regressor of a motion of the platform.

    Parameters
    ----------
    placed
        Platform and legs.

    Returns
    -------
    casadi.Function
        ``(pose, twist, acceleration) -> regressor``, (7, 1), (6, 1), (6, 1) to (nu, 10 bodies and the rotors), with
        `infeasible` as inverse dynamics.

    Raises
    ------
    UnsupportedError
        If there are idle freedoms.
    ActuationError
        If the motors cannot hold the robot at home.
    """
    plan, chain = placed.plan, placed.plan.chain
    require_sufficient_motors(chain)
    require_inertial(chain, plan.tree)
    idle = sum(leg.idle.shape[1] for leg in placed.legs)
    if idle:
        raise not_linear(chain, idle)
    twist, acceleration = ca.SX.sym("twist", 6), ca.SX.sym("acceleration", 6)
    moving = platform_motion(plan.tree, placed.pose, twist, acceleration)
    driven = balancing_efforts(placed, ca.SX.eye(6), motor_columns(placed)).T
    columns = {plan.tree.platform: _of_platform(placed, moving, driven)}
    rotors: dict[int, ca.SX] = {}
    for leg in placed.legs:
        bodies, own = _of_leg(placed, leg, moving, driven)
        columns |= bodies
        rotors |= own
    return shared(
        "regressor",
        {"pose": placed.pose, "twist": twist, "acceleration": acceleration},
        {
            "regressor": ca.horzcat(
                *(columns[k] for k in range(1, len(plan.tree.joints) + 1)),
                *(rotors[k] for k in sorted(rotors)),
            ),
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
) -> tuple[dict[int, ca.SX], dict[int, ca.SX]]:
    """Columns of the parameters of a leg's bodies, (nu, 10) for each, and of its rotors, (nu, 1), by tangent entry."""
    joints, own_rates = leg.leg.joints, leg_rates(leg, moving)
    moved = leg_motions(leg, moving, own_rates)
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
    rotors, a = {}, leg_accelerations(leg, moving, own_rates)
    for joint, body in zip(joints, leg.leg.bodies, strict=True):
        entry = placed.plan.tree.joints[body - 1].v.start
        for k in np.flatnonzero(joint.rotor).tolist():
            rotors[entry + k] = rates[joint.v.start + k, :].T * a[joint.v.start + k]
    return columns, rotors


def _driven_rates(placed: PlacedPlatform, leg: PlacedLeg, alone: list[PlatformMotion]) -> ca.SX:
    """Rates of a leg's joints for a unit rate of each motor, (nv, nu)."""
    rates = ca.horzcat(*(leg_rates(leg, moving) for moving in alone))
    if len(alone) == placed.plan.twists.shape[1]:  # motors to spare move with the others
        for motor, entry in leg.leg.motors:
            rates[entry, :] = constant(np.eye(len(alone))[motor]).T
    return rates
