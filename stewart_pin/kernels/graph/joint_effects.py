"""What joints do by themselves, as expressions: springs, damping and dry friction, of the tree and of loops.

The rules are those of `stewart_pin.state.joint_effects`, the coordinates of loops those of
`stewart_pin.state.joint_coordinates`. Dry friction of a joint at rest opposes the motion that the acceleration starts;
where accelerations are asked for, that is no rule but a search, and the state is told by the output ``resting``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from stewart_pin.errors import UnsupportedError
from stewart_pin.kernels.graph.bodies import configuration_chart, efforts_of_wrenches
from stewart_pin.kernels.graph.loop_rows import Between, about_origin, frames_between
from stewart_pin.kernels.planning.joint_physics import has_friction, is_passive
from stewart_pin.kernels.planning.spatial import constant, rotation_constant, shared
from stewart_pin.kernels.planning.tree import LoopEnds
from stewart_pin.model.description import JointKind, physics_coordinates
from stewart_pin.model.joint_physics import JointPhysics
from stewart_pin.model.loop_rows import orthonormal_triad
from stewart_pin.tolerances import AT_REST, AT_REST_BESIDE, TAKES_PART
from stewart_pin.typing import FloatArray

if TYPE_CHECKING:
    from stewart_pin.kernels.graph.whole_tree import ClosedTree

_SMALL_ANGLE = 1e-4
"""Square of the tangent of half an angle below which the angle comes from a series: its fifth term is below 1e-17."""
_LENGTHS = ("length", "x", "y")


def spring_effort(physics: JointPhysics, x: ca.SX) -> ca.SX:
    """Express the effort of a spring and of a constant force.

    Parameters
    ----------
    physics
        Of the joint.
    x
        (1, 1) its position.

    Returns
    -------
    casadi.SX
        (1, 1), by Horner's rule.
    """
    apart, value = x - physics.rest, ca.SX(0)
    for coefficient in physics.polynomial[::-1]:
        value = value * apart + coefficient
    return value


def rotation_vector(quaternion: ca.SX) -> ca.SX:
    """Express the rotation vector of a quaternion, the shorter way round.

    Parameters
    ----------
    quaternion
        (4, 1) x, y, z, w of any length but none.

    Returns
    -------
    casadi.SX
        (3, 1) [rad]; to round-off near no rotation, derivatives too.
    """
    vector, w = quaternion[:3], quaternion[3]
    square = ca.dot(vector, vector)
    # A quaternion and its opposite are the same rotation: this one has w ≥ 0.
    side, cosine = ca.if_else(w < 0, -1, 1), ca.fabs(w)
    small = square < _SMALL_ANGLE * cosine * cosine
    # Either branch is finite where the other counts: what is not would spoil the derivatives of both.
    near = ca.if_else(small, cosine, 1)
    ratio = square / (near * near)
    series = (1 - ratio * (1 / 3 - ratio * (1 / 5 - ratio * (1 / 7 - ratio / 9)))) / near
    sine = ca.sqrt(ca.if_else(small, 1, square))
    return side * 2 * ca.if_else(small, series, ca.atan2(sine, cosine) / sine) * vector


def quaternion_of(rotation: ca.SX) -> ca.SX:
    """Express a quaternion of a rotation: of the four columns of 4 q qᵀ the largest.

    Parameters
    ----------
    rotation
        (3, 3).

    Returns
    -------
    casadi.SX
        (4, 1) x, y, z, w, of a length between 2 and 4.
    """
    r = rotation
    x, y, z = (1 + 2 * r[k, k] - ca.trace(r) for k in range(3))
    w = 1 + ca.trace(r)
    xy, xz, yz = r[1, 0] + r[0, 1], r[2, 0] + r[0, 2], r[2, 1] + r[1, 2]
    wx, wy, wz = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    columns = [(x, [x, xy, xz, wx]), (y, [xy, y, yz, wy]), (z, [xz, yz, z, wz])]
    most, best = w, [wx, wy, wz, w]
    for size, column in columns:
        best = [ca.if_else(size > most, new, old) for new, old in zip(column, best, strict=True)]
        most = ca.fmax(most, size)
    return ca.vertcat(*best)


# ----------------------------------------------------------------------------------------------------
# Coordinates of joints that close loops
# ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _OfLoop:
    """A coordinate of a loop: where it stands (1, 1), its rate per tangent velocity (nv, 1), what acts along it."""

    value: ca.SX
    column: ca.SX
    physics: JointPhysics
    length: bool

    def effort(self, v: ca.SX) -> ca.SX:
        """Tell what spring and damping do along it; angles are known up to whole turns, the nearest to rest counts."""
        x, physics = self.value, self.physics
        if not self.length:
            x = x - 2 * np.pi * ca.floor((x - physics.rest + np.pi) / (2 * np.pi))
        along = spring_effort(physics, x) if physics.pushes else ca.SX(0)
        return along - physics.damping * (self.column.T @ v) if physics.damping else along


def _coordinates(closed: ClosedTree) -> list[_OfLoop]:
    """List the coordinates of loops along which something acts."""
    tree, found = closed.tree, []
    for loop in tree.loops:
        for word, physics in zip(physics_coordinates(loop.kind), loop.physics, strict=False):
            if not physics:
                continue
            between = frames_between(loop, closed.at)
            for value, force, moment in _read(word, loop, between):
                # What has this power per rate of frame 2 has it of the joints: as the rows of the loops.
                to_body1 = -rotation_constant(loop.rotation1)
                to_body2 = rotation_constant(loop.rotation2) @ between.rotation.T
                wrench = ca.horzcat(force, moment)
                wrenches = {
                    body: about_origin(ca.vec(to_body @ wrench), arm)
                    for body, to_body, arm in (
                        (loop.body1, to_body1, between.arm),
                        (loop.body2, to_body2, constant(loop.translation2)),
                    )
                }
                column = efforts_of_wrenches(tree.joints, closed.at, wrenches, 1)
                found.append(_OfLoop(value, column, physics, word in _LENGTHS))
    return found


def _read(word: str, loop: LoopEnds, between: Between) -> list[tuple[ca.SX, ca.SX, ca.SX]]:
    """Tell positions, and their derivatives by translation and rotation of frame 2, (3, 1) each in frame 1."""
    rotation, t, none = between.rotation, between.translation, ca.SX(3, 1)
    a, b = (constant(axis) for axis in (loop.axis, loop.axis2))
    triad = orthonormal_triad(loop.axis)
    match word:
        case "length":
            return [(ca.dot(a, t), a, none)]
        case "x" | "y":
            across = constant(triad["xy".index(word) + 1])
            return [(ca.dot(across, t), across, none)]
        case "angle":
            x = constant(triad[1])
            return [_angle(loop, a, x, rotation @ x)]
        case "angle 1":
            return [_angle(loop, a, b, rotation @ b)]
        case "angle 2":
            # The rate of Rᵀ a is Rᵀ (a × ω), and the angle is counted from it.
            before = rotation.T @ a
            value, _, _ = _angle(loop, b, before, a)
            return [(value, none, ca.cross(a, rotation @ _by_direction(b, before)))]
        case "turn":
            turned = rotation_vector(quaternion_of(rotation))
            return [(turned[k], none, constant(np.eye(3)[k])) for k in range(3)]
    raise UnsupportedError(f"loop '{loop.name}': kernels know no coordinate '{word}'")


def _angle(loop: LoopEnds, axis: ca.SX, before: ca.SX, after: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Angle about an axis from one direction to another that frame 2 carries, both seen along the axis."""
    across = ca.dot(axis, ca.cross(before, after))
    along = ca.dot(before, after) - ca.dot(axis, before) * ca.dot(axis, after)
    return ca.atan2(across, along), ca.SX(3, 1), ca.cross(after, _by_direction(axis, after))


