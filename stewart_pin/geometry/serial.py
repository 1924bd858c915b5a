"""Arms with three joints in closed form: the planar one, all its configurations; the spatial one, its velocities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import product

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array, as_batch, require_broadcast
from stewart_pin.errors import InputError, SingularityError
from stewart_pin.tolerances import ROUND_OFF
from stewart_pin.typing import ArrayLike, FloatArray


class ArmReach(StrEnum):
    """How a pose lies to the reach of an arm."""

    REGULAR = "regular"
    """Two elbows."""
    STRETCHED = "stretched"
    """On the outer edge: the elbows coincide, straight; the arm is singular."""
    FOLDED = "folded"
    """On the inner edge: the elbows coincide, folded back; the arm is singular."""
    POSITIVE_DIMENSIONAL = "positive-dimensional"
    """Links 1 and 2 of equal length, folded back on joint 1: any first angle will do."""
    TOO_FAR = "too far"
    """Out of reach, beyond the outer edge."""
    TOO_NEAR = "too near"
    """Out of reach, inside the inner edge."""


@dataclass(frozen=True, eq=False, repr=False)
class ArmBranches(Brief):
    """All configurations of a planar arm for one pose of its hand.

    Attributes
    ----------
    configurations
        (n, 3) joint angles, elbow at the right of the line from joint 1 to the wrist first (θ2 > 0) [rad].
    elbow
        (n,) sign of sin θ2: +1, -1, or 0 where the elbows coincide [1].
    reach
        Why there are as many.
    excess
        Distance of the wrist from the nearest point that joint 3 can take; 0 within reach [m].
    wrist
        (2,) position of joint 3 [m].
    """

    configurations: FloatArray
    elbow: FloatArray
    reach: ArmReach
    excess: float
    wrist: FloatArray


def planar_arm_configurations(
    lengths: ArrayLike, position: ArrayLike, angle: float, *, limits: ArrayLike | None = None
) -> FloatArray:
    """Find all joint angles of a planar arm that put its hand at a pose.

    `planar_arm_branches` gives the same with the reason why there are as many.

    Parameters
    ----------
    lengths
        (3,) link lengths L1, L2, L3 [m].
    position
        (2,) tip Px, Py in the base frame, joint 1 at the origin [m].
    angle
        Direction of the last link, φ = θ1 + θ2 + θ3 [rad].
    limits
        (3, 2) least and greatest angle of each joint; default: none, angles in (-π, π] [rad].

    Returns
    -------
    numpy.ndarray
        (n, 3) joint angles; n is 2, 1 where the elbows coincide, 0 out of reach. With limits, everything inside
        them: fewer where a branch violates them, more where a joint can take the same place after a full turn [rad].

    Raises
    ------
    InputError
        If an argument has the wrong shape, is not finite, or a length is not above zero.
    SingularityError
        If any first angle will do: links 1 and 2 are equally long and the wrist is on joint 1.

    Examples
    --------
    >>> planar_arm_configurations([0.5, 0.4, 0.2], [0.3, 0.7], 1.0).round(4)
    array([[ 0.4639,  1.7989, -1.2628],
           [ 1.9849, -1.7989,  0.814 ]])
    """
    branches = planar_arm_branches(lengths, position, angle, limits=limits)
    if branches.reach is ArmReach.POSITIVE_DIMENSIONAL:
        raise SingularityError(
            "links 1 and 2 are equally long and the wrist is on joint 1, so any first angle will do; "
            "choose it, or see planar_arm_branches for one of them",
            smallest_singular_value=0.0,
            direction=np.array([1.0, 0.0, -1.0]) / np.sqrt(2.0),
            names=("θ1", "θ2", "θ3"),
        )
    return branches.configurations


def planar_arm_branches(
    lengths: ArrayLike, position: ArrayLike, angle: float, *, limits: ArrayLike | None = None
) -> ArmBranches:
    """Find all joint angles of a planar arm for a pose of its hand, and say why there are as many.

    Parameters
    ----------
    lengths
        (3,) link lengths L1, L2, L3 [m].
    position
        (2,) tip Px, Py in the base frame, joint 1 at the origin [m].
    angle
        Direction of the last link, φ = θ1 + θ2 + θ3 [rad].
    limits
        (3, 2) least and greatest angle of each joint; default: none, angles in (-π, π] [rad].

    Returns
    -------
    ArmBranches
        Configurations and reach; where any first angle will do, the one with θ1 = 0.

    Raises
    ------
    InputError
        If an argument has the wrong shape, is not finite, or a length is not above zero.

    Notes
    -----
    The wrist (joint 3) is at w = (Px - L3 cos φ, Py - L3 sin φ), which leaves a triangle of sides L1, L2, ``d = |w|``:

        tan² (θ2 / 2) = ((L1 + L2)² - d²) / (d² - (L1 - L2)²)
        θ1 = atan2(wy, wx) - atan2(L2 sin θ2, L1 + L2 cos θ2),  θ3 = φ - θ1 - θ2

    This is the law of cosines by half the angle: within reach both sides of the fraction are positive, and no cosine
    has to be clipped.
    """
    one, two, hand = as_link_lengths(lengths)
    angle = float(as_array("angle", angle, ()))
    wrist = as_array("position", position, (2,)) - hand * np.array([np.cos(angle), np.sin(angle)])
    limits = None if limits is None else _as_limits(limits)
    distance = float(np.hypot(*wrist))
    # The wrist is a difference of numbers up to this size, and as uncertain as they are.
    reach, excess = _reach(one, two, distance, one + two + distance + 2 * hand)
    found, signs = [], []
    for second in _elbows(one, two, distance, reach):
        first = 0.0
        if reach is not ArmReach.POSITIVE_DIMENSIONAL:
            first = np.arctan2(wrist[1], wrist[0]) - np.arctan2(
                two * np.sin(second), one + two * np.cos(second)
            )
        angles = _principal(np.array([first, second, angle - first - second]))
        for configuration in [angles] if limits is None else _within(angles, limits):
            found.append(configuration)
            signs.append(np.sign(second) if reach is ArmReach.REGULAR else 0.0)
    return ArmBranches(np.array(found).reshape(-1, 3), np.array(signs), reach, excess, wrist)


def planar_arm_pose(lengths: ArrayLike, angles: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Locate the hand of a planar arm.

    Parameters
    ----------
    lengths
        (3,) link lengths L1, L2, L3 [m].
    angles
        (..., 3) joint angles [rad].

    Returns
    -------
    position : numpy.ndarray
        (..., 2) tip in the base frame [m].
    angle : numpy.ndarray
        (...) direction of the last link, φ = θ1 + θ2 + θ3 [rad].
    """
    lengths = as_link_lengths(lengths)
    angles = as_batch("angles", angles, (3,))
    directions = np.cumsum(angles, axis=-1)
    position = np.stack([np.cos(directions) @ lengths, np.sin(directions) @ lengths], axis=-1)
    return position, directions[..., 2]


