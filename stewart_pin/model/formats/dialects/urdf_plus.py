"""URDF+: loops are ``<loop>``, gears are ``<coupling>``, and ``independent="true"`` marks the motors.

A loop has a ``<predecessor link>`` and a ``<successor link>``, each with its ``<origin>``, and an ``<axis>``.
Besides the types of URDF+, all kinds of loops are read and written: a universal one has ``<axis2>``, a distance has a
``<length value>``, a cable besides a ``<reel joint ratio>`` that winds it in and a ``<pulley radius>`` where it runs
over one, about the ``<axis>``. What its coordinates may do stands in ``<limit>`` as for a joint, of a kind with several
in one for each ``coordinate``. What it does by itself, damping and springs, stands in ``<dynamics>`` in the same way.

A coupling has a ``<predecessor link>``, a ``<successor link>`` and a ``<ratio value>``: the positions of the joints
from the nearest common ancestor of the two links to the successor sum up to the ratio times that of the predecessor.
With a motor's rotor as successor, on the same parent as the link that it drives: rotor = ratio × link. Other couplings
are written, and read, as ``type="polynomial"``: ``<follower joint>`` stands at the polynomial ``<polynomial value>``,
constant first, of ``<leader joint>``; without a leader, at the constant; each ``<also joint ratio>`` adds its ratio
times the position of one more joint. Readers that know none of all this see the spanning tree.

References
----------
.. [1] M. Chignoli et al., "URDF+: An Enhanced URDF for Robots with Kinematic Loops", 2024.
.. [2] generalized_rbda, the implementation by the same authors: ``ClusterTreeModel::explicitRollingConstraint``.
"""

from __future__ import annotations

from pathlib import Path

from lxml import etree

from stewart_pin.errors import UnsupportedError
from stewart_pin.model.description import (
    AXIS_FREE_LOOPS,
    LOOP_KINDS,
    Cable,
    Coupling,
    JointKind,
    Loop,
    Mechanism,
    Note,
    loop_coordinates,
)
from stewart_pin.model.formats.dialect import Dialect, Parts, upward
from stewart_pin.model.formats.dynamics import DYNAMICS, write_loop_dynamics
from stewart_pin.model.formats.urdf_core import read_bounds, read_loop_dynamics
from stewart_pin.model.formats.urdf_elements import LIMITS, UrdfElements
from stewart_pin.model.formats.urdf_writer import save, tree_element, write_bounds, write_origin
from stewart_pin.model.formats.words import Words
from stewart_pin.model.formats.xml import number_text


def _read_loop(reader: UrdfElements, element: etree._Element) -> Parts:
    name = reader.text(element, "name", "a <loop>")
    owner = f"loop '{name}'"
    written = reader.text(element, "type", owner)
    written = {"continuous": "revolute", "ball": "spherical"}.get(written, written)
    if written not in list(LOOP_KINDS):
        raise reader.error(f"{owner} has the type '{written}'; supported: {', '.join(LOOP_KINDS)}", owner)
    kind = JointKind(written)
    parts = {
        JointKind.UNIVERSAL: ("axis", "axis2"),
        JointKind.DISTANCE: ("length",),
        JointKind.CABLE: ("axis", "length", "reel", "pulley"),
    }.get(kind, ("axis",))
    reader.only(element, owner, ("name", "type"), ("predecessor", "successor", "limit", "dynamics", *parts))
    ends = [reader.child(element, tag, owner) for tag in ("predecessor", "successor")]
    length = 0.0
    if kind in (JointKind.DISTANCE, JointKind.CABLE):
        rod = reader.child(element, "length", owner)
        length = float(reader.numbers(rod, "value", 1, owner)[0])
    cable = _read_cable(reader, element, owner) if kind is JointKind.CABLE else Cable()
    # An axis guessed for a loop would be another mechanism.
    default = "0 0 1" if kind in AXIS_FREE_LOOPS and not cable.radius else ""
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
        bounds=read_bounds(reader, element, owner, kind),
        physics=read_loop_dynamics(reader, element, owner, kind),
        cable=cable,
    )
    return Parts(loops=(loop,))


