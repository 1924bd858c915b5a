"""URDF+: loops are ``<loop>``, and ``independent="true"`` marks the motors.

A loop has a ``<predecessor link>`` and a ``<successor link>``, each with its ``<origin>``, and an ``<axis>``.
Besides the types of URDF+, all kinds of loops are read and written: a universal one has ``<axis2>``, a distance has a
``<length value>``. Readers that know none of this see the spanning tree.

References
----------
.. [1] M. Chignoli et al., "URDF+: An Enhanced URDF for Robots with Kinematic Loops", 2024.
"""

from __future__ import annotations

from pathlib import Path

from lxml import etree

from stewart_pin.model.description import AXIS_FREE_LOOPS, LOOP_KINDS, JointKind, Loop, Mechanism
from stewart_pin.model.formats.dialect import Dialect, Parts
from stewart_pin.model.formats.urdf_elements import UrdfElements
from stewart_pin.model.formats.urdf_writer import save, tree_element, write_origin
from stewart_pin.model.formats.xml import number_text


def _read_loop(reader: UrdfElements, element: etree._Element) -> Parts:
    name = reader.text(element, "name", "a <loop>")
    owner = f"loop '{name}'"
    written = reader.text(element, "type", owner)
    written = {"continuous": "revolute", "ball": "spherical"}.get(written, written)
    if written not in list(LOOP_KINDS):
        raise reader.error(f"{owner} has the type '{written}'; supported: {', '.join(LOOP_KINDS)}", owner)
    kind = JointKind(written)
    parts = {JointKind.UNIVERSAL: ("axis", "axis2"), JointKind.DISTANCE: ("length",)}.get(kind, ("axis",))
    reader.only(element, owner, ("name", "type"), ("predecessor", "successor", *parts))
    ends = [reader.child(element, tag, owner) for tag in ("predecessor", "successor")]
    for end in ends:
        reader.only(end, owner, ("link",), ("origin",))
    length = 0.0
    if kind is JointKind.DISTANCE:
        rod = reader.child(element, "length", owner)
        reader.only(rod, owner, ("value",))
        length = float(reader.numbers(rod, "value", 1, owner)[0])
    # An axis guessed for a loop would be another mechanism.
    default = "0 0 1" if kind in AXIS_FREE_LOOPS else ""
    loop = Loop(
        name=name,
        kind=kind,
        link1=reader.text(ends[0], "link", owner),
        link2=reader.text(ends[1], "link", owner),
        placement1=reader.origin(ends[0], owner),
        placement2=reader.origin(ends[1], owner),
        axis=reader.axis(element, owner, "axis", default),
        axis2=reader.axis(element, owner, "axis2", "0 1 0" if kind is not JointKind.UNIVERSAL else ""),
        length=length,
    )
    return Parts(loops=(loop,))


def write_urdf_plus(mechanism: Mechanism, path: Path) -> None:
    """Write a mechanism as URDF with loops in the URDF+ dialect.

    Parameters
    ----------
    mechanism
        What to write.
    path
        File to create or overwrite.
    """
    robot = tree_element(mechanism)
    for loop in mechanism.loops:
        _write_loop(robot, loop)
    save(robot, mechanism, path)


def _write_loop(robot: etree._Element, loop: Loop) -> None:
    element = etree.SubElement(robot, "loop", name=loop.name, type=str(loop.kind))
    for tag, link, placement in (
        ("predecessor", loop.link1, loop.placement1),
        ("successor", loop.link2, loop.placement2),
    ):
        write_origin(etree.SubElement(element, tag, link=link), placement)
    if loop.kind not in AXIS_FREE_LOOPS:
        etree.SubElement(element, "axis", xyz=number_text(loop.axis))
    if loop.kind is JointKind.UNIVERSAL:
        etree.SubElement(element, "axis2", xyz=number_text(loop.axis2))
    if loop.kind is JointKind.DISTANCE:
        etree.SubElement(element, "length", value=number_text([loop.length]))


DIALECT = Dialect("urdf+", "URDF+ <loop>", {"robot/loop": _read_loop}, write=write_urdf_plus)
