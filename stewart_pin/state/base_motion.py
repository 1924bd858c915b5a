"""A ground that moves as prescribed: on a ship, a vehicle, a shaken floor.

A chain stands in the frame of its ground link, which is called the world everywhere else; here that frame moves in an
inertial one. Configurations, velocities and poses stay relative to it; inertia and weight are felt in the inertial one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import pinocchio as pin

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array
from stewart_pin.errors import InputError
from stewart_pin.geometry.rotations import as_rotation
from stewart_pin.state.scratch import Pool, Scratch
from stewart_pin.typing import Configuration, FloatArray, Tangent

if TYPE_CHECKING:
    from stewart_pin.state.chain import ClosedChain


@dataclass(frozen=True, eq=False, repr=False)
class BaseMotion(Brief):
    """Motion of the ground link in an inertial frame; the default is rest.

    Attributes
    ----------
    rotation
        (3, 3) axes of the base in the inertial frame.
    twist
        (6,) velocity of the base origin and angular velocity, [v; ω], inertial axes [m/s, rad/s].
    acceleration
        (6,) acceleration of the base origin and angular acceleration, inertial axes [m/s², rad/s²].

    Raises
    ------
    InputError
        If a field has the wrong shape, is not finite, or is no rotation.
    """

    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    twist: FloatArray = field(default_factory=lambda: np.zeros(6))
    acceleration: FloatArray = field(default_factory=lambda: np.zeros(6))

    def __post_init__(self) -> None:
        for name in ("twist", "acceleration"):
            object.__setattr__(self, name, as_array(name, getattr(self, name), (6,)))
        rotation = as_rotation("rotation", as_array("rotation", self.rotation, (3, 3)))
        object.__setattr__(self, "rotation", rotation)

    def to_base(self, vectors: FloatArray) -> FloatArray:
        """Turn vectors from inertial axes into those of the base.

        Parameters
        ----------
        vectors
            (..., 3 n) vectors one after the other, as in a wrench [any unit].

        Returns
        -------
        numpy.ndarray
            Like `vectors`, in axes of the base [any unit].
        """
        return (vectors.reshape(*vectors.shape[:-1], -1, 3) @ self.rotation).reshape(vectors.shape)


BaseMotions: TypeAlias = BaseMotion | Sequence[BaseMotion] | Callable[[float], BaseMotion]
"""Motion of the ground during a motion: the same all the time, one per instant, or a function of the instant [s]."""


def base_motions(given: BaseMotions | None, time: FloatArray) -> tuple[BaseMotion, ...] | None:
    """Check the motion of a ground during a motion.

    Parameters
    ----------
    given
        One motion, one per instant, or a function of the instant; None: it rests.
    time
        (N,) instants [s].

    Returns
    -------
    tuple of BaseMotion or None
        One per instant.

    Raises
    ------
    InputError
        If they are none, or not as many as there are instants.
    """
    if given is None:
        return None
    if isinstance(given, BaseMotion):
        return (given,) * len(time)
    if callable(given):
        return tuple(asked_base(given, float(t)) for t in time)
    motions = tuple(given) if isinstance(given, Sequence) else (given,)
    wrong = [each for each in motions if not isinstance(each, BaseMotion)]
    if wrong:
        raise InputError(
            f"base_motion must be a BaseMotion, one per instant or a function of it, got {type(wrong[0]).__name__}"
        )
    if len(motions) != len(time):
        raise InputError(
            f"base_motion has {len(motions)} motions of the ground, the motion is of {len(time)} instants"
        )
    return motions


def asked_base(function: Callable[[float], BaseMotion], t: float) -> BaseMotion:
    """Ask a function of the instant for the motion of the ground.

    Parameters
    ----------
    function
        What the caller passed.
    t
        Instant [s].

    Returns
    -------
    BaseMotion
        What it said.

    Raises
    ------
    InputError
        If it said something else.
    """
    said = function(t)
    if not isinstance(said, BaseMotion):
        raise InputError(f"base_motion must return a BaseMotion, got {type(said).__name__} at {t:g} s")
    return said


class MovingGround:
    """The tree of a chain on a free-flyer, by which Pinocchio moves its ground; bodies alone, without rotors.

    Masses count in ``chain.mass_unit``.

    Parameters
    ----------
    chain
        Closed chain.
    """

    def __init__(self, chain: ClosedChain) -> None:
        fixed, model = chain.mass_model, pin.Model()
        model.gravity = fixed.gravity
        model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "ground that moves")
        for k in range(1, fixed.njoints):
            model.addJoint(
                fixed.parents[k] + 1, fixed.joints[k], fixed.jointPlacements[k], f"{fixed.names[k]} {k}"
            )
            model.inertias[k + 1] = fixed.inertias[k]
        self.model = model
        self.scratches: Pool[Scratch] = Pool(lambda: Scratch(model))

    def state(
        self, base: BaseMotion, q: Configuration, v: Tangent, a: Tangent
    ) -> tuple[Configuration, Tangent, Tangent]:
        """Put a state of the chain on its moving ground.

        Parameters
        ----------
        base
            How the ground moves.
        q, v, a
            (nq,), (nv,) and (nv,) state of the chain [m, rad, unit quaternions; per s; per s²].

        Returns
        -------
        q, v, a : numpy.ndarray
            (7 + nq,), (6 + nv,) and (6 + nv,): a free-flyer moves by the twist in its own axes, and by its spatial
            acceleration, which misses the ω × v of the origin [m, rad, unit quaternions; per s; per s²].
        """
        linear, omega = base.twist[:3], base.twist[3:]
        push = np.concatenate([base.acceleration[:3] - np.cross(omega, linear), base.acceleration[3:]])
        # Where the ground is makes no difference; how it is turned does, to weight.
        place = np.concatenate([np.zeros(3), pin.Quaternion(base.rotation).coeffs()])
        return (
            np.concatenate([place, q]),
            np.concatenate([base.to_base(base.twist), v]),
            np.concatenate([base.to_base(push), a]),
        )
