"""The bodies of a hexapod, read off its chain for the closed form."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from stewart_pin.building.rotors import require_no_rotors
from stewart_pin.errors import UnsupportedError
from stewart_pin.geometry.hexapod import Hexapod
from stewart_pin.geometry.hexapod_bodies import HexapodBodies, LowerJoint, RigidBody
from stewart_pin.model.fixed_links import fixed_to
from stewart_pin.model.tree import link_frame
from stewart_pin.state.chain import ClosedChain

_SAME = 1e-9
"""Deviation between the link frames and the leg frames of the closed form that is round-off [m and 1]."""


def hexapod_bodies(chain: ClosedChain) -> HexapodBodies:
    """Read platform, cylinders and rods off a chain.

    Parameters
    ----------
    chain
        Chain of six legs, as `hexapod_chain` builds them: universal lower joints with first axis base x and second
        axis leg y, or spherical ones with the leg as third axis; links with their z axis along the leg.

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
        leg = platform.act(head) - foot
        for link, origin in ((joint.parent, foot), (joint.child, platform.act(head))):
            frame = data.oMf[link_frame(model, link)]
            off = np.linalg.norm(frame.translation - origin) + np.linalg.norm(
                frame.rotation[:, 2] - leg / np.linalg.norm(leg)
            )
            if off > _SAME:
                raise UnsupportedError(
                    f"link '{link}' has not its origin at the leg end and its z axis along the leg"
                )
        axes.add(_lower_axes(chain, joint.parent))
        lower.append(_rigid_body(chain, joint.parent))
        upper.append(_rigid_body(chain, joint.child))
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
        _rigid_body(chain, chain.platform_link), tuple(lower), tuple(upper), kinds[next(iter(axes))]
    )


def _rigid_body(chain: ClosedChain, name: str) -> RigidBody:
    inertia = chain.mechanism.link(name).inertia or pin.Inertia.Zero()
    return RigidBody(inertia.mass, inertia.lever, inertia.inertia)


def _lower_axes(chain: ClosedChain, link: str) -> tuple[str, ...]:
    """Axes of the joints from the ground to a link, such as ("x", "y"); "?" for any other."""
    parents = {joint.child: joint for joint in chain.mechanism.joints}
    axes: list[str] = []
    while link != chain.mechanism.root:
        joint = parents[link]
        turned = not np.array_equal(joint.placement.rotation, np.eye(3))
        if joint.kind == "fixed" and not turned:
            link = joint.parent
            continue
        names = [
            name for name, axis in zip("xyz", np.eye(3), strict=True) if np.array_equal(joint.axis, axis)
        ]
        axes.insert(0, "?" if turned or not names or joint.kind != "revolute" else names[0])
        link = joint.parent
    return tuple(axes)
