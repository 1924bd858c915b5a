"""CasADi functions of a platform on legs by name: of the pose, and the motion of the platform or of its motors."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca

from stewart_pin.kernels.graph import leg_reactions, platform_dynamics, platform_kinematics
from stewart_pin.kernels.graph.conditioning import platform_conditioning
from stewart_pin.kernels.graph.derivatives import dynamics_derivatives, platform_derivatives
from stewart_pin.kernels.graph.driven_platform import DrivenPlatform, by_motors, derivatives_by_motors
from stewart_pin.kernels.graph.geometry_derivatives import leg_geometry_derivatives
from stewart_pin.kernels.graph.platform_dynamics import PlacedPlatform
from stewart_pin.kernels.graph.regressor import platform_regressor

LEG_FUNCTIONS: dict[str, Callable[[PlacedPlatform], ca.Function]] = {
    "inverse_dynamics": platform_dynamics.inverse_dynamics_function,
    "forward_dynamics": platform_dynamics.forward_dynamics_function,
    "inverse_kinematics": platform_kinematics.inverse_kinematics_function,
    "motor_jacobian": platform_kinematics.motor_jacobian_function,
    "conditioning": platform_conditioning,
    "regressor": platform_regressor,
    "reactions": leg_reactions.reactions_function,
}
DERIVATIVES = ("inverse_dynamics_derivatives", "forward_dynamics_derivatives")
BY_LEGS = ("inverse_dynamics_by_legs", "forward_dynamics_by_legs")


def leg_function(name: str, placed: PlacedPlatform, driven: DrivenPlatform | None = None) -> ca.Function:
    """Write a function.

    Parameters
    ----------
    name
        One of `LEG_FUNCTIONS`, `DERIVATIVES` and `BY_LEGS`; in motor coordinates not of kinematics and geometry.
    placed
        Platform and legs.
    driven
        The same, driven by its motors, if the function is to take their motion.

    Returns
    -------
    casadi.Function
        Of the pose first.

    Raises
    ------
    UnsupportedError
        If legs in closed form do not determine it.
    ActuationError
        If the motors cannot hold the robot at home, where they have to.
    """
    if driven is not None and name == "conditioning":
        return platform_conditioning(placed, driving=driven.reduced)
    function = _of_platform(name, placed)
    if driven is None:
        return function
    if name in DERIVATIVES:
        verb = LEG_FUNCTIONS[name.removesuffix("_derivatives")](placed)
        return derivatives_by_motors(driven, verb, function)
    return by_motors(driven, function)


def _of_platform(name: str, placed: PlacedPlatform) -> ca.Function:
    """Write a function of the platform's motion."""
    if name in BY_LEGS:
        return leg_geometry_derivatives(placed, name.removesuffix("_by_legs"))
    if name not in DERIVATIVES:
        return LEG_FUNCTIONS[name](placed)
    verb, plan = name.removesuffix("_derivatives"), placed.plan
    if plan.twists.shape[1] == len(plan.tree.motors):
        return platform_derivatives(placed, verb)
    return dynamics_derivatives(LEG_FUNCTIONS[verb](placed), None)
