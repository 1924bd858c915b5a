"""Isaac Sim's ``<loop_joint>``, read as its importer, old Drake and a Fusion exporter write it.

Isaac's importer documents one type, ``spherical``, and prints the tag ``link1`` for both ends; ``link2`` is read as
well. Other types need an ``<axis>``, in frame 1, as old Drake had it. The exporter's form has ``<parent>``,
``<child>``, a point on each (``<parent_origin>``, ``<child_origin>``) and an axis in the parent; as it says nothing of
how the child is turned, the two are taken to lie as they do while all joints are at zero, which is the pose the
exporter saw.

References
----------
.. [1] Isaac Sim documentation, "URDF importer extension", loop_joint.
.. [2] Drake documentation before 2019, RigidBodyTree, RigidBodyLoop.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pinocchio as pin
from lxml import etree

from stewart_pin.errors import UnsupportedError
from stewart_pin.model.description import AXIS_FREE_LOOPS, JointKind, Loop, Mechanism, Note, Outcome
from stewart_pin.model.formats.dialect import AT_ZERO, Dialect, Parts, note_lost_limits, relative_at_zero
from stewart_pin.model.formats.dialects.mimic import write_mimics
from stewart_pin.model.formats.dynamics import (
    DYNAMICS,
    note_lost_physics,
    note_unheard,
)
from stewart_pin.model.formats.urdf_core import read_bounds, read_loop_dynamics
from stewart_pin.model.formats.urdf_elements import LIMITS, UrdfElements
from stewart_pin.model.formats.urdf_writer import pose_attributes, save, tree_element
from stewart_pin.model.formats.words import Words
from stewart_pin.model.formats.xml import shown_tag

_TYPES = {
    "spherical": JointKind.SPHERICAL,
    "ball": JointKind.SPHERICAL,
    "fixed": JointKind.FIXED,
    "revolute": JointKind.REVOLUTE,
    "continuous": JointKind.REVOLUTE,
    "prismatic": JointKind.PRISMATIC,
}


def _read(reader: UrdfElements, element: etree._Element) -> Parts:
    name = reader.text(element, "name", "a <loop_joint>")
    owner = f"loop_joint '{name}'"
    written = reader.text(element, "type", owner)
    if written not in _TYPES:
        raise reader.error(f"{owner} has the type '{written}'; supported: {', '.join(_TYPES)}", owner)
    kind = _TYPES[written]
    if element.find("parent") is not None or element.find("child") is not None:
        return _read_points(reader, element, Loop(name, kind, "", "", pin.SE3.Identity(), pin.SE3.Identity()))
    reader.only(element, owner, ("name", "type"), ("link1", "link2", "axis", "limit", "dynamics"))
    # Isaac's documentation prints <link1> twice; the order of the file tells them apart.
    ends = [end for end in element.iterchildren(etree.Element) if shown_tag(end) in ("link1", "link2")]
    if len(ends) != 2 or shown_tag(ends[0]) == "link2":
        raise reader.error(f"{owner} needs a <link1> and a <link2>", owner)
    loop = Loop(
        name,
        kind,
        reader.text(ends[0], "link", owner),
        reader.text(ends[1], "link", owner),
        reader.pose(ends[0], owner),
        reader.pose(ends[1], owner),
        reader.axis(element, owner, "axis", "0 0 1" if kind in AXIS_FREE_LOOPS else ""),
    )
    bounds, physics = (read(reader, element, owner, kind) for read in (read_bounds, read_loop_dynamics))
    return Parts(loops=(replace(loop, bounds=bounds, physics=physics),))


def _read_points(reader: UrdfElements, element: etree._Element, loop: Loop) -> Parts:
    owner = f"loop_joint '{loop.name}'"
    known = ("parent", "child", "parent_origin", "child_origin", "axis", "limit", "dynamics")
    reader.only(element, owner, ("name", "type"), known)
    link1, link2 = reader.ends(element, owner)
    origins = [reader.child(element, tag, owner) for tag in ("parent_origin", "child_origin")]
    axis = reader.optional(element, "axis", owner)
    if axis is not None and axis.get("frame", "parent") != "parent":
        raise reader.error(f"{owner}: <axis frame> must be 'parent', got {axis.get('frame')!r}", owner)
    direction = reader.axis(element, owner, "axis", "0 0 1" if loop.kind in AXIS_FREE_LOOPS else "")
    placement1, placement2 = (reader.pose(origin, owner) for origin in origins)
    loop = replace(
        loop, link1=link1, link2=link2, placement1=placement1, placement2=placement2,
        axis=placement1.rotation.T @ direction, bounds=read_bounds(reader, element, owner, loop.kind),
        physics=read_loop_dynamics(reader, element, owner, loop.kind),
    )  # fmt: skip
    if loop.kind is JointKind.SPHERICAL or origins[1].get("rpy") is not None:
        return Parts(loops=(loop,))

    def turned(mechanism: Mechanism) -> Parts:
        relative = relative_at_zero(mechanism, link1, link2, owner)
        turned_child = pin.SE3(relative.rotation.T @ placement1.rotation, placement2.translation)
        note = Note(f"loop '{loop.name}'", AT_ZERO, Outcome.CHANGED)
        return Parts(loops=(replace(loop, placement2=turned_child),), notes=(note,))

    return Parts(later=turned)


def write_isaac(mechanism: Mechanism, path: Path) -> tuple[Note, ...]:
    """Write a mechanism as URDF with ``<loop_joint>`` for Isaac Sim, its couplings as ``<mimic>``.

    Parameters
    ----------
    mechanism
        What to write.
    path
        File to create or overwrite.

    Returns
    -------
    tuple of Note
        What the dialect has no word for.

    Raises
    ------
    UnsupportedError
        If a loop is not spherical, the one type that Isaac Sim documents, or a coupling is no ``<mimic>``.
    """
    robot, notes = tree_element(mechanism, path)
    write_mimics(robot, mechanism, "isaac")
    for loop in mechanism.loops:
        if loop.kind is not JointKind.SPHERICAL:
            raise UnsupportedError(
                f"loop '{loop.name}' is of type '{loop.kind}'; Isaac Sim knows only spherical loop joints: "
                "loops_by_balls(chain) holds hinges and rigid closures by balls"
            )
        element = etree.SubElement(robot, "loop_joint", name=loop.name, type="spherical")
        for tag, link, placement in (
            ("link1", loop.link1, loop.placement1),
            ("link2", loop.link2, loop.placement2),
        ):
            etree.SubElement(element, tag, {"link": link, **pose_attributes(placement)})
    lost = (*note_lost_limits(mechanism, "isaac", balls=()), *note_lost_physics(mechanism, "isaac"))
    return (*notes, *lost, *note_unheard(mechanism, "Isaac Sim"), *save(robot, mechanism, path))


_WORDS = {
    "robot/loop_joint": Words(
        ("name", "type"),
        ("link1", "link2", "parent", "child", "parent_origin", "child_origin", "axis", "limit", "dynamics"),
    ),
    "loop_joint/link1": Words(("link", "xyz", "rpy")),
    "loop_joint/link2": Words(("link", "xyz", "rpy")),
    "loop_joint/parent": Words(("link",)),
    "loop_joint/child": Words(("link",)),
    "loop_joint/parent_origin": Words(("xyz", "rpy")),
    "loop_joint/child_origin": Words(("xyz", "rpy")),
    "loop_joint/axis": Words(("xyz", "frame")),
    "loop_joint/limit": Words(("coordinate", *LIMITS)),
    "loop_joint/dynamics": Words(("coordinate", *DYNAMICS)),
}

DIALECT = Dialect("isaac", "Isaac <loop_joint>", {"robot/loop_joint": _read}, _WORDS, write=write_isaac)
