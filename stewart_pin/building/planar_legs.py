"""The three legs of a planar 3-RPR platform, read off its chain for the closed forms."""

from __future__ import annotations

import numpy as np

from stewart_pin.building.body_graph import BodyGraph, Edge
from stewart_pin.errors import UnsupportedError
from stewart_pin.geometry.planar import PlanarRPR
from stewart_pin.model.description import JointKind
from stewart_pin.state.chain import ClosedChain
from stewart_pin.tolerances import PRINTED
from stewart_pin.typing import FloatArray


def planar_rpr(chain: ClosedChain) -> PlanarRPR:
    """Read anchors and corners off a chain that moves in a plane, wherever that stands.

    Parameters
    ----------
    chain
        Closed chain of three legs, each a prismatic motor between a revolute joint on the ground and one on the
        platform, wherever the file cut the loops, and whatever the motors read: lengths are
        ``offset + sign * motor_positions`` with ``sign, offset = chain.leg_readings``.

    Returns
    -------
    PlanarRPR
        Legs in the order of the motors, and the plane. With the plane along xy of the world its frame is the world's,
        but for its height.

    Raises
    ------
    UnsupportedError
        If the chain is no such platform.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> chain = stp.load("rpr_planar")
    >>> sign, offset = chain.leg_readings
    >>> lengths = offset + sign * stp.motor_positions(chain, chain.q_home)
    >>> len(stp.planar_assembly_modes(stp.planar.planar_rpr(chain), lengths))
    4
    """
    graph = BodyGraph(chain)
    platform = graph.frames[chain.platform_link]
    if len(chain.motors) != 3:
        raise UnsupportedError(
            f"a planar 3-RPR platform has three motors, {chain.name} has {len(chain.motors)}"
        )
    hinges = [_leg(graph, motor) for motor in chain.motors]
    z = _across(hinges[0][0].axis, platform.rotation[:, 2])
    axes = _square(z)
    slack = PRINTED * chain.length_scale
    plane = np.eye(4)
    # The plane goes through the platform's origin, and its frame stands under that of the world.
    plane[:3, :3], plane[:3, 3] = axes, z * (z @ platform.translation)
    anchors, corners = [], []
    turned = platform.rotation.T @ axes @ _about_z(axes.T @ platform.rotation)
    for motor, (foot, head) in zip(chain.motors, hinges, strict=True):
        for hinge in (foot, head):
            if np.linalg.norm(np.cross(hinge.axis, z)) > PRINTED:
                raise _no_leg(
                    motor, f"joint '{hinge.name}' does not turn about the axis that the others turn about"
                )
        edge = graph.edge(motor)
        assert edge is not None
        across = np.cross(edge.axis, head.point - foot.point)
        if abs(edge.axis @ z) > PRINTED or abs(across @ z) > slack:
            raise _no_leg(motor, "it does not slide along the line between its hinges")
        anchors.append(axes[:, :2].T @ foot.point)
        corners.append(turned[:, :2].T @ platform.actInv(head.point))
    return PlanarRPR(np.array(anchors), np.array(corners), plane, turned)


def _across(axis: FloatArray, platform_z: FloatArray) -> FloatArray:
    """Direct an axis along the platform's z, or, where that stands otherwise, its first component up."""
    first = axis[np.abs(axis) > PRINTED][0]
    along = axis @ platform_z
    return axis * np.sign(along if abs(along) > 1 - PRINTED else first)


def _square(z: FloatArray) -> FloatArray:
    """Axes with a given z, and x as near to the world's as can be; to its y where that stands across."""
    near = np.eye(3)[0 if abs(z[0]) < 1 - PRINTED else 1]
    x = near - (near @ z) * z
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _about_z(rotation: FloatArray) -> FloatArray:
    """Turn about z that takes x as near as can be to a rotation's x, or to its y where that stands across."""
    flat = rotation[:2, 0] if np.linalg.norm(rotation[:2, 0]) > PRINTED else rotation[:2, 1]
    c, s = flat / np.linalg.norm(flat)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def _leg(graph: BodyGraph, motor: str) -> tuple[Edge, Edge]:
    """Hinges of a leg on the ground and on the platform."""
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
        ends[graph.across(onward[0], graph.body[link])] = onward[0]
    if set(ends) != {graph.ground, graph.platform}:
        raise _no_leg(motor, "it does not lead from the ground to the platform")
    return ends[graph.ground], ends[graph.platform]


def _no_leg(motor: str, reason: str) -> UnsupportedError:
    return UnsupportedError(
        f"motor '{motor}' does not drive a leg of a planar 3-RPR platform: {reason}; its closed forms need such legs, "
        "the other verbs do not"
    )
