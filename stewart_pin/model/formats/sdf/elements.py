"""Reading SDFormat elements: values as text, poses, flags, and what is not read, with the reason."""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.geometry.rotations import rotation_from_rpy
from stewart_pin.model.description import Note, Outcome
from stewart_pin.model.formats.words import Words, meant_word
from stewart_pin.model.formats.xml import ElementReader, reason_to_ignore, shown_tag
from stewart_pin.model.validation import SCALED, not_of_unit_length, unit_quaternion
from stewart_pin.tolerances import NO_DIRECTION
from stewart_pin.typing import FloatArray

# ----------------------------------------------------------------------------------------------------
# Tags of SDFormat that are not read: why the mechanism does not need them, or that it might
# ----------------------------------------------------------------------------------------------------


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
    "velocity_decay": "drag of whole links; a joint may have damping",
    "physics": "simulator settings",
    "gripper": "simulator settings",
    "initial_position": "the zero pose is that of the links",
    "drake:collision_filter_group": "collision settings",
    "drake:controller_gains": "controller settings",
    "drake:damping": "Drake reads it in its planar joint alone",
    "drake:linear_spring_damper": "a spring between points of two links, which no joint is; a joint may have one",
}
_BINDING_PLUGINS = ("mimic", "detachable", "attach", "gearbox", "constraint", "closed", "loop")


def held_model(plugin: etree._Element) -> str | None:
    """Tell whether a plugin of Gazebo is a DetachableJoint between links of this file: it closes a loop.

    Parameters
    ----------
    plugin
        The ``<plugin>``.

    Returns
    -------
    str or None
        Model beside its own one of which it holds a link, empty for its own; None where it is none, or holds a model of
        another file.
    """
    names = " ".join(plugin.get(key, "") for key in ("name", "filename")).lower()
    model = plugin.getparent()
    held = (plugin.findtext("child_model") or "").strip()
    if "detachable" not in names or not held or model is None:
        return None
    if held == "__model__" or (shown_tag(model) == "model" and held == model.get("name")):
        return ""
    world = model.getparent()
    beside = [] if world is None or shown_tag(world) != "world" else [title(element) for element in world]
    return held if held in beside else None


def title(element: etree._Element) -> str:
    """Name a ``<model>`` or an ``<include>``.

    Parameters
    ----------
    element
        The element.

    Returns
    -------
    str
        Its name, or else what it includes.
    """
    return (element.get("name") or element.findtext("name") or element.findtext("uri") or "").strip()


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
    if tag == "drake:linear_spring_damper":
        inner = [(shown_tag(each), (each.text or "").strip()) for each in element.iterchildren(etree.Element)]
        told = ", ".join(f"{name.rpartition('damper_')[2]} {text}" for name, text in inner)
        return f"{_HARMLESS[tag]} ({told})"
    if tag != "plugin":
        return _HARMLESS.get(tag) or reason_to_ignore(reader, element, owner)
    if held_model(element) is not None:
        return "holds two links as they lie at rest: read as a loop, never detached"
    names = " ".join(element.get(key, "") for key in ("name", "filename"))
    inside = {shown_tag(inner).lower() for inner in element.iter(etree.Element)}
    if any(word in names.lower() for word in _BINDING_PLUGINS) or any("mimic" in inner for inner in inside):
        raise reader.error(
            f"<plugin> '{names}' (line {element.sourceline}) of {owner} could hold or couple links while the "
            "simulation runs, and is not understood; write the joint, or the <mimic>, into the model",
            "<plugin>",
        )
    return "code of a simulator"


# ----------------------------------------------------------------------------------------------------

_INFINITY = re.compile(r"([+-]?)inf(inity)?", re.IGNORECASE)
_NUMBER = re.compile(r"[+-]?[0-9.]+([eE][+-]?[0-9]+)?", re.ASCII)
_ENDLESS = 1e16
"""SDFormat's own number for no limit; exporters write the largest float or double as well."""
_FLAGS = {"true": True, "1": True, "false": False, "0": False}
_ROUND_OFF = 1e-15
"""Component of a unit vector below which it counts as zero."""


