"""The same mechanism with other masses, its ground free, joints locked, or its joints and loops attached elsewhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from stewart_pin.building.joints import with_physics_fields_of
from stewart_pin.building.loading import build_chain, require_link, with_fixed_link
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.model.description import Cable, Coupling, Joint, JointKind, Link, Loop, Mechanism
from stewart_pin.model.tree import build_tree, link_frame
from stewart_pin.model.unfolding import fixed_to
from stewart_pin.model.validation import is_massless, validate
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.configurations import as_pose
from stewart_pin.state.geometry_parameters import (
    Attachment,
    Displacement,
    GeometryParameter,
    geometry_parameters,
)
from stewart_pin.state.newton import close_loops
from stewart_pin.state.state import as_chain, as_configuration
from stewart_pin.typing import ArrayLike, Configuration, FloatArray


def replace_inertias(chain: ClosedChain, inertias: Mapping[str, pin.Inertia]) -> ClosedChain:
    """Give bodies other inertias.

    Parameters
    ----------
    chain
        Closed chain.
    inertias
        New inertia of each named body in its link frame [kg, m, kg m²].

    Returns
    -------
    ClosedChain
        Same links, joints, loops, motors and home.

    Raises
    ------
    InputError
        If a name is not that of a link with inertia, or a value is no inertia.
    MechanismError
        If an inertia is unphysical.
    """
    as_chain(chain)
    if not isinstance(inertias, Mapping):
        raise InputError(f"inertias must give an inertia to each name, got {type(inertias).__name__}")
    for name, inertia in inertias.items():
        if not isinstance(inertia, pin.Inertia):
            raise InputError(f"inertias['{name}'] must be a pinocchio.Inertia, got {type(inertia).__name__}")
    bodies = [link.name for link in chain.mechanism.links if link.inertia is not None]
    unknown = set(inertias) - set(bodies)
    if unknown:
        raise InputError(f"'{min(unknown)}' is no body; the bodies are: {', '.join(bodies)}")
    links = tuple(
        replace(link, inertia=inertias.get(link.name, link.inertia)) for link in chain.mechanism.links
    )
    mechanism = replace(chain.mechanism, links=links)
    validate(mechanism)
    rebuilt = replace(chain, mechanism=mechanism, model=build_tree(mechanism, chain.gravity))
    return with_physics_fields_of(chain, rebuilt)


def attach_payload(
    chain: ClosedChain,
    inertia: pin.Inertia,
    *,
    link: str | None = None,
    placement: pin.SE3 | None = None,
    name: str = "payload",
) -> ClosedChain:
    """Bolt a rigid body to a link.

    Parameters
    ----------
    chain
        Closed chain.
    inertia
        Mass, centre of mass and inertia about it in the payload's own frame [kg, m, kg m²].
    link
        Name of the link that carries it; default: the platform.
    placement
        Payload frame in that link; default: the link's frame.
    name
        Name of the new link.

    Returns
    -------
    ClosedChain
        Same joints, loops, motors, platform and home, and a link that is fixed to the carrier.

    Raises
    ------
    InputError
        If there is no such link, the name is taken, or the inertia is none.
    MechanismError
        If the inertia is unphysical.

    Examples
    --------
    >>> import numpy as np, pinocchio as pin, stewart_pin as stp
    >>> box = pin.Inertia(12.0, np.array([0.0, 0.0, 0.1]), 0.1 * np.eye(3))
    >>> chain = stp.attach_payload(stp.load("stewart"), box)
    >>> effort = stp.inverse_dynamics(chain, chain.q_home, np.zeros(chain.nv), np.zeros(chain.nv))
    """
    as_chain(chain)
    if not isinstance(inertia, pin.Inertia):
        raise InputError(f"inertia must be a pinocchio.Inertia, got {type(inertia).__name__}")
    mechanism, carrier = chain.described(), chain.platform_link if link is None else link
    require_link(mechanism, "link", carrier)
    placement = pin.SE3.Identity() if placement is None else as_pose("placement", placement)
    mechanism = with_fixed_link(mechanism, Link(name, inertia), carrier, placement)
    rebuilt = build_chain(mechanism, motors=chain.motors, platform=chain.platform, gravity=chain.gravity)
    return with_physics_fields_of(chain, rebuilt)


def massless_legs(chain: ClosedChain, *, point_platform: bool = False) -> ClosedChain:
    """Take the mass from every body but the ground, the platform and what is fixed to them.

    Parameters
    ----------
    chain
        Closed chain.
    point_platform
        Whether the platform's mass is gathered at the origin of the platform frame, without rotational inertia.

    Returns
    -------
    ClosedChain
        The mechanism of the simplified formula: all force comes from the platform.

    Raises
    ------
    UnsupportedError
        If the platform's mass is to be gathered, but no link that is fixed to the platform has an inertia.
    """
    as_chain(chain)
    bodies = {link.name: link.inertia for link in chain.mechanism.links if link.inertia is not None}
    ground, platform = (
        fixed_to(chain.mechanism, link) for link in (chain.mechanism.root, chain.platform_link)
    )
    inertias = {name: pin.Inertia.Zero() for name in bodies if name not in {*ground, *platform}}
    if point_platform:
        carriers = [name for name in platform if name in bodies]
        if not carriers:
            raise UnsupportedError(
                f"platform '{chain.platform}' has no <inertial>: there is no mass to gather"
            )
        mass = sum(bodies[name].mass for name in carriers)
        inertias |= {name: pin.Inertia.Zero() for name in carriers}
        origin = platform[carriers[0]].inverse().translation
        inertias[carriers[0]] = pin.Inertia(mass, origin, np.zeros((3, 3)))
    return replace_inertias(chain, inertias)


# ----------------------------------------------------------------------------------------------------
# The same mechanism with its ground set free: a robot on a ship, a satellite, a falling one
# ----------------------------------------------------------------------------------------------------

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
    return with_physics_fields_of(chain, rebuilt)


# ----------------------------------------------------------------------------------------------------
# The same mechanism with joints locked: fewer coordinates, the loops kept
#
# `pinocchio.buildReducedModel` knows nothing of loops; here the description itself is reduced, so that everything that
# works for a chain works for the smaller one.
# ----------------------------------------------------------------------------------------------------

_FLAT = 1e-9
"""Slope of a coupling, relative to its coefficients, at which its follower does not hold the joint that it follows."""


def lock_joints(chain: ClosedChain, joints: Sequence[str], q: ArrayLike | None = None) -> ClosedChain:
    """Lock joints of any kind where they stand at a configuration, and keep the loops.

    The coordinates of the smaller chain are those of the chain without the locked ones, in the same order; all names
    stay. A locked motor is no motor any more. A mechanism that cannot move any more is allowed: it is a structure, and
    its dynamics are statics.

    Parameters
    ----------
    chain
        Closed chain.
    joints
        Names of joints with one or more freedoms.
    q
        (nq,) configuration with closed loops; default: home [m, rad, unit quaternions].

    Returns
    -------
    ClosedChain
        The chain with fixed joints in place of the locked ones, its home at `q`.

    Raises
    ------
    InputError
        If a name is not that of a joint that moves, is given twice, or no joint would be left; if the loops are open.
    UnsupportedError
        If a locked joint follows another through a coupling that is stationary there, and so does not hold it.
    MechanismError
        If another joint stands beyond its limits at `q`, which is no home.

    Notes
    -----
    A coupling of a locked joint holds its partner: the row stays, and keeps the partner where it stands.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> chain = stp.lock_joints(stp.load("stewart"), ["leg1", "leg2", "leg3"])
    >>> chain.motors, chain.nv, stp.mobility(chain).dof
    (('leg4', 'leg5', 'leg6'), 21, 3)
    """
    as_chain(chain)
    locked = _names(chain, joints)
    q = _closed(chain, chain.q_home if q is None else as_configuration(chain, "q", q))
    mechanism = chain.described()
    data = pin.Data(chain.model)
    pin.framesForwardKinematics(chain.model, data, q)

    def fixed(joint: Joint) -> Joint:
        parent, child = (data.oMf[link_frame(chain.model, link)] for link in (joint.parent, joint.child))
        return Joint(joint.name, JointKind.FIXED, joint.parent, joint.child, parent.actInv(child))

    values = {
        name: q[joint.idx_q : joint.idx_q + joint.nq]
        for name, joint in zip(chain.model.names[1:], chain.model.joints[1:], strict=True)
    }
    smaller = replace(
        mechanism,
        joints=tuple(fixed(joint) if joint.name in locked else joint for joint in mechanism.joints),
        loops=tuple(_with_reel_locked(loop, locked, values) for loop in mechanism.loops),
        couplings=tuple(filter(None, (_with_locked(part, locked, values) for part in mechanism.couplings))),
        home={name: value for name, value in values.items() if name not in locked},
    )
    motors = [motor for motor in chain.motors if motor not in locked]
    rebuilt = build_chain(smaller, motors=motors, platform=chain.platform, gravity=chain.gravity)
    return with_physics_fields_of(chain, rebuilt)


def _names(chain: ClosedChain, joints: Sequence[str]) -> set[str]:
    moving = list(chain.model.names[1:])
    if isinstance(joints, str) or not isinstance(joints, Sequence):
        raise InputError(f"joints must be a sequence of joint names, got {joints!r}")
    for name in joints:
        if name not in moving:
            fixed = any(joint.name == name for joint in chain.mechanism.joints)
            raise InputError(
                f"joints name '{name}', which {'is fixed already' if fixed else 'is no joint'}; "
                f"the joints that move are: {', '.join(moving)}"
            )
    if len(set(joints)) != len(joints):
        raise InputError(f"joints name a joint twice: {list(joints)}")
    if len(joints) == len(moving):
        raise InputError(
            "joints name every joint that moves, so no mechanism would be left; leave one of them"
        )
    return set(joints)


def _closed(chain: ClosedChain, q: Configuration) -> Configuration:
    """Check that the loops are closed, and close them to round-off: locked joints leave no room for it later."""
    chain.at(q).require_closed()
    return close_loops(chain, q).q


def _with_reel_locked(loop: Loop, locked: set[str], values: dict[str, Configuration]) -> Loop:
    """Keep a cable as long as it is where its reel is locked."""
    if loop.cable.reel not in locked:
        return loop
    wound = loop.cable.ratio * float(values[str(loop.cable.reel)][0])
    return replace(loop, length=loop.length - wound, cable=Cable(radius=loop.cable.radius))


def _fewer_others(coupling: Coupling, locked: set[str], values: dict[str, Configuration]) -> Coupling:
    """Rewrite a coupling to a sum of joints, some of them locked, with at least one fewer besides the two."""
    terms = dict(coupling.others)
    constant, *powers = coupling.polynomial
    held = [name for name in terms if name in locked]
    if held:
        constant += sum(terms.pop(name) * float(values[name][0]) for name in held)
        return replace(coupling, polynomial=(constant, *powers), others=tuple(terms.items()))
    # One of the two is locked, and the first of the others takes its place.
    (other, ratio), *rest = coupling.others
    if coupling.joint1 in locked:
        # q1 = p(q2) + r q + ..., solved for q.
        shares = tuple(-power / ratio for power in powers)
        constant = (float(values[coupling.joint1][0]) - constant) / ratio
        return replace(
            coupling,
            joint1=other,
            polynomial=(constant, *shares),
            others=tuple((name, -share / ratio) for name, share in rest),
        )
    stands = float(np.polynomial.Polynomial(coupling.polynomial)(float(values[str(coupling.joint2)][0])))
    return replace(coupling, joint2=other, polynomial=(stands, ratio), others=tuple(rest))


def _with_locked(coupling: Coupling, locked: set[str], values: dict[str, Configuration]) -> Coupling | None:
    """Rewrite a coupling for the joints that are left: the partner of a locked joint stands still."""
    left = [name for name in coupling.joints if name not in locked]
    if len(left) == len(coupling.joints):
        return coupling
    if not left:
        return None
    if coupling.others:
        return _with_locked(_fewer_others(coupling, locked, values), locked, values)
    stands = float(values[left[0]][0])
    if left[0] == coupling.joint2:
        slope = np.polynomial.Polynomial(coupling.polynomial).deriv()(stands)
        sizes = np.abs(coupling.polynomial) * np.abs(stands) ** np.arange(len(coupling.polynomial))
        if abs(slope) <= _FLAT * sizes.max():
            raise UnsupportedError(
                f"joint '{coupling.joint1}' cannot be locked alone here: its coupling '{coupling.name}' is stationary "
                f"where joint '{left[0]}' stands at {stands:.6g}, and does not hold it; lock both, or elsewhere"
            )
    return Coupling(coupling.name, left[0], None, (stands,))


# ----------------------------------------------------------------------------------------------------
# The same mechanism with joints and loops attached elsewhere, as tolerances and calibration have it
# ----------------------------------------------------------------------------------------------------

_Moves = dict[tuple[str, Attachment], FloatArray]
"""(6,) shift and rotation vector of each place that moves."""


def displace_geometry(chain: ClosedChain, displacements: Mapping[GeometryParameter, float]) -> ClosedChain:
    """Attach joints and loops elsewhere.

    Parameters
    ----------
    chain
        Closed chain.
    displacements
        How far each of `geometry_parameters` is displaced [m or rad]; what is not named stays. The turns of a frame
        form one rotation vector.

    Returns
    -------
    ClosedChain
        Same links, masses, motors and platform; its home is the old one with the loops closed again.

    Raises
    ------
    InputError
        If a parameter is not one of the chain's, or a displacement is not finite.
    MechanismError
        If what results is no mechanism, as with a rod of negative length.
    ClosureError
        If the loops do not close any more, as where a planar mechanism is bent out of its plane.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> first = stp.build.geometry_parameters(chain)[0]
    >>> moved = stp.build.displace_geometry(chain, {first: 1e-3})
    """
    as_chain(chain)
    known = set(geometry_parameters(chain))
    moves: _Moves = {}
    if not isinstance(displacements, Mapping):
        raise InputError(
            f"displacements must give an amount to each parameter, got {type(displacements).__name__}"
        )
    for parameter, amount in displacements.items():
        if parameter not in known:
            raise InputError(
                f"{parameter} is no parameter of {chain.name}; stewart_pin.build.geometry_parameters lists them"
            )
        if not np.isfinite(amount):
            raise InputError(f"the displacement of {parameter} must be finite, got {amount}")
        place = moves.setdefault((parameter.owner, parameter.attachment), np.zeros(6))
        place[parameter.axis + (3 if parameter.displacement is Displacement.TURN else 0)] = amount
    mechanism = _moved(chain.mechanism, moves)
    validate(mechanism)
    moved = replace(chain, mechanism=mechanism, model=build_tree(mechanism, chain.gravity))
    moved = with_physics_fields_of(chain, moved)
    return replace(moved, q_home=close_loops(moved, chain.q_home).q)


def _moved(mechanism: Mechanism, moves: _Moves) -> Mechanism:
    def placed(placement: pin.SE3, owner: str, attachment: Attachment) -> pin.SE3:
        move = moves.get((owner, attachment))
        if move is None:
            return placement
        return pin.SE3(pin.exp3(move[3:]) @ placement.rotation, placement.translation + move[:3])

    joints = tuple(
        replace(joint, placement=placed(joint.placement, joint.name, Attachment.JOINT))
        for joint in mechanism.joints
    )
    loops = tuple(
        replace(
            loop,
            placement1=placed(loop.placement1, loop.name, Attachment.FRAME1),
            placement2=placed(loop.placement2, loop.name, Attachment.FRAME2),
            length=loop.length + float(moves.get((loop.name, Attachment.ROD), np.zeros(1))[0]),
        )
        for loop in mechanism.loops
    )
    return replace(mechanism, joints=joints, loops=loops)
