"""Frames of SDFormat at rest: where links, joints, frames and nested models stand, and to which link they belong.

Links stand in the frame of their model, frames in the one they are attached to, joints in that of their child link
(the rule of every version); ``relative_to`` names another one. A nested model is a scope of its own, whose frames are
called ``model::frame`` from outside.

References
----------
.. [1] Open Robotics, "Pose Frame Semantics Proposal", SDFormat 1.7, and "Model Composition", SDFormat 1.8.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.model.description import JointKind
from stewart_pin.model.formats.sdf.elements import SdfReader
from stewart_pin.typing import FloatArray

MODEL = "__model__"
WORLD = "world"
_LISTED = 30
"""How many names an error lists."""


def motion(kind: JointKind, axis: FloatArray, values: FloatArray) -> pin.SE3:
    """Place the child link of a joint in the joint's frame.

    Parameters
    ----------
    kind
        A kind of joints in a tree.
    axis
        (3,) unit vector in the joint frame, dimensionless; of a joint of one freedom.
    values
        Where the joint stands [m, rad, quaternion]; not asked of a fixed joint.

    Returns
    -------
    pinocchio.SE3
        The placement.
    """
    match kind:
        case JointKind.REVOLUTE:
            return pin.SE3(pin.exp3(axis * values[0]), np.zeros(3))
        case JointKind.PRISMATIC:
            return pin.SE3(np.eye(3), axis * values[0])
        case JointKind.SPHERICAL:
            return pin.SE3(pin.Quaternion(values).matrix(), np.zeros(3))
        case JointKind.FLOATING:
            return pin.XYZQUATToSE3(values)
        case _:
            return pin.SE3.Identity()


def coordinates_between(
    kind: JointKind, axis: FloatArray, axis2: FloatArray, placement: pin.SE3
) -> tuple[float, ...]:
    """Read the coordinates of a joint that closes a loop off its frames, as far as SDFormat has limits of them.

    Parameters
    ----------
    kind
        Kind of the loop.
    axis, axis2
        (3,) unit vectors, as of a `Loop`, dimensionless.
    placement
        Frame 2 in frame 1.

    Returns
    -------
    tuple of float
        As many as the joint has axes in SDFormat [m or rad].
    """
    turn = placement.rotation
    match kind:
        case JointKind.PRISMATIC:
            return (float(axis @ placement.translation),)
        case JointKind.REVOLUTE:
            quaternion = pin.Quaternion(turn)
            return (float(2 * np.arctan2(axis @ quaternion.vec(), quaternion.w)),)
        case JointKind.UNIVERSAL:
            # R = exp(a α) exp(b β): α from b to R b about a, β from Rᵀ a to a about b.
            return _angle(axis, axis2, turn @ axis2), _angle(axis2, turn.T @ axis, axis)
        case _:
            return ()


def _angle(axis: FloatArray, before: FloatArray, after: FloatArray) -> float:
    along = before @ after - (axis @ before) * (axis @ after)
    return float(np.arctan2(axis @ np.cross(before, after), along))


@dataclass(eq=False)
class Scope:
    """A model, or the world around it, with the frames that its elements may name.

    Attributes
    ----------
    reader
        Reader of the file that holds it.
    element
        Its ``<model>`` or ``<world>``.
    prefix
        What stands before the names of its links and joints: empty for the outermost model.
    version
        Of the file.
    parent
        Scope around it.
    placing
        Element whose ``<pose>`` places the model: the model itself, or the ``<include>`` that took it in.
    placement_frame
        Frame inside the model that this pose places.
    static
        Whether its links are held in the world.
    nested
        Scopes of the models inside, by name.
    elements
        Links, joints, frames by name.
    """

    reader: SdfReader
    element: etree._Element
    prefix: str
    version: tuple[int, ...]
    parent: Scope | None = None
    placing: tuple[SdfReader, etree._Element] | None = None
    placement_frame: str = ""
    static: bool = False
    nested: dict[str, Scope] = field(default_factory=dict)
    elements: dict[str, etree._Element] = field(default_factory=dict)
    _poses: dict[str, pin.SE3] = field(default_factory=dict)
    _bodies: dict[str, str] = field(default_factory=dict)

    @property
    def owner(self) -> str:
        """How messages call it."""
        return f"{self.element.tag} '{self.element.get('name', '')}'"

    def models(self) -> list[Scope]:
        """List the scope and all those inside, in the order of the file.

        Returns
        -------
        list of Scope
            This one first.
        """
        found: list[Scope] = []
        waiting: list[Scope] = [self]
        while waiting:
            scope = waiting.pop()
            found.append(scope)
            waiting += reversed(list(scope.nested.values()))
        return found

    def pose(self, name: str, user: str) -> pin.SE3:
        """Find where a frame stands in the world while all joints are at zero.

        Parameters
        ----------
        name
            Link, joint, frame or model; ``a::b`` for a frame b of the nested model a.
        user
            Who names it, for the message.

        Returns
        -------
        pinocchio.SE3
            Placement in the world.
        """
        chain: list[tuple[Scope, str, pin.SE3]] = []
        scope, at = self, name
        seen: set[tuple[int, str]] = set()
        while at not in scope._poses:
            if (id(scope), at) in seen:
                raise scope.reader.error(
                    f"{user}: the frames of {scope.owner} stand in each other in a circle, at '{at}'; give one of "
                    "them a pose in the frame of the model",
                    at,
                )
            seen.add((id(scope), at))
            above, relative_to, placement = scope._step(at, user)
            chain.append((scope, at, placement))
            if above is None:
                break
            scope, at = above, relative_to
        placement = scope._poses.get(at, pin.SE3.Identity())
        for scope, at, relative in reversed(chain):
            placement = placement * relative
            scope._poses[at] = placement
        return placement

    def body(self, name: str, user: str) -> str:
        """Find the link that carries a frame.

        Parameters
        ----------
        name
            Link, joint, frame or model.
        user
            Who names it, for the message.

        Returns
        -------
        str
            Full name of the link, or ``world``.
        """
        chain: list[tuple[Scope, str]] = []
        scope, at = self, name
        seen: set[tuple[int, str]] = set()
        while at not in scope._bodies:
            if (id(scope), at) in seen:
                raise scope.reader.error(
                    f"{user}: the frames of {scope.owner} are attached to each other in a circle, at '{at}'; "
                    "attach one of them to a link",
                    at,
                )
            seen.add((id(scope), at))
            chain.append((scope, at))
            found = scope._attached(at, user)
            if isinstance(found, str):
                scope._bodies[at] = found
                break
            scope, at = found
        link = scope._bodies[at]
        for passed, frame in chain:
            passed._bodies[frame] = link
        return link

    def _step(self, name: str, user: str) -> tuple[Scope | None, str, pin.SE3]:
        """Go from a frame to the one in which it is given: (None, "", its placement in the world) at the end."""
        if name == MODEL:
            return self._place_model(user)
        inside = self._inside(name)
        if inside is not None:
            return inside[0], inside[1], pin.SE3.Identity()
        if name == WORLD:
            return None, "", pin.SE3.Identity()
        element = self._find(name, user)
        owner = f"{element.tag} '{name}'"
        placement, relative_to = self.reader.pose(element, owner)
        if not relative_to:
            relative_to = {
                "frame": element.get("attached_to") or self._own_frame,
                "joint": (element.findtext("child") or "").strip(),
            }.get(str(element.tag), MODEL)
        return self, relative_to, placement

    @property
    def _own_frame(self) -> str:
        return MODEL if self.element.tag == "model" else WORLD

    def _place_model(self, user: str) -> tuple[Scope | None, str, pin.SE3]:
        reader, element = self.placing or (self.reader, self.element)
        placement, relative_to = reader.pose(element, self.owner)
        if self.placement_frame:
            inner = self._within(self.placement_frame, user)
            placement = placement * inner.inverse()
        if self.parent is None:
            if relative_to not in ("", WORLD):
                raise reader.error(
                    f"{self.owner}: <pose relative_to='{relative_to}'> (line {element.sourceline}), but only the "
                    "world is around it; give the pose in the world",
                    relative_to,
                )
            return None, "", placement
        return self.parent, relative_to or self.parent._own_frame, placement

    def _within(self, name: str, user: str) -> pin.SE3:
        """Find where a frame stands in the frame of its own model."""
        placement = pin.SE3.Identity()
        scope, at = self, name
        for _ in range(10_000):
            if scope is self and at == MODEL:
                return placement
            above, relative_to, step = scope._step(at, user)
            placement = step * placement
            if above is None:
                break
            scope, at = above, relative_to
        raise self.reader.error(
            f"{self.owner}: its placement_frame '{self.placement_frame}' stands in no frame of the model; give it a "
            "pose in the frame of the model",
            self.placement_frame,
        )

    def _attached(self, name: str, user: str) -> str | tuple[Scope, str]:
        """Go from a frame to the one that carries it, or to the link."""
        if name == MODEL:
            return self._canonical(user)
        inside = self._inside(name)
        if inside is not None:
            return inside
        if name == WORLD:
            return WORLD
        element = self._find(name, user)
        if element.tag == "link":
            return self.prefix + name
        if element.tag == "frame":
            return self, element.get("attached_to") or self._own_frame
        return self, self.reader.content(element, "child", f"joint '{name}'")

    def _canonical(self, user: str) -> tuple[Scope, str]:
        chosen = self.element.get("canonical_link")
        if chosen:
            return self, chosen
        links = [name for name, element in self.elements.items() if element.tag == "link"]
        if links:
            return self, links[0]
        if self.nested:
            return next(iter(self.nested.values())), MODEL
        raise self.reader.error(f"{user}: {self.owner} has no <link>", self.element.get("name", ""))

    def _inside(self, name: str) -> tuple[Scope, str] | None:
        """Split ``a::b`` at a nested model; a name that stands there as a whole comes first."""
        if name in self.elements:
            return None
        if name in self.nested:
            return self.nested[name], MODEL
        for head, scope in self.nested.items():
            if name.startswith(f"{head}::"):
                return scope, name.removeprefix(f"{head}::")
        return None

    def _find(self, name: str, user: str) -> etree._Element:
        if name not in self.elements:
            names = sorted({*self.elements, *self.nested})
            have = ", ".join(names[:_LISTED]) + (", ..." if len(names) > _LISTED else "")
            raise self.reader.error(
                f"{user} names the frame '{name}', which {self.owner} does not have; it has: {have or 'none'}",
                name,
            )
        return self.elements[name]


def check_names(scope: Scope) -> None:
    """Refuse two elements of one name, where frames are found by their names.

    Parameters
    ----------
    scope
        Model to check.

    Raises
    ------
    FileFormatError
        If two links, or two frames, or since version 1.7 any two elements of the model share a name.
    """
    seen: dict[str, str] = {}
    for element in scope.element.iterchildren("link", "joint", "frame", "model"):
        name, tag = element.get("name", ""), str(element.tag)
        if name in seen and (scope.version >= (1, 7) or seen[name] == tag):
            raise scope.reader.error(
                f"a <{seen[name]}> and a <{tag}> (line {element.sourceline}) of {scope.owner} are called '{name}'; "
                "rename one",
                name,
            )
        seen.setdefault(name, tag)
