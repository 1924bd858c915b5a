"""Derivatives of the dynamics with respect to the ends of the legs, in closed form.

They are those of `geometry_by_tree` for some displacements, at a third of its cost: shifts of the points where legs
stand on the ground, and of the points where they carry the platform.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from stewart_pin.kernels.graph.displaced_tree import Moves, displacement_moves
from stewart_pin.kernels.graph.functions import shared
from stewart_pin.kernels.graph.platform_dynamics import (
    PlacedPlatform,
    balance,
    forward_dynamics_function,
    inverse_dynamics_function,
    place_platform,
    platform_mass_matrix,
)
from stewart_pin.kernels.planning.elimination import solve_square, solve_symmetric
from stewart_pin.kernels.planning.plan import Leg, LegEnd, PlatformPlan
from stewart_pin.kernels.planning.spatial import constant
from stewart_pin.state.geometry_parameters import Attachment


def leg_displacements(placed: PlacedPlatform) -> tuple[int, ...]:
    """List the displacements that this way of differentiating knows.

    Parameters
    ----------
    placed
        Platform and legs.

    Returns
    -------
    tuple of int
        Their places in `stewart_pin.build.geometry_parameters`; none unless the platform has six freedoms and as many motors
        on legs that stand on the ground and carry it with one end each: with fewer freedoms it would turn by itself
        when a point moves.
    """
    plan = placed.plan
    simple = all(len(leg.ends) == 1 and not leg.on_platform for leg in plan.legs)
    if plan.twists.shape[1] != 6 or len(plan.tree.motors) != 6 or not simple:
        return ()
    moves, symbols = displacement_moves(plan.chain)
    shifts = ca.vertcat(*(shift for leg in _shifted(plan, moves) for shift in _shifts(leg)))
    return tuple(k for k, depends in enumerate(ca.which_depends(shifts, symbols, 1, False)) if depends)


def leg_geometry_derivatives(placed: PlacedPlatform, name: str) -> ca.Function:
    """Differentiate inverse or forward dynamics with respect to the ends of the legs.

    With r = wrench - columns tau_motor, which is zero, and the other symbols held, the efforts change by columns⁻¹ ∂r
    and the accelerations by -M⁻¹ ∂r.

    Parameters
    ----------
    placed
        Platform and legs that have `leg_displacements`.
    name
        ``inverse_dynamics`` or ``forward_dynamics``.

    Returns
    -------
    casadi.Function
        Same inputs; ``by_geometry`` (results, displacements), in the order of `leg_displacements`.
    """
    plan, inverse = placed.plan, name == "inverse_dynamics"
    moves, symbols = displacement_moves(plan.chain)
    moved = place_platform(replace(plan, legs=_shifted(plan, moves)), symbols)
    twist, acceleration = ca.SX.sym("twist", 6), ca.SX.sym("acceleration", 6)
    tau_motor = ca.SX.sym("tau_motor", len(plan.tree.motors))
    wrench, columns = balance(moved, twist, acceleration)
    share, left = moved.project(columns), moved.project(wrench - columns @ tau_motor)
    change = ca.jacobian(left, symbols)[:, list(leg_displacements(placed))]
    if inverse:
        motors = plan.chain.tangent_scale[list(plan.tree.motors)]
        values = moved.values(share) * moved.twist_scale[:, None] / motors
        result = solve_square(share, change, values, "the motors' share")[0]
    else:
        inertia, values = platform_mass_matrix(moved)
        result = -constant(plan.twists) @ ca.vertcat(*solve_symmetric(inertia, change, values)[0])
    state = [moved.pose, twist, acceleration, tau_motor]
    # The point of the derivative: no shift.
    result = ca.substitute(result, symbols, ca.SX.zeros(*symbols.shape))
    solved = ca.Function("derivatives", state, [result])
    function = (inverse_dynamics_function if inverse else forward_dynamics_function)(placed)
    third = acceleration if inverse else tau_motor
    answer = function.call([moved.pose, twist, third])[0]
    full = [moved.pose, twist, third, answer] if inverse else [moved.pose, twist, answer, third]
    inputs = dict(zip(function.name_in(), [moved.pose, twist, third], strict=True))
    return shared(f"{name}_by_legs", inputs, {"by_geometry": solved.call(full)[0]})


def _shifted(plan: PlatformPlan, moves: Moves) -> tuple[Leg, ...]:
    """Legs with symbols where they are attached to ground and platform, if that is one place of its own."""
    legs = []
    for leg in plan.legs:
        roots = [joint.name for joint in leg.joints if not joint.parent]
        shift = moves[roots[0], Attachment.JOINT][:3] if len(roots) == 1 else None
        legs.append(replace(leg, ends=tuple(_shifted_end(plan, end, moves) for end in leg.ends), shift=shift))
    return tuple(legs)


def _shifted_end(plan: PlatformPlan, end: LegEnd, moves: Moves) -> LegEnd:
    attachment = Attachment.FRAME2 if end.body_first else Attachment.FRAME1
    move = moves.get((end.loop.name, attachment)) if end.loop.index else None
    if move is None:  # the joint that leads to the platform
        return end
    frame = plan.chain.model.frames[plan.chain.platform_id].placement
    return replace(end, shift=constant(np.array(frame.rotation).T) @ move[:3])


def _shifts(leg: Leg) -> list[ca.SX]:
    return [part.shift for part in (leg, *leg.ends) if part.shift is not None]
