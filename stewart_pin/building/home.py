"""The home configuration: as the file gives it, or found, with the loops closed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pinocchio as pin

from stewart_pin.closure.configurations import clipped, limit_violations, random_configuration, unwound
from stewart_pin.closure.newton import Closure, System, close_loops, loop_system, solve
from stewart_pin.errors import MechanismError
from stewart_pin.model.chain import ClosedChain
from stewart_pin.model.description import JointKind, Mechanism, Note, Outcome
from stewart_pin.typing import Configuration, FloatArray

_ATTEMPTS = 16
"""Random configurations to start from."""
_ROUNDS = 10
"""How often loops and limits are met in turn from one start."""
_LEAP = 0.6
"""How far a joint of an assembled pose is moved at once towards its range, in robot sizes or radians."""
_CLOSED_IN_FILE = 1e-3
"""How far closing the loops may move a joint of a home printed with few digits, in robot sizes and radians; also how
far home may stand outside a joint limit. More is an error."""


def settle_home(chain: ClosedChain) -> ClosedChain:
    """Close the loops at home.

    The description's home is refined by Newton's method. Joints that it does not name are searched for, from the
    neutral configuration moved inside the joint limits and then from seeded random ones, while the others stay.
    A home that is only a guess is searched for from there.

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
    if chain.mechanism.assembled:
        return _settle_assembled(chain)
    given = _named_entries(chain)
    best, fault = np.inf, ""
    for guess in _guesses(chain, given):
        closure = _close(chain, guess, given)
        best = min(best, closure.gap)
        if closure.flipped:
            fault = (
                fault
                or f"the frames of loop '{closure.flipped}' point against each other; turn one by half a turn"
            )
        if not closure.success:
            continue
        q = closure.q
        found = _moved(chain, guess, q, given) or _beyond_limits(chain, q)
        if not found:
            return replace(chain, q_home=q, mechanism=_with_home_note(chain, q))
        fault = fault or found
    raise MechanismError(
        f"no home configuration: {fault or f'the loops do not close, the smallest gap found is {best:.3g} m'}; "
        "correct the origins of the loops, or the home (<group_state name='home'> or keyframe of the file)",
        path=chain.mechanism.source,
        culprit="home",
    )


def _settle_assembled(chain: ClosedChain) -> ClosedChain:
    """Carry joints that the file puts beyond their limits inside, the loops closed; stay where they do not allow it."""
    start = close_loops(chain, home_guess(chain, inside=False), throw=False)
    if not start.success:
        raise MechanismError(
            f"no home configuration: the loops do not close where the file places its links: the gap is "
            f"{start.gap:.3g} m; correct the poses",
            path=chain.mechanism.source,
            culprit="home",
        )
    outside = limit_violations(chain, start.q, _CLOSED_IN_FILE)
    if not outside:
        return replace(chain, q_home=start.q)
    q = _carry_inside(chain, start.q, list(outside))
    found = limit_violations(chain, q, _CLOSED_IN_FILE)
    worst = next(iter(outside))
    text = f"home: the pose of the file is beyond the limits of {len(outside)} joints; " + (
        "they were moved inside" if not found else "the loops let them no further, and it stays there"
    )
    note = Note(f"joint '{worst}'", text, Outcome.CHANGED)
    mechanism = replace(chain.mechanism, notes=(*chain.mechanism.notes, note))
    return replace(chain, q_home=start.q if found else q, mechanism=mechanism)


def _carry_inside(chain: ClosedChain, q: Configuration, joints: list[str]) -> Configuration:
    """Move joints towards their ranges in leaps, each closed again: long ones, to leave dead points behind."""
    entries = np.array([chain.model.joints[chain.model.getJointId(name)].idx_v for name in joints])
    longest = _LEAP * chain.tangent_scale[entries]
    target = clipped(chain, q)
    for _ in range(_ROUNDS):
        step = np.zeros(chain.nv)
        step[entries] = np.clip(pin.difference(chain.model, q, target)[entries], -longest, longest)
        closure = close_loops(chain, pin.integrate(chain.model, q, step), throw=False)
        if not closure.success:
            return q
        q = closure.q
        if not limit_violations(chain, q, _CLOSED_IN_FILE):
            return q
    return q


