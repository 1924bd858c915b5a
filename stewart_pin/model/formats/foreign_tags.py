"""Tags of a robot file that are not read: some are harmless, some could change the mechanism."""

from __future__ import annotations

from lxml import etree

from stewart_pin.model.formats.xml import ElementReader, shown_tag

DIALECTS = (
    "<loop>, <coupling>, <loop_joint>, <drake:ball_constraint>, <constraint>, <gazebo><joint>, <mimic>, a YAML beside "
    "the URDF, frames closing_*_1, closing_*_2, and a link with two parents"
)
"""Loop syntaxes that `load` understands."""

_HARMLESS = {
    "visual": "for viewers",
    "collision": "collision shapes",
    "material": "colours are for viewers",
    "dynamics": "friction and damping are arguments of the simulation",
    "safety_controller": "controller settings",
    "calibration": "encoder settings",
    "contact": "simulator settings",
    "transmission": "motors are the joints marked independent",
    "ros2_control": "motors are the joints marked independent",
    "joint_properties": "friction and damping are arguments of the simulation",
    "gazebo": "simulator settings",
    "mujoco": "simulator settings",
    "sensor": "sensors",
    "group": "semantic groups",
    "group_state": "only the state 'home' is read",
    "end_effector": "only the one called 'platform' is read",
    "disable_collisions": "collision settings",
    "passive_joint": "motors are the joints marked independent",
    "virtual_joint": "the root link is the ground",
}
_LOOP_WORDS = ("loop", "constraint", "closure", "closing", "coupling", "connect", "weld", "mimic", "equality")
_UNEXPANDED = {
    "xacro": "expand the file with xacro first",
    "xi": "put the included text into the file",
}


def reason_to_ignore(reader: ElementReader, element: etree._Element, owner: str) -> str:
    """Say why a tag is not read, or stop: it could close a loop or couple joints, in a dialect that is not understood.

    Parameters
    ----------
    reader
        Reader of the file, for the error.
    element
        The tag.
    owner
        Link or joint that holds it, for the message.

    Returns
    -------
    str
        Why the mechanism does not need it.

    Raises
    ------
    FileFormatError
        If the tag, or one inside it, could change the mechanism.
    """
    for inner in element.iter(etree.Element):
        shown = shown_tag(inner)
        prefix, _, local = shown.rpartition(":")
        if prefix in _UNEXPANDED:
            raise reader.error(f"<{shown}> (line {inner.sourceline}): {_UNEXPANDED[prefix]}", f"<{shown}>")
        if _may_close_a_loop(inner, local.lower(), is_outermost=inner is element):
            if shown == "plugin":
                shown = f"plugin {inner.get('name') or inner.get('filename')}"
            path = "".join(f"<{tag}>" for tag in dict.fromkeys((shown_tag(element), shown)))
            raise reader.error(
                f"{path} (line {inner.sourceline}) of {owner} could close a loop or couple joints, and is not "
                f"understood; supported: {DIALECTS}",
                path,
            )
    return _HARMLESS.get(shown_tag(element), "unknown tag")


def _may_close_a_loop(element: etree._Element, name: str, *, is_outermost: bool) -> bool:
    if is_outermost:
        return name == "link" or (
            name not in _HARMLESS and any(word in name for word in (*_LOOP_WORDS, "joint"))
        )
    if name == "plugin":
        words = (element.get("filename", "") + element.get("name", "")).lower()
        return "detachable" in words
    if next(element.iterancestors("plugin"), None) is not None:
        return "mimic" in name
    if any(word in name for word in _LOOP_WORDS):
        return True
    # Plugins list joints by name only; a joint of a simulator's model has a type, or links.
    return name == "joint" and ("type" in element.attrib or element.find("child") is not None)
