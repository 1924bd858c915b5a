"""A platform on legs, driven by its motors: its twist and acceleration follow from theirs, leg by leg.

With J the motor Jacobian in the twists T that the platform can do, twist = T s and acceleration = T ds/dt, and m the
accelerations of the motors while the platform moves without acceleration,

    rates = J s,    accelerations = J ds/dt + m.

The pose itself comes from Newton steps. Of motors to spare, some are followed; the others must agree with them.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.graph.derivatives import pose_chart
from stewart_pin.kernels.graph.joint_effects import resting_among
from stewart_pin.kernels.graph.leg_forces import leg_accelerations
from stewart_pin.kernels.graph.legs import leg_rates, platform_motion
from stewart_pin.kernels.graph.platform_dynamics import PlacedPlatform, motor_columns
from stewart_pin.kernels.planning.elimination import Elimination, plan_pivots
from stewart_pin.kernels.planning.spatial import constant, shared


@dataclass(frozen=True, eq=False)
class DrivenPlatform:
    """A platform at a symbolic pose, and what its motors make of it.

    Attributes
    ----------
    placed
        Platform and legs.
    jacobian
        (nu, 6) motor rates per twist, in world axes.
    reduced
        Its share of the twists that the platform can do, (dof, nu), transposed and eliminated.
    """

    placed: PlacedPlatform
    jacobian: ca.SX
    reduced: Elimination

    @property
    def motors(self) -> int:
        """Number of motors."""
        return self.jacobian.shape[0]

    def follow(self, demand: ca.SX) -> ca.SX:
        """Find what motion of the platform meets a demand on the motors.

        Parameters
        ----------
        demand
            (nu, 1) rates, or accelerations less those that it has without the platform's.

        Returns
        -------
        casadi.SX
            (6, 1) in world axes.
        """
        return constant(self.placed.plan.twists) @ self.reduced.transposed(demand)

    def infeasible(self, *motions: tuple[ca.SX, ca.SX]) -> dict[str, ca.SX]:
        """Measure by how far motors to spare disagree, where there are such.

        Parameters
        ----------
        *motions
            What the motors do and what is demanded of them, (nu, 1) each.

        Returns
        -------
        dict
            ``{"infeasible": (1, 1)}``, relative to 1 and to the demand, or nothing.
        """
        spare = list(self.reduced.pivots.columns)
        if not spare:
            return {}
        worst = ca.SX(0)
        for done, demand in motions:
            worst = ca.fmax(worst, ca.norm_inf((done - demand)[spare]) / (1 + ca.norm_inf(demand)))
        return {"infeasible": worst}


def drive_platform(placed: PlacedPlatform) -> DrivenPlatform:
    """Drive a platform by its motors.

    Parameters
    ----------
    placed
        Platform and legs.

    Returns
    -------
    DrivenPlatform
        Platform, driven.

    Raises
    ------
    UnsupportedError
        If the motors leave motions of the platform open, or one drives what the platform does not see.
    """
    plan, columns = placed.plan, motor_columns(placed)
    share = placed.project(columns)
    motors = plan.chain.tangent_scale[list(plan.tree.motors)]
    values = placed.values(share) * placed.twist_scale[:, None] / motors
    pivots = plan_pivots(values, list(range(share.shape[1])))
    if pivots.rows:
        raise UnsupportedError(
            f"the motors of {plan.chain.name} leave {len(pivots.rows)} freedom(s) of its platform open"
        )
    return DrivenPlatform(placed, columns.T, Elimination(share, pivots))


def motor_accelerations(placed: PlacedPlatform, twist: ca.SX, acceleration: ca.SX) -> ca.SX:
    """Compute how the motors accelerate with the platform.

    Parameters
    ----------
    placed
        Platform and legs.
    twist, acceleration
        (6, 1) motion of the platform in world axes.

    Returns
    -------
    casadi.SX
        (nu, 1) [m/s² or rad/s²].
    """
    plan = placed.plan
    moving = platform_motion(plan.tree, placed.pose, twist, acceleration)
    found = ca.SX(len(plan.tree.motors), 1)
    for leg in placed.legs:
        a = leg_accelerations(leg, moving, leg_rates(leg, moving))
        for motor, entry in leg.leg.motors:
            found[motor] = a[entry]
    return found


def by_motors(driven: DrivenPlatform, function: ca.Function) -> ca.Function:
    """Let a function of the platform's motion take that of its motors.

    Parameters
    ----------
    driven
        Platform, driven.
    function
        ``(pose, twist, acceleration) -> result``, or ``(pose, twist, tau_motor) -> acceleration``, perhaps with what
        acts from outside; its other outputs judge what the platform is asked to do.

    Returns
    -------
    casadi.Function
        ``(pose, velocity, acceleration) -> result``, or ``(pose, velocity, tau_motor) -> acceleration``, (7, 1) and
        (nu, 1) each, acceleration that of the motors, and what acts from outside; with `infeasible` where there are
        motors to spare.
    """
    placed, third = driven.placed, function.name_in(2)
    velocity, last = ca.SX.sym("velocity", driven.motors), ca.SX.sym(third, driven.motors)
    acting = dict(zip(function.name_in()[3:], function.sx_in()[3:], strict=True))
    twist = driven.follow(velocity)
    drift = motor_accelerations(placed, twist, ca.SX.zeros(6))
    asked = (driven.jacobian @ twist, velocity)
    if third == "acceleration":
        acceleration = driven.follow(last - drift)
        found = function.call([placed.pose, twist, acceleration, *acting.values()])
        results = dict(zip(function.name_out(), found, strict=True))
        results.pop("infeasible", None)
        beside = driven.infeasible(asked, (driven.jacobian @ acceleration + drift, last))
    else:
        moved, *judged = function.call([placed.pose, twist, last, *acting.values()])
        results = {function.name_out(0): driven.jacobian @ moved + drift}
        beside = driven.infeasible(asked) | resting_among(function.name_out()[1:], judged)
    return shared(
        function.name(),
        {"pose": placed.pose, "velocity": velocity, third: last, **acting},
        {**results, **beside},
    )


def derivatives_by_motors(
    driven: DrivenPlatform, function: ca.Function, derivatives: ca.Function
) -> ca.Function:
    """Let derivatives of the dynamics in platform coordinates hold in those of the motors.

    With the motors held, a displacement of the pose changes twist and acceleration too; what it changes follows from
    rates and accelerations of the motors by implicit differentiation.

    Parameters
    ----------
    driven
        Platform, driven.
    function
        ``inverse_dynamics`` or ``forward_dynamics`` in platform coordinates.
    derivatives
        Of that function.

    Returns
    -------
    casadi.Function
        ``(pose, velocity, acceleration or tau_motor) -> (by_position, by_velocity, ...)``, (7, 1) and (nu, 1) to
        (nu, nu) each, and ``by_wrenches`` where something acts from outside; with `infeasible` as `by_motors`. They
        hold for what the motors can do.
    """
    placed, third = driven.placed, function.name_in(2)
    inverse, pose, twists = third == "acceleration", placed.pose, constant(placed.plan.twists)
    velocity, last = ca.SX.sym("velocity", driven.motors), ca.SX.sym(third, driven.motors)
    acting = dict(zip(function.name_in()[3:], function.sx_in()[3:], strict=True))
    twist, acceleration = ca.SX.sym("twist", 6), ca.SX.sym("acceleration", 6)
    done = motor_accelerations(placed, twist, acceleration)
    along = pose_chart(pose) @ twists
    bends = ca.Function(
        "bends",
        [pose, twist, acceleration],
        [
            ca.jacobian(driven.jacobian @ twist, pose) @ along,
            ca.jacobian(done, pose) @ along,
            ca.jacobian(done, twist) @ twists,
            done,
        ],
    )
    back = ca.horzcat(*(driven.reduced.transposed(unit) for unit in ca.horzsplit(ca.SX.eye(driven.motors))))
    moved = driven.follow(velocity)
    if inverse:
        drift = motor_accelerations(placed, moved, ca.SX.zeros(6))
        platform_third = accelerated = driven.follow(last - drift)
    else:
        platform_third, accelerated = last, function.call([pose, moved, last, *acting.values()])[0]
    parts = derivatives.call([pose, moved, platform_third, *acting.values()])
    by_pose, by_twist = (part @ twists for part in parts[:2])
    rates_by_pose, by_pose_done, by_twist_done, made = bends.call([pose, moved, accelerated])
    turned = -back @ rates_by_pose  # of twists by poses, at constant rates
    beside = [(driven.jacobian @ moved, velocity)]
    if inverse:
        by_acceleration = parts[2] @ twists
        sped = -back @ (by_pose_done + by_twist_done @ turned)
        by_position = by_pose + by_twist @ turned + by_acceleration @ sped
        by_velocity = by_twist - by_acceleration @ (back @ by_twist_done)
        by_third, by_acting = by_acceleration @ back, parts[3 : 3 + len(acting)]
        beside.append((made, last))
    else:
        by_position = by_pose_done + by_twist_done @ turned
        by_position += driven.jacobian @ (by_pose + by_twist @ turned)
        by_velocity = by_twist_done + driven.jacobian @ by_twist
        by_third, *by_acting = (driven.jacobian @ part for part in parts[2 : 3 + len(acting)])
    return shared(
        f"{function.name()}_derivatives",
        {"pose": pose, "velocity": velocity, third: last, **acting},
        {
            "by_position": by_position @ back,
            "by_velocity": by_velocity @ back,
            f"by_{third}": by_third,
            **{f"by_{name}": part for name, part in zip(acting, by_acting, strict=False)},
            **driven.infeasible(*beside),
            **resting_among(derivatives.name_out(), parts),
        },
    )
