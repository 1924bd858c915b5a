"""Links that move as one: whatever fixed joints hold together."""

from __future__ import annotations

import pinocchio as pin

from stewart_pin.model.description import JointKind, Mechanism


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
