"""States at which a chain's matrices, and its idle freedoms, are looked at before its kernels are written."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
import pinocchio as pin

from stewart_pin.errors import ClosureError, SingularityError, UnsupportedError
from stewart_pin.mechanics.inverse_dynamics import idle_inertia, inverse_dynamics, take_part
from stewart_pin.mechanics.kinematics import platform_motion, platform_pose
from stewart_pin.model.description import JointKind
from stewart_pin.model.tree import link_frame
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.generic import regularity
from stewart_pin.state.newton import close_loops
from stewart_pin.typing import Configuration, FloatArray

_REGULAR = 1e-3
"""Share of the usual regularity that a home must have for pivots to be chosen on it."""
_STANDS = 1e-9
"""Idle motions that turn a body by less, relative to 1, are round-off."""
_SPREAD, _SPREAD_BESIDE = 0.15, 0.03
"""Largest displacement of a joint from home, and from a configuration far from it, in robot sizes and radians."""


def closed_samples(
    chain: ClosedChain, *, count: int = 8, seed: int = 0, around: Configuration | None = None
) -> FloatArray:
    """Draw configurations with closed loops around home, or around another.

    Parameters
    ----------
    chain
        Closed chain.
    count
        How many.
    seed
        Of the displacements.
    around
        (nq,) configuration instead of home [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (count, nq) configurations [m, rad, unit quaternions]; home itself, often symmetric, is not among them.

    Raises
    ------
    UnsupportedError
        If the loops close at no displacement.
    """
    rng = np.random.default_rng(seed)
    found: list[FloatArray] = []
    spread, centre = (_SPREAD, chain.q_home) if around is None else (_SPREAD_BESIDE, around)
    for _ in range(20 * count):
        step = rng.uniform(-spread, spread, chain.nv) * chain.tangent_scale
        closure = close_loops(chain, pin.integrate(chain.model, centre, step), throw=False)
        if closure.success:
            found.append(closure.q)
        else:
            spread *= 0.9
        if len(found) == count:
            return np.array(found)
    raise UnsupportedError(
        f"the loops of {chain.name} close at {len(found)} of {20 * count} displacements of home; "
        "kernels need closed states to look at"
    )


def pivot_samples(chain: ClosedChain, around: Configuration | None = None) -> FloatArray:
    """Return the configurations on which pivots are chosen: around home, and home itself where it is regular.

    Parameters
    ----------
    chain
        Closed chain.
    around
        (nq,) regular configuration instead of home [m, rad, unit quaternions].

    Returns
    -------
    numpy.ndarray
        (samples, nq) configurations with closed loops [m, rad, unit quaternions].
    """
    samples, centre = closed_samples(chain, around=around), chain.q_home if around is None else around
    return np.vstack([samples, centre]) if regularity(chain.at(centre)) >= _REGULAR else samples


def at_samples(inputs: Sequence[ca.SX], samples: Sequence[FloatArray], matrix: ca.SX) -> FloatArray:
    """Evaluate a matrix of expressions at samples.

    Parameters
    ----------
    inputs
        (n, 1) symbols each.
    samples
        (samples, n) values of each input, in any unit.
    matrix
        (m, n) expressions.

    Returns
    -------
    numpy.ndarray
        (samples, m, n) values, in the same unit as the matrix.
    """
    function = ca.Function("sample", list(inputs), [ca.densify(matrix)])
    rows = zip(*samples, strict=True)
    return np.array([np.array(function(*row)).reshape(matrix.shape) for row in rows])


# ----------------------------------------------------------------------------------------------------
# Whether it matters where idle freedoms stand: platform and motors do not determine it
# ----------------------------------------------------------------------------------------------------

_SAME = 1e-6
"""Relative difference of efforts that closing the loops again leaves."""
_ROUND_OFF = 1e-9
"""The same of efforts that vanish, relative to what the joints carry."""
_TURNS = (0.5, 0.1, 0.02)
"""How far idle freedoms are moved for the comparison, in robot sizes and radians: the first that can be closed."""


def require_idle_without_effect(chain: ClosedChain, q: Configuration) -> None:
    """Refuse chains whose motor efforts depend on where idle freedoms stand, as a lopsided rod that may spin.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration with closed loops, to compare at [m, rad, unit quaternions].

    Raises
    ------
    UnsupportedError
        If efforts differ, or the idle freedoms cannot be moved.
    """
    here = chain.at(q)
    freedom = here.freedom
    if not freedom.idle.shape[1] or freedom.lost.shape[1]:
        return
    rng = np.random.default_rng(0)
    jacobian = here.P
    twist, acceleration = (
        jacobian @ freedom.motions @ rng.normal(size=freedom.motions.shape[1]) for _ in range(2)
    )
    # Near the same pose only the twists that the platform can do everywhere are sure to be feasible.
    if chain.generic.count.platform < 6:
        acceleration = twist = np.zeros(6)
    direction = freedom.idle @ rng.uniform(0.5, 1.0, freedom.idle.shape[1])
    pose = platform_pose(chain, q)

    def efforts_at(guess: Configuration) -> FloatArray:
        state = platform_motion(chain, pose, twist, acceleration, q_guess=guess, limits=False)
        return inverse_dynamics(state).tau_motor

    efforts = [efforts_at(q), efforts_at(idle_moved(chain, q, direction))]
    # Where gravity does no work, efforts at rest are round-off of what the joints carry.
    size = max(_SAME * np.abs(efforts[0]).max(), _ROUND_OFF * np.abs(here.weight).max())
    if np.abs(efforts[0] - efforts[1]).max() > size:
        names = [
            n for n, x in zip(chain.tangent_names, np.abs(freedom.idle).max(axis=1), strict=True) if x > 1e-6
        ]
        raise UnsupportedError(
            f"where idle freedoms of {chain.name} stand ({', '.join(names[:3])}, ...) changes the motor efforts, and "
            "neither platform nor motors determine it; use coordinates='tree'"
        )


def require_idle_without_physics(chain: ClosedChain, *, told: bool) -> None:
    """Refuse springs, damping and dry friction of joints that idle motions move, where nothing answers them.

    Neither platform nor motors tell where such a joint stands, and what it does by itself depends on that. Where the
    whole state is given, idle freedoms without inertia have no acceleration that it could give them, and whether dry
    friction holds those that are at rest takes a search.

    Parameters
    ----------
    chain
        Closed chain.
    told
        Whether the whole state is given: then only dry friction, and idle freedoms without inertia, are in the way.

    Raises
    ------
    UnsupportedError
        Naming a joint.
    """
    effects = chain.at(chain.q_home).effects
    if effects is None or not chain.generic.count.idle:
        return
    pushed = (effects.damping != 0) | (effects.friction != 0)
    pushed[chain.joint_effects.in_v] = True
    names = np.array([*np.array(chain.tangent_names)[pushed], *(["of a ball or a loop"] * len(effects.rows))])
    for q in chain.generic.samples:
        state = chain.at(q)
        idle = state.freedom.idle
        if told:
            if take_part(state, idle).any():
                raise UnsupportedError(
                    f"a joint that idle freedoms of {chain.name} move has dry friction, and whether that holds them at "
                    "rest takes a search; use the verbs of one state"
                )
            _, axes, heavy = idle_inertia(state)
            idle = idle @ axes[:, ~heavy]
        rows = np.vstack([np.eye(chain.nv)[pushed], chain.joint_effects.rows(state)])
        moved = np.abs(rows @ idle).max(axis=1, initial=0.0) > _STANDS * max(1.0, chain.length_scale)
        if moved.any():
            why = "which neither platform nor motors say where to; use coordinates='tree'"
            if told:
                why = "which have no inertia; use the verbs of one state, or give the bodies mass"
            raise UnsupportedError(
                f"joint '{names[moved][0]}' has a spring, damping or friction, and is moved by idle freedoms of "
                f"{chain.name}, {why}"
            )


def require_standing_frames(chain: ClosedChain) -> None:
    """Refuse reactions told in axes of a body that idle motions turn: neither platform nor motors tell where it stands.

    Parameters
    ----------
    chain
        Closed chain.

    Raises
    ------
    UnsupportedError
        If loop frame 1 of several rows turns so.
    """
    if not chain.generic.count.idle:
        return
    told = [
        loop for loop in chain.loops if loop.kind not in (JointKind.DISTANCE, JointKind.CABLE)
    ]  # one row has no axes
    for q in chain.generic.samples:
        idle, data = chain.at(q).freedom.idle, pin.Data(chain.model)
        for loop in told:
            frame = link_frame(chain.model, loop.link1)
            turning = pin.computeFrameJacobian(chain.model, data, q, frame, pin.LOCAL)[3:] @ idle
            if np.abs(turning).max(initial=0.0) > _STANDS:
                raise UnsupportedError(
                    f"the reactions of loop '{loop.name}' are told in axes of '{loop.link1}', which idle freedoms of "
                    f"{chain.name} turn, and neither platform nor motors say where to; use coordinates='tree', or "
                    "describe the loop from its other link"
                )


def require_standing_points(chain: ClosedChain, wrenches: Sequence[str]) -> None:
    """Refuse wrenches at points that idle motions move: neither platform nor motors tell where these stand.

    Parameters
    ----------
    chain
        Closed chain.
    wrenches
        Links on which wrenches act from outside, at the origins of their frames.

    Raises
    ------
    UnsupportedError
        If idle motions move one of these points.
    """
    for link in wrenches:
        if _idle_twists(chain, link)[:3].max(initial=0.0) > _STANDS * chain.length_scale:
            raise UnsupportedError(
                f"a wrench on '{link}' acts at the origin of its frame, which idle freedoms of {chain.name} move, and "
                "neither platform nor motors say where to; use coordinates='tree', or put the frame on the axis about "
                "which the link may spin"
            )


def pushes_idle(chain: ClosedChain, wrenches: Sequence[str]) -> bool:
    """Tell whether wrenches on some links can do work on idle motions.

    Parameters
    ----------
    chain
        Closed chain.
    wrenches
        Links on which wrenches act from outside.

    Returns
    -------
    bool
        Whether an idle motion moves or turns the frame of one of them.
    """
    size = np.repeat([chain.length_scale, 1.0], 3)
    return any(
        (_idle_twists(chain, link).max(axis=1, initial=0.0) > _STANDS * size).any() for link in wrenches
    )


def telling_wrenches(chain: ClosedChain, wrenches: Sequence[str]) -> tuple[str, ...]:
    """List the links on which the effect of a wrench depends on where idle freedoms stand, or is unknown.

    A moment spins a thin rod at a million rad/s²: what printed digits leave it lopsided then tells.

    Parameters
    ----------
    chain
        Closed chain.
    wrenches
        Links on which wrenches act from outside, at points that no idle motion moves.

    Returns
    -------
    tuple of str
        Those of them on which moments may not push idle motions.
    """
    links = [link for link in wrenches if pushes_idle(chain, (link,))]
    if not links:
        return ()
    q, none = closed_samples(chain, count=1)[0], np.zeros(chain.nv)
    idle = chain.at(q).freedom.idle
    direction = idle @ np.random.default_rng(0).uniform(0.5, 1.0, idle.shape[1])
    states = [chain.at(one, none, none) for one in (q, idle_moved(chain, q, direction))]
    bare = [inverse_dynamics(state).tau_motor for state in states]
    moments = np.hstack([np.zeros((3, 3)), np.eye(3)])
    told = []
    for link in links:
        try:
            effects = np.array(
                [
                    [inverse_dynamics(state, wrenches={link: moment}).tau_motor - own for moment in moments]
                    for state, own in zip(states, bare, strict=True)
                ]
            )
        except SingularityError:  # without inertia there is no answer wherever it stands
            told.append(link)
            continue
        if np.abs(effects[0] - effects[1]).max() > _SAME * np.abs(effects[0]).max():
            told.append(link)
    return tuple(told)


def _idle_twists(chain: ClosedChain, link: str) -> FloatArray:
    """Sizes of the twists of a link's frame, in its axes, in all idle motions of all samples: (6, motions)."""
    if not chain.generic.count.idle:
        return np.zeros((6, 0))
    frame, found = link_frame(chain.model, link), []
    for q in chain.generic.samples:
        idle, data = chain.at(q).freedom.idle, pin.Data(chain.model)
        found.append(np.abs(pin.computeFrameJacobian(chain.model, data, q, frame, pin.LOCAL) @ idle))
    return np.hstack(found)


def idle_moved(chain: ClosedChain, q: Configuration, direction: FloatArray) -> Configuration:
    """Put idle freedoms elsewhere while the platform rests.

    Parameters
    ----------
    chain
        Closed chain.
    q
        (nq,) configuration with closed loops [m, rad, unit quaternions].
    direction
        (nv,) an idle motion, of about one robot size or radian [m, rad].

    Returns
    -------
    numpy.ndarray
        (nq,) configuration with closed loops and the same pose, as far along that motion as loops let it go at once
        [m, rad, unit quaternions].

    Raises
    ------
    UnsupportedError
        If it cannot be moved.
    """
    pose, rest = platform_pose(chain, q), np.zeros(6)
    for turn in _TURNS:
        try:
            guess = close_loops(chain, pin.integrate(chain.model, q, turn * direction)).q
            return platform_motion(chain, pose, rest, rest, q_guess=guess, limits=False).q
        except ClosureError:
            continue
    raise UnsupportedError(
        f"the idle freedoms of {chain.name} cannot be moved by {_TURNS[-1]} with the platform at rest, so it is not "
        "known whether they matter; use coordinates='tree'"
    )
