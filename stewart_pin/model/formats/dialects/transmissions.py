"""Motors that ROS names: ``<transmission>`` and ``<ros2_control>``.

They count where no joint is marked independent and they can only mean one thing; see `choose_motors`.

References
----------
.. [1] ROS wiki, "urdf/XML/Transmission"; ros2_control documentation, "URDF hardware components".
"""

from __future__ import annotations

from lxml import etree

from stewart_pin.model.description import Note
from stewart_pin.model.formats.dialect import Dialect, Parts
from stewart_pin.model.formats.urdf_elements import UrdfElements
from stewart_pin.model.formats.xml import reason_to_ignore, shown_tag

_NOT_DRIVEN = ("PassiveJointInterface", "JointStateInterface")
_ROTOR = ("drake:rotor_inertia", "drake:gear_ratio")


def _read_transmission(reader: UrdfElements, element: etree._Element) -> Parts:
    reason_to_ignore(reader, element, "the file")
    notes = tuple(
        Note(f"<{shown_tag(inner)}>", "rotor inertia and gear ratio are arguments of the simulation")
        for inner in element.iter(etree.Element)
        if shown_tag(inner) in _ROTOR
    )
    joints = element.findall("joint")
    if joints and all(_is_passive(joint) for joint in joints):
        return Parts(notes=(*notes, Note(reader.shown(element, "the file"), "passive joints, no motors")))
    return Parts(motors=tuple(joint.get("name") or "" for joint in joints), notes=notes)


def _is_passive(joint: etree._Element) -> bool:
    """Tell whether a joint's interfaces are all those of a joint that nothing drives."""
    words = [(each.text or "").strip().rpartition("/")[2] for each in joint.findall("hardwareInterface")]
    return bool(words) and all(word in _NOT_DRIVEN for word in words)


def _read_ros2_control(reader: UrdfElements, element: etree._Element) -> Parts:
    reason_to_ignore(reader, element, "the file")
    driven = [joint for joint in element.findall("joint") if joint.find("command_interface") is not None]
    return Parts(motors=tuple(joint.get("name") or "" for joint in driven))


DIALECT = Dialect(
    "ros",
    "ROS <transmission>, <ros2_control>",
    {"robot/transmission": _read_transmission, "robot/ros2_control": _read_ros2_control},
)
