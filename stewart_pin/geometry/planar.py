"""Closed forms of the planar 3-RPR platform, for any batch shape, and Newton's method on its leg equations.

Leg *i* runs from a fixed anchor to a corner of the platform; its length is driven. A pose is the position of
the platform frame's origin and the angle of its x axis, both in the base frame.

References
----------
.. [1] J.-P. Merlet, "Parallel Robots", 2nd ed., Springer, 2006, ch. 4 (direct kinematics).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array, as_batch, as_positive
from stewart_pin.errors import InputError, SingularityError
from stewart_pin.geometry.rotations import as_rotation
from stewart_pin.typing import ArrayLike, ComplexArray, FloatArray

# ----------------------------------------------------------------------------------------------------
# Newton steps for many small systems at once, from starts that may lie near a singular root
# ----------------------------------------------------------------------------------------------------


Equations = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""(n, k) unknowns to (n, m) residuals and (n, m, k) Jacobians."""

_RANK = 4 * np.finfo(float).eps
"""Singular values below this share of the largest are round-off and take no step."""

_PATIENCE = 5
"""Steps without a smaller residual after which a start is given up."""

_ACROSS = 2
"""Steps across the valley after one along it: their errors are those of the step to the power 4."""


def valley_newton(
    equations: Equations, start: FloatArray, *, max_iterations: int, largest_step: float
) -> FloatArray:
    """Take Newton steps, each followed by a return to the valley floor, and keep the best point.

    An m-fold root lies in a curved valley of small residuals. A step along the valley leaves its floor and so
    enlarges the residual, unless steps across the valley follow. The distance shrinks by 1 - 1/m each time.

    Parameters
    ----------
    equations
        Maps (n, k) unknowns to (n, m) residuals and (n, m, k) Jacobians, row by row.
    start
        (n, k) first guesses, dimensionless: in units that make all unknowns of order one.
    max_iterations
        Steps taken per row, at most.
    largest_step
        Longer steps are shortened to this.

    Returns
    -------
    numpy.ndarray
        (n, k) the unknowns of least residual, dimensionless, the start included.
    """
    x, best = np.array(start), np.array(start)
    residual, jacobian = equations(x)
    least = np.linalg.norm(residual, axis=-1)
    idle = np.zeros(len(x), dtype=int)
    for _ in range(max_iterations):
        if ((idle >= _PATIENCE) | (least <= np.finfo(float).eps)).all():
            break
        step = _step(jacobian, residual)
        length = np.linalg.norm(step, axis=-1, keepdims=True)
        x = x - step * np.minimum(1.0, largest_step / np.where(length > 0.0, length, 1.0))
        x = strong_newton(equations, x, max_iterations=_ACROSS)
        residual, jacobian = equations(x)
        cost = np.linalg.norm(residual, axis=-1)
        best = np.where((cost < least)[:, None], x, best)
        idle = np.where(cost < least, 0, idle + 1)
        least = np.fmin(cost, least)
    return best


def strong_newton(equations: Equations, start: FloatArray, *, max_iterations: int) -> FloatArray:
    """Take Newton steps in all but the weakest direction: to the floor of the valley, not along it.

    Parameters
    ----------
    equations
        Maps (n, k) unknowns to (n, m) residuals and (n, m, k) Jacobians, row by row.
    start
        (n, k) first guesses, dimensionless: in units that make all unknowns of order one.
    max_iterations
        Steps taken per row.

    Returns
    -------
    numpy.ndarray
        (n, k) unknowns, dimensionless.
    """
    x = np.array(start)
    for _ in range(max_iterations):
        residual, jacobian = equations(x)
        x = x - _step(jacobian, residual, drop=1)
    return x


def _step(jacobian: FloatArray, residual: FloatArray, *, drop: int = 0) -> FloatArray:
    """Return the step to subtract, with nothing along directions without rank."""
    u, s, vt = np.linalg.svd(jacobian, full_matrices=False)
    used = s > _RANK * s[:, :1]
    used[:, s.shape[1] - drop :] = False
    weight = np.divide(1.0, s, out=np.zeros_like(s), where=used)
    return np.einsum("nji,nj->ni", vt, weight * np.einsum("nij,ni->nj", u, residual))


