"""Poses of a six-legged platform from its leg lengths: one, in double precision or to any number of digits; a path's.

Levenberg–Marquardt on the six leg equations; the pose moves on the manifold, R ← exp(ω) R. Steps are clamped
and may not change the sign of det J, so the answer lies on the guess's side of every singularity.

References
----------
.. [1] J.-P. Merlet, "Parallel Robots", 2nd ed., Springer, 2006, section 4.4 (numerical direct kinematics) and
   chapter 6 (singularities).
.. [2] K. Madsen, H. B. Nielsen, O. Tingleff, "Methods for Non-Linear Least Squares Problems",
   DTU, 2004, chapter 3.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array
from stewart_pin.errors import ClosureError, InputError, SingularityError
from stewart_pin.geometry.hexapod import Hexapod, leg_jacobian, leg_lengths, require_hexapod
from stewart_pin.geometry.multiprecision import refine_pose
from stewart_pin.geometry.rotations import as_rotation
from stewart_pin.typing import ArrayLike, FloatArray

_SINGULAR = 1e-9
"""Smallest over largest singular value of the scaled leg Jacobian below which a pose counts as singular."""
_MAX_TURN = 0.3
"""Greatest turn in one step [rad]; the greatest shift is this times the size of the robot."""
_ROUND_OFF = 16 * np.finfo(float).eps
"""Residual over the size of the robot that double precision can reach."""


@dataclass(frozen=True, eq=False, repr=False)
class HexapodPose(Brief):
    """A pose of the platform; unpacks as ``position, rotation``.

    Attributes
    ----------
    position
        (3,) platform origin in the base frame [m].
    rotation
        (3, 3) platform axes in the base frame.
    residual
        Norm of the six leg-length errors reached [m].
    residuals
        The same after every step, the guess first; zero where it is below the least double [m].
    iterations
        Steps taken.
    success
        Whether the tolerance was met.
    decimals
        Decimal strings of ``x y z`` [m] and ``psi theta phi`` [rad] with R = Rz(ψ) Ry(θ) Rx(φ), when digits
        were asked for; else None.
    """

    position: FloatArray
    rotation: FloatArray
    residual: float
    residuals: tuple[float, ...]
    iterations: int
    success: bool
    decimals: dict[str, str] | None = None

    def __iter__(self) -> Iterator[FloatArray]:
        return iter((self.position, self.rotation))

    def __len__(self) -> int:
        return 2

    def __getitem__(self, index: int | slice) -> FloatArray | tuple[FloatArray, ...]:
        return (self.position, self.rotation)[index]


def hexapod_pose(
    hexapod: Hexapod,
    lengths: ArrayLike,
    *,
    guess: tuple[ArrayLike, ArrayLike],
    digits: int | None = None,
    tolerance: float | None = None,
    max_iterations: int = 100,
    throw: bool = True,
) -> HexapodPose:
    """Find the pose near a guess that has the given leg lengths.

    Parameters
    ----------
    hexapod
        Geometry.
    lengths
        (6,) leg lengths [m].
    guess
        Position (3,) in the base frame [m] and rotation (3, 3) to start from.
    digits
        Refine in multiprecision until the residual is below 10 to the power of minus this many [m];
        needs the extra ``precision``.
    tolerance
        Norm of the leg-length errors to reach in double precision [m]; default: round-off.
    max_iterations
        Greatest number of steps in double precision.
    throw
        Raise when the search fails; else return the best pose with ``success=False``.

    Returns
    -------
    HexapodPose
        Unpacks as ``position, rotation``.

    Raises
    ------
    ClosureError
        If the lengths were not reached on this side of the singularities.
    SingularityError
        If the search began or ended at a singular pose.

    Examples
    --------
    >>> at = lambda degrees: np.array([[np.cos(a), np.sin(a), 0.0] for a in np.radians(degrees)])
    >>> hexapod = Hexapod(at([10, 110, 130, 230, 250, 350]), 0.6 * at([50, 70, 170, 190, 290, 310]))
    >>> lengths = leg_lengths(hexapod, [0.0, 0.1, 2.0], np.eye(3))
    >>> position, rotation = hexapod_pose(hexapod, lengths, guess=([0.0, 0.0, 2.0], np.eye(3)))
    >>> bool(np.abs(position - [0.0, 0.1, 2.0]).max() < 1e-12)
    True
    """
    wanted = as_leg_lengths(lengths, (6,))
    position = as_array("guess[0]", guess[0], (3,))
    rotation = as_rotation("guess[1]", guess[1])
    if digits is not None and not 1 <= digits <= 10_000:
        raise InputError(f"digits must lie between 1 and 10000, got {digits}")
    size = robot_size(hexapod, wanted)
    goal = tolerance if tolerance is not None else _ROUND_OFF * size
    position, rotation, residuals = _descend(hexapod, wanted, position, rotation, goal, max_iterations, size)
    pose = HexapodPose(
        position, rotation, residuals[-1], residuals, len(residuals) - 1, bool(residuals[-1] <= goal)
    )
    if not pose.success:
        return _fail(hexapod, pose, goal, throw)
    return pose if digits is None else _with_digits(hexapod, wanted, pose, digits)


def as_leg_lengths(lengths: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """Check leg lengths: finite and above zero.

    Parameters
    ----------
    lengths
        What the caller passed [m].
    shape
        Required shape; None stands for any length.

    Returns
    -------
    numpy.ndarray
        The value as float64 [m].

    Raises
    ------
    InputError
        If a length is zero or negative.
    """
    array = as_array("lengths", lengths, shape)
    if (array <= 0.0).any():
        where = tuple(int(i) for i in np.argwhere(array <= 0.0)[0])
        raise InputError(f"lengths must be above zero, got {array[where]} at index {where}")
    return array


def robot_size(hexapod: Hexapod, lengths: FloatArray) -> float:
    """Give one length that scales all others: the greatest of the two point clouds and the legs.

    Parameters
    ----------
    hexapod
        Geometry.
    lengths
        (..., 6) leg lengths [m].

    Returns
    -------
    float
        The size [m].
    """
    require_hexapod(hexapod)
    clouds = (hexapod.base_points, hexapod.platform_points)
    return float(max([np.abs(c - c.mean(axis=0)).max() for c in clouds] + [lengths.max()]))


def scaled_jacobian(hexapod: Hexapod, position: FloatArray, rotation: FloatArray, size: float) -> FloatArray:
    """Compute the leg Jacobian with turns measured in units of 1/size, so that its rows have no unit.

    Parameters
    ----------
    hexapod
        Geometry.
    position
        (..., 3) platform origin in the base frame [m].
    rotation
        (..., 3, 3) platform axes in the base frame.
    size
        Length that turns a turn into a shift [m].

    Returns
    -------
    numpy.ndarray
        (..., 6, 6) dimensionless.
    """
    jacobian = leg_jacobian(hexapod, position, rotation)
    jacobian[..., 3:] /= size
    return jacobian


def move(position: FloatArray, rotation: FloatArray, step: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Move a pose by a displacement of the platform origin and a turn in base axes.

    Parameters
    ----------
    position
        (3,) platform origin in the base frame [m].
    rotation
        (3, 3) platform axes in the base frame.
    step
        (6,) shift [m] and turn [rad].

    Returns
    -------
    position : numpy.ndarray
        (3,) moved origin in the base frame [m].
    rotation : numpy.ndarray
        (3, 3) exp(turn) R.
    """
    return position + step[:3], Rotation.from_rotvec(step[3:]).as_matrix() @ rotation


