"""Inverse dynamics as a matrix times the inertial parameters of the bodies, for identification.

Of each body the parameters are Pinocchio's: mass, mass times centre of mass, and inertia about the joint frame's origin
as xx, xy, yy, xz, yz, zz. Motor efforts are linear in them, unless idle freedoms obey their own inertia.
"""

from __future__ import annotations

import casadi as ca

from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.graph.driven_tree import DrivenTree, driven_motion
from stewart_pin.kernels.graph.functions import shared
from stewart_pin.kernels.graph.joint_efforts import Wrench, efforts_of_wrenches
from stewart_pin.kernels.graph.joint_motion import at_rest, motions
from stewart_pin.kernels.graph.whole_tree import ClosedTree, motor_efforts
from stewart_pin.kernels.spatial import constant, couple
from stewart_pin.mechanics.constrained import require_held
from stewart_pin.mechanics.freedom import analyse_freedom
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
        ``(q, v, a) -> regressor``, (nu, 10 bodies).

    Raises
    ------
    UnsupportedError
        If there are idle freedoms.
    ActuationError
        If the motors cannot hold the robot at home.
    """
    v, a = ca.SX.sym("v", closed.tree.nv), ca.SX.sym("a", closed.tree.nv)
    return shared("regressor", {"q": closed.q, "v": v, "a": a}, {"regressor": _regressor(closed, v, a)})


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
    return shared("regressor", inputs, {"regressor": regressor, "infeasible": infeasible})


def _regressor(closed: ClosedTree, v: ca.SX, a: ca.SX) -> ca.SX:
    chain, tree = closed.chain, closed.tree
    require_held(chain, analyse_freedom(chain, chain.q_home))
    parameters = ca.SX.sym("parameters", PER_BODY * len(tree.joints))
    moving = motions(tree.joints, closed.at, v, a, at_rest(constant(tree.gravity)))
    wrenches = {
        k: _wrench(parameters[PER_BODY * (k - 1) : PER_BODY * k], moving.acceleration[k], moving.turning[k])
        for k in range(1, len(tree.joints) + 1)
    }
    needed = efforts_of_wrenches(tree.joints, closed.at, wrenches, 1)

    def refuse(idle: ca.SX, scale: FloatArray) -> ca.SX:
        raise UnsupportedError(
            f"{chain.name} has {idle.shape[1]} idle freedom(s), which obey their own inertia: its motor efforts are "
            "not linear in the inertial parameters"
        )

    tau_motor, _ = motor_efforts(closed, needed, refuse)
    return ca.jacobian(tau_motor, parameters)


def _wrench(parameters: ca.SX, acceleration: ca.SX, turning: ca.SX) -> Wrench:
    mass, first = parameters[0], parameters[1:4]
    xx, xy, yy, xz, yz, zz = ca.vertsplit(parameters[4:])
    inertia = ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))
    second = (xx + yy + zz) / 2 * ca.SX.eye(3) - inertia
    force = mass * acceleration + turning @ first
    return force, ca.cross(first, acceleration) + couple(turning, second)
