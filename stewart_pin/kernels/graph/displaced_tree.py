"""The tree with symbols for small displacements of the places where joints and loops are attached.

Turns enter to the first order, ``1 + skew(turn)``: what is written with these symbols serves first derivatives at zero.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from stewart_pin.kernels.graph.bodies import joint_placement, placements
from stewart_pin.kernels.graph.loop_rows import loop_columns
from stewart_pin.kernels.graph.whole_tree import ClosedTree
from stewart_pin.kernels.planning.spatial import constant, rotation_constant, skew
from stewart_pin.kernels.planning.tree import LoopEnds, TreeJoint
from stewart_pin.model.loop_rows import LengthRow
from stewart_pin.model.tree import link_frame
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.geometry_parameters import Attachment, Displacement, geometry_parameters

Moves = dict[tuple[str, Attachment], ca.SX]
"""(6, 1) shift and rotation vector of each place, in axes of the body; (1, 1) of a rod's length."""


def displaced_tree(closed: ClosedTree) -> tuple[ClosedTree, ca.SX]:
    """Put symbols where joints and loops are attached.

    Parameters
    ----------
    closed
        The chain as it is.

    Returns
    -------
    displaced : ClosedTree
        Same configuration; tree, placements and loop rows displaced, eliminated rows and motions as they are.
    symbols : casadi.SX
        (n, 1) displacements, in the order of `stewart_pin.build.geometry_parameters`.
    """
    tree, q = closed.tree, closed.q
    moves, symbols = displacement_moves(closed.chain)
    joints = tuple(_moved_joint(joint, moves) for joint in tree.joints)
    loops = tuple(_moved_loop(loop, moves) for loop in tree.loops)
    tree = replace(tree, joints=joints, loops=loops)
    at = placements(joints, [joint_placement(joint, q[joint.q]) for joint in joints], closed=closed.at.closed)
    return replace(closed, tree=tree, at=at, columns=loop_columns(tree, at, q)), symbols


def displacement_moves(chain: ClosedChain) -> tuple[Moves, ca.SX]:
    """Make symbols for the displacements of a chain.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    moves : dict
        Of each joint, loop frame and rod by name.
    symbols : casadi.SX
        (n, 1) displacements, in the order of `stewart_pin.build.geometry_parameters`.
    """
    parameters = geometry_parameters(chain)
    symbols = ca.SX.sym("displacement", len(parameters))
    moves: Moves = {}
    for symbol, parameter in zip(ca.vertsplit(symbols), parameters, strict=True):
        place = (parameter.owner, parameter.attachment)
        if parameter.displacement is Displacement.LENGTH:
            moves[place] = symbol
            continue
        # A link that is fixed to a body has its own axes.
        frame = chain.model.frames[link_frame(chain.model, parameter.link)]
        axis = rotation_constant(np.array(frame.placement.rotation))[:, parameter.axis] * symbol
        move = moves.get(place, ca.SX.zeros(6))
        zero = ca.SX.zeros(3)
        turns = parameter.displacement is Displacement.TURN
        moves[place] = move + (ca.vertcat(zero, axis) if turns else ca.vertcat(axis, zero))
    return moves, symbols


def _moved_joint(joint: TreeJoint, moves: Moves) -> TreeJoint:
    move = moves.get((joint.name, Attachment.JOINT))
    if move is None:
        return joint
    rotation, translation = _moved(joint.rotation, joint.translation, move)
    return replace(joint, rotation=rotation, translation=translation)


def _moved_loop(loop: LoopEnds, moves: Moves) -> LoopEnds:
    rotation1, translation1 = _moved(loop.rotation1, loop.translation1, moves[loop.name, Attachment.FRAME1])
    rotation2, translation2 = _moved(loop.rotation2, loop.translation2, moves[loop.name, Attachment.FRAME2])
    longer = moves.get((loop.name, Attachment.ROD))
    rows = tuple(
        replace(row, length=row.length + longer) if isinstance(row, LengthRow) and longer is not None else row
        for row in loop.rows
    )
    return replace(
        loop,
        rotation1=rotation1,
        rotation2=rotation2,
        translation1=translation1,
        translation2=translation2,
        rows=rows,
    )


def _moved(rotation: np.ndarray, translation: np.ndarray, move: ca.SX) -> tuple[ca.SX, ca.SX]:
    turned = (ca.SX.eye(3) + skew(move[3:])) @ rotation_constant(rotation)
    return turned, constant(translation) + move[:3]
