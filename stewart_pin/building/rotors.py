"""Inertia of rotors, Pinocchio's armature: no description has a place for it, so it is carried over or asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stewart_pin.errors import UnsupportedError
from stewart_pin.state.chain import ClosedChain


def with_rotors_of(chain: ClosedChain, rebuilt: ClosedChain) -> ClosedChain:
    """Carry the inertia of rotors over to a chain that was rebuilt from a description.

    Parameters
    ----------
    chain
        Chain as it was.
    rebuilt
        Chain as it was rebuilt.

    Returns
    -------
    ClosedChain
        The rebuilt chain; each joint of the same name and size has its rotor.
    """
    if not np.any(chain.model.armature):
        return rebuilt
    model = rebuilt.model.copy()
    armature = np.array(model.armature)
    for name, joint in zip(model.names[1:], model.joints[1:], strict=True):
        if chain.model.existJointName(name):
            before = chain.model.joints[chain.model.getJointId(name)]
            if before.nv == joint.nv:
                own = chain.model.armature[before.idx_v : before.idx_v + before.nv]
                armature[joint.idx_v : joint.idx_v + joint.nv] = own
    model.armature = armature
    return replace(rebuilt, model=model)


def require_no_rotors(chain: ClosedChain, where: str) -> None:
    """Refuse rotors where there is no place for their inertia.

    Parameters
    ----------
    chain
        Closed chain.
    where
        What has no place for it.

    Raises
    ------
    UnsupportedError
        If a joint has a rotor.
    """
    turning = np.flatnonzero(chain.model.armature)
    if turning.size:
        name, amount = chain.tangent_names[turning[0]], chain.model.armature[turning[0]]
        raise UnsupportedError(
            f"{where} has no place for rotors, and joint '{name}' of {chain.name} has one of {amount:g} kg or kg m² "
            "(armature of the model); use a verb that takes the chain, or set the armature to zero"
        )
