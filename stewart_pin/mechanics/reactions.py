"""What every joint and every loop transmits: forces and moments as vectors, for bearings, bolts and ball joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.checks import as_array
from stewart_pin.closure.reaction_derivatives import loop_wrench, reaction_forces
from stewart_pin.closure.relative_motion import LoopEnds
from stewart_pin.errors import InputError
from stewart_pin.mechanics.effort import Effort
from stewart_pin.model.chain import ClosedChain, as_configuration
from stewart_pin.model.description import JointKind
from stewart_pin.typing import ArrayLike, FloatArray

_BALANCE = 1e-6
"""Part of the joints' efforts, relative to the largest, that may be left over: that of another state leaves more."""


@dataclass(frozen=True, eq=False)
class Reaction:
    """The wrench that one joint or loop transmits.

    Attributes
    ----------
    name
        Name of the joint or loop.
    source, target
        Links: what `source` does to `target`.
    point
        (3,) origin of the joint, or of loop frame 2, in the world [m].
    force
        (3,) in world axes [N].
    moment
        (3,) about `point`, in world axes [N m].
    unique
        Whether it is the only possible one: redundant loops share their load in a way that only elasticity decides.
    """

    name: str
    source: str
    target: str
    point: FloatArray
    force: FloatArray
    moment: FloatArray
    unique: bool


def joint_reactions(chain: ClosedChain, q: ArrayLike, v: ArrayLike, effort: Effort) -> tuple[Reaction, ...]:
    """Compute the wrench that each moving joint of the tree and each loop transmits, drives included.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration with closed loops [m, rad, unit quaternions].
    v
        (nv,) tangent velocity [m/s, rad/s].
    effort
        What `inverse_dynamics` answered for this state.

    Returns
    -------
    tuple of Reaction
        The moving joints of the tree in the order of the model, then the loops. A motor's effort is the component of
        its joint's wrench along the joint axis. Floating joints transmit nothing and are left out.

    Raises
    ------
    InputError
        If the effort does not belong to this state: it leaves joints without balance.

    Examples
    --------
    >>> import numpy as np, stewart_pin as stp
    >>> chain = stp.load("stewart")
    >>> rest = np.zeros(chain.nv)
    >>> effort = stp.inverse_dynamics(chain, chain.q_home, rest, rest)
    >>> parts = stp.joint_reactions(chain, chain.q_home, rest, effort)
    >>> len(parts)  # 18 joints of the legs, 6 balls
    24
    """
    q, v = as_configuration(chain, "q", q), as_array("v", v, (chain.nv,))
    model, data = chain.model, pin.Data(chain.model)
    pin.computeJointJacobians(model, data, q)  # and placements in the world, which rnea leaves alone
    loops = reaction_forces(chain, q, effort.lambda_c)
    balance = np.array(pin.rnea(model, data, q, v, effort.a, loops.forces)) - loops.efforts
    carried = float(np.abs(balance).max(initial=0.0))
    balance[chain.motor_index] -= effort.tau_motor
    size = max(carried, float(np.abs(effort.lambda_c).max(initial=0.0)) * chain.length_scale, 1e-9)
    if np.abs(balance).max(initial=0.0) > max(_BALANCE * size, 2 * effort.residual):
        worst = int(np.argmax(np.abs(balance)))
        raise InputError(
            f"effort does not belong to this state: {balance[worst]:.3g} N or N m are left over at "
            f"'{chain.tangent_names[worst]}'; pass what inverse_dynamics answered for the same q and v"
        )
    in_loop = _in_loops(chain)
    reactions = []
    for number, name in enumerate(model.names):
        if number == 0 or chain.mechanism.joint(name).kind is JointKind.FLOATING:
            continue
        joint, placement = chain.mechanism.joint(name), data.oMi[number]
        reactions.append(
            _reaction(
                name,
                joint.parent,
                joint.child,
                placement,
                data.f[number],
                unique=effort.reactions_unique or name not in in_loop,
            )
        )
    return (*reactions, *_loop_reactions(chain, data, effort))


def _loop_reactions(chain: ClosedChain, data: pin.Data, effort: Effort) -> list[Reaction]:
    reactions = []
    for k, loop in enumerate(chain.loops):
        ends = LoopEnds(chain, data, k)
        wrench, _ = loop_wrench(chain, k, ends, ends.displacement(), effort.lambda_c)
        # From the origin of frame 1 to that of frame 2.
        force, moment = wrench[:3], wrench[3:] - np.cross(ends.t, wrench[:3])
        frame1 = data.oMi[ends.joint1] * ends.frame1
        here = pin.SE3(frame1.rotation, frame1.act(ends.t))
        reactions.append(
            _reaction(
                loop.name,
                loop.link1,
                loop.link2,
                here,
                pin.Force(force, moment),
                unique=effort.reactions_unique,
            )
        )
    return reactions


def _reaction(
    name: str, source: str, target: str, placement: pin.SE3, force: pin.Force, *, unique: bool
) -> Reaction:
    turn = placement.rotation
    return Reaction(
        name,
        source,
        target,
        np.array(placement.translation),
        turn @ force.linear,
        turn @ force.angular,
        unique,
    )


def _in_loops(chain: ClosedChain) -> set[str]:
    """Joints that carry a share of loop reactions: those between either end of a loop and the ground."""
    found: set[str] = set()
    for joint in {*chain.loop_table.joint1, *chain.loop_table.joint2}:
        while joint:
            found.add(chain.model.names[joint])
            joint = chain.model.parents[joint]
    return found