def _read_cable(reader: UrdfElements, element: etree._Element, owner: str) -> Cable:
    reel, pulley = (reader.optional(element, tag, owner) for tag in ("reel", "pulley"))
    joint, ratio, radius = None, 1.0, 0.0
    if reel is not None:
        reader.only(reel, f"{owner}: <reel>", ("joint", "ratio"))
        joint = reader.text(reel, "joint", owner)
        if "ratio" in reel.attrib:
            ratio = float(reader.numbers(reel, "ratio", 1, owner)[0])
    if pulley is not None:
        reader.only(pulley, f"{owner}: <pulley>", ("radius",))
        radius = float(reader.numbers(pulley, "radius", 1, owner)[0])
    return Cable(joint, ratio, radius)


def _read_coupling(reader: UrdfElements, element: etree._Element) -> Parts:
    name = reader.text(element, "name", "a <coupling>")
    owner = f"coupling '{name}'"
    written = element.get("type", "rolling")
    if written == "polynomial":
        return _read_polynomial(reader, element, name, owner)
    if written != "rolling":
        raise reader.error(f"{owner} has the type '{written}'; supported: rolling, polynomial", owner)
    reader.only(element, owner, ("name", "type"), ("predecessor", "successor", "ratio"))
    ends = [reader.child(element, tag, owner) for tag in ("predecessor", "successor")]
    ratio_element = reader.child(element, "ratio", owner)
    links = [reader.text(end, "link", owner) for end in ends]
    ratio = float(reader.numbers(ratio_element, "value", 1, owner)[0])

    def coupled(mechanism: Mechanism) -> Parts:
        leaders, followers = joints_apart(mechanism, *links)
        if not leaders or not followers:
            lacks = "predecessor" if followers else "successor"
            raise UnsupportedError(
                f"{reader.path}: {owner}: no joint moves between the {lacks} and the common ancestor of both; name "
                "links on two branches"
            )
        others = [(joint, ratio) for joint in leaders[1:]] + [(joint, -1.0) for joint in followers[1:]]
        return Parts(couplings=(Coupling(name, followers[0], leaders[0], (0.0, ratio), tuple(others)),))

    return Parts(later=coupled)


def joints_apart(mechanism: Mechanism, link1: str, link2: str) -> tuple[list[str], list[str]]:
    """List the moving joints between two links and their nearest common ancestor.

    Parameters
    ----------
    mechanism
        Description with both links.
    link1, link2
        Names of the links.

    Returns
    -------
    first, second : list of str
        Names of the joints above each link that are not above the other.
    """
    paths = [[joint for joint in upward(mechanism, link)] for link in (link1, link2)]
    moving = [[joint.name for joint in path if joint.kind is not JointKind.FIXED] for path in paths]
    first, second = ([name for name in own if name not in other] for own, other in (moving, moving[::-1]))
    return first, second


def _read_polynomial(reader: UrdfElements, element: etree._Element, name: str, owner: str) -> Parts:
    reader.only(element, owner, ("name", "type"), ("follower", "leader", "polynomial", "also"))
    follower = reader.child(element, "follower", owner)
    leader = reader.optional(element, "leader", owner)
    numbers = reader.child(element, "polynomial", owner)
    coefficients = reader.parse(
        reader.text(numbers, "value", owner), None, f"{owner}: <polynomial value>", owner
    )
    joint2 = None if leader is None else reader.text(leader, "joint", owner)
    others: list[tuple[str, float]] = []
    for also in element.findall("also"):
        reader.only(also, owner, ("joint", "ratio"))
        others.append((reader.text(also, "joint", owner), float(reader.numbers(also, "ratio", 1, owner)[0])))
    coupling = Coupling(
        name, reader.text(follower, "joint", owner), joint2, tuple(map(float, coefficients)), tuple(others)
    )
    return Parts(couplings=(coupling,))


def write_urdf_plus(mechanism: Mechanism, path: Path) -> tuple[Note, ...]:
    """Write a mechanism as URDF with loops in the URDF+ dialect.

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
    """
    robot, notes = tree_element(mechanism, path)
    for loop in mechanism.loops:
        _write_loop(robot, loop)
    for coupling in mechanism.couplings:
        _write_coupling(robot, mechanism, coupling)
    return (*notes, *save(robot, mechanism, path))


