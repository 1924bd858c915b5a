"""The bodies of a hexapod, read off its chain for the closed form."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from stewart_pin.building.rotors import require_no_rotors
from stewart_pin.errors import UnsupportedError
from stewart_pin.geometry.hexapod import Hexapod
from stewart_pin.geometry.hexapod_bodies import HexapodBodies, LowerJoint, RigidBody
from stewart_pin.model.description import JointKind
from stewart_pin.model.fixed_links import fixed_to
from stewart_pin.model.tree import link_frame
from stewart_pin.state.chain import ClosedChain
from stewart_pin.typing import FloatArray

_SAME = 1e-9
"""Deviation of axes and leg ends from those of the closed form that is round-off, in leg lengths and radians."""


def hexapod_bodies(chain: ClosedChain) -> HexapodBodies:
    """Read platform, cylinders and rods off a chain.

    Parameters
    ----------
    chain
        Chain of six legs: universal lower joints with first axis base x and second axis leg y, or spherical ones with
        the leg as third axis, all as hinges through the foot. Frames of links, senses of axes and zeros of joints may
        be any.

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
    mechanism, model = chain.mechanism, chain.model
    data = pin.Data(model)
    pin.framesForwardKinematics(model, data, chain.q_home)
    platform = data.oMf[chain.platform_id]
    lower, upper, axes = [], [], set()
    for motor, foot, head in zip(chain.motors, hexapod.base_points, hexapod.platform_points, strict=True):
        joint = mechanism.joint(motor)
        end = platform.act(head)
        leg = _leg_axes(end - foot)
        axes.add(
            _lower_axes(chain, data, joint.parent, pin.SE3(leg, foot), float(np.linalg.norm(end - foot)))
        )
        lower.append(_rigid_body(chain, joint.parent, pin.SE3(leg, foot), data))
        upper.append(_rigid_body(chain, joint.child, pin.SE3(leg, end), data))
    known = {*fixed_to(mechanism, mechanism.root), chain.platform_link}
    known |= {
        name
        for motor in chain.motors
        for name in (mechanism.joint(motor).parent, mechanism.joint(motor).child)
    }
    others = [link.name for link in mechanism.links if link.inertia is not None and link.name not in known]
    if others:
        raise UnsupportedError(f"the closed form has no place for the bodies {', '.join(others)}")
    kinds: dict[tuple[str, ...], LowerJoint] = {("x", "y"): "universal", ("x", "y", "z"): "spherical"}
    if len(axes) != 1 or next(iter(axes)) not in kinds:
        raise UnsupportedError("the closed form needs lower joints with the axes x, y or x, y, z")
    return HexapodBodies(
        _rigid_body(chain, chain.platform_link, platform, data),
        tuple(lower),
        tuple(upper),
        kinds[next(iter(axes))],
    )


def _leg_axes(leg: FloatArray) -> FloatArray:
    """Turn Rx(α) Ry(β) with cos β > 0 that takes z along a leg."""
    z = leg / np.linalg.norm(leg)
    y = np.array([0.0, z[2], -z[1]])
    size = np.linalg.norm(y)
    if size < _SAME:
        raise UnsupportedError("a leg lies along base x, the first axis of its lower joint")
    return np.column_stack([np.cross(y / size, z), y / size, z])


def _rigid_body(chain: ClosedChain, name: str, at: pin.SE3, data: pin.Data) -> RigidBody:
    """Read a body in a frame that is fixed to it, given in the world at home."""
    inertia = chain.mechanism.link(name).inertia or pin.Inertia.Zero()
    there = at.actInv(data.oMf[link_frame(chain.model, name)])
    # A link that stands as the closed form has it keeps its numbers to the last bit.
    if not there.isIdentity(_SAME):
        inertia = inertia.se3Action(there)
    return RigidBody(inertia.mass, inertia.lever, inertia.inertia)


def _lower_axes(
    chain: ClosedChain, data: pin.Data, link: str, leg: pin.SE3, length: float
) -> tuple[str, ...]:
    """Axes of the joints from the ground to a link, such as ("x", "y"); "?" for any other.

    The first is compared with base x, the second and third with y and z of the leg.
    """
    parents = {joint.child: joint for joint in chain.mechanism.joints}
    found: list[tuple[FloatArray, FloatArray] | None] = []
    while link != chain.mechanism.root:
        joint = parents[link]
        if joint.kind is JointKind.REVOLUTE:
            frame = data.oMf[link_frame(chain.model, link)]
            found.insert(0, (frame.rotation @ joint.axis, frame.translation))
        elif joint.kind is not JointKind.FIXED:
            found.insert(0, None)
        link = joint.parent
    wanted = (("x", np.eye(3)[0]), ("y", leg.rotation[:, 1]), ("z", leg.rotation[:, 2]))
    names = ["?"] * len(found)
    for k, (hinge, (name, along)) in enumerate(zip(found, wanted, strict=False)):
        if hinge is None:
            continue
        axis, point = hinge
        off = np.linalg.norm(np.cross(axis, along))
        off += np.linalg.norm(np.cross(axis, leg.translation - point)) / length
        names[k] = name if off < _SAME else "?"
    return tuple(names)
