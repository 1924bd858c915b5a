"""Columns of the constraint matrix: the forces that a joint can transmit, and the accelerations it forbids.

A joint with motion axes S transmits the wrenches T with Tᵀ S = 0. It adds +T to the rows of its successor and -T to
those of its predecessor, and demands Tᵀ (a_successor - a_predecessor) = c. What the closure of a loop transmits is
told first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stewart_pin.errors import SingularityError
from stewart_pin.mechanics.constraint_matrix.kinematics import (
    JointMotion,
    LinkMotion,
    force_at,
    motion_about,
    skew,
)
from stewart_pin.mechanics.constraint_matrix.topology import CompoundJoint
from stewart_pin.model.description import Cable, JointKind, Loop, unknown_kind
from stewart_pin.typing import FloatArray

# ----------------------------------------------------------------------------------------------------
# What each kind of loop closure transmits, told a second time for the maximal-coordinate system
#
# This table is this system's own: it judges the rows of `stewart_pin.model.loop_table`, so nothing of it comes from
# there. Entries stand in the order of the reactions, `ClosedChain.loop_table`.
# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class ForceAlong:
    """A force at the origin of frame 2, along a direction that is fixed in body 1.

    Attributes
    ----------
    direction
        (3,) unit vector in frame 1.
    """

    direction: FloatArray


@dataclass(frozen=True, eq=False)
class MomentAcross:
    """A moment along ``second × first``: it keeps a direction of each body at right angles to the other.

    Attributes
    ----------
    first
        (3,) unit vector in frame 1.
    second
        (3,) unit vector in frame 2.
    """

    first: FloatArray
    second: FloatArray


@dataclass(frozen=True, eq=False)
class ForceBetween:
    """A force along the line between the origins of the frames, which keeps their distance; or along a cable.

    Attributes
    ----------
    distance
        What is kept [m].
    axis
        (3,) axis about which the pulley of the cable swivels, in frame 1.
    cable
        Its reel and pulley.
    """

    distance: float
    axis: FloatArray
    cable: Cable


Transmitted = ForceAlong | MomentAcross | ForceBetween


def transmitted(loop: Loop) -> tuple[Transmitted, ...]:
    """List what a loop transmits.

    Parameters
    ----------
    loop
        The loop.

    Returns
    -------
    tuple
        One entry per reaction.
    """
    x, y, z = np.eye(3)
    axis = np.array(loop.axis, dtype=float)
    left, up = axes_beside(axis)
    # Moments about left and up hold the axis of body 2 in the direction of that of body 1.
    held = MomentAcross(-up, axis), MomentAcross(left, axis)
    twist = MomentAcross(up, left)  # about the axis
    by_kind: dict[JointKind, tuple[Transmitted, ...]] = {
        JointKind.SPHERICAL: (ForceAlong(x), ForceAlong(y), ForceAlong(z)),
        JointKind.REVOLUTE: (ForceAlong(x), ForceAlong(y), ForceAlong(z), *held),
        JointKind.UNIVERSAL: (
            ForceAlong(x),
            ForceAlong(y),
            ForceAlong(z),
            MomentAcross(axis, np.array(loop.axis2, dtype=float)),
        ),
        JointKind.CYLINDRICAL: (ForceAlong(left), ForceAlong(up), *held),
        JointKind.PRISMATIC: (ForceAlong(left), ForceAlong(up), twist, *held),
        JointKind.PLANAR: (ForceAlong(axis), *held),
        JointKind.POINT_ON_LINE: (ForceAlong(left), ForceAlong(up)),
        JointKind.DISTANCE: (ForceBetween(loop.length, axis, Cable()),),
        JointKind.CABLE: (ForceBetween(loop.length, axis, loop.cable),),
        JointKind.FIXED: (ForceAlong(x), ForceAlong(y), ForceAlong(z), twist, *held),
    }
    if loop.kind not in by_kind:
        raise unknown_kind(f"loop '{loop.name}'", loop.kind, "the system of maximal coordinates")
    return by_kind[loop.kind]


def axes_beside(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Complete an axis to a right-handed frame.

    Parameters
    ----------
    axis
        (3,) unit vector.

    Returns
    -------
    left, up : numpy.ndarray
        (3,) unit vectors, axis × left = up; of a coordinate axis the next two.
    """
    longest = int(np.abs(axis).argmax())
    next_one = np.zeros(3)
    next_one[longest - 2] = 1.0
    up = np.cross(axis, next_one)
    up = up / np.sqrt(up @ up)
    return np.cross(up, axis), up


