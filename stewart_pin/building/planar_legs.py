"""The three legs of a planar 3-RPR platform, read off its chain for the closed forms."""

from __future__ import annotations

import numpy as np

from stewart_pin.building.body_graph import BodyGraph, Edge
from stewart_pin.errors import UnsupportedError
from stewart_pin.geometry.planar import PlanarRPR
from stewart_pin.model.description import JointKind
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import FloatArray

_ROUND_OFF = 1e-9
"""How far points and axes may be from the plane or the leg, in robot sizes: files print ten digits."""


def planar_rpr(chain: ClosedChain) -> PlanarRPR:
    """Read anchors and corners off a chain that moves in the xy plane of its base.

    Parameters
    ----------
    chain
        Closed chain of three legs, each a prismatic motor between a revolute joint on the ground and one on the
        platform, wherever the file cut the loops; motor positions are leg lengths.

    Returns
    -------
    PlanarRPR
        Legs in the order of the motors.

    Raises
    ------
    UnsupportedError
        If the chain is no such platform.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> chain = stp.load("rpr_planar")
    >>> modes = stp.planar_assembly_modes(stp.planar.planar_rpr(chain), stp.motor_positions(chain, chain.q_home))
    >>> len(modes)
    4
    """
    graph = BodyGraph(chain)
    platform = graph.frames[chain.platform_link]
    if len(chain.motors) != 3:
        raise UnsupportedError(
            f"a planar 3-RPR platform has three motors, {chain.name} has {len(chain.motors)}"
        )
    if np.linalg.norm(platform.rotation[:, 2] - [0, 0, 1]) > _ROUND_OFF:
        raise UnsupportedError(
            f"platform '{chain.platform_link}' has its z axis not along z of the base, across the plane"
        )
    anchors, corners = [], []
    for motor, position in zip(chain.motors, chain.q_home[chain.motor_q_index], strict=True):
        foot, head = _leg(graph, motor, _ROUND_OFF * chain.length_scale)
        length = float(np.linalg.norm((head - foot)[:2]))
        if abs(length - position) > _ROUND_OFF * chain.length_scale:
            raise _no_leg(motor, f"it stands at {position:.6g} where the leg is {length:.6g} m long")
        anchors.append(foot[:2])
        corners.append(platform.actInv(head)[:2])
    return PlanarRPR(np.array(anchors), np.array(corners))


def _leg(graph: BodyGraph, motor: str, slack: float) -> tuple[FloatArray, FloatArray]:
    """Hinges of a leg on the ground and on the platform, in the world."""
    edge = graph.edge(motor)
    if edge is None or edge.kind is not JointKind.PRISMATIC:
        raise _no_leg(
            motor, "nothing leads on from it" if edge is None else f"it is {edge.kind}, not prismatic"
        )
    ends: dict[str, Edge] = {}
    for link in edge.links:
        onward = graph.onward(graph.body[link], edge)
        if len(onward) != 1 or onward[0].kind is not JointKind.REVOLUTE:
            raise _no_leg(motor, f"link '{link}' is not held by one revolute joint")
        hinge = onward[0]
        if np.linalg.norm(np.cross(hinge.axis, [0, 0, 1])) > _ROUND_OFF:
            raise _no_leg(motor, f"joint '{hinge.name}' does not turn about z of the base")
        ends[graph.across(hinge, graph.body[link])] = hinge
    if set(ends) != {graph.ground, graph.platform}:
        raise _no_leg(motor, "it does not lead from the ground to the platform")
    foot, head = ends[graph.ground].point, ends[graph.platform].point
    miss = np.cross(edge.axis, (head - foot) * [1, 1, 0])
    if abs(edge.axis[2]) > _ROUND_OFF or np.linalg.norm(miss) > slack:
        raise _no_leg(motor, "it does not slide along the line between its hinges")
    return foot, head


def _no_leg(motor: str, reason: str) -> UnsupportedError:
    return UnsupportedError(
        f"motor '{motor}' does not drive a leg of a planar 3-RPR platform: {reason}; its closed forms need such legs, "
        "the other verbs do not"
    )
