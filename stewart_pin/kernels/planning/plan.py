"""How a chain is taken apart for kernels in platform coordinates: the platform, and the legs between it and ground.

The platform's motion is given. Without the platform, the mechanism falls into legs: trees that hang on the ground, or
on the platform, and are closed onto the other one. Each leg is solved by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.planning.joint_physics import first_effect
from stewart_pin.kernels.planning.samples import pivot_samples
from stewart_pin.kernels.planning.spatial import Masses
from stewart_pin.kernels.planning.tree import LoopEnds, OutsidePoint, Tree, TreeJoint, tree_of
from stewart_pin.mechanics.kinematics import platform_pose
from stewart_pin.model.description import JointKind
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import FloatArray

_ENDS = (JointKind.SPHERICAL, JointKind.REVOLUTE)
"""Kinds of joints at the end of a leg."""
_ROUND_OFF = 1e-8
"""Share of a twist below which it is round-off of closed loops."""


@dataclass(frozen=True, eq=False)
class LegEnd:
    """A ball, or a hinge of a planar leg, that ties a body of a leg to the platform or to the ground.

    A hinge is treated as a ball at its centre: what else it holds does no work, since all that turns in the leg and on
    the platform turns about parallel axes.

    Attributes
    ----------
    body
        Number of the body within the leg, from 1.
    point
        (3,) centre of the ball in that body [m].
    other
        (3,) centre of the ball in the platform or the ground [m].
    loop
        What ties it, with the loop rows that it has; none for the joint that leads to the platform.
    body_first
        Whether the leg's body is body 1 of the loop.
    hinge
        (3,) axis of a hinge in world axes, dimensionless; None for a ball.
    shift
        (3, 1) CasADi symbols added to `other`, in its axes; None for none [m].
    """

    body: int
    point: FloatArray
    other: FloatArray
    loop: LoopEnds
    body_first: bool
    hinge: FloatArray | None = None
    shift: Any = None


@dataclass(frozen=True, eq=False)
class Leg:
    """A tree between ground and platform.

    Attributes
    ----------
    on_platform
        Whether it hangs on the platform and ends at the ground; otherwise the other way round.
    joints
        Its joints; parents are bodies of the leg, or 0 for what it hangs on; tangent entries count within the leg.
    bodies
        Number in the chain of each of its bodies.
    ends
        Where it is closed.
    motors
        ``(motor, tangent entry)`` of each motor in it.
    home
        Home position of each of its joints [m, rad, unit quaternion].
    shift
        (3, 1) CasADi symbols by which its root is moved in what it hangs on; None for none [m].
    outside
        Where wrenches act on it from outside; bodies count within the leg.
    """

    on_platform: bool
    joints: tuple[TreeJoint, ...]
    bodies: tuple[int, ...]
    ends: tuple[LegEnd, ...]
    motors: tuple[tuple[int, int], ...]
    home: tuple[FloatArray, ...]
    shift: Any = None
    outside: tuple[OutsidePoint, ...] = ()

    @property
    def name(self) -> str:
        """Name of the first joint, for messages."""
        return self.joints[0].name

    @property
    def nv(self) -> int:
        """Number of tangent entries."""
        return self.joints[-1].v.stop


@dataclass(frozen=True, eq=False)
class PlatformPlan:
    """A chain taken apart.

    Attributes
    ----------
    chain
        The chain.
    tree
        Constants, with the platform frame as the frame of its body.
    legs
        Its legs.
    twists
        (6, dof) twists that the platform can do, the same everywhere [m/s, rad/s].
    poses
        (samples, 7) poses to look at before kernels are written [m, unit quaternion].
    """

    chain: ClosedChain
    tree: Tree
    legs: tuple[Leg, ...]
    twists: FloatArray
    poses: FloatArray

    @property
    def held(self) -> FloatArray:
        """(6, 6 - dof) twists that, with its own, make all: in these it is held by the legs [m/s, rad/s]."""
        size = np.repeat([self.chain.length_scale, 1.0], 3)
        dof = self.twists.shape[1]
        beside = np.linalg.svd(self.twists / size[:, None])[0][:, dof:]
        return _echelon(beside)[0] * size[:, None] if dof < 6 else np.zeros((6, 0))

    @property
    def masses(self) -> Masses:
        """Of the platform, about the platform frame."""
        return self.tree.joints[self.tree.platform - 1].masses


def plan_platform(chain: ClosedChain, wrenches: Sequence[str] = ()) -> PlatformPlan:
    """Take a chain apart into a platform and its legs.

    Parameters
    ----------
    chain
        Closed chain.
    wrenches
        Links on which wrenches act from outside.

    Returns
    -------
    PlatformPlan
        Platform and legs.

    Raises
    ------
    UnsupportedError
        If the platform is not a body that only balls and passive joints tie to the rest, or where legs end, or a ball
        stands, joints do something by themselves: that is felt by the whole tree.
    """
    tree = tree_of(chain, wrenches)
    _require_free_legs(chain, tree)
    tree = _in_platform_frame(tree)
    loops = list(tree.loops)
    carrier = tree.joints[tree.platform - 1]
    if carrier.parent or carrier.kind is not JointKind.FLOATING:
        loops.append(_cut(chain, tree, carrier))
    groups = _groups(tree, loops)
    legs = tuple(_leg(chain, tree, bodies, loops) for bodies in groups)
    moved = {motor for leg in legs for motor, _ in leg.motors}
    if len(moved) < len(tree.motors):
        left = next(k for k in range(len(tree.motors)) if k not in moved)
        raise _unsupported(chain, f"motor '{chain.motors[left]}' carries the platform itself")
    samples = pivot_samples(chain)
    poses = np.array([pin.SE3ToXYZQUAT(platform_pose(chain, q)) for q in samples])
    for leg in legs:
        _require_planar(chain, leg, np.zeros((6, 0)))
    twists = platform_twists(chain, samples)
    for leg in legs:
        _require_planar(chain, leg, twists)
    return PlatformPlan(chain, tree, legs, twists, poses)


def _require_free_legs(chain: ClosedChain, tree: Tree) -> None:
    """Refuse what legs are not solved with: couplings, a platform that does not move, springs where legs end."""
    if not tree.platform:
        raise _unsupported(chain, "the platform is the ground")
    if tree.couplings:
        raise _unsupported(chain, f"row '{chain.loop_table.names[tree.couplings[0].index]}' couples joints")
    carrier = tree.joints[tree.platform - 1]
    if carrier.rotor.any():
        raise _unsupported(
            chain, f"joint '{carrier.name}', which carries it, has a rotor (armature of the model)"
        )
    balls = [joint for joint in tree.joints if joint.kind is JointKind.SPHERICAL and joint.physics.pushes]
    effect = first_effect(replace(tree, joints=(carrier, *balls)))
    if effect is not None:
        raise _unsupported(chain, effect)


def platform_twists(chain: ClosedChain, samples: FloatArray) -> FloatArray:
    """Find the twists that the platform can do.

    Parameters
    ----------
    chain
        Closed chain.
    samples
        (samples, nq) configurations with closed loops [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (6, dof) basis, in world axes [m/s, rad/s]; the unit vectors where these will do.

    Raises
    ------
    UnsupportedError
        If they differ from pose to pose, so that no fixed coordinates of the platform's motion exist.
    """
    size = np.repeat([chain.length_scale, 1.0], 3)
    here = []
    for q in samples:
        state = chain.at(q)
        twists = state.P @ state.freedom.motions
        left = np.linalg.svd(twists / size[:, None])[0]
        here.append(left[:, : chain.generic.count.platform])
    left, s, _ = np.linalg.svd(np.hstack(here))
    basis = left[:, : np.count_nonzero(s > _ROUND_OFF)]
    if basis.shape[1] != here[0].shape[1]:
        raise _unsupported(
            chain,
            f"its platform has {here[0].shape[1]} freedom(s) of motion, along twists that change with the pose",
        )
    basis, chosen = _echelon(basis)
    return basis * size[:, None] / size[chosen]


def _echelon(basis: FloatArray) -> tuple[FloatArray, list[int]]:
    """Column echelon form, unit vectors where the columns span such; and the rows in which it is the identity."""
    chosen: list[int] = []
    for row in range(len(basis)):
        if np.linalg.matrix_rank(basis[[*chosen, row]], tol=1e-6) > len(chosen):
            chosen.append(row)
    basis = basis @ np.linalg.inv(basis[chosen])
    basis[np.abs(basis) < _ROUND_OFF] = 0.0
    return basis, chosen


def _in_platform_frame(tree: Tree) -> Tree:
    """Describe the platform's body in the platform frame."""
    back, shift = tree.platform_rotation.T, tree.platform_translation
    carrier = tree.joints[tree.platform - 1]
    joints = [
        replace(j, rotation=back @ j.rotation, translation=back @ (j.translation - shift))
        if j.parent == tree.platform
        else j
        for j in tree.joints
    ]
    joints[tree.platform - 1] = replace(carrier, masses=carrier.masses.seen_from(back.T, shift))
    loops = []
    for loop in tree.loops:
        if loop.body1 == tree.platform:
            loop = replace(
                loop, rotation1=back @ loop.rotation1, translation1=back @ (loop.translation1 - shift)
            )
        if loop.body2 == tree.platform:
            loop = replace(
                loop, rotation2=back @ loop.rotation2, translation2=back @ (loop.translation2 - shift)
            )
        loops.append(loop)
    outside = [
        replace(act, point=back @ (act.point - shift)) if act.body == tree.platform else act
        for act in tree.outside
    ]
    return replace(
        tree,
        outside=tuple(outside),
        joints=tuple(joints),
        loops=tuple(loops),
        platform_rotation=np.eye(3),
        platform_translation=np.zeros(3),
    )


def _unsupported(chain: ClosedChain, reason: str) -> UnsupportedError:
    return UnsupportedError(f"{chain.name} does not come apart into a platform and legs: {reason}")


def _cut(chain: ClosedChain, tree: Tree, joint: TreeJoint) -> LoopEnds:
    """Turn the joint that leads to the platform into a loop."""
    if tree.platform - 1 in {_joint_at(tree, index) for index in tree.motors}:
        raise _unsupported(chain, f"motor '{joint.name}' carries the platform")
    if joint.kind not in _ENDS:
        raise _unsupported(
            chain, f"joint '{joint.name}', which carries it, is {joint.kind}, no ball and no hinge"
        )
    # The platform body's own frame, which the joint moves, seen from the platform frame.
    at = chain.model.frames[chain.platform_id].placement.inverse()
    return LoopEnds(
        name=joint.name,
        kind=joint.kind,
        body1=joint.parent,
        body2=tree.platform,
        rotation1=joint.rotation,
        rotation2=at.rotation,
        translation1=joint.translation,
        translation2=at.translation,
        axis=joint.axis,
        rows=(),
        index=(),
        axis2=joint.axis,
    )


def _axis_at_home(chain: ClosedChain, loop: LoopEnds) -> FloatArray:
    data = pin.Data(chain.model)
    pin.forwardKinematics(chain.model, data, chain.q_home)
    frame = pin.updateFramePlacement(chain.model, data, chain.platform_id)
    body = frame if loop.body1 == chain.model.frames[chain.platform_id].parentJoint else data.oMi[loop.body1]
    return body.rotation @ loop.rotation1 @ loop.axis


def _require_planar(chain: ClosedChain, leg: Leg, twists: FloatArray) -> None:
    """Refuse hinges at the end of a leg or platform that turns about other axes than theirs."""
    data = pin.Data(chain.model)
    pin.forwardKinematics(chain.model, data, chain.q_home)
    turning = [
        (f"joint '{joint.name}'", data.oMi[body].rotation @ joint.axis)
        for joint, body in zip(leg.joints, leg.bodies, strict=True)
        if joint.kind is JointKind.REVOLUTE
    ]
    turning += [("the platform", twist[3:]) for twist in twists.T]
    for hinge in (end.hinge for end in leg.ends if end.hinge is not None):
        for name, axis in turning:
            if np.abs(np.cross(hinge, axis)).max() > _ROUND_OFF:
                raise _unsupported(
                    chain,
                    f"the leg of joint '{leg.name}' ends in a hinge, and {name} turns about another axis",
                )
        if any(joint.kind is JointKind.SPHERICAL for joint in leg.joints):
            raise _unsupported(chain, f"the leg of joint '{leg.name}' ends in a hinge and has a ball")


def _joint_at(tree: Tree, index: int) -> int:
    return next(k for k, joint in enumerate(tree.joints) if joint.v.start <= index < joint.v.stop)


def _groups(tree: Tree, loops: Sequence[LoopEnds]) -> list[list[int]]:
    """Bodies that hang together without ground and platform, in the order of the first."""
    roots = (0, tree.platform)
    group = {k: k for k in range(len(tree.joints) + 1)}

    def top(k: int) -> int:
        return k if group[k] == k else top(group[k])

    ties = [(k, joint.parent) for k, joint in enumerate(tree.joints, start=1)]
    for a, b in [*ties, *((loop.body1, loop.body2) for loop in loops)]:
        if a not in roots and b not in roots:
            group[max(top(a), top(b))] = min(top(a), top(b))
    members: dict[int, list[int]] = {}
    for k in range(1, len(tree.joints) + 1):
        if k not in roots:
            members.setdefault(top(k), []).append(k)
    return list(members.values())


def _leg(chain: ClosedChain, tree: Tree, bodies: list[int], loops: Sequence[LoopEnds]) -> Leg:
    name = tree.joints[bodies[0] - 1].name
    hangs_on = {tree.joints[k - 1].parent for k in bodies} & {0, tree.platform}
    if len(hangs_on) > 1:
        raise _unsupported(
            chain, f"the leg of joint '{name}' hangs on the ground and on the platform at once"
        )
    root = hangs_on.pop()
    other = tree.platform if root == 0 else 0
    local = {root: 0, **{k: n for n, k in enumerate(bodies, start=1)}}
    ends = tuple(
        _end(chain, loop, local, other) for loop in loops if loop.body1 in bodies or loop.body2 in bodies
    )
    joints: list[TreeJoint] = []
    motors: list[tuple[int, int]] = []
    start = 0
    for k in bodies:
        joint = tree.joints[k - 1]
        size = joint.v.stop - joint.v.start
        joints.append(replace(joint, parent=local[joint.parent], v=slice(start, start + size)))
        motors += [(n, start) for n, index in enumerate(tree.motors) if index == joint.v.start]
        start += size
    home = tuple(chain.q_home[joint.q] for joint in joints)
    outside = tuple(replace(act, body=local[act.body]) for act in tree.outside if act.body in bodies)
    return Leg(bool(root), tuple(joints), tuple(bodies), ends, tuple(motors), home, outside=outside)


def _end(chain: ClosedChain, loop: LoopEnds, local: dict[int, int], other: int) -> LegEnd:
    if loop.kind not in _ENDS:
        raise _unsupported(chain, f"loop '{loop.name}' is {loop.kind}, no ball and no hinge")
    hinge = _axis_at_home(chain, loop) if loop.kind is JointKind.REVOLUTE else None
    sides = ((loop.body1, loop.translation1), (loop.body2, loop.translation2))
    for first, ((body, point), (far, far_point)) in ((True, sides), (False, sides[::-1])):
        if local.get(body) and far == other:
            return LegEnd(local[body], point, far_point, loop, first, hinge)
    raise _unsupported(chain, f"loop '{loop.name}' does not tie a leg to the platform or the ground")
