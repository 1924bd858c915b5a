"""Which joints of a description are motors, in which order; which could be, and which link could be the platform."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stewart_pin.errors import MechanismError
from stewart_pin.model.description import Joint, JointKind, Mechanism


def mark_motors(mechanism: Mechanism, names: Sequence[str]) -> Mechanism:
    """Mark joints as the motors, in an order.

    Parameters
    ----------
    mechanism
        Description; which motors it had does not matter.
    names
        Existing joints, in the order of motor coordinates and efforts.

    Returns
    -------
    Mechanism
        The same machine; the motors stand in their order, each where the description had one of them.

    Raises
    ------
    MechanismError
        If several joints have the name of one.
    """
    every = [joint.name for joint in mechanism.joints]
    for name in names:
        if every.count(name) > 1:
            raise MechanismError(
                f"{every.count(name)} joints are called '{name}'; rename all but one",
                path=mechanism.source,
                culprit=name,
            )
    in_order = iter([mechanism.joint(name) for name in names])
    motors = set(names)
    joints = tuple(
        replace(next(in_order), independent=True)
        if joint.name in motors
        else replace(joint, independent=False)
        for joint in mechanism.joints
    )
    return replace(mechanism, joints=joints)


# ----------------------------------------------------------------------------------------------------
# Which link could be the platform, and which joints the motors, of a mechanism that names none: best guess first
# ----------------------------------------------------------------------------------------------------

_WORDS = ("platform", "end_effector", "endeffector", "tool", "tcp", "flange", "gripper", "hand", "tip", "top")
"""What platforms are called."""


def platform_candidates(mechanism: Mechanism) -> tuple[str, ...]:
    """List the moving links, those first that are called so, that loops lead to, and that carry no others.

    Parameters
    ----------
    mechanism
        Description.

    Returns
    -------
    tuple of str
        All links but the ground, best guess first.
    """
    moving = _moving(mechanism)
    body = _bodies(mechanism)
    closing = Counter(body[end] for loop in mechanism.loops for end in {loop.link1, loop.link2})
    carried = Counter(body[joint.parent] for joint in mechanism.joints if joint.kind is not JointKind.FIXED)
    depth = _depths(mechanism)
    massive = {link.name for link in mechanism.links if link.inertia is not None}

    def rank(link: str) -> tuple[float, ...]:
        name = link.lower()
        called = next((k for k, word in enumerate(_WORDS) if word in name), len(_WORDS))
        own = body[link]
        # A frame without mass, as a loop's end may be, names the body less well than the body's own link.
        return called, -closing[own], carried[own], -depth[link], link not in massive

    return tuple(sorted(moving, key=rank))


def motor_candidates(mechanism: Mechanism) -> tuple[str, ...]:
    """List the joints of one freedom, those first that the file hints at, that have limits, and that are on the ground.

    Parameters
    ----------
    mechanism
        Description.

    Returns
    -------
    tuple of str
        Joints that a motor could drive, best guess first; those that follow another joint come last.
    """
    follow = {coupling.joint1 for coupling in mechanism.couplings}
    depth = _depths(mechanism)
    hinted = {name: k for k, name in enumerate(mechanism.motor_hints)}

    def rank(joint: Joint) -> tuple[float, ...]:
        stated = bool(np.isfinite(joint.bounds.effort).any())
        hint = hinted.get(joint.name, len(hinted))
        return hint, joint.name in follow, not stated, depth[joint.parent]

    return tuple(joint.name for joint in sorted(mechanism.joints, key=rank) if joint.has_axis)


def _moving(mechanism: Mechanism) -> list[str]:
    """Links that are not fixed to the ground."""
    body, root = _bodies(mechanism), mechanism.root
    return [link.name for link in mechanism.links if body[link.name] != root]


def _bodies(mechanism: Mechanism) -> dict[str, str]:
    """First link of the body of every link: fixed joints are no joints."""
    above = {joint.child: joint for joint in mechanism.joints}
    found: dict[str, str] = {}
    for link in mechanism.links:
        at = link.name
        while at in above and above[at].kind is JointKind.FIXED:
            at = above[at].parent
        found[link.name] = at
    return found


def _depths(mechanism: Mechanism) -> dict[str, int]:
    """Joints that move between the ground and every link."""
    above = {joint.child: joint for joint in mechanism.joints}
    found: dict[str, int] = {}
    for link in mechanism.links:
        at, depth = link.name, 0
        while at in above:
            depth += above[at].kind is not JointKind.FIXED
            at = above[at].parent
        found[link.name] = depth
    return found
