"""Solve the block system: motor efforts, loop reactions, and the accelerations of all bodies.

References
----------
.. [1] N. J. Higham, "Accuracy and Stability of Numerical Algorithms", 2002.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.linalg import get_lapack_funcs

from stewart_pin.errors import ActuationError, InputError
from stewart_pin.mechanics.constraint_matrix.columns import loop_openings
from stewart_pin.mechanics.constraint_matrix.joint_efforts import OwnEffort, acting_joints, friction_at_rest
from stewart_pin.mechanics.constraint_matrix.kinematics import motion_about
from stewart_pin.mechanics.constraint_matrix.system import (
    AssembledSystem,
    ConstraintMatrixSystem,
    assemble,
    coupling_opening,
    loaded_links,
    tree_accelerations,
    wound_in,
)
from stewart_pin.mechanics.effort import Effort
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.outside import OutsideWrenches, as_wrenches
from stewart_pin.state.state import State
from stewart_pin.tolerances import CONSISTENT, NOTHING, TAKES_PART
from stewart_pin.typing import Configuration, FloatArray, Tangent

_SAMPLES = 3
"""Closed configurations at which the rank of the system is looked at, once per chain."""
_REGULAR = 1e-11
"""Reciprocal condition number of a system without dependent columns from which on it is solved as it stands."""


@dataclass(frozen=True, eq=False)
class _Solution:
    """Unknowns of the block system, one column per right side or (n,) of the one, and the freedom left in them.

    That is an (n, k) basis, orthonormal in units of `scale`.
    """

    unknowns: FloatArray
    undetermined: FloatArray
    scale: FloatArray


def constraint_matrix_inverse_dynamics(
    state: State, a: Tangent, outside: OutsideWrenches | None = None, *, throw: bool = True
) -> Effort:
    """Compute motor efforts and loop reactions from the maximal-coordinate system.

    Parameters
    ----------
    state
        State that keeps the loops closed.
    a
        (nv,) tangent acceleration that keeps them closed [m/s², rad/s²].
    outside
        Wrenches from outside, or None.
    throw
        Whether motors that cannot hold the robot are an error; otherwise the least-squares efforts are returned with
        their residual.

    Returns
    -------
    Effort
        Motor efforts and reactions; where the system is singular the least-norm ones in natural units, motors first,
        then loops.

    Raises
    ------
    ActuationError
        If the motors cannot hold the robot.
    InputError
        If the bodies' own motion does not keep the loops closed.
    """
    chain, q, v = state.chain, state.q, state.v
    # About a point within the robot: where it stands in the world shall cost no digits.
    assembled = assemble(chain, q, v, a, _middle(state), outside, state.base_motion)
    system = assembled.system
    _require_consistent(chain, assembled, q, a)
    _require_coupled(chain, q, v, a)
    n_bodies = system.f_p.size
    deficiency = _deficiency(chain, loaded_links(chain, outside), acting_joints(chain))
    solution = _solve(system, chain.length_scale, deficiency if throw else None, assembled.resting)
    system, solution = _with_idle_friction(chain, assembled, solution)
    motors = slice(solution.unknowns.size - chain.nu, solution.unknowns.size)
    first_loop = 1 + sum(freedom.axes.shape[1] < 6 for freedom in assembled.freedoms)
    loops = slice(n_bodies + system.columns[first_loop].start if chain.nc else motors.start, motors.start)
    # Least norm of the wrenches; bodies that nothing determines keep as near to the demand as they can.
    demand = np.zeros_like(solution.unknowns)
    demand[:n_bodies] = _demanded(assembled, a)
    beyond = replace(solution, unknowns=solution.unknowns - demand)
    # Efforts and rows in units of energy, so that forces and moments compare whatever the unit of length.
    sizes = np.ones_like(demand)
    sizes[motors], sizes[loops] = chain.tangent_scale[chain.motor_index], chain.row_sizes
    sizes[:n_bodies] = 1.0 / _motion_scale(system, chain.length_scale)
    unknowns, unique = _least_norm(beyond, [motors, loops, slice(n_bodies), slice(None)], sizes)
    unknowns += demand

    residual_vector = system.matrix @ unknowns - system.right_hand_side
    if throw:
        _require_held(chain, assembled, unknowns, a)
    return Effort(
        tau_motor=unknowns[motors],
        lambda_c=unknowns[loops],
        unique=unique[0],
        reactions_unique=unique[1],
        a=_tangent_acceleration(assembled, unknowns[:n_bodies], a),
        residual=float(np.abs(residual_vector[:n_bodies]).max()),
    )


_STARTS = 1e-9
"""Acceleration per effort, in robot sizes and the largest inertia, from which on a coordinate is free to start: that of
one that motors hold is round-off; that of a thin rod is a hundred or more, times the square of its share in the motion.
"""


def _with_idle_friction(
    chain: ClosedChain, assembled: AssembledSystem, solution: _Solution
) -> tuple[ConstraintMatrixSystem, _Solution]:
    """Let dry friction oppose what idle freedoms at rest do, instead of what was demanded of them."""
    unknowns, responses = solution.unknowns[:, 0], solution.unknowns[:, 1:]
    system, resting = assembled.system, assembled.resting
    bodies, inertia = system.f_p.size, _largest_inertia(system, chain.length_scale)
    count = len(system.bodies)
    free = [
        k
        for k, own in enumerate(resting)
        if own.on_bodies(count) @ responses[:bodies, k] * inertia > _STARTS * own.size**2
    ]
    if free:
        own, response = [resting[k] for k in free], responses[:, free]
        unknowns = unknowns - response @ assembled.rubbing[free]
        pull = np.array([each.acceleration(unknowns[:bodies]) for each in own])
        pairs = np.array([each.on_bodies(count) for each in own])
        limits = np.array([each.friction for each in own])
        found = friction_at_rest(pairs @ response[:bodies], pull, limits)
        unknowns = unknowns + response @ found
        system = replace(system, f_p=system.f_p - (found - assembled.rubbing[free]) @ pairs)
    return system, replace(solution, unknowns=unknowns)


def _middle(state: State) -> FloatArray:
    if len(state.chain.loops):
        return state.loops.origin2.mean(axis=0)
    return np.zeros(3) if state.chain.platform is None else state.pose.translation


@lru_cache(maxsize=16)
def _deficiency(chain: ClosedChain, loaded: tuple[str, ...] = (), _acting: tuple[str, ...] = ()) -> int:
    """Count the unknowns that the equations of a mechanism leave undetermined wherever it stands.

    Found by the gap between singular values at closed configurations, as the ranks of the loops are, but from this
    system's own matrix; links that are bodies because they are loaded, or joints act on them, take part. Chains do not
    change but for the fields of their models that tell which joints act, so the answers for the last few are kept.
    """
    found: list[int] = []
    outside = as_wrenches(chain, dict.fromkeys(loaded, np.zeros(6)))
    for q in chain.generic.samples[:_SAMPLES]:
        state = chain.at(q)
        system = assemble(chain, q, state.v, chain.rest, _middle(state), outside).system
        scale, across = _natural_units(system, chain.length_scale)
        values = np.linalg.svd(system.matrix.toarray() * across[:, None] * scale, compute_uv=False)
        values = np.maximum(values / values[0], 0.01 * NOTHING)
        ratios = values / np.append(values[1:], 0.01 * NOTHING)
        found.append(values.size - 1 - int(np.argmax(np.where(values > NOTHING, ratios, 0.0))))
    return min(found)


def _solve(
    system: ConstraintMatrixSystem, size: float, deficiency: int | None, unit: Sequence[OwnEffort] = ()
) -> _Solution:
    """Solve with as many directions as the mechanism has, or where that is not asked for as the matrix has here.

    Further columns of the unknowns are what unit efforts change.
    """
    scale, across = _natural_units(system, size)
    # Dense on purpose: at this size LAPACK is faster than SuperLU, which crashes on singular matrices.
    matrix = system.matrix.toarray() * across[:, None] * scale
    right = np.zeros((across.size, 1 + len(unit)))
    right[:, 0] = system.right_hand_side
    for k, own in enumerate(unit, 1):
        right[: system.f_p.size, k] = -own.on_bodies(len(system.bodies))
    right *= across[:, None]
    null = (
        np.zeros((across.size, 0)) if not deficiency else _free_wrenches(matrix, system.f_p.size, deficiency)
    )
    if null is not None:
        # Symmetric, so that what it leaves open is also what its right side cannot ask for.
        regular = matrix + null @ null.T
        getrf, gecon, getrs = get_lapack_funcs(("getrf", "gecon", "getrs"), (matrix,))
        factors, pivots, info = getrf(regular)
        if info == 0 and gecon(factors, np.linalg.norm(regular, 1))[0] > _REGULAR:
            unknowns = getrs(factors, pivots, right)[0]
            # Large wrenches would leave their round-off in the accelerations; one refinement takes it out [1, ch. 12].
            unknowns += getrs(factors, pivots, right - matrix @ unknowns)[0]
            return _Solution(scale[:, None] * unknowns, null, scale)
    u, s, vt = np.linalg.svd(matrix)
    rank = int(np.count_nonzero(s > _REGULAR * s[0])) if deficiency is None else s.size - deficiency
    unknowns = np.zeros_like(right)
    for _ in range(2):  # the second time as above
        unknowns += vt[:rank].T @ ((u[:, :rank].T @ (right - matrix @ unknowns)) / s[:rank, None])
    return _Solution(scale[:, None] * unknowns, vt[rank:].T, scale)


def _free_wrenches(matrix: FloatArray, n_bodies: int, deficiency: int) -> FloatArray | None:
    """Orthonormal basis of what is undetermined, where that is wrenches alone: (n, deficiency), or None.

    From the columns of the joints, which next to a singularity tell it twice as many digits as the whole matrix.
    """
    _, s, vt = np.linalg.svd(matrix[:n_bodies, n_bodies:])
    values = np.append(s, np.zeros(len(vt) - s.size))
    if (values[len(vt) - deficiency :] > _REGULAR * values[0]).any():
        return None
    return np.vstack([np.zeros((n_bodies, deficiency)), vt[len(vt) - deficiency :].T])


def _natural_units(system: ConstraintMatrixSystem, size: float) -> tuple[FloatArray, FloatArray]:
    """Scales of unknowns and rows that make every entry of the matrix one at most, whatever the unit of length."""
    motion = _motion_scale(system, size)
    columns = _column_scale(system, motion)
    inertia = _largest_inertia(system, size)
    return np.concatenate([motion, inertia * columns]), np.concatenate([motion / inertia, columns])


def _largest_inertia(system: ConstraintMatrixSystem, size: float) -> float:
    """Inertia of a body in natural units, or one where none has any [kg m²]."""
    return float(np.abs(system.I.diagonal() * _motion_scale(system, size) ** 2).max()) or 1.0


def _motion_scale(system: ConstraintMatrixSystem, size: float) -> FloatArray:
    return np.tile([size, size, size, 1.0, 1.0, 1.0], len(system.bodies))


def _column_scale(system: ConstraintMatrixSystem, motion: FloatArray) -> FloatArray:
    return 1.0 / np.linalg.norm(system.C.toarray() * motion[:, None], axis=0)


def _least_norm(solution: _Solution, groups: list[slice], sizes: FloatArray) -> tuple[FloatArray, list[bool]]:
    """Among all solutions, make the first group least, then the second, and so on; tell which were unique.

    Least is the norm of the unknowns times their sizes.
    """
    unknowns, basis, scale = solution.unknowns.copy(), solution.undetermined, solution.scale[:, None]
    unique: list[bool] = []
    for group in groups:
        # Whether a group takes part in what is undetermined shows in the units of the solution.
        _, s, vt = np.linalg.svd(basis[group], full_matrices=True)
        rank = int(np.count_nonzero(s > TAKES_PART))
        unique.append(rank == 0)
        if rank:
            moving = scale * (basis @ vt[:rank].T)
            size = sizes[group]
            apart = np.linalg.lstsq(moving[group] * size[:, None], unknowns[group] * size, rcond=None)[0]
            unknowns -= moving @ apart
        basis = basis @ vt[rank:].T
    return unknowns, unique


def _demanded(assembled: AssembledSystem, a: Tangent) -> FloatArray:
    """Accelerations of the bodies as the joints of the tree have it, on a ground that moves as it is told to."""
    ground = assembled.system.c_a[:6]  # the first columns hold the ground
    return tree_accelerations(assembled.topology, assembled.freedoms, a, ground)


def _require_consistent(chain: ClosedChain, assembled: AssembledSystem, q: Configuration, a: Tangent) -> None:
    """Check gap, rate and acceleration of the loops as the bodies' own motion shows them."""
    system = assembled.system
    bodies = _demanded(assembled, a)
    names = {name: columns for name, columns in zip(system.joints, system.columns, strict=True)}
    twists = np.concatenate([assembled.links[body.name].twist for body in assembled.topology.bodies])
    matrix = system.C.toarray()
    for joint in assembled.topology.loops:
        opening = loop_openings(
            joint.loop,
            assembled.links[joint.loop.link1],
            assembled.links[joint.loop.link2],
            chain.length_scale,
            wound_in(chain, joint.loop.cable, q),
        )
        if np.abs(opening).max() > CONSISTENT:
            raise InputError(
                f"q does not keep loop '{joint.name}' closed: a row is off by {np.abs(opening).max():.3g}, in robot "
                "sizes or radians; see close_loops"
            )
        columns = names[joint.name]
        rate = matrix[:, columns].T @ twists
        left = matrix[:, columns].T @ bodies - system.c_a[columns]
        for what, value, size in (("v", rate, twists), ("a", left, bodies)):
            worst = float(np.abs(value).max(initial=0.0))
            if worst > CONSISTENT * max(1.0, float(np.abs(size).max())):
                raise InputError(
                    f"{what} does not keep loop '{joint.name}' closed: {worst:.3g} is left over; see platform_motion"
                )


