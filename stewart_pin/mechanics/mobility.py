"""How many freedoms a mechanism has, which are idle, and whether its motors hold the rest."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np
import scipy.linalg

from stewart_pin.brief import Brief
from stewart_pin.model.description import JointKind
from stewart_pin.model.tree import link_frame
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import State, as_chain
from stewart_pin.tolerances import SINGULAR, TAKES_PART
from stewart_pin.typing import FloatArray

# ----------------------------------------------------------------------------------------------------
# Which motors hold a robot: how many are to spare, which joints they leave free, and which set would do
#
# A set of motors holds the robot when every motion that is left with the motors locked leaves the platform at rest. All
# matrices see lengths in robot sizes, so that the unit of length decides nothing.
# ----------------------------------------------------------------------------------------------------


_WORTH_IT = 0.1
"""Share of the best joint's part in a motion above which a joint like the given motors is preferred to it."""
_MOST_SETS = 64
"""Most sets of spare motors that are listed."""
_MOST_TRIALS = 2000
"""Most combinations of motors that are tried for the list; of more, one set is found from each motor on."""


@dataclass(frozen=True)
class MotorSets:
    """What the motors of a chain are good for, at one configuration.

    Attributes
    ----------
    surplus
        Number of motors beyond those that move independently of each other.
    spare
        Sets of as many motors that could be left out together without losing a freedom: all of them, but at most 64,
        and from many motors a choice.
    free_joints
        Joints that take part in motions of the platform with all motors locked.
    suggestion
        A set of motors that holds the robot: the given one where it does; otherwise those of its motors that help, and
        the joints that hold best what they leave, joints like the motors first. Empty where no set of joints with one
        freedom holds it.
    """

    surplus: int
    spare: tuple[tuple[str, ...], ...]
    free_joints: tuple[str, ...]
    suggestion: tuple[str, ...]


def analyse_motors(state: State) -> MotorSets:
    """Judge the motors of a chain, and find a set that holds the robot.

    Parameters
    ----------
    state
        State with closed loops, at a configuration that is nothing special.

    Returns
    -------
    MotorSets
        Motors to spare, joints left free, and a set that works.
    """
    chain, freedom = state.chain, state.freedom
    scale, motions = chain.tangent_scale[:, None], state.motions.basis
    share = motions[chain.motor_index]
    surplus = chain.nu - chain.generic.count.motor
    joints = {name: chain.model.joints[chain.model.getJointId(name)] for name in chain.model.names[1:]}
    moving = np.linalg.norm(freedom.lost / scale, axis=1) > TAKES_PART
    free = tuple(name for name, j in joints.items() if moving[j.idx_v : j.idx_v + j.nv].any())
    suggestion = chain.motors
    if freedom.lost.shape[1]:
        # Without a platform every motion has to be held.
        target = motions
        if chain.platform is not None:
            target = state.P / chain.twist_sizes[:, None] @ freedom.motions
        rows = {
            joint.name: motions[joints[joint.name].idx_v]
            for joint in chain.mechanism.joints
            if joint.has_axis and joint.name in joints
        }
        suggestion = _suggest(rows, target, chain.motors, _alike(chain, rows))
    return MotorSets(surplus, _spare(chain.motors, share, surplus), free, suggestion)


def _rank(share: FloatArray) -> int:
    s = np.linalg.svd(share, compute_uv=False)
    # Rows of orthonormal motions are at most one.
    return int(np.count_nonzero(s >= SINGULAR)) if s.size else 0


def _spare(motors: Sequence[str], share: FloatArray, surplus: int) -> tuple[tuple[str, ...], ...]:
    """List sets of `surplus` motors without which the rank is the same."""
    if not surplus:
        return ()
    rank = len(motors) - surplus
    trials: Iterable[tuple[int, ...]] = combinations(range(len(motors)), surplus)
    if comb(len(motors), surplus) > _MOST_TRIALS:
        trials = (_left_out(share, first) for first in range(len(motors)))
    sets: dict[tuple[int, ...], None] = {}
    for out in trials:
        if out not in sets and _rank(np.delete(share, out, axis=0)) == rank:
            sets[out] = None
        if len(sets) == _MOST_SETS:
            break
    return tuple(tuple(motors[k] for k in out) for out in sets)


def _left_out(share: FloatArray, first: int) -> tuple[int, ...]:
    """Keep every motor that is independent of those before it, from the first on and around; return the others."""
    order = np.roll(np.arange(len(share)), -first)
    kept: list[int] = []
    # What is left of each row beside those that are kept: no singular value of it and them is larger.
    left = share[order]
    for k, row in enumerate(left):
        size = np.linalg.norm(row)
        if size >= SINGULAR:
            kept.append(int(order[k]))
            left[k + 1 :] -= np.outer(left[k + 1 :] @ row, row / size**2)
    if _rank(share[kept]) < len(kept):  # nearly dependent together, if not one by one
        kept = []
        for k in order:
            if _rank(share[[*kept, k]]) > len(kept):
                kept.append(int(k))
    return tuple(sorted({*range(len(share))} - {*kept}))


