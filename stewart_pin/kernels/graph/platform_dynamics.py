"""Inverse and forward dynamics in platform coordinates, legs first.

Each leg is solved by itself; what it does to the platform is a wrench, a column for each of its motors, and an
inertia. With C the columns, which are also the transpose of the motor Jacobian,

    M acceleration + wrench = C tau_motor

in the twists T that the platform can do: Tᵀ on the left, acceleration = T s.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from stewart_pin.errors import SingularityError
from stewart_pin.kernels.graph.bodies import outside_input
from stewart_pin.kernels.graph.leg_forces import (
    LegForces,
    Rest,
    friction_of,
    leg_forces,
    leg_inertia,
    require_known_joints,
)
from stewart_pin.kernels.graph.legs import (
    PlacedLeg,
    PlatformMotion,
    Samples,
    leg_rates,
    place_leg,
    platform_inertia,
    platform_motion,
    platform_wrench,
)
from stewart_pin.kernels.planning.elimination import solve_square, solve_symmetric
from stewart_pin.kernels.planning.plan import PlatformPlan
from stewart_pin.kernels.planning.samples import at_samples
from stewart_pin.kernels.planning.spatial import constant, shared
from stewart_pin.state.freedom import require_sufficient_motors
from stewart_pin.tolerances import AT_REST, AT_REST_BESIDE
from stewart_pin.typing import FloatArray


@dataclass(frozen=True, eq=False)
class PlacedPlatform:
    """A platform and its legs at a symbolic pose.

    Attributes
    ----------
    plan
        The chain, taken apart.
    pose
        (7, 1) symbols.
    legs
        Its legs.
    wrenches
        (n, 1) symbols of what acts from outside, in world axes.
    shifts
        (n, 1) symbols by which the ends of its legs are moved, or None.
    """

    plan: PlatformPlan
    pose: ca.SX
    legs: tuple[PlacedLeg, ...]
    wrenches: ca.SX
    shifts: ca.SX | None = None

    @property
    def outside(self) -> dict[str, ca.SX]:
        """Input of functions on which something acts from outside, by its name; nothing for the others."""
        return outside_input(self.wrenches)

    @property
    def twist_scale(self) -> FloatArray:
        """(dof,) natural sizes of the platform's freedoms [m or rad]."""
        size = np.repeat([self.plan.chain.length_scale, 1.0], 3)
        return np.linalg.norm(self.plan.twists / size[:, None], axis=0) ** -1

    def values(self, matrix: ca.SX) -> FloatArray:
        """Evaluate a matrix of the pose at samples.

        Parameters
        ----------
        matrix
            (m, n) expressions.

        Returns
        -------
        numpy.ndarray
            (samples, m, n), in the same unit as the matrix.
        """
        return at_samples(*_samples(self.plan, self.pose, self.shifts), matrix)

    def usual(self, pivots: ca.SX) -> FloatArray:
        """Tell how large pivots usually are.

        Parameters
        ----------
        pivots
            (n, 1) expressions of the pose.

        Returns
        -------
        numpy.ndarray
            (n,) medians over the samples, in the same units.
        """
        return np.median(np.abs(self.values(pivots)), axis=0).ravel()

    def infeasible(self, *motions: ca.SX) -> dict[str, ca.SX]:
        """Measure what the platform cannot do of a demand, where there is such a thing.

        Parameters
        ----------
        *motions
            (6, 1) twists or accelerations.

        Returns
        -------
        dict
            ``{"infeasible": (1, 1)}``, relative to 1 and to the demand, or nothing: for platforms with six freedoms
            on legs with one end each.
        """
        left = [ca.fabs(stretch) for leg in self.legs for stretch in leg.positions.stretched]
        size = constant(np.repeat([self.plan.chain.length_scale, 1.0], 3))
        if self.plan.twists.shape[1] < 6:
            twists = self.plan.twists / np.repeat([self.plan.chain.length_scale, 1.0], 3)[:, None]
            beside = constant(np.eye(6) - twists @ np.linalg.pinv(twists))
            left += [ca.norm_inf(beside @ (m / size)) / (1 + ca.norm_inf(m / size)) for m in motions]
            left += self._turned_aside()
        worst = ca.SX(0)
        for value in left:
            worst = ca.fmax(worst, value)
        return {"infeasible": worst} if left else {}

    def _turned_aside(self) -> list[ca.SX]:
        """Sine of half the angle by which the platform has turned about axes about which it does not turn.

        Legs may close there too, where it came in another way than that of home and has other twists.
        """
        axes, s, _ = np.linalg.svd(self.plan.twists[3:])
        turns = int(np.count_nonzero(s > 1e-6))
        if turns > 1:  # about two axes one turns about all
            return []
        x, y, z, w = self.plan.poses[0, 3:]
        # Vector part of the pose's quaternion times the conjugate of that at a sample.
        vector = constant(np.array([[w, -z, y, -x], [z, w, -x, -y], [-y, x, w, -z]])) @ self.pose[3:]
        return [ca.fabs(constant(axis).T @ vector) for axis in axes[:, turns:].T]

    def project(self, wrenches: ca.SX) -> ca.SX:
        """Keep of wrenches what works on the twists that the platform can do.

        Parameters
        ----------
        wrenches
            (6, k).

        Returns
        -------
        casadi.SX
            (dof, k).
        """
        return constant(self.plan.twists).T @ wrenches


