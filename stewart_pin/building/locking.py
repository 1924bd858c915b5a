"""The same mechanism with joints locked: fewer coordinates, the loops kept.

`pinocchio.buildReducedModel` knows nothing of loops; here the description itself is reduced, so that everything that
works for a chain works for the smaller one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from stewart_pin.building.loading import build_chain
from stewart_pin.building.rotors import with_rotors_of
from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.model.description import Coupling, Joint, JointKind
from stewart_pin.model.tree import link_frame
from stewart_pin.state.chain import ClosedChain, as_configuration
from stewart_pin.state.newton import close_loops
from stewart_pin.state.state import as_chain
from stewart_pin.typing import ArrayLike, Configuration

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
        couplings=tuple(filter(None, (_with_locked(part, locked, values) for part in mechanism.couplings))),
        home={name: value for name, value in values.items() if name not in locked},
    )
    motors = [motor for motor in chain.motors if motor not in locked]
    rebuilt = build_chain(smaller, motors=motors, platform=chain.platform, gravity=chain.gravity)
    return with_rotors_of(chain, rebuilt)


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


def _with_locked(coupling: Coupling, locked: set[str], values: dict[str, Configuration]) -> Coupling | None:
    """Rewrite a coupling for the joints that are left: the partner of a locked joint stands still."""
    ends = [name for name in (coupling.joint1, coupling.joint2) if name is not None]
    left = [name for name in ends if name not in locked]
    if len(left) == len(ends):
        return coupling
    if not left:
        return None
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
