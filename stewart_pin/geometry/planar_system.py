"""Leg equations of the planar 3-RPR platform and their derivatives, row by row, for Newton's method."""

from __future__ import annotations

import numpy as np

from stewart_pin.geometry.newton import Equations
from stewart_pin.typing import ComplexArray, FloatArray


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
