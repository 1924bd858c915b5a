"""Recognise the legs of a platform: where each motor's leg meets the ground and the platform."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.errors import UnsupportedError
from stewart_pin.model.description import JointKind, Mechanism
from stewart_pin.typing import FloatArray

_ROUND_OFF = 1e-9
"""Two joint axes meet when they pass this close to each other, relative to one metre [m]."""


@dataclass(frozen=True, eq=False)
class _Edge:
    """A connection as seen from one of its two links: the joint's frame in this link and in the other one."""

    kind: JointKind
    name: str
    other: str
    here: pin.SE3
    there: pin.SE3


def leg_points(mechanism: Mechanism, motors: Sequence[str], platform: str) -> tuple[FloatArray, FloatArray]:
    """Find both ends of the leg that each motor drives.

    A leg is a prismatic motor between a joint that turns about one point of the ground and a joint that turns about
    one point of the platform; wherever the file cut the loop.

    Parameters
    ----------
    mechanism
        Description.
    motors
        Names of the motor joints.
    platform
        Name of the platform link.

    Returns
    -------
    base_points : numpy.ndarray
        (nu, 3) in the ground link's frame [m].
    platform_points : numpy.ndarray
        (nu, 3) in the platform link's frame [m].

    Raises
    ------
    UnsupportedError
        If a motor does not drive such a leg.
    """
    edges = _edges(mechanism)
    ends = {mechanism.root: [], platform: []}
    for motor in motors:
        joint = mechanism.joint(motor)
        if joint.kind is not JointKind.PRISMATIC:
            raise _no_leg(motor, f"it is {joint.kind}, not prismatic")
        found = [_follow(edges, motor, start, other, set(ends)) for start, other in _both_ways(joint)]
        reached = dict(found)
        if set(reached) != set(ends):
            raise _no_leg(motor, f"it does not lead from link '{mechanism.root}' to link '{platform}'")
        for link, point in reached.items():
            ends[link].append(point)
    return np.array(ends[mechanism.root]).reshape(-1, 3), np.array(ends[platform]).reshape(-1, 3)


def _both_ways(joint) -> tuple[tuple[str, str], tuple[str, str]]:
    return (joint.parent, joint.child), (joint.child, joint.parent)


def _edges(mechanism: Mechanism) -> dict[str, list[_Edge]]:
    edges: dict[str, list[_Edge]] = {link.name: [] for link in mechanism.links}
    one = pin.SE3.Identity()
    for joint in mechanism.joints:
        edges[joint.parent].append(_Edge(joint.kind, joint.name, joint.child, joint.placement, one))
        edges[joint.child].append(_Edge(joint.kind, joint.name, joint.parent, one, joint.placement))
    for loop in mechanism.loops:
        edges[loop.link1].append(_Edge(loop.kind, loop.name, loop.link2, loop.placement1, loop.placement2))
        edges[loop.link2].append(_Edge(loop.kind, loop.name, loop.link1, loop.placement2, loop.placement1))
    return edges


def _follow(
    edges: dict[str, list[_Edge]], motor: str, link: str, behind: str, ends: set[str]
) -> tuple[str, FloatArray]:
    """Walk from one side of the motor over joints about one point to the ground or the platform."""
    visited = {behind}
    point: FloatArray | None = None  # common point of the joints passed, in the current link
    while link not in ends:
        visited.add(link)
        onward = [edge for edge in edges[link] if edge.other not in visited and edge.name != motor]
        if len(onward) != 1:
            raise _no_leg(motor, f"{len(onward)} ways lead on from link '{link}'")
        edge = onward[0]
        if edge.kind is JointKind.FIXED:
            point = None if point is None else (edge.there * edge.here.inverse()).act(point)
        elif edge.kind in (JointKind.REVOLUTE, JointKind.SPHERICAL, JointKind.UNIVERSAL):
            here = np.array(edge.here.translation)
            if point is not None and np.linalg.norm(point - here) > _ROUND_OFF:
                raise _no_leg(motor, f"its joints do not turn about one point (joint '{edge.name}')")
            point = np.array(edge.there.translation)
        else:
            raise _no_leg(motor, f"joint '{edge.name}' is {edge.kind}")
        link = edge.other
    if point is None:
        raise _no_leg(motor, "it is fixed to its end")
    return link, point


def _no_leg(motor: str, reason: str) -> UnsupportedError:
    return UnsupportedError(
        f"motor '{motor}' does not drive a leg with a point-like joint at either end: {reason}; "
        "closed forms of hexapods need such legs, the other verbs do not"
    )