# ----------------------------------------------------------------------------------------------------

_DISTINCT = 1e-10
"""Smallest singular value of unit axes below which they count as dependent: far above round-off."""
_PURE = 1e-12
"""Part of a motion axis that counts as zero, per metre of robot: round-off of moving it between points."""


@dataclass(frozen=True, eq=False)
class Columns:
    """What one joint contributes.

    Attributes
    ----------
    wrenches
        (6, n) T at the world origin, per joint force or moment [1, m].
    acceleration
        (n,) c, the relative acceleration demanded along the wrenches [m/s², rad/s²].
    """

    wrenches: FloatArray
    acceleration: FloatArray


@dataclass(frozen=True, eq=False)
class Freedoms:
    """Relative motion that a compound joint allows.

    Attributes
    ----------
    axes
        (6, n) motion axes S at the world origin, per joint rate [1, m].
    origin
        (3,) a point of the joint [m].
    bias
        (6,) relative acceleration without joint acceleration [m/s², rad/s²].
    index
        (n,) indices of the joints' tangent entries.
    """

    axes: FloatArray
    origin: FloatArray
    bias: FloatArray
    index: np.ndarray


def compound_freedoms(compound: CompoundJoint, joints: dict[str, JointMotion]) -> Freedoms:
    """Collect the freedoms of tree joints in a row.

    Parameters
    ----------
    compound
        The joints.
    joints
        Their motion in the world.

    Returns
    -------
    Freedoms
        Axes of all of them, at the origin of the last one.
    """
    parts = [joints[part.name] for part in compound.parts]
    return Freedoms(
        axes=np.hstack([part.axes for part in parts]),
        origin=parts[-1].origin,
        bias=np.sum([part.bias for part in parts], axis=0),
        index=np.concatenate([np.arange(part.index.start, part.index.stop) for part in parts]),
    )


def passive_columns(freedoms: Freedoms, size: float) -> Columns:
    """Find the wrenches that do no work on the freedoms.

    Parameters
    ----------
    freedoms
        Motion axes of the joint.
    size
        Length that counts as one [m].

    Returns
    -------
    Columns
        6 - n of them: forces and moments in separate columns where the axes are pure rotations about one point or
        pure translations, otherwise a basis that is orthonormal where forces and moments per `size` count alike.
    """
    at_point = motion_about(freedoms.origin, freedoms.axes)
    slides, turns = at_point[:3], at_point[3:]
    round_off = _PURE * max(size, float(np.linalg.norm(freedoms.origin)))
    zero = np.zeros((3, 3))
    if np.abs(slides).max(initial=0.0) < round_off:
        moments = _complement(turns)
        force, moment = np.hstack([np.eye(3), 0 * moments]), np.hstack([zero, moments])
    elif np.abs(turns).max() < _PURE:
        forces = _complement(slides)
        force, moment = np.hstack([forces, zero]), np.hstack([0 * forces, np.eye(3)])
    else:
        # In one unit: columns that mix newtons and newton metres would depend on each other in a robot of micrometres.
        axes = np.vstack([slides / size, turns])
        both = _complement(axes / np.linalg.norm(axes, axis=0))
        force, moment = both[:3], both[3:] * size
    wrenches = force_at(freedoms.origin, force, moment)
    return Columns(wrenches, wrenches.T @ freedoms.bias)