def _descend(
    hexapod: Hexapod,
    wanted: FloatArray,
    position: FloatArray,
    rotation: FloatArray,
    goal: float,
    max_iterations: int,
    size: float,
) -> tuple[FloatArray, FloatArray, tuple[float, ...]]:
    gap = leg_lengths(hexapod, position, rotation) - wanted
    jacobian = scaled_jacobian(hexapod, position, rotation, size)
    _require_regular(jacobian, "the guess")
    side = np.linalg.slogdet(jacobian)[0]
    residuals, damping = [float(np.linalg.norm(gap))], 0.0
    while len(residuals) <= max_iterations and damping < 1e8 and residuals[-1] > goal:
        step = _clamped_step(jacobian, gap, damping, size)
        trial = move(position, rotation, step)
        trial_gap = leg_lengths(hexapod, *trial) - wanted
        trial_jacobian = scaled_jacobian(hexapod, *trial, size)
        better = np.linalg.norm(trial_gap) < residuals[-1]
        # A step across det J = 0 would land in another assembly mode.
        if not better or np.linalg.slogdet(trial_jacobian)[0] != side:
            if np.linalg.norm(step[:3]) < _ROUND_OFF * size and np.linalg.norm(step[3:]) < _ROUND_OFF:
                break
            damping = max(10.0 * damping, 1e-6)
            continue
        position, rotation = trial
        gap, jacobian, damping = trial_gap, trial_jacobian, 0.1 * damping if damping > 1e-9 else 0.0
        residuals.append(float(np.linalg.norm(gap)))
    return position, rotation, tuple(residuals)


