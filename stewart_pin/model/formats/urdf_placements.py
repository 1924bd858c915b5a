"""Placements as URDF has them, for the writers of all dialects."""

from __future__ import annotations

import pinocchio as pin
from lxml import etree

from stewart_pin.geometry.rotations import rpy_from_rotation
from stewart_pin.model.formats.xml import number_text


def write_origin(element: etree._Element, placement: pin.SE3) -> None:
    """Write a placement as ``<origin>``, unless it is the identity.

    Parameters
    ----------
    element
        Where to put it.
    placement
        The placement.
    """
    attributes = pose_attributes(placement)
    if attributes:
        etree.SubElement(element, "origin", attributes)


def pose_attributes(placement: pin.SE3) -> dict[str, str]:
    """Print a placement as the attributes ``xyz`` and ``rpy``.

    Parameters
    ----------
    placement
        The placement.

    Returns
    -------
    dict
        Without ``rpy`` where nothing is turned; empty for the identity.
    """
    rpy = rpy_from_rotation(placement.rotation)
    turned = {"rpy": number_text(rpy)} if rpy.any() else {}
    moved = {"xyz": number_text(placement.translation)} if turned or placement.translation.any() else {}
    return moved | turned
