"""The bodies of a hexapod, read off its chain for the closed form."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from stewart_pin.building.body_graph import BodyGraph, Edge
from stewart_pin.building.rotors import require_no_rotors
from stewart_pin.errors import UnsupportedError
from stewart_pin.geometry.hexapod import Hexapod
from stewart_pin.geometry.hexapod_bodies import HexapodBodies, LowerJoint, RigidBody
from stewart_pin.model.description import JointKind
from stewart_pin.state.chain import ClosedChain
from stewart_pin.tolerances import PRINTED
from stewart_pin.typing import FloatArray

_SAME = 1e-9
"""Deviation of a link from where the closed form has it that is round-off, in leg lengths and radians."""


def hexapod_bodies(chain: ClosedChain) -> HexapodBodies:
    """Read platform, cylinders and rods off a chain.

    Parameters
    ----------
    chain
        Chain of six legs: lower joints universal with the second axis square to the leg, or balls, or three hinges
        through the foot. Frames of links, senses of axes and zeros of joints may be any, and so may be the base's
        frame and the cut of the loops.

    Returns
    -------
    HexapodBodies
        Bodies in the frames that the closed form expects [kg, m, kg m²].

    Raises
    ------
    UnsupportedError
        If the chain is no such hexapod, or has further bodies or rotors.
    """
    require_no_rotors(chain, "the closed form")
    hexapod = Hexapod.from_chain(chain)
    graph = BodyGraph(chain)
    platform = graph.frames[chain.platform_link]
    lower, upper, firsts, kinds = [], [], [], set()
    known = {graph.ground, graph.platform}
    for motor, foot, head in zip(chain.motors, hexapod.base_points, hexapod.platform_points, strict=True):
        end = platform.act(head)
        below, above, hinges = _parts(graph, motor)
        kind, first = _lower_joint(motor, hinges, end - foot)
        leg = _leg_axes(end - foot, first)
        lower.append(_rigid_body(chain, graph, below, pin.SE3(leg, foot)))
        upper.append(_rigid_body(chain, graph, above, pin.SE3(leg, end)))
        firsts.append(first)
        kinds.add(kind)
        known |= {below, above}
    others = sorted({graph.body[link.name] for link in chain.mechanism.links if link.inertia} - known)
    if others:
        raise UnsupportedError(f"the closed form has no place for the bodies {', '.join(others)}")
    if len(kinds) != 1:
        raise UnsupportedError("the closed form needs legs whose lower joints are all of one kind")
    body = _rigid_body(chain, graph, graph.platform, platform)
    return HexapodBodies(body, tuple(lower), tuple(upper), kinds.pop(), np.array(firsts))


def _leg_axes(leg: FloatArray, first: FloatArray) -> FloatArray:
    """Axes of a leg frame as columns: z along the leg, y square to it and to the first axis of the lower joint."""
    z = leg / np.linalg.norm(leg)
    y = np.cross(z, first)
    size = np.linalg.norm(y)
    if size < _SAME:
        raise UnsupportedError("a leg lies along the first axis of its lower joint")
    return np.column_stack([np.cross(y / size, z), y / size, z])


def _parts(graph: BodyGraph, motor: str) -> tuple[str, str, list[Edge]]:
    """Find the bodies below and above a motor, and the joints from the ground to the lower one."""
    slide = graph.edge(motor)
    assert slide is not None  # it drives a leg
    sides: dict[str, tuple[str, list[Edge]]] = {}
    for start in (graph.body[link] for link in slide.links):
        body, path = start, [slide]
        while body not in (graph.ground, graph.platform):
            path.append(graph.onward(body, path[-1])[0])
            body = graph.across(path[-1], body)
        sides[body] = start, path[:0:-1]
    below, hinges = sides[graph.ground]
    return below, sides[graph.platform][0], hinges


def _lower_joint(motor: str, hinges: list[Edge], leg: FloatArray) -> tuple[LowerJoint, FloatArray]:
    """Tell the kind of a lower joint, and its first axis with the first component that is not zero positive."""
    match [edge.kind for edge in hinges]:
        case [JointKind.REVOLUTE, JointKind.REVOLUTE]:
            lean = max(abs(hinges[1].axis @ leg) / np.linalg.norm(leg), abs(hinges[1].axis @ hinges[0].axis))
            if lean > PRINTED:
                raise UnsupportedError(
                    f"the closed form needs lower joints whose second axis is square to leg and first axis; that of "
                    f"'{motor}' leans by {lean:.3g} rad"
                )
            kind: LowerJoint = "universal"
        case [JointKind.REVOLUTE, JointKind.REVOLUTE, JointKind.REVOLUTE]:
            kind = "spherical"
        case [JointKind.SPHERICAL]:
            # A ball has no axes: any that is not along the leg names the leg frame.
            return "spherical", np.eye(3)[int(np.argmin(np.abs(leg)))]
        case others:
            raise UnsupportedError(
                f"the closed form needs universal or spherical lower joints, '{motor}' has "
                f"{', '.join(others) or 'none'}"
            )
    axis = hinges[0].axis
    return kind, axis * np.sign(axis[np.abs(axis) > PRINTED][0])


def _rigid_body(chain: ClosedChain, graph: BodyGraph, body: str, at: pin.SE3) -> RigidBody:
    """Read a body, all links that are fixed to each other, in a frame that is given in the world at home."""
    whole = pin.Inertia.Zero()
    for link in chain.mechanism.links:
        if link.inertia is None or graph.body[link.name] != body:
            continue
        there = at.actInv(graph.frames[link.name])
        # A link that stands as the closed form has it keeps its numbers to the last bit.
        moved = link.inertia if there.isIdentity(_SAME) else link.inertia.se3Action(there)
        whole = moved if whole.mass == 0.0 else whole + moved
    return RigidBody(whole.mass, whole.lever, whole.inertia)
