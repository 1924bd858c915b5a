"""Derivatives of the dynamics with respect to where the legs are attached, for tolerances and calibration."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.elimination import solve_square, solve_symmetric
from stewart_pin.kernels.graph.functions import shared
from stewart_pin.kernels.graph.platform_dynamics import (
    PlacedPlatform,
    balance,
    forward_dynamics_function,
    inverse_dynamics_function,
    place_platform,
    platform_mass_matrix,
)
from stewart_pin.kernels.plan import Leg, PlatformPlan
from stewart_pin.kernels.spatial import constant


def geometry_derivatives(placed: PlacedPlatform, name: str) -> ca.Function:
    """Differentiate inverse or forward dynamics with respect to the ends of the legs.

    With r = wrench - columns tau_motor, which is zero, and the other symbols held, the efforts change by columns⁻¹ ∂r
    and the accelerations by -M⁻¹ ∂r. Bodies keep their inertia about the joints that carry them.

    Parameters
    ----------
    placed
        Platform and legs.
    name
        ``inverse_dynamics`` or ``forward_dynamics``.

    Returns
    -------
    casadi.Function
        Same inputs; ``by_base`` (n, 3 legs) and ``by_platform`` (n, 3 ends), in the order of the motors: per shift of
        the point where a leg stands, in world axes, and of the points where it carries the platform, in platform axes.

    Raises
    ------
    UnsupportedError
        If the platform has not six freedoms and as many motors, or a leg hangs on it.
    """
    plan, inverse = placed.plan, name == "inverse_dynamics"
    _require_six_freedoms(plan)
    legs, base, ends = _shifted(plan)
    shifts = ca.vertcat(base, ends)
    moved = place_platform(replace(plan, legs=legs), shifts)
    twist, acceleration = ca.SX.sym("twist", 6), ca.SX.sym("acceleration", 6)
    tau_motor = ca.SX.sym("tau_motor", len(plan.tree.motors))
    wrench, columns = balance(moved, twist, acceleration)
    share, left = moved.project(columns), moved.project(wrench - columns @ tau_motor)
    change = ca.jacobian(left, shifts)
    if inverse:
        motors = plan.chain.tangent_scale[list(plan.tree.motors)]
        values = moved.values(share) * moved.twist_scale[:, None] / motors
        result = solve_square(share, change, values, "the motors' share")[0]
    else:
        inertia, values = platform_mass_matrix(moved)
        result = -constant(plan.twists) @ ca.vertcat(*solve_symmetric(inertia, change, values)[0])
    symbols = [moved.pose, twist, acceleration, tau_motor]
    # The point of the derivative: no shift.
    result = ca.substitute(result, shifts, ca.SX.zeros(*shifts.shape))
    solved = ca.Function("derivatives", symbols, [result])
    function = (inverse_dynamics_function if inverse else forward_dynamics_function)(placed)
    third = acceleration if inverse else tau_motor
    answer = function.call([moved.pose, twist, third])[0]
    full = [moved.pose, twist, third, answer] if inverse else [moved.pose, twist, answer, third]
    by_base, by_platform = ca.horzsplit(
        solved.call(full)[0], [0, base.shape[0], base.shape[0] + ends.shape[0]]
    )
    inputs = dict(zip(function.name_in(), [moved.pose, twist, third], strict=True))
    return shared(f"{name}_geometry", inputs, {"by_base": by_base, "by_platform": by_platform})


def _shifted(plan: PlatformPlan) -> tuple[tuple[Leg, ...], ca.SX, ca.SX]:
    """Legs with symbols for their ends, numbered by their first motors; and the symbols."""
    order = sorted(range(len(plan.legs)), key=lambda k: plan.legs[k].motors[0][0])
    base = ca.SX.sym("base", 3 * len(order))
    ends = ca.SX.sym("ends", 3 * sum(len(leg.ends) for leg in plan.legs))
    shifted, at = {}, 0
    for place, k in enumerate(order):
        own = []
        for end in plan.legs[k].ends:
            own.append(replace(end, shift=ends[at : at + 3]))
            at += 3
        shifted[k] = replace(plan.legs[k], ends=tuple(own), shift=base[3 * place : 3 * place + 3])
    return tuple(shifted[k] for k in range(len(order))), base, ends


def _require_six_freedoms(plan: PlatformPlan) -> None:
    dof, motors, name = plan.twists.shape[1], len(plan.tree.motors), plan.chain.name
    if dof != 6 or motors != 6:
        raise UnsupportedError(
            f"{name} has {dof} freedoms and {motors} motors; derivatives by its geometry need six of each, since a "
            "platform with fewer would lose them when a point moves"
        )
    for leg in plan.legs:
        if leg.on_platform or not leg.motors:
            raise UnsupportedError(
                f"the leg of joint '{leg.name}' of {name} hangs on the platform or has no motor: there are no "
                "derivatives by its ends"
            )
