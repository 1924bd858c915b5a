"""Masses of a six-legged platform: what a body weighs, and which bodies a platform with legs is made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array
from stewart_pin.errors import InputError
from stewart_pin.typing import ArrayLike, FloatArray

LowerJoint = Literal["universal", "spherical"]
"""Joint between the base and a leg; see `HexapodBodies`."""

_ROUND_OFF = 1e-9
"""Part of the largest entry by which an inertia may miss symmetry or the triangle inequality: it has been
computed, rotated or printed in double precision, so it never meets either exactly."""


@dataclass(frozen=True, eq=False, repr=False)
class RigidBody(Brief):
    """Mass distribution of a rigid body.

    Attributes
    ----------
    mass
        Mass, zero allowed [kg].
    com
        (3,) centre of mass in the body frame [m].
    inertia
        (3, 3) moments of inertia about the centre of mass, along the axes of the body frame [kg m²].

    Raises
    ------
    InputError
        If no distribution of positive mass has these values.

    Notes
    -----
    The principal moments of a body, sorted, obey 0 <= I₁ and I₃ <= I₁ + I₂. Both are one condition on the
    second moments S = tr(I)/2 - I: S is positive semidefinite.
    """

    mass: float
    com: FloatArray
    inertia: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", _as_mass(self.mass))
        com, inertia = as_array("com", self.com, (3,)).copy(), _as_inertia(self.inertia)
        for name, array in (("com", com), ("inertia", inertia)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def is_axisymmetric(self) -> bool:
        """Tell whether a turn about the z axis of the body frame changes nothing.

        Returns
        -------
        bool
            True if the centre of mass lies on that axis, Ixx = Iyy, and no product of inertia is left, all
            within round-off.
        """
        off_axis = self.mass * np.abs(self.com[:2]).max() > _ROUND_OFF * self.mass * np.abs(self.com).max()
        uneven = abs(self.inertia[0, 0] - self.inertia[1, 1])
        products = np.abs(self.inertia[[0, 0, 1], [1, 2, 2]]).max()
        return not off_axis and bool(max(uneven, products) <= _ROUND_OFF * np.abs(self.inertia).max())


@dataclass(frozen=True, eq=False, repr=False)
class HexapodBodies(Brief):
    """Bodies of a six-legged platform.

    The leg frame has z along the leg, from base to platform, and y square to the leg and to the first axis of
    its lower joint. With this axis along base x its attitude in the base frame is Rx(α) Ry(β), with cos β > 0:
    that is how a universal joint with its second axis along leg y turns the leg.

    Attributes
    ----------
    platform
        In the platform frame.
    lower
        Cylinder, the part of a leg that is joined to the base: in the leg frame at the base point. One for
        all legs, or six; kept as six.
    upper
        Rod, the part of a leg that is joined to the platform by a ball: in the leg frame at the platform
        point, so its centre of mass has a negative z. One for all legs, or six; kept as six.
    lower_joint
        "universal" transmits a torque about the normal of its two axes, so a leg cannot spin freely;
        "spherical" transmits none, so it can.
    first_axes
        (3,) or (6, 3) direction of the first axes of the lower joints, which stand in the base, in the base frame;
        kept as six unit vectors, dimensionless. Of spherical joints it only names the leg frame.

    Raises
    ------
    InputError
        If a body is no `RigidBody`, legs are not six, the joint is unknown, or an axis has no direction.
    """

    platform: RigidBody
    lower: RigidBody | tuple[RigidBody, ...]
    upper: RigidBody | tuple[RigidBody, ...]
    lower_joint: LowerJoint = "universal"
    first_axes: ArrayLike = (1.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not isinstance(self.platform, RigidBody):
            raise InputError(f"platform must be a RigidBody, got {type(self.platform).__name__}")
        for name in ("lower", "upper"):
            object.__setattr__(self, name, _as_six(name, getattr(self, name)))
        if self.lower_joint not in get_args(LowerJoint):
            raise InputError(f"lower_joint must be 'universal' or 'spherical', got {self.lower_joint!r}")
        object.__setattr__(self, "first_axes", _as_axes(self.first_axes))


def _as_mass(value: float) -> float:
    mass = float(as_array("mass", value, ()))
    if mass < 0.0:
        raise InputError(f"mass must not be negative, got {mass:g} kg")
    return mass


def _as_inertia(value: ArrayLike) -> FloatArray:
    inertia = as_array("inertia", value, (3, 3))
    scale = np.abs(inertia).max()
    if np.abs(inertia - inertia.T).max() > _ROUND_OFF * scale:
        raise InputError(f"inertia must be symmetric, got {inertia.tolist()}")
    inertia = (inertia + inertia.T) / 2
    first, second, third = np.linalg.eigvalsh(inertia)
    if first < -_ROUND_OFF * scale:
        raise InputError(f"inertia must be positive semidefinite, got a principal moment {first:.6g} kg m²")
    if third - first - second > _ROUND_OFF * scale:
        raise InputError(
            f"inertia breaks the triangle inequality: principal moment {third:.6g} kg m² exceeds "
            f"{first:.6g} + {second:.6g}; give moments about the centre of mass"
        )
    return inertia


def _as_axes(value: ArrayLike) -> FloatArray:
    axes = np.asarray(value, dtype=float)
    axes = np.broadcast_to(as_array("first_axes", value, (6, 3) if axes.ndim == 2 else (3,)), (6, 3))
    sizes = np.linalg.norm(axes, axis=1, keepdims=True)
    if not sizes.all():
        raise InputError("first_axes must be directions, got one of length zero")
    axes = axes / sizes
    axes.setflags(write=False)
    return axes


def _as_six(name: str, value: RigidBody | tuple[RigidBody, ...]) -> tuple[RigidBody, ...]:
    if isinstance(value, RigidBody):
        return (value,) * 6
    try:
        bodies = tuple(value)
    except TypeError:
        raise InputError(f"{name} must be one RigidBody or six, got {type(value).__name__}") from None
    if len(bodies) != 6 or not all(isinstance(body, RigidBody) for body in bodies):
        listed = ", ".join(type(body).__name__ for body in bodies[:7])
        raise InputError(f"{name} must be one RigidBody or six, got {len(bodies)}: {listed}")
    return bodies
