"""The constants of a chain that a kernel is made of: joints, masses, loop frames and rows, motors, gravity.

Bodies are numbered as the joints that carry them in Pinocchio's model; body 0 is the ground.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.planning.spatial import Masses
from stewart_pin.model.description import JointKind
from stewart_pin.model.joint_physics import JointPhysics, read_fields
from stewart_pin.model.loop_rows import NormalRow, Row, closure_rows
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.outside import outside_places
from stewart_pin.typing import FloatArray

_KINDS = {
    JointKind.REVOLUTE: (1, 1),
    JointKind.PRISMATIC: (1, 1),
    JointKind.SPHERICAL: (4, 3),
    JointKind.FLOATING: (7, 6),
}
"""Sizes of configuration and tangent of the joints that have a graph."""


@dataclass(frozen=True, eq=False)
class TreeJoint:
    """A joint of the spanning tree and the body that it carries.

    Attributes
    ----------
    name
        Of the joint.
    kind
        Revolute, prismatic, spherical or floating.
    parent
        Number of the body that carries it, 0 for the ground.
    rotation
        (3, 3) rotation of the joint frame in the parent.
    translation
        (3,) origin of the joint frame in the parent [m].
    axis
        (3,) unit vector of a revolute or prismatic joint, in the joint frame.
    q, v
        Its entries of configuration and tangent.
    masses
        Of the body, about the joint frame.
    rotor
        Inertia of each tangent entry's own, which Pinocchio calls armature [kg or kg m²].
    damping, friction
        Viscous and dry friction of each tangent entry [N s/m or N m s/rad, N or N m].
    physics
        Its spring and constant force; the rest stands above.
    """

    name: str
    kind: JointKind
    parent: int
    rotation: FloatArray
    translation: FloatArray
    axis: FloatArray
    q: slice
    v: slice
    masses: Masses
    rotor: FloatArray
    damping: FloatArray
    friction: FloatArray
    physics: JointPhysics


@dataclass(frozen=True, eq=False)
class LoopEnds:
    """A loop: two frames on two bodies, and the rows between them.

    Attributes
    ----------
    name
        Of the loop.
    kind
        What it leaves free.
    body1, body2
        Numbers of the bodies.
    rotation1, rotation2
        (3, 3) rotations of the loop frames in their bodies.
    translation1, translation2
        (3,) origins of the loop frames in their bodies [m].
    axis
        (3,) unit vector of the free axis in frame 1, for kinds that have one.
    rows
        Equations, in the order of the chain's loop rows.
    index
        Place of each row among all loop rows.
    axis2
        (3,) unit vector of the other free axis of a universal joint, in frame 2.
    physics
        What the joint does by itself, along each of `physics_coordinates`.
    """

    name: str
    kind: JointKind
    body1: int
    body2: int
    rotation1: FloatArray
    rotation2: FloatArray
    translation1: FloatArray
    translation2: FloatArray
    axis: FloatArray
    rows: tuple[Row, ...]
    index: tuple[int, ...]
    axis2: FloatArray
    physics: tuple[JointPhysics, ...] = ()

    @property
    def holds_point(self) -> bool:
        """Whether the frames' origins coincide: the first three rows are normal and independent."""
        return len(self.rows) >= 3 and all(isinstance(row, NormalRow) for row in self.rows[:3])


@dataclass(frozen=True, eq=False)
class CouplingRow:
    """A row ``q1 - p(q2) - r q = 0`` between joints.

    Attributes
    ----------
    index
        Place among all loop rows.
    q1, v1
        Entries of joint 1 in configuration and tangent.
    q2, v2
        Entries of joint 2, or -1 where there is none.
    polynomial
        (n,) coefficients of p from the constant one on [unit of joint 1 per power of the unit of joint 2].
    others
        Entries of further joints in configuration and tangent, and their ratios [unit of joint 1 per unit of each].
    """

    index: int
    q1: int
    v1: int
    q2: int
    v2: int
    polynomial: FloatArray
    others: tuple[tuple[int, int, float], ...] = ()


@dataclass(frozen=True, eq=False)
class OutsidePoint:
    """A point of a body at which a wrench acts from outside.

    Attributes
    ----------
    body
        Number of the body.
    point
        (3,) the point in that body [m].
    entries
        Place of the wrench, [force; moment] in world axes, among all that act.
    """

    body: int
    point: FloatArray
    entries: slice


@dataclass(frozen=True, eq=False)
class Tree:
    """Constants of a chain.

    Attributes
    ----------
    joints
        Joints; entry k carries body k + 1.
    loops
        Loops.
    couplings
        Rows between pairs of joints.
    nq, nv, nc
        Sizes of configuration, tangent and loop rows.
    motors
        Tangent index of each motor.
    motors_q
        Configuration index of each motor.
    platform
        Body that carries the platform frame; the ground where there is no platform.
    platform_rotation
        (3, 3) rotation of the platform frame in that body.
    platform_translation
        (3,) its origin there [m].
    gravity
        (3,) acceleration of free fall in world axes [m/s²].
    outside
        Where wrenches act from outside, on the ground too, where they do nothing.
    """

    joints: tuple[TreeJoint, ...]
    loops: tuple[LoopEnds, ...]
    couplings: tuple[CouplingRow, ...]
    nq: int
    nv: int
    nc: int
    motors: tuple[int, ...]
    motors_q: tuple[int, ...]
    platform: int
    platform_rotation: FloatArray
    platform_translation: FloatArray
    gravity: FloatArray
    outside: tuple[OutsidePoint, ...] = ()

    def path(self, body: int) -> tuple[int, ...]:
        """List the bodies from one down to the ground.

        Parameters
        ----------
        body
            Number of a body.

        Returns
        -------
        tuple of int
            The body itself first; without the ground.
        """
        return path_down(self.joints, body)


