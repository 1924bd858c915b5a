"""The home configuration: as the file gives it, or found near it, with the loops closed and inside the joint limits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin
from scipy.optimize import lsq_linear

from stewart_pin.errors import MechanismError
from stewart_pin.model.description import JointKind, Note, Outcome
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.configurations import clipped, random_configuration, unwound
from stewart_pin.state.limits import Excess
from stewart_pin.state.newton import Closure, close_at_precision, displaced, polish
from stewart_pin.state.state import State
from stewart_pin.tolerances import CLOSED, HOME_IN_FILE
from stewart_pin.typing import BoolArray, Configuration, FloatArray

_ATTEMPTS = 16
"""Random configurations to start from."""
_STEPS = 60
"""Bounded Gauss-Newton steps from one start."""
_ROUNDS = 10
"""Leaps by which joints of an assembled pose are carried inside their limits."""
_LEAP = 0.6
"""How far a joint of an assembled pose is moved at once towards its range, in robot sizes or radians; also the largest
bounded Gauss-Newton step."""
_ENOUGH = 1e-6
"""Gap from which on Newton's method closes the rest without moving a joint noticeably."""


def settle_home(chain: ClosedChain) -> ClosedChain:
    """Close the loops at home; the report tells which joints without a coordinate are beyond their limits there.

    The description's home is closed by the shortest way. Joints that it does not name are searched for: from the
    neutral configuration moved inside the joint limits, by bounded least squares, and then from seeded random ones,
    each group of loops that share no joint for itself. Joints in no loop stay where they are. A home that is only a
    guess is searched for from there.

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
    settled = _settle_assembled(chain) if chain.mechanism.assembled else _settle(chain)
    beyond = settled.judge.positions(settled.q_home, slack=HOME_IN_FILE)
    names = settled.limits.names[chain.nv :]
    notes = [
        Note(f"joint '{excess.joint}'", f"home is beyond its limits: {excess}", Outcome.KEPT)
        for excess in beyond
        if excess.joint in names
    ]
    return settled.with_home(settled.q_home, *notes) if notes else settled


def _settle(chain: ClosedChain) -> ClosedChain:
    given = _named_entries(chain)
    guess = _alone_inside(chain, home_guess(chain), given)
    direct = polish(chain, guess)
    faults = [_fault(chain, guess, direct, given)]
    if not faults[0]:
        return _with_home(chain, direct.q)
    q = guess
    for group in _groups(chain):
        found = _search(chain, q, given, group)
        if found is None:
            raise _no_home(chain, guess, given, faults[0])
        q = found
    closure = polish(chain, q)
    fault = _fault(chain, guess, closure, given)
    if fault:
        raise _no_home(chain, guess, given, fault)
    return _with_home(chain, closure.q)


def near_home(chain: ClosedChain, precision: float, *, searching: bool) -> Configuration | None:
    """Find a configuration at which the loops close but for digits.

    Parameters
    ----------
    chain
        Chain whose home is a guess.
    precision
        Largest gap that digits may have left, in robot sizes and radians.
    searching
        Whether to search for one, as `settle_home` does; otherwise only the nearest is tried.

    Returns
    -------
    numpy.ndarray or None
        (nq,) configuration inside the joint limits [m, rad, unit quaternions], or None where there is none.
    """
    given = _named_entries(chain)
    assembled = chain.mechanism.assembled
    guess = home_guess(chain, inside=not assembled)
    q = guess if assembled else _alone_inside(chain, guess, given)
    near = close_at_precision(chain, q, precision).state
    closed = near.largest_gap <= precision and not near.opposed()
    if closed and (assembled or not (_moved(chain, guess, near.q, given) or _beyond_limits(chain, near.q))):
        return near.q
    if assembled or not searching:
        return None
    for group in _groups(chain):
        found = _search(chain, q, given, group, precision)
        if found is None:
            return None
        q = found
    return q


def keep_home(chain: ClosedChain, q: Configuration) -> ClosedChain:
    """Set a home that was found by `near_home`; where it stands beyond limits, as a file may have it, carry it inside.

    Parameters
    ----------
    chain
        Chain whose home is a guess.
    q
        (nq,) configuration with closed loops [m, rad, unit quaternions].

    Returns
    -------
    ClosedChain
        The same chain with a home.
    """
    beyond = chain.mechanism.assembled and _beyond_limits(chain, q)
    return _settle_assembled(chain) if beyond else _with_home(chain, q)


def _settle_assembled(chain: ClosedChain) -> ClosedChain:
    """Carry joints that the file puts beyond their limits inside, the loops closed; stay where they do not allow it."""
    start = polish(chain, home_guess(chain, inside=False))
    if not start.success:
        raise MechanismError(
            f"no home configuration: the loops do not close where the file places its links: the gap is "
            f"{start.gap:.3g} m; correct the poses",
            path=chain.mechanism.source,
            culprit="home",
        )
    outside = _outside(chain, start.q)
    if not outside:
        return chain.with_home(start.q)
    q = _carry_inside(chain, start.q, [excess.joint for excess in outside])
    found = _outside(chain, q)
    worst = outside[0].joint
    text = f"home: the pose of the file is beyond the limits of {len(outside)} joints; " + (
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
        if not _outside(chain, q):
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
    if not pin.isNormalized(chain.model, q, 1e-3):
        raise MechanismError(
            "the home configuration holds a quaternion that is not of unit length",
            path=chain.mechanism.source,
            culprit="home",
        )
    return pin.normalize(chain.model, q)


def _named_entries(chain: ClosedChain) -> BoolArray:
    """Mark the tangent entries of the joints that the home names: (nv,) of bool."""
    named = np.zeros(chain.nv, dtype=bool)
    if chain.mechanism.home_is_guess:
        return named
    for name, joint in zip(chain.model.names[1:], chain.model.joints[1:], strict=True):
        named[joint.idx_v : joint.idx_v + joint.nv] = name in chain.mechanism.home
    return named


def _alone_inside(chain: ClosedChain, q: Configuration, given: BoolArray) -> Configuration:
    """Bring joints in no loop, that the home does not name, to the nearest value within their limits."""
    alone = ~given
    for _, entries in _groups(chain):
        alone &= ~entries
    inside = np.clip(q, chain.model.lowerPositionLimit, chain.model.upperPositionLimit)
    return np.where(_in_configuration(chain, alone), inside, q)


def _fault(chain: ClosedChain, guess: Configuration, closure: Closure, given: BoolArray) -> str:
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
        return f"the loops do not close, the smallest gap found is {closure.gap:.3g} m"
    return _moved(chain, guess, closure.q, given) or _beyond_limits(chain, closure.q)


def _groups(chain: ClosedChain) -> list[tuple[BoolArray, BoolArray]]:
    """Rows and tangent entries of each set of loops that share joints with no other set."""
    touched = chain.loop_table.row_difference != 0
    coupling = chain.loop_table.coupling
    for k, row in enumerate(coupling.index):
        touched[row, [entry for entry in (coupling.v1[k], coupling.v2[k]) if entry >= 0]] = True
        touched[row] |= coupling.ratios_v[k] != 0
    # Entries of one joint move together.
    for joint in chain.model.joints[1:]:
        own = slice(joint.idx_v, joint.idx_v + joint.nv)
        touched[:, own] = touched[:, own].any(axis=1, keepdims=True)
    left = np.ones(chain.nc, dtype=bool)
    groups: list[tuple[BoolArray, BoolArray]] = []
    while left.any():
        rows = np.zeros(chain.nc, dtype=bool)
        rows[np.argmax(left)] = True
        while True:
            entries = touched[rows].any(axis=0)
            more = touched[:, entries].any(axis=1) | rows
            if (more == rows).all():
                break
            rows = more
        groups.append((rows, entries))
        left &= ~rows
    return groups


def _search(
    chain: ClosedChain,
    start: Configuration,
    given: BoolArray,
    group: tuple[BoolArray, BoolArray],
    precision: float = 0.0,
) -> Configuration | None:
    """Close one group of loops inside the limits, from near the start first; the other joints stay."""
    rows, entries = group
    for guess in _guesses(chain, start, entries & ~given):
        q = _bounded(chain, guess, given, rows, entries, precision)
        if q is not None:
            return q
    return None


def _guesses(chain: ClosedChain, start: Configuration, free: BoolArray) -> Iterator[Configuration]:
    yield start
    if not free.any():
        return
    moving = _in_configuration(chain, free)
    yield np.where(moving, clipped(chain, _outermost(chain, start)), start)
    rng = np.random.default_rng(0)
    for _ in range(_ATTEMPTS):
        yield np.where(moving, random_configuration(chain, rng), start)


def _outermost(chain: ClosedChain, q: Configuration) -> Configuration:
    """Put coordinates that stand at a limit just beyond it, so that `clipped` takes them to the middle."""
    lower, upper = chain.model.lowerPositionLimit, chain.model.upperPositionLimit
    return np.where(q <= lower, q - 1.0, np.where(q >= upper, q + 1.0, q))


def _bounded(
    chain: ClosedChain,
    guess: Configuration,
    given: BoolArray,
    rows: BoolArray,
    entries: BoolArray,
    precision: float,
) -> Configuration | None:
    """Gauss-Newton steps within the limits until the rows of a group are nearly closed, then to the last bit.

    With a precision, rows that close to it are left as they are.
    """
    state = chain.at(pin.normalize(chain.model, np.array(guess)))
    free = np.flatnonzero(entries)
    residual = (state.gap / chain.row_sizes)[rows]
    damping = 1e-3
    for _ in range(_STEPS):
        if np.abs(residual).max() < max(_ENOUGH, precision / 2):
            break
        lower, upper = _room(chain, state.q, guess, given)
        jacobian = state.rows[rows][:, free]
        system = np.vstack([jacobian, damping * np.eye(free.size)])
        right = np.concatenate([-residual, np.zeros(free.size)])
        step = np.zeros(chain.nv)
        step[free] = lsq_linear(system, right, bounds=(lower[free], upper[free])).x
        trial = displaced(state, step)
        left = (trial.gap / chain.row_sizes)[rows]
        if np.linalg.norm(left) < np.linalg.norm(residual):
            state, residual, damping = trial, left, max(damping / 5, 1e-9)
        elif damping > 1e3:
            return None
        else:
            damping *= 5
    else:
        return None
    closed = np.array(state.q) if precision else _closed_group(chain, state, rows, free)
    if closed is None or _moved(chain, guess, closed, given):
        return None
    q = np.where(_in_configuration(chain, entries & ~given), unwound(chain, closed), closed)
    return None if _outside(chain, q, np.flatnonzero(entries)) else q


def _closed_group(
    chain: ClosedChain, state: State, rows: BoolArray, free: np.ndarray
) -> Configuration | None:
    """Close the rows of a group to the last bit, whatever their rank: damped by the size of the gap."""
    for _ in range(_STEPS):
        residual = (state.gap / chain.row_sizes)[rows]
        worst = float(np.abs(residual).max())
        if worst <= max(CLOSED / 10, state.round_off / 10):
            break
        u, s, vt = np.linalg.svd(state.rows[rows][:, free], full_matrices=False)
        step = np.zeros(chain.nv)
        step[free] = -vt.T @ ((s / (s**2 + worst**2)) * (u.T @ residual))
        trial = displaced(state, step)
        if not np.abs(trial.gap / chain.row_sizes)[rows].max() < worst:
            break
        state = trial
    closed = np.abs(state.gap / chain.row_sizes)[rows].max() <= max(CLOSED, state.round_off)
    # A loop of another group may still be open, and look like one that is closed the wrong way round.
    opposed = {loop for loop in state.opposed() if rows[chain.loop_table.slices[loop]].any()}
    return np.array(state.q) if closed and not opposed else None


def _room(
    chain: ClosedChain, q: Configuration, guess: Configuration, given: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """How far each tangent entry may go at once in natural units: to its limits, and named joints hardly at all."""
    lower, upper = np.full(chain.nv, -_LEAP), np.full(chain.nv, _LEAP)
    for joint in chain.model.joints[1:]:
        if joint.nq == 1 and joint.nv == 1:
            k, scale = joint.idx_v, chain.tangent_scale[joint.idx_v]
            low, high = (
                (float(limit[joint.idx_q]) - q[joint.idx_q]) / scale
                for limit in (chain.model.lowerPositionLimit, chain.model.upperPositionLimit)
            )
            # A start outside its range, as a home with few digits may be, is not thrown back at once.
            lower[k], upper[k] = max(lower[k], min(low, 0.0)), min(upper[k], max(high, 0.0))
    moved = pin.difference(chain.model, guess, q) / chain.tangent_scale
    lower[given] = -0.9 * HOME_IN_FILE - moved[given]
    upper[given] = 0.9 * HOME_IN_FILE - moved[given]
    return np.minimum(lower, -1e-12), np.maximum(upper, 1e-12)


def _in_configuration(chain: ClosedChain, entries: BoolArray) -> BoolArray:
    """Carry a mark per tangent entry over to the configuration: (nq,) of bool."""
    return np.concatenate([np.full(joint.nq, entries[joint.idx_v]) for joint in chain.model.joints[1:]])


def _no_home(chain: ClosedChain, guess: Configuration, given: BoolArray, fault: str) -> MechanismError:
    """Say why there is no home, by the best that can be had without limits."""
    if "do not close" in fault:
        smallest = polish(chain, guess)
        for trial in _guesses(chain, guess, ~given):
            closure = polish(chain, trial)
            own = _fault(chain, guess, closure, given)
            if closure.success and own:
                fault = own
                break
            smallest = min(smallest, closure, key=lambda c: c.gap)
        else:
            fault = _fault(chain, guess, smallest, given) or fault
    return MechanismError(
        f"no home configuration: {fault}; correct {'the origins of the loops' if chain.loops else 'their numbers'}, or "
        "the home (<group_state name='home'> or "
        "keyframe of the file)",
        path=chain.mechanism.source,
        culprit="home",
    )


def _moved(chain: ClosedChain, guess: Configuration, q: Configuration, given: BoolArray) -> str:
    moved = np.abs(pin.difference(chain.model, guess, q) / chain.tangent_scale) * given
    if moved.max(initial=0.0) <= HOME_IN_FILE:
        return ""
    worst = int(np.argmax(moved))
    return f"closing them moves joint '{chain.tangent_names[worst]}' by {moved[worst]:.3g} robot sizes or radians"


def _with_home(chain: ClosedChain, q: Configuration) -> ClosedChain:
    """Set home, and tell in the report when one that was only a guess is another configuration than the file's."""
    moved = _moved(chain, home_guess(chain), q, np.ones(chain.nv, dtype=bool))
    if not (chain.mechanism.home_is_guess and moved):
        return chain.with_home(q)
    return chain.with_home(q, Note("home", f"{moved}, as loops and limits demand", Outcome.CHANGED))


def _beyond_limits(chain: ClosedChain, q: Configuration) -> str:
    for excess in _outside(chain, q):
        least, most = excess.allowed
        return f"joint '{excess.joint}' would stand at {excess.value:.6g}, beyond its limits {least:.6g} to {most:.6g}"
    return ""


def _outside(chain: ClosedChain, q: Configuration, entries: np.ndarray | None = None) -> tuple[Excess, ...]:
    """List joints of the tree beyond their ranges; a home with few digits may be so by what it lacks."""
    looked_at = np.arange(chain.nv) if entries is None else entries
    return chain.judge.positions(q, slack=HOME_IN_FILE, entries=looked_at)
