"""The same mechanism with its ground set free: a robot on a ship, a satellite, a falling one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from stewart_pin.building.loading import build_chain
from stewart_pin.building.rotors import with_rotors_of
from stewart_pin.errors import InputError
from stewart_pin.model.description import Joint, JointKind, Link
from stewart_pin.model.validation import is_massless
from stewart_pin.state.chain import ClosedChain, as_pose
from stewart_pin.state.state import as_chain
from stewart_pin.typing import ArrayLike

FLOATING_JOINT = "floating_base"
"""Name of the joint that `on_floating_base` adds."""


def on_floating_base(
    chain: ClosedChain,
    base_inertia: pin.Inertia | None = None,
    *,
    pose: pin.SE3 | None = None,
    gravity: ArrayLike | None = None,
) -> ClosedChain:
    """Hang the ground link of a chain on a joint with six freedoms and no motor.

    The new joint comes first: its seven coordinates (x y z, quaternion x y z w) and six rates ([v; ω] in base axes)
    stand before those of the chain. Inverse dynamics has no answer any more, because nothing holds the base; forward
    dynamics has.

    Parameters
    ----------
    chain
        Chain on the ground.
    base_inertia
        Inertia of the base in its link frame [kg, m, kg m²]; default: that of the ground link.
    pose
        Home placement of the base in the world; default: where the ground is.
    gravity
        (3,) acceleration of free fall in the world frame [m/s²]; default: that of the chain.

    Returns
    -------
    ClosedChain
        Same links, loops, motors, platform and home, on a free base.

    Raises
    ------
    InputError
        If the base has no mass, or a name that is needed is taken.

    Examples
    --------
    >>> import pinocchio as pin, numpy as np, stewart_pin as stp
    >>> bus = pin.Inertia(200.0, np.zeros(3), 20.0 * np.eye(3))
    >>> satellite = stp.on_floating_base(stp.load("arm_7r"), bus, gravity=(0, 0, 0))
    >>> satellite.nq, satellite.nv, satellite.nu
    (14, 13, 7)
    """
    as_chain(chain)
    mechanism = chain.described()
    root = mechanism.link(mechanism.root)
    inertia = root.inertia if base_inertia is None else base_inertia
    if inertia is not None and not isinstance(inertia, pin.Inertia):
        raise InputError(f"base_inertia must be a pinocchio.Inertia, got {type(inertia).__name__}")
    if inertia is None or is_massless(inertia):
        raise InputError(
            f"base_inertia is needed: the ground link '{root.name}' has no mass, and a free base must have some"
        )
    names = {link.name for link in mechanism.links} | {joint.name for joint in mechanism.joints}
    world = "world" if "world" not in names else "inertial"
    taken = {world, FLOATING_JOINT} & names
    if taken:
        raise InputError(f"the name '{min(taken)}' is taken in {mechanism.name}; rename that link or joint")
    pose = pin.SE3.Identity() if pose is None else as_pose("pose", pose)
    links = [replace(link, inertia=inertia) if link is root else link for link in mechanism.links]
    base = Joint(FLOATING_JOINT, JointKind.FLOATING, world, root.name, pin.SE3.Identity())
    floating = replace(
        mechanism,
        name=f"{mechanism.name}_floating",
        links=(Link(world), *links),
        joints=(base, *mechanism.joints),
        home={FLOATING_JOINT: np.array(pin.SE3ToXYZQUAT(pose)), **mechanism.home},
    )
    rebuilt = build_chain(
        floating,
        motors=chain.motors,
        platform=chain.platform,
        gravity=chain.gravity if gravity is None else gravity,
    )
    return with_rotors_of(chain, rebuilt)