# ----------------------------------------------------------------------------------------------------
# Words of our own, for what SDFormat has none: attributes and elements of a namespace, which other readers pass over
#
# link body="false"                it is no body, whatever its <inertial> says
# link joint, frame joint          name of the joint by which it floats, or is fixed
# joint name, mimic name           name of joint and coupling, where the file has to use another one
# joint axis                       axis from which the swing of a ball is counted
# joint part1, part2, between        names of the two hinges and of the cross that stand for a universal joint
# joint independent                whether a motor drives it; on one joint: none that does not say so is a motor
# joint position, link position    what the joint reads at rest: a coordinate, a quaternion of a ball, the pose of a
#                                  floating link; of a joint that closes a loop, frame 2 in frame 1 [m, quaternion]
# limit velocity, effort, ...      least and greatest value, where they are not opposite; also jerk
# <limit coordinate>               the same, and position, of a coordinate for which SDFormat has no <limit>
# dynamics stiffness, rest, force  the spring as a polynomial, its rest counted as <spring_reference> is, and a constant
#                                  effort; armature: the rotor of what no motor drives
# <dynamics coordinate>            all that a coordinate does for which SDFormat has no <axis>, by the fields of
#                                  `JointPhysics`; of a floating link, its six coordinates alike
# model platform                   name of the platform link
# visual name, material name       names, where SDFormat wants others
# ----------------------------------------------------------------------------------------------------

OWN_PREFIX, OWN = "stewart_pin", "urn:stewart_pin"
"""Prefix and name of the namespace."""
OWN_LIMIT, OWN_DYNAMICS = f"{OWN_PREFIX}:limit", f"{OWN_PREFIX}:dynamics"
SPANS = ("velocity", "acceleration", "effort", "jerk")
"""Limits that have a word of our own."""


def own(*keys: str) -> tuple[str, ...]:
    """Spell attributes of our own namespace.

    Parameters
    ----------
    *keys
        Their names.

    Returns
    -------
    tuple of str
        As lxml has them.
    """
    return tuple(f"{{{OWN}}}{key}" for key in keys)


# ----------------------------------------------------------------------------------------------------


