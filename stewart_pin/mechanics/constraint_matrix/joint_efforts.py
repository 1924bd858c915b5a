"""What joints do by themselves, told by the bodies: springs, damping and dry friction as pairs of wrenches.

A joint that acts along a coordinate x with the effort f puts f w on its successor and -f w on its predecessor, with w
the wrench whose power on their relative motion is ẋ, and ẍ = wᵀ (a_successor - a_predecessor) + what is known. Of a
freedom of a compound joint w is the column of a motor there; of the closure of a loop it is told here.

This judges `stewart_pin.state.joint_effects`: nothing of it comes from there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from stewart_pin.errors import ConvergenceError
from stewart_pin.mechanics.constraint_matrix.columns import (
    Freedoms,
    LoopEnds,
    acceleration_along,
    axes_beside,
    effort_column,
    loop_ends,
)
from stewart_pin.mechanics.constraint_matrix.kinematics import LinkMotion, skew
from stewart_pin.mechanics.constraint_matrix.topology import Topology
from stewart_pin.model.description import Joint, JointKind, Loop, unknown_kind
from stewart_pin.model.joint_physics import JointPhysics, read_fields
from stewart_pin.state.chain import ClosedChain
from stewart_pin.tolerances import AT_REST, AT_REST_BESIDE
from stewart_pin.typing import Configuration, FloatArray, Tangent


@dataclass(frozen=True, eq=False)
class OwnEffort:
    """What one joint does along one coordinate.

    Attributes
    ----------
    predecessor, successor
        Numbers of the bodies.
    wrench
        (6,) on the successor per unit of effort, at the world origin [1, m].
    known
        Acceleration of the coordinate that is there without that of the bodies [m/s² or rad/s²].
    smooth
        Effort of spring and damping [N or N m].
    friction
        Dry friction [N or N m].
    rate
        Rate of the coordinate [m/s or rad/s].
    size
        Natural size of the coordinate [m or 1].
    """

    predecessor: int
    successor: int
    wrench: FloatArray
    known: float
    smooth: float
    friction: float
    rate: float
    size: float

    def acceleration(self, bodies: FloatArray) -> float:
        """Tell how the coordinate accelerates.

        Parameters
        ----------
        bodies
            (6 n_bodies,) accelerations of the bodies [m/s², rad/s²].

        Returns
        -------
        float
            [m/s² or rad/s²].
        """
        at = bodies.reshape(-1, 6)
        return float(self.wrench @ (at[self.successor] - at[self.predecessor])) + self.known

    def on_bodies(self, count: int) -> FloatArray:
        """Put a unit effort on the bodies.

        Parameters
        ----------
        count
            Number of bodies.

        Returns
        -------
        numpy.ndarray
            (6 n_bodies,) wrenches [1, m].
        """
        pair = np.zeros((count, 6))
        pair[self.successor] += self.wrench
        pair[self.predecessor] -= self.wrench
        return pair.ravel()


def acting_joints(chain: ClosedChain) -> tuple[str, ...]:
    """List the joints of the tree that do something by themselves besides the inertia of a rotor.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    tuple of str
        Their names, in the order of the description.
    """
    fields, found = read_fields(chain.model), []
    for joint in chain.mechanism.joints:
        entries = _entries(chain, joint)
        if joint.physics.pushes or any(fields[name][entries].any() for name in ("damping", "friction")):
            found.append(joint.name)
    return tuple(found)


def own_efforts(
    chain: ClosedChain,
    layout: Topology,
    freedoms: Sequence[Freedoms],
    links: Mapping[str, LinkMotion],
    q: Configuration,
    v: Tangent,
) -> tuple[OwnEffort, ...]:
    """Tell what each joint does by itself.

    Parameters
    ----------
    chain
        Closed chain.
    layout
        Bodies and compound joints.
    freedoms
        Freedoms of each compound joint.
    links
        Motion of every link.
    q
        (nq,) configuration [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].

    Returns
    -------
    tuple of OwnEffort
        One per coordinate, those of the tree first.
    """
    number = {link.name: k for k, link in enumerate(layout.bodies)}
    fields, size, found = read_fields(chain.model), chain.length_scale, []
    joints = {joint.name: joint for joint in chain.mechanism.joints}
    for name in acting_joints(chain):
        at = layout.compound(name)
        ends = number[layout.tree[at].predecessor], number[layout.tree[at].successor]
        entries = _entries(chain, joints[name])
        pushes = _tree_springs(chain, joints[name], q)
        for entry, push in zip(range(entries.start, entries.stop), pushes, strict=True):
            column = effort_column(freedoms[at], entry, 0.0)
            smooth = push - float(fields["damping"][entry] * v[entry])
            friction, natural = float(fields["friction"][entry]), float(chain.tangent_scale[entry])
            known = -float(column.acceleration[0])
            found.append(
                OwnEffort(*ends, column.wrenches[:, 0], known, smooth, friction, float(v[entry]), natural)
            )
    for joint in layout.loops:
        loop = joint.loop
        if not any(loop.physics):
            continue
        ends = loop_ends(loop, links[loop.link1], links[loop.link2])
        pair = number[joint.predecessor], number[joint.successor]
        for part, physics in _loop_parts(loop, ends):
            rate = float(part.wrench @ (ends.twist2 - ends.twist1))
            smooth = part.push - physics.damping * rate
            natural = size if part.is_length else 1.0
            found.append(OwnEffort(*pair, part.wrench, part.known, smooth, physics.friction, rate, natural))
    return tuple(found)


def _entries(chain: ClosedChain, joint: Joint) -> slice:
    if joint.kind is JointKind.FIXED:
        return slice(0, 0)
    entry = chain.model.joints[chain.model.getJointId(joint.name)]
    return slice(entry.idx_v, entry.idx_v + entry.nv)


def _tree_springs(chain: ClosedChain, joint: Joint, q: Configuration) -> list[float]:
    """Efforts of the springs of a tree joint, one per tangent entry [N or N m]."""
    entry = chain.model.joints[chain.model.getJointId(joint.name)]
    if joint.kind is JointKind.SPHERICAL:
        turned = Rotation.from_quat(q[entry.idx_q : entry.idx_q + 4]).as_rotvec()
        return [float(x) for x in -sum(joint.physics.stiffness) * turned]
    if joint.kind is JointKind.FLOATING:
        return [0.0] * 6
    return [_spring(joint.physics, float(q[entry.idx_q]) - joint.physics.rest)]


def _spring(physics: JointPhysics, apart: float) -> float:
    """Effort of a spring by its displacement from rest: Horner's scheme for force - Σ k xⁿ."""
    pull = 0.0
    for stiffness in reversed(physics.stiffness):
        pull = (pull + stiffness) * apart
    return physics.force - pull


