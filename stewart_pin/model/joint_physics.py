"""What a joint does by itself: inertia of its rotor, damping, dry friction, springs.

With x the coordinate of a joint of one freedom, or of one that closes a loop, its effort along x is

    force - Σ stiffness_k (x - rest)^k - damping ẋ - friction sign(ẋ),

and the kinetic energy of its rotor armature ẋ² / 2.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from stewart_pin.errors import UnsupportedError
from stewart_pin.typing import FloatArray

if TYPE_CHECKING:
    from stewart_pin.model.description import Mechanism


@dataclass(frozen=True)
class JointPhysics:
    """What a joint does by itself along one coordinate.

    Of a ball or a floating joint of the tree, armature, damping and friction are those of each tangent entry; the
    stiffness of a ball is that of the whole angle by which it has turned.

    Attributes
    ----------
    armature
        Inertia of the rotor, times the square of the gear ratio [kg or kg m²].
    damping
        Viscous friction [N s/m or N m s/rad].
    friction
        Dry friction [N or N m].
    stiffness
        (k,) coefficients of the spring's effort by powers of the displacement, the linear one first [N/m or N m/rad,
        and so on].
    rest
        Position at which the spring is at rest [m or rad].
    force
        Constant effort along the coordinate, as of a gas spring; the preload of a spring at its rest [N or N m].
    """

    armature: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    stiffness: tuple[float, ...] = ()
    rest: float = 0.0
    force: float = 0.0

    @property
    def pushes(self) -> bool:
        """Whether there is a spring or a constant force."""
        return bool(self.force or any(self.stiffness))

    @property
    def polynomial(self) -> tuple[float, ...]:
        """(k + 1,) effort of springs by powers of the displacement from rest, the constant one first [N or N m]."""
        return (self.force, *(-value for value in self.stiffness))

    def __bool__(self) -> bool:
        """Whether the joint does anything by itself."""
        return self != _NOTHING and bool(self.armature or self.damping or self.friction or self.pushes)

    def __str__(self) -> str:
        """Name what is not zero."""
        told = [
            f"{name} {' '.join(f'{x:g}' for x in np.atleast_1d(value))}"
            for name, value in ((each.name, getattr(self, each.name)) for each in fields(self))
            if np.any(value)
        ]
        return ", ".join(told) or "nothing"

    def fault(self) -> str | None:
        """Say what is wrong with the numbers.

        Returns
        -------
        str or None
            The quantity with its value, and what it may be.
        """
        for name in ("armature", "damping", "friction"):
            value = getattr(self, name)
            if not (isfinite(value) and value >= 0):
                return f"{name} is {value:g}; it must be zero or more"
        for name in ("rest", "force"):
            if not isfinite(getattr(self, name)):
                return f"{name} is {getattr(self, name):g}; it must be a finite number"
        if not all(map(isfinite, self.stiffness)):
            return f"stiffness is {self.stiffness}; it must hold finite numbers"
        return None


_NOTHING = JointPhysics()
NO_PHYSICS = _NOTHING
"""Of a joint that does nothing by itself."""


# ----------------------------------------------------------------------------------------------------
# Pinocchio's own fields: armature, damping and dry friction of each tangent entry
# ----------------------------------------------------------------------------------------------------


def set_joint_physics(model: pin.Model, mechanism: Mechanism) -> None:
    """Write armature, damping and dry friction into the fields of a model that is being built.

    Parameters
    ----------
    model
        Model from `build_tree`.
    mechanism
        Description of the same tree.
    """
    armature, damping, friction = np.zeros((3, model.nv))
    for joint in mechanism.joints:
        if joint.physics and model.existJointName(joint.name):
            entry = model.joints[model.getJointId(joint.name)]
            own = slice(entry.idx_v, entry.idx_v + entry.nv)
            armature[own], damping[own] = joint.physics.armature, joint.physics.damping
            friction[own] = joint.physics.friction
    write_fields(model, {"armature": armature, "damping": damping, "friction": friction})


def read_fields(model: pin.Model) -> dict[str, FloatArray]:
    """Read armature, damping and dry friction of a model.

    Parameters
    ----------
    model
        Pinocchio model.

    Returns
    -------
    dict
        (nv,) arrays ``armature`` [kg, kg m²], ``damping`` [N s/m, N m s/rad] and ``friction`` [N, N m].

    Raises
    ------
    UnsupportedError
        If dry friction differs between the directions.
    """
    upper, lower = np.array(model.upperDryFrictionLimit), np.array(model.lowerDryFrictionLimit)
    # Pinocchio's `friction` is the upper one alone; who sets it leaves the lower one at zero.
    uneven = np.flatnonzero((lower != -upper) & (lower != 0.0))
    if uneven.size:
        k = int(uneven[0])
        raise UnsupportedError(
            f"dry friction of entry {k} of the tangent goes from {lower[k]:g} to {upper[k]:g} "
            "(lowerDryFrictionLimit, upperDryFrictionLimit of the model); make both sides alike"
        )
    return {"armature": np.array(model.armature), "damping": np.array(model.damping), "friction": upper}


def write_fields(model: pin.Model, values: Mapping[str, FloatArray]) -> None:
    """Write armature, damping and dry friction into a model.

    Parameters
    ----------
    model
        Pinocchio model, which is changed.
    values
        (nv,) ``armature`` [kg, kg m²], ``damping`` [N s/m, N m s/rad] and ``friction`` [N, N m].
    """
    model.armature, model.damping = values["armature"], values["damping"]
    model.upperDryFrictionLimit, model.lowerDryFrictionLimit = values["friction"], -values["friction"]


FIELDS = ("armature", "damping", "upperDryFrictionLimit", "lowerDryFrictionLimit")
"""Fields of the model that tell what joints do by themselves."""


def fields_key(model: pin.Model) -> bytes:
    """Tell fields of the model that may be set by hand, as a key.

    Parameters
    ----------
    model
        Pinocchio model.

    Returns
    -------
    bytes
        The same while they are.
    """
    return b"".join(getattr(model, field).tobytes() for field in FIELDS)


def with_physics_of(model: pin.Model, mechanism: Mechanism) -> Mechanism:
    """Write armature, damping and dry friction of a model into the description of its tree.

    Parameters
    ----------
    model
        Pinocchio model, whose fields may have been set by hand.
    mechanism
        Description of the same tree.

    Returns
    -------
    Mechanism
        With the physics of the model. Entries of one joint that differ stay as described, see `uneven_joint`.
    """
    joints, fields_ = [], read_fields(model)
    for joint in mechanism.joints:
        if model.existJointName(joint.name):
            entry, changes = model.joints[model.getJointId(joint.name)], {}
            for field, values in fields_.items():
                own = values[entry.idx_v : entry.idx_v + entry.nv]
                if (own == own[0]).all() and own[0] != getattr(joint.physics, field):
                    changes[field] = float(own[0])
            if changes:
                joint = replace(joint, physics=replace(joint.physics, **changes))
        joints.append(joint)
    return replace(mechanism, joints=tuple(joints))


def uneven_joint(model: pin.Model) -> tuple[str, str] | None:
    """Find a joint whose tangent entries differ in armature, damping or friction, which no description can say.

    Parameters
    ----------
    model
        Pinocchio model.

    Returns
    -------
    tuple of str, or None
        Its name, and the field.
    """
    for field, values in read_fields(model).items():
        for name, joint in zip(model.names[1:], model.joints[1:], strict=True):
            own = values[joint.idx_v : joint.idx_v + joint.nv]
            if not (own == own[0]).all():
                return name, field
    return None
