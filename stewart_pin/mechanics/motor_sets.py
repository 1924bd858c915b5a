"""Which motors hold a robot: how many are to spare, which joints they leave free, and which set would do.

A set of motors holds the robot when every motion that is left with the motors locked leaves the platform at rest. All
matrices see lengths in robot sizes, so that the unit of length decides nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, islice
from math import comb

import numpy as np

from stewart_pin.model.description import JointKind
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.state import State
from stewart_pin.tolerances import SINGULAR, TAKES_PART
from stewart_pin.typing import FloatArray

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
    if comb(len(motors), surplus) <= _MOST_TRIALS:
        trials: Iterable[tuple[int, ...]] = combinations(range(len(motors)), surplus)
    else:
        trials = dict.fromkeys(_left_out(share, first) for first in range(len(motors)))
    sets = (out for out in trials if _rank(np.delete(share, out, axis=0)) == rank)
    return tuple(tuple(motors[k] for k in out) for out in islice(sets, _MOST_SETS))


def _left_out(share: FloatArray, first: int) -> tuple[int, ...]:
    """Keep every motor that is independent of those before it, from the first on and around; return the others."""
    kept: list[int] = []
    for k in np.roll(np.arange(len(share)), -first):
        if _rank(share[[*kept, k]]) > len(kept):
            kept.append(int(k))
    return tuple(k for k in range(len(share)) if k not in kept)


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
        strength = {name: float(np.linalg.norm(row @ lost)) for name, row in rows.items()}
        best = max(strength.values(), default=0.0)
        if best <= TAKES_PART:
            return ()
        usual = max((strength[name] for name in alike), default=0.0)
        pool = alike if usual > _WORTH_IT * best else set(rows)
        # Of joints that are equally good the first in the file, whatever the round-off.
        enough = (1 - 1e-6) * (usual if pool is alike else best)
        chosen.append(next(name for name, value in strength.items() if name in pool and value >= enough))
    for name in reversed(chosen.copy()):
        others = [other for other in chosen if other != name]
        if np.linalg.norm(platform @ _left(rows, others, platform)) <= TAKES_PART:
            chosen = others
    added = [name for name in rows if name in chosen and name not in given]
    return (*(name for name in given if name in chosen), *added)


def _left(rows: Mapping[str, FloatArray], locked: Sequence[str], platform: FloatArray) -> FloatArray:
    """Orthonormal basis of the motions that locked joints leave, in coordinates of the free ones."""
    if not locked:
        return np.eye(platform.shape[1])
    held = np.array([rows[name] for name in locked])
    _, s, vt = np.linalg.svd(held)
    return vt[np.count_nonzero(s >= SINGULAR) :].T
