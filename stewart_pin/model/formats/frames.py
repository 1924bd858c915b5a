"""Frames that a file names: which link carries them, and where links stand while all joints are at zero."""

from __future__ import annotations

import pinocchio as pin

from stewart_pin.errors import FileFormatError
from stewart_pin.model.description import Joint, JointKind, Mechanism

AT_ZERO = "the file places it in one link; the other is taken to lie as it does while all joints are at zero"
"""Note on a loop that was placed by `relative_at_zero`."""


def find_frame(mechanism: Mechanism, name: str, owner: str) -> str:
    """Find the link whose frame a name stands for.

    Parameters
    ----------
    mechanism
        What has been read so far.
    name
        Name of a link, or of a joint: the frame of its child, which moves with it.
    owner
        Named in the message.

    Returns
    -------
    str
        Name of a link.

    Raises
    ------
    FileFormatError
        If no frame has that name, or if a link and a joint to another link have it.
    """
    found = {joint.child for joint in mechanism.joints if joint.name == name}
    found |= {link.name for link in mechanism.links if link.name == name}
    if len(found) != 1:
        have = ", ".join(sorted(link.name for link in mechanism.links))
        fault = (
            f"there is no link or joint '{name}'" if not found else f"a link and a joint are called '{name}'"
        )
        raise FileFormatError(f"{owner}: {fault}; the links are: {have}", path=mechanism.source, culprit=name)
    return found.pop()


def carrier(mechanism: Mechanism, link: str) -> tuple[str, pin.SE3]:
    """Find the body that carries a link which is there for its frame only.

    Parameters
    ----------
    mechanism
        What has been read so far.
    link
        Name of the link.

    Returns
    -------
    link : str
        The parent, if the link is fixed to it and carries nothing itself; else the link.
    placement : pinocchio.SE3
        Frame of the given link in the returned one.
    """
    above = [joint for joint in mechanism.joints if joint.child == link]
    carries = any(joint.parent == link for joint in mechanism.joints)
    if carries or len(above) != 1 or above[0].kind is not JointKind.FIXED:
        return link, pin.SE3.Identity()
    return above[0].parent, above[0].placement


def placement_at_zero(mechanism: Mechanism, link: str) -> pin.SE3:
    """Place a link in the root of its tree while all joints are at zero.

    Parameters
    ----------
    mechanism
        What has been read so far.
    link
        Name of the link.

    Returns
    -------
    pinocchio.SE3
        Placement of the link; where several joints lead to a link, the first counts.
    """
    placement = pin.SE3.Identity()
    for joint in upward(mechanism, link):
        placement = joint.placement * placement
    return placement


def relative_at_zero(mechanism: Mechanism, link1: str, link2: str, owner: str) -> pin.SE3:
    """Place one link in another while all joints are at zero.

    Parameters
    ----------
    mechanism
        What has been read so far.
    link1, link2
        Names of the links.
    owner
        Named in the message.

    Returns
    -------
    pinocchio.SE3
        Placement of link 2 in link 1.

    Raises
    ------
    FileFormatError
        If a link is missing.
    """
    names = {link.name for link in mechanism.links}
    for link in (link1, link2):
        if link not in names:
            raise FileFormatError(
                f"{owner} names the missing link '{link}'; the links are: {', '.join(sorted(names))}",
                path=mechanism.source,
                culprit=owner,
            )
    return placement_at_zero(mechanism, link1).actInv(placement_at_zero(mechanism, link2))


def upward(mechanism: Mechanism, link: str) -> list[Joint]:
    """List the joints between a link and the root of its tree.

    Parameters
    ----------
    mechanism
        What has been read so far.
    link
        Name of the link.

    Returns
    -------
    list of Joint
        From the link up.
    """
    above: dict[str, Joint] = {}
    for joint in mechanism.joints:
        above.setdefault(joint.child, joint)
    path: list[Joint] = []
    while link in above and above[link] not in path:
        path.append(above[link])
        link = above[link].parent
    return path
