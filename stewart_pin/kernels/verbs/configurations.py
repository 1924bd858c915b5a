"""Whole configurations of arrays of poses or motor positions, or poses of motor positions; and what judges a state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from stewart_pin.errors import InputError
from stewart_pin.kernels.verbs.newton import Between, NewtonSteps, Plans, Solved, solve_on_branch
from stewart_pin.programs.status import StateBound, StateStatus
from stewart_pin.tolerances import SINGULAR, UNIT_QUATERNION
from stewart_pin.typing import ArrayLike, FloatArray

UNIT = 2 * UNIT_QUATERNION
"""Deviation of a squared quaternion from 1: twice that of its length which the one-state verbs allow."""


@dataclass(frozen=True, eq=False)
class Starts:
    """Where Newton's method starts: at home, or beside it where home is singular as a stretched arm is.

    Attributes
    ----------
    states
        (n, size) configurations or poses to try in turn [m, rad, unit quaternions].
    targets
        (n, m) poses or motor positions there [m, rad, unit quaternions].
    """

    states: FloatArray
    targets: FloatArray


def serves(steps: NewtonSteps, state: FloatArray, target: FloatArray) -> bool:
    """Whether steps can start from a state: they stay where nothing is to be done.

    Parameters
    ----------
    steps
        Towards a target.
    state
        (n,) configuration or pose [m, rad, unit quaternions].
    target
        (m,) what it meets: pose or motor positions [m, rad, unit quaternions].

    Returns
    -------
    bool
        Whether they do.
    """
    stays = steps.double(state, target, np.zeros(1))[0]
    return bool(np.allclose(stays, state, atol=1e-6))


def configurations(
    plans: Plans, starts: Starts, targets: FloatArray, between: Between, *, threads: int = 1
) -> Solved:
    """Find the configurations, or poses, that meet targets, on the branch of where they are looked for from.

    Parameters
    ----------
    plans
        Steps towards a target.
    starts
        From where, in turn.
    targets
        (N, 7) poses or (N, nu) motor positions [m, rad, unit quaternions].
    between
        Leads from one target to another.
    threads
        Number of threads.

    Returns
    -------
    Solved
        Configurations or poses.
    """
    found: Solved | None = None
    for q, met in zip(starts.states, starts.targets, strict=True):
        left = np.arange(len(targets)) if found is None else np.flatnonzero(~found.kept)
        if found is not None and not len(left):
            break

        def begin(
            rows: np.ndarray, q: FloatArray = q, met: FloatArray = met
        ) -> tuple[FloatArray, FloatArray]:
            return np.tile(q, (len(rows), 1)), np.tile(met, (len(rows), 1))

        aims = targets if len(left) == len(targets) else targets[left]
        solved = solve_on_branch(plans, q, begin, aims, between, threads=threads)
        found = solved if found is None else found.with_rows(left, solved)
    assert found is not None
    # Where home is singular branches meet, and any of them will do.
    return found if len(starts.states) == 1 else Solved(found.states, found.closed, found.closed)


def poses_between(begin: FloatArray, end: FloatArray, share: FloatArray) -> FloatArray:
    """Go from one pose to another along a screw, as the verbs of one state do.

    Parameters
    ----------
    begin, end
        (k, 7) position and unit quaternion x y z w [m].
    share
        (k,) of the way, dimensionless.

    Returns
    -------
    numpy.ndarray
        (k, 7) poses [m, unit quaternion].
    """
    first = Rotation.from_quat(begin[:, 3:])
    turn = (first.inv() * Rotation.from_quat(end[:, 3:])).as_rotvec()
    shift = first.inv().apply(end[:, :3] - begin[:, :3])
    # log6 and exp6: with V(φ) ρ the shift of the whole way, V(s φ) s ρ is that of a share s.
    rho = np.linalg.solve(_shifts(turn), shift[..., None])
    part = (_shifts(share[:, None] * turn) @ rho)[..., 0] * share[:, None]
    turned = first * Rotation.from_rotvec(share[:, None] * turn)
    return np.hstack([begin[:, :3] + first.apply(part), turned.as_quat()])


def _shifts(turn: FloatArray) -> FloatArray:
    """Left Jacobians of rotation vectors: (k, 3, 3)."""
    angle = np.linalg.norm(turn, axis=1)
    x, y, z = turn.T
    zero = np.zeros(len(turn))
    cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    half = np.sinc(angle / (2 * np.pi))
    small = angle < 1e-3
    safe = np.where(small, 1.0, angle)
    third = np.where(small, 1 / 6 - angle**2 / 120, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) + (half**2 / 2)[:, None, None] * cross + third[:, None, None] * (cross @ cross)


def as_rows(name: str, value: ArrayLike, size: int) -> tuple[FloatArray, bool]:
    """Read states that may hold nan, which becomes a code.

    Parameters
    ----------
    name
        Name of the argument, for the message.
    value
        (N, size) or (size,) [any unit].
    size
        Entries of a state.

    Returns
    -------
    rows : numpy.ndarray
        (N, size) or (1, size) [any unit].
    single : bool
        Whether there was no axis of states.

    Raises
    ------
    InputError
        If the shape is wrong.
    """
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} must be an array of numbers, got {type(value).__name__}") from None
    if array.ndim not in (1, 2) or array.shape[-1] != size:
        raise InputError(f"{name} must have shape (N, {size}) or ({size},), got {array.shape}")
    return np.atleast_2d(array), array.ndim == 1


def with_unit_quaternions(poses: FloatArray) -> FloatArray:
    """Strike out poses whose quaternion is not of unit length.

    Parameters
    ----------
    poses
        (N, 7) position and quaternion [m, dimensionless].

    Returns
    -------
    numpy.ndarray
        (N, 7) with nan for these [m, unit quaternion].
    """
    square = np.einsum("ni,ni->n", poses[:, 3:], poses[:, 3:])
    unit = np.abs(square - 1) <= UNIT
    if unit.all():
        return poses
    return np.where(unit[:, None], poses, np.nan)


def normalised(poses: FloatArray) -> FloatArray:
    """Give quaternions unit length; none has no direction, and becomes nan.

    Parameters
    ----------
    poses
        (N, 7) position and quaternion [m, dimensionless].

    Returns
    -------
    numpy.ndarray
        (N, 7) position and unit quaternion [m, unit quaternion].
    """
    length = np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    return np.hstack([poses[:, :3], poses[:, 3:] / np.where(length > 0, length, np.nan)])


def as_poses(position: FloatArray, rotation: FloatArray) -> FloatArray:
    """Join positions and rotations.

    Parameters
    ----------
    position
        (N, 3) [m].
    rotation
        (N, 3, 3) rotations; nan stays nan.

    Returns
    -------
    numpy.ndarray
        (N, 7) position and quaternion x y z w [m, unit quaternion].
    """
    found = np.full((len(rotation), 4), np.nan)
    good = np.isfinite(rotation).all(axis=(1, 2))
    if good.any():
        found[good] = Rotation.from_matrix(rotation[good]).as_quat()
    return np.hstack([position, found])


# ----------------------------------------------------------------------------------------------------
# Outputs that judge a state: feasible demands, closed loops, unit quaternions, and how near a singularity is
# ----------------------------------------------------------------------------------------------------

_FEASIBLE = {"f8": 1e-6, "f4": 1e-5}
"""Part of a demand that may be impossible: round-off of printed numbers, as in the one-state verbs; a hundred units of
round-off in single precision."""
_REGULAR = {"f8": SINGULAR, "f4": 1e-4}
"""Conditioning below which a state is singular: where the one-state verbs say so; in single precision with three digits
left."""
_FOUND = {"f8": 1e-4, "f4": 1e-2}
"""The same where the configuration was looked for with the motors held. Loops closed to 1e-12 leave it 1e-12 / c off,
and c itself a part 1e-12 / c² of its own: four digits are left. In single precision they close to 1e-6, and two are
left."""
POOR = 1e-2
"""Conditioning below which other pivots are tried."""


def judged(
    function: Any,
    measure: Any | None,
    dtype: np.dtype[Any],
    push: Any | None = None,
    *,
    graded: bool = False,
    wary: bool = False,
    found: bool = False,
) -> tuple[Any, list[StateBound]]:
    """Add the outputs that judge a state.

    Parameters
    ----------
    function
        `casadi.Function` of states.
    measure
        `casadi.Function` of its first input, with the conditioning of the state; None where nothing is divided by.
    dtype
        Type of the kernel.
    push
        `casadi.Function` of its first input and its wrenches: by how much these push idle motions without inertia;
        None where they cannot.
    graded
        Whether the conditioning is given back, as the last output, of singular states too; it needs a measure.
    wary
        Whether states that are `POOR` count as singular already, to be looked at again.
    found
        Whether the configuration was looked for with the motors held, and is known the less the nearer it is to a
        singularity.

    Returns
    -------
    function : casadi.Function
        With these outputs.
    bounds : list of StateBound
        What they must keep.
    """
    import casadi as ca  # noqa: PLC0415 - optional; there is a function already

    kind = dtype.str[1:]
    inputs = function.sx_in()
    outputs = dict(zip(function.name_out(), function.call(inputs), strict=True))
    bounds = [StateBound(name, upper=_FEASIBLE[kind]) for name in ("infeasible", "open") if name in outputs]
    if "resting" in outputs:
        bounds.append(StateBound("resting", upper=0.5, code=StateStatus.RESTING))
    if "pose" in function.name_in():
        quaternion = inputs[function.name_in().index("pose")][3:]
        outputs["quaternion_square"] = ca.dot(quaternion, quaternion)
        bounds.append(StateBound("quaternion_square", 1 - UNIT, 1 + UNIT))
    if push is not None:
        wrenches = inputs[function.name_in().index("wrenches")]
        outputs["pushed"] = push.call([inputs[0], wrenches])[0]
        bounds.append(StateBound("pushed", upper=_FEASIBLE[kind]))
    if measure is not None:
        outputs["conditioning"] = measure.call(inputs[:1])[0]
        least = POOR if wary else (_FOUND if found else _REGULAR)[kind]
        bounds.append(StateBound("conditioning", lower=least, code=StateStatus.SINGULAR, written=graded))
    results: Any = ca.cse(list(outputs.values()))
    return ca.Function(function.name(), inputs, results, function.name_in(), list(outputs)), bounds


def lost_on_the_way(conditioning: FloatArray) -> None:
    """Count, in place, what a motion that was looked for has lost already, and the dynamics lose again.

    Parameters
    ----------
    conditioning
        (N,) of the configurations c, dimensionless; becomes c³ where that is less: the error of a configuration, ε / c,
        is that of its velocity by 1 / c, and that of its acceleration by 1 / c again.
    """
    np.minimum(conditioning, conditioning**3, out=conditioning)