class SdfReader(ElementReader):
    """Reads elements of one SDFormat file.

    Parameters
    ----------
    path
        The file.
    notes
        What was kept, changed or ignored so far; the files of one robot share the list.
    """

    def __init__(self, path: Path, notes: list[Note]) -> None:
        super().__init__(path)
        self.notes = notes

    def note(self, subject: str, text: str, outcome: Outcome = Outcome.IGNORED) -> None:
        """Write a note for the report.

        Parameters
        ----------
        subject
            Link, joint or model.
        text
            What became of it.
        outcome
            Kept, changed or ignored.
        """
        self.notes.append(Note(subject, text, outcome))

    def note_strangers(self, element: etree._Element, owner: str, words: Words) -> None:
        """Note what is not read; stop at misspelt words, and at children that could change the mechanism.

        Parameters
        ----------
        element
            Where to look.
        owner
            Named in the message.
        words
            What it may hold.
        """
        attributes, known = words.attributes, words.tags
        for name in element.attrib:
            if name not in attributes:
                what = f"attribute '{name}' of <{shown_tag(element)}>"
                self.refuse_slip(str(name), attributes, element, what, owner)
                self.note(f"{owner}, line {element.sourceline}", f"{what}: unknown")
        for child in element.iterchildren(etree.Element):
            tag = shown_tag(child)
            if tag not in known:
                if tag not in _HARMLESS:
                    self.refuse_slip(tag, known, child, f"<{tag}> of <{shown_tag(element)}>", owner)
                why = words.noted.get(tag) or why_ignored(self, child, owner)
                self.note(
                    f"{owner}, line {child.sourceline}" if "unknown" in why else owner, f"<{tag}>: {why}"
                )

    def refuse_slip(
        self, word: str, known: Collection[str], element: etree._Element, what: str, owner: str
    ) -> None:
        """Stop at a misspelt word.

        Parameters
        ----------
        word
            As it is written.
        known
            Words that are read there.
        element
            Where it stands.
        what, owner
            Named in the message.

        Raises
        ------
        FileFormatError
            If it looks like one of the known words, which the message tells.
        """
        meant = meant_word(word, known)
        if meant:
            raise self.error(
                f"{owner}: {what} (line {element.sourceline}) is not understood; is '{meant}' meant?", owner
            )

    def children(self, element: etree._Element, tag: str) -> list[etree._Element]:
        """List the children of a tag.

        Parameters
        ----------
        element
            Where to look.
        tag
            Tag with its prefix, whether its namespace is declared or not.

        Returns
        -------
        list
            The children, in the order of the file.
        """
        return [child for child in element.iterchildren(etree.Element) if shown_tag(child) == tag]

    def optional(self, element: etree._Element, tag: str, owner: str) -> etree._Element | None:
        """Find a child element, of which there may be at most one.

        Parameters
        ----------
        element
            Where to look.
        tag
            Tag of the child, with its prefix.
        owner
            Named in the message.

        Returns
        -------
        lxml.etree._Element or None
            The child.
        """
        found = self.children(element, tag)
        if len(found) > 1:
            raise self.error(
                f"{owner} has {len(found)} <{tag}> (line {found[1].sourceline}); keep one", owner
            )
        return found[0] if found else None

    def name(self, element: etree._Element) -> str:
        """Read the name of a link, joint, frame or model.

        Parameters
        ----------
        element
            The element.

        Returns
        -------
        str
            Its name.
        """
        name = self.text(element, "name", f"a <{shown_tag(element)}>")
        if name == "world" or (name.startswith("__") and name.endswith("__")):
            raise self.error(
                f"<{shown_tag(element)}> (line {element.sourceline}) has the name '{name}', which SDFormat keeps "
                "for itself; rename it",
                name,
            )
        return name

    def content(self, element: etree._Element, tag: str, owner: str) -> str:
        """Read the text of a child that is required.

        Parameters
        ----------
        element
            Where to look.
        tag
            Tag of the child.
        owner
            Named in the message.

        Returns
        -------
        str
            Its text, without blanks around it.
        """
        child = self.child(element, tag, owner)
        text = (child.text or "").strip()
        if not text:
            raise self.error(f"{owner}: <{tag}> (line {child.sourceline}) is empty", owner)
        return text

    def vector(self, element: etree._Element, tag: str, n: int, owner: str, default: str = "") -> FloatArray:
        """Read a child of n finite numbers.

        Parameters
        ----------
        element
            Where to look.
        tag
            Tag of the child.
        n
            How many numbers it holds.
        owner
            Named in the message.
        default
            Text to use when the child is absent; empty: it is required.

        Returns
        -------
        numpy.ndarray
            (n,) the numbers, in the unit of the element [m, rad, kg, kg m²].
        """
        child = self.optional(element, tag, owner) if default else self.child(element, tag, owner)
        if child is None:
            return self.parse(default, n, owner, owner)
        text = (child.text or "").strip()
        if (
            default and not text and not len(child)
        ):  # Gazebo and Drake take an empty element for an absent one
            return self.parse(default, n, owner, owner)
        return self.parse(text, n, f"{owner}: <{tag}> (line {child.sourceline})", owner)

    def number(self, element: etree._Element, tag: str, owner: str, default: str = "") -> float:
        """Read a child of one finite number.

        Parameters
        ----------
        element
            Where to look.
        tag
            Tag of the child.
        owner
            Named in the message.
        default
            Text to use when the child is absent; empty: it is required.

        Returns
        -------
        float
            The number, in the unit of the element [m, rad, kg, kg m²].
        """
        return float(self.vector(element, tag, 1, owner, default)[0])

    def bound(self, element: etree._Element, tag: str, owner: str) -> float | None:
        """Read a limit, which may be infinite.

        Parameters
        ----------
        element
            Where to look.
        tag
            Tag of the child.
        owner
            Named in the message.

        Returns
        -------
        float or None
            The limit [m, rad, N, N m, m/s or rad/s], or None where the file states none.
        """
        child = self.optional(element, tag, owner)
        if child is None:
            return None
        text = (child.text or "").strip()
        if not text and not len(child):
            return None
        endless = _INFINITY.fullmatch(text)
        if endless:
            return -np.inf if endless[1] == "-" else np.inf
        if _NUMBER.fullmatch(text) and abs(float(text)) >= _ENDLESS:
            return float(np.copysign(np.inf, float(text)))
        return float(self.parse(text, 1, f"{owner}: <{tag}> (line {child.sourceline})", owner)[0])

    def flag(
        self, element: etree._Element, tag: str, owner: str, *, default: bool = False, attribute: bool = False
    ) -> bool:
        """Read a child or an attribute that is true or false.

        Parameters
        ----------
        element
            Where to look.
        tag
            Tag of the child, or name of the attribute.
        owner
            Named in the message.
        default
            What absence means.
        attribute
            Whether it is an attribute.

        Returns
        -------
        bool
            The flag.
        """
        if attribute:
            text = element.get(tag)
        else:
            child = self.optional(element, tag, owner)
            text = None if child is None else (child.text or "")
        if text is None:
            return default
        value = _FLAGS.get(text.strip().lower())
        if value is None:
            raise self.error(
                f"{owner}: <{tag}> (line {element.sourceline}) must be true or false, got {text.strip()!r}",
                owner,
            )
        return value

    def own(self, element: etree._Element, key: str) -> str | None:
        """Read an attribute of our own namespace.

        Parameters
        ----------
        element
            Where to look.
        key
            Its name.

        Returns
        -------
        str or None
            Its text; None where it is absent.
        """
        return element.get(own(key)[0])

    def own_numbers(self, element: etree._Element, key: str, owner: str) -> FloatArray | None:
        """Read the numbers of an attribute of our own namespace.

        Parameters
        ----------
        element
            Where to look.
        key
            Its name.
        owner
            Named in the message.

        Returns
        -------
        numpy.ndarray or None
            (n,) the numbers [m, rad, quaternion], n > 0; None where it is absent.
        """
        text = self.own(element, key)
        where = f"{owner}: {OWN_PREFIX}:{key} (line {element.sourceline})"
        return None if text is None else self.parse(text, None, where, owner)

    def unit_quaternion(self, quaternion: FloatArray, owner: str) -> FloatArray:
        """Scale what a joint reads to unit length, if its digits explain that it lacks it.

        Parameters
        ----------
        quaternion
            (4,) as it was read (dimensionless).
        owner
            Named in the message.

        Returns
        -------
        numpy.ndarray
            (4,) of unit length (dimensionless).
        """
        unit = unit_quaternion(quaternion)
        if unit is None:
            raise self.error(f"{owner}: {OWN_PREFIX}:position: {not_of_unit_length(quaternion)}", owner)
        if not np.array_equal(unit, quaternion):
            self.note(owner, SCALED, Outcome.CHANGED)
        return unit

    def own_spans(
        self, element: etree._Element, owner: str, keys: Collection[str] = SPANS
    ) -> dict[str, tuple[float, float]]:
        """Read least and greatest values from attributes of our own namespace.

        Parameters
        ----------
        element
            A limit.
        owner
            Named in the message.
        keys
            Names of the attributes.

        Returns
        -------
        dict
            By name, for those that are there [m, rad, N, N m and their rates]; infinite where nothing is stated.
        """
        found: dict[str, tuple[float, float]] = {}
        for key in keys:
            words = (self.own(element, key) or "").split()
            if not words:
                continue
            where = f"{owner}: {OWN_PREFIX}:{key} (line {element.sourceline})"
            if len(words) != 2:
                raise self.error(
                    f"{where} must hold a least and a greatest value, got {' '.join(words)!r}", owner
                )
            least, most = (self._end(word, where, owner) for word in words)
            found[key] = (least, most)
        return found

    def _end(self, word: str, where: str, owner: str) -> float:
        endless = _INFINITY.fullmatch(word)
        if endless:
            return -np.inf if endless[1] == "-" else np.inf
        return float(self.parse(word, 1, where, owner)[0])

    def pose(self, element: etree._Element, owner: str) -> tuple[pin.SE3, str]:
        """Read the ``<pose>`` of an element.

        Parameters
        ----------
        element
            Link, joint, frame, model or inertial.
        owner
            Named in the message.

        Returns
        -------
        placement : pinocchio.SE3
            The pose; the identity where there is none.
        relative_to : str
            Name of the frame in which it is given; empty for the default of the element.
        """
        pose = self.optional(element, "pose", owner)
        if pose is None:
            return pin.SE3.Identity(), ""
        self.only(pose, owner, ("relative_to", "frame", "rotation_format", "degrees"))
        # Up to 1.6 the attribute was called `frame`.
        frame = pose.get("relative_to") or pose.get("frame") or ""
        where = f"{owner}: <pose> (line {pose.sourceline})"
        written = pose.get("rotation_format", "euler_rpy")
        degrees = self.flag(pose, "degrees", owner, attribute=True)
        text = (pose.text or "").strip()
        if not text:
            return pin.SE3.Identity(), frame
        if written == "quat_xyzw" and not degrees:
            values = self.parse(text, 7, where, owner)
            size = float(np.linalg.norm(values[3:]))
            if size < NO_DIRECTION:
                raise self.error(f"{where} has a quaternion of length zero", owner)
            return pin.SE3(pin.Quaternion(values[3:] / size).matrix(), values[:3]), frame
        if written != "euler_rpy":
            raise self.error(
                f"{where} has the rotation_format '{written}'"
                f"{' in degrees' if degrees else ''}; write euler_rpy, or quat_xyzw without degrees",
                owner,
            )
        values = self.parse(text, 6, where, owner)
        angles = np.deg2rad(values[3:]) if degrees else values[3:]
        return pin.SE3(rotation_from_rpy(*angles), values[:3]), frame


def direction(reader: SdfReader, vector: FloatArray, owner: str) -> FloatArray:
    """Scale an axis to unit length.

    Parameters
    ----------
    reader
        Reader of the file, for the error.
    vector
        (3,) axis as the file gives it, dimensionless.
    owner
        Named in the message.

    Returns
    -------
    numpy.ndarray
        (3,) unit vector, dimensionless; exactly along a coordinate axis where only round-off says otherwise.
    """
    size = float(np.linalg.norm(vector))
    if size < NO_DIRECTION:
        raise reader.error(f"{owner} has an axis of length zero; give a direction", owner)
    unit = vector if abs(size - 1) < _ROUND_OFF else vector / size
    unit = np.where(np.abs(unit) < _ROUND_OFF, 0.0, unit)
    return np.sign(unit) if np.count_nonzero(unit) == 1 else unit
