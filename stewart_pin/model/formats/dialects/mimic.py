"""URDF's ``<mimic>``: one joint stands at ``multiplier`` times the position of another, plus ``offset``.

What has another name than ``<joint>_mimic`` keeps it in an attribute ``name``, which other readers pass over.
The plugins of Gazebo Classic that do the same are read too.

References
----------
.. [1] ROS wiki, "urdf/XML/joint", mimic.
"""

from __future__ import annotations

from dataclasses import replace

from lxml import etree

from stewart_pin.errors import UnsupportedError
from stewart_pin.model.description import Coupling, JointKind, Mechanism, Note, Outcome
from stewart_pin.model.formats.dialect import Dialect, Parts
from stewart_pin.model.formats.urdf_elements import UrdfElements
from stewart_pin.model.formats.words import Words, check_words, meant_word
from stewart_pin.model.formats.xml import number_text


def _read(reader: UrdfElements, element: etree._Element) -> Parts:
    coupling = read_mimic(reader, element)
    return Parts(later=lambda mechanism: couple(mechanism, coupling))


def read_mimic(reader: UrdfElements, element: etree._Element) -> Coupling:
    """Read a ``<mimic>``.

    Parameters
    ----------
    reader
        Reader of the file.
    element
        The tag, inside the joint that follows.

    Returns
    -------
    Coupling
        Follower, leader, offset and multiplier.
    """
    parent = element.getparent()
    joint = "" if parent is None else parent.get("name", "")
    owner = f"joint '{joint}'"
    multiplier = float(reader.numbers(element, "multiplier", 1, owner, default="1")[0])
    offset = float(reader.numbers(element, "offset", 1, owner, default="0")[0])
    name = element.get("name") or f"{joint}_mimic"
    return Coupling(name, joint, reader.text(element, "joint", owner), (offset, multiplier))


def couple(mechanism: Mechanism, coupling: Coupling) -> Parts:
    """Add a linear coupling, of which a joint may be rigid: a file that holds joints still need not lose its gears.

    Parameters
    ----------
    mechanism
        What has been read so far.
    coupling
        Follower, leader, offset and multiplier.

    Returns
    -------
    Parts
        The coupling; nothing where the follower is rigid; where the leader is, which stands at zero, the follower
        stands at the offset. Notes say so.
    """
    fixed = [joint.name for joint in mechanism.joints if joint.kind is JointKind.FIXED]
    subject = f"joint '{coupling.joint1}'"
    if coupling.joint1 in fixed:
        return Parts(notes=(Note(subject, f"does not follow '{coupling.joint2}': it is fixed"),))
    if coupling.joint2 not in fixed:
        return Parts(couplings=(coupling,))
    held = replace(coupling, joint2=None, polynomial=coupling.polynomial[:1])
    text = f"held still at {coupling.polynomial[0]:g}: '{coupling.joint2}', which it follows, is fixed"
    return Parts(couplings=(held,), notes=(Note(subject, text, Outcome.CHANGED),))


def write_mimics(robot: etree._Element, mechanism: Mechanism, format: str) -> None:
    """Write the couplings of a mechanism into its joints.

    Parameters
    ----------
    robot
        The ``<robot>``, with its joints.
    mechanism
        What it describes.
    format
        Named in the message.

    Raises
    ------
    UnsupportedError
        If a coupling is not linear, holds a joint still, or is the second of its joint.
    """
    joints = {element.get("name"): element for element in robot.iter("joint", "{*}joint")}
    for coupling in mechanism.couplings:
        joint = joints[coupling.joint1]
        offset, multiplier, *higher = (*coupling.polynomial, 0.0, 0.0)
        fault = ""
        if coupling.others:
            fault = "follows a sum of joints"
        elif coupling.joint2 is None:
            fault = "holds a joint still: make the joint fixed"
        elif any(higher):
            fault = "is not linear"
        elif joint.find("mimic") is not None:
            fault = f"is the second that joint '{coupling.joint1}' follows: write the other joint of one of them first"
        if fault:
            raise UnsupportedError(
                f"coupling '{coupling.name}' {fault}; format '{format}' knows only <mimic>"
            )
        named = {} if coupling.name == f"{coupling.joint1}_mimic" else {"name": coupling.name}
        values = {"multiplier": number_text([multiplier]), "offset": number_text([offset])}
        etree.SubElement(joint, "mimic", {"joint": str(coupling.joint2), **values, **named})


