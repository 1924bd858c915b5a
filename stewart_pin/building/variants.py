"""The same mechanism with other masses, without touching its file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin

from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.model.chain import ClosedChain
from stewart_pin.model.description import JointKind, Mechanism
from stewart_pin.model.tree import build_tree
from stewart_pin.model.validation import validate


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
    return replace(chain, mechanism=mechanism, model=build_tree(mechanism, chain.gravity))


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
    bodies = {link.name: link.inertia for link in chain.mechanism.links if link.inertia is not None}
    ground, platform = (_fixed_to(chain.mechanism, link) for link in (chain.mechanism.root, chain.platform))
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


def _fixed_to(mechanism: Mechanism, link: str) -> dict[str, pin.SE3]:
    """Find the links that fixed joints hold to a link, itself first: their placements in it."""
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
