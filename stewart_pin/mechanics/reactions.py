"""What every joint and every loop transmits: forces and moments as vectors, for bearings, bolts and ball joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stewart_pin.brief import Brief
from stewart_pin.errors import InputError
from stewart_pin.mechanics.effort import Effort
from stewart_pin.mechanics.inverse_dynamics import inverse_dynamics
from stewart_pin.model.description import JointKind
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.outside import Wrenches, as_wrenches, with_outside
from stewart_pin.state.relative_motion import LoopEnds
from stewart_pin.state.row_derivatives import loop_wrench, reaction_forces
from stewart_pin.state.state import State, as_state
from stewart_pin.tolerances import NOTHING, TAKES_PART
from stewart_pin.typing import ArrayLike, FloatArray, Tangent

_BALANCE = 1e-6
"""Part of the joints' efforts, relative to the largest, that may be left over: that of another state leaves more."""
_NO_LOAD = 1e-9
"""Effort that is none at all, for a robot of masses near 1 kg [N or N m]."""


@dataclass(frozen=True, eq=False, repr=False)
class Reaction(Brief):
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
        Whether it is the only possible one. Redundant loops share their load in a way that only elasticity decides; a
        joint that no such choice loads is not concerned.
    """

    name: str
    source: str
    target: str
    point: FloatArray
    force: FloatArray
    moment: FloatArray
    unique: bool


def joint_reactions(
    chain: ClosedChain | State,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    effort: Effort | None = None,
    *,
    wrenches: Wrenches | None = None,
) -> tuple[Reaction, ...]:
    """Compute the wrench that each moving joint of the tree and each loop transmits, drives included.

    Parameters
    ----------
    chain
        Closed chain, or a state of it.
    q
        (nq,) configuration with closed loops, with a chain [m, rad, unit quaternions].
    v
        (nv,) tangent velocity, with a chain [m/s, rad/s].
    effort
        What `inverse_dynamics` answered for this state; default: what it answers, of a state with acceleration.
    wrenches
        {link: (6,)} what acts from outside, as in `inverse_dynamics`; the same that `effort` was computed under
        [N, N m].

    Returns
    -------
    tuple of Reaction
        The moving joints of the tree in the order of the model, then the loops. Along the free axis of a joint stands
        all that acts there: motor, gear, spring, damping and dry friction, less what its rotor takes. Dry friction of
        joints at rest is what the effort leaves to it, the least where that is not determined. Floating joints are left
        out where they transmit nothing.

    Raises
    ------
    InputError
        If the effort does not belong to this state and these wrenches: it leaves joints without balance.

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
    state = as_state(chain, q, v)
    outside = None if wrenches is None else as_wrenches(state.chain, wrenches)
    effort = inverse_dynamics(state, wrenches=wrenches) if effort is None else effort
    if not isinstance(effort, Effort):
        raise InputError(f"effort must be what inverse_dynamics answers, got {type(effort).__name__}")
    chain, model, data = state.chain, state.chain.mass_model, pin.Data(state.chain.model)
    q, v, unit = state.q, state.v, state.chain.mass_unit
    pin.computeJointJacobians(model, data, q)  # and placements in the world, which rnea leaves alone
    loops = reaction_forces(chain, q, effort.lambda_c / unit)
    forces = loops.forces if outside is None else with_outside(state, outside, loops.forces, unit)
    balance, carried_by = _tree_balance(state, data, effort.a, forces)
    balance = unit * (balance - loops.efforts)
    carried = float(np.abs(balance).max(initial=0.0))
    balance[chain.motor_index] -= effort.tau_motor
    own, effects = np.zeros((len(chain.loops), 6)), state.effects
    if effects is not None:
        balance -= effects.efforts(effort.a)
        held = _held_friction(state, effort.a, balance)
        balance -= held @ effects.rubbing.rows
        own = effects.loop_wrenches(effort.a, held)
        if own.any():
            _, carried_by = _tree_balance(
                state, data, effort.a, _with_loop_efforts(chain, data, forces, own / unit)
            )
    size = max(carried, float(np.abs(effort.lambda_c).max(initial=0.0)) * chain.length_scale, _NO_LOAD * unit)
    if np.abs(balance).max(initial=0.0) > max(_BALANCE * size, 2 * effort.residual):
        worst = int(np.argmax(np.abs(balance)))
        raise InputError(
            f"effort does not belong to this state: {balance[worst]:.3g} N or N m are left over at "
            f"'{chain.tangent_names[worst]}'; pass what inverse_dynamics answered for the same q and v, and the "
            "wrenches that it was given"
        )
    joints_unique, loops_unique = _uniqueness(state)
    reactions = []
    for number, name in enumerate(model.names):
        if number == 0 or (
            chain.mechanism.joint(name).kind is JointKind.FLOATING and not _resists(state, number)
        ):
            continue
        joint, placement = chain.mechanism.joint(name), data.oMi[number]
        force = pin.Force(unit * carried_by[number].vector)
        reactions.append(
            _reaction(name, joint.parent, joint.child, placement, force, unique=joints_unique[number])
        )
    return (*reactions, *_loop_reactions(chain, data, effort, own, loops_unique))


