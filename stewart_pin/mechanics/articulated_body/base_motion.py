"""A base that moves as prescribed: a ship, a satellite's bus on rails, a shaking floor."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array
from stewart_pin.geometry.rotations import as_rotation
from stewart_pin.typing import FloatArray


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

    def spatial(self, gravity: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Express the motion in base coordinates, with gravity as an upward acceleration of the base.

        Parameters
        ----------
        gravity
            (3,) acceleration of free fall in the inertial frame [m/s²].

        Returns
        -------
        velocity : numpy.ndarray
            (6,) spatial velocity v₀, [angular; linear], base axes [rad/s, m/s].
        acceleration : numpy.ndarray
            (6,) spatial acceleration a₀ - a_g, base axes [rad/s², m/s²].
        """
        linear, omega = self.twist[:3], self.twist[3:]
        # Spatial acceleration misses the ω × v of the origin.
        push = self.acceleration[:3] - np.cross(omega, linear) - gravity
        turned = np.stack([omega, linear, self.acceleration[3:], push]) @ self.rotation
        return turned[:2].ravel(), turned[2:].ravel()
