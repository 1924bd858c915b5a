"""The motions of the platform, in coordinates that fit them, and the limits that a file states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stewart_pin.checks import as_positive
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.mechanics.capability.enumeration import Shape
from stewart_pin.mechanics.capability.polytope import Polytope
from stewart_pin.model.tree import LimitKind
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.freedom import TWIST_AXES
from stewart_pin.state.state import State
from stewart_pin.typing import ArrayLike, FloatArray

_ALONG = 1e-9
"""Distance of an axis from the space of motions below which the platform moves along it, lengths normalised."""
_WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")


@dataclass(frozen=True, eq=False)
class PlatformSpace:
    """Twists that the platform can do at one configuration, lengths normalised: (v, ω · length).

    Attributes
    ----------
    basis
        (6, d) orthonormal; the axes themselves where the platform moves along axes [dimensionless].
    share
        (d, dof) coordinates of the normalised twist per motion of `Freedom.motions` [m/s per motion].
    aligned
        The axis of each coordinate, or None when they are no axes.
    length
        Normalising length [m].
    """

    basis: FloatArray
    share: FloatArray
    aligned: tuple[int, ...] | None
    length: float

    def polytope(self, shape: Shape, kind: str) -> Polytope:
        """Express a shape in these coordinates as velocities or wrenches with their units.

        Parameters
        ----------
        shape
            In normalised coordinates [m/s or N].
        kind
            ``"velocity"`` or ``"wrench"``.

        Returns
        -------
        Polytope
            The same set.
        """
        velocity = kind == "velocity"
        # Normalised twists are (v, ω length), normalised wrenches (f, m / length): their product is the power.
        stretch = np.repeat([1.0, self.length if velocity else 1 / self.length], 3)
        if self.aligned is None:
            d = self.basis.shape[1]
            names, units = tuple(f"mode {k + 1}" for k in range(d)), ("m/s" if velocity else "N",) * d
            scale, basis = np.ones(d), self.basis / stretch[:, None]
        else:
            axes = list(self.aligned)
            names = tuple((TWIST_AXES if velocity else _WRENCH)[k] for k in axes)
            units = tuple((("m/s", "rad/s") if velocity else ("N", "N m"))[k // 3] for k in axes)
            scale, basis = stretch[axes], self.basis
        return Polytope(
            vertices=shape.vertices / scale,
            normals=shape.normals * scale,
            offsets=shape.offsets,
            limits=shape.limits,
            names=names,
            units=units,
            scale=scale,
            basis=basis,
            length=self.length,
        )


def platform_space(state: State, length: float | None) -> PlatformSpace:
    """Find coordinates for the platform's motions.

    Parameters
    ----------
    state
        State with closed loops.
    length
        Normalising length; default: the size of the robot [m].

    Returns
    -------
    PlatformSpace
        The coordinates.

    Raises
    ------
    UnsupportedError
        If the platform cannot move.
    """
    chain, freedom = state.chain, state.freedom
    length = chain.length_scale if length is None else as_positive("length", length)
    twist = state.P @ freedom.motions
    twist[3:] *= length
    u = np.linalg.svd(twist)[0]
    d = freedom.count.platform  # at a dead point it does not move, whatever its round-off does
    if d == 0:
        raise UnsupportedError(f"the platform '{chain.platform}' of '{chain.name}' cannot move here")
    basis = u[:, :d]
    along = [k for k in range(6) if 1.0 - float(np.linalg.norm(basis[k])) < _ALONG]
    aligned = tuple(along) if len(along) == d else None
    if aligned is not None:
        basis = np.eye(6)[:, along]
    return PlatformSpace(basis=basis, share=basis.T @ twist, aligned=aligned, length=length)


def as_limit(name: str, value: ArrayLike, count: int) -> FloatArray:
    """Check largest absolute values, one for all or one each.

    Parameters
    ----------
    name
        Name of the argument, for the message.
    value
        What the caller passed [any unit].
    count
        How many are needed.

    Returns
    -------
    numpy.ndarray
        (count,) limits [any unit].

    Raises
    ------
    InputError
        If they are not one or `count` finite numbers above zero.
    """
    try:
        limit = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be one number or {count}, got {value!r}") from None
    if limit.shape not in ((), (count,)):
        raise InputError(
            f"{name} must be one number or an array of shape ({count},), got shape {limit.shape}"
        )
    if not np.isfinite(limit).all() or (limit <= 0).any():
        raise InputError(f"{name} must be finite and above zero, got {limit}")
    return np.broadcast_to(limit, (count,)).copy()


def motor_limits(chain: ClosedChain, name: str, value: ArrayLike | None, kind: LimitKind) -> FloatArray:
    """Choose between limits that the caller gives and those of the chain, motor by motor.

    Parameters
    ----------
    chain
        Closed chain.
    name
        Name of the argument, for the message.
    value
        (nu,) largest absolute values, nan for the chain's own limit; one number for all; or None for the chain's
        [any unit].
    kind
        Kind of the limits of the chain.

    Returns
    -------
    numpy.ndarray
        (nu, 2) least and greatest values [any unit].

    Raises
    ------
    InputError
        If a motor has no limit at one of its ends: what the others may do does not bound it.
    """
    limits = chain.limits.bounds(kind, chain.motor_index)
    if value is not None:
        given = np.array(value, dtype=float) if _numeric(value) else np.array(0.0)
        own = np.isnan(given) if given.shape == (chain.nu,) else np.zeros(chain.nu, dtype=bool)
        most = as_limit(name, np.where(own, 1.0, given) if own.any() else value, chain.nu)
        limits = np.where(own[:, None], limits, most[:, None] * [-1.0, 1.0])
    missing = [m for m, ends in zip(chain.motors, limits, strict=True) if not np.isfinite(ends).all()]
    if missing:
        raise InputError(
            f"'{chain.name}' states no usable limit for the motors {', '.join(missing)}; pass {name}=..., with nan for "
            "the motors that have one"
        )
    return limits


def _numeric(value: ArrayLike) -> bool:
    try:
        np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return False
    return True
