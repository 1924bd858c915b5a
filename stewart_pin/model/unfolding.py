"""Joints of several freedoms as one-freedom joints in a row, with links without inertia between them.

Pinocchio's derivatives are wrong through its own universal and composite joints, and its wheel has no other joint of
two freedoms, so that rows of revolute and prismatic joints stand for them. Links without inertia are no bodies: the row
acts as the one joint that the file describes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.model.description import Coupling, Joint, JointKind, Link, Mechanism, Note, Outcome
from stewart_pin.model.loop_table import orthonormal_triad
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
