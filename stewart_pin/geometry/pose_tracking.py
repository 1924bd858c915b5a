"""Follow the pose of a six-legged platform along a path of leg lengths without ever changing assembly mode.

Where det J = 0 two assembly modes meet, and a plain Newton iteration that steps over such a fold comes out
on the other one. Here every step is cut until the smallest singular value of the leg Jacobian changes by a
modest factor only, so a fold is approached and never passed: the tracker stops there and says so.

References
----------
.. [1] J.-P. Merlet, "Parallel Robots", 2nd ed., Springer, 2006, section 4.4 and chapter 6.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.errors import InputError
from stewart_pin.geometry.hexapod import Hexapod, leg_lengths
from stewart_pin.geometry.hexapod_pose import as_leg_lengths, hexapod_pose, move, robot_size, scaled_jacobian
from stewart_pin.typing import ArrayLike, FloatArray

Event = Literal["finished", "fold", "lost"]

_NOISE = 8 * np.finfo(float).eps
"""Round-off of a leg length, relative to the robot's size."""
_LEAST_STEP = 1e-9
"""Fraction of the way between two samples below which the tracker gives up."""
_KEPT = 0.5
"""Least ratio of the smallest singular value after a step to that before."""
_CONTRACTION = 0.2
"""Greatest ratio of successive corrections."""
_SINGULAR = 1e-2
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
            event = "fold" if _ratio(hexapod, pose, size) < _SINGULAR else "lost"
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
