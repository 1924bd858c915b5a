"""Which bodies MuJoCo needs: links with mass, and several joints in one body where links without mass stood between.

MuJoCo accepts no moving body without mass, but any number of joints (up to six freedoms) in one body, applied in
order. A link without mass that only passes a motion on therefore vanishes: its joints move into the next body, their
frames expressed in that body's frame at zero joint values. This is exact. Placements as MuJoCo has them
stand below.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from lxml import etree

from stewart_pin.errors import UnsupportedError
from stewart_pin.model.description import Joint, JointKind, Link, Mechanism
from stewart_pin.model.formats.xml import number_text
from stewart_pin.model.validation import is_massless
from stewart_pin.typing import FloatArray

_LEAST = 1e-15
"""MuJoCo's mjMINVAL: least mass [kg] and principal moment [kg m²] of a moving body."""
_ROTATIONS = (JointKind.REVOLUTE, JointKind.SPHERICAL)
_FREEDOMS = {JointKind.FIXED: 0, JointKind.REVOLUTE: 1, JointKind.PRISMATIC: 1, JointKind.SPHERICAL: 3}


@dataclass(frozen=True, eq=False)
class Body:
    """A body of MuJoCo's tree.

    Attributes
    ----------
    link
        Link whose frame and name the body has.
    parent
        Name of the parent body; None: the world.
    placement
        Body frame in the parent body at zero joint values.
    joints
        Moving joints between the two, in the order in which they act, each with its frame in this body at zero
        joint values.
    """

    link: Link
    parent: str | None
    placement: pin.SE3
    joints: tuple[tuple[Joint, pin.SE3], ...] = ()


def plan_bodies(mechanism: Mechanism) -> tuple[Body, ...]:
    """Turn links into bodies.

    Parameters
    ----------
    mechanism
        Valid description.

    Returns
    -------
    tuple of Body
        Every parent before its children; the ground first, floating bodies children of the world.

    Raises
    ------
    UnsupportedError
        If a link can neither be a body nor vanish; names it and the remedy.
    """
    return _Planner(mechanism).run()


