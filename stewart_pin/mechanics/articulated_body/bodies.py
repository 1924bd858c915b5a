"""Bodies and joints in the textbook's terms: parent λ, tree transform X_T, joint transform X_J, motion subspace S.

This is the one place where Pinocchio's order of coordinates meets Featherstone's order of spatial vectors: in the
columns of S. A spherical joint's rates are the angular velocity of the child in child axes, a floating joint's are
[linear; angular] in child axes, so the columns of its S are the linear axes first. The spatial vectors themselves
stand in front.

References
----------
.. [1] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer, 2008, ch. 4.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from stewart_pin.model.description import Joint, JointKind, unknown_kind
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import Configuration, FloatArray

# ----------------------------------------------------------------------------------------------------
# Spatial vectors in Featherstone's order, [angular; linear], in body coordinates
#
# References
# ----------
# .. [1] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer, 2008, ch. 2.
# ----------------------------------------------------------------------------------------------------


def skew(vector: FloatArray) -> FloatArray:
    """Build the matrix of the cross product with one vector; several times faster than `numpy.cross` on so few numbers.

    Parameters
    ----------
    vector
        (3,) vector [any unit].

    Returns
    -------
    numpy.ndarray
        (3, 3) such that ``skew(a) @ b == a × b`` [any unit].
    """
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def motion_transform(rotation: FloatArray, origin: FloatArray) -> FloatArray:
    """Build the coordinate transform of motion vectors from frame A to frame B.

    Its transpose takes force vectors from B to A.

    Parameters
    ----------
    rotation
        (3, 3) axes of B in A; the transpose of E in [1]_, table 2.2.
    origin
        (3,) origin of B in A [m].

    Returns
    -------
    numpy.ndarray
        (6, 6) matrix ᴮX_A = [[E, 0], [-E r×, E]] [1 and m].
    """
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = matrix[3:, 3:] = rotation.T
    matrix[3:, :3] = -rotation.T @ skew(origin)
    return matrix


def cross_motion(velocity: FloatArray) -> FloatArray:
    """Build the spatial cross product of motion vectors.

    Parameters
    ----------
    velocity
        (6,) spatial velocity [rad/s, m/s].

    Returns
    -------
    numpy.ndarray
        (6, 6) matrix v× = [[ω×, 0], [v×, ω×]], eq. (2.31) of [1]_ [1/s, m/s]. That of force vectors, v×*, is minus its
        transpose, eq. (2.32).
    """
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = matrix[3:, 3:] = skew(velocity[:3])
    matrix[3:, :3] = skew(velocity[3:])
    return matrix


def spatial_inertia(inertia: pin.Inertia | None) -> FloatArray:
    """Express the inertia of a body in its link frame.

    Parameters
    ----------
    inertia
        Mass [kg], centre of mass [m] and inertia about it [kg m²]; None: no body.

    Returns
    -------
    numpy.ndarray
        (6, 6) matrix of eq. (2.63) of [1]_ [kg m², kg m, kg].
    """
    if inertia is None:
        return np.zeros((6, 6))
    mass, c = inertia.mass, skew(inertia.lever)
    return np.block([[inertia.inertia - mass * c @ c, mass * c], [-mass * c, mass * np.eye(3)]])


# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Body:
    """A link and the joint it hangs on.

    Attributes
    ----------
    link
        Name of the link.
    joint
        Joint to the parent; None for the base.
    parent
        Number λ(i) of the parent; the base is its own.
    subspace
        (6, n) motion subspace S: child twists per joint rate, in child coordinates [1].
    inertia
        (6, 6) spatial inertia in link coordinates [kg m², kg m, kg].
    q_index, v_index
        Entries of the joint in configuration and tangent.
    """

    link: str
    joint: Joint | None
    parent: int
    subspace: FloatArray
    inertia: FloatArray
    q_index: slice
    v_index: slice

    def transform(self, q: Configuration) -> FloatArray:
        """Build the transform from parent to child coordinates, X_J X_T.

        Parameters
        ----------
        q
            (nq,) configuration of the whole chain [m, rad, unit quaternions].

        Returns
        -------
        numpy.ndarray
            (6, 6) matrix ⁱX_λ(i) of motion vectors [1 and m].
        """
        if self.joint is None:
            return np.eye(6)
        turn, shift = joint_motion(self.joint, q[self.q_index])
        placement = self.joint.placement
        origin = placement.translation + placement.rotation @ shift
        return motion_transform(placement.rotation @ turn, origin)


@lru_cache(maxsize=8)
def tree_bodies(chain: ClosedChain) -> tuple[Body, ...]:
    """List the links of a chain so that every parent comes before its children; the base is number 0.

    Chains do not change, so the answers for the last few are kept.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    tuple of Body
        One per link, massless ones too; a fixed joint is one without freedom.
    """
    mechanism, model = chain.mechanism, chain.model
    inertias = {link.name: spatial_inertia(link.inertia) for link in mechanism.links}
    children: dict[str, list[Joint]] = {link.name: [] for link in mechanism.links}
    for joint in mechanism.joints:
        children[joint.parent].append(joint)
    root, none = mechanism.root, slice(0, 0)
    bodies = [Body(root, None, 0, np.zeros((6, 0)), inertias[root], none, none)]
    number = 0
    while number < len(bodies):
        for joint in children[bodies[number].link]:
            q_index = v_index = none
            if joint.kind is not JointKind.FIXED:
                entry = model.joints[model.getJointId(joint.name)]
                q_index = slice(entry.idx_q, entry.idx_q + entry.nq)
                v_index = slice(entry.idx_v, entry.idx_v + entry.nv)
            subspace = motion_subspace(joint)
            bodies.append(Body(joint.child, joint, number, subspace, inertias[joint.child], q_index, v_index))
        number += 1
    return tuple(bodies)


def motion_subspace(joint: Joint) -> FloatArray:
    """Build S, the twists that a joint allows, one column per rate in Pinocchio's order ([1]_, table 4.1).

    Parameters
    ----------
    joint
        Joint of the tree.

    Returns
    -------
    numpy.ndarray
        (6, n) in child coordinates, [angular; linear] [1]; constant there, so that its apparent derivative vanishes.
    """
    none, one = np.zeros((3, 3)), np.eye(3)
    match joint.kind:
        case JointKind.REVOLUTE:
            return np.concatenate([joint.axis, np.zeros(3)])[:, None]
        case JointKind.PRISMATIC:
            return np.concatenate([np.zeros(3), joint.axis])[:, None]
        case JointKind.SPHERICAL:
            return np.vstack([one, none])
        case JointKind.FLOATING:
            return np.block([[none, one], [one, none]])
        case JointKind.FIXED:
            return np.zeros((6, 0))
    raise unknown_kind(f"joint '{joint.name}'", joint.kind, "the articulated-body algorithm")


def joint_motion(joint: Joint, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Place the child in the joint frame.

    Parameters
    ----------
    joint
        Joint of the tree.
    values
        Joint coordinates in Pinocchio's convention [m, rad, quaternion x y z w].

    Returns
    -------
    rotation : numpy.ndarray
        (3, 3) child axes in the joint frame.
    shift : numpy.ndarray
        (3,) child origin in the joint frame [m].
    """
    match joint.kind:
        case JointKind.REVOLUTE:
            axis = skew(joint.axis)
            # Rodrigues' formula: 1 + sin q a× + (1 - cos q) (a×)².
            return np.eye(3) + np.sin(values[0]) * axis + (1.0 - np.cos(values[0])) * axis @ axis, np.zeros(3)
        case JointKind.PRISMATIC:
            return np.eye(3), joint.axis * values[0]
        case JointKind.SPHERICAL:
            return Rotation.from_quat(values).as_matrix(), np.zeros(3)
        case JointKind.FLOATING:
            return Rotation.from_quat(values[3:]).as_matrix(), values[:3]
        case JointKind.FIXED:
            return np.eye(3), np.zeros(3)
    raise unknown_kind(f"joint '{joint.name}'", joint.kind, "the articulated-body algorithm")
