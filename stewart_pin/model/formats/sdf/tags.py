"""Tags of SDFormat that are not read: why the mechanism does not need them, or that it might."""

from __future__ import annotations

from lxml import etree

from stewart_pin.model.formats.foreign_tags import reason_to_ignore
from stewart_pin.model.formats.xml import ElementReader, shown_tag

_HARMLESS = {
    "visual": "for viewers",
    "collision": "collision shapes",
    "surface": "contact settings",
    "material": "colours are for viewers",
    "sensor": "sensors",
    "light": "for viewers",
    "projector": "for viewers",
    "particle_emitter": "for viewers",
    "audio_sink": "for simulators",
    "audio_source": "for simulators",
    "battery": "for simulators",
    "self_collide": "collision settings",
    "allow_auto_disable": "simulator settings",
    "enable_wind": "simulator settings",
    "velocity_decay": "friction and damping are arguments of the simulation",
    "dynamics": "friction, damping and springs are arguments of the simulation",
    "physics": "simulator settings",
    "gripper": "simulator settings",
    "initial_position": "the zero pose is that of the links",
    "drake:collision_filter_group": "collision settings",
    "drake:controller_gains": "controller settings",
    "drake:damping": "friction, damping and springs are arguments of the simulation",
    "drake:linear_spring_damper": "friction, damping and springs are arguments of the simulation",
    "drake:rotor_inertia": "the inertia of a rotor is a link of its own here",
    "drake:gear_ratio": "the inertia of a rotor is a link of its own here",
}
_BINDING_PLUGINS = ("mimic", "detachable", "attach", "gearbox", "constraint", "closed", "loop")


def why_ignored(reader: ElementReader, element: etree._Element, owner: str) -> str:
    """Say why a tag is not read, or stop: it could hold links together, or couple joints.

    Parameters
    ----------
    reader
        Reader of the file, for the error.
    element
        The tag.
    owner
        Link, joint or model that holds it, for the message.

    Returns
    -------
    str
        Why the mechanism does not need it.

    Raises
    ------
    FileFormatError
        If the tag, or one inside it, could change the mechanism.
    """
    tag = shown_tag(element)
    if tag != "plugin":
        return _HARMLESS.get(tag) or reason_to_ignore(reader, element, owner)
    names = " ".join(element.get(key, "") for key in ("name", "filename"))
    inside = {shown_tag(inner).lower() for inner in element.iter(etree.Element)}
    if any(word in names.lower() for word in _BINDING_PLUGINS) or any("mimic" in inner for inner in inside):
        raise reader.error(
            f"<plugin> '{names}' (line {element.sourceline}) of {owner} could hold or couple links while the "
            "simulation runs, and is not understood; write the joint, or the <mimic>, into the model",
            "<plugin>",
        )
    return "code of a simulator"