def _write_coupling(robot: etree._Element, mechanism: Mechanism, coupling: Coupling) -> None:
    """Write a coupling as URDF+ has it where it can say it, else as a polynomial."""
    links = [mechanism.joint(name).child for name in (coupling.joint2, coupling.joint1) if name is not None]
    plain = len(coupling.polynomial) == 2 and coupling.polynomial[0] == 0 and not coupling.others
    if plain and joints_apart(mechanism, *links) == ([coupling.joint2], [coupling.joint1]):
        element = etree.SubElement(robot, "coupling", name=coupling.name, type="rolling")
        etree.SubElement(element, "predecessor", link=links[0])
        etree.SubElement(element, "successor", link=links[1])
        etree.SubElement(element, "ratio", value=number_text([coupling.polynomial[1]]))
        return
    element = etree.SubElement(robot, "coupling", name=coupling.name, type="polynomial")
    etree.SubElement(element, "follower", joint=coupling.joint1)
    if coupling.joint2 is not None:
        etree.SubElement(element, "leader", joint=coupling.joint2)
    etree.SubElement(element, "polynomial", value=number_text(coupling.polynomial))
    for joint, ratio in coupling.others:
        etree.SubElement(element, "also", joint=joint, ratio=number_text([ratio]))


def _write_loop(robot: etree._Element, loop: Loop) -> None:
    element = etree.SubElement(robot, "loop", name=loop.name, type=str(loop.kind))
    for tag, link, placement in (
        ("predecessor", loop.link1, loop.placement1),
        ("successor", loop.link2, loop.placement2),
    ):
        write_origin(etree.SubElement(element, tag, link=link), placement)
    swings = loop.kind is JointKind.SPHERICAL and bool(loop.bounds)  # by this axis
    if swings or loop.cable.radius or loop.kind not in AXIS_FREE_LOOPS:
        etree.SubElement(element, "axis", xyz=number_text(loop.axis))
    if loop.kind is JointKind.UNIVERSAL:
        etree.SubElement(element, "axis2", xyz=number_text(loop.axis2))
    if loop.kind in (JointKind.DISTANCE, JointKind.CABLE):
        etree.SubElement(element, "length", value=number_text([loop.length]))
    if loop.cable.reel is not None:
        etree.SubElement(element, "reel", joint=loop.cable.reel, ratio=number_text([loop.cable.ratio]))
    if loop.cable.radius:
        etree.SubElement(element, "pulley", radius=number_text([loop.cable.radius]))
    own = loop_coordinates(loop.kind)
    for coordinate, bounds in zip(own, loop.bounds, strict=False):
        write_bounds(element, bounds, **({"coordinate": coordinate} if len(own) > 1 else {}))
    write_loop_dynamics(element, loop.kind, loop.physics)


DIALECT = Dialect(
    "urdf+",
    "URDF+",
    {"robot/loop": _read_loop, "robot/coupling": _read_coupling},
    {
        "robot/loop": Words(
            ("name", "type"),
            ("predecessor", "successor", "axis", "axis2", "length", "reel", "pulley", "limit", "dynamics"),
        ),
        "loop/predecessor": Words(("link",), ("origin",)),
        "loop/successor": Words(("link",), ("origin",)),
        "loop/length": Words(("value",)),
        "loop/reel": Words(("joint", "ratio")),
        "loop/pulley": Words(("radius",)),
        "loop/limit": Words(("coordinate", *LIMITS)),
        "loop/dynamics": Words(("coordinate", *DYNAMICS)),
        "robot/coupling": Words(
            ("name", "type"),
            ("predecessor", "successor", "ratio", "follower", "leader", "polynomial", "also"),
        ),
        "coupling/predecessor": Words(("link",)),
        "coupling/successor": Words(("link",)),
        "coupling/ratio": Words(("value",)),
        "coupling/follower": Words(("joint",)),
        "coupling/leader": Words(("joint",)),
        "coupling/also": Words(("joint", "ratio")),
        "coupling/polynomial": Words(("value",)),
    },
    write=write_urdf_plus,
)
