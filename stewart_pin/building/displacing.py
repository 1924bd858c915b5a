"""The same mechanism with joints and loops attached elsewhere, as tolerances and calibration have it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin

from stewart_pin.building.rotors import with_rotors_of
from stewart_pin.errors import InputError
from stewart_pin.model.description import Mechanism
from stewart_pin.model.tree import build_tree
from stewart_pin.model.validation import validate
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.geometry_parameters import (
    Attachment,
    Displacement,
    GeometryParameter,
    geometry_parameters,
)
from stewart_pin.state.newton import close_loops
from stewart_pin.typing import FloatArray

_Moves = dict[tuple[str, Attachment], FloatArray]
"""(6,) shift and rotation vector of each place that moves."""


def displace_geometry(chain: ClosedChain, displacements: Mapping[GeometryParameter, float]) -> ClosedChain:
    """Attach joints and loops elsewhere.

    Parameters
    ----------
    chain
        Closed chain.
    displacements
        How far each of `geometry_parameters` is displaced [m or rad]; what is not named stays. The turns of a frame
        form one rotation vector.

    Returns
    -------
    ClosedChain
        Same links, masses, motors and platform; its home is the old one with the loops closed again.

    Raises
    ------
    InputError
        If a parameter is not one of the chain's, or a displacement is not finite.
    MechanismError
        If what results is no mechanism, as with a rod of negative length.
    ClosureError
        If the loops do not close any more, as where a planar mechanism is bent out of its plane.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> first = stp.build.geometry_parameters(chain)[0]
    >>> moved = stp.build.displace_geometry(chain, {first: 1e-3})
    """
    known = set(geometry_parameters(chain))
    moves: _Moves = {}
    for parameter, amount in displacements.items():
        if parameter not in known:
            raise InputError(
                f"{parameter} is no parameter of {chain.name}; stewart_pin.build.geometry_parameters lists them"
            )
        if not np.isfinite(amount):
            raise InputError(f"the displacement of {parameter} must be finite, got {amount}")
        place = moves.setdefault((parameter.owner, parameter.attachment), np.zeros(6))
        place[parameter.axis + (3 if parameter.displacement is Displacement.TURN else 0)] = amount
    mechanism = _moved(chain.mechanism, moves)
    validate(mechanism)
    moved = replace(chain, mechanism=mechanism, model=build_tree(mechanism, chain.gravity))
    moved = with_rotors_of(chain, moved)
    return replace(moved, q_home=close_loops(moved, chain.q_home).q)


def _moved(mechanism: Mechanism, moves: _Moves) -> Mechanism:
    def placed(placement: pin.SE3, owner: str, attachment: Attachment) -> pin.SE3:
        move = moves.get((owner, attachment))
        if move is None:
            return placement
        return pin.SE3(pin.exp3(move[3:]) @ placement.rotation, placement.translation + move[:3])

    joints = tuple(
        replace(joint, placement=placed(joint.placement, joint.name, Attachment.JOINT))
        for joint in mechanism.joints
    )
    loops = tuple(
        replace(
            loop,
            placement1=placed(loop.placement1, loop.name, Attachment.FRAME1),
            placement2=placed(loop.placement2, loop.name, Attachment.FRAME2),
            length=loop.length + float(moves.get((loop.name, Attachment.ROD), np.zeros(1))[0]),
        )
        for loop in mechanism.loops
    )
    return replace(mechanism, joints=joints, loops=loops)
