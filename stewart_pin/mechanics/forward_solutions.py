"""Several configurations of the same motor positions, of any chain, by many starts. Never a promise to have all."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from stewart_pin.brief import Brief
from stewart_pin.checks import as_array, as_count
from stewart_pin.model.description import JointKind
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.configurations import random_configuration, unwound
from stewart_pin.state.newton import LARGEST_STEP, MAX_ITERATIONS, Closure, solve
from stewart_pin.state.paths import motor_path
from stewart_pin.state.state import State, as_chain
from stewart_pin.typing import ArrayLike, Configuration, FloatArray

_SAME = 1e-6
"""Configurations nearer than this are one: Newton's residual of 1e-14 moves a double root by its square root [1]."""

_FARTHEST = 1000.0
"""Most steps on top of the usual ones for motors that stand far away: a coupled motor's fifty turns."""


@dataclass(frozen=True, eq=False, repr=False)
class ForwardSolutions(Brief):
    """Configurations found for given motor positions.

    Attributes
    ----------
    closures
        One per configuration, those found most often first.
    poses
        Platform frame in the world of each.
    hits
        Number of starts that led to each.
    starts
        Number of starts.
    missed_share
        Estimated probability that one more start would find a new one: solutions seen once, per start that
        converged (Good and Turing). A small number makes further solutions unlikely, not impossible.
    complete
        Always False: many starts find solutions, they cannot prove that there are no others.
    """

    closures: tuple[Closure, ...]
    poses: tuple[pin.SE3, ...]
    hits: tuple[int, ...]
    starts: int
    missed_share: float
    complete: bool = False


def all_forward_kinematics(
    chain: ClosedChain, q_motor: ArrayLike, *, starts: int = 200, seed: int = 0, limits: bool = True
) -> ForwardSolutions:
    """Search configurations of given motor positions from seeded random starts.

    Parameters
    ----------
    chain
        Closed chain.
    q_motor
        (nu,) motor positions in the order of ``chain.motors`` [m or rad].
    starts
        Number of starts: home, and random configurations, within the joint limits where there are any.
    seed
        Of the random starts.
    limits
        Whether joint limits must hold. Without limits, legs on universal joints stand in two ways for every pose.

    Returns
    -------
    ForwardSolutions
        Distinct configurations; links that only idle freedoms move are not told apart. For six-legged platforms
        `assembly_modes` finds all of them, with proof.

    Raises
    ------
    MissingRoleError
        If the chain has no motors, or no platform.
    InputError
        If there is no start or there are more than a million, or the seed is no whole number from 0 on.
    """
    as_chain(chain)
    chain.require_motors()
    chain.platform_link  # noqa: B018 - raises
    target = as_array("q_motor", q_motor, (chain.nu,))
    starts = as_count("starts", starts, 1)
    rng = np.random.default_rng(as_count("seed", seed, most=None))
    home = chain.at(chain.q_home)
    system = motor_path(home, target).system(chain)
    told_apart = _joints_told_apart(chain)
    found: list[tuple[FloatArray, Closure]] = []
    hits: list[int] = []
    for start in range(starts):
        guess = chain.q_home if start == 0 else random_configuration(chain, rng)
        guess = _wound(chain, guess, target)
        away = np.abs(guess[chain.motor_q_index] - target) / chain.tangent_scale[chain.motor_index]
        steps = MAX_ITERATIONS + int(min(_FARTHEST, np.max(away, initial=0.0) / LARGEST_STEP))
        closure = solve(chain, guess, system, max_iterations=steps)
        closure = replace(closure, state=State(chain, unwound(chain, closure.q, asked=chain.motors)))
        if not closure.success or (limits and chain.judge.positions(closure.q, slack=_SAME)):
            continue
        mark = _placements(chain, closure.q, told_apart)
        for k, (other, _) in enumerate(found):
            if np.abs(mark - other).max(initial=0.0) < _SAME:
                hits[k] += 1
                break
        else:
            found.append((mark, closure))
            hits.append(1)
    order = np.argsort(-np.array(hits), kind="stable")
    closures = tuple(found[k][1] for k in order)
    return ForwardSolutions(
        closures=closures,
        poses=tuple(_pose(chain, closure.q) for closure in closures),
        hits=tuple(hits[k] for k in order),
        starts=starts,
        missed_share=hits.count(1) / sum(hits) if hits else 1.0,
    )


def _wound(chain: ClosedChain, guess: Configuration, target: FloatArray) -> Configuration:
    """Turn motors to within half a turn of where they shall stand, unless a coupling or a cable counts the turns."""
    guess = np.array(guess)
    counted = {
        name for coupling in chain.mechanism.couplings for name in coupling.joints
    } | chain.mechanism.reels
    for name, at, wanted in zip(chain.motors, chain.motor_q_index, target, strict=True):
        if chain.mechanism.joint(name).kind is JointKind.REVOLUTE and name not in counted:
            guess[at] += 2 * np.pi * np.round((wanted - guess[at]) / (2 * np.pi))
    return guess


def _joints_told_apart(chain: ClosedChain) -> np.ndarray:
    """Joints whose placement no idle freedom changes."""
    idle = np.abs(chain.at(chain.q_home).freedom.idle).max(axis=1, initial=0.0) > _SAME
    moved = np.zeros(chain.model.njoints, dtype=bool)
    for k in range(1, chain.model.njoints):
        joint = chain.model.joints[k]
        moved[k] = moved[chain.model.parents[k]] or idle[joint.idx_v : joint.idx_v + joint.nv].any()
    return np.flatnonzero(~moved)[1:]


def _placements(chain: ClosedChain, q: Configuration, joints: np.ndarray) -> FloatArray:
    """Rotations and translations (in robot sizes) of joints and platform: the same for the same configuration."""
    data = pin.Data(chain.model)
    pin.forwardKinematics(chain.model, data, q)
    frames = [data.oMi[int(k)] for k in joints]
    frames.append(pin.updateFramePlacement(chain.model, data, chain.platform_id))
    return np.concatenate(
        [np.append(frame.rotation.ravel(), frame.translation / chain.length_scale) for frame in frames]
    )


def _pose(chain: ClosedChain, q: Configuration) -> pin.SE3:
    data = pin.Data(chain.model)
    pin.forwardKinematics(chain.model, data, q)
    return pin.SE3(pin.updateFramePlacement(chain.model, data, chain.platform_id))
