"""Derivatives of the dynamics with respect to geometry, for any chain: by multipliers, on the whole tree.

A result x, an effort or an acceleration, obeys the equation of motion f(q, v, a, x, g) = 0 and the conditions of
`held_motion`, c_q = c_v = c_a = 0. With multipliers that make

    L = x + w·f + α·c_a + β·c_v + γ·c_q

insensitive to a, v and q, in this order, dx/dg = ∂L/∂g with everything else held: one sweep back per result,
however many displacements there are [1]_.

Idle freedoms keep their momentum at zero, Iᵀ M v = 0, where I itself depends on g. Motors to spare keep least efforts,
tau = S u with J u = 0. Both add multiples of J(q, g) times a fixed vector to L, and the first iᵀ M(q, g) v as well,
with a fixed idle motion i. Derivatives by the ends of legs with closed forms have a shorter way, below.

References
----------
.. [1] Bryson, Ho, "Applied Optimal Control", 1975, section 2.3, the adjoint of a system of equations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from stewart_pin.kernels.graph.bodies import configuration_chart
from stewart_pin.kernels.graph.displaced_tree import Moves, displaced_tree, displacement_moves
from stewart_pin.kernels.graph.driven_tree import DrivenTree, driven_motion, driven_velocity
from stewart_pin.kernels.graph.held_motion import (
    HeldMotion,
    condition_bias,
    condition_columns,
    condition_gaps,
    hold_motors,
)
from stewart_pin.kernels.graph.joint_effects import resting, resting_among
from stewart_pin.kernels.graph.platform_dynamics import (
    PlacedPlatform,
    balance,
    forward_dynamics_function,
    inverse_dynamics_function,
    place_platform,
    platform_mass_matrix,
)
from stewart_pin.kernels.graph.state_functions import openness
from stewart_pin.kernels.graph.whole_tree import (
    ClosedTree,
    demanded_efforts,
    idle_accelerations,
    inertia_times,
    let_idle_go,
    motor_columns,
    motor_efforts,
    tree_forward_dynamics,
)
from stewart_pin.kernels.planning.elimination import solve_square, solve_symmetric
from stewart_pin.kernels.planning.plan import Leg, LegEnd, PlatformPlan
from stewart_pin.kernels.planning.spatial import constant, shared
from stewart_pin.state.freedom import require_sufficient_motors
from stewart_pin.state.geometry_parameters import Attachment
from stewart_pin.typing import FloatArray

_ZERO = 1e-9
"""Entries below this are round-off."""


@dataclass(frozen=True, eq=False)
class _Sums:
    """A motion, and multipliers with one column per result.

    `pairs` are (multipliers, vectors): the rows J(q, g) times vectors that are held, times the multipliers. `idle` are
    the idle motions of which the momentum is held.
    """

    held: HeldMotion
    v: ca.SX
    a: ca.SX
    lambda_c: ca.SX
    work: ca.SX
    bias: ca.SX
    pairs: tuple[tuple[ca.SX, ca.SX], ...]
    idle: ca.SX | None = None

    def with_pair(self, multipliers: ca.SX, vectors: ca.SX) -> _Sums:
        return replace(self, pairs=(*self.pairs, (multipliers, vectors)))

    def values(self) -> list[ca.SX]:
        return [
            self.v,
            self.a,
            self.lambda_c,
            self.work,
            self.bias,
            *([] if self.idle is None else [self.idle]),
            *(x for pair in self.pairs for x in pair),
        ]

    def symbolic(self) -> _Sums:
        """Put symbols for all that is held."""
        v, a, lambda_c, work, bias, *rest = (ca.SX.sym("held", *value.shape) for value in self.values())
        idle = None if self.idle is None else rest.pop(0)
        pairs = tuple(zip(rest[::2], rest[1::2], strict=True))
        return _Sums(self.held, v, a, lambda_c, work, bias, pairs, idle)

    def total(self, closed: ClosedTree) -> ca.SX:
        """Write w·f + α·c_a, iᵀ M v and the pairs for the chain as it is or displaced: (results, 1)."""
        on_platform = self.held.on_platform
        efforts = demanded_efforts(closed, self.v, self.a) - closed.columns.transpose @ self.lambda_c
        rows = condition_columns(closed, on_platform).T
        total = self.work.T @ efforts + self.bias.T @ condition_bias(closed, on_platform, self.v)
        if self.idle is not None:
            total = total + self.idle.T @ inertia_times(closed, self.v)
        for multipliers, vectors in self.pairs:
            if vectors.shape[1] == 1:
                total = total + multipliers.T @ (rows @ vectors)
            else:
                total = total + ca.sum1(multipliers * (rows @ vectors)).T
        return total

    def evaluated(self, held: _Sums, expression: ca.SX) -> ca.SX:
        """Give the symbols of `held` in an expression their values."""
        given = self.given
        return ca.Function("held", [*given, *held.values()], [expression]).call([*given, *self.values()])[0]

    @property
    def given(self) -> list[ca.SX]:
        """Symbols that are not held: the configuration, and what acts from outside."""
        return [self.held.closed.q, *self.held.closed.outside.values()]


def tree_geometry_derivatives(held: HeldMotion, driven: DrivenTree | None, name: str) -> ca.Function:
    """Differentiate inverse or forward dynamics with respect to the places where joints and loops are attached.

    Parameters
    ----------
    held
        The chain, and what of its motion is held.
    driven
        The same chain, driven; None for functions of whole states.
    name
        ``inverse_dynamics`` or ``forward_dynamics``.

    Returns
    -------
    casadi.Function
        Same inputs; ``by_geometry`` (results, displacements), in the order of `stewart_pin.build.geometry_parameters`.
        It holds for displacements that keep the mobility; and ``infeasible`` or ``open``, as the dynamics have it.

    Raises
    ------
    ActuationError
        If the motors cannot hold the robot at home.
    """
    inverse = name == "inverse_dynamics"
    inputs, judges, found = (_inverse if inverse else _forward)(held, driven)
    outputs = {"by_geometry": _by_geometry(found), **judges}
    return shared(f"{name}_by_tree", {**inputs, **held.closed.outside}, outputs)


def _inverse(held: HeldMotion, driven: DrivenTree | None) -> tuple[dict[str, ca.SX], dict[str, ca.SX], _Sums]:
    closed = held.closed
    tree, chain = closed.tree, closed.chain
    require_sufficient_motors(chain)
    if driven is None:
        v, a = ca.SX.sym("v", tree.nv), ca.SX.sym("a", tree.nv)
        inputs = {"q": closed.q, "v": v, "a": a}
        judges = {"open": openness(closed, closed.q, v, a)}
    else:
        inputs, v, a, infeasible = driven_motion(driven)
        judges = {"infeasible": infeasible}
    demanded = demanded_efforts(closed, v, a)
    own: list[ca.SX] = []

    def let_go(idle: ca.SX, scale: FloatArray) -> ca.SX:
        steps = idle_accelerations(closed, demanded, idle, scale)
        own.append(idle @ steps)
        return demanded + inertia_times(closed, idle) @ steps

    tau_motor, needed = motor_efforts(closed, demanded, let_go)
    lambda_c = _loop_multipliers(closed, needed - motor_columns(tree) @ tau_motor)
    moving = a + own[0] if own else a
    # Motor efforts are linear in the joint efforts: these are their coefficients.
    unit = ca.SX.eye(tree.nv)
    work = motor_efforts(closed, unit, lambda idle, scale: let_idle_go(closed, unit, idle, scale))[0].T
    pulled = -inertia_times(closed, work)
    if own and driven is None and tree.nc:
        # Idle freedoms go their own way from what was demanded, as far as the motors' accelerations let them.
        going = hold_motors(closed).multipliers(pulled)
        bias = held.multipliers(pulled - closed.columns.transpose @ going)
        pairs = ((going, moving), (bias, a))
        bias = bias + going
    else:
        bias = held.multipliers(pulled)
        pairs = ((bias, moving),)
    sums = _Sums(held, v, moving, lambda_c, work, bias, pairs)
    spare = ca.SX.eye(len(tree.motors)) - motor_columns(tree).T @ work
    if np.abs(closed.values(spare)).max() > _ZERO:
        sharing = _loop_multipliers(closed, -motor_columns(tree) @ spare)
        sharing = ca.vertcat(sharing, ca.SX.zeros(held.size - tree.nc, sharing.shape[1]))
        sums = sums.with_pair(sharing, work @ tau_motor)
    return inputs, judges, sums


def _forward(held: HeldMotion, driven: DrivenTree | None) -> tuple[dict[str, ca.SX], dict[str, ca.SX], _Sums]:
    closed = held.closed
    tree = closed.tree
    tau_motor = ca.SX.sym("tau_motor", len(tree.motors))
    if driven is None:
        v = ca.SX.sym("v", tree.nv)
        inputs = {"q": closed.q, "v": v, "tau_motor": tau_motor}
        judges = {"open": openness(closed, closed.q, v)}
    else:
        velocity, v, infeasible = driven_velocity(driven)
        inputs = {"q": closed.q, "velocity": velocity, "tau_motor": tau_motor}
        judges = {"infeasible": infeasible}
    judges |= resting(closed, v)
    a, lambda_c = tree_forward_dynamics(closed, v, tau_motor)
    moved = inertia_times(closed, closed.motions)
    inertia = closed.motions.T @ moved
    values = closed.values(inertia) * closed.motion_scale[:, None] * closed.motion_scale
    steps = ca.vertcat(*solve_symmetric(inertia, -(closed.motions.T @ held.output), values)[0])
    bias = _loop_multipliers(closed, -(held.output + moved @ steps))
    if held.on_platform:
        bias = ca.vertcat(bias, ca.SX.eye(6))
    turned = closed.columns.turn.T @ lambda_c
    return inputs, judges, _Sums(held, v, a, turned, closed.motions @ steps, bias, ((bias, a),))


def _loop_multipliers(closed: ClosedTree, right: ca.SX) -> ca.SX:
    """Solve J_cᵀ x = right for the rows as they are turned, dependent ones at zero: (nc, k)."""
    found = closed.reduced.back(closed.reduced.forward(right), {})
    rest = ca.SX.zeros(1, right.shape[1])
    return ca.vertcat(*(found.get(k, rest) for k in range(closed.tree.nc)), ca.SX(0, right.shape[1]))


def _by_geometry(sums: _Sums) -> ca.SX:
    """Find the multipliers of rates and positions, and differentiate: (results, displacements)."""
    held, closed = sums.held, sums.held.closed
    symbols = sums.symbolic()
    by_v = sums.evaluated(symbols, ca.jacobian(symbols.total(closed), symbols.v)).T
    if held.idle.shape[1]:
        momenta = inertia_times(closed, held.idle)
        inertia = held.idle.T @ momenta
        shares = solve_symmetric(inertia, -(held.idle.T @ by_v), closed.values(inertia))[0]
        along = held.idle @ ca.vertcat(*shares)
        # Iᵀ M v = 0 at all times, and M v = Aᵀ m for the rows A, with A I = 0: (M v)ᵀ dI = -mᵀ dA I.
        rows = ca.repmat(held.multipliers(inertia_times(closed, sums.v)), 1, by_v.shape[1])
        sums = replace(sums.with_pair(rows, -along), idle=along)
        by_v = by_v + momenta @ ca.vertcat(*shares)
    sums = sums.with_pair(held.multipliers(-by_v), sums.v)
    symbols = sums.symbolic()
    by_q = ca.jacobian(symbols.total(closed), closed.q) @ configuration_chart(closed.tree.joints, closed.q)
    positions = held.multipliers(-sums.evaluated(symbols, by_q).T)
    displaced, displacement = displaced_tree(closed)
    held_positions = ca.SX.sym("positions", *positions.shape)
    gaps = condition_gaps(displaced, closed, held.on_platform)
    change = ca.jacobian(symbols.total(displaced) + held_positions.T @ gaps, displacement)
    change = ca.substitute(change, displacement, ca.SX.zeros(*displacement.shape))
    function = ca.Function("change", [*sums.given, held_positions, *symbols.values()], [change])
    return function.call([*sums.given, positions, *sums.values()])[0]


# ----------------------------------------------------------------------------------------------------
# Derivatives of the dynamics with respect to the ends of the legs, in closed form
#
# They are those of the whole tree for some displacements, at a third of its cost: shifts of the points where legs
# stand on the ground, and of the points where they carry the platform.
# ----------------------------------------------------------------------------------------------------


def leg_displacements(placed: PlacedPlatform) -> tuple[int, ...]:
    """List the displacements that this way of differentiating knows.

    Parameters
    ----------
    placed
        Platform and legs.

    Returns
    -------
    tuple of int
        Their places in `stewart_pin.build.geometry_parameters`; none unless the platform has six freedoms and as many
        motors on legs that stand on the ground and carry it with one end each: with fewer freedoms it would turn by
        itself when a point moves.
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
    state = [moved.pose, twist, acceleration, tau_motor, *moved.outside.values()]
    # The point of the derivative: no shift.
    result = ca.substitute(result, symbols, ca.SX.zeros(*symbols.shape))
    solved = ca.Function("derivatives", state, [result])
    function = (inverse_dynamics_function if inverse else forward_dynamics_function)(placed)
    third = acceleration if inverse else tau_motor
    given, acting = [moved.pose, twist, third, *moved.outside.values()], moved.outside.values()
    answer, *judged = function.call(given)
    full = [moved.pose, twist, third, answer] if inverse else [moved.pose, twist, answer, third]
    inputs = dict(zip(function.name_in(), given, strict=True))
    outputs = {"by_geometry": solved.call([*full, *acting])[0]}
    outputs |= resting_among(function.name_out()[1:], judged)
    return shared(f"{name}_by_legs", inputs, outputs)


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
