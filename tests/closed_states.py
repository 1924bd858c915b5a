"""States of any closed chain, and differences along its motions: what the laws are tested on.

Nothing here knows a robot: configurations are random displacements of home with their loops closed, velocities and
accelerations are random motions that keep them closed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import stewart_pin as stp
from stewart_pin.model.description import LOOP_KINDS, JointKind
from tests.mechanisms import gear_train, two_bodies
from tests.zoo.table import ROBOTS, ROWS, zoo_chain

KINDS = (*(str(kind) for kind in LOOP_KINDS), "gear_train")
"""A mechanism per kind of closure, its frames and axes in general position; named after the kind."""
FEW = ("stewart", "delta", "five_bar", "four_bar", "rpr_planar")
"""Bundled robots that stand for the others where a check takes long: hexapod, rods, planar, one motor, serial legs."""
POSES = ("home", "generic", "symmetric", "near_singular")
_NEAR = 2e-3
"""Smallest singular value, in robot sizes, at which the walk towards a singularity stops."""


def slow_but_for_few(names: Iterable[str], few: Iterable[str] = FEW) -> list[Any]:
    """Parameters of a test: names, those beside the few marked as slow."""
    few = tuple(few)
    return [name if name in few else pytest.param(name, marks=pytest.mark.slow) for name in names]


NAMES = slow_but_for_few(stp.robots(), ROBOTS)
"""Every bundled robot; those with a row in the zoo slow."""


@cache
def robot(name: str) -> stp.ClosedChain:
    """Load a bundled robot or one of the zoo, or build one of the `KINDS` of closures, once: chains are immutable."""
    if name in ROWS:
        return zoo_chain(name)
    if name in KINDS:
        rng = np.random.default_rng(11)
        return (
            gear_train(rng, differential=True) if name == "gear_train" else two_bodies(JointKind(name), rng)
        )
    return stp.load(name)


@cache
def configuration(name: str, pose: str) -> np.ndarray:
    """Return a closed configuration of a bundled robot, of one of the kinds `POSES`."""
    chain = robot(name)
    rng = np.random.default_rng(7)
    match pose:
        case "home":
            return chain.q_home
        case "generic":
            return random_configuration(chain, rng)
        case "symmetric":
            # All motors by the same share of the robot's size: symmetric robots stay so.
            step = 0.1 * chain.tangent_scale[chain.motor_index]
            moved = stp.forward_kinematics(
                chain, stp.motor_positions(chain, chain.q_home) + step, limits=False, throw=False
            )
            return moved.q if moved.success else chain.q_home
        case _:
            return _walk_to_singularity(chain, rng)


def random_configuration(
    chain: stp.ClosedChain, rng: np.random.Generator, spread: float = 0.15, start: np.ndarray | None = None
) -> np.ndarray:
    """Displace every coordinate by up to `spread` robot sizes or radians, and close the loops."""
    start = chain.q_home if start is None else start
    for _ in range(20):
        step = rng.uniform(-spread, spread, chain.nv) * chain.tangent_scale
        closure = stp.close_loops(chain, pin.integrate(chain.model, start, step), throw=False)
        if closure.success:
            return closure.q
    raise AssertionError(f"no displacement of {chain.name} closes")


def random_motion(
    chain: stp.ClosedChain, rng: np.random.Generator, q: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Draw a velocity and an acceleration that keep the loops closed, of about one robot size per s and s²."""
    motions = chain.at(q).freedom.motions
    v = motions @ rng.normal(size=motions.shape[1])
    jacobian = stp.loop_jacobian(chain, q) * chain.tangent_scale
    a = -chain.tangent_scale * np.linalg.lstsq(jacobian, stp.loop_bias(chain, q, v), rcond=1e-10)[0]
    return v, a + motions @ rng.normal(size=motions.shape[1])


def along(chain: stp.ClosedChain, q: np.ndarray, v: np.ndarray, a: np.ndarray | None = None):
    """Curve on the configuration manifold with velocity `v` and acceleration `a` at time zero."""
    a = np.zeros_like(v) if a is None else a
    return lambda t: pin.integrate(chain.model, q, v * t + a * t**2 / 2)


def derivative(f: Callable[[float], np.ndarray | float], h: float = 1e-3) -> np.ndarray:
    """Central differences of order 4: with rates near one, h⁴/30 and eps/h are both near 1e-13."""
    return (8 * (np.asarray(f(h)) - f(-h)) - (np.asarray(f(2 * h)) - f(-2 * h))) / (12 * h)


def close(actual: np.ndarray, expected: np.ndarray, relative: float) -> None:
    """Require agreement relative to the largest expected entry: entries that cancel have no digits of their own."""
    actual, expected = np.asarray(actual), np.asarray(expected)
    assert actual.shape == expected.shape
    size = float(np.abs(expected).max(initial=0.0))
    error = float(np.abs(actual - expected).max(initial=0.0))
    assert error <= relative * max(size, 1e-300), f"relative error {error / max(size, 1e-300):.3g}"


def conditioning(chain: stp.ClosedChain, q: np.ndarray) -> float:
    """How well loops and motors together hold the robot, from 0 (singular) to about 1.

    Where the loops lose rank as the motors do, each alone may look well: a Delta whose rods lie in one plane.
    """
    jacobian = stp.loop_jacobian(chain, q) * chain.tangent_scale / chain.row_sizes[:, None]
    s = np.linalg.svd(np.vstack([jacobian, np.eye(chain.nv)[chain.motor_index]]), compute_uv=False)
    held = chain.nv - chain.at(q).freedom.idle.shape[1]
    return float(s[held - 1]) if held <= s.size else 0.0


def smallest_inertia(chain: stp.ClosedChain, q: np.ndarray) -> float:
    """Return the smallest inertia of all motions that keep the loops closed, lengths in robot sizes [kg m²]."""
    motions = chain.at(q).freedom.motions
    upper = np.triu(np.reshape(pin.crba(chain.model, pin.Data(chain.model), q), (chain.nv, chain.nv)))
    return float(np.linalg.eigvalsh(motions.T @ (upper + np.triu(upper, 1).T) @ motions)[0])


def _walk_to_singularity(chain: stp.ClosedChain, rng: np.random.Generator) -> np.ndarray:
    """From the worst conditioned of some random configurations, down the slope of the smallest singular value."""
    q = min((random_configuration(chain, rng, 0.4) for _ in range(10)), key=lambda q: conditioning(chain, q))
    worst, reach = conditioning(chain, q), 0.3
    for _ in range(40):
        if worst < _NEAR or reach < 1e-3:
            break
        motions = chain.at(q).freedom.motions
        slope = np.array([conditioning(chain, _moved(chain, q, 1e-4 * n)) - worst for n in motions.T]) / 1e-4
        # Newton's step to one half of the threshold: onto the singularity itself the laws do not hold.
        step = -slope * (worst - _NEAR / 2) / max(float(slope @ slope), 1e-12)
        trial = _moved(chain, q, motions @ step * min(1.0, reach / max(np.linalg.norm(step), 1e-12)))
        value = conditioning(chain, trial)
        if _NEAR / 4 < value < worst and np.abs(stp.loop_gap(chain, trial)).max(initial=0.0) < 1e-10:
            q, worst = trial, value
        else:
            reach /= 2
    return q


def _moved(chain: stp.ClosedChain, q: np.ndarray, step: np.ndarray) -> np.ndarray:
    return stp.close_loops(chain, pin.integrate(chain.model, q, step), throw=False).q