# ----------------------------------------------------------------------------------------------------
# Coordinates of loops
# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _LoopPart:
    """One coordinate of a loop: its wrench on link 2, what is known of its acceleration, and what its spring does."""

    wrench: FloatArray
    known: float
    push: float
    is_length: bool = False


def _loop_parts(loop: Loop, ends: LoopEnds) -> list[tuple[_LoopPart, JointPhysics]]:
    axis = np.array(loop.axis, dtype=float)
    left, up = axes_beside(axis)
    turn = ends.rotation1.T @ ends.rotation2
    shift = ends.rotation1.T @ (ends.point2 - ends.point1)

    def length(direction: FloatArray, physics: JointPhysics) -> _LoopPart:
        wrench, known = acceleration_along(direction, ends)
        push = _spring(physics, float(direction @ shift) - physics.rest)
        return _LoopPart(wrench, known, push, is_length=True)

    def angle(about: FloatArray, carrier: FloatArray, value: float, physics: JointPhysics) -> _LoopPart:
        # ẋ = u · (ω2 - ω1) with u carried along: ẍ = u · (α2 - α1) + (ω × u) · (ω2 - ω1).
        relative = ends.twist2[3:] - ends.twist1[3:]
        apart = (value - physics.rest + np.pi) % (2 * np.pi) - np.pi  # to the nearest whole turn
        wrench = np.concatenate([np.zeros(3), about])
        return _LoopPart(wrench, float(skew(carrier) @ about @ relative), _spring(physics, apart))

    def about_axis(physics: JointPhysics) -> _LoopPart:
        turned = turn @ left
        value = float(np.arctan2(turned @ up, turned @ left))
        return angle(ends.rotation1 @ axis, ends.twist1[3:], value, physics)

    own = loop.physics
    match loop.kind:
        case JointKind.REVOLUTE:
            parts = [about_axis(own[0])]
        case JointKind.PRISMATIC | JointKind.POINT_ON_LINE:
            parts = [length(axis, own[0])]
        case JointKind.CYLINDRICAL:
            parts = [length(axis, own[0]), about_axis(own[1])]
        case JointKind.PLANAR:
            parts = [length(left, own[0]), length(up, own[1]), about_axis(own[2])]
        case JointKind.UNIVERSAL:
            # R = exp(axis α) exp(axis2 β): R axis2 = axis2 cos α + across sin α, Rᵀ axis = axis cos β + across sin β.
            second = np.array(loop.axis2, dtype=float)
            across = skew(axis) @ second
            first, back = turn @ second, turn.T @ axis
            values = np.arctan2(first @ across, first @ second), np.arctan2(back @ across, back @ axis)
            parts = [
                angle(ends.rotation1 @ axis, ends.twist1[3:], float(values[0]), own[0]),
                angle(ends.rotation2 @ second, ends.twist2[3:], float(values[1]), own[1]),
            ]
        case JointKind.SPHERICAL:
            turned = ends.rotation1 @ Rotation.from_matrix(turn).as_rotvec()
            pushes = -sum(own[0].stiffness) * turned
            parts = [
                _LoopPart(np.concatenate([np.zeros(3), u]), 0.0, float(u @ pushes)) for u in ends.rotation1.T
            ]
            own = own * 3
        case _:
            raise unknown_kind(f"loop '{loop.name}'", loop.kind, "the springs of the maximal coordinates")
    return list(zip(parts, own, strict=True))


