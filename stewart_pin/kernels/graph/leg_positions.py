"""Positions of the joints of a leg from the point where it ends, in closed form.

A leg is a stem, which may be missing, and one or several pointers. A pointer turns about one point (a ball, or two
hinges that cross at right angles, or three, the third along the leg) and reaches its end along a line through that
point, by a slide or by a rod of fixed length. A stem is a hinge or a slide before the pointers, such as a crank: the
length of the rod tells how far it has moved. In the plane a single hinge makes a pointer. Of two solutions the one on
the side of home is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.graph.bodies import JointPlacement
from stewart_pin.kernels.planning.plan import Leg, LegEnd
from stewart_pin.kernels.planning.spatial import constant, rotation_constant, skew, turn_about
from stewart_pin.kernels.planning.tree import TreeJoint
from stewart_pin.model.description import JointKind
from stewart_pin.model.loop_rows import orthonormal_triad
from stewart_pin.typing import FloatArray

_ROUND_OFF = 1e-9
"""Axes and points that miss each other by less meet: files print ten digits."""


@dataclass(frozen=True, eq=False)
class Reach:
    """A slide that is as long as two points are apart: ``length = sign * position + offset``.

    Attributes
    ----------
    root
        (3,) point in what the leg hangs on, ground or platform [m].
    end
        (3,) point in the other of the two [m].
    sign
        1, or -1 for a slide that shortens the leg.
    offset
        Length with the slide at zero [m].
    """

    root: FloatArray
    end: FloatArray
    sign: float
    offset: float


@dataclass(frozen=True, eq=False)
class LegPositions:
    """Where the joints of a leg are.

    Attributes
    ----------
    moved
        Placement of every joint.
    values
        ``{joint: position}`` of hinges (cosine and sine, (2, 1)) and slides (1, 1), joints counted from 0.
    stretched
        Squared distance over squared length, less 1, of every rod that nothing has been moved to fit, and the slope of
        every planar pointer out of its plane: zero at poses that the platform can take.
    reaches
        Slides of a leg that is nothing but a pointer in space.
    elbow
        Whether a crank or a slide on a rail moves a rod: two positions of it reach one end, that of home is taken.
    """

    moved: tuple[JointPlacement, ...]
    values: dict[int, ca.SX]
    stretched: tuple[ca.SX, ...]
    reaches: dict[int, Reach]
    elbow: bool


@dataclass(frozen=True, eq=False)
class _Pointer:
    """Joints that turn about one point and the end that they reach.

    `spin` is a third hinge, along the line to the end, and `slide` the joint that reaches, where there are such.
    The line is a unit vector in the body of the last of these joints before the slide.
    """

    turns: tuple[int, ...]
    spin: int | None
    slide: int | None
    end: LegEnd
    line: FloatArray
    offset: float

    def planar(self, leg: Leg) -> bool:
        """Whether it is one hinge."""
        return len(self.turns) == 1 and leg.joints[self.turns[0]].kind is JointKind.REVOLUTE


def leg_positions(leg: Leg, targets: Sequence[ca.SX]) -> LegPositions:
    """Solve a leg.

    Parameters
    ----------
    leg
        The leg.
    targets
        (3, 1) of each end, in axes of what the leg hangs on [m].

    Returns
    -------
    LegPositions
        Placements of the joints.

    Raises
    ------
    UnsupportedError
        If the leg has no closed form here.
    """
    stem, pointers = _take_apart(leg)
    moved: dict[int, JointPlacement] = {}
    values: dict[int, ca.SX] = {}
    points = {id(end): target for end, target in zip(leg.ends, targets, strict=True)}
    if stem is not None:
        joint = leg.joints[stem]
        points = {key: _into(joint, point) for key, point in points.items()}
        solve = _crank if joint.kind is JointKind.REVOLUTE else _rail
        moved[stem], values[stem] = solve(leg, stem, pointers[0], points[id(pointers[0].end)])
        turn, shift = moved[stem]
        points = {key: turn.T @ (point - shift) for key, point in points.items()}
    stretched: list[ca.SX] = []
    reaches: dict[int, Reach] = {}
    for k, pointer in enumerate(pointers):
        target = points[id(pointer.end)]
        planar = pointer.planar(leg)
        (_point_in_plane if planar else _point)(leg, pointer, target, moved, values)
        if stem is None and pointer.slide is not None and not planar:
            sign, centre = _sign(leg, pointer, pointer.slide), leg.joints[pointer.turns[0]].translation
            reaches[pointer.slide] = Reach(centre, pointer.end.other, sign, pointer.offset)
        # The rod that a crank or rail has been moved to fit is as long as it should be.
        fitted = pointer.slide is not None or (stem is not None and k == 0)
        stretched += _misfits(leg, pointer, target, fitted=fitted)
    placements = tuple(moved[k] for k in range(len(leg.joints)))
    return LegPositions(placements, values, tuple(stretched), reaches, stem is not None)


def _misfits(leg: Leg, pointer: _Pointer, target: ca.SX, *, fitted: bool) -> list[ca.SX]:
    """Measure by what a pointer does not reach its target: its length, and the slope out of its plane."""
    first = leg.joints[pointer.turns[0]]
    arm = target - constant(first.translation)
    square = ca.dot(arm, arm)
    found = [] if fitted else [square / pointer.offset**2 - 1]
    if pointer.planar(leg):
        normal = rotation_constant(first.rotation) @ constant(first.axis)
        found.append(ca.dot(normal, arm) / ca.sqrt(square))
    return found


def _into(joint: TreeJoint, point: ca.SX) -> ca.SX:
    """Express a point of the parent in the joint frame."""
    return rotation_constant(joint.rotation).T @ (point - constant(joint.translation))


def _no_form(leg: Leg, reason: str) -> UnsupportedError:
    return UnsupportedError(
        f"the leg of joint '{leg.name}' has no closed form: {reason}; known are legs that turn about one point (a "
        "ball, two crossing hinges at right angles, or one hinge in the plane) and slide to their end, or reach it by "
        "a rod behind a crank or rail"
    )


def _take_apart(leg: Leg) -> tuple[int | None, tuple[_Pointer, ...]]:
    """Find what moves the pointers of a leg, None where it hangs on its first turns, and the pointers."""
    first, below = leg.joints[0], _below(leg, 0)
    stem = None if _points_at_once(leg, below) else 0
    if stem is not None and first.kind not in (JointKind.REVOLUTE, JointKind.PRISMATIC):
        raise _no_form(leg, f"joint '{first.name}' is {first.kind}")
    starts = [0] if stem is None else below
    pointers = tuple(_pointer(leg, start, rod=stem is not None) for start in starts)
    used = sum(len(p.turns) + (p.spin is not None) + (p.slide is not None) for p in pointers)
    if not pointers or used + (stem is not None) != len(leg.joints) or len(pointers) != len(leg.ends):
        raise _no_form(leg, "it has more joints or ends than its pointers use")
    return stem, pointers


def _below(leg: Leg, joint: int) -> list[int]:
    """Joints that hang on a joint."""
    return [k for k, other in enumerate(leg.joints) if other.parent == joint + 1]


def _points_at_once(leg: Leg, below: Sequence[int]) -> bool:
    """Whether the first joint turns a pointer, and is no crank or rail that carries others."""
    first = leg.joints[0]
    if first.kind is JointKind.SPHERICAL or not below:
        return first.kind in (JointKind.SPHERICAL, JointKind.REVOLUTE)
    if first.kind is not JointKind.REVOLUTE or len(below) > 1:
        return False
    return leg.joints[below[0]].kind is JointKind.PRISMATIC or _crosses(leg, 0, below[0])


def _crosses(leg: Leg, one: int, two: int) -> bool:
    """Whether two hinges, one on the other, meet at right angles in the origin of both."""
    first, second = leg.joints[one], leg.joints[two]
    if first.kind is not JointKind.REVOLUTE or second.kind is not JointKind.REVOLUTE:
        return False
    apart = np.abs(second.translation).max()
    return bool(apart < _ROUND_OFF and abs(first.axis @ second.rotation @ second.axis) < _ROUND_OFF)


def _pointer(leg: Leg, start: int, *, rod: bool) -> _Pointer:
    """Find the joints of a pointer from its first one on, and its line; a rod ends without a slide."""
    turns, spin = _turns_of(leg, start)
    last = turns[-1] if spin is None else spin
    slide = _slide_of(leg, last, rod=rod)
    carrier = last if slide is None else slide
    end = next((end for end in leg.ends if end.body == carrier + 1), None)
    if end is None:
        raise _no_form(leg, f"the body of joint '{leg.joints[carrier].name}' has no end")
    pointer = _Pointer(turns, spin, slide, end, *_line(leg, slide, end))
    _require_right_angles(leg, pointer)
    return pointer


def _turns_of(leg: Leg, start: int) -> tuple[tuple[int, ...], int | None]:
    """Joints that turn a pointer about its point, and a third hinge on two of them that may spin it."""
    if leg.joints[start].kind not in (JointKind.SPHERICAL, JointKind.REVOLUTE):
        raise _no_form(leg, f"joint '{leg.joints[start].name}' does not turn")
    below = _below(leg, start)
    if len(below) != 1 or not _crosses(leg, start, below[0]):
        return (start,), None
    further = _below(leg, below[0])
    spins = bool(further) and leg.joints[further[0]].kind is JointKind.REVOLUTE
    return (start, below[0]), further[0] if spins else None


def _slide_of(leg: Leg, last: int, *, rod: bool) -> int | None:
    """Joint by which a pointer reaches its end, on the last of those that turn it."""
    below = _below(leg, last)
    if not below:
        return None
    slide = leg.joints[below[0]]
    if rod or len(below) > 1 or slide.kind is not JointKind.PRISMATIC or _below(leg, below[0]):
        raise _no_form(leg, f"joint '{slide.name}' is not the slide at the end of a leg")
    return below[0]


def _require_right_angles(leg: Leg, pointer: _Pointer) -> None:
    """Refuse a line that its hinges do not turn as the closed form has it."""
    first, last = leg.joints[pointer.turns[0]], leg.joints[pointer.turns[-1]]
    if pointer.spin is not None:
        hinge = leg.joints[pointer.spin]
        off = max(np.abs(hinge.translation).max(), np.abs(np.cross(hinge.axis, pointer.line)).max())
        if off > _ROUND_OFF:
            raise _no_form(leg, f"hinge '{hinge.name}' does not stand along the line to its end")
    if pointer.planar(leg) and abs(pointer.line @ first.axis) > _ROUND_OFF:
        raise _no_form(leg, f"it does not stay in the plane of hinge '{first.name}'")
    if len(pointer.turns) == 2 and abs(_turned_line(leg, pointer) @ last.axis) > _ROUND_OFF:
        raise _no_form(leg, f"it does not stand at right angles to the axis of '{last.name}'")


def _turned_line(leg: Leg, pointer: _Pointer) -> FloatArray:
    """Line in the body of the last of the joints that turn it."""
    return pointer.line if pointer.spin is None else leg.joints[pointer.spin].rotation @ pointer.line


def _line(leg: Leg, slide: int | None, end: LegEnd) -> tuple[FloatArray, float]:
    """Direction from the centre to the end, and how far along it the end is with the slide at 0.

    The direction is reversed where the slide's home is on its negative side, so that the distance is positive.
    """
    if slide is None:
        length = float(np.linalg.norm(end.point))
        if not length:
            raise _no_form(leg, "its rod has no length")
        line, offset = end.point / length, length
    else:
        joint = leg.joints[slide]
        line = joint.rotation @ joint.axis
        reach = joint.translation + joint.rotation @ end.point
        offset = float(line @ reach)
        if np.abs(reach - offset * line).max() > _ROUND_OFF:
            raise _no_form(leg, f"slide '{joint.name}' does not pass through the point where the leg turns")
        if offset + float(leg.home[slide][0]) < 0:
            line, offset = -line, -offset
    return line, offset


def _point(
    leg: Leg, pointer: _Pointer, target: ca.SX, moved: dict[int, JointPlacement], values: dict[int, ca.SX]
) -> None:
    """Turn a pointer towards its target, given in axes of the body that carries it."""
    first = leg.joints[pointer.turns[0]]
    target = _into(first, target)
    x_axis, y_axis, z_axis, tilt = _triad(leg, pointer)
    x, y, z = (ca.dot(constant(axis), target) for axis in (x_axis, y_axis, z_axis))
    across = y * y + z * z
    height = ca.sqrt(across)
    if len(pointer.turns) == 2 and _home_tilt(leg, pointer, tilt) < 0:
        height = -height
    length = ca.sqrt(x * x + across) if pointer.slide is not None else ca.SX(pointer.offset)
    # u = sin ψ X + cos ψ (-sin θ Y + cos θ Z)
    cos1, sin1, cos2, sin2 = z / height, -y / height, height / length, x / length
    none = ca.SX.zeros(3)
    if len(pointer.turns) == 1:
        turn = turn_about(x_axis, cos1, sin1) @ turn_about(y_axis, cos2, sin2)
        moved[pointer.turns[0]] = turn, none
    else:
        one, two = pointer.turns
        # The second hinge turns by ψ less the angle at which the line stands when it is at zero.
        turned = cos2 * np.cos(tilt) + sin2 * np.sin(tilt), sin2 * np.cos(tilt) - cos2 * np.sin(tilt)
        if abs(tilt) < _ROUND_OFF:
            turned = cos2, sin2
        moved[one] = turn_about(x_axis, cos1, sin1), none
        moved[two] = turn_about(leg.joints[two].axis, *turned), none
        values[one], values[two] = ca.vertcat(cos1, sin1), ca.vertcat(*turned)
    if pointer.spin is not None:
        joint, angle = leg.joints[pointer.spin], float(leg.home[pointer.spin][0])
        moved[pointer.spin] = turn_about(joint.axis, ca.SX(np.cos(angle)), ca.SX(np.sin(angle))), none
    if pointer.slide is not None:
        _slide(leg, pointer, pointer.slide, length, moved, values)


def _point_in_plane(
    leg: Leg, pointer: _Pointer, target: ca.SX, moved: dict[int, JointPlacement], values: dict[int, ca.SX]
) -> None:
    """Turn a pointer on one hinge towards its target; what is out of its plane is left out."""
    joint = leg.joints[pointer.turns[0]]
    target = _into(joint, target)
    x = ca.dot(constant(pointer.line), target)
    y = ca.dot(constant(np.cross(joint.axis, pointer.line)), target)
    length = ca.sqrt(x * x + y * y) if pointer.slide is not None else ca.SX(pointer.offset)
    cosine, sine = x / length, y / length
    moved[pointer.turns[0]] = turn_about(joint.axis, cosine, sine), ca.SX.zeros(3)
    values[pointer.turns[0]] = ca.vertcat(cosine, sine)
    if pointer.slide is not None:
        _slide(leg, pointer, pointer.slide, length, moved, values)


def _slide(
    leg: Leg,
    pointer: _Pointer,
    slide: int,
    length: ca.SX,
    moved: dict[int, JointPlacement],
    values: dict[int, ca.SX],
) -> None:
    joint = leg.joints[slide]
    position = _sign(leg, pointer, slide) * (length - pointer.offset)
    moved[slide] = ca.SX.eye(3), constant(joint.axis) * position
    values[slide] = position


def _sign(leg: Leg, pointer: _Pointer, slide: int) -> float:
    joint = leg.joints[slide]
    return float(pointer.line @ joint.rotation @ joint.axis)


def _triad(leg: Leg, pointer: _Pointer) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Axes X, Y, Z in the frame of the first joint, and the angle about Y from Z to the line at zero joint values."""
    first = leg.joints[pointer.turns[0]]
    if len(pointer.turns) == 1:
        z_axis, x_axis, y_axis = orthonormal_triad(pointer.line)
        return x_axis, y_axis, z_axis, 0.0
    second = leg.joints[pointer.turns[1]]
    x_axis, y_axis = first.axis, second.rotation @ second.axis
    z_axis = np.cross(x_axis, y_axis)
    line = second.rotation @ _turned_line(leg, pointer)
    return x_axis, y_axis, z_axis, float(np.arctan2(line @ x_axis, line @ z_axis))