def _reach(one: float, two: float, distance: float, size: float) -> tuple[ArmReach, float]:
    """Sort a wrist distance; near an edge round-off decides nothing."""
    slack = ROUND_OFF * size
    outer, inner = one + two, abs(one - two)
    if abs(distance - outer) <= slack:
        return ArmReach.STRETCHED, 0.0
    if abs(distance - inner) <= slack:
        return (ArmReach.POSITIVE_DIMENSIONAL if inner <= slack else ArmReach.FOLDED), 0.0
    if distance > outer:
        return ArmReach.TOO_FAR, distance - outer
    if distance < inner:
        return ArmReach.TOO_NEAR, inner - distance
    return ArmReach.REGULAR, 0.0


def _elbows(one: float, two: float, distance: float, reach: ArmReach) -> list[float]:
    """Angle θ2 of each branch."""
    match reach:
        case ArmReach.STRETCHED:
            return [0.0]
        case ArmReach.FOLDED | ArmReach.POSITIVE_DIMENSIONAL:
            return [np.pi]
        case ArmReach.REGULAR:
            straight = (one + two - distance) * (one + two + distance)
            folded = (distance - one + two) * (distance + one - two)
            second = 2 * float(np.arctan2(np.sqrt(straight), np.sqrt(folded)))
            return [second, -second]
        case _:
            return []


