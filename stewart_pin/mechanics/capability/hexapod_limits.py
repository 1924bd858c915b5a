"""Greatest speeds and loads of a six-legged platform from its geometry alone."""

from __future__ import annotations

from typing import Literal

import numpy as np

from stewart_pin.checks import as_array
from stewart_pin.errors import InputError, SingularityError
from stewart_pin.geometry.hexapod import Hexapod, leg_forces_for_wrench, leg_jacobian
from stewart_pin.mechanics.capability.enumeration import maximise
from stewart_pin.mechanics.capability.platform_space import as_limit
from stewart_pin.tolerances import JACOBIAN_SINGULAR
from stewart_pin.typing import ArrayLike, FloatArray


def velocity_limits(
    hexapod: Hexapod,
    position: ArrayLike,
    rotation: ArrayLike,
    *,
    rate_limit: ArrayLike,
    others: Literal["free", "zero"] = "free",
) -> FloatArray:
    """Find the greatest speed along x, y and z without turning.

    Parameters
    ----------
    hexapod
        Geometry.
    position
        (3,) platform origin in the base frame [m].
    rotation
        (3, 3) platform axes in the base frame.
    rate_limit
        (6,) or one number: largest absolute leg rate [m/s].
    others
        The other two components of the velocity: ``"free"`` to take any value (a linear programme for each axis), or
        ``"zero"`` for a motion straight along the axis.

    Returns
    -------
    numpy.ndarray
        (3,) greatest speed along each base axis [m/s].

    Raises
    ------
    SingularityError
        If the legs do not determine the platform's motion at this pose.
    InputError
        If an argument has the wrong shape, or a limit is not finite and above zero.
    """
    jacobian = leg_jacobian(
        hexapod, as_array("position", position, (3,)), as_array("rotation", rotation, (3, 3))
    )
    size = np.linalg.norm(hexapod.platform_points, axis=1).mean() or 1.0
    _require_regular(jacobian / [1, 1, 1, size, size, size], "the leg Jacobian")
    return velocity_limits_of_jacobian(jacobian[:, :3], rate_limit=rate_limit, others=others)


def velocity_limits_of_jacobian(
    jacobian: ArrayLike, *, rate_limit: ArrayLike, others: Literal["free", "zero"] = "free"
) -> FloatArray:
    """Find the greatest value of each velocity component, one after the other, from a Jacobian.

    For each component k: max v_k subject to |J v| <= rate_limit.

    Parameters
    ----------
    jacobian
        (m, n) actuator rates per velocity component, of rank n [m/s or rad/s per unit].
    rate_limit
        (m,) or one number: largest absolute actuator rate [m/s or rad/s].
    others
        The other components: ``"free"`` or ``"zero"``.

    Returns
    -------
    numpy.ndarray
        (n,) greatest value of each component [m/s, or the unit of the component].

    Raises
    ------
    SingularityError
        If the Jacobian has a lower rank, so that some velocity has no bound.
    InputError
        If an argument has the wrong shape, or a limit is not finite and above zero.
    """
    jacobian = as_array("jacobian", jacobian, (None, None))
    m, n = jacobian.shape
    limit = as_limit("rate_limit", rate_limit, m)
    if others not in ("free", "zero"):
        raise InputError(f"others must be 'free' or 'zero', got {others!r}")
    if n == 0:
        raise InputError("jacobian must have at least one column")
    _require_regular(jacobian, "the Jacobian")
    if others == "zero":
        # One leg alone stops a motion along an axis; a leg across it does not.
        with np.errstate(divide="ignore"):
            return (limit[:, None] / np.abs(jacobian)).min(axis=0)
    return np.array([maximise(axis, jacobian, -limit, limit) @ axis for axis in np.eye(n)])


def load_limit(
    hexapod: Hexapod,
    position: ArrayLike,
    rotation: ArrayLike,
    *,
    force_limit: ArrayLike,
    direction: ArrayLike = (0.0, 0.0, 1.0),
) -> float:
    """Find the greatest force through the platform origin that the legs can exert without a moment.

    The leg forces f = J⁻ᵀ [d; 0] of a unit force grow in proportion; the first leg at its limit ends it.

    Parameters
    ----------
    hexapod
        Geometry.
    position
        (3,) platform origin in the base frame [m].
    rotation
        (3, 3) platform axes in the base frame.
    force_limit
        (6,) or one number: largest absolute leg force [N].
    direction
        (3,) of the force, in base axes; its length does not matter [dimensionless].

    Returns
    -------
    float
        Greatest force; along +z it carries as much weight [N].

    Raises
    ------
    SingularityError
        If the legs cannot carry every wrench at this pose.
    InputError
        If an argument has the wrong shape, the direction is zero, or a limit is not finite and above zero.
    """
    limit = as_limit("force_limit", force_limit, 6)
    direction = as_array("direction", direction, (3,))
    size = float(np.linalg.norm(direction))
    if size == 0.0:
        raise InputError("direction must not be zero")
    jacobian = leg_jacobian(
        hexapod, as_array("position", position, (3,)), as_array("rotation", rotation, (3, 3))
    )
    forces = leg_forces_for_wrench(jacobian, np.concatenate([direction / size, np.zeros(3)]))
    with np.errstate(divide="ignore"):
        return float((limit / np.abs(forces)).min())


def _require_regular(jacobian: FloatArray, name: str) -> None:
    if jacobian.shape[0] < jacobian.shape[1]:
        raise SingularityError(
            f"{name} has {jacobian.shape[0]} rows for {jacobian.shape[1]} components: some velocity has no bound",
            smallest_singular_value=0.0,
        )
    _, s, vt = np.linalg.svd(jacobian)
    if s[-1] <= JACOBIAN_SINGULAR * s[0]:
        raise SingularityError(
            f"{name} is singular (smallest singular value {s[-1]:.3g}): the actuators do not limit every motion; "
            "move away from this pose",
            smallest_singular_value=float(s[-1]),
            direction=vt[-1],
        )