def home_guess(chain: ClosedChain, *, inside: bool = True) -> Configuration:
    """Assemble the home of the file; joints it does not name are neutral, or mid-way between their limits.

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
    q = clipped(chain, q) if inside else q
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
    if not pin.isNormalized(chain.model, q, 1e-3):
        raise MechanismError(
            "the home configuration holds a quaternion that is not of unit length",
            path=chain.mechanism.source,
            culprit="home",
        )
    return pin.normalize(chain.model, q)


def _named_entries(chain: ClosedChain) -> np.ndarray:
    """Mark the tangent entries of the joints that the home names: (nv,) of bool."""
    named = np.zeros(chain.nv, dtype=bool)
    if chain.mechanism.home_is_guess:
        return named
    for name, joint in zip(chain.model.names[1:], chain.model.joints[1:], strict=True):
        named[joint.idx_v : joint.idx_v + joint.nv] = name in chain.mechanism.home
    return named


def _guesses(chain: ClosedChain, given: np.ndarray) -> Iterator[Configuration]:
    first = home_guess(chain)
    yield first
    if given.all():
        return
    rng = np.random.default_rng(0)
    for _ in range(_ATTEMPTS):
        yield np.where(_in_configuration(chain, given), first, random_configuration(chain, rng))


def _close(chain: ClosedChain, guess: Configuration, given: np.ndarray) -> Closure:
    """Close the loops; joints that are searched for are brought inside their limits in turn with it."""
    if given.all():
        return close_loops(chain, guess, throw=False)
    held = _in_configuration(chain, given)
    start, closure = guess, Closure(q=guess, gap=np.inf, iterations=0, success=False)
    for _ in range(_ROUNDS):
        near = _hold(chain, start, given) if given.any() else start
        closure = close_loops(chain, near, throw=False)
        if not closure.success:
            break
        q = np.where(held, closure.q, unwound(chain, closure.q))
        closure = replace(closure, q=q)
        if not _beyond_limits(chain, q):
            break
        start = np.where(held, guess, clipped(chain, q))
    return closure


def _in_configuration(chain: ClosedChain, entries: np.ndarray) -> np.ndarray:
    """Carry a mark per tangent entry over to the configuration: (nq,) of bool."""
    return np.concatenate([np.full(joint.nq, entries[joint.idx_v]) for joint in chain.model.joints[1:]])


def _hold(chain: ClosedChain, guess: Configuration, given: np.ndarray) -> Configuration:
    """Close the loops as far as the given joints allow when they stay: a start from which they hardly move."""
    loops = loop_system(chain)
    rows = np.eye(chain.nv)[given]

    def evaluate(data: pin.Data, q: Configuration) -> tuple[FloatArray, FloatArray]:
        gap, jacobian = loops.evaluate(data, q)
        kept = pin.difference(chain.model, guess, q)[given]
        return np.concatenate([gap, kept]), np.vstack([jacobian, rows])

    sizes = np.concatenate([loops.sizes, chain.tangent_scale[given]])
    return solve(chain, guess, System(evaluate, sizes, "the home configuration")).q


def _moved(chain: ClosedChain, guess: Configuration, q: Configuration, given: np.ndarray) -> str:
    moved = np.abs(pin.difference(chain.model, guess, q) / chain.tangent_scale) * given
    if moved.max(initial=0.0) <= _CLOSED_IN_FILE:
        return ""
    worst = int(np.argmax(moved))
    return f"closing them moves joint '{chain.tangent_names[worst]}' by {moved[worst]:.3g} robot sizes or radians"


def _with_home_note(chain: ClosedChain, q: Configuration) -> Mechanism:
    """Tell in the report when a home that was only a guess is another configuration than the file's."""
    mechanism = chain.mechanism
    moved = _moved(chain, home_guess(chain), q, np.ones(chain.nv, dtype=bool))
    if not (mechanism.home_is_guess and moved):
        return mechanism
    note = Note("home", f"{moved}, as loops and limits demand", Outcome.CHANGED)
    return replace(mechanism, notes=(*mechanism.notes, note))


def _beyond_limits(chain: ClosedChain, q: Configuration) -> str:
    for name, (value, lower, upper) in limit_violations(chain, q, _CLOSED_IN_FILE).items():
        return f"joint '{name}' would stand at {value:.6g}, beyond its limits {lower:.6g} to {upper:.6g}"
    return ""