def _principal(angles: FloatArray) -> FloatArray:
    """Bring angles into (-π, π]."""
    return np.pi - np.mod(np.pi - angles, 2 * np.pi)


def _within(angles: FloatArray, limits: FloatArray) -> list[FloatArray]:
    """All full-turn copies of a configuration within limits."""
    slack = ROUND_OFF * 4 * np.pi
    turn = 2 * np.pi
    choices: list[Sequence[float]] = []
    for value, (low, high) in zip(angles, limits, strict=True):
        first, last = np.ceil((low - slack - value) / turn), np.floor((high + slack - value) / turn)
        choices.append([float(value + turn * k) for k in np.arange(first, last + 1)])
    return [np.array(choice) for choice in product(*choices)]


def as_link_lengths(lengths: ArrayLike) -> FloatArray:
    """Check the link lengths of a three-joint arm at the door.

    Parameters
    ----------
    lengths
        (3,) what the caller passed [m].

    Returns
    -------
    numpy.ndarray
        (3,) lengths as float64 [m].

    Raises
    ------
    InputError
        If the shape is wrong, or a length is not a finite number above zero.
    """
    lengths = as_array("lengths", lengths, (3,))
    if (lengths <= 0).any():
        raise InputError(f"lengths must be above zero, got {lengths.tolist()}")
    return lengths


def _as_limits(limits: ArrayLike) -> FloatArray:
    limits = as_array("limits", limits, (3, 2))
    if (limits[:, 0] > limits[:, 1]).any():
        raise InputError(f"limits must be (least, greatest) per joint, got {limits.tolist()}")
    return limits


# ----------------------------------------------------------------------------------------------------
# The spatial arm with a vertical joint and two parallel horizontal ones: velocities and Jacobians in closed form
#
# Frame {i} sits on joint i, z along its axis, x along the link; {4} is the tool. Joint 1 turns about z of the base, L1
# leads from axis 1 to axis 2, then z turns by 90° about x: axes 2 and 3 are horizontal. At q = 0 the arm is stretched
# along x of the base. c23 stands for cos(θ2 + θ3).
#
# References
# ----------
# .. [1] J. J. Craig, "Introduction to Robotics: Mechanics and Control", ch. 5: outward propagation of velocities.
# ----------------------------------------------------------------------------------------------------

_FRAMES = (3, 4)


@dataclass(frozen=True, eq=False, repr=False)
class LinkVelocities(Brief):
    """Velocities of the frames {1} to {4}, each in its own axes.

    Attributes
    ----------
    angular
        (..., 4, 3) angular velocities ⁱω_i [rad/s].
    linear
        (..., 4, 3) velocities ⁱv_i of the frame origins [m/s].
    """

    angular: FloatArray
    linear: FloatArray


def spatial_arm_velocities(lengths: ArrayLike, q: ArrayLike, rates: ArrayLike) -> LinkVelocities:
    """Propagate velocities outwards, from link to link.

    Parameters
    ----------
    lengths
        (3,) link lengths L1, L2, L3 [m].
    q
        (..., 3) joint angles [rad].
    rates
        (..., 3) joint rates [rad/s].

    Returns
    -------
    LinkVelocities
        Angular and linear velocity of every frame.

    Raises
    ------
    InputError
        If an argument has the wrong shape, is not finite, or a length is not above zero.

    Notes
    -----
    From frame i to frame i+1 at p in i, with the rotation R of i+1 in i (Craig, ch. 5):

        ω' = Rᵀ ω + θ' z,    v' = Rᵀ (v + ω × p).
    """
    lengths, q, rates = as_link_lengths(lengths), as_batch("q", q, (3,)), as_batch("rates", rates, (3,))
    require_broadcast(q=q.shape[:-1], rates=rates.shape[:-1])
    q, rates = np.broadcast_arrays(q, rates)
    zeros = np.zeros(q.shape[:-1])
    # The tool frame follows without a joint.
    q, rates = (np.concatenate([x, zeros[..., None]], axis=-1) for x in (q, rates))
    omega, velocity = np.zeros((2, *q.shape[:-1], 3))
    angular, linear = [], []
    for i, along in enumerate((0.0, *lengths)):
        velocity = velocity + np.cross(omega, [along, 0.0, 0.0])
        if i == 1:  # from {1} to {2}, z turns by 90° about x: (x, y, z) reads (x, z, -y)
            omega, velocity = (
                np.stack([x[..., 0], x[..., 2], -x[..., 1]], axis=-1) for x in (omega, velocity)
            )
        omega, velocity = (_turned(x, q[..., i]) for x in (omega, velocity))
        omega = omega + np.stack([zeros, zeros, rates[..., i]], axis=-1)
        angular.append(omega)
        linear.append(velocity)
    return LinkVelocities(np.stack(angular, axis=-2), np.stack(linear, axis=-2))