def _home_tilt(leg: Leg, pointer: _Pointer, tilt: float) -> float:
    return float(np.cos(float(leg.home[pointer.turns[1]][0]) + tilt))


def _crank(leg: Leg, stem: int, pointer: _Pointer, target: ca.SX) -> tuple[JointPlacement, ca.SX]:
    """Turn a crank until the rod reaches: A cos θ + B sin θ = k."""
    joint = leg.joints[stem]
    elbow = leg.joints[pointer.turns[0]].translation
    along = joint.axis * (joint.axis @ elbow)
    arm, side = elbow - along, np.cross(joint.axis, elbow)
    a, b = ca.dot(constant(arm), target), ca.dot(constant(side), target)
    rest = float(elbow @ elbow) - pointer.offset**2
    k = (ca.dot(target, target) + rest) / 2 - ca.dot(constant(along), target)
    square = a * a + b * b
    root = ca.sqrt(square - k * k)
    # At home, A sin θ - B cos θ is the root with its sign.
    angle = float(leg.home[stem][0])
    at_home = _home_target(leg, stem, pointer)
    if arm @ at_home * np.sin(angle) - side @ at_home * np.cos(angle) < 0:
        root = -root
    cosine, sine = (a * k - b * root) / square, (b * k + a * root) / square
    return (turn_about(joint.axis, cosine, sine), ca.SX.zeros(3)), ca.vertcat(cosine, sine)