def effort_column(freedoms: Freedoms, entry: int, acceleration: float) -> Columns:
    """Build the column of a motor or gear: unit effort on its own freedom, none on the others of the joint.

    Where massless links join several freedoms in one joint, they must differ: see `Raises`.

    Parameters
    ----------
    freedoms
        Motion axes of the compound joint that holds the driven one.
    entry
        Tangent entry of the driven joint.
    acceleration
        Its demanded acceleration [m/s² or rad/s²].

    Returns
    -------
    Columns
        One column.

    Raises
    ------
    SingularityError
        If the freedoms of the joint do not differ here (gimbal lock): what the effort does is then undetermined.
    """
    axes = motion_about(freedoms.origin, freedoms.axes)
    # Sizes of the axes do not matter to whether they differ.
    smallest = float(np.linalg.svd(axes / np.linalg.norm(axes, axis=0), compute_uv=False)[-1])
    if axes.shape[1] > 6 or smallest < _DISTINCT:
        raise SingularityError(
            f"{axes.shape[1]} joints in a row without a body between them, one of them driven, share their motions "
            f"here (smallest singular value {smallest:.3g}); move away from this configuration, or give the links "
            "between them mass",
            smallest_singular_value=smallest,
        )
    # The dual basis S (SᵀS)⁻¹: power of column k is the rate of freedom k.
    dual = np.linalg.pinv(axes).T[:, freedoms.index == entry]
    wrench = force_at(freedoms.origin, dual[:3], dual[3:])
    return Columns(wrench, wrench.T @ freedoms.bias + acceleration)


def loop_columns(loop: Loop, link1: LinkMotion, link2: LinkMotion) -> Columns:
    """Build the columns of a loop, one per row of its gap, in the sign of its reactions.

    Parameters
    ----------
    loop
        The loop.
    link1, link2
        Motion of its links.

    Returns
    -------
    Columns
        Wrenches on link 2.
    """
    ends = loop_ends(loop, link1, link2)
    wrenches, demands = zip(*(_loop_row(part, ends) for part in transmitted(loop)), strict=True)
    return Columns(np.stack(wrenches, axis=1), np.array(demands))


def loop_openings(
    loop: Loop, link1: LinkMotion, link2: LinkMotion, size: float, wound: float = 0.0
) -> FloatArray:
    """Measure how far a loop is from closed.

    Parameters
    ----------
    loop
        The loop.
    link1, link2
        Motion of its links.
    size
        Length that counts as one [m].
    wound
        What a reel has wound in of a cable [m].

    Returns
    -------
    numpy.ndarray
        (n,) opening of every row, dimensionless: lengths per `size`, angles in radians.
    """
    ends = loop_ends(loop, link1, link2)
    reach = ends.point2 - ends.point1
    openings = []
    for part in transmitted(loop):
        if isinstance(part, MomentAcross):
            openings.append((ends.rotation1 @ part.first) @ (ends.rotation2 @ part.second))
        elif isinstance(part, ForceAlong):
            openings.append((ends.rotation1 @ part.direction) @ reach / size)
        else:
            way = _over_pulley(part, ends, reach)[2] if part.cable.radius else np.linalg.norm(reach)
            openings.append((way + wound - part.distance) / size)
    return np.array(openings)


@dataclass(frozen=True, eq=False)
class LoopEnds:
    """Loop frames in the world, with the twists of the links that carry them.

    Attributes
    ----------
    rotation1, rotation2
        (3, 3) axes of the frames.
    point1, point2
        (3,) their origins [m].
    twist1, twist2
        (6,) spatial velocities of the links at the world origin [m/s, rad/s].
    """

    rotation1: FloatArray
    rotation2: FloatArray
    point1: FloatArray
    point2: FloatArray
    twist1: FloatArray
    twist2: FloatArray


def loop_ends(loop: Loop, link1: LinkMotion, link2: LinkMotion) -> LoopEnds:
    """Place the frames of a loop in the world.

    Parameters
    ----------
    loop
        The loop.
    link1, link2
        Motion of its links.

    Returns
    -------
    LoopEnds
        Its frames.
    """
    rotation1 = link1.rotation @ loop.placement1.rotation
    rotation2 = link2.rotation @ loop.placement2.rotation
    point1 = link1.origin + link1.rotation @ loop.placement1.translation
    point2 = link2.origin + link2.rotation @ loop.placement2.translation
    return LoopEnds(rotation1, rotation2, point1, point2, link1.twist, link2.twist)


