"""The home configuration: as the file gives it, or found near it, with the loops closed and inside the joint limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin

from stewart_pin.building.body_graph import Part, part_of
from stewart_pin.building.home_within_limits import Stuck, bounded, guesses, search_within_limits
from stewart_pin.errors import MechanismError
from stewart_pin.model.description import JointKind, Note, Outcome
from stewart_pin.model.loop_table import independent_groups
from stewart_pin.model.tree import build_tree
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.configurations import clipped
from stewart_pin.state.limits import Excess, beyond_cones, in_configuration, moved_beyond, outside
from stewart_pin.state.newton import Closure, close_at_precision, polish
from stewart_pin.tolerances import HOME_IN_FILE
from stewart_pin.typing import Configuration, FloatArray

_ROUNDS = 10
"""Leaps by which joints of an assembled pose are carried inside their limits."""
_LEAP = 0.6
"""How far a joint of an assembled pose is moved at once towards its range, in robot sizes or radians."""
_ROUNDING = 0.02
"""Largest gap, in robot sizes or radians, that may be rounding if somebody says so."""


def settle_home(chain: ClosedChain) -> ClosedChain:
    """Close the loops at home; the report tells which joints without a coordinate are beyond their limits there.

    The description's home is closed by the shortest way. Joints that it does not name are searched for: from the
    neutral configuration moved inside the joint limits, by bounded least squares, and then from seeded random ones.
    Each group of loops that share no joint is closed for itself; joints in no loop stay where they are. A home that is
    only a guess is searched for from there.

    Parameters
    ----------
    chain
        Chain whose home is a guess.

    Returns
    -------
    ClosedChain
        The same chain with a home at which every loop closes.

    Raises
    ------
    MechanismError
        If the loops do not close, or only beyond the joint limits, or with a loop's axes against each other.
    """
    return settle_parts(chain, settle_alone)


def settle_parts(
    chain: ClosedChain, settle: Callable[[ClosedChain], ClosedChain], size: float | None = None
) -> ClosedChain:
    """Find the home of each part of a chain that shares no loop with the others, as a chain of its own.

    Parameters
    ----------
    chain
        Chain whose home is a guess.
    settle
        Finds the home of a part, and may move its joints and loops.
    size
        Natural length of chains whose joints or loops were moved; default: that of the chain [m].

    Returns
    -------
    ClosedChain
        The same chain with a home at which every loop closes, and what the parts tell in its report.

    Raises
    ------
    MechanismError
        As `settle` does.
    """
    parts = _parts(chain)
    q, notes = _start(chain, parts)
    joints, loops = ({part.name: part for part in old} for old in (chain.mechanism.joints, chain.loops))
    moved = False
    for part in parts:
        settled = settle(part.chain)
        q[part.at] = settled.q_home
        told = settled.mechanism
        notes += told.notes[len(part.chain.mechanism.notes) :]
        if told.joints is not part.chain.mechanism.joints:
            moved = True
            joints |= {
                name: replace(joints[name], placement=told.joint(name).placement) for name in part.joints
            }
            loops |= {loop.name: loop for loop in told.loops}
    if moved:
        mechanism = replace(chain.mechanism, joints=tuple(joints.values()), loops=tuple(loops.values()))
        chain = replace(chain, mechanism=mechanism, model=build_tree(mechanism, chain.gravity))
        chain.__dict__["length_scale"] = size or chain.length_scale
    if not chain.mechanism.assembled:
        notes += _told_of(chain, q)
    notes += [
        Note(
            f"joint '{excess.joint}'", f"home is beyond its limits by {excess.by:.2g}: {excess}", Outcome.KEPT
        )
        for excess in chain.judge.positions(q)
    ]
    return chain.with_home(q, *notes)


def _parts(chain: ClosedChain) -> list[Part]:
    """Split a chain into loops and couplings that share no joint."""
    groups = independent_groups(chain.loop_table, chain.model)
    everything = Part(chain, np.arange(chain.nq), tuple(chain.model.names)[1:])
    if len(groups) == 1 and groups[0][1].all():
        return [everything]
    # A loop between links that nothing moves closes or not, whatever the others do: it goes with the first of them.
    still = [rows for rows, entries in groups if not entries.any()]
    moving = [(rows, entries) for rows, entries in groups if entries.any()]
    if not moving:
        return [everything] if still else []
    moving[0] = (np.logical_or.reduce([moving[0][0], *still]), moving[0][1])
    return [part_of(chain, rows, entries) for rows, entries in moving]


def _start(chain: ClosedChain, parts: list[Part]) -> tuple[Configuration, list[Note]]:
    """Where joints in no loop stay: where the file has them, or at the nearest value within their limits."""
    assembled = chain.mechanism.assembled
    guess = home_guess(chain, inside=not assembled)
    alone = np.ones(chain.nq, dtype=bool)
    for part in parts:
        alone[part.at] = False
    given = in_configuration(chain, _leeway(chain) < np.inf) & (not assembled)
    notes: list[Note] = []
    for excess in outside(chain, guess):
        at = chain.model.joints[chain.model.getJointId(excess.joint)].idx_q
        if alone[at] and given[at]:
            raise _wrong_home(chain, _stands_beyond(excess))
        if alone[at] and assembled:
            text = "home: the pose of the file is beyond its limits; it was moved to the nearest value within"
            notes.append(Note(f"joint '{excess.joint}'", text, Outcome.CHANGED))
    inside = np.clip(guess, chain.model.lowerPositionLimit, chain.model.upperPositionLimit)
    return np.where(alone & ~given, inside, guess), notes


# ----------------------------------------------------------------------------------------------------
# One part
# ----------------------------------------------------------------------------------------------------


def settle_alone(chain: ClosedChain, slack: float = HOME_IN_FILE) -> ClosedChain:
    """Find the home of a chain whose loops all share joints.

    Parameters
    ----------
    chain
        Chain whose home is a guess.
    slack
        How far closing the loops may move a joint that the home names, in robot sizes and radians.

    Returns
    -------
    ClosedChain
        The same chain with a home.

    Raises
    ------
    MechanismError
        As `settle_home`.
    """
    if chain.mechanism.assembled:
        return _settle_assembled(chain)
    leeway = _leeway(chain, slack)
    guess = home_guess(chain)
    direct = polish(chain, guess)
    fault = _fault(chain, guess, direct, leeway)
    if not fault and not beyond_cones(chain, direct.q).any():
        return chain.with_home(_inside(chain, guess, direct.q, leeway))
    found = search_within_limits(chain, guess, leeway)
    if isinstance(found, Stuck) and fault:
        raise _no_home(chain, guess, leeway, fault, found)
    return chain.with_home(direct.q if isinstance(found, Stuck) else found)


def near_home(chain: ClosedChain, precision: float, *, searching: bool) -> Configuration | None:
    """Find a configuration at which the loops close but for digits.

    Parameters
    ----------
    chain
        Chain whose loops all share joints, and whose home is a guess.
    precision
        Largest gap that digits may have left, in robot sizes and radians.
    searching
        Whether to search for one, as `settle_alone` does; otherwise only the nearest is tried.

    Returns
    -------
    numpy.ndarray or None
        (nq,) configuration inside the joint limits [m, rad, unit quaternions], or None where there is none.
    """
    leeway = _leeway(chain, max(HOME_IN_FILE, precision))
    assembled = chain.mechanism.assembled
    guess = home_guess(chain, inside=not assembled)
    near = close_at_precision(chain, guess, precision).state
    if near.largest_gap <= precision and not near.opposed():
        inside = assembled or not (moved_beyond(chain, guess, near.q, leeway) or outside(chain, near.q))
        if inside and (assembled or not beyond_cones(chain, near.q).any()):
            return near.q
    if assembled or not searching:
        return None
    found = search_within_limits(chain, guess, leeway, precision)
    return None if isinstance(found, Stuck) else found


def keep_home(chain: ClosedChain, q: Configuration) -> ClosedChain:
    """Set a home that was found by `near_home`; where it stands beyond limits, as a file may have it, carry it inside.

    Parameters
    ----------
    chain
        Chain whose loops all share joints, and whose home is a guess.
    q
        (nq,) configuration with closed loops [m, rad, unit quaternions].

    Returns
    -------
    ClosedChain
        The same chain with a home.
    """
    beyond = chain.mechanism.assembled and outside(chain, q)
    return _settle_assembled(chain) if beyond else chain.with_home(q)


def _settle_assembled(chain: ClosedChain) -> ClosedChain:
    """Carry joints that the file puts beyond their limits inside, the loops closed; stay where they do not allow it."""
    start = polish(chain, home_guess(chain, inside=False))
    if not start.success:
        raise MechanismError(
            f"no home configuration: the loops do not close where the file places its links: the gap is "
            f"{start.gap:.3g} m; correct the poses{_if_rounding(start)}",
            path=chain.mechanism.source,
            culprit="home",
        )
    beyond = outside(chain, start.q)
    if not beyond:
        return chain.with_home(start.q)
    q = _carry_inside(chain, start.q, [excess.joint for excess in beyond])
    found = outside(chain, q)
    worst = beyond[0].joint
    text = f"home: the pose of the file is beyond the limits of {len(beyond)} joints; " + (
        "they were moved inside" if not found else "the loops let them no further, and it stays there"
    )
    note = Note(f"joint '{worst}'", text, Outcome.CHANGED)
    return chain.with_home(start.q if found else q, note)


def _carry_inside(chain: ClosedChain, q: Configuration, joints: list[str]) -> Configuration:
    """Move joints towards their ranges in leaps, each closed again: long ones, to leave dead points behind."""
    entries = np.array([chain.model.joints[chain.model.getJointId(name)].idx_v for name in joints])
    longest = _LEAP * chain.tangent_scale[entries]
    target = clipped(chain, q)
    for _ in range(_ROUNDS):
        step = np.zeros(chain.nv)
        step[entries] = np.clip(pin.difference(chain.model, q, target)[entries], -longest, longest)
        closure = polish(chain, pin.integrate(chain.model, q, step))
        if not closure.success:
            return q
        q = closure.q
        if not outside(chain, q):
            return q
    return q


def home_guess(chain: ClosedChain, *, inside: bool = True) -> Configuration:
    """Assemble the home of the file; joints it does not name are neutral, or at the limit that is nearest to that.

    Parameters
    ----------
    chain
        Chain with a description.
    inside
        Whether joints that the home does not name are brought inside their limits.

    Returns
    -------
    numpy.ndarray
        (nq,) configuration, loops not yet closed [m, rad, unit quaternions].

    Raises
    ------
    MechanismError
        If a value has the wrong size.
    """
    q = pin.neutral(chain.model)
    q = np.clip(q, chain.model.lowerPositionLimit, chain.model.upperPositionLimit) if inside else q
    for name, values in chain.mechanism.home.items():
        if chain.mechanism.joint(name).kind is JointKind.FIXED:
            continue
        joint = chain.model.joints[chain.model.getJointId(name)]
        if len(values) != joint.nq:
            raise MechanismError(
                f"the home configuration gives joint '{name}' {len(values)} values, it has {joint.nq}",
                path=chain.mechanism.source,
                culprit=name,
            )
        q[joint.idx_q : joint.idx_q + joint.nq] = values
    return pin.normalize(chain.model, q)


def _leeway(chain: ClosedChain, slack: float = HOME_IN_FILE) -> FloatArray:
    """(nv,) how far closing may move each tangent entry, natural units: a slack where the home names its joint."""
    leeway = np.full(chain.nv, np.inf)
    if chain.mechanism.home_is_guess:
        return leeway
    for name, joint in zip(chain.model.names[1:], chain.model.joints[1:], strict=True):
        if name in chain.mechanism.home:
            leeway[joint.idx_v : joint.idx_v + joint.nv] = slack
    return leeway


def _fault(chain: ClosedChain, guess: Configuration, closure: Closure, leeway: FloatArray) -> str:
    """Say what keeps a configuration from being home."""
    if not closure.success:
        if "axes against each other" in closure.reason:
            loop = closure.reason.split("'")[1]
            return f"the frames of loop '{loop}' point against each other; turn one by half a turn"
        if not chain.loops:
            return (
                f"the couplings do not close together, off by {closure.gap:.3g} m or rad at least: "
                + ", ".join(f"'{coupling.name}'" for coupling in chain.couplings)
            )
        gaps = np.abs(closure.state.relative_gap)
        worst = max(range(len(chain.loops)), key=lambda k: gaps[chain.loop_table.slices[k]].max())
        loop = chain.loops[worst].name
        return f"the loops do not close, the smallest gap found is {closure.gap:.3g} m, at loop '{loop}'"
    moved = moved_beyond(chain, guess, closure.q, leeway)
    return moved or next(map(_stands_beyond, outside(chain, closure.q)), "")


def _no_home(
    chain: ClosedChain, guess: Configuration, leeway: FloatArray, fault: str, stuck: Stuck
) -> MechanismError:
    """Say why there is no home, by the best that can be had without limits, and which limits stand in the way."""
    smallest = min(polish(chain, guess), polish(chain, stuck.q), key=lambda c: c.gap)
    if "do not close" in fault:
        for trial in guesses(chain, guess, leeway == np.inf):
            closure = polish(chain, trial)
            own = _fault(chain, guess, closure, leeway)
            if closure.success and own:
                fault = own
                break
            smallest = min(smallest, closure, key=lambda c: c.gap)
        else:
            # Newton's method alone closes few large mechanisms from afar.
            loose = bounded(_unlimited(chain), guess, leeway, cones=False) if stuck.held else stuck
            closure = smallest if isinstance(loose, Stuck) else polish(chain, loose)
            fault = _fault(chain, guess, closure, leeway) or fault
    if stuck.held and "beyond its limits" in fault:
        held = ", ".join(f"'{name}'" for name in stuck.held)
        fault += (
            f"; within all limits a gap of {stuck.gap:.3g} m or rad is left, where those of {held} "
            "stand in the way"
        )
    if "do not close" in fault:
        fault += _if_rounding(smallest)
    return _wrong_home(chain, fault)


def _if_rounding(closure: Closure) -> str:
    """Offer to forgive a gap that may be rounding."""
    gap = closure.state.largest_gap
    return (
        f"; if that is rounding, load with closure_tolerance={2 * gap:.1g}, or more"
        if gap < _ROUNDING
        else ""
    )


def _unlimited(chain: ClosedChain) -> ClosedChain:
    old = chain.mechanism
    joints = tuple(replace(joint, lower=-np.inf, upper=np.inf) for joint in old.joints)
    mechanism = replace(old, joints=joints)
    return replace(chain, mechanism=mechanism, model=build_tree(mechanism, chain.gravity))


def _wrong_home(chain: ClosedChain, fault: str) -> MechanismError:
    return MechanismError(
        f"no home configuration: {fault}; correct {'the origins of the loops' if chain.loops else 'their numbers'}, or "
        "the home (<group_state name='home'> or keyframe of the file)",
        path=chain.mechanism.source,
        culprit="home",
    )


def _stands_beyond(excess: Excess) -> str:
    least, most = excess.allowed
    return f"joint '{excess.joint}' would stand at {excess.value:.6g}, beyond its limits {least:.6g} to {most:.6g}"


def _told_of(chain: ClosedChain, q: Configuration) -> list[Note]:
    """Tell in the report when home is another configuration than the file's, by digits or because that was a guess."""
    guess = chain.mechanism.home_is_guess
    leeway = np.full(chain.nv, HOME_IN_FILE) if guess else _leeway(chain)
    moved = moved_beyond(chain, home_guess(chain), q, leeway)
    why = "as loops and limits demand" if guess else "which the digits of the file explain"
    return [Note("home", f"{moved}, {why}", Outcome.CHANGED)] if moved else []


def _inside(chain: ClosedChain, guess: Configuration, q: Configuration, leeway: FloatArray) -> Configuration:
    """Bring joints that no home names inside their limits, where they are beyond by no more than digits cost."""
    free = leeway == np.inf
    named = {name for name, own in zip(chain.tangent_names, free, strict=True) if not own}
    if not {excess.joint for excess in chain.judge.positions(q)} - named:
        return q
    within = np.clip(q, chain.model.lowerPositionLimit, chain.model.upperPositionLimit)
    start = np.where(in_configuration(chain, free), within, guess)
    found = bounded(chain, start, leeway, cones=True)
    return q if isinstance(found, Stuck) else found