def _clamped_step(jacobian: FloatArray, gap: FloatArray, damping: float, size: float) -> FloatArray:
    u, s, vt = np.linalg.svd(jacobian)
    weights = s / (s**2 + damping * s[0] ** 2) if damping > 0.0 else 1.0 / np.maximum(s, 1e-14 * s[0])
    step = -(vt.T * weights) @ (u.T @ gap)
    step *= min(1.0, _MAX_TURN * size / max(np.linalg.norm(step), 1e-300))
    step[3:] /= size
    return step


def _require_regular(jacobian: FloatArray, where: str) -> None:
    singular = np.linalg.svd(jacobian, compute_uv=False)
    if singular[-1] <= _SINGULAR * singular[0]:
        raise SingularityError(
            f"{where} is a singular pose (smallest singular value {singular[-1]:.3g} of the leg Jacobian, "
            f"turns in units of the robot's size); lengths do not fix the pose there, start elsewhere",
            smallest_singular_value=float(singular[-1]),
        )


def _fail(hexapod: Hexapod, pose: HexapodPose, goal: float, throw: bool) -> HexapodPose:
    if not throw:
        return pose
    size = robot_size(hexapod, leg_lengths(hexapod, pose.position, pose.rotation))
    _require_regular(scaled_jacobian(hexapod, pose.position, pose.rotation, size), "the end of the search")
    quaternion = Rotation.from_matrix(pose.rotation).as_quat()
    raise ClosureError(
        f"no pose with these leg lengths was reached: residual {pose.residual:.3g} m after {pose.iterations} "
        f"steps (tolerance {goal:.3g} m); give a guess on the solution's side of the singularities, or list "
        f"all poses with assembly_modes",
        residual=pose.residual,
        iterations=pose.iterations,
        q=np.concatenate([pose.position, quaternion]),
    )


def _with_digits(hexapod: Hexapod, wanted: FloatArray, pose: HexapodPose, digits: int) -> HexapodPose:
    refined = refine_pose(
        hexapod.base_points, hexapod.platform_points, wanted, pose.position, pose.rotation, digits=digits
    )
    residuals = pose.residuals + refined.residuals
    return HexapodPose(
        refined.position,
        refined.rotation,
        residuals[-1],
        residuals,
        len(residuals) - 1,
        True,
        refined.decimals,
    )


# ----------------------------------------------------------------------------------------------------
# Follow the pose along a path of leg lengths without ever changing assembly mode
#
# Where det J = 0 two assembly modes meet, and a plain Newton iteration that steps over such a fold comes out
# on the other one. Here every step is cut until the smallest singular value of the leg Jacobian changes by a
# modest factor only, so a fold is approached and never passed: the tracker stops there and says so.
# ----------------------------------------------------------------------------------------------------

Event = Literal["finished", "fold", "lost"]

_NOISE = 8 * np.finfo(float).eps
"""Round-off of a leg length, relative to the robot's size."""
_LEAST_STEP = 1e-9
"""Fraction of the way between two samples below which the tracker gives up."""
_KEPT = 0.5
"""Least ratio of the smallest singular value after a step to that before."""
_CONTRACTION = 0.2
"""Greatest ratio of successive corrections."""
_NEAR_FOLD = 1e-2
"""A stop is called a fold when the smallest over the largest singular value is below this."""


@dataclass(frozen=True, eq=False, repr=False)
class TrackedPose(Brief):
    """The poses along a path of leg lengths, as far as they go.

    Attributes
    ----------
    position
        (k, 3) platform origins in the base frame, one for each sample reached [m].
    rotation
        (k, 3, 3) platform axes in the base frame.
    event
        ``"finished"``; ``"fold"`` when the legs drive the platform into a singular pose between samples k -
        1 and k; ``"lost"`` when the next sample could not be reached for another reason.
    last_position
        (3,) the last valid pose, at or after the last sample reached: platform origin in the base frame [m].
    last_rotation
        (3, 3) its platform axes in the base frame.
    last_lengths
        (6,) its leg lengths [m].
    smallest_singular_value
        Of the leg Jacobian at the last valid pose, turns in units of the robot's size, dimensionless.
    substeps
        Steps taken.
    """

    position: FloatArray
    rotation: FloatArray
    event: Event
    last_position: FloatArray
    last_rotation: FloatArray
    last_lengths: FloatArray
    smallest_singular_value: float
    substeps: int

    @property
    def success(self) -> bool:
        """Whether the whole path was followed."""
        return self.event == "finished"


