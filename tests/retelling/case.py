"""What is asked of a robot, in its plain coordinates: states, motions of the platform, readings of its motors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, lru_cache

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from tests.closed_states import configuration
from tests.joint_physics import with_own_physics


@dataclass(frozen=True, eq=False)
class Case:
    """A robot with what it is asked.

    Attributes
    ----------
    chain
        The robot as it is bundled.
    q, v, a
        A state in general position that keeps the loops closed.
    tau_motor
        Motor efforts.
    q_open
        A configuration with open loops, near `q`.
    near
        A closed configuration near home.
    """

    chain: stp.ClosedChain
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    tau_motor: np.ndarray
    q_open: np.ndarray
    near: np.ndarray

    @property
    def effort(self) -> float:
        """An effort that is not small: the weight, along a length where motors turn [N or N m]."""
        mass = sum(body.mass for body in self.chain.model.inertias)
        lengths = self.chain.tangent_scale[self.chain.motor_index].max(initial=0.0)
        return 9.81 * mass * (1.0 if lengths != 1.0 else self.chain.length_scale)

    def amplitude(self, scale: float) -> np.ndarray:
        """(nu,) swing of each motor, a part of the robot's size or of a radian."""
        return 0.03 * scale * self.chain.tangent_scale[self.chain.motor_index]

    @property
    def frequency(self) -> np.ndarray:
        """(nu,) of each motor [Hz]."""
        return 1 + 0.1 * np.arange(self.chain.nu)

    @lru_cache  # noqa: B019 - cases are kept
    def motion(self, scale: float, times: tuple[float, ...]) -> stp.motions.PlatformSamples:
        """Sway the motors about home."""
        home = stp.motor_positions(self.chain, self.chain.q_home)
        return sway(self.chain, home, self.amplitude(scale), self.frequency, np.array(times))


TIMES = np.linspace(0, 1, 5)


def sway(
    chain: stp.ClosedChain, home: np.ndarray, amplitude, frequency, times
) -> stp.motions.PlatformSamples:
    """Move the platform as motors do that swing about a position, each at its own frequency."""
    w = 2 * np.pi * frequency
    poses, twists, accelerations = [], [], []
    for t in times:
        q = stp.forward_kinematics(chain, home + amplitude * np.sin(w * t)).q
        v = stp.dynamics.motion_map(chain, q).G @ (amplitude * w * np.cos(w * t))
        there = stp.dynamics.motion_map(chain, q, v)
        a = there.G @ (-amplitude * w**2 * np.sin(w * t)) + there.gamma
        state = chain.at(q, v)
        poses.append(state.pose)
        twists.append(state.twist)
        accelerations.append(state.P @ a + state.platform_bias)
    return stp.motions.PlatformSamples(
        np.asarray(times),
        np.array([pose.translation for pose in poses]),
        np.array([pose.rotation for pose in poses]),
        np.array(twists),
        np.array(accelerations),
    )


REAL = " with real joints"
"""After the name of a robot: with rotors, springs, damping and dry friction."""


@cache
def plain(name: str) -> stp.ClosedChain:
    """Load a bundled robot; arms whose home is stretched, a singularity, get another home."""
    if name.endswith(REAL):
        chain = with_own_physics(plain(name.removesuffix(REAL)), anywhere=True)
        loose = {
            each: {"stiffness": 0.0}
            for each in [
                *(joint.name for joint in chain.mechanism.joints if joint.kind == "spherical"),
                *(loop.name for loop in chain.loops if loop.kind == "spherical"),
            ]
        }  # the rest of a ball's spring stands in its frames, which tellings turn
        real = stp.with_joint_physics(chain, loose)
        return replace(real, mechanism=replace(real.mechanism, name=name))
    chain = stp.load(name)
    if not name.startswith("arm"):
        return chain
    return replace(chain, q_home=np.array([0.4, 0.9, 0.7, 0.8, -0.3, 0.6, 0.2])[: chain.nq])


@cache
def case(name: str) -> Case:
    """Draw what is asked of a robot, always the same."""
    chain, rng = plain(name), np.random.default_rng(3)
    q = configuration(name.removesuffix(REAL), "generic")
    rates = rng.normal(size=chain.nu) * chain.tangent_scale[chain.motor_index]
    accelerations = rng.normal(size=chain.nu) * chain.tangent_scale[chain.motor_index]
    v = stp.dynamics.motion_map(chain, q).G @ rates
    map_ = stp.dynamics.motion_map(chain, q, v)
    a = map_.G @ accelerations + map_.gamma
    effort = stp.inverse_dynamics(chain, q, v, a)
    wander = lambda spread: pin.integrate(  # noqa: E731
        chain.model, q, spread * rng.uniform(-1, 1, chain.nv) * chain.tangent_scale
    )
    step = 0.05 * rng.uniform(-1, 1, chain.nu) * chain.tangent_scale[chain.motor_index]
    near = stp.forward_kinematics(chain, stp.motor_positions(chain, chain.q_home) + step).q
    return Case(chain, q, v, a, effort.tau_motor * rng.uniform(0.5, 1.5, chain.nu), wander(0.02), near)