def spatial_arm_jacobian(
    lengths: ArrayLike, q: ArrayLike, *, frame: int = 4, axes: str = "base"
) -> FloatArray:
    """Map joint rates to the twist of frame {3} or of the tool frame {4}.

    Parameters
    ----------
    lengths
        (3,) link lengths L1, L2, L3 [m].
    q
        (..., 3) joint angles [rad].
    frame
        3 or 4: whose origin.
    axes
        ``"base"``, or ``"frame"`` for the frame's own axes ({3} and {4} have the same).

    Returns
    -------
    numpy.ndarray
        (..., 6, 3) such that [v; ω] = J @ rates [m and 1].

    Raises
    ------
    InputError
        If an argument has the wrong shape or value.

    Notes
    -----
    In the tool frame, with L = L1 + L2 c2 + L3 c23:

        ⁴v = [[0, L2 s3, 0], [0, L2 c3 + L3, L3], [-L, 0, 0]] θ',    ω = [[s23, 0, 0], [c23, 0, 0], [0, 1, 1]] θ'

    and {3} is the same with L3 = 0. Printed forms that circulate have L2 c3 for the element (2, 2), a bracket misplaced
    in (3, 1), and s2 s3 + c2 c3 for s23.
    """
    lengths, q = as_link_lengths(lengths), as_batch("q", q, (3,))
    if frame not in _FRAMES:
        raise InputError(f"frame must be one of {_FRAMES}, got {frame!r}")
    if axes not in ("base", "frame"):
        raise InputError(f"axes must be 'base' or 'frame', got {axes!r}")
    one, two, three = lengths[0], lengths[1], lengths[2] if frame == 4 else 0.0
    first, second, third = np.moveaxis(q, -1, 0)
    jacobian = np.zeros((*q.shape[:-1], 6, 3))
    (c1, s1), (c2, s2), (c3, s3) = ((np.cos(x), np.sin(x)) for x in (first, second, third))
    c23, s23 = np.cos(second + third), np.sin(second + third)
    reach = one + two * c2 + three * c23
    if axes == "frame":
        jacobian[..., 0, 1] = two * s3
        jacobian[..., 1, 1] = two * c3 + three
        jacobian[..., 1, 2] = three
        jacobian[..., 2, 0] = -reach
        jacobian[..., 3, 0], jacobian[..., 4, 0] = s23, c23
        jacobian[..., 5, 1:] = 1.0
        return jacobian
    sink = two * s2 + three * s23
    jacobian[..., 0, 0], jacobian[..., 1, 0] = -s1 * reach, c1 * reach
    for k, (down, out) in ((1, (sink, two * c2 + three * c23)), (2, (three * s23, three * c23))):
        jacobian[..., 0, k], jacobian[..., 1, k], jacobian[..., 2, k] = -c1 * down, -s1 * down, out
        jacobian[..., 3, k], jacobian[..., 4, k] = s1, -c1
    jacobian[..., 5, 0] = 1.0
    return jacobian


def _turned(vector: FloatArray, angle: FloatArray) -> FloatArray:
    """Express a vector in axes turned about z."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = np.moveaxis(vector, -1, 0)
    return np.stack([c * x + s * y, c * y - s * x, z], axis=-1)
