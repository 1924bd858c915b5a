"""Files in which a link has two parents: the second joint is cut, and closes a loop instead."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import numpy as np
import pinocchio as pin

from stewart_pin.errors import MechanismError
from stewart_pin.model.description import LOOP_KINDS, Bounds, Joint, JointKind, Loop, Note, Outcome


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
    driven = {joint.child for joint in joints if joint.independent}
    reached = {joint.parent for joint in joints} - children
    above: dict[str, Joint] = {}
    while True:
        open_ends = [j for j in joints if j.parent in reached and j.child not in reached]
        if not open_ends:
            return above
        # A passive joint to a link that a motor moves waits until no other joint leads on.
        step = min(open_ends, key=lambda j: j.child in driven and not j.independent)
        above[step.child] = step
        reached.add(step.child)