def _samples(plan: PlatformPlan, pose: ca.SX, shifts: ca.SX | None) -> Samples:
    if shifts is None:
        return [pose], [plan.poses]
    return [pose, shifts], [plan.poses, np.zeros((len(plan.poses), shifts.shape[0]))]


def place_platform(plan: PlatformPlan, shifts: ca.SX | None = None) -> PlacedPlatform:
    """Place platform and legs at a symbolic pose.

    Parameters
    ----------
    plan
        The chain, taken apart.
    shifts
        (n, 1) symbols that its legs and their ends hold as shifts, or None.

    Returns
    -------
    PlacedPlatform
        Platform and legs.

    Raises
    ------
    UnsupportedError
        If a leg has no closed form, or one that does not tell what its joints do by themselves.
    """
    pose, still = ca.SX.sym("pose", 7), ca.SX.zeros(6)
    moving = platform_motion(plan.tree, pose, still, still)
    scale = plan.chain.tangent_scale
    legs = []
    for leg in plan.legs:
        joints = [plan.tree.joints[body - 1] for body in leg.bodies]
        entries = np.concatenate([np.arange(joint.v.start, joint.v.stop) for joint in joints])
        legs.append(place_leg(leg, moving, _samples(plan, pose, shifts), scale[entries]))
    for leg in legs:
        require_known_joints(leg)
    wrenches = ca.SX.sym("wrenches", 6 * len(plan.tree.outside))
    return PlacedPlatform(plan, pose, tuple(legs), wrenches, shifts)


def inverse_dynamics_function(placed: PlacedPlatform) -> ca.Function:
    """Write inverse dynamics.

    Parameters
    ----------
    placed
        Platform and legs.

    Returns
    -------
    casadi.Function
        ``(pose, twist, acceleration) -> tau_motor``, (7, 1), (6, 1), (6, 1) to (nu, 1). Where the platform cannot do
        every motion there is a second output `infeasible`, the part of the demand that it cannot do, relative to 1 and
        to the demand; that part has no consequence.

    Raises
    ------
    ActuationError
        If the motors cannot hold the robot at home.
    """
    plan = placed.plan
    require_sufficient_motors(plan.chain)
    twist, acceleration = ca.SX.sym("twist", 6), ca.SX.sym("acceleration", 6)
    tau_motor = balancing_efforts(placed, *balance(placed, twist, acceleration))
    return shared(
        "inverse_dynamics",
        {"pose": placed.pose, "twist": twist, "acceleration": acceleration, **placed.outside},
        {"tau_motor": tau_motor, **placed.infeasible(twist, acceleration)},
    )


def motor_share_function(placed: PlacedPlatform) -> ca.Function:
    """Write inverse dynamics together with what each motor contributes, from which other efforts follow.

    Parameters
    ----------
    placed
        Platform and legs.

    Returns
    -------
    casadi.Function
        ``(pose, twist, acceleration) -> (tau_motor, share)``, the latter (dof, nu) of efforts in natural units, with
        `infeasible` as for inverse dynamics.
    """
    plan = placed.plan
    require_sufficient_motors(plan.chain)
    twist, acceleration = ca.SX.sym("twist", 6), ca.SX.sym("acceleration", 6)
    wrench, columns = balance(placed, twist, acceleration)
    sizes = plan.chain.tangent_scale[list(plan.tree.motors)]
    return shared(
        "motor_share",
        {"pose": placed.pose, "twist": twist, "acceleration": acceleration, **placed.outside},
        {
            "tau_motor": balancing_efforts(placed, wrench, columns),
            "share": constant(np.diag(placed.twist_scale))
            @ placed.project(columns)
            @ ca.diag(constant(1 / sizes)),
            **placed.infeasible(twist, acceleration),
        },
    )


