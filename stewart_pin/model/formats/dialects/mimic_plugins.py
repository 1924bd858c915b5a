"""Mimic joints of Gazebo Classic, which knows no ``<mimic>``: plugins that move one joint after another.

``<mimicJoint>`` follows ``<joint>`` (``<jointName>`` in one of them) with ``<multiplier>`` and ``<offset>``. Where the
follower has a ``<mimic>`` of its own, that one counts.

References
----------
.. [1] roboticsgroup_gazebo_plugins, README, "MimicJointPlugin".
"""

from __future__ import annotations

from lxml import etree

from stewart_pin.model.description import Coupling
from stewart_pin.model.formats.dialects.mimic import read_mimic
from stewart_pin.model.formats.urdf_elements import UrdfElements

_LEADERS = ("joint", "jointName")
_SETTINGS = ("hasPID", "sensitiveness", "maxEffort", "robotNamespace", "namespace")


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
    found = [plugin for plugin in gazebo.findall("plugin") if plugin.find("mimicJoint") is not None]
    for plugin in found:
        gazebo.remove(plugin)
    return [c for c in (_read(reader, plugin) for plugin in found) if not _has_mimic(reader, c)]


def _has_mimic(reader: UrdfElements, coupling: Coupling) -> bool:
    """Tell whether the follower of a plugin has a ``<mimic>``, and note what the two say."""
    joints = [joint for joint in reader.root.findall("joint") if joint.get("name") == coupling.joint1]
    mimics = [mimic for joint in joints for mimic in joint.findall("mimic")]
    for mimic in mimics:
        own = read_mimic(reader, mimic)
        same = (own.joint2, own.polynomial) == (coupling.joint2, coupling.polynomial)
        offset, multiplier = coupling.polynomial
        other = f"left out: <mimic> says otherwise than {multiplier:g} × '{coupling.joint2}' + {offset:g}"
        text = f"Gazebo's mimic plugin {'repeats the <mimic>' if same else other}"
        reader.note(f"joint '{coupling.joint1}'", text)
    return bool(mimics)


def _read(reader: UrdfElements, plugin: etree._Element) -> Coupling:
    owner = f"plugin '{plugin.get('name', '')}'"
    leader = next((tag for tag in _LEADERS if plugin.find(tag) is not None), "joint")
    reader.only(
        plugin, owner, ("name", "filename"), (leader, "mimicJoint", "multiplier", "offset", *_SETTINGS)
    )
    joints = [reader.content(reader.child(plugin, tag, owner), owner) for tag in ("mimicJoint", leader)]
    numbers = []
    for tag, default in (("offset", 0.0), ("multiplier", 1.0)):
        element = reader.optional(plugin, tag, owner)
        text = None if element is None else reader.content(element, owner)
        numbers.append(
            default if text is None else float(reader.parse(text, 1, f"{owner}: <{tag}>", owner)[0])
        )
    for tag in _SETTINGS:
        if reader.optional(plugin, tag, owner) is not None:
            reader.note(owner, f"<{tag}>: simulator settings")
    return Coupling(f"{joints[0]}_mimic", joints[0], joints[1], tuple(numbers))
