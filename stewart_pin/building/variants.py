"""The same mechanism with other masses, without touching its file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin

from stewart_pin.errors import InputError
from stewart_pin.model.chain import ClosedChain
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
        If a name is not that of a link with inertia.
    """
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
    """Take the mass from every body but the ground and the platform.

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
    """
    kept = {chain.mechanism.root, chain.platform}
    inertias = {
        link.name: pin.Inertia.Zero()
        for link in chain.mechanism.links
        if link.inertia is not None and link.name not in kept
    }
    if point_platform:
        body = chain.mechanism.link(chain.platform)
        mass = 0.0 if body.inertia is None else body.inertia.mass
        inertias[body.name] = pin.Inertia(mass, np.zeros(3), np.zeros((3, 3)))
    return replace_inertias(chain, inertias)
