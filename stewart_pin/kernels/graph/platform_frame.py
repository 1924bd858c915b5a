"""The platform frame of the whole tree: where it is, how joint motions move it, and its bias."""

from __future__ import annotations

import casadi as ca

from stewart_pin.kernels.graph.joint_motion import at_rest, efforts_of_wrenches, moments_of, motions
from stewart_pin.kernels.graph.whole_tree import ClosedTree
from stewart_pin.kernels.planning.spatial import constant, rotation_constant, shared


def platform_columns(closed: ClosedTree) -> ca.SX:
    """Build the transpose of the platform's Jacobian.

    Parameters
    ----------
    closed
        The chain.

    Returns
    -------
    casadi.SX
        (nv, 6): unit forces and unit moments at the platform frame's origin along world axes, as joint efforts.
    """
    tree, at = closed.tree, closed.at
    back = at.to_world[tree.platform].T
    arm = constant(tree.platform_translation)
    force = ca.horzcat(back, ca.SX(3, 3))
    moment = ca.horzcat(moments_of(arm, back), back)
    return efforts_of_wrenches(tree.joints, at, {tree.platform: (force, moment)}, 6)


def platform_bias(closed: ClosedTree, v: ca.SX) -> ca.SX:
    """Write the platform's acceleration that is there without joint acceleration.

    Parameters
    ----------
    closed
        The chain.
    v
        (nv, 1) tangent velocity.

    Returns
    -------
    casadi.SX
        (6, 1) of the platform frame's origin and axes, in world axes.
    """
    tree, at = closed.tree, closed.at
    drifting = motions(tree.joints, at, v, ca.SX.zeros(tree.nv), at_rest(ca.SX.zeros(3)))
    k, to_world = tree.platform, at.to_world[tree.platform]
    linear = drifting.acceleration[k] + drifting.turning[k] @ constant(tree.platform_translation)
    return ca.vertcat(to_world @ linear, to_world @ drifting.omega_rate[k])


def platform_placement(closed: ClosedTree) -> tuple[ca.SX, ca.SX]:
    """Write where the platform frame is.

    Parameters
    ----------
    closed
        The chain.

    Returns
    -------
    position, rotation : casadi.SX
        (3, 1) and (3, 3), in the world.
    """
    tree, at = closed.tree, closed.at
    to_world = at.to_world[tree.platform]
    position = at.in_world[tree.platform] + to_world @ constant(tree.platform_translation)
    return position, to_world @ rotation_constant(tree.platform_rotation)


def platform_pose_function(closed: ClosedTree) -> ca.Function:
    """Write the pose of the platform frame.

    Parameters
    ----------
    closed
        The chain.

    Returns
    -------
    casadi.Function
        ``q -> (position, rotation)``, (nq, 1) to (3, 1) [m] and (3, 3).
    """
    position, rotation = platform_placement(closed)
    return shared("platform_pose", {"q": closed.q}, {"position": position, "rotation": rotation})