def _rail(leg: Leg, stem: int, pointer: _Pointer, target: ca.SX) -> tuple[JointPlacement, ca.SX]:
    """Slide along a rail until the rod reaches."""
    joint = leg.joints[stem]
    reach = target - constant(leg.joints[pointer.turns[0]].translation)
    along = ca.dot(constant(joint.axis), reach)
    root = ca.sqrt(along * along + pointer.offset**2 - ca.dot(reach, reach))
    at_home = _home_target(leg, stem, pointer) - leg.joints[pointer.turns[0]].translation
    if float(leg.home[stem][0]) < joint.axis @ at_home:
        root = -root
    position = along + root
    return (ca.SX.eye(3), constant(joint.axis) * position), position


def _home_target(leg: Leg, stem: int, pointer: _Pointer) -> FloatArray:
    """Find the end of the first pointer at home, in the frame of the stem."""
    joint, value = leg.joints[stem], float(leg.home[stem][0])
    point = np.array(pointer.end.point)
    hinges = list(pointer.turns) if pointer.spin is None else [*pointer.turns, pointer.spin]
    for k in hinges[::-1]:
        hinge = leg.joints[k]
        point = hinge.translation + hinge.rotation @ (_home_turn(hinge, leg.home[k]) @ point)
    if joint.kind is JointKind.REVOLUTE:
        return _home_turn(joint, leg.home[stem]) @ point
    return point + joint.axis * value


def _home_turn(joint: TreeJoint, q: FloatArray) -> FloatArray:
    if joint.kind is JointKind.REVOLUTE:
        angle = float(q[0])
        cross = np.array(ca.DM(ca.evalf(skew(constant(joint.axis)))))
        return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    x, y, z, w = q
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross
