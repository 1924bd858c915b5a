"""Placements as MuJoCo has them: a position, and a quaternion w x y z."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.model.formats.xml import number_text
from stewart_pin.typing import FloatArray


def placement_of(position: FloatArray, quaternion: FloatArray) -> pin.SE3:
    """Build a placement from MuJoCo's numbers.

    Parameters
    ----------
    position
        (3,) origin [m].
    quaternion
        (4,) w x y z, unit quaternion.

    Returns
    -------
    pinocchio.SE3
        The placement.
    """
    w, x, y, z = (float(value) for value in quaternion)
    rotation = pin.Quaternion(w, x, y, z).normalized().toRotationMatrix()
    return pin.SE3(rotation, np.array(position, dtype=float))


def place(element: etree._Element, placement: pin.SE3) -> None:
    """Write a placement as ``pos`` and ``quat``, unless it is the identity.

    Parameters
    ----------
    element
        Body, site or geom.
    placement
        The placement.
    """
    if placement.translation.any():
        element.set("pos", number_text(placement.translation))
    if not np.array_equal(placement.rotation, np.eye(3)):
        element.set("quat", quaternion_text(placement.rotation))


def quaternion_text(rotation: FloatArray) -> str:
    """Print a rotation as MuJoCo's quaternion.

    Parameters
    ----------
    rotation
        (3, 3) rotation matrix.

    Returns
    -------
    str
        w x y z.
    """
    x, y, z, w = pin.Quaternion(rotation).coeffs()
    return number_text([w, x, y, z])
