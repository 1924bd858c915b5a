"""How far the loops are from closed."""

from __future__ import annotations

import casadi as ca

from stewart_pin.kernels.graph.joint_motion import Placements
from stewart_pin.kernels.graph.loop_rows import follower
from stewart_pin.kernels.planning.spatial import constant, rotation_constant
from stewart_pin.kernels.planning.tree import Tree
from stewart_pin.model.description import JointKind
from stewart_pin.model.loop_rows import AngleRow, LengthRow, NormalRow


def loop_gaps(tree: Tree, at: Placements, q: ca.SX) -> ca.SX:
    """Evaluate the gap of the loops.

    Parameters
    ----------
    tree
        Constants.
    at
        Placements of the bodies.
    q
        (nq, 1) configuration.

    Returns
    -------
    casadi.SX
        (nc, 1) as `stewart_pin.loop_gap` [m, rad and dimensionless].
    """
    gap = ca.SX(tree.nc, 1)
    for loop in tree.loops:
        frame1 = at.to_world[loop.body1] @ rotation_constant(loop.rotation1)
        frame2 = at.to_world[loop.body2] @ rotation_constant(loop.rotation2)
        origin1 = at.in_world[loop.body1] + at.to_world[loop.body1] @ constant(loop.translation1)
        origin2 = at.in_world[loop.body2] + at.to_world[loop.body2] @ constant(loop.translation2)
        rotation, reach = frame1.T @ frame2, frame1.T @ (origin2 - origin1)
        for index, row in zip(loop.index, loop.rows, strict=True):
            match row:
                case NormalRow():
                    gap[index] = ca.dot(constant(row.normal), reach)
                case AngleRow():
                    gap[index] = ca.dot(constant(row.u1), rotation @ constant(row.u2))
                case LengthRow():
                    gap[index] = ca.norm_2(reach) - row.length
    for row in tree.couplings:
        gap[row.index] = q[row.q1] - follower(row, q, 0)
    return gap


def opposed_axes(tree: Tree, at: Placements) -> ca.SX:
    """Find loops whose rows vanish although they are not assembled: directions that should agree are opposed.

    Parameters
    ----------
    tree
        Constants.
    at
        Placements of the bodies.

    Returns
    -------
    casadi.SX
        (1, 1) 0 for an assembled chain, 1 where the axes of a loop point against each other.
    """
    worst = ca.SX(0)
    for loop in tree.loops:
        if loop.kind is JointKind.UNIVERSAL:
            continue
        # Angle rows hold u2 of frame 2 at right angles to two axes of frame 1: along the third, which has its name.
        axes = {tuple(row.u2) for row in loop.rows if isinstance(row, AngleRow)}
        frame1 = at.to_world[loop.body1] @ rotation_constant(loop.rotation1)
        frame2 = at.to_world[loop.body2] @ rotation_constant(loop.rotation2)
        for axis in sorted(axes):
            agreement = ca.dot(frame1 @ constant(axis), frame2 @ constant(axis))
            worst = ca.fmax(worst, -agreement)
    return worst