def path_down(joints: Sequence[TreeJoint], body: int) -> tuple[int, ...]:
    """List the bodies from one down to the root of a tree.

    Parameters
    ----------
    joints
        Joints of the tree; parents are bodies, or 0 for the root.
    body
        Number of a body.

    Returns
    -------
    tuple of int
        The body itself first; without the root.
    """
    path: list[int] = []
    while body:
        path.append(body)
        body = joints[body - 1].parent
    return tuple(path)


def tree_of(chain: ClosedChain, wrenches: Sequence[str] = ()) -> Tree:
    """Read the constants of a chain.

    Parameters
    ----------
    chain
        Closed chain.
    wrenches
        Links on which wrenches act from outside, at the origins of their frames.

    Returns
    -------
    Tree
        Its constants.

    Raises
    ------
    UnsupportedError
        If a joint is of a kind that has no graph.
    InputError
        If a link is unknown.
    """
    # Without a platform the ground stands for it; functions of a platform are refused before they are written.
    frame = chain.model.frames[0 if chain.platform is None else chain.platform_id]
    fields = read_fields(chain.model)
    return Tree(
        joints=tuple(_joint(chain, k, fields) for k in range(1, chain.model.njoints)),
        loops=_loops(chain),
        couplings=_couplings(chain),
        nq=chain.nq,
        nv=chain.nv,
        nc=chain.nc,
        motors=tuple(int(k) for k in chain.motor_index),
        motors_q=tuple(int(k) for k in chain.motor_q_index),
        platform=frame.parentJoint,
        platform_rotation=np.array(frame.placement.rotation),
        platform_translation=np.array(frame.placement.translation),
        gravity=chain.gravity,
        outside=tuple(
            OutsidePoint(place.joint, np.array(place.placement.translation), slice(6 * k, 6 * k + 6))
            for k, place in enumerate(outside_places(chain, wrenches))
        ),
    )


def _joint(chain: ClosedChain, number: int, fields: dict[str, FloatArray]) -> TreeJoint:
    model = chain.model
    name, joint = model.names[number], model.joints[number]
    described = chain.mechanism.joint(name)
    if _KINDS.get(described.kind) != (joint.nq, joint.nv):
        raise UnsupportedError(
            f"joint '{name}' is {described.kind} with {joint.nq} coordinates; kernels have revolute, prismatic, "
            "spherical and floating joints"
        )
    placement, own = model.jointPlacements[number], slice(joint.idx_v, joint.idx_v + joint.nv)
    return TreeJoint(
        name=name,
        kind=described.kind,
        parent=model.parents[number],
        rotation=np.array(placement.rotation),
        translation=np.array(placement.translation),
        axis=np.array(described.axis, dtype=float),
        q=slice(joint.idx_q, joint.idx_q + joint.nq),
        v=own,
        masses=masses_of(model.inertias[number]),
        rotor=fields["armature"][own],
        damping=fields["damping"][own],
        friction=fields["friction"][own],
        physics=described.physics,
    )


def masses_of(inertia: pin.Inertia) -> Masses:
    """Turn mass, centre of mass and inertia into moments about the frame's origin.

    Parameters
    ----------
    inertia
        Pinocchio's inertia.

    Returns
    -------
    Masses
        Mass, first and second moments.
    """
    about_com, com = np.array(inertia.inertia), np.array(inertia.lever)
    second = np.trace(about_com) / 2 * np.eye(3) - about_com + inertia.mass * np.outer(com, com)
    return Masses(float(inertia.mass), inertia.mass * com, second)


def _loops(chain: ClosedChain) -> tuple[LoopEnds, ...]:
    table = chain.loop_table
    loops: list[LoopEnds] = []
    for k, loop in enumerate(chain.loops):
        rows, place = closure_rows(loop), table.slices[k]
        loops.append(
            LoopEnds(
                name=loop.name,
                kind=loop.kind,
                body1=table.joint1[k],
                body2=table.joint2[k],
                rotation1=table.rotation1[k],
                rotation2=table.rotation2[k],
                translation1=table.translation1[k],
                translation2=table.translation2[k],
                axis=np.array(loop.axis, dtype=float),
                rows=rows,
                index=tuple(range(place.start, place.stop)),
                axis2=np.array(loop.axis2, dtype=float),
                physics=loop.physics,
            )
        )
    return tuple(loops)


def _couplings(chain: ClosedChain) -> tuple[CouplingRow, ...]:
    rows = chain.loop_table.coupling
    return tuple(
        CouplingRow(
            index=int(rows.index[k]),
            q1=int(rows.q1[k]),
            v1=int(rows.v1[k]),
            q2=int(rows.q2[k]),
            v2=int(rows.v2[k]),
            polynomial=rows.polynomial[k],
            others=tuple(
                (int(q), int(v), float(rows.ratios_v[k, v]))
                for q, v in zip(
                    np.flatnonzero(rows.ratios_q[k]), np.flatnonzero(rows.ratios_v[k]), strict=True
                )
            ),
        )
        for k in range(len(rows.index))
    )