def _require_coupled(chain: ClosedChain, q: Configuration, v: Tangent, a: Tangent) -> None:
    for coupling in chain.couplings:
        opening = coupling_opening(chain, coupling, q, v, a)
        entry = chain.model.joints[chain.model.getJointId(coupling.joint1)].idx_v
        for what, left, size in zip("qva", opening, (np.zeros(1), v, a), strict=True):
            if abs(left) > CONSISTENT * chain.tangent_scale[entry] * max(1.0, float(np.abs(size).max())):
                raise InputError(
                    f"{what} does not keep coupling '{coupling.name}' of joint '{coupling.joint1}': {left:.3g} is left "
                    "over; see close_loops and platform_motion"
                )


def _tangent_acceleration(assembled: AssembledSystem, bodies: FloatArray, demand: Tangent) -> Tangent:
    """Joint accelerations from the bodies' accelerations; where no body takes part, the demand."""
    at = {body.name: bodies[6 * k : 6 * k + 6] for k, body in enumerate(assembled.topology.bodies)}
    a = demand.copy()
    for compound, freedom in zip(assembled.topology.tree, assembled.freedoms, strict=True):
        relative = at[compound.successor] - at[compound.predecessor] - freedom.bias
        axes = motion_about(freedom.origin, freedom.axes)
        a[freedom.index] = np.linalg.lstsq(axes, motion_about(freedom.origin, relative), rcond=None)[0]
    return a