def _alike(chain: ClosedChain, names: Iterable[str]) -> set[str]:
    """Joints of the kind of a motor, as many joints from the ground: where a builder would put another one."""
    model = chain.model

    def role(name: str) -> tuple[JointKind, int]:
        depth, joint = 0, model.getJointId(name)
        while joint:
            depth, joint = depth + 1, model.parents[joint]
        return chain.mechanism.joint(name).kind, depth

    roles = {role(motor) for motor in chain.motors}
    return {name for name in names if role(name) in roles}


def _suggest(
    rows: Mapping[str, FloatArray], platform: FloatArray, given: Sequence[str], alike: set[str]
) -> tuple[str, ...]:
    """Keep what helps of the given motors, then add the joint that takes most part in what is left, and so on."""
    chosen: list[str] = []
    for name in given:
        if np.linalg.norm(rows[name] @ _left(rows, chosen, platform)) > TAKES_PART:
            chosen.append(name)
    while True:
        space = _left(rows, chosen, platform)
        _, s, vt = np.linalg.svd(platform @ space)
        lost = space @ vt[: np.count_nonzero(s > TAKES_PART)].T
        if not lost.shape[1]:
            break
        best = _strongest({name: float(np.linalg.norm(row @ lost)) for name, row in rows.items()}, alike)
        if best is None:
            return ()
        chosen.append(best)
    chosen = _needed(rows, chosen, platform)
    added = [name for name in rows if name in chosen and name not in given]
    return (*(name for name in given if name in chosen), *added)


def _needed(rows: Mapping[str, FloatArray], chosen: list[str], platform: FloatArray) -> list[str]:
    """Leave out motors that the others make needless, the last first."""
    for name in reversed(chosen.copy()):
        others = [other for other in chosen if other != name]
        if np.linalg.norm(platform @ _left(rows, others, platform)) <= TAKES_PART:
            chosen = others
    return chosen


def _strongest(strength: Mapping[str, float], alike: set[str]) -> str | None:
    """Name the joint that takes most part, one of those `alike` where that is worth it; None where none does."""
    best = max(strength.values(), default=0.0)
    if best <= TAKES_PART:
        return None
    usual = max((strength[name] for name in alike), default=0.0)
    pool = alike if usual > _WORTH_IT * best else set(strength)
    # Of joints that are equally good the first in the file, whatever the round-off.
    enough = (1 - 1e-6) * (usual if pool is alike else best)
    return next(name for name, value in strength.items() if name in pool and value >= enough)


def _left(rows: Mapping[str, FloatArray], locked: Sequence[str], platform: FloatArray) -> FloatArray:
    """Orthonormal basis of the motions that locked joints leave, in coordinates of the free ones."""
    if not locked:
        return np.eye(platform.shape[1])
    held = np.array([rows[name] for name in locked])
    _, s, vt = np.linalg.svd(held)
    return vt[np.count_nonzero(s >= SINGULAR) :].T


# ----------------------------------------------------------------------------------------------------

_REST = 1e-8
"""Velocities below this count as rest, relative to the largest."""


@dataclass(frozen=True, repr=False)
class Mobility(Brief):
    """Freedoms of a mechanism, what its loops repeat, and what its motors are good for.

    The numbers belong to the mechanism: they hold at configurations that are nothing special.

    Attributes
    ----------
    dof
        Number of independent motions that keep the loops closed, at a generic configuration.
    idle
        One readable name per idle freedom: a motion that moves neither motors nor platform. Where only these are given,
        idle freedoms carry no momentum and follow their own inertia, see `platform_motion`.
    redundant_rows
        Number of equations of loops and couplings that follow from the others.
    motors_sufficient
        Whether the motors hold everything but the idle freedoms.
    redundant
        Names of as many rows that follow from the others; which ones is a choice.
    lost
        Number of motions of the platform that locked motors leave.
    home_singular
        Whether home has more freedoms, or its motors hold less, than usual.
    dof_home
        Number of motions at home.
    dof_samples
        Number of motions at each of the random configurations near home that were looked at; of home where no other
        one closed.
    surplus_motors
        Number of motors beyond those that move independently of each other.
    spare_motors
        Sets of as many motors that could be left out together, at most 64 of them.
    free_joints
        Joints that take part in motions of the platform with all motors locked.
    suggestion
        Motors that hold the robot: the given ones where they do; empty where no joints with one freedom can.
    verdict
        The motors in a word: ``"sufficient"``, ``"redundant"`` where they hold the robot with some to spare,
        ``"wrongly chosen"`` where the suggestion needs no more of them, or else ``"too few"``.
    """

    dof: int
    idle: tuple[str, ...]
    redundant_rows: int
    motors_sufficient: bool
    redundant: tuple[str, ...]
    lost: int
    home_singular: bool
    dof_home: int
    dof_samples: tuple[int, ...]
    surplus_motors: int
    spare_motors: tuple[tuple[str, ...], ...]
    free_joints: tuple[str, ...]
    suggestion: tuple[str, ...]
    verdict: str


