"""The same mechanism with other roles: other motors, another platform."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pinocchio as pin

from stewart_pin.building.loading import build_chain
from stewart_pin.building.rotors import with_rotors_of
from stewart_pin.errors import InputError
from stewart_pin.model.description import Joint, JointKind, Link, Mechanism
from stewart_pin.state.chain import ClosedChain, as_pose
from stewart_pin.state.state import as_chain


def with_motors(chain: ClosedChain, motors: Sequence[str]) -> ClosedChain:
    """Drive a chain by other joints.

    Parameters
    ----------
    chain
        Closed chain.
    motors
        Names of joints with one freedom, in the order of motor positions and efforts; `mobility` suggests a set.

    Returns
    -------
    ClosedChain
        Same links, joints, loops, platform and home.

    Raises
    ------
    InputError
        If a name stands twice, or `motors` is no sequence of names.
    MechanismError
        If a name is not that of a joint with one freedom; lists those that are.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> chain = stp.with_motors(stp.load("five_bar"), ["left_hip", "left_knee"])
    >>> stp.mobility(chain).motors_sufficient
    True
    """
    as_chain(chain)
    rebuilt = build_chain(chain.described(), motors=motors, platform=chain.platform, gravity=chain.gravity)
    return with_rotors_of(chain, rebuilt)


def with_platform(
    chain: ClosedChain, link: str, *, placement: pin.SE3 | None = None, name: str | None = None
) -> ClosedChain:
    """Take another link, or a frame on a link, as the platform.

    Parameters
    ----------
    chain
        Closed chain.
    link
        Name of a link that moves.
    placement
        Platform frame in the link; default: the link's own frame.
    name
        Name of the frame, with `placement`; default: the link's name with ``_frame``.

    Returns
    -------
    ClosedChain
        Same joints, loops, motors and home; with `placement`, a link without inertia is fixed on `link`.

    Raises
    ------
    InputError
        If there is no such link, the name is taken, or a name is given without a placement.
    MechanismError
        If the link is the ground.

    Examples
    --------
    >>> import numpy as np, pinocchio as pin, stewart_pin as stp
    >>> tool = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.1]))
    >>> chain = stp.with_platform(stp.load("stewart"), "platform", placement=tool, name="tool")
    >>> stp.platform_pose(chain, chain.q_home).translation
    array([0. , 0. , 1.1])
    """
    as_chain(chain)
    mechanism = chain.described()
    require_link(mechanism, "link", link)
    if placement is None:
        if name is not None:
            raise InputError(
                f"name {name!r} needs a placement=: without one, the platform is link '{link}' itself"
            )
        rebuilt = build_chain(mechanism, motors=chain.motors, platform=link, gravity=chain.gravity)
        return with_rotors_of(chain, rebuilt)
    name = f"{link}_frame" if name is None else name
    mechanism = with_fixed_link(mechanism, Link(name), link, as_pose("placement", placement))
    rebuilt = build_chain(mechanism, motors=chain.motors, platform=name, gravity=chain.gravity)
    return with_rotors_of(chain, rebuilt)


def with_fixed_link(mechanism: Mechanism, link: Link, carrier: str, placement: pin.SE3) -> Mechanism:
    """Fix a new link on another.

    Parameters
    ----------
    mechanism
        Description.
    link
        The new link; the joint that fixes it gets its name, or one made of it.
    carrier
        Name of the link that carries it.
    placement
        New link in the carrier.

    Returns
    -------
    Mechanism
        Description with one more link and joint.

    Raises
    ------
    InputError
        If a link has this name already, or it is empty.
    """
    if not link.name or link.name in {part.name for part in mechanism.links}:
        said = "taken" if link.name else "empty"
        raise InputError(f"name {link.name!r} is {said} in {mechanism.name}; choose another for the new link")
    joint_name, taken = link.name, {part.name for part in mechanism.joints}
    while joint_name in taken:
        joint_name += "_fixed"
    joint = Joint(joint_name, JointKind.FIXED, carrier, link.name, placement)
    return replace(mechanism, links=(*mechanism.links, link), joints=(*mechanism.joints, joint))


def require_link(mechanism: Mechanism, argument: str, link: str) -> None:
    """Check the name of a link.

    Parameters
    ----------
    mechanism
        Description.
    argument
        Name of the argument, for the message.
    link
        Name that the caller passed.

    Raises
    ------
    InputError
        If there is no such link; lists those that there are.
    """
    links = [part.name for part in mechanism.links]
    if link not in links:
        raise InputError(
            f"{argument} {link!r} is no link of {mechanism.name}; the links are: {', '.join(links)}"
        )