class _Planner:
    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.links = {link.name: link for link in mechanism.links}
        self.below: dict[str, list[Joint]] = {name: [] for name in self.links}
        for joint in sorted(mechanism.joints, key=lambda joint: joint.name):
            self.below[joint.parent].append(joint)
        self.used = {mechanism.platform: "it is the platform"}
        for loop in mechanism.loops:
            for link in (loop.link1, loop.link2):
                self.used.setdefault(link, f"loop '{loop.name}' ends on it")

    def run(self) -> tuple[Body, ...]:
        ground = self.mechanism.root
        bodies = [Body(self.links[ground], None, pin.SE3.Identity())]
        # Depth-first, children in the order of the Pinocchio model. The placement is that of the joint's parent
        # link in the world, where no joint moves it.
        stack: list[tuple[Joint, pin.SE3 | None]]
        stack = [(joint, pin.SE3.Identity()) for joint in reversed(self.below[ground])]
        while stack:
            joint, at_rest = stack.pop()
            body = self._floating(joint, at_rest) if joint.kind is JointKind.FLOATING else self._body(joint)
            bodies.append(body)
            fixed = joint.kind is JointKind.FIXED and at_rest is not None
            placement = at_rest * joint.placement if fixed else None
            stack += [(below, placement) for below in reversed(self.below[body.link.name])]
        return tuple(bodies)

    def _floating(self, joint: Joint, at_rest: pin.SE3 | None) -> Body:
        if at_rest is None:
            raise UnsupportedError(
                f"floating joint '{joint.name}' hangs on the moving link '{joint.parent}'; MuJoCo's free bodies are "
                "children of the world: attach it to the ground"
            )
        self._require_mass(joint.child)
        placement = at_rest * joint.placement
        # A free joint has no place: MuJoCo's coordinates of it are the pose of the body in the world.
        return Body(self.links[joint.child], None, placement, ((joint, pin.SE3.Identity()),))

    def _body(self, first: Joint) -> Body:
        joints = [first]
        if first.kind is not JointKind.FIXED:
            while self._vanishes(joints[-1].child):
                joints.append(self.below[joints[-1].child][0])
            self._require_mass(joints[-1].child)
            self._require_order(joints)
        placed: list[tuple[Joint, pin.SE3]] = []
        ahead = pin.SE3.Identity()
        for joint in reversed(joints):
            if joint.kind is not JointKind.FIXED:
                placed.append((joint, ahead.inverse()))
            ahead = joint.placement * ahead
        return Body(self.links[joints[-1].child], first.parent, ahead, tuple(reversed(placed)))

    def _vanishes(self, link: str) -> bool:
        """Tell whether a moving link only passes a motion on."""
        below = self.below[link]
        passes = len(below) == 1 and below[0].kind is not JointKind.FLOATING
        return (
            passes
            and link not in self.used
            and is_massless(self.links[link].inertia)
            and not self._held(link)
        )

    def _held(self, link: str) -> bool:
        """Tell whether a link, or one fixed to it, has the mass and moments that MuJoCo demands."""
        inertia = self.links[link].inertia
        if inertia is not None and inertia.mass >= _LEAST and least_moment(inertia) >= _LEAST:
            return True
        return any(self._held(joint.child) for joint in self.below[link] if joint.kind is JointKind.FIXED)

    def _require_mass(self, link: str) -> None:
        if self._held(link):
            return
        inertia, below = self.links[link].inertia, self.below[link]
        remedy = "give it a mass and a rotational inertia"
        if inertia is not None and inertia.mass >= _LEAST:
            raise UnsupportedError(
                f"link '{link}' has the principal moment {least_moment(inertia):.3g} kg m²; MuJoCo refuses moving "
                f"bodies with a moment below {_LEAST:g} kg m²: {remedy}"
            )
        why = self.used.get(link) or (
            f"{len(below)} joints leave it ({', '.join(joint.name for joint in below)})"
            if below
            else "no joint leaves it"
        )
        raise UnsupportedError(
            f"link '{link}' has no mass, and MuJoCo refuses moving bodies without mass; it cannot vanish into its "
            f"neighbours either, because {why}: {remedy}"
        )

    def _require_order(self, joints: list[Joint]) -> None:
        moving = [joint for joint in joints if joint.kind is not JointKind.FIXED]
        names = ", ".join(joint.name for joint in moving)
        between = joints[0].child
        if sum(_FREEDOMS[joint.kind] for joint in moving) > 6:
            raise UnsupportedError(
                f"link '{between}' has no mass, so the joints {names} fall into one body, and MuJoCo allows six "
                "freedoms in one: give it a mass and a rotational inertia"
            )
        for k, joint in enumerate(moving):
            if joint.kind is JointKind.SPHERICAL and any(
                after.kind in _ROTATIONS for after in moving[k + 1 :]
            ):
                raise UnsupportedError(
                    f"link '{joint.child}' has no mass, so the joints {names} fall into one body, and MuJoCo allows "
                    f"no rotation after the ball '{joint.name}' in one: give it a mass and a rotational inertia"
                )


def least_moment(inertia: pin.Inertia) -> float:
    """Return the least principal moment of inertia.

    Parameters
    ----------
    inertia
        Inertia of a link.

    Returns
    -------
    float
        About the centre of mass [kg m²].
    """
    return float(np.linalg.eigvalsh(inertia.inertia)[0])


# ----------------------------------------------------------------------------------------------------
# Placements as MuJoCo has them: a position, and a quaternion w x y z
# ----------------------------------------------------------------------------------------------------


def placement_of(position: FloatArray, quaternion: FloatArray) -> pin.SE3:
    """Build a placement from MuJoCo's numbers.

    Parameters
    ----------
    position
        (3,) origin [m].
    quaternion
        (4,) w x y z, unit quaternion.

    Returns
    -------
    pinocchio.SE3
        The placement.
    """
    w, x, y, z = (float(value) for value in quaternion)
    rotation = pin.Quaternion(w, x, y, z).normalized().toRotationMatrix()
    return pin.SE3(rotation, np.array(position, dtype=float))


def place(element: etree._Element, placement: pin.SE3) -> None:
    """Write a placement as ``pos`` and ``quat``, unless it is the identity.

    Parameters
    ----------
    element
        Body, site or geom.
    placement
        The placement.
    """
    if placement.translation.any():
        element.set("pos", number_text(placement.translation))
    if not np.array_equal(placement.rotation, np.eye(3)):
        element.set("quat", quaternion_text(placement.rotation))


def quaternion_text(rotation: FloatArray) -> str:
    """Print a rotation as MuJoCo's quaternion.

    Parameters
    ----------
    rotation
        (3, 3) rotation matrix.

    Returns
    -------
    str
        w x y z.
    """
    x, y, z, w = pin.Quaternion(rotation).coeffs()
    return number_text([w, x, y, z])