def _by_direction(axis: ca.SX, direction: ca.SX) -> ca.SX:
    """Differentiate the angle of a direction about an axis by the direction."""
    across = ca.cross(axis, direction)
    return across / ca.dot(across, across)


# ----------------------------------------------------------------------------------------------------
# Efforts of all joints of a tree
# ----------------------------------------------------------------------------------------------------


def joint_efforts(closed: ClosedTree, v: ca.SX, a: ca.SX | None) -> ca.SX | None:
    """Express what joints do by themselves.

    Parameters
    ----------
    closed
        Chain at its configuration.
    v
        (nv, 1) tangent velocity.
    a
        (nv, 1) acceleration, which tells where joints at rest are about to move; None: dry friction of joints at rest
        is left out, see `resting`.

    Returns
    -------
    casadi.SX or None
        (nv, 1) joint efforts; None where joints do nothing.
    """
    tree = closed.tree
    if is_passive(tree):
        return None
    own, efforts = _coordinates(closed), ca.SX(tree.nv, 1)
    for joint in tree.joints:
        if joint.physics.pushes:
            x = closed.q[joint.q]
            if joint.kind is JointKind.SPHERICAL:
                efforts[joint.v] -= joint.physics.stiffness[0] * rotation_vector(x)
            else:
                efforts[joint.v] += spring_effort(joint.physics, x)
        if joint.damping.any():
            efforts[joint.v] -= constant(joint.damping) * v[joint.v]
    for each in own:
        efforts += each.column * each.effort(v)
    rub = _rubbing(closed, own)
    if rub is not None:
        efforts -= rub.columns @ (rub.limits * _directions(closed, rub, v, a))
    return efforts


