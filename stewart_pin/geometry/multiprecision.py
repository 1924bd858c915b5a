"""Newton's method on the six leg equations with as many digits as wanted (extra ``precision``)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from stewart_pin.errors import ConvergenceError, MissingExtraError, SingularityError
from stewart_pin.typing import FloatArray

_GUARD_DIGITS = 20
"""Digits carried beyond those asked for: the loss to the condition of the Jacobian."""
_NAMES = ("x", "y", "z", "psi", "theta", "phi")


@dataclass(frozen=True, eq=False)
class RefinedPose:
    """A pose known to many digits.

    Attributes
    ----------
    position
        (3,) platform origin in the base frame, rounded to double precision [m].
    rotation
        (3, 3) platform axes in the base frame, rounded to double precision.
    residuals
        Norm of the six leg-length errors after each step [m].
    decimals
        Decimal strings of ``x y z`` [m] and ``psi theta phi`` [rad], R = Rz(ψ) Ry(θ) Rx(φ).
    """

    position: FloatArray
    rotation: FloatArray
    residuals: tuple[float, ...]
    decimals: dict[str, str]


def refine_pose(
    base_points: FloatArray,
    platform_points: FloatArray,
    lengths: FloatArray,
    position: FloatArray,
    rotation: FloatArray,
    *,
    digits: int,
) -> RefinedPose:
    """Refine a pose until its residual is below 10 to the power of minus `digits`.

    The doubles in geometry and lengths are taken as exact.

    Parameters
    ----------
    base_points, platform_points
        (6, 3) leg ends in their frames [m].
    lengths
        (6,) leg lengths [m].
    position
        (3,) platform origin in the base frame, good to double precision [m].
    rotation
        (3, 3) platform axes in the base frame, good to double precision.
    digits
        Decimal digits.

    Returns
    -------
    RefinedPose
        With the residual of every step.

    Raises
    ------
    ConvergenceError
        If the steps stop reducing the residual before the digits are reached.
    SingularityError
        If the pose is singular.
    """
    mp = _mpmath()
    with mp.workdps(digits + _GUARD_DIGITS):
        base, arms, goal = _matrix(mp, base_points), _matrix(mp, platform_points), _matrix(mp, lengths)
        p, r = _matrix(mp, position), _orthonormal(mp, _matrix(mp, rotation))
        residuals: list[float] = []
        gap, jacobian = _equations(mp, base, arms, goal, p, r)
        while mp.norm(gap) >= mp.mpf(10) ** -digits:
            try:
                step = mp.lu_solve(jacobian, -gap)
            except ZeroDivisionError:
                raise SingularityError(
                    "the pose to be refined is singular; its digits are not determined",
                    smallest_singular_value=0.0,
                ) from None
            p, r = p + step[:3], _exponential(mp, step[3:]) * r
            gap, jacobian = _equations(mp, base, arms, goal, p, r)
            residuals.append(float(mp.norm(gap)))
            if len(residuals) > 10 + digits.bit_length():
                raise ConvergenceError(
                    f"{digits} digits were not reached: residual {residuals[-1]:.3g} m; the pose is nearly "
                    "singular, ask for fewer digits",
                    residual=residuals[-1],
                )
        numbers = [*p, *_angles(mp, r)]
        decimals = {n: mp.nstr(v, digits, strip_zeros=False) for n, v in zip(_NAMES, numbers, strict=True)}
        return RefinedPose(_doubles(p)[:, 0], _doubles(r), tuple(residuals), decimals)


def _mpmath() -> Any:
    try:
        import mpmath  # noqa: PLC0415
    except ImportError:
        raise MissingExtraError("mpmath", "precision") from None
    return mpmath


def _equations(mp: Any, base: Any, arms: Any, goal: Any, p: Any, r: Any) -> tuple[Any, Any]:
    gap, jacobian = mp.matrix(6, 1), mp.matrix(6, 6)
    for i in range(6):
        arm = r * arms[i, :].T
        leg = p + arm - base[i, :].T
        length = mp.norm(leg)
        gap[i] = length - goal[i]
        u = leg / length
        jacobian[i, :3] = u.T
        jacobian[i, 3:] = _cross(mp, arm, u).T
    return gap, jacobian


def _exponential(mp: Any, turn: Any) -> Any:
    # Rodrigues; the series keeps full precision at the tiny turns of the last steps.
    skew = mp.matrix([[0, -turn[2], turn[1]], [turn[2], 0, -turn[0]], [-turn[1], turn[0], 0]])
    angle = mp.norm(turn)
    if angle == 0:
        return mp.eye(3)
    half = mp.sin(angle / 2) / (angle / 2)
    return mp.eye(3) + mp.sin(angle) / angle * skew + half**2 / 2 * skew * skew


def _orthonormal(mp: Any, r: Any) -> Any:
    # Newton iteration for the polar factor; quadratic from a rotation in double precision.
    while mp.norm(r.T * r - mp.eye(3)) > mp.mpf(10) ** (3 - mp.mp.dps):
        r = (r + mp.inverse(r).T) / 2
    return r


def _angles(mp: Any, r: Any) -> tuple[Any, Any, Any]:
    psi = mp.atan2(r[1, 0], r[0, 0])
    theta = mp.atan2(-r[2, 0], mp.hypot(r[0, 0], r[1, 0]))
    return psi, theta, mp.atan2(r[2, 1], r[2, 2])


def _cross(mp: Any, a: Any, b: Any) -> Any:
    return mp.matrix([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _matrix(mp: Any, array: FloatArray) -> Any:
    return mp.matrix(array.tolist())


def _doubles(matrix: Any) -> FloatArray:
    return np.array(matrix.tolist(), dtype=float)
