"""The same mechanism with other masses, without touching its file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin

from stewart_pin.building.loading import build_chain, require_link, with_fixed_link
from stewart_pin.building.rotors import with_rotors_of
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.model.description import Joint, JointKind, Link
from stewart_pin.model.tree import build_tree
from stewart_pin.model.unfolding import fixed_to
from stewart_pin.model.validation import is_massless, validate
from stewart_pin.state.chain import ClosedChain, as_pose
from stewart_pin.state.state import as_chain
from stewart_pin.typing import ArrayLike


def replace_inertias(chain: ClosedChain, inertias: Mapping[str, pin.Inertia]) -> ClosedChain:
    """Give bodies other inertias.

    Parameters
    ----------
    chain
        Closed chain.
    inertias
        New inertia of each named body in its link frame [kg, m, kg m²].

    Returns
    -------
    ClosedChain
        Same links, joints, loops, motors and home.

    Raises
    ------
    InputError
        If a name is not that of a link with inertia, or a value is no inertia.
    MechanismError
        If an inertia is unphysical.
    """
    as_chain(chain)
    if not isinstance(inertias, Mapping):
        raise InputError(f"inertias must give an inertia to each name, got {type(inertias).__name__}")
    for name, inertia in inertias.items():
        if not isinstance(inertia, pin.Inertia):
            raise InputError(f"inertias['{name}'] must be a pinocchio.Inertia, got {type(inertia).__name__}")
    bodies = [link.name for link in chain.mechanism.links if link.inertia is not None]
    unknown = set(inertias) - set(bodies)
    if unknown:
        raise InputError(f"'{min(unknown)}' is no body; the bodies are: {', '.join(bodies)}")
    links = tuple(
        replace(link, inertia=inertias.get(link.name, link.inertia)) for link in chain.mechanism.links
    )
    mechanism = replace(chain.mechanism, links=links)
    validate(mechanism)
    rebuilt = replace(chain, mechanism=mechanism, model=build_tree(mechanism, chain.gravity))
    return with_rotors_of(chain, rebuilt)


def attach_payload(
    chain: ClosedChain,
    inertia: pin.Inertia,
    *,
    link: str | None = None,
    placement: pin.SE3 | None = None,
    name: str = "payload",
) -> ClosedChain:
    """Bolt a rigid body to a link.

    Parameters
    ----------
    chain
        Closed chain.
    inertia
        Mass, centre of mass and inertia about it in the payload's own frame [kg, m, kg m²].
    link
        Name of the link that carries it; default: the platform.
    placement
        Payload frame in that link; default: the link's frame.
    name
        Name of the new link.

    Returns
    -------
    ClosedChain
        Same joints, loops, motors, platform and home, and a link that is fixed to the carrier.

    Raises
    ------
    InputError
        If there is no such link, the name is taken, or the inertia is none.
    MechanismError
        If the inertia is unphysical.

    Examples
    --------
    >>> import numpy as np, pinocchio as pin, stewart_pin as stp
    >>> box = pin.Inertia(12.0, np.array([0.0, 0.0, 0.1]), 0.1 * np.eye(3))
    >>> chain = stp.attach_payload(stp.load("stewart"), box)
    >>> effort = stp.inverse_dynamics(chain, chain.q_home, np.zeros(chain.nv), np.zeros(chain.nv))
    """
    as_chain(chain)
    if not isinstance(inertia, pin.Inertia):
        raise InputError(f"inertia must be a pinocchio.Inertia, got {type(inertia).__name__}")
    mechanism, carrier = chain.described(), chain.platform_link if link is None else link
    require_link(mechanism, "link", carrier)
    placement = pin.SE3.Identity() if placement is None else as_pose("placement", placement)
    mechanism = with_fixed_link(mechanism, Link(name, inertia), carrier, placement)
    rebuilt = build_chain(mechanism, motors=chain.motors, platform=chain.platform, gravity=chain.gravity)
    return with_rotors_of(chain, rebuilt)


def massless_legs(chain: ClosedChain, *, point_platform: bool = False) -> ClosedChain:
    """Take the mass from every body but the ground, the platform and what is fixed to them.

    Parameters
    ----------
    chain
        Closed chain.
    point_platform
        Whether the platform's mass is gathered at the origin of the platform frame, without rotational inertia.

    Returns
    -------
    ClosedChain
        The mechanism of the simplified formula: all force comes from the platform.

    Raises
    ------
    UnsupportedError
        If the platform's mass is to be gathered, but no link that is fixed to the platform has an inertia.
    """
    as_chain(chain)
    bodies = {link.name: link.inertia for link in chain.mechanism.links if link.inertia is not None}
    ground, platform = (
        fixed_to(chain.mechanism, link) for link in (chain.mechanism.root, chain.platform_link)
    )
    inertias = {name: pin.Inertia.Zero() for name in bodies if name not in {*ground, *platform}}
    if point_platform:
        carriers = [name for name in platform if name in bodies]
        if not carriers:
            raise UnsupportedError(
                f"platform '{chain.platform}' has no <inertial>: there is no mass to gather"
            )
        mass = sum(bodies[name].mass for name in carriers)
        inertias |= {name: pin.Inertia.Zero() for name in carriers}
        origin = platform[carriers[0]].inverse().translation
        inertias[carriers[0]] = pin.Inertia(mass, origin, np.zeros((3, 3)))
    return replace_inertias(chain, inertias)


# ----------------------------------------------------------------------------------------------------
# The same mechanism with its ground set free: a robot on a ship, a satellite, a falling one
# ----------------------------------------------------------------------------------------------------

FLOATING_JOINT = "floating_base"
"""Name of the joint that `on_floating_base` adds."""


def on_floating_base(
    chain: ClosedChain,
    base_inertia: pin.Inertia | None = None,
    *,
    pose: pin.SE3 | None = None,
    gravity: ArrayLike | None = None,
) -> ClosedChain:
    """Hang the ground link of a chain on a joint with six freedoms and no motor.

    The new joint comes first: its seven coordinates (x y z, quaternion x y z w) and six rates ([v; ω] in base axes)
    stand before those of the chain. Inverse dynamics has no answer any more, because nothing holds the base; forward
    dynamics has.

    Parameters
    ----------
    chain
        Chain on the ground.
    base_inertia
        Inertia of the base in its link frame [kg, m, kg m²]; default: that of the ground link.
    pose
        Home placement of the base in the world; default: where the ground is.
    gravity
        (3,) acceleration of free fall in the world frame [m/s²]; default: that of the chain.

    Returns
    -------
    ClosedChain
        Same links, loops, motors, platform and home, on a free base.

    Raises
    ------
    InputError
        If the base has no mass, or a name that is needed is taken.

    Examples
    --------
    >>> import pinocchio as pin, numpy as np, stewart_pin as stp
    >>> bus = pin.Inertia(200.0, np.zeros(3), 20.0 * np.eye(3))
    >>> satellite = stp.on_floating_base(stp.load("arm_7r"), bus, gravity=(0, 0, 0))
    >>> satellite.nq, satellite.nv, satellite.nu
    (14, 13, 7)
    """
    as_chain(chain)
    mechanism = chain.described()
    root = mechanism.link(mechanism.root)
    inertia = root.inertia if base_inertia is None else base_inertia
    if inertia is not None and not isinstance(inertia, pin.Inertia):
        raise InputError(f"base_inertia must be a pinocchio.Inertia, got {type(inertia).__name__}")
    if inertia is None or is_massless(inertia):
        raise InputError(
            f"base_inertia is needed: the ground link '{root.name}' has no mass, and a free base must have some"
        )
    names = {link.name for link in mechanism.links} | {joint.name for joint in mechanism.joints}
    world = "world" if "world" not in names else "inertial"
    taken = {world, FLOATING_JOINT} & names
    if taken:
        raise InputError(f"the name '{min(taken)}' is taken in {mechanism.name}; rename that link or joint")
    pose = pin.SE3.Identity() if pose is None else as_pose("pose", pose)
    links = [replace(link, inertia=inertia) if link is root else link for link in mechanism.links]
    base = Joint(FLOATING_JOINT, JointKind.FLOATING, world, root.name, pin.SE3.Identity())
    floating = replace(
        mechanism,
        name=f"{mechanism.name}_floating",
        links=(Link(world), *links),
        joints=(base, *mechanism.joints),
        home={FLOATING_JOINT: np.array(pin.SE3ToXYZQUAT(pose)), **mechanism.home},
    )
    rebuilt = build_chain(
        floating,
        motors=chain.motors,
        platform=chain.platform,
        gravity=chain.gravity if gravity is None else gravity,
    )
    return with_rotors_of(chain, rebuilt)
