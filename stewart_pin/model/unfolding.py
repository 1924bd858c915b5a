"""Joints of several freedoms as one-freedom joints in a row, with links without inertia between them.

Pinocchio's derivatives are wrong through its own universal and composite joints, and its wheel has no other joint of
two freedoms, so that rows of revolute and prismatic joints stand for them. Links without inertia are no bodies: the row
acts as the one joint that the file describes. Links that move as one, and second parents, which become loops, are dealt
with here too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np
import pinocchio as pin

from stewart_pin.errors import MechanismError
from stewart_pin.model.description import (
    LOOP_KINDS,
    Bounds,
    Coupling,
    Joint,
    JointKind,
    Link,
    Loop,
    Mechanism,
    Note,
    Outcome,
)
from stewart_pin.model.joint_physics import NO_PHYSICS, JointPhysics
from stewart_pin.model.loop_rows import orthonormal_triad
from stewart_pin.typing import FloatArray


@dataclass(frozen=True, eq=False)
class Unfolded:
    """What stands for one joint of the file.

    Attributes
    ----------
    links
        New links without inertia, between the new joints.
    joints
        Joints in a row, from the parent on.
    couplings
        Couplings between them.
    note
        What was done, for the report.
    """

    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    couplings: tuple[Coupling, ...]
    note: Note

    def doing(self, physics: Sequence[JointPhysics]) -> Unfolded:
        """Give the joints what they do by themselves.

        Parameters
        ----------
        physics
            Of the joints in their order; those that are left over do nothing.

        Returns
        -------
        Unfolded
            The same row.
        """
        own = (*physics, *(NO_PHYSICS,) * len(self.joints))
        joints = tuple(replace(joint, physics=each) for joint, each in zip(self.joints, own, strict=False))
        return replace(self, joints=joints)


def unfold_universal(
    name: str, parent: str, child: str, placement: pin.SE3, axis: FloatArray, axis2: FloatArray
) -> Unfolded:
    """Unfold a universal joint: a turn about the first axis, fixed in the parent, then one about the second.

    Parameters
    ----------
    name
        Name of the joint; the parts are called ``name_1`` and ``name_2``.
    parent, child
        Link names.
    placement
        Joint frame in the parent link.
    axis, axis2
        (3,) unit vectors in the joint frame at zero.

    Returns
    -------
    Unfolded
        Two revolute joints about a cross.
    """
    parts = [("1", JointKind.REVOLUTE, axis), ("2", JointKind.REVOLUTE, axis2)]
    return _row(name, "universal", parent, child, placement, parts)


def unfold_cylindrical(name: str, parent: str, child: str, placement: pin.SE3, axis: FloatArray) -> Unfolded:
    """Unfold a cylindrical joint: a slide along its axis and a turn about it.

    Parameters
    ----------
    name
        Name of the joint; the parts are called ``name_slide`` and ``name_turn``.
    parent, child
        Link names.
    placement
        Joint frame in the parent link.
    axis
        (3,) unit vector in the joint frame.

    Returns
    -------
    Unfolded
        A prismatic and a revolute joint.
    """
    parts = [("slide", JointKind.PRISMATIC, axis), ("turn", JointKind.REVOLUTE, axis)]
    return _row(name, "cylindrical", parent, child, placement, parts)


def unfold_planar(name: str, parent: str, child: str, placement: pin.SE3, normal: FloatArray) -> Unfolded:
    """Unfold a planar joint: two slides in the plane and a turn about its normal.

    Parameters
    ----------
    name
        Name of the joint; the parts are called ``name_x``, ``name_y`` and ``name_turn``.
    parent, child
        Link names.
    placement
        Joint frame in the parent link.
    normal
        (3,) unit vector in the joint frame; for a coordinate axis, the slides are along the cyclically next ones.

    Returns
    -------
    Unfolded
        Two prismatic joints and a revolute one.
    """
    n, x, y = orthonormal_triad(normal)
    parts = [("x", JointKind.PRISMATIC, x), ("y", JointKind.PRISMATIC, y), ("turn", JointKind.REVOLUTE, n)]
    return _row(name, "planar", parent, child, placement, parts)


def unfold_screw(
    name: str, parent: str, child: str, placement: pin.SE3, axis: FloatArray, lead: float
) -> Unfolded:
    """Unfold a screw joint: a turn about its axis, and a slide along it that the turn drives.

    Parameters
    ----------
    name
        Name of the joint, which its turn keeps; the slide is called ``name_slide``.
    parent, child
        Link names.
    placement
        Joint frame in the parent link.
    axis
        (3,) unit vector in the joint frame.
    lead
        Travel along the axis per whole turn, positive for a right-hand thread [m].

    Returns
    -------
    Unfolded
        A revolute and a prismatic joint, coupled.
    """
    whole = _row(
        name,
        "screw",
        parent,
        child,
        placement,
        [("", JointKind.REVOLUTE, axis), ("slide", JointKind.PRISMATIC, axis)],
    )
    turn, slide = (joint.name for joint in whole.joints)
    thread = Coupling(f"{name}_thread", slide, turn, (0.0, lead / (2 * np.pi)))
    return Unfolded(whole.links, whole.joints, (thread,), whole.note)


def close_by_screw(screw: Loop, lead: float) -> tuple[Unfolded, Loop]:
    """Let a screw close a loop: it hangs on link 1, carries a link without inertia, and link 2 is held by that.

    Only so does its turn count, whole turns too: a loop has no coordinate.

    Parameters
    ----------
    screw
        The screw as the cylindrical joint that it is but for its thread.
    lead
        Travel along the axis per whole turn, positive for a right-hand thread [m].

    Returns
    -------
    row : Unfolded
        A revolute joint of the screw's name and a prismatic one, coupled; the link at their end is ``name_end``.
    loop : Loop
        Holds that link at link 2, and is called ``name_end``.
    """
    end = f"{screw.name}_end"
    row = unfold_screw(screw.name, screw.link1, end, screw.placement1, screw.axis, lead)
    loop = Loop(end, JointKind.FIXED, end, screw.link2, pin.SE3.Identity(), screw.placement2)
    turn, slide = (joint.name for joint in row.joints)
    text = (
        f"screw that closes a loop unfolded into '{turn}' and '{slide}', at whose end loop '{end}' holds "
        f"'{screw.link2}'"
    )
    note = Note(row.note.subject, text, Outcome.CHANGED)
    return Unfolded((*row.links, Link(end)), row.joints, row.couplings, note), loop


def _row(
    name: str,
    kind: str,
    parent: str,
    child: str,
    placement: pin.SE3,
    parts: list[tuple[str, JointKind, FloatArray]],
) -> Unfolded:
    between = [f"{name}_between_{k}" for k in range(1, len(parts))]
    owners, carried = [parent, *between], [*between, child]
    joints = tuple(
        Joint(
            f"{name}_{suffix}" if suffix else name,
            part,
            owners[k],
            carried[k],
            placement if k == 0 else pin.SE3.Identity(),
            axis,
        )
        for k, (suffix, part, axis) in enumerate(parts)
    )
    made = " and ".join(f"'{joint.name}'" for joint in joints)
    note = Note(f"joint '{name}'", f"{kind} joint unfolded into {made}", Outcome.CHANGED)
    return Unfolded(tuple(Link(link) for link in between), joints, (), note)


# ----------------------------------------------------------------------------------------------------
# Links that move as one: whatever fixed joints hold together
# ----------------------------------------------------------------------------------------------------


def fixed_to(mechanism: Mechanism, link: str) -> dict[str, pin.SE3]:
    """Find the links that fixed joints hold to a link.

    Parameters
    ----------
    mechanism
        Description.
    link
        Name of a link.

    Returns
    -------
    dict
        Placements of the links in it, itself first: ``{link: placement}``.
    """
    placements, frontier = {link: pin.SE3.Identity()}, [link]
    while frontier:
        name = frontier.pop()
        for joint in mechanism.joints:
            if joint.kind is not JointKind.FIXED:
                continue
            for here, there, step in (
                (joint.parent, joint.child, joint.placement),
                (joint.child, joint.parent, joint.placement.inverse()),
            ):
                if here == name and there not in placements:
                    placements[there] = placements[name] * step
                    frontier.append(there)
    return placements


# ----------------------------------------------------------------------------------------------------
# Files in which a link has two parents: the second joint is cut, and closes a loop instead
# ----------------------------------------------------------------------------------------------------


def cut_second_parents(
    joints: Sequence[Joint], *, source: str = ""
) -> tuple[tuple[Joint, ...], tuple[Loop, ...], tuple[Note, ...]]:
    """Keep one joint per child link, and turn every further one into a loop of the same kind.

    The tree grows from the links that are no joint's child. Where a link has several parents, a motor stays in the
    tree, and among equals the joint that stands first in the file.

    Parameters
    ----------
    joints
        All joints of a file, of which several may have the same child. Frames follow URDF: the child's frame is the
        joint's frame.
    source
        The file, for messages.

    Returns
    -------
    joints : tuple
        Those of the tree, in the order of the file.
    loops : tuple
        One per joint that was cut, of its name: frame 1 is the joint's frame in the parent, frame 2 the child's.
    notes : tuple
        What was cut.

    Raises
    ------
    MechanismError
        If a joint that has to be cut is a motor: the joints that could be cut in its place are motors, too.
    """
    above = _grow(joints)
    kept = {joint.name for joint in above.values()}
    tree = tuple(joint for joint in joints if joint.name in kept or joint.child not in above)
    cut = [joint for joint in joints if joint.name not in kept and joint.child in above]
    for joint in cut:
        if joint.independent:
            raise MechanismError(
                f"link '{joint.child}' has two parents, and cutting the loop at joint "
                f"'{above[joint.child].name}' is not possible, but '{joint.name}' is a motor; "
                "a motor cannot close a loop: cut the loop at a passive joint",
                path=source,
                culprit=joint.name,
            )
    notes = tuple(
        Note(
            f"joint '{joint.name}'",
            f"cut into a loop: link '{joint.child}' hangs on '{above[joint.child].parent}' already",
            Outcome.CHANGED,
        )
        for joint in cut
    )
    return tree, tuple(loop_from_joint(joint, source=source) for joint in cut), notes


def loop_from_joint(joint: Joint, *, source: str = "") -> Loop:
    """Let a joint close a loop.

    Parameters
    ----------
    joint
        Joint whose child link hangs on another joint. Its coordinate is lost, its limits are kept.
    source
        The file, for messages.

    Returns
    -------
    Loop
        Of the joint's name and kind, between parent and child.

    Raises
    ------
    MechanismError
        If a joint of this kind cannot close a loop.
    """
    if joint.kind not in LOOP_KINDS:
        raise MechanismError(
            f"joint '{joint.name}' of type '{joint.kind}' gives link '{joint.child}' a second parent and holds "
            "nothing; remove it",
            path=source,
            culprit=joint.name,
        )
    return Loop(
        joint.name,
        joint.kind,
        joint.parent,
        joint.child,
        joint.placement,
        pin.SE3.Identity(),
        axis=joint.axis if joint.has_axis else np.array([0.0, 0.0, 1.0]),
        bounds=_bounds(joint),
        physics=(joint.physics,) if joint.physics else (),
    )


def _bounds(joint: Joint) -> tuple[Bounds, ...]:
    if joint.has_axis:
        return (joint.bounds,)
    if joint.kind is JointKind.SPHERICAL:
        return Bounds(position=(-inf, joint.swing)), Bounds(position=(-inf, joint.turn))
    return ()


def _grow(joints: Sequence[Joint]) -> dict[str, Joint]:
    """Choose the joint above every link that the ground reaches."""
    children = {joint.child for joint in joints}
    # A motor and a rotor stand in the tree.
    driven = {joint.child for joint in joints if joint.independent or joint.physics.armature}
    reached = {joint.parent for joint in joints} - children
    above: dict[str, Joint] = {}
    while True:
        open_ends = [j for j in joints if j.parent in reached and j.child not in reached]
        if not open_ends:
            return above
        # A passive joint to a link that a motor moves waits until no other joint leads on.
        step = min(open_ends, key=lambda j: j.child in driven and not (j.independent or j.physics.armature))
        above[step.child] = step
        reached.add(step.child)