# ----------------------------------------------------------------------------------------------------

_SIDE_MISMATCH = 1e-9
"""Relative misfit of three sides and an angle that still counts as rounding of printed figures."""


@dataclass(frozen=True, eq=False, repr=False)
class PlanarRPR(Brief):
    """Geometry of a planar platform on three legs.

    Neither the first anchor nor the first corner has to stand at an origin.

    Attributes
    ----------
    anchors
        (3, 2) fixed leg ends, in the base frame [m].
    corners
        (3, 2) moving leg ends, in the platform frame [m].
    plane
        (4, 4) placement of the base frame in the world, its z across the plane of motion: rotation, dimensionless, and
        position [m].
    turned
        (3, 3) axes of the platform frame, its z across the plane too, in the frame that the world calls the platform's:
        a rotation, dimensionless.
    """

    anchors: FloatArray
    corners: FloatArray
    plane: FloatArray = field(default_factory=lambda: np.eye(4))
    turned: FloatArray = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        for name, size in (("plane", 4), ("turned", 3)):
            placed = as_array(name, getattr(self, name), (size, size)).copy()
            as_rotation(name, placed[:3, :3])
            placed.setflags(write=False)
            object.__setattr__(self, name, placed)
        for name in ("anchors", "corners"):
            points = as_array(name, getattr(self, name), (3, 2)).copy()
            points.setflags(write=False)
            object.__setattr__(self, name, points)

    def coordinates(self, position: ArrayLike, rotation: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Find the planar pose of a platform that stands somewhere in the world.

        Parameters
        ----------
        position
            (..., 3) platform origin in the world [m].
        rotation
            (..., 3, 3) platform axes in the world.

        Returns
        -------
        position : numpy.ndarray
            (..., 2) in the base frame [m].
        angle : numpy.ndarray
            (...) of the platform's x axis [rad].
        """
        axes = self.plane[:3, :3]
        flat = (as_batch("position", position, (3,)) - self.plane[:3, 3]) @ axes[:, :2]
        turned = axes.T @ as_rotation("rotation", rotation) @ self.turned
        return flat, np.arctan2(turned[..., 1, 0], turned[..., 0, 0])

    def placement(self, position: ArrayLike, angle: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Find where a planar pose stands in the world, the way back from `coordinates`.

        Parameters
        ----------
        position
            (..., 2) in the base frame [m].
        angle
            (...) of the platform's x axis [rad].

        Returns
        -------
        position : numpy.ndarray
            (..., 3) platform origin in the world [m].
        rotation : numpy.ndarray
            (..., 3, 3) platform axes in the world.
        """
        position, angle = as_batch("position", position, (2,)), as_batch("angle", angle, ())
        axes = self.plane[:3, :3]
        c, s, zero = np.cos(angle), np.sin(angle), np.zeros_like(angle)
        turn = np.stack([c, -s, zero, s, c, zero, zero, zero, zero + 1], axis=-1).reshape(*angle.shape, 3, 3)
        return self.plane[:3, 3] + position @ axes[:, :2].T, axes @ turn @ self.turned.T

    @classmethod
    def from_sides(
        cls, l1: float, l2: float, l3: float, gamma: float, x1: float, x2: float, y2: float
    ) -> PlanarRPR:
        """Build a platform from the sides of its triangle, with the first anchor at the origin.

        The platform frame stands in the first corner, its x axis points to the second.

        Parameters
        ----------
        l1
            Side between the second and the third corner [m]; it follows from the rest and is checked.
        l2
            Side between the first and the third corner [m].
        l3
            Side between the first and the second corner [m].
        gamma
            Angle at the first corner, opposite `l1` [rad].
        x1
            Second anchor at (x1, 0), in the base frame [m].
        x2, y2
            Third anchor, in the base frame [m].

        Returns
        -------
        PlanarRPR
            Legs in the order of the anchors.

        Raises
        ------
        InputError
            If a side is not above zero, or the first side does not close the triangle.
        """
        l1, l2, l3 = as_positive("l1", l1), as_positive("l2", l2), as_positive("l3", l3)
        gamma, x1, x2, y2 = as_array("(gamma, x1, x2, y2)", [gamma, x1, x2, y2], (4,))
        third = l2 * np.array([np.cos(gamma), np.sin(gamma)])
        closing = float(np.hypot(third[0] - l3, third[1]))
        if abs(closing - l1) > _SIDE_MISMATCH * max(l1, l2, l3):
            raise InputError(
                f"l1 must close the triangle: l2, l3 and gamma give {closing:.12g}, got {l1:.12g}"
            )
        return cls(np.array([[0.0, 0.0], [x1, 0.0], [x2, y2]]), np.array([[0.0, 0.0], [l3, 0.0], third]))


def require_planar(value: object) -> None:
    """Refuse what is no geometry of a planar platform on three legs.

    Parameters
    ----------
    value
        What the caller passed.

    Raises
    ------
    InputError
        If it is something else, as a chain; says what takes one.
    """
    if not isinstance(value, PlanarRPR):
        raise InputError(
            f"planar: a closed form of planar platforms takes a PlanarRPR, got {type(value).__name__}; for a chain use "
            "planar.planar_rpr(chain), or assembly_modes, inverse_kinematics and motor_jacobian, which take it"
        )


def planar_legs(planar: PlanarRPR, position: ArrayLike, angle: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Compute the vectors along the legs and the arms to the corners.

    Parameters
    ----------
    planar
        Geometry.
    position
        (..., 2) platform origin in the base frame [m].
    angle
        (...) of the platform x axis in the base frame [rad].

    Returns
    -------
    legs : numpy.ndarray
        (..., 3, 2) from anchor to corner, in the base frame [m].
    arms : numpy.ndarray
        (..., 3, 2) from platform origin to corner, in the base frame [m].

    Raises
    ------
    InputError
        If a shape is wrong, or the batch shapes do not fit each other.
    """
    require_planar(planar)
    position, angle = as_batch("position", position, (2,)), as_batch("angle", angle, ())
    try:
        np.broadcast_shapes(position.shape[:-1], angle.shape)
    except ValueError:
        raise InputError(
            f"batch shapes do not fit each other: position {position.shape[:-1]}, angle {angle.shape}"
        ) from None
    c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
    x, y = planar.corners.T
    arms = np.stack([c * x - s * y, s * x + c * y], axis=-1)
    return position[..., None, :] + arms - planar.anchors, arms


def planar_leg_lengths(planar: PlanarRPR, position: ArrayLike, angle: ArrayLike) -> FloatArray:
    """Compute the three leg lengths of a pose: ``l = |p + R(θ) c - a|``.

    Parameters
    ----------
    planar
        Geometry.
    position
        (..., 2) platform origin in the base frame [m].
    angle
        (...) of the platform x axis in the base frame [rad].

    Returns
    -------
    numpy.ndarray
        (..., 3) lengths [m].

    Examples
    --------
    >>> planar = PlanarRPR([[0, 0], [4, 0], [0, 4]], [[0, 0], [1, 0], [0, 1]])
    >>> planar_leg_lengths(planar, [0.0, 3.0], 0.0)
    array([3.        , 4.24264069, 0.        ])
    """
    legs, _ = planar_legs(planar, position, angle)
    return np.hypot(legs[..., 0], legs[..., 1])


def planar_leg_jacobian(planar: PlanarRPR, position: ArrayLike, angle: ArrayLike) -> FloatArray:
    """Compute the map from platform velocity to leg rates.

    Row *i* is [uᵀ, arm × u] with u the unit vector along leg *i* from anchor to corner [1]_.

    Parameters
    ----------
    planar
        Geometry.
    position
        (..., 2) platform origin in the base frame [m].
    angle
        (...) of the platform x axis in the base frame [rad].

    Returns
    -------
    numpy.ndarray
        (..., 3, 3) leg rates [m/s] per velocity [vx, vy, ω] of the platform origin in base axes [m/s, rad/s].

    Raises
    ------
    SingularityError
        If a leg has no length, and therefore no direction.

    References
    ----------
    .. [1] J.-P. Merlet, "Parallel Robots", 2nd ed., 2006, ch. 5 (inverse Jacobian).
    """
    legs, arms = planar_legs(planar, position, angle)
    lengths = np.hypot(legs[..., 0], legs[..., 1])
    if (lengths == 0.0).any():
        leg = int(np.argwhere(lengths == 0.0)[0][-1])
        raise SingularityError(
            f"leg {leg + 1} has length zero and no direction; move the platform", smallest_singular_value=0.0
        )
    u = legs / lengths[..., None]
    moment = arms[..., 0] * u[..., 1] - arms[..., 1] * u[..., 0]
    return np.concatenate([u, moment[..., None]], axis=-1)


# ----------------------------------------------------------------------------------------------------
# Leg equations of the planar 3-RPR platform and their derivatives, row by row, for Newton's method
# ----------------------------------------------------------------------------------------------------


def leg_system(b: ComplexArray, d: ComplexArray, p: FloatArray) -> Equations:
    """Build the equations |w + z d_i - b_i| - p_i = 0.

    Parameters
    ----------
    b, d
        (n, m) complex anchors and corners of m legs.
    p
        (n, m) their lengths [m].

    Returns
    -------
    Callable
        Maps (n, 3) unknowns w_x, w_y, θ to (n, m) residuals and (n, m, 3) Jacobians.
    """

    def equations(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        arms = np.exp(1j * x[:, 2:]) * d
        legs = x[:, :1] + 1j * x[:, 1:2] + arms - b
        reach = np.abs(legs)
        u = legs / np.where(reach > 0.0, reach, 1.0)
        moment = (np.conj(arms) * u).imag
        return reach - p, np.stack([u.real, u.imag, moment], axis=-1)

    return equations


def merging_system(b: ComplexArray, d: ComplexArray, p: FloatArray, leg: int) -> Equations:
    """Build the equations of a pose where two modes merge as one leg changes.

    The other two legs have their lengths, and the three legs as lines meet in one point or are parallel: the
    determinant of the rows [ℓ, arm × ℓ] vanishes.

    Parameters
    ----------
    b, d
        (3,) complex anchors and corners.
    p
        (3,) lengths [m]; that of `leg` is not read.
    leg
        Index of the leg that changes.

    Returns
    -------
    Callable
        Maps (n, 3) unknowns w_x, w_y, θ to (n, 3) residuals and (n, 3, 3) Jacobians.
    """
    others = [i for i in range(3) if i != leg]
    lengths_only = leg_system(b[others], d[others], p[others])

    def equations(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        residual, jacobian = lengths_only(x)
        arms = np.exp(1j * x[:, 2:]) * d
        legs = x[:, :1] + 1j * x[:, 1:2] + arms - b
        rows = np.stack([legs.real, legs.imag, (np.conj(arms) * legs).imag], axis=-1)
        one, zero = np.ones(legs.shape), np.zeros(legs.shape)
        turned = -(np.conj(arms) * legs).real + np.abs(arms) ** 2
        # Derivative of a row, each column per unknown; the middle block is the Hessian of |ℓ|²/2.
        # fmt: off
        hessian = np.stack([
            np.stack([one,       zero,      -arms.imag], axis=-1),
            np.stack([zero,      one,        arms.real], axis=-1),
            np.stack([-arms.imag, arms.real, turned],    axis=-1),
        ], axis=-2)
        # fmt: on
        cofactor = _cross(np.roll(rows, -1, axis=1), np.roll(rows, -2, axis=1))
        determinant = np.einsum("nk,nk->n", rows[:, 0], cofactor[:, 0])
        slope = np.einsum("nijk,nij->nk", hessian, cofactor)
        return (
            np.concatenate([residual, determinant[:, None]], axis=-1),
            np.concatenate([jacobian, slope[:, None]], axis=1),
        )

    return equations


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    (ax, ay, az), (bx, by, bz) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)