def _resists(state: State, number: int) -> bool:
    """Whether a joint has damping or dry friction."""
    if state.effects is None:
        return False
    joint = state.chain.model.joints[number]
    entries = slice(joint.idx_v, joint.idx_v + joint.nv)
    return bool(state.effects.damping[entries].any() or state.effects.friction[entries].any())


def _held_friction(state: State, a: Tangent, left: Tangent) -> FloatArray:
    """Find the dry friction (k,) of coordinates that stay at rest, to which an effort leaves joint efforts (nv,)."""
    assert state.effects is not None
    rub, scale = state.effects.rubbing, state.chain.tangent_scale
    friction, stays = np.zeros(len(rub.limits)), state.effects.directions(a) == 0
    if stays.any():
        limits = rub.limits[stays]
        pushes = (limits[:, None] * rub.rows[stays] * scale).T
        share = np.linalg.lstsq(pushes, left * scale, rcond=NOTHING)[0]
        friction[stays] = limits * np.clip(share, -1.0, 1.0)  # what is beyond belongs to another state
    return friction


def _with_loop_efforts(
    chain: ClosedChain, data: pin.Data, forces: pin.StdVec_Force, own: FloatArray
) -> pin.StdVec_Force:
    """Add what joints that close loops give, (loops, 6) on link 2 in frame 1, to forces on the joints of the tree."""
    total = pin.StdVec_Force()
    total.extend(forces)
    for k, wrench in enumerate(own):
        if wrench.any():
            ends, force = LoopEnds(chain, data, k), pin.Force(wrench)
            total[int(ends.joint2)] += ends.frame2.act(ends.placement.actInv(force))
            total[int(ends.joint1)] -= ends.frame1.act(force)
    return total


def _tree_balance(
    state: State, data: pin.Data, a: Tangent, forces: pin.StdVec_Force
) -> tuple[FloatArray, list[pin.Force]]:
    """Joint efforts (nv,) of the tree under forces on its bodies, and what every joint carries, by Newton and Euler."""
    chain = state.chain
    if state.base_motion is None:
        efforts = pin.rnea(chain.mass_model, data, state.q, state.v, a, forces)
        return np.array(efforts), list(data.f)
    ground = chain.moving_ground
    whole, on_ground = pin.Data(ground.model), pin.StdVec_Force()
    on_ground.extend([pin.Force.Zero(), *forces])
    motion = ground.state(state.base_motion, state.q, state.v, a)
    efforts = np.array(pin.rnea(ground.model, whole, *motion, on_ground))[6:]
    return efforts + np.array(chain.mass_model.armature) * a, list(whole.f)[1:]


def _uniqueness(state: State) -> tuple[list[bool], list[bool]]:
    """Of every tree joint and every loop, whether no self-stress of redundant rows loads it.

    A self-stress is a combination of reactions without efforts at the joints, Jᵀ λ = 0; the tree below a joint hands on
    what the loops do to the bodies beyond it.
    """
    chain, stress = state.chain, state.motions.redundant / state.chain.row_sizes[:, None]
    joints, loops = [True] * chain.model.njoints, [True] * len(chain.loops)
    if not stress.shape[1]:
        return joints, loops
    table, size = chain.loop_table, np.repeat([chain.length_scale, 1.0], 3)
    # Wrench on every body about the origin of loop 1's frame, the moment in robot sizes.
    centre = state.loops.origin2[0] if len(chain.loops) else np.zeros(3)
    wrench = state.row_wrenches[:, :, None] * stress[:, None, :]
    wrench[:, 3:] -= np.cross(centre[None, :, None], wrench[:, :3], axis=1)
    wrench = wrench * size[:, None]
    body = np.zeros((chain.model.njoints, 6, stress.shape[1]))
    for k, rows in enumerate(table.slices):
        total = wrench[rows].sum(axis=0)
        body[table.joint2[k]] += total
        body[table.joint1[k]] -= total
        loops[k] = bool(np.abs(stress[rows] * chain.row_sizes[rows, None]).max(initial=0.0) < TAKES_PART)
    coupling = table.coupling
    others = np.flatnonzero(coupling.ratios_v.any(axis=0))
    geared = {int(k) for k in (*coupling.v1, *coupling.v2, *others) if k >= 0}
    idle_gear = np.abs(stress[coupling.index]).max(initial=0.0) < TAKES_PART
    for number in range(chain.model.njoints - 1, 0, -1):
        joint = chain.model.joints[number]
        own = joint.nv == 1 and joint.idx_v in geared and not idle_gear
        joints[number] = bool(np.abs(body[number]).max() < TAKES_PART) and not own
        body[chain.model.parents[number]] += body[number]
    return joints, loops


def _loop_reactions(
    chain: ClosedChain, data: pin.Data, effort: Effort, own: FloatArray, unique: Sequence[bool]
) -> list[Reaction]:
    reactions = []
    for k, loop in enumerate(chain.loops):
        ends = LoopEnds(chain, data, k)
        wrench = loop_wrench(chain, k, ends, ends.displacement(), effort.lambda_c)[0] + own[k]
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
                unique=unique[k],
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