def balance(placed: PlacedPlatform, twist: ca.SX, acceleration: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Balance the platform.

    Parameters
    ----------
    placed
        Platform and legs.
    twist, acceleration
        (6, 1) motion of the platform in world axes.

    Returns
    -------
    wrench, columns : casadi.SX
        (6, 1) and (6, nu): motors have to give ``columns @ tau_motor = wrench``.
    """
    moving = platform_motion(placed.plan.tree, placed.pose, twist, acceleration)
    return balance_legs(placed, moving, forces_of_legs(placed, moving))


def forces_of_legs(placed: PlacedPlatform, moving: PlatformMotion, *, starts: bool = True) -> list[LegForces]:
    """Compute the forces that the legs take to follow the platform.

    What acts on them from outside, and what their joints do by themselves, is taken off.

    Parameters
    ----------
    placed
        Platform and legs.
    moving
        Motion of the platform.
    starts
        Whether its acceleration tells where joints at rest are about to move; else their dry friction is left out.

    Returns
    -------
    list of LegForces
        In the order of the legs.
    """
    legs = [(leg, leg_rates(leg, moving)) for leg in placed.legs]
    rest = Rest(
        _resting_rate(placed, ca.vertcat(moving.velocity, moving.omega)),
        _resting_rate(placed, ca.vertcat(moving.felt + constant(moving.gravity), moving.omega_rate))
        if starts
        else None,
    )
    return [leg_forces(leg, moving, rates, placed.wrenches, rest) for leg, rates in legs]


def _resting_rate(placed: PlacedPlatform, motion: ca.SX) -> ca.SX:
    """Rate below which a joint is at rest beside a platform that moves, in natural units."""
    length = placed.plan.chain.length_scale
    most = ca.fmax(ca.norm_inf(motion[:3]) / length, ca.norm_inf(motion[3:]))
    return ca.fmax(AT_REST, AT_REST_BESIDE * most)


def _resting(placed: PlacedPlatform, twist: ca.SX) -> dict[str, ca.SX]:
    """Tell states in which a joint with dry friction is at rest, as `joint_effects.resting`."""
    moving = platform_motion(placed.plan.tree, placed.pose, twist, ca.SX.zeros(6))
    rest, worst = _resting_rate(placed, twist), ca.SX(0)
    for leg in placed.legs:
        entries = np.flatnonzero(friction_of(leg)).tolist()
        rates, sizes = leg_rates(leg, moving)[entries], constant(leg.scale[entries])
        for still in ca.vertsplit(ca.fabs(rates) <= sizes * rest) if entries else []:
            worst = ca.fmax(worst, still)
    return {} if worst.is_constant() else {"resting": worst}


def balance_legs(
    placed: PlacedPlatform, moving: PlatformMotion, forces: list[LegForces]
) -> tuple[ca.SX, ca.SX]:
    """Balance the platform against the forces of its legs.

    Parameters
    ----------
    placed
        Platform and legs.
    moving
        Motion of the platform.
    forces
        Of its legs.

    Returns
    -------
    wrench, columns : casadi.SX
        As `balance`.
    """
    wrench = platform_wrench(placed.plan.masses, moving) - _acting_on_platform(placed, moving)
    for force in forces:
        wrench = wrench - force.wrench
    return wrench, _columns(placed.plan, forces)


def _acting_on_platform(placed: PlacedPlatform, moving: PlatformMotion) -> ca.SX:
    """Add up what acts on the platform from outside, about its origin and in world axes: (6, 1)."""
    tree, total = placed.plan.tree, ca.SX(6, 1)
    for act in tree.outside:
        if act.body == tree.platform:
            wrench = placed.wrenches[act.entries]
            arm = moving.rotation @ constant(act.point)
            total += ca.vertcat(wrench[:3], wrench[3:] + ca.cross(arm, wrench[:3]))
    return total


def forward_dynamics_function(placed: PlacedPlatform) -> ca.Function:
    """Write forward dynamics.

    Parameters
    ----------
    placed
        Platform and legs.

    Returns
    -------
    casadi.Function
        ``(pose, twist, tau_motor) -> acceleration``, (7, 1), (6, 1), (nu, 1) to (6, 1), with `infeasible` likewise;
        with dry friction ``resting`` as well.

    Raises
    ------
    SingularityError
        If a motion of the platform has no inertia.
    """
    plan = placed.plan
    twist, tau_motor = ca.SX.sym("twist", 6), ca.SX.sym("tau_motor", len(plan.tree.motors))
    moving = platform_motion(plan.tree, placed.pose, twist, ca.SX.zeros(6))
    wrench, columns = balance_legs(placed, moving, forces_of_legs(placed, moving, starts=False))
    inertia, values = platform_mass_matrix(placed)
    steps, weightless, _ = solve_symmetric(inertia, placed.project(columns @ tau_motor - wrench), values)
    if weightless:
        raise SingularityError(
            f"{len(weightless)} freedom(s) of the platform of {plan.chain.name} have no inertia, so accelerations are "
            "undetermined; give the bodies mass",
            smallest_singular_value=0.0,
        )
    acceleration = constant(plan.twists) @ ca.vertcat(*steps)
    return shared(
        "forward_dynamics",
        {"pose": placed.pose, "twist": twist, "tau_motor": tau_motor, **placed.outside},
        {"acceleration": acceleration, **placed.infeasible(twist), **_resting(placed, twist)},
    )


def platform_mass_matrix(placed: PlacedPlatform) -> tuple[ca.SX, FloatArray]:
    """Compute the inertia of the whole robot in the freedoms of its platform.

    Parameters
    ----------
    placed
        Platform and legs.

    Returns
    -------
    inertia : casadi.SX
        (dof, dof), symmetric.
    values : numpy.ndarray
        (samples, dof, dof) at the samples, in equal units [kg m²].
    """
    plan, still = placed.plan, ca.SX.zeros(6)
    moving = platform_motion(plan.tree, placed.pose, still, still)
    inertia = platform_inertia(plan.masses, moving.rotation)
    for leg in placed.legs:
        inertia = inertia + leg_inertia(leg, moving)
    inertia = placed.project(inertia) @ constant(plan.twists)
    scale = placed.twist_scale
    return inertia, placed.values(inertia) * scale[:, None] * scale


def motor_columns(placed: PlacedPlatform) -> ca.SX:
    """Compute the wrenches that the motors put on the platform, per unit of effort.

    Parameters
    ----------
    placed
        Platform and legs.

    Returns
    -------
    casadi.SX
        (6, nu), the transpose of the motor Jacobian, in world axes.
    """
    plan, still = placed.plan, ca.SX.zeros(6)
    moving = platform_motion(plan.tree, placed.pose, still, still)
    return _columns(plan, [leg_forces(leg, moving, ca.SX.zeros(leg.leg.nv)) for leg in placed.legs])


def _columns(plan: PlatformPlan, forces: list[LegForces]) -> ca.SX:
    columns: dict[int, ca.SX] = {}
    for force in forces:
        columns.update(force.columns)
    return ca.horzcat(*(columns[k] for k in range(len(plan.tree.motors))))


def balancing_efforts(placed: PlacedPlatform, wrench: ca.SX, columns: ca.SX) -> ca.SX:
    """Find the motor efforts that balance the platform.

    Parameters
    ----------
    placed
        Platform and legs.
    wrench, columns
        (6, 1) and (6, nu), from `balance`.

    Returns
    -------
    casadi.SX
        (nu, 1), of least norm in natural units where there are more than needed.
    """
    share, load = placed.project(columns), placed.project(wrench)
    plan, dof = placed.plan, share.shape[0]
    motors = plan.chain.tangent_scale[list(plan.tree.motors)]
    values = placed.values(share) * placed.twist_scale[:, None] / motors
    if dof == share.shape[1]:
        return solve_square(share, load, values, "the motors' share")[0]
    sizes = constant(motors)
    share = share @ ca.diag(1 / sizes)
    square = share @ share.T
    scale = placed.twist_scale
    values = placed.values(square) * scale[:, None] * scale
    return (share.T @ solve_square(square, load, values, "the motors' share")[0]) / sizes
