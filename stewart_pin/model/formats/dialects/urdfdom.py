"""The ``<constraint>`` that is proposed for urdfdom: parent and child, each with its origin and its axis.

The axes stand in the frames that the origins make, as the axis of a URDF joint does. A universal joint turns about
the parent's axis and the child's. For the other types the child's frame is turned, by the least rotation, so that its
axis becomes the parent's.

References
----------
.. [1] urdfdom, pull request 264, "Add constraints to describe closed loops", 2026.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.model.description import AXIS_FREE_LOOPS, LOOP_KINDS, JointKind, Loop, Note, Outcome
from stewart_pin.model.formats.dialect import Dialect, Parts
from stewart_pin.model.formats.urdf_elements import UrdfElements
from stewart_pin.typing import FloatArray

_SYNONYMS = {"continuous": "revolute", "ball": "spherical"}


def _read(reader: UrdfElements, element: etree._Element) -> Parts:
    name = reader.text(element, "name", "a <constraint>")
    owner = f"constraint '{name}'"
    written = reader.text(element, "type", owner)
    types = [kind for kind in LOOP_KINDS if kind is not JointKind.DISTANCE]
    word = written.removesuffix("_joint")  # the fork writes spherical_joint
    if _SYNONYMS.get(word, word) not in types:
        raise reader.error(f"{owner} has the type '{written}'; supported: {', '.join(types)}", owner)
    kind = JointKind(_SYNONYMS.get(word, word))
    tags = [f"{end}{part}" for end in ("parent", "child") for part in ("", "_origin", "_axis")]
    reader.only(element, owner, ("name", "type"), tags)
    link1, link2 = reader.ends(element, owner)
    place1, place2 = (reader.origin(element, owner, f"{end}_origin") for end in ("parent", "child"))
    default = "0 0 1" if kind in AXIS_FREE_LOOPS else ""
    axis = reader.axis(element, owner, "parent_axis", default)
    given = reader.optional(element, "child_axis", owner) is not None or kind is JointKind.UNIVERSAL
    axis2 = reader.axis(element, owner, "child_axis", default) if given else axis
    if kind is JointKind.UNIVERSAL:
        return Parts(loops=(Loop(name, kind, link1, link2, place1, place2, axis, axis2),))
    notes: tuple[Note, ...] = ()
    if kind not in AXIS_FREE_LOOPS and not np.array_equal(axis, axis2):
        place2 = place2 * pin.SE3(_least_rotation(axis, axis2), np.zeros(3))
        if kind is JointKind.PRISMATIC:
            text = "two axes do not say how the child is turned about them; the least rotation is taken"
            notes = (Note(f"loop '{name}'", text, Outcome.CHANGED),)
    return Parts(loops=(Loop(name, kind, link1, link2, place1, place2, axis),), notes=notes)


def _least_rotation(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the rotation of least angle that takes unit vector a to b."""
    if a @ b < -1 + 1e-12:  # half a turn about any axis across
        across = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
        across /= np.linalg.norm(across)
        return 2 * np.outer(across, across) - np.eye(3)
    return pin.Quaternion.FromTwoVectors(a, b).toRotationMatrix()


DIALECT = Dialect("urdfdom", "urdfdom <constraint>", {"robot/constraint": _read})
