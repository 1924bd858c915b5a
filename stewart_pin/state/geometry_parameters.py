"""The geometry of a mechanism as numbers that can be in error: where its joints and loops are attached.

Of every joint that holds its child, the placement in the parent link may be shifted and turned; of every loop, its two
frames, and the length of a rod. A joint moves with all that hangs on it; a body keeps its inertia about the joint
that carries it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from stewart_pin.brief import Brief
from stewart_pin.model.description import JointKind
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import as_chain

_UNATTACHED = (JointKind.FIXED, JointKind.FLOATING)
"""Kinds of joints without geometry of their own: parts of a body, and joints that hold nothing."""


class Attachment(StrEnum):
    """What is displaced."""

    JOINT = "joint"
    FRAME1 = "frame 1"
    FRAME2 = "frame 2"
    ROD = "rod"


class Displacement(StrEnum):
    """How it is displaced."""

    SHIFT = "shift"
    TURN = "turn"
    LENGTH = "length"


@dataclass(frozen=True, repr=False)
class GeometryParameter(Brief):
    """A small displacement of a place where a joint or a loop is attached; print it.

    Attributes
    ----------
    owner
        Name of the joint or loop.
    attachment
        The joint, one of the frames of the loop, or its rod.
    link
        Link that carries it, in whose axes it is displaced.
    displacement
        A shift [m], a turn about the frame's own origin [rad], or more length of the rod [m].
    axis
        0, 1, 2 for the link's x, y, z; 0 for the length of a rod.
    """

    owner: str
    attachment: Attachment
    link: str
    displacement: Displacement
    axis: int

    @property
    def unit(self) -> str:
        """Unit of the displacement, ``"m"`` or ``"rad"``."""
        return "rad" if self.displacement is Displacement.TURN else "m"

    def __str__(self) -> str:
        """Say what moves, and along which axis of which link."""
        if self.attachment is Attachment.ROD:
            return f"loop '{self.owner}': length"
        joint = self.attachment is Attachment.JOINT
        who = f"joint '{self.owner}'" if joint else f"loop '{self.owner}', {self.attachment}"
        return f"{who}: {self.displacement} {'xyz'[self.axis]} in '{self.link}'"


def geometry_parameters(chain: ClosedChain) -> tuple[GeometryParameter, ...]:
    """List the displacements of joints and loops.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    tuple of GeometryParameter
        Of each joint that is neither fixed nor floating three shifts and three turns, then of each loop those of frames
        1 and 2, and the length of a rod or a cable; in the order of the description.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> print(stp.build.geometry_parameters(stp.load("four_bar"))[0])
    joint 'crank_motor': shift x in 'base'
    """
    as_chain(chain)
    places = [
        (joint.name, Attachment.JOINT, joint.parent)
        for joint in chain.mechanism.joints
        if joint.kind not in _UNATTACHED
    ]
    for loop in chain.loops:
        places += [(loop.name, Attachment.FRAME1, loop.link1), (loop.name, Attachment.FRAME2, loop.link2)]
        if loop.kind in (JointKind.DISTANCE, JointKind.CABLE):
            places.append((loop.name, Attachment.ROD, loop.link1))
    parameters: list[GeometryParameter] = []
    for owner, attachment, link in places:
        if attachment is Attachment.ROD:
            parameters.append(GeometryParameter(owner, attachment, link, Displacement.LENGTH, 0))
            continue
        for displacement in (Displacement.SHIFT, Displacement.TURN):
            parameters += [
                GeometryParameter(owner, attachment, link, displacement, axis) for axis in range(3)
            ]
    return tuple(parameters)