def track_pose(
    hexapod: Hexapod,
    lengths_path: ArrayLike,
    *,
    start: tuple[ArrayLike, ArrayLike],
    max_substeps: int = 100_000,
) -> TrackedPose:
    """Follow the pose along a path of leg lengths, straight between the samples.

    The sign of det J never changes.

    Parameters
    ----------
    hexapod
        Geometry.
    lengths_path
        (N, 6) leg lengths [m].
    start
        Position (3,) [m] and rotation (3, 3) near the pose of the first sample.
    max_substeps
        Greatest number of steps in all.

    Returns
    -------
    TrackedPose
        Look at ``event``: a fold ends the path early.

    Raises
    ------
    InputError
        If the path is empty.
    ClosureError
        If the first sample cannot be reached from `start`.
    SingularityError
        If `start` is singular.
    """
    path = as_leg_lengths(lengths_path, (None, 6))
    if len(path) == 0:
        raise InputError("lengths_path must hold at least one sample")
    first = hexapod_pose(hexapod, path[0], guess=start)
    pose = first.position, first.rotation
    size = robot_size(hexapod, path)
    poses, here, fraction, substeps = [pose], path[0], 1.0, 0
    event: Event = "finished"
    for goal in path[1:]:
        done = 0.0
        begin = here
        while done < 1.0 and fraction >= _LEAST_STEP and substeps < max_substeps:
            reach = min(1.0, done + fraction)
            lengths = goal if reach == 1.0 else begin + reach * (goal - begin)
            trial = _step(hexapod, pose, lengths, size)
            substeps += 1
            if trial is None:
                fraction = 0.5 * (reach - done)
                continue
            pose, here, done, fraction = trial, lengths, reach, min(1.0, 2.0 * fraction)
        if done < 1.0:
            event = "fold" if _ratio(hexapod, pose, size) < _NEAR_FOLD else "lost"
            break
        poses.append(pose)
    smallest = np.linalg.svd(scaled_jacobian(hexapod, pose[0], pose[1], size), compute_uv=False)[-1]
    position, rotation = (np.array(part) for part in zip(*poses, strict=True))
    lengths = leg_lengths(hexapod, pose[0], pose[1])
    return TrackedPose(position, rotation, event, pose[0], pose[1], lengths, float(smallest), substeps)


def _ratio(hexapod: Hexapod, pose: tuple[FloatArray, FloatArray], size: float) -> float:
    values = np.linalg.svd(scaled_jacobian(hexapod, pose[0], pose[1], size), compute_uv=False)
    return float(values[-1] / values[0])


def _step(
    hexapod: Hexapod, pose: tuple[FloatArray, FloatArray], lengths: FloatArray, size: float
) -> tuple[FloatArray, FloatArray] | None:
    """Predict along the tangent and correct by Newton; None when the step is too long to be safe."""
    position, rotation = pose
    jacobian = scaled_jacobian(hexapod, position, rotation, size)
    before = np.linalg.svd(jacobian, compute_uv=False)[-1]
    side, previous, after = np.linalg.slogdet(jacobian)[0], np.inf, before
    for attempt in range(8):
        gap = leg_lengths(hexapod, position, rotation) - lengths
        # The first pass is the tangent predictor, the others correct it.
        step = -np.linalg.solve(jacobian, gap)
        correction = np.linalg.norm(step) / size
        # Next to a fold round-off of the lengths moves the pose by this much, and no correction gets smaller.
        noise = max(1e-13, _NOISE / after)
        if correction > (0.2 if attempt == 0 else max(_CONTRACTION * previous, noise)):
            return None
        position, rotation = move(position, rotation, step / np.array([1, 1, 1, size, size, size]))
        jacobian = scaled_jacobian(hexapod, position, rotation, size)
        sign, after = np.linalg.slogdet(jacobian)[0], np.linalg.svd(jacobian, compute_uv=False)[-1]
        if sign != side or after < _KEPT * before:
            return None
        if correction < noise:
            return position, rotation
        previous = correction
    return None
