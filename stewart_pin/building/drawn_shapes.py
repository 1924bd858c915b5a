"""What the bodies of a chain look like when no file says so: sticks between the points at which joints hold them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from stewart_pin.model.description import Joint, JointKind, Link, Loop
from stewart_pin.model.loop_rows import orthonormal_triad
from stewart_pin.model.shapes import DRAWN, Material, Shape, ShapeKind
from stewart_pin.model.unfolding import fixed_to
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import FloatArray

_SAME = 1e-6
"""Points nearer than this are one point, in robot sizes."""


def body_points(chain: ClosedChain) -> dict[str, FloatArray]:
    """Collect the points of every link.

    Where all joints meet in one point, as those of a spherical linkage, hinges hold the bodies along their axes, at
    `hinge_reach` from there.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    dict
        ``{link: (n, 3) points in the link frame [m]}``, each point once.
    """
    points = _held_points(chain, hinge_reach(chain))
    same = _SAME * chain.length_scale
    # A flange is the only far end that a last link has; a payload is no corner of a platform.
    for joint in chain.mechanism.joints:
        if _holds_nothing(chain, joint):
            points[joint.child].append(np.zeros(3))
            if len(_distinct(points[joint.parent], same)) < 2:
                points[joint.parent].append(np.array(joint.placement.translation))
    return {link: _distinct(found, same) for link, found in points.items()}


def hinge_reach(chain: ClosedChain) -> float:
    """Tell how far from their frames hinges are drawn, along their axes.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    float
        Zero; the size of the robot where every body that several joints or loops hold is held at one point [m].
    """
    held = [points for points in _held_points(chain, 0.0).values() if len(points) > 1]
    same = _SAME * chain.length_scale
    return chain.length_scale if held and all(len(_distinct(points, same)) == 1 for points in held) else 0.0


def off_centre(joint: Joint | Loop, reach: float) -> FloatArray:
    """Place the mark of a joint or loop in its own frame.

    Parameters
    ----------
    joint
        Joint or loop.
    reach
        What `hinge_reach` says [m].

    Returns
    -------
    numpy.ndarray
        (3,) point [m].
    """
    return reach * np.asarray(joint.axis) if joint.kind is JointKind.REVOLUTE else np.zeros(3)


def _held_points(chain: ClosedChain, reach: float) -> dict[str, list[FloatArray]]:
    """Collect where joints and loops hold each link to others, hinges off centre."""
    points: dict[str, list[FloatArray]] = {link.name: [] for link in chain.mechanism.links}
    for joint in chain.mechanism.joints:
        # A free body is held by nothing.
        if joint.kind is not JointKind.FLOATING and not _holds_nothing(chain, joint):
            points[joint.parent].append(np.array(joint.placement.act(off_centre(joint, reach))))
            points[joint.child].append(off_centre(joint, reach))
    for loop in chain.loops:
        points[loop.link1].append(np.array(loop.placement1.act(off_centre(loop, reach))))
        points[loop.link2].append(np.array(loop.placement2.act(off_centre(loop, reach))))
    return points


def _holds_nothing(chain: ClosedChain, joint: Joint) -> bool:
    """Tell whether a joint fixes a link that no other joint or loop holds, such as a payload or a frame."""
    held = {other.parent for other in chain.mechanism.joints}
    held |= {link for loop in chain.loops for link in (loop.link1, loop.link2)}
    return joint.kind is JointKind.FIXED and joint.child not in held


def _distinct(points: list[FloatArray], same: float) -> FloatArray:
    kept: list[FloatArray] = []
    for point in points:
        if all(np.linalg.norm(point - other) > same for other in kept):
            kept.append(point)
    return np.array(kept).reshape(-1, 3)


_STICK = 0.01
"""Radius of the simple shapes, in robot sizes."""
_GROUND, _PLATFORM, _BODY = (0.43, 0.43, 0.43, 1.0), (0.12, 0.47, 0.71, 1.0), (0.3, 0.3, 0.3, 1.0)


def with_drawn_shapes(chain: ClosedChain) -> ClosedChain:
    """Give bodies simple shapes where no link has any that can be seen: sticks between the points that hold them.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    ClosedChain
        The chain itself where a link has a visual; else with shapes whose names begin with `DRAWN`.
    """
    mechanism = chain.mechanism
    if any(link.visuals for link in mechanism.links):
        return chain
    points = body_points(chain)
    # Formats that call their ground so add a link of this name, to which the ground is fixed.
    still = fixed_to(mechanism, mechanism.root).keys() - {"world"}
    ground = still & {joint.parent for joint in mechanism.joints}
    for name in ground:
        points[name] = _distinct([np.zeros(3), *points[name]], _SAME * chain.length_scale)
    links = tuple(
        replace(link, visuals=_sticks(chain, link, points[link.name]))
        if link.inertia is not None or link.name in ground
        else link
        for link in mechanism.links
    )
    return replace(chain, mechanism=replace(mechanism, links=links))


def _sticks(chain: ClosedChain, link: Link, points: FloatArray) -> tuple[Shape, ...]:
    """One stick between two points, a star from the middle of more, a stick through the centre of mass from one."""
    radius = _STICK * chain.length_scale
    if len(points) == 1 and link.inertia is not None:
        points = np.array([points[0], 2 * np.array(link.inertia.lever) - points[0]])
    elif len(points) == 0:
        points = np.zeros((1, 3)) if link.inertia is None else np.array([link.inertia.lever])
    colour = (
        _GROUND
        if link.name in fixed_to(chain.mechanism, chain.mechanism.root)
        else _PLATFORM
        if link.name == chain.platform
        else _BODY
    )
    middle = points[0] if len(points) <= 2 else points.mean(axis=0)
    shapes: list[Shape] = []
    for number, end in enumerate(points if len(points) > 2 else points[-1:], start=1):
        along = end - middle
        length = float(np.linalg.norm(along))
        name = f"{DRAWN}{link.name}_{number}"
        if length > radius:
            normal, x, y = orthonormal_triad(along / length)
            turn = np.column_stack([x, y, normal])
            kind, sizes, place = ShapeKind.CYLINDER, (radius, length), pin.SE3(turn, (middle + end) / 2)
        else:
            kind, sizes, place = ShapeKind.SPHERE, (2 * radius,), pin.SE3(np.eye(3), end)
        shapes.append(Shape(kind, sizes, place, name, material=Material(rgba=colour)))
    return tuple(shapes)