def _require_held(chain: ClosedChain, assembled: AssembledSystem, unknowns: FloatArray, a: Tangent) -> None:
    """Refuse when the platform does not do what was asked."""
    if chain.platform is None:
        return
    system = assembled.system
    carrier = chain.platform
    while carrier not in system.bodies:
        carrier = next(joint.parent for joint in chain.mechanism.joints if joint.child == carrier)
    k = system.bodies.index(carrier)
    rows = slice(6 * k, 6 * k + 6)
    motion = _motion_scale(system, chain.length_scale)
    # In natural units, so that the unit of length decides nothing.
    asked, done = (x[rows] / motion[rows] for x in (_demanded(assembled, a), unknowns))
    if np.abs(asked - done).max() <= CONSISTENT * max(1.0, float(np.abs(asked).max())):
        return
    direction = (asked - done) / np.abs(asked - done).max()
    raise ActuationError(
        "the motors cannot hold the robot here: the platform does not follow the motors, it misses "
        f"({', '.join(f'{x:+.3g}' for x in direction)}) of its spatial acceleration; move away from this "
        "configuration, add a motor, or pass throw=False for least squares",
        smallest_singular_value=0.0,
        direction=direction,
        names=tuple(f"{carrier} {axis}" for axis in ("vx", "vy", "vz", "wx", "wy", "wz")),
    )
