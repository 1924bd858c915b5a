"""Derivatives of the dynamics, by CasADi's differentiation of the graphs, along charts of the state.

A pose is displaced by a shift and a rotation vector in world axes. Where the functions take the whole configuration,
this moves along the motion that the drive imposes, so that loops stay closed.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from stewart_pin.kernels.graph.bodies import configuration_chart
from stewart_pin.kernels.graph.driven_tree import DrivenTree, follow
from stewart_pin.kernels.graph.platform_dynamics import (
    PlacedPlatform,
    balance,
    forward_dynamics_function,
    inverse_dynamics_function,
    platform_mass_matrix,
)
from stewart_pin.kernels.planning.elimination import solve_square, solve_symmetric
from stewart_pin.kernels.planning.spatial import constant, shared, skew


def pose_chart(pose: ca.SX) -> ca.SX:
    """Differentiate a pose along its displacements in world axes.

    Parameters
    ----------
    pose
        (7, 1) position and unit quaternion x y z w.

    Returns
    -------
    casadi.SX
        (7, 6).
    """
    vector, scalar = pose[3:6], pose[6]
    # d(exp(φ) q)/dφ at zero is half of the quaternion product with the unit vectors from the left.
    turn = ca.vertcat(scalar * ca.SX.eye(3) - skew(vector), -vector.T) / 2
    return ca.diagcat(ca.SX.eye(3), turn)


def platform_derivatives(placed: PlacedPlatform, name: str) -> ca.Function:
    """Differentiate inverse or forward dynamics in platform coordinates, without differentiating the solution.

    With r = wrench - columns tau_motor, which is zero, and the other symbols held, the efforts change by columns⁻¹ ∂r
    and the accelerations by -M⁻¹ ∂r.

    Parameters
    ----------
    placed
        Platform and legs; as many motors as freedoms.
    name
        ``inverse_dynamics`` or ``forward_dynamics``.

    Returns
    -------
    casadi.Function
        As `dynamics_derivatives`.
    """
    inverse = name == "inverse_dynamics"
    plan, pose = placed.plan, placed.pose
    function = (inverse_dynamics_function if inverse else forward_dynamics_function)(placed)
    twist, acceleration = ca.SX.sym("twist", 6), ca.SX.sym("acceleration", 6)
    tau_motor = ca.SX.sym("tau_motor", len(plan.tree.motors))
    wrench, columns = balance(placed, twist, acceleration)
    acting = list(placed.outside.values())
    share, left = placed.project(columns), placed.project(wrench - columns @ tau_motor)
    changes = [ca.jacobian(left, pose) @ pose_chart(pose), ca.jacobian(left, twist)]
    changes.append(ca.jacobian(left, acceleration) if inverse else -share)
    changes += [ca.jacobian(left, wrenches) for wrenches in acting]
    if inverse:
        motors = plan.chain.tangent_scale[list(plan.tree.motors)]
        values = placed.values(share) * placed.twist_scale[:, None] / motors
        result = solve_square(share, ca.horzcat(*changes), values, "the motors' share")[0]
    else:
        inertia, values = platform_mass_matrix(placed)
        result = -constant(plan.twists) @ ca.vertcat(
            *solve_symmetric(inertia, ca.horzcat(*changes), values)[0]
        )
    symbols = [pose, twist, acceleration, tau_motor, *acting]
    solved = ca.Function("derivatives", symbols, [result])
    third = acceleration if inverse else tau_motor
    inputs = dict(zip(function.name_in(), [pose, twist, third, *acting], strict=True))
    answers = function.call(list(inputs.values()))
    both = [third, answers[0]] if inverse else [answers[0], third]
    result = solved.call([pose, twist, *both, *acting])[0]
    ends = np.cumsum([0, *(change.shape[1] for change in changes)]).tolist()
    outputs = dict(zip((f"by_{x}" for x in inputs), ca.horzsplit(result, ends), strict=True))
    outputs |= dict(zip(function.name_out()[1:], answers[1:], strict=True))
    return shared(f"{name}_derivatives", inputs, outputs)


def dynamics_derivatives(function: ca.Function, driven: DrivenTree | None) -> ca.Function:
    """Differentiate inverse or forward dynamics.

    Parameters
    ----------
    function
        ``inverse_dynamics`` or ``forward_dynamics``.
    driven
        The whole tree that it is about, if it takes its configuration; None if it takes the pose.

    Returns
    -------
    casadi.Function
        Same inputs; matrices ``by_NAME``, one for each input, with as many rows as the function's result. For a
        platform with fewer than six freedoms they hold along displacements, twists and accelerations that it can do.
        What acts from outside is held in world axes, at points that move with their links.
    """
    inputs = function.sx_in()
    names = function.name_in()
    result = function.call(inputs)[0]
    if driven is None:
        along = pose_chart(inputs[0])
    else:
        columns = [follow(driven, k) for k in range(driven.drive.shape[1])]
        moved = ca.substitute([ca.horzcat(*columns)], [driven.closed.q], [inputs[0]])[0]
        along = configuration_chart(driven.closed.tree.joints, inputs[0]) @ moved
    matrices = [ca.jacobian(result, inputs[0]) @ along, *(ca.jacobian(result, x) for x in inputs[1:])]
    of = names if driven is None else ["position", *names[1:]]
    outputs = {f"by_{name}": matrix for name, matrix in zip(of, matrices, strict=True)}
    outputs |= dict(zip(function.name_out()[1:], function.call(inputs)[1:], strict=True))
    return shared(f"{function.name()}_derivatives", dict(zip(names, inputs, strict=True)), outputs)