DIALECT = Dialect(
    "mimic",
    "<mimic>",
    {"joint/mimic": _read, "drake:joint/mimic": _read},
    {"joint/mimic": Words(("joint", "multiplier", "offset"), (), {"@name": "name of the coupling"})},
)


# ----------------------------------------------------------------------------------------------------
# Mimic joints of Gazebo Classic, which knows no ``<mimic>``: plugins that move one joint after another
#
# ``<mimicJoint>`` follows ``<joint>`` (``<jointName>`` in one of them) with ``<multiplier>`` and ``<offset>``. Where
# the follower has a ``<mimic>`` of its own, that one counts.
#
# References
# ----------
# .. [1] roboticsgroup_gazebo_plugins, README, "MimicJointPlugin".
# ----------------------------------------------------------------------------------------------------

_LEADERS = ("joint", "jointName")
_SETTINGS = ("hasPID", "sensitiveness", "maxEffort", "robotNamespace", "namespace")
_PLUGIN = {
    "plugin": Words(
        (),
        ("mimicJoint", *_LEADERS, "multiplier", "offset"),
        {"@name": "", "@filename": "told by its tags", **dict.fromkeys(_SETTINGS, "simulator settings")},
    ),
    **{f"plugin/{tag}": Words(text=True) for tag in ("mimicJoint", *_LEADERS, "multiplier", "offset")},
}
"""Words of the plugins; others are no robot's."""


def take_mimic_plugins(reader: UrdfElements, gazebo: etree._Element) -> list[Coupling]:
    """Read the mimic plugins inside a ``<gazebo>``, and take them out of it.

    Parameters
    ----------
    reader
        Reader of the file.
    gazebo
        The element.

    Returns
    -------
    list of Coupling
        One per plugin whose follower has no ``<mimic>``.
    """
    for child in gazebo.iterfind("plugin/*"):
        if child.tag != "mimicJoint" and meant_word(str(child.tag), ("mimicJoint",)):
            what = f"<{child.tag}> of a <plugin> (line {child.sourceline})"
            text = f"{what} is not understood; is <mimicJoint> meant?"
            raise reader.error(text, f"<{child.tag}>")
    found = [plugin for plugin in gazebo.findall("plugin") if plugin.find("mimicJoint") is not None]
    for plugin in found:
        gazebo.remove(plugin)
    read = [_read_plugin(reader, plugin) for plugin in found]
    return [coupling for coupling in read if not has_mimic(reader, coupling, "Gazebo's mimic plugin")]


def has_mimic(reader: UrdfElements, coupling: Coupling, told_by: str) -> bool:
    """Tell whether a follower has a ``<mimic>`` as well, and note what the two say.

    Parameters
    ----------
    reader
        Reader of the file.
    coupling
        What another tag says.
    told_by
        How the note calls that tag.

    Returns
    -------
    bool
        Whether it has one, which counts.
    """
    joints = [joint for joint in reader.root.findall("joint") if joint.get("name") == coupling.joint1]
    mimics = [mimic for joint in joints for mimic in joint.findall("mimic")]
    for mimic in mimics:
        own = read_mimic(reader, mimic)
        same = (own.joint2, own.polynomial) == (coupling.joint2, coupling.polynomial)
        offset, multiplier = coupling.polynomial
        other = f"left out: <mimic> says otherwise than {multiplier:g} × '{coupling.joint2}' + {offset:g}"
        text = f"{told_by} {'repeats the <mimic>' if same else other}"
        reader.note(f"joint '{coupling.joint1}'", text)
    return bool(mimics)


def _read_plugin(reader: UrdfElements, plugin: etree._Element) -> Coupling:
    owner = f"plugin '{plugin.get('name', '')}'"
    leader = next((tag for tag in _LEADERS if plugin.find(tag) is not None), "joint")
    check_words(reader, plugin, _PLUGIN, reader.note)
    for tag in _LEADERS:
        if tag != leader and plugin.find(tag) is not None:
            raise reader.error(f"{owner} has a <{leader}> and a <{tag}>; keep one", owner)
    joints = [reader.content(reader.child(plugin, tag, owner), owner) for tag in ("mimicJoint", leader)]
    numbers = []
    for tag, default in (("offset", 0.0), ("multiplier", 1.0)):
        element = reader.optional(plugin, tag, owner)
        text = None if element is None else reader.content(element, owner)
        numbers.append(
            default if text is None else float(reader.parse(text, 1, f"{owner}: <{tag}>", owner)[0])
        )
    return Coupling(f"{joints[0]}_mimic", joints[0], joints[1], tuple(numbers))