def acceleration_along(direction: FloatArray, ends: LoopEnds) -> tuple[FloatArray, float]:
    """Tell how the origin of frame 2 accelerates along a direction of body 1, seen from there.

    Parameters
    ----------
    direction
        (3,) unit vector in frame 1.
    ends
        Frames of the loop.

    Returns
    -------
    wrench : numpy.ndarray
        (6,) whose power on the relative acceleration of the bodies it is [1, m].
    known : float
        What is there without it [m/s²].
    """
    wrench, demand = _loop_row(ForceAlong(direction), ends)
    return wrench, -demand


def _loop_row(part: Transmitted, ends: LoopEnds) -> tuple[FloatArray, float]:
    """Wrench of one reaction, and the demand from differentiating its opening twice in the world frame."""
    w1, w2 = ends.twist1[3:], ends.twist2[3:]
    if isinstance(part, MomentAcross):
        # g = u1 · u2 with both turning: d²g = (u2 × u1)·(α2 - α1) + u1·(w2×(w2×u2)) + u2·(w1×(w1×u1)) + 2 u̇1·u̇2.
        u1, u2 = ends.rotation1 @ part.first, ends.rotation2 @ part.second
        rate1, rate2 = skew(w1) @ u1, skew(w2) @ u2
        known = u1 @ skew(w2) @ rate2 + u2 @ skew(w1) @ rate1 + 2 * rate1 @ rate2
        return np.concatenate([np.zeros(3), skew(u2) @ u1]), -float(known)
    point = ends.point2
    reach = ends.point2 - ends.point1
    # Both bodies are looked at where frame 2 is: body 1's material point there moves with `velocity1`.
    velocity1, velocity2 = (motion_about(point, twist)[:3] for twist in (ends.twist1, ends.twist2))
    apart = velocity2 - velocity1
    # Spatial to classical acceleration of these points adds ω × velocity.
    classical = skew(w2) @ velocity2 - skew(w1) @ velocity1
    if isinstance(part, ForceAlong):
        n = ends.rotation1 @ part.direction
        # g = n·reach with n fixed in body 1: d²g = n·(relative acceleration) + 2 (w1 × n)·apart.
        known = n @ classical + 2 * skew(w1) @ n @ apart
    else:
        if part.cable.radius:
            n, turning, _ = _over_pulley(part, ends, reach, apart)
            bent = turning @ apart
        else:
            length = np.linalg.norm(reach)
            n = reach / length
            slip = apart - n * (n @ apart)
            bent = slip @ slip / length
        # g = |reach|: seen from body 1, d²g = n·c̈ + ṅ·ċ; c̈ gains -2 w1 × apart from body 1's turning.
        known = n @ (classical - 2 * skew(w1) @ apart) + bent
    return np.concatenate([n, skew(point) @ n]), -float(known)


def _over_pulley(
    part: ForceBetween, ends: LoopEnds, reach: FloatArray, apart: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, float]:
    """Direction of a cable beyond its pulley, how it turns as the far end moves, seen from body 1, and its length.

    By the point at which it leaves: the pulley's plane turns about the swivel axis, the cable rolls off in it.
    """
    radius, up = part.cable.radius, ends.rotation1 @ part.axis
    level = reach - up * (up @ reach)
    ahead = level / np.sqrt(level @ level)
    side = skew(ahead) @ up  # turns ahead to up
    middle = reach - radius * ahead
    straight = np.sqrt(middle @ middle - radius**2)
    leaves = (radius**2 * middle + radius * straight * (skew(side) @ middle)) / (middle @ middle)
    n = (middle - leaves) / straight
    wrapped = np.arctan2(-(skew(leaves) @ ahead) @ side, -ahead @ leaves) % (2 * np.pi)
    turning = np.zeros(3)
    if apart is not None:
        # Angular velocities of the plane about `up`, and of the cable in it about `side`.
        swivelling = (skew(up) @ level) @ apart / (level @ level)
        rolling = leaves @ apart / (radius * straight)
        turning = skew(up * swivelling + side * rolling) @ n
    return n, turning, float(radius * wrapped + straight)


def _complement(columns: FloatArray) -> FloatArray:
    """Orthonormal basis of what is orthogonal to n columns: always m - n vectors, also where the columns degenerate."""
    m, n = columns.shape
    if n == 0:
        return np.eye(m)
    if n >= m:
        return np.zeros((m, 0))
    return np.linalg.svd(columns)[0][:, n:]