def resting(closed: ClosedTree, v: ca.SX) -> dict[str, ca.SX]:
    """Tell states from which no graph finds the acceleration: dry friction holds a joint, or lets it go.

    Parameters
    ----------
    closed
        Chain at its configuration.
    v
        (nv, 1) tangent velocity.

    Returns
    -------
    dict
        ``{"resting": (1, 1)}``, 1 where a joint with dry friction is at rest and 0 elsewhere; nothing without friction.
    """
    if not has_friction(closed.tree):
        return {}
    rub = _rubbing(closed, _coordinates(closed))
    assert rub is not None
    # What closed loops let nothing move does nothing.
    shares = np.abs(closed.values(rub.columns.T @ closed.motions)).max(axis=(0, 2), initial=0.0)
    able = np.flatnonzero(shares > TAKES_PART * rub.sizes).tolist()
    still = ca.logic_not(_moving(rub.columns.T @ v, v, rub.sizes, closed))[able]
    return {"resting": reduce(ca.fmax, ca.vertsplit(still))} if able else {}


def with_resting(derivatives: ca.Function, forward: ca.Function) -> ca.Function:
    """Let derivatives tell states in which they do not exist: the effort of a joint with dry friction jumps at rest.

    Parameters
    ----------
    derivatives
        Of inverse or forward dynamics.
    forward
        Forward dynamics of the same configuration and velocity.

    Returns
    -------
    casadi.Function
        With the output ``resting``, if forward dynamics has it.
    """
    if "resting" in derivatives.name_out() or "resting" not in forward.name_out():
        return derivatives
    inputs = derivatives.sx_in()
    at_rest = forward.call([*inputs[:2], ca.SX.zeros(*forward.size_in(2)), *inputs[3:]])
    outputs = dict(zip(derivatives.name_out(), derivatives.call(inputs), strict=True))
    outputs["resting"] = at_rest[forward.name_out().index("resting")]
    return shared(derivatives.name(), dict(zip(derivatives.name_in(), inputs, strict=True)), outputs)


def resting_among(names: Sequence[str], outputs: Sequence[ca.SX]) -> dict[str, ca.SX]:
    """Find what tells of joints at rest among outputs of a function.

    Parameters
    ----------
    names, outputs
        Of the function.

    Returns
    -------
    dict
        As `resting`.
    """
    return {name: value for name, value in zip(names, outputs, strict=True) if name == "resting"}


@dataclass(frozen=True, eq=False)
class _Rubbing:
    """Coordinates with dry friction: (nv, k) rates per tangent velocity, (k,) limits and natural sizes."""

    columns: ca.SX
    limits: FloatArray
    sizes: FloatArray


def _rubbing(closed: ClosedTree, own: list[_OfLoop]) -> _Rubbing | None:
    chain, tree = closed.chain, closed.tree
    if not has_friction(tree):
        return None
    friction = np.concatenate([joint.friction for joint in tree.joints])
    entries = np.flatnonzero(friction)
    loops = [each for each in own if each.physics.friction]
    columns = ca.horzcat(constant(np.eye(tree.nv)[:, entries]), *(each.column for each in loops))
    sizes = [chain.length_scale if each.length else 1.0 for each in loops]
    return _Rubbing(
        ca.sparsify(columns),
        np.array([*friction[entries], *(each.physics.friction for each in loops)]),
        np.array([*chain.tangent_scale[entries], *sizes]),
    )


def _directions(closed: ClosedTree, rub: _Rubbing, v: ca.SX, a: ca.SX | None) -> ca.SX:
    """Tell where each coordinate moves, or is about to: 1, -1, or 0 where it stays at rest, (k, 1)."""
    rates = rub.columns.T @ v
    moving = _moving(rates, v, rub.sizes, closed)
    found = ca.if_else(moving, ca.sign(rates), 0)
    if a is None:
        return found
    starting = rub.columns.T @ a + _bias(closed, rub.columns, v)
    starts = _moving(starting, a, rub.sizes, closed)
    return found + ca.if_else(ca.logic_and(ca.logic_not(moving), starts), ca.sign(starting), 0)


def _moving(rates: ca.SX, v: ca.SX, sizes: FloatArray, closed: ClosedTree) -> ca.SX:
    most = ca.norm_inf(v / constant(closed.chain.tangent_scale))
    return ca.fabs(rates) > constant(sizes) * ca.fmax(AT_REST, AT_REST_BESIDE * most)


def _bias(closed: ClosedTree, columns: ca.SX, v: ca.SX) -> ca.SX:
    """Accelerations of coordinates without any of the tangent: their columns turn along the velocity."""
    if not ca.depends_on(columns, closed.q):
        return ca.SX(columns.shape[1], 1)
    held = ca.SX.sym("v", *v.shape)
    along = configuration_chart(closed.tree.joints, closed.q) @ held
    bias = ca.jacobian(columns.T @ held, closed.q) @ along
    return ca.substitute(bias, held, v)
