"""How a public verb is asked of a chain however it is told, and its answer brought back to plain terms.

A verb is a function of a `Telling` and a `Case`; it returns arrays by name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from tests.retelling.case import TIMES, Case, sway
from tests.retelling.telling import Telling


@dataclass(frozen=True, eq=False)
class Sized:
    """An answer that may happen to be zero, with what it would usually be."""

    value: Any
    size: float


Answers = dict[str, Any]
Verb = Callable[[Telling, Case], Answers]
VERBS: dict[str, Mapping[str, Verb]] = {}
"""How each public name is asked, by name of the question."""
QUESTIONS: dict[str, Verb] = {}
"""Every question by its name."""
KINDS: dict[str, str] = {}
"""Kind of each question: quick, slow, or compiled, which takes seconds."""


def asks(*names: str, kind: str = "quick") -> Callable[[Verb], Verb]:
    """Enter a question for the public names that it asks."""

    def enter(verb: Verb) -> Verb:
        question = verb.__name__.strip("_")
        for name in names:
            VERBS[name] = {**VERBS.get(name, {}), question: verb}
        QUESTIONS[question], KINDS[question] = verb, kind
        return verb

    return enter


def told_pose(t: Telling, c: Case, q: np.ndarray) -> pin.SE3:
    """Tell a pose; printed digits tilt what a planar platform can reach, so that it is asked for its own."""
    if t.exact:
        return t.world * stp.platform_pose(c.chain, q)
    return stp.platform_pose(t.chain, t.state(q)[0])


def told_motion(t: Telling, c: Case, scale: float, times: np.ndarray = TIMES) -> stp.motions.PlatformSamples:
    """Tell a motion of the platform, or have the told chain make its own."""
    if t.exact:
        return t.samples(c.motion(scale, tuple(times)))
    return sway(
        t.chain,
        t.readings(stp.motor_positions(c.chain, c.chain.q_home)),
        t.efforts(c.amplitude(scale)),
        t.sizes(c.frequency),
        times,
    )


def told_wrenches(t: Telling, c: Case, q: np.ndarray) -> dict[str, np.ndarray]:
    """Tell a wrench on every link with mass: its frame may stand elsewhere in the link, its axes are the world's."""
    rng, unit = np.random.default_rng(5), c.effort * np.repeat([1.0, c.chain.length_scale], 3)
    plain, told = _origins(c.chain, q), _origins(t.chain, t.state(q)[0])
    found = {}
    for link in c.chain.mechanism.links:
        if link.inertia is None and link.name != c.chain.platform:
            continue
        wrench = t.turned(unit * rng.normal(size=6))
        arm = t.world * plain[link.name] - told[link.name]
        found[link.name] = np.concatenate([wrench[:3], wrench[3:] + np.cross(arm, wrench[:3])])
    return found


def _origins(chain: stp.ClosedChain, q: np.ndarray) -> dict[str, np.ndarray]:
    model, data = chain.model, pin.Data(chain.model)
    pin.framesForwardKinematics(model, data, q)
    return {
        link.name: np.array(data.oMf[model.getFrameId(link.name, pin.FrameType.BODY)].translation)
        for link in chain.mechanism.links
    }


def keeps_closed(c: Case, q: np.ndarray) -> np.ndarray:
    """Draw a velocity that keeps the loops closed."""
    return stp.dynamics.motion_map(c.chain, q).G @ c.v[c.chain.motor_index]


def moves(t: Telling, q: np.ndarray, v: np.ndarray, a: np.ndarray, note: str = "") -> Answers:
    told = t.chain.at(q, v)
    answers = {
        "motors" + note: t.motors(a[t.chain.motor_index]),
        "platform" + note: t.twists(told.P @ a + told.platform_bias),
    }
    return answers | ({"a" + note: t.tangent(a)} if t.joint_by_joint else {})