# ----------------------------------------------------------------------------------------------------
# Dry friction
# ----------------------------------------------------------------------------------------------------


def moves(rates: FloatArray, sizes: FloatArray, motion: Tangent, chain: ClosedChain) -> FloatArray:
    """Tell the sense in which coordinates move: 1 or -1, or 0 where that is round-off.

    Parameters
    ----------
    rates
        (k,) rates of the coordinates, or their accelerations [m/s or rad/s].
    sizes
        (k,) their natural sizes [m or 1].
    motion
        (nv,) velocity of the tree, or acceleration [m/s, rad/s].
    chain
        Closed chain.

    Returns
    -------
    numpy.ndarray
        (k,) dimensionless.
    """
    largest = max(abs(motion / chain.tangent_scale), default=0.0)
    return np.sign(rates) * (abs(rates) > sizes * max(AT_REST, AT_REST_BESIDE * largest))


_DEPENDENT = 1e-12
"""Eigenvalue of responses of size one below which coordinates move as others do: some thousand units of round-off."""
_EXACT = 1e-9
"""Acceleration against friction that may be left, relative to the largest: its direction is told to ten digits."""


def friction_at_rest(response: FloatArray, accelerations: FloatArray, limits: FloatArray) -> FloatArray:
    """Find what dry friction does at coordinates at rest that are free to start.

    With the responses W = Rᵀ R and the accelerations b = Rᵀ d, friction f makes ǀR f + dǀ least within its limits
    (Gauss's principle).

    Parameters
    ----------
    response
        (k, k) acceleration of each per unit effort at each, each answering itself by more than round-off [1/kg or
        1/(kg m²)].
    accelerations
        (k,) accelerations without friction at rest [m/s² or rad/s²].
    limits
        (k,) dry friction, above zero [N or N m].

    Returns
    -------
    numpy.ndarray
        (k,) efforts, within the limits [N or N m].

    Raises
    ------
    ConvergenceError
        If some coordinate starts along its friction, or stays against what it can do.
    """
    # In units in which each answers itself by one.
    unit = 1.0 / np.sqrt(response.diagonal())
    matrix, pull, bound = response * unit * unit[:, None], accelerations * unit, limits / unit
    size = float(max(abs(pull).max(), (abs(matrix) @ bound).max()))
    values, axes = np.linalg.eigh((matrix + matrix.T) / 2)
    moves_alone = values > _DEPENDENT * values[-1]
    root, across = np.sqrt(values[moves_alone]), axes[:, moves_alone].T
    rows, right = root[:, None] * across, -(across @ pull) / root
    beside = axes[:, ~moves_alone].T
    if abs(beside @ pull).max(initial=0.0) > _EXACT * size:
        # Of coordinates that move alike but for what is demanded, some slip: friction goes along there, to its limits.
        weight = np.sqrt(_DEPENDENT)
        rows, right = np.vstack([rows, weight * beside]), np.append(right, -(beside @ pull) / weight)
    least = np.linalg.lstsq(rows, right)[0]
    share = (
        least if (abs(least) <= bound).all() else lsq_linear(rows, right, (-bound, bound), "bvls", 1e-15).x
    )
    left, stays = matrix @ share + pull, abs(share) < bound * (1.0 - 1e-9)
    wrong = float(np.where(stays, abs(left), np.maximum(left * np.sign(share), 0.0)).max()) / size
    if wrong > _EXACT:
        raise ConvergenceError(
            f"no dry friction of the joints at rest was found: {wrong:.3g} of the largest acceleration is left "
            "against it; are some frictions many orders of magnitude larger than others?",
            residual=wrong,
        )
    return share * unit