def mobility(chain: ClosedChain) -> Mobility:
    """Count the freedoms of a mechanism at home and at seeded random configurations near it.

    Parameters
    ----------
    chain
        Closed chain.

    Returns
    -------
    Mobility
        The generic numbers; ``home_singular`` tells when home differs, ``dof_samples`` what was seen elsewhere.

    Examples
    --------
    >>> import stewart_pin as stp
    >>> found = stp.mobility(stp.load("five_bar", motors=["left_hip"]))
    >>> found.dof, found.verdict, found.free_joints, found.suggestion
    (2, 'too few', ('left_knee', 'right_hip', 'right_knee'), ('left_hip', 'right_hip'))
    """
    as_chain(chain)
    usual = chain.generic
    home, samples = chain.at(chain.q_home), [chain.at(q) for q in usual.samples]
    # The state that is farthest from singular shows most clearly who takes part in what.
    state = max(samples, key=lambda s: min(s.motions.smallest, s.freedom.smallest_singular_value))
    motors = analyse_motors(state)
    lost = usual.count.uncontrolled
    verdict = "redundant" if motors.surplus else "sufficient"
    if lost:
        verdict = "wrongly chosen" if 0 < len(motors.suggestion) <= chain.nu else "too few"
    return Mobility(
        dof=usual.count.dof,
        idle=_idle_names(state),
        redundant_rows=chain.nc - usual.rank,
        motors_sufficient=lost == 0,
        redundant=_redundant_rows(state),
        lost=lost,
        home_singular=_motions(home) > usual.count.dof or home.freedom.lost.shape[1] > lost,
        dof_home=_motions(home),
        dof_samples=tuple(_motions(sample) for sample in samples),
        surplus_motors=motors.surplus,
        spare_motors=motors.spare,
        free_joints=motors.free_joints,
        suggestion=motors.suggestion,
        verdict=verdict,
    )


def _motions(state: State) -> int:
    """Count the motions at a configuration: the usual ones, and those that a singularity of the loops adds."""
    usual = state.chain.generic
    gained = np.count_nonzero(state.motions.values < SINGULAR * usual.usual_loops)
    return usual.count.dof + int(gained)


def _redundant_rows(state: State) -> tuple[str, ...]:
    chain, rank = state.chain, state.chain.generic.rank
    if rank == chain.nc:
        return ()
    # Pivoted QR of the transpose picks `rank` independent rows; the others follow from them.
    pivots = np.asarray(scipy.linalg.qr(state.rows.T, pivoting=True)[-1])
    return tuple(chain.loop_table.names[k] for k in sorted(pivots[rank:]))


def _idle_names(state: State) -> tuple[str, ...]:
    # In robot sizes, so that the unit of length does not decide which vectors make the basis.
    chain = state.chain
    scale = chain.tangent_scale[:, None]
    basis = scale * _sparse_basis(state.freedom.idle / scale)
    frames, links = chain.model.frames, chain.mechanism.links
    carriers = {link.name: frames[link_frame(chain.model, link.name)].parentJoint for link in links}
    return tuple(_describe(state, motion, carriers) for motion in basis.T)


def _sparse_basis(columns: FloatArray) -> FloatArray:
    """Reduce an orthonormal basis: each vector has one coordinate to itself, and moves few joints.

    Pivots are the rows of largest norm, which no rotation of the basis changes: the result does not depend on it.
    """
    count = columns.shape[1]
    if not count:
        return columns
    order = np.asarray(scipy.linalg.qr(columns.T, mode="r", pivoting=True)[-1])
    return columns @ np.linalg.inv(columns[np.sort(order[:count])])


def _describe(state: State, motion: FloatArray, carriers: Mapping[str, int]) -> str:
    """Name a motion by the links that move and the way they move; with the joint that carries each link."""
    chain = state.chain
    of_joints = state.joint_twists(motion) / chain.twist_sizes
    moving = np.abs(of_joints).max(axis=1) > _REST * np.abs(motion / chain.tangent_scale).max()
    twists = {name: of_joints[joint] for name, joint in carriers.items() if moving[joint]}
    bodies = [name for name in twists if chain.mechanism.link(name).inertia is not None] or list(twists)
    first = twists[bodies[0]]
    together = all(np.allclose(twists[name], first, atol=_REST) for name in bodies)
    # A screw without pitch: v · ω = 0.
    spins = together and np.linalg.norm(first[3:]) > _REST and abs(first[:3] @ first[3:]) < _REST
    if not spins:
        return f"{', '.join(bodies)}: move with motors and platform at rest"
    for number, motor in enumerate(chain.motors, start=1):
        joint = chain.mechanism.joint(motor)
        if joint.parent in bodies or joint.child in bodies:
            return f"leg {number}: spin about its axis"
    return f"{', '.join(bodies)}: spin about its axis"
